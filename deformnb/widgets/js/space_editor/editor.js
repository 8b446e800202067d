// What the editor in space draws and says, and its edits. SpaceEditorPage is this and the talk with Python.

import { EditorDrawing, NEARLY_FOLDED } from "../editor/drawing.js";
import { dot } from "../maths/camera.js";
import { shownLength } from "../maths/numbers.js";
import {
  addedPoint, freeIds, lockedPoints, mirroredEdit, mirrorSide, nextId, removedPoints, renamedPoint, resetPoints,
  samePoints, switchedPoints, turnOfKey,
} from "../maths/points.js";
import { flatPoint, fromPane, inPane, movedInSpace, turnedInSpace, wayInPane, withSources } from "../maths/space.js";
import { busOf, holdBus, publishPoints, releaseBus, settingsOf } from "../sync/bus.js";
import { LONGEST_EDIT, RestingTrait, senderOf } from "../sync/edits.js";
import { OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.js";
import { helpPanel, SPACE_EDITOR_KEYS } from "../ui/key_help.js";
import { Toolbar } from "../ui/toolbar.js";
import { SpacePane } from "./pane.js";
import { PaneGestures, SPACE_NEAR, spaceKey } from "./pointer.js";

const LEAST_HEIGHT = 140; // CSS pixels of a picture
const SPACE_FOLD_TIP = "Smallest factor by which volumes are stretched, on a coarse lattice: 1 keeps them; below 0 the " +
  "volume folds over itself";

const SPACE_GROUPS = [
  [["add", "Add", "Add points: click where", true],
    ["select", "Select", "Select several points: drag a band, or tap them", true],
    ["remove", "Delete", "Delete the selected points", false, "selection"],
    ["rename", "Rename", "Name the selected point", false, "one"],
    ["switch", "On/off", "Switch the selected points on or off", false, "selection"],
    ["lock", "Lock", "Lock the selected points, or free them", true, "selection"],
    ["reset", "Put back", "Put the selected points, or all, back where they were taken", false, "points"]],
  [["undo", "Undo", "Undo", false, "past"], ["redo", "Redo", "Redo", false, "future"]],
  [["go", "Go to", "Bring the slices to the selected point", false, "one"],
    ["compare", "Before", "Show the volume as it was", true]],
  [["zoom-out", "", "Zoom out"], ["zoom-in", "", "Zoom in"], ["fit", "Fit", "Show the whole pictures"]],
  [["more", "More", "More tools", false], ["help", "Keys", "Keys and gestures", true]],
];
const SPACE_MORE = [
  [["mirror", "Mirror", "Do the same on both sides of a plane", true],
    ["mirror-axis", "Mirror another way", "Lay the plane of the mirror across the next axis", false],
    ["snap", "Snap to a lattice", "Targets keep to the nodes of a lattice", true]],
  [["turn-left", "Turn left by 15\u00b0", "Turn the selected points to the left in the picture", false, "points_selected"],
    ["turn-right", "Turn right by 15\u00b0", "Turn the selected points to the right in the picture", false, "points_selected"]],
];

class SpaceEditing extends EditorDrawing {
  // ---- drawing ------------------------------------------------------------------------------------------------------

  layout() {
    this.applyTheme(); // a style sheet that comes late changes sizes as well
    this.root.setAttribute("aria-label", `Editor in space of ${this.model.get("label") || "Volume"}`);
    const widths = this.pictures.map((pane) => Math.max(100, pane.stage.clientWidth || 260)), most = this.model.get("height");
    const wanted = this.pictures.map(({ info: { box: [a0, a1, b0, b1] } }, k) => widths[k] * (b1 - b0) / (a1 - a0));
    const height = Math.round(Math.max(LEAST_HEIGHT, Math.min(most, Math.max(...wanted))));
    this.pictures.forEach((pane, k) => pane.layout(widths[k], height));
    this.drawNow();
  }

  draw() {
    if (this.pictures.map((pane) => pane.draw()).some(Boolean)) this.focusStage(); // no shortcut: all are drawn
    this.describe();
  }

  describe() {
    const { points, selected, facts } = this, off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one ? `point ${one.id}${one.name ? ` ${one.name}` : ""} at ${one.target.map(shownLength).join(", ")}`
      : selected.size ? `${selected.size} selected` : "";
    setText(this.factsLine, points.length ? [count, chosen].filter(Boolean).join(" \u00b7 ")
      : "No points yet: four or more in space bend the volume, one moves it");
    this.#describeFolds(points.length ? facts.folds : null);
    setText(this.notes, facts.note || this.#advice());
    this.notes.classList.toggle("dnb-ed-bad", Boolean(facts.isBad));
    this.notes.classList.toggle("dnb-ed-near", !facts.isBad && Boolean(facts.note));
    this.chooser.value = this.model.get("projection");
    const pressed = Object.entries({ add: this.isAdding, select: this.isSelecting,
      mirror: this.mirror.on, snap: this.model.get("snap") > 0, compare: this.model.get("shows_original"), help: !this.help.hidden,
      lock: selected.size > 0 && points.every((p) => p.locked || !selected.has(p.id)) });
    this.toolbar.update({ count: points.length, selected: selected.size, past: this.sender.canStep("undo"),
      future: this.sender.canStep("redo"), steps: this.model.get("history") ?? {},
      pressed: pressed.filter(([, is]) => is).map(([name]) => name), readOnly: this.isLocked });
  }

  #describeFolds(folds) {
    const [least, share] = folds ?? [1, 0], value = `min det J ${least.toFixed(2)}`;
    this.foldFact.classList.toggle("dnb-ed-bad", least <= 0);
    this.foldFact.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    const words = least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds" : "\u2713 no folds";
    setText(this.foldFact, folds ? `${words} (${value})` : "");
    setAttributes(this.foldFact, { title: folds ? SPACE_FOLD_TIP : "" });
  }

  // What can be done next, where there is nothing to remark.
  #advice() {
    if (this.model.get("read_only")) return "These points are shown only";
    if (this.points.length === 0) return "Double-click a picture to add a point; click to bring the slices there; ? lists all keys";
    if (this.selected.size === 0) {
      const wheel = this.isSlice ? "goes through the slices" : "zooms";
      return `Drag a disc to move what lies under it; the wheel ${wheel}; ? lists all keys`;
    }
    return "Arrows move the selected points, J brings the slices to them, Delete removes them, Home puts them back";
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  edit(points, kind = "move", join = null) {
    if (this.isLocked || samePoints(points, this.points)) return false;
    if (JSON.stringify(points).length > LONGEST_EDIT) {
      this.say("These are too many points to send at once. Remove some, or edit in Python.");
      return false;
    }
    this.sender.edit(points, kind, join); // which tells all views, this one too
    return true;
  }

  stepHistory(way) {
    if (this.drag0 || this.isLocked || !this.sender.step(way)) return;
    this.speak(way === "undo" ? "undone" : "redone");
  }

  beginDrag() { if (!this.isLocked) this.drag0 = this.points; }

  drag(ids, way, what, id) {
    if (this.drag0) this.show(this.symmetric(this.drag0, movedInSpace(this.drag0, ids, way, what), this.sideOfPoint(id)));
  }

  // Points on their way.
  show(points) {
    this.points = points;
    publishPoints(this.bus, { origin: this.id, points: this.points, settings: settingsOf(this.model), fit: null, phase: "move" });
    this.sender.move(this.points);
    this.invalidate();
  }

  endDrag(isCancelled, kind = "move") {
    const before = this.drag0, points = this.points;
    this.drag0 = null;
    if (!before) return;
    this.points = before;
    if (!isCancelled && this.edit(points, kind)) return;
    this.points = this.sender.points; // Python may have moved them meanwhile
    publishPoints(this.bus, { origin: this.id, points: this.points, settings: settingsOf(this.model), fit: null, phase: "end" });
    this.sender.move(this.points); // Python has seen the drag, and now that it is no more
    this.invalidate();
  }

  #chosen(id) { return id !== null && !this.selected.has(id) ? [id] : [...this.selected]; }

  nudge(pane, id, [dx, dy], voxels, what) {
    const { spacing: [du, dv] } = pane.info, way = wayInPane(pane.info, dx * voxels * du, dy * voxels * dv);
    this.#nudgeBy(id, way, what);
  }

  nudgeDepth(pane, id, voxels) {
    const by = voxels * pane.info.spacing[2], ids = this.#chosen(id);
    if (ids.length) this.#nudgeBy(id, pane.info.n.map((x) => by * x), "target");
  }

  #nudgeBy(id, way, what) {
    const ids = this.#chosen(id);
    if (ids.length === 0) { this.setCursor(this.cursor.map((x, k) => x + way[k]), true); return; }
    if (id !== null && !this.selected.has(id)) this.select([id]);
    const free = freeIds(this.points, ids);
    if (!free.length) this.tellLocked(ids[0]);
    this.change(movedInSpace(this.points, free, way, what), "nudge", `nudge ${ids}`);
    const p = ids.length === 1 && this.points.find((q) => q.id === ids[0]);
    if (p) this.speak(`point ${p.id} at ${p.target.map(shownLength).join(", ")}`);
  }

  // A new point takes hold of what is seen where it is put: Python looks up where that comes from, and nothing moves.
  addAt(pane, at) {
    const flat = this.points.map((p) => flatPoint(p, pane.info, this.isSlice ? pane.depth : null)), { k, x, y } = pane.view;
    const near = flat.find((p) => !p.isFar && Math.hypot(k * p.target[0] + x - at[0], k * p.target[1] + y - at[1]) < SPACE_NEAR);
    if (near) { this.select([near.id]); pane.handles.focus(near.id); return near.id; }
    if (!pane.isInside(at)) { this.hint("Points are put inside the volume"); return null; }
    return this.addPlace(fromPane(pane.info, this.snapped(pane.info, inPane(pane.info, pane.under(at)))), pane);
  }

  addAtCursor(pane) { this.addPlace(this.cursor, pane); }

  addPlace(place, pane) {
    const id = nextId(this.points, this.sender.nextId), points = addedPoint(this.points, id, place, place);
    if (!this.change(points, "add")) return null;
    this.select([id]);
    this.drawNow();
    pane.handles.focus(id);
    this.speak(`point ${id} added at ${place.map(shownLength).join(", ")}`);
    return id;
  }

  tellLocked(id) {
    const p = this.points.find((q) => q.id === id);
    if (p) this.hint(`${p.name || `Point ${p.id}`} is locked; L frees it`, 4000);
  }

  toggleLock(ids) {
    if (!ids.length) this.hint("Select points to lock them");
    else if (this.edit(lockedPoints(this.points, ids), "lock")) {
      this.speak(this.points.find((p) => p.id === ids[0]).locked ? "locked" : "free");
    }
  }

  remove(wanted) {
    const ids = freeIds(this.points, wanted);
    if (wanted.length && !ids.length) this.tellLocked(wanted[0]);
    const at = this.points.findIndex((p) => p.id === ids[0]), pane = this.paneOf(document.activeElement);
    const hadFocus = this.root.contains(this.root.getRootNode().activeElement);
    if (!ids.length || !this.change(removedPoints(this.points, ids), "remove")) return;
    this.speak(ids.length === 1 ? `point ${ids[0]} deleted` : `${ids.length} points deleted`);
    this.drawNow();
    const next = this.points[Math.min(at, this.points.length - 1)];
    if (hadFocus && !(next && pane.handles.focus(next.id))) pane.stage.focus({ preventScroll: true });
  }

  rename(id, pane = this.paneOf(document.activeElement)) {
    const p = this.points.find((q) => q.id === id);
    if (!p || this.isLocked) return;
    const flat = flatPoint(p, pane.info, null), { k, x, y } = pane.view, box = this.row.getBoundingClientRect();
    const stage = pane.stage.getBoundingClientRect();
    Object.assign(this, { renamed: id, renamedIn: pane });
    this.input.hidden = false;
    this.input.value = p.name;
    this.input.placeholder = `point ${id}`;
    this.input.style.left = `${Math.max(4, Math.min(box.width - 164, stage.left - box.left + k * flat.target[0] + x + 12))}px`;
    this.input.style.top = `${Math.max(4, stage.top - box.top + k * flat.target[1] + y - 30)}px`;
    this.input.focus();
    this.input.select();
  }

  endRename(isKept) {
    if (this.input.hidden) return;
    const id = this.renamed, hadFocus = this.root.getRootNode().activeElement === this.input;
    this.input.hidden = true;
    if (isKept) this.edit(renamedPoint(this.points, id, this.input.value), "rename");
    if (!this.renamedIn.handles.focus(id) && hadFocus) this.renamedIn.stage.focus({ preventScroll: true });
  }

  // ---- selection and commands ---------------------------------------------------------------------------------------

  select(ids, isShared = true) {
    const known = new Set(this.points.map((p) => p.id)), next = new Set((ids ?? []).filter((id) => known.has(id)));
    const isSame = next.size === this.selected.size && [...next].every((id) => this.selected.has(id));
    this.selected = next;
    this.invalidate();
    if (isSame || !isShared) return;
    this.selection.tellSoon([...this.selected]);
  }

  toggleSelected(id) {
    this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  run(command, focused) {
    const ids = this.#chosen(focused), all = this.points.map((p) => p.id);
    if (focused === null && this.toolbar.isOff(command)) return;
    const active = this.paneOf(document.activeElement);
    if (this.runTool(command, active)) return;
    const every = (f) => this.pictures.forEach(f);
    const commands = {
      add: () => this.setAdding(!this.isAdding), select: () => this.setSelecting(!this.isSelecting), remove: () => this.remove(ids), undo: () => this.stepHistory("undo"),
      redo: () => this.stepHistory("redo"), rename: () => ids.length === 1 && this.rename(ids[0], active),
      switch: () => this.change(switchedPoints(this.points, ids), "switch"),
      reset: () => this.change(resetPoints(this.points, freeIds(this.points, ids.length ? ids : all)), "reset"),
      lock: () => this.toggleLock(ids),
      go: () => ids.length === 1 && this.goTo(ids[0]),
      compare: () => this.look({ original: !this.model.get("shows_original") }),
      "zoom-in": () => every((pane) => pane.zoomAt(1.25)), "zoom-out": () => every((pane) => pane.zoomAt(0.8)),
      fit: () => every((pane) => pane.fitView()), help: () => this.toggleHelp(),
    };
    commands[command]?.();
  }

  // While it is on, whatever is dragged around or clicked is added to what is selected: fingers have no Shift key.
  setSelecting(isSelecting) {
    if (isSelecting) this.setAdding(false);
    this.isSelecting = isSelecting;
    if (isSelecting) this.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    this.invalidate();
  }

  setAdding(isAdding) {
    if (isAdding) this.setSelecting(false);
    this.isAdding = isAdding && !this.isLocked;
    this.row.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) this.hint("Click where a feature is, and drag it. Esc when done");
    this.invalidate();
  }

  // The focus goes to the list, and back to where it was.
  toggleHelp() {
    const { activeElement } = this.root.getRootNode();
    this.help.hidden = !this.help.hidden;
    if (!this.help.hidden) {
      this.beforeHelp = this.root.contains(activeElement) ? activeElement : null;
      this.help.focus();
    } else if (this.beforeHelp?.isConnected) this.beforeHelp.focus({ preventScroll: true });
    else this.pictures[0].stage.focus({ preventScroll: true });
    this.invalidate();
  }

  escape() {
    if (this.gestures.some((gestures) => gestures.cancel())) return true;
    if (!this.help.hidden) { this.toggleHelp(); return true; }
    if (this.isAdding || this.isSelecting) { this.setAdding(false); this.setSelecting(false); return true; }
    if (this.selected.size === 0) return false;
    this.select([]);
    return true;
  }

  focusStage() { this.paneOf(document.activeElement).stage.focus({ preventScroll: true }); }
}

// Tools of the hand of the editor in space: turning, the mirror, the lattice that holds. Needs maths/points.js, maths/points.js,
// maths/space.js and editor/handles.js. SpaceEditorPage (space_editor/editor.js) is this and the talk with Python.

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

// The editor in space: three linked pictures with the same points. Joined behind the files that
// deformnb/widgets/editor/space_editor.py names.
// To Python: edit and history, by sync/edits.js; hello, look, seen. From Python: pictures, error, done.

const SPACE_PROJECTIONS = { slice: "Slices", mip: "Maximum (MIP)", composite: "Composite", shaded: "Shaded" };
const SLOW_PICTURES = 500; // milliseconds after which it is said that pictures are being made
const LOOK_PATIENCE = 400; // milliseconds after which a place is sent though the pictures of the last one have not come

class SpaceEditorPage extends SpaceHand {
  constructor(model, el) {
    super(model);
    Object.assign(this, { model, id: Math.random().toString(36).slice(2, 12), bus: busOf(model), closed: new AbortController(),
      selected: new Set(model.get("selected")), drag0: null, isAdding: false, isSelecting: false, isComparing: false, isSpaceDown: false,
      frame: 0, facts: {}, looked: new Set(), waitingSince: -Infinity, pendingLook: null, shownCount: 0 });
    this.sender = senderOf(this.bus, model);
    this.selection = new RestingTrait(model, "selected");
    this.sender.receive();
    this.points = this.sender.points;
    this.panes = model.get("panes");
    this.cursor = [...model.get("cursor")];
    this.#build(el);
    this.#listen();
    this.guard(() => { this.layout(); this.showWaiting(); });
    model.send({ type: "hello", view: this.id });
    this.#expectPictures();
  }

  #build(el) {
    this.host = el;
    el.classList.add("dnb-ed-host");
    this.root = pageElement("div", "dnb-editor dnb-space", el, { tabindex: "-1", role: "group", ...OWN_KEYS });
    this.toolbar = new Toolbar(this, this.root, SPACE_GROUPS, SPACE_EDITOR_KEYS, SPACE_MORE);
    const group = pageElement("div", "dnb-ed-group", null);
    this.toolbar.root.insertBefore(group, this.toolbar.root.children[2]);
    this.chooser = pageElement("select", "dnb-sp-select", group, { "aria-label": "What the pictures show", ...OWN_KEYS });
    for (const [name, title] of Object.entries(SPACE_PROJECTIONS)) {
      pageElement("option", "", this.chooser, { value: name }).textContent = title;
    }
    this.row = pageElement("div", "dnb-sp-row", this.root);
    this.pictures = this.panes.map((_, k) => new SpacePane(this, k, this.row));
    this.gestures = this.pictures.map((pane) => new PaneGestures(this, pane));
    const veil = pageElement("div", "dnb-ed-veil", this.row);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" });
    this.input = pageElement("input", "dnb-ed-input", this.row, { type: "text", maxlength: "80", hidden: "",
      "aria-label": "name of the point", ...OWN_KEYS });
    this.tip = pageElement("div", "dnb-ed-hint", this.row, { hidden: "", "aria-hidden": "true" });
    this.alert = pageElement("div", "dnb-ed-alert", this.row, { role: "alert", hidden: "" });
    this.help = helpPanel(this.row, SPACE_EDITOR_KEYS);
    const status = pageElement("div", "dnb-ed-status", this.root);
    this.factsLine = pageElement("span", "dnb-ed-facts", status);
    this.foldFact = pageElement("span", "dnb-ed-folds", status);
    this.notes = pageElement("div", "dnb-ed-notes", status);
    this.spoken = pageElement("div", "dnb-ed-spoken", this.root, { "aria-live": "polite" });
    this.root.deformnb = this; // for tests and for whoever looks into the page
  }

  #listen() {
    const handlers = this.handlers = [];
    const on = (name, handler) => {
      const guarded = (...given) => this.guard(() => handler(...given));
      this.model.on(name, guarded);
      handlers.push([name, guarded]);
    };
    on("msg:custom", (message, buffers) => this.message(message, buffers ?? []));
    on("change:selected", () => { if (!this.selection.isAhead) this.select(this.model.get("selected"), false); });
    on("change:cursor", () => this.receiveCursor());
    on("change:panes", () => this.setPanes());
    on("change:theme", () => this.applyTheme());
    on("change:waiting", () => this.showWaiting());
    on("change:height", () => this.layout());
    for (const name of ["label", "projection", "shows_original", "read_only", "history", "mirror", "snap"]) on(`change:${name}`, () => this.invalidate());
    this.moved = (event) => this.guard(() => {
      const { origin, points, phase } = event.detail;
      if (origin === this.id || this.drag0) return;
      if (phase === "move") { this.points = points; this.invalidate(); } else this.receive();
    });
    this.bus.addEventListener("deformnb:points", this.moved);
    this.sender.greet();
    const heard = { points: () => this.receive(), status: () => this.showStatus(), history: () => this.invalidate() };
    this.unlisten = this.sender.listen((what) => this.guard(heard[what]));
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    const { signal } = this.closed, listen = (target, name, handler) => target.addEventListener(
      name, (event) => this.guard(() => handler(event)), { signal });
    listen(this.dark, "change", () => this.applyTheme());
    listen(this.chooser, "change", () => this.look({ projection: this.chooser.value }));
    listen(this.root, "keydown", (e) => { if (spaceKey(this, e)) { e.preventDefault(); e.stopPropagation(); } });
    listen(this.root, "keyup", (e) => {
      if (e.key === " ") this.isSpaceDown = false;
      if (/^(Arrow|Page)/.test(e.key)) this.lookAtRest();
    });
    listen(this.root, "focusout", (e) => { if (!this.root.contains(e.relatedTarget)) this.isSpaceDown = false; });
    listen(this.input, "keydown", (e) => {
      e.stopPropagation();
      if (e.key === "Enter" || e.key === "Escape") this.endRename(e.key === "Enter");
    });
    listen(this.input, "blur", () => this.endRename(true));
    this.observer = new ResizeObserver(() => this.guard(() => this.layout()));
    this.observer.observe(this.root);
    this.themes = new MutationObserver(() => this.guard(() => this.applyTheme()));
    this.themes.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
  }

  close() {
    this.sender.flush();
    this.unlisten();
    this.closed.abort();
    this.selection.close();
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.bus.removeEventListener("deformnb:points", this.moved);
    this.observer.disconnect();
    this.themes.disconnect();
    cancelAnimationFrame(this.frame);
    for (const timer of [this.slowTimer, this.lookTimer, this.tipTimer, this.alertTimer]) clearTimeout(timer);
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  // Whatever goes wrong in here is said in the widget, and the page goes on.
  guard(action) {
    try { return action(); } catch (error) {
      console.error(error);
      this.say(`The editor met an error: ${error.message}`);
      return undefined;
    }
  }

  // ---- what comes from Python ---------------------------------------------------------------------------------------

  message(message, buffers) {
    if (message?.type === "error") this.say(String(message.message), true);
    if (message?.type === "look") this.lookAt(message.id);
    if (message?.type === "pictures" && (!message.view || message.view === this.id)) this.receivePictures(message, buffers);
  }

  receivePictures({ seq, panes, facts }, buffers) {
    const parts = [...buffers];
    const bytes = (b) => (b instanceof DataView ? new Uint8Array(b.buffer, b.byteOffset, b.byteLength) : new Uint8Array(b));
    for (const pane of panes) {
      const pixels = bytes(parts.shift());
      const depths = pane.hasDepths ? new Float32Array(bytes(parts.shift()).slice().buffer) : null;
      this.pictures[pane.index].take(pane, pixels, depths, pane.shapes ? bytes(parts.shift()) : null);
    }
    this.#expectPictures(false);
    this.facts = { ...(facts.isBad ? { folds: this.facts.folds } : {}), folds: this.facts.folds, worst: this.facts.worst,
      ...facts };
    this.shownCount += 1;
    this.drawNow();
    if (seq) this.model.send({ type: "seen", view: this.id, seq });
    this.waitingSince = -Infinity;
    this.#sendLook();
  }

  set(name, value) {
    this.model.set(name, value);
    this.model.save_changes();
    this.invalidate();
  }

  receive() {
    const { points } = this.sender;
    if (this.drag0) { // Python has found where a new point takes hold; the hand keeps the rest
      this.drag0 = withSources(this.drag0, points);
      this.points = withSources(this.points, points);
      return;
    }
    if (samePoints(points, this.points)) return;
    this.points = points;
    this.select([...this.selected]);
    publishPoints(this.bus, { origin: this.id, points, settings: settingsOf(this.model), fit: null, phase: "end" });
    this.invalidate();
  }

  receiveCursor() {
    const given = this.model.get("cursor");
    if (this.looked.delete(JSON.stringify(given)) || this.pendingLook) return; // our own, or an older one
    this.cursor = [...given];
    this.invalidate();
  }

  setPanes() {
    this.panes = this.model.get("panes");
    for (const pane of this.pictures) { pane.picture = null; pane.isFitted = true; }
    this.layout();
  }

  get isWorkedIn() { return this.root.matches(":focus-within"); }

  get isWaiting() { return Boolean(this.model.get("waiting")); }

  get isLocked() { return this.isWaiting || this.model.get("read_only"); }

  get isSlice() { return this.model.get("projection") === "slice"; }

  // While Python makes something else, nothing here can be edited; a hand that is at it is as if it had not begun.
  showWaiting() {
    const { isWaiting } = this;
    if (isWaiting) {
      for (const gestures of this.gestures) gestures.cancel();
      this.endRename(false);
      this.setAdding(false);
    }
    this.row.classList.toggle("dnb-ed-waiting", isWaiting);
    this.row.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, this.model.get("waiting") || (this.isSlow ? "Making the pictures" : ""));
    this.invalidate();
  }

  // ---- where the slices lie -----------------------------------------------------------------------------------------

  // The first pictures of a large volume take seconds, and those of all of it too: nobody shall look at mere grey.
  #expectPictures(isExpected = true) {
    clearTimeout(this.slowTimer);
    if (isExpected) this.slowTimer = setTimeout(() => this.guard(() => { this.isSlow = true; this.showWaiting(); }), SLOW_PICTURES);
    else if (this.isSlow) {
      this.isSlow = false;
      this.showWaiting();
    }
  }

  // What Python shall show; `cursor` at the pace at which pictures come, and the newest only.
  look(what, isMoving = false) {
    this.pendingLook = { ...this.pendingLook, ...what, moving: isMoving };
    if ("projection" in what || "original" in what) this.#expectPictures();
    this.#sendLook();
  }

  #sendLook() {
    clearTimeout(this.lookTimer);
    if (!this.pendingLook) return;
    const now = performance.now(), since = now - this.waitingSince;
    if (since < LOOK_PATIENCE) {
      this.lookTimer = setTimeout(() => this.#sendLook(), LOOK_PATIENCE - since);
      return;
    }
    this.waitingSince = now;
    if (this.pendingLook.cursor) this.looked.add(JSON.stringify(this.pendingLook.cursor));
    if (this.looked.size > 20) this.looked.delete(this.looked.values().next().value);
    this.model.send({ type: "look", view: this.id, ...this.pendingLook });
    this.pendingLook = null;
  }

  lookAtRest() { if (this.isSlice) this.look({ cursor: this.cursor }, false); }

  setCursor(place, isMoving) {
    const next = this.panes.reduce((at, pane) => {
      const [a, b, c] = inPane(pane, at), [low, high] = pane.depths;
      return c < low || c > high ? fromPane(pane, [a, b, Math.max(low, Math.min(high, c))]) : at;
    }, place);
    this.cursor = next;
    this.look({ cursor: next }, isMoving);
    this.invalidate();
  }

  setDepth(pane, depth) {
    const [a, b] = inPane(pane.info, this.cursor);
    this.setCursor(fromPane(pane.info, [a, b, depth]), true);
  }

  scroll(pane, slices) {
    const { depths: [first], spacing } = pane.info, now = Math.round((pane.depth - first) / spacing[2]);
    this.setDepth(pane, first + (now + slices) * spacing[2]);
    this.lookAtRest();
  }

  // The cross-hair of a picture to a place on the screen: all of it, or one line only.
  moveCross(pane, at, line, isMoving) {
    const [a, b] = pane.toPlane(at), [a0, b0, c0] = inPane(pane.info, this.cursor);
    const place = this.isSlice || line ? [line === "h" ? a0 : a, line === "v" ? b0 : b, c0]
      : inPane(pane.info, pane.under(at)); // of the whole volume: what is seen there
    this.setCursor(fromPane(pane.info, place), isMoving);
  }

  goTo(id) {
    const p = this.points.find((q) => q.id === id);
    if (!p) return;
    this.select([id]);
    this.setCursor([...p.target], false);
    this.speak(`slices at ${p.name || `point ${id}`}`);
  }

  lookAt(id) {
    const p = this.points.find((q) => q.id === id);
    for (const pane of p ? this.pictures : []) pane.lookAt(p.target);
  }

  paneOf(node) { return this.pictures.find((pane) => pane.root.contains(node)) ?? this.pictures[0]; }
}

function render({ model, el }) {
  const page = new SpaceEditorPage(model, el);
  return () => page.close();
}

function initialize({ model }) {
  const bus = busOf(model), uid = model.get("uid");
  holdBus(bus);
  const sender = senderOf(bus, model), leave = () => sender.flush(); // a page that goes says its last word
  sender.attach(model);
  window.addEventListener("pagehide", leave);
  model.on("destroy", () => {
    window.removeEventListener("pagehide", leave);
    sender.detach(model);
    if (sender.models.length === 0) bus.sender = null;
    releaseBus(bus, uid);
  });
}

export default { initialize, render };
