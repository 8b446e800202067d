// Pointers, the wheel and keys of the editor, turned into calls of its tools. The keys are listed in ui/keys.js.

import { shownLength } from "../maths/numbers.ts";
import { freeIds, TURN_CODES, TURN_WAYS, turnOfDrag, withRims } from "../maths/points.ts";
import type { Vector2 } from "../types.ts";
import { slackOf, treeOf } from "../ui/dom.ts";
import { commandOf, EDITOR_KEYS } from "../ui/keys.ts";
import type { EditorView } from "./editor.ts";
import { isRightClick, keepFromScrolling, POINT_STEPS, WheelSteps } from "./handles.ts";
import type { PartHandle } from "./motion_handles.ts";
import type { Moved, Turn } from "./point_tools.ts";
import type { Chosen, Grip } from "./shape_handles.ts";
/** `handle`: of the motion of a rigid part, null on an outline. */
export type ShapeGrip = Grip & { chosen: Chosen; handle: PartHandle | null };
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

const arrows: Record<string, Vector2> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

/** The nearest element around that of an event that a selector matches. */
function around({ target }: { target: EventTarget | null }, selector: string): HTMLElement | SVGElement | null {
  return target instanceof Element ? target.closest(selector) : null;
}

function numberOf(text: string | undefined) {
  return text ? Number(text) : null;
}

/** Keys pressed anywhere in the editor. */
class EditorKeys {
  editor: EditorView;
  gestures: Gestures;

  constructor(editor: EditorView, gestures: Gestures) {
    this.editor = editor;
    this.gestures = gestures;
  }

  key(event: KeyboardEvent) {
    const { editor } = this,
      isThird = event.getModifierState?.("AltGraph") ?? false; // brackets of many keyboards
    const isCommand = (event.ctrlKey || event.metaKey) && !isThird,
      isAlt = event.altKey && !isThird;
    if (around(event, "input, select")) {
      // have keys of their own
      if (event.key === "Escape" && event.target === editor.brush.slider) {
        editor.brush.stop();
        editor.focusStage();
      }
      return;
    }
    if (!isCommand && around(event, ".dnb-ed-help")) {
      if (event.key === "Escape" || event.key === "?") editor.closeHelp();
      return;
    }
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const handled = isCommand ? this.#command(key, event) : this.#plain(key, event, isAlt);
    if (!handled) return;
    event.preventDefault();
    event.stopPropagation();
  }

  #command(key: string, event: KeyboardEvent) {
    const { editor } = this,
      focused = this.gestures.pointAt(event);
    if (POINT_STEPS[key] && around(event, "button")) return false;
    if (POINT_STEPS[key])
      editor.handles.focusNext(
        editor.points.map((p) => p.id),
        POINT_STEPS[key],
        focused?.id,
      );
    else if (key === "z") editor.stepHistory(event.shiftKey ? "redo" : "undo");
    else if (key === "y") editor.stepHistory("redo");
    else if (key === "a") editor.select(editor.points.map((p) => p.id));
    else return false;
    return true;
  }

  /** Keys on a line, a corner or the middle of an edge. */
  #shapeKey(key: string, event: KeyboardEvent, shape: ShapeGrip) {
    const {
        editor,
        editor: { shapeTools },
      } = this,
      arrow = arrows[key],
      command = commandOf(EDITOR_KEYS, key);
    const isOther = JSON.stringify(shape.chosen) !== JSON.stringify(shapeTools.chosen);
    const isDelete = key === "Delete" || key === "Backspace",
      way = TURN_WAYS[key];
    const isOutline = shape.corner !== null || shape.middle !== null;
    if (key === "Enter") {
      if (!isOther && shape.corner !== null && shapeTools.toggleStop(shape.corner)) return true;
      if (shape.middle === null) shapeTools.choose(isOther || shape.corner !== null ? shape.chosen : null);
      else if (!editor.isLocked) shapeTools.insertCorner(shape.middle);
      return true;
    }
    if (!arrow && !isDelete && !way && !["F2", "Home", "o", "f"].includes(key)) return false;
    if (isOther) shapeTools.choose(shape.chosen);
    if (editor.isLocked) return true;
    const isPart = editor.partTools.isOn,
      pixels = event.shiftKey ? 10 : 1;
    if ((way || key === "Home") && !isPart) return false;
    if (way) editor.partTools.turnKey(way, event.shiftKey);
    else if (key === "Home") editor.partTools.reset();
    else if (arrow && isPart && shape.handle === "turn") editor.partTools.turnKey(arrow[0] || arrow[1], event.shiftKey);
    else if (arrow && isPart && !isOutline) editor.partTools.nudge(arrow, pixels, shape.handle ?? "move");
    else if (arrow) shapeTools.nudge(shape, arrow, pixels);
    else if (isDelete && shape.middle !== null) editor.hint("Here is no corner to delete yet");
    else if (isDelete && shape.corner !== null) shapeTools.removeCorner(shape.corner);
    else if (command) editor.run(command, null);
    return true;
  }

  #plain(key: string, event: KeyboardEvent, isAlt: boolean) {
    const { editor, gestures } = this,
      onButton = around(event, "button"),
      arrow = arrows[key];
    const focused = gestures.pointAt(event),
      shape = focused ? null : gestures.shapeAt(event);
    if (!onButton && editor.pen.isOn && !isAlt && editor.pen.key(key, event, arrow)) return true;
    if (!onButton && editor.brush.isOn && !isAlt && editor.brush.key(key, event, arrow)) return true;
    if (!onButton && editor.wand.isOn && !isAlt && editor.wand.key(key, event, arrow)) return true;
    if (!onButton && editor.windowTool.isOn && !isAlt && editor.windowTool.key(key, event, arrow)) return true;
    if ((key === "Enter" || key === " ") && gestures.markAt(event) === "swap") {
      editor.shapeTools.turn();
      return true;
    }
    if (arrow && gestures.markAt(event) === "axis") return this.#axisKey(arrow, event.shiftKey ? 10 : 1);
    if (shape && !onButton && !isAlt && this.#shapeKey(key, event, shape)) return true;
    if (onButton instanceof HTMLButtonElement && arrow) return editor.toolbar.focusNext(onButton, key);
    if (onButton && (key === "Enter" || key === " ")) return false;
    if (arrow) {
      editor.pointTools.nudge(focused?.id ?? null, arrow, event.shiftKey ? 10 : 1, isAlt ? "both" : "target");
      return true;
    }
    const way = TURN_WAYS[isAlt ? TURN_CODES[event.code]! : key];
    if (way && !isAlt && editor.selected.size === 0 && editor.partTools.isOn) {
      editor.partTools.turnKey(way, event.shiftKey);
      return true;
    }
    if (way) {
      editor.pointTools.turnKey(way, { isLarge: event.shiftKey, isScale: isAlt });
      return true;
    }
    if (isAlt) return false;
    if (key === " ") {
      gestures.space(true);
      return true;
    }
    if (key === "PageUp" || key === "PageDown") return editor.moveSlice(key === "PageDown" ? 1 : -1);
    if (key === "Enter") {
      if (focused) editor.toggleSelected(focused.id);
      else if (!editor.isLocked) editor.pointTools.addInMiddle();
      return true;
    }
    if (key === "Escape") return gestures.escape();
    if (key === "[" || key === "]") {
      editor.brush.grow(key === "]" ? 1 : -1);
      return true;
    }
    const command = (event.shiftKey && commandOf(EDITOR_KEYS, `Shift+${key}`)) || commandOf(EDITOR_KEYS, key);
    if (!command) return false;
    editor.run(command === "zoom" ? (key === "-" ? "zoom-out" : "zoom-in") : command, focused?.id ?? null);
    return true;
  }

  #axisKey(arrow: Vector2, pixels: number) {
    const {
        editor,
        editor: { pointTools },
      } = this,
      { mirror } = pointTools,
      c = mirror.axis === "a" ? 0 : 1;
    pointTools.moveAxis(mirror.at + pixels * arrow[c] * editor.model.get("raster").spacing[c], true);
    editor.announce(`axis at ${shownLength(pointTools.mirror.at)}`);
    return true;
  }
}

/**
 * Pointers and the wheel. The mouse drags points, draws a band or, with space or the middle button, moves the view. One
 * finger drags points and moves the view, or draws a band while several are selected; two fingers move and zoom it.
 * Until someone works in the editor, a finger scrolls the page around.
 */
export class Gestures {
  editor: EditorView;
  pointers: Map<number, Vector2>;
  gesture: Gesture | null;
  kind: string;
  isOthers: boolean;
  isSpaceDown: boolean;
  wheelSteps: WheelSteps;
  closing: AbortController;

  constructor(editor: EditorView) {
    this.editor = editor;
    /** Places of the pointers that are down. */
    this.pointers = new Map();
    this.gesture = null;
    this.kind = "mouse"; // of the pointer that went down last
    this.isOthers = false; // whether its press belongs to the page around
    this.isSpaceDown = false;
    this.wheelSteps = new WheelSteps();
    this.closing = new AbortController();
    const { stage, svg, root } = editor,
      { signal } = this.closing,
      options = { signal, passive: false };
    const keys = new EditorKeys(editor, this);
    svg.addEventListener("pointerdown", (e) => editor.guard(() => this.#down(e)), { signal });
    svg.addEventListener("pointermove", (e) => editor.guard(() => this.#move(e)), { signal });
    svg.addEventListener("pointerup", (e) => editor.guard(() => this.#up(e)), { signal });
    svg.addEventListener("pointercancel", (e) => editor.guard(() => this.#up(e, true)), { signal });
    svg.addEventListener("pointerleave", () => editor.guard(() => this.#leave()), { signal });
    svg.addEventListener(
      "lostpointercapture",
      (e) => {
        if (this.pointers.has(e.pointerId)) editor.guard(() => this.#up(e, true));
      },
      { signal },
    );
    svg.addEventListener("dblclick", (e) => editor.guard(() => this.#doubleClick(e)), { signal });
    svg.addEventListener("contextmenu", (e) => editor.guard(() => this.#contextMenu(e)), { signal });
    svg.addEventListener(
      "touchstart",
      (e) => {
        if (this.isOthers) keepFromScrolling(e);
      },
      options,
    );
    stage.addEventListener("wheel", (e) => editor.guard(() => this.#wheel(e)), options);
    root.addEventListener("keydown", (e) => editor.guard(() => keys.key(e)), { signal });
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

  close() {
    this.closing.abort();
  }

  /** The place of a pointer in CSS pixels of the view. */
  place(event: MouseEvent): Vector2 {
    const box = this.editor.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /**
   * The element that an event is about. While a pointer is captured, what lies under its clicks is not their target. A
   * press may come before other points or shapes are drawn: then they are, and what lies there now counts.
   */
  #hit(event: Event) {
    if (event.type === "pointerdown" && this.editor.frame) this.editor.drawNow();
    const { type, target } = event,
      isPlaced = ["pointerdown", "dblclick", "contextmenu"].includes(type);
    if (!(event instanceof MouseEvent && isPlaced)) return { target };
    return { target: treeOf(this.editor.root).elementFromPoint(event.clientX, event.clientY) };
  }

  /** The point that an event is about. */
  pointAt(event: Event): { id: number; what: "target" | "source" } | null {
    const hit = this.#hit(event),
      target = around(hit, "[data-id]"),
      source = around(hit, "[data-source]");
    if (target) return { id: Number(target.dataset.id), what: "target" };
    return source ? { id: Number(source.dataset.source), what: "source" } : null;
  }

  /**
   * What of a shape an event is about: its line, a corner, the middle of an edge, or a handle of a part's motion, of
   * which its inside is one.
   */
  shapeAt(event: Event): ShapeGrip | null {
    const hit = this.#hit(event),
      grip = around(hit, ".dnb-ed-grip"),
      { chosen } = this.editor.shapeTools;
    if (grip && chosen) {
      return { chosen, corner: numberOf(grip.dataset.corner), middle: numberOf(grip.dataset.middle), handle: null };
    }
    const found = around(hit, "[data-motion]")?.dataset.motion;
    const handle = found === "move" || found === "turn" || found === "pivot" ? found : null;
    if (chosen && handle && handle !== "move") return { chosen, corner: null, middle: null, handle };
    const [what, index] = around(hit, "[data-shape]")?.dataset.shape?.split(":") ?? [];
    if (what !== "cuts" && what !== "parts") return null;
    return { chosen: { what, index: Number(index) }, corner: null, middle: null, handle };
  }

  /** The handle that turns, or the axis of the mirror. */
  markAt(event: Event) {
    return around(event, "[data-mark]")?.dataset.mark ?? null;
  }

  // ---- pointers -----------------------------------------------------------------------------------------------------

  #down(event: PointerEvent) {
    const { editor } = this;
    if (editor.isWaiting) return;
    const at = this.place(event),
      press = { from: at, at, isPress: true };
    this.pointers.set(event.pointerId, at);
    this.kind = event.pointerType || "mouse";
    this.isOthers = this.kind === "touch" && !editor.isWorkedIn; // before this press gives it the focus
    editor.svg.setPointerCapture(event.pointerId);
    const { kind = "" } = this.gesture ?? {};
    if (this.pointers.size === 2 && !["points", "turn", "axis", "part"].includes(kind)) {
      this.#startPinch();
      return;
    }
    if (this.gesture) return;
    const grabbed = this.pointAt(event),
      mark = this.markAt(event),
      shape = grabbed ? null : this.#ownShapeAt(event);
    event.preventDefault();
    if (event.button === 1 || (event.button === 0 && this.isSpaceDown)) {
      this.gesture = { ...press, isPress: false, kind: "pan", adds: false, shape: null };
    } else if (event.button === 2 && this.kind !== "touch") {
      const click = isRightClick(event)
        ? { id: grabbed?.id ?? null, shape: grabbed ? null : this.shapeAt(event) }
        : null;
      this.gesture = { ...press, kind: "window", click };
    } else if (event.button !== 0) this.gesture = null;
    else if (editor.windowTool.isOn && !this.isOthers) {
      editor.focusStage();
      this.gesture = { ...press, kind: "window", click: null };
    } else if (editor.wand.isOn) {
      editor.focusStage();
      editor.wand.pick(at);
      this.gesture = null;
    } else if (editor.pen.isOn) {
      editor.focusStage();
      this.gesture = { ...press, kind: "pen" };
    } else if (mark === "axis") this.#grabAxis(at);
    else if (editor.brush.isOn) {
      editor.focusStage();
      this.gesture = { ...press, isPress: false, kind: "brush" };
      editor.brush.press(at);
    } else if (mark === "swap") editor.shapeTools.turn();
    else if (mark === "turn") this.#grabTurn(at);
    else if (shape) this.#grabShape(shape, at);
    else if (grabbed) this.#grab(event, grabbed, at);
    else if (editor.isAdding) {
      editor.focusStage();
      const id = editor.pointTools.addAt(at, event.altKey);
      if (id !== null) this.#grab(event, { id, what: "target" }, at, true);
    } else this.#press(event, at);
    editor.stage.classList.toggle("dnb-ed-panning", this.gesture?.kind === "pan" && this.kind !== "touch");
  }

  /**
   * On the picture itself. Where nobody works in the editor a finger belongs to the page around, which may scroll.
   */
  #press(event: PointerEvent, at: Vector2) {
    const { editor, isOthers } = this,
      isFinger = this.kind === "touch";
    if (!isOthers) editor.focusStage();
    const kind = isOthers ? "tap" : isFinger && !editor.isSelecting ? "pan" : "band";
    this.gesture = {
      kind,
      from: at,
      at,
      isPress: true,
      adds: editor.isSelecting || event.shiftKey || event.ctrlKey,
      shape: editor.isSelecting ? null : this.shapeAt(event),
    };
  }

  #grab(event: PointerEvent, { id, what }: { id: number; what: "target" | "source" }, at: Vector2, isNew = false) {
    const { editor } = this,
      was = editor.selected.has(id);
    const adds = editor.isSelecting || event.shiftKey || event.ctrlKey || event.metaKey;
    if (!was) editor.select(adds ? [...editor.selected, id] : [id]);
    editor.handles.focus(id);
    const ids = editor.selected.has(id) ? [...editor.selected] : [id];
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
      ids: freeIds(editor.points, withRims(editor.points, ids)),
    };
  }

  #grabTurn(at: Vector2) {
    const turn = this.editor.pointTools.beginTurn();
    if (!turn) return;
    const about = this.editor.onView(turn.about),
      start: Vector2 = [at[0] - about[0], at[1] - about[1]];
    this.gesture = { kind: "turn", turn, about, start, from: at, at, isPress: true, scales: false };
  }

  #grabAxis(at: Vector2) {
    const { editor } = this,
      { mirror } = editor.pointTools;
    editor.marks.grip.focus({ preventScroll: true });
    this.gesture = { kind: "axis", from: at, at, isPress: true, c: mirror.axis === "a" ? 0 : 1, start: mirror.at };
  }

  /**
   * The part of the chosen shape that an event is about. Another shape is chosen by a click: a drag that begins on its
   * line is one on the picture, and a shape that was not chosen is not moved.
   */
  #ownShapeAt(event: Event) {
    const { editor } = this,
      { chosen } = editor.shapeTools;
    const grip = editor.isAdding || editor.isSelecting ? null : this.shapeAt(event);
    if (grip?.handle && !editor.partTools.isOn) return null;
    return grip && chosen?.what === grip.chosen.what && chosen.index === grip.chosen.index ? grip : null;
  }

  #grabShape(grip: ShapeGrip, at: Vector2) {
    this.#focusShape(grip);
    this.gesture = grip.handle
      ? { kind: "part", handle: grip.handle, from: at, at, isPress: true }
      : { kind: "shape", grip, from: at, at, isPress: true };
  }

  #focusShape(grip: ShapeGrip) {
    const {
      editor,
      editor: { shapeTools },
    } = this;
    shapeTools.choose(grip.chosen);
    editor.drawNow();
    if (grip.corner !== null) shapeTools.handles.focusCorner(grip.corner);
    else if (grip.handle && grip.handle !== "move") editor.partTools.handles.focus(grip.handle);
    else shapeTools.handles.focus(grip.chosen);
  }

  #move(event: PointerEvent) {
    const {
        editor,
        editor: { partTools, pointTools, shapeTools },
      } = this,
      at = this.place(event),
      g = this.gesture;
    if (!this.pointers.has(event.pointerId)) {
      if (editor.pen.isOn) editor.pen.hover(at);
      if (editor.brush.isOn) editor.brush.hover(at);
      editor.statusLine.pointAt(event.pointerType === "touch" ? null : at);
      return;
    }
    this.pointers.set(event.pointerId, at);
    if (!g) return;
    if (g.kind === "pinch") {
      this.#pinch(g);
      return;
    }
    if (g.kind === "brush") {
      editor.brush.drag(at);
      return;
    }
    const by: Vector2 = [at[0] - g.from[0], at[1] - g.from[1]];
    if (g.isPress && Math.hypot(by[0], by[1]) < slackOf(this.kind)) return;
    if (g.kind === "pan") editor.panBy(at[0] - g.at[0], at[1] - g.at[1]);
    else if (g.kind === "band") this.#band(g, at);
    else if (g.kind === "window") {
      if (g.isPress) editor.windowTool.begin();
      editor.windowTool.drag(by);
    } else if (g.kind === "pen") editor.pen.drag(at);
    else if (g.kind === "turn") {
      // about the middle of the selection; Alt scales instead, Shift goes in steps
      const [angle, factor] = turnOfDrag(g.start, [at[0] - g.about[0], at[1] - g.about[1]], event);
      g.scales = event.altKey;
      pointTools.turnTo(g.turn, angle, factor);
    } else if (g.kind === "axis") pointTools.moveAxis(g.start + by[g.c]! / editor.view.k, false);
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
    const { brush, statusLine } = this.editor;
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
    this.editor.handles.showBand(box);
    g.before ??= (g.adds ? [...this.editor.selected] : []) as Vector2;
    this.editor.select([...g.before, ...this.editor.pointsInside(box)]);
  }

  #up(event: PointerEvent, isCancelled = false) {
    const {
      editor,
      editor: { partTools, pointTools, shapeTools },
      gesture: g,
    } = this;
    this.pointers.delete(event.pointerId);
    if (!g) return;
    if (g.kind === "pinch") {
      if (this.pointers.size === 0) this.gesture = null;
      return;
    }
    this.gesture = null;
    editor.stage.classList.remove("dnb-ed-panning");
    editor.handles.showBand(null);
    if (g.kind === "window") {
      if (!g.isPress) editor.windowTool.end(isCancelled);
      else if (g.click && !isCancelled) this.#rightClicked(g.click);
    } else if (g.kind === "pen") {
      if (!isCancelled && editor.pen.isOn) editor.pen.up(g.from, this.place(event));
    } else if (g.kind === "shape") {
      if (!g.isPress) shapeTools.endDrag(isCancelled);
    } else if (g.kind === "part") partTools.endDrag(isCancelled);
    else if (g.kind === "brush") {
      editor.brush.lift(isCancelled);
      if (this.kind === "touch") editor.brush.hover(null); // a finger that is away points nowhere
    } else if (g.kind === "turn") pointTools.endDrag(isCancelled || g.isPress, g.scales ? "scale" : "turn");
    else if (g.kind === "axis") pointTools.moveAxis(isCancelled ? g.start : pointTools.mirror.at, true);
    else if (g.kind === "points") {
      if (!g.isPress) pointTools.endDrag(isCancelled);
      else if (g.was && !g.isNew) editor.select(g.adds ? [...editor.selected].filter((id) => id !== g.id) : [g.id]);
    } else if (g.isPress && !isCancelled) this.#clicked(g);
    else if (g.kind === "tap" && !isCancelled) editor.hint("Tap the picture first, then a finger moves it", 4000);
    else if (g.kind === "band" && !g.isPress && !isCancelled && editor.selected.size === 0 && !editor.isLocked) {
      editor.hint("Double-click adds a point to drag", 5000);
    }
  }

  /** A press on the picture that did not move. */
  #clicked(g: Extract<Gesture, { kind: "pan" | "tap" | "band" }>) {
    const { editor } = this;
    if (g.kind === "tap") editor.focusStage();
    if (g.shape && !g.adds) this.#focusShape(g.shape);
    else if (!g.adds) {
      editor.select([]);
      editor.shapeTools.choose(null);
    }
  }

  /** Escape during a drag: as if it had not begun. */
  cancel() {
    const {
      editor,
      editor: { partTools, pointTools, shapeTools },
      gesture: g,
    } = this;
    this.gesture = null;
    editor.handles.showBand(null);
    if (g?.kind === "part") partTools.endDrag(true);
    if ((g?.kind === "points" && !g.isPress) || g?.kind === "turn") pointTools.endDrag(true);
    if (g?.kind === "brush") editor.brush.lift(true);
    if (g?.kind === "window") editor.windowTool.end(true);
    if (g?.kind === "axis") pointTools.moveAxis(g.start, true);
    if (g?.kind === "shape" && !g.isPress) shapeTools.endDrag(true);
    return g !== null;
  }

  #startPinch() {
    const { editor, gesture: g } = this,
      was = this.#twoFingers(),
      at: Vector2 = [was.x, was.y];
    editor.handles.showBand(null);
    if (g?.kind === "brush") editor.brush.lift(true);
    if (g?.kind === "window") editor.windowTool.end(true);
    if (g?.kind === "band" && g.before) editor.select(g.before); // a band that was to be two fingers
    this.gesture = { kind: "pinch", was, from: at, at, isPress: false };
  }

  #twoFingers(): TwoFingers {
    const [[ax, ay], [bx, by]] = [...this.pointers.values()] as [Vector2, Vector2];
    return { x: (ax + bx) / 2, y: (ay + by) / 2, gap: Math.max(10, Math.hypot(ax - bx, ay - by)) };
  }

  #pinch(g: { was: TwoFingers }) {
    if (this.pointers.size < 2) return;
    const now = this.#twoFingers();
    this.editor.panBy(now.x - g.was.x, now.y - g.was.y);
    this.editor.zoomAt(now.gap / g.was.gap, now.x, now.y);
    g.was = now;
  }

  #doubleClick(event: MouseEvent) {
    const { editor } = this,
      { pen } = editor;
    if (editor.windowTool.isOn) {
      editor.windowTool.reset();
      event.preventDefault();
      return;
    }
    if (editor.isWaiting || editor.brush.isOn || editor.wand.isOn || editor.isSelecting) return;
    const grabbed = this.pointAt(event),
      shape = this.shapeAt(event);
    if (pen.draft) pen.finish(pen.draft.tool === "part");
    else if (pen.hasJustEnded)
      return; // the second press has set the last place
    else if (grabbed) editor.pointTools.rename(grabbed.id);
    else if (shape && shape.corner !== null && editor.shapeTools.toggleStop(shape.corner)) {
      /* it is done */
    } else if (shape && !shape.handle) editor.shapeTools.rename();
    else editor.pointTools.addAt(this.place(event), event.altKey);
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
    const { shapeTools, pointTools, isLocked } = this.editor;
    if (id !== null) pointTools.remove([id]);
    if (shape && !shape.handle && !isLocked) {
      shapeTools.choose(shape.chosen);
      if (shape.corner !== null) shapeTools.removeCorner(shape.corner);
      else shapeTools.remove();
    }
  }

  /** The wheel belongs to the page that scrolls, until someone works in the editor. */
  #wheel(event: WheelEvent) {
    const { editor } = this,
      [x, y] = this.place(event),
      isWanted = event.ctrlKey || event.metaKey || editor.isWorkedIn;
    if (!isWanted) {
      editor.hint(
        editor.slices
          ? "Click the picture to go through the slices with the wheel, or hold Ctrl to zoom"
          : "Click the picture, or hold Ctrl, to zoom with the wheel",
      );
      return;
    }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (editor.brush.isOn && !event.ctrlKey && !event.metaKey) {
      editor.brush.grow(-delta / 60);
      return;
    }
    if (editor.slices && !event.ctrlKey && !event.metaKey) {
      const steps = this.wheelSteps.add(delta);
      if (steps !== 0) editor.moveSlice(steps);
      return;
    }
    editor.zoomAt(Math.exp(-delta * (event.ctrlKey ? 0.01 : 0.0022)), x, y);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  space(isDown: boolean) {
    this.isSpaceDown = isDown;
    this.editor.stage.classList.toggle("dnb-ed-can-pan", isDown);
  }

  /** Give up what is under way, one thing after the other; false where nothing is. */
  escape() {
    const {
      editor,
      editor: { shapeTools },
    } = this;
    if (this.cancel() || editor.pen.cancel() || editor.brush.stop() || editor.windowTool.stop() || editor.wand.stop())
      return true;
    if (editor.closeHelp()) return true;
    if (editor.stopModes() || shapeTools.dropOffer()) return true;
    if (editor.selected.size === 0 && !shapeTools.chosen) return false;
    shapeTools.choose(null);
    editor.select([]);
    return true;
  }
}
