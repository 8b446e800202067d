// Marks over one of the three pictures: the cross-hair of the other two, a ring where the map folds most, and the
// lattice to which targets snap.

import type { View } from "../editor/painter.ts";
import type { PaneInfo, Vector2 } from "../types.ts";
import { setAttributes, svgElement } from "../ui/dom.ts";

// The lines of the cross-hair: upright (the place along a) and level (the place along b).
export const LINES = ["v", "h"] as const;

export type Line = (typeof LINES)[number];

const GAP = 12; // CSS pixels: the middle of the cross-hair stays clear of lines

export class PaneMarks {
  #lines: SVGGElement[];
  #worst: SVGGElement;
  #nodes: SVGPathElement;
  #nodesKey = ""; // of the lattice that is drawn

  constructor(svg: SVGSVGElement) {
    const cross = svgElement("g", { class: "dnb-sp-cross", "aria-hidden": "true" }, svg);
    this.#lines = LINES.map((name) => {
      const line = svgElement("g", { class: `dnb-sp-line dnb-sp-line-${name}`, "data-line": name }, cross);
      for (const part of ["hit", "case", "ink"]) svgElement("path", { class: `dnb-sp-line-${part}` }, line);
      return line;
    });
    this.#worst = svgElement("g", { class: "dnb-ed-worst", visibility: "hidden", "aria-hidden": "true" }, svg);
    for (const name of ["case", "ring"]) svgElement("circle", { r: 9, class: `dnb-ed-worst-${name}` }, this.#worst);
    this.#nodes = svgElement("path", { class: "dnb-sp-nodes", "aria-hidden": "true" }, svg);
  }

  /**
   * Draw the cross-hair at a place of the view.
   * @param crossing numbers of the pictures that its lines represent
   */
  drawCross([x, y]: Vector2, { width, height }: View, crossing: (number | undefined)[]) {
    const paths = [
      `M ${x} 0 V ${y - GAP} M ${x} ${y + GAP} V ${height}`,
      `M 0 ${y} H ${x - GAP} M ${x + GAP} ${y} H ${width}`,
    ];
    this.#lines.forEach((line, k) => {
      for (const path of line.children) setAttributes(path, { d: paths[k]! });
      line.style.setProperty("--dnb-line-ink", `var(--dnb-pane${crossing[k]})`);
    });
  }

  /** Draw a ring at a place of the view; null for none. */
  drawWorst(place: Vector2 | null) {
    const [x, y] = place ?? [0, 0];
    setAttributes(this.#worst, {
      visibility: place ? "visible" : "hidden",
      transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`,
    });
  }

  /** Draw the lattice of this step, as small crosses where it is wide enough to be seen. */
  drawNodes(step: number, { k, x, y }: View, { box: [a0, a1, b0, b1], spacing: [du, dv] }: PaneInfo) {
    const key = `${step} ${k} ${x} ${y}`;
    if (key === this.#nodesKey) return;
    this.#nodesKey = key;
    let path = "";
    for (let a = a0 + du / 2; step * k >= 5 && a < a1; a += step) {
      for (let b = b0 + dv / 2; b < b1; b += step) {
        path += `M ${(k * a + x - 2).toFixed(1)} ${(k * b + y).toFixed(1)} h 4 m -2 -2 v 4`;
      }
    }
    this.#nodes.setAttribute("d", path);
  }
}
