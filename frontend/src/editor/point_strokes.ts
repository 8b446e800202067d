// Strokes of brushes, which move control points.

import { pictureFrame, Stroke } from "../maths/brushes.ts";
import { mirrorSide, projectOnAxis } from "../maths/points.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import type { Vector2 } from "../types.ts";
import { EDITOR_KEYS } from "../ui/keys.ts";
import type { BrushHost } from "./brush_tool.ts";
import type { EditorParts } from "./parts.ts";

const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point snaps to it

/** Dependencies of strokes on the editor. */
export type StrokeEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "drag" | "foldStop" | "points"
>;

export class PointStrokes implements BrushHost<Vector2> {
  readonly keys = EDITOR_KEYS;
  #side = 0; // of the mirror on which the stroke began

  constructor(readonly editor: StrokeEditor) {}

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
    return this.editor.stage;
  }

  get viewport() {
    return this.editor.viewport;
  }

  get diagonal() {
    return pictureFrame(this.editor.picture.box).diagonal;
  }

  end(isCancelled: boolean) {
    this.editor.tools.drag.endDrag(isCancelled, "brush");
  }

  /** Begin a stroke; null and a hint where none can begin. */
  begin(place: Vector2, radius: number, tool: string) {
    const { editor } = this,
      { drag, points: pointTools } = editor.tools,
      { state: mirror } = pointTools.mirror,
      settings = editor.map.settings;
    if (editor.points.isLocked) return null;
    const isNear = (at: Vector2) => mirror.on && mirrorSide(mirror, at, BRUSH_SETTLES * radius) === 0;
    const id = editor.points.nextId();
    const stroke = new Stroke<Vector2>(
      editor.points.list,
      place,
      radius,
      { tool, id },
      {
        frame: pictureFrame(editor.picture.box),
        reach: typeof settings.support === "number" ? settings.support : 0,
        sourceAt: (points) => editor.map.sourcesOf(points.some((p) => p.active) ? editor.map.fitOf(points) : null),
        settle: (at) => (isNear(at) ? projectOnAxis(mirror, at) : at),
      },
    );
    if (stroke.lockedBy) {
      pointTools.hintLocked([stroke.lockedBy.id]);
      return null;
    }
    if (!stroke.isPossible) {
      editor.messages.hint("There is nothing here to take hold of");
      return null;
    }
    this.#side = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    drag.beginDrag();
    return stroke;
  }

  /** Show the picture with a stroke as it is now; false where it must not continue. */
  paint(stroke: Stroke<Vector2>) {
    const { editor } = this,
      { drag, points: pointTools } = editor.tools,
      { drag0 } = drag;
    if (!drag0) return false;
    const points = pointTools.mirror.edit(drag0, stroke.points, this.#side),
      {
        points: {
          shapes: { parts },
        },
        map: { strength },
      } = editor;
    const held = parts.length ? findConflicts(points, parts, strength) : [];
    if (held.length > findConflicts(drag0, parts, strength).length) {
      drag.hintConflict(held[held.length - 1]!);
      return false;
    }
    if (editor.tools.foldStop.refusesStroke(editor.points.list, points)) {
      editor.frames.invalidate();
      return false;
    }
    drag.follow(points);
    return true;
  }
}
