// A rigid part that is being drawn, over one of the three pictures: its outline, and grips at its sides.

import type { View } from "../editor/painter.ts";
import { setAttributes, svgElement } from "../ui/dom.ts";
import { DRAFT_SIDES, type DraftOnSlice } from "./part_pen.ts";

export class DraftMarks {
  #root: SVGGElement;
  #paths: SVGPathElement[];
  #grips: Map<string, SVGGElement>;

  constructor(svg: SVGSVGElement) {
    this.#root = svgElement("g", { class: "dnb-sp-draft", visibility: "hidden", "aria-hidden": "true" }, svg);
    this.#paths = ["inside", "case", "line"].map((name) =>
      svgElement(
        "path",
        { class: `dnb-ed-draft-${name}`, ...(name === "inside" && { "data-draft": name }) },
        this.#root,
      ),
    );
    this.#grips = new Map(
      Object.keys(DRAFT_SIDES).map((side) => {
        const grip = svgElement("g", { class: "dnb-ed-grip dnb-ed-corner", "data-draft": side }, this.#root);
        svgElement("circle", { r: 11, class: "dnb-ed-hit" }, grip);
        svgElement("rect", { x: -4.5, y: -4.5, width: 9, height: 9, class: "dnb-ed-grip-square" }, grip);
        return [side, grip];
      }),
    );
  }

  draw(draft: DraftOnSlice | null, { k, x, y }: View) {
    setAttributes(this.#root, { visibility: draft ? "visible" : "hidden" });
    if (!draft) return;
    const {
        middle: [a, b],
        radii: [p, q],
        form,
      } = draft,
      [u, v, r, s] = [k * a + x, k * b + y, k * p, k * q].map((value) => value.toFixed(1)) as [
        string,
        string,
        string,
        string,
      ];
    const d =
      form === "box"
        ? `M${u} ${v}m-${r}-${s}h${2 * Number(r)}v${2 * Number(s)}h-${2 * Number(r)}Z`
        : `M${u} ${v}m-${r} 0a${r} ${s} 0 1 0 ${2 * Number(r)} 0a${r} ${s} 0 1 0-${2 * Number(r)} 0Z`;
    for (const path of this.#paths) setAttributes(path, { d });
    for (const [side, grip] of this.#grips) {
      const [da, db] = DRAFT_SIDES[side]!;
      setAttributes(grip, {
        transform: `translate(${(k * (a + da * p) + x).toFixed(1)} ${(k * (b + db * q) + y).toFixed(1)})`,
      });
    }
  }
}
