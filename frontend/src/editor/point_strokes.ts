// Strokes of brushes, which move control points.

import { Stroke } from "../maths/brushes.ts";
import { mirrorSide, projectOnAxis } from "../maths/points.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import type { Vector2 } from "../types.ts";
import type { EditorParts } from "./parts.ts";

const BRUSH_SETTLES = 0.3; // of the radius: nearer than this to a mirror's axis a new point snaps to it

/** Dependencies of strokes on the editor. */
export type StrokeEditor = EditorParts<
  "frames" | "messages" | "points" | "map" | "picture",
  "drag" | "foldStop" | "points"
>;

export class PointStrokes {
  #side = 0; // of the mirror on which the stroke began

  constructor(readonly editor: StrokeEditor) {}

  /** Begin a stroke; null and a hint where none can begin. */
  begin(place: Vector2, radius: number, tool: string) {
    const { editor } = this,
      { drag, points: pointTools } = editor.tools,
      { state: mirror } = pointTools.mirror,
      settings = editor.map.settings;
    if (editor.points.isLocked) return null;
    const isNear = (at: Vector2) => mirror.on && mirrorSide(mirror, at, BRUSH_SETTLES * radius) === 0;
    const id = editor.points.nextId();
    const stroke = new Stroke(
      editor.points.list,
      place,
      radius,
      { tool, id },
      {
        box: editor.picture.box,
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
  paint(stroke: Stroke) {
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
