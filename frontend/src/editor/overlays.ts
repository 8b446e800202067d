// Overlays of the editor's picture: folds, changes of area, principal strains, uncertainty, and another picture.

import { contourOf, detMapOf, detsOnRaster, foldPieces } from "../maths/folds.ts";
import { isStill } from "../maths/rigid_stages.ts";
import { LONGEST_ARM, plainNumber, strainGain, strainsAt } from "../maths/warp_map.ts";
import { setTrait } from "../sync/edits.ts";
import type { LayeredFit, Raster, Vector2, Vector4 } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, svgElement } from "../ui/dom.ts";
import { EDITOR_KEYS, tipOf } from "../ui/keys.ts";
import type { Folds } from "./edited_map.ts";
import { drawFolds, type FoldPieces, hatchPattern } from "./fold_drawing.ts";
import type { GridPlaces } from "./grid_nodes.ts";
import type { View } from "./painter.ts";
import { bytesOf, context2d, drawGrid } from "./painter.ts";
import type { EditorParts } from "./parts.ts";
export type StrainArm = { from: Vector2; to: Vector2; grows: boolean };
export type UncertaintyLegend = [level: number, text: string][];

// ---- crosses of the principal strains at the nodes of the grid: solid where stretched, dashed where pressed ---------

const STRAIN_INKS = { grows: "#7ee08a", shrinks: "#dba6f0" }; // on the grey of a picture, in light and dark pages
const STRAIN_DASH = [3.5, 2.5];

/** Arms of all crosses in places of the picture. */
function strainArms(layered: LayeredFit, places: GridPlaces, cell: number) {
  const strains = strainsAt(layered, places),
    gain = strainGain(strains);
  const arms: StrainArm[] = [];
  for (let n = 0; n < places.isSeen.length; n++) {
    for (const m of [0, 1]) {
      const strain = strains.stretch[2 * n + m]! - 1,
        half = (gain * Math.abs(strain) * cell) / 2;
      if (!(half > 0.01 * cell)) continue;
      const angle = strains.angle[n]! + (m * Math.PI) / 2,
        da = half * Math.cos(angle),
        db = half * Math.sin(angle);
      const [a, b] = [places.target[2 * n]!, places.target[2 * n + 1]!];
      arms.push({ from: [a - da, b - db], to: [a + da, b + db], grows: strain > 0 });
    }
  }
  return { gain, arms };
}

function drawStrain(c: CanvasRenderingContext2D, { k, x, y, ratio }: View, arms: StrainArm[]) {
  c.save();
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.lineCap = "butt";
  /** @param grows those to be drawn, null for all */
  const trace = (grows: boolean | null) => {
    c.beginPath();
    for (const arm of arms) {
      if (grows !== null && arm.grows !== grows) continue;
      c.moveTo(k * arm.from[0] + x, k * arm.from[1] + y);
      c.lineTo(k * arm.to[0] + x, k * arm.to[1] + y);
    }
    c.stroke();
  };
  Object.assign(c, { strokeStyle: "rgba(0, 0, 0, 0.7)", lineWidth: 4.2 });
  trace(null);
  for (const grows of [false, true]) {
    c.setLineDash(grows ? [] : STRAIN_DASH);
    Object.assign(c, { strokeStyle: STRAIN_INKS[grows ? "grows" : "shrinks"], lineWidth: 2 });
    trace(grows);
  }
  c.restore();
}

/**
 * The legend, with an arm of a known strain in the size in which it is drawn.
 * @param cell CSS pixels
 */
function strainKey(parent: HTMLElement, gain: number, cell: number) {
  const share = plainNumber(Math.min(0.5, LONGEST_ARM / gain)),
    long = share * gain * cell;
  const percent = Number((100 * share).toPrecision(3));
  pageElement("div", "", parent).textContent = "principal strains";
  for (const grows of [true, false]) {
    const row = pageElement("div", "dnb-ed-key-arm", parent),
      width = Math.ceil(long) + 2;
    const d = `M1 4H${(1 + long).toFixed(1)}`;
    const icon = svgElement("svg", { width, height: 8, viewBox: `0 0 ${width} 8`, "aria-hidden": "true" }, row);
    svgElement("path", { d, stroke: "rgba(0, 0, 0, 0.7)", "stroke-width": 4.2, fill: "none" }, icon);
    svgElement(
      "path",
      {
        d,
        stroke: STRAIN_INKS[grows ? "grows" : "shrinks"],
        "stroke-width": 2,
        fill: "none",
        ...(grows ? {} : { "stroke-dasharray": STRAIN_DASH.join(" ") }),
      },
      icon,
    );
    pageElement("span", "", row).textContent = grows ? `stretched by ${percent} %` : `pressed by ${percent} %`;
  }
  const size = gain === 1 ? "in their own size" : gain > 1 ? `exaggerated \u00d7 ${gain}` : `drawn \u00d7 ${gain}`;
  pageElement("div", "", parent).textContent = size;
  setAttributes(parent, {
    "aria-label": `Crosses along the principal strains, ${size}: solid arms are stretched, dashed arms pressed`,
  });
}

// ---- another picture ------------------------------------------------------------------------------------------------

export const GHOST_TRAITS = ["ghost", "ghost_opacity"];

/** Dependencies of the ghost on the editor. */
export type GhostEditor = EditorParts<"model" | "stage" | "viewport" | "picture">;

/** A translucent picture over the editor's, under the overlay and the handles: the target of the drags. */
export class Ghost {
  image: HTMLImageElement;
  bytes: DataView<ArrayBuffer> | null = null;
  url = "";

  constructor(readonly editor: GhostEditor) {
    this.image = pageElement("img", "dnb-ed-ghost", editor.stage.element, {
      alt: "",
      "aria-hidden": "true",
      draggable: "false",
      hidden: "",
    });
    editor.stage.svg.before(this.image);
  }

  /** Draw it as in the traits, over the whole picture. */
  draw() {
    const {
      model,
      viewport: {
        view: { k, x, y },
      },
      picture: {
        box: [a0, a1, b0, b1],
      },
    } = this.editor;
    const bytes = model.get("ghost"),
      opacity = Number(model.get("ghost_opacity")) || 0;
    if (bytes !== this.bytes) this.#load(bytes);
    this.image.hidden = !this.url || opacity <= 0;
    if (this.image.hidden) return;
    Object.assign(this.image.style, {
      opacity: String(opacity),
      left: `${k * a0 + x}px`,
      top: `${k * b0 + y}px`,
      width: `${k * (a1 - a0)}px`,
      height: `${k * (b1 - b0)}px`,
    });
  }

  /** @param bytes of a PNG */
  #load(bytes: DataView<ArrayBuffer> | null) {
    this.close();
    this.bytes = bytes;
    if (!bytes?.byteLength) return;
    this.url = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
    this.image.src = this.url;
  }

  close() {
    if (this.url) URL.revokeObjectURL(this.url);
    this.url = "";
  }
}

// ---- maps of the deformation ----------------------------------------------------------------------------------------

/** Of each overlay the label in the menu and the title. */
export const OVERLAYS: Record<string, string[]> = {
  none: ["Plain", "nothing over the picture"],
  folds: ["Folds", "red where the map folds over itself"],
  area: ["Area", "green where tissue grows, purple where it shrinks"],
  strain: ["Strain", "crosses along the principal strains: solid where tissue is stretched, dashed where compressed"],
  uncertainty: ["Uncertainty", "grey where the map is extrapolated far from the control points"],
};
export const OVERLAY_TRAITS = ["overlay", "uncertainty", "uncertainty_facts", "marked"];
export const AREA_COLOURS = { shrinks: [118, 42, 131], same: [255, 255, 255], grows: [27, 120, 55] };
const AREA_ALPHA = 0.62;
const AREA_OCTAVES = 1; // half and twice the area have the full colours
const UNCERTAINTY_COLOUR = [150, 153, 160],
  UNCERTAINTY_ALPHA = 0.88;
const OVERLAY_CELL = { moving: 14, resting: 7 }; // CSS pixels; where a fold begins, a quarter of it
const KEY_CORNERS = [
  ["bottom", "left"],
  ["bottom", "right"],
  ["top", "right"],
  ["top", "left"],
]; // first choices first
const OVERLAY_WORK = { moving: 1.2e5, resting: 1e6 }; // evaluations of a kernel

/** Dependencies of the overlay on the editor. */
export type OverlayEditor = EditorParts<
  "model" | "frames" | "messages" | "theme" | "stage" | "viewport" | "points" | "picture",
  never,
  "grid" | "nodes",
  "toolbar"
>;

/** Folds, areas, strains or uncertainty, on a separate canvas between the picture and the handles. */
export class Overlay {
  canvas: HTMLCanvasElement;
  context: CanvasRenderingContext2D;
  small: HTMLCanvasElement;
  hatch: string | CanvasPattern;
  worst: SVGGElement;
  key: HTMLDivElement;
  /** The values that the canvas was drawn from. */
  drawn: unknown[] | null = null;
  /** The folds that are drawn, in places of the picture. */
  pieces: FoldPieces | null = null;
  isUsed = false; // whether there is anything on the canvas
  described = ""; // the values that the legend was made from
  gain = ""; // the same of the strains
  select: HTMLSelectElement;

  constructor(readonly editor: OverlayEditor) {
    this.canvas = pageElement("canvas", "dnb-ed-overlay", editor.stage.element, { "aria-hidden": "true" });
    this.context = context2d(this.canvas);
    this.small = document.createElement("canvas"); // for an image that is magnified
    this.hatch = hatchPattern(this.context);
    this.worst = svgElement(
      "g",
      { class: "dnb-ed-worst", visibility: "hidden", "aria-hidden": "true" },
      editor.stage.svg,
    );
    for (const name of ["case", "ring"]) svgElement("circle", { r: 9, class: `dnb-ed-worst-${name}` }, this.worst);
    this.key = pageElement("div", "dnb-ed-key", editor.stage.element, {
      role: "img",
      "aria-label": "legend",
      hidden: "",
    });
    editor.stage.svg.before(this.canvas); // the handles are above it
    const menus = editor.panels.toolbar.buttons.get("compare")?.button.parentElement ?? null;
    this.select = pageElement("select", "dnb-ed-menu", menus, {
      "aria-label": tipOf(EDITOR_KEYS, "overlay", "Overlay"),
      ...OWN_KEYS,
    });
    for (const [value, [label, title]] of Object.entries(OVERLAYS)) {
      pageElement("option", "", this.select, { value, title: title! }).textContent = label!;
    }
    this.select.addEventListener("change", () => editor.frames.guard(() => this.choose(this.select.value)));
  }

  get kind(): string {
    const kind = this.editor.model.get("overlay");
    return Object.hasOwn(OVERLAYS, kind) ? kind : "folds";
  }

  choose(kind: string) {
    setTrait(this.editor.model, "overlay", kind);
    this.editor.messages.announce(`overlay: ${OVERLAYS[kind]![1]}`);
  }

  next() {
    const names = Object.keys(OVERLAYS),
      kind = names[(names.indexOf(this.kind) + 1) % names.length]!;
    this.choose(kind);
    this.editor.messages.hint(`${OVERLAYS[kind]![0]}: ${OVERLAYS[kind]![1]}`);
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /**
   * @param layered null for the original picture, which has no overlay
   * @param known the same, at the nodes of the picture while something moves
   */
  draw(layered: LayeredFit | null, known: LayeredFit | null, folds: Folds | null, isMoving: boolean) {
    const { kind } = this;
    this.#describe(layered ? kind : "none");
    this.#mark(layered && kind !== "none" ? folds : null);
    this.#lay(layered, known, kind, folds, isMoving);
    this.#placeKey(isMoving);
  }

  #lay(layered: LayeredFit | null, known: LayeredFit | null, kind: string, folds: Folds | null, isMoving: boolean) {
    const {
      viewport: { view },
      model,
      picture: { box, sheet },
    } = this.editor;
    const key = [
      layered,
      kind,
      ...Object.values(view),
      isMoving && layered !== null,
      String(box),
      String(sheet),
      model.get("density"),
      model.get("show_grid"),
      ...(kind === "uncertainty" ? [model.get("uncertainty"), model.get("uncertainty_facts")] : []),
    ];
    if (this.drawn?.every((value, n) => value === key[n])) return;
    this.drawn = key;
    this.#clear();
    this.pieces = null;
    const part = this.#visible();
    if (!layered || kind === "none" || !part) return;
    if (kind === "uncertainty") this.#drawUncertainty(part);
    const isBent = layered.fits.some(({ fit }) => !isStill(fit));
    if (kind === "strain") this.key.hidden = !isBent;
    if (isBent && folds && known) this.#drawMap(layered, known, part, folds, isMoving);
  }

  #clear() {
    const { width, height, ratio } = this.editor.viewport.view,
      { canvas, context: c } = this;
    const w = Math.max(1, Math.round(width * ratio)),
      h = Math.max(1, Math.round(height * ratio));
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    c.setTransform(1, 0, 0, 1, 0, 0);
    if (this.isUsed) c.clearRect(0, 0, w, h);
    this.isUsed = false;
  }

  /** The visible part of the drawing, [a0, a1, b0, b1], or null. */
  #visible(): Vector4 | null {
    const {
      viewport: {
        view: { k, x, y, width, height },
      },
      picture: {
        sheet: [a0, a1, b0, b1],
      },
    } = this.editor;
    const [left, right] = [Math.max(a0, -x / k), Math.min(a1, (width - x) / k)];
    const [top, bottom] = [Math.max(b0, -y / k), Math.min(b1, (height - y) / k)];
    return right > left && bottom > top ? [left, right, top, bottom] : null;
  }

  #drawMap(layered: LayeredFit, known: LayeredFit, part: Vector4, folds: Folds, isMoving: boolean) {
    const {
        kind,
        editor: {
          viewport: {
            view: { k },
          },
        },
      } = this,
      [a0, a1, b0, b1] = part,
      cost = Math.max(1, known.count);
    const pace = isMoving ? "moving" : "resting",
      work = OVERLAY_WORK[pace],
      size = OVERLAY_CELL[pace] / k;
    const cell = Math.max(size, Math.sqrt(((a1 - a0) * (b1 - b0) * cost) / work));
    const columns = Math.max(2, Math.ceil((a1 - a0) / cell) + 1),
      rows = Math.max(2, Math.ceil((b1 - b0) / cell) + 1);
    const raster: Raster = {
      shape: [rows, columns],
      origin: [a0, b0],
      spacing: [(a1 - a0) / (columns - 1), (b1 - b0) / (rows - 1)],
    };
    const dets = detsOnRaster(known, raster);
    if (kind === "area") this.#drawArea(dets, raster, part);
    if (kind === "strain") this.#drawStrain(layered);
    const { probes } = folds;
    if (folds.least > 0 && !probes.some(([, , det]) => det <= 0) && dets.every((det) => !(det <= 0.3))) return;
    this.pieces = foldPieces(detMapOf(known), raster, dets, probes, work);
    if (!this.pieces.fill.length) return;
    const isInAir = folds.least > 0 && folds.air > 0;
    drawFolds(this.context, this.editor.viewport.view, this.pieces, isInAir, this.hatch);
    this.isUsed = true;
  }

  #drawArea(dets: ArrayLike<number>, raster: Raster, part: Vector4) {
    const {
        shape: [rows, columns],
      } = raster,
      image = new ImageData(columns, rows),
      out = image.data;
    for (let n = 0, at = 0; n < dets.length; n++, at += 4) {
      if (Number.isNaN(dets[n])) continue; // a gap has no area
      const t = Math.max(-1, Math.min(1, dets[n]! > 0 ? -Math.log2(dets[n]!) / AREA_OCTAVES : 1));
      const { same } = AREA_COLOURS,
        full = t < 0 ? AREA_COLOURS.shrinks : AREA_COLOURS.grows;
      for (let i = 0; i < 3; i++) out[at + i] = same[i]! + Math.abs(t) * (full[i]! - same[i]!);
      out[at + 3] = 255;
    }
    this.#spread(image, raster, AREA_ALPHA, part);
    const {
      layers: {
        grid: { last: grid },
      },
      viewport: { view },
      theme: { colours },
      model,
    } = this.editor; // the grid is under the colours, and would be hardly visible
    if (grid && model.get("show_grid") && model.get("density") > 0)
      drawGrid(this.context, view, grid.lines, colours.grid);
  }

  #drawStrain(layered: LayeredFit) {
    const {
        layers: { nodes: gridNodes },
        viewport: { view },
        picture: {
          box: [a0, a1],
        },
      } = this.editor,
      places = gridNodes.placesOf(layered);
    const cell = (a1 - a0) / (places.columns - 1),
      { gain, arms } = strainArms(layered, places, cell);
    const described = `${gain} ${(cell * view.k).toFixed(0)}`;
    drawStrain(this.context, view, arms);
    this.isUsed = true;
    if (described === this.gain) return;
    this.gain = described;
    this.key.replaceChildren();
    strainKey(this.key, gain, cell * view.k);
  }

  /** Draw one pixel of an image for each node of a raster, smooth between them. */
  #spread(
    image: ImageData,
    { spacing: [da, db], origin: [a0, b0] }: { spacing: number[]; origin: number[] },
    alpha: number,
    [left, right, top, bottom]: Vector4,
  ) {
    const { context: c } = this,
      { k, x, y, ratio } = this.editor.viewport.view,
      { width, height } = image;
    Object.assign(this.small, { width, height }); // which clears it
    context2d(this.small).putImageData(image, 0, 0);
    c.save();
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.beginPath();
    c.rect(k * left + x, k * top + y, k * (right - left), k * (bottom - top));
    c.clip();
    c.globalAlpha = alpha;
    c.imageSmoothingEnabled = true;
    c.drawImage(this.small, k * (a0! - da! / 2) + x, k * (b0! - db! / 2) + y, k * da! * width, k * db! * height);
    c.restore();
    this.isUsed = true;
  }

  get #uncertaintyFacts(): { width: number; height: number; legend: UncertaintyLegend } {
    return { width: 0, height: 0, legend: [], ...this.editor.model.get("uncertainty_facts") };
  }

  /** Python's uncertainty, with a line at every level that the legend names. */
  #drawUncertainty(part: Vector4) {
    const { width, height, legend } = this.#uncertaintyFacts,
      given = this.editor.model.get("uncertainty");
    if (!given || !width || given.byteLength !== width * height) return;
    const values = bytesOf(given);
    const image = new ImageData(width, height),
      [a0, a1, b0, b1] = this.editor.picture.box;
    const da = (a1 - a0) / width,
      db = (b1 - b0) / height;
    for (let n = 0; n < values.length; n++)
      image.data.set([...UNCERTAINTY_COLOUR, UNCERTAINTY_ALPHA * values[n]!], 4 * n);
    const raster: Pick<Raster, "spacing" | "origin"> = { spacing: [da, db], origin: [a0 + da / 2, b0 + db / 2] };
    this.#spread(image, raster, 1, part);
    const { context: c } = this,
      { k, x, y, ratio } = this.editor.viewport.view,
      lines = new Path2D();
    for (const [level] of legend) {
      for (const [u, v, p, q] of contourOf(values, [height, width], level)) {
        lines.moveTo(k * (raster.origin[0] + u * da) + x, k * (raster.origin[1] + v * db) + y);
        lines.lineTo(k * (raster.origin[0] + p * da) + x, k * (raster.origin[1] + q * db) + y);
      }
    }
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const [strokeStyle, lineWidth] of [
      ["rgba(0, 0, 0, 0.55)", 3],
      ["rgba(255, 255, 255, 0.9)", 1.4],
    ]) {
      Object.assign(c, { strokeStyle, lineWidth });
      c.stroke(lines);
    }
  }

  // ---- marks and words ----------------------------------------------------------------------------------------------

  /** A ring around the place where the map folds most. */
  #mark(folds: Folds | null) {
    const place = folds && folds.least <= 0 ? folds.place : null;
    setAttributes(this.worst, { visibility: place ? "visible" : "hidden" });
    if (!place) return;
    const [x, y] = this.editor.viewport.toView(place);
    setAttributes(this.worst, { transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})` });
  }

  /** Put the legend into a corner in which it hides no point, or few; it stays there while something moves. */
  #placeKey(isMoving: boolean) {
    if (this.key.hidden || isMoving) return;
    const {
        viewport: {
          view: { width, height },
        },
        points: { list: points },
      } = this.editor,
      air = 22; // CSS pixels: a disc, and from it to the edge
    const wide = this.key.offsetWidth + air,
      high = this.key.offsetHeight + air;
    const places = points.flatMap((p) => [p.target, p.source]).map((at) => this.editor.viewport.toView(at));
    const hidden = ([row, column]: string[]) =>
      places.filter(
        ([x, y]) => (column === "left" ? x < wide : x > width - wide) && (row === "top" ? y < high : y > height - high),
      ).length;
    const [row, column] = KEY_CORNERS.reduce((best, corner) => (hidden(corner) < hidden(best) ? corner : best));
    this.key.classList.toggle("dnb-ed-key-top", row === "top");
    this.key.classList.toggle("dnb-ed-key-right", column === "right");
  }

  #describe(kind: string) {
    const legend = kind === "uncertainty" ? this.#uncertaintyFacts.legend : [],
      described = JSON.stringify([kind, legend]);
    if (this.select.value !== this.kind) this.select.value = this.kind;
    if (described === this.described) return;
    this.described = described;
    this.select.title = tipOf(EDITOR_KEYS, "overlay", `What lies over the picture: ${OVERLAYS[this.kind]![1]}`);
    this.key.hidden = kind !== "area" && kind !== "uncertainty";
    this.key.classList.remove("dnb-ed-key-wide");
    this.key.replaceChildren();
    this.gain = "";
    if (kind === "area") this.#areaKey();
    if (kind === "uncertainty") this.#uncertaintyKey(legend);
  }

  #areaKey() {
    const most = 2 ** AREA_OCTAVES,
      { shrinks, same, grows } = AREA_COLOURS;
    const rgb = (colour: number[]) => `rgb(${colour.join(" ")})`;
    this.#bar("relative area", `linear-gradient(to right, ${[shrinks, same, grows].map(rgb).join(", ")})`, [
      [0, `1/${most}`],
      [0.5, "1"],
      [1, `${most}\u00d7`],
    ]);
    setAttributes(this.key, {
      "aria-label":
        `Relative area: purple is 1/${most} or less of what it was, white ` + `the same, green ${most} times or more`,
    });
  }

  #uncertaintyKey(legend: UncertaintyLegend) {
    const colour = UNCERTAINTY_COLOUR.join(" ");
    this.key.classList.add("dnb-ed-key-wide");
    const background = `linear-gradient(to right, rgb(${colour} / 0), rgb(${colour} / ${UNCERTAINTY_ALPHA}))`;
    const { bar, row } = this.#bar("uncertainty", background, []);
    row.classList.add("dnb-ed-key-words"); // in order, and never one over the other: the ticks show the places
    for (const [level, text] of legend) {
      pageElement("i", "", bar).style.left = `${(level / 2.55).toFixed(1)}%`;
      pageElement("span", "", row).textContent = text;
    }
    if (!legend.length) pageElement("div", "", this.key).textContent = "not known yet";
    const texts = legend.map(([, text]) => text).join(", ");
    setAttributes(this.key, { "aria-label": `Uncertainty: ${texts || "not known yet"}` });
  }

  /** A bar of colours with texts under it. */
  #bar(title: string, background: string, texts: [share: number, text: string][]) {
    pageElement("div", "", this.key).textContent = title;
    const bar = pageElement("div", "dnb-ed-key-bar", this.key);
    bar.style.background = background;
    const row = pageElement("div", "dnb-ed-key-texts", this.key);
    for (const [share, text] of texts) {
      const item = pageElement("span", "", row);
      item.textContent = text;
      item.style.left = `${(100 * share).toFixed(1)}%`;
      item.style.transform = `translateX(${(-100 * share).toFixed(1)}%)`; // no text extends beyond the ends
    }
    return { bar, row };
  }
}
