// Strokes of brushes on the control points of a picture.

import { pictureFrame } from "../maths/brushes.ts";
import { findConflicts } from "../maths/rigid_stages.ts";
import type { PicturePoint, Vector2 } from "../types.ts";
import { EDITOR_KEYS } from "../ui/keys.ts";
import type { EditorParts } from "./parts.ts";
import { StrokeHost } from "./stroke_host.ts";

/** Dependencies of strokes on the editor. */
export type PointStrokesEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "drag" | "foldStop" | "points"
>;

export class PointStrokes extends StrokeHost<Vector2> {
  readonly keys = EDITOR_KEYS;

  constructor(override readonly editor: PointStrokesEditor) {
    super(editor);
  }

  get stage() {
    return this.editor.stage;
  }

  get viewport() {
    return this.editor.viewport;
  }

  protected get spacing() {
    return Math.min(...this.editor.model.get("raster").spacing);
  }

  protected get mirror() {
    return this.editor.tools.points.mirror.state;
  }

  protected get around() {
    const { map, picture } = this.editor,
      { support } = map.settings;
    return {
      frame: pictureFrame(picture.box),
      reach: typeof support === "number" ? support : 0,
      sourceAt: (points: PicturePoint[]) => map.sourcesOf(points.some((p) => p.active) ? map.fitOf(points) : null),
    };
  }

  protected hintLocked(id: number) {
    this.editor.tools.points.hintLocked([id]);
  }

  protected beginDrag() {
    this.editor.tools.drag.beginDrag();
  }

  protected complete(points: PicturePoint[]) {
    const { drag, points: pointTools } = this.editor.tools;
    return drag.drag0 && pointTools.mirror.edit(drag.drag0, points, this.side);
  }

  protected show(points: PicturePoint[]) {
    const { editor } = this,
      { drag, foldStop } = editor.tools,
      {
        points: {
          shapes: { parts },
        },
        map: { strength },
      } = editor;
    const held = parts.length ? findConflicts(points, parts, strength) : [];
    if (held.length > findConflicts(drag.drag0 ?? [], parts, strength).length) {
      drag.hintConflict(held[held.length - 1]!);
      return false;
    }
    if (foldStop.refusesStroke(editor.points.list, points)) {
      editor.frames.invalidate();
      return false;
    }
    drag.follow(points);
    return true;
  }

  end(isCancelled: boolean) {
    this.editor.tools.drag.endDrag(isCancelled, "brush");
  }
}
