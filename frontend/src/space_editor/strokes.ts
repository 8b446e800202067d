// Strokes of the brush in space, on the slice under the pointer: a ball around the place that is pressed.

import type { BrushHost } from "../editor/brush_tool.ts";
import { Stroke, volumeFrame } from "../maths/brushes.ts";
import { mirrorSide, projectOnAxis } from "../maths/points.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { Vector2, Vector3 } from "../types.ts";
import { SPACE_EDITOR_KEYS } from "../ui/keys.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

const SETTLES = 0.3; // of the radius: nearer than this to the plane of a mirror a new point snaps to it

/** Dependencies of strokes on the editor. */
export type SpaceStrokeEditor = SpaceParts<
  "model" | "frames" | "messages" | "row" | "points" | "edits" | "map" | "tools" | "cursor" | "foldStop" | "brush"
>;

export class SpaceStrokes implements BrushHost<Vector3> {
  readonly keys = SPACE_EDITOR_KEYS;
  #pane: SpacePane | null = null;
  #depth = 0; // of the stroke, in its picture
  #side = 0; // of the mirror on which it began

  constructor(readonly editor: SpaceStrokeEditor) {}

  get model() {
    return this.editor.model;
  }

  get frames() {
    return this.editor.frames;
  }

  get messages() {
    return this.editor.messages;
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

  get diagonal() {
    return volumeFrame(this.editor.cursor.panes[0]!).diagonal;
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

  begin(place: Vector3, radius: number, tool: string) {
    const { cursor, edits, map, messages, points, tools } = this.editor,
      { mirror } = tools;
    if (points.isLocked) return null;
    if (!map.isKnown) {
      messages.hint("Brushes work where points alone deform the volume: no cuts, no rigid parts, no fit forward", 5000);
      return null;
    }
    const { support } = map.settings,
      isNear = (at: Vector3) => mirror.on && mirrorSide(mirror, at, SETTLES * radius) === 0,
      stroke = new Stroke<Vector3>(
        points.list,
        place,
        radius,
        { tool, id: points.nextId() },
        {
          frame: volumeFrame(cursor.panes[0]!),
          reach: typeof support === "number" ? support : 0,
          sourceAt: (list) => map.sourceOf(list),
          settle: (at) => (isNear(at) ? projectOnAxis(mirror, at) : at),
        },
      );
    if (stroke.lockedBy) {
      tools.announceLocked(stroke.lockedBy.id);
      return null;
    }
    if (!stroke.isPossible) {
      messages.hint("There is nothing here to take hold of");
      return null;
    }
    this.#side = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    edits.beginDrag();
    return stroke;
  }

  /** Show the slices with a stroke as it is now; false where it must not continue. */
  paint(stroke: Stroke<Vector3>) {
    const { edits, foldStop, frames, points, tools } = this.editor;
    if (!edits.drag0) return false;
    const wanted = tools.symmetric(edits.drag0, stroke.points, this.#side);
    if (foldStop.refusesStroke(points.list, wanted)) {
      frames.invalidate();
      return false;
    }
    edits.show(wanted);
    return true;
  }

  end(isCancelled: boolean) {
    this.editor.edits.endDrag(isCancelled, "brush");
  }
}
