// A fit as an editor shows it: its slope, its inverse, and the deformed grid with the strains at its nodes.

import type {
  Fit,
  LayeredFit,
  Numbers2,
  Numbers3,
  Numbers6,
  RbfFit,
  ReadyPart,
  TipBlend,
  Vector,
  Vector2,
  Vector4,
} from "../types.ts";
import { marginOf, regionKey } from "./cuts.ts";
import { forwardEnd, forwardWithSlope } from "./forward_fit.ts";
import { RBF_KERNELS, rbfLinearAt, rbfQuadraticAt } from "./rbf.ts";
import { fieldAt, partsAt } from "./rigid_stages.ts";
import { clampedWithSlope, sampledWithSlope } from "./sampled_fit.ts";

export const NO_CUTS: LayeredFit = {
  fits: [],
  regions: [],
  rule: "source",
  fit: null,
  byKey: new Map(),
  notes: [],
  count: 0,
  hasRest: false,
};

const newWork = () => new Float64Array(6) as Numbers6;
const PARTS_AROUND = [newWork(), newWork(), newWork(), newWork(), newWork()] as const; // at a place and next to it

/** y + D(y) and its Jacobian at (a, b) of any fit: [a', b', j00, j01, j10, j11]; of rigid parts by differences. */
export function fieldWithSlope(fit: Fit, a: number, b: number, out: Numbers6): Numbers6 {
  if (fit.sampled?.isClamped) return clampedWithSlope(fit.sampled, a, b, out);
  if (fit.sampled) return sampledWithSlope(fit.sampled, a, b, out) ? out : fieldWithSlope(fit.sampled.fit, a, b, out);
  if (fit.blend) return blendWithSlope(fit.blend, a, b, out);
  if (fit.stages) return stagedWithSlope(fit.stages, a, b, out);
  if (fit.forward) return forwardWithSlope(fit.forward, a, b, out);
  const { rigid, base } = fit;
  if (!rigid || !base) return mapWithSlope(fit, a, b, out);
  return withParts(rigid, base, a, b, mapWithSlope(base, a, b, out));
}

/** The same of rigid parts in a smooth map. `out`: in, those of the map alone. */
export function withParts(rigid: ReadyPart[], base: RbfFit, a: number, b: number, out: Numbers6) {
  const h = 1e-5 * base.support,
    [at, east, west, south, north] = PARTS_AROUND,
    d = 1 / (2 * h);
  partsAt(rigid, a, b, at);
  partsAt(rigid, a + h, b, east);
  partsAt(rigid, a - h, b, west);
  partsAt(rigid, a, b + h, south);
  partsAt(rigid, a, b - h, north);
  const w = at[2],
    u = out[0] - a,
    v = out[1] - b,
    wa = d * (east[2] - west[2]),
    wb = d * (south[2] - north[2]);
  out[0] = a + at[0] + w * u;
  out[1] = b + at[1] + w * v;
  out[2] = 1 + d * (east[0] - west[0]) + w * (out[2] - 1) + wa * u;
  out[3] = d * (south[0] - north[0]) + w * out[3] + wb * u;
  out[4] = d * (east[1] - west[1]) + w * out[4] + wa * v;
  out[5] = 1 + d * (south[1] - north[1]) + w * (out[5] - 1) + wb * v;
  return out;
}

const STAGE_WORK = newWork();

/** The same of stages, by the chain rule: the last comes first. */
function stagedWithSlope(stages: Fit[], a: number, b: number, out: Numbers6) {
  const t = STAGE_WORK;
  let m00 = 1,
    m01 = 0,
    m10 = 0,
    m11 = 1,
    x = a,
    y = b;
  for (let k = stages.length - 1; k >= 0; k--) {
    fieldWithSlope(stages[k]!, x, y, t);
    x = t[0];
    y = t[1];
    [m00, m10] = [t[2] * m00 + t[3] * m10, t[4] * m00 + t[5] * m10];
    [m01, m11] = [t[2] * m01 + t[3] * m11, t[4] * m01 + t[5] * m11];
  }
  out.set([x, y, m00, m01, m10, m11]);
  return out;
}

const TIP_WORK = Array.from({ length: 8 }, newWork) as [Numbers6, ...Numbers6[]],
  TIP_OPENING = new Float64Array(3) as Numbers3;

/** The same of fits blended at the tips of cuts, by the product rule. */
function blendWithSlope({ fits, openings }: TipBlend, a: number, b: number, out: Numbers6) {
  fits.forEach((fit, k) => {
    if (fit) fieldWithSlope(fit, a, b, TIP_WORK[k]!);
    else TIP_WORK[k]!.set([a, b, 1, 0, 0, 1]);
  });
  const { 0: x, 1: y, 2: j00, 3: j01, 4: j10, 5: j11 } = TIP_WORK[0];
  for (let k = openings.length - 1; k >= 0; k--) {
    const { 0: w, 1: wx, 2: wy } = openings[k]!(x, y, TIP_OPENING),
      half = 1 << k;
    const wa = wx * j00 + wy * j10,
      wb = wx * j01 + wy * j11;
    for (let j = 0; j < half; j++) {
      const p = TIP_WORK[j]!,
        q = TIP_WORK[j + half]!,
        u = q[0] - p[0],
        v = q[1] - p[1];
      for (let i = 0; i < 6; i++) p[i]! += w * (q[i]! - p[i]!);
      p[2] += u * wa;
      p[3] += u * wb;
      p[4] += v * wa;
      p[5] += v * wb;
    }
  }
  out.set(TIP_WORK[0]);
  return out;
}

/** The same of a plain fit, in one pass over the centres. */
function mapWithSlope(fit: RbfFit, a: number, b: number, out: Numbers6) {
  const r = fit.support,
    p = (a - fit.origin[0]) / r,
    q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const { profile, slope, compact } = RBF_KERNELS[fit.kernel]!;
  let u = linear[0][0] * p + linear[0][1] * q + constant[0],
    v = linear[1][0] * p + linear[1][1] * q + constant[1];
  let [[j00, j01], [j10, j11]] = rbfLinearAt(fit, p, q);
  if (fit.quadratic) {
    u += rbfQuadraticAt(fit.quadratic[0], [p, q]);
    v += rbfQuadraticAt(fit.quadratic[1], [p, q]);
  }
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      w = scales ? scales[k]! * scales[k]! : 1;
    const s = (dp * dp + dq * dq) * w;
    if (compact && s >= 1) continue;
    const phi = profile(s),
      g = 2 * w * slope(s);
    u += alpha[j]! * phi;
    v += alpha[j + 1]! * phi;
    j00 += alpha[j]! * g * dp;
    j01 += alpha[j]! * g * dq;
    j10 += alpha[j + 1]! * g * dp;
    j11 += alpha[j + 1]! * g * dq;
  }
  out[0] = a + u;
  out[1] = b + v;
  out[2] = 1 + j00 / r;
  out[3] = j01 / r;
  out[4] = j10 / r;
  out[5] = 1 + j11 / r;
  return out;
}

/**
 * The place where the feature at (a, b) of the input appears: y with y + D(y) = (a, b), by damped Newton steps; in
 * stages, where these do not converge, one after the other. Returns false where none was found; a fold may have no such
 * place.
 * @param at the start, then y
 * @param work gets the last result of fieldWithSlope
 */
export function mapInverse(fit: Fit, a: number, b: number, at: Numbers2, tolerance: number, work?: Numbers6) {
  if (fit.forward && !fit.sampled && !fit.blend && !fit.stages) {
    const isFound = forwardEnd(fit.forward, a, b, at);
    if (isFound && work) forwardWithSlope(fit.forward, at[0], at[1], work);
    return isFound;
  }
  if (newtonInverse(fit, a, b, at, tolerance, work)) return true;
  if (!fit.stages || fit.sampled) return false;
  at[0] = a;
  at[1] = b;
  for (const stage of fit.stages) if (!newtonInverse(stage, at[0], at[1], at, 0.1 * tolerance)) return false;
  return newtonInverse(fit, a, b, at, tolerance, work);
}

function newtonInverse(fit: Fit, a: number, b: number, at: Numbers2, tolerance: number, work?: Numbers6) {
  const t = work ?? newWork();
  fieldWithSlope(fit, at[0], at[1], t);
  let error = Math.hypot(t[0] - a, t[1] - b);
  for (let turn = 0; turn < 12 && error > tolerance; turn++) {
    const det = t[2] * t[5] - t[3] * t[4],
      ea = a - t[0],
      eb = b - t[1];
    if (!(Math.abs(det) > 1e-9)) return false;
    const sa = (t[5] * ea - t[3] * eb) / det,
      sb = (t[2] * eb - t[4] * ea) / det;
    const a0 = at[0],
      b0 = at[1];
    let share = 1,
      better = Infinity;
    for (let halvings = 0; halvings < 6; halvings++, share /= 2) {
      fieldWithSlope(fit, a0 + share * sa, b0 + share * sb, t);
      better = Math.hypot(t[0] - a, t[1] - b);
      if (better < error) break;
    }
    if (!(better < error)) return false;
    at[0] = a0 + share * sa;
    at[1] = b0 + share * sb;
    error = better;
  }
  return error <= tolerance;
}

/**
 * The lines of a grid of square cells over a box.
 * @param box [a0, a1, b0, b1]
 * @param cells along its longer side
 */
function gridLines(box: Vector4, cells: number) {
  const [a0, a1, b0, b1] = box,
    size = Math.max(a1 - a0, b1 - b0) / cells;
  const across = Math.max(1, Math.round((a1 - a0) / size)),
    down = Math.max(1, Math.round((b1 - b0) / size));
  const lines: { from: Vector2; to: Vector2; pieces: number; isEdge: boolean }[] = [];
  for (let k = 0; k <= across; k++) {
    const a = a0 + ((a1 - a0) * k) / across;
    lines.push({ from: [a, b0], to: [a, b1], pieces: down, isEdge: k === 0 || k === across });
  }
  for (let k = 0; k <= down; k++) {
    const b = b0 + ((b1 - b0) * k) / down;
    lines.push({ from: [a0, b], to: [a1, b], pieces: across, isEdge: k === 0 || k === down });
  }
  return lines;
}

/** Move a place and its image, by the last result of fieldWithSlope. */
export function follow(at: Numbers2, da: number, db: number, { 2: j00, 3: j01, 4: j10, 5: j11 }: Numbers6) {
  const det = j00 * j11 - j01 * j10,
    isFlat = !(Math.abs(det) > 1e-3);
  at[0] += isFlat ? da : (j11 * da - j01 * db) / det;
  at[1] += isFlat ? db : (j00 * db - j10 * da) / det;
}

/**
 * The grid on the deformed picture: each line as runs of places, broken where the map folds and at cuts.
 * @param parts pieces of a line per cell
 */
export function deformedGrid(layered: LayeredFit, box: Vector4, cells: number, parts: number, tolerance: number) {
  const work = newWork();
  return gridLines(box, cells).map(({ from, to, pieces, isEdge }) => {
    const n = pieces * parts;
    const runs: number[][] = [];
    for (const { first, last, k } of piecesOfLine(layered, from, to, n)) {
      const count = Math.max(1, Math.ceil((last - first) * n - 1e-9));
      traceLine(
        layered,
        k,
        (j) => {
          const t = first + ((last - first) * j) / count;
          return [from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t];
        },
        count,
        tolerance,
        work,
        runs,
      );
    }
    return { runs, isEdge };
  });
}

/**
 * The segments of a straight line in one region each, as shares of it, with the number of the region's fit.
 */
function piecesOfLine(layered: LayeredFit, from: Vector2, to: Vector2, n: number) {
  if (!layered.regions.length) return [{ first: 0, last: 1, k: layered.fits.length ? 0 : -1 }];
  const keyAt: (t: number) => number = (t) =>
    regionKey(layered, from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t);
  const found: { first: number; last: number; k: number }[] = [];
  let first = 0,
    key = keyAt(0);
  const end = (last: number) => {
    found.push({ first, last, k: layered.byKey.get(key) ?? -1 });
  };
  for (let i = 1; i <= n; i++) {
    const next = keyAt(i / n);
    if (next === key) continue;
    let low = (i - 1) / n,
      high = i / n;
    for (let turn = 0; turn < 14; turn++) {
      const middle = (low + high) / 2;
      if (keyAt(middle) === key) low = middle;
      else high = middle;
    }
    end(low);
    first = high;
    key = next;
  }
  end(1);
  return found;
}

/**
 * Trace a line through fit k (-1: tissue at rest) and add its runs. Each place is found from the one before it and
 * the slope there, so that Newton's method has a step to do at most.
 * @param place of the line, j from 0 to count
 */
function traceLine(
  layered: LayeredFit,
  k: number,
  place: (j: number) => Vector2,
  count: number,
  tolerance: number,
  work: Numbers6,
  runs: number[][],
) {
  const fit = k < 0 ? null : layered.fits[k]!.fit,
    at = new Float64Array(2) as Numbers2,
    hasCuts = layered.regions.length > 0;
  let run: number[] | null = null;
  let before = place(0);
  const find = (x: number, y: number) => {
    if (!fit) {
      at[0] = x;
      at[1] = y;
      return true;
    }
    if (run) follow(at, x - before[0], y - before[1], work);
    else startFrom(fit, x, y, at);
    if (mapInverse(fit, x, y, at, tolerance, work)) return true;
    at[0] = x;
    at[1] = y;
    return mapInverse(fit, x, y, at, tolerance, work);
  };
  const begin = (places: number[]) => {
    runs.push(places);
    return places;
  };
  for (let j = 0; j <= count; j++) {
    const [x, y] = place(j);
    const isSeen = find(x, y) && (!hasCuts || isVisibleFrom(layered, k, at[0], at[1]));
    // Where other tissue begins to cover the line, it is traced to that place.
    if (hasCuts && j > 0 && isSeen !== (run !== null) && fit) {
      let low = j - 1,
        high = j;
      let edge: number[] = []; // the last visible place
      const kept = run,
        { 0: a, 1: b } = at;
      run = null;
      for (let turn = 0; turn < 6; turn++) {
        const middle = (low + high) / 2,
          [p, q] = place(middle);
        const isGood = find(p, q) && isVisibleFrom(layered, k, at[0], at[1]);
        if (isGood) edge = [at[0], at[1]];
        if (isGood === isSeen) high = middle;
        else low = middle;
      }
      if (!isSeen) kept?.push(...edge);
      else {
        run = begin(edge);
        at.set([a, b]);
        fieldWithSlope(fit, a, b, work);
      }
    }
    if (isSeen) {
      run ??= begin([]);
      run.push(at[0], at[1]);
    } else run = null;
    before = [x, y];
  }
}

/** Whether a place of the result shows the tissue of fit k (-1: tissue at rest). */
function isVisibleFrom(layered: LayeredFit, k: number, a: number, b: number) {
  const own = regionKey(layered, a, b),
    at = layered.byKey.get(own) ?? -1;
  if (at === k || layered.rule === "paper") return at === k;
  if (at < 0) return true; // tissue at rest is covered by moving tissue
  const [da, db] = fieldAt(layered.fits[at]!.fit, a, b);
  return marginOf(layered.regions, own, a + da, b + db) < 0;
}

// ---- the nodes of the grid on the deformed picture, and the strains there ------------------------------------------

export const LONGEST_ARM = 0.9; // of a cell, tip to tip of a cross

/** The cells of the grid that gridLines draws: [across, down]. */
export function gridShape([a0, a1, b0, b1]: Vector4, cells: number): Vector2 {
  const size = Math.max(a1 - a0, b1 - b0) / cells;
  return [Math.max(1, Math.round((a1 - a0) / size)), Math.max(1, Math.round((b1 - b0) / size))];
}

/**
 * The nodes of the grid row by row, as numbers a, b, a, b, ...; the target of an invisible node is meaningless.
 */
export function gridPlaces(layered: LayeredFit | null, box: Vector4, cells: number, tolerance: number) {
  const [a0, a1, b0, b1] = box,
    [across, down] = gridShape(box, cells),
    columns = across + 1,
    rows = down + 1;
  const count = columns * rows,
    source = new Float64Array(2 * count),
    target = new Float64Array(2 * count);
  const isSeen = new Uint8Array(count),
    work = newWork(),
    at = new Float64Array(2) as Numbers2;
  const { regions } = layered ?? NO_CUTS;
  /** The fit of the node before, whose slope is in `work` */
  let last: Fit | null = null;
  for (let n = 0; n < count; n++) {
    const x = a0 + ((a1 - a0) * (n % columns)) / across,
      y = b0 + ((b1 - b0) * Math.floor(n / columns)) / down;
    source.set([x, y], 2 * n);
    const k = fitFrom(layered, x, y),
      fit = layered?.fits[k]?.fit ?? null;
    let isFound = true;
    if (!fit) {
      at[0] = x;
      at[1] = y;
    } else {
      if (last === fit && n % columns > 0) follow(at, x - source[2 * n - 2]!, y - source[2 * n - 1]!, work);
      else startFrom(fit, x, y, at);
      isFound = mapInverse(fit, x, y, at, tolerance, work);
      if (!isFound) {
        startFrom(fit, x, y, at);
        isFound = mapInverse(fit, x, y, at, tolerance, work);
      }
      if (!isFound) {
        at[0] = x;
        at[1] = y;
        isFound = mapInverse(fit, x, y, at, tolerance, work);
      }
    }
    last = isFound ? fit : null;
    isSeen[n] = isFound && (!layered || !regions.length || isVisibleFrom(layered, k, at[0], at[1])) ? 1 : 0;
    target.set(at, 2 * n);
  }
  return { columns, rows, source, target, isSeen };
}

/** The number of the fit of the region of a place, -1 for none. */
function fitFrom(layered: LayeredFit | null, x: number, y: number) {
  return layered?.fits.length ? (layered.byKey.get(regionKey(layered, x, y)) ?? -1) : -1;
}

/** The place where the tissue of a place is visible, null where it is not. */
export function findVisiblePlace(layered: LayeredFit | null, [x, y]: Vector, tolerance: number): Vector2 | null {
  const k = fitFrom(layered, x, y),
    at = new Float64Array(2) as Numbers2;
  if (!layered || k < 0) return [x, y];
  const { fit } = layered.fits[k]!;
  startFrom(fit, x, y, at);
  let isFound = mapInverse(fit, x, y, at, tolerance);
  if (!isFound) {
    at[0] = x;
    at[1] = y;
    isFound = mapInverse(fit, x, y, at, tolerance);
  }
  return isFound && (!layered.regions.length || isVisibleFrom(layered, k, at[0], at[1])) ? [at[0], at[1]] : null;
}

/** A first guess of the inverse. */
function startFrom(fit: Fit, x: number, y: number, at: Numbers2) {
  const [da, db] = fieldAt(fit, x, y);
  at[0] = x - da;
  at[1] = y - db;
}

/**
 * Both principal stretches of the tissue at each node (2 is twice as long) and the direction of the first; NaN where
 * the map folds or the node is not visible.
 */
export function strainsAt(
  layered: LayeredFit | null,
  { source, target, isSeen }: { source: Float64Array; target: Float64Array; isSeen: Uint8Array },
) {
  const count = isSeen.length,
    stretch = new Float64Array(2 * count).fill(NaN),
    angle = new Float64Array(count);
  const work = newWork();
  for (let n = 0; n < count; n++) {
    if (!isSeen[n]) continue;
    const k = fitFrom(layered, source[2 * n]!, source[2 * n + 1]!);
    if (!layered || k < 0) {
      stretch.fill(1, 2 * n, 2 * n + 2);
      continue;
    }
    fieldWithSlope(layered.fits[k]!.fit, target[2 * n]!, target[2 * n + 1]!, work);
    const { 2: j00, 3: j01, 4: j10, 5: j11 } = work;
    if (!(j00 * j11 - j01 * j10 > 0)) continue;
    // The map is backward: tissue is stretched by 1 / s where s^2 are the eigenvalues of J^T J.
    const p = j00 * j00 + j10 * j10,
      q = j00 * j01 + j10 * j11,
      r = j01 * j01 + j11 * j11;
    const mean = (p + r) / 2,
      spread = Math.hypot((p - r) / 2, q);
    stretch[2 * n] = 1 / Math.sqrt(Math.max(mean - spread, 1e-12 * mean));
    stretch[2 * n + 1] = 1 / Math.sqrt(mean + spread);
    angle[n] = Math.atan2(2 * q, p - r) / 2 + Math.PI / 2;
  }
  return { stretch, angle };
}

/** A plain factor by which the longest arm is nearly a cell long. */
export function strainGain({ stretch }: { stretch: Float64Array }) {
  const known = [...stretch]
    .filter(Number.isFinite)
    .map((s) => Math.abs(s - 1))
    .sort((p, q) => p - q);
  const most = known.length ? known[Math.floor(0.95 * (known.length - 1))]! : 0;
  return most > 1e-9 ? plainNumber(Math.min(1e4, LONGEST_ARM / most)) : 1;
}

/** The largest of 1, 2, 5, 10, ... up to a positive number. */
export function plainNumber(most: number) {
  const power = 10 ** Math.floor(Math.log10(most));
  return Number((power * ([5, 2].find((step) => step * power <= most * (1 + 1e-9)) ?? 1)).toPrecision(3));
}
