// The tools for the motion of the chosen rigid part on a picture.

import { cleanShapes, sameShapes } from "../maths/points.ts";
import { regionOf } from "../maths/regions.ts";
import { carryPoints, findConflicts } from "../maths/rigid_stages.ts";
import {
  motionWords,
  movePlace,
  pivotOf,
  placeBefore,
  rotatePart,
  turnAndShift,
  updateShape,
} from "../maths/shapes.ts";
import type { PartData, Shapes, Vector2 } from "../types.ts";
import { MotionHandles } from "./motion_handles.ts";
import { ALONE, type PartEditOptions, PartMoves, type PartPlane, type PartState } from "./part_moves.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the tools on the editor. */
export type PartEditor = EditorParts<
  "model" | "sender" | "frames" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "foldStop" | "modes" | "shapes"
>;

export class PartTools extends PartMoves<PartData, Vector2> {
  handles: MotionHandles;

  constructor(override readonly editor: PartEditor) {
    super(editor);
    this.handles = new MotionHandles(editor.stage.svg, editor.tools.shapes.handles.grips);
  }

  protected get own() {
    const { chosen, shape } = this.editor.tools.shapes.choice;
    return chosen && shape?.enabled && "motion" in shape ? { part: shape, index: chosen.index } : null;
  }

  get isLimb() {
    const { pivot, region } = this.own?.part ?? {};
    return this.isOn && pivot && region ? regionOf(region).distance(pivot[0], pivot[1]) > 0 : false;
  }

  protected get isFine() {
    return !this.editor.map.error;
  }

  protected get plane(): PartPlane<PartData> {
    const { model, picture, viewport } = this.editor;
    return {
      box: picture.sheet,
      spacing: model.get("raster").spacing,
      placeAt: (at) => viewport.placeAt(at),
      pivotAt: (part) => movePlace(part.motion, pivotOf(part)),
      angleOf: (part) => turnAndShift(part).angle,
      shifted(part, [da, db]) {
        const { angle, shift } = turnAndShift(part);
        return rotatePart(part, angle, [shift[0] + da, shift[1] + db]);
      },
      turned(part, by) {
        const { angle, shift } = turnAndShift(part);
        return rotatePart(part, angle + by, shift);
      },
      withPivotAt: (part, place) => ({ ...part, pivot: placeBefore(part.motion, place) }),
    };
  }

  /** Draw the handles. True if the focus was on one that is gone. */
  draw() {
    const { editor } = this,
      own = this.isOn && !editor.tools.modes.isAdding && !editor.tools.modes.isSelecting ? this.own : null;
    return this.handles.update(own?.part ?? null, own?.index ?? 0, editor.viewport.view);
  }

  /** Points that contradict the part in another motion are left out until the user has decided. */
  protected stateOf(
    before: PartData,
    after: PartData,
    index: number,
    start: Pick<PartState<Vector2>, "points" | "shapes">,
  ) {
    const shapes = { ...start.shapes, parts: updateShape(start.shapes.parts, index, after) },
      strength = this.editor.map.strength;
    const points = carryPoints(start.points, before, after);
    const held = findConflicts(points, shapes.parts, strength).map(({ point }) => point.id);
    return { shapes, points, held };
  }

  protected partOf({ parts }: Shapes, index: number) {
    return parts[index];
  }

  protected motionOf({ motion }: PartData) {
    return motion;
  }

  protected motionWords(part: PartData) {
    return motionWords(part);
  }

  protected begin() {
    this.editor.tools.foldStop.begin();
  }

  protected limit(make: (share: number) => PartState<Vector2>) {
    return this.editor.tools.foldStop.limit(make);
  }

  protected finish(isCancelled: boolean) {
    this.editor.tools.foldStop.end(isCancelled);
  }

  protected redraw(isMoving: boolean) {
    this.editor.map.invalidate(isMoving);
  }

  protected apply({ points, shapes }: PartState<Vector2>, kind: string, options: PartEditOptions) {
    return this.editor.tools.shapes.edit("parts", shapes.parts, kind, { ...options, points });
  }

  protected remarks() {
    const { layered } = this.editor.map;
    return (layered?.fits ?? []).every(({ fit }) => fit.count === 0 && (fit.rigid?.length ?? 0) < 2) ? [ALONE] : [];
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
}
