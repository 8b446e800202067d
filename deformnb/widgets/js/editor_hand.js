// Further tools of the editor's hand: turning, locks, the mirror, the grid that holds, and what brushes write.

const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point goes onto it

class EditorHand extends EditorEdits {
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
