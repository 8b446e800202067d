// Tools of the hand of the editor in space: turning, the mirror, the lattice that holds. Needs turns.js, mirror.js,
// space_edits.js and hand_marks.js. SpaceEditorPage (space_editor.js) is this and the talk with Python.

const SNAP_PARTS = 16; // of the longest side: the step of the lattice, in whole voxels

class SpaceHand extends SpaceEditing {
  // ---- the mirror ---------------------------------------------------------------------------------------------------

  // The picture across which a plane lies that is the next to an axis of space.
  #facing(axis) {
    const k = "xyz".indexOf(axis);
    return this.panes.reduce((p, q) => (Math.abs(q.n[k]) > Math.abs(p.n[k]) ? q : p));
  }

  // `normal` looks to the positive side of the axis, so in an upright volume `at` is a coordinate.
  get mirror() {
    const { on = false, axis = "x", at = null } = this.model.get("mirror") ?? {}, pane = this.#facing(axis);
    const sign = Math.sign(pane.n["xyz".indexOf(axis)]) || 1, normal = pane.n.map((x) => sign * x);
    return { on, axis, at: at ?? dot(normal, fromPane(pane, [0, 0, (pane.box[4] + pane.box[5]) / 2])), normal };
  }

  // The lengths within which a source is on the plane, and a partner is found.
  get mirrorNear() {
    const { spacing } = this.panes[0];
    return { axis: 0.5 * Math.min(...spacing), partner: Math.max(...spacing) };
  }

  #setMirror(on, axis, at) {
    this.set("mirror", { on, axis, at });
    if (at === null) this.set("mirror", { on, axis, at: this.mirror.at }); // the middle
    if (on) this.hint(`What you do on one side of the plane across ${axis} is done on the other too`, 4000);
  }

  toggleMirror() {
    const { on, axis, at } = this.mirror;
    this.#setMirror(!on, axis, at);
  }

  turnMirror() { this.#setMirror(true, "xyz"[("xyz".indexOf(this.mirror.axis) + 1) % 3], null); }

  // The plane to a place in space; Python hears of it at the end.
  moveMirror(place, isEnd) {
    const { on, axis, normal } = this.mirror, pane = this.#facing(axis);
    const ends = [pane.box[4], pane.box[5]].map((depth) => dot(normal, fromPane(pane, [0, 0, depth])));
    const at = Math.max(Math.min(...ends), Math.min(Math.max(...ends), dot(normal, place)));
    this.model.set("mirror", { on, axis, at });
    if (isEnd) this.model.save_changes();
    this.invalidate();
  }

  // The plane as a picture shows it that looks along it: "a" and "b" as of a flat mirror, null where it faces the eye.
  mirrorIn(pane) {
    const { on, at, normal } = this.mirror, [a, b] = [dot(normal, pane.u), dot(normal, pane.v)];
    if (!on || Math.max(Math.abs(a), Math.abs(b)) < 0.9) return null;
    const place = inPane(pane, normal.map((x) => at * x)), k = Math.abs(a) > Math.abs(b) ? 0 : 1;
    return { on, axis: "ab"[k], at: place[k] };
  }

  sideOfPoint(id) {
    const p = this.points.find((q) => q.id === id), { mirror } = this;
    return p && mirror.on ? mirrorSide(mirror, p.source, this.mirrorNear.axis) : 0;
  }

  symmetric(before, after, lead = 0) {
    const { mirror } = this;
    if (!mirror.on) return after;
    return mirroredEdit(mirror, before, after, { near: this.mirrorNear, lead, id: nextId(after, this.sender.nextId) });
  }

  // An edit, and the same on the other side of the mirror if there is one.
  change(points, kind, join = null) { return this.edit(this.symmetric(this.points, points), kind, join); }

  // ---- the lattice that holds ---------------------------------------------------------------------------------------

  toggleSnap() {
    const { box: [a0, a1, b0, b1, c0, c1], spacing } = this.panes[0], voxel = Math.min(...spacing);
    const step = voxel * Math.max(1, Math.round(Math.max(a1 - a0, b1 - b0, c1 - c0) / SNAP_PARTS / voxel));
    this.set("snap", this.model.get("snap") > 0 ? 0 : step);
    if (this.model.get("snap") > 0) this.hint(`Targets keep to a lattice of ${shownLength(step)}; hold Alt to go between`, 4000);
  }

  // The next node in a picture, whose nodes begin at the middle of its first voxel; the depth stays.
  snapped(pane, [a, b, c]) {
    const step = this.model.get("snap") || 0, { box: [a0,, b0], spacing: [du, dv] } = pane;
    const near = (value, first) => first + step * Math.round((value - first) / step);
    return step > 0 ? [near(a, a0 + du / 2), near(b, b0 + dv / 2), c] : [a, b, c];
  }

  // The way that brings the point under the hand onto a node; the others go with it.
  snappedWay(pane, id, way, what, isLoose) {
    const p = this.drag0?.find((q) => q.id === id);
    if (!p || isLoose || what !== "target" || !(this.model.get("snap") > 0)) return way;
    const to = fromPane(pane, this.snapped(pane, inPane(pane, p.target.map((x, k) => x + way[k]))));
    return to.map((x, k) => x - p.target[k]);
  }

  // ---- turning and scaling ------------------------------------------------------------------------------------------

  // The ids that a turn takes along; null, and a word why, where there is nothing to turn.
  turnables() {
    const chosen = [...this.selected], free = freeIds(this.points, chosen);
    if (this.isLocked || !chosen.length) return null;
    if (!free.length) this.tellLocked(chosen[0]);
    else if (free.length < 2) this.hint("Select two points or more to turn them", 4000);
    return free.length < 2 ? null : free;
  }

  // By a key, in the plane of a picture. Quick presses are undone as one.
  turnKey(pane, way, how) {
    const ids = this.turnables(), [angle, factor] = turnOfKey(way, how), kind = angle ? "turn" : "scale";
    if (!ids) return;
    this.change(turnedInSpace(this.points, ids, pane.info, angle, factor), kind, `${kind} ${pane.index} ${ids}`);
    this.speak(angle ? `turned by ${shownLength(angle * 180 / Math.PI)} degrees` : `scaled by ${factor.toFixed(2)}`);
  }

  beginTurn() {
    const ids = this.turnables();
    if (ids) this.beginDrag();
    return ids;
  }

  turnTo(pane, ids, angle, factor) {
    this.show(this.symmetric(this.drag0, turnedInSpace(this.drag0, ids, pane.info, angle, factor)));
    this.hint(factor === 1 ? `${shownLength(angle * 180 / Math.PI)}\u00b0` : `\u00d7 ${factor.toFixed(2)}`);
  }

  // ---- commands -----------------------------------------------------------------------------------------------------

  // False for those of others.
  runTool(command, pane) {
    const commands = {
      mirror: () => this.toggleMirror(), "mirror-axis": () => this.turnMirror(), snap: () => this.toggleSnap(),
      "turn-left": () => this.turnKey(pane, -1, { isLarge: true }), "turn-right": () => this.turnKey(pane, 1, { isLarge: true }),
    };
    if (!Object.hasOwn(commands, command)) return false;
    commands[command]();
    return true;
  }
}
