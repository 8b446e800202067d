// Strokes of the brush in space, on the slice under the pointer: a ball around the place that is pressed.

import { StrokeHost } from "../editor/stroke_host.ts";
import { volumeFrame } from "../maths/brushes.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { SpacePoint, Vector2, Vector3 } from "../types.ts";
import { SPACE_EDITOR_KEYS } from "../ui/keys.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of strokes on the editor. */
export type SpaceStrokeEditor = SpaceParts<
  "model" | "frames" | "messages" | "row" | "points" | "edits" | "map" | "tools" | "cursor" | "foldStop" | "brush"
>;

export class SpaceStrokes extends StrokeHost<Vector3> {
  readonly keys = SPACE_EDITOR_KEYS;
  #pane: SpacePane | null = null;
  #depth = 0; // of the stroke, in its picture

  constructor(override readonly editor: SpaceStrokeEditor) {
    super(editor);
  }

  get stage() {
    return this.editor.row;
  }

  /** The picture that the pointer is over, or that has the focus. */
  get pane() {
    const { row } = this.editor;
    return this.#pane ?? row.paneOf(document.activeElement);
  }

  /** Of the picture under the pointer; its places are in the volume. */
  get viewport() {
    return { view: this.pane.viewport.view, placeAt: (at: Vector2) => this.#placeAt(at) };
  }

  /** The circle of the brush as it is seen in a picture. */
  circleIn(pane: SpacePane) {
    const { isOn, at, radius } = this.editor.brush;
    return { isOn, at: this.pane === pane ? at : null, radius };
  }

  /** The pointer is over a picture. */
  enter(pane: SpacePane) {
    if (!this.editor.brush.stroke) this.#pane = pane;
  }

  #placeAt(at: Vector2): Vector3 {
    const { pane } = this,
      [a, b] = pane.viewport.placeAt(at);
    if (!this.editor.brush.stroke) this.#depth = toPane(pane.info, pane.under(at))[2];
    return fromPane(pane.info, [a, b, this.#depth]);
  }

  protected get spacing() {
    return Math.min(...this.editor.cursor.panes[0]!.spacing);
  }

  protected get mirror() {
    return this.editor.tools.mirror;
  }

  protected get around() {
    const { cursor, map } = this.editor,
      { support } = map.settings;
    return {
      frame: volumeFrame(cursor.panes[0]!),
      reach: typeof support === "number" ? support : 0,
      sourceAt: (points: SpacePoint[]) => map.sourceOf(points),
    };
  }

  protected override get refusal() {
    if (this.editor.map.isKnown) return "";
    return "Brushes work where points alone deform the volume: no cuts, no rigid parts, no fit forward";
  }

  protected hintLocked(id: number) {
    this.editor.tools.announceLocked(id);
  }

  protected beginDrag() {
    this.editor.edits.beginDrag();
  }

  protected complete(points: SpacePoint[]) {
    const { edits, tools } = this.editor;
    return edits.drag0 && tools.symmetric(edits.drag0, points, this.side);
  }

  protected show(points: SpacePoint[]) {
    const { edits, foldStop, frames, points: edited } = this.editor;
    if (foldStop.refusesStroke(edited.list, points)) {
      frames.invalidate();
      return false;
    }
    edits.show(points);
    return true;
  }

  end(isCancelled: boolean) {
    this.editor.edits.endDrag(isCancelled, "brush");
  }
}
