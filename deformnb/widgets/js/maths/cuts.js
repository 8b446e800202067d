// Fits that cuts keep apart, equal to deformnb.rbf.cuts in the plane (Eqs. 7-8).

import { rbfCheckPoints } from "./rbf.js";
import { regionOf } from "./regions.js";
import { fieldAt, fieldOnRaster, stagedFit } from "./rigid_stages.js";

/** @import { FitSettings, LayeredFit, Point, Raster, Region } from "../types.d.ts" */

/**
 * The fits of the points in the regions between the cuts; without cuts one fit of all points.
 * @param {Point[]} points
 * @param {FitSettings & { previous?: LayeredFit | null }} [settings]
 * @returns {LayeredFit}
 */
export function layeredFit(points, settings = {}) {
  const regions = (settings.cuts ?? []).filter((cut) => cut.enabled !== false).map((cut) => regionOf(cut.region));
  const before = new Map(settings.previous?.fits.map(({ key, fit }) => [key, fit]));
  /** @type {Map<number, Point[]>} */
  const groups = new Map();
  rbfCheckPoints(points);
  for (const p of points) {
    if (p.active === false) continue;
    const key = sidesKey(regions, p.source[0], p.source[1]), group = groups.get(key);
    if (group) group.push(p);
    else groups.set(key, [p]);
  }
  if (!regions.length) groups.set(0, points);
  const order = regions.map((_, k) => 1 << k);
  const inOrder = [...groups].sort(([p], [q]) => {
    const bit = order.find((b) => (p ^ q) & b);
    return bit ? (p & bit) - (q & bit) : 0;
  });
  const fits = inOrder.map(([key, own]) => ({ key, sides: regions.map((_, k) => Boolean(key & (1 << k))),
    fit: stagedFit(own, settings.parts, { ...settings, previous: before.get(key) ?? null }) }));
  return { fits, regions, rule: settings.cut_rule ?? "source", fit: regions.length ? null : fits[0].fit,
    byKey: new Map(fits.map(({ key }, k) => [key, k])), notes: [...new Set(fits.flatMap(({ fit }) => fit.notes))],
    doubts: [...new Set(fits.flatMap(({ fit }) => fit.doubts))],
    count: fits.reduce((sum, { fit }) => sum + fit.count, 0),
    hasRest: regions.length > 0 && fits.length < 2 ** regions.length };
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
