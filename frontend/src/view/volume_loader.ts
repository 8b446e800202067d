// Loading of the voxels from Python: packed pieces are requested, unpack and put together.

import type { Chunk } from "../generated.ts";
import { bytesOf } from "../sync/buffers.ts";
import type { Vector3 } from "../types.ts";
import type { Bytes } from "./types.ts";

const IN_FLIGHT = 2; // pieces in flight: the second hides the round trip of the first
const LOADER_PATIENCE = 5000; // milliseconds without any piece, after which those in flight are taken for lost
const LOADER_TRIES = 3; // each waits twice as long as the one before

async function unpack(bytes: Uint8Array<ArrayBuffer>) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export class VolumeLoader {
  id: string;
  chunks: number;
  requested = 0; // pieces that have been requested
  isOver = false;
  isStuck = false;
  tries = 0;
  timer = 0;
  values: Uint8Array<ArrayBuffer>;
  missing: Set<number>;

  /**
   * @param info of the volume; chunks: the number of pieces
   * @param request requests a piece
   * @param stuck gets true where pieces have been lost repeatedly, false once one has arrived
   */
  constructor(
    { id, shape, chunks }: { id: string; shape: Vector3; chunks: number },
    readonly request: (index: number) => void,
    readonly progress: (share: number) => void,
    readonly stuck: (isStuck: boolean) => void = () => {},
  ) {
    this.id = id;
    this.chunks = chunks;
    this.values = new Uint8Array(shape[0] * shape[1] * shape[2]);
    this.missing = new Set(Array.from({ length: chunks }, (_, index) => index));
    progress(0);
    while (this.requested < Math.min(IN_FLIGHT, chunks)) request(this.requested++);
    this.#watch();
  }

  /**
   * Take a piece; returns the values once all are here, else null. With a `lag` it holds differences from the voxels so
   * far before.
   */
  async receive({ id, index, start, lag = 0 }: Chunk, packed: Bytes) {
    if (id !== this.id || this.isOver || !this.missing.has(index)) return null; // of another volume, or a duplicate
    let voxels = null;
    try {
      voxels = await unpack(bytesOf(packed));
    } catch {
      /* damaged in transit: requested again after a while */
    }
    if (this.isOver || !this.missing.has(index)) return null;
    if (!voxels || start + voxels.length > this.values.length) return null;
    if (lag > 0) for (let i = lag; i < voxels.length; i++) voxels[i]! += voxels[i - lag]!;
    this.values.set(voxels, start);
    this.missing.delete(index);
    this.tries = 0;
    this.#setStuck(false);
    this.progress((this.chunks - this.missing.size) / this.chunks);
    if (this.missing.size === 0) {
      this.close();
      return this.values;
    }
    if (this.requested < this.chunks) this.request(this.requested++);
    this.#watch();
    return null;
  }

  /** Request the pieces again that have been requested and have not arrived. */
  again() {
    this.tries = 0;
    this.#setStuck(false);
    this.#requestMissing();
  }

  close() {
    this.isOver = true;
    clearTimeout(this.timer);
  }

  #requestMissing() {
    for (const index of this.missing) if (index < this.requested) this.request(index);
    this.#watch();
  }

  #watch() {
    clearTimeout(this.timer);
    this.timer = setTimeout(
      () => {
        this.tries += 1;
        if (this.tries > LOADER_TRIES)
          this.#setStuck(true); // a late piece is accepted too
        else this.#requestMissing();
      },
      LOADER_PATIENCE * 2 ** this.tries,
    );
  }

  #setStuck(isStuck: boolean) {
    if (isStuck !== this.isStuck) this.stuck(isStuck);
    this.isStuck = isStuck;
  }
}
