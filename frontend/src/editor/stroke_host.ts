// Strokes of brushes on control points, of a picture or in space: what both have in common.

import { Stroke, type StrokeSurroundings } from "../maths/brushes.ts";
import { mirrorSide, projectOnAxis } from "../maths/points.ts";
import type { Mirror, Model, Point, Vector } from "../types.ts";
import type { KeyTable } from "../ui/keys.ts";
import type { BrushHost } from "./brush_tool.ts";
import type { EditedPoints } from "./edited_points.ts";
import type { Frames } from "./frames.ts";
import type { Messages } from "./messages.ts";

const SETTLES = 0.3; // of the radius: nearer than this to a mirror a new point snaps to it
const MISSED = 0.5; // voxels, or pixels, by which points that are left out may have moved tissue

/** Dependencies of strokes on an editor. */
export interface StrokeEditor<V extends Vector> {
  model: Model;
  frames: Frames;
  messages: Messages;
  points: EditedPoints<V>;
}

export abstract class StrokeHost<V extends Vector> implements BrushHost<V> {
  readonly model: Model;
  readonly frames: Frames;
  readonly messages: Messages;
  abstract readonly keys: KeyTable;
  abstract readonly stage: BrushHost<V>["stage"];
  abstract readonly viewport: BrushHost<V>["viewport"];
  protected side = 0; // of the mirror on which the stroke began

  constructor(readonly editor: StrokeEditor<V>) {
    this.model = editor.model;
    this.frames = editor.frames;
    this.messages = editor.messages;
  }

  abstract end(isCancelled: boolean): void;

  /** The length of a voxel, or a pixel. */
  protected abstract get spacing(): number;

  protected abstract get mirror(): Mirror;

  protected abstract get around(): Omit<StrokeSurroundings<V>, "settle">;

  /** The points of a stroke with their mirror images; null where none are being dragged. */
  protected abstract complete(points: Point<V>[]): Point<V>[] | null;

  /** Show points; false where the stroke must not continue to them. */
  protected abstract show(points: Point<V>[]): boolean;

  protected abstract beginDrag(): void;

  protected abstract hintLocked(id: number): void;

  /** The reason why no stroke can begin here at all, "" for none. */
  protected get refusal() {
    return "";
  }

  get diagonal() {
    return this.around.frame.diagonal;
  }

  /** Begin a stroke; null and a hint where none can begin. */
  begin(place: V, radius: number, tool: string) {
    const { around, messages, mirror, refusal } = this,
      { points } = this.editor;
    if (points.isLocked) return null;
    if (refusal) {
      messages.hint(refusal, 5000);
      return null;
    }
    const isNear = (at: V) => mirror.on && mirrorSide(mirror, at, SETTLES * radius) === 0,
      settle = (at: V) => (isNear(at) ? projectOnAxis(mirror, at) : at),
      stroke = new Stroke<V>(points.list, place, radius, { tool, id: points.nextId() }, { ...around, settle });
    if (stroke.lockedBy) {
      this.hintLocked(stroke.lockedBy.id);
      return null;
    }
    if (!stroke.isPossible) {
      messages.hint("There is nothing here to drag");
      return null;
    }
    this.side = mirror.on ? mirrorSide(mirror, place, 0) : 0;
    this.beginDrag();
    return stroke;
  }

  /** Show a stroke as it is now; false where it must not continue. */
  paint(stroke: Stroke<V>) {
    const points = this.complete(stroke.points);
    return points !== null && this.show(points);
  }

  /** Leave few of the points of a stroke, where that does not fold. */
  finish(stroke: Stroke<V>) {
    const { points } = stroke;
    stroke.thin(MISSED * this.spacing, (some) => this.complete(some) ?? some);
    if (this.paint(stroke)) return;
    stroke.points = points;
    this.paint(stroke);
  }
}
