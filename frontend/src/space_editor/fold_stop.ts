// The stop of drags and keys in space before tissue folds. Python checks the end of each on a finer lattice; maps of more
// than the points (cuts, rigid parts, stages, a fit forward) are checked by Python alone.

import { NEARLY_FOLDED } from "../generated.ts";
import { SafeShare } from "../maths/safe_share.ts";
import type { SpacePoint } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

export class SpaceFoldStop {
  note = ""; // the reason why a drag was stopped
  /** The smallest det J before the drag. */
  #least0: number | null = null;
  #start: SpacePoint[] = [];
  #share = new SafeShare();

  constructor(readonly editor: SpaceParts<"model" | "points" | "map">) {}

  get isOn() {
    const { map, model } = this.editor;
    return Boolean(model.get("stop_at_folds")) && map.isKnown;
  }

  /** A drag or a key begins. */
  begin() {
    Object.assign(this, { note: "" });
    this.#least0 = null;
    this.#start = this.editor.points.list;
    this.#share.reset();
  }

  #isRefused(points: SpacePoint[]) {
    const { map } = this.editor;
    this.#least0 ??= map.leastOf(this.#start);
    return map.leastOf(points) < Math.min(NEARLY_FOLDED, this.#least0) - 1e-9;
  }

  /** Points as far as the map stays free of folds, while the stop is on: from `make(0)` to `make(1)`. */
  limit(make: (share: number) => SpacePoint[]) {
    const wanted = make(1);
    this.note = "";
    if (!this.isOn || !this.#isRefused(wanted)) {
      this.#share.reset();
      return wanted;
    }
    this.note = "Stopped before tissue folds; T lets the drag continue";
    return make(this.#share.find(make, (points) => this.#isRefused(points)));
  }
}
