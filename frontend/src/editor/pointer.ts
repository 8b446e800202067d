// Pointers over the picture of an editor: those that are down, and the gesture under way.

import type { Vector2 } from "../types.ts";
import { slackOf } from "../ui/dom.ts";
import { grabNearest } from "../ui/fingers.ts";
import { type Gesture, keepPage, PanGesture } from "./gesture.ts";
import { PinchGesture } from "./gestures.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the pointers on the editor. */
export type PointerEditor = EditorParts<
  "frames" | "stage" | "viewport" | "points",
  "presses" | "clicks" | "pen" | "modes" | "shapes",
  never,
  "status"
>;

/**
 * Pointers. The mouse drags points, draws a band or, with space or the middle button, moves the view. One
 * finger drags points and moves the view, or draws a band while several are selected; two fingers move and zoom it.
 * Until the editor has the focus, a finger beside what can be dragged scrolls the host page.
 */
export class Gestures {
  /** Places of the pointers that are down. */
  pointers: Map<number, Vector2> = new Map();

  gesture: Gesture | null = null;

  kind = "mouse"; // of the pointer that went down last

  isSpaceDown = false;

  constructor(readonly editor: PointerEditor) {
    const { frames } = editor,
      { svg, root, closing } = editor.stage,
      { signal } = closing,
      options = { signal };
    grabNearest(svg, signal);
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
    frames.listen(svg, "dblclick", (e) => editor.tools.clicks.doubleClick(e), options);
    frames.listen(svg, "contextmenu", (e) => this.#contextMenu(e), options);
    frames.listen(svg, "touchmove", (e) => keepPage(e, this.gesture), { signal, passive: false });
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
    const { points, stage, tools, viewport } = this.editor;
    if (points.isWaiting) return;
    const at = stage.placeOf(event);
    this.pointers.set(event.pointerId, at);
    this.kind = event.pointerType || "mouse";
    const isOthers = this.kind === "touch" && !stage.isInUse; // before this press gives it the focus
    stage.svg.setPointerCapture(event.pointerId);
    if (this.pointers.size === 2 && !this.gesture?.isHolding) {
      this.cancel();
      this.gesture = new PinchGesture(this.pointers, viewport);
      return;
    }
    if (this.gesture) return;
    event.preventDefault();
    const { isSpaceDown, kind } = this;
    this.gesture = tools.presses.begin({ event, at, isOthers, isSpaceDown, isFinger: kind === "touch" });
    stage.element.classList.toggle("dnb-ed-panning", this.gesture instanceof PanGesture && this.kind !== "touch");
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
    const { panels, tools } = this.editor;
    panels.status.pointAt(null);
    if (!this.gesture) tools.modes.activeTool?.leave?.();
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

  #contextMenu(event: MouseEvent) {
    event.preventDefault();
    event.stopPropagation();
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
