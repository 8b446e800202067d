// A small cube in a corner that turns with the camera: its faces bear the letters of a patient's sides, and a click on
// one looks from there. Where one face hides all others, arrows next to it lead to its neighbours.

import { cross, dot, scaled } from "../maths/camera.ts";
import type { Vector2, Vector3 } from "../types.ts";
import { buttonElement, iconElement, named, pageElement, setAttributes, svgElement } from "./dom.ts";
import { findPressed } from "./fingers.ts";
import { SIDES, type Side } from "./view_parts.ts";

const CUBE_SIDE = 27; // half an edge; the drawing is 100 wide and an edge-on cube must fit
const FLAT = 0.985; // cosine: a face that is seen as straight as this hides the others

const unit = (a: Vector3) => scaled(a, 1 / Math.hypot(...a));

export class OrientationCube {
  root: HTMLDivElement;
  svg: SVGSVGElement;
  faces: { view: Side; group: SVGGElement; sheet: SVGRectElement; letter: SVGTextElement; title: SVGTitleElement }[];
  arrows: { path: SVGPathElement; x: number; y: number; view: Side | null }[];
  bar: HTMLDivElement | undefined;
  home: HTMLDivElement | undefined;
  readonly #actions = new Map<SVGElement, () => void>(); // of faces and arrows
  isAnatomical = true; // whether the faces bear letters of a patient's sides

  /** @param choose called with the name of a view */
  constructor(parent: Element, choose: (view: Side) => void, home: () => void) {
    this.root = pageElement("div", "dnb-compass", parent);
    this.svg = svgElement("svg", { class: "dnb-cube", viewBox: "0 0 100 100", "aria-hidden": "true" }, this.root);
    svgElement("rect", { class: "dnb-cube-ground", x: -20, y: -20, width: 140, height: 140 }, this.svg); // for fingers
    this.svg.addEventListener("click", (event) => {
      const part = findPressed([...this.#actions.keys()], event);
      if (part) this.#actions.get(part)?.();
    });
    this.faces = SIDES.map((side) => this.#face(side, choose));
    const ways: Vector2[] = [
      [1, 0],
      [-1, 0],
      [0, 1],
      [0, -1],
    ];
    this.arrows = ways.map(([x, y]) => {
      const path = svgElement(
        "path",
        {
          class: "dnb-turn",
          d: "M 38 -8 L 47 0 L 38 8 Z",
          transform: `translate(50 50) rotate(${(-Math.atan2(y, x) * 180) / Math.PI})`,
        },
        this.svg,
      );
      const arrow: OrientationCube["arrows"][number] = { path, x, y, view: null };
      this.#actions.set(path, () => arrow.view && choose(arrow.view));
      return arrow;
    });
    this.#buttons(choose, home);
  }

  #face([view, letter, title]: (typeof SIDES)[number], choose: (view: Side) => void) {
    const group = svgElement("g", { class: "dnb-face", "data-view": view }, this.svg);
    const words = svgElement("title", {}, group, `${title} (${view})`);
    const sheet = svgElement("rect", { x: -10, y: -10, width: 20, height: 20 }, group);
    const text = svgElement("text", { "text-anchor": "middle", y: 4.4 }, group, letter);
    this.#actions.set(group, () => choose(view));
    return { view, group, sheet, letter: text, title: words };
  }

  /** The same for the keyboard and for screen readers: out of sight until one of them has the focus. */
  #buttons(choose: (view: Side) => void, home: () => void) {
    this.bar = pageElement("div", "dnb-bar", this.root, { role: "toolbar", "aria-label": "view direction" });
    for (const [view, letter, title] of SIDES) {
      const attributes = { title: `${title} (${view})`, "aria-label": `view ${title}` };
      buttonElement("dnb-button", this.bar, letter, () => choose(view), attributes);
    }
    this.home = pageElement("div", "dnb-home", this.root);
    const attributes = { title: "reset (0 or double click)", "aria-label": "reset the view" };
    buttonElement("dnb-button", this.home, "\u27f2", home, attributes);
  }

  /**
   * Add a button below the one that resets the view.
   * @param name of its class
   * @param path of its icon, 16 x 16
   */
  addButton(name: string, path: string, tip: string, action: () => void) {
    return buttonElement(`dnb-button ${name}`, this.home ?? null, iconElement(path), action, named(tip));
  }

  /** Name the faces by the sides of a patient, or by the axes that look at the viewer. */
  #name(isAnatomical: boolean) {
    this.isAnatomical = isAnatomical;
    const buttons = this.bar?.querySelectorAll("button") ?? [];
    SIDES.forEach(([view, letter, words], k) => {
      const face = this.faces[k]!,
        text = isAnatomical ? letter : `${view[0] === "+" ? "\u2212" : "+"}${view[1]}`,
        way = isAnatomical ? words : `along ${view}`;
      face.letter.textContent = text;
      face.title.textContent = isAnatomical ? `${words} (${view})` : way;
      const button = buttons[k];
      if (!button) return;
      button.textContent = text;
      setAttributes(button, { title: face.title.textContent, "aria-label": `view ${way}` });
    });
  }

  /** Draw the cube as the camera sees it. All vectors are in space. */
  draw(
    views: Record<Side, { direction: Vector3; up: Vector3 }>,
    { direction, up, right }: { direction: Vector3; up: Vector3; right: Vector3 },
    isAnatomical = true,
  ) {
    if (isAnatomical !== this.isAnatomical) this.#name(isAnatomical);
    const sides = this.faces.map(({ view, group, sheet }) => {
      const n = scaled(unit(views[view].direction), -1),
        top = unit(views[view].up),
        across = cross(top, n);
      const flat = (v: Vector3, k: number): Vector2 => [k * CUBE_SIDE * dot(v, right), -k * CUBE_SIDE * dot(v, up)];
      const near = -dot(n, direction);
      const [a, b] = flat(across, 0.1),
        [c, d] = flat(top, -0.1),
        [e, f] = flat(n, 1); // a face is 20 units wide
      group.setAttribute("transform", `matrix(${[a, b, c, d, 50 + e, 50 + f].map((x) => x.toFixed(3)).join(" ")})`);
      group.style.display = near > 0.02 ? "" : "none";
      sheet.style.setProperty("--near", near.toFixed(3));
      return { view, near, x: dot(n, right), y: dot(n, up) };
    });
    const isFlat = sides.some(({ near }) => near > FLAT);
    for (const arrow of this.arrows) {
      const { path, x, y } = arrow,
        best = sides.reduce((p, q) => (q.x * x + q.y * y > p.x * x + p.y * y ? q : p));
      arrow.view = isFlat ? best.view : null;
      path.style.display = isFlat ? "" : "none";
    }
  }
}
