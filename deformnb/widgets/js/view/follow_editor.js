// The maps of a field as the ray caster takes them, with those that an editor makes put in. Needs maths/regions.js, maths/cuts.js.
// No DOM. Equal to deformnb/widgets/textures.py: one layer for each map of each region, and the distance to each cut.

import { layeredFit, layersOnRaster } from "../maths/cuts.js";
import { RbfError } from "../maths/rbf.js";
import { FIT_TRAITS, busOf, holdBus, pointsOf, releaseBus, settingsOf } from "../sync/bus.js";
import { MOST_REGIONS } from "../webgl/displacement_shader.js";
import { bytesOf, floatsOf } from "./volume_loader.js";

const CUT_STEPS = 512, CUT_MARGIN = 0.125; // nodes along the longer side, and how far beyond the maps they go
const CUT_TILE = 32; // nodes along a square that only the near edges of an outline are asked for

/** The message "field" with its buffers in place; null if it builds on distances that `known` does not hold. */
export function fieldOf(content, buffers, known) {
  const isHalf = (name) => content.space?.cut && (name === "space" || name === "depths");
  const parts = Object.fromEntries(content.buffers.map((name, k) => [name,
    isHalf(name) ? new Uint16Array(bytesOf(buffers[k]).slice().buffer) : floatsOf(buffers[k])]));
  const planar = content.planar && { ...content.planar, maps: parts.maps, weights: parts.weights };
  if (planar?.cut) {
    if (parts.distances) { known.id = planar.cut.id; known.distances = parts.distances; }
    if (known.id !== planar.cut.id) return null;
    planar.cut = { ...planar.cut, distances: known.distances };
  }
  return { box: content.box, coarse: content.coarse, planar, space: content.space && { ...content.space, values: parts.space, depths: parts.depths } };
}

/**
 * A planar field with one of its maps made anew in each region, or null if it has no such map or cannot be told.
 * layered: of layeredFit; settings: with the cuts that it was made with; index: which map it is.
 */
export function withLayers(base, layered, { cuts = [] }, index) {
  const [layers, rows, columns] = base.shape, size = rows * columns * 2, before = base.cut ? base.cut.sides.length : 1;
  const count = layers / before, cut = layered.regions.length ? cutOf(base, layered, cuts) : null;
  const isSame = cut ? cut.sides === base.cut?.sides : !base.cut;
  if (index >= count || (!isSame && count > 1)) return null; // other maps would have to be divided too: Python does that
  const keys = cut ? cut.sides.map(bitsOf) : [0], raster = { shape: [rows, columns], origin: base.origin, spacing: base.spacing };
  const maps = isSame ? base.maps.slice() : new Float32Array(keys.length * size);
  const values = layersOnRaster(layered, raster);
  keys.forEach((key, r) => {
    const k = layered.regions.length ? layered.fits.findIndex((f) => f.key === key) : 0, at = (r * count + index) * size;
    if (k >= 0) maps.set(values[k], at); else maps.fill(0, at, at + size); // a region without points stays
  });
  return { ...base, maps, shape: [keys.length * count, rows, columns], cut: cut && { ...cut, rule: layered.rule } };
}

function bitsOf(sides) { return sides.reduce((sum, inside, c) => sum + (inside ? 2 ** c : 0), 0); }

// The cuts of a fit: the base's own while the same lines are drawn, for then nothing of them changes but the maps.
function cutOf(base, layered, cuts) {
  const name = JSON.stringify(cuts.filter((cut) => cut.enabled !== false).map((cut) => cut.region));
  const old = base.cut, isSame = old && (old.name ?? JSON.stringify(old.regions)) === name;
  if (isSame && layered.fits.every(({ key }) => old.sides.some((s) => bitsOf(s) === key))) return old;
  const raster = old ?? cutRaster(base), [, rows, columns] = raster.shape, { origin, spacing } = raster;
  const distances = isSame ? old.distances : cutDistances(layered.regions, { shape: [rows, columns], origin, spacing });
  const count = layered.regions.length, keys = new Set(layered.fits.map(({ key }) => key));
  for (let i = 0; i < rows * columns; i++) {
    let bits = 0;
    for (let c = 0; c < count; c++) if (distances[c * rows * columns + i] < 0) bits += 2 ** c;
    keys.add(bits);
  }
  if (keys.size > MOST_REGIONS) return null;
  const sides = [...keys].sort((a, b) => a - b).map((key) => layered.regions.map((_, c) => Boolean(key & (1 << c))));
  return { shape: [count, rows, columns], origin, spacing, distances, sides, name };
}

// Nodes around those of the maps.
function cutRaster({ shape: [, rows, columns], origin, spacing }) {
  const size = [(columns - 1) * spacing[0], (rows - 1) * spacing[1]], margin = CUT_MARGIN * Math.max(...size);
  const lengths = size.map((l) => l + 2 * margin), longest = Math.max(...lengths);
  const counts = lengths.map((l) => Math.max(8, Math.ceil((CUT_STEPS * l) / longest)));
  return { shape: [0, counts[1], counts[0]], origin: origin.map((o) => o - margin),
    spacing: lengths.map((l, i) => l / (counts[i] - 1)) };
}

/** Signed distances to each region at the nodes of a raster, one layer after the other. */
function cutDistances(regions, { shape: [rows, columns], origin, spacing }) {
  const out = new Float32Array(regions.length * rows * columns);
  const radius = 0.5 * CUT_TILE * Math.hypot(...spacing);
  for (let y = 0; y < rows; y += CUT_TILE) {
    for (let x = 0; x < columns; x += CUT_TILE) {
      const a = origin[0] + (x + CUT_TILE / 2) * spacing[0], b = origin[1] + (y + CUT_TILE / 2) * spacing[1];
      regions.forEach((region, c) => {
        const distance = region.near(a, b, radius), layer = c * rows * columns;
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

// Follows an Editor in the same page: what it has fitted is sampled here, by maths/cuts.js, and nothing goes to Python.
//
// Python's maps and the editor's points reach the page by different ways. Python's maps are shown as they are where
// they are of the points that the editor has now, where another map begins to be followed, or where Python shows
// something else; they give way where the editor has gone on since, so that no old picture flashes up.

export const SHAPES = ["cuts", "cut_rule", "parts"];
const FOLLOWED = ["points", ...FIT_TRAITS];

export class FieldLink {
  /**
   * apply(planar, isDrawing) is called with what RayCaster.setPlanar takes. hand(isMoving) is told of a movement, and of
   * its end: it asks catchUp for the maps when it is drawing, for a hand moves more often than a volume is drawn.
   */
  constructor(model, apply, hand) {
    Object.assign(this, { model, apply, hand, awaited: null, base: null, reference: null, editor: null, bus: null,
      count: 0, ms: 0, isMoving: false, index: null, expected: null, settled: "" });
    this.undo = [];
  }

  async follow(reference) {
    if (reference === this.reference) return; // following again tears nothing down
    this.close();
    this.reference = reference;
    if (!reference) return;
    const ticket = (this.ticket = {});
    const editor = typeof reference === "string"
      ? await this.model.widget_manager.get_model(reference.replace("IPY_MODEL_", "")) : reference;
    if (this.ticket !== ticket) return; // another one was chosen meanwhile
    this.editor = editor;
    const bus = (this.bus = busOf(editor)), uid = editor.get("uid");
    holdBus(bus); // the editor's own view may go and come back
    const moved = (event) => this.moved(event.detail);
    bus.addEventListener("deformnb:points", moved);
    this.undo.push(() => bus.removeEventListener("deformnb:points", moved), () => releaseBus(bus, uid));
    // An editor that is not drawn on this page publishes nothing; its traits still change.
    const changed = () => { if (!bus.latest) this.moved(this.#traits()); };
    for (const name of FOLLOWED) {
      editor.on(`change:${name}`, changed);
      this.undo.push(() => editor.off(`change:${name}`, changed));
    }
    if (this.#isNewer()) this.refit(this.#newest());
  }

  /**
   * Python's maps, with what the editor has shown since in place of one of them. follow: {index, points, shapes} if
   * Python follows the editor, with the points, cuts and parts that the maps are of; null if it shows something else.
   */
  merged(planar, follow) {
    const isSwitch = Boolean(follow) && this.index !== null && this.index !== follow.index;
    this.base = planar;
    this.expected = follow ? madeKey(follow.points, follow.shapes ?? this.#shapes()) : null;
    if (follow) this.index = follow.index;
    if (!planar || !this.editor) return planar;
    const isMoving = Boolean(this.bus.latest && this.bus.latest.phase === "move");
    if (isMoving || (follow && !isSwitch && this.#isNewer())) {
      const newer = this.#sampled(this.#newest());
      if (newer) return newer;
    }
    this.settled = detailKey(this.#newest());
    return planar;
  }

  /** Whether the editor has other points than Python's maps. */
  #isNewer() {
    return this.expected === null || this.expected !== madeKey(pointsOf(this.bus, this.editor) || [], this.#shapes());
  }

  #shapes() { return Object.fromEntries(SHAPES.map((name) => [name, this.editor?.get(name) ?? null])); }

  #traits() { return { points: pointsOf(this.bus, this.editor), settings: settingsOf(this.editor) }; }

  /** What is on the way under the pointer, else what the editor's model holds. */
  #newest() {
    const { latest } = this.bus, traits = this.#traits();
    return latest && (latest.phase === "move" || pointsKey(latest.points) === pointsKey(traits.points || [])) ? latest : traits;
  }

  moved(detail) {
    const isMoving = detail.phase === "move";
    this.awaited = isMoving ? detail : null;
    this.hand(isMoving); // also of an end at which nothing is new: the view waits for one
    if (!isMoving && detailKey(detail) !== this.settled) this.refit(detail); // else Python's maps show it already
  }

  /** The maps of the newest movement, unless they have been made. */
  catchUp() {
    const { awaited } = this;
    this.awaited = null;
    if (awaited) this.refit(awaited, true);
  }

  /** Samples a fit on the raster of the maps that Python has sent, and shows it. */
  refit(detail, isDrawing = false) {
    const planar = this.#sampled(detail);
    if (planar) this.apply(planar, isDrawing);
  }

  #sampled({ points, settings, layered, phase }) {
    if (!this.base) return null;
    const start = performance.now();
    let found = null;
    try {
      const fits = layered === undefined ? layeredFit(points, settings) : layered;
      found = fits && withLayers(this.base, fits, settings, this.index ?? this.model.get("editor_map") ?? 0);
    } catch (error) {
      if (!(error instanceof RbfError)) throw error; // the editor says what is wrong
    }
    if (!found) return null; // the last good picture stays
    this.base = found;
    this.isMoving = phase === "move";
    this.settled = "";
    this.count += 1;
    this.ms = performance.now() - start;
    return this.base;
  }

  close() {
    for (const step of this.undo) step();
    this.undo = [];
    this.ticket = null;
    this.awaited = null;
    this.editor = null;
    this.bus = null;
    this.reference = null;
    this.settled = "";
  }
}

/** Equal for points that give the same fit. */
function pointsKey(points) {
  return JSON.stringify(points.map((p) => [p.id, p.source, p.target, p.active !== false, p.weight ?? 1, p.radius ?? null]));
}

function madeKey(points, shapes) { return pointsKey(points) + JSON.stringify(SHAPES.map((name) => shapes[name])); }

function detailKey({ points, settings }) { return pointsKey(points || []) + JSON.stringify(settings); }
