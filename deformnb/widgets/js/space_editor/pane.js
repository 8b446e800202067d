// One of the three pictures: its pixels, the cross-hair of the other two, and the points in it.

import { Handles, HandMarks } from "../editor/handles.js";
import { dot, scaled, sideOf } from "../maths/camera.js";
import { clearness, flatPoint, fromPane, inPane, spaceLabel, spaceTip } from "../maths/space.js";
import { OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.js";

const MOST_LABELS = 10; // of points off the slice; of more, only those say how far away that are chosen or pointed at
const PANE_MARGIN = 8; // CSS pixels around the picture
const PART_INK = [86, 180, 233, 0.36], CUT_INK = [255, 214, 10, 0.9]; // red, green, blue and how much of it
const LINES = ["v", "h"]; // the cross-hair: upright (the place along a) and level (the place along b)

export class SpacePane {
  constructor(page, index, parent) {
    Object.assign(this, { page, index, picture: null, depths: null, isFitted: true,
      view: { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 } });
    this.root = pageElement("div", `dnb-sp-pane dnb-sp-pane${index}`, parent, { role: "group" });
    const head = pageElement("div", "dnb-sp-head", this.root);
    this.title = pageElement("span", "dnb-sp-title", head);
    this.place = pageElement("span", "dnb-sp-place", head);
    this.stage = pageElement("div", "dnb-ed-stage dnb-sp-stage", this.root, { tabindex: "0", role: "application", ...OWN_KEYS });
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
    for (const name of ["dnb-ed-worst-case", "dnb-ed-worst-ring"]) svgElement("circle", { r: 9, class: name }, this.worst);
    this.nodes = svgElement("path", { class: "dnb-sp-nodes", "aria-hidden": "true" }, this.svg);
    this.handles = new Handles(this.svg, { label: spaceLabel, tip: spaceTip });
    this.marks = new HandMarks(this.svg, this.handles.points);
    this.letters = ["left", "right", "top", "bottom"].map((side) => (
      pageElement("span", `dnb-sp-letter dnb-sp-${side}`, this.stage, { "aria-hidden": "true" })));
    this.slider = pageElement("input", "dnb-sp-slider", this.root, { type: "range", ...OWN_KEYS });
    this.slider.addEventListener("input", () => page.guard(() => page.setDepth(this, Number(this.slider.value))));
    this.slider.addEventListener("change", () => page.guard(() => page.lookAtRest()));
  }

  get info() { return this.page.panes[this.index]; }

  // The panes that the upright and the level line stand for, by what runs along a and along b in this picture.
  crossing(name) {
    const along = name === "v" ? this.info.u : this.info.v;
    return this.page.pictures.find((other) => Math.abs(dot(other.info.n, along)) > 0.9);
  }

  get depth() { return inPane(this.info, this.page.cursor)[2]; }

  describe() {
    const { name, u, v, depths, spacing } = this.info, { isSlice } = this.page;
    setText(this.title, name);
    this.root.setAttribute("aria-label", `${name} picture`);
    this.stage.setAttribute("aria-label", `${name} picture with control points. Arrows move the selected points, or the ` +
      "cross-hair; page up and down go through the slices; question mark lists the keys.");
    [[u, -1], [u, 1], [v, -1], [v, 1]].forEach(([w, sign], k) => setText(this.letters[k], sideOf(scaled(w, sign))));
    setAttributes(this.slider, { min: depths[0], max: depths[1], step: spacing[2], "aria-label": `${name} slice` });
    this.slider.hidden = !isSlice;
    const count = Math.round((depths[1] - depths[0]) / spacing[2]) + 1;
    const number = Math.round((this.depth - depths[0]) / spacing[2]) + 1;
    if (document.activeElement !== this.slider || Number(this.slider.value) !== this.depth) this.slider.value = this.depth;
    setText(this.place, isSlice ? `${number} / ${count}` : "whole volume");
    this.slider.setAttribute("aria-valuetext", `slice ${number} of ${count}`);
  }

  // ---- the view -----------------------------------------------------------------------------------------------------

  layout(width, height) {
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1)), v = this.view;
    const [dx, dy] = [(width - v.width) / 2, (height - v.height) / 2];
    Object.assign(v, { width, height, ratio });
    this.stage.style.height = `${height}px`;
    Object.assign(this.canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (this.isFitted) this.fitView();
    else Object.assign(v, { x: v.x + dx, y: v.y + dy });
  }

  get fittedScale() {
    const [a0, a1, b0, b1] = this.info.box, { width, height } = this.view;
    return Math.max(1e-9, Math.min((width - 2 * PANE_MARGIN) / (a1 - a0), (height - 2 * PANE_MARGIN) / (b1 - b0)));
  }

  fitView() {
    const [a0, a1, b0, b1] = this.info.box, { width, height } = this.view, k = this.fittedScale;
    Object.assign(this.view, { k, x: width / 2 - k * (a0 + a1) / 2, y: height / 2 - k * (b0 + b1) / 2 });
    this.isFitted = true;
    this.page.invalidate();
  }

  panBy(dx, dy) {
    const [a0, a1, b0, b1] = this.info.box, v = this.view, rest = 30; // some of the picture stays in sight
    v.x = Math.max(rest - v.k * a1, Math.min(v.width - rest - v.k * a0, v.x + dx));
    v.y = Math.max(rest - v.k * b1, Math.min(v.height - rest - v.k * b0, v.y + dy));
    this.isFitted = false;
    this.page.invalidate();
  }

  zoomAt(factor, x = this.view.width / 2, y = this.view.height / 2) {
    const v = this.view, k = Math.max(this.fittedScale / 2, Math.min(this.fittedScale * 32, v.k * factor)), f = k / v.k;
    Object.assign(v, { k, x: x + f * (v.x - x), y: y + f * (v.y - y) });
    this.panBy(0, 0);
  }

  // A place in the middle of the view, if it is not all in sight anyway.
  lookAt(place) {
    const [a, b] = inPane(this.info, place), v = this.view;
    if (!this.isFitted) this.panBy(v.width / 2 - v.k * a - v.x, v.height / 2 - v.k * b - v.y);
  }

  // ---- places -------------------------------------------------------------------------------------------------------

  toPlane([x, y]) { return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k]; }

  // The place in space under a place of the screen: on the slice, or what is seen there of the whole volume.
  under(at) {
    const [a, b] = this.toPlane(at);
    return fromPane(this.info, [a, b, this.page.isSlice ? this.depth : this.#seenDepth(a, b)]);
  }

  // Points in a rectangle of the view; on slices those near the slice only.
  pointsInside({ x, y, width, height }) {
    const { view: v, page } = this, depth = page.isSlice ? this.depth : null;
    return page.points.map((p) => flatPoint(p, this.info, depth)).filter(({ target: [a, b], isFar }) => {
      const px = v.k * a + v.x - x, py = v.k * b + v.y - y;
      return !isFar && px >= 0 && py >= 0 && px <= width && py <= height;
    }).map((p) => p.id);
  }

  isInside(at) {
    const [a, b] = this.toPlane(at), [a0, a1, b0, b1] = this.info.box;
    return a >= a0 && a <= a1 && b >= b0 && b <= b1;
  }

  #seenDepth(a, b) {
    if (!this.depths) return this.depth;
    const { shape: [nv, nu], spacing: [du, dv], origin } = this.raster;
    const column = Math.max(0, Math.min(nu - 1, Math.round((a - origin[0]) / du)));
    const row = Math.max(0, Math.min(nv - 1, Math.round((b - origin[1]) / dv)));
    return this.depths[row * nu + column];
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  // A picture of Python: pixels of one or three channels; of projections the depth that is seen at each, of slices how
  // much of each place lies in a rigid part and on a cut.
  take({ shape: [height, width], spacing, origin, channels, shapes }, pixels, depths, shares) {
    const made = new ImageData(width, height), out = new Uint32Array(made.data.buffer);
    for (let k = 0; k < out.length; k++) {
      const [r, g, b] = channels === 1 ? [pixels[k], pixels[k], pixels[k]]
        : [pixels[3 * k], pixels[3 * k + 1], pixels[3 * k + 2]];
      out[k] = 0xff000000 | (b << 16) | (g << 8) | r;
    }
    this.picture = Object.assign(document.createElement("canvas"), { width, height });
    this.picture.getContext("2d").putImageData(made, 0, 0);
    this.raster = { shape: [height, width], spacing, origin };
    this.depths = depths;
    this.shapes = shapes && this.#tinted(shapes, shares);
  }

  #tinted([height, width], shares) {
    const made = new ImageData(width, height), canvas = Object.assign(document.createElement("canvas"), { width, height });
    for (let k = 0, j = 0; k < shares.length; k += 2, j += 4) {
      const [ink, share] = shares[k + 1] ? [CUT_INK, shares[k + 1]] : [PART_INK, shares[k]];
      made.data.set(ink.slice(0, 3), j);
      made.data[j + 3] = ink[3] * share;
    }
    canvas.getContext("2d").putImageData(made, 0, 0);
    return canvas;
  }

  draw() {
    const { view: v, page } = this, c = this.canvas.getContext("2d");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = page.colours.stage;
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (this.picture) {
      const { shape: [nv, nu], spacing: [du, dv], origin: [a, b] } = this.raster;
      c.setTransform(v.ratio, 0, 0, v.ratio, 0, 0);
      c.imageSmoothingQuality = "high";
      const box = [v.k * (a - du / 2) + v.x, v.k * (b - dv / 2) + v.y, v.k * du * nu, v.k * dv * nv];
      c.drawImage(this.picture, ...box);
      if (this.shapes) c.drawImage(this.shapes, ...box);
    }
    this.describe();
    this.#drawCross();
    this.#drawWorst();
    this.#drawNodes();
    return this.#drawPoints();
  }

  // The lattice to which targets keep, as small crosses where it is wide enough to be seen.
  #drawNodes() {
    const { page, view: { k, x, y }, info: { box: [a0, a1, b0, b1], spacing: [du, dv] } } = this, step = page.model.get("snap") || 0;
    const told = `${step} ${k} ${x} ${y}`;
    if (told === this.nodesTold) return;
    this.nodesTold = told;
    let path = "";
    for (let a = a0 + du / 2; step * k >= 5 && a < a1; a += step) {
      for (let b = b0 + dv / 2; b < b1; b += step) path += `M ${(k * a + x - 2).toFixed(1)} ${(k * b + y).toFixed(1)} h 4 m -2 -2 v 4`;
    }
    this.nodes.setAttribute("d", path);
  }

  #drawCross() {
    const { view: v } = this, [a, b] = inPane(this.info, this.page.cursor), x = v.k * a + v.x, y = v.k * b + v.y;
    const gap = 12; // the middle stays free to be looked at
    const paths = [`M ${x} 0 V ${y - gap} M ${x} ${y + gap} V ${v.height}`, `M 0 ${y} H ${x - gap} M ${x + gap} ${y} H ${v.width}`];
    this.lines.forEach((line, k) => {
      for (const path of line.children) path.setAttribute("d", paths[k]);
      line.style.setProperty("--dnb-line-ink", `var(--dnb-pane${this.crossing(LINES[k]).index})`);
    });
  }

  // A ring where the map folds most, as Python has found it when the points last rested.
  #drawWorst() {
    const { facts: { folds, worst }, points } = this.page, isShown = points.length > 0 && Boolean(worst) && folds?.[0] <= 0;
    const [a, b] = isShown ? inPane(this.info, worst) : [0, 0], { k, x, y } = this.view;
    setAttributes(this.worst, { visibility: isShown ? "visible" : "hidden",
      transform: `translate(${(k * a + x).toFixed(1)} ${(k * b + y).toFixed(1)})` });
  }

  #drawPoints() {
    const { page, info } = this, depth = page.isSlice ? this.depth : null;
    const flat = page.points.map((p) => flatPoint(p, info, depth)), thick = info.box[5] - info.box[4];
    flat.sort((p, q) => Number(q.isFar) - Number(p.isFar)); // those on the slice are drawn last and grabbed first
    this.svg.classList.toggle("dnb-sp-many", flat.filter((p) => p.isFar).length > MOST_LABELS);
    const isFocusLost = this.handles.update(flat, page.selected, this.view, 0, 0);
    for (const p of flat) {
      const parts = this.handles.byId.get(p.id);
      for (const part of [parts.target, parts.source, parts.arrow]) {
        part.classList.toggle("dnb-sp-far", p.isFar);
        part.style.opacity = p.isFar ? clearness(p.away, thick) : "";
      }
    }
    this.#drawMarks(flat);
    return isFocusLost;
  }

  // The handle that turns, and the plane of the mirror where it is seen from its edge.
  #drawMarks(flat) {
    const { page } = this, { k, x, y } = this.view, mirror = page.mirrorIn(this.info) ?? { on: false, axis: "a", at: 0 };
    const isTurning = page.selected.size > 1, none = { isOn: false };
    this.marks.update({ mirror, view: this.view, gripAway: 34, points: flat, selected: isTurning ? page.selected : new Set(), brush: none, pen: none,
      isLocked: page.isLocked, isHolding: page.drag0 !== null, isAdding: page.isAdding, onView: ([a, b]) => [k * a + x, k * b + y] });
  }
}
