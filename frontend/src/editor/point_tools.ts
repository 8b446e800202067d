// The editor's tools for points: drags and single edits, the mirror, the grid, turning, locks, and strokes of brushes.

import type { PointsEdit } from "../generated.ts";
import { Stroke } from "../maths/brushes.ts";
import { placeOf } from "../maths/cuts.ts";
import { shownLength } from "../maths/numbers.ts";
import {
  freeIds,
  lockedPoints,
  middleOf,
  mirroredEdit,
  mirrorSide,
  movedPoints,
  newPoint,
  nextId,
  onAxis,
  placeBetween,
  removedPoints,
  renamedPoint,
  resetPoints,
  rimmedPoints,
  rimOf,
  samePoints,
  switchedPoints,
  turnedPoints,
  turnOfKey,
  withRims,
} from "../maths/points.ts";
import { RbfError, rbfLabel } from "../maths/rbf.ts";
import { heldPoints, partLabel } from "../maths/rigid_stages.ts";
import { placeSeen } from "../maths/warp_map.ts";
import { MOST_CHARACTERS } from "../sync/edits.ts";
import type { LayeredFit, PartData, Point, Shapes, Vector, Vector2 } from "../types.ts";
import { treeOf } from "../ui/dom.ts";
import type { EditorView } from "./editor.ts";
import { pointLabel } from "./handles.ts";
/** the places of points that a drag moves */
export type Moved = "target" | "source" | "both";
/** points, ids of those that turn, the centre */
export type Turn = { points: Point[]; ids: number[]; about: Vector2 };
/** a point that a rigid part does not let in */
export type Held = { point: Point; part: PartData };

const NEAR = 6; // CSS pixels: a new handle nearer than this to an old one selects that
const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point goes onto it

/**
 * The part of a drag from `before` to `points` after which a point would enter a rigid part and contradict its motion.
 */
function allowedMove(
  before: Point[],
  points: Point[],
  parts: PartData[],
  strength: number,
): { points: Point[]; held: Held[] } {
  if (!parts.length) return { points, held: [] };
  const was = new Set(heldPoints(before, parts, strength).map(({ point }) => point.id));
  const heldIn = (given: Point[]) => heldPoints(given, parts, strength).filter(({ point }) => !was.has(point.id));
  const held = heldIn(points);
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
    if (heldIn(between(middle)).length) high = middle;
    else low = middle;
  }
  return { points: between(low), held };
}

/** Edits of the control points. */
export class PointTools {
  editor: EditorView;
  drag0: Point[] | null;
  isLive: boolean;
  isSent: boolean;
  strokeSide: number;

  constructor(editor: EditorView) {
    this.editor = editor;
    /** The points before a drag, null while there is none. */
    this.drag0 = null;
    this.isLive = false; // whether points on their way have not been sent yet
    this.isSent = false; // whether points of this drag have been sent
    this.strokeSide = 0; // the side of the mirror on which the stroke of a brush began
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * Replace the list of points, unless it cannot be fitted while the present one can: then the reason is shown.
   * @param kind the name of the edit
   * @param join edits with the same one in quick succession are undone as one
   */
  edit(points: Point[], kind: PointsEdit["kind"] = "move", join: string | null = null) {
    const { editor } = this;
    if (editor.isLocked || samePoints(points, editor.points)) return false;
    if (!editor.error && !this.accepts(points)) return false;
    if (JSON.stringify(points).length > MOST_CHARACTERS) {
      editor.showMessage("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    editor.sender.edit(points, kind, join); // which notifies all views, this one too
    return true;
  }

  /** The same with its mirror image, if the mirror is on. */
  change(points: Point[], kind: PointsEdit["kind"], join: string | null = null) {
    return this.edit(this.symmetric(this.editor.points, points, 0, kind === "add"), kind, join);
  }

  /** Whether a fit is possible; if not, the reason is shown. */
  accepts(points: Point[], shapes: Partial<Shapes> = this.editor.shapes) {
    const { editor } = this;
    try {
      editor.fitOf(points, shapes);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      const { message } = error;
      editor.showMessage(message, true);
      editor.handles.blink(points.filter((p) => message.includes(rbfLabel(p))).map((p) => p.id));
      return false;
    }
    return true;
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  /** Begin a drag of these points, which may have one more than the editor. */
  beginDrag(points: Point[] = this.editor.points) {
    const { editor } = this;
    if (editor.isLocked) return false;
    editor.points = points;
    Object.assign(this, { drag0: points, isSent: false });
    editor.foldStop.begin();
    return true;
  }

  /**
   * Move points by CSS pixels since the drag began.
   * @param id the point under the pointer
   * @param isLoose whether that one need not keep to the grid
   */
  drag(ids: number[], by: Vector2, what: Moved, id: number, isLoose: boolean = false) {
    const { editor, drag0 } = this;
    if (!drag0) return;
    if (!ids.length) {
      this.hintLocked([id]);
      return;
    }
    const f = (what === "target" ? editor.gridNodes.pull : 1) / editor.view.k;
    const way = this.#snappedWay(id, [f * by[0], f * by[1]], what, isLoose),
      lead = this.#sideOf(id);
    this.#show(drag0, (t) => this.symmetric(drag0, movedPoints(drag0, ids, t * way[0]!, t * way[1]!, what), lead));
  }

  /**
   * Show points on their way, `make(1)` of them, or as far as parts and folds let them go; `make(0)` is the start.
   */
  #show(drag0: Point[], make: (share: number) => Point[]) {
    const { editor } = this,
      { shapes } = editor;
    const { points: wanted } = editor.foldStop.limit((share) => ({ points: make(share), shapes }));
    const { points, held } = allowedMove(drag0, wanted, editor.shapes.parts, editor.strength);
    editor.handles.lock(held.map(({ point }) => point.id));
    if (held.length) this.#hintHeld(held[0]!);
    editor.rate.moved(performance.now());
    this.#follow(points);
  }

  #follow(points: Point[]) {
    this.editor.points = points;
    this.editor.changed(true);
    this.isLive = true;
  }

  /** Send points on their way, if Python follows the drag. */
  sendMove() {
    const { editor } = this;
    if (this.drag0 && this.isLive && editor.model.get("live")) {
      editor.sender.move(editor.points);
      this.isSent = true;
    }
    this.isLive = false;
    editor.partTools.sendMove();
  }

  #hintHeld({ point, part }: Held) {
    const why = part.motion ? "has a motion of its own" : "is fixed";
    this.editor.hint(`${rbfLabel(point)} cannot go into ${partLabel(part)}, which ${why}`);
  }

  endDrag(isCancelled: boolean, kind: PointsEdit["kind"] = "move") {
    const { editor, drag0 } = this,
      { points } = editor;
    this.drag0 = null;
    editor.sender.drawn = editor.rate.taken();
    editor.handles.lock([]);
    if (!drag0) return;
    editor.points = drag0;
    if (!isCancelled && this.edit(points, kind)) return;
    editor.points = editor.sender.points; // Python may have moved them meanwhile
    editor.changed();
    if (this.isSent) editor.sender.move(editor.points); // Python has followed the drag, which is void now
  }

  // ---- single edits -------------------------------------------------------------------------------------------------

  /** Those that may be changed, with the rims that go along; a hint if there are none. */
  freed(ids: number[]) {
    const free = freeIds(this.editor.points, withRims(this.editor.points, ids));
    if (ids.length && !free.length) this.hintLocked(ids);
    return free;
  }

  hintLocked([id]: number[]) {
    const p = this.editor.pointOf(id!);
    if (p) this.editor.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  /**
   * Move the selected points, or the one in focus, by so many pixels of the picture; without any, move the view.
   */
  nudge(focused: number | null, [dx, dy]: Vector2, pixels: number, what: Moved) {
    const { editor } = this,
      ids = editor.idsAt(focused);
    if (ids.length === 0) {
      editor.panBy(-dx * pixels * 4, -dy * pixels * 4);
      return;
    }
    if (focused !== null && !editor.selected.has(focused)) editor.select([focused]);
    const [du, dv] = editor.model.get("raster").spacing,
      free = this.freed(ids);
    this.change(movedPoints(editor.points, free, dx * pixels * du, dy * pixels * dv, what), "nudge", `nudge ${ids}`);
    const p = editor.pointOf(ids[0]!);
    if (p && ids.length === 1) editor.announce(pointLabel(p));
  }

  /**
   * A function of places of the picture: the source of a point there that moves nothing, null in a gap. As drags are
   * magnified by the strength, a feature must come from target + D / strength to be seen at the target.
   */
  #sourcesOf(layered: LayeredFit | null): (target: Vector) => Vector2 | null {
    const strength = this.editor.strength || 1;
    return (target) => {
      const [da, db, opacity] = layered ? placeOf(layered, target[0], target[1], 1e-9) : ([0, 0, 1] as const);
      return opacity < 0.5 ? null : [target[0] + da / strength, target[1] + db / strength];
    };
  }

  /** The place of the original picture that is seen at a place, null in a gap. */
  seenAt([a, b]: Vector2): Vector2 | null {
    const { editor } = this,
      layered = editor.isComparing ? null : editor.layered;
    const [da, db, opacity] = layered ? placeOf(layered, a, b, 1e-9) : ([0, 0, 1] as const);
    return opacity < 0.5 ? null : [a + da, b + db];
  }

  /**
   * Add a point that holds what is seen at a place of the view: its source is where the map leads, so nothing
   * moves.
   * @param at CSS pixels
   * @returns its id, that of a point which is there already, or null in a gap
   */
  addAt([x, y]: Vector2, isLoose = false): number | null {
    const { editor } = this,
      [near] = editor.points
        .map((p) => {
          const [px, py] = editor.onView(p.target as Vector2);
          return { id: p.id, away: Math.hypot(px - x, py - y) };
        })
        .sort((p, q) => p.away - q.away);
    if (near && near.away < NEAR) {
      editor.select([near.id]);
      editor.handles.focus(near.id);
      return near.id;
    }
    const place = editor.placeAt([x, y]),
      target = isLoose ? place : this.#snappedPlace(place);
    const source = this.#sourcesOf(editor.fitAt([x, y]))(target);
    if (source === null) {
      editor.hint("This is a gap: there is nothing here to take hold of");
      return null;
    }
    const id = nextId(editor.points, editor.sender.nextId);
    if (!this.change([...editor.points, newPoint(id, source, target)], "add")) return id;
    this.present(id, "added");
    return id;
  }

  addInMiddle() {
    this.addAt([this.editor.view.width / 2, this.editor.view.height / 2]);
  }

  /** Select a point, give it the focus, and describe it to a screen reader. */
  present(id: number, remark: string) {
    const { editor } = this,
      p = editor.pointOf(id);
    editor.select([id]);
    editor.drawNow();
    editor.handles.focus(id);
    if (p) editor.announce(`${pointLabel(p)}, ${remark}`);
  }

  remove(wanted: number[]) {
    const { editor } = this,
      ids = this.freed(wanted),
      at = editor.points.findIndex((p) => p.id === ids[0]);
    const hadFocus = editor.svg.contains(treeOf(editor.root).activeElement);
    if (!ids.length || !this.change(removedPoints(editor.points, ids), "remove")) return;
    editor.announce(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    const next = editor.points[Math.min(at, editor.points.length - 1)];
    editor.drawNow();
    if (hadFocus && next) editor.handles.focus(next.id);
    else if (hadFocus) editor.focusStage();
  }

  rename(id: number) {
    const { editor } = this,
      p = editor.pointOf(id);
    if (!p || editor.isLocked) return;
    editor.promptName(p.name, `point ${id}`, editor.onView(p.target as Vector2), {
      take: (text) => {
        this.edit(renamedPoint(editor.points, id, text), "rename");
      },
      focus: () => editor.handles.focus(id),
    });
  }

  switch(ids: number[]) {
    this.change(switchedPoints(this.editor.points, ids), "switch");
  }

  /** Put these points back where they were taken, all if there are none. */
  reset(ids: number[]) {
    const { points } = this.editor;
    this.change(resetPoints(points, this.freed(ids.length ? ids : points.map((p) => p.id))), "reset");
  }

  // ---- the mirror ---------------------------------------------------------------------------------------------------

  get mirror() {
    const { on = false, axis = "a", at = null } = this.editor.model.get("mirror") ?? {};
    return { on: Boolean(on), axis: String(axis), at: Number(at ?? this.#middle(axis)) };
  }

  #middle(axis: string) {
    const [a0, a1, b0, b1] = this.editor.box;
    return axis === "a" ? (a0 + a1) / 2 : (b0 + b1) / 2;
  }

  /** The lengths within which a source is on the axis, and a partner is found: parts of a pixel. */
  get #mirrorNear() {
    const pixel = Math.max(...this.editor.model.get("raster").spacing);
    return { axis: 0.5 * pixel, partner: pixel };
  }

  #setMirror(change: { on: boolean; axis?: string; at?: number }) {
    this.editor.set("mirror", { ...this.mirror, ...change });
    const { on, axis } = this.mirror,
      line = axis === "a" ? "upright" : "level";
    if (on) this.editor.hint(`What you do on one side of the ${line} line is done on the other too`, 4000);
  }

  toggleMirror() {
    this.#setMirror({ on: !this.mirror.on });
  }

  turnMirror() {
    const axis = this.mirror.axis === "a" ? "b" : "a";
    this.#setMirror({ on: true, axis, at: this.#middle(axis) });
  }

  /** Move the axis; Python gets it at the end. */
  moveAxis(at: number, isEnd: boolean) {
    const { editor } = this,
      c = this.mirror.axis === "a" ? 0 : 1;
    const low = editor.box[2 * c]!,
      high = editor.box[2 * c + 1]!;
    editor.model.set("mirror", { ...this.mirror, at: Math.max(low, Math.min(high, at)) });
    if (isEnd) editor.model.save_changes();
    editor.invalidate();
  }

  /** The side of the mirror on which a point was taken: 1, -1, or 0 on the axis and without a mirror. */
  #sideOf(id: number) {
    const { mirror } = this,
      p = this.editor.pointOf(id);
    return p && mirror.on ? mirrorSide(mirror, p.source, this.#mirrorNear.axis) : 0;
  }

  /**
   * An edit from `before` to `after` with its mirror image.
   * @param lead the side that decides, or 0
   * @param holds whether new points take hold of what is seen, on both sides
   */
  symmetric(before: Point[], after: Point[], lead: number = 0, holds: boolean = false) {
    const { mirror, editor } = this,
      { layered } = editor,
      near = this.#mirrorNear;
    if (!mirror.on) return after;
    const seenAt = (source: Vector) =>
      holds && layered && editor.strength === 1 && !editor.isOriginal
        ? placeSeen(layered, source, 1e-6 * near.axis)
        : null;
    return mirroredEdit(mirror, before, after, { near, lead, id: nextId(after, editor.sender.nextId), seenAt });
  }

  // ---- the grid to which targets keep -------------------------------------------------------------------------------

  /** A cell of the grid that is drawn. */
  get #cell() {
    const [a0, a1, b0, b1] = this.editor.box;
    return Math.max(a1 - a0, b1 - b0) / (this.editor.model.get("density") || 16);
  }

  get snap() {
    return Number(this.editor.model.get("snap")) || 0;
  }

  toggleSnap() {
    this.editor.set("snap", this.snap > 0 ? 0 : this.#cell);
    const { snap } = this;
    if (snap > 0) this.editor.hint(`Targets keep to a grid of ${shownLength(snap)}; hold Alt to go between`, 4000);
  }

  /** The next node; the drawn grid fills the box with whole cells, which may be a little larger or smaller. */
  #snappedPlace([a, b]: Vector2): Vector2 {
    const { snap } = this,
      cell = this.#cell,
      [a0, a1, b0, b1] = this.editor.box;
    if (!(snap > 0)) return [a, b];
    const isDrawn = Math.abs(snap - cell) < 1e-6 * cell;
    const whole = (length: number) => (isDrawn ? length / Math.max(1, Math.round(length / snap)) : snap);
    const [da, db] = [whole(a1 - a0), whole(b1 - b0)];
    return [a0 + da * Math.round((a - a0) / da), b0 + db * Math.round((b - b0) / db)];
  }

  /** The way that brings the point under the pointer onto a node; the others go with it. */
  #snappedWay(id: number, way: Vector2, what: Moved, isLoose: boolean) {
    const p = this.drag0?.find((q) => q.id === id);
    if (!p || isLoose || what === "both" || !(this.snap > 0)) return way;
    const [a, b] = p[what] as Vector2,
      to = this.#snappedPlace([a + way[0], b + way[1]]);
    return [to[0] - a, to[1] - b];
  }

  // ---- turning and scaling ------------------------------------------------------------------------------------------

  /** The points that a turn of the selection turns. A single point gets a rim, which turns around it. */
  #turnables(): Turn | null {
    const { editor } = this,
      { points } = editor,
      chosen = points.filter((p) => editor.selected.has(p.id) && !p.locked);
    if (!chosen.length) {
      this.hintLocked([...editor.selected]);
      return null;
    }
    if (chosen.length > 1) return { points, ids: this.freed(chosen.map((p) => p.id)), about: middleOf(chosen) };
    const [pin] = chosen as [Point],
      rim = rimOf(points, pin).filter((p) => !p.locked);
    if (rim.length) return { points, ids: rim.map((p) => p.id), about: pin.target as Vector2 };
    const room = points.reduce(
      (least, p) =>
        p.id === pin.id || !p.active
          ? least
          : Math.min(least, Math.hypot(p.target[0] - pin.target[0], p.target[1] - pin.target[1])),
      Infinity,
    );
    const id = nextId(points, editor.sender.nextId),
      distance = Math.min(editor.brush.radius, 0.6 * room);
    const rimmed = rimmedPoints(points, pin, distance, id, this.#sourcesOf(editor.layered));
    return { points: rimmed, ids: rimmed.slice(points.length).map((p) => p.id), about: pin.target as Vector2 };
  }

  /**
   * Turn or scale by a key. Quick presses are undone as one.
   * @param way 1 or 1
   */
  turnKey(way: number, how: { isLarge: boolean; isScale: boolean }) {
    const { editor } = this,
      [angle, factor] = turnOfKey(way, how),
      turn = editor.isLocked ? null : this.#turnables();
    if (!turn) return;
    const kind = angle ? "turn" : "scale";
    const points = turnedPoints(turn.points, turn.ids, turn.about, angle, factor);
    this.change(points, kind, `${kind} ${[...editor.selected]}`);
    editor.announce(
      angle ? `turned by ${shownLength((angle * 180) / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`,
    );
  }

  beginTurn() {
    const turn = this.editor.isLocked ? null : this.#turnables();
    if (turn) this.beginDrag();
    return turn;
  }

  /** Turn and scale since the drag began. */
  turnTo({ points, ids, about }: Turn, angle: number, factor: number) {
    const { drag0 } = this;
    if (!drag0) return;
    this.#show(drag0, (t) => this.symmetric(drag0, turnedPoints(points, ids, about, t * angle, factor ** t)));
    this.editor.hint(factor === 1 ? `${shownLength((angle * 180) / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`);
  }

  // ---- locks --------------------------------------------------------------------------------------------------------

  toggleLock(ids: number[]) {
    const { editor } = this;
    if (!ids.length) {
      editor.hint("Select points to lock them");
      return;
    }
    if (!this.edit(lockedPoints(editor.points, ids), "lock")) return;
    const isLocked = editor.pointOf(ids[0]!)?.locked;
    editor.announce(`${ids.length === 1 ? `point ${ids[0]}` : `${ids.length} points`} ${isLocked ? "locked" : "free"}`);
  }

  // ---- strokes of brushes -------------------------------------------------------------------------------------------

  /** Begin a stroke; null and a hint where none can begin. */
  beginStroke(place: Vector2, radius: number, tool: string) {
    const { editor, mirror } = this,
      { settings } = editor;
    if (editor.isLocked) return null;
    const isNear = (at: Vector2) => mirror.on && mirrorSide(mirror, at, BRUSH_SETTLES * radius) === 0;
    const stroke = new Stroke(editor.points, place, radius, {
      tool,
      box: editor.box,
      id: nextId(editor.points, editor.sender.nextId),
      reach: typeof settings.support === "number" ? settings.support : 0,
      sourceAt: (points) => this.#sourcesOf(points.some((p) => p.active) ? editor.fitOf(points) : null),
      settle: (at) => (isNear(at as Vector2) ? onAxis(mirror, at) : at),
    });
    if (stroke.lockedBy) {
      this.hintLocked([stroke.lockedBy.id]);
      return null;
    }
    if (!stroke.isPossible) {
      editor.hint("There is nothing here to take hold of");
      return null;
    }
    this.strokeSide = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    this.beginDrag();
    return stroke;
  }

  /** Show the picture with a stroke as it is now; false where it must not go on. */
  paintStroke(stroke: Stroke) {
    const { editor, drag0 } = this;
    if (!drag0) return false;
    const points = this.symmetric(drag0, stroke.points, this.strokeSide),
      {
        shapes: { parts },
        strength,
      } = editor;
    const held = parts.length ? heldPoints(points, parts, strength) : [];
    if (held.length > heldPoints(drag0, parts, strength).length) {
      this.#hintHeld(held[held.length - 1]!);
      return false;
    }
    if (editor.foldStop.refuses({ points, shapes: editor.shapes }, "The brush stops before the picture folds")) {
      editor.invalidate();
      return false;
    }
    this.#follow(points);
    return true;
  }
}
