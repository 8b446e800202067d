// The camera of a view: it follows the trait `camera` and frames the bounding box of the view.

import { perAxis } from "../maths/axes.ts";
import { Camera } from "../maths/camera.ts";
import { type Clip, isClipped, UNCLIPPED } from "../maths/clipping.ts";
import type { Sides } from "../types.ts";
import { boxCorners } from "../ui/view_parts.ts";
import type { CameraTrait, ViewDirection, VolumeViewLike } from "./types.ts";

const PERSPECTIVE = 0.7; // bend of a camera with perspective

export class ViewCamera extends Camera {
  isWriting = false;

  constructor(readonly view: VolumeViewLike) {
    super();
  }

  /** Facts about the volume; there must be one. */
  get info() {
    const { info } = this.view;
    if (!info) throw new Error("there is no volume yet");
    return info;
  }

  /** The bounding box of the view, in the volume's own frame. */
  get box() {
    return this.view.field?.box || this.info.box;
  }

  /** The part of the box that is framed: the trait's share of the volume's own, and what the result has beyond that. */
  get framed(): Sides {
    const { box } = this,
      whole = this.info.own ?? this.info.box,
      shares: Clip = this.view.model.get("frame") ?? UNCLIPPED;
    if (!isClipped(shares)) return box;
    const size = perAxis((i) => whole.high[i] - whole.low[i]);
    return {
      low: perAxis((i) => {
        const low = whole.low[i] + shares[i][0] * size[i];
        return box.low[i] < whole.low[i] - 1e-6 * size[i] ? Math.min(low, box.low[i]) : low;
      }),
      high: perAxis((i) => {
        const high = whole.low[i] + shares[i][1] * size[i];
        return box.high[i] > whole.high[i] + 1e-6 * size[i] ? Math.max(high, box.high[i]) : high;
      }),
    };
  }

  /** The middle of the framed box, in the volume's own frame. */
  get middle() {
    const { low, high } = this.framed;
    return perAxis((i) => (low[i] + high[i]) / 2);
  }

  /** Pictures side by side. */
  get parts() {
    return this.view.shown === "side_by_side" ? 2 : 1;
  }

  /** Width by height of one picture. */
  get aspect() {
    const [width, height] = this.view.pixels;
    return width / this.parts / height;
  }

  /** The length in space that the picture is high when all of the box is seen. */
  get full() {
    return this.fit(boxCorners(this.framed, this.info.axes), this.aspect);
  }

  /** The value of the trait. */
  get trait() {
    const { direction, up, pan, height } = this;
    return { ...this.view.model.get("camera"), direction, up, pan: [...pan], zoom: this.full / height };
  }

  /** Take the value of the trait, but not while the user turns the picture; false if it did not. */
  read(isForced = false) {
    const { view } = this;
    if (!view.info || (!isForced && (this.isWriting || view.pointer.isBusy))) return false;
    const camera: CameraTrait = view.model.get("camera") || {};
    this.look(camera.direction || [0.4, 1, -0.3], camera.up);
    this.pan = [...(camera.pan || [0, 0])];
    this.bend = camera.perspective ? PERSPECTIVE : 0;
    this.height = this.full / (camera.zoom || 1);
    return true;
  }

  /** The camera in the volume's own frame, for a picture of this width by height. */
  forAspect(aspect: number) {
    return this.frameCamera(this.info.to_frame, this.middle, aspect);
  }

  write() {
    const { view } = this;
    this.isWriting = true; // our own change must not come back as if Python had made it
    view.model.set("camera", this.trait);
    view.model.save_changes();
    this.isWriting = false;
  }

  /** Apply a change of the shape of the picture or of the box: the zoom stays, not the scale. */
  reframe(change: () => void) {
    const zoom = this.view.info ? this.full / this.height : 0;
    change();
    if (zoom) this.height = this.full / zoom;
  }

  /** Keep some of the box in the picture, wherever it is moved. */
  keepBoxInView() {
    this.keepInView(boxCorners(this.framed, this.info.axes), this.aspect);
  }

  /** Fit all of the box into the view. */
  seeAll({ direction, up }: ViewDirection) {
    this.look(direction, up);
    this.pan = [0, 0];
    this.height = this.full;
  }
}
