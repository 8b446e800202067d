// Fits in the forward direction, equal to deformnb.rbf.forward: the targets as a function of the sources,
// x + F(x) = y, and for a place y of the result the place x of the input by Newton's method. A place is certain where
// the residual vanishes to rounding and F does not fold at x.

import { AIM, FOUND, MOST_NEWTON_STEPS, SEEDS, SEEDS_AROUND, SHORTEST_STEP, TRIED } from "../generated.ts";
import type {
  Fit,
  FitSettings,
  Lattice,
  Numbers2,
  Numbers3,
  Numbers6,
  Point,
  Raster,
  RbfFit,
  Vector,
  Vector2,
} from "../types.ts";
import { mapVector } from "./camera.ts";
import { placeBetween } from "./points.ts";
import { RBF_KERNELS, rbfFit, rbfLinearAt, rbfQuadraticAt, rbfSupport } from "./rbf.ts";

const NEAR_STEP = 0.02; // of a pixel: a residual that one step of Newton's method squares

/** Points with sources and targets exchanged. */
export function exchangePoints(points: Point[]) {
  return points.map((p) => ({ ...p, source: p.target, target: p.source }));
}

/** The inverse of the fit from sources to targets; in space with dim 3. */
export function forwardFit(
  points: Point[],
  settings: FitSettings & { previous?: Fit | null } = {},
  dim: number = 2,
): Fit {
  const strength = settings.strength ?? 1,
    support = rbfSupport(exchangePoints(points), settings);
  const dragged =
    strength === 1 ? points : points.map((p) => ({ ...p, target: placeBetween(p.source, p.target, strength) }));
  const previous = settings.previous?.forward ?? null;
  const forward = rbfFit(exchangePoints(dragged), { ...settings, strength: 1, support, previous }, dim);
  return { ...forward, forward };
}

/** Whether F moves nothing. */
function isStill({ count, coefficients, linear, constant, quadratic }: RbfFit) {
  return (
    count === 0 ||
    (coefficients.every((v) => v === 0) &&
      constant.every((v) => v === 0) &&
      !quadratic &&
      linear.every((row) => row.every((v) => v === 0)))
  );
}

/** x + F(x) and its derivative row by row, of a plain fit: `out` gets dim + dim * dim numbers. */
function mapAndSlope(fit: RbfFit, x: ArrayLike<number>, out: Numbers6) {
  const { support: r, origin, centers, coefficients: alpha, count, scales, linear, constant, quadratic } = fit;
  const dim = constant.length,
    p = mapVector(origin, (o, k) => (x[k]! - o) / r),
    { profile, slope } = RBF_KERNELS[fit.kernel]!;
  const m = rbfLinearAt3(fit, p);
  for (let i = 0; i < dim; i++) {
    out[i] = constant[i]! + (quadratic ? rbfQuadraticAt(quadratic[i]!, p) : 0);
    for (let k = 0; k < dim; k++) {
      out[i]! += linear[i]![k]! * p[k]!;
      out[dim + dim * i + k] = m[i]![k]!;
    }
  }
  for (let c = 0, j = 0; c < count; c++, j += dim) {
    const dp = p[0] - centers[j]!,
      dq = p[1] - centers[j + 1]!,
      dr = dim > 2 ? p[2]! - centers[j + 2]! : 0;
    const w = scales ? scales[c]! * scales[c]! : 1,
      s = (dp * dp + dq * dq + dr * dr) * w;
    const phi = profile(s),
      g = 2 * w * slope(s);
    for (let i = 0; i < dim; i++) {
      const a = alpha[j + i]!,
        at = dim + dim * i;
      out[i]! += a * phi;
      out[at]! += a * g * dp;
      out[at + 1]! += a * g * dq;
      if (dim > 2) out[at + 2]! += a * g * dr;
    }
  }
  for (let i = 0; i < dim; i++) {
    out[i]! += x[i]!;
    for (let k = 0; k < dim; k++) out[dim + dim * i + k] = out[dim + dim * i + k]! / r + Number(i === k);
  }
}

/** The derivative of the trend, in the plane or in space. */
function rbfLinearAt3(fit: RbfFit, p: Vector) {
  const { quadratic, linear } = fit;
  if (!quadratic || p.length === 2) return rbfLinearAt(fit, p[0], p[1]);
  return linear.map((row, i) =>
    row.map((value, k) => value + 2 * quadratic[i]![k]!.reduce((sum, h, l) => sum + h * p[l]!, 0)),
  );
}

/** The determinant of the derivative that mapAndSlope has left, and its adjugate in `out`. */
function adjugateOf(t: Numbers6, dim: number, out: Numbers6) {
  if (dim === 2) {
    out[0] = t[5];
    out[1] = -t[3];
    out[2] = -t[4];
    out[3] = t[2];
    return t[2] * t[5] - t[3] * t[4];
  }
  const a = (i: number, k: number) => t[3 + 3 * (i % 3) + (k % 3)]!;
  for (let i = 0; i < 3; i++) {
    for (let k = 0; k < 3; k++) {
      out[3 * i + k] = a(k + 1, i + 1) * a(k + 2, i + 2) - a(k + 1, i + 2) * a(k + 2, i + 1);
    }
  }
  return a(0, 0) * out[0] + a(0, 1) * out[3] + a(0, 2) * out[6]!;
}

/** Values computed once for a fit */
export interface Inverse {
  dim: number;
  /** Of the points */
  size: number;
  /** Of the targets */
  middle: number[];
  /** Of the determinant at most points */
  sign: number;
  sources: number[][];
  targets: number[][];
  /** The inverse of the derivative at each source */
  slopes: number[][];
  isStill: boolean;
  lattice: { nodes: Float64Array; ends: Float64Array } | null;
}

const inverses: WeakMap<RbfFit, Inverse> = new WeakMap();

const T = new Float64Array(12) as Numbers6,
  ADJUGATE = new Float64Array(9) as Numbers6;

function inverseOf(fit: RbfFit): Inverse {
  const known = inverses.get(fit);
  if (known) return known;
  const dim = fit.constant.length,
    { origin, support, centers, count } = fit;
  const sources = Array.from({ length: count }, (_, c) => origin.map((o, k) => o + support * centers[dim * c + k]!));
  const signs: number[] = [];
  const targets = [] as number[][],
    slopes = [] as number[][];
  for (const x of sources) {
    mapAndSlope(fit, x, T);
    const det = adjugateOf(T, dim, ADJUGATE);
    let columns = 1; // the product of the lengths of the columns
    for (let k = 0; k < dim; k++) columns *= Math.hypot(...origin.map((_, i) => T[dim + dim * i + k]!));
    const isFlat = !(Math.abs(det) >= 1e-6 * columns);
    targets.push(Array.from(T.subarray(0, dim)));
    signs.push(Math.sign(det));
    slopes.push(
      Array.from({ length: dim * dim }, (_, n) => (isFlat ? Number(n % (dim + 1) === 0) : ADJUGATE[n]! / det)),
    );
  }
  const all = [...sources, ...targets],
    sides = origin.map((_, k) => sideOf(all, k));
  const made = {
    dim,
    sources,
    targets,
    slopes,
    isStill: isStill(fit),
    lattice: null,
    size: Math.hypot(...sides) || support,
    sign: Math.sign(signs.reduce((sum, s) => sum + s, 0)) || 1,
    middle: origin.map((_, k) => targets.reduce((sum, y) => sum + y[k]!, 0) / Math.max(1, count)),
  };
  inverses.set(fit, made);
  return made;
}

function sideOf(places: number[][], k: number) {
  let low = Infinity,
    high = -Infinity;
  for (const place of places) {
    low = Math.min(low, place[k]!);
    high = Math.max(high, place[k]!);
  }
  return places.length ? high - low : 0;
}

/** Places of the input around the sources, and their images. */
function latticeOf(fit: RbfFit, inverse: Inverse) {
  if (inverse.lattice) return inverse.lattice;
  const { dim, sources, size } = inverse,
    n = SEEDS[dim as 2 | 3],
    sides = sources[0]!.map((_, k) => sideOf(sources, k));
  const reach = SEEDS_AROUND * Math.max(Math.hypot(...sides), 1e-3 * size),
    total = n ** dim;
  const low = sides.map((_, k) => sources.reduce((least, x) => Math.min(least, x[k]!), Infinity) - reach);
  const nodes = new Float64Array(dim * total),
    ends = new Float64Array(dim * total),
    x = new Float64Array(dim);
  for (let i = 0; i < total; i++) {
    for (let k = 0; k < dim; k++) {
      x[k] = low[k]! + ((sides[k]! + 2 * reach) * (Math.floor(i / n ** (dim - 1 - k)) % n)) / (n - 1);
    }
    nodes.set(x, dim * i);
    mapAndSlope(fit, x, T);
    ends.set(T.subarray(0, dim), dim * i);
  }
  inverse.lattice = { nodes, ends };
  return inverse.lattice;
}

const TRIAL = new Float64Array(3),
  STEP = new Float64Array(3);

/** Damped Newton steps from x, in place; the residual that is left. `t` gets what mapAndSlope leaves at x. */
function newton(fit: RbfFit, y: ArrayLike<number>, x: Float64Array, tolerance: number, t: Numbers6) {
  const dim = y.length;
  let error = residual(fit, y, x, t);
  for (let turn = 0; turn < MOST_NEWTON_STEPS && error > tolerance; turn++) {
    const det = adjugateOf(t, dim, ADJUGATE);
    if (!(Math.abs(det) > 0)) break;
    for (let i = 0; i < dim; i++) {
      STEP[i] = 0;
      for (let k = 0; k < dim; k++) STEP[i]! += (ADJUGATE[dim * i + k]! * (y[k]! - t[k]!)) / det;
    }
    let share = 1,
      better = Infinity;
    for (; share > SHORTEST_STEP; share /= 2) {
      for (let i = 0; i < dim; i++) TRIAL[i] = x[i]! + share * STEP[i]!;
      better = residual(fit, y, TRIAL, t);
      if (better < error) break;
    }
    if (!(better < error)) {
      residual(fit, y, x, t);
      break;
    }
    for (let i = 0; i < dim; i++) x[i] = TRIAL[i]!;
    error = better;
  }
  return error;
}

function residual(fit: RbfFit, y: ArrayLike<number>, x: Float64Array, t: Numbers6) {
  mapAndSlope(fit, x, t);
  const error = distance(y, t);
  return Number.isFinite(error) ? error : Infinity;
}

function distance(p: ArrayLike<number>, q: ArrayLike<number>) {
  return p.length === 2
    ? Math.hypot(p[0]! - q[0]!, p[1]! - q[1]!)
    : Math.hypot(p[0]! - q[0]!, p[1]! - q[1]!, p[2]! - q[2]!);
}

function isCertain({ dim, size, middle, sign }: Inverse, y: ArrayLike<number>, error: number, t: Numbers6) {
  return error <= FOUND * Math.max(size, distance(y, middle)) && adjugateOf(t, dim, ADJUGATE) * sign > 0;
}

const BEST = new Float64Array(3),
  BEST_T = new Float64Array(12) as Numbers6,
  AT = new Float64Array(3);

/**
 * The place x of the input that maps to y, in `x`, and what mapAndSlope leaves there, in `t`; whether it is certain.
 * Where it is not, x is the best place known.
 */
export function placeBefore(fit: RbfFit, y: ArrayLike<number>, x: Float64Array, t: Numbers6) {
  const inverse = inverseOf(fit),
    { dim } = inverse;
  if (inverse.isStill) {
    for (let k = 0; k < dim; k++) x[k] = y[k]!;
    mapAndSlope(fit, x, t);
    return true;
  }
  let least = Infinity;
  for (const start of starts(fit, inverse, y)) {
    AT.set(start);
    const at = AT.subarray(0, dim),
      error = newton(fit, y, at, AIM * inverse.size, t);
    if (isCertain(inverse, y, error, t)) {
      x.set(at);
      return true;
    }
    if (error < least) {
      least = error;
      BEST.set(at);
      BEST_T.set(t);
    }
  }
  for (let k = 0; k < dim; k++) x[k] = Number.isFinite(least) ? BEST[k]! : y[k]!;
  t.set(BEST_T.subarray(0, t.length));
  return false;
}

/**
 * Places from which the source of y is sought: by the nearest control point, y - F(y), y, and nodes of a lattice.
 */
function* starts(fit: RbfFit, inverse: Inverse, y: ArrayLike<number>) {
  const { dim, sources, targets, slopes } = inverse;
  let near = 0;
  targets.forEach((target, c) => {
    if (distance(target, y) < distance(targets[near]!, y)) near = c;
  });
  yield sources[near]!.map(
    (value, i) =>
      value + sources[near]!.reduce((sum, _, k) => sum + slopes[near]![dim * i + k]! * (y[k]! - targets[near]![k]!), 0),
  );
  mapAndSlope(fit, y, T);
  yield sources[near]!.map((_, k) => 2 * y[k]! - T[k]!);
  yield Array.from(y);
  const { nodes, ends } = latticeOf(fit, inverse),
    far = new Float64Array(TRIED).fill(Infinity);
  const best = new Int32Array(TRIED);
  for (let i = 0; i < ends.length; i += dim) {
    const d = distance(y, ends.subarray(i, i + dim));
    for (let k = 0; k < TRIED; k++) {
      if (!(d < far[k]!)) continue;
      far.copyWithin(k + 1, k, TRIED - 1);
      best.copyWithin(k + 1, k, TRIED - 1);
      far[k] = d;
      best[k] = i;
      break;
    }
  }
  for (const i of best) yield Array.from(nodes.subarray(i, i + dim));
}

/** The targets of the points behind a fit, in its relative coordinates. */
export function forwardTargets(fit: RbfFit) {
  const { origin, support } = fit;
  return Float64Array.from(inverseOf(fit).targets.flatMap((y) => y.map((value, k) => (value - origin[k]!) / support)));
}

const X = new Float64Array(3) as Numbers3,
  SLOPE = new Float64Array(12) as Numbers6,
  PLACE = new Float64Array(2) as Numbers2;

/** The backward displacement at a place of the picture. */
export function forwardAt(fit: RbfFit, a: number, b: number): Vector2 {
  PLACE[0] = a;
  PLACE[1] = b;
  placeBefore(fit, PLACE, X, SLOPE);
  return [X[0] - a, X[1] - b];
}

/** y + D(y) and its Jacobian, as of fieldWithSlope; where nothing is certain the determinant is 0. */
export function forwardWithSlope(fit: RbfFit, a: number, b: number, out: Numbers6) {
  PLACE[0] = a;
  PLACE[1] = b;
  const isFound = placeBefore(fit, PLACE, X, SLOPE),
    det = adjugateOf(SLOPE, 2, ADJUGATE);
  out[0] = X[0];
  out[1] = X[1];
  for (let k = 0; k < 4; k++) out[2 + k] = isFound ? ADJUGATE[k]! / det : 0;
  return out;
}

/** The image of the place (a, b) of the input, in `at`, exactly; whether the result shows it there. */
export function forwardEnd(fit: RbfFit, a: number, b: number, at: Numbers2) {
  mapAndSlope(fit, [a, b], T);
  at[0] = T[0];
  at[1] = T[1];
  const isFound = placeBefore(fit, at, X, SLOPE);
  return isFound && Math.hypot(X[0] - a, X[1] - b) <= FOUND ** 0.5 * inverseOf(fit).size;
}

/**
 * Displacements along rows of places: each place is found from the one before it and the slope there.
 * @param count places of a row
 * @param step along the first axis
 * @param first place of a row
 */
function alongRows(
  fit: RbfFit,
  count: number,
  step: number,
  first: (row: number) => Vector,
  rows: number,
  out: Float32Array,
) {
  const inverse = inverseOf(fit),
    { dim } = inverse;
  if (inverse.isStill) {
    out.fill(0, 0, dim * count * rows);
    return;
  }
  const x = new Float64Array(dim),
    t = new Float64Array(dim + dim * dim) as Numbers6,
    near = NEAR_STEP * step;
  for (let row = 0, n = 0; row < rows; row++) {
    const y = first(row),
      start = y[0];
    let isGood = false;
    for (let j = 0; j < count; j++, n += dim) {
      y[0] = start + j * step;
      if (isGood) isGood = tryStep(fit, inverse, y, x, t, near, step);
      if (!isGood) isGood = placeBefore(fit, y, x, t);
      for (let k = 0; k < dim; k++) out[n + k] = x[k]! - y[k]!;
    }
  }
}

/**
 * From the source x of the place before to that of y: along the slope, and one step of Newton's method. False where
 * that is not enough.
 * @param t as mapAndSlope has left it
 */
function tryStep(
  fit: RbfFit,
  { dim, sign }: Inverse,
  y: ArrayLike<number>,
  x: Float64Array,
  t: Numbers6,
  near: number,
  step: number,
) {
  let det = adjugateOf(t, dim, ADJUGATE);
  for (let i = 0; i < dim; i++) x[i]! += (ADJUGATE[dim * i]! * step) / det;
  if (!(residual(fit, y, x, t) <= near)) return false;
  det = adjugateOf(t, dim, ADJUGATE);
  if (!(det * sign > 0)) return false;
  for (let i = 0; i < dim; i++) {
    for (let k = 0; k < dim; k++) x[i]! += (ADJUGATE[dim * i + k]! * (y[k]! - t[k]!)) / det;
  }
  return true;
}

/** Displacements at the pixels of a raster, as of rbfOnRaster. */
export function forwardOnRaster(
  fit: RbfFit,
  { shape: [nv, nu], spacing: [du, dv], origin: [a, b] }: Raster,
  map: Float32Array,
) {
  alongRows(fit, nu, du, (row) => [a, b + row * dv], nv, map);
  return map;
}

/** Displacements at the nodes of a lattice in space, as of rbfOnLattice. */
export function forwardOnLattice(
  fit: RbfFit,
  { shape: [nx, ny, nz], spacing: [dx, dy, dz], origin: [x, y, z] }: Lattice,
) {
  const map = new Float32Array(nx * ny * nz * 3);
  alongRows(fit, nx, dx, (row) => [x, y + (row % ny) * dy, z + Math.floor(row / ny) * dz], ny * nz, map);
  return map;
}
