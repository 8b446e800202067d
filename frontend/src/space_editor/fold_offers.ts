// What gets a drag in space further that was stopped before tissue folds.

import { DragOffers, FOLLOWERS, fitWays, type StoppedDrag } from "../editor/drag_offers.ts";
import { added, difference, scaled } from "../maths/camera.ts";
import { newPoint } from "../maths/points.ts";
import { toPane } from "../maths/space.ts";
import type { FitChange } from "../sync/edits.ts";
import type { SpacePoint, Vector3 } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

/** The input of a fit in space. */
export interface SpaceState {
  points: SpacePoint[];
  fit?: FitChange;
}

const SIGNS = [-1, 1] as const,
  FACES: Vector3[] = [0, 1, 2].flatMap((axis) =>
    SIGNS.map((sign): Vector3 => [axis === 0 ? sign : 0, axis === 1 ? sign : 0, axis === 2 ? sign : 0]),
  ),
  CORNERS: Vector3[] = SIGNS.flatMap((x) =>
    SIGNS.flatMap((y) => SIGNS.map((z): Vector3 => [x / Math.sqrt(3), y / Math.sqrt(3), z / Math.sqrt(3)])),
  ),
  SHELLS = [
    { share: 0.5, directions: FACES },
    { share: 1, directions: CORNERS },
  ]; // of new points, in radii of the tissue that follows
const ROOM = 0.3; // of that radius: no new point nearer than this to another one

/** Dependencies of the offers on the editor. */
export type SpaceOffersEditor = SpaceParts<
  "frames" | "messages" | "row" | "points" | "edits" | "map" | "cursor" | "foldStop"
>;

export class SpaceFoldOffers extends DragOffers<SpaceState> {
  constructor(readonly editor: SpaceOffersEditor) {
    super({ frames: editor.frames, messages: editor.messages, stage: editor.row });
  }

  protected isRefused(state: SpaceState) {
    return this.editor.foldStop.isRefused(state);
  }

  protected get isBusy() {
    return this.editor.points.isDragging;
  }

  protected ways({ make }: StoppedDrag<SpaceState>) {
    const { map } = this.editor;
    return {
      ...fitWays(make, map.reach, map.settings.stages ?? 1),
      points: FOLLOWERS.map((width) => (share: number) => this.#withFollowers(make(share), make(1), width)),
    };
  }

  protected apply({ points, fit }: SpaceState) {
    const { edits, foldStop } = this.editor;
    foldStop.leave();
    edits.edit(points, "move", null, fit);
  }

  /** The points of a state that the drag has moved, and how far. */
  #moved({ points }: SpaceState) {
    const was = new Map(this.editor.foldStop.start.map((p) => [p.id, p]));
    return points.flatMap((point) => {
      const before = was.get(point.id)?.target ?? point.source,
        by = difference(point.target, before);
      return point.active && Math.hypot(...by) > 0 ? [{ point, before, by }] : [];
    });
  }

  /**
   * The state with the tissue around the moved points carried along, less and less with the distance: the points there
   * follow, and new ones are set around.
   * @param width of the tissue that follows, in lengths of the whole drag
   */
  #withFollowers(state: SpaceState, end: SpaceState, width: number): SpaceState | null {
    const moved = this.#moved(state),
      all = this.#moved(end);
    if (!moved.length || !all.length) return moved.length ? null : state;
    const radius = width * Math.max(...all.map(({ by }) => Math.hypot(...by))),
      ids = new Set(all.map(({ point }) => point.id)),
      was = new Map(this.editor.foldStop.start.map((p) => [p.id, p.target]));
    const pull = (place: Vector3) => {
      const away = moved.map((one) => Math.hypot(...difference(place, one.before))),
        least = Math.min(...away);
      return scaled(moved[away.indexOf(least)]!.by, Math.max(0, 1 - (least / radius) ** 2) ** 2);
    };
    const points = state.points.map((p) => {
      const at = was.get(p.id);
      if (ids.has(p.id) || p.locked || !p.active || !at) return p;
      const by = pull(at);
      return Math.hypot(...by) ? { ...p, target: added(at, by) } : p;
    });
    return { ...state, points: this.#withShells(points, all, radius, pull) };
  }

  /** The points with new ones around those that are moved. */
  #withShells(points: SpacePoint[], all: { before: Vector3 }[], radius: number, pull: (place: Vector3) => Vector3) {
    const { cursor, foldStop, map, points: edited } = this.editor,
      middle = scaled(
        all.reduce<Vector3>((sum, { before }) => added(sum, before), [0, 0, 0]),
        1 / all.length,
      ),
      spread = Math.max(...all.map(({ before }) => Math.hypot(...difference(before, middle)))),
      sourceOf = map.sourceOf(foldStop.start),
      pane = cursor.panes[0]!,
      [a0, a1, b0, b1, c0, c1] = pane.box,
      made = [...points];
    let id = edited.nextId(points);
    for (const { share, directions } of SHELLS) {
      for (const direction of directions) {
        const at = added(middle, scaled(direction, spread + share * radius)),
          [a, b, c] = toPane(pane, at),
          isInside = a >= a0 && a <= a1 && b >= b0 && b <= b1 && c >= c0 && c <= c1;
        if (!isInside || made.some((p) => Math.hypot(...difference(p.target, at)) < ROOM * radius)) continue;
        made.push(newPoint(id++, sourceOf(at), added(at, pull(at))));
      }
    }
    return made;
  }

  /** Withdraw the offers where nothing can be edited. */
  show() {
    if (this.isShown && this.editor.points.isLocked) this.drop();
  }
}
