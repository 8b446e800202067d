// Cuts and rigid parts as SVG over the picture, under the control points. A cut is a line with a band in the colour of
// the region on each of its sides; a rigid part is hatched. What a hand can take: the line, and of the chosen shape its
// corners (squares) and the middles of its edges (dots).

import { shownLength } from "../maths/numbers.js";
import { maskPixels } from "../maths/regions.js";
import { cornersOf, SHAPE_NAMES, shapeLabel, shapeName } from "../maths/shapes.js";
import { OWN_KEYS, setAttributes, setText, svgElement } from "../ui/dom.js";

export const REGION_MARKS = 8; // colours and forms of regions; more than eight regions begin again
// Forms tell the regions apart without colours: disc, diamond, triangle, hexagon, star, cross, bar, drop.
export const REGION_FORMS = ["", "M0-8.2L8.2 0 0 8.2-8.2 0Z", "M0-8L7.6 6H-7.6Z", "M-4.2-7.3H4.2L8.4 0 4.2 7.3H-4.2L-8.4 0Z",
  "M0-9L2.6-3.2 8.7-2.7 4.1 1.4 5.5 7.5 0 4.3-5.5 7.5-4.1 1.4-8.7-2.7-2.6-3.2Z",
  "M-2.8-8H2.8V-2.8H8V2.8H2.8V8H-2.8V2.8H-8V-2.8H-2.8Z", "M-8.5-4H8.5V4H-8.5Z", "M0-9L6 1A6 6 0 1 1-6 1Z"];

export class ShapeHandles {
  constructor(svg) {
    this.svg = svg;
    const defs = svgElement("defs", {}, svg), id = `dnb-hatch-${Math.random().toString(36).slice(2)}`;
    const hatch = svgElement("pattern", { id, width: 9, height: 9, patternUnits: "userSpaceOnUse",
      patternTransform: "rotate(45)" }, defs);
    svgElement("rect", { width: 9, height: 9, class: "dnb-ed-hatch-ground" }, hatch);
    svgElement("path", { d: "M2 0V9", class: "dnb-ed-hatch-case" }, hatch);
    svgElement("path", { d: "M2 0V9", class: "dnb-ed-hatch-line" }, hatch);
    this.hatch = `url(#${id})`;
    this.root = svgElement("g", { class: "dnb-ed-shapes" }, svg);
    this.grips = svgElement("g", { class: "dnb-ed-grips" }, svg);
    this.draft = svgElement("g", { class: "dnb-ed-draft", visibility: "hidden", "aria-hidden": "true" }, svg);
    this.shown = new Map();
    this.draftParts = ["case", "line", "next", "start", "cursor"].map((name) => svgElement(name === "start" || name === "cursor"
      ? "circle" : "path", { class: `dnb-ed-draft-${name}` }, this.draft));
  }

  // `chosen` is {what, index} or null; sideKey(a, b) says in which region a place lies; reach as in maths/shapes.js.
  update(shapes, chosen, view, { reach, sideKey, isLocked }) {
    const seen = new Set(), focused = this.svg.getRootNode().activeElement;
    let isFocusLost = false;
    for (const what of ["parts", "cuts"]) {
      shapes[what].forEach((shape, index) => {
        const key = `${what}:${index}`;
        seen.add(key);
        this.#place(this.shown.get(key) ?? this.#make(key, what), shape, what, index, view, reach, sideKey,
          chosen?.what === what && chosen.index === index);
      });
    }
    for (const [key, parts] of this.shown) {
      if (seen.has(key)) continue;
      isFocusLost ||= parts.root === focused;
      parts.root.remove();
      this.shown.delete(key);
    }
    const shape = chosen ? shapes[chosen.what][chosen.index] : null;
    return this.#placeGrips(isLocked ? null : shape, chosen, view, reach, focused) || isFocusLost;
  }

  #make(key, what) {
    const root = svgElement("g", { class: `dnb-ed-shape dnb-ed-${what === "cuts" ? "cut" : "part"}`, "data-shape": key,
      tabindex: "0", role: "button", "aria-roledescription": SHAPE_NAMES[what], ...OWN_KEYS });
    const at = what === "parts" ? [...this.root.children].find((node) => node.dataset.shape.startsWith("cuts")) : null;
    this.root.insertBefore(root, at ?? null); // cuts over parts
    const parts = { root, tip: svgElement("title", {}, root), bands: [] };
    for (const name of ["fill", "halo", "case", "bands", "far-case", "far", "line", "moved-case", "moved", "hit"]) {
      parts[name] = svgElement(name === "bands" ? "g" : "path", { class: `dnb-ed-shape-${name}` }, root);
    }
    parts.fill.setAttribute("fill", what === "parts" ? this.hatch : "none");
    parts.name = svgElement("text", { class: "dnb-ed-shape-name" }, root);
    this.shown.set(key, parts);
    return parts;
  }

  #place(parts, shape, what, index, view, reach, sideKey, isChosen) {
    const { region } = shape, label = shapeLabel(shape, what, index);
    parts.root.classList.toggle("dnb-ed-off", !shape.enabled);
    parts.root.classList.toggle("dnb-ed-chosen", isChosen);
    setAttributes(parts.root, { "aria-label": label, "aria-pressed": String(isChosen) });
    setText(parts.tip, `${label}. Click to choose it`);
    const { line, far, inside, label: [x, y] } = shapePaths(region, view, reach);
    const whole = region.kind === "half_space" ? far : line;
    setAttributes(parts.fill, { d: what === "parts" && shape.enabled ? inside : "" });
    for (const name of ["halo", "case", "line"]) setAttributes(parts[name], { d: region.kind === "half_space" ? far : line });
    for (const name of ["far-case", "far"]) setAttributes(parts[name], { d: region.kind === "line" ? far : "" });
    for (const name of ["moved-case", "moved"]) {
      setAttributes(parts[name], shape.motion && shape.enabled ? { d: whole, transform: onScreen(shape.motion, view) } : { d: "" });
    }
    setAttributes(parts.hit, { d: whole + (region.kind === "line" ? far : "") });
    this.#bands(parts, what === "cuts" && shape.enabled ? sideBands(region, view, reach, sideKey) : []);
    const isNamed = Boolean(shape.name) || isChosen;
    setAttributes(parts.name, { x: x.toFixed(1), y: y.toFixed(1), visibility: isNamed ? "visible" : "hidden" });
    setText(parts.name, `${shapeName(shape, what, index)}${shape.enabled ? "" : " (off)"}`);
  }

  #bands(parts, bands) {
    while (parts.bands.children.length > bands.length) parts.bands.lastChild.remove();
    bands.forEach(({ d, mark }, k) => {
      setAttributes(parts.bands.children[k] ?? svgElement("path", {}, parts.bands), { d, "data-region": mark });
    });
  }

  #placeGrips(shape, chosen, { k, x, y }, reach, focused) {
    const region = shape?.region, corners = region ? cornersOf(region, reach) : [], n = corners.length;
    const edges = region?.vertices ? (region.kind === "polygon" ? n : n - 1) : 0;
    const places = [...corners.map((place, i) => ["corner", i, place]), ...Array.from({ length: edges }, (_, i) => {
      const p = corners[i], q = corners[(i + 1) % n];
      return ["middle", i, [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2]];
    })];
    let isFocusLost = false;
    while (this.grips.children.length > places.length) {
      isFocusLost ||= this.grips.lastChild === focused;
      this.grips.lastChild.remove();
    }
    places.forEach(([sort, i, [a, b]], at) => {
      const grip = this.grips.children[at] ?? this.#makeGrip();
      const edge = sort === "middle" ? corners[(i + 1) % n].map((v, c) => k * (v - corners[i][c])) : [99, 99];
      setAttributes(grip, { transform: `translate(${(k * a + x).toFixed(2)} ${(k * b + y).toFixed(2)})`,
        class: `dnb-ed-grip dnb-ed-${sort}`, "data-corner": "", "data-middle": "", [`data-${sort}`]: i,
        visibility: Math.hypot(...edge) < 26 ? "hidden" : "visible",
        "aria-label": sort === "corner" ? `Corner ${i + 1} of ${n} of ${shapeName(shape, chosen.what, chosen.index)}, at ` +
          `${[a, b].map(shownLength).join(", ")}` : `Middle of edge ${i + 1}: Enter makes it a corner` });
    });
    return isFocusLost;
  }

  #makeGrip() {
    const grip = svgElement("g", { tabindex: "0", role: "button", ...OWN_KEYS }, this.grips);
    svgElement("circle", { r: 11, class: "dnb-ed-hit" }, grip);
    svgElement("circle", { r: 9, class: "dnb-ed-grip-halo" }, grip);
    svgElement("rect", { x: -4.5, y: -4.5, width: 9, height: 9, class: "dnb-ed-grip-square" }, grip);
    svgElement("circle", { r: 3.2, class: "dnb-ed-grip-dot" }, grip);
    return grip;
  }

  focus({ what, index }) { this.shown.get(`${what}:${index}`)?.root.focus({ preventScroll: true }); }

  focusCorner(k) { this.grips.querySelector(`[data-corner="${k}"]`)?.focus({ preventScroll: true }); }

  // What is being drawn: places that are set, and the one that would come next.
  showDraft(draft, { k, x, y }) {
    const [casing, line, next, start, cursor] = this.draftParts;
    setAttributes(this.draft, { visibility: draft ? "visible" : "hidden" });
    if (!draft) return;
    const at = draft.places.map(([a, b]) => [k * a + x, k * b + y]), d = shapePath(at);
    setAttributes(casing, { d });
    setAttributes(line, { d });
    const end = draft.next ? [k * draft.next[0] + x, k * draft.next[1] + y] : null, last = at[at.length - 1];
    const ahead = draft.tool === "part" && at.length > 1 ? [last, end, at[0]] : [last, end];
    setAttributes(next, { d: end && last ? shapePath(ahead) : "" });
    setAttributes(start, { r: draft.canClose ? 7 : 4, visibility: at.length ? "inherit" : "hidden",
      cx: (at[0]?.[0] ?? 0).toFixed(1), cy: (at[0]?.[1] ?? 0).toFixed(1) });
    setAttributes(cursor, { r: 6, visibility: draft.isByKeys && end ? "inherit" : "hidden", cx: (end?.[0] ?? 0).toFixed(1),
      cy: (end?.[1] ?? 0).toFixed(1) });
    this.draft.classList.toggle("dnb-ed-closing", Boolean(draft.isClosing));
  }
}

// A motion in the picture as one of CSS pixels.
function onScreen({ matrix: [[a, c], [b, d]], shift: [s, t] }, { k, x, y }) {
  return `matrix(${[a, b, c, d, k * s + x - a * x - c * y, k * t + y - b * x - d * y].map((v) => v.toFixed(6)).join(" ")})`;
}

function shapePath(places, isClosed = false) {
  return places.length ? `M${places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${isClosed ? "Z" : ""}` : "";
}

// In CSS pixels: the line as drawn, its continuation without end, the inside, and where its name stands.
export function shapePaths(region, { k, x, y, width, height }, reach) {
  const on = ([a, b]) => [k * a + x, k * b + y], endless = 3 * (width + height);
  if (region.kind === "mask") return maskPaths(region, on);
  const at = cornersOf(region, reach).map(on), n = at.length, away = ([px, py], [qx, qy]) => {
    const length = Math.hypot(qx - px, qy - py) || 1;
    return [qx + endless * (qx - px) / length, qy + endless * (qy - py) / length];
  };
  const first = n > 1 ? away(at[1], at[0]) : at[0], last = n > 1 ? away(at[n - 2], at[n - 1]) : at[0];
  const label = at.reduce((best, p) => (p[1] < best[1] ? p : best), at[0]);
  const name = [Math.max(6, Math.min(width - 80, label[0] + 8)), Math.max(16, Math.min(height - 8, label[1] - 8))];
  const paths = { line: shapePath(at, region.kind === "polygon"), far: "", inside: "", label: name };
  if (region.kind === "polygon") return { ...paths, inside: paths.line };
  if (region.kind === "line") return { ...paths, far: shapePath([at[0], first]) + shapePath([at[n - 1], last]) };
  const [na, nb] = region.normal, back = ([px, py]) => [px - 2 * endless * na, py - 2 * endless * nb];
  return { ...paths, far: shapePath([first, last]), inside: shapePath([first, last, back(last), back(first)], true) };
}

const maskOutlines = new WeakMap();

// The faces of the pixels of a mask where it ends, row by row and column by column.
function maskPaths(region, on) {
  let faces = maskOutlines.get(region);
  if (!faces) {
    const { shape: [nv, nu], spacing: [du, dv], origin: [a0, b0] } = region, isSet = maskPixels(region);
    const at = (i, j) => i >= 0 && j >= 0 && i < nv && j < nu && isSet[i * nu + j] === 1;
    const edge = (i, j, m, n) => [[a0 + (j - 0.5) * du, b0 + (i - 0.5) * dv], [a0 + (n - 0.5) * du, b0 + (m - 0.5) * dv]];
    faces = [];
    for (let i = 0; i <= nv; i++) for (let j = 0, from = -1; j <= nu; j++) {
      const is = j < nu && at(i, j) !== at(i - 1, j);
      if (is && from < 0) from = j;
      if (!is && from >= 0) { faces.push(edge(i, from, i, j)); from = -1; }
    }
    for (let j = 0; j <= nu; j++) for (let i = 0, from = -1; i <= nv; i++) {
      const is = i < nv && at(i, j) !== at(i, j - 1);
      if (is && from < 0) from = i;
      if (!is && from >= 0) { faces.push(edge(from, j, i, j)); from = -1; }
    }
    faces.spans = [];
    for (let i = 0; i < nv; i++) for (let j = 0, from = -1; j <= nu; j++) {
      if (at(i, j) && from < 0) from = j;
      if (!at(i, j) && from >= 0) { faces.spans.push([edge(i, from, i, j), edge(i + 1, from, i + 1, j)]); from = -1; }
    }
    maskOutlines.set(region, faces);
  }
  const line = faces.map(([p, q]) => shapePath([on(p), on(q)])).join("");
  const inside = faces.spans.map(([[p, q], [r, s]]) => shapePath([on(p), on(q), on(s), on(r)], true)).join("");
  const top = faces.length ? on(faces[0][0]) : [0, 0];
  return { line, far: "", inside, label: [top[0] + 8, top[1] - 8] };
}

// Along every edge of a cut a line on either side, with the mark of the region that lies there.
function sideBands(region, { k, x, y, width, height }, reach, sideKey) {
  if (region.kind === "mask") return [];
  const corners = cornersOf(region, reach), n = corners.length, bands = [], off = 4, endless = 3 * (width + height);
  const edges = region.kind === "polygon" ? n : n - 1;
  for (let j = 0; j < edges; j++) {
    const p = corners[j], q = corners[(j + 1) % n], length = Math.hypot(q[0] - p[0], q[1] - p[1]);
    if (!length) continue;
    const [ta, tb] = [(q[0] - p[0]) / length, (q[1] - p[1]) / length], isOpen = region.kind !== "polygon";
    const before = isOpen && j === 0 ? endless : 0, after = isOpen && j === edges - 1 ? endless : 0;
    for (const side of [-1, 1]) {
      const na = -side * tb, nb = side * ta, nudge = Math.min(1.5 / k, length / 4);
      const mark = sideKey((p[0] + q[0]) / 2 + nudge * na, (p[1] + q[1]) / 2 + nudge * nb) % REGION_MARKS;
      const place = ([a, b], along) => [k * a + x + off * na + along * ta, k * b + y + off * nb + along * tb];
      bands.push({ d: shapePath([place(p, -before), place(q, after)]), mark });
    }
  }
  return bands;
}
