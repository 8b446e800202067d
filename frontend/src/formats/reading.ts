// Bytes of a file that a user has chosen, read in pieces: headers first, voxels only after all sizes are checked.

import { MOST_PACKED } from "../generated.ts";
import type { Vector3 } from "../types.ts";

/** A file that cannot be read, in a sentence for the user. */
export class FileError extends Error {}

const MOST_BYTES = 2 ** 30; // of voxels as stored: a phone holds no more, and half of it is copied once
const MOST_BEHIND = 2 ** 22; // bytes behind the voxels that are looked at for the check sum of gzip

export interface Work {
  progress?: (share: number) => void;
  /** Ends the work */
  signal?: AbortSignal;
}

export type VoxelType = "u1" | "i1" | "u2" | "i2" | "u4" | "i4" | "u8" | "i8" | "f4" | "f8";

/** Voxels as a file holds them. */
export type Stored =
  | Uint8Array
  | Int8Array
  | Uint16Array
  | Int16Array
  | Uint32Array
  | Int32Array
  | BigUint64Array
  | BigInt64Array
  | Float32Array
  | Float64Array;

const ARRAYS: Record<VoxelType, new (buffer: ArrayBuffer) => Stored> = {
  u1: Uint8Array,
  i1: Int8Array,
  u2: Uint16Array,
  i2: Int16Array,
  u4: Uint32Array,
  i4: Int32Array,
  u8: BigUint64Array,
  i8: BigInt64Array,
  f4: Float32Array,
  f8: Float64Array,
};

/** Text from a file made fit for a message. */
export function shownText(text: unknown) {
  const plain = String(text),
    cut = plain.length > 120 ? `${plain.slice(0, 120)}...` : plain;
  return cut.replace(/[^\P{C}]/gu, "?");
}

/** Whole numbers of a header's field. */
export function integersOf(field: string, text: string, count: number) {
  const words = text.split(/\s+/).filter(Boolean);
  if (words.length !== count || !words.every((word) => /^[+-]?\d{1,19}$/.test(word))) {
    throw new FileError(`the field '${field}' should be ${count} whole numbers but is '${shownText(text)}'.`);
  }
  return words.map(Number);
}

/** The whole number of a header's field. */
export function integerOf(field: string, text: string) {
  return integersOf(field, text, 1)[0]!;
}

/** Numbers of a header's field; NaN and infinity are for the caller to refuse. */
export function floatsOfText(field: string, text: string, count: number | null = null) {
  const words = text.split(/\s+/).filter(Boolean);
  const isNumber = (word: string) => /^[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)$/i.test(word);
  if (words.length > 100 || (count !== null && words.length !== count) || !words.every(isNumber)) {
    throw new FileError(`the field '${field}' should be numbers but is '${shownText(text)}'.`);
  }
  return words.map((word) =>
    /nan/i.test(word) ? Number.NaN : /inf/i.test(word) ? (word.startsWith("-") ? -Infinity : Infinity) : Number(word),
  );
}

export function shownBytes(count: number) {
  const units = ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"];
  let size = count,
    k = 0;
  while (size >= 1024 && k < units.length - 1) {
    size /= 1024;
    k += 1;
  }
  return `${k ? size.toFixed(1) : size} ${units[k]}`;
}

/** Sizes [nz, ny, nx] of the sizes along x, y, z and beyond. */
export function volumeShape(sizes: number[], itemsize: number, notes: string[]): Vector3 {
  if (!sizes.length || Math.min(...sizes) < 1) {
    throw new FileError(`every size must be at least 1 voxel, but the sizes along x, y, z are ${sizes.join(", ")}.`);
  }
  const real = [...sizes];
  while (real.length > 3 && real.at(-1) === 1) real.pop();
  if (real.length > 3) {
    throw new FileError(
      `a volume has three axes but this file has ${real.length} (${real.join(" x ")}). Save one ` +
        "time point or one channel as a separate file and open that.",
    );
  }
  if (sizes.length < 3) notes.push("a 2-D image was taken as a volume of one slice");
  const [nx = 1, ny = 1, nz = 1] = real,
    bytes = nx * ny * nz * itemsize;
  if (bytes > MOST_BYTES) {
    throw new FileError(
      `its voxels (${real.join(" x ")}) take ${shownBytes(bytes)}, more than the ` +
        `${shownBytes(MOST_BYTES)} that this page holds. Open it with deformnb app, or save it coarser.`,
    );
  }
  return [nz, ny, nx];
}

/** Bytes of a file one after the other, unpacked if need be. */
export class ByteReader {
  size: number;
  reader: ReadableStreamDefaultReader<Uint8Array<ArrayBuffer>>;
  rest: Uint8Array<ArrayBuffer>;

  /** @param isPacked whether by gzip */
  constructor(
    blob: Blob,
    readonly isPacked: boolean,
  ) {
    this.size = blob.size;
    const stream = blob.stream() as ReadableStream<Uint8Array<ArrayBuffer>>;
    this.reader = (isPacked ? stream.pipeThrough(new DecompressionStream("gzip")) : stream).getReader();
    this.rest = new Uint8Array(0);
  }

  /** The next piece, null at the end. */
  async #next() {
    if (this.rest.length) {
      const { rest } = this;
      this.rest = new Uint8Array(0);
      return rest;
    }
    try {
      const { done, value } = await this.reader.read();
      return done ? null : value;
    } catch (error) {
      if (this.isPacked && /junk|trailing/i.test(`${error}`)) return null; // behind the end and its check sum
      if (!this.isPacked) throw new FileError(`it cannot be read (${shownText(error)}).`);
      throw new FileError(
        "it cannot be unpacked: it is damaged, cut short, or packed in several parts. Unpack it, " + "and open that.",
      );
    }
  }

  /** Fill an array with the next bytes; returns how many there were. */
  async fill(target: Uint8Array<ArrayBuffer>, { progress, signal }: Work = {}) {
    let at = 0;
    while (at < target.length) {
      signal?.throwIfAborted();
      const piece = await this.#next();
      if (!piece) break;
      const taken = Math.min(piece.length, target.length - at);
      target.set(taken < piece.length ? piece.subarray(0, taken) : piece, at);
      this.rest = piece.subarray(taken);
      at += taken;
      progress?.(at / target.length);
    }
    return at;
  }

  /** The next bytes, fewer at the end of the file. */
  async take(count: number) {
    const target = new Uint8Array(count);
    return target.subarray(0, await this.fill(target));
  }

  async skip(count: number) {
    for (let left = count; left > 0; ) {
      const piece = await this.#next();
      if (!piece) return;
      this.rest = piece.subarray(Math.min(left, piece.length));
      left -= Math.min(left, piece.length);
    }
  }

  /**
   * The next voxels. Their bytes are counted before there is an array for them.
   * @param isBig whether the highest byte is the first
   * @param before bytes that were read
   */
  async voxels(type: VoxelType, isBig: boolean, count: number, before: number, work: Work) {
    const bytes = count * Number(type[1]),
      most = this.isPacked ? this.size * MOST_PACKED : this.size - before;
    if (bytes > most) this.#refuseTruncated(Math.max(0, most), bytes);
    let target: Uint8Array<ArrayBuffer>;
    try {
      target = new Uint8Array(bytes);
    } catch {
      throw new FileError(`there is not enough memory for its ${shownBytes(bytes)} of voxels; save it coarser.`);
    }
    const found = await this.fill(target, work);
    if (found < bytes) this.#refuseTruncated(found, bytes);
    if (this.isPacked) await this.skip(MOST_BEHIND); // to the check sum at the end
    await this.close();
    const isLittleHere = new Uint8Array(new Uint16Array([1]).buffer)[0] === 1;
    if (isBig === isLittleHere) swapBytes(target, Number(type[1]));
    return new ARRAYS[type](target.buffer);
  }

  #refuseTruncated(found: number, wanted: number): never {
    throw new FileError(
      `its header announces ${shownBytes(wanted)} of voxels but the file holds at most ` +
        `${shownBytes(found)}; it is cut short or its header is damaged.`,
    );
  }

  async close() {
    await this.reader.cancel().catch(() => {});
  }
}

/** @param size of a number */
function swapBytes(bytes: Uint8Array, size: number) {
  if (size === 1) return;
  for (let at = 0; at < bytes.length; at += size) {
    for (let low = at, high = at + size - 1; low < high; low++, high--) {
      const byte = bytes[low]!;
      bytes[low] = bytes[high]!;
      bytes[high] = byte;
    }
  }
}
