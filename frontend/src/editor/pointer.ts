// Pointers over the picture of an editor: which gesture a press begins.

import type { Vector2 } from "../types.ts";
import { slackOf } from "../ui/dom.ts";
import {
  BandGesture,
  type Gesture,
  type GrabbedPoint,
  PanGesture,
  PointsGesture,
  TapGesture,
  TurnGesture,
} from "./gesture.ts";
import { AxisGesture, PartGesture, PinchGesture, ShapeGesture, WindowGesture } from "./gestures.ts";
import { isRightClick, preventScrolling } from "./handles.ts";
import type { ShapeGrip } from "./hit_test.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the pointers on the editor. */
export type PointerEditor = EditorParts<
  "frames" | "messages" | "stage" | "viewport" | "points",
  "hits" | "brush" | "pen" | "window" | "modes" | "points" | "drag" | "turns" | "shapes" | "parts",
  "handles" | "marks",
  "status"
>;

/**
 * Pointers. The mouse drags points, draws a band or, with space or the middle button, moves the view. One
 * finger drags points and moves the view, or draws a band while several are selected; two fingers move and zoom it.
 * Until the editor has the focus, a finger scrolls the host page.
 */
export class Gestures {
  /** Places of the pointers that are down. */
  pointers: Map<number, Vector2> = new Map();

  gesture: Gesture | null = null;

  kind = "mouse"; // of the pointer that went down last

  isOthers = false; // whether its press belongs to the host page

  isSpaceDown = false;

  constructor(readonly editor: PointerEditor) {
    const { frames } = editor,
      { svg, root, closing } = editor.stage,
      { signal } = closing,
      options = { signal };
    frames.listen(svg, "pointerdown", (e) => this.#down(e), options);
    frames.listen(svg, "pointermove", (e) => this.#move(e), options);
    frames.listen(svg, "pointerup", (e) => this.#up(e), options);
    frames.listen(svg, "pointercancel", (e) => this.#up(e, true), options);
    frames.listen(svg, "pointerleave", () => this.#leave(), options);
    frames.listen(
      svg,
      "lostpointercapture",
      (e) => {
        if (this.pointers.has(e.pointerId)) this.#up(e, true);
      },
      options,
    );
    frames.listen(svg, "dblclick", (e) => this.#doubleClick(e), options);
    frames.listen(svg, "contextmenu", (e) => this.#contextMenu(e), options);
    frames.listen(
      svg,
      "touchstart",
      (e) => {
        if (this.isOthers) preventScrolling(e);
      },
      { signal, passive: false },
    );
    frames.listen(
      root,
      "keyup",
      (e) => {
        if (e.key === " ") this.space(false);
      },
      options,
    );
    frames.listen(
      root,
      "focusout",
      ({ relatedTarget }) => {
        if (!(relatedTarget instanceof Node && root.contains(relatedTarget))) this.space(false);
      },
      options,
    );
  }

  // ---- pointers -----------------------------------------------------------------------------------------------------

  /** Whether a press belongs to a gesture or a mode: nothing else may begin. */
  get isBusy() {
    const { modes, pen } = this.editor.tools;
    return pen.isOn || modes.isAdding || this.isSpaceDown || this.pointers.size > 0;
  }

  #down(event: PointerEvent) {
    const { points, stage, viewport } = this.editor;
    if (points.isWaiting) return;
    const at = stage.placeOf(event);
    this.pointers.set(event.pointerId, at);
    this.kind = event.pointerType || "mouse";
    this.isOthers = this.kind === "touch" && !stage.isInUse; // before this press gives it the focus
    stage.svg.setPointerCapture(event.pointerId);
    if (this.pointers.size === 2 && !this.gesture?.isHolding) {
      this.cancel();
      this.gesture = new PinchGesture(this.pointers, viewport);
      return;
    }
    if (this.gesture) return;
    event.preventDefault();
    this.gesture = this.#begin(event, at);
    stage.element.classList.toggle("dnb-ed-panning", this.gesture instanceof PanGesture && this.kind !== "touch");
  }

  /** The gesture that a press begins, or null. */
  #begin(event: PointerEvent, at: Vector2): Gesture | null {
    const { layers, stage, tools, viewport } = this.editor,
      { brush, drag, hits, modes, points, shapes, turns, window } = tools;
    const grabbed = hits.pointAt(event),
      mark = hits.markAt(event),
      shape = grabbed ? null : this.#ownShapeAt(event);
    if (event.button === 1 || (event.button === 0 && this.isSpaceDown)) return new PanGesture(at, viewport);
    if (event.button === 2 && this.kind !== "touch") {
      const id = grabbed?.id ?? null,
        under = grabbed ? null : hits.shapeAt(event);
      return new WindowGesture(at, window, isRightClick(event) ? () => this.#handleRightClick(id, under) : null);
    }
    if (event.button !== 0) return null;
    const tool = modes.activeTool;
    if (tool && !(tool === window && this.isOthers) && !(tool === brush && mark === "axis")) {
      stage.focus();
      return tool.grab(at, this.kind === "touch");
    }
    if (mark === "axis") {
      layers.marks.grip.focus({ preventScroll: true });
      return new AxisGesture(at, points.mirror, viewport);
    }
    if (mark === "swap") {
      shapes.turn();
      return null;
    }
    if (mark === "turn") {
      const turn = turns.begin();
      const turnTo = (angle: number, factor: number) => turn && turns.turnTo(turn, angle, factor);
      return (
        turn &&
        new TurnGesture(at, viewport.toView(turn.about), turnTo, (isCancelled, kind) => drag.endDrag(isCancelled, kind))
      );
    }
    if (shape) {
      this.#focusShape(shape);
      return shape.handle ? new PartGesture(at, tools.parts, shape.handle) : new ShapeGesture(at, shapes, shape);
    }
    if (grabbed) return this.#grab(event, grabbed, at);
    if (!modes.isAdding) return this.#press(event, at);
    stage.focus();
    const id = points.addAt(at, event.altKey);
    return id === null ? null : this.#grab(event, { id, what: "target", isNew: true }, at);
  }

  #grab(event: PointerEvent, grabbed: GrabbedPoint, at: Vector2) {
    const { layers, points, tools } = this.editor,
      made = new PointsGesture(event, at, grabbed, points, tools.modes.isSelecting, tools.drag);
    layers.handles.focus(grabbed.id);
    return made;
  }

  /**
   * A press on the picture itself. Without the focus a finger belongs to the host page, which may scroll.
   */
  #press(event: PointerEvent, at: Vector2) {
    const { layers, messages, points, stage, tools, viewport } = this.editor,
      { hits, modes } = tools,
      isFinger = this.kind === "touch";
    if (!this.isOthers) stage.focus();
    const adds = modes.isSelecting || event.shiftKey || event.ctrlKey,
      shape = modes.isSelecting ? null : hits.shapeAt(event);
    const click = () => this.#handleClick(shape, adds);
    if (this.isOthers) {
      const advise = () => messages.hint("Tap the picture first, then a finger moves it", 4000);
      return new TapGesture(at, advise, () => {
        stage.focus();
        click();
      });
    }
    if (isFinger && !modes.isSelecting) return new PanGesture(at, viewport, click);
    return new BandGesture(at, points, adds, {
      show: (band) => layers.handles.showBand(band),
      inside: (band) => points.list.filter(({ target }) => viewport.isInside(target as Vector2, band)).map((p) => p.id),
      click,
      end: () => {
        if (points.selected.size === 0 && !points.isLocked) messages.hint("Double-click adds a point to drag", 5000);
      },
    });
  }

  /** A press on the picture that did not move. */
  #handleClick(shape: ShapeGrip | null, adds: boolean) {
    const { points, tools } = this.editor;
    if (adds) return;
    if (shape) this.#focusShape(shape);
    else {
      points.select([]);
      tools.shapes.choice.choose(null);
    }
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
    const { panels, stage, tools } = this.editor,
      at = stage.placeOf(event);
    if (this.pointers.has(event.pointerId)) {
      this.pointers.set(event.pointerId, at);
      this.gesture?.move(at, slackOf(this.kind), event);
    } else {
      tools.modes.activeTool?.hover?.(at);
      panels.status.pointAt(event.pointerType === "touch" ? null : at);
    }
  }

  #leave() {
    const {
      tools: { brush },
      panels: { status: statusLine },
    } = this.editor;
    statusLine.pointAt(null);
    if (brush.isOn && !this.gesture && !brush.isByKeys) brush.hover(null);
  }

  #up(event: PointerEvent, isCancelled = false) {
    const { gesture } = this,
      { stage } = this.editor;
    this.pointers.delete(event.pointerId);
    if (!gesture || (gesture instanceof PinchGesture && this.pointers.size > 0)) return;
    this.gesture = null;
    stage.element.classList.remove("dnb-ed-panning");
    gesture.end(isCancelled, stage.placeOf(event));
  }

  /** Cancel a drag (Escape). */
  cancel() {
    const { gesture } = this;
    this.gesture = null;
    gesture?.end(true, gesture.at);
    return gesture !== null;
  }

  #doubleClick(event: MouseEvent) {
    const { editor } = this,
      pen = editor.tools.pen;
    if (editor.tools.window.isOn) {
      editor.tools.window.reset();
      event.preventDefault();
      return;
    }
    const { activeTool, isSelecting } = editor.tools.modes;
    if (editor.points.isWaiting || (activeTool && activeTool !== pen) || isSelecting) return;
    const grabbed = this.editor.tools.hits.pointAt(event),
      shape = this.editor.tools.hits.shapeAt(event);
    if (pen.draft) pen.finish(pen.draft.tool === "part");
    else if (pen.hasEndedNow)
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
  #handleRightClick(id: number | null, shape: ShapeGrip | null) {
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

  /** Cancel the pending operations, one after the other; false where there are none. */
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
