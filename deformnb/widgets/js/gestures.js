// Pointer, wheel and keys of the editor, turned into calls of the page. One finger or the mouse drags points, draws a
// band or, with space or the middle button, moves the view; two fingers move and zoom it.

const NEAR = 6; // CSS pixels: a new handle nearer than this to an old one selects that
const SLACK = { mouse: 2, pen: 3, touch: 6 }; // a press that moves less is a click

class Gestures {
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
    on(stage, "wheel", (e) => this.wheel(e), { passive: false });
    on(root, "keydown", (e) => this.key(e));
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

  // ---- pointers -----------------------------------------------------------------------------------------------------

  down(event) {
    if (this.page.isWaiting) return;
    this.pointers.set(event.pointerId, this.place(event));
    this.kind = event.pointerType || "mouse";
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
    else if (!grabbed && !this.page.isAdding && this.shapeAt(event)) this.grabShape(this.shapeAt(event), at);
    else if (grabbed) this.grab(event, grabbed, at);
    else if (this.page.isAdding) {
      this.page.focusStage();
      this.grab(event, { id: this.page.addAt(at, event.altKey), what: "target" }, at, true);
    } else {
      this.page.focusStage();
      const isFinger = this.kind === "touch";
      this.gesture = { kind: isFinger ? "pan" : "band", from: at, at, isPress: true, adds: event.shiftKey || event.ctrlKey };
    }
    this.page.stage.classList.toggle("dnb-ed-panning", this.gesture?.kind === "pan" && this.kind !== "touch");
  }

  grab(event, { id, what }, at, isNew = false) {
    if (id === null) return; // where nothing could be added
    const { page } = this, adds = event.shiftKey || event.ctrlKey || event.metaKey, was = page.selected.has(id);
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
    const to = [at[0] - g.about[0], at[1] - g.about[1]], [x, y] = g.start, step = Math.PI / 12;
    if (event.altKey) {
      const factor = Math.max(0.1, Math.min(10, Math.hypot(...to) / Math.hypot(x, y)));
      g.scales = true;
      this.page.turnTo(g.held, 0, event.shiftKey ? Math.max(0.1, Math.round(10 * factor) / 10) : factor);
      return;
    }
    const angle = Math.atan2(x * to[1] - y * to[0], x * to[0] + y * to[1]);
    g.scales = false;
    this.page.turnTo(g.held, event.shiftKey ? step * Math.round(angle / step) : angle, 1);
  }

  grabAxis(at) {
    const { page } = this, c = page.mirror.axis === "a" ? 0 : 1;
    page.marks.grip.focus({ preventScroll: true });
    this.gesture = { kind: "axis", from: at, at, isPress: true, c, start: page.mirror.at };
  }

  grabShape(grip, at) {
    const { page } = this, was = page.chosen, { what, index } = grip.chosen;
    const isSame = was !== null && was.what === what && was.index === index;
    page.chooseShape(grip.chosen);
    page.drawNow();
    if (grip.corner !== null) page.shapeHandles.focusCorner(grip.corner);
    else page.shapeHandles.focus(grip.chosen);
    // A line that is only now chosen stays where it is: nobody shall move what he wanted to look at.
    this.gesture = { kind: "shape", grip, from: at, at, isPress: true, isFirst: !isSame };
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
    else if (g.kind === "shape" && !g.isFirst) {
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
    else if (g.kind === "shape") { if (!g.isPress && !g.isFirst) this.page.endShapeDrag(isCancelled); }
    else if (g.kind === "brush") {
      this.page.brush.lift(isCancelled);
      if (this.kind === "touch") this.page.brush.hover(null); // a finger that is away points nowhere
    } else if (g.kind === "turn") this.page.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "axis") this.page.moveAxis(isCancelled ? g.start : this.page.mirror.at, true);
    else if (g.kind === "points") {
      if (!g.isPress) this.page.endDrag(isCancelled);
      else if (g.was && !g.isNew) this.page.select(g.adds ? [...this.page.selected].filter((id) => id !== g.id) : [g.id]);
    } else if (g.isPress && !isCancelled && !g.adds && g.from) { this.page.select([]); this.page.chooseShape(null); }
    else if (g.kind === "band" && !g.isPress && !isCancelled && this.page.selected.size === 0 && !this.page.isLocked) {
      this.page.hint("Double-click adds a point to drag", 5000);
    }
  }

  // Escape during a drag: as if it had not begun.
  cancel() {
    const g = this.gesture;
    this.gesture = null;
    this.page.handles.showBand(null);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") this.page.endDrag(true);
    if (g?.kind === "brush") this.page.brush.lift(true);
    if (g?.kind === "axis") this.page.moveAxis(g.start, true);
    if (g?.kind === "shape" && !g.isPress && !g.isFirst) this.page.endShapeDrag(true);
    return g !== null;
  }

  startPinch() {
    this.page.handles.showBand(null);
    if (this.gesture?.kind === "brush") this.page.brush.lift(true);
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
    if (this.page.isWaiting || this.page.brush.isOn) return;
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
    const grabbed = this.idAt(event); // a long press of a finger also comes here, and must not delete
    if (grabbed && this.kind !== "touch") this.page.remove([grabbed.id]);
    const shape = grabbed || this.kind === "touch" ? null : this.shapeAt(event);
    if (shape && !this.page.isLocked) {
      this.page.chooseShape(shape.chosen);
      if (shape.corner !== null) this.page.removeCorner(shape.corner);
      else this.page.removeShape();
    }
  }

  // The wheel belongs to the page that scrolls, until someone works in the editor.
  wheel(event) {
    const isWanted = event.ctrlKey || event.metaKey || this.page.root.contains(document.activeElement);
    if (!isWanted) { this.page.hint("Click the picture, or hold Ctrl, to zoom with the wheel"); return; }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (this.page.brush.isOn && !event.ctrlKey && !event.metaKey) { this.page.brush.grow(-delta / 60); return; }
    this.page.zoomAt(Math.exp(-delta * (event.ctrlKey ? 0.01 : 0.0022)), ...this.place(event));
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  space(isDown) {
    this.isSpaceDown = isDown;
    this.page.stage.classList.toggle("dnb-ed-can-pan", isDown);
  }

  key(event) {
    const { page } = this, isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird, isAlt = event.altKey && !isThird;
    if (event.target.closest("input, select")) { // have keys of their own
      if (event.key === "Escape" && event.target === page.brush.slider) { page.brush.stop(); page.focusStage(); }
      return;
    }
    if (!isCommand && event.target.closest(".dnb-ed-help")) { if (event.key === "Escape" || event.key === "?") page.closeHelp(); return; }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const handled = isCommand ? this.command(key, event.shiftKey) : this.plain(key, event, isAlt);
    if (!handled) return;
    event.preventDefault();
    event.stopPropagation();
  }

  command(key, isShift) {
    const { page } = this;
    if (key === "z") page.stepHistory(isShift ? "redo" : "undo");
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
    const focused = this.idAt(event), shape = focused ? null : this.shapeAt(event);
    if (!onButton && page.pen.isOn && !isAlt && page.pen.key(key, event, arrows[key])) return true;
    if (!onButton && page.brush.isOn && !isAlt && page.brush.key(key, event, arrows[key])) return true;
    if (this.markAt(event) === "axis" && key in arrows) return this.axisKey(arrows[key], event.shiftKey ? 10 : 1);
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
    if (key === " ") { this.space(true); return true; }
    if (key === "Enter") {
      if (focused) page.toggleSelected(focused.id);
      else if (!page.isLocked) page.addInMiddle();
      return true;
    }
    if (key === "Escape") return this.escape();
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

  // Gives up what is under way, one thing after the other; false where nothing is.
  escape() {
    const { page } = this;
    if (this.cancel() || page.pen.cancel() || page.brush.stop() || page.closeHelp() || page.stopAdding()) return true;
    if (page.selected.size === 0 && !page.chosen) return false;
    page.chooseShape(null);
    page.select([]);
    return true;
  }
}

// Ways of a turn: clockwise is 1. With Shift the same keys write other signs, with Alt on some keyboards as well.
const TURN_WAYS = { ",": -1, "<": -1, ";": -1, ".": 1, ">": 1, ":": 1 }, TURN_CODES = { Comma: ",", Period: "." };
