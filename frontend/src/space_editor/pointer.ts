// Pointer and wheel over a picture of the editor in space: which gesture a press begins.

import type { Gesture, GrabbedPoint } from "../editor/gesture.ts";
import { BandGesture, keepPage, PanGesture, PointsGesture, TapGesture, TurnGesture } from "../editor/gesture.ts";
import { BrushGesture, PartGesture } from "../editor/gestures.ts";
import { isRightClick, WheelSteps } from "../editor/handles.ts";
import { shapeGrip } from "../editor/hit_test.ts";
import type { PartHandle } from "../editor/motion_handles.ts";
import type { Chosen } from "../editor/shape_handles.ts";
import { middleOf } from "../maths/points.ts";
import { toPane } from "../maths/space.ts";
import type { Vector2 } from "../types.ts";
import { slackOf, targetOf } from "../ui/dom.ts";
import { elementUnder, grabNearest } from "../ui/fingers.ts";
import { CrossGesture, DraftGesture, MirrorGesture, SliceWindowGesture } from "./gestures.ts";
import type { SpacePane } from "./pane.ts";
import { LINES } from "./pane_marks.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the pointers on the editor. */
export type SpacePointerEditor = SpaceParts<
  | "frames"
  | "messages"
  | "row"
  | "points"
  | "edits"
  | "tools"
  | "brush"
  | "strokes"
  | "modes"
  | "cursor"
  | "status"
  | "shapes"
>;

const sameChoice = (a: Chosen, b: Chosen | null) => a.what === b?.what && a.index === b.index;

/**
 * Pointers of one picture: points, the cross-hair, and the view with the middle button or with the space bar held.
 */
export class PaneGestures {
  gesture: Gesture | null = null;
  pointer = 0; // id of that of the gesture

  /** The place of the stage on the screen; during a gesture, reading it takes 0.5 ms. */
  box: DOMRect | null = null;

  isOthers = false; // whether a finger is on a picture of an editor without the focus
  wheelSteps = new WheelSteps();

  constructor(
    readonly editor: SpacePointerEditor,
    readonly pane: SpacePane,
  ) {
    const { frames, row } = editor,
      { stage, svg } = pane,
      { signal } = row.closing;
    const options = { signal },
      active = { signal, passive: false };
    grabNearest(svg, signal);
    frames.listen(svg, "pointerdown", (e) => this.#down(e), options);
    frames.listen(svg, "pointermove", (e) => this.#move(e), options);
    frames.listen(svg, "pointerup", (e) => this.#up(e), options);
    frames.listen(svg, "pointercancel", (e) => this.#up(e, true), options);
    frames.listen(svg, "lostpointercapture", (e) => this.#up(e, true), options);
    frames.listen(svg, "pointerleave", () => this.#leave(), options);
    frames.listen(svg, "dblclick", (e) => this.#doubleClick(e), options);
    frames.listen(svg, "contextmenu", (e) => this.#contextMenu(e), options);
    frames.listen(svg, "touchmove", (e) => keepPage(e, this.gesture), active);
    frames.listen(stage, "wheel", (e) => this.#wheel(e), active);
    const forget = () => {
      this.box = null;
    };
    for (const name of ["scroll", "resize"]) window.addEventListener(name, forget, { signal, capture: true });
  }

  #placeOf(event: MouseEvent): Vector2 {
    if (!this.gesture) this.box = null;
    this.box ??= this.pane.stage.getBoundingClientRect();
    return [event.clientX - this.box.left, event.clientY - this.box.top];
  }

  /** The element under the pointer. Clicks of a captured pointer go to the element that has captured it. */
  #elementAt(event: MouseEvent) {
    const isClick = event.type === "dblclick" || event.type === "contextmenu";
    return isClick ? elementUnder(this.pane.svg, event) : targetOf(event);
  }

  /** The point under the pointer, or null. */
  #pointAt(event: MouseEvent): GrabbedPoint | null {
    const found = this.#elementAt(event)?.closest("[data-id], [data-source], [data-line]");
    const id = found?.getAttribute("data-id"),
      source = found?.getAttribute("data-source");
    if (id) return { id: Number(id), what: "target" };
    return source ? { id: Number(source), what: "source" } : null;
  }

  /** The line of the cross-hair under the pointer, or null. */
  #lineAt(event: MouseEvent) {
    const name = targetOf(event).closest("[data-line]")?.getAttribute("data-line");
    return LINES.find((line) => line === name) ?? null;
  }

  #down(event: PointerEvent) {
    const { points, row } = this.editor,
      at = this.#placeOf(event);
    if (points.isWaiting || this.gesture) return;
    this.isOthers = event.pointerType === "touch" && !row.isInUse; // before this press gives it the focus
    this.pane.svg.setPointerCapture(event.pointerId);
    event.preventDefault();
    this.pointer = event.pointerId;
    this.gesture = this.#begin(event, at);
  }

  /** The gesture that a press begins, or null. */
  #begin(event: PointerEvent, at: Vector2): Gesture | null {
    const { brush, cursor, messages, modes, points, shapes, strokes, tools } = this.editor,
      { pane } = this,
      hit = this.#pointAt(event);
    const mark = targetOf(event).closest("[data-mark]")?.getAttribute("data-mark");
    if (event.button === 1 || (event.button === 0 && modes.isSpaceDown)) return new PanGesture(at, pane.viewport);
    if (event.button === 2 && event.pointerType !== "touch") return this.#rightPress(at, hit);
    if (event.button !== 0) return null;
    if (mark === "axis") {
      pane.marks.grip.focus({ preventScroll: true });
      return new MirrorGesture(at, pane, tools);
    }
    if (shapes.pen.isOn) {
      pane.stage.focus({ preventScroll: true });
      const what = targetOf(event).closest("[data-draft]")?.getAttribute("data-draft") ?? null;
      return new DraftGesture(at, pane, shapes.pen, what);
    }
    if (brush.isOn) {
      pane.stage.focus({ preventScroll: true });
      strokes.enter(pane);
      return new BrushGesture(at, brush, event.pointerType === "touch");
    }
    if (mark === "turn") return this.#turn(at);
    const shape = hit || modes.isAdding || modes.isSelecting ? null : shapeGrip(event, shapes.choice.chosen),
      isChosen = shape !== null && sameChoice(shape.chosen, shapes.choice.chosen);
    if (shape?.handle && isChosen && shapes.moves.isOn) return this.#grabPart(at, shape.handle);
    if (hit) return this.#grab(event, hit, at);
    if (modes.isAdding) {
      const id = tools.addAt(pane, at);
      if (id !== null) return this.#grab(event, { id, what: "target", isNew: true }, at);
      points.select([]);
      return null;
    }
    const release = (isClick: boolean) => {
      if (isClick) {
        points.select([]);
        if (shape || shapes.choice.chosen) shapes.choice.choose(shape?.chosen ?? null);
      }
      cursor.rest();
    };
    if (this.isOthers) {
      const advise = () => messages.hint("Tap a picture first, then a finger moves its cross-hair");
      return new TapGesture(at, advise, () => {
        pane.stage.focus({ preventScroll: true });
        pane.moveCross(at, null, false);
        release(true);
      });
    }
    pane.stage.focus({ preventScroll: true });
    if (!event.shiftKey && !modes.isSelecting) return new CrossGesture(at, pane, this.#lineAt(event), release);
    return new BandGesture(at, points, true, {
      show: (band) => pane.handles.showBand(band),
      inside: (band) => pane.pointsInside(band),
    });
  }

  /** A right click deletes the point under it; a drag changes the window of the slices. */
  #rightPress(at: Vector2, hit: GrabbedPoint | null) {
    const { cursor, status, tools } = this.editor,
      { window } = status.facts;
    if (!window || !cursor.isSlice) return null;
    return new SliceWindowGesture(
      at,
      window,
      (to, isMoving) => cursor.setWindow(to, isMoving),
      () => hit && tools.remove([hit.id]),
    );
  }

  /** A press on the chosen rigid part. */
  #grabPart(at: Vector2, handle: PartHandle) {
    const { frames, shapes } = this.editor,
      { pane } = this;
    frames.drawNow();
    if (handle !== "move") pane.parts.motion.focus(handle);
    else if (shapes.choice.chosen) pane.parts.shapes.focus(shapes.choice.chosen);
    return new PartGesture(at, shapes.moves.enter(pane), handle);
  }

  #turn(at: Vector2) {
    const { edits, points, tools } = this.editor,
      { pane } = this,
      ids = tools.beginTurn();
    if (!ids) return null;
    const turned = points.list.filter((p) => ids.includes(p.id));
    const about = middleOf(turned.map((p) => ({ target: toPane(pane.info, p.target) })));
    return new TurnGesture(
      at,
      pane.viewport.toView(about),
      (angle, factor) => tools.turnTo(pane, ids, angle, factor),
      (isCancelled, kind) => edits.endDrag(isCancelled, kind),
    );
  }

  #grab(event: PointerEvent, grabbed: GrabbedPoint, at: Vector2) {
    const { edits, modes, points, tools } = this.editor,
      { pane } = this;
    const made = new PointsGesture(event, at, grabbed, points, modes.isSelecting, {
      beginDrag: () => edits.beginDrag(),
      drag: (ids, by, what, id, isLoose) => tools.drag(pane, ids, by, what, id, isLoose),
      endDrag: (isCancelled) => edits.endDrag(isCancelled),
    });
    pane.handles.focus(grabbed.id);
    return made;
  }

  #move(event: PointerEvent) {
    const at = this.#placeOf(event);
    if (this.gesture && this.pointer === event.pointerId) this.gesture.move(at, slackOf(event.pointerType), event);
    else if (!this.gesture) {
      const { brush, status, strokes } = this.editor;
      strokes.enter(this.pane);
      if (brush.isOn) brush.hover(at);
      status.showValue(event.pointerType === "touch" ? null : this.pane.valueAt(at));
    }
  }

  #up(event: PointerEvent, isCancelled = false) {
    const { gesture } = this;
    if (!gesture || this.pointer !== event.pointerId) return;
    this.gesture = null;
    gesture.end(isCancelled, gesture.at);
  }

  #leave() {
    const { brush, status } = this.editor;
    status.showValue(null);
    if (!this.gesture && brush.isOn) brush.leave();
  }

  /** Undo the drag so far (Escape). Returns whether there was one. */
  cancel() {
    const { gesture } = this;
    this.gesture = null;
    gesture?.end(true, gesture.at);
    return gesture !== null;
  }

  #doubleClick(event: MouseEvent) {
    const { brush, cursor, modes, points, shapes, tools } = this.editor;
    if (points.isWaiting || modes.isSelecting || brush.isOn || shapes.pen.isOn) return;
    const hit = this.#pointAt(event),
      shape = hit ? null : shapeGrip({ target: this.#elementAt(event) }, shapes.choice.chosen);
    if (hit) cursor.goTo(hit.id);
    else if (shape && !shape.handle) shapes.rename(this.pane);
    else tools.addAt(this.pane, this.#placeOf(event));
    event.preventDefault();
  }

  #contextMenu(event: MouseEvent) {
    event.preventDefault();
    const hit = this.#pointAt(event);
    if (hit && isRightClick(event) && !this.editor.cursor.isSlice) this.editor.tools.remove([hit.id]);
  }

  /** Scroll through the slices, with Ctrl zoom. The wheel scrolls the page until the editor has the focus. */
  #wheel(event: WheelEvent) {
    const { brush, cursor, messages, row } = this.editor,
      { info, viewport } = this.pane,
      isZoom = event.ctrlKey || event.metaKey;
    if (!isZoom && !row.isInUse) {
      messages.hint("Click a picture to go through its slices with the wheel");
      return;
    }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1,
      [x, y] = this.#placeOf(event);
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (brush.isOn && !isZoom) {
      brush.grow(-delta / 60);
      return;
    }
    if (isZoom || !cursor.isSlice) {
      viewport.zoomAt(Math.exp(-delta * 0.004), x, y);
      return;
    }
    const steps = this.wheelSteps.add(delta);
    if (steps !== 0) cursor.scroll(info, steps);
  }
}
