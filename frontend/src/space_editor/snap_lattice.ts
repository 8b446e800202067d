// The lattice to whose nodes targets in space snap. Its nodes begin at the middle of the first voxel.

import type { Moved } from "../editor/gesture.ts";
import { added, difference } from "../maths/camera.ts";
import { formatLength } from "../maths/numbers.ts";
import { fromPane, toPane } from "../maths/space.ts";
import { setTrait } from "../sync/edits.ts";
import type { PaneInfo, SpacePoint, Vector3 } from "../types.ts";
import type { SpaceParts } from "./parts.ts";

const SNAP_PARTS = 16; // of the longest side: the step of the lattice, in whole voxels

function nearest(value: number, first: number, step: number) {
  return first + step * Math.round((value - first) / step);
}

export class SnapLattice {
  constructor(readonly editor: SpaceParts<"model" | "messages" | "cursor">) {}

  /** The distance of its nodes; 0 where targets do not snap. */
  get step(): number {
    return this.editor.model.get("snap") || 0;
  }

  toggle() {
    const { editor } = this,
      {
        box: [a0, a1, b0, b1, c0, c1],
        spacing,
      } = editor.cursor.panes[0]!,
      voxel = Math.min(...spacing);
    const step = voxel * Math.max(1, Math.round(Math.max(a1 - a0, b1 - b0, c1 - c0) / SNAP_PARTS / voxel));
    setTrait(editor.model, "snap", this.step > 0 ? 0 : step);
    if (this.step > 0)
      editor.messages.hint(`Targets snap to a lattice of ${formatLength(step)}; hold Alt to go between`, 4000);
  }

  /** The next node in a picture; the depth stays. */
  nodeIn(pane: PaneInfo, [a, b, c]: Vector3): Vector3 {
    const { step } = this,
      {
        box: [a0, , b0],
        spacing: [du, dv],
      } = pane;
    return step > 0 ? [nearest(a, a0 + du / 2, step), nearest(b, b0 + dv / 2, step), c] : [a, b, c];
  }

  /** The next node in space. */
  nodeAt(place: Vector3): Vector3 {
    const { step } = this,
      pane = this.editor.cursor.panes[0]!,
      [a, b, c] = this.nodeIn(pane, toPane(pane, place));
    return step > 0 ? fromPane(pane, [a, b, nearest(c, pane.depths[0], step)]) : place;
  }

  /** The displacement in a picture that brings the point under the pointer onto a node; the others follow it. */
  snapMove(pane: PaneInfo, p: SpacePoint | undefined, way: Vector3, what: Moved, isLoose: boolean): Vector3 {
    if (!p || isLoose || what !== "target" || !(this.step > 0)) return way;
    return difference(fromPane(pane, this.nodeIn(pane, toPane(pane, added(p.target, way)))), p.target);
  }
}
