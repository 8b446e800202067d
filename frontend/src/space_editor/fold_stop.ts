// The stop of drags and keys in space before tissue folds. Python checks the end of each on a finer lattice; maps of more
// than the points (cuts, rigid parts, stages, a fit forward) are checked by Python alone.

import { NEARLY_FOLDED } from "../generated.ts";
import { RbfError, rbfFit } from "../maths/rbf.ts";
import { SafeShare } from "../maths/safe_share.ts";
import { type IsTissueAt, leastDetInSpace, tissueOfMask } from "../maths/space_folds.ts";
import { settingsOf } from "../sync/bus.ts";
import type { SpaceMask, SpacePoint } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

const WORK = 6e4; // evaluations of a kernel for the lattice of one check

export class SpaceFoldStop {
  note = ""; // the reason why a drag was stopped
  /** The smallest det J before the drag. */
  #least0: number | null = null;
  #start: SpacePoint[] = [];
  #share = new SafeShare();
  #mask: { data: SpaceMask; isTissue: IsTissueAt } | null = null;

  constructor(readonly editor: SpaceParts<"model" | "points" | "cursor">) {}

  get isOn() {
    const { model } = this.editor,
      { stages, direction } = settingsOf(model);
    return (
      Boolean(model.get("stop_at_folds")) && model.get("tissue") !== null && !(stages! > 1) && direction !== "forward"
    );
  }

  /** A drag or a key begins. */
  begin() {
    Object.assign(this, { note: "" });
    this.#least0 = null;
    this.#start = this.editor.points.list;
    this.#share.reset();
  }

  get #isTissue(): IsTissueAt {
    const data: Partial<SpaceMask> = this.editor.model.get("tissue") ?? {};
    if (!data.bits) return () => true;
    if (this.#mask?.data !== data) this.#mask = { data: data as SpaceMask, isTissue: tissueOfMask(data as SpaceMask) };
    return this.#mask.isTissue;
  }

  /** The smallest det J of points; minus infinity where they cannot be fitted. */
  #leastOf(points: SpacePoint[]) {
    const { cursor, model } = this.editor;
    try {
      return leastDetInSpace(rbfFit(points, settingsOf(model), 3), cursor.panes[0]!, this.#isTissue, WORK);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }

  #isRefused(points: SpacePoint[]) {
    this.#least0 ??= this.#leastOf(this.#start);
    return this.#leastOf(points) < Math.min(NEARLY_FOLDED, this.#least0) - 1e-9;
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
