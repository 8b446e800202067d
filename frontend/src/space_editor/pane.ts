// One of the three pictures: its pixels, the cross-hair of the other two, and the points in it.

import { Handles, ToolMarks } from "../editor/handles.ts";
import type { PaneContent } from "../generated.ts";
import { dot, scaled, sideOf } from "../maths/camera.ts";
import { clearness, flatPoint, fromPane, inPane, spaceLabel, spaceTip } from "../maths/space.ts";
import type { FlatPoint, PaneInfo, Point, Raster, Vector2, Vector3 } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import type { SpaceEditorView } from "./editor.ts";

const MOST_LABELS = 10; // of points off the slice; of more, only the chosen and the pointed at show their distance
const PANE_MARGIN = 8; // CSS pixels around the picture
const PART_INK = [86, 180, 233, 0.36],
  CUT_INK = [255, 214, 10, 0.9]; // red, green, blue and opacity
// The lines of the cross-hair: upright (the place along a) and level (the place along b).
export const LINES = ["v", "h"] as const;

export type Line = (typeof LINES)[number];

/** A picture of Python: pixels of one or three channels, and the shape of a mask of parts and cuts. */
function makeCanvas(width: number, height: number) {
  return Object.assign(document.createElement("canvas"), { width, height });
}

function contextOf(canvas: HTMLCanvasElement) {
  return canvas.getContext("2d") as CanvasRenderingContext2D;
}

export class SpacePane {
  root: HTMLDivElement;
  title: HTMLSpanElement;
  place: HTMLSpanElement;
  stage: HTMLDivElement;
  canvas: HTMLCanvasElement;
  svg: SVGSVGElement;
  cross: SVGGElement;
  lines: SVGGElement[];
  worst: SVGGElement;
  nodes: SVGPathElement;
  handles: Handles<FlatPoint>;
  marks: ToolMarks;
  letters: HTMLSpanElement[];
  slider: HTMLInputElement;

  view = { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 };
  isFitted = true;
  picture: HTMLCanvasElement | null = null;
  /** The parts and cuts over it */
  shapes: HTMLCanvasElement | null = null;
  /** The depth that is seen at each pixel of a projection */
  depths: Float32Array | null = null;
  /** Of the picture */
  raster: Raster = { shape: [1, 1], spacing: [1, 1], origin: [0, 0] };
  nodesKey = ""; // of the lattice that is drawn
  /** What is painted on the canvas: pixels, their place and the colour around them */
  painted: unknown[] = [];
  /** Points as they are drawn at the depth `flatAt` */
  flat: WeakMap<Point, FlatPoint> = new WeakMap();
  flatAt = "";

  constructor(
    readonly editor: SpaceEditorView,
    readonly index: number,
    parent: HTMLElement,
  ) {
    this.root = pageElement("div", `dnb-sp-pane dnb-sp-pane${index}`, parent, { role: "group" });
    const head = pageElement("div", "dnb-sp-head", this.root);
    this.title = pageElement("span", "dnb-sp-title", head);
    this.place = pageElement("span", "dnb-sp-place", head);
    this.stage = pageElement("div", "dnb-ed-stage dnb-sp-stage", this.root, {
      tabindex: "0",
      role: "application",
      ...OWN_KEYS,
    });
    this.canvas = pageElement("canvas", "dnb-ed-canvas", this.stage, { "aria-hidden": "true" });
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.stage);
    this.cross = svgElement("g", { class: "dnb-sp-cross", "aria-hidden": "true" }, this.svg);
    this.lines = LINES.map((name) => {
      const line = svgElement("g", { class: `dnb-sp-line dnb-sp-line-${name}`, "data-line": name }, this.cross);
      svgElement("path", { class: "dnb-sp-line-hit" }, line);
      svgElement("path", { class: "dnb-sp-line-case" }, line);
      svgElement("path", { class: "dnb-sp-line-ink" }, line);
      return line;
    });
    this.worst = svgElement("g", { class: "dnb-ed-worst", visibility: "hidden", "aria-hidden": "true" }, this.svg);
    for (const name of ["case", "ring"]) svgElement("circle", { r: 9, class: `dnb-ed-worst-${name}` }, this.worst);
    this.nodes = svgElement("path", { class: "dnb-sp-nodes", "aria-hidden": "true" }, this.svg);
    this.handles = new Handles(this.svg, { label: spaceLabel, tip: spaceTip });
    this.marks = new ToolMarks(this.svg, this.handles.points);
    this.letters = ["left", "right", "top", "bottom"].map((side) =>
      pageElement("span", `dnb-sp-letter dnb-sp-${side}`, this.stage, { "aria-hidden": "true" }),
    );
    this.slider = pageElement("input", "dnb-sp-slider", this.root, { type: "range", ...OWN_KEYS });
    this.slider.addEventListener("input", () =>
      editor.frames.guard(() => editor.setDepth(this, Number(this.slider.value))),
    );
    this.slider.addEventListener("change", () => editor.frames.guard(() => editor.lookAtRest()));
  }

  get info(): PaneInfo {
    return this.editor.panes[this.index]!;
  }

  /** The pane that a line stands for, by the direction of a or b in this picture. */
  crossing(name: Line) {
    const along = name === "v" ? this.info.u : this.info.v;
    return this.editor.pictures.find((other) => Math.abs(dot(other.info.n, along)) > 0.9);
  }

  get depth() {
    return inPane(this.info, this.editor.cursor)[2];
  }

  describe() {
    const { name, u, v, depths, spacing } = this.info,
      { isSlice } = this.editor;
    setText(this.title, name);
    this.root.setAttribute("aria-label", `${name} picture`);
    this.stage.setAttribute(
      "aria-label",
      `${name} picture with control points. Arrows move the selected points, or ` +
        "the cross-hair; page up and down go through the slices; question mark lists the keys.",
    );
    [scaled(u, -1), u, scaled(v, -1), v].forEach((way, k) => {
      setText(this.letters[k]!, sideOf(way));
    });
    setAttributes(this.slider, { min: depths[0], max: depths[1], step: spacing[2], "aria-label": `${name} slice` });
    this.slider.hidden = !isSlice;
    const count = Math.round((depths[1] - depths[0]) / spacing[2]) + 1;
    const number = Math.round((this.depth - depths[0]) / spacing[2]) + 1;
    const isHeld = document.activeElement === this.slider && Number(this.slider.value) === this.depth;
    if (!isHeld) this.slider.value = String(this.depth);
    setText(this.place, isSlice ? `${number} / ${count}` : "whole volume");
    this.slider.setAttribute("aria-valuetext", `slice ${number} of ${count}`);
  }

  // ---- the view -----------------------------------------------------------------------------------------------------

  layout(width: number, height: number) {
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1)),
      v = this.view;
    const [dx, dy] = [(width - v.width) / 2, (height - v.height) / 2];
    Object.assign(v, { width, height, ratio });
    this.stage.style.height = `${height}px`;
    Object.assign(this.canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    this.painted = []; // which clears it
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (this.isFitted) this.fitView();
    else Object.assign(v, { x: v.x + dx, y: v.y + dy });
  }

  get fittedScale() {
    const [a0, a1, b0, b1] = this.info.box,
      { width, height } = this.view;
    return Math.max(1e-9, Math.min((width - 2 * PANE_MARGIN) / (a1 - a0), (height - 2 * PANE_MARGIN) / (b1 - b0)));
  }

  fitView() {
    const [a0, a1, b0, b1] = this.info.box,
      { width, height } = this.view,
      k = this.fittedScale;
    Object.assign(this.view, { k, x: width / 2 - (k * (a0 + a1)) / 2, y: height / 2 - (k * (b0 + b1)) / 2 });
    this.isFitted = true;
    this.editor.frames.invalidate();
  }

  panBy(dx: number, dy: number) {
    const [a0, a1, b0, b1] = this.info.box,
      v = this.view,
      rest = 30; // some of the picture stays in sight
    v.x = Math.max(rest - v.k * a1, Math.min(v.width - rest - v.k * a0, v.x + dx));
    v.y = Math.max(rest - v.k * b1, Math.min(v.height - rest - v.k * b0, v.y + dy));
    this.isFitted = false;
    this.editor.frames.invalidate();
  }

  zoomAt(factor: number, x: number = this.view.width / 2, y: number = this.view.height / 2) {
    const v = this.view,
      k = Math.max(this.fittedScale / 2, Math.min(this.fittedScale * 32, v.k * factor)),
      f = k / v.k;
    Object.assign(v, { k, x: x + f * (v.x - x), y: y + f * (v.y - y) });
    this.panBy(0, 0);
  }

  /** Bring a place into the middle of the view, if the picture is not all in sight anyway. */
  lookAt(place: Vector3) {
    const [a, b] = inPane(this.info, place),
      v = this.view;
    if (!this.isFitted) this.panBy(v.width / 2 - v.k * a - v.x, v.height / 2 - v.k * b - v.y);
  }

  // ---- places -------------------------------------------------------------------------------------------------------

  /** @param at in pixels */
  toPlane([x, y]: Vector2) {
    return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k];
  }

  /** The place in space under a place of the screen: on the slice, or what is seen there of the whole volume. */
  under(at: Vector2) {
    const [a, b] = this.toPlane(at) as Vector2;
    return fromPane(this.info, [a, b, this.editor.isSlice ? this.depth : this.#seenDepth(a, b)!]);
  }

  /** The ids of the points in a rectangle of the view; on slices of those near the slice only. */
  pointsInside({ x, y, width, height }: { x: number; y: number; width: number; height: number }) {
    const { view: v, editor } = this,
      depth = editor.isSlice ? this.depth : null;
    return editor.points
      .map((p) => flatPoint(p, this.info, depth))
      .filter(({ target: [a, b], isFar }) => {
        const px = v.k * a + v.x - x,
          py = v.k * b + v.y - y;
        return !isFar && px >= 0 && py >= 0 && px <= width && py <= height;
      })
      .map((p) => p.id);
  }

  isInside(at: Vector2) {
    const [a, b] = this.toPlane(at) as Vector2,
      [a0, a1, b0, b1] = this.info.box;
    return a >= a0 && a <= a1 && b >= b0 && b <= b1;
  }

  #seenDepth(a: number, b: number) {
    if (!this.depths) return this.depth;
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin,
    } = this.raster;
    const column = Math.max(0, Math.min(nu - 1, Math.round((a - origin[0]) / du)));
    const row = Math.max(0, Math.min(nv - 1, Math.round((b - origin[1]) / dv)));
    return this.depths[row * nu + column];
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /**
   * Take over a picture of Python.
   * @param shares of parts and of cuts in each pixel
   */
  take(
    { shape: [height, width], spacing, origin, channels, shapes }: PaneContent,
    pixels: Uint8Array,
    depths: Float32Array | null,
    shares: Uint8Array | null,
  ) {
    const made = new ImageData(width, height),
      out = new Uint32Array(made.data.buffer);
    for (let k = 0; k < out.length; k++) {
      const [r, g, b] =
        channels === 1 ? [pixels[k], pixels[k], pixels[k]] : [pixels[3 * k], pixels[3 * k + 1], pixels[3 * k + 2]];
      out[k] = 0xff000000 | (b! << 16) | (g! << 8) | r!;
    }
    this.picture = makeCanvas(width, height);
    contextOf(this.picture).putImageData(made, 0, 0);
    this.raster = { shape: [height, width], spacing, origin };
    this.depths = depths;
    this.shapes = shapes && shares && this.#tinted(shapes, shares);
  }

  /** Parts and cuts as a translucent picture. */
  #tinted([height, width]: [number, number], shares: Uint8Array) {
    const made = new ImageData(width, height),
      canvas = makeCanvas(width, height);
    for (let k = 0, j = 0; k < shares.length; k += 2, j += 4) {
      const [ink, share] = shares[k + 1] ? [CUT_INK, shares[k + 1]] : [PART_INK, shares[k]];
      made.data.set(ink.slice(0, 3), j);
      made.data[j + 3] = ink[3]! * share!;
    }
    contextOf(canvas).putImageData(made, 0, 0);
    return canvas;
  }

  draw() {
    this.#paint();
    this.describe();
    this.#drawCross();
    this.#drawWorst();
    this.#drawNodes();
    return this.#drawPoints();
  }

  /**
   * Paint picture, parts and cuts, unless they are on the canvas: of moving points most frames bring no other picture.
   */
  #paint() {
    const {
      view: v,
      editor: {
        theme: {
          colours: { stage },
        },
      },
      picture,
      shapes,
    } = this;
    const painted = [picture, shapes, stage, v.k, v.x, v.y];
    if (painted.every((value, k) => value === this.painted[k])) return;
    this.painted = painted;
    const c = contextOf(this.canvas);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = stage;
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (picture) {
      const {
        shape: [nv, nu],
        spacing: [du, dv],
        origin: [a, b],
      } = this.raster;
      c.setTransform(v.ratio, 0, 0, v.ratio, 0, 0);
      c.imageSmoothingQuality = "high";
      const x = v.k * (a - du / 2) + v.x,
        y = v.k * (b - dv / 2) + v.y,
        width = v.k * du * nu,
        height = v.k * dv * nv;
      c.drawImage(picture, x, y, width, height);
      if (shapes) c.drawImage(shapes, x, y, width, height);
    }
  }

  /** Draw the lattice to which targets snap, as small crosses where it is wide enough to be seen. */
  #drawNodes() {
    const {
      editor,
      view: { k, x, y },
      info: {
        box: [a0, a1, b0, b1],
        spacing: [du, dv],
      },
    } = this;
    const step = editor.model.get("snap") || 0,
      key = `${step} ${k} ${x} ${y}`;
    if (key === this.nodesKey) return;
    this.nodesKey = key;
    let path = "";
    for (let a = a0 + du / 2; step * k >= 5 && a < a1; a += step) {
      for (let b = b0 + dv / 2; b < b1; b += step) {
        path += `M ${(k * a + x - 2).toFixed(1)} ${(k * b + y).toFixed(1)} h 4 m -2 -2 v 4`;
      }
    }
    this.nodes.setAttribute("d", path);
  }

  #drawCross() {
    const { view: v } = this,
      [a, b] = inPane(this.info, this.editor.cursor),
      x = v.k * a + v.x,
      y = v.k * b + v.y;
    const gap = 12; // the middle stays free to be looked at
    const paths = [
      `M ${x} 0 V ${y - gap} M ${x} ${y + gap} V ${v.height}`,
      `M 0 ${y} H ${x - gap} M ${x + gap} ${y} H ${v.width}`,
    ];
    this.lines.forEach((line, k) => {
      for (const path of line.children) setAttributes(path, { d: paths[k]! });
      line.style.setProperty("--dnb-line-ink", `var(--dnb-pane${this.crossing(LINES[k]!)?.index})`);
    });
  }

  /** Draw a ring where the map folds most, as Python has found it when the points last rested. */
  #drawWorst() {
    const {
      facts: { folds, worst },
      points,
    } = this.editor;
    const place = points.length && folds && folds[0] <= 0 ? worst : null;
    const [a, b] = place ? inPane(this.info, place) : [0, 0],
      { k, x, y } = this.view;
    setAttributes(this.worst, {
      visibility: place ? "visible" : "hidden",
      transform: `translate(${(k * a + x).toFixed(1)} ${(k * b + y).toFixed(1)})`,
    });
  }

  /**
   * The points in this picture; those that have not moved since the last frame are the same objects, not drawn again.
   */
  #flatPoints() {
    const { editor, info } = this,
      depth = editor.isSlice ? this.depth : null,
      at = JSON.stringify([info, depth]);
    if (at !== this.flatAt) {
      this.flatAt = at;
      this.flat = new WeakMap();
    }
    return editor.points.map((p) => {
      const made = this.flat.get(p) ?? flatPoint(p, info, depth);
      this.flat.set(p, made);
      return made;
    });
  }

  /** Draw the points. Returns whether the focus was on a point that is gone. */
  #drawPoints(): boolean {
    const { editor, info } = this,
      flat = this.#flatPoints(),
      thick = info.box[5] - info.box[4];
    flat.sort((p, q) => Number(q.isFar) - Number(p.isFar)); // those on the slice are drawn last and grabbed first
    this.svg.classList.toggle("dnb-sp-many", flat.filter((p) => p.isFar).length > MOST_LABELS);
    const isFocusLost = this.handles.update(flat, editor.selected, this.view, 0, 0);
    for (const p of flat) {
      const parts = this.handles.byId.get(p.id);
      if (!parts) continue;
      for (const part of [parts.target, parts.source, parts.arrow]) {
        part.classList.toggle("dnb-sp-far", p.isFar);
        part.style.opacity = p.isFar ? String(clearness(p.away, thick)) : "";
      }
    }
    this.#drawMarks(flat);
    return isFocusLost;
  }

  /** Draw the handle that turns, and the plane of the mirror where it is seen from its edge. */
  #drawMarks(flat: FlatPoint[]) {
    const { editor } = this,
      { k, x, y } = this.view,
      none = { isOn: false };
    const mirror = editor.pointTools.mirrorIn(this.info) ?? { on: false, axis: "a", at: 0 };
    const selected = editor.selected.size > 1 ? editor.selected : new Set<number>(); // one point has nothing to turn
    this.marks.update({
      mirror,
      view: this.view,
      gripAway: 34,
      points: flat,
      selected,
      brush: none,
      pen: none,
      isLocked: editor.isLocked,
      isHolding: editor.drag0 !== null,
      isAdding: editor.isAdding,
      onView: ([a, b]) => [k * a + x, k * b + y],
    });
  }
}
