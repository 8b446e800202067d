// Fits that cuts keep apart, equal to deformnb.rbf.cuts in the plane (Eqs. 7-8), and to deformnb.rbf.slits where cuts
// stop inside the body.

import { MOST_SLITS } from "./constants.js";
import { RbfError, rbfCheckPoints } from "./rbf.js";
import { regionOf } from "./regions.js";
import { fieldAt, fieldOnRaster, stagedFit } from "./rigid_stages.js";

/** @import { Fit, FitSettings, LayeredFit, Point, Raster, Region } from "../types.d.ts" */

/**
 * The fits of the points in the regions between the cuts; without cuts one fit of all points.
 * @param {Point[]} points
 * @param {FitSettings & { previous?: LayeredFit | null }} [settings]
 * @returns {LayeredFit}
 */
export function layeredFit(points, settings = {}) {
  const regions = (settings.cuts ?? []).filter((cut) => cut.enabled !== false).map((cut) => regionOf(cut.region));
  const before = new Map(settings.previous?.fits.map(({ key, fit }) => [key, fit]));
  rbfCheckPoints(points);
  checkSlits(regions, settings.cut_rule ?? "source");
  /** @type {(own: Point[], previous: Fit | null) => Fit} */
  const fitOf = (own, previous) => stagedFit(own, settings.parts, { ...settings, previous });
  const found = !regions.length ? [{ key: 0, fit: fitOf(points, before.get(0) ?? null) }]
    : regions.some(({ opening }) => opening) ? fitsBesideSlits(points, regions, before, fitOf)
      : [...groupsOf(points, regions)].map(([key, own]) => ({ key, fit: fitOf(own, before.get(key) ?? null) }));
  const order = regions.map((_, k) => 1 << k);
  const fits = found.sort(({ key: p }, { key: q }) => {
    const bit = order.find((b) => (p ^ q) & b);
    return bit ? (p & bit) - (q & bit) : 0;
  }).map(({ key, fit }) => ({ key, sides: regions.map((_, k) => Boolean(key & (1 << k))), fit }));
  return { fits, regions, rule: settings.cut_rule ?? "source", fit: regions.length ? null : fits[0].fit,
    byKey: new Map(fits.map(({ key }, k) => [key, k])), notes: [...new Set(fits.flatMap(({ fit }) => fit.notes))],
    count: fits.reduce((sum, { fit }) => sum + fit.count, 0),
    hasRest: regions.length > 0 && fits.length < 2 ** regions.length };
}

/**
 * The active points by their sides of some of the regions, as of sidesKey.
 * @param {Point[]} points
 * @param {Region[]} regions
 * @param {number} [mask]  the bits of the regions that count
 */
function groupsOf(points, regions, mask = -1) {
  /** @type {Map<number, Point[]>} */
  const groups = new Map();
  for (const p of points) {
    if (p.active === false) continue;
    const key = sidesKey(regions, p.source[0], p.source[1]) & mask, group = groups.get(key);
    if (group) group.push(p);
    else groups.set(key, [p]);
  }
  return groups;
}

/** As check_slits in deformnb.rbf.slits. @param {Region[]} regions @param {string} rule */
function checkSlits(regions, rule) {
  const count = regions.filter(({ opening }) => opening).length;
  if (count > MOST_SLITS) {
    throw new RbfError(`at most ${MOST_SLITS} cuts of a step may stop inside the body, got ${count}; let one go on to ` +
      "the border, or put it in a step of its own.");
  }
  if (count && rule === "paper") {
    throw new RbfError('the rule "paper" of cuts (Eq. 8) hides what crosses a line, also where that has stopped; use ' +
      'the rule "source", or let the cuts go on to the border.');
  }
}

/**
 * The blended fits of every region between cuts of which some stop, as fits_beside_slits in deformnb.rbf.slits.
 * @param {Point[]} points
 * @param {Region[]} regions
 * @param {Map<number, Fit>} before
 * @param {(own: Point[], previous: Fit | null) => Fit} fitOf
 */
function fitsBesideSlits(points, regions, before, fitOf) {
  const stop = regions.flatMap(({ opening }, k) => (opening ? [k] : [])), all = 2 ** regions.length - 1;
  const masks = Array.from({ length: 1 << stop.length }, (_, bits) => (
    stop.reduce((mask, k, j) => (bits & (1 << j) ? mask : mask & ~(1 << k)), all)));
  const groups = masks.map((mask) => groupsOf(points, regions, mask));
  /** @type {Map<number, Fit>[]} */
  const known = masks.map(() => new Map());
  const openings = stop.flatMap((k) => regions[k].opening ?? []);
  /** @type {{ key: number, fit: Fit }[]} */
  const made = [];
  for (let key = 0; key <= all; key++) {
    const last = before.get(key)?.blend?.fits;
    const fits = masks.map((mask, bits) => {
      const own = groups[bits].get(key & mask);
      const fit = known[bits].get(key & mask) ?? (own ? fitOf(own, last?.[bits] ?? null) : null);
      if (fit) known[bits].set(key & mask, fit);
      return fit;
    });
    const some = fits.filter((fit) => fit !== null), main = some[some.length - 1];
    if (!main) continue;
    made.push({ key, fit: { ...main, base: undefined, rigid: undefined, stages: undefined, forward: undefined,
      blend: { fits, openings }, count: some.reduce((sum, { count }) => sum + count, 0),
      notes: [...new Set(some.flatMap(({ notes }) => notes))] } });
  }
  return made;
}

/**
 * The sides of a place as one number: bit k is set inside region k.
 * @param {Pick<Region, "distance">[]} regions
 * @param {number} a
 * @param {number} b
 */
export function sidesKey(regions, a, b) {
  let key = 0;
  for (let k = 0; k < regions.length; k++) if (regions[k].distance(a, b) < 0) key |= 1 << k;
  return key;
}

/** The same of the cuts of a fit. @param {LayeredFit} layered @param {number} a @param {number} b */
export function regionKey(layered, a, b) { return sidesKey(layered.regions, a, b); }

/**
 * The distance of a place from the boundary of the region of these sides; negative outside.
 * @param {Pick<Region, "distance">[]} regions
 * @param {number} key
 * @param {number} a
 * @param {number} b
 */
export function marginOf(regions, key, a, b) {
  let least = Infinity;
  for (let k = 0; k < regions.length; k++) {
    const d = regions[k].distance(a, b), into = key & (1 << k) ? -d : d;
    if (into < least) least = into;
  }
  return least;
}

/**
 * The share of a pixel within a region, for an edge of this softness.
 * @param {number} margin
 * @param {number} softness
 */
export function coverage(margin, softness) {
  return Math.max(0, Math.min(1, 0.5 + margin / softness));
}

/**
 * The displacements of each fit at the pixels of a raster, as of fieldOnRaster.
 * @param {LayeredFit} layered
 * @param {Raster} raster
 * @param {(Float32Array | null)[]} [outs]
 */
export function layersOnRaster(layered, raster, outs = []) {
  return layered.fits.map(({ fit }, k) => fieldOnRaster(fit, raster, outs[k] ?? null));
}

/**
 * What is seen at a place: [da, db, opacity, k] of fit k; -1 in a region without points, which does not move.
 * @param {LayeredFit} layered
 * @param {number} a
 * @param {number} b
 * @param {number} softness
 * @param {number[]} [out]
 */
export function placeOf(layered, a, b, softness, out = [0, 0, 1, 0]) {
  const { fits, regions } = layered;
  if (!regions.length) { [out[0], out[1]] = fieldAt(fits[0].fit, a, b); out[2] = 1; out[3] = 0; return out; }
  const moves = fits.map(({ fit }) => fieldAt(fit, a, b));
  return chosenPlace(layered, regions, a, b, (k) => moves[k], softness, out);
}

/**
 * The same from displacements that are known.
 * @param {LayeredFit} layered
 * @param {Pick<Region, "distance">[]} regions
 * @param {number} a
 * @param {number} b
 * @param {(k: number) => number[]} move  the displacement of fit k at (a, b)
 * @param {number} softness
 * @param {number[]} out
 */
export function chosenPlace(layered, regions, a, b, move, softness, out) {
  const { fits } = layered, own = sidesKey(regions, a, b), at = layered.byKey.get(own) ?? -1;
  /** @type {(k: number) => number} */
  const there = (k) => {
    const [da, db] = move(k);
    return coverage(marginOf(regions, fits[k].key, a + da, b + db), softness);
  };
  let k = at, opacity = 1;
  if (layered.rule === "paper") {
    if (at >= 0) opacity = Math.min(1, there(at) / (coverage(marginOf(regions, own, a, b), softness) || 1));
  } else {
    let still = 1; // the share of the place in regions without points, which do not move
    if (layered.hasRest) for (const { key } of fits) still -= coverage(marginOf(regions, key, a, b), softness);
    still = layered.hasRest ? Math.max(0, Math.min(1, still)) : 0;
    let best = at < 0 ? still : there(at), sum = at < 0 ? still : still + best;
    const isCertain = best >= 0.5;
    for (let j = 0; j < fits.length; j++) {
      if (j === at || (isCertain && sum >= 1)) continue;
      const c = there(j);
      sum += c;
      if (!isCertain && c > best) { best = c; k = j; }
    }
    if (!isCertain && still > best) k = -1;
    opacity = Math.min(1, sum);
  }
  const [da, db] = k < 0 ? NO_MOVE : move(k);
  out[0] = da;
  out[1] = db;
  out[2] = opacity;
  out[3] = k;
  return out;
}

const NO_MOVE = [0, 0];
