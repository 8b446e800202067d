// The rigid parts of a step in space over a view of the volume: loops around each, in three planes through its pivot.

import { outlineOf } from "../maths/mask_outlines.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { SpaceCamera } from "../maths/space_camera.ts";
import { moveInSpace, partOnSlice, pivotInSpace } from "../maths/space_parts.ts";
import type { PaneInfo, SpacePart, SpaceRegion, Vector3 } from "../types.ts";
import { setAttributes, svgElement } from "../ui/dom.ts";

/** The rigid parts of an editor, and which is chosen. */
export interface EditedParts {
  parts: SpacePart[];
  chosen: number | null;
  panes: PaneInfo[];
}

export class PartLoops {
  #root: SVGGElement;
  #pieces: WeakMap<SpaceRegion, Vector3[][]> = new WeakMap();

  constructor(svg: SVGSVGElement) {
    this.#root = svgElement("g", { class: "dnb-sp-loops", "aria-hidden": "true" });
    svg.prepend(this.#root); // under the points
  }

  draw(camera: SpaceCamera, { parts, chosen, panes }: EditedParts) {
    const shown = parts.map((part, k) => ({ part, isChosen: k === chosen })).filter(({ part }) => part.enabled),
      paths = this.#root.children;
    while (paths.length > 2 * shown.length) paths[paths.length - 1]!.remove();
    shown.forEach(({ part, isChosen }, k) => {
      const d = this.#path(camera, part, panes);
      for (const [i, name] of ["case", "ink"].entries()) {
        const path = paths[2 * k + i] ?? svgElement("path", {}, this.#root);
        setAttributes(path, { d, class: `dnb-sp-loop-${name}${isChosen ? " dnb-sp-loop-chosen" : ""}` });
      }
    });
  }

  #path(camera: SpaceCamera, { motion, region, ...part }: SpacePart, panes: PaneInfo[]) {
    const pieces = this.#pieces.get(region) ?? loopsOf({ ...part, region, motion: null, pivot: null }, panes);
    this.#pieces.set(region, pieces);
    return pieces
      .map((piece) => {
        const at = piece.map((place) =>
          camera
            .see(moveInSpace(motion, place))
            .at.map((x) => x.toFixed(1))
            .join(" "),
        );
        return `M${at.join("L")}`;
      })
      .join("");
  }
}

/** Pieces of the loops around a part; of a half space there are none. */
function loopsOf(part: SpacePart, panes: PaneInfo[]) {
  if (part.region.kind !== "mask") return [];
  return panes.flatMap((pane) => {
    const depth = toPane(pane, pivotInSpace(part))[2],
      { region } = partOnSlice(part, pane, depth);
    if (region.kind !== "mask") return [];
    return outlineOf(region).faces.map((face) => face.map(([a, b]) => fromPane(pane, [a, b, depth])));
  });
}
