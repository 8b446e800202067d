// The rigid parts over one of the three pictures, the handles of the chosen one, and one that is being drawn.

import { MotionHandles } from "../editor/motion_handles.ts";
import type { View } from "../editor/painter.ts";
import { ShapeHandles } from "../editor/shape_handles.ts";
import { twistOf } from "../maths/space_parts.ts";
import { DraftMarks } from "./draft_marks.ts";
import type { SpaceParts } from "./parts.ts";
import type { PaneInSpace } from "./shapes.ts";

export class PaneRigidParts {
  shapes: ShapeHandles;
  motion: MotionHandles;
  #draft: DraftMarks;

  constructor(
    readonly editor: SpaceParts<"modes" | "shapes">,
    readonly pane: PaneInSpace & { readonly svg: SVGSVGElement },
  ) {
    this.shapes = new ShapeHandles(pane.svg);
    this.motion = new MotionHandles(pane.svg, this.shapes.grips);
    this.#draft = new DraftMarks(pane.svg);
  }

  /** The distance of the two places that determine the line of a half space. */
  get reach() {
    const [a0, a1, b0, b1] = this.pane.info.box;
    return Math.hypot(a1 - a0, b1 - b0) / 8;
  }

  /** Draw all. True if the focus was on something that is gone. */
  draw(view: View) {
    const {
        modes: { isAdding, isSelecting },
        shapes: { choice, moves, own, pen },
        shapes,
      } = this.editor,
      { pane } = this,
      parts = shapes.onSlice(pane),
      chosen = choice.chosen?.what === "parts" ? choice.chosen : null;
    this.#draft.draw(pen.onSlice(pane), view);
    const isLost = this.shapes.update({ cuts: [], parts }, chosen, view, {
      reach: this.reach,
      isLocked: true, // a slice has no corners to drag
      isBefore: false,
      sideKey: () => 0,
    });
    const isHeld = own && moves.isOn && !isAdding && !isSelecting && !pen.isOn,
      held = isHeld && this.shapes.isSeen("parts", own.index) ? own : null,
      angle = held ? twistOf(held.part, pane.info.n) : 0;
    return this.motion.update(held ? parts[held.index]! : null, held?.index ?? 0, view, angle) || isLost;
  }
}
