// The fit of control points on a picture or in space, equal to deformnb.rbf.fitting.fit_rbf. All arithmetic is in
// float64, as in the package; a test compares the two for every kernel and trend.

import type { Kernel as KernelName } from "../generated.ts";
import {
  COLLAPSED,
  FAR_BEHIND,
  FLAT,
  KERNEL_FACTS,
  LARGEST_COORDINATE,
  LARGEST_SET,
  LEAST_SPREAD,
  LONGEST_SHARE,
  MOST_GAIN,
  MOST_LEFT_OUT,
  MOST_MISSED,
  NEAREST,
  NEAREST_AND_EQUAL,
  NO_ANGLE,
  RESIDUAL,
  ROUNDING,
  SAME_DISPLACEMENT,
  SAME_DISTANCE,
  SAME_PLACE,
  SOFTNESS,
  STEEP,
  THIN,
  THIN_BEND,
  TINY,
  TREND_FACTS,
} from "../generated.ts";
import type {
  FitSettings,
  KernelTable,
  Lattice,
  Matrix,
  Matrix2,
  Point,
  Raster,
  RbfFit,
  Vector,
  Vector2,
  Vector3,
} from "../types.ts";
import { difference, mapVector } from "./camera.ts";
import { kernelMatrix } from "./kernel_matrix.ts";
import { kernelOfTable } from "./kernel_table.ts";
import { labelOf, numberPoints } from "./point_names.ts";
import { placeBetween } from "./points.ts";

/**
 * Share: of the points' diameter that the usual support is; gaps: the longest one next to points in a row, in gaps;
 * profile(s) and slope(s) = d profile / d s of the squared relative distance s, as in deformnb.rbf.kernels. The directions that the points determine of a linear map, as in deformnb.rbf.trends.Span. For the trend "quadratic" quadrics are the combinations of products of two coordinates that they determine, and bend is the penalty of the rest.
 */
export type Kernel = {
  title: string;
  order: number;
  compact: boolean;
  share: number;
  gaps: number;
  profile: (s: number) => number;
  slope: (s: number) => number;
};
/** A control point with its weight, its target x and its displacement d. */
export type Span = { basis: number[][]; ridge: Matrix | null; quadrics?: number[][]; bend?: Matrix };
/** Points prepared for a solve. */
export type Place = { point: Point; w: number; x: Vector; d: Vector };
export type Ready = Span & {
  n: number;
  merged: Place[];
  origin: Vector;
  radius: number;
  trend: string;
  notes: string[];
  ids: number[];
};

// ---- linear algebra: deformnb.rbf.interpolant.solve and deformnb.rbf.trends, dense ---------------------------------
// Matrices of n rows and m columns are Float64Array of n * m, row by row; those of dim x dim are nested lists.

/** A matrix by its entries. */
function rbfMatrix(dim: number, entry: (i: number, j: number) => number) {
  return Array.from({ length: dim }, (_, i) => Array.from({ length: dim }, (__, j) => entry(i, j))) as Matrix;
}

function rbfEye(dim: number) {
  return rbfMatrix(dim, (i, j) => Number(i === j));
}

function rbfDot(p: number[], q: number[]) {
  return p.reduce((sum, value, k) => sum + value * q[k]!, 0);
}

function rbfTimes(a: number[][], b: number[][]) {
  return rbfMatrix(a.length, (i, j) => a[i]!.reduce((sum, value, k) => sum + value * b[k]![j]!, 0));
}

/** The matrix of the values of a function of each entry. */
function mapMatrix(m: number[][], entry: (value: number, i: number, j: number) => number) {
  return m.map((row, i) => row.map((value, j) => entry(value, i, j))) as Matrix;
}

function rbfTimesNumber(m: number[][], factor: number) {
  return mapMatrix(m, (value) => value * factor);
}

function rbfPlus(m: number[][], n: number[][]) {
  return mapMatrix(m, (value, i, j) => value + n[i]![j]!);
}

function rbfTrace(m: number[][]) {
  return m.reduce((sum, row, k) => sum + row[k]!, 0);
}

function rbfCross(p: number[], q: number[]): Vector3 {
  const [a, b, c] = p as Vector3,
    [d, e, f] = q as Vector3;
  return [b * f - c * e, c * d - a * f, a * e - b * d];
}

/** The sum of the outer products of images and directions. */
function rbfOuter(images: number[][], basis: number[][], dim = basis[0]!.length) {
  return rbfMatrix(dim, (i, j) => images.reduce((sum, image, k) => sum + image[i]! * basis[k]![j]!, 0));
}

/**
 * Alpha (n x dim), A (dim x dim), t (dim) and the residual of relative targets x and displacements d (both n x dim).
 * @param turn the rotation where the points determine none
 * @param isSkew the matrix is not symmetric: points have their own support radii
 */
function rbfSolve(
  matrix: ReturnType<typeof kernelMatrix>,
  x: Float64Array,
  d: Float64Array,
  span: Span,
  turn: Matrix,
  kernel: string,
  trend: string,
  isSkew: boolean,
) {
  const { n, dim, phi } = matrix;
  const { order } = RBF_KERNELS[kernel]!,
    whole = d,
    isBent = trend === "quadratic";
  const q = isBent ? rbfProducts(x, dim) : new Float64Array(0),
    width = q.length / n;
  let bent: number[][] | null = null;
  if (isBent && order < 3) {
    bent = rbfQuadraticPart(phi, x, d, q, span, isSkew);
    d = rbfWithout(d, q, bent);
    trend = "affine";
  }
  let solved: { alpha: Float64Array; linear: number[][]; constant: number[]; bent?: number[][] | null };
  if (isSkew) solved = rbfLeastSquares(phi, x, d, span, turn, trend);
  else if (order === 3) {
    solved = rbfBorderedTrend(phi, x, d, span.basis, dim, q, span.quadrics ?? []);
    bent = solved.bent ?? null;
  } else if (order === 2) solved = rbfBorderedTrend(phi, x, d, span.basis, dim);
  else if (trend === "none") {
    solved = { alpha: matrix.solve(d, dim), linear: rbfMatrix(dim, () => 0), constant: new Array<number>(dim).fill(0) };
  } else solved = rbfLeastEnergy(matrix, x, d, span, turn, kernel, trend);
  const { alpha, linear, constant } = solved,
    miss = new Float64Array(dim * n);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < dim; k++) {
      let sum = constant[k]! - whole[dim * i + k]!;
      for (let j = 0; j < dim; j++) sum += x[dim * i + j]! * linear[k]![j]!;
      if (bent) for (let j = 0; j < width; j++) sum += q[width * i + j]! * bent[j]![k]!;
      for (let j = 0; j < n; j++) sum += phi[i * n + j]! * alpha[dim * j + k]!;
      miss[dim * i + k] = sum;
    }
  }
  return { ...solved, miss, quadratic: bent && rbfQuadraticForms(bent, dim) };
}

// ---- the quadratic trend: products of two coordinates: squares, then mixed ones times sqrt(2) -----------------------

/** The pairs of coordinates of the products. */
function rbfPairs(dim: number): Vector2[] {
  const all = Array.from({ length: dim }, (_, a) => a);
  return [...all.map((a): Vector2 => [a, a]), ...all.flatMap((a) => all.slice(0, a).map((b): Vector2 => [a, b]))];
}

/** @param x n x dim; returns the products of each row */
function rbfProducts(x: Float64Array, dim: number) {
  const pairs = rbfPairs(dim),
    n = x.length / dim,
    out = new Float64Array(n * pairs.length);
  for (let i = 0, k = 0; i < x.length; i += dim) {
    for (const [a, b] of pairs) out[k++] = (a === b ? 1 : Math.SQRT2) * x[i + a]! * x[i + b]!;
  }
  return out;
}

/**
 * The symmetric matrices of all components.
 * @param c products x dim
 */
function rbfQuadraticForms(c: number[][], dim: number) {
  const pairs = rbfPairs(dim);
  return Array.from({ length: dim }, (_, m) => {
    const form = rbfMatrix(dim, () => 0);
    pairs.forEach(([a, b], k) => {
      form[a]![b] = form[b]![a] = (a === b ? 1 : Math.SQRT1_2) * c[k]![m]!;
    });
    return form;
  });
}

/** Displacements without their quadratic part. */
function rbfWithout(d: Float64Array, q: Float64Array, c: number[][]) {
  const dim = c[0]!.length,
    width = c.length;
  return Float64Array.from(d, (value, i) => {
    const m = i % dim,
      at = (width * (i - m)) / dim;
    return c.reduce((left, row, k) => left - q[at + k]! * row[m]!, value);
  });
}

/**
 * Factors (products x dim) of the products of least energy next to all affine maps, as deformnb.rbf.interpolant has
 * them.
 * @param isSkew the matrix is not symmetric: by plain least squares
 */
function rbfQuadraticPart(
  phi: Float64Array,
  x: Float64Array,
  d: Float64Array,
  q: Float64Array,
  span: Span,
  isSkew: boolean,
) {
  const n = Math.sqrt(phi.length),
    dim = x.length / n,
    count = q.length / n,
    all = count + dim;
  // Where the points determine none of it, all that follows would be rounding.
  if (span.quadrics?.length === 0) return Array.from({ length: count }, () => new Array<number>(dim).fill(0));
  const width = span.basis.length + 1,
    p = rbfAffineColumns(x, span.basis, dim),
    both = new Float64Array(all * (n + width));
  for (let i = 0; i < n; i++) {
    both.set(q.subarray(count * i, count * (i + 1)), all * i);
    both.set(d.subarray(dim * i, dim * (i + 1)), all * i + count);
  }
  const w = isSkew
    ? rbfProjected(p, both, n, width, all)
    : rbfFactored(rbfBordered(phi, p, n, width), n + width)(both, all);
  const s = new Float64Array(count * count),
    h = new Float64Array(count * dim);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < count; k++) {
      for (let j = 0; j < count; j++) s[count * k + j]! += q[count * i + k]! * w[all * i + j]!;
      for (let m = 0; m < dim; m++) h[dim * k + m]! += q[count * i + k]! * w[all * i + count + m]!;
    }
  }
  let trace = 0;
  for (let k = 0; k < count; k++) trace += s[(count + 1) * k]!;
  const size = trace > 0 ? trace : 1;
  span.bend?.flat().forEach((value, k) => {
    s[k]! += size * value;
  });
  const c = rbfFactored(s, count)(h, dim);
  return Array.from({ length: count }, (_, k) => Array.from(c.subarray(dim * k, dim * (k + 1))));
}

/** (1, x on the span of the points), n x (1 + rank). */
function rbfAffineColumns(x: Float64Array, basis: number[][], dim: number) {
  const n = x.length / dim,
    width = basis.length + 1,
    p = new Float64Array(n * width);
  for (let i = 0; i < n; i++) {
    p[i * width] = 1;
    basis.forEach((e, k) => {
      p[i * width + 1 + k] = e.reduce((sum, value, c) => sum + x[dim * i + c]! * value, 0);
    });
  }
  return p;
}

/** Columns b (n x m) less their projection on columns p (n x r), by Gram-Schmidt, twice. */
function rbfProjected(p: Float64Array, b: Float64Array, n: number, r: number, m: number) {
  const e = Float64Array.from(p),
    out = b.slice(0, n * m);
  const remove = (a: Float64Array, wa: number, k: number, f: Float64Array, wf: number, j: number) => {
    let dot = 0;
    for (let i = 0; i < n; i++) dot += a[i * wa + k]! * f[i * wf + j]!;
    for (let i = 0; i < n; i++) a[i * wa + k]! -= dot * f[i * wf + j]!;
  };
  for (let k = 0; k < r; k++) {
    for (let twice = 0; twice < 2; twice++) for (let j = 0; j < k; j++) remove(e, r, k, e, r, j);
    let size = 0;
    for (let i = 0; i < n; i++) size += e[i * r + k]! ** 2;
    for (let i = 0; i < n; i++) e[i * r + k]! /= Math.sqrt(size) || 1;
  }
  for (let k = 0; k < m; k++) {
    for (let twice = 0; twice < 2; twice++) for (let j = 0; j < r; j++) remove(out, m, k, e, r, j);
  }
  return out;
}

/** The part of the products that centred points determine next to affine maps: deformnb.rbf.trends.quadric_span. */
function rbfQuadricSpan(rows: Vector[], basis: number[][], dim: number) {
  const n = rows.length,
    size = rbfSpread(rows) || 1;
  const x = Float64Array.from(rows.flat(), (value) => value / size),
    q = rbfProducts(x, dim),
    count = q.length / n;
  const rest = rbfProjected(rbfAffineColumns(x, basis, dim), q, n, basis.length + 1, count);
  const { sigma, directions } = rbfSingular(
    Array.from({ length: count }, (_, k) => rows.map((__, i) => rest[count * i + k]!)),
  );
  if (!(sigma[0] > FLAT * Math.hypot(...q))) {
    return { quadrics: [], bend: rbfEye(count) };
  }
  const spreads = sigma.map((value) => value / sigma[0]),
    weights = spreads.map((value) => rbfPenalty(value, THIN_BEND));
  return { quadrics: directions.filter((_, k) => spreads[k]! > FLAT), bend: rbfWeighted(directions, weights) };
}

/** The symmetric matrix with these orthonormal directions and eigenvalues. */
function rbfWeighted(directions: number[][], weights: number[]) {
  return rbfOuter(
    directions.map((e, k) => e.map((value) => weights[k]! * value)),
    directions,
  );
}

/** The penalty of a direction with this spread. */
function rbfPenalty(spread: number, limit: number) {
  const s = Math.max(spread, LEAST_SPREAD);
  return s < limit ? ((limit - s) / s) ** 2 / SOFTNESS : 0;
}

/** Solver of a general square system, factored once with partial pivoting. */
function rbfFactored(matrix: Float64Array, n: number): (rhs: Float64Array, m: number) => Float64Array {
  const a = Float64Array.from(matrix),
    order = Array.from({ length: n }, (_, k) => k);
  for (let c = 0; c < n; c++) {
    let pivot = c;
    for (let i = c + 1; i < n; i++) if (Math.abs(a[i * n + c]!) > Math.abs(a[pivot * n + c]!)) pivot = i;
    if (pivot !== c) {
      for (let k = 0; k < n; k++) [a[c * n + k], a[pivot * n + k]] = [a[pivot * n + k]!, a[c * n + k]!];
      [order[c], order[pivot]] = [order[pivot]!, order[c]!];
    }
    for (let i = c + 1; i < n; i++) {
      const f = a[i * n + c]! / a[c * n + c]!;
      a[i * n + c] = f;
      if (f !== 0) for (let k = c + 1; k < n; k++) a[i * n + k]! -= f * a[c * n + k]!;
    }
  }
  return (rhs, m) => {
    const out = new Float64Array(n * m);
    for (let c = 0; c < m; c++) {
      for (let i = 0; i < n; i++) {
        let sum = rhs[order[i]! * m + c]!;
        for (let k = 0; k < i; k++) sum -= a[i * n + k]! * out[k * m + c]!;
        out[i * m + c] = sum;
      }
      for (let i = n - 1; i >= 0; i--) {
        let sum = out[i * m + c]!;
        for (let k = i + 1; k < n; k++) sum -= a[i * n + k]! * out[k * m + c]!;
        out[i * m + c] = sum / a[i * n + i]!;
      }
    }
    return out;
  };
}

/** [Phi P; P^T 0] with the n x r matrix P. */
function rbfBordered(phi: Float64Array, p: Float64Array, n: number, r: number) {
  const size = n + r,
    out = new Float64Array(size * size);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < n; j++) out[i * size + j] = phi[i * n + j]!;
    for (let k = 0; k < r; k++) out[i * size + n + k] = out[(n + k) * size + i] = p[i * r + k]!;
  }
  return out;
}

/** The trend of least energy. */
function rbfLeastEnergy(
  matrix: ReturnType<typeof kernelMatrix>,
  x: Float64Array,
  d: Float64Array,
  span: Span,
  turn: Matrix,
  kernel: string,
  trend: string,
) {
  const { n, dim, phi } = matrix,
    all = 2 * dim,
    w = new Float64Array(n * all),
    mean = new Array<number>(all).fill(0);
  const fill = (out: Float64Array, width: number, first: number) => {
    for (let i = 0; i < n; i++) {
      out.set(x.subarray(dim * i, dim * (i + 1)), width * i + first);
      out.set(d.subarray(dim * i, dim * (i + 1)), width * i + first + dim);
    }
  };
  if (RBF_KERNELS[kernel]!.order === 0) {
    const width = all + 1,
      rhs = new Float64Array(n * width).fill(1);
    fill(rhs, width, 1);
    const v = matrix.solve(rhs, width),
      sums = new Float64Array(width);
    for (let i = 0; i < n; i++) for (let k = 0; k < width; k++) sums[k]! += v[width * i + k]!;
    for (let k = 0; k < all; k++) {
      mean[k] = sums[k + 1]! / sums[0]!;
      for (let i = 0; i < n; i++) w[all * i + k] = v[width * i + k + 1]! - v[width * i]! * mean[k]!;
    }
  } else {
    // Phi is not definite: only the bordered system is well posed
    const rhs = new Float64Array((n + 1) * all);
    fill(rhs, all, 0);
    const v = rbfFactored(rbfBordered(phi, new Float64Array(n).fill(1), n, 1), n + 1)(rhs, all);
    w.set(v.subarray(0, all * n));
    for (let k = 0; k < all; k++) mean[k] = v[all * n + k]!;
  }
  const s = rbfMatrix(dim, () => 0),
    h = rbfMatrix(dim, () => 0);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < dim; k++) {
      for (let j = 0; j < dim; j++) {
        s[k]![j]! += x[dim * i + k]! * w[all * i + j]!;
        h[k]![j]! += (x[dim * i + k]! + d[dim * i + k]!) * w[all * i + j]!;
      }
    }
  }
  if (trend === "affine" && span.ridge) rbfSteady(s, h, rbfPlainMoments(x, d, dim), span.ridge);
  const linear = rbfLessOne(rbfTrendMap(s, h, span, turn, trend)),
    alpha = new Float64Array(dim * n);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < dim; k++) {
      let value = w[all * i + dim + k]!;
      for (let j = 0; j < dim; j++) value -= linear[k]![j]! * w[all * i + j]!;
      alpha[dim * i + k] = value;
    }
  }
  return { alpha, linear, constant: rbfConstant(mean, linear) };
}

/** A linear map less the identity. */
function rbfLessOne(m: number[][]) {
  return rbfMatrix(m.length, (i, j) => m[i]![j]! - Number(i === j));
}

/** Mean of the displacements minus the linear map's at the mean of places. */
function rbfConstant(mean: number[], linear: number[][]) {
  return linear.map((row, k) => mean[row.length + k]! - rbfDot(row, mean));
}

/** Means and second moments with equal weights of all points. */
function rbfPlainMoments(x: Float64Array, d: Float64Array, dim: number) {
  const n = x.length / dim,
    mean = new Array<number>(2 * dim).fill(0),
    s = rbfMatrix(dim, () => 0),
    h = rbfMatrix(dim, () => 0);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < dim; k++) {
      mean[k]! += x[dim * i + k]! / n;
      mean[dim + k]! += d[dim * i + k]! / n;
    }
  }
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < dim; k++) {
      for (let j = 0; j < dim; j++) {
        const c = x[dim * i + j]! - mean[j]!,
          p = x[dim * i + k]! - mean[k]!;
        s[k]![j]! += p * c;
        h[k]![j]! += (p + d[dim * i + k]! - mean[dim + k]!) * c;
      }
    }
  }
  return { mean, s, h };
}

/** Add the plain moments as much as the points are thin: the energy of a row is that of its small wiggles. */
function rbfSteady(s: number[][], h: number[][], plain: { s: number[][]; h: number[][] }, ridge: number[][]) {
  const share = rbfSingular(ridge).sigma[0],
    weight = 1 / rbfTrace(s),
    other = share / rbfTrace(plain.s);
  for (let i = 0; i < s.length; i++) {
    for (let j = 0; j < s.length; j++) {
      s[i]![j] = weight * s[i]![j]! + other * plain.s[i]![j]!;
      h[i]![j] = weight * h[i]![j]! + other * plain.h[i]![j]!;
    }
  }
}

/** For a matrix that is not symmetric: the trend of least squares, and Phi alpha = the rest. */
function rbfLeastSquares(phi: Float64Array, x: Float64Array, d: Float64Array, span: Span, turn: Matrix, trend: string) {
  const dim = turn.length;
  let linear = rbfMatrix(dim, () => 0),
    constant = new Array<number>(dim).fill(0);
  if (trend !== "none") {
    const { mean, s, h } = rbfPlainMoments(x, d, dim);
    linear = rbfLessOne(rbfTrendMap(s, h, span, turn, trend));
    constant = rbfConstant(mean, linear);
  }
  const left = rbfWithoutLinear(x, d, linear),
    moved = left.map((value, i) => value - constant[i % dim]!);
  return { alpha: rbfFactored(phi, x.length / dim)(moved, dim), linear, constant };
}

/** Displacements without a linear part. */
function rbfWithoutLinear(x: Float64Array, d: Float64Array, linear: number[][]) {
  const dim = linear.length;
  return Float64Array.from(d, (value, i) =>
    linear[i % dim]!.reduce((left, m, k) => left - m * x[i - (i % dim) + k]!, value),
  );
}

/** The linear map of a trend from second moments. */
function rbfTrendMap(s: Matrix, h: Matrix, { basis, ridge }: Span, turn: Matrix, trend: string) {
  if (trend === "translation") return rbfEye(s.length);
  const size = rbfTrace(s);
  if (trend === "affine_exact" || (trend === "affine" && !ridge)) {
    return rbfComplete(rbfAffineImages(s, h, basis), basis, s.length);
  }
  const isHeld = trend === "affine" && ridge !== null;
  const rotation = rbfNearestRotation(isHeld ? rbfHeldAboutRow(h, size, ridge) : h, size, turn);
  if (trend === "rigid") return rotation;
  const scale = Math.max(rotation.reduce((sum, row, i) => sum + rbfDot(row, h[i]!), 0) / size, 0);
  const similar = rbfTimesNumber(rotation, scale);
  if (!isHeld) return similar;
  // G + (H - G S) (S + tr(S) ridge)^-1: the similarity, corrected where the points determine more
  const taken = rbfTimes(similar, s),
    rest = rbfPlus(h, rbfTimesNumber(taken, -1));
  const held = rbfPlus(s, rbfTimesNumber(ridge, size));
  const images = rbfAffineImages(held, rest, rbfEye(s.length));
  return mapMatrix(similar, (value, i, j) => value + images[j]![i]!);
}

/**
 * H with the smallest turn of a row of points in space added, as much as the row is thin: see
 * deformnb.rbf.trends._fix_row_rotation.
 */
function rbfHeldAboutRow(h: Matrix, size: number, ridge: Matrix) {
  if (h.length === 2) return h;
  const { sigma, directions } = rbfSingular(ridge),
    along = directions[2]!; // the penalty of the row is zero
  const image = h.map((row) => rbfDot(row, along)),
    length = Math.hypot(...image);
  const aside = sigma[0] > (1 + 1e-6) * sigma[1] ? directions[0] : null; // the row is thinnest there
  const turn = rbfSmallestTurn(along, length > 0 ? image.map((value) => value / length) : along, aside);
  const across = rbfMatrix(3, (i, j) => Number(i === j) - along[i]! * along[j]!),
    more = rbfTimes(turn, across);
  return rbfPlus(h, rbfTimesNumber(more, sigma[1] * size));
}

/** The images of the directions of the basis under the affine trend of least energy. */
function rbfAffineImages(s: number[][], h: number[][], basis: number[][]) {
  const rank = basis.length,
    dim = s.length,
    small = new Float64Array(rank * rank),
    rhs = new Float64Array(rank * dim);
  for (let i = 0; i < rank; i++) {
    for (let j = 0; j < rank; j++)
      small[i * rank + j] = rbfDot(
        basis[i]!,
        s.map((row) => rbfDot(row, basis[j]!)),
      );
    for (let k = 0; k < dim; k++) rhs[dim * i + k] = rbfDot(basis[i]!, h[k]!);
  }
  const images = rbfFactored(small, rank)(rhs, dim);
  return basis.map((_, i) => Array.from(images.subarray(dim * i, dim * (i + 1))));
}

/**
 * The linear map of the directions of the basis to the images, which rotates and scales the directions across with
 * them: deformnb.rbf.trends.complete.
 */
function rbfComplete(images: number[][], basis: number[][], dim: number) {
  const rank = basis.length;
  if (rank === 0) return rbfEye(dim);
  if (rank === dim) return rbfOuter(images, basis);
  const [first, second] = basis as Matrix,
    [firstImage, secondImage] = images as Matrix;
  const quarter = ([a, b]: Vector): Vector => [-b, a];
  if (dim === 2) return rbfOuter([firstImage, quarter(firstImage)], [first, quarter(first)]);
  if (rank === 1) return rbfSmallestTurn(first, firstImage);
  const image = rbfCross(firstImage, secondImage),
    scale = Math.sqrt(Math.hypot(...image)) || 1;
  return rbfOuter([...images, image.map((value) => value / scale)], [...basis, rbfCross(first, second)]);
}

/**
 * Scale times the smallest rotation that takes a unit vector to the direction of its image, by Rodrigues.
 * @param axis of half a turn, across q; without one that of coordinates farthest from q
 */
function rbfSmallestTurn(q: number[], image: number[], axis: number[] | null = null) {
  const length = Math.hypot(...image),
    t = image.map((value) => value / (length || 1));
  const isOpposite = rbfDot(q, t) < -1 + 1e-9; // half a turn, and the rest from there
  const start = isOpposite ? q.map((value) => -value) : q,
    [a, b, c] = rbfCross(start, t);
  const k = [
      [0, -c, b],
      [c, 0, -a],
      [-b, a, 0],
    ],
    square = rbfTimes(k, k);
  const rest = 2 / start.reduce((sum, value, i) => sum + (value + t[i]!) ** 2, 0);
  const turn = rbfMatrix(3, (i, j) => Number(i === j) + k[i]![j]! + rest * square[i]![j]!);
  if (!isOpposite) return rbfTimesNumber(turn, length);
  const sizes = q.map(Math.abs),
    least = sizes.indexOf(Math.min(...sizes));
  const open = axis ?? rbfEye(3)[least]!,
    slant = rbfDot(open, q);
  const aside = q.map((value, i) => open[i]! - slant * value),
    size = Math.hypot(...aside);
  const half = rbfMatrix(3, (i, j) => (2 * aside[i]! * aside[j]!) / size ** 2 - Number(i === j));
  return rbfTimesNumber(rbfTimes(turn, half), length);
}

/** @param previous where there is none */
function rbfNearestRotation(h: Matrix, size: number, previous: Matrix) {
  const least = NO_ANGLE * Math.max(size, Math.hypot(...h.flat())),
    { rotation, certainty } = rbfRotation(h);
  if (certainty > least) return rotation;
  return h.length === 2 ? previous : rbfRotation(rbfPlus(h, rbfTimesNumber(previous, least))).rotation;
}

/**
 * The rotation R with the largest tr(R^T H), and the sum of the two smallest stretches of H, which is zero where the
 * rotation is open.
 */
function rbfRotation(h: Matrix): { rotation: Matrix; certainty: number } {
  if (h.length === 2) {
    const c = h[0][0] + h[1][1],
      s = h[1][0] - h[0][1],
      certainty = Math.hypot(c, s),
      length = certainty || 1;
    return {
      rotation: [
        [c / length, -s / length],
        [s / length, c / length],
      ],
      certainty,
    };
  }
  const {
    sigma,
    directions: [p, q],
  } = rbfSingular(rbfMatrix(3, (k, i) => h[i]![k]!));
  const image = (e: Vector) => h.map((row) => rbfDot(row, e)),
    first = image(p),
    other = image(q);
  const u = first.map((value) => value / (sigma[0] || 1)),
    slant = rbfDot(u, other);
  const aside = other.map((value, k) => value - slant * u[k]!),
    size = Math.hypot(...aside) || 1;
  const v = aside.map((value) => value / size);
  const sign = rbfDeterminant(h) < 0 ? -1 : 1;
  return {
    rotation: rbfOuter([u, v, rbfCross(u, v)], [p, q, rbfCross(p, q)]),
    certainty: sigma[1] + sign * (sigma as Vector3)[2],
  };
}

/**
 * The solution of the bordered system with an affine trend on the span of the points, and with the combinations of
 * products q that they determine.
 */
function rbfBorderedTrend(
  phi: Float64Array,
  x: Float64Array,
  d: Float64Array,
  basis: number[][],
  dim: number,
  q: Float64Array | null = null,
  quadrics: number[][] = [],
) {
  const n = x.length / dim,
    rank = basis.length,
    affine = rank + 1,
    width = affine + quadrics.length;
  const first = rbfAffineColumns(x, basis, dim),
    p = new Float64Array(n * width),
    count = q ? q.length / n : 0;
  for (let i = 0; i < n; i++) {
    p.set(first.subarray(i * affine, (i + 1) * affine), i * width);
    if (q) {
      quadrics.forEach((e, k) => {
        p[i * width + affine + k] = e.reduce((sum, value, j) => sum + value * q[count * i + j]!, 0);
      });
    }
  }
  const factored = rbfFactored(rbfBordered(phi, p, n, width), n + width);
  const solve = (b: Float64Array) => {
    const rhs = new Float64Array(dim * (n + width));
    rhs.set(b);
    const v = factored(rhs, dim),
      row = (k: number) => Array.from(v.subarray(dim * k, dim * (k + 1)));
    const bent = Array.from({ length: count }, (_, j) =>
      Array.from({ length: dim }, (__, m) =>
        quadrics.reduce((sum, e, k) => sum + e[j]! * v[dim * (n + affine + k) + m]!, 0),
      ),
    );
    return {
      alpha: v.slice(0, dim * n),
      constant: row(n),
      bent: q ? bent : null,
      images: basis.map((_, k) => row(n + 1 + k)),
    };
  };
  const whole = solve(d);
  if (rank === dim) return { ...whole, linear: rbfOuter(whole.images, basis, dim) };
  const linear = rbfLessOne(
    rbfComplete(
      whole.images.map((image, k) => image.map((value, j) => basis[k]![j]! + value)),
      basis,
      dim,
    ),
  );
  // Points that are flat only to rounding are a little off their span, where the completed map displaces them too.
  const rest = solve(rbfWithoutLinear(x, q && whole.bent ? rbfWithout(d, q, whole.bent) : d, linear));
  const more = rbfOuter(rest.images, basis, dim);
  return {
    alpha: rest.alpha,
    constant: rest.constant,
    bent: whole.bent?.map((row, j) => row.map((value, m) => value + (rest.bent?.[j]?.[m] ?? 0))),
    linear: rbfPlus(linear, more),
  };
}

/** Orthonormal directions that span centred points. */
function rbfSpan(rows: Vector[]): Vector[] {
  if (rows.length < 2) return [];
  const dim = rows[0]!.length;
  const { sigma, directions } = rbfSingular(Array.from({ length: dim }, (_, k) => rows.map((row) => row[k]!)));
  if (sigma[0] === 0) return [];
  return sigma[dim - 1]! > FLAT * sigma[0] ? rbfEye(dim) : directions.filter((_, k) => sigma[k]! > FLAT * sigma[0]);
}

/**
 * Singular values of the columns of a matrix, falling, and their directions: by one-sided Jacobi, exact to rounding.
 */
function rbfSingular(columns: number[][]) {
  const count = columns.length,
    a = [...columns],
    v = a.map((_, k) => a.map((__, j) => Number(j === k)));
  const dot = (p: number[], q: number[]) => p.reduce((sum, value, k) => sum + value * q[k]!, 0);
  for (let sweep = 0, isDone = false; sweep < 8 * (count - 1) && !isDone; sweep++) {
    isDone = true;
    for (let i = 0; i < count; i++) {
      for (let j = i + 1; j < count; j++) {
        const gamma = dot(a[i]!, a[j]!);
        if (gamma === 0) continue;
        isDone = false;
        const zeta = (dot(a[j]!, a[j]!) - dot(a[i]!, a[i]!)) / (2 * gamma);
        const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.hypot(1, zeta));
        const c = 1 / Math.hypot(1, t),
          s = c * t;
        for (const m of [a, v]) {
          const p = m[i]!,
            q = m[j]!;
          m[i] = p.map((value, k) => c * value - s * q[k]!);
          m[j] = p.map((value, k) => s * value + c * q[k]!);
        }
      }
    }
  }
  const sizes = a.map((p) => Math.hypot(...p)),
    order = sizes.map((_, k) => k).sort((i, j) => sizes[j]! - sizes[i]! || i - j);
  return { sigma: order.map((k) => sizes[k]) as Vector, directions: order.map((k) => v[k]) as Matrix };
}

/**
 * The principal directions of places, and their spread along each relative to the longest, in the thinner of two sets:
 * deformnb.rbf.trends.thin_directions.
 */
function rbfSpreads(targets: Vector[], sources: Vector[]) {
  const x = rbfScaled(targets),
    y = rbfScaled(sources),
    dim = x[0]!.length,
    tiny = 1e-12; // both may be flat in one direction
  const more = (m: Matrix, t: number) => mapMatrix(m, (value, i, j) => value + (i === j ? t : 0));
  const moments: (p: number[][], q: number[][]) => Matrix = (p, q) =>
    rbfMatrix(dim, (i, j) => p.reduce((sum, row, k) => sum + row[i]! * q[k]![j]!, 0));
  const xx = moments(x, x),
    yy = moments(y, y),
    yx = moments(y, x);
  const least = 1e-9 * Math.sqrt(rbfTrace(xx) * rbfTrace(yy)); // the smallest turn where one is open
  const { rotation } = rbfRotation(more(yx, least));
  const back = y.map((row) => rotation.map((_, k) => row.reduce((sum, value, i) => sum + value * rotation[i]![k]!, 0)));
  const a = rbfRelative(xx),
    b = rbfTrace(yy) > 0 ? rbfRelative(moments(back, back)) : a;
  // 2 A (A + B)^-1 B
  const sum = more(rbfPlus(a, b), 2 * tiny).flat();
  const solved = rbfFactored(Float64Array.from(sum), dim)(Float64Array.from(more(b, tiny).flat()), dim);
  const both = rbfTimes(
    more(a, tiny),
    rbfMatrix(dim, (i, j) => solved[dim * i + j]!),
  );
  const { sigma, directions } = rbfSingular(rbfMatrix(dim, (i, j) => both[i]![j]! + both[j]![i]!));
  return { spreads: sigma.map((value) => Math.sqrt(value / sigma[0])), directions };
}

/** Places centred, and about 1 in size: squares of tiny lengths would be zero. */
function rbfScaled(places: Vector[]): Vector[] {
  const mean = mapVector(places[0]!, (_, k) => places.reduce((sum, p) => sum + p[k]! / places.length, 0));
  const centred = places.map((p) => difference(p, mean));
  const size = rbfSpread(centred) || 1;
  return centred.map((p) => mapVector(p, (value) => value / size));
}

/** The centroid of places. */
function rbfMean(places: Vector[]) {
  return mapVector(places[0]!, (_, k) => places.reduce((sum, p) => sum + p[k]!, 0) / places.length);
}

/** The root mean square distance of places from their centroid; 0 for none. */
function rbfSpread(places: Vector[]) {
  if (places.length === 0) return 0;
  const mean = rbfMean(places);
  const away = places.map((p) => rbfDistance(p, mean));
  const largest = away.reduce((m, value) => Math.max(m, value), 0);
  return largest && largest * Math.sqrt(away.reduce((sum, value) => sum + (value / largest) ** 2, 0) / places.length);
}

/** Second moments relative to their largest eigenvalue. */
function rbfRelative(m: number[][]) {
  const largest = rbfSingular(m).sigma[0] || 1;
  return mapMatrix(m, (value) => value / largest);
}

/** The rotation of the trend of a fit. */
function rbfRotationOf({ linear, support }: RbfFit) {
  const m = mapMatrix(linear, (value, i, j) => Number(i === j) + value / support);
  return rbfDeterminant(m) > 0 ? rbfRotation(m).rotation : rbfEye(m.length);
}

// ---- remarks on a fit, as deformnb.rbf.conditioning makes them -----------------------------------------------------

/**
 * The indices of the nearest neighbours of each point, nearest first, row by row; as many as requested, or all.
 */
function rbfNeighbours({ merged, n, origin, radius }: Ready, most: number) {
  const count = Math.min(most, n - 1),
    found = new Int32Array(n * count),
    gaps = new Float64Array(n * count).fill(Infinity);
  const dim = origin.length,
    x = new Float64Array(dim * n);
  merged.forEach((q, k) => {
    for (let c = 0; c < dim; c++) x[dim * k + c] = (q.x[c]! - origin[c]!) / radius;
  });
  const insert = (i: number, j: number, gap: number) => {
    const first = i * count;
    let at = first + count - 1;
    for (; at > first && gaps[at - 1]! > gap; at--) {
      gaps[at] = gaps[at - 1]!;
      found[at] = found[at - 1]!;
    }
    gaps[at] = gap;
    found[at] = j;
  };
  for (let i = 0; i < n; i++) {
    for (let j = i + 1; j < n; j++) {
      let gap = 0;
      for (let c = 0; c < dim; c++) {
        const step = x[dim * i + c]! - x[dim * j + c]!;
        gap += step * step;
      }
      if (gap < gaps[(i + 1) * count - 1]!) insert(i, j, gap);
      if (gap < gaps[(j + 1) * count - 1]!) insert(j, i, gap);
    }
  }
  return { found, count };
}

function rbfClosest(ready: Ready) {
  if (ready.n < 2) return "a single point";
  const { merged } = ready,
    { found } = rbfNeighbours(ready, 1);
  const gap = (k: number) => rbfDistance(merged[k]!.x, merged[found[k]!]!.x);
  const least = merged.reduce((best, _, k) => (gap(k) < gap(best) ? k : best), 0);
  return `${rbfLabel(merged[least]!.point)} and ${rbfLabel(merged[found[least]!]!.point)}`;
}

function rbfWarnings(ready: Ready, kernel: string, map: number[][]) {
  const notes = [],
    { sigma } = rbfSingular(map); // of the transpose: the singular values are the same
  const isPlain =
    ready.trend === "affine_exact" ||
    (["affine", "quadratic"].includes(ready.trend) && RBF_KERNELS[kernel]!.order >= 2);
  if (isPlain && sigma[0] > STEEP) {
    notes.push(
      `the affine trend stretches more than ${STEEP} times: the control points nearly lie on one line ` +
        "or in one plane; the trend similarity would not",
    );
  }
  const spread = (place: (q: Place) => Vector) => rbfSpread(ready.merged.map(place));
  const collapses: Record<string, string> = {
    affine: "the trend collapses everything to one place",
    affine_exact: "the trend collapses everything to one place",
    quadratic: "the trend collapses everything to one place",
    similarity: "the trend collapses everything to one place",
    rigid: "the rotation is undetermined and stays as it was",
  };
  const sources = spread(rbfSource);
  if (Object.hasOwn(collapses, ready.trend) && sources < NO_ANGLE * spread((q) => q.x)) {
    notes.push(`the sources nearly coincide: ${collapses[ready.trend]}`);
  } else if (isPlain && !(sigma[sigma.length - 1]! >= NO_ANGLE * sigma[0])) {
    notes.push(
      "the sources lie on one line or in one plane and the targets do not: the affine trend presses " +
        "everything flat",
    );
  }
  return notes;
}

/** Ids of points that share a source and have different targets. */
function rbfTornPairs({ merged, n, ids }: Ready, most: number = 3) {
  const size = rbfDiameter(merged.map((q) => q.x)),
    near = SAME_PLACE * size;
  const sources = merged.map(rbfSource),
    first = Float64Array.from(sources, ([value]) => value);
  const found: Vector2[] = [];
  for (let i = 0; i < n && size > 0 && found.length < most; i++) {
    for (let j = i + 1; j < n && found.length < most; j++) {
      if (Math.abs(first[i]! - first[j]!) <= near && rbfDistance(sources[i]!, sources[j]!) <= near) {
        found.push([ids[i]!, ids[j]!]);
      }
    }
  }
  return found;
}

function rbfSource({ x, d }: Place) {
  return mapVector(x, (value, k) => value + d[k]!);
}

function rbfDistance(p: Vector, q: Vector) {
  return Math.hypot(...difference(p, q));
}

/** Ids of points that are pulled past each other. */
function rbfCrossingPairs(ready: Ready, map: number[][], most: number = 3) {
  const { merged, n } = ready;
  if (n < 2) return [];
  const dim = map.length, // flat arrays: with vectors this took longer than the solve
    x = Float64Array.from(merged.flatMap((q) => q.x)),
    moved = Float64Array.from(merged.flatMap((q) => q.d.map((value, k) => value + q.x[k]! - rbfDot(map[k]!, q.x)))),
    gap = new Float64Array(dim);
  const distance = (places: Float64Array, i: number, j: number) => {
    let square = 0;
    for (let k = 0; k < dim; k++) {
      const step = places[dim * i + k]! - places[dim * j + k]!;
      square += step * step;
    }
    return Math.sqrt(square);
  };
  const lengthUnderMap = () => {
    let square = 0;
    for (const row of map) {
      let sum = 0;
      for (let k = 0; k < dim; k++) sum += row[k]! * gap[k]!;
      square += sum * sum;
    }
    return Math.sqrt(square);
  };
  if (!rbfHasCrossing(x, moved, map)) return []; // the usual case, without a search for neighbours
  const pairs = new Map<number, [i: number, j: number, degree: number]>(),
    { found, count } = rbfNeighbours(ready, NEAREST_AND_EQUAL);
  for (let i = 0; i < n; i++) {
    const fourth = distance(x, i, found[i * count + Math.min(NEAREST, count) - 1]!);
    for (let at = i * count; at < (i + 1) * count; at++) {
      const j = found[at]!,
        length = distance(x, i, j);
      if (length > fourth * (1 + SAME_DISTANCE)) break;
      for (let k = 0; k < dim; k++) gap[k] = x[dim * i + k]! - x[dim * j + k]!;
      const along = Math.max(COLLAPSED * length, lengthUnderMap()); // beyond that the ratio would be rounding
      const beside = distance(moved, i, j);
      if (!(beside > along)) continue;
      // In quarters of an octave, as in deformnb.rbf.conditioning: neither rounding nor a small move changes the names.
      const degree = Math.round(4 * Math.log2(beside / along));
      pairs.set(Math.min(i, j) * n + Math.max(i, j), [Math.min(i, j), Math.max(i, j), degree]);
    }
  }
  const worst = [...pairs]
    .sort(([, [i, j, d]], [, [k, l, e]]) => e - d || ready.ids[i]! - ready.ids[k]! || ready.ids[j]! - ready.ids[l]!)
    .slice(0, most);
  return worst
    .filter(([, [, , degree]]) => degree >= worst[0]![1][2] - FAR_BEHIND)
    .sort(([p], [q]) => p - q)
    .map(([, [i, j]]): Vector2 => [ready.ids[i]!, ready.ids[j]!]);
}

/**
 * Whether the displacement next to a linear map moves any two places farther than the map keeps them apart.
 * @param moved the sources next to the map
 */
function rbfHasCrossing(x: Float64Array, moved: Float64Array, map: number[][]) {
  const [[a, b, c], [d, e, f], last] = map as [number[], number[], number[]?],
    dim = map.length;
  for (let i = 0; i < x.length; i += dim) {
    for (let j = 0; j < i; j += dim) {
      const u = x[i]! - x[j]!,
        v = x[i + 1]! - x[j + 1]!,
        p = moved[i]! - moved[j]!,
        q = moved[i + 1]! - moved[j + 1]!;
      let beside = p * p + q * q,
        s = a! * u + b! * v,
        t = d! * u + e! * v,
        along = 0;
      if (last) {
        const w = x[i + 2]! - x[j + 2]!,
          r = moved[i + 2]! - moved[j + 2]!;
        beside += r * r;
        s += c! * w;
        t += f! * w;
        along = (last[0]! * u + last[1]! * v + last[2]! * w) ** 2;
      }
      if (!(beside * (1 + SAME_DISTANCE) <= along + s * s + t * t)) return true;
    }
  }
  return false;
}

// ---- kernels and trends, with the names and in the order of the package ---------------------------------------------

/** Points or settings that cannot be fitted, with a message for users. */
export class RbfError extends Error {}

const FORMULAS: Record<KernelName, Pick<Kernel, "profile" | "slope">> = {
  wendland_c2: {
    profile: (s) => {
      if (s >= 1) return 0;
      const t = 1 - Math.sqrt(s),
        q = t * t;
      return q * q * (5 - 4 * t);
    },
    slope: (s) => {
      if (s >= 1) return 0;
      const t = 1 - Math.sqrt(s);
      return -10 * t * t * t;
    },
  },
  wendland_c0: {
    profile: (s) => {
      if (s >= 1) return 0;
      const t = 1 - Math.sqrt(s);
      return t * t;
    },
    slope: (s) => {
      const r = Math.sqrt(Math.max(s, TINY));
      return r >= 1 ? 0 : -(1 - r) / r;
    },
  },
  wendland_c4: {
    profile: (s) => {
      if (s >= 1) return 0;
      const r = Math.sqrt(s),
        t = 1 - r,
        q = t * t;
      return (q * q * q * (35 * s + 18 * r + 3)) / 3;
    },
    slope: (s) => {
      if (s >= 1) return 0;
      const r = Math.sqrt(s);
      return (-28 / 3) * (1 + 5 * r) * (1 - r) ** 5;
    },
  },
  thin_plate: {
    profile: (s) => 0.5 * s * Math.log(Math.max(s, TINY)),
    slope: (s) => 0.5 * (Math.log(Math.max(s, TINY)) + 1),
  },
  gaussian: {
    profile: (s) => Math.exp(-4.5 * s),
    slope: (s) => -4.5 * Math.exp(-4.5 * s),
  },
  multiquadric: {
    profile: (s) => -Math.sqrt(1 + 16 * s),
    slope: (s) => -8 / Math.sqrt(1 + 16 * s),
  },
  inverse_multiquadric: {
    profile: (s) => 1 / Math.sqrt(1 + 16 * s),
    slope: (s) => {
      const t = 1 + 16 * s;
      return -8 / (t * Math.sqrt(t));
    },
  },
  inverse_quadratic: {
    profile: (s) => 1 / (1 + 16 * s),
    slope: (s) => {
      const t = 1 + 16 * s;
      return -16 / (t * t);
    },
  },
  cubic: {
    profile: (s) => s * Math.sqrt(s),
    slope: (s) => 1.5 * Math.sqrt(s),
  },
  quintic: {
    profile: (s) => -s * s * Math.sqrt(s),
    slope: (s) => -2.5 * s * Math.sqrt(s),
  },
  linear: {
    profile: (s) => -Math.sqrt(s),
    slope: (s) => -0.5 / Math.sqrt(Math.max(s, TINY)),
  },
};

export const RBF_KERNELS: Record<string, Kernel> = Object.fromEntries(
  Object.entries(KERNEL_FACTS).map(([name, facts]) => [name, { ...facts, ...FORMULAS[name as KernelName] }]),
);

const TABLES: Map<string, KernelTable> = new Map();

/**
 * The name of the kernel of settings; one that Python has registered comes with its table. It is the very string that the
 * kernel is stored under: for an equal one, such as a part of a longer text, V8 discards the compiled code at each access.
 */
export function rbfKernelOf({ kernel = "wendland_c2", kernel_table: table }: FitSettings) {
  if (table?.name === kernel && TABLES.get(kernel)?.numbers !== table.numbers) {
    TABLES.set(kernel, table);
    RBF_KERNELS[kernel] = kernelOfTable(table);
  }
  return Object.keys(RBF_KERNELS).find((name) => name === kernel) ?? kernel;
}

/** order: the largest order of a kernel that the trend can be paired with. */
export const RBF_TRENDS: Record<string, { title: string; order: number }> = TREND_FACTS;

// ---- the fit --------------------------------------------------------------------------------------------------------

/** The fit of control points on a picture, or of dimension 3 in space. Throws RbfError. */
export function rbfFit(given: Point[], settings: FitSettings & { previous?: RbfFit | null } = {}, dim = 2) {
  const points = numberPoints(given);
  const kernel = rbfKernelOf(settings),
    trend = settings.trend ?? "affine";
  const smoothing = settings.smoothing ?? 0,
    strength = settings.strength ?? 1;
  rbfCheckSettings(kernel, trend, smoothing, strength, settings.support ?? null);
  rbfCheckPoints(points, dim);
  const active = points.filter((p) => p.active !== false);
  if (RBF_KERNELS[kernel]!.order > 0 && active.some((p) => (p.radius ?? null) !== null)) {
    throw new RbfError(
      `control points have individual support radii, and the ${kernel} kernel, which has no end, ` +
        "has none; choose a Wendland kernel or the Gaussian, or clear their radii.",
    );
  }
  if (active.length > LARGEST_SET) {
    throw new RbfError(
      `${active.length} control points are more than the ${LARGEST_SET} that are fitted here; ` +
        "Python fits them: warp the volume, or switch some off to drag.",
    );
  }
  // The radius is that of the points as dragged, at full strength, as in deformnb.document.deformation.Step.
  const radius = rbfRadius(active, rbfSupport(points, settings), trend);
  const ready = rbfPrepare(active, kernel, radius, trend, smoothing, strength, dim);
  if (ready.n === 0) return rbfIdentity(ready, kernel, "none", 1);
  return rbfSolvePrepared(ready, kernel, smoothing, settings.previous ?? null);
}

/** Throw an RbfError for settings that do not go together. */
export function rbfCheckSettings(
  kernel: string,
  trend: string,
  smoothing: number,
  strength: number,
  support: number | "box_diagonal" | null,
) {
  if (!Object.hasOwn(RBF_KERNELS, kernel)) {
    throw new RbfError(`unknown kernel '${kernel}'; choose one of ${Object.keys(RBF_KERNELS).join(", ")}.`);
  }
  if (!Object.hasOwn(RBF_TRENDS, trend)) {
    throw new RbfError(`unknown trend '${trend}'; choose one of ${Object.keys(RBF_TRENDS).join(", ")}.`);
  }
  if (support !== null && support !== "box_diagonal" && !(Number.isFinite(support) && support > 0)) {
    throw new RbfError(`the support radius must be a positive length, got ${support}.`);
  }
  if (!(Number.isFinite(smoothing) && smoothing >= 0)) {
    throw new RbfError(`smoothing must be 0 or a positive number, got ${smoothing}.`);
  }
  if (!Number.isFinite(strength)) throw new RbfError(`strength must be a finite number, got ${strength}.`);
  if (RBF_TRENDS[trend]!.order < RBF_KERNELS[kernel]!.order) {
    const able = Object.keys(RBF_TRENDS)
      .filter((t) => RBF_TRENDS[t]!.order >= RBF_KERNELS[kernel]!.order)
      .join(", ");
    throw new RbfError(
      `the ${kernel} kernel is not positive definite and needs a trend of ${able}; ` +
        `choose that, or a Wendland kernel for the trend '${trend}'.`,
    );
  }
}

/** The label of a point of a fit. */
export function rbfLabel(point: Point) {
  return labelOf(point, point.number ?? 0);
}

/** Throw an RbfError for points that cannot be fitted. */
export function rbfCheckPoints(points: Point[], dim = 2) {
  for (const p of numberPoints(points)) {
    for (const [what, place] of Object.entries({ source: p.source, target: p.target })) {
      const good =
        Array.isArray(place) &&
        place.length === dim &&
        place.every((v) => Number.isFinite(v) && Math.abs(v) <= LARGEST_COORDINATE);
      if (!good) {
        throw new RbfError(
          `the ${what} of ${rbfLabel(p)} is [${place}]; coordinates must be finite and below 1e15. ` +
            "Correct or remove that point.",
        );
      }
    }
    const weight = p.weight ?? 1;
    if (!(Number.isFinite(weight) && weight > 0)) {
      throw new RbfError(`the weight of ${rbfLabel(p)} is ${weight}; weights must be positive numbers.`);
    }
    const radius = p.radius ?? 1;
    if (!(radius > 0 && radius <= LARGEST_COORDINATE)) {
      throw new RbfError(
        `the radius of ${rbfLabel(p)} is ${radius}; a radius is a positive length, or null for that of all.`,
      );
    }
  }
}

export type Ends = { source: Vector; target: Vector; active?: boolean };

/** The places that do not move during a drag: the active sources, or the targets if the sources coincide. */
function rbfAtRest(points: Ends[]) {
  const active = points.filter((p) => p.active !== false);
  const sources = active.map((p) => p.source),
    targets = active.map((p) => p.target);
  return rbfSpread(sources) > SAME_PLACE * rbfSpread(targets) ? sources : targets;
}

/** The sides of the box of places; nothing for none. */
function rbfSizes(places: Vector[]) {
  return (places[0] ?? []).map(
    (_, k) =>
      places.reduce((m, p) => Math.max(m, p[k]!), -Infinity) - places.reduce((m, p) => Math.min(m, p[k]!), Infinity),
  );
}

/** The largest distance between two places; 0 for none. */
function rbfDiameter(places: Vector[]) {
  const size = rbfSpread(places);
  if (size === 0) return 0;
  const scaled = rbfScaled(places),
    middle = mapVector(scaled[0]!, () => 0);
  const square = (p: number[], q: number[]) => {
    let sum = 0;
    for (let k = 0; k < p.length; k++) sum += (p[k]! - q[k]!) ** 2;
    return sum;
  };
  const farthest: (from: Vector) => Vector = (from) =>
    scaled.reduce((far, p) => (square(p, from) > square(far, from) ? p : far), from);
  const one = farthest(middle),
    other = farthest(one);
  const least = Math.sqrt(square(other, farthest(other))),
    reach = Math.sqrt(square(one, middle));
  // Others are within that distance of all.
  const ends = scaled.filter((p) => Math.sqrt(square(p, middle)) >= (1 - 1e-9) * (least - reach));
  let most = 0;
  ends.forEach((p, k) => {
    for (let i = 0; i < k; i++) most = Math.max(most, square(p, ends[i]!));
  });
  return size * Math.sqrt(most);
}

/** The support of documents before 2.0, which depends on the axes; nothing else does. */
export function rbfBoxDiagonal(points: Ends[]) {
  return Math.hypot(...rbfSizes(rbfAtRest(points))) || null;
}

/**
 * The usual support of points: a share of their diameter, not below the distance at which they are connected, and less
 * for points in a row.
 */
function rbfUsualSupport(points: Point[], kernel: string) {
  const places = rbfAtRest(points),
    known = SUPPORTS.find((one) => one.kernel === kernel && arePlacesEqual(one.places, places));
  if (known) return known.support;
  const support = rbfSupportOf(places, kernel);
  SUPPORTS.unshift({ kernel, places, support });
  SUPPORTS.length = Math.min(SUPPORTS.length, KNOWN_SUPPORTS);
  return support;
}

/** The last usual supports: during a drag the places that they depend on stay. */
const SUPPORTS: { kernel: string; places: Vector[]; support: number | null }[] = [],
  KNOWN_SUPPORTS = 8;

function arePlacesEqual(p: Vector[], q: Vector[]) {
  return (
    p.length === q.length &&
    p.every((one, k) => one === q[k] || one.every((value, c) => value === (q[k] as number[])[c]))
  );
}

function rbfSupportOf(places: Vector[], kernel: string) {
  const size = rbfDiameter(places),
    { share, gaps } = RBF_KERNELS[kernel]!;
  if (size === 0) return null;
  const { spreads } = rbfSpreads(places, places),
    wide = spreads.filter((spread) => spread >= THIN).length;
  const across = Math.max(1, places.length ** (1 / wide) - 1);
  const usual = share >= 1 ? share * size : Math.max(share * size, rbfGap(rbfSample(places)));
  return wide === spreads.length ? usual : Math.min(usual, size * Math.min(0.5, gaps / across));
}

/** The longest edge of the minimum spanning tree of places: the distance at which they are connected. */
function rbfGap(places: Vector[]) {
  if (places.length < 2) return 0;
  const near = places.map((p) => rbfDistance(p, places[0]!)),
    waiting = places.map((_, k) => k > 0);
  let longest = 0;
  for (let count = 1; count < places.length; count++) {
    let next = -1;
    waiting.forEach((is, k) => {
      if (is && (next < 0 || near[k]! < near[next]!)) next = k;
    });
    longest = Math.max(longest, near[next]!);
    waiting[next] = false;
    places.forEach((p, k) => {
      near[k] = Math.min(near[k]!, rbfDistance(p, places[next]!));
    });
  }
  return longest;
}

/** About so many of the places, by their distance from the centroid: deformnb.rbf.cross_validation.sample_of. */
function rbfSample(places: Vector[]) {
  const n = places.length;
  if (n <= MOST_LEFT_OUT) return places;
  const mean = rbfMean(places);
  const ranked = places.map((p, k) => ({ k, away: rbfDistance(p, mean) })).sort((p, q) => p.away - q.away || p.k - q.k);
  const found = [],
    last = ranked[n - 1]!.away;
  for (let first = 0, next = 0; first < n; first = next) {
    for (next = first + 1; next < n && ranked[next]!.away - ranked[next - 1]!.away <= SAME_DISTANCE * last; ) next++;
    if (Math.floor(next * (MOST_LEFT_OUT / n)) > Math.floor(first * (MOST_LEFT_OUT / n))) {
      found.push(...ranked.slice(first, next));
    }
  }
  return found.length <= 2 * MOST_LEFT_OUT ? found.sort((p, q) => p.k - q.k).map(({ k }) => places[k]!) : [];
}

/**
 * The support radius of a set of points: as given, by a rule, as Python chose it, the usual one, or that of a lone
 * point.
 */
export function rbfSupport(points: Point[], settings: FitSettings) {
  const { support, chosen_support: chosen, lone_support: lone } = settings,
    kernel = rbfKernelOf(settings);
  const own =
    support === "box_diagonal" ? rbfBoxDiagonal(points) : (support ?? chosen ?? rbfUsualSupport(points, kernel));
  return own ?? lone ?? null;
}

function rbfRadius(active: Point[], radius: number | null, trend: string) {
  if (radius !== null) return radius;
  if (active.length && trend === "none") {
    throw new RbfError(
      `${rbfLabel(active[0]!)} is alone and there is no trend, so nothing determines its range; ` +
        "give a support radius.",
    );
  }
  return 1; // a translation does not depend on it
}

/** @param given support radius */
function rbfPrepare(
  active: Point[],
  kernel: string,
  given: number,
  trend: string,
  smoothing: number,
  strength: number,
  dim: number,
): Ready {
  const places = active.map((p): Place => {
    const x = strength === 1 ? p.target : placeBetween(p.source, p.target, strength);
    return { point: p, w: p.weight ?? 1, x, d: difference(p.source, x) };
  });
  const ends = places.map((q) => ({ source: q.point.source, target: q.x })),
    limited = [];
  const size = rbfDiameter(rbfAtRest(ends)) || Infinity;
  let radius = given;
  if (RBF_KERNELS[kernel]!.compact && given > LONGEST_SHARE * size) {
    radius = LONGEST_SHARE * size;
    limited.push(
      `the support radius is limited to ${LONGEST_SHARE} times the largest distance between control points; ` +
        "beyond that the map hardly changes",
    );
  }
  const { merged, notes } = rbfMerge(places, radius, Math.min(radius, size), smoothing);
  const n = merged.length;
  const origin = Array.from({ length: dim }, (_, k) => n && merged.reduce((sum, q) => sum + q.x[k]!, 0) / n) as Vector;
  const centred = merged.map((q) => difference(q.x, origin)),
    basis = rbfSpan(centred);
  const { ridge, where } = rbfThinness(merged, basis);
  const [name, remark] = rbfDeterminedTrend(trend, kernel, n, basis.length, where, dim);
  const bent: Pick<Span, "quadrics" | "bend"> = name === "quadratic" ? rbfQuadricSpan(centred, basis, dim) : {};
  const open = bent.bend?.flat().some((value) => value !== 0) ? rbfOpenBend(n, kernel, dim) : [];
  return {
    n,
    merged,
    origin,
    radius,
    basis,
    ridge,
    ...bent,
    trend: name,
    notes: [...limited, ...notes, ...remark, ...open],
    ids: merged.map((q) => q.point.id),
  };
}

/**
 * The penalty of the trend "affine" across a row of points, or in space across a flat set, and its place in words;
 * nothing for wide sets.
 */
function rbfThinness(merged: Place[], basis: number[][]) {
  if (merged.length < 2 || basis.length === 0) return { ridge: null, where: "" };
  const { spreads, directions } = rbfSpreads(
    merged.map((q) => q.x),
    merged.map(rbfSource),
  );
  const wide = spreads.filter((spread) => spread >= THIN).length;
  if (wide === spreads.length) return { ridge: null, where: "" };
  return {
    ridge: rbfWeighted(
      directions,
      spreads.map((spread) => rbfPenalty(spread, THIN)),
    ),
    where: wide === 1 ? "on one line" : "in one plane",
  };
}

/** Unite points at one place, found through a sort along a so that 2000 points take no longer than a few. */
function rbfMerge(places: Place[], radius: number, reach: number, smoothing: number) {
  const near = SAME_PLACE * reach,
    order = places.map((_, k) => k).sort((i, j) => places[i]!.x[0] - places[j]!.x[0]);
  const parent = places.map((_, k) => k);
  const root = (k: number) => {
    let top = k;
    while (parent[top] !== top) {
      parent[top] = parent[parent[top]!]!;
      top = parent[top]!;
    }
    return top;
  };
  const pairs: Vector2[] = [];
  order.forEach((i, at) => {
    for (let next = at + 1; next < order.length; next++) {
      const j = order[next]!,
        p = places[i]!.x,
        q = places[j]!.x;
      if (q[0] - p[0] > near) break;
      if (rbfDistance(p, q) <= near) pairs.push([Math.min(i, j), Math.max(i, j)]);
    }
  });
  if (pairs.length === 0) return { merged: places, notes: [] };
  if (smoothing === 0) rbfRefuseConflicts(places, pairs, radius);
  for (const [i, j] of pairs) parent[root(i)] = root(j);
  const groups: Map<number, Place[]> = new Map();
  for (const [k, q] of places.entries()) {
    const r = root(k),
      group = groups.get(r);
    if (group) group.push(q);
    else groups.set(r, [q]);
  }
  const merged = [],
    notes = [];
  for (const members of groups.values()) {
    // in the order of their first members
    const w = members.reduce((sum, q) => sum + q.w, 0);
    const mean: (key: "x" | "d") => Vector = (key) =>
      mapVector(members[0]![key], (_, k) => members.reduce((sum, q) => sum + q.w * q[key][k]!, 0) / w);
    merged.push({ point: members[0]!.point, w, x: mean("x"), d: mean("d") });
    if (members.length > 1) {
      notes.push(`${members.map((q) => rbfLabel(q.point)).join(", ")} are at one place and count as one`);
    }
  }
  return { merged, notes };
}

function rbfRefuseConflicts(places: Place[], pairs: Vector2[], radius: number) {
  for (const [i, j] of pairs) {
    const p = places[i]!,
      q = places[j]!;
    if (rbfDistance(p.d, q.d) <= SAME_DISPLACEMENT * radius + rbfDistance(p.x, q.x)) continue;
    const [place, one, two] = [p.x, p.d, q.d].map((v) => `(${v.map(rbfFormat).join(", ")})`);
    throw new RbfError(
      `${rbfLabel(p.point)} and ${rbfLabel(q.point)} are at the same place ${place} but require ` +
        `different displacements ${one} and ${two}; move or delete one, or turn smoothing on.`,
    );
  }
}

function rbfFormat(value: number) {
  return String(Number(value.toPrecision(6)));
}

/** The trend that so many points determine, and a remark. */
function rbfDeterminedTrend(
  trend: string,
  kernel: string,
  n: number,
  rank: number,
  where: string,
  dim: number,
): [trend: string, remarks: string[]] {
  if (n === 0 || trend === "none" || trend === "translation") return [trend, []];
  const { order } = RBF_KERNELS[kernel]!;
  if (rank === 0) return [order >= 2 ? trend : "translation", ["one control point: the trend is a translation"]];
  if (!where) return [trend, []];
  if (RBF_TRENDS[trend]!.order < 2) {
    return [
      trend,
      rank === 1 && dim === 3 ? ["the control points lie on one line: the turn about it is the smallest possible"] : [],
    ];
  }
  const lie = `the control points lie nearly ${where}: across it`;
  if (trend !== "affine_exact" && order < 2) return [trend, [`${lie} the affine trend turns and scales as along it`]];
  return [
    trend,
    [
      `${lie} nothing holds the affine trend, which may shear or stretch without bounds; a Wendland ` +
        "kernel with the trend affine stays calm",
    ],
  ];
}

/** A note where n points do not determine all of the quadratic trend. */
function rbfOpenBend(n: number, kernel: string, dim: number) {
  if (n < 2) return [];
  const least = ((dim + 1) * (dim + 2)) / 2;
  const curve = dim === 2 ? "one conic (an ellipse, a hyperbola, two lines)" : "one quadric (an ellipsoid, two planes)";
  const why =
    n < least
      ? `the quadratic trend needs ${least} control points or more, and there are ${n}`
      : `the control points lie nearly on ${curve}`;
  return [
    `${why}: ${
      RBF_KERNELS[kernel]!.order > 2 && n >= least
        ? "the quadratic trend is undetermined off it; the thin-plate kernel would vary less there"
        : "the part of it that they do not determine is left out"
    }`,
  ];
}

function rbfIdentity(ready: Ready, kernel: string, trend: string, support: number): RbfFit {
  const dim = ready.origin.length;
  const centers = Float64Array.from(
    ready.merged.flatMap((q) => q.x.map((value, k) => (value - ready.origin[k]!) / support)),
  );
  const radii = ready.merged.map((q) => q.point.radius ?? ready.radius),
    isOwn = radii.some((r) => r !== ready.radius);
  const scales = isOwn ? Float64Array.from(radii, (r) => ready.radius / r) : null;
  return {
    count: ready.n,
    scales,
    centers,
    coefficients: new Float64Array(dim * ready.n),
    linear: rbfMatrix(dim, () => 0),
    constant: new Array<number>(dim).fill(0) as Vector,
    quadratic: null,
    origin: ready.origin,
    support,
    kernel,
    trend,
    ids: ready.ids,
    notes: ready.notes,
  };
}

function rbfSolvePrepared(ready: Ready, kernel: string, smoothing: number, previous: RbfFit | null): RbfFit {
  const { n, radius: r } = ready;
  const fit = rbfIdentity(ready, kernel, ready.trend, r);
  const d = Float64Array.from(
      ready.merged.flatMap((q) => q.d),
      (value) => value / r,
    ),
    dim = ready.origin.length;
  if (d.every((value) => value === 0)) return fit; // exactly the identity, which a solve would miss by rounding
  const nugget = ready.merged.map((q) => smoothing / q.w);
  const turn = previous === null ? rbfEye(dim) : rbfRotationOf(previous);
  const places = Float64Array.from(ready.merged.flatMap((q) => q.x));
  const radii = fit.scales && ready.merged.map((q) => q.point.radius ?? r);
  const matrix = kernelMatrix({ kernel, radius: r, places, nugget, radii }, RBF_KERNELS[kernel]!.profile);
  const { alpha, linear, constant, quadratic, miss } = rbfSolve(
    matrix,
    fit.centers,
    d,
    ready,
    turn,
    kernel,
    ready.trend,
    radii !== null,
  );
  const largest: (array: Float64Array) => number = (array) =>
    array.reduce((most, value) => (most >= Math.abs(value) || Number.isNaN(most) ? most : Math.abs(value)), 0);
  if (fit.scales && !(largest(alpha) <= MOST_GAIN * largest(d))) {
    throw new RbfError(
      "the individual support radii of these control points are incompatible: the system " +
        `is nearly singular (closest are ${rbfClosest(ready)}). Give neighbours more similar radii, or smaller ones.`,
    );
  }
  const isExact = largest(miss) <= RESIDUAL * largest(d) + ROUNDING * largest(fit.centers);
  if (!isExact && !(largest(miss) <= MOST_MISSED * largest(d))) {
    throw new RbfError(
      `the ${kernel} kernel with support ${rbfFormat(r)} is too flat for these ${n} control points: ` +
        `the system is singular to working precision (closest are ${rbfClosest(ready)}). Use a smaller support, a ` +
        "Wendland kernel, or a little smoothing.",
    );
  }
  const map = linear.map((row, i) => row.map((value, j) => Number(i === j) + value));
  const torn = rbfTornPairs(ready),
    numbers = new Map(ready.merged.map(({ point: { id, number } }) => [id, number]));
  const isTorn = ([i, j]: Vector2) => torn.some(([p, q]) => p === i && q === j);
  const crossed = torn.map(
    ([i, j]) =>
      `control points ${numbers.get(i)} and ${numbers.get(j)} share a source and have different targets: the map folds between them`,
  );
  const solved = {
    ...fit,
    coefficients: alpha.map((value) => value * r),
    linear: rbfTimesNumber(linear, r),
    constant: constant.map((value) => value * r) as Vector,
    quadratic: (quadratic?.map((m) => rbfTimesNumber(m, r)) as RbfFit["quadratic"] | undefined) ?? null,
  };
  crossed.push(
    ...rbfCrossingPairs(ready, map)
      .filter((pair) => !isTorn(pair) && rbfFoldsBetween(solved, pair))
      .map(
        ([i, j]) =>
          `control points ${numbers.get(i)} and ${numbers.get(j)} are pulled past each other: the map folds there`,
      ),
  );
  return {
    ...solved,
    notes: [
      ...ready.notes,
      ...(isExact ? [] : [rbfNearlySingular(ready, miss)]),
      ...crossed,
      ...rbfWarnings(ready, kernel, map),
    ],
  };
}

/**
 * Places on the line from one point to another at which the determinant is computed, as in deformnb.rbf.interpolant.
 */
const BETWEEN = Array.from({ length: 16 }, (_, k) => (k + 0.5) / 16);

/**
 * Whether det(1 + dD/dx) <= 0 somewhere on the straight line between two points.
 * @param pair ids
 */
function rbfFoldsBetween(fit: RbfFit, pair: Vector2) {
  const dim = fit.constant.length;
  const placeOf = (id: number) => {
    const k = fit.ids.indexOf(id);
    return [...fit.centers.subarray(dim * k, dim * (k + 1))] as Vector;
  };
  const p = placeOf(pair[0]),
    q = placeOf(pair[1]);
  return BETWEEN.some((t) => !(rbfDeterminant(rbfMapDerivative(fit, placeBetween(p, q, t))) > 0));
}

/** 1 + dD/dx at a place in relative coordinates, in a plane or in space. */
function rbfMapDerivative(fit: RbfFit, place: number[]) {
  const { centers: x, coefficients: alpha, count, scales, linear, quadratic, support } = fit,
    dim = place.length;
  const slope = RBF_KERNELS[fit.kernel]!.slope,
    away = new Float64Array(dim),
    out = new Float64Array(dim * dim);
  for (let m = 0; m < dim; m++) {
    for (let k = 0; k < dim; k++) {
      out[m * dim + k] = linear[m]![k]! + (quadratic ? 2 * rbfDot(quadratic[m]![k]!, place) : 0);
    }
  }
  for (let c = 0, j = 0; c < count; c++, j += dim) {
    const w = scales ? scales[c]! * scales[c]! : 1;
    let square = 0;
    for (let k = 0; k < dim; k++) {
      const step = place[k]! - x[j + k]!;
      away[k] = step;
      square += step * step;
    }
    const g = 2 * w * slope(square * w);
    if (g === 0) continue;
    for (let m = 0; m < dim; m++) {
      const pull = alpha[j + m]! * g;
      for (let k = 0; k < dim; k++) out[m * dim + k]! += pull * away[k]!;
    }
  }
  return rbfMatrix(dim, (m, k) => Number(m === k) + out[m * dim + k]! / support);
}

/** The determinant of a matrix of 2 or 3 rows. */
function rbfDeterminant([a, b, c]: Matrix) {
  return c ? rbfDot(a, rbfCross(b, c)) : a[0] * b[1] - a[1] * b[0];
}

function rbfNearlySingular(ready: Ready, miss: Float64Array) {
  const {
    n,
    radius,
    origin: { length: dim },
  } = ready;
  const lengths = Array.from({ length: n }, (_, k) => Math.hypot(...miss.subarray(k * dim, (k + 1) * dim)));
  const most = radius * Math.max(...lengths);
  return (
    `the system is nearly singular (closest are ${rbfClosest(ready)}): the map misses its targets by up to ` +
    `${Number(most.toPrecision(1))}; a smaller support, a Wendland kernel or a little smoothing would not`
  );
}

// ---- evaluation -----------------------------------------------------------------------------------------------------

/** The backward displacement at a place of the picture. */
export function rbfAt(fit: RbfFit, a: number, b: number): Vector2 {
  const r = fit.support,
    p = (a - fit.origin[0]) / r,
    q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const profile = RBF_KERNELS[fit.kernel]!.profile;
  let u = linear[0][0] * p + linear[0][1] * q + constant[0],
    v = linear[1][0] * p + linear[1][1] * q + constant[1];
  if (fit.quadratic) {
    u += rbfQuadraticAt(fit.quadratic[0], [p, q]);
    v += rbfQuadraticAt(fit.quadratic[1], [p, q]);
  }
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      s = dp * dp + dq * dq;
    const phi = profile(scales ? s * scales[k]! * scales[k]! : s);
    u += alpha[j]! * phi;
    v += alpha[j + 1]! * phi;
  }
  return [u, v];
}

/**
 * The value of a quadratic form.
 * @param h symmetric
 */
export function rbfQuadraticAt(h: Matrix, place: number[]) {
  return place.reduce((sum, p, i) => sum + p * rbfDot(h[i]!, place), 0);
}

/** The derivative of the trend at a place in relative coordinates. */
export function rbfLinearAt({ quadratic, linear }: RbfFit, p: number, q: number): Matrix {
  if (!quadratic) return linear;
  return mapMatrix(linear, (value, m, k) => {
    const form = quadratic[m]![k]!;
    return value + 2 * (form[0] * p + form[1] * q);
  });
}

/** [[dDa/da, dDa/db], [dDb/da, dDb/db]] at a place. */
export function rbfJacobianAt(fit: RbfFit, a: number, b: number): Matrix2 {
  const r = fit.support,
    p = (a - fit.origin[0]) / r,
    q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, count, scales } = fit,
    slope = RBF_KERNELS[fit.kernel]!.slope;
  let [[m00, m01], [m10, m11]] = rbfLinearAt(fit, p, q);
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      w = scales ? scales[k]! * scales[k]! : 1;
    const g = 2 * w * slope((dp * dp + dq * dq) * w);
    m00 += alpha[j]! * g * dp;
    m01 += alpha[j]! * g * dq;
    m10 += alpha[j + 1]! * g * dp;
    m11 += alpha[j + 1]! * g * dq;
  }
  return [
    [m00 / r, m01 / r],
    [m10 / r, m11 / r],
  ];
}

/** Displacements at the pixels of a raster, nv * nu * 2 numbers with the component last. */
export function rbfOnRaster(
  fit: RbfFit,
  { shape: [nv, nu], spacing: [du, dv], origin: [a, b] }: Raster,
  out: Float32Array | null = null,
) {
  const map = out ?? new Float32Array(nv * nu * 2),
    row = new RbfRow(fit, a, du, nu);
  for (let i = 0; i < nv; i++) row.evaluate([b + i * dv], map, 2 * nu * i);
  return map;
}

/**
 * Displacements at the nodes of a lattice in space, nz * ny * nx * 3 numbers with the component last.
 * @param fit of dimension 3
 */
export function rbfOnLattice(fit: RbfFit, { shape: [nx, ny, nz], spacing: [dx, dy, dz], origin: [x, y, z] }: Lattice) {
  const map = new Float32Array(nx * ny * nz * 3),
    row = new RbfRow(fit, x, dx, nx);
  for (let k = 0, at = 0; k < nz; k++) {
    for (let j = 0; j < ny; j++, at += 3 * nx) row.evaluate([y + j * dy, z + k * dz], map, at);
  }
  return map;
}

/**
 * Displacements along a row of places, from a first coordinate on. One centre after the other, and for compact kernels
 * only the places that it reaches: the distance across the row is constant.
 */
class RbfRow {
  step: number;
  first: number;
  sums: Float64Array<ArrayBuffer>[];
  moving: number[];

  constructor(
    readonly fit: RbfFit,
    first: number,
    step: number,
    count: number,
  ) {
    this.step = step / fit.support;
    this.first = (first - fit.origin[0]) / fit.support;
    this.sums = Array.from({ length: 3 }, () => new Float64Array(count)); // of each component; in a plane the last is idle
    const dim = fit.constant.length,
      isMoving = (c: number) => fit.coefficients.subarray(dim * c, dim * (c + 1)).some((value) => value !== 0);
    this.moving = Array.from({ length: fit.count }, (_, c) => c).filter(isMoving); // centres
  }

  /** @param across the other coordinates */
  evaluate(across: number[], out: Float32Array, at: number) {
    const { fit, step, first: p0, moving, sums } = this,
      { support, origin, centers: x, coefficients: alpha, scales } = fit;
    const place = [0, ...across.map((value, k) => (value - origin[k + 1]!) / support)],
      [, q = 0, r = 0] = place;
    const dim = place.length,
      [us, vs, ws] = sums as [Float64Array<ArrayBuffer>, Float64Array<ArrayBuffer>, Float64Array<ArrayBuffer>],
      { length } = us,
      { profile, compact } = RBF_KERNELS[fit.kernel]!;
    this.#trend(place);
    for (const c of moving) {
      const j = dim * c,
        w = scales ? scales[c]! * scales[c]! : 1;
      const d2 = (q - x[j + 1]!) ** 2 + (dim > 2 ? (r - x[j + 2]!) ** 2 : 0);
      if (compact && d2 * w >= 1) continue;
      const reach = compact ? Math.sqrt(1 / w - d2) : Infinity,
        middle = x[j]! - p0;
      const first = Math.max(0, Math.ceil((middle - reach) / step));
      const last = Math.min(length - 1, Math.floor((middle + reach) / step));
      const au = alpha[j]!,
        av = alpha[j + 1]!,
        aw = dim > 2 ? alpha[j + 2]! : 0;
      for (let k = first; k <= last; k++) {
        const dp = k * step - middle,
          phi = profile((dp * dp + d2) * w);
        us[k]! += au * phi;
        vs[k]! += av * phi;
        ws[k]! += aw * phi;
      }
    }
    for (let m = 0; m < dim; m++) for (let k = 0, n = at + m; k < length; k++, n += dim) out[n] = sums[m]![k]!;
  }

  /**
   * Begin with the trend.
   * @param place relative coordinates; the first one is set here
   */
  #trend(place: number[]) {
    const {
      fit: { linear, constant, quadratic },
      first,
      step,
      sums,
    } = this;
    for (const [m, [along, ...across]] of linear.entries()) {
      const sum = sums[m]!,
        rest = across.reduce((value, a, k) => value + a * place[k + 1]!, constant[m]!);
      for (let k = 0; k < sum.length; k++) sum[k] = along * (first + k * step) + rest;
      if (!quadratic) continue;
      for (let k = 0; k < sum.length; k++) {
        place[0] = first + k * step;
        sum[k]! += rbfQuadraticAt(quadratic[m]!, place);
      }
    }
  }
}
