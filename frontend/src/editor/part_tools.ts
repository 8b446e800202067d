// The editor's tools for the motion of the chosen rigid part: it is dragged by its inside, turned by its ring, and its
// pivot is set by a cross. The points that it carries follow it.

import { formatLength } from "../maths/numbers.ts";
import { cleanShapes, sameShapes, updatePoints } from "../maths/points.ts";
import { regionOf } from "../maths/regions.ts";
import { carryPoints, findConflicts } from "../maths/rigid_stages.ts";
import {
  motionWords,
  movePlace,
  pivotOf,
  placeBefore,
  rotatePart,
  SHAPE_NAMES,
  shapeName,
  turnAndShift,
  updateShape,
} from "../maths/shapes.ts";
import type { PartData, PicturePoint, Shapes, Vector2 } from "../types.ts";
import type { PartHandle } from "./motion_handles.ts";
import { MotionHandles } from "./motion_handles.ts";
import type { EditorParts } from "./parts.ts";

/**
 * A part being moved: all shapes, its carried points with it, and the ids of those that contradict it.
 */
export type PartState = { shapes: Shapes; points: PicturePoint[]; held: number[] };

/** The state before a drag, and that which is shown now. */
export type PartDrag = {
  part: PartData;
  index: number;
  handle: PartHandle;
  points: PicturePoint[];
  shapes: Shapes;
  wasFine: boolean;
  start: Vector2;
  now: PartState;
};

const TURN_STEPS = [1, 15]; // degrees of a key alone and with Shift; a drag with Shift snaps to the second
const ALONE = "nothing holds the tissue around it: add points there, or a fixed side";
const VERBS: Record<PartHandle, string> = { move: "move", turn: "turn", pivot: "move the pivot of" };

/** Dependencies of the tools on the editor. */
export type PartEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "foldStop" | "modes" | "shapes"
>;

export class PartTools {
  handles: MotionHandles;
  drag0: PartDrag | null = null;
  isLive = false; // whether the part has moved since the last message to Python
  isSent = false; // whether Python has received anything of this drag

  constructor(readonly editor: PartEditor) {
    this.handles = new MotionHandles(editor.stage.svg, editor.tools.shapes.handles.grips);
    editor.points.draggers.push(this);
  }

  /** The part that is chosen and switched on, and its place in the list. */
  get #own() {
    const { chosen, shape } = this.editor.tools.shapes.choice;
    return chosen && shape?.enabled && "motion" in shape ? { part: shape, index: chosen.index } : null;
  }

  /** Whether there is a part to move. */
  get isOn() {
    return this.#own !== null && !this.editor.points.isLocked;
  }

  /** Whether the part has its pivot outside, as a limb at a joint. */
  get isLimb() {
    const { pivot, region } = this.#own?.part ?? {};
    return this.isOn && pivot && region ? regionOf(region).distance(pivot[0], pivot[1]) > 0 : false;
  }

  /** Draw the handles. True if the focus was on one that is gone. */
  draw() {
    const { editor } = this,
      own = this.isOn && !editor.tools.modes.isAdding && !editor.tools.modes.isSelecting ? this.#own : null;
    return this.handles.update(own?.part ?? null, own?.index ?? 0, editor.viewport.view);
  }

  /**
   * The state with a part of another motion. Points that contradict it there are left out until the user has decided.
   */
  #stateOf(
    before: PartData,
    after: PartData,
    index: number,
    start: { points: PicturePoint[]; shapes: Shapes },
  ): PartState {
    const shapes = { ...start.shapes, parts: updateShape(start.shapes.parts, index, after) },
      strength = this.editor.map.strength;
    const points = carryPoints(start.points, before, after);
    const held = findConflicts(points, shapes.parts, strength).map(({ point }) => point.id);
    return { shapes, points, held };
  }

  /** Take other parts that Python proposes, after a question about the points that contradict them. */
  propose(proposed: PartData[], kind: string) {
    const { editor } = this,
      before = editor.points.shapes.parts,
      parts = cleanShapes(proposed, "parts", before);
    let points = editor.points.list;
    parts.forEach((part, k) => {
      const was = before[k];
      if (was && sameShapes(was.region, part.region)) points = carryPoints(points, was, part);
    });
    editor.tools.shapes.edit("parts", parts, kind, { wasFine: true, points });
  }

  // ---- drags --------------------------------------------------------------------------------------------------------

  /**
   * Begin a drag at a place of the view. A part whose pivot was set outside of it turns about that, as a limb about its
   * joint, by its inside too.
   */
  beginDrag(given: PartHandle, from: Vector2) {
    const { editor } = this,
      { list: points, shapes } = editor.points,
      own = this.#own;
    if (editor.points.isLocked || !own) return;
    this.drag0 = {
      ...own,
      handle: given === "move" && this.isLimb ? "turn" : given,
      points,
      shapes,
      wasFine: !editor.map.error,
      start: editor.viewport.placeAt(from),
      now: { points, shapes, held: [] },
    };
    this.isSent = false;
    editor.tools.foldStop.begin();
  }

  /**
   * Move, turn or shift the pivot to a place of the view, as far as the map stays free of folds.
   * @param isStepped whether a rotation snaps to steps
   */
  drag(at: Vector2, isStepped: boolean) {
    const { editor, drag0 } = this;
    if (!drag0) return;
    const { part, index, handle } = drag0,
      to = editor.viewport.placeAt(at);
    const make =
      handle === "pivot"
        ? this.#movePivot(part, drag0.start, to)
        : handle === "turn"
          ? turnPart(part, drag0.start, to, isStepped)
          : movePart(part, drag0.start, to);
    drag0.now = editor.tools.foldStop.limit((share) => {
      const state = this.#stateOf(part, make(share), index, drag0);
      return { ...state, points: deactivate(state.points, state.held) };
    });
    Object.assign(editor.points, { list: drag0.now.points, shapes: drag0.now.shapes });
    const shown = drag0.now.shapes.parts[index]!;
    editor.messages.hint(this.#words(shown, handle, drag0.now.held.length));
    this.isLive = true;
    editor.map.invalidate(true);
  }

  /** Send the part being moved, if Python follows the drag. */
  sendMove() {
    const { editor, drag0 } = this;
    if (drag0 && this.isLive && editor.model.get("live")) {
      const {
        index,
        now: { points, shapes },
      } = drag0;
      editor.sender.move(points, { index, motion: shapes.parts[index]!.motion });
      this.isSent = true;
    }
    this.isLive = false;
  }

  /**
   * The hint during a drag.
   * @param held how many points contradict the part
   */
  #words(part: PartData, handle: PartHandle, held: number) {
    if (handle === "pivot") return `pivot at ${movePlace(part.motion, pivotOf(part)).map(formatLength).join(", ")}`;
    const { layered } = this.editor.map,
      words = motionWords(part) || "where it was";
    const isAlone = (layered?.fits ?? []).every(({ fit }) => fit.count === 0 && (fit.rigid?.length ?? 0) < 2);
    return [words, held ? `${held === 1 ? "1 point" : `${held} points`} in the way` : "", isAlone ? ALONE : ""]
      .filter(Boolean)
      .join("; ");
  }

  endDrag(isCancelled: boolean) {
    const { editor, drag0 } = this;
    this.drag0 = null;
    if (!drag0) return;
    const { handle, part, index, now, points, shapes, wasFine } = drag0;
    Object.assign(editor.points, { list: points, shapes });
    const kind = `${VERBS[handle]} ${part.name || SHAPE_NAMES.parts}`,
      after = now.shapes.parts[index];
    const isEdit = !isCancelled && after && this.#edit(part, after, index, kind, { wasFine });
    if (!isCancelled) editor.tools.foldStop.end();
    if (isEdit) return;
    Object.assign(editor.points, { list: editor.sender.points, shapes: editor.sender.shapes });
    editor.map.invalidate();
    if (this.isSent) editor.sender.move(editor.points.list); // Python has followed the drag, which is void now
  }

  #edit(
    before: PartData,
    after: PartData,
    index: number,
    kind: string,
    { wasFine, join }: { wasFine?: boolean; join?: string | null } = {},
  ) {
    const { editor } = this,
      { shapes, points } = this.#stateOf(before, after, index, {
        points: editor.points.list,
        shapes: editor.points.shapes,
      });
    const isDone = editor.tools.shapes.edit("parts", shapes.parts, kind, { wasFine, points, join });
    if (isDone) editor.messages.announce(`${shapeName(after, "parts", index)} ${motionWords(after) || "where it was"}`);
    return isDone;
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  /** Move the part, or its pivot, by so many pixels of the picture. */
  nudge([dx, dy]: Vector2, pixels: number, handle: PartHandle = "move") {
    const { editor } = this,
      own = this.#own,
      [du, dv] = editor.model.get("raster").spacing;
    if (!own || editor.points.isLocked) return;
    const { part, index } = own,
      by: Vector2 = [dx * pixels * du, dy * pixels * dv];
    const after = handle === "pivot" ? this.#movePivot(part, [0, 0], by)(1) : movePart(part, [0, 0], by)(1);
    const kind = `${VERBS[handle]} ${part.name || SHAPE_NAMES.parts}`;
    this.#edit(part, after, index, kind, { join: `${handle} part ${index}` });
    editor.frames.drawNow();
  }

  /** Turn the part by one step, clockwise for 1. */
  turnKey(way: number, isLarge: boolean) {
    const { editor } = this,
      own = this.#own;
    if (!own || editor.points.isLocked) return;
    const { part, index } = own,
      { angle, shift } = turnAndShift(part);
    const after = rotatePart(part, angle + (way * TURN_STEPS[isLarge ? 1 : 0]! * Math.PI) / 180, shift);
    this.#edit(part, after, index, `turn ${part.name || SHAPE_NAMES.parts}`, { join: `turn part ${index}` });
    editor.frames.drawNow();
  }

  /** Reset the part's motion: it is fixed again. */
  reset() {
    const own = this.#own;
    if (!own || this.editor.points.isLocked || !own.part.motion) return;
    const { part, index } = own;
    this.#edit(part, { ...part, motion: null }, index, `put back ${part.name || SHAPE_NAMES.parts}`);
  }

  /** The part with its pivot moved from one place towards another, within the picture. Its motion stays. */
  #movePivot(part: PartData, from: Vector2, to: Vector2) {
    const [a0, a1, b0, b1] = this.editor.picture.sheet,
      [a, b] = movePlace(part.motion, pivotOf(part));
    return (share: number): PartData => {
      const at: Vector2 = [a + share * (to[0] - from[0]), b + share * (to[1] - from[1])];
      const inside: Vector2 = [Math.max(a0, Math.min(a1, at[0])), Math.max(b0, Math.min(b1, at[1]))];
      return { ...part, pivot: placeBefore(part.motion, inside) };
    };
  }
}

/** The points with some of them switched off. */
function deactivate(points: PicturePoint[], ids: number[]) {
  return ids.length ? updatePoints(points, ids, () => ({ active: false })) : points;
}

/** A part moved from one place to another. */
function movePart(part: PartData, from: Vector2, to: Vector2) {
  const { angle, shift } = turnAndShift(part);
  return (share: number) =>
    rotatePart(part, angle, [shift[0] + share * (to[0] - from[0]), shift[1] + share * (to[1] - from[1])]);
}

/** A part that turns about its pivot by the angle between two places of the pointer. */
function turnPart(part: PartData, from: Vector2, to: Vector2, isStepped: boolean) {
  const { angle, shift } = turnAndShift(part),
    [a, b] = movePlace(part.motion, pivotOf(part));
  const [x, y] = [from[0] - a, from[1] - b],
    [u, v] = [to[0] - a, to[1] - b],
    step = (TURN_STEPS[1]! * Math.PI) / 180;
  const by = Math.atan2(x * v - y * u, x * u + y * v);
  const way = isStepped ? step * Math.round((angle + by) / step) - angle : by;
  return (share: number) => rotatePart(part, angle + share * way, shift);
}
