// The drawing that a deformation should come to, beside it, with the nodes that are to be reached by their numbers.

import type { Vector2, Vector4 } from "../types.ts";
import { pageElement, setText, svgElement } from "../ui/dom.ts";

const RADIUS = 9; // CSS pixels of a numbered disc

export class GoalDrawing {
  readonly element: HTMLElement;
  readonly #image: HTMLImageElement;
  readonly #svg: SVGSVGElement;
  readonly #caption: HTMLElement;
  #box: Vector4 = [0, 1, 0, 1];
  #url = "";

  constructor(parent: Element) {
    this.element = pageElement("figure", "dnb-th-goal", parent);
    const frame = pageElement("div", "dnb-th-goal-frame", this.element);
    this.#image = pageElement("img", "dnb-th-goal-image", frame, { draggable: "false" });
    this.#svg = svgElement("svg", { class: "dnb-th-goal-marks", "aria-hidden": "true" }, frame);
    this.#caption = pageElement("figcaption", "dnb-th-caption", this.element);
  }

  /**
   * Show another drawing.
   * @param box of the picture, in whose coordinates nodes are given
   * @param words the caption, and what the drawing shows
   */
  show(png: Blob, box: Vector4, words: { caption: string; alt: string }) {
    URL.revokeObjectURL(this.#url);
    this.#url = URL.createObjectURL(png);
    this.#box = box;
    this.#image.src = this.#url;
    this.#image.alt = words.alt;
    setText(this.#caption, words.caption);
    const [a0, a1, b0, b1] = box;
    this.#svg.setAttribute("viewBox", `${a0} ${b0} ${a1 - a0} ${b1 - b0}`);
    this.mark([], null);
  }

  /**
   * Number the nodes at their places.
   * @param worst the number of the one that is emphasized, from 0
   */
  mark(places: Vector2[], worst: number | null) {
    const [a0, a1, b0, b1] = this.#box,
      { clientWidth: width, clientHeight: height } = this.#svg,
      unit = Math.max((a1 - a0) / (width || 300), (b1 - b0) / (height || 300)),
      r = RADIUS * unit;
    this.#svg.replaceChildren();
    for (const [k, [x, y]] of places.entries()) {
      const mark = svgElement("g", { class: k === worst ? "dnb-th-mark dnb-th-worst" : "dnb-th-mark" }, this.#svg);
      svgElement("circle", { cx: x, cy: y, r, "stroke-width": 2 * unit }, mark);
      svgElement("text", { x, y: y + 0.38 * r, "font-size": 1.15 * r }, mark, String(k + 1));
    }
  }

  close() {
    URL.revokeObjectURL(this.#url);
    this.element.remove();
  }
}
