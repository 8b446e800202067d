// The handles of the motion of a rigid part as SVG: a ring around its pivot with a knob, which turn it, and a cross at
// the pivot, which can be dragged. Both are drawn where the part has moved to.

import { formatLength } from "../maths/numbers.ts";
import { movePlace, pivotOf, shapeName, turnAndShift } from "../maths/shapes.ts";
import type { PartData } from "../types.ts";
import { OWN_KEYS, setAttributes, svgElement, treeOf } from "../ui/dom.ts";
import type { View } from "./painter.ts";
import { farthest } from "./shape_handles.ts";
/** The effect of a drag of a part */
export type PartHandle = "move" | "turn" | "pivot";

const RING = [38, 110]; // CSS pixels of the ring's radius at least and at most
const AROUND = 18; // from the farthest corner of a part to the ring
const CROSS_ROOM = 22; // radius of a part below which the cross would cover all that can be dragged

export class MotionHandles {
  root: SVGGElement;
  ring: SVGGElement;
  circles: SVGCircleElement[];
  knob: SVGGElement;
  cross: SVGGElement;

  /** @param grips of outlines */
  constructor(
    readonly svg: SVGSVGElement,
    grips: SVGElement,
  ) {
    const ring = svgElement("g", { "data-motion": "turn", class: "dnb-ed-turn-ring", visibility: "hidden" });
    svg.insertBefore(ring, grips); // corners on the ring stay within reach; knob and cross are above them
    this.root = svgElement("g", { class: "dnb-ed-motion", visibility: "hidden" });
    grips.after(this.root);
    this.ring = ring;
    this.circles = ["hit", "case", "line"].map((name) =>
      svgElement("circle", { class: `dnb-ed-turn-ring-${name}` }, ring),
    );
    svgElement("title", {}, ring, "Drag around to turn the part; Shift goes in steps of 15\u00b0");
    this.knob = svgElement(
      "g",
      {
        "data-motion": "turn",
        class: "dnb-ed-turn dnb-ed-part-knob",
        role: "slider",
        tabindex: "-1",
        "aria-label": "Turn",
        "aria-valuemin": -180,
        "aria-valuemax": 180,
        "aria-valuenow": 0,
        ...OWN_KEYS,
      },
      this.root,
    );
    svgElement("circle", { r: 16, class: "dnb-ed-hit" }, this.knob);
    svgElement("circle", { r: 8, class: "dnb-ed-turn-disc" }, this.knob);
    svgElement("path", { d: "M4.2-1.6A4.5 4.5 0 1 0 4 2.2M4.6-4.6V-1.4H1.4", class: "dnb-ed-turn-arrow" }, this.knob);
    svgElement("title", {}, this.knob, "Drag around to turn the part; Shift goes in steps of 15\u00b0");
    this.cross = svgElement(
      "g",
      {
        "data-motion": "pivot",
        class: "dnb-ed-pivot",
        role: "button",
        tabindex: "-1",
        "aria-label": "Pivot",
        "aria-roledescription": "pivot",
        ...OWN_KEYS,
      },
      this.root,
    );
    svgElement("circle", { r: 11, class: "dnb-ed-hit" }, this.cross);
    for (const name of ["case", "line"]) {
      svgElement("path", { d: "M-7 0H7M0-7V7", class: `dnb-ed-pivot-${name}` }, this.cross);
    }
    svgElement("title", {}, this.cross, "The pivot: the part turns about it. Drag it where a joint is");
  }

  /**
   * Show the handles of a part, or none. True if the focus was on one that is gone.
   * @param angle of the part, in radians
   */
  update(part: PartData | null, index: number, { k, x, y }: View, angle: number = part ? turnAndShift(part).angle : 0) {
    const isLost = !part && this.root.contains(treeOf(this.svg).activeElement);
    for (const group of [this.ring, this.root]) setAttributes(group, { visibility: part ? "visible" : "hidden" });
    for (const handle of [this.knob, this.cross]) setAttributes(handle, { tabindex: part ? "0" : "-1" });
    if (!part) return isLost;
    const pivot = pivotOf(part),
      at = movePlace(part.motion, pivot),
      [u, v] = [k * at[0] + x, k * at[1] + y];
    const degrees = formatLength((angle * 180) / Math.PI);
    const name = shapeName(part, "parts", index),
      extent = k * farthest(part.region, pivot);
    const radius = Math.max(RING[0]!, Math.min(RING[1]!, extent + AROUND));
    for (const circle of this.circles) {
      setAttributes(circle, { cx: u.toFixed(1), cy: v.toFixed(1), r: radius.toFixed(1) });
    }
    const [p, q] = [u + radius * Math.sin(angle), v - radius * Math.cos(angle)];
    setAttributes(this.knob, {
      "aria-label": `Turn of ${name}`,
      "aria-valuenow": degrees,
      "aria-valuetext": `${degrees} degrees`,
      transform: `translate(${p.toFixed(1)} ${q.toFixed(1)})`,
    });
    setAttributes(this.cross, {
      "aria-label": `Pivot of ${name}, at ${at.map(formatLength).join(", ")}`,
      visibility: extent < CROSS_ROOM ? "hidden" : "inherit",
      transform: `translate(${u.toFixed(1)} ${v.toFixed(1)})`,
    });
    return false;
  }

  focus(handle: PartHandle) {
    (handle === "pivot" ? this.cross : this.knob).focus({ preventScroll: true });
  }
}
