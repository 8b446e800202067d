// The editor's tools for points: drags and single edits, the mirror, the grid, turning, locks, and strokes of brushes.

import type { PointsEdit } from "../generated.ts";
import { Stroke } from "../maths/brushes.ts";
import { placeOf } from "../maths/cuts.ts";
import { formatLength } from "../maths/numbers.ts";
import {
  addRim,
  freeIds,
  includeRims,
  middleOf,
  mirrorSide,
  newPoint,
  nextId,
  placeBetween,
  projectOnAxis,
  removePoints,
  renamePoint,
  resetPoints,
  rimOf,
  rotatePoints,
  samePoints,
  toggleLocks,
  togglePoints,
  translatePoints,
  turnOfKey,
} from "../maths/points.ts";
import { RbfError, rbfLabel } from "../maths/rbf.ts";
import { findConflicts, partLabel } from "../maths/rigid_stages.ts";
import { MOST_CHARACTERS } from "../sync/edits.ts";
import type { LayeredFit, PartData, Point, Shapes, Vector, Vector2 } from "../types.ts";
import { treeOf } from "../ui/dom.ts";
import type { Moved } from "./gesture.ts";
import { pointLabel } from "./handles.ts";
import { PointMirror } from "./mirror.ts";
import type { EditorParts } from "./parts.ts";
import { SnapGrid } from "./snap_grid.ts";
/** Points, ids of those that turn, the centre */
export type Turn = { points: Point[]; ids: number[]; about: Vector2 };
/** A point that contradicts a rigid part */
export type Held = { point: Point; part: PartData };

const NEAR = 6; // CSS pixels: a new handle nearer than this to an old one selects that
const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point snaps to it

/**
 * The part of a drag from `before` to `points` after which a point would enter a rigid part and contradict its motion.
 */
function limitMove(
  before: Point[],
  points: Point[],
  parts: PartData[],
  strength: number,
): { points: Point[]; held: Held[] } {
  if (!parts.length) return { points, held: [] };
  const was = new Set(findConflicts(before, parts, strength).map(({ point }) => point.id));
  const conflicts = (given: Point[]) => findConflicts(given, parts, strength).filter(({ point }) => !was.has(point.id));
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

/** Dependencies of the tools on the editor. */
export type PointEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "brush" | "foldStop" | "parts",
  "handles" | "nodes",
  "names"
>;

/** Edits of the control points. */
export class PointTools {
  /** The points before a drag, null while there is none. */
  drag0: Point[] | null = null;
  isLive = false; // whether moving points have not been sent yet
  isSent = false; // whether points of this drag have been sent
  strokeSide = 0; // the side of the mirror on which the stroke of a brush began
  mirror: PointMirror;
  snap: SnapGrid;

  constructor(readonly editor: PointEditor) {
    this.mirror = new PointMirror(editor);
    this.snap = new SnapGrid(editor);
    editor.points.draggers.push(this);
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * Replace the list of points, unless it cannot be fitted while the present one can: then the reason is shown.
   * @param kind the name of the edit
   * @param join edits with the same one in quick succession are undone as one
   */
  edit(points: Point[], kind: PointsEdit["kind"] = "move", join: string | null = null) {
    const { editor } = this;
    if (editor.points.isLocked || samePoints(points, editor.points.list)) return false;
    if (!editor.map.error && !this.accepts(points)) return false;
    if (JSON.stringify(points).length > MOST_CHARACTERS) {
      editor.messages.show("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    editor.sender.edit(points, kind, join); // which notifies all views, this one too
    return true;
  }

  /** The same with its mirror image, if the mirror is on. */
  change(points: Point[], kind: PointsEdit["kind"], join: string | null = null) {
    return this.edit(this.mirror.edit(this.editor.points.list, points, 0, kind === "add"), kind, join);
  }

  /** Whether a fit is possible; if not, the reason is shown. */
  accepts(points: Point[], shapes: Partial<Shapes> = this.editor.points.shapes) {
    const { editor } = this;
    try {
      editor.map.fitOf(points, shapes);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      const { message } = error;
      editor.messages.show(message, true);
      editor.layers.handles.blink(points.filter((p) => message.includes(rbfLabel(p))).map((p) => p.id));
      return false;
    }
    return true;
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  /** Begin a drag of these points, which may have one more than the editor. */
  beginDrag(points: Point[] = this.editor.points.list) {
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
    const { editor, drag0 } = this;
    if (!drag0) return;
    const free = freeIds(drag0, includeRims(drag0, ids));
    if (!free.length) {
      this.hintLocked([id]);
      return;
    }
    const f = (what === "target" ? editor.layers.nodes.pull : 1) / editor.viewport.view.k;
    const way = this.#snapMove(id, [f * by[0], f * by[1]], what, isLoose),
      lead = this.mirror.sideOf(id);
    this.#show(drag0, (t) =>
      this.mirror.edit(drag0, translatePoints(drag0, free, t * way[0]!, t * way[1]!, what), lead),
    );
  }

  /**
   * Show moving points, `make(1)` of them, or as far as parts and folds let them go; `make(0)` is the start.
   */
  #show(drag0: Point[], make: (share: number) => Point[]) {
    const { editor } = this,
      shapes = editor.points.shapes;
    const { points: wanted } = editor.tools.foldStop.limit((share) => ({ points: make(share), shapes }));
    const { points, held } = limitMove(drag0, wanted, editor.points.shapes.parts, editor.map.strength);
    editor.layers.handles.lock(held.map(({ point }) => point.id));
    if (held.length) this.#hintConflict(held[0]!);
    editor.frames.rate.recordMove(performance.now());
    this.#follow(points);
  }

  #follow(points: Point[]) {
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
    editor.tools.parts.sendMove();
  }

  #hintConflict({ point, part }: Held) {
    const why = part.motion ? "has its own motion" : "is fixed";
    this.editor.messages.hint(`${rbfLabel(point)} cannot go into ${partLabel(part)}, which ${why}`);
  }

  endDrag(isCancelled: boolean, kind: PointsEdit["kind"] = "move") {
    const { editor, drag0 } = this,
      points = editor.points.list;
    this.drag0 = null;
    editor.sender.drawn = editor.frames.rate.finish();
    editor.layers.handles.lock([]);
    if (!drag0) return;
    editor.points.list = drag0;
    if (!isCancelled && this.edit(points, kind)) return;
    editor.points.list = editor.sender.points; // Python may have moved them meanwhile
    editor.map.invalidate();
    if (this.isSent) editor.sender.move(editor.points.list); // Python has followed the drag, which is void now
  }

  // ---- single edits -------------------------------------------------------------------------------------------------

  /** Ids that may be changed, with those of their rims; a hint if there are none. */
  movableIds(ids: number[]) {
    const free = freeIds(this.editor.points.list, includeRims(this.editor.points.list, ids));
    if (ids.length && !free.length) this.hintLocked(ids);
    return free;
  }

  hintLocked([id]: number[]) {
    const p = this.editor.points.withId(id!);
    if (p) this.editor.messages.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  /**
   * Move the selected points, or the one in focus, by so many pixels of the picture; without any, move the view.
   */
  nudge(focused: number | null, [dx, dy]: Vector2, pixels: number, what: Moved) {
    const { editor } = this,
      ids = editor.points.idsAt(focused);
    if (ids.length === 0) {
      editor.viewport.panBy(-dx * pixels * 4, -dy * pixels * 4);
      return;
    }
    if (focused !== null && !editor.points.selected.has(focused)) editor.points.select([focused]);
    const [du, dv] = editor.model.get("raster").spacing,
      free = this.movableIds(ids);
    this.change(
      translatePoints(editor.points.list, free, dx * pixels * du, dy * pixels * dv, what),
      "nudge",
      `nudge ${ids}`,
    );
    const p = editor.points.withId(ids[0]!);
    if (p && ids.length === 1) editor.messages.announce(pointLabel(p));
  }

  /**
   * A function of places of the picture: the source of a point there that moves nothing, null in a gap. As drags are
   * magnified by the strength, a feature must come from target + D / strength to be seen at the target.
   */
  #sourcesOf(layered: LayeredFit | null): (target: Vector) => Vector2 | null {
    const strength = this.editor.map.strength || 1;
    return (target) => {
      const [da, db, opacity] = layered ? placeOf(layered, target[0], target[1], 1e-9) : ([0, 0, 1] as const);
      return opacity < 0.5 ? null : [target[0] + da / strength, target[1] + db / strength];
    };
  }

  /** The place of the original picture that is visible at a place, null in a gap. */
  visiblePlace([a, b]: Vector2): Vector2 | null {
    const { editor } = this,
      layered = editor.picture.isComparing ? null : editor.map.layered;
    const [da, db, opacity] = layered ? placeOf(layered, a, b, 1e-9) : ([0, 0, 1] as const);
    return opacity < 0.5 ? null : [a + da, b + db];
  }

  /**
   * Add a point that holds the tissue visible at a place of the view: its source is where the map leads, so nothing
   * moves.
   * @param at CSS pixels
   * @returns its id, that of a point which is there already, or null in a gap
   */
  addAt([x, y]: Vector2, isLoose = false): number | null {
    const { editor } = this,
      [near] = editor.points.list
        .map((p) => {
          const [px, py] = editor.viewport.toView(p.target as Vector2);
          return { id: p.id, away: Math.hypot(px - x, py - y) };
        })
        .sort((p, q) => p.away - q.away);
    if (near && near.away < NEAR) {
      editor.points.select([near.id]);
      editor.layers.handles.focus(near.id);
      return near.id;
    }
    const place = editor.viewport.placeAt([x, y]),
      target = isLoose ? place : this.snap.placeOf(place);
    const source = this.#sourcesOf(editor.map.fitAt([x, y]))(target);
    if (source === null) {
      editor.messages.hint("This is a gap: there is nothing here to take hold of");
      return null;
    }
    const id = nextId(editor.points.list, editor.sender.nextId);
    if (!this.change([...editor.points.list, newPoint(id, source, target)], "add")) return id;
    this.present(id, "added");
    return id;
  }

  addInMiddle() {
    this.addAt([this.editor.viewport.view.width / 2, this.editor.viewport.view.height / 2]);
  }

  /** Select a point, give it the focus, and describe it to a screen reader. */
  present(id: number, remark: string) {
    const { editor } = this,
      p = editor.points.withId(id);
    editor.points.select([id]);
    editor.frames.drawNow();
    editor.layers.handles.focus(id);
    if (p) editor.messages.announce(`${pointLabel(p)}, ${remark}`);
  }

  remove(wanted: number[]) {
    const { editor } = this,
      ids = this.movableIds(wanted),
      at = editor.points.list.findIndex((p) => p.id === ids[0]);
    const hadFocus = editor.stage.svg.contains(treeOf(editor.stage.root).activeElement);
    if (!ids.length || !this.change(removePoints(editor.points.list, ids), "remove")) return;
    editor.messages.announce(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    const next = editor.points.list[Math.min(at, editor.points.list.length - 1)];
    editor.frames.drawNow();
    if (hadFocus && next) editor.layers.handles.focus(next.id);
    else if (hadFocus) editor.stage.focus();
  }

  rename(id: number) {
    const { editor } = this,
      p = editor.points.withId(id);
    if (!p || editor.points.isLocked) return;
    editor.panels.names.prompt(p.name, `point ${id}`, editor.viewport.toView(p.target as Vector2), {
      take: (text) => {
        this.edit(renamePoint(editor.points.list, id, text), "rename");
      },
      focus: () => editor.layers.handles.focus(id),
    });
  }

  switch(ids: number[]) {
    this.change(togglePoints(this.editor.points.list, ids), "switch");
  }

  /** Reset these points to their sources, all if there are none. */
  reset(ids: number[]) {
    const points = this.editor.points.list;
    this.change(resetPoints(points, this.movableIds(ids.length ? ids : points.map((p) => p.id))), "reset");
  }

  /** The displacement that brings the point under the pointer onto a node; the others follow it. */
  #snapMove(id: number, way: Vector2, what: Moved, isLoose: boolean) {
    const p = this.drag0?.find((q) => q.id === id);
    if (!p || isLoose || what === "both" || !(this.snap.step > 0)) return way;
    const [a, b] = p[what] as Vector2,
      to = this.snap.placeOf([a + way[0], b + way[1]]);
    return [to[0] - a, to[1] - b];
  }

  // ---- turning and scaling ------------------------------------------------------------------------------------------

  /** The points that a rotation of the selection moves. A single point gets a rim, which turns around it. */
  #turnables(): Turn | null {
    const { editor } = this,
      points = editor.points.list,
      chosen = points.filter((p) => editor.points.selected.has(p.id) && !p.locked);
    if (!chosen.length) {
      this.hintLocked([...editor.points.selected]);
      return null;
    }
    if (chosen.length > 1) return { points, ids: this.movableIds(chosen.map((p) => p.id)), about: middleOf(chosen) };
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
      distance = Math.min(editor.tools.brush.radius, 0.6 * room);
    const rimmed = addRim(points, pin, distance, id, this.#sourcesOf(editor.map.layered));
    return { points: rimmed, ids: rimmed.slice(points.length).map((p) => p.id), about: pin.target as Vector2 };
  }

  /**
   * Turn or scale by a key. Quick presses are undone as one.
   * @param way 1 or 1
   */
  turnKey(way: number, how: { isLarge: boolean; isScale: boolean }) {
    const { editor } = this,
      [angle, factor] = turnOfKey(way, how),
      turn = editor.points.isLocked ? null : this.#turnables();
    if (!turn) return;
    const kind = angle ? "turn" : "scale";
    const points = rotatePoints(turn.points, turn.ids, turn.about, angle, factor);
    this.change(points, kind, `${kind} ${[...editor.points.selected]}`);
    editor.messages.announce(
      angle ? `turned by ${formatLength((angle * 180) / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`,
    );
  }

  beginTurn() {
    const turn = this.editor.points.isLocked ? null : this.#turnables();
    if (turn) this.beginDrag();
    return turn;
  }

  /** Turn and scale since the drag began. */
  turnTo({ points, ids, about }: Turn, angle: number, factor: number) {
    const { drag0 } = this;
    if (!drag0) return;
    this.#show(drag0, (t) => this.mirror.edit(drag0, rotatePoints(points, ids, about, t * angle, factor ** t)));
    this.editor.messages.hint(
      factor === 1 ? `${formatLength((angle * 180) / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`,
    );
  }

  // ---- locks --------------------------------------------------------------------------------------------------------

  toggleLock(ids: number[]) {
    const { editor } = this;
    if (!ids.length) {
      editor.messages.hint("Select points to lock them");
      return;
    }
    if (!this.edit(toggleLocks(editor.points.list, ids), "lock")) return;
    const isLocked = editor.points.withId(ids[0]!)?.locked;
    editor.messages.announce(
      `${ids.length === 1 ? `point ${ids[0]}` : `${ids.length} points`} ${isLocked ? "locked" : "free"}`,
    );
  }

  // ---- strokes of brushes -------------------------------------------------------------------------------------------

  /** Begin a stroke; null and a hint where none can begin. */
  beginStroke(place: Vector2, radius: number, tool: string) {
    const {
        editor,
        mirror: { state: mirror },
      } = this,
      settings = editor.map.settings;
    if (editor.points.isLocked) return null;
    const isNear = (at: Vector2) => mirror.on && mirrorSide(mirror, at, BRUSH_SETTLES * radius) === 0;
    const id = nextId(editor.points.list, editor.sender.nextId);
    const stroke = new Stroke(
      editor.points.list,
      place,
      radius,
      { tool, id },
      {
        box: editor.picture.box,
        reach: typeof settings.support === "number" ? settings.support : 0,
        sourceAt: (points) => this.#sourcesOf(points.some((p) => p.active) ? editor.map.fitOf(points) : null),
        settle: (at) => (isNear(at as Vector2) ? projectOnAxis(mirror, at) : at),
      },
    );
    if (stroke.lockedBy) {
      this.hintLocked([stroke.lockedBy.id]);
      return null;
    }
    if (!stroke.isPossible) {
      editor.messages.hint("There is nothing here to take hold of");
      return null;
    }
    this.strokeSide = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    this.beginDrag();
    return stroke;
  }

  /** Show the picture with a stroke as it is now; false where it must not continue. */
  paintStroke(stroke: Stroke) {
    const { editor, drag0 } = this;
    if (!drag0) return false;
    const points = this.mirror.edit(drag0, stroke.points, this.strokeSide),
      {
        points: {
          shapes: { parts },
        },
        map: { strength },
      } = editor;
    const held = parts.length ? findConflicts(points, parts, strength) : [];
    if (held.length > findConflicts(drag0, parts, strength).length) {
      this.#hintConflict(held[held.length - 1]!);
      return false;
    }
    if (
      editor.tools.foldStop.refuses(
        { points, shapes: editor.points.shapes },
        "The brush stops before the picture folds",
      )
    ) {
      editor.frames.invalidate();
      return false;
    }
    this.#follow(points);
    return true;
  }
}
