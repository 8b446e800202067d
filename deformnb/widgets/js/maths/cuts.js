// Fits that cuts keep apart, equal to deformnb.rbf.cuts in the plane (Eqs. 7-8). Needs maths/rbf.js, maths/regions.js,
// maths/rigid_stages.js, maths/rigid_stages.js. No DOM.
//
//   layeredFit(points, settings)  -> {fits: [{key, sides, fit}], regions, rule, ...}; settings as of rbfFit, and
//                                    cuts: [{region, name, enabled}], cut_rule: "source" | "paper", parts (maths/rigid_stages.js),
//                                    stages (maths/rigid_stages.js)
//   layersOnRaster(layered, raster, outs)         -> the displacements of each fit, Float32Array (nv * nu * 2)
//   placeOf(layered, a, b, softness, out)         -> [da, db, opacity, k]: what is seen at a place, from which fit;
//                                                    k is -1 in a region without points, which does not move
//   regionKey(layered, a, b)                      -> the sides of a place as one number: bit k is set inside cut k
//   previous: the layered fit before this one
//
// Without cuts there is one fit of all points, which is always the one that is seen. layered.fit is that one, or null.

import { rbfCheckPoints } from "./rbf.js";
import { regionOf } from "./regions.js";
import { fieldAt, fieldOnRaster, stagedFit } from "./rigid_stages.js";

export const CUT_RULES = ["source", "paper"];
export const CUT_MOST = 8;

export function layeredFit(points, settings = {}) {
  const cuts = (settings.cuts ?? []).filter((cut) => cut.enabled !== false), regions = cuts.map((cut) => regionOf(cut.region));
  const before = new Map((settings.previous?.fits ?? []).map(({ key, fit }) => [key, fit]));
  const groups = new Map();
  rbfCheckPoints(points);
  for (const p of points) {
    if (p.active === false) continue;
    const key = sidesKey(regions, ...p.source);
    if (!groups.has(key)) groups.set(key, []);
    groups.get(key).push(p);
  }
  if (!regions.length) groups.set(0, points);
  const order = regions.map((_, k) => 1 << k);
  const inOrder = [...groups].sort(([p], [q]) => {
    const bit = order.find((b) => (p ^ q) & b);
    return bit ? (p & bit) - (q & bit) : 0;
  });
  const fits = inOrder.map(([key, own]) => ({ key, sides: regions.map((_, k) => Boolean(key & (1 << k))),
    fit: stagedFit(own, settings.parts, { ...settings, previous: before.get(key) ?? null }) }));
  const layered = { fits, regions, rule: settings.cut_rule ?? "source", fit: regions.length ? null : fits[0].fit };
  layered.byKey = new Map(fits.map(({ key }, k) => [key, k]));
  for (const name of ["notes", "doubts"]) layered[name] = [...new Set(fits.flatMap(({ fit }) => fit[name] ?? []))];
  layered.count = fits.reduce((sum, { fit }) => sum + fit.count, 0);
  layered.hasRest = regions.length > 0 && fits.length < 2 ** regions.length;
  return layered;
}

export function sidesKey(regions, a, b) {
  let key = 0;
  for (let k = 0; k < regions.length; k++) if (regions[k].distance(a, b) < 0) key |= 1 << k;
  return key;
}

export function regionKey(layered, a, b) { return sidesKey(layered.regions, a, b); }

// How far a place is within the region of these sides; negative outside.
export function marginOf(regions, key, a, b) {
  let least = Infinity;
  for (let k = 0; k < regions.length; k++) {
    const d = regions[k].distance(a, b), into = key & (1 << k) ? -d : d;
    if (into < least) least = into;
  }
  return least;
}

export function coverage(margin, softness) {
  const c = 0.5 + margin / softness;
  return c < 0 ? 0 : c > 1 ? 1 : c;
}

export function layersOnRaster(layered, raster, outs = []) {
  return layered.fits.map(({ fit }, k) => fieldOnRaster(fit, raster, outs[k] ?? null));
}

export function placeOf(layered, a, b, softness, out = [0, 0, 1, 0]) {
  const { fits, regions } = layered;
  if (!regions.length) { [out[0], out[1]] = fieldAt(fits[0].fit, a, b); out[2] = 1; out[3] = 0; return out; }
  const moves = fits.map(({ fit }) => fieldAt(fit, a, b));
  return chosenPlace(layered, regions, a, b, (k) => moves[k], softness, out);
}

// The choice between displacements that are known: `move(k)` is that of fit k at (a, b).
export function chosenPlace(layered, regions, a, b, move, softness, out) {
  const { fits } = layered, own = sidesKey(regions, a, b), at = layered.byKey.get(own) ?? -1;
  const there = (k) => { const [da, db] = move(k); return coverage(marginOf(regions, fits[k].key, a + da, b + db), softness); };
  let k = at, opacity = 1;
  if (layered.rule === "paper") {
    if (at >= 0) opacity = Math.min(1, there(at) / (coverage(marginOf(regions, own, a, b), softness) || 1));
  } else {
    let still = 1; // what of the place belongs to regions without points: they stay where they are
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
