// The tools for the motion of the chosen rigid part of a step in space: in the plane of a slice.

import { ALONE, type PartEditOptions, PartMoves, type PartPlane, type PartState } from "../editor/part_moves.ts";
import type { MovedPart } from "../generated.ts";
import { updateShape } from "../maths/shapes.ts";
import { fromPane, toPane, vectorFromPane } from "../maths/space.ts";
import {
  carryInSpace,
  isInSpace,
  partDataOf,
  pivotInSpace,
  placeBeforeInSpace,
  shiftInSpace,
  spaceMotionWords,
  spacePartsOf,
  turnInSpace,
  twistOf,
} from "../maths/space_parts.ts";
import type { Shapes, SpacePart, Vector2, Vector3 } from "../types.ts";
import type { SpacePane } from "./pane.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the tools on the editor. */
export type SpacePartEditor = SpaceParts<
  "model" | "sender" | "frames" | "messages" | "row" | "points" | "edits" | "shapes" | "foldStop"
>;

export class SpacePartTools extends PartMoves<SpacePart, Vector3> {
  #pane: SpacePane | null = null;

  constructor(override readonly editor: SpacePartEditor) {
    super(editor);
  }

  /** A press, or a key, in a picture. */
  enter(pane: SpacePane) {
    this.#pane = pane;
    return this;
  }

  protected get own() {
    return this.editor.shapes.own;
  }

  get isLimb() {
    const { pivot, region } = this.own?.part ?? {};
    return this.isOn && pivot && region ? !isInSpace(region, pivot) : false;
  }

  protected get isFine() {
    return true; // Python knows, and refuses what cannot be fitted
  }

  protected get plane(): PartPlane<SpacePart> {
    const pane = this.#pane ?? this.editor.row.paneOf(document.activeElement),
      { info, viewport } = pane,
      flat = ([a, b]: Vector3): Vector2 => [a, b];
    return {
      box: info.box,
      spacing: [info.spacing[0], info.spacing[1]],
      placeAt: (at) => viewport.placeAt(at),
      pivotAt: (part) => flat(toPane(info, pivotInSpace(part))),
      angleOf: (part) => twistOf(part, info.n),
      shifted: (part, [da, db]) => shiftInSpace(part, vectorFromPane(info, da, db)),
      turned: (part, angle) => turnInSpace(part, info.n, angle),
      withPivotAt(part, [a, b]) {
        const place = fromPane(info, [a, b, toPane(info, pivotInSpace(part))[2]]);
        return { ...part, pivot: placeBeforeInSpace(part.motion, place) };
      },
    };
  }

  protected stateOf(
    before: SpacePart,
    after: SpacePart,
    index: number,
    start: Pick<PartState<Vector3>, "points" | "shapes">,
  ) {
    const shapes = { ...start.shapes, parts: updateShape(start.shapes.parts, index, partDataOf(after)) };
    return { shapes, points: carryInSpace(start.points, before, after), held: [] };
  }

  protected partOf({ parts }: Shapes, index: number) {
    return spacePartsOf(parts)[index];
  }

  protected motionOf(part: SpacePart): MovedPart["motion"] {
    return partDataOf(part).motion;
  }

  protected motionWords(part: SpacePart) {
    return spaceMotionWords(part);
  }

  protected begin() {
    this.editor.foldStop.begin();
  }

  protected limit(make: (share: number) => PartState<Vector3>) {
    return make(1); // Python stops it at its end
  }

  protected finish() {}

  protected redraw(isMoving: boolean) {
    const { edits, points } = this.editor;
    edits.publish(points.list, isMoving ? "move" : "end");
    if (isMoving) this.sendMove();
  }

  protected apply({ points, shapes }: PartState<Vector3>, kind: string, { join = null }: PartEditOptions) {
    return this.editor.shapes.edit("parts", shapes.parts, kind, { points, join });
  }

  protected remarks() {
    const { points, shapes } = this.editor;
    return points.list.some((p) => p.active) || shapes.parts.length > 1 ? [] : [ALONE];
  }
}
