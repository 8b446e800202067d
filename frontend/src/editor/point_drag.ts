// Drags of control points: as far as folds and rigid parts let them go, sent to Python while it follows.

import type { PointsEdit } from "../generated.ts";
import { labelOf, numberOf } from "../maths/point_names.ts";
import { freeIds, includeRims, placeBetween, translatePoints } from "../maths/points.ts";
import { findConflicts, partLabel } from "../maths/rigid_stages.ts";
import type { PartData, PicturePoint, Point, Vector2 } from "../types.ts";
import type { MapState } from "./fold_stop.ts";
import type { Moved, PointDragger } from "./gesture.ts";
import type { EditorParts } from "./parts.ts";

/** A point that contradicts a rigid part */
export type Held = { point: Point; part: PartData };
/**
 * The part of a drag from `before` to `points` after which a point would enter a rigid part and contradict its motion.
 */
function limitMove(
  before: PicturePoint[],
  points: PicturePoint[],
  parts: PartData[],
  strength: number,
): { points: PicturePoint[]; held: Held[] } {
  if (!parts.length) return { points, held: [] };
  const was = new Set(findConflicts(before, parts, strength).map(({ point }) => point.id));
  const conflicts = (given: PicturePoint[]) =>
    findConflicts(given, parts, strength).filter(({ point }) => !was.has(point.id));
  const held = conflicts(points);
  if (!held.length) return { points, held };
  const then = new Map(points.map((p) => [p.id, p]));
  const between = (t: number) =>
    before.map((p) => {
      const { source, target } = then.get(p.id) ?? p;
      return { ...p, source: placeBetween(p.source, source, t), target: placeBetween(p.target, target, t) };
    });
  let low = 0,
    high = 1;
  for (let turn = 0; turn < 10; turn++) {
    const middle = (low + high) / 2;
    if (conflicts(between(middle)).length) high = middle;
    else low = middle;
  }
  return { points: between(low), held };
}

/** Dependencies of drags on the editor. */
export type DragEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "viewport" | "points" | "map",
  "foldStop" | "others" | "points",
  "handles" | "nodes"
>;

export class PointDrag implements PointDragger {
  /** The points before a drag, null while there is none. */
  drag0: PicturePoint[] | null = null;
  isLive = false; // whether moving points have not been sent yet
  isSent = false; // whether points of this drag have been sent
  /** The way of its last movement. */
  #way: ((before: PicturePoint[], share: number) => PicturePoint[]) | null = null;

  constructor(readonly editor: DragEditor) {
    editor.points.draggers.push(this);
  }

  /** Begin a drag of these points, which may have one more than the editor. */
  beginDrag(points: PicturePoint[] = this.editor.points.list) {
    const { editor } = this;
    if (editor.points.isLocked) return false;
    editor.points.list = points;
    Object.assign(this, { drag0: points, isSent: false });
    editor.tools.foldStop.begin();
    return true;
  }

  /**
   * Move points by CSS pixels since the drag began.
   * @param id the point under the pointer
   * @param isLoose whether that one need not keep to the grid
   */
  drag(ids: number[], by: Vector2, what: Moved, id: number, isLoose: boolean = false) {
    const { layers, viewport } = this.editor,
      f = (what === "target" ? layers.nodes.pull : 1) / viewport.view.k;
    this.translate(ids, [f * by[0], f * by[1]], what, id, isLoose);
  }

  /** Move points by a displacement in the picture since the drag began; parameters as of `drag`. */
  translate(ids: number[], by: Vector2, what: Moved, id: number, isLoose: boolean) {
    const { editor, drag0 } = this;
    if (!drag0) return;
    const free = freeIds(drag0, includeRims(drag0, ids));
    if (!free.length) {
      editor.tools.points.hintLocked([id]);
      return;
    }
    if (editor.points.list === drag0 && editor.tools.others.holds(free)) {
      const held = drag0.find((p) => p.id === id) ?? drag0[0]!;
      editor.messages.hint(`${labelOf(held, numberOf(drag0, held.id))} is being moved in another window`);
      return;
    }
    const way = this.#snapMove(id, by, what, isLoose),
      { mirror } = editor.tools.points,
      lead = mirror.sideOf(id);
    this.show((before, t) => mirror.edit(before, translatePoints(before, free, t * way[0]!, t * way[1]!, what), lead));
  }

  /**
   * Show moving points, `make(before, 1)` of them, or as far as parts and folds let them go; with 0 it is the start.
   */
  show(make: (before: PicturePoint[], share: number) => PicturePoint[]) {
    const { drag0, editor } = this,
      shapes = editor.points.shapes;
    if (!drag0) return;
    this.#way = make;
    const { points: wanted } = editor.tools.foldStop.limit<MapState>((share) => ({
      points: make(drag0, share),
      shapes,
    }));
    const { points, held } = limitMove(drag0, wanted, editor.points.shapes.parts, editor.map.strength);
    editor.layers.handles.lock(held.map(({ point }) => point.id));
    if (held.length) this.hintConflict(held[0]!);
    editor.frames.rate.recordMove(performance.now());
    this.follow(points);
  }

  follow(points: PicturePoint[]) {
    this.editor.points.list = points;
    this.editor.map.invalidate(true);
    this.isLive = true;
  }

  /** Send the moving points, if Python follows the drag. */
  sendMove() {
    const { editor } = this;
    if (this.drag0 && this.isLive && editor.model.get("live")) {
      editor.sender.move(editor.points.list);
      this.isSent = true;
    }
    this.isLive = false;
  }

  hintConflict({ point, part }: Held) {
    const why = part.motion ? "has its own motion" : "is fixed";
    const { messages, points } = this.editor;
    messages.hint(`${labelOf(point, points.numberOf(point.id))} cannot go into ${partLabel(part)}, which ${why}`);
  }

  /** Returns whether the drag was an edit. */
  endDrag(isCancelled: boolean, kind: PointsEdit["kind"] = "move") {
    const { editor, drag0 } = this;
    if (!isCancelled && this.#way && editor.tools.foldStop.isOverdue()) this.show(this.#way);
    this.#way = null;
    const points = editor.points.list;
    this.drag0 = null;
    editor.sender.drawn = editor.frames.rate.finish();
    editor.layers.handles.lock([]);
    if (!drag0) return false;
    editor.points.list = drag0;
    const isEdit = !isCancelled && editor.tools.points.edit(points, kind);
    editor.tools.foldStop.end(isCancelled);
    if (isEdit) return true;
    editor.points.list = editor.sender.points; // Python may have moved them meanwhile
    editor.map.invalidate();
    if (this.isSent) editor.sender.move(editor.points.list); // Python has followed the drag, which is void now
    return false;
  }

  /** The displacement that brings the point under the pointer onto a node; the others follow it. */
  #snapMove(id: number, way: Vector2, what: Moved, isLoose: boolean) {
    const p = this.drag0?.find((q) => q.id === id),
      { snap } = this.editor.tools.points;
    if (!p || isLoose || what === "both" || !(snap.step > 0)) return way;
    const [a, b] = p[what],
      to = snap.placeOf([a + way[0], b + way[1]]);
    return [to[0] - a, to[1] - b];
  }
}
