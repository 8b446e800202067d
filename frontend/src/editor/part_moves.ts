// The motion of the chosen rigid part, on a picture or on a slice in space: it is dragged by its inside, turned by its
// ring, and its pivot is set by a cross. The points that it carries follow it.

import type { MovedPart } from "../generated.ts";
import { formatLength } from "../maths/numbers.ts";
import { updatePoints } from "../maths/points.ts";
import { SHAPE_NAMES, shapeName } from "../maths/shapes.ts";
import type { Sender } from "../sync/edits.ts";
import type { Model, Point, Shapes, Vector, Vector2, Vector4 } from "../types.ts";
import type { EditedPoints } from "./edited_points.ts";
import type { Frames } from "./frames.ts";
import type { Messages } from "./messages.ts";
import type { PartHandle } from "./motion_handles.ts";

export const ALONE = "nothing holds the tissue around it: add points there, or a fixed side";
const TURN_STEPS = [1, 15]; // degrees of a key alone and with Shift; a drag with Shift snaps to the second
const VERBS: Record<PartHandle, string> = { move: "move", turn: "turn", pivot: "move the pivot of" };

/** A part being moved: all shapes, its carried points with it, and the ids of those that contradict it. */
export type PartState<V extends Vector> = { shapes: Shapes; points: Point<V>[]; held: number[] };

/** A part and its place in the list. */
export type OwnPart<P> = { part: P; index: number };

/** The state before a drag, and that which is shown now. */
export type PartDrag<P, V extends Vector> = OwnPart<P> & {
  handle: PartHandle;
  points: Point<V>[];
  shapes: Shapes;
  wasFine: boolean;
  start: Vector2;
  now: PartState<V>;
};

/** The picture, or the slice, on which a part is moved, and motions in it. Places are those of the picture. */
export interface PartPlane<P> {
  readonly box: readonly [...Vector4, ...number[]];
  /** Of its pixels. */
  readonly spacing: Vector2;
  /** The place at a place of the view. */
  placeAt(at: Vector2): Vector2;
  /** The pivot of a part, where its motion has brought it. */
  pivotAt(part: P): Vector2;
  angleOf(part: P): number;
  shifted(part: P, way: Vector2): P;
  turned(part: P, angle: number): P;
  withPivotAt(part: P, place: Vector2): P;
}

/** Dependencies on the editor. */
export interface PartMovesEditor<V extends Vector> {
  model: Model;
  sender: Sender<V>;
  frames: Frames;
  messages: Messages;
  points: EditedPoints<V>;
}

/** How an edit is made: whether a fit was possible before it, and with which others it is undone as one. */
export type PartEditOptions = { wasFine?: boolean; join?: string | null };

export abstract class PartMoves<P extends { name: string }, V extends Vector> {
  drag0: PartDrag<P, V> | null = null;
  isLive = false; // whether the part has moved since the last message to Python
  isSent = false; // whether Python has received anything of this drag

  constructor(readonly editor: PartMovesEditor<V>) {
    editor.points.draggers.push(this);
  }

  /** The part that is chosen and switched on. */
  protected abstract get own(): OwnPart<P> | null;

  /** The picture under the pointer, or that has the focus. */
  protected abstract get plane(): PartPlane<P>;

  /** Whether the part has its pivot outside, as a limb at a joint. */
  abstract get isLimb(): boolean;

  protected abstract motionWords(part: P): string;

  protected abstract motionOf(part: P): MovedPart["motion"];

  /** Whether a fit is possible now. */
  protected abstract get isFine(): boolean;

  /** The state with a part of another motion. */
  protected abstract stateOf(
    before: P,
    after: P,
    index: number,
    start: Pick<PartState<V>, "points" | "shapes">,
  ): PartState<V>;

  protected abstract partOf(shapes: Shapes, index: number): P | undefined;

  /** A drag begins. */
  protected abstract begin(): void;

  /** The state as far as the map stays free of folds. */
  protected abstract limit(make: (share: number) => PartState<V>): PartState<V>;

  /** Draw the state that is shown now: it moves, or has come to rest. */
  protected abstract redraw(isMoving: boolean): void;

  /** A drag has ended. */
  protected abstract finish(isCancelled: boolean): void;

  /** Make an edit; false where it is refused. */
  protected abstract apply(state: PartState<V>, kind: string, options: PartEditOptions): boolean;

  /** What a hint says of a part that moves, after its motion. */
  protected abstract remarks(): string[];

  /** Whether there is a part to move. */
  get isOn() {
    return this.own !== null && !this.editor.points.isLocked;
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  /**
   * Begin a drag at a place of the view. A part whose pivot was set outside of it turns about that, as a limb about its
   * joint, by its inside too.
   */
  beginDrag(given: PartHandle, from: Vector2) {
    const { list: points, shapes } = this.editor.points,
      { own } = this;
    if (this.editor.points.isLocked || !own) return;
    this.drag0 = {
      ...own,
      handle: given === "move" && this.isLimb ? "turn" : given,
      points,
      shapes,
      wasFine: this.isFine,
      start: this.plane.placeAt(from),
      now: { points, shapes, held: [] },
    };
    this.isSent = false;
    this.begin();
  }

  /**
   * Move, turn or shift the pivot to a place of the view, as far as the map stays free of folds.
   * @param isStepped whether a rotation snaps to steps
   */
  drag(at: Vector2, isStepped: boolean) {
    const { editor, drag0 } = this;
    if (!drag0) return;
    const { part, index, handle, start } = drag0,
      to = this.plane.placeAt(at);
    const make =
      handle === "pivot"
        ? this.#movePivot(part, [to[0] - start[0], to[1] - start[1]])
        : handle === "turn"
          ? this.#turn(part, start, to, isStepped)
          : this.#move(part, [to[0] - start[0], to[1] - start[1]]);
    drag0.now = this.limit((share) => {
      const state = this.stateOf(part, make(share), index, drag0);
      return { ...state, points: deactivate(state.points, state.held) };
    });
    Object.assign(editor.points, { list: drag0.now.points, shapes: drag0.now.shapes });
    const shown = this.partOf(drag0.now.shapes, index)!;
    editor.messages.hint(this.#words(shown, handle, drag0.now.held.length));
    this.isLive = true;
    this.redraw(true);
  }

  /** Send the part being moved, if Python follows the drag. */
  sendMove() {
    const { editor, drag0 } = this;
    if (drag0 && this.isLive && editor.model.get("live")) {
      const {
        index,
        now: { points, shapes },
      } = drag0;
      editor.sender.move(points, { index, motion: this.motionOf(this.partOf(shapes, index)!) });
      this.isSent = true;
    }
    this.isLive = false;
  }

  /**
   * The hint during a drag.
   * @param held how many points contradict the part
   */
  #words(part: P, handle: PartHandle, held: number) {
    if (handle === "pivot") return `pivot at ${this.plane.pivotAt(part).map(formatLength).join(", ")}`;
    const words = this.motionWords(part) || "where it was";
    return [words, held ? `${held === 1 ? "1 point" : `${held} points`} in the way` : "", ...this.remarks()]
      .filter(Boolean)
      .join("; ");
  }

  endDrag(isCancelled: boolean) {
    const { editor, drag0 } = this;
    this.drag0 = null;
    if (!drag0) return;
    const { handle, part, index, now, points, shapes, wasFine } = drag0;
    Object.assign(editor.points, { list: points, shapes });
    const after = this.partOf(now.shapes, index);
    const isEdit = !isCancelled && after && this.#edit(part, after, index, this.#kind(handle, part), { wasFine });
    this.finish(isCancelled);
    if (isEdit) return;
    Object.assign(editor.points, { list: editor.sender.points, shapes: editor.sender.shapes });
    this.redraw(false);
    if (this.isSent) editor.sender.move(editor.points.list); // Python has followed the drag, which is void now
  }

  #kind(handle: PartHandle, part: P) {
    return `${VERBS[handle]} ${part.name || SHAPE_NAMES.parts}`;
  }

  #edit(before: P, after: P, index: number, kind: string, options: PartEditOptions = {}) {
    const { messages, points } = this.editor,
      state = this.stateOf(before, after, index, { points: points.list, shapes: points.shapes }),
      isDone = this.apply(state, kind, options);
    if (isDone) messages.announce(`${shapeName(after, "parts", index)} ${this.motionWords(after) || "where it was"}`);
    return isDone;
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  /** Move the part, or its pivot, by so many pixels of the picture. */
  nudge([dx, dy]: Vector2, pixels: number, handle: PartHandle = "move") {
    const { own } = this,
      [du, dv] = this.plane.spacing;
    if (!own || this.editor.points.isLocked) return;
    const { part, index } = own,
      by: Vector2 = [dx * pixels * du, dy * pixels * dv];
    const after = handle === "pivot" ? this.#movePivot(part, by)(1) : this.#move(part, by)(1);
    this.#edit(part, after, index, this.#kind(handle, part), { join: `${handle} part ${index}` });
    this.editor.frames.drawNow();
  }

  /** Turn the part by one step, clockwise for 1. */
  turnKey(way: number, isLarge: boolean) {
    const { own } = this;
    if (!own || this.editor.points.isLocked) return;
    const { part, index } = own,
      after = this.plane.turned(part, (way * TURN_STEPS[isLarge ? 1 : 0]! * Math.PI) / 180);
    this.#edit(part, after, index, this.#kind("turn", part), { join: `turn part ${index}` });
    this.editor.frames.drawNow();
  }

  /** Reset the part's motion: it is fixed again. */
  reset() {
    const { own } = this;
    if (!own || this.editor.points.isLocked || !this.motionOf(own.part)) return;
    const { part, index } = own;
    this.#edit(part, { ...part, motion: null }, index, `put back ${part.name || SHAPE_NAMES.parts}`);
  }

  // ---- motions ------------------------------------------------------------------------------------------------------

  #move(part: P, [da, db]: Vector2) {
    const { plane } = this;
    return (share: number) => plane.shifted(part, [share * da, share * db]);
  }

  /** The part turned about its pivot by the angle between two places of the pointer. */
  #turn(part: P, from: Vector2, to: Vector2, isStepped: boolean) {
    const { plane } = this,
      angle = plane.angleOf(part),
      [a, b] = plane.pivotAt(part);
    const [x, y] = [from[0] - a, from[1] - b],
      [u, v] = [to[0] - a, to[1] - b],
      step = (TURN_STEPS[1]! * Math.PI) / 180;
    const by = Math.atan2(x * v - y * u, x * u + y * v);
    const way = isStepped ? step * Math.round((angle + by) / step) - angle : by;
    return (share: number) => plane.turned(part, share * way);
  }

  /** The part with its pivot moved, within the picture. Its motion stays. */
  #movePivot(part: P, [da, db]: Vector2) {
    const { plane } = this,
      [a0, a1, b0, b1] = plane.box,
      [a, b] = plane.pivotAt(part);
    return (share: number) =>
      plane.withPivotAt(part, [Math.max(a0, Math.min(a1, a + share * da)), Math.max(b0, Math.min(b1, b + share * db))]);
  }
}

/** The points with some of them switched off. */
function deactivate<V extends Vector>(points: Point<V>[], ids: number[]) {
  return ids.length ? updatePoints(points, ids, () => ({ active: false })) : points;
}
