// The marks of tools that a press or a key moves: the axis of the mirror, the handle that turns, the arrows that swap
// sides.

import { formatLength } from "../maths/numbers.ts";
import type { Vector2 } from "../types.ts";
import { type Gesture, TurnGesture } from "./gesture.ts";
import { AxisGesture } from "./gestures.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the marks on the editor. */
export type GripEditor = EditorParts<
  "model" | "messages" | "viewport",
  "points" | "drag" | "turns" | "shapes",
  "marks"
>;

export class MarkGrips {
  constructor(readonly editor: GripEditor) {}

  /** The gesture of a press on a mark, or null. */
  grab(mark: string, at: Vector2): Gesture | null {
    const { layers, tools, viewport } = this.editor;
    if (mark === "axis") {
      layers.marks.grip.focus({ preventScroll: true });
      return new AxisGesture(at, tools.points.mirror, viewport);
    }
    if (mark === "turn") return this.#turn(at);
    if (mark === "swap") tools.shapes.turn();
    return null;
  }

  #turn(at: Vector2) {
    const { tools, viewport } = this.editor,
      { drag, turns } = tools,
      turn = turns.begin();
    if (!turn) return null;
    return new TurnGesture(
      at,
      viewport.toView(turn.about),
      (angle, factor) => turns.turnTo(turn, angle, factor),
      (isCancelled, kind) => drag.endDrag(isCancelled, kind),
    );
  }

  /** Handle a key on a mark; returns whether it is one of the mark. */
  key(mark: string | null, { key, shiftKey }: KeyboardEvent, arrow: Vector2 | undefined) {
    if (mark === "swap" && (key === "Enter" || key === " ")) this.editor.tools.shapes.turn();
    else if (mark === "axis" && arrow) this.#moveAxis(arrow, shiftKey ? 10 : 1);
    else return false;
    return true;
  }

  #moveAxis(arrow: Vector2, pixels: number) {
    const { editor } = this,
      { points: pointTools } = editor.tools,
      {
        mirror: { state: mirror },
      } = pointTools,
      c = mirror.axis === "a" ? 0 : 1;
    pointTools.mirror.moveAxis(mirror.at + pixels * arrow[c] * editor.model.get("raster").spacing[c], true);
    editor.messages.announce(`axis at ${formatLength(pointTools.mirror.state.at)}`);
  }
}
