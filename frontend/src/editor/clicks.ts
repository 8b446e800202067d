// Clicks on points and shapes, and presses on the chosen shape.

import type { Vector2 } from "../types.ts";
import type { Gesture } from "./gesture.ts";
import { PartGesture, ShapeGesture, WindowGesture } from "./gestures.ts";
import { isRightClick } from "./handles.ts";
import type { ShapeGrip } from "./hit_test.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of clicks on the editor. */
export type ClickEditor = EditorParts<
  "frames" | "stage" | "points",
  "hits" | "modes" | "pen" | "window" | "points" | "shapes" | "parts"
>;

export class Clicks {
  constructor(readonly editor: ClickEditor) {}

  /** A press on the picture that did not move. */
  handle(shape: ShapeGrip | null, adds: boolean) {
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
  chosenShapeAt(event: Event) {
    const { hits, modes, parts, shapes } = this.editor.tools,
      { chosen } = shapes.choice;
    const grip = modes.isAdding || modes.isSelecting ? null : hits.shapeAt(event);
    if (grip?.handle && !parts.isOn) return null;
    return grip && chosen?.what === grip.chosen.what && chosen.index === grip.chosen.index ? grip : null;
  }

  /** A press on the chosen shape. */
  grab(at: Vector2, grip: ShapeGrip): Gesture {
    const { parts, shapes } = this.editor.tools;
    this.#focusShape(grip);
    return grip.handle ? new PartGesture(at, parts, grip.handle) : new ShapeGesture(at, shapes, grip);
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

  doubleClick(event: MouseEvent) {
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
    else if (pen.hasEndedAt(editor.stage.placeOf(event)))
      return; // its first press has ended the line
    else if (grabbed) editor.tools.points.rename(grabbed.id);
    else if (shape && shape.corner !== null && editor.tools.shapes.toggleStop(shape.corner)) {
      /* it is done */
    } else if (shape && !shape.handle) editor.tools.shapes.rename();
    else editor.tools.points.addAt(this.editor.stage.placeOf(event), event.altKey);
    event.preventDefault();
  }

  /** A press of the right button: its drag changes the window. Some systems ask for the menu at the press. */
  rightPress(event: PointerEvent, at: Vector2) {
    const { hits, window } = this.editor.tools,
      id = hits.pointAt(event)?.id ?? null,
      shape = id === null ? hits.shapeAt(event) : null;
    return new WindowGesture(at, window, isRightClick(event) ? () => this.#handleRightClick(id, shape) : null);
  }

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
}
