// The shape that is chosen in the editor: a cut, a rigid part, or a fixed side.

import { motionWords, shapeName, shapeRecord, swapRegionSides, trackShape } from "../maths/shapes.ts";
import type { Sender } from "../sync/edits.ts";
import type { Model, ShapeData, Shapes, Vector } from "../types.ts";
import type { EditedPoints } from "./edited_points.ts";
import type { Frames } from "./frames.ts";
import type { Chosen } from "./shape_handles.ts";

/** Dependencies of the choice on the editor. */
export interface ChoiceEditor {
  model: Model;
  sender: Pick<Sender, "choose" | "isBehind">;
  frames: Frames;
  points: Pick<EditedPoints<Vector>, "shapes" | "isDragging" | "select" | "onSelect">;
}

export class ShapeChoice {
  /** The list in which it is, and its place there. */
  chosen: Chosen | null = null;

  /** @param wordsOf the motion of a part */
  constructor(
    readonly editor: ChoiceEditor,
    private readonly wordsOf = motionWords,
  ) {
    editor.points.onSelect = () => this.choose(null);
  }

  get shape(): ShapeData | null {
    return this.chosen ? (this.editor.points.shapes[this.chosen.what]?.[this.chosen.index] ?? null) : null;
  }

  /** The name of the chosen shape and its motion, "" for none. */
  get name() {
    const { chosen, shape } = this;
    if (!chosen || !shape) return "";
    const motion = "motion" in shape ? this.wordsOf(shape) : "";
    return [shapeName(shape, chosen.what, chosen.index), shape.enabled ? motion : "off"].filter(Boolean).join(": ");
  }

  /** Whether the chosen shape is a fixed side. */
  get isSide() {
    const { shape } = this;
    return shape !== null && "motion" in shape && !shape.motion && shape.region.kind === "half_space";
  }

  /** Whether the chosen shape has two sides to swap. */
  get canTurn() {
    return this.shape !== null && swapRegionSides(this.shape.region) !== null;
  }

  /** Whether the chosen shape is a cut with ends. */
  get canStop() {
    return this.chosen?.what === "cuts" && this.shape?.region.kind === "line";
  }

  choose(chosen: Chosen | null) {
    const { frames, points, sender } = this.editor,
      was = JSON.stringify(this.chosen);
    const shape = chosen ? points.shapes[chosen.what]?.[chosen.index] : null;
    this.chosen = chosen && shape ? { what: chosen.what, index: chosen.index } : null;
    if (this.chosen) points.select([]);
    if (JSON.stringify(this.chosen) !== was) {
      sender.choose(this.chosen && shape ? { ...this.chosen, shape: shapeRecord(shape) } : null);
    }
    frames.invalidate();
  }

  /** Find the chosen shape in new lists. */
  follow(shapes: Shapes) {
    const { chosen } = this;
    const index = chosen && trackShape(this.editor.points.shapes[chosen.what], shapes[chosen.what], chosen.index);
    this.chosen = chosen && index !== null ? { what: chosen.what, index } : null;
  }

  /** Take Python's choice, once it has received ours: a list next to the picture has chosen, or another window. */
  receive() {
    const { frames, model, points, sender } = this.editor;
    if (sender.isBehind() || points.isDragging) return;
    const { what, index } = (model.get("chosen_shape") ?? {}) as Partial<Chosen>;
    const chosen = what && index !== undefined && points.shapes[what]?.[index] ? { what, index } : null;
    if (JSON.stringify(chosen) === JSON.stringify(this.chosen)) return;
    this.chosen = chosen;
    if (chosen) points.select([]);
    frames.invalidate();
  }
}
