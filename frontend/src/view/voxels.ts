// The voxels of a live view: fetched piece by piece, then given to the GPU.

import type { Chunk } from "../generated.ts";
import type { Vector3 } from "../types.ts";
import { pageElement } from "../ui/dom.ts";
import type { RayCaster } from "../webgl/raycaster.ts";
import type { VolumeData } from "../webgl/types.ts";
import { MemoryError, NOT_HELD } from "../webgl/voxel_textures.ts";
import type { Bytes, VolumeInfo } from "./types.ts";
import type { ViewElements, ViewMessages } from "./view_elements.ts";
import { VolumeLoader } from "./volume_loader.ts";

const FEWEST = 32 ** 3; // the fewest voxels worth drawing

/** Metadata of a volume for a ray caster, next to its values. */
export function volumeData({ shape, spacing, outside, grey, share, is_labels: isLabels, box }: VolumeInfo): VolumeData {
  return { shape, spacing, outside, isLabels, grey, share, box: { low: box.low, high: box.high }, ownBox: box };
}

/** Dependencies of the voxels on their view. */
export interface VoxelsView {
  readonly info: VolumeInfo | null;
  readonly caster: RayCaster | null;
  readonly field: unknown;
  messages: ViewMessages;
  elements: ViewElements;
  /** Request the missing values from Python, of so many voxels at most. */
  hello(voxels?: number): void;
  setTable(): void;
  /** All are on the GPU. */
  handleUpload(): void;
}

export class LiveVoxels {
  values: Uint8Array | null = null; // once all are here
  loader: VolumeLoader | null = null;
  isScarce = false; // whether the GPU did not hold all voxels
  received = 0; // bytes

  #progress: HTMLDivElement;

  constructor(private readonly view: VoxelsView) {
    this.#progress = pageElement("div", "dnb-progress", view.elements.root, {
      role: "progressbar",
      "aria-label": "loading the volume",
    });
  }

  /** Forget those that are here. */
  drop() {
    this.values = null;
    this.loader?.close();
    this.loader = null;
  }

  load(info: VolumeInfo) {
    this.loader = new VolumeLoader(
      info,
      (index) => this.view.messages.send({ type: "chunk", id: info.id, index }),
      (share) => this.#setProgress(0.8 * share),
      (isStuck) => this.#setStuck(isStuck),
    );
  }

  #setStuck(isStuck: boolean) {
    const { elements } = this.view;
    const again = () => {
      if (!this.view.field) this.view.hello();
      this.loader?.again();
    };
    elements.messages.set("voxels", isStuck ? "The volume does not arrive. Is the kernel running?" : "", {
      kind: "error",
      actions: [{ name: "again", text: "Try again", act: again }],
    });
  }

  #setProgress(share: number) {
    this.#progress.style.setProperty("--share", String(share));
    this.#progress.setAttribute("aria-valuenow", String(Math.round(100 * share)));
    this.#progress.hidden = share >= 1;
  }

  async receive(content: Chunk, packed: Bytes) {
    const { loader, view } = this;
    if (!loader || loader.id !== content.id) return;
    this.received += packed.byteLength;
    const values = await loader.receive(content, packed);
    if (!values || !view.info) return;
    this.values = values;
    await this.upload(view.info, values);
  }

  /** Request half of the voxels, since the GPU does not hold the volume, until they are too few to look at. */
  requestFewer(shape: Vector3, why = new MemoryError(NOT_HELD)) {
    const fewer = Math.floor((shape[0] * shape[1] * shape[2]) / 2);
    if (fewer < FEWEST) throw why;
    this.isScarce = true;
    this.loader = null;
    this.values = null;
    this.view.hello(fewer);
  }

  async upload(info: VolumeInfo, values: Uint8Array) {
    const { view } = this,
      { caster } = view;
    if (!caster) return;
    const tick = (done: number) =>
      new Promise<void>((resolve) => {
        this.#setProgress(0.8 + 0.19 * done);
        setTimeout(resolve, 0);
      });
    let done = false;
    try {
      const uploaded = caster.voxels.setVolume(values, volumeData(info), tick);
      this.loader = null;
      view.setTable(); // now, for these voxels: once they are up it would be fitted to them a second time
      done = await uploaded;
    } catch (error) {
      if (!(error instanceof MemoryError)) throw error;
      if (caster === view.caster && info === view.info) this.requestFewer(info.shape, error);
      return;
    }
    if (!done || caster !== view.caster) return;
    view.handleUpload();
    this.#setProgress(1);
  }
}
