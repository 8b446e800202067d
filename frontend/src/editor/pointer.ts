import { freeIds, turnOfDrag, withRims } from "../maths/points.ts";
import type { Vector2 } from "../types.ts";
import { slackOf } from "../ui/dom.ts";
import { isRightClick, keepFromScrolling } from "./handles.ts";
import type { ShapeGrip } from "./hit_test.ts";
import type { PartHandle } from "./motion_handles.ts";
import type { EditorParts } from "./parts.ts";
import type { Moved, Turn } from "./point_tools.ts";
export type TwoFingers = { x: number; y: number; gap: number };
/** What a click with the right button removes. */
export type RightClick = { id: number | null; shape: ShapeGrip | null };

/** A gesture under way: where it began, where the pointer is, and whether that has not moved yet. */
export type Gesture = { from: Vector2; at: Vector2; isPress: boolean } & (
  | { kind: "pan" | "tap" | "band"; adds: boolean; shape: ShapeGrip | null; before?: Vector2 }
  | { kind: "points"; id: number; ids: number[]; what: Moved; adds: boolean; was: boolean; isNew: boolean }
  | { kind: "shape"; grip: ShapeGrip }
  | { kind: "part"; handle: PartHandle }
  | { kind: "turn"; turn: Turn; about: Vector2; start: Vector2; scales: boolean }
  | { kind: "axis"; c: number; start: number }
  | { kind: "pinch"; was: TwoFingers }
  | { kind: "window"; click: RightClick | null }
  | { kind: "pen" }
  | { kind: "brush" }
);

/** What the pointers use of the editor. */
export type PointerEditor = EditorParts<
  "frames" | "messages" | "stage" | "viewport" | "points",
  "hits" | "brush" | "pen" | "wand" | "window" | "modes" | "points" | "shapes" | "parts",
  "handles" | "marks",
  "status"
>;

/**
 * Pointers. The mouse drags points, draws a band or, with space or the middle button, moves the view. One
 * finger drags points and moves the view, or draws a band while several are selected; two fingers move and zoom it.
 * Until someone works in the editor, a finger scrolls the page around.
 */
export class Gestures {
  editor: PointerEditor;
  pointers: Map<number, Vector2>;
  gesture: Gesture | null;
  kind: string;
  isOthers: boolean;
  isSpaceDown: boolean;

  constructor(editor: PointerEditor) {
    this.editor = editor;
    /** Places of the pointers that are down. */
    this.pointers = new Map();
    this.gesture = null;
    this.kind = "mouse"; // of the pointer that went down last
    this.isOthers = false; // whether its press belongs to the page around
    this.isSpaceDown = false;
    const { svg, root, closing } = editor.stage,
      { signal } = closing,
      options = { signal, passive: false };
    svg.addEventListener("pointerdown", (e) => editor.frames.guard(() => this.#down(e)), { signal });
    svg.addEventListener("pointermove", (e) => editor.frames.guard(() => this.#move(e)), { signal });
    svg.addEventListener("pointerup", (e) => editor.frames.guard(() => this.#up(e)), { signal });
    svg.addEventListener("pointercancel", (e) => editor.frames.guard(() => this.#up(e, true)), { signal });
    svg.addEventListener("pointerleave", () => editor.frames.guard(() => this.#leave()), { signal });
    svg.addEventListener(
      "lostpointercapture",
      (e) => {
        if (this.pointers.has(e.pointerId)) editor.frames.guard(() => this.#up(e, true));
      },
      { signal },
    );
    svg.addEventListener("dblclick", (e) => editor.frames.guard(() => this.#doubleClick(e)), { signal });
    svg.addEventListener("contextmenu", (e) => editor.frames.guard(() => this.#contextMenu(e)), { signal });
    svg.addEventListener(
      "touchstart",
      (e) => {
        if (this.isOthers) keepFromScrolling(e);
      },
      options,
    );
    root.addEventListener(
      "keyup",
      (e) => {
        if (e.key === " ") this.space(false);
      },
      { signal },
    );
    root.addEventListener(
      "focusout",
      ({ relatedTarget }) => {
        if (!(relatedTarget instanceof Node && root.contains(relatedTarget))) this.space(false);
      },
      { signal },
    );
  }

  // ---- pointers -----------------------------------------------------------------------------------------------------

  #down(event: PointerEvent) {
    const { editor } = this;
    if (editor.points.isWaiting) return;
    const at = this.editor.stage.placeOf(event),
      press = { from: at, at, isPress: true };
    this.pointers.set(event.pointerId, at);
    this.kind = event.pointerType || "mouse";
    this.isOthers = this.kind === "touch" && !editor.stage.isWorkedIn; // before this press gives it the focus
    editor.stage.svg.setPointerCapture(event.pointerId);
    const { kind = "" } = this.gesture ?? {};
    if (this.pointers.size === 2 && !["points", "turn", "axis", "part"].includes(kind)) {
      this.#startPinch();
      return;
    }
    if (this.gesture) return;
    const grabbed = this.editor.tools.hits.pointAt(event),
      mark = this.editor.tools.hits.markAt(event),
      shape = grabbed ? null : this.#ownShapeAt(event);
    event.preventDefault();
    if (event.button === 1 || (event.button === 0 && this.isSpaceDown)) {
      this.gesture = { ...press, isPress: false, kind: "pan", adds: false, shape: null };
    } else if (event.button === 2 && this.kind !== "touch") {
      const click = isRightClick(event)
        ? { id: grabbed?.id ?? null, shape: grabbed ? null : this.editor.tools.hits.shapeAt(event) }
        : null;
      this.gesture = { ...press, kind: "window", click };
    } else if (event.button !== 0) this.gesture = null;
    else if (editor.tools.window.isOn && !this.isOthers) {
      editor.stage.focus();
      this.gesture = { ...press, kind: "window", click: null };
    } else if (editor.tools.wand.isOn) {
      editor.stage.focus();
      editor.tools.wand.pick(at);
      this.gesture = null;
    } else if (editor.tools.pen.isOn) {
      editor.stage.focus();
      this.gesture = { ...press, kind: "pen" };
    } else if (mark === "axis") this.#grabAxis(at);
    else if (editor.tools.brush.isOn) {
      editor.stage.focus();
      this.gesture = { ...press, isPress: false, kind: "brush" };
      editor.tools.brush.press(at);
    } else if (mark === "swap") editor.tools.shapes.turn();
    else if (mark === "turn") this.#grabTurn(at);
    else if (shape) this.#grabShape(shape, at);
    else if (grabbed) this.#grab(event, grabbed, at);
    else if (editor.tools.modes.isAdding) {
      editor.stage.focus();
      const id = editor.tools.points.addAt(at, event.altKey);
      if (id !== null) this.#grab(event, { id, what: "target" }, at, true);
    } else this.#press(event, at);
    editor.stage.element.classList.toggle("dnb-ed-panning", this.gesture?.kind === "pan" && this.kind !== "touch");
  }

  /**
   * On the picture itself. Where nobody works in the editor a finger belongs to the page around, which may scroll.
   */
  #press(event: PointerEvent, at: Vector2) {
    const { editor, isOthers } = this,
      isFinger = this.kind === "touch";
    if (!isOthers) editor.stage.focus();
    const kind = isOthers ? "tap" : isFinger && !editor.tools.modes.isSelecting ? "pan" : "band";
    this.gesture = {
      kind,
      from: at,
      at,
      isPress: true,
      adds: editor.tools.modes.isSelecting || event.shiftKey || event.ctrlKey,
      shape: editor.tools.modes.isSelecting ? null : this.editor.tools.hits.shapeAt(event),
    };
  }

  #grab(event: PointerEvent, { id, what }: { id: number; what: "target" | "source" }, at: Vector2, isNew = false) {
    const { editor } = this,
      was = editor.points.selected.has(id);
    const adds = editor.tools.modes.isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    if (!was) editor.points.select(adds ? [...editor.points.selected, id] : [id]);
    editor.layers.handles.focus(id);
    const ids = editor.points.selected.has(id) ? [...editor.points.selected] : [id];
    this.gesture = {
      kind: "points",
      id,
      from: at,
      at,
      isPress: true,
      adds,
      was,
      isNew,
      what: event.altKey ? "both" : what,
      ids: freeIds(editor.points.list, withRims(editor.points.list, ids)),
    };
  }

  #grabTurn(at: Vector2) {
    const turn = this.editor.tools.points.beginTurn();
    if (!turn) return;
    const about = this.editor.viewport.onView(turn.about),
      start: Vector2 = [at[0] - about[0], at[1] - about[1]];
    this.gesture = { kind: "turn", turn, about, start, from: at, at, isPress: true, scales: false };
  }

  #grabAxis(at: Vector2) {
    const { editor } = this,
      mirror = editor.tools.points.mirror.state;
    editor.layers.marks.grip.focus({ preventScroll: true });
    this.gesture = { kind: "axis", from: at, at, isPress: true, c: mirror.axis === "a" ? 0 : 1, start: mirror.at };
  }

  /**
   * The part of the chosen shape that an event is about. Another shape is chosen by a click: a drag that begins on its
   * line is one on the picture, and a shape that was not chosen is not moved.
   */
  #ownShapeAt(event: Event) {
    const { editor } = this,
      chosen = editor.tools.shapes.choice.chosen;
    const grip =
      editor.tools.modes.isAdding || editor.tools.modes.isSelecting ? null : this.editor.tools.hits.shapeAt(event);
    if (grip?.handle && !editor.tools.parts.isOn) return null;
    return grip && chosen?.what === grip.chosen.what && chosen.index === grip.chosen.index ? grip : null;
  }

  #grabShape(grip: ShapeGrip, at: Vector2) {
    this.#focusShape(grip);
    this.gesture = grip.handle
      ? { kind: "part", handle: grip.handle, from: at, at, isPress: true }
      : { kind: "shape", grip, from: at, at, isPress: true };
  }

  #focusShape(grip: ShapeGrip) {
    const { editor } = this,
      { shapes: shapeTools } = editor.tools;
    shapeTools.choice.choose(grip.chosen);
    editor.frames.drawNow();
    if (grip.corner !== null) shapeTools.handles.focusCorner(grip.corner);
    else if (grip.handle && grip.handle !== "move") editor.tools.parts.handles.focus(grip.handle);
    else shapeTools.handles.focus(grip.chosen);
  }

  #move(event: PointerEvent) {
    const { editor } = this,
      { parts: partTools, points: pointTools, shapes: shapeTools } = editor.tools,
      at = this.editor.stage.placeOf(event),
      g = this.gesture;
    if (!this.pointers.has(event.pointerId)) {
      if (editor.tools.pen.isOn) editor.tools.pen.hover(at);
      if (editor.tools.brush.isOn) editor.tools.brush.hover(at);
      editor.panels.status.pointAt(event.pointerType === "touch" ? null : at);
      return;
    }
    this.pointers.set(event.pointerId, at);
    if (!g) return;
    if (g.kind === "pinch") {
      this.#pinch(g);
      return;
    }
    if (g.kind === "brush") {
      editor.tools.brush.drag(at);
      return;
    }
    const by: Vector2 = [at[0] - g.from[0], at[1] - g.from[1]];
    if (g.isPress && Math.hypot(by[0], by[1]) < slackOf(this.kind)) return;
    if (g.kind === "pan") editor.viewport.panBy(at[0] - g.at[0], at[1] - g.at[1]);
    else if (g.kind === "band") this.#band(g, at);
    else if (g.kind === "window") {
      if (g.isPress) editor.tools.window.begin();
      editor.tools.window.drag(by);
    } else if (g.kind === "pen") editor.tools.pen.drag(at);
    else if (g.kind === "turn") {
      // about the middle of the selection; Alt scales instead, Shift goes in steps
      const [angle, factor] = turnOfDrag(g.start, [at[0] - g.about[0], at[1] - g.about[1]], event);
      g.scales = event.altKey;
      pointTools.turnTo(g.turn, angle, factor);
    } else if (g.kind === "axis") pointTools.mirror.moveAxis(g.start + by[g.c]! / editor.viewport.view.k, false);
    else if (g.kind === "shape") {
      if (g.isPress) shapeTools.beginDrag(g.grip);
      shapeTools.drag(by[0], by[1]);
    } else if (g.kind === "part") {
      if (g.isPress) partTools.beginDrag(g.handle, g.from);
      partTools.drag(at, event.shiftKey);
    } else if (g.kind === "points") {
      if (g.isPress) pointTools.beginDrag();
      pointTools.drag(g.ids, by as Vector2, g.what, g.id, event.altKey);
    }
    g.isPress = false;
    g.at = at;
  }

  #leave() {
    const {
      tools: { brush },
      panels: { status: statusLine },
    } = this.editor;
    statusLine.pointAt(null);
    if (brush.isOn && !this.gesture && !brush.isByKeys) brush.hover(null);
  }

  #band(g: Extract<Gesture, { kind: "pan" | "tap" | "band" }>, at: Vector2) {
    const box = {
      x: Math.min(g.from[0], at[0]),
      y: Math.min(g.from[1], at[1]),
      width: Math.abs(at[0] - g.from[0]),
      height: Math.abs(at[1] - g.from[1]),
    };
    this.editor.layers.handles.showBand(box);
    g.before ??= (g.adds ? [...this.editor.points.selected] : []) as Vector2;
    this.editor.points.select([...g.before, ...this.editor.points.inside(box)]);
  }

  #up(event: PointerEvent, isCancelled = false) {
    const { editor, gesture: g } = this,
      { parts: partTools, points: pointTools, shapes: shapeTools } = editor.tools;
    this.pointers.delete(event.pointerId);
    if (!g) return;
    if (g.kind === "pinch") {
      if (this.pointers.size === 0) this.gesture = null;
      return;
    }
    this.gesture = null;
    editor.stage.element.classList.remove("dnb-ed-panning");
    editor.layers.handles.showBand(null);
    if (g.kind === "window") {
      if (!g.isPress) editor.tools.window.end(isCancelled);
      else if (g.click && !isCancelled) this.#rightClicked(g.click);
    } else if (g.kind === "pen") {
      if (!isCancelled && editor.tools.pen.isOn) editor.tools.pen.up(g.from, this.editor.stage.placeOf(event));
    } else if (g.kind === "shape") {
      if (!g.isPress) shapeTools.endDrag(isCancelled);
    } else if (g.kind === "part") partTools.endDrag(isCancelled);
    else if (g.kind === "brush") {
      editor.tools.brush.lift(isCancelled);
      if (this.kind === "touch") editor.tools.brush.hover(null); // a finger that is away points nowhere
    } else if (g.kind === "turn") pointTools.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "axis") pointTools.mirror.moveAxis(isCancelled ? g.start : pointTools.mirror.state.at, true);
    else if (g.kind === "points") {
      if (!g.isPress) pointTools.endDrag(isCancelled);
      else if (g.was && !g.isNew)
        editor.points.select(g.adds ? [...editor.points.selected].filter((id) => id !== g.id) : [g.id]);
    } else if (g.isPress && !isCancelled) this.#clicked(g);
    else if (g.kind === "tap" && !isCancelled)
      editor.messages.hint("Tap the picture first, then a finger moves it", 4000);
    else if (
      g.kind === "band" &&
      !g.isPress &&
      !isCancelled &&
      editor.points.selected.size === 0 &&
      !editor.points.isLocked
    ) {
      editor.messages.hint("Double-click adds a point to drag", 5000);
    }
  }

  /** A press on the picture that did not move. */
  #clicked(g: Extract<Gesture, { kind: "pan" | "tap" | "band" }>) {
    const { editor } = this;
    if (g.kind === "tap") editor.stage.focus();
    if (g.shape && !g.adds) this.#focusShape(g.shape);
    else if (!g.adds) {
      editor.points.select([]);
      editor.tools.shapes.choice.choose(null);
    }
  }

  /** Escape during a drag: as if it had not begun. */
  cancel() {
    const { editor, gesture: g } = this,
      { parts: partTools, points: pointTools, shapes: shapeTools } = editor.tools;
    this.gesture = null;
    editor.layers.handles.showBand(null);
    if (g?.kind === "part") partTools.endDrag(true);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") pointTools.endDrag(true);
    if (g?.kind === "brush") editor.tools.brush.lift(true);
    if (g?.kind === "window") editor.tools.window.end(true);
    if (g?.kind === "axis") pointTools.mirror.moveAxis(g.start, true);
    if (g?.kind === "shape" && !g.isPress) shapeTools.endDrag(true);
    return g !== null;
  }

  #startPinch() {
    const { editor, gesture: g } = this,
      was = this.#twoFingers(),
      at: Vector2 = [was.x, was.y];
    editor.layers.handles.showBand(null);
    if (g?.kind === "brush") editor.tools.brush.lift(true);
    if (g?.kind === "window") editor.tools.window.end(true);
    if (g?.kind === "band" && g.before) editor.points.select(g.before); // a band that was to be two fingers
    this.gesture = { kind: "pinch", was, from: at, at, isPress: false };
  }

  #twoFingers(): TwoFingers {
    const [[ax, ay], [bx, by]] = [...this.pointers.values()] as [Vector2, Vector2];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, gap: Math.max(10, Math.hypot(ax - bx, ay - by)) };
  }

  #pinch(g: { was: TwoFingers }) {
    if (this.pointers.size < 2) return;
    const now = this.#twoFingers();
    this.editor.viewport.panBy(now.x - g.was.x, now.y - g.was.y);
    this.editor.viewport.zoomAt(now.gap / g.was.gap, now.x, now.y);
    g.was = now;
  }

  #doubleClick(event: MouseEvent) {
    const { editor } = this,
      pen = editor.tools.pen;
    if (editor.tools.window.isOn) {
      editor.tools.window.reset();
      event.preventDefault();
      return;
    }
    if (editor.points.isWaiting || editor.tools.brush.isOn || editor.tools.wand.isOn || editor.tools.modes.isSelecting)
      return;
    const grabbed = this.editor.tools.hits.pointAt(event),
      shape = this.editor.tools.hits.shapeAt(event);
    if (pen.draft) pen.finish(pen.draft.tool === "part");
    else if (pen.hasJustEnded)
      return; // the second press has set the last place
    else if (grabbed) editor.tools.points.rename(grabbed.id);
    else if (shape && shape.corner !== null && editor.tools.shapes.toggleStop(shape.corner)) {
      /* it is done */
    } else if (shape && !shape.handle) editor.tools.shapes.rename();
    else editor.tools.points.addAt(this.editor.stage.placeOf(event), event.altKey);
    event.preventDefault();
  }

  #contextMenu(event: MouseEvent) {
    event.preventDefault();
    event.stopPropagation();
  }

  /**
   * A click with the right button: the button may as well begin a drag, and some systems ask for the menu at the press.
   */
  #rightClicked({ id, shape }: RightClick) {
    const {
      tools: { shapes: shapeTools, points: pointTools },
      points: { isLocked },
    } = this.editor;
    if (id !== null) pointTools.remove([id]);
    if (shape && !shape.handle && !isLocked) {
      shapeTools.choice.choose(shape.chosen);
      if (shape.corner !== null) shapeTools.removeCorner(shape.corner);
      else shapeTools.remove();
    }
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  space(isDown: boolean) {
    this.isSpaceDown = isDown;
    this.editor.stage.element.classList.toggle("dnb-ed-can-pan", isDown);
  }

  /** Give up what is under way, one thing after the other; false where nothing is. */
  escape() {
    const { editor } = this,
      { shapes: shapeTools } = editor.tools;
    if (this.cancel() || editor.tools.modes.cancelTool()) return true;
    if (editor.tools.modes.closeHelp()) return true;
    if (editor.tools.modes.stopModes() || shapeTools.dropOffer()) return true;
    if (editor.points.selected.size === 0 && !shapeTools.choice.chosen) return false;
    shapeTools.choice.choose(null);
    editor.points.select([]);
    return true;
  }
}
