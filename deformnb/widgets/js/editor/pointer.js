// Keys pressed anywhere in the editor, turned into calls of the page. Those that are told are in ui/key_help.js.

import { shownLength } from "../maths/numbers.js";
import { freeIds, TURN_CODES, TURN_WAYS, turnOfHand, withRims } from "../maths/points.js";
import { SLACK } from "../ui/dom.js";
import { commandOf, EDITOR_KEYS } from "../ui/key_help.js";
import { isRightClick, keepFromScrolling, POINT_STEPS } from "./handles.js";

class EditorKeys {
  constructor(page, gestures) { Object.assign(this, { page, gestures }); }

  key(event) {
    const { page } = this, isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird, isAlt = event.altKey && !isThird;
    if (event.target.closest("input, select")) { // have keys of their own
      if (event.key === "Escape" && event.target === page.brush.slider) { page.brush.stop(); page.focusStage(); }
      return;
    }
    if (!isCommand && event.target.closest(".dnb-ed-help")) { if (event.key === "Escape" || event.key === "?") page.closeHelp(); return; }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const handled = isCommand ? this.command(key, event) : this.plain(key, event, isAlt);
    if (!handled) return;
    event.preventDefault();
    event.stopPropagation();
  }

  command(key, event) {
    const { page } = this, focused = this.gestures.idAt(event);
    if (POINT_STEPS[key] && event.target.closest("button")) return false;
    if (POINT_STEPS[key]) page.handles.focusNext(page.points.map((p) => p.id), POINT_STEPS[key], focused?.id);
    else if (key === "z") page.stepHistory(event.shiftKey ? "redo" : "undo");
    else if (key === "y") page.stepHistory("redo");
    else if (key === "a") page.select(page.points.map((p) => p.id));
    else return false;
    return true;
  }

  // Keys on a line, a corner or the middle of an edge.
  shapeKey(key, event, shape, arrow) {
    const { page } = this, isOther = JSON.stringify(shape.chosen) !== JSON.stringify(page.chosen);
    if (key === "Enter" && shape.middle !== null) { if (!page.isLocked) page.insertCorner(shape.middle); return true; }
    if (key === "Enter") { page.chooseShape(isOther || shape.corner !== null ? shape.chosen : null); return true; }
    if (!arrow && !["Delete", "Backspace", "F2", "o", "f"].includes(key)) return false;
    if (isOther) page.chooseShape(shape.chosen);
    if (page.isLocked) return true;
    if (arrow) page.nudgeShape(shape, arrow, event.shiftKey ? 10 : 1);
    else if ((key === "Delete" || key === "Backspace") && shape.middle !== null) page.hint("Here is no corner to delete yet");
    else if (shape.corner !== null && (key === "Delete" || key === "Backspace")) page.removeCorner(shape.corner);
    else page.run(commandOf(EDITOR_KEYS, key), null);
    return true;
  }

  plain(key, event, isAlt) {
    const { page } = this, onButton = event.target.closest("button");
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const focused = this.gestures.idAt(event), shape = focused ? null : this.gestures.shapeAt(event);
    if (!onButton && page.pen.isOn && !isAlt && page.pen.key(key, event, arrows[key])) return true;
    if (!onButton && page.brush.isOn && !isAlt && page.brush.key(key, event, arrows[key])) return true;
    if (this.gestures.markAt(event) === "axis" && key in arrows) return this.axisKey(arrows[key], event.shiftKey ? 10 : 1);
    if (shape && !onButton && !isAlt && this.shapeKey(key, event, shape, arrows[key])) return true;
    if (onButton && (key in arrows)) return page.toolbar.focusNext(onButton, key);
    if (onButton && (key === "Enter" || key === " ")) return false;
    if (key in arrows) {
      page.nudge(focused?.id ?? null, arrows[key], event.shiftKey ? 10 : 1, isAlt ? "both" : "target");
      return true;
    }
    const way = TURN_WAYS[isAlt ? TURN_CODES[event.code] : key];
    if (way) { page.turnKey(way, { isLarge: event.shiftKey, isScale: isAlt }); return true; }
    if (isAlt) return false;
    if (key === " ") { this.gestures.space(true); return true; }
    if (key === "Enter") {
      if (focused) page.toggleSelected(focused.id);
      else if (!page.isLocked) page.addInMiddle();
      return true;
    }
    if (key === "Escape") return this.gestures.escape();
    if (key === "[" || key === "]") { page.brush.grow(key === "]" ? 1 : -1); return true; }
    const command = (event.shiftKey && commandOf(EDITOR_KEYS, `Shift+${key}`)) || commandOf(EDITOR_KEYS, key);
    if (!command) return false;
    page.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, focused?.id ?? null);
    return true;
  }

  axisKey([dx, dy], pixels) {
    const { page } = this, c = page.mirror.axis === "a" ? 0 : 1;
    page.moveAxis(page.mirror.at + pixels * [dx, dy][c] * page.model.get("raster").spacing[c], true);
    page.speak(`axis at ${shownLength(page.mirror.at)}`);
    return true;
  }
}

// Pointer and wheel of the editor, turned into calls of the page; the keys are in editor/pointer.js. The mouse drags points,
// draws a band or, with space or the middle button, moves the view. One finger drags points and moves the view, or draws
// a band while several are selected; two fingers move and zoom it. Until someone works in the editor, a finger scrolls.

export const NEAR = 6; // CSS pixels: a new handle nearer than this to an old one selects that

export class Gestures {
  constructor(page) {
    this.page = page;
    this.pointers = new Map();
    this.gesture = null;
    this.isSpaceDown = false;
    this.closing = new AbortController();
    const { stage, svg, root } = page;
    const on = (target, name, handler, options = {}) => target.addEventListener(
      name, (event) => page.guard(() => handler(event)), { signal: this.closing.signal, ...options });
    on(svg, "pointerdown", (e) => this.down(e));
    on(svg, "pointermove", (e) => this.move(e));
    on(svg, "pointerup", (e) => this.up(e));
    on(svg, "pointercancel", (e) => this.up(e, true));
    on(svg, "pointerleave", () => { if (page.brush.isOn && !this.gesture && !page.brush.isByKeys) page.brush.hover(null); });
    on(svg, "lostpointercapture", (e) => { if (this.pointers.has(e.pointerId)) this.up(e, true); });
    on(svg, "dblclick", (e) => this.doubleClick(e));
    on(svg, "contextmenu", (e) => this.contextMenu(e));
    on(svg, "touchstart", (e) => { if (this.isOthers) keepFromScrolling(e); }, { passive: false });
    on(stage, "wheel", (e) => this.wheel(e), { passive: false });
    const keys = new EditorKeys(page, this);
    on(root, "keydown", (e) => keys.key(e));
    on(root, "keyup", (e) => { if (e.key === " ") this.space(false); });
    on(root, "focusout", (e) => { if (!root.contains(e.relatedTarget)) this.space(false); });
  }

  close() { this.closing.abort(); }

  place(event) {
    const box = this.page.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  // The point that an event is about. While a pointer is captured its clicks say nothing of what lies under them.
  idAt(event) {
    const isClick = event.type === "dblclick" || event.type === "contextmenu";
    const hit = isClick ? this.page.root.getRootNode().elementFromPoint(event.clientX, event.clientY) : event.target;
    const target = hit?.closest?.("[data-id]"), source = hit?.closest?.("[data-source]");
    if (target) return { id: Number(target.dataset.id), what: "target" };
    return source ? { id: Number(source.dataset.source), what: "source" } : null;
  }

  // What of a shape an event is about: its line, a corner, or the middle of an edge.
  shapeAt(event) {
    const isClick = event.type === "dblclick" || event.type === "contextmenu";
    const hit = isClick ? this.page.root.getRootNode().elementFromPoint(event.clientX, event.clientY) : event.target;
    const grip = hit?.closest?.(".dnb-ed-grip"), line = hit?.closest?.("[data-shape]");
    const number = (text) => (text ? Number(text) : null);
    if (grip) return { chosen: this.page.chosen, corner: number(grip.dataset.corner), middle: number(grip.dataset.middle) };
    if (!line) return null;
    const [what, index] = line.dataset.shape.split(":");
    return { chosen: { what, index: Number(index) }, corner: null, middle: null };
  }

  // The handle that turns, or the axis of the mirror.
  markAt(event) { return event.target.closest?.("[data-mark]")?.dataset.mark ?? null; }

  // ---- keyspointers -----------------------------------------------------------------------------------------------------

  down(event) {
    if (this.page.isWaiting) return;
    this.pointers.set(event.pointerId, this.place(event));
    this.kind = event.pointerType || "mouse";
    this.isOthers = this.kind === "touch" && !this.page.isWorkedIn; // before this press gives it the focus
    this.page.svg.setPointerCapture(event.pointerId);
    if (this.pointers.size === 2 && !["points", "turn", "axis"].includes(this.gesture?.kind)) { this.startPinch(); return; }
    if (this.gesture) return;
    const at = this.place(event), grabbed = this.idAt(event), mark = this.markAt(event);
    event.preventDefault();
    if (event.button === 1 || (event.button === 0 && this.isSpaceDown)) this.gesture = { kind: "pan", at };
    else if (event.button !== 0) this.gesture = null;
    else if (this.page.pen.isOn) {
      this.page.focusStage();
      this.gesture = { kind: "pen", from: at, at, isPress: true };
    } else if (mark === "axis") this.grabAxis(at);
    else if (this.page.brush.isOn) {
      this.page.focusStage();
      this.gesture = { kind: "brush", from: at, at };
      this.page.brush.press(at);
    } else if (mark === "turn") this.grabTurn(at);
    else if (!grabbed && this.ownsShape(event)) this.grabShape(this.shapeAt(event), at);
    else if (grabbed) this.grab(event, grabbed, at);
    else if (this.page.isAdding) {
      this.page.focusStage();
      this.grab(event, { id: this.page.addAt(at, event.altKey), what: "target" }, at, true);
    } else this.press(event, at);
    this.page.stage.classList.toggle("dnb-ed-panning", this.gesture?.kind === "pan" && this.kind !== "touch");
  }

  // On the picture itself. Where nobody works in the editor a finger belongs to the page around, which may scroll.
  press(event, at) {
    const { page, isOthers } = this, isFinger = this.kind === "touch";
    if (!isOthers) page.focusStage();
    const kind = isOthers ? "tap" : isFinger && !page.isSelecting ? "pan" : "band";
    this.gesture = { kind, from: at, at, isPress: true, adds: page.isSelecting || event.shiftKey || event.ctrlKey,
      shape: page.isSelecting ? null : this.shapeAt(event) };
  }

  grab(event, { id, what }, at, isNew = false) {
    if (id === null) return; // where nothing could be added
    const { page } = this, was = page.selected.has(id);
    const adds = page.isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    if (!was) page.select(adds ? [...page.selected, id] : [id]);
    page.handles.focus(id);
    const ids = page.selected.has(id) ? [...page.selected] : [id];
    this.gesture = { kind: "points", id, from: at, at, isPress: true, adds, was, isNew,
      what: event.altKey ? "both" : what, ids: freeIds(page.points, withRims(page.points, ids)) };
  }

  grabTurn(at) {
    const held = this.page.beginTurn();
    if (!held) return;
    const about = this.page.onView(held.about), from = [at[0] - about[0], at[1] - about[1]];
    this.gesture = { kind: "turn", held, about, start: from, from: at, at, isPress: true };
  }

  // The middle of the selection is the middle of the turn; Alt scales instead, Shift goes in steps.
  turn(g, at, event) {
    g.scales = event.altKey;
    this.page.turnTo(g.held, ...turnOfHand(g.start, [at[0] - g.about[0], at[1] - g.about[1]], event));
  }

  grabAxis(at) {
    const { page } = this, c = page.mirror.axis === "a" ? 0 : 1;
    page.marks.grip.focus({ preventScroll: true });
    this.gesture = { kind: "axis", from: at, at, isPress: true, c, start: page.mirror.at };
  }

  // Whether an event is about the shape that is chosen. Another one is chosen by a click: a drag that begins on its line
  // is one on the picture, and nobody moves what he did not see.
  ownsShape(event) {
    const { page } = this, grip = page.isAdding || page.isSelecting ? null : this.shapeAt(event);
    return grip !== null && page.chosen?.what === grip.chosen.what && page.chosen.index === grip.chosen.index;
  }

  grabShape(grip, at) {
    this.focusShape(grip);
    this.gesture = { kind: "shape", grip, from: at, at, isPress: true };
  }

  focusShape(grip) {
    const { page } = this;
    page.chooseShape(grip.chosen);
    page.drawNow();
    if (grip.corner !== null) page.shapeHandles.focusCorner(grip.corner);
    else page.shapeHandles.focus(grip.chosen);
  }

  move(event) {
    if (!this.pointers.has(event.pointerId)) {
      if (this.page.pen.isOn) this.page.pen.hover(this.place(event));
      if (this.page.brush.isOn) this.page.brush.hover(this.place(event));
      return;
    }
    const at = this.place(event), g = this.gesture;
    this.pointers.set(event.pointerId, at);
    if (!g) return;
    if (g.kind === "pinch") { this.pinch(); return; }
    if (g.kind === "brush") { this.page.brush.drag(at); return; }
    if (g.isPress && Math.hypot(at[0] - g.from[0], at[1] - g.from[1]) < SLACK[this.kind]) return;
    if (g.kind === "pan") this.page.panBy(at[0] - g.at[0], at[1] - g.at[1]);
    else if (g.kind === "band") this.band(g, at);
    else if (g.kind === "pen") this.page.pen.drag(at);
    else if (g.kind === "turn") this.turn(g, at, event);
    else if (g.kind === "axis") this.page.moveAxis(g.start + (at[g.c] - g.from[g.c]) / this.page.view.k, false);
    else if (g.kind === "shape") {
      if (g.isPress) this.page.beginShapeDrag(g.grip);
      this.page.dragShape(at[0] - g.from[0], at[1] - g.from[1]);
    }
    else if (g.kind === "points") {
      if (g.isPress) this.page.beginDrag();
      this.page.drag(g.ids, (at[0] - g.from[0]), (at[1] - g.from[1]), g.what, g.id, event.altKey);
    }
    g.isPress = false;
    g.at = at;
  }

  band(g, at) {
    const box = { x: Math.min(g.from[0], at[0]), y: Math.min(g.from[1], at[1]),
      width: Math.abs(at[0] - g.from[0]), height: Math.abs(at[1] - g.from[1]) };
    this.page.handles.showBand(box);
    g.before ??= g.adds ? [...this.page.selected] : [];
    this.page.select([...g.before, ...this.page.pointsInside(box)]);
  }

  up(event, isCancelled = false) {
    this.pointers.delete(event.pointerId);
    const g = this.gesture;
    if (!g) return;
    if (g.kind === "pinch") { if (this.pointers.size === 0) this.gesture = null; return; }
    this.gesture = null;
    this.page.stage.classList.remove("dnb-ed-panning");
    this.page.handles.showBand(null);
    if (g.kind === "pen") { if (!isCancelled && this.page.pen.isOn) this.page.pen.up(g.from, this.place(event)); }
    else if (g.kind === "shape") { if (!g.isPress) this.page.endShapeDrag(isCancelled); }
    else if (g.kind === "brush") {
      this.page.brush.lift(isCancelled);
      if (this.kind === "touch") this.page.brush.hover(null); // a finger that is away points nowhere
    } else if (g.kind === "turn") this.page.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "axis") this.page.moveAxis(isCancelled ? g.start : this.page.mirror.at, true);
    else if (g.kind === "points") {
      if (!g.isPress) this.page.endDrag(isCancelled);
      else if (g.was && !g.isNew) this.page.select(g.adds ? [...this.page.selected].filter((id) => id !== g.id) : [g.id]);
    } else if (g.isPress && !isCancelled && g.from) this.clicked(g);
    else if (g.kind === "tap" && !isCancelled) this.page.hint("Tap the picture first, then a finger moves it", 4000);
    else if (g.kind === "band" && !g.isPress && !isCancelled && this.page.selected.size === 0 && !this.page.isLocked) {
      this.page.hint("Double-click adds a point to drag", 5000);
    }
  }

  // A press on the picture that did not move.
  clicked(g) {
    const { page } = this;
    if (g.kind === "tap") page.focusStage();
    if (g.shape && !g.adds) this.focusShape(g.shape);
    else if (!g.adds) { page.select([]); page.chooseShape(null); }
  }

  // Escape during a drag: as if it had not begun.
  cancel() {
    const g = this.gesture;
    this.gesture = null;
    this.page.handles.showBand(null);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") this.page.endDrag(true);
    if (g?.kind === "brush") this.page.brush.lift(true);
    if (g?.kind === "axis") this.page.moveAxis(g.start, true);
    if (g?.kind === "shape" && !g.isPress) this.page.endShapeDrag(true);
    return g !== null;
  }

  startPinch() {
    this.page.handles.showBand(null);
    if (this.gesture?.kind === "brush") this.page.brush.lift(true);
    if (this.gesture?.before) this.page.select(this.gesture.before); // a band that was to be two fingers
    this.gesture = { kind: "pinch", was: this.twoFingers() };
  }

  twoFingers() {
    const [[ax, ay], [bx, by]] = [...this.pointers.values()];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, gap: Math.max(10, Math.hypot(ax - bx, ay - by)) };
  }

  pinch() {
    if (this.pointers.size < 2) return;
    const { was } = this.gesture, now = this.twoFingers();
    this.page.panBy(now.x - was.x, now.y - was.y);
    this.page.zoomAt(now.gap / was.gap, now.x, now.y);
    this.gesture.was = now;
  }

  doubleClick(event) {
    if (this.page.isWaiting || this.page.brush.isOn || this.page.isSelecting) return;
    const grabbed = this.idAt(event), shape = this.shapeAt(event);
    if (this.page.pen.isOn) this.page.pen.finish(this.page.pen.draft.tool === "part");
    else if (this.page.pen.hasJustEnded) return; // the second press has set the last place
    else if (grabbed) this.page.rename(grabbed.id);
    else if (shape) this.page.renameShape();
    else this.page.addAt(this.place(event), event.altKey);
    event.preventDefault();
  }

  contextMenu(event) {
    event.preventDefault();
    event.stopPropagation();
    if (!isRightClick(event) || this.kind === "touch") return;
    const grabbed = this.idAt(event), shape = grabbed ? null : this.shapeAt(event);
    if (grabbed) this.page.remove([grabbed.id]);
    if (shape && !this.page.isLocked) {
      this.page.chooseShape(shape.chosen);
      if (shape.corner !== null) this.page.removeCorner(shape.corner);
      else this.page.removeShape();
    }
  }

  // The wheel belongs to the page that scrolls, until someone works in the editor.
  wheel(event) {
    const isWanted = event.ctrlKey || event.metaKey || this.page.isWorkedIn;
    if (!isWanted) { this.page.hint("Click the picture, or hold Ctrl, to zoom with the wheel"); return; }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (this.page.brush.isOn && !event.ctrlKey && !event.metaKey) { this.page.brush.grow(-delta / 60); return; }
    this.page.zoomAt(Math.exp(-delta * (event.ctrlKey ? 0.01 : 0.0022)), ...this.place(event));
  }

  // ---- keyskeys ---------------------------------------------------------------------------------------------------------

  space(isDown) {
    this.isSpaceDown = isDown;
    this.page.stage.classList.toggle("dnb-ed-can-pan", isDown);
  }

  // Gives up what is under way, one thing after the other; false where nothing is.
  escape() {
    const { page } = this;
    if (this.cancel() || page.pen.cancel() || page.brush.stop() || page.closeHelp() || page.stopModes() || page.dropOffer()) {
      return true;
    }
    if (page.selected.size === 0 && !page.chosen) return false;
    page.chooseShape(null);
    page.select([]);
    return true;
  }
}
