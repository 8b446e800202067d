// What gets a drag on a picture further that was stopped before tissue folds.

import { cleanShapes, middleOf, newPoint } from "../maths/points.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import { cutSides, isInside } from "../maths/shapes.ts";
import type { LineData, PartData, PicturePoint, Vector2 } from "../types.ts";
import { DragOffers, FOLLOWERS, fitWays, type StoppedDrag } from "./drag_offers.ts";
import type { MapState } from "./fold_stop.ts";
import type { EditorParts } from "./parts.ts";

const RING = 8; // points that hold the tissue around, and that let it follow

/** Dependencies of the offers on the editor. */
export type OffersEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "points" | "map" | "picture" | "sender",
  "foldStop" | "points" | "shapes"
>;

export class FoldOffers extends DragOffers<MapState> {
  constructor(readonly editor: OffersEditor) {
    super(editor);
  }

  protected isRefused(state: MapState) {
    return this.editor.tools.foldStop.isRefused(state);
  }

  protected get isBusy() {
    return this.editor.points.isDragging;
  }

  // ---- the ways ------------------------------------------------------------------------------------------------------

  protected ways({ make }: StoppedDrag<MapState>) {
    const { map } = this.editor;
    return {
      ...fitWays(make, map.reach, map.settings.stages ?? 1),
      rigid: [(share: number) => this.#rigidly(make(share))],
      corners: [(share: number) => this.#withoutCorners(make(share))],
      points: FOLLOWERS.map((width) => (share: number) => this.#withFollowers(make(share), make(1), width)),
    };
  }

  protected apply(state: MapState) {
    const { foldStop, points: pointTools, shapes: shapeTools } = this.editor.tools;
    foldStop.leave();
    if (state.shapes !== this.editor.points.shapes)
      shapeTools.edit("parts", state.shapes.parts, "move rigidly", { points: state.points });
    else pointTools.edit(state.points, "move", null, state.fit);
  }

  /** The state without the points that every step begins with, in the corners, where something else holds tissue. */
  #withoutCorners(state: MapState): MapState | null {
    const isAtRest = ({ source, target }: PicturePoint) => source[0] === target[0] && source[1] === target[1],
      points = state.points.filter((p) => p.name !== "corner" || p.locked || !isAtRest(p)),
      isHeld =
        state.shapes.parts.some(({ enabled, motion }) => enabled && !motion) ||
        points.some((p) => p.active && isAtRest(p));
    return isHeld && points.length < state.points.length ? { ...state, points } : null;
  }

  /** The points of a state that the drag has moved, as they were. */
  #moved({ points }: MapState) {
    const { start } = this.editor.tools.foldStop,
      was = new Map(start.points.map((p) => [p.id, p]));
    return points.flatMap((p) => {
      const before = was.get(p.id)?.target ?? p.source;
      const by: Vector2 = [p.target[0] - before[0], p.target[1] - before[1]];
      return p.active && Math.hypot(...by) > 0 ? [{ point: p, before, by }] : [];
    });
  }

  /** The tissue around the points that are moved as a rigid part that goes with them, or their side of a cut. */
  #rigidly(state: MapState): MapState | null {
    const moved = this.#moved(state),
      by = moved[0]?.by;
    if (!by || !moved.every((one) => [0, 1].every((c) => Math.abs(one.by[c]! - by[c]!) < 1e-6 * Math.hypot(...by)))) {
      return null; // they are turned or scaled
    }
    const cuts = state.shapes.cuts.filter(({ enabled }) => enabled),
      line = cuts.length === 1 ? cuts[0]!.region : null;
    return line?.kind === "line" && !line.stops ? this.#withSide(state, line, by) : this.#withDisc(state, by);
  }

  /** All points on the side of a cut on which some are moved, moved alike: nothing on that side bends. */
  #withSide(state: MapState, line: LineData, by: Vector2): MapState | null {
    const ids = new Set(this.#moved(state).map(({ point }) => point.id)),
      { start } = this.editor.tools.foldStop,
      was = new Map(start.points.map((p) => [p.id, p.target])),
      own = state.points.filter(({ id }) => ids.has(id)),
      side = cutSides(line, this.editor.picture.box).find((one) => own.every(({ source }) => isInside(one, source)));
    if (!side) return null;
    const points = state.points.map((p) => {
      const at = was.get(p.id);
      if (ids.has(p.id) || p.locked || !at || !isInside(side, p.source)) return p;
      return { ...p, target: [at[0] + by[0], at[1] + by[1]] as Vector2 };
    });
    return { ...state, points };
  }

  /** A disc around the points that are moved, in which no other point is, as a rigid part. */
  #withDisc(state: MapState, by: Vector2): MapState | null {
    const { box } = this.editor.picture,
      moved = this.#moved(state).map(({ point }) => point),
      isFromRest = moved.every(
        ({ source, target }) =>
          Math.hypot(target[0] - source[0] - by[0], target[1] - source[1] - by[1]) < 1e-6 * Math.hypot(...by),
      );
    if (!isFromRest || state.shapes.parts.some(({ enabled }) => enabled)) return null;
    const middle = middleOf(moved.map(({ source }) => ({ target: source }))),
      away = ({ source: [a, b] }: PicturePoint) => Math.hypot(a - middle[0], b - middle[1]),
      ids = new Set(moved.map(({ id }) => id)),
      room = Math.min(
        ...state.points.filter((p) => p.active && !ids.has(p.id)).map(away),
        0.6 * Math.hypot(box[1] - box[0], box[3] - box[2]),
      ),
      radius = Math.max(1.2 * Math.max(...moved.map(away)), 0.45 * room);
    if (!(radius > 0 && radius < room)) return null;
    const motion = {
      matrix: [
        [1, 0],
        [0, 1],
      ],
      shift: by,
    } as PartData["motion"];
    const [part] = cleanShapes(
      [{ region: { kind: "polygon", vertices: ringOf(middle, radius, 16) }, motion }],
      "parts",
    );
    const parts = [...state.shapes.parts, part!];
    return findConflicts(state.points, parts, 1).length ? null : { ...state, shapes: { ...state.shapes, parts } };
  }

  /**
   * The state with the tissue around the moved points carried along, less and less with the distance: the points there
   * follow, and new ones are set around.
   * @param width of the tissue that follows, in lengths of the whole drag
   */
  #withFollowers(state: MapState, end: MapState, width: number): MapState | null {
    const moved = this.#moved(state),
      all = this.#moved(end);
    if (!moved.length || !all.length) return moved.length ? null : state;
    const { editor } = this,
      { box } = editor.picture,
      radius = width * Math.max(...all.map(({ by }) => Math.hypot(...by))),
      ids = new Set(all.map(({ point }) => point.id));
    const pull = ([a, b]: Vector2): Vector2 => {
      let near = Infinity,
        by: Vector2 = [0, 0];
      for (const one of moved) {
        const away = Math.hypot(a - one.before[0], b - one.before[1]);
        if (away < near) {
          near = away;
          by = one.by;
        }
      }
      const weight = Math.max(0, 1 - (near / radius) ** 2) ** 2;
      return [weight * by[0], weight * by[1]];
    };
    const was = new Map(editor.tools.foldStop.start.points.map((p) => [p.id, p]));
    const points = state.points.map((p) => {
      const at = was.get(p.id)?.target;
      if (ids.has(p.id) || p.locked || !p.active || !at) return p;
      const [da, db] = pull(at);
      return da || db ? { ...p, target: [at[0] + da, at[1] + db] as Vector2 } : p;
    });
    const middle = middleOf(all.map(({ point, before }) => ({ ...point, target: before })));
    const spread = Math.max(...all.map(({ before: [a, b] }) => Math.hypot(a - middle[0], b - middle[1])));
    const layered = editor.map.fitOf(editor.tools.foldStop.start.points, editor.tools.foldStop.start.shapes),
      sourceOf = editor.map.sourcesOf(layered);
    let id = editor.points.nextId(state.points);
    for (const share of [0.5, 1]) {
      for (const at of ringOf(middle, spread + share * radius, RING, share === 1 ? 0.5 : 0)) {
        const isNear = points.some(({ target: [a, b] }) => Math.hypot(a - at[0], b - at[1]) < 0.3 * radius),
          isInside = at[0] >= box[0] && at[0] <= box[1] && at[1] >= box[2] && at[1] <= box[3];
        const source = isNear || !isInside ? null : sourceOf(at);
        if (source === null) continue;
        const [da, db] = pull(at);
        points.push(newPoint(id++, source, [at[0] + da, at[1] + db]));
      }
    }
    return { ...state, points };
  }

  /** Hide the bar when a tool with options of its own is on, or nothing can be edited. */
  show() {
    if (this.isShown && (this.editor.points.isLocked || this.editor.picture.isBefore)) this.drop();
  }
}

/** Places on a circle; `turn` of a step rotates them. */
function ringOf([a, b]: Vector2, radius: number, count: number, turn: number = 0): Vector2[] {
  return Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * (k + turn)) / count;
    return [a + radius * Math.cos(angle), b + radius * Math.sin(angle)];
  });
}
