// The fit of control points on a picture, equal to deformnb.rbf.fitting.fit_rbf for dimension 2. All arithmetic is
// in float64, as in the package; a test compares the two for every kernel and trend.

import {
  COLLAPSED, FAR_BEHIND, FLAT, LARGEST_COORDINATE, LARGEST_SET, LEAST_SPREAD, LONGEST_SHARE, MANY, MOST_GAIN,
  MOST_NEIGHBOURS, NO_ANGLE, RESIDUAL, ROUNDING, SAME_DISPLACEMENT, SAME_PLACE, SOFTNESS, STEEP, THIN, THIN_BEND, TINY,
} from "./constants.js";
import { kernelMatrix } from "./kernel_matrix.js";
import { kernelOfTable } from "./kernel_table.js";

/** @import { FitSettings, KernelTable, Point, Raster, RbfFit, Vector2 } from "../types.d.ts" */

/**
 * share: of the box's diagonal that the usual support is; gaps: the longest one beside points in a row, in gaps;
 * profile(s) and slope(s) = d profile / d s of the squared relative distance s, as in deformnb.rbf.kernels.
 * @typedef {{ title: string, order: number, compact: boolean, share: number, gaps: number,
 *   profile: (s: number) => number, slope: (s: number) => number }} Kernel
 *
 * The directions that the points determine of a linear map, as in deformnb.rbf.trends.Span.
 * For the trend "quadratic" quadrics are the combinations of products of two coordinates that they determine, and bend
 * is the penalty of the rest.
 * @typedef {{ basis: number[][], ridge: number[][] | null, quadrics?: number[][], bend?: number[][] }} Span
 *
 * A control point with its weight, its target x and its displacement d.
 * @typedef {{ point: Point, w: number, x: number[], d: number[] }} Place
 *
 * Points made ready for a solve.
 * @typedef {Span & { n: number, merged: Place[], origin: number[], radius: number, trend: string, notes: string[],
 *   ids: number[] }} Ready
 */

// ---- linear algebra: deformnb.rbf.interpolant.solve and deformnb.rbf.trends, dense ---------------------------------
// Matrices of n rows and m columns are Float64Array of n * m, row by row; matrices of 2 x 2 are nested lists.

/**
 * alpha (n x 2), A (2 x 2), t (2) and the residual of relative targets x and displacements d (both n x 2).
 * @param {ReturnType<typeof kernelMatrix>} matrix
 * @param {Float64Array} x
 * @param {Float64Array} d
 * @param {Span} span
 * @param {number[][]} turn  the rotation where the points determine none
 * @param {string} kernel
 * @param {string} trend
 * @param {boolean} isSkew  the matrix is not symmetric: points have support radii of their own
 */
function rbfSolve(matrix, x, d, span, turn, kernel, trend, isSkew) {
  const { n, phi } = matrix;
  const { order } = RBF_KERNELS[kernel], whole = d, isBent = trend === "quadratic";
  const q = isBent ? rbfProducts(x) : new Float64Array(0);
  /** @type {number[][] | null} */
  let bent = null;
  if (isBent && order < 3) {
    bent = rbfQuadraticPart(phi, x, d, q, span, isSkew);
    d = rbfWithout(d, q, bent);
    trend = "affine";
  }
  /** @type {{ alpha: Float64Array, linear: number[][], constant: number[], bent?: number[][] | null }} */
  let solved;
  if (isSkew) solved = rbfLeastSquares(phi, x, d, span, turn, trend);
  else if (order === 3) {
    solved = rbfBorderedTrend(phi, x, d, span.basis, q, span.quadrics ?? []);
    bent = solved.bent ?? null;
  } else if (order === 2) solved = rbfBorderedTrend(phi, x, d, span.basis);
  else if (trend === "none") {
    solved = { alpha: matrix.solve(d, 2), linear: [[0, 0], [0, 0]], constant: [0, 0] };
  } else solved = rbfLeastEnergy(matrix, x, d, span, turn, kernel, trend);
  const { alpha, linear, constant } = solved, miss = new Float64Array(2 * n);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) {
      let sum = x[2 * i] * linear[k][0] + x[2 * i + 1] * linear[k][1] + constant[k] - whole[2 * i + k];
      if (bent) for (let j = 0; j < 3; j++) sum += q[3 * i + j] * bent[j][k];
      for (let j = 0; j < n; j++) sum += phi[i * n + j] * alpha[2 * j + k];
      miss[2 * i + k] = sum;
    }
  }
  return { ...solved, miss, quadratic: bent && rbfQuadraticForms(bent) };
}

// ---- the quadratic trend: products of two coordinates, a^2, b^2 and sqrt(2) a b -------------------------------------

/** @param {Float64Array} x  n x 2; n x 3 products come back */
function rbfProducts(x) {
  const out = new Float64Array(1.5 * x.length);
  for (let i = 0, j = 0; i < x.length; i += 2, j += 3) {
    out[j] = x[i] * x[i];
    out[j + 1] = x[i + 1] * x[i + 1];
    out[j + 2] = Math.SQRT2 * x[i] * x[i + 1];
  }
  return out;
}

/** The symmetric matrices of both components. @param {number[][]} c  3 x 2 */
function rbfQuadraticForms(c) {
  return [0, 1].map((m) => [[c[0][m], Math.SQRT1_2 * c[2][m]], [Math.SQRT1_2 * c[2][m], c[1][m]]]);
}

/** Displacements without their quadratic part. @param {Float64Array} d @param {Float64Array} q @param {number[][]} c */
function rbfWithout(d, q, c) {
  return Float64Array.from(d, (value, i) => {
    const m = i % 2, j = 3 * (i - m) / 2;
    return value - q[j] * c[0][m] - q[j + 1] * c[1][m] - q[j + 2] * c[2][m];
  });
}

/**
 * Factors (3 x 2) of the products of least energy beside all affine maps, as deformnb.rbf.interpolant has them.
 * @param {Float64Array} phi
 * @param {Float64Array} x
 * @param {Float64Array} d
 * @param {Float64Array} q
 * @param {Span} span
 * @param {boolean} isSkew  the matrix is not symmetric: by plain least squares
 */
function rbfQuadraticPart(phi, x, d, q, span, isSkew) {
  const n = x.length / 2, width = span.basis.length + 1, p = rbfAffineColumns(x, span.basis);
  const both = new Float64Array(5 * (n + width));
  for (let i = 0; i < n; i++) both.set([q[3 * i], q[3 * i + 1], q[3 * i + 2], d[2 * i], d[2 * i + 1]], 5 * i);
  const w = isSkew ? rbfProjected(p, both, n, width, 5)
    : rbfFactored(rbfBordered(phi, p, n, width), n + width)(both, 5);
  const s = new Float64Array(9), h = new Float64Array(6);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 3; k++) {
      for (let j = 0; j < 3; j++) s[3 * k + j] += q[3 * i + k] * w[5 * i + j];
      for (let m = 0; m < 2; m++) h[2 * k + m] += q[3 * i + k] * w[5 * i + 3 + m];
    }
  }
  const trace = s[0] + s[4] + s[8], size = trace > 0 ? trace : 1;
  span.bend?.flat().forEach((value, k) => { s[k] += size * value; });
  const c = rbfFactored(s, 3)(h, 2);
  return [0, 1, 2].map((k) => [c[2 * k], c[2 * k + 1]]);
}

/** (1, x on the span of the points), n x (1 + rank). @param {Float64Array} x @param {number[][]} basis */
function rbfAffineColumns(x, basis) {
  const n = x.length / 2, width = basis.length + 1, p = new Float64Array(n * width);
  for (let i = 0; i < n; i++) {
    p[i * width] = 1;
    basis.forEach((e, k) => { p[i * width + 1 + k] = x[2 * i] * e[0] + x[2 * i + 1] * e[1]; });
  }
  return p;
}

/**
 * What columns p (n x r) leave of columns b (n x m), by Gram-Schmidt, twice.
 * @param {Float64Array} p
 * @param {Float64Array} b
 * @param {number} n
 * @param {number} r
 * @param {number} m
 */
function rbfProjected(p, b, n, r, m) {
  const e = Float64Array.from(p), out = b.slice(0, n * m);
  /** @type {(a: Float64Array, wa: number, k: number, f: Float64Array, wf: number, j: number) => void} */
  const remove = (a, wa, k, f, wf, j) => {
    let dot = 0;
    for (let i = 0; i < n; i++) dot += a[i * wa + k] * f[i * wf + j];
    for (let i = 0; i < n; i++) a[i * wa + k] -= dot * f[i * wf + j];
  };
  for (let k = 0; k < r; k++) {
    for (let twice = 0; twice < 2; twice++) for (let j = 0; j < k; j++) remove(e, r, k, e, r, j);
    let size = 0;
    for (let i = 0; i < n; i++) size += e[i * r + k] ** 2;
    for (let i = 0; i < n; i++) e[i * r + k] /= Math.sqrt(size) || 1;
  }
  for (let k = 0; k < m; k++) {
    for (let twice = 0; twice < 2; twice++) for (let j = 0; j < r; j++) remove(out, m, k, e, r, j);
  }
  return out;
}

/**
 * The part of the products that centred points determine beside affine maps: deformnb.rbf.trends.quadric_span.
 * @param {number[][]} rows
 * @param {number[][]} basis
 */
function rbfQuadricSpan(rows, basis) {
  const n = rows.length, size = rows.reduce((m, p) => Math.max(m, Math.abs(p[0]), Math.abs(p[1])), 0) || 1;
  const x = Float64Array.from(rows.flatMap((p) => [p[0] / size, p[1] / size])), q = rbfProducts(x);
  const rest = rbfProjected(rbfAffineColumns(x, basis), q, n, basis.length + 1, 3);
  const { sigma, directions } = rbfSingular([0, 1, 2].map((k) => rows.map((_, i) => rest[3 * i + k])));
  const eye = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  if (!(sigma[0] > FLAT * q.reduce((m, value) => Math.max(m, Math.abs(value)), 1))) return { quadrics: [], bend: eye };
  const spreads = sigma.map((value) => value / sigma[0]), weights = spreads.map((value) => rbfPenalty(value, THIN_BEND));
  return { quadrics: directions.filter((_, k) => spreads[k] > FLAT),
    bend: eye.map((_, i) => eye.map((__, j) => weights.reduce((sum, w, k) => sum + w * directions[k][i] *
      directions[k][j], 0))) };
}

/** The penalty of a direction with this spread. @param {number} spread @param {number} limit */
function rbfPenalty(spread, limit) {
  const s = Math.max(spread, LEAST_SPREAD);
  return s < limit ? ((limit - s) / s) ** 2 / SOFTNESS : 0;
}

/**
 * Solver of a general square system, factored once with partial pivoting.
 * @param {Float64Array} matrix
 * @param {number} n
 * @returns {(rhs: Float64Array, m: number) => Float64Array}
 */
function rbfFactored(matrix, n) {
  const a = Float64Array.from(matrix), order = Array.from({ length: n }, (_, k) => k);
  for (let c = 0; c < n; c++) {
    let pivot = c;
    for (let i = c + 1; i < n; i++) if (Math.abs(a[i * n + c]) > Math.abs(a[pivot * n + c])) pivot = i;
    if (pivot !== c) {
      for (let k = 0; k < n; k++) [a[c * n + k], a[pivot * n + k]] = [a[pivot * n + k], a[c * n + k]];
      [order[c], order[pivot]] = [order[pivot], order[c]];
    }
    for (let i = c + 1; i < n; i++) {
      const f = a[i * n + c] / a[c * n + c];
      a[i * n + c] = f;
      if (f !== 0) for (let k = c + 1; k < n; k++) a[i * n + k] -= f * a[c * n + k];
    }
  }
  return (rhs, m) => {
    const out = new Float64Array(n * m);
    for (let c = 0; c < m; c++) {
      for (let i = 0; i < n; i++) {
        let sum = rhs[order[i] * m + c];
        for (let k = 0; k < i; k++) sum -= a[i * n + k] * out[k * m + c];
        out[i * m + c] = sum;
      }
      for (let i = n - 1; i >= 0; i--) {
        let sum = out[i * m + c];
        for (let k = i + 1; k < n; k++) sum -= a[i * n + k] * out[k * m + c];
        out[i * m + c] = sum / a[i * n + i];
      }
    }
    return out;
  };
}

/**
 * [Phi P; P^T 0] with the n x r matrix P.
 * @param {Float64Array} phi
 * @param {Float64Array} p
 * @param {number} n
 * @param {number} r
 */
function rbfBordered(phi, p, n, r) {
  const size = n + r, out = new Float64Array(size * size);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < n; j++) out[i * size + j] = phi[i * n + j];
    for (let k = 0; k < r; k++) out[i * size + n + k] = out[(n + k) * size + i] = p[i * r + k];
  }
  return out;
}

/**
 * The trend of least energy.
 * @param {ReturnType<typeof kernelMatrix>} matrix
 * @param {Float64Array} x
 * @param {Float64Array} d
 * @param {Span} span
 * @param {number[][]} turn
 * @param {string} kernel
 * @param {string} trend
 */
function rbfLeastEnergy(matrix, x, d, span, turn, kernel, trend) {
  const { n, phi } = matrix, w = new Float64Array(n * 4), mean = [0, 0, 0, 0];
  if (RBF_KERNELS[kernel].order === 0) {
    const rhs = new Float64Array(n * 5);
    for (let i = 0; i < n; i++) rhs.set([1, x[2 * i], x[2 * i + 1], d[2 * i], d[2 * i + 1]], 5 * i);
    const v = matrix.solve(rhs, 5);
    const sums = [0, 0, 0, 0, 0];
    for (let i = 0; i < n; i++) for (let k = 0; k < 5; k++) sums[k] += v[5 * i + k];
    for (let k = 0; k < 4; k++) {
      mean[k] = sums[k + 1] / sums[0];
      for (let i = 0; i < n; i++) w[4 * i + k] = v[5 * i + k + 1] - v[5 * i] * mean[k];
    }
  } else { // Phi is not definite: only the bordered system is well posed
    const rhs = new Float64Array((n + 1) * 4);
    for (let i = 0; i < n; i++) rhs.set([x[2 * i], x[2 * i + 1], d[2 * i], d[2 * i + 1]], 4 * i);
    const v = rbfFactored(rbfBordered(phi, new Float64Array(n).fill(1), n, 1), n + 1)(rhs, 4);
    w.set(v.subarray(0, 4 * n));
    for (let k = 0; k < 4; k++) mean[k] = v[4 * n + k];
  }
  const s = [[0, 0], [0, 0]], h = [[0, 0], [0, 0]];
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) {
      for (let j = 0; j < 2; j++) {
        s[k][j] += x[2 * i + k] * w[4 * i + j];
        h[k][j] += (x[2 * i + k] + d[2 * i + k]) * w[4 * i + j];
      }
    }
  }
  if (trend === "affine" && span.ridge) rbfSteady(s, h, rbfPlainMoments(x, d), span.ridge);
  const m = rbfTrendMap(s, h, span, turn, trend), linear = [[m[0][0] - 1, m[0][1]], [m[1][0], m[1][1] - 1]];
  const alpha = new Float64Array(2 * n);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) {
      alpha[2 * i + k] = w[4 * i + 2 + k] - linear[k][0] * w[4 * i] - linear[k][1] * w[4 * i + 1];
    }
  }
  return { alpha, linear, constant: [0, 1].map((k) => mean[2 + k] - linear[k][0] * mean[0] - linear[k][1] * mean[1]) };
}

/** Means and second moments in which all points count alike. @param {Float64Array} x @param {Float64Array} d */
function rbfPlainMoments(x, d) {
  const n = x.length / 2, mean = [0, 0, 0, 0], s = [[0, 0], [0, 0]], h = [[0, 0], [0, 0]];
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) { mean[k] += x[2 * i + k] / n; mean[2 + k] += d[2 * i + k] / n; }
  }
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) {
      for (let j = 0; j < 2; j++) {
        const c = x[2 * i + j] - mean[j], p = x[2 * i + k] - mean[k];
        s[k][j] += p * c;
        h[k][j] += (p + d[2 * i + k] - mean[2 + k]) * c;
      }
    }
  }
  return { mean, s, h };
}

/**
 * Add the plain moments as much as the points are thin: the energy of a row is that of its small wiggles.
 * @param {number[][]} s
 * @param {number[][]} h
 * @param {{ s: number[][], h: number[][] }} plain
 * @param {number[][]} ridge
 */
function rbfSteady(s, h, plain, ridge) {
  const share = Math.max(...ridge.flat().map(Math.abs));
  const weight = 1 / (s[0][0] + s[1][1]), other = share / (plain.s[0][0] + plain.s[1][1]);
  for (let i = 0; i < 2; i++) {
    for (let j = 0; j < 2; j++) {
      s[i][j] = weight * s[i][j] + other * plain.s[i][j];
      h[i][j] = weight * h[i][j] + other * plain.h[i][j];
    }
  }
}

/**
 * For a matrix that is not symmetric: the trend of least squares, and Phi alpha = the rest.
 * @param {Float64Array} phi
 * @param {Float64Array} x
 * @param {Float64Array} d
 * @param {Span} span
 * @param {number[][]} turn
 * @param {string} trend
 */
function rbfLeastSquares(phi, x, d, span, turn, trend) {
  let linear = [[0, 0], [0, 0]], constant = [0, 0];
  if (trend !== "none") {
    const { mean, s, h } = rbfPlainMoments(x, d), m = rbfTrendMap(s, h, span, turn, trend);
    linear = [[m[0][0] - 1, m[0][1]], [m[1][0], m[1][1] - 1]];
    constant = [0, 1].map((k) => mean[2 + k] - linear[k][0] * mean[0] - linear[k][1] * mean[1]);
  }
  const left = Float64Array.from(d, (value, i) => value - constant[i % 2] - linear[i % 2][0] * x[i - (i % 2)] -
    linear[i % 2][1] * x[i - (i % 2) + 1]);
  return { alpha: rbfFactored(phi, x.length / 2)(left, 2), linear, constant };
}

/**
 * The linear map of a trend from second moments.
 * @param {number[][]} s
 * @param {number[][]} h
 * @param {Span} span
 * @param {number[][]} turn
 * @param {string} trend
 */
function rbfTrendMap(s, h, { basis, ridge }, turn, trend) {
  if (trend === "translation") return [[1, 0], [0, 1]];
  const size = s[0][0] + s[1][1];
  if (trend === "affine_exact" || (trend === "affine" && !ridge)) {
    return rbfComplete(rbfAffineImages(s, h, basis), basis);
  }
  const rotation = rbfNearestRotation(h, size, turn);
  if (trend === "rigid") return rotation;
  let scale = 0;
  for (let i = 0; i < 2; i++) for (let j = 0; j < 2; j++) scale += rotation[i][j] * h[i][j];
  scale = Math.max(scale / size, 0);
  const similar = rotation.map((row) => row.map((value) => scale * value));
  if (trend === "similarity" || !ridge) return similar;
  // G + (H - G S) (S + tr(S) ridge)^-1: the similarity, corrected where the points determine more
  const rest = h.map((row, i) => row.map((value, j) => value - similar[i][0] * s[0][j] - similar[i][1] * s[1][j]));
  const held = s.map((row, i) => row.map((value, j) => value + size * ridge[i][j]));
  const images = rbfAffineImages(held, rest, [[1, 0], [0, 1]]);
  return similar.map((row, i) => row.map((value, j) => value + images[j][i]));
}

/**
 * The images of the directions of the basis under the affine trend of least energy.
 * @param {number[][]} s
 * @param {number[][]} h
 * @param {number[][]} basis
 */
function rbfAffineImages(s, h, basis) {
  /** @type {(m: number[][], p: number[], q: number[]) => number} */
  const quadratic = (m, p, q) => p[0] * (m[0][0] * q[0] + m[0][1] * q[1]) + p[1] * (m[1][0] * q[0] + m[1][1] * q[1]);
  const rank = basis.length, small = new Float64Array(rank * rank), rhs = new Float64Array(rank * 2);
  for (let i = 0; i < rank; i++) {
    for (let j = 0; j < rank; j++) small[i * rank + j] = quadratic(s, basis[i], basis[j]);
    for (let k = 0; k < 2; k++) rhs[2 * i + k] = basis[i][0] * h[k][0] + basis[i][1] * h[k][1];
  }
  const images = rbfFactored(small, rank)(rhs, 2);
  return basis.map((_, i) => [images[2 * i], images[2 * i + 1]]);
}

/**
 * The linear map of the directions of the basis to the images, which rotates and scales the direction across with them.
 * @param {number[][]} images
 * @param {number[][]} basis
 */
function rbfComplete(images, basis) {
  if (basis.length === 0) return [[1, 0], [0, 1]];
  /** @type {(p: number[], q: number[]) => number[][]} */
  const outer = (p, q) => [[p[0] * q[0], p[0] * q[1]], [p[1] * q[0], p[1] * q[1]]];
  /** @type {(p: number[]) => number[]} */
  const quarter = (p) => [-p[1], p[0]];
  const first = outer(images[0], basis[0]);
  const other = basis.length === 2 ? outer(images[1], basis[1]) : outer(quarter(images[0]), quarter(basis[0]));
  return first.map((row, i) => row.map((value, j) => value + other[i][j]));
}

/** @param {number[][]} h @param {number} size @param {number[][]} previous  where there is none */
function rbfNearestRotation(h, size, previous) {
  const least = NO_ANGLE * Math.max(size, Math.hypot(h[0][0], h[0][1], h[1][0], h[1][1]));
  const c = h[0][0] + h[1][1], s = h[1][0] - h[0][1], length = Math.hypot(c, s);
  return length > least ? [[c / length, -s / length], [s / length, c / length]] : previous;
}

/**
 * The solution of the bordered system with an affine trend on the span of the points, and with the combinations of
 * products q that they determine.
 * @param {Float64Array} phi
 * @param {Float64Array} x
 * @param {Float64Array} d
 * @param {number[][]} basis
 * @param {Float64Array | null} [q]  n x 3
 * @param {number[][]} [quadrics]
 */
function rbfBorderedTrend(phi, x, d, basis, q = null, quadrics = []) {
  const n = x.length / 2, rank = basis.length, affine = rank + 1, width = affine + quadrics.length;
  const first = rbfAffineColumns(x, basis), p = new Float64Array(n * width);
  for (let i = 0; i < n; i++) {
    p.set(first.subarray(i * affine, (i + 1) * affine), i * width);
    if (q) quadrics.forEach((e, k) => { p[i * width + affine + k] = rbfDot3(e, q, 3 * i); });
  }
  const factored = rbfFactored(rbfBordered(phi, p, n, width), n + width);
  const solve = (/** @type {Float64Array} */ b) => {
    const rhs = new Float64Array(2 * (n + width));
    rhs.set(b);
    const v = factored(rhs, 2);
    const bent = [0, 1, 2].map((j) => [0, 1].map(
      (m) => quadrics.reduce((sum, e, k) => sum + e[j] * v[2 * (n + affine + k) + m], 0)));
    return { alpha: v.slice(0, 2 * n), constant: [v[2 * n], v[2 * n + 1]], bent: q ? bent : null,
      images: basis.map((_, k) => [v[2 * (n + 1 + k)], v[2 * (n + 1 + k) + 1]]) };
  };
  // D on the span of the points: sum of image (outer) direction
  /** @type {(images: number[][]) => number[][]} */
  const spanned = (images) => [0, 1].map((i) => [0, 1].map(
    (j) => images.reduce((sum, image, k) => sum + image[i] * basis[k][j], 0)));
  const whole = solve(d);
  if (rank === 2) return { ...whole, linear: spanned(whole.images) };
  const m = rbfComplete(whole.images.map((image, k) => [basis[k][0] + image[0], basis[k][1] + image[1]]), basis);
  const linear = [[m[0][0] - 1, m[0][1]], [m[1][0], m[1][1] - 1]];
  // Points that are flat only to rounding lie a little off their span, where the completed map displaces them too.
  const left = Float64Array.from(q && whole.bent ? rbfWithout(d, q, whole.bent) : d, (value, i) => {
    const k = i - (i % 2);
    return value - linear[i % 2][0] * x[k] - linear[i % 2][1] * x[k + 1];
  });
  const rest = solve(left), more = spanned(rest.images);
  return { alpha: rest.alpha, constant: rest.constant,
    bent: whole.bent?.map((row, j) => row.map((value, m) => value + (rest.bent?.[j][m] ?? 0))),
    linear: linear.map((row, i) => row.map((value, j) => value + more[i][j])) };
}

/** @param {number[]} e @param {Float64Array} q @param {number} at */
function rbfDot3(e, q, at) {
  return e[0] * q[at] + e[1] * q[at + 1] + e[2] * q[at + 2];
}

/** Orthonormal directions that span centred points. @param {number[][]} rows */
function rbfSpan(rows) {
  if (rows.length < 2) return [];
  const { sigma, along } = rbfPrincipal(rows);
  if (sigma[0] === 0) return [];
  return sigma[1] > FLAT * sigma[0] ? [[1, 0], [0, 1]] : [along];
}

/**
 * Singular values of rows of two numbers, falling, and the direction of the first.
 * @param {number[][]} rows
 */
function rbfPrincipal(rows) {
  const { sigma, directions } = rbfSingular([rows.map((r) => r[0]), rows.map((r) => r[1])]);
  return { sigma, along: directions[0] };
}

/**
 * Singular values of the columns of a matrix, falling, and their directions: by one-sided Jacobi, exact to rounding.
 * @param {number[][]} columns
 */
function rbfSingular(columns) {
  const count = columns.length, a = [...columns], v = a.map((_, k) => a.map((__, j) => Number(j === k)));
  /** @type {(p: number[], q: number[]) => number} */
  const dot = (p, q) => p.reduce((sum, value, k) => sum + value * q[k], 0);
  for (let sweep = 0, isDone = false; sweep < 8 * (count - 1) && !isDone; sweep++) {
    isDone = true;
    for (let i = 0; i < count; i++) {
      for (let j = i + 1; j < count; j++) {
        const gamma = dot(a[i], a[j]);
        if (gamma === 0) continue;
        isDone = false;
        const zeta = (dot(a[j], a[j]) - dot(a[i], a[i])) / (2 * gamma);
        const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.hypot(1, zeta));
        const c = 1 / Math.hypot(1, t), s = c * t;
        for (const m of [a, v]) {
          const p = m[i], q = m[j];
          m[i] = p.map((value, k) => c * value - s * q[k]);
          m[j] = p.map((value, k) => s * value + c * q[k]);
        }
      }
    }
  }
  const sizes = a.map((p) => Math.hypot(...p)), order = sizes.map((_, k) => k).sort((i, j) => sizes[j] - sizes[i] || i - j);
  return { sigma: order.map((k) => sizes[k]), directions: order.map((k) => v[k]) };
}

/**
 * The spread of places across their longest direction, relative to it, in the thinner of two sets:
 * deformnb.rbf.trends.thin_directions in the plane.
 * @param {number[][]} targets
 * @param {number[][]} sources
 */
function rbfSpreads(targets, sources) {
  const [x, y] = [targets, sources].map(rbfScaled);
  /** @type {(p: number[][], q: number[][]) => number[][]} */
  const moments = (p, q) => [0, 1].map((i) => [0, 1].map((j) => p.reduce((sum, row, k) => sum + row[i] * q[k][j], 0)));
  const xx = moments(x, x), yy = moments(y, y), yx = moments(y, x);
  const least = 2e-9 * Math.sqrt((xx[0][0] + xx[1][1]) * (yy[0][0] + yy[1][1]));
  const c = yx[0][0] + yx[1][1] + least, s = yx[1][0] - yx[0][1], length = Math.hypot(c, s) || 1;
  const back = y.map(([p, q]) => [(c * p + s * q) / length, (c * q - s * p) / length]);
  const a = rbfRelative(moments(x, x));
  const b = yy[0][0] + yy[1][1] > 0 ? rbfRelative(moments(back, back)) : a, tiny = 1e-12;
  // 2 A (A + B)^-1 B
  const p = a[0][0] + b[0][0] + 2 * tiny, q = a[0][1] + b[0][1], r = a[1][1] + b[1][1] + 2 * tiny, det = p * r - q * q;
  const inverse = [[r / det, -q / det], [-q / det, p / det]];
  /** @type {(m: number[][], k: number[][]) => number[][]} */
  const times = (m, k) => [0, 1].map((i) => [0, 1].map((j) => m[i][0] * k[0][j] + m[i][1] * k[1][j]));
  /** @type {(m: number[][]) => number[][]} */
  const more = (m) => [[m[0][0] + tiny, m[0][1]], [m[1][0], m[1][1] + tiny]];
  const both = times(times(more(a), inverse), more(b)), off = both[0][1] + both[1][0];
  const mean = both[0][0] + both[1][1], half = Math.hypot(both[0][0] - both[1][1], off);
  const angle = Math.atan2(off, both[0][0] - both[1][1]) / 2;
  return { spread: Math.sqrt(Math.max(2 * (mean - half), 0) / (2 * (mean + half))),
    along: [Math.cos(angle), Math.sin(angle)] };
}

/** Places centred, and at most 1 in size: squares of tiny lengths would be zero. @param {number[][]} places */
function rbfScaled(places) {
  const mean = [0, 1].map((k) => places.reduce((sum, p) => sum + p[k] / places.length, 0));
  const centred = places.map((p) => [p[0] - mean[0], p[1] - mean[1]]);
  const size = centred.reduce((m, p) => Math.max(m, Math.abs(p[0]), Math.abs(p[1])), 0) || 1;
  return centred.map((p) => [p[0] / size, p[1] / size]);
}

/** Second moments relative to their largest eigenvalue. @param {number[][]} m */
function rbfRelative(m) {
  const largest = (m[0][0] + m[1][1] + Math.hypot(m[0][0] - m[1][1], 2 * m[0][1])) / 2 || 1;
  return m.map((row) => row.map((value) => value / largest));
}

/** @param {number[][]} m */
function rbfSpectralNorm(m) {
  const e = (m[0][0] + m[1][1]) / 2, f = (m[0][0] - m[1][1]) / 2;
  const g = (m[1][0] + m[0][1]) / 2, h = (m[1][0] - m[0][1]) / 2;
  return Math.hypot(e, h) + Math.hypot(f, g);
}

/** The rotation of the trend of a fit. @param {RbfFit} fit */
function rbfRotationOf(fit) {
  const m = [[1 + fit.linear[0][0] / fit.support, fit.linear[0][1] / fit.support],
    [fit.linear[1][0] / fit.support, 1 + fit.linear[1][1] / fit.support]];
  const c = m[0][0] + m[1][1], s = m[1][0] - m[0][1], length = Math.hypot(c, s);
  if (!(m[0][0] * m[1][1] - m[0][1] * m[1][0] > 0) || length === 0) return [[1, 0], [0, 1]];
  return [[c / length, -s / length], [s / length, c / length]];
}

// ---- remarks on a fit, as deformnb.rbf.conditioning makes them -----------------------------------------------------

/**
 * The indices of the nearest neighbours of each point, nearest first, row by row; as many as are asked for, or all.
 * @param {Ready} ready
 * @param {number} most
 */
function rbfNeighbours({ merged, n, origin, radius }, most) {
  const count = Math.min(most, n - 1), found = new Int32Array(n * count), gaps = new Float64Array(n * count).fill(Infinity);
  const x = new Float64Array(2 * n);
  merged.forEach((q, k) => { for (const c of [0, 1]) x[2 * k + c] = (q.x[c] - origin[c]) / radius; });
  /** @type {(i: number, j: number, gap: number) => void} */
  const insert = (i, j, gap) => {
    let at = (i + 1) * count - 1;
    for (; at > i * count && gaps[at - 1] > gap; at--) { gaps[at] = gaps[at - 1]; found[at] = found[at - 1]; }
    gaps[at] = gap;
    found[at] = j;
  };
  for (let i = 0; i < n; i++) {
    for (let j = i + 1; j < n; j++) {
      const da = x[2 * i] - x[2 * j], db = x[2 * i + 1] - x[2 * j + 1], gap = da * da + db * db;
      if (gap < gaps[(i + 1) * count - 1]) insert(i, j, gap);
      if (gap < gaps[(j + 1) * count - 1]) insert(j, i, gap);
    }
  }
  return { found, count };
}

/** @param {Ready} ready */
function rbfClosest(ready) {
  if (ready.n < 2) return "a single point";
  const { merged } = ready, { found } = rbfNeighbours(ready, 1);
  const gap = (/** @type {number} */ k) => Math.hypot(...[0, 1].map((c) => merged[k].x[c] - merged[found[k]].x[c]));
  const least = merged.reduce((best, _, k) => (gap(k) < gap(best) ? k : best), 0);
  return `${rbfLabel(merged[least].point)} and ${rbfLabel(merged[found[least]].point)}`;
}

/** @param {Ready} ready @param {string} kernel @param {number[][]} map */
function rbfWarnings(ready, kernel, map) {
  const notes = [];
  const isPlain = ready.trend === "affine_exact" ||
    (["affine", "quadratic"].includes(ready.trend) && RBF_KERNELS[kernel].order >= 2);
  if (isPlain && rbfSpectralNorm(map) > STEEP) {
    notes.push(`the affine trend stretches more than ${STEEP} times: the control points nearly lie on one line ` +
      "or in one plane; the trend similarity would not");
  }
  /** @type {(place: (q: Place) => number[]) => number} */
  const spread = (place) => Math.max(...[0, 1].map((k) => {
    const all = ready.merged.map((q) => place(q)[k]);
    return all.reduce((m, v) => Math.max(m, v), -Infinity) - all.reduce((m, v) => Math.min(m, v), Infinity);
  }));
  /** @type {Record<string, string>} */
  const collapses = { affine: "the trend collapses everything to one place",
    affine_exact: "the trend collapses everything to one place",
    quadratic: "the trend collapses everything to one place",
    similarity: "the trend collapses everything to one place", rigid: "the turn is open and stays what it was" };
  const sources = spread((q) => [q.x[0] + q.d[0], q.x[1] + q.d[1]]);
  if (Object.hasOwn(collapses, ready.trend) && sources < NO_ANGLE * spread((q) => q.x)) {
    notes.push(`the sources nearly coincide: ${collapses[ready.trend]}`);
  } else if (isPlain) {
    const largest = rbfSpectralNorm(map), det = map[0][0] * map[1][1] - map[0][1] * map[1][0];
    if (!(Math.abs(det) >= NO_ANGLE * largest * largest)) {
      notes.push("the sources lie on one line or in one plane and the targets do not: the affine trend presses " +
        "everything flat");
    }
  }
  return notes;
}

/** Ids of points that share a source and have different targets. @param {Ready} ready @param {number} [most] */
function rbfTornPairs({ merged, n, ids }, most = 3) {
  const size = Math.max(0, ...[0, 1].map((k) => rbfExtent(merged.map((q) => [q.x[k], 0])))), near = SAME_PLACE * size;
  /** @type {Vector2[]} */
  const found = [];
  for (let i = 0; i < n && size > 0 && found.length < most; i++) {
    const { x: [a, b], d: [da, db] } = merged[i], from = a + da, to = b + db;
    for (let j = i + 1; j < n && found.length < most; j++) {
      const { x, d } = merged[j], gap = from - x[0] - d[0];
      if (Math.abs(gap) <= near && Math.hypot(gap, to - x[1] - d[1]) <= near) found.push([ids[i], ids[j]]);
    }
  }
  return found;
}

/**
 * Ids of points that are pulled past each other.
 * @param {Ready} ready
 * @param {number[][]} map
 * @param {number} [most]
 */
function rbfCrossingPairs(ready, map, most = 3) {
  const { merged, n } = ready;
  if (n < 2) return [];
  const moved = merged.map(({ d, x }) => [0, 1].map((k) => d[k] + x[k] - map[k][0] * x[0] - map[k][1] * x[1]));
  const pairs = new Map(), { found, count } = rbfNeighbours(ready, 4);
  for (let i = 0; i < n; i++) {
    for (const j of found.subarray(i * count, (i + 1) * count)) {
      const gap = [merged[i].x[0] - merged[j].x[0], merged[i].x[1] - merged[j].x[1]];
      const along = Math.max(COLLAPSED * Math.hypot(...gap), // beyond that the ratio would be rounding
        Math.hypot(...map.map((row) => row[0] * gap[0] + row[1] * gap[1])));
      const beside = Math.hypot(moved[i][0] - moved[j][0], moved[i][1] - moved[j][1]);
      // In quarters of an octave, as in deformnb.rbf.conditioning: neither rounding nor a small move changes the names.
      const degree = Math.round(4 * Math.log2(beside / along));
      if (beside > along) pairs.set(Math.min(i, j) * n + Math.max(i, j), [Math.min(i, j), Math.max(i, j), degree]);
    }
  }
  const worst = [...pairs].sort(([p, [,, d]], [q, [,, e]]) => e - d || p - q).slice(0, most);
  return worst.filter(([, [,, degree]]) => degree >= worst[0][1][2] - FAR_BEHIND).sort(([p], [q]) => p - q)
    .map(([, [i, j]]) => [ready.ids[i], ready.ids[j]]);
}

// ---- kernels and trends, with the names and in the order of the package ---------------------------------------------

/** Points or settings that cannot be fitted, with a message for users. */
export class RbfError extends Error {}

/** @type {Record<string, Kernel>} */
export const RBF_KERNELS = {
  wendland_c2: {
    title: "Wendland C2", order: 0, compact: true, share: 1, gaps: 16,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s), q = t * t; return q * q * (5 - 4 * t); },
    slope: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return -10 * t * t * t; },
  },
  wendland_c0: {
    title: "Wendland C0", order: 0, compact: true, share: 1, gaps: Infinity,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return t * t; },
    slope: (s) => { const r = Math.sqrt(Math.max(s, TINY)); return r >= 1 ? 0 : -(1 - r) / r; },
  },
  wendland_c4: {
    title: "Wendland C4", order: 0, compact: true, share: 1, gaps: 8,
    profile: (s) => {
      if (s >= 1) return 0;
      const r = Math.sqrt(s), t = 1 - r, q = t * t;
      return q * q * q * (35 * s + 18 * r + 3) / 3;
    },
    slope: (s) => { if (s >= 1) return 0; const r = Math.sqrt(s); return (-28 / 3) * (1 + 5 * r) * (1 - r) ** 5; },
  },
  thin_plate: {
    title: "Thin-plate spline", order: 2, compact: false, share: 1, gaps: Infinity,
    profile: (s) => 0.5 * s * Math.log(Math.max(s, TINY)),
    slope: (s) => 0.5 * (Math.log(Math.max(s, TINY)) + 1),
  },
  gaussian: {
    title: "Gaussian", order: 0, compact: false, share: 1 / 4, gaps: 2,
    profile: (s) => Math.exp(-4.5 * s),
    slope: (s) => -4.5 * Math.exp(-4.5 * s),
  },
  multiquadric: {
    title: "Multiquadric", order: 1, compact: false, share: 1 / 4, gaps: 1,
    profile: (s) => -Math.sqrt(1 + 16 * s),
    slope: (s) => -8 / Math.sqrt(1 + 16 * s),
  },
  inverse_multiquadric: {
    title: "Inverse multiquadric", order: 0, compact: false, share: 1 / 4, gaps: 1,
    profile: (s) => 1 / Math.sqrt(1 + 16 * s),
    slope: (s) => { const t = 1 + 16 * s; return -8 / (t * Math.sqrt(t)); },
  },
  inverse_quadratic: {
    title: "Inverse quadratic", order: 0, compact: false, share: 1 / 4, gaps: 1,
    profile: (s) => 1 / (1 + 16 * s),
    slope: (s) => { const t = 1 + 16 * s; return -16 / (t * t); },
  },
  cubic: {
    title: "Cubic", order: 2, compact: false, share: 1, gaps: Infinity,
    profile: (s) => s * Math.sqrt(s),
    slope: (s) => 1.5 * Math.sqrt(s),
  },
  quintic: {
    title: "Quintic", order: 3, compact: false, share: 1, gaps: Infinity,
    profile: (s) => -s * s * Math.sqrt(s),
    slope: (s) => -2.5 * s * Math.sqrt(s),
  },
  linear: {
    title: "Linear", order: 1, compact: false, share: 1, gaps: Infinity,
    profile: (s) => -Math.sqrt(s),
    slope: (s) => -0.5 / Math.sqrt(Math.max(s, TINY)),
  },
};

/** @type {Map<string, KernelTable>} */
const TABLES = new Map();

/**
 * The name of the kernel of settings; one that Python has registered comes with its table.
 * @param {FitSettings} settings
 */
export function rbfKernelOf({ kernel = "wendland_c2", kernel_table: table }) {
  if (table?.name === kernel && TABLES.get(kernel)?.numbers !== table.numbers) {
    TABLES.set(kernel, table);
    RBF_KERNELS[kernel] = kernelOfTable(table);
  }
  return kernel;
}

/**
 * order: the largest order of a kernel that the trend can be paired with.
 * @type {Record<string, { title: string, order: number }>}
 */
export const RBF_TRENDS = {
  affine: { title: "Affine", order: 2 },
  similarity: { title: "Similarity (turn, scale, shift)", order: 1 },
  rigid: { title: "Rigid (turn, shift)", order: 1 },
  translation: { title: "Translation", order: 1 },
  none: { title: "None", order: 0 },
  affine_exact: { title: "Affine, exact across a row of points too", order: 2 },
  quadratic: { title: "Quadratic", order: 3 },
};

// ---- the fit --------------------------------------------------------------------------------------------------------

/**
 * The fit of control points. Throws RbfError.
 * @param {Point[]} points
 * @param {FitSettings & { previous?: RbfFit | null }} [settings]
 */
export function rbfFit(points, settings = {}) {
  const kernel = rbfKernelOf(settings), trend = settings.trend ?? "affine";
  const smoothing = settings.smoothing ?? 0, strength = settings.strength ?? 1;
  rbfCheckSettings(kernel, trend, smoothing, strength, settings.support ?? null);
  rbfCheckPoints(points);
  const active = points.filter((p) => p.active !== false);
  if (RBF_KERNELS[kernel].order > 0 && active.some((p) => (p.radius ?? null) !== null)) {
    throw new RbfError(`control points have support radii of their own, and the ${kernel} kernel, which has no end, ` +
      "knows none; choose a Wendland kernel or the Gaussian, or clear their radii.");
  }
  if (active.length > LARGEST_SET) {
    throw new RbfError(`${active.length} control points are more than the ${LARGEST_SET} that are fitted here; ` +
      "Python fits them: warp the volume, or switch some off to drag.");
  }
  // The radius is that of the points as dragged, at full strength, as in deformnb.document.deformation.Step.
  const radius = rbfRadius(active, rbfSupport(points, settings), trend);
  const ready = rbfPrepare(active, kernel, radius, trend, smoothing, strength);
  if (ready.n === 0) return rbfIdentity(ready, kernel, "none", 1);
  return rbfSolvePrepared(ready, kernel, smoothing, settings.previous ?? null);
}

/**
 * Throw an RbfError for settings that do not go together.
 * @param {string} kernel
 * @param {string} trend
 * @param {number} smoothing
 * @param {number} strength
 * @param {number | "box_diagonal" | null} support
 */
export function rbfCheckSettings(kernel, trend, smoothing, strength, support) {
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
  if (RBF_TRENDS[trend].order < RBF_KERNELS[kernel].order) {
    const able = Object.keys(RBF_TRENDS).filter((t) => RBF_TRENDS[t].order >= RBF_KERNELS[kernel].order).join(", ");
    throw new RbfError(`the ${kernel} kernel is not positive definite on its own and needs a trend of ${able}; ` +
      `choose that, or a Wendland kernel for the trend '${trend}'.`);
  }
}

/** @param {Point} point */
export function rbfLabel(point) {
  return `control point ${point.id}${point.name ? ` ("${point.name}")` : ""}`;
}

/** Throw an RbfError for points that cannot be fitted. @param {Point[]} points */
export function rbfCheckPoints(points) {
  for (const p of points) {
    for (const [what, place] of Object.entries({ source: p.source, target: p.target })) {
      const good = Array.isArray(place) && place.length === 2 &&
        place.every((v) => Number.isFinite(v) && Math.abs(v) <= LARGEST_COORDINATE);
      if (!good) {
        throw new RbfError(`the ${what} of ${rbfLabel(p)} is [${place}]; coordinates must be finite and below 1e15. ` +
          "Correct or remove that point.");
      }
    }
    const weight = p.weight ?? 1;
    if (!(Number.isFinite(weight) && weight > 0)) {
      throw new RbfError(`the weight of ${rbfLabel(p)} is ${weight}; weights must be positive numbers.`);
    }
    const radius = p.radius ?? 1;
    if (!(radius > 0 && radius <= LARGEST_COORDINATE)) {
      throw new RbfError(`the radius of ${rbfLabel(p)} is ${radius}; a radius is a positive length, or null for that ` +
        "of all.");
    }
  }
}

/** @typedef {{ source: number[], target: number[], active?: boolean }} Ends */

/**
 * The places that do not move during a drag: the active sources, or the targets if the sources coincide.
 * @param {Ends[]} points
 */
function rbfAtRest(points) {
  const active = points.filter((p) => p.active !== false);
  const sources = active.map((p) => p.source), targets = active.map((p) => p.target);
  return rbfExtent(sources) > SAME_PLACE * rbfExtent(targets) ? sources : targets;
}

/** The diagonal of the box of places; 0 for none. @param {number[][]} places */
function rbfExtent(places) {
  const size = [0, 1].map((k) => places.reduce((m, p) => Math.max(m, p[k]), -Infinity) -
    places.reduce((m, p) => Math.min(m, p[k]), Infinity));
  return places.length ? Math.hypot(size[0], size[1]) : 0;
}

/** @param {Ends[]} points */
export function rbfBoxDiagonal(points) {
  return rbfExtent(rbfAtRest(points)) || null;
}

/**
 * The usual support of points: a share of their box, less for points in a row.
 * @param {Point[]} points
 * @param {string} kernel
 */
function rbfUsualSupport(points, kernel) {
  const places = rbfAtRest(points), size = rbfExtent(places), { share, gaps } = RBF_KERNELS[kernel];
  if (size === 0) return null;
  const isThin = rbfSpreads(places, places).spread < THIN, wide = isThin ? 1 : 2;
  const across = Math.max(1, places.length ** (1 / wide) - 1), ball = isThin ? 2 : Math.PI;
  const most = places.length > MANY && RBF_KERNELS[kernel].order < 2
    ? (MOST_NEIGHBOURS / ball) ** (1 / wide) / Math.sqrt(wide) / across : Infinity;
  return size * Math.min(share, most, ...(isThin ? [0.5, gaps / across] : []));
}

/**
 * The support radius of a set of points: as given, by a rule, as Python chose it, the usual one, or that of a lone
 * point.
 * @param {Point[]} points
 * @param {FitSettings} settings
 */
export function rbfSupport(points, settings) {
  const { support, chosen_support: chosen, lone_support: lone } = settings, kernel = rbfKernelOf(settings);
  const own = support === "box_diagonal" ? rbfBoxDiagonal(points)
    : support ?? chosen ?? rbfUsualSupport(points, kernel);
  return own ?? lone ?? null;
}

/** @param {Point[]} active @param {number | null} radius @param {string} trend */
function rbfRadius(active, radius, trend) {
  if (radius !== null) return radius;
  if (active.length && trend === "none") {
    throw new RbfError(`${rbfLabel(active[0])} is alone and there is no trend, so nothing determines its range; ` +
      "give a support radius.");
  }
  return 1; // a translation does not depend on it
}

/**
 * @param {Point[]} active
 * @param {string} kernel
 * @param {number} given  support radius
 * @param {string} trend
 * @param {number} smoothing
 * @param {number} strength
 * @returns {Ready}
 */
function rbfPrepare(active, kernel, given, trend, smoothing, strength) {
  const places = active.map((p) => {
    const x = strength === 1 ? [...p.target] : [0, 1].map((k) => p.source[k] + strength * (p.target[k] - p.source[k]));
    return { point: p, w: p.weight ?? 1, x, d: [p.source[0] - x[0], p.source[1] - x[1]] };
  });
  const box = rbfBoxDiagonal(places.map((q) => ({ source: q.point.source, target: q.x }))) ?? Infinity, limited = [];
  let radius = given;
  if (RBF_KERNELS[kernel].compact && given > LONGEST_SHARE * box) {
    radius = LONGEST_SHARE * box;
    limited.push(`the support radius is limited to ${LONGEST_SHARE} diagonals of the control points' box; beyond ` +
      "that the map hardly changes");
  }
  const { merged, notes } = rbfMerge(places, radius, Math.min(radius, box), smoothing);
  const n = merged.length;
  const origin = n ? [0, 1].map((k) => merged.reduce((sum, q) => sum + q.x[k], 0) / n) : [0, 0];
  const basis = rbfSpan(merged.map((q) => [q.x[0] - origin[0], q.x[1] - origin[1]]));
  const { ridge, where } = rbfThinness(merged, basis);
  const [name, remark] = rbfDeterminedTrend(trend, kernel, n, basis.length, where);
  /** @type {Pick<Span, "quadrics" | "bend">} */
  const bent = name === "quadratic" ? rbfQuadricSpan(
    merged.map((q) => [q.x[0] - origin[0], q.x[1] - origin[1]]), basis) : {};
  const open = bent.bend?.flat().some((value) => value !== 0) ? rbfOpenBend(n, kernel) : [];
  return { n, merged, origin, radius, basis, ridge, ...bent, trend: name,
    notes: [...limited, ...notes, ...remark, ...open], ids: merged.map((q) => q.point.id) };
}

/**
 * The penalty of the trend "affine" across a row of points, and the place of the row in words; nothing for wide sets.
 * @param {Place[]} merged
 * @param {number[][]} basis
 */
function rbfThinness(merged, basis) {
  if (merged.length < 2 || basis.length === 0) return { ridge: null, where: "" };
  const { spread, along } = rbfSpreads(merged.map((q) => q.x), merged.map((q) => [q.x[0] + q.d[0], q.x[1] + q.d[1]]));
  if (spread >= THIN) return { ridge: null, where: "" };
  const weight = rbfPenalty(spread, THIN);
  const across = [-along[1], along[0]], quarters = rbfRound(Math.atan2(along[1], along[0]) * 180 / Math.PI / 15);
  const degrees = ((quarters * 15) % 180 + 180) % 180;
  return { ridge: across.map((p) => across.map((q) => weight * p * q)), where: `on one line, at ${degrees} degrees` };
}

/** The nearest integer; halves go to the even number, as in Python. @param {number} value */
function rbfRound(value) {
  const low = Math.floor(value), rest = value - low;
  return rest < 0.5 || (rest === 0.5 && low % 2 === 0) ? low : low + 1;
}

/**
 * Unite points at one place, found through a sort along a so that 2000 points take no longer than a few.
 * @param {Place[]} places
 * @param {number} radius
 * @param {number} reach
 * @param {number} smoothing
 */
function rbfMerge(places, radius, reach, smoothing) {
  const near = SAME_PLACE * reach, order = places.map((_, k) => k).sort((i, j) => places[i].x[0] - places[j].x[0]);
  const parent = places.map((_, k) => k);
  /** @type {(k: number) => number} */
  const root = (k) => {
    let top = k;
    while (parent[top] !== top) { parent[top] = parent[parent[top]]; top = parent[top]; }
    return top;
  };
  /** @type {Vector2[]} */
  const pairs = [];
  order.forEach((i, at) => {
    for (let next = at + 1; next < order.length; next++) {
      const j = order[next], p = places[i].x, q = places[j].x;
      if (q[0] - p[0] > near) break;
      if (Math.hypot(q[0] - p[0], q[1] - p[1]) <= near) pairs.push([Math.min(i, j), Math.max(i, j)]);
    }
  });
  if (pairs.length === 0) return { merged: places, notes: [] };
  if (smoothing === 0) rbfRefuseConflicts(places, pairs, radius);
  for (const [i, j] of pairs) parent[root(i)] = root(j);
  /** @type {Map<number, Place[]>} */
  const groups = new Map();
  for (const [k, q] of places.entries()) {
    const r = root(k), group = groups.get(r);
    if (group) group.push(q);
    else groups.set(r, [q]);
  }
  const merged = [], notes = [];
  for (const members of groups.values()) { // in the order of their first members
    const w = members.reduce((sum, q) => sum + q.w, 0);
    /** @type {(key: "x" | "d") => number[]} */
    const mean = (key) => [0, 1].map((k) => members.reduce((sum, q) => sum + q.w * q[key][k], 0) / w);
    merged.push({ point: members[0].point, w, x: mean("x"), d: mean("d") });
    if (members.length > 1) {
      notes.push(`${members.map((q) => rbfLabel(q.point)).join(", ")} are at one place and count as one`);
    }
  }
  return { merged, notes };
}

/** @param {Place[]} places @param {Vector2[]} pairs @param {number} radius */
function rbfRefuseConflicts(places, pairs, radius) {
  for (const [i, j] of pairs) {
    const p = places[i], q = places[j];
    if (Math.hypot(p.d[0] - q.d[0], p.d[1] - q.d[1]) <= SAME_DISPLACEMENT * radius) continue;
    const [place, one, two] = [p.x, p.d, q.d].map((v) => `(${v.map(rbfShown).join(", ")})`);
    throw new RbfError(`${rbfLabel(p.point)} and ${rbfLabel(q.point)} are at the same place ${place} but require ` +
      `different displacements ${one} and ${two}; move or delete one, or turn smoothing on.`);
  }
}

/** @param {number} value */
function rbfShown(value) {
  return String(Number(value.toPrecision(6)));
}

/**
 * The trend that so many points bear, and a remark.
 * @param {string} trend
 * @param {string} kernel
 * @param {number} n
 * @param {number} rank
 * @param {string} where
 * @returns {[trend: string, remarks: string[]]}
 */
function rbfDeterminedTrend(trend, kernel, n, rank, where) {
  if (n === 0 || trend === "none" || trend === "translation") return [trend, []];
  const { order } = RBF_KERNELS[kernel];
  if (rank === 0) return [order >= 2 ? trend : "translation", ["one control point: the trend is a translation"]];
  if (!where || RBF_TRENDS[trend].order < 2) return [trend, []];
  const lie = `the control points lie nearly ${where}: across it`;
  if (trend !== "affine_exact" && order < 2) return [trend, [`${lie} the affine trend turns and scales as along it`]];
  return [trend, [`${lie} nothing holds the affine trend, which may shear or stretch without bounds; a Wendland ` +
    "kernel with the trend affine stays calm"]];
}

/** A note where n points do not determine all of the quadratic trend. @param {number} n @param {string} kernel */
function rbfOpenBend(n, kernel) {
  if (n < 2) return [];
  const why = n < 6 ? `the quadratic trend needs 6 control points or more, and there are ${n}`
    : "the control points lie nearly on one conic (an ellipse, a hyperbola, two lines)";
  return [`${why}: ${RBF_KERNELS[kernel].order > 2 && n >= 6
    ? "nothing holds the quadratic trend beside it; the thin-plate kernel would stay calm"
    : "what they leave open of it is left out"}`];
}

/** @param {Ready} ready @param {string} kernel @param {string} trend @param {number} support @returns {RbfFit} */
function rbfIdentity(ready, kernel, trend, support) {
  const centers = new Float64Array(2 * ready.n);
  ready.merged.forEach((q, k) => {
    centers[2 * k] = (q.x[0] - ready.origin[0]) / support;
    centers[2 * k + 1] = (q.x[1] - ready.origin[1]) / support;
  });
  const radii = ready.merged.map((q) => q.point.radius ?? ready.radius), isOwn = radii.some((r) => r !== ready.radius);
  const scales = isOwn ? Float64Array.from(radii, (r) => ready.radius / r) : null;
  return { count: ready.n, scales, centers, coefficients: new Float64Array(2 * ready.n), linear: [[0, 0], [0, 0]],
    constant: [0, 0], quadratic: null, origin: ready.origin, support, kernel, trend, ids: ready.ids,
    notes: ready.notes, doubts: [] };
}

/**
 * @param {Ready} ready
 * @param {string} kernel
 * @param {number} smoothing
 * @param {RbfFit | null} previous
 * @returns {RbfFit}
 */
function rbfSolvePrepared(ready, kernel, smoothing, previous) {
  const { n, radius: r } = ready;
  const fit = rbfIdentity(ready, kernel, ready.trend, r);
  const d = new Float64Array(2 * n);
  ready.merged.forEach((q, k) => { d[2 * k] = q.d[0] / r; d[2 * k + 1] = q.d[1] / r; });
  if (d.every((value) => value === 0)) return fit; // exactly the identity, which a solve would miss by rounding
  const nugget = ready.merged.map((q) => smoothing / q.w);
  const turn = previous === null ? [[1, 0], [0, 1]] : rbfRotationOf(previous);
  const places = new Float64Array(2 * n);
  ready.merged.forEach((q, k) => { places[2 * k] = q.x[0]; places[2 * k + 1] = q.x[1]; });
  const radii = fit.scales && ready.merged.map((q) => q.point.radius ?? r);
  const matrix = kernelMatrix({ kernel, radius: r, places, nugget, radii }, RBF_KERNELS[kernel].profile);
  const { alpha, linear, constant, quadratic, miss } = rbfSolve(matrix, fit.centers, d, ready, turn, kernel, ready.trend,
    radii !== null);
  /** @type {(array: Float64Array) => number} */
  const largest = (array) => array.reduce((most, value) => (most >= Math.abs(value) || Number.isNaN(most) ? most
    : Math.abs(value)), 0);
  if (fit.scales && !(largest(alpha) <= MOST_GAIN * largest(d))) {
    throw new RbfError("the support radii that these control points have of their own do not go together: the system " +
      `is nearly singular (closest are ${rbfClosest(ready)}). Give neighbours more similar radii, or smaller ones.`);
  }
  if (!(largest(miss) <= RESIDUAL * largest(d) + ROUNDING * largest(fit.centers))) {
    throw new RbfError(`the ${kernel} kernel with support ${rbfShown(r)} is too flat for these ${n} control points: ` +
      `the system is singular to working precision (closest are ${rbfClosest(ready)}). Use a smaller support, a ` +
      "Wendland kernel, or a little smoothing.");
  }
  const map = [[1 + linear[0][0], linear[0][1]], [linear[1][0], 1 + linear[1][1]]];
  const torn = rbfTornPairs(ready);
  /** @type {(pair: number[]) => boolean} */
  const isTorn = ([i, j]) => torn.some(([p, q]) => p === i && q === j);
  const crossed = torn.map(
    ([i, j]) => `control points ${i} and ${j} share a source and have different targets: the map folds between them`);
  crossed.push(...rbfCrossingPairs(ready, map).filter((pair) => !isTorn(pair)).map(
    ([i, j]) => `control points ${i} and ${j} are pulled past each other: the map may fold there`));
  return { ...fit, coefficients: alpha.map((value) => value * r), linear: linear.map((row) => row.map((m) => m * r)),
    constant: constant.map((value) => value * r), doubts: crossed,
    quadratic: quadratic?.map((m) => m.map((row) => row.map((value) => value * r))) ?? null,
    notes: [...ready.notes, ...crossed, ...rbfWarnings(ready, kernel, map)] };
}

// ---- evaluation -----------------------------------------------------------------------------------------------------

/**
 * The backward displacement at a place of the picture.
 * @param {RbfFit} fit
 * @param {number} a
 * @param {number} b
 * @returns {Vector2}
 */
export function rbfAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const profile = RBF_KERNELS[fit.kernel].profile;
  let u = linear[0][0] * p + linear[0][1] * q + constant[0], v = linear[1][0] * p + linear[1][1] * q + constant[1];
  if (fit.quadratic) {
    u += rbfQuadraticAt(fit.quadratic[0], p, q);
    v += rbfQuadraticAt(fit.quadratic[1], p, q);
  }
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], s = dp * dp + dq * dq;
    const phi = profile(scales ? s * scales[k] * scales[k] : s);
    u += alpha[j] * phi;
    v += alpha[j + 1] * phi;
  }
  return [u, v];
}

/** The value of a quadratic form. @param {number[][]} h  symmetric @param {number} p @param {number} q */
export function rbfQuadraticAt(h, p, q) {
  return h[0][0] * p * p + 2 * h[0][1] * p * q + h[1][1] * q * q;
}

/**
 * The derivative of the trend at a place in relative coordinates.
 * @param {RbfFit} fit
 * @param {number} p
 * @param {number} q
 */
export function rbfLinearAt({ quadratic, linear }, p, q) {
  return quadratic ? linear.map((row, m) => row.map((value, k) => value + 2 * (quadratic[m][k][0] * p +
    quadratic[m][k][1] * q))) : linear;
}

/** [[dDa/da, dDa/db], [dDb/da, dDb/db]] at a place. @param {RbfFit} fit @param {number} a @param {number} b */
export function rbfJacobianAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, count, scales } = fit, slope = RBF_KERNELS[fit.kernel].slope;
  let [[m00, m01], [m10, m11]] = rbfLinearAt(fit, p, q);
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], w = scales ? scales[k] * scales[k] : 1;
    const g = 2 * w * slope((dp * dp + dq * dq) * w);
    m00 += alpha[j] * g * dp;
    m01 += alpha[j] * g * dq;
    m10 += alpha[j + 1] * g * dp;
    m11 += alpha[j + 1] * g * dq;
  }
  return [[m00 / r, m01 / r], [m10 / r, m11 / r]];
}

/**
 * Displacements at the pixels of a raster, nv * nu * 2 numbers with the component last. One centre after the other, and
 * for compact kernels only the columns that it reaches: the row's distance is constant.
 * @param {RbfFit} fit
 * @param {Raster} raster
 * @param {Float32Array | null} [out]
 */
export function rbfOnRaster(fit, raster, out = null) {
  const [nv, nu] = raster.shape, [du, dv] = raster.spacing, r = fit.support;
  const map = out ?? new Float32Array(nv * nu * 2);
  const step = du / r, p0 = (raster.origin[0] - fit.origin[0]) / r;
  const { centers: x, coefficients: alpha, linear, constant, quadratic, count, scales } = fit;
  const { profile, compact } = RBF_KERNELS[fit.kernel], row = new Float64Array(2 * nu);
  for (let i = 0; i < nv; i++) {
    const q = (raster.origin[1] + i * dv - fit.origin[1]) / r;
    for (let k = 0; k < nu; k++) {
      const p = p0 + k * step;
      row[2 * k] = linear[0][0] * p + linear[0][1] * q + constant[0];
      row[2 * k + 1] = linear[1][0] * p + linear[1][1] * q + constant[1];
      if (quadratic) {
        row[2 * k] += rbfQuadraticAt(quadratic[0], p, q);
        row[2 * k + 1] += rbfQuadraticAt(quadratic[1], p, q);
      }
    }
    for (let c = 0, j = 0; c < count; c++, j += 2) {
      const au = alpha[j], av = alpha[j + 1], w = scales ? scales[c] * scales[c] : 1, dq2 = (q - x[j + 1]) ** 2;
      if ((au === 0 && av === 0) || (compact && dq2 * w >= 1)) continue;
      const reach = compact ? Math.sqrt(1 / w - dq2) : Infinity;
      const first = Math.max(0, Math.ceil((x[j] - reach - p0) / step));
      const last = Math.min(nu - 1, Math.floor((x[j] + reach - p0) / step));
      for (let k = first; k <= last; k++) {
        const dp = p0 + k * step - x[j], phi = profile((dp * dp + dq2) * w);
        row[2 * k] += au * phi;
        row[2 * k + 1] += av * phi;
      }
    }
    map.set(row, 2 * nu * i);
  }
  return map;
}
