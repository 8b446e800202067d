// The axes of a plot: places in pixels and in values, ticks and their texts.

import { formatNumber, ticksOf } from "../maths/curves.ts";
import type { Vector2 } from "../types.ts";
import { svgElement } from "../ui/dom.ts";

export const PLOT = { left: 46, right: 12, top: 10, bottom: 22 };
const SNAP = 5; // CSS pixels

export class PlotAxes {
  /** The plot, in pixels */
  box = { left: 0, top: 0, width: 0, height: 0 };
  ends: [Vector2, Vector2] = [
    [0, 1],
    [0, 1],
  ];
  power = 1; // of heights
  /** Heights to which places snap */
  snaps: number[] = [];

  constructor(readonly margins = PLOT) {}

  /** Fit to a width; returns the height with the margins. */
  resize(width: number, least: number) {
    const { left, right, top, bottom } = this.margins,
      high = Math.round(Math.max(least, Math.min(1.7 * least, 0.3 * width))),
      height = high + bottom - PLOT.bottom;
    this.box = { left, top, width: width - left - right, height: height - top - bottom };
    return height;
  }

  toPixel([x, y]: Vector2): Vector2 {
    const {
        box: b,
        ends: [[x0, x1], [y0, y1]],
      } = this,
      height = Math.max(0, Math.min(1, (y - y0) / (y1 - y0)));
    return [b.left + ((x - x0) / (x1 - x0)) * b.width, b.top + (1 - height ** this.power) * b.height];
  }

  toPlace([px, py]: Vector2): Vector2 {
    const {
        box: b,
        ends: [[x0, x1], [y0, y1]],
      } = this,
      height = Math.max(0, Math.min(1, 1 - (py - b.top) / b.height));
    return [x0 + ((px - b.left) / b.width) * (x1 - x0), y0 + height ** (1 / this.power) * (y1 - y0)];
  }

  /**
   * A place with as many digits as can be distinguished, at one of the snapping heights if it is near.
   * @param isFree whether nothing snaps
   */
  tidy([x, y]: Vector2, isFree: boolean = false): Vector2 {
    const [, py] = this.toPixel([x, y]);
    const near = isFree ? undefined : this.snaps.find((value) => Math.abs(this.toPixel([x, value])[1] - py) < SNAP);
    const [[x0, x1], [y0, y1]] = this.ends;
    const digits = (range: number) => Math.max(0, Math.min(12, 3 - Math.floor(Math.log10(range))));
    const rounded = this.power === 1 ? y.toFixed(digits(y1 - y0)) : y < 5e-6 ? 0 : y.toPrecision(3);
    return [Number(x.toFixed(digits(x1 - x0))), near ?? Number(rounded)];
  }

  // ---- ticks --------------------------------------------------------------------------------------------------------

  /** Texts at the ends of the horizontal axis. */
  endWords(): [string, string] {
    const [[x0, x1]] = this.ends;
    return [formatNumber(x0, x1 - x0), formatNumber(x1, x1 - x0)];
  }

  tickText(y: number) {
    return formatNumber(y, this.ends[1][1] - this.ends[1][0]);
  }

  /** Ticks of the horizontal axis. */
  placeTicks(): number[] {
    return ticksOf(...this.ends[0], this.box.width / 70);
  }

  /** Ticks of heights. */
  ticks(): number[] {
    return ticksOf(...this.ends[1], Math.max(2.5, this.box.height / 30));
  }

  draw(layer: SVGGElement) {
    const { left, top, width, height } = this.box,
      [[x0, x1], [y0]] = this.ends;
    const write = (x: number, y: number, text: string, anchor: string) =>
      svgElement("text", { class: "dnb-cv-text", x, y, "text-anchor": anchor }, layer, text);
    layer.replaceChildren();
    svgElement("rect", { class: "dnb-cv-frame", x: left, y: top, width, height }, layer);
    for (const y of this.ticks()) {
      const py = this.toPixel([x0, y])[1];
      const name = this.snaps.includes(y) ? "dnb-cv-strong" : "dnb-cv-grid";
      svgElement("path", { class: name, d: `M${left} ${py}h${width}` }, layer);
      write(left - 11, py + 4, this.tickText(y), "end");
    }
    const [first, last] = this.endWords();
    write(left, top + height + 16, first, "start");
    write(left + width, top + height + 16, last, "end");
    const taken = 6.5 * Math.max(first.length, last.length) + 22;
    for (const x of this.placeTicks()) {
      const px = this.toPixel([x, y0])[0];
      svgElement("path", { class: "dnb-cv-tick", d: `M${px} ${top + height}v3` }, layer);
      const hasRoom = px > left + taken && px < left + width - taken;
      if (hasRoom) write(px, top + height + 16, formatNumber(x, x1 - x0), "middle");
    }
  }
}
