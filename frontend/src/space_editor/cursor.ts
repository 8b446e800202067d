// The place at which the slices meet.

import { nameOf } from "../maths/point_names.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { PaneInfo, Vector2, Vector3 } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

export class SliceCursor {
  place: Vector3;

  /** The pictures in space. */
  panes: PaneInfo[];

  constructor(readonly editor: SpaceParts<"model" | "frames" | "messages" | "points" | "requests">) {
    const { model } = editor;
    this.panes = model.get("panes");
    const [x, y, z]: Vector3 = model.get("cursor");
    this.place = [x, y, z];
  }

  get isSlice() {
    return this.editor.model.get("projection") === "slice";
  }

  /** The unit of lengths; "" where it is not known. */
  get unit(): string {
    return this.editor.model.get("unit") ?? "";
  }

  receive() {
    const { frames, model, requests } = this.editor,
      place: Vector3 = model.get("cursor");
    if (requests.knows(place)) return;
    this.place = [...place];
    frames.invalidate();
  }

  /** Request full pictures where it rests. */
  rest() {
    if (this.isSlice) this.editor.requests.look({ cursor: this.place });
  }

  /** @param place which is clamped to the volume */
  set(place: Vector3, isMoving: boolean) {
    this.place = this.panes.reduce<Vector3>((at, pane) => {
      const [a, b, c] = toPane(pane, at),
        [low, high] = pane.depths;
      return c < low || c > high ? fromPane(pane, [a, b, Math.max(low, Math.min(high, c))]) : at;
    }, place);
    this.editor.requests.look({ cursor: this.place }, isMoving);
    this.editor.frames.invalidate();
  }

  /** Show other values as black and white. */
  setWindow(window: Vector2, isMoving: boolean) {
    this.editor.requests.look({ window }, isMoving);
  }

  /** The depth of the slice of a picture. */
  depthIn(pane: PaneInfo) {
    return toPane(pane, this.place)[2];
  }

  setDepth(pane: PaneInfo, depth: number) {
    const [a, b] = toPane(pane, this.place);
    this.set(fromPane(pane, [a, b, depth]), true);
  }

  scroll(pane: PaneInfo, slices: number) {
    const {
      depths: [first],
      spacing,
    } = pane;
    const now = Math.round((this.depthIn(pane) - first) / spacing[2]);
    this.setDepth(pane, first + (now + slices) * spacing[2]);
    this.rest();
  }

  /** Move the slices to a point. */
  goTo(id: number) {
    const { messages, points } = this.editor,
      p = points.withId(id);
    if (!p) return;
    points.select([id]);
    const [x, y, z] = p.target;
    this.set([x, y, z], false);
    messages.announce(`slices at ${nameOf(p, points.numberOf(id))}`);
  }
}
