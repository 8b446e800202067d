// The wheel over the editor's picture: it zooms, scrolls through the slices, or changes the brush.

import { WheelSteps } from "./handles.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the wheel on the editor. */
export type WheelEditor = EditorParts<"frames" | "messages" | "stage" | "viewport" | "points" | "picture", "brush">;

export class Wheel {
  #steps = new WheelSteps();

  constructor(readonly editor: WheelEditor) {
    const { element, closing } = editor.stage,
      options = { signal: closing.signal, passive: false };
    element.addEventListener("wheel", (e) => editor.frames.guard(() => this.#turn(e)), options);
  }

  /** Leave the wheel to the scrolling page until the editor has the focus. */
  #turn(event: WheelEvent) {
    const { editor } = this,
      [x, y] = editor.stage.placeOf(event),
      isWanted = event.ctrlKey || event.metaKey || editor.stage.isInUse;
    if (!isWanted) {
      editor.messages.hint(
        editor.picture.slices.current
          ? "Click the picture to go through the slices with the wheel, or hold Ctrl to zoom"
          : "Click the picture, or hold Ctrl, to zoom with the wheel",
      );
      return;
    }
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    if (editor.tools.brush.isOn && !event.ctrlKey && !event.metaKey) {
      editor.tools.brush.grow(-delta / 60);
      return;
    }
    if (editor.picture.slices.current && !event.ctrlKey && !event.metaKey) {
      const steps = this.#steps.add(delta);
      if (steps !== 0) editor.picture.slices.move(steps, editor.points.isDragging);
      return;
    }
    editor.viewport.zoomAt(Math.exp(-delta * (event.ctrlKey ? 0.01 : 0.0022)), x, y);
  }
}
