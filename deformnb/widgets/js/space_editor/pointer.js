// Pointer, wheel and keys of the editor in space, turned into calls of the page.

import { isRightClick, keepFromScrolling, POINT_STEPS } from "../editor/handles.js";
import { shownLength } from "../maths/numbers.js";
import { freeIds, middleOf, TURN_CODES, TURN_WAYS, turnOfHand } from "../maths/points.js";
import { inPane, wayInPane } from "../maths/space.js";
import { commandOf, SPACE_EDITOR_KEYS } from "../ui/key_help.js";

export const SPACE_NEAR = 6; // CSS pixels: a new handle nearer than this to an old one on the slice selects that
const STILL = { mouse: 2, pen: 3, touch: 6 }; // a press that moves less is a click

// Pointers of one picture: points, the cross-hair, and the view with the middle button or with the space bar held.
export class PaneGestures {
  constructor(page, pane) {
    Object.assign(this, { page, pane, gesture: null });
    const on = (target, name, handler, options = {}) => target.addEventListener(
      name, (event) => page.guard(() => handler(event)), { signal: page.closed.signal, ...options });
    on(pane.svg, "pointerdown", (e) => this.down(e));
    on(pane.svg, "pointermove", (e) => this.move(e));
    on(pane.svg, "pointerup", (e) => this.up(e));
    for (const name of ["pointercancel", "lostpointercapture"]) on(pane.svg, name, (e) => this.up(e, true));
    on(pane.svg, "dblclick", (e) => this.doubleClick(e));
    on(pane.svg, "contextmenu", (e) => this.contextMenu(e));
    on(pane.svg, "touchstart", (e) => { if (this.isOthers) keepFromScrolling(e); }, { passive: false });
    on(pane.stage, "wheel", (e) => this.wheel(e), { passive: false });
  }

  place(event) {
    const box = this.pane.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  // What an event is about: a point, a line of the cross-hair, or nothing. A captured pointer's clicks do not tell.
  hit(event) {
    const isClick = event.type === "dblclick" || event.type === "contextmenu";
    const node = isClick ? this.page.root.getRootNode().elementFromPoint(event.clientX, event.clientY) : event.target;
    const found = node?.closest?.("[data-id], [data-source], [data-line]"), { id, source, line } = found?.dataset ?? {};
    if (id !== undefined) return { id: Number(id), what: "target" };
    if (source !== undefined) return { id: Number(source), what: "source" };
    return line === undefined ? null : { line };
  }

  // The handle that turns, or the plane of the mirror.
  markAt(event) { return event.target.closest?.("[data-mark]")?.dataset.mark ?? null; }

  down(event) {
    const { page, pane } = this, at = this.place(event), hit = this.hit(event), mark = this.markAt(event);
    if (page.isWaiting || this.gesture) return;
    this.isOthers = event.pointerType === "touch" && !page.isWorkedIn; // before this press gives it the focus
    pane.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    const begun = { pointer: event.pointerId, from: at, at, isPress: true, slack: STILL[event.pointerType] ?? 2 };
    if (event.button === 1 || (event.button === 0 && page.isSpaceDown)) this.gesture = { ...begun, kind: "pan" };
    else if (event.button !== 0) return;
    else if (mark === "axis") {
      pane.marks.grip.focus({ preventScroll: true });
      this.gesture = { ...begun, kind: "mirror", start: page.mirror.at };
    } else if (mark === "turn") this.#grabTurn(begun);
    else if (hit?.id !== undefined) this.#grab(event, hit, begun);
    else if (page.isAdding) this.#grab(event, { id: page.addAt(pane, at), what: "target" }, begun);
    else if (this.isOthers) this.gesture = { ...begun, kind: "tap" };
    else {
      pane.stage.focus({ preventScroll: true });
      this.gesture = event.shiftKey || page.isSelecting ? { ...begun, kind: "band", before: [...page.selected] }
        : { ...begun, kind: "cross", line: hit?.line ?? null };
    }
  }

  #grabTurn(begun) {
    const { page, pane } = this, ids = page.beginTurn(), { k, x, y } = pane.view;
    if (!ids) return;
    const flat = page.points.filter((p) => ids.includes(p.id)).map((p) => ({ target: inPane(pane.info, p.target) })), [a, b] = middleOf(flat);
    const about = [k * a + x, k * b + y];
    this.gesture = { ...begun, kind: "turn", ids, about, start: [begun.at[0] - about[0], begun.at[1] - about[1]] };
  }

  #grab(event, { id, what }, begun) {
    const { page, pane } = this, was = page.selected.has(id);
    const adds = page.isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    if (!was) page.select(adds ? [...page.selected, id] : [id]);
    pane.handles.focus(id);
    this.gesture = { ...begun, kind: "points", id, adds, was, what: event.altKey ? "both" : what,
      ids: freeIds(page.points, page.selected.has(id) ? [...page.selected] : [id]) };
  }

  move(event) {
    const g = this.gesture, at = this.place(event);
    if (!g || g.pointer !== event.pointerId) return;
    if (g.isPress && Math.hypot(at[0] - g.from[0], at[1] - g.from[1]) < g.slack) return;
    const { page, pane: { view: { k } } } = this;
    if (g.kind === "pan") this.pane.panBy(at[0] - g.at[0], at[1] - g.at[1]);
    else if (g.kind === "band") this.#band(g, at);
    else if (g.kind === "tap") page.hint("Tap a picture first, then a finger moves its cross-hair");
    else if (g.kind === "mirror") page.moveMirror(this.pane.under(at), false);
    else if (g.kind === "turn") {
      g.scales = event.altKey;
      page.turnTo(this.pane, g.ids, ...turnOfHand(g.start, [at[0] - g.about[0], at[1] - g.about[1]], event));
    } else if (g.kind === "cross") this.page.moveCross(this.pane, at, g.line, true);
    else {
      if (g.isPress) this.page.beginDrag();
      if (!g.ids.length) this.page.tellLocked(g.id);
      const way = wayInPane(this.pane.info, (at[0] - g.from[0]) / k, (at[1] - g.from[1]) / k);
      this.page.drag(g.ids, this.page.snappedWay(this.pane.info, g.id, way, g.what, event.altKey), g.what, g.id);
    }
    g.isPress = false;
    g.at = at;
  }

  // Selects what is drawn clearly in a rectangle, besides what was selected.
  #band(g, at) {
    const box = { x: Math.min(g.from[0], at[0]), y: Math.min(g.from[1], at[1]), width: Math.abs(at[0] - g.from[0]),
      height: Math.abs(at[1] - g.from[1]) };
    this.pane.handles.showBand(box);
    this.page.select([...g.before, ...this.pane.pointsInside(box)]);
  }

  up(event, isCancelled = false) {
    const g = this.gesture, { page } = this;
    if (!g || g.pointer !== event.pointerId) return;
    this.gesture = null;
    this.pane.handles.showBand(null);
    if (g.kind === "mirror") this.#letMirrorGo(g, isCancelled);
    else if (g.kind === "turn") page.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "points") {
      if (!g.isPress) page.endDrag(isCancelled);
      else if (g.was) page.select(g.adds ? [...page.selected].filter((id) => id !== g.id) : [g.id]);
    } else if (["cross", "tap"].includes(g.kind) && !isCancelled) {
      if (g.kind === "tap") {
        if (!g.isPress) return;
        this.pane.stage.focus({ preventScroll: true });
      }
      if (g.isPress && !g.line) page.moveCross(this.pane, g.from, null, false);
      if (g.isPress) page.select([]);
      page.lookAtRest();
    }
  }

  #letMirrorGo(g, isCancelled) {
    const { at, normal } = this.page.mirror, held = isCancelled ? g.start : at;
    this.page.moveMirror(normal.map((x) => held * x), true);
  }

  // Escape during a drag: as if it had not begun.
  cancel() {
    const g = this.gesture;
    this.gesture = null;
    this.pane.handles.showBand(null);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") this.page.endDrag(true);
    if (g?.kind === "mirror") this.#letMirrorGo(g, true);
    return g !== null;
  }

  doubleClick(event) {
    if (this.page.isWaiting || this.page.isSelecting) return;
    const hit = this.hit(event);
    if (hit?.id !== undefined) this.page.goTo(hit.id);
    else this.page.addAt(this.pane, this.place(event));
    event.preventDefault();
  }

  contextMenu(event) {
    event.preventDefault();
    const hit = this.hit(event);
    if (hit?.id !== undefined && isRightClick(event)) this.page.remove([hit.id]);
  }

  // The wheel goes through the slices, with Ctrl it zooms; it belongs to the page around until someone works in here.
  wheel(event) {
    const { page, pane } = this, isZoom = event.ctrlKey || event.metaKey;
    if (!isZoom && !page.isWorkedIn) {
      page.hint("Click a picture to go through its slices with the wheel");
      return;
    }
    event.preventDefault();
    const delta = Math.max(-240, Math.min(240, event.deltaY * (event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1)));
    if (isZoom || !page.isSlice) { pane.zoomAt(Math.exp(-delta * 0.004), ...this.place(event)); return; }
    this.rolled = (this.rolled ?? 0) + delta;
    const notches = Math.trunc(this.rolled / 40); // a notch of a wheel is about 100, a trackpad sends many small ones
    if (notches === 0) return;
    this.rolled = 0;
    page.scroll(pane, Math.sign(notches) * Math.max(1, Math.floor(Math.abs(notches) / 2)));
  }
}

export const SPACE_ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// Keys pressed anywhere in the editor; true if they meant something.
export function spaceKey(page, event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key, isCommand = event.ctrlKey || event.metaKey;
  if (event.target.closest("input[type=text], select")) return false; // have keys of their own
  const onButton = event.target.closest("button"), pane = page.paneOf(event.target);
  const focused = event.target.closest("[data-id]"), id = focused ? Number(focused.dataset.id) : null;
  if (isCommand && POINT_STEPS[key] && !onButton) {
    return pane.handles.focusNext(page.points.map((p) => p.id), POINT_STEPS[key], id);
  }
  if (isCommand) return spaceCommand(page, key, event.shiftKey);
  if (event.target.closest("input[type=range]")) return false;
  if (onButton && key in SPACE_ARROWS) return page.toolbar.focusNext(onButton, key);
  if (onButton && (key === "Enter" || key === " ")) return false;
  if (key in SPACE_ARROWS && event.target.closest("[data-mark]")) return mirrorKey(page, pane, SPACE_ARROWS[key], event.shiftKey ? 10 : 1);
  const way = TURN_WAYS[event.altKey ? TURN_CODES[event.code] : key];
  if (way) { page.turnKey(pane, way, { isLarge: event.shiftKey, isScale: event.altKey }); return true; }
  if (key in SPACE_ARROWS) {
    page.nudge(pane, id, SPACE_ARROWS[key], event.shiftKey ? 10 : 1, event.altKey ? "both" : "target");
    return true;
  }
  if (key === "PageUp" || key === "PageDown") {
    const by = (key === "PageUp" ? -1 : 1) * (event.shiftKey ? 10 : 1);
    if (event.altKey) page.nudgeDepth(pane, id, by);
    else page.scroll(pane, by);
    return true;
  }
  if (event.altKey) return false;
  if (key === " ") { page.isSpaceDown = true; return true; }
  if (key === "Enter") {
    if (id === null) page.addAtCursor(pane); else page.toggleSelected(id);
    return true;
  }
  if (key === "Escape") return page.escape();
  const command = (event.shiftKey && commandOf(SPACE_EDITOR_KEYS, `Shift+${key}`)) || commandOf(SPACE_EDITOR_KEYS, key);
  if (!command) return false;
  page.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, id);
  return true;
}

// The plane of the mirror by voxels of a picture that looks along it.
function mirrorKey(page, pane, [dx, dy], voxels) {
  const { spacing: [du, dv] } = pane.info, way = wayInPane(pane.info, dx * voxels * du, dy * voxels * dv), { at, normal } = page.mirror;
  page.moveMirror(normal.map((x, k) => at * x + way[k]), true);
  page.speak(`mirror at ${shownLength(page.mirror.at)}`);
  return true;
}

function spaceCommand(page, key, isShift) {
  if (key === "z") page.stepHistory(isShift ? "redo" : "undo");
  else if (key === "y") page.stepHistory("redo");
  else if (key === "a") page.select(page.points.map((p) => p.id));
  else return false;
  return true;
}
