// Cuts and rigid parts as SVG over the picture, under the control points. A cut is a line with a band in the colour of
// the region on each of its sides; a rigid part is hatched, and drawn where its motion takes it, with a thin line where
// it was. Of the chosen shape the line can be dragged, its corners (squares) and the middles of its edges (dots); of a
// part its inside too, which moves it (editor/part_moves.ts).

import { outlineOf } from "../maths/mask_outlines.ts";
import { formatLength } from "../maths/numbers.ts";
import {
  cornersOf,
  middleOfRegion,
  motionOf,
  movePlace,
  SHAPE_NAMES,
  shapeLabel,
  shapeName,
  stopsAt,
} from "../maths/shapes.ts";
import type { MaskData, Motion, RegionData, ShapeData, ShapeKind, Shapes, Vector2 } from "../types.ts";
import { OWN_KEYS, setAttributes, setText, svgElement, treeOf } from "../ui/dom.ts";
import { EDITOR_KEYS, tipOf } from "../ui/keys.ts";
import type { View } from "./painter.ts";
export type Chosen = { what: ShapeKind; index: number };
/** A corner, the middle of an edge, or neither */
export type Grip = { corner: number | null; middle: number | null };
/** The number of the region that contains a place */
export type SideKey = (a: number, b: number) => number;

/** A shape that is being drawn: the places set so far, and the next one. */
export type Draft = {
  tool: string;
  places: Vector2[];
  next: Vector2 | null;
  isByKeys?: boolean;
  canClose?: boolean;
  isClosing?: boolean;
};

/**
 * Paths in CSS pixels: the line as drawn, its continuation without end, discs where a cut stops, the inside, and where
 * its name is.
 */
export type ShapePaths = { line: string; far: string; tips: string; inside: string; label: Vector2 };

/** The elements of a shape. */
export interface ShapeParts
  extends Record<"inside" | "fill" | "halo" | "case" | "line" | "tips" | "hit", SVGPathElement> {
  root: SVGGElement;
  tip: SVGTitleElement;
  body: SVGGElement;
  bands: SVGGElement;
  name: SVGTextElement;
  /** Its place before its motion. */
  were: SVGPathElement[];
  far: SVGPathElement[];
}

const NAME_IN = [34, 30]; // CSS pixels from the pivot on the line to the name of a fixed side, and half its width
const LEAST_ROOM = 26; // CSS pixels of an edge, below which its middle is no grip
const SWAP_ROOM = [30, 138, 14]; // CSS pixels of the button that swaps sides: from a corner, from the ring, to the edge
const SMALL = 20; // CSS pixels: of a part that reaches no farther the corners would cover all that moves it
export const REGION_MARKS = 8; // colours and forms of regions; more than eight regions begin again
// Forms of regions, for readers without colours: disc, diamond, triangle, hexagon, star, cross, bar, drop.
export const REGION_FORMS = [
  "",
  "M0-8.2L8.2 0 0 8.2-8.2 0Z",
  "M0-8L7.6 6H-7.6Z",
  "M-4.2-7.3H4.2L8.4 0 4.2 7.3H-4.2L-8.4 0Z",
  "M0-9L2.6-3.2 8.7-2.7 4.1 1.4 5.5 7.5 0 4.3-5.5 7.5-4.1 1.4-8.7-2.7-2.6-3.2Z",
  "M-2.8-8H2.8V-2.8H8V2.8H2.8V8H-2.8V2.8H-8V-2.8H-2.8Z",
  "M-8.5-4H8.5V4H-8.5Z",
  "M0-9L6 1A6 6 0 1 1-6 1Z",
];

/** The shapes as elements, which can have the focus and be dragged. */
export class ShapeHandles {
  hatch: string;
  root: SVGGElement;
  grips: SVGGElement;
  swap: SVGGElement;
  draft: SVGGElement;
  shown = new Map<string, ShapeParts>();
  draftParts: (SVGCircleElement | SVGPathElement)[];

  constructor(readonly svg: SVGSVGElement) {
    const defs = svgElement("defs", {}, svg),
      id = `dnb-hatch-${Math.random().toString(36).slice(2)}`;
    const hatch = svgElement(
      "pattern",
      { id, width: 13, height: 13, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      defs,
    );
    svgElement("rect", { width: 13, height: 13, class: "dnb-ed-hatch-ground" }, hatch);
    svgElement("path", { d: "M2 0V13", class: "dnb-ed-hatch-case" }, hatch);
    svgElement("path", { d: "M2 0V13", class: "dnb-ed-hatch-line" }, hatch);
    this.hatch = `url(#${id})`;
    this.root = svgElement("g", { class: "dnb-ed-shapes" }, svg);
    this.grips = svgElement("g", { class: "dnb-ed-grips" }, svg);
    this.swap = svgElement(
      "g",
      {
        class: "dnb-ed-turn dnb-ed-swap",
        "data-mark": "swap",
        role: "button",
        tabindex: "-1",
        visibility: "hidden",
        "aria-label": "Swap sides",
        ...OWN_KEYS,
      },
      svg,
    );
    svgElement("title", {}, this.swap).textContent = tipOf(
      EDITOR_KEYS,
      "turn",
      "Swap sides: the other half stays fixed",
    );
    svgElement("circle", { r: 16, class: "dnb-ed-hit" }, this.swap);
    svgElement("circle", { r: 10, class: "dnb-ed-turn-disc" }, this.swap);
    svgElement(
      "path",
      { d: "M-2.6 5.4V-5.4M-5-2.8L-2.6-5.4-.2-2.8M2.6-5.4V5.4M.2 2.8L2.6 5.4 5 2.8", class: "dnb-ed-turn-arrow" },
      this.swap,
    );
    this.draft = svgElement("g", { class: "dnb-ed-draft", visibility: "hidden", "aria-hidden": "true" }, svg);
    this.draftParts = ["case", "line", "next", "start", "cursor"].map((name, k) =>
      svgElement(k < 3 ? "path" : "circle", { class: `dnb-ed-draft-${name}` }, this.draft),
    );
  }

  /**
   * Draw all shapes for a view. True if the focus was on one that is gone.
   * @param options reach as in maths/shapes.js; isBefore draws parts where they were
   */
  update(
    shapes: Shapes,
    chosen: Chosen | null,
    view: View,
    { reach, sideKey, isLocked, isBefore }: { reach: number; sideKey: SideKey; isLocked: boolean; isBefore: boolean },
  ) {
    const seen = new Set(),
      focused = treeOf(this.svg).activeElement;
    let isFocusLost = false;
    for (const what of ["parts", "cuts"] as const) {
      for (const [index, shape] of shapes[what].entries()) {
        const key = `${what}:${index}`,
          parts = this.shown.get(key) ?? this.make(key, what);
        seen.add(key);
        const isChosen = chosen?.what === what && chosen.index === index;
        this.#place(parts, shape, { what, index }, view, reach, isChosen, isBefore ? null : motionOf(shape));
        this.#bands(parts, what === "cuts" && shape.enabled ? sideBands(shape.region, view, reach, sideKey) : []);
      }
    }
    for (const [key, parts] of this.shown) {
      if (seen.has(key)) continue;
      isFocusLost ||= parts.root === focused;
      parts.root.remove();
      this.shown.delete(key);
    }
    const shape = chosen ? shapes[chosen.what][chosen.index] : null;
    const isSide = chosen?.what === "parts" && shape?.region.kind === "half_space" && !isLocked;
    if (this.#placeSwap(isSide && shape ? shape : null, view, reach) && this.swap === focused) isFocusLost = true;
    const grips = chosen && !isLocked ? gripsOf(shapes[chosen.what][chosen.index]!, chosen, reach) : [];
    return this.#placeGrips(grips, view, focused) || isFocusLost;
  }

  /** The elements of a new shape. */
  make(key: string, what: ShapeKind): ShapeParts {
    const root = svgElement("g", {
      class: `dnb-ed-shape dnb-ed-${what === "cuts" ? "cut" : "part"}`,
      "data-shape": key,
      tabindex: "0",
      role: "button",
      "aria-roledescription": SHAPE_NAMES[what],
      ...OWN_KEYS,
    });
    const firstCut = this.root.querySelector("[data-shape^=cuts]"); // cuts are above parts
    this.root.insertBefore(root, what === "parts" ? firstCut : null);
    const tip = svgElement("title", {}, root),
      were = ["was-case", "was"].map((name) => svgElement("path", { class: `dnb-ed-shape-${name}` }, root)),
      body = svgElement("g", {}, root);
    const path = (name: string) => svgElement("path", { class: `dnb-ed-shape-${name}` }, body);
    const parts: ShapeParts = {
      root,
      tip,
      were,
      body,
      inside: path("inside"),
      fill: path("fill"),
      halo: path("halo"),
      case: path("case"),
      bands: svgElement("g", { class: "dnb-ed-shape-bands" }, body),
      far: [path("far-case"), path("far")],
      line: path("line"),
      tips: path("tips"),
      hit: path("hit"),
      name: svgElement("text", { class: "dnb-ed-shape-name" }, root),
    };
    parts.fill.setAttribute("fill", what === "parts" ? this.hatch : "none");
    parts.inside.setAttribute("data-motion", "move");
    this.shown.set(key, parts);
    return parts;
  }

  #place(
    parts: ShapeParts,
    shape: ShapeData,
    { what, index }: Chosen,
    view: View,
    reach: number,
    isChosen: boolean,
    motion: Motion,
  ) {
    const { region } = shape,
      label = shapeLabel(shape, what, index);
    const { line, far, tips, inside } = shapePaths(region, view, reach);
    setAttributes(parts.root, { visibility: line + far ? "visible" : "hidden" }); // a slice may not meet it
    parts.root.classList.toggle("dnb-ed-off", !shape.enabled);
    parts.root.classList.toggle("dnb-ed-chosen", isChosen);
    setAttributes(parts.root, { "aria-label": label, "aria-pressed": String(isChosen) });
    setText(parts.tip, `${label}. Click to choose it`);
    const [x, y] = namePlace(region, motion, view, reach);
    const whole = region.kind === "half_space" ? far : line;
    setAttributes(parts.body, { transform: motion ? toScreenMotion(motion, view) : "" });
    for (const path of [parts.fill, parts.inside]) {
      setAttributes(path, { d: what === "parts" && shape.enabled ? inside : "" });
    }
    for (const path of [parts.halo, parts.case, parts.line]) setAttributes(path, { d: whole });
    setAttributes(parts.tips, { d: tips });
    for (const path of parts.far) setAttributes(path, { d: region.kind === "line" ? far : "" });
    for (const path of parts.were) setAttributes(path, { d: isStill(motion) ? "" : whole });
    const isSmall = what === "parts" && shape.enabled && view.k * extentOf(region) < SMALL;
    setAttributes(parts.hit, { "data-motion": isSmall ? "move" : "" });
    setAttributes(parts.hit, { d: whole + (region.kind === "line" ? far : "") });
    const isNamed = Boolean(shape.name) || isChosen;
    setAttributes(parts.name, { x: x.toFixed(1), y: y.toFixed(1), visibility: isNamed ? "inherit" : "hidden" });
    setText(parts.name, `${shapeName(shape, what, index)}${shape.enabled ? "" : " (off)"}`);
  }

  #bands(parts: ShapeParts, bands: { d: string; mark: number }[]) {
    for (const gone of [...parts.bands.children].slice(bands.length)) gone.remove();
    bands.forEach(({ d, mark }, k) => {
      setAttributes(parts.bands.children[k] ?? svgElement("path", {}, parts.bands), { d, "data-region": mark });
    });
  }

  /** Put the button that swaps the sides on the line of a fixed side, next to its ring; true if there is none. */
  #placeSwap(shape: ShapeData | null, { k, x, y, width, height }: View, reach: number) {
    setAttributes(this.swap, { visibility: shape ? "visible" : "hidden", tabindex: shape ? "0" : "-1" });
    if (!shape) return true;
    const [[p, q], [r, s]] = cornersOf(shape.region, reach)
      .map((place) => movePlace(motionOf(shape), place))
      .map(([a, b]) => [k * a + x, k * b + y]) as [[number, number], [number, number]];
    const length = Math.hypot(r - p, s - q) || 1,
      way = Math.max(length / 2 + SWAP_ROOM[0]!, SWAP_ROOM[1]!) / length;
    const place = (share: number): Vector2 => [(p + r) / 2 + share * (r - p), (q + s) / 2 + share * (s - q)],
      first = place(way),
      other = place(-way);
    const isSeen = ([u, v]: Vector2) =>
      u > SWAP_ROOM[2]! && v > SWAP_ROOM[2]! && u < width - SWAP_ROOM[2]! && v < height - SWAP_ROOM[2]!;
    const [u, v] = isSeen(first) || !isSeen(other) ? first : other,
      angle = (Math.atan2(s - q, r - p) * 180) / Math.PI;
    setAttributes(this.swap, { transform: `translate(${u.toFixed(1)} ${v.toFixed(1)}) rotate(${angle.toFixed(1)})` });
    return false;
  }

  /** True if the focus was on a grip that is gone. */
  #placeGrips(grips: ReturnType<typeof gripsOf>, { k, x, y }: View, focused: Element | null) {
    const gone = [...this.grips.children].slice(grips.length),
      isFocusLost = gone.some((grip) => grip === focused);
    for (const grip of gone) grip.remove();
    grips.forEach(({ sort, number, place: [a, b], room, label, isTip }, at) => {
      setAttributes(this.grips.children[at] ?? this.#makeGrip(), {
        transform: `translate(${(k * a! + x).toFixed(2)} ${(k * b! + y).toFixed(2)})`,
        class: `dnb-ed-grip dnb-ed-${sort}${isTip ? " dnb-ed-tip" : ""}`,
        "data-corner": "",
        "data-middle": "",
        [`data-${sort}`]: number,
        visibility: k * room < LEAST_ROOM ? "hidden" : "visible",
        "aria-label": label,
      });
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

  /** Whether anything is seen of a shape, of which a slice may show nothing. */
  isSeen(what: ShapeKind, index: number) {
    return this.shown.get(`${what}:${index}`)?.root.getAttribute("visibility") === "visible";
  }

  focus({ what, index }: Chosen) {
    this.shown.get(`${what}:${index}`)?.root.focus({ preventScroll: true });
  }

  focusCorner(k: number) {
    const grip: SVGElement | null = this.grips.querySelector(`[data-corner="${k}"]`);
    grip?.focus({ preventScroll: true });
  }

  showDraft(draft: Draft | null, { k, x, y }: View) {
    const [casing, line, next, start, cursor] = this.draftParts as [
      SVGCircleElement | SVGPathElement,
      SVGCircleElement | SVGPathElement,
      SVGCircleElement | SVGPathElement,
      SVGCircleElement | SVGPathElement,
      SVGCircleElement | SVGPathElement,
    ];
    setAttributes(this.draft, { visibility: draft ? "visible" : "hidden" });
    if (!draft) return;
    const on = ([a, b]: Vector2): Vector2 => [k * a + x, k * b + y];
    const at = draft.places.map(on),
      d = shapePath(at);
    setAttributes(casing, { d });
    setAttributes(line, { d });
    const end = draft.next && on(draft.next),
      last = at.at(-1);
    const back = draft.tool === "part" && at.length > 1 ? at.slice(0, 1) : [];
    setAttributes(next, { d: end && last ? shapePath([last, end, ...back]) : "" });
    setAttributes(start, {
      r: draft.canClose ? 7 : 4,
      visibility: at.length ? "inherit" : "hidden",
      cx: (at[0]?.[0] ?? 0).toFixed(1),
      cy: (at[0]?.[1] ?? 0).toFixed(1),
    });
    setAttributes(cursor, {
      r: 6,
      visibility: draft.isByKeys && end ? "inherit" : "hidden",
      cx: (end?.[0] ?? 0).toFixed(1),
      cy: (end?.[1] ?? 0).toFixed(1),
    });
    this.draft.classList.toggle("dnb-ed-closing", Boolean(draft.isClosing));
  }
}

/**
 * Grips of a shape: its corners, and the middles of its edges. `room` is the length of an edge, without end at corners
 * unless they would cover a small part.
 */
function gripsOf(shape: ShapeData, { what, index }: Chosen, reach: number) {
  const { region } = shape,
    name = shapeName(shape, what, index),
    motion = motionOf(shape);
  const room = what === "parts" ? (LEAST_ROOM / SMALL) * extentOf(region) : Infinity;
  const corners = cornersOf(region, reach).map((place) => movePlace(motion, place)),
    n = corners.length;
  const edges = corners.slice(0, region.kind === "polygon" ? n : region.kind === "line" ? n - 1 : 0);
  return [
    ...corners.map((place, i) => {
      const isTip = what === "cuts" ? stopsAt(region, i) : null,
        words =
          isTip === null
            ? ""
            : isTip
              ? ". The cut stops here: Enter lets it continue"
              : ". The cut continues: Enter lets it stop here";
      return {
        sort: "corner",
        number: i,
        place,
        room,
        isTip: isTip === true,
        label: `Corner ${i + 1} of ${n} of ${name}, at ${place.map(formatLength).join(", ")}${words}`,
      };
    }),
    ...edges.map((p, i) => {
      const q = corners[(i + 1) % n]!,
        place = [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
      return {
        sort: "middle",
        number: i,
        place,
        isTip: false,
        room: Math.hypot(q[0] - p[0], q[1] - p[1]),
        label: `Middle of edge ${i + 1}: Enter makes it a corner`,
      };
    }),
  ];
}

/** Whether a motion moves nothing. */
function isStill(motion: Motion) {
  return !motion || (motion.matrix[0][0] === 1 && motion.shift.every((value) => value === 0));
}

/** Position of the name of a shape in CSS pixels of the view, within it. */
export function namePlace(region: RegionData, motion: Motion, view: View, reach: number): Vector2 {
  const { k, x, y, width, height } = view,
    at = shapePaths(region, view, reach).label;
  const [a, b] = movePlace(motion, [(at[0] - x) / k, (at[1] - y) / k]);
  return isStill(motion)
    ? at
    : [Math.max(6, Math.min(width - 80, k * a + x)), Math.max(16, Math.min(height - 8, k * b + y))];
}

/** The farthest that a region reaches from a place; infinity for a half plane. */
export function farthest(region: RegionData, [a, b]: Vector2) {
  if (region.kind === "half_space") return Infinity;
  const places = region.kind === "mask" ? outlineOf(region).corners : region.vertices;
  return Math.max(0, ...places.map(([p, q]) => Math.hypot(p! - a, q! - b)));
}

/** The farthest that a region reaches from its middle. */
function extentOf(region: RegionData) {
  return farthest(region, middleOfRegion(region));
}

/** A motion in the picture as one of CSS pixels. */
function toScreenMotion({ matrix: [[a, c], [b, d]], shift: [s, t] }: NonNullable<Motion>, { k, x, y }: View) {
  const values = [a, b, c, d, k * s + x - a * x - c * y, k * t + y - b * x - d * y];
  return `matrix(${values.map((v) => v.toFixed(6)).join(" ")})`;
}

function shapePath(places: Vector2[], isClosed = false) {
  const texts = places.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`);
  return texts.length ? `M${texts.join("L")}${isClosed ? "Z" : ""}` : "";
}

/** A disc where a cut stops. */
function discPath([x, y]: Vector2) {
  return `M${(x - 3.4).toFixed(1)} ${y.toFixed(1)}a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0Z`;
}

export function shapePaths(region: RegionData, { k, x, y, width, height }: View, reach: number): ShapePaths {
  const endless = 3 * (width + height);
  const on = ([a, b]: Vector2): Vector2 => [k * a + x, k * b + y];
  if (region.kind === "mask") return maskPaths(region, on);
  const at = cornersOf(region, reach).map(on),
    n = at.length;
  const away = ([px, py]: Vector2, [qx, qy]: Vector2): Vector2 => {
    const length = Math.hypot(qx - px, qy - py) || 1;
    return [qx + (endless * (qx - px)) / length, qy + (endless * (qy - py)) / length];
  };
  const first = n > 1 ? away(at[1]!, at[0]!) : at[0]!,
    last = n > 1 ? away(at[n - 2]!, at[n - 1]!) : at[0]!;
  const label = at.reduce((best, p) => (p[1] < best![1] ? p : best), at[0])!;
  const name: Vector2 = [
    Math.max(6, Math.min(width - 80, label[0] + 8)),
    Math.max(16, Math.min(height - 8, label[1] - 8)),
  ];
  const paths = { line: shapePath(at, region.kind === "polygon"), far: "", tips: "", inside: "", label: name };
  if (region.kind === "polygon") return { ...paths, inside: paths.line };
  if (region.kind === "line") {
    const ends: [Vector2, Vector2][] = [
        [at[0]!, first],
        [at[n - 1]!, last],
      ],
      isTip = [0, n - 1].map((k) => stopsAt(region, k) === true);
    return {
      ...paths,
      far: ends.map((end, k) => (isTip[k] ? "" : shapePath(end))).join(""),
      tips: ends.map(([end], k) => (isTip[k] ? discPath(end) : "")).join(""),
    };
  }
  const [na, nb] = region.normal;
  const back = ([px, py]: Vector2): Vector2 => [px - 2 * endless * na, py - 2 * endless * nb];
  const [u, v] = on(region.point),
    side = [u - NAME_IN[0]! * na - NAME_IN[1]!, v - NAME_IN[0]! * nb + 4]; // in the hatched half
  return {
    ...paths,
    far: shapePath([first, last]),
    inside: shapePath([first, last, back(last), back(first)], true),
    label: [Math.max(6, Math.min(width - 80, side[0]!)), Math.max(16, Math.min(height - 8, side[1]!))],
  };
}

function maskPaths(region: MaskData, on: (place: Vector2) => Vector2): ShapePaths {
  const { faces, rows } = outlineOf(region);
  const [x, y] = faces.length ? on(faces[0]![0]!) : [0, 0];
  return {
    line: faces.map((face) => shapePath(face.map(on))).join(""),
    far: "",
    tips: "",
    inside: rows.map((row) => shapePath(row.map(on), true)).join(""),
    label: [x + 8, y - 8],
  };
}

/** Along every edge of a cut a line on either side, with the mark of the region there. */
function sideBands(region: RegionData, { k, x, y, width, height }: View, reach: number, sideKey: SideKey) {
  if (region.kind === "mask") return [];
  const corners = cornersOf(region, reach),
    n = corners.length,
    bands = [],
    off = 4,
    endless = 3 * (width + height);
  const edges = region.kind === "polygon" ? n : n - 1;
  for (let j = 0; j < edges; j++) {
    const p = corners[j]!,
      q = corners[(j + 1) % n]!,
      length = Math.hypot(q[0] - p[0], q[1] - p[1]);
    if (!length) continue;
    const [ta, tb] = [(q[0] - p[0]) / length, (q[1] - p[1]) / length],
      isOpen = region.kind !== "polygon";
    const continues = (corner: number) => isOpen && stopsAt(region, corner) !== true;
    const before = j === 0 && continues(0) ? endless : 0,
      after = j === edges - 1 && continues(n - 1) ? endless : 0;
    for (const side of [-1, 1]) {
      const na = -side * tb,
        nb = side * ta,
        nudge = Math.min(1.5 / k, length / 4);
      const mark = sideKey((p[0] + q[0]) / 2 + nudge * na, (p[1] + q[1]) / 2 + nudge * nb) % REGION_MARKS;
      const place = ([a, b]: Vector2, along: number): Vector2 => [
        k * a + x + off * na + along * ta,
        k * b + y + off * nb + along * tb,
      ];
      bands.push({ d: shapePath([place(p, -before), place(q, after)]), mark });
    }
  }
  return bands;
}
