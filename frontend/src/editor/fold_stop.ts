// The stop of drags before the map folds, for control points and for rigid parts.

import { NEARLY_FOLDED } from "../generated.ts";
import { foldsOf, probesOf } from "../maths/folds.ts";
import { RbfError } from "../maths/rbf.ts";
import type { PicturePoint, Shapes } from "../types.ts";
import type { EditorParts } from "./parts.ts";
/** The input of a fit */
export type MapState = { points: PicturePoint[]; shapes: Shapes };

const HOLD_WORK = 6e4,
  HOLD_NODES = [9, 33] as const; // evaluations of a kernel for one check, and nodes of a side of its lattice

/** Dependencies of the stop on the editor. */
export type FoldStopEditor = EditorParts<"model" | "points" | "map" | "picture">;

/** Check in advance of whether a drag would fold the map where tissue is visible. */
export class FoldStop {
  note = ""; // the reason why a drag was stopped
  /** The smallest det J before the drag. */
  least0: number | null = null;
  start: MapState;

  constructor(readonly editor: FoldStopEditor) {
    /** The editor's state when the drag began. */
    this.start = { points: [], shapes: { cuts: [], parts: [] } };
  }

  /** A drag begins. */
  begin() {
    const { list: points, shapes } = this.editor.points;
    Object.assign(this, { note: "", least0: null, start: { points, shapes } });
  }

  /** The smallest det J of a state; minus infinity where it cannot be fitted. */
  #leastOf({ points, shapes }: MapState) {
    const { editor } = this;
    try {
      const layered = editor.map.fitOf(points, shapes);
      const [few, many] = HOLD_NODES;
      const nodes = Math.max(few, Math.min(many, Math.floor(Math.sqrt(HOLD_WORK / (layered.count + 1)))));
      return foldsOf(
        layered,
        editor.picture.box,
        nodes,
        probesOf(layered, HOLD_WORK / 4),
        editor.map.tissueTest(layered),
      ).least;
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }

  /**
   * Whether the map folds in a state, and did not before the drag: folds of before may stay.
   * @param note the reason that is shown if it does
   */
  refuses(state: MapState, note: string) {
    this.least0 ??= this.#leastOf(this.start);
    const isRefused = this.#leastOf(state) < Math.min(NEARLY_FOLDED, this.least0) - 1e-9;
    this.note = isRefused ? note : "";
    return isRefused;
  }

  /** A drag as far as the map stays free of folds, if the user has chosen that: from `make(0)` to `make(1)`. */
  limit<S extends MapState>(make: (share: number) => S): S {
    const wanted = make(1),
      note = "Stopped before the picture folds; T lets the drag continue";
    this.note = "";
    if (!this.editor.model.get("stop_at_folds") || !this.refuses(wanted, note)) return wanted;
    let low = 0,
      high = 1;
    for (let turn = 0; turn < 8; turn++) {
      const middle = (low + high) / 2;
      if (this.refuses(make(middle), note)) high = middle;
      else low = middle;
    }
    this.note = note;
    return make(low);
  }
}
