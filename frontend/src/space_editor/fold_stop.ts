// The stop of drags and keys in space before tissue folds. Python checks the end of each on a finer lattice; maps of more
// than the points (cuts, rigid parts, a fit forward) are checked by Python alone.

import type { StoppedDrag } from "../editor/drag_offers.ts";
import { NEARLY_FOLDED } from "../generated.ts";
import { placeBetween, samePoints } from "../maths/points.ts";
import { SafeShare } from "../maths/safe_share.ts";
import type { SpacePoint } from "../types.ts";
import type { SpaceState } from "./fold_offers.ts";
import type { SpaceParts } from "./parts.ts";

export class SpaceFoldStop {
  note = ""; // the reason why a drag was stopped
  start: SpacePoint[] = []; // of the drag
  /** The smallest det J before the drag. */
  #least0: number | null = null;
  #stopped: StoppedDrag<SpaceState> | null = null;
  /** The points that the drag has left. */
  #left: SpacePoint[] | null = null;
  #share = new SafeShare();

  constructor(readonly editor: SpaceParts<"model" | "points" | "map" | "foldOffers">) {}

  get isOn() {
    const { map, model } = this.editor;
    return Boolean(model.get("stop_at_folds")) && map.isKnown;
  }

  /** A drag or a key begins. */
  begin() {
    this.leave();
    this.#least0 = null;
    this.start = this.editor.points.list;
    this.#share.reset();
  }

  /** Forget the drag that was stopped: it is undone, or goes on. */
  leave() {
    this.note = "";
    this.#stopped = null;
    this.#left = null;
    this.editor.foldOffers.drop();
  }

  /** A drag has ended: offer what gets further, if it was stopped. */
  end(isCancelled = false) {
    if (isCancelled) this.leave();
    if (!this.#stopped) return;
    this.#left = this.editor.points.list;
    this.editor.foldOffers.propose(this.#stopped);
  }

  /** Other points have come: a drag that was stopped before is no longer what one sees. */
  follow() {
    if (this.#left && !samePoints(this.#left, this.editor.points.list)) this.leave();
  }

  /** The reason, as long as no message offers what gets further. */
  get remark() {
    return this.editor.foldOffers.isShown ? "" : this.note;
  }

  /** Whether the map folds in a state, and did not before the drag: folds of before may stay. */
  isRefused({ points, fit }: SpaceState) {
    const { map } = this.editor;
    this.#least0 ??= map.leastOf(this.start);
    return map.leastOf(points, fit) < Math.min(NEARLY_FOLDED, this.#least0) - 1e-9;
  }

  /**
   * Whether a stroke of a brush must not continue to a state, while the stop is on.
   * @param now the points up to which it is allowed
   */
  refusesStroke(now: SpacePoint[], wanted: SpacePoint[]) {
    this.leave();
    if (!this.isOn || !this.isRefused({ points: wanted })) return false;
    this.note = "The brush stops before tissue folds";
    this.#stopped = { make: strokeWay(now, wanted), share: 0 };
    return true;
  }

  /** Points as far as the map stays free of folds, while the stop is on: from `make(0)` to `make(1)`. */
  limit(make: (share: number) => SpacePoint[]) {
    const stateAt = (share: number): SpaceState => ({ points: make(share) }),
      wanted = stateAt(1);
    this.leave();
    if (!this.isOn || !this.isRefused(wanted)) {
      this.#share.reset();
      return wanted.points;
    }
    const share = this.#share.find(stateAt, (state) => this.isRefused(state));
    this.note = "Stopped before tissue folds; T lets the drag continue";
    this.#stopped = { make: stateAt, share };
    return make(share);
  }
}

/** The way of a stroke that goes on from some points to others, which may be more. */
function strokeWay(now: SpacePoint[], wanted: SpacePoint[]) {
  const places = new Map(now.map((p) => [p.id, p.target]));
  return (share: number): SpaceState => ({
    points: wanted.map((p) => ({ ...p, target: placeBetween(places.get(p.id) ?? p.source, p.target, share) })),
  });
}
