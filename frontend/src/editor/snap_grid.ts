// The grid to whose nodes targets snap.

import { formatLength } from "../maths/numbers.ts";
import { setTrait } from "../sync/edits.ts";
import type { Vector2 } from "../types.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the grid on the editor. */
export type SnapEditor = EditorParts<"model" | "messages" | "picture">;

export class SnapGrid {
  constructor(readonly editor: SnapEditor) {}

  /** A cell of the grid that is drawn. */
  get #cell() {
    const [a0, a1, b0, b1] = this.editor.picture.box;
    return Math.max(a1 - a0, b1 - b0) / (this.editor.model.get("density") || 16);
  }

  /** The distance of its nodes; 0 where targets do not snap. */
  get step() {
    return Number(this.editor.model.get("snap")) || 0;
  }

  toggle() {
    const { messages, model } = this.editor;
    setTrait(model, "snap", this.step > 0 ? 0 : this.#cell);
    const { step } = this;
    if (step > 0) messages.hint(`Targets snap to a grid of ${formatLength(step)}; hold Alt to go between`, 4000);
  }

  /** The next node; the drawn grid fills the box with whole cells, which may be a little larger or smaller. */
  placeOf([a, b]: Vector2): Vector2 {
    const { step } = this,
      cell = this.#cell,
      [a0, a1, b0, b1] = this.editor.picture.box;
    if (!(step > 0)) return [a, b];
    const isDrawn = Math.abs(step - cell) < 1e-6 * cell;
    const whole = (length: number) => (isDrawn ? length / Math.max(1, Math.round(length / step)) : step);
    const [da, db] = [whole(a1 - a0), whole(b1 - b0)];
    return [a0 + da * Math.round((a - a0) / da), b0 + db * Math.round((b - b0) / db)];
  }
}
