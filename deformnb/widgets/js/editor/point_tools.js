// The editor's edits of points: drags, nudges, new points. EditorPage is this, the hand's further tools, and the model.

import { Stroke } from "../maths/brushes.js";
import { layeredFit, placeOf } from "../maths/cuts.js";
import { foldsOf, probesOf } from "../maths/folds.js";
import { shownLength } from "../maths/numbers.js";
import {
  freeIds, lockedPoints, middleOf, mirroredEdit, mirrorSide, movedPoints, newPoint, nextId, onAxis, removedPoints,
  rimmedPoints, rimOf, samePoints, turnedPoints, turnOfKey, withRims,
} from "../maths/points.js";
import { RbfError, rbfLabel } from "../maths/rbf.js";
import { heldPoints, partLabel } from "../maths/rigid_stages.js";
import { placeSeen } from "../maths/warp_map.js";
import { LONGEST_EDIT } from "../sync/edits.js";
import { settingsOf } from "../sync/bus.js";
import { pointLabel } from "./handles.js";
import { NEAR } from "./pointer.js";
import { EditorShapes } from "./shape_tools.js";

const HOLD_LEAST = 0.05; // of det J, before which a hand is stopped that must not fold the map
const HOLD_WORK = 6e4, HOLD_NODES = [9, 33]; // evaluations of a kernel for one look, on a lattice of so many nodes a side

class EditorEdits extends EditorShapes {
  // The next list of points, unless it cannot be fitted while the present one can: then it is said why. `kind` is
  // what Python hears; edits with the same `join` in quick succession are undone as one.
  edit(points, kind = "move", join = null) {
    if (this.isLocked || samePoints(points, this.points)) return false;
    if (!this.error && !this.accepts(points)) return false;
    if (JSON.stringify(points).length > LONGEST_EDIT) {
      this.say("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    this.sender.edit(points, kind, join); // which tells all views, this one too
    return true;
  }

  accepts(points, shapes = this.shapes) {
    try { layeredFit(points, { ...this.settings, ...shapes, previous: this.layered }); } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      this.say(error.message, true);
      this.handles.blink(points.filter((p) => error.message.includes(rbfLabel(p))).map((p) => p.id));
      return false;
    }
    return true;
  }

  stepHistory(way) {
    if (this.drag0 || this.isLocked || !this.sender.step(way)) return;
    this.speak(way === "undo" ? "undone" : "redone");
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  get isHolding() { return this.drag0 !== null; }

  beginDrag() {
    if (this.isLocked) return;
    this.drag0 = this.points;
    this.least0 = null;
    this.stopNote = "";
    this.wasTold = false;
  }

  // `id` is the point under the hand; a loose hand is not held to the grid.
  drag(ids, dx, dy, what, id = null, isLoose = false) {
    if (!this.drag0) return;
    if (!ids.length) { this.tellLocked([id]); return; }
    const f = (what === "target" ? this.netNodes.pull : 1) / this.view.k;
    const way = this.snappedWay(id, [f * dx, f * dy], what, isLoose), lead = this.sideOfPoint(id);
    this.show((t) => this.symmetric(this.drag0, movedPoints(this.drag0, ids, t * way[0], t * way[1], what), lead));
  }

  // Points on their way, `make(1)` of them, or as far as parts and folds let them go; `make(0)` is where they began.
  show(make) {
    const wanted = this.withoutFolds(make);
    const allowed = this.shapes.parts.length ? this.allowedShare(this.drag0, wanted) : { share: 1, held: [] };
    this.points = allowed.share < 1 ? allowed.points : wanted;
    this.handles.lock(allowed.held.map(({ point }) => point.id));
    if (allowed.held.length) this.tellHeld(allowed.held[0]);
    this.rate.moved(performance.now());
    this.changed(true);
    this.isLive = true;
  }

  tellHeld({ point, part }) {
    const why = part.motion ? "has a motion of its own" : "is fixed";
    this.hint(`${rbfLabel(point)} cannot go into ${partLabel(part)}, which ${why}`);
  }

  // ---- folds --------------------------------------------------------------------------------------------------------

  // The smallest det J that these points make; minus infinity where they cannot be fitted.
  leastOf(points) {
    try {
      const layered = layeredFit(points, { ...this.settings, previous: this.layered }), [few, many] = HOLD_NODES;
      const nodes = Math.max(few, Math.min(many, Math.floor(Math.sqrt(HOLD_WORK / (layered.count + 1)))));
      return foldsOf(layered, this.box, nodes, probesOf(layered, HOLD_WORK / 4)).least;
    } catch (error) {
      if (!(error instanceof RbfError)) throw error;
      return -Infinity;
    }
  }

  // Whether the map folds with these points, and did not before: what is folded already may stay so.
  wouldFold(points) {
    this.least0 ??= this.leastOf(this.drag0);
    return this.leastOf(points) < Math.min(HOLD_LEAST, this.least0) - 1e-9;
  }

  // As far along the way as the map stays free of folds, if that is asked for.
  withoutFolds(make) {
    const wanted = make(1);
    this.stopNote = "";
    if (!this.model.get("stop_at_folds") || !this.wouldFold(wanted)) return wanted;
    this.stopNote = "Stopped before the picture folds; T lets points go on";
    let low = 0, high = 1;
    for (let turn = 0; turn < 8; turn++) {
      const middle = (low + high) / 2;
      if (this.wouldFold(make(middle))) high = middle;
      else low = middle;
    }
    return make(low);
  }

  endDrag(isCancelled, kind = "move") {
    const before = this.drag0, points = this.points;
    this.drag0 = null;
    this.sender.drawn = this.rate.taken();
    this.handles.lock([]);
    if (!before) return;
    this.points = before;
    if (!isCancelled && this.edit(points, kind)) return;
    this.points = this.sender.points; // Python may have moved them meanwhile
    this.changed();
    if (this.wasTold) this.sender.move(this.points); // Python has seen the drag, and now that it is no more
  }

  // ---- single edits -------------------------------------------------------------------------------------------------

  // The same edit on the other side of the mirror, if there is one, and what is locked left where it is.
  change(points, kind, join = null) { return this.edit(this.symmetric(this.points, points, 0, kind === "add"), kind, join); }

  // Those that may be changed, with what goes along with them; it is said if there are none.
  freed(ids) {
    const free = freeIds(this.points, withRims(this.points, ids));
    if (ids.length && !free.length) this.tellLocked(ids);
    return free;
  }

  tellLocked(ids) {
    const p = this.points.find((q) => q.id === ids[0]);
    if (p) this.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  nudge(focused, [dx, dy], pixels, what) {
    const ids = focused !== null && !this.selected.has(focused) ? [focused] : [...this.selected];
    if (ids.length === 0) { this.panBy(-dx * pixels * 4, -dy * pixels * 4); return; }
    if (focused !== null && !this.selected.has(focused)) this.select([focused]);
    const [du, dv] = this.model.get("raster").spacing, free = this.freed(ids);
    this.change(movedPoints(this.points, free, dx * pixels * du, dy * pixels * dv, what), "nudge", `nudge ${ids}`);
    if (ids.length === 1) this.speak(pointLabel(this.points.find((p) => p.id === ids[0])));
  }

  // What is seen at places of the picture, as the source of a point there; null in a gap. Dragged `strength` times, a
  // feature must come from target + D to be seen at the target.
  sourcesOf(layered) {
    const strength = settingsOf(this.model).strength || 1;
    return (target) => {
      const [da, db, opacity] = layered ? placeOf(layered, ...target, 1e-9) : [0, 0, 1];
      return opacity < 0.5 ? null : [target[0] + da / strength, target[1] + db / strength];
    };
  }

  placeAt([x, y]) { return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k]; }

  onView([a, b]) { return [this.view.k * a + this.view.x, this.view.k * b + this.view.y]; }

  // A new point takes hold of what is seen there: its source is where the map looks, so nothing moves.
  addAt([x, y], isLoose = false) {
    const near = this.points.map((p) => [Math.hypot(this.onView(p.target)[0] - x, this.onView(p.target)[1] - y), p.id])
      .sort((p, q) => p[0] - q[0])[0];
    if (near && near[0] < NEAR) { this.select([near[1]]); this.handles.focus(near[1]); return near[1]; }
    const place = this.placeAt([x, y]), target = isLoose ? place : this.snappedPlace(place);
    const source = this.sourcesOf(this.isComparing ? null : this.layered)(target);
    if (source === null) { this.hint("This is a gap: there is nothing here to take hold of"); return null; }
    const id = nextId(this.points, this.sender.nextId);
    if (!this.change([...this.points, newPoint(id, source, target)], "add")) return id;
    this.select([id]);
    this.drawNow();
    this.handles.focus(id);
    this.speak(`${pointLabel(this.points.find((p) => p.id === id))}, added`);
    return id;
  }

  addInMiddle() { this.addAt([this.view.width / 2, this.view.height / 2]); }

  remove(wanted) {
    const ids = this.freed(wanted), at = this.points.findIndex((p) => p.id === ids[0]);
    const hadFocus = this.svg.contains(this.root.getRootNode().activeElement);
    if (!ids.length || !this.change(removedPoints(this.points, ids), "remove")) return;
    this.speak(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    const next = this.points[Math.min(at, this.points.length - 1)];
    this.drawNow();
    if (hadFocus && next) this.handles.focus(next.id);
    else if (hadFocus) this.focusStage();
  }
}

// Further tools of the editor's hand: turning, locks, the mirror, the grid that holds, and what brushes write.

const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point goes onto it

export class EditorHand extends EditorEdits {
  // ---- the mirror ---------------------------------------------------------------------------------------------------

  get mirror() {
    const { on = false, axis = "a", at = null } = this.model.get("mirror") ?? {};
    return { on, axis, at: at ?? this.#middle(axis) };
  }

  #middle(axis) {
    const [a0, a1, b0, b1] = this.box;
    return axis === "a" ? (a0 + a1) / 2 : (b0 + b1) / 2;
  }

  // The lengths within which a source is on the axis, and a partner is found: parts of a pixel.
  get mirrorNear() {
    const pixel = Math.max(...this.model.get("raster").spacing);
    return { axis: 0.5 * pixel, partner: pixel };
  }

  setMirror(change) {
    this.set("mirror", { ...this.mirror, ...change });
    if (this.mirror.on) this.hint(`What you do on one side of the ${this.axisWord} line is done on the other too`, 4000);
  }

  get axisWord() { return this.mirror.axis === "a" ? "upright" : "level"; }

  toggleMirror() { this.setMirror({ on: !this.mirror.on }); }

  turnMirror() {
    const axis = this.mirror.axis === "a" ? "b" : "a";
    this.setMirror({ on: true, axis, at: this.#middle(axis) });
  }

  // The axis under the hand; Python hears of it at the end.
  moveAxis(at, isEnd) {
    const c = this.mirror.axis === "a" ? 0 : 1, [low, high] = [this.box[2 * c], this.box[2 * c + 1]];
    this.model.set("mirror", { ...this.mirror, at: Math.max(low, Math.min(high, at)) });
    if (isEnd) this.model.save_changes();
    this.invalidate();
  }

  sideOfPoint(id) {
    const p = this.points.find((q) => q.id === id);
    return p && this.mirror.on ? mirrorSide(this.mirror, p.source, this.mirrorNear.axis) : 0;
  }

  // `holds`: new points take hold of what is seen, on both sides.
  symmetric(before, after, lead = 0, holds = false) {
    const { mirror } = this;
    if (!mirror.on) return after;
    const seenAt = (source) => (holds && this.layered && this.strength === 1 && !this.isComparing
      ? placeSeen(this.layered, source, 1e-6 * this.mirrorNear.axis) : null);
    return mirroredEdit(mirror, before, after, { near: this.mirrorNear, lead, id: nextId(after, this.sender.nextId), seenAt });
  }

  // ---- the grid that holds ------------------------------------------------------------------------------------------

  // A cell of the grid that is drawn.
  get cell() {
    const [a0, a1, b0, b1] = this.box;
    return Math.max(a1 - a0, b1 - b0) / (this.model.get("density") || 16);
  }

  toggleSnap() {
    this.set("snap", this.model.get("snap") > 0 ? 0 : this.cell);
    if (this.model.get("snap") > 0) this.hint(`Targets keep to a grid of ${shownLength(this.model.get("snap"))}; hold Alt to go between`, 4000);
  }

  // The next node; the drawn grid fills the box with whole cells, which may be a little larger or smaller.
  snappedPlace([a, b]) {
    const step = this.model.get("snap") || 0, [a0, a1, b0, b1] = this.box;
    if (!(step > 0)) return [a, b];
    const isDrawn = Math.abs(step - this.cell) < 1e-6 * this.cell;
    const whole = (length) => (isDrawn ? length / Math.max(1, Math.round(length / step)) : step);
    const [da, db] = [whole(a1 - a0), whole(b1 - b0)];
    return [a0 + da * Math.round((a - a0) / da), b0 + db * Math.round((b - b0) / db)];
  }

  // The way that brings the point under the hand onto a node; the others go with it.
  snappedWay(id, way, what, isLoose) {
    const p = this.drag0.find((q) => q.id === id);
    if (!p || isLoose || what === "both" || !(this.model.get("snap") > 0)) return way;
    const [a, b] = p[what], to = this.snappedPlace([a + way[0], b + way[1]]);
    return [to[0] - a, to[1] - b];
  }

  // ---- turning and scaling ------------------------------------------------------------------------------------------

  // What a turn of the selection turns, and about which place. A point alone gets a rim, which turns around it.
  turnables() {
    const chosen = this.points.filter((p) => this.selected.has(p.id) && !p.locked);
    if (!chosen.length) { this.tellLocked([...this.selected]); return null; }
    if (chosen.length > 1) return { points: this.points, ids: this.freed(chosen.map((p) => p.id)), about: middleOf(chosen) };
    const [pin] = chosen, rim = rimOf(this.points, pin).filter((p) => !p.locked);
    if (rim.length) return { points: this.points, ids: rim.map((p) => p.id), about: pin.target };
    const room = this.points.reduce((least, p) => (p.id === pin.id || !p.active ? least
      : Math.min(least, Math.hypot(p.target[0] - pin.target[0], p.target[1] - pin.target[1]))), Infinity);
    const points = rimmedPoints(this.points, pin, Math.min(this.brush.radius, 0.6 * room),
      nextId(this.points, this.sender.nextId), this.sourcesOf(this.layered));
    return { points, ids: points.slice(this.points.length).map((p) => p.id), about: pin.target };
  }

  // By a key: radians and a factor. Quick presses are undone as one.
  turnBy(angle, factor) {
    const held = this.turnables();
    if (!held) return;
    const kind = angle ? "turn" : "scale";
    this.change(turnedPoints(held.points, held.ids, held.about, angle, factor), kind, `${kind} ${[...this.selected]}`);
    this.speak(angle ? `turned by ${shownLength(angle * 180 / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`);
  }

  turnKey(way, how) { if (!this.isLocked) this.turnBy(...turnOfKey(way, how)); }

  beginTurn() {
    const held = this.isLocked ? null : this.turnables();
    if (!held) return null;
    this.beginDrag();
    return held;
  }

  turnTo(held, angle, factor) {
    this.show((t) => this.symmetric(this.drag0, turnedPoints(held.points, held.ids, held.about, t * angle, factor ** t)));
    this.hint(factor === 1 ? `${shownLength(angle * 180 / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`);
  }

  // ---- locks --------------------------------------------------------------------------------------------------------

  toggleLock(ids) {
    if (!ids.length) { this.hint("Select points to lock them"); return; }
    if (!this.edit(lockedPoints(this.points, ids), "lock")) return;
    const isLocked = this.points.find((p) => p.id === ids[0]).locked;
    this.speak(`${ids.length === 1 ? `point ${ids[0]}` : `${ids.length} points`} ${isLocked ? "locked" : "free"}`);
  }

  // ---- brushes ------------------------------------------------------------------------------------------------------

  setBrush(tool) {
    const was = this.brush.tool;
    this.brush.stop();
    if (was === tool || this.isLocked) return;
    this.setAdding(false);
    this.setSelecting(false);
    this.pen.stop();
    this.chooseShape(null);
    this.select([]);
    this.brush.start(tool);
    this.focusStage();
  }

  // null, and a word why, where no stroke can begin.
  beginStroke(place, radius, tool) {
    if (this.isLocked) return null;
    const { mirror } = this, settings = this.settings;
    const isNear = (at) => mirror.on && mirrorSide(mirror, at, BRUSH_SETTLES * radius) === 0;
    const sourceAt = (points) => this.sourcesOf(points.some((p) => p.active) ? layeredFit(points, settings) : null);
    const stroke = new Stroke(this.points, place, radius, { tool, box: this.box, id: nextId(this.points, this.sender.nextId),
      sourceAt, reach: this.settings.support ?? 0, settle: (at) => (isNear(at) ? onAxis(mirror, at) : at) });
    if (stroke.lockedBy) { this.tellLocked([stroke.lockedBy.id]); return null; }
    if (!stroke.isPossible) { this.hint("There is nothing here to take hold of"); return null; }
    stroke.lead = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    this.beginDrag();
    return stroke;
  }

  // The picture with a stroke as it is now; false where it must not be.
  paintStroke(stroke) {
    if (!this.drag0) return false;
    const points = this.symmetric(this.drag0, stroke.points, stroke.lead), { parts } = this.shapes;
    const held = parts.length ? heldPoints(points, parts, this.strength) : [];
    if (held.length > heldPoints(this.drag0, parts, this.strength).length) { this.tellHeld(held[held.length - 1]); return false; }
    this.stopNote = "";
    if (this.wouldFold(points)) { this.stopNote = "The brush stops before the picture folds"; this.invalidate(); return false; }
    this.points = points;
    this.changed(true);
    this.isLive = true;
    return true;
  }

  // ---- commands -----------------------------------------------------------------------------------------------------

  // Those of the toolbar and the keys that this file is about; false for others.
  runTool(command, ids) {
    const commands = {
      select: () => this.setSelecting(!this.isSelecting), smudge: () => this.setBrush("smudge"), size: () => this.setBrush("size"), lock: () => this.toggleLock(ids),
      mirror: () => this.toggleMirror(), "mirror-axis": () => this.turnMirror(), snap: () => this.toggleSnap(),
      stop: () => this.set("stop_at_folds", !this.model.get("stop_at_folds")),
      "turn-left": () => this.turnKey(-1, { isLarge: true }), "turn-right": () => this.turnKey(1, { isLarge: true }),
    };
    if (!Object.hasOwn(commands, command)) return false;
    commands[command]();
    return true;
  }

  get pressedTools() {
    const chosen = this.points.filter((p) => this.selected.has(p.id));
    return { select: this.isSelecting, smudge: this.brush.tool === "smudge", size: this.brush.tool === "size", mirror: this.mirror.on,
      snap: this.model.get("snap") > 0, stop: Boolean(this.model.get("stop_at_folds")),
      lock: chosen.length > 0 && chosen.every((p) => p.locked) };
  }
}
