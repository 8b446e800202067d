// Fits separated by cuts, equal to deformnb.rbf.cuts in the plane (Eqs. 7-8), and to deformnb.rbf.slits where cuts
// stop inside the body.

import { MOST_SLITS } from "../generated.ts";
import type { Fit, FitSettings, LayeredFit, Point, Raster, Region, Vector2, Vector4 } from "../types.ts";
import { numberPoints } from "./point_names.ts";
import { RbfError, rbfCheckPoints } from "./rbf.ts";
import { regionOf } from "./regions.ts";
import { fieldAt, fieldOnRaster, stagedFit } from "./rigid_stages.ts";

/** The fits of the points in the regions between the cuts; without cuts one fit of all points. */
export function layeredFit(given: Point[], settings: FitSettings & { previous?: LayeredFit | null } = {}): LayeredFit {
  const points = numberPoints(given);
  const regions = (settings.cuts ?? []).filter((cut) => cut.enabled !== false).map((cut) => regionOf(cut.region));
  const before = new Map(settings.previous?.fits.map(({ key, fit }) => [key, fit]));
  rbfCheckPoints(points);
  checkSlits(regions, settings.cut_rule ?? "source");
  const fitOf: (own: Point[], previous: Fit | null) => Fit = (own, previous) =>
    stagedFit(own, settings.parts, { ...settings, previous });
  const found = !regions.length
    ? [{ key: 0, fit: fitOf(points, before.get(0) ?? null) }]
    : regions.some(({ opening }) => opening)
      ? slitFits(points, regions, before, fitOf)
      : [...groupsOf(points, regions)].map(([key, own]) => ({ key, fit: fitOf(own, before.get(key) ?? null) }));
  const order = regions.map((_, k) => 1 << k);
  const fits = found
    .sort(({ key: p }, { key: q }) => {
      const bit = order.find((b) => (p ^ q) & b);
      return bit ? (p & bit) - (q & bit) : 0;
    })
    .map(({ key, fit }) => ({ key, sides: regions.map((_, k) => Boolean(key & (1 << k))), fit }));
  return {
    fits,
    regions,
    rule: settings.cut_rule ?? "source",
    fit: regions.length ? null : fits[0]!.fit,
    byKey: new Map(fits.map(({ key }, k) => [key, k])),
    notes: [...new Set(fits.flatMap(({ fit }) => fit.notes))],
    count: fits.reduce((sum, { fit }) => sum + fit.count, 0),
    hasRest: regions.length > 0 && fits.length < 2 ** regions.length,
  };
}

/**
 * The active points by their sides of some of the regions, as of sidesKey.
 * @param mask the bits of the regions that count
 */
function groupsOf(points: Point[], regions: Region[], mask: number = -1) {
  const groups: Map<number, Point[]> = new Map();
  for (const p of points) {
    if (p.active === false) continue;
    const key = sidesKey(regions, p.source[0], p.source[1]) & mask,
      group = groups.get(key);
    if (group) group.push(p);
    else groups.set(key, [p]);
  }
  return groups;
}

/** As check_slits in deformnb.rbf.slits. */
function checkSlits(regions: Region[], rule: string) {
  const count = regions.filter(({ opening }) => opening).length;
  if (count > MOST_SLITS) {
    throw new RbfError(
      `at most ${MOST_SLITS} cuts of a step may stop inside the body, got ${count}; let one continue to ` +
        "the border, or put it in a separate step.",
    );
  }
  if (count && rule === "paper") {
    throw new RbfError(
      'the rule "paper" of cuts (Eq. 8) hides what crosses a line, also where that has stopped; use ' +
        'the rule "source", or let the cuts continue to the border.',
    );
  }
}

/** The blended fits of every region between cuts of which some stop, as fits_beside_slits in deformnb.rbf.slits. */
function slitFits(
  points: Point[],
  regions: Region[],
  before: Map<number, Fit>,
  fitOf: (own: Point[], previous: Fit | null) => Fit,
) {
  const stop = regions.flatMap(({ opening }, k) => (opening ? [k] : [])),
    all = 2 ** regions.length - 1;
  const masks = Array.from({ length: 1 << stop.length }, (_, bits) =>
    stop.reduce((mask, k, j) => (bits & (1 << j) ? mask : mask & ~(1 << k)), all),
  );
  const groups = masks.map((mask) => groupsOf(points, regions, mask));
  const known: Map<number, Fit>[] = masks.map(() => new Map());
  const openings = stop.flatMap((k) => regions[k]!.opening ?? []);
  const made: { key: number; fit: Fit }[] = [];
  for (let key = 0; key <= all; key++) {
    const last = before.get(key)?.blend?.fits;
    const fits = masks.map((mask, bits) => {
      const own = groups[bits]!.get(key & mask);
      const fit = known[bits]!.get(key & mask) ?? (own ? fitOf(own, last?.[bits] ?? null) : null);
      if (fit) known[bits]!.set(key & mask, fit);
      return fit;
    });
    const some = fits.filter((fit) => fit !== null),
      main = some[some.length - 1];
    if (!main) continue;
    made.push({
      key,
      fit: {
        ...main,
        base: undefined,
        rigid: undefined,
        stages: undefined,
        forward: undefined,
        blend: { fits, openings },
        count: some.reduce((sum, { count }) => sum + count, 0),
        notes: [...new Set(some.flatMap(({ notes }) => notes))],
      },
    });
  }
  return made;
}

/** The sides of a place as one number: bit k is set inside region k. */
export function sidesKey(regions: Pick<Region, "distance">[], a: number, b: number) {
  let key = 0;
  for (let k = 0; k < regions.length; k++) if (regions[k]!.distance(a, b) < 0) key |= 1 << k;
  return key;
}

/** The same of the cuts of a fit. */
export function regionKey(layered: LayeredFit, a: number, b: number) {
  return sidesKey(layered.regions, a, b);
}

/** The distance of a place from the boundary of the region of these sides; negative outside. */
export function marginOf(regions: Pick<Region, "distance">[], key: number, a: number, b: number) {
  let least = Infinity;
  for (let k = 0; k < regions.length; k++) {
    const d = regions[k]!.distance(a, b),
      into = key & (1 << k) ? -d : d;
    if (into < least) least = into;
  }
  return least;
}

/** The share of a pixel within a region, for an edge of this softness. */
export function coverage(margin: number, softness: number) {
  return Math.max(0, Math.min(1, 0.5 + margin / softness));
}

/** The displacements of each fit at the pixels of a raster, as of fieldOnRaster. */
export function layersOnRaster(layered: LayeredFit, raster: Raster, outs: (Float32Array | null)[] = []) {
  return layered.fits.map(({ fit }, k) => fieldOnRaster(fit, raster, outs[k] ?? null));
}

/** The visible fit at a place: [da, db, opacity, k] of fit k; -1 in a region without points, which does not move. */
export function placeOf(layered: LayeredFit, a: number, b: number, softness: number, out: Vector4 = [0, 0, 1, 0]) {
  const { fits, regions } = layered;
  if (!regions.length) {
    [out[0], out[1]] = fieldAt(fits[0]!.fit, a, b);
    out[2] = 1;
    out[3] = 0;
    return out;
  }
  const moves = fits.map(({ fit }) => fieldAt(fit, a, b));
  return chosenPlace(layered, regions, a, b, (k) => moves[k]!, softness, out);
}

/**
 * The same from displacements that are known.
 * @param move the displacement of fit k at (a, b)
 */
export function chosenPlace(
  layered: LayeredFit,
  regions: Pick<Region, "distance">[],
  a: number,
  b: number,
  move: (k: number) => Vector2,
  softness: number,
  out: Vector4,
) {
  const { fits } = layered,
    own = sidesKey(regions, a, b),
    at = layered.byKey.get(own) ?? -1;
  const there = (k: number) => {
    const [da, db] = move(k);
    return coverage(marginOf(regions, fits[k]!.key, a + da, b + db), softness);
  };
  let k = at,
    opacity = 1;
  if (layered.rule === "paper") {
    if (at >= 0) opacity = Math.min(1, there(at) / (coverage(marginOf(regions, own, a, b), softness) || 1));
  } else {
    let still = 1; // the share of the place in regions without points, which do not move
    if (layered.hasRest) for (const { key } of fits) still -= coverage(marginOf(regions, key, a, b), softness);
    still = layered.hasRest ? Math.max(0, Math.min(1, still)) : 0;
    let best = at < 0 ? still : there(at),
      sum = at < 0 ? still : still + best;
    const isCertain = best >= 0.5;
    for (let j = 0; j < fits.length; j++) {
      if (j === at || (isCertain && sum >= 1)) continue;
      const c = there(j);
      sum += c;
      if (!isCertain && c > best) {
        best = c;
        k = j;
      }
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

const NO_MOVE: Vector2 = [0, 0];
