// The modes of the editor in space: adding and selecting.

import type { SpaceParts } from "./parts.ts";

export class SpaceModes {
  isAdding = false;
  isSelecting = false;
  isSpaceDown = false;

  constructor(readonly editor: SpaceParts<"frames" | "messages" | "points" | "row" | "help" | "brush" | "shapes">) {}

  /**
   * Switch a mode in which all that is dragged around or clicked is added to the selection: fingers have no Shift key.
   */
  setSelecting(isSelecting: boolean) {
    const { brush, frames, messages, shapes } = this.editor;
    if (isSelecting) {
      this.setAdding(false);
      brush.stop();
      shapes.pen.stop();
    }
    this.isSelecting = isSelecting;
    if (isSelecting) messages.hint("Drag a band around points, or tap one after the other. Esc when done", 4000);
    frames.invalidate();
  }

  setAdding(isAdding: boolean) {
    const { brush, frames, messages, points, row, shapes } = this.editor;
    if (isAdding) {
      this.setSelecting(false);
      brush.stop();
      shapes.pen.stop();
    }
    this.isAdding = isAdding && !points.isLocked;
    row.element.classList.toggle("dnb-ed-adding", this.isAdding);
    if (this.isAdding) messages.hint("Click where a feature is, and drag it. Esc when done");
    frames.invalidate();
  }

  /** Switch a brush on or off. */
  setBrush(tool: string) {
    const { brush, points, row, shapes } = this.editor,
      was = brush.tool;
    brush.stop();
    shapes.pen.stop();
    if (was === tool || points.isLocked) return;
    this.setAdding(false);
    this.setSelecting(false);
    points.select([]);
    brush.start(tool);
    row.focus();
  }

  /** Switch the pen for rigid parts on or off. */
  setPartPen() {
    const { brush, points, shapes } = this.editor;
    if (shapes.pen.stop() || points.isLocked) return;
    this.setAdding(false);
    this.setSelecting(false);
    brush.stop();
    points.select([]);
    shapes.pen.start();
  }

  /** Show or hide the list of keys. The focus moves to the list, and back to where it was. */
  toggleHelp() {
    this.editor.help.toggle();
    this.editor.frames.invalidate();
  }

  /** End a drag, the list of keys, a mode or the selection, one after the other; false where there is none. */
  escape() {
    const { brush, help, points, row, shapes } = this.editor;
    if (row.cancelGestures() || brush.stop() || shapes.pen.stop()) return true;
    if (help.isOpen) this.toggleHelp();
    else if (this.isAdding || this.isSelecting) {
      this.setAdding(false);
      this.setSelecting(false);
    } else if (points.selected.size > 0) points.select([]);
    else if (shapes.choice.chosen) shapes.choice.choose(null);
    else return false;
    return true;
  }
}
