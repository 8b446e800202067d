// The stop of drags before tissue folds, for control points, brushes and rigid parts. It holds drags only: documents,
// undo, scripts and edits of other tools are as they are, and a map that folds already stays so.

import { NEARLY_FOLDED } from "../generated.ts";
import { foldsOf, probesOf } from "../maths/folds.ts";
import { samePoints, sameShapes } from "../maths/points.ts";
import { RbfError } from "../maths/rbf.ts";
import { checksOf, SafeShare } from "../maths/safe_share.ts";
import type { FitChange } from "../sync/edits.ts";
import type { PicturePoint, Shapes, Vector4 } from "../types.ts";
import type { StoppedDrag } from "./drag_offers.ts";
import type { EditorParts } from "./parts.ts";

/** The input of a fit */
export type MapState = { points: PicturePoint[]; shapes: Shapes; fit?: FitChange };

const HOLD_WORK = 6e4,
  HOLD_NODES = [9, 33] as const; // evaluations of a kernel for one check, and nodes of a side of its lattice
const TURNS = 8; // of the bisection of a drag

/** Dependencies of the stop on the editor. */
export type FoldStopEditor = EditorParts<"model" | "points" | "map" | "picture", "foldOffers">;

/** Check in advance of whether a drag would fold the map where tissue is visible. */
export class FoldStop {
  note = ""; // the reason why a drag was stopped
  /** The smallest det J before the drag. */
  least0: number | null = null;
  start: MapState;
  stopped: StoppedDrag<MapState> | null = null;
  /** The state in which the drag was left. */
  #left: MapState | null = null;
  #share = new SafeShare();

  constructor(readonly editor: FoldStopEditor) {
    /** The editor's state when the drag began. */
    this.start = { points: [], shapes: { cuts: [], parts: [] } };
  }

  get isOn() {
    return Boolean(this.editor.model.get("stop_at_folds"));
  }

  /** A drag begins. */
  begin() {
    const { list: points, shapes } = this.editor.points;
    this.leave();
    Object.assign(this, { least0: null, start: { points, shapes } });
    this.#share.reset();
  }

  /** Forget the drag that was stopped: it is undone, or goes on. */
  leave() {
    Object.assign(this, { note: "", stopped: null });
    this.#left = null;
    this.editor.tools.foldOffers.drop();
  }

  /** A drag has ended: offer what gets further, if it was stopped. */
  end(isCancelled = false) {
    if (isCancelled) this.leave();
    if (!this.stopped) return;
    const { list: points, shapes } = this.editor.points;
    this.#left = { points, shapes };
    this.editor.tools.foldOffers.propose(this.stopped);
  }

  /** Other points or shapes have come: a drag that was stopped before is no longer what one sees. */
  follow() {
    const { list, shapes } = this.editor.points,
      left = this.#left;
    if (left && !(samePoints(left.points, list) && sameShapes(left.shapes, shapes))) this.leave();
  }

  /** The reason, as long as no message offers what gets further. */
  get remark() {
    return this.editor.tools.foldOffers.isShown ? "" : this.note;
  }

  /** The smallest det J of a state; minus infinity where it cannot be fitted. */
  #leastOf({ points, shapes, fit }: MapState) {
    const { editor } = this;
    try {
      const layered = editor.map.fitOf(points, { ...shapes, ...fit });
      const [few, many] = HOLD_NODES;
      const nodes = Math.max(few, Math.min(many, Math.floor(Math.sqrt(HOLD_WORK / (layered.count + 1)))));
      const { box } = editor.picture,
        isTissue = editor.map.tissueTest(layered);
      const near = isTissue && tissueNear(isTissue, box, nodes);
      return foldsOf(layered, box, nodes, probesOf(layered, HOLD_WORK / 4), near).least;
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }

  /** Whether the map folds in a state, and did not before the drag: folds of before may stay. */
  isRefused(state: MapState) {
    this.least0 ??= this.#leastOf(this.start);
    return this.#leastOf(state) < Math.min(NEARLY_FOLDED, this.least0) - 1e-9;
  }

  /** The largest share of a way from a state that is allowed, by bisection. */
  largestShare(make: (share: number) => MapState, turns: number = TURNS) {
    let low = 0,
      high = 1;
    for (let turn = 0; turn < turns; turn++) {
      const middle = (low + high) / 2;
      if (this.isRefused(make(middle))) high = middle;
      else low = middle;
    }
    return low;
  }

  /** Whether a stopped drag ends where it may not have been checked. The next movement is checked. */
  isOverdue() {
    return this.stopped !== null && this.#share.isOverdue();
  }

  /** A drag as far as the map stays free of folds, while the stop is on: from `make(0)` to `make(1)`. */
  limit<S extends MapState>(make: (share: number) => S): S {
    const wanted = make(1);
    this.stopped = null;
    this.note = "";
    const { points } = this.start,
      way = { length: lengthOf(this.start, wanted), checks: checksOf(points.length) };
    if (!this.isOn || !this.#share.refusesWay(way, () => this.isRefused(wanted))) {
      this.#share.reset();
      return wanted;
    }
    const share = this.#share.find(make, (state) => this.isRefused(state), way.checks);
    this.#hold({ make, share }, "Stopped before tissue folds; T lets the drag continue");
    return make(share);
  }

  /**
   * Whether a stroke of a brush must not continue to a state, while the stop is on.
   * @param now the points up to which it is allowed
   */
  refusesStroke(now: PicturePoint[], wanted: PicturePoint[]) {
    const { shapes } = this.editor.points,
      isRefused = this.isOn && this.isRefused({ points: wanted, shapes });
    this.stopped = null;
    this.note = "";
    if (isRefused)
      this.#hold({ make: strokeWay(now, wanted, shapes), share: 0 }, "The brush stops before tissue folds");
    return isRefused;
  }

  #hold(stopped: StoppedDrag<MapState>, note: string) {
    this.stopped = stopped;
    this.note = note;
  }
}

/** Whether tissue is within half a cell of a lattice in a box: a fold at a node of air may reach tissue between nodes. */
function tissueNear(isTissue: (a: number, b: number) => boolean, [a0, a1, b0, b1]: Vector4, nodes: number) {
  const steps = [0, -0.5, 0.5],
    da = (a1 - a0) / (nodes - 1),
    db = (b1 - b0) / (nodes - 1);
  return (a: number, b: number) => steps.some((i) => steps.some((j) => isTissue(a + i * da, b + j * db)));
}

/** The longest way of a point or a part from one state to another; infinite where they differ in more than places. */
function lengthOf({ points, shapes }: MapState, to: MapState) {
  let most = shapes === to.shapes || !to.shapes.parts.some(({ motion }) => motion) ? 0 : Infinity;
  const was = new Map(points.map((p) => [p.id, p]));
  for (const p of to.points) {
    const before = was.get(p.id);
    if (before === p) continue;
    for (const key of ["source", "target"] as const) {
      const [a, b] = before?.[key] ?? p.source;
      most = Math.max(most, Math.hypot(p[key][0] - a, p[key][1] - b));
    }
  }
  return most;
}

/** The way of a stroke that goes on from some points to others, which may be more. */
function strokeWay(now: PicturePoint[], wanted: PicturePoint[], shapes: Shapes) {
  const places = new Map(now.map((p) => [p.id, p.target]));
  return (share: number): MapState => ({
    shapes,
    points: wanted.map((p) => {
      const [a, b] = places.get(p.id) ?? p.source;
      return { ...p, target: [a + share * (p.target[0] - a), b + share * (p.target[1] - b)] };
    }),
  });
}
