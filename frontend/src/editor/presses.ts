// Which gesture a press of a pointer begins.

import type { Vector2 } from "../types.ts";
import { BandGesture, type Gesture, type GrabbedPoint, PanGesture, PointsGesture, TapGesture } from "./gesture.ts";
import type { EditorParts } from "./parts.ts";

/** A press of a pointer at a place of the view. */
export interface Press {
  event: PointerEvent;
  at: Vector2;
  isFinger: boolean;
  /** Whether it belongs to the host page, which may scroll */
  isOthers: boolean;
  isSpaceDown: boolean;
}

/** Dependencies of presses on the editor. */
export type PressEditor = EditorParts<
  "messages" | "stage" | "viewport" | "points",
  "hits" | "modes" | "grips" | "clicks" | "points" | "drag",
  "handles"
>;

export class Presses {
  constructor(readonly editor: PressEditor) {}

  /** The gesture that a press begins, or null. */
  begin(press: Press): Gesture | null {
    const { event, at } = press,
      { stage, tools, viewport } = this.editor,
      { clicks, hits, modes, points } = tools;
    const grabbed = hits.pointAt(event),
      mark = hits.markAt(event),
      shape = grabbed ? null : clicks.chosenShapeAt(event);
    if (event.button === 1 || (event.button === 0 && press.isSpaceDown)) return new PanGesture(at, viewport);
    if (event.button === 2 && !press.isFinger) return clicks.rightPress(event, at);
    if (event.button !== 0) return null;
    const tool = modes.activeTool;
    if (tool && !tool.ignores?.(press.isOthers, mark)) {
      stage.focus();
      return tool.grab(at, press.isFinger);
    }
    if (mark) return tools.grips.grab(mark, at);
    if (shape) return clicks.grab(at, shape);
    if (grabbed) return this.#grab(event, grabbed, at);
    if (!modes.isAdding) return this.#pressPicture(press);
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
  #pressPicture({ event, at, isFinger, isOthers }: Press) {
    const { layers, messages, points, stage, tools, viewport } = this.editor,
      { clicks, hits, modes } = tools;
    if (!isOthers) stage.focus();
    const adds = modes.isSelecting || event.shiftKey || event.ctrlKey,
      shape = modes.isSelecting ? null : hits.shapeAt(event);
    const click = () => clicks.handle(shape, adds);
    if (isOthers) {
      const advise = () => messages.hint("Tap the picture first, then a finger moves it", 4000);
      return new TapGesture(at, advise, () => {
        stage.focus();
        click();
      });
    }
    if (isFinger && !modes.isSelecting) return new PanGesture(at, viewport, click);
    return new BandGesture(at, points, adds, {
      show: (band) => layers.handles.showBand(band),
      inside: (band) => points.list.filter(({ target }) => viewport.isInside(target, band)).map((p) => p.id),
      click,
      end: () => {
        if (points.selected.size === 0 && !points.isLocked)
          messages.hint("Double-click adds a point to drag; after A, press and drag in one go", 5000);
      },
    });
  }
}
