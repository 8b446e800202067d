// The maps of a field in the ray caster's form, with an editor's maps in place of some. No DOM. Equal to
// deformnb/widgets/textures.py: one layer for each map of each region, and the distance to each cut.

import type { FieldMaps } from "../generated.ts";
import { CUT_MARGIN, CUT_STEPS, MOST_REGIONS } from "../generated.ts";
import { layeredFit, layersOnRaster } from "../maths/cuts.ts";
import { pointsKey } from "../maths/points.ts";
import { RbfError, rbfKernelOf } from "../maths/rbf.ts";
import { bytesOf, floatsOf } from "../sync/buffers.ts";
import { FIT_TRAITS, FollowedModel, pointsOf, settingsOf } from "../sync/bus.ts";
import type {
  Bus,
  CutData,
  FitSettings,
  LayeredFit,
  Model,
  Point,
  PointsDetail,
  Raster,
  Region,
  Values,
} from "../types.ts";
import { bitsOf } from "../webgl/region_bits.ts";
import type { PlanarField, PlaneCut } from "../webgl/types.ts";
import type { Bytes, Field } from "./types.ts";

/** Distances to the cuts received last */
export type KnownCuts = { id?: string; distances?: Float32Array };
/** Values of the traits SHAPES */
export type Shapes = Record<string, unknown>;
export type Detail = Pick<PointsDetail, "points" | "settings"> & Partial<PointsDetail>;

const CUT_TILE = 32; // nodes along a square for which only the near edges of an outline are evaluated

/** The common part of messages about a field. */
export type FieldContent = Pick<FieldMaps, "box" | "planar" | "space" | "coarse" | "buffers">;

/** The content of a field with its buffers in place; null if it builds on distances that `known` does not hold. */
export function fieldOf(content: FieldContent, buffers: Bytes[], known: KnownCuts): Field | null {
  const { box, coarse, planar, space, buffers: names } = content;
  const isHalf = (name: string) => space?.cut && (name === "space" || name === "depths");
  const parts: Values = Object.fromEntries(
    names.map((name, k) => [
      name,
      isHalf(name) ? new Uint16Array(bytesOf(buffers[k]!).slice().buffer) : floatsOf(buffers[k]!),
    ]),
  );
  const cut = planar?.cut ?? null;
  if (cut && parts.distances) {
    known.id = cut.id;
    known.distances = parts.distances;
  }
  if (cut && known.id !== cut.id) return null;
  return {
    box,
    coarse,
    planar: planar && {
      ...planar,
      maps: parts.maps,
      weights: parts.weights,
      cut: cut && { ...cut, distances: known.distances! },
    },
    space: space && { ...space, values: parts.space, depths: parts.depths },
  };
}

/**
 * A planar field with one of its maps recomputed in each region, or null if there is no such map or it cannot be made.
 * @param settings those that the fit was made with
 * @param index which map it is
 */
export function withLayers(
  base: PlanarField,
  layered: LayeredFit,
  { cuts = [] }: FitSettings,
  index: number,
): PlanarField | null {
  const [layers, rows, columns] = base.shape,
    size = rows * columns * 2,
    before = base.cut ? base.cut.sides.length : 1;
  const count = layers / before,
    cut = layered.regions.length ? planeCut(base, layered, cuts) : null;
  const isSame = cut ? cut.sides === base.cut?.sides : !base.cut;
  if (index >= count || (!isSame && count > 1)) return null; // Python must divide the other maps too
  const keys = cut ? cut.sides.map(bitsOf) : [0];
  const raster: Raster = { shape: [rows, columns], origin: base.origin, spacing: base.spacing };
  const maps = isSame ? base.maps.slice() : new Float32Array(keys.length * size);
  const values = layersOnRaster(layered, raster);
  keys.forEach((key, r) => {
    const k = layered.regions.length ? layered.fits.findIndex((f) => f.key === key) : 0;
    const at = (r * count + index) * size;
    if (k >= 0) maps.set(values[k]!, at);
    else maps.fill(0, at, at + size); // a region without points stays
  });
  return { ...base, maps, shape: [keys.length * count, rows, columns], cut: cut && { ...cut, rule: layered.rule } };
}

/**
 * The cuts of a fit: the base's own while the lines are unchanged, for then only the maps change.
 */
function planeCut(base: PlanarField, layered: LayeredFit, cuts: CutData[]): PlaneCut | null {
  const name = JSON.stringify(cuts.filter((cut) => cut.enabled !== false).map((cut) => cut.region));
  const old = base.cut,
    isSame = old && (old.name ?? JSON.stringify(old.regions)) === name;
  if (isSame && layered.fits.every(({ key }) => old.sides.some((s) => bitsOf(s) === key))) return old;
  const raster = old ? rasterOf(old) : cutRaster(base),
    {
      shape: [rows, columns],
      origin,
      spacing,
    } = raster;
  const distances = isSame ? old.distances : cutDistances(layered.regions, raster);
  const count = layered.regions.length,
    keys = new Set(layered.fits.map(({ key }) => key));
  for (let i = 0; i < rows * columns; i++) {
    let bits = 0;
    for (let c = 0; c < count; c++) if (distances[c * rows * columns + i]! < 0) bits += 2 ** c;
    keys.add(bits);
  }
  if (keys.size > MOST_REGIONS) return null;
  const sides = [...keys].sort((a, b) => a - b).map((key) => layered.regions.map((_, c) => Boolean(key & (1 << c))));
  return { shape: [count, rows, columns], origin, spacing, distances, sides, name };
}

function rasterOf({ shape: [, rows, columns], origin, spacing }: PlaneCut): Raster {
  return { shape: [rows, columns], origin, spacing };
}

/** Nodes around those of the maps. */
function cutRaster({ shape: [, rows, columns], origin, spacing }: PlanarField): Raster {
  const [width, height] = [(columns - 1) * spacing[0], (rows - 1) * spacing[1]],
    margin = CUT_MARGIN * Math.max(width, height),
    longest = Math.max(width, height) + 2 * margin;
  const nodes = (length: number) => Math.max(8, Math.ceil((CUT_STEPS * length) / longest));
  const [a, b] = [width + 2 * margin, height + 2 * margin];
  return {
    shape: [nodes(b), nodes(a)],
    origin: [origin[0] - margin, origin[1] - margin],
    spacing: [a / (nodes(a) - 1), b / (nodes(b) - 1)],
  };
}

/** Signed distances to each region at the nodes of a raster, one layer after the other. */
function cutDistances(regions: Region[], { shape: [rows, columns], origin, spacing }: Raster) {
  const out = new Float32Array(regions.length * rows * columns);
  const radius = 0.5 * CUT_TILE * Math.hypot(...spacing);
  for (let y = 0; y < rows; y += CUT_TILE) {
    for (let x = 0; x < columns; x += CUT_TILE) {
      const a = origin[0] + (x + CUT_TILE / 2) * spacing[0],
        b = origin[1] + (y + CUT_TILE / 2) * spacing[1];
      regions.forEach((region, c) => {
        const distance = region.near(a, b, radius),
          layer = c * rows * columns;
        for (let i = y; i < Math.min(y + CUT_TILE, rows); i++) {
          for (let k = x; k < Math.min(x + CUT_TILE, columns); k++) {
            out[layer + i * columns + k] = distance(origin[0] + k * spacing[0], origin[1] + i * spacing[1]);
          }
        }
      });
    }
  }
  return out;
}

// Following an Editor in the same window: its fits are sampled here, by maths/cuts.js, and nothing goes to Python.
//
// Python's maps and the editor's points reach the view by different channels. Python's maps are shown as they are where
// they are of the points that the editor has now, where another map begins to be followed, or where Python shows
// something else; they are replaced where the editor has changed since, so that no old picture flashes up.

export const SHAPES = ["cuts", "cut_rule", "parts"];
const FOLLOWED = ["points", ...FIT_TRAITS];

export class FieldLink {
  awaited: Detail | null = null; // the newest movement, if its maps have not been made
  base: PlanarField | null = null; // the maps that are shown
  followed: FollowedModel;
  editor: Model | null = null;
  bus: Bus | null = null;
  count = 0; // fits that were sampled here
  ms = 0; // of the last of them
  isMoving = false;
  index: number | null = null; // of the map that the editor's points make
  expected: string | null = null; // the input of Python's maps
  settled = "";

  /**
   * @param model the view's
   * @param apply takes new maps
   * @param move is called at a movement, and at its end: the view calls catchUp for the maps when it draws, for points move more often than a volume is drawn
   */
  constructor(
    readonly model: Model,
    readonly apply: (planar: PlanarField, isDrawing: boolean) => void,
    public move: (isMoving: boolean) => void,
  ) {
    this.followed = new FollowedModel(model);
  }

  async follow(reference: string | Model | null) {
    if (reference === this.followed.reference) return; // following again removes no listener
    this.close();
    const found = await this.followed.choose(reference);
    if (!found) return;
    const { model: editor, bus } = found;
    this.editor = editor;
    this.bus = bus;
    this.followed.hear(bus, "deformnb:points", ({ detail }) => this.followMove(detail));
    // An editor that is not drawn in this window publishes nothing; its traits still change.
    const changed = () => {
      if (!bus.latest) this.followMove(traitsOf(bus, editor));
    };
    for (const name of FOLLOWED) {
      editor.on(`change:${name}`, changed);
      this.followed.ends.push(() => editor.off(`change:${name}`, changed));
    }
    if (this.#isNewer(bus, editor)) this.refit(newestOf(bus, editor));
  }

  /**
   * Python's maps, with the editor's newer map in place of one of them.
   * @param follow if Python follows the editor: the map of the editor's points, and the points, cuts and parts that the maps are of; null if it shows something else
   */
  merge(planar: PlanarField | null, follow: { index: number; points: Point[]; shapes?: Shapes } | null) {
    const { bus, editor } = this,
      isSwitch = follow !== null && this.index !== null && this.index !== follow.index;
    this.base = planar;
    this.expected = follow && shapesKey(follow.points, follow.shapes ?? shapesOf(editor));
    if (follow) this.index = follow.index;
    if (!planar || !bus || !editor) return planar;
    const isMoving = bus.latest?.phase === "move";
    if (isMoving || (follow && !isSwitch && this.#isNewer(bus, editor))) {
      const newer = this.#sampleField(newestOf(bus, editor));
      if (newer) return newer;
    }
    this.settled = detailKey(newestOf(bus, editor));
    return planar;
  }

  /** True if the editor has other points than Python's maps. */
  #isNewer(bus: Bus, editor: Model) {
    return this.expected !== shapesKey(pointsOf(bus, editor) || [], shapesOf(editor));
  }

  followMove(detail: Detail) {
    const isMoving = detail.phase === "move";
    this.awaited = isMoving ? detail : null;
    this.move(isMoving); // also of an end at which nothing is new: the view waits for one
    if (!isMoving && detailKey(detail) !== this.settled) this.refit(detail); // else Python's maps show it already
  }

  /** Make the maps of the newest movement, unless they have been made. */
  catchUp() {
    const { awaited } = this;
    this.awaited = null;
    if (awaited) this.refit(awaited, true);
  }

  /** Sample a fit on the raster of the maps that Python has sent, and show it. */
  refit(detail: Detail, isDrawing = false) {
    const planar = this.#sampleField(detail);
    if (planar) this.apply(planar, isDrawing);
  }

  #sampleField({ points, settings, layered, sampled, phase }: Detail) {
    if (!this.base) return null;
    const start = performance.now();
    let found = null;
    try {
      rbfKernelOf(settings); // the editor has made the fit; this script evaluates it
      const fits = layered === undefined ? layeredFit(points, settings) : (sampled ?? layered);
      found = fits && withLayers(this.base, fits, settings, this.index ?? this.model.get("editor_map") ?? 0);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error; // the editor shows what is wrong
    }
    if (!found) return null; // the last good picture remains
    this.base = found;
    this.isMoving = phase === "move";
    this.settled = "";
    this.count += 1;
    this.ms = performance.now() - start;
    return this.base;
  }

  close() {
    this.followed.end();
    this.awaited = null;
    this.editor = null;
    this.bus = null;
    this.settled = "";
  }
}

function shapesOf(editor: Model | null) {
  return Object.fromEntries(SHAPES.map((name) => [name, editor?.get(name) ?? null]));
}

function traitsOf(bus: Bus, editor: Model): Detail {
  return { points: pointsOf(bus, editor), settings: settingsOf(editor) };
}

/** The points under the pointer that is moving them, else those that the editor's model holds. */
function newestOf(bus: Bus, editor: Model): Detail {
  const { latest } = bus,
    traits = traitsOf(bus, editor);
  const isNewest = latest?.phase === "move" || (latest && pointsKey(latest.points) === pointsKey(traits.points || []));
  return latest && isNewest ? latest : traits;
}

function shapesKey(points: Point[], shapes: Shapes) {
  return pointsKey(points) + JSON.stringify(SHAPES.map((name) => shapes[name]));
}

function detailKey({ points, settings }: Detail) {
  return pointsKey(points || []) + JSON.stringify(settings);
}
