// The linear algebra behind rbf.js: deformnb.rbf.interpolant.solve and deformnb.rbf.trends, for dimension 2, dense, in float64.
// Matrices of n rows and m columns are Float64Array of n * m, row by row; matrices of 2 x 2 are nested lists.

// alpha (n x 2), A (2 x 2), t (2) and the residual of relative targets x and displacements d (both n x 2).
// scales: null, or support / R_j of points with support radii R_j of their own.
// span: {basis, ridge}, what the points determine of a linear map, as in deformnb.rbf.trends.Span.
function rbfSolve(x, d, nugget, span, turn, kernel, trend, scales = null) {
  const n = nugget.length, phi = new Float64Array(n * n), profile = RBF_KERNELS[kernel].profile;
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      const dp = x[2 * i] - x[2 * j], dq = x[2 * i + 1] - x[2 * j + 1], s = dp * dp + dq * dq;
      phi[i * n + j] = profile(scales ? s * scales[j] * scales[j] : s);
      phi[j * n + i] = scales ? profile(s * scales[i] * scales[i]) : phi[i * n + j];
    }
    phi[i * n + i] += nugget[i];
  }
  let solved;
  if (scales) solved = rbfLeastSquares(phi, x, d, span, turn, trend);
  else if (RBF_KERNELS[kernel].order === 2) solved = rbfBorderedAffine(phi, x, d, span.basis);
  else if (trend === "none") {
    solved = { alpha: rbfCholeskySolve(phi, d, n, 2), linear: [[0, 0], [0, 0]], constant: [0, 0] };
  } else solved = rbfLeastEnergy(phi, x, d, span, turn, kernel, trend);
  const { alpha, linear, constant } = solved, miss = new Float64Array(2 * n);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < 2; k++) {
      let sum = x[2 * i] * linear[k][0] + x[2 * i + 1] * linear[k][1] + constant[k] - d[2 * i + k];
      for (let j = 0; j < n; j++) sum += phi[i * n + j] * alpha[2 * j + k];
      miss[2 * i + k] = sum;
    }
  }
  return { ...solved, miss };
}

// Solution of a symmetric positive definite system with m right-hand sides; NaN where it is not definite.
function rbfCholeskySolve(matrix, rhs, n, m) {
  const l = Float64Array.from(matrix), out = Float64Array.from(rhs);
  for (let j = 0; j < n; j++) {
    for (let i = j; i < n; i++) {
      let sum = l[i * n + j];
      for (let k = 0; k < j; k++) sum -= l[i * n + k] * l[j * n + k];
      l[i * n + j] = i === j ? Math.sqrt(sum) : sum / l[j * n + j];
    }
  }
  for (let c = 0; c < m; c++) {
    for (let i = 0; i < n; i++) {
      let sum = out[i * m + c];
      for (let k = 0; k < i; k++) sum -= l[i * n + k] * out[k * m + c];
      out[i * m + c] = sum / l[i * n + i];
    }
    for (let i = n - 1; i >= 0; i--) {
      let sum = out[i * m + c];
      for (let k = i + 1; k < n; k++) sum -= l[k * n + i] * out[k * m + c];
      out[i * m + c] = sum / l[i * n + i];
    }
  }
  return out;
}

// Solver of a general square system, factored once with partial pivoting.
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
      const f = (a[i * n + c] /= a[c * n + c]);
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

// [Phi P; P^T 0] with the n x r matrix P.
function rbfBordered(phi, p, n, r) {
  const size = n + r, out = new Float64Array(size * size);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j < n; j++) out[i * size + j] = phi[i * n + j];
    for (let k = 0; k < r; k++) out[i * size + n + k] = out[(n + k) * size + i] = p[i * r + k];
  }
  return out;
}

function rbfLeastEnergy(phi, x, d, span, turn, kernel, trend) {
  const n = x.length / 2, w = new Float64Array(n * 4), mean = [0, 0, 0, 0];
  if (RBF_KERNELS[kernel].order === 0) {
    const rhs = new Float64Array(n * 5);
    for (let i = 0; i < n; i++) rhs.set([1, x[2 * i], x[2 * i + 1], d[2 * i], d[2 * i + 1]], 5 * i);
    const v = rbfCholeskySolve(phi, rhs, n, 5);
    const sums = [0, 1, 2, 3, 4].map((k) => { let sum = 0; for (let i = 0; i < n; i++) sum += v[5 * i + k]; return sum; });
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

// Means and second moments in which all points count alike.
function rbfPlainMoments(x, d) {
  const n = x.length / 2, mean = [0, 0, 0, 0], s = [[0, 0], [0, 0]], h = [[0, 0], [0, 0]];
  for (let i = 0; i < n; i++) for (let k = 0; k < 2; k++) { mean[k] += x[2 * i + k] / n; mean[2 + k] += d[2 * i + k] / n; }
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

// Adds the plain moments as much as the points are thin: the energy of a row is that of its small wiggles.
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

// For a matrix that is not symmetric: the trend of least squares, and Phi alpha = what it leaves.
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

function rbfTrendMap(s, h, { basis, ridge }, turn, trend) {
  if (trend === "translation") return [[1, 0], [0, 1]];
  const size = s[0][0] + s[1][1];
  if (trend === "affine_exact" || (trend === "affine" && !ridge)) return rbfComplete(rbfAffineImages(s, h, basis), basis);
  const rotation = rbfNearestRotation(h, size, turn);
  if (trend === "rigid") return rotation;
  let scale = 0;
  for (let i = 0; i < 2; i++) for (let j = 0; j < 2; j++) scale += rotation[i][j] * h[i][j];
  scale = Math.max(scale / size, 0);
  const similar = rotation.map((row) => row.map((value) => scale * value));
  if (trend === "similarity") return similar;
  // G + (H - G S) (S + tr(S) ridge)^-1: the similarity, corrected where the points determine more
  const rest = h.map((row, i) => row.map((value, j) => value - similar[i][0] * s[0][j] - similar[i][1] * s[1][j]));
  const held = s.map((row, i) => row.map((value, j) => value + size * ridge[i][j]));
  const images = rbfAffineImages(held, rest, [[1, 0], [0, 1]]);
  return similar.map((row, i) => row.map((value, j) => value + images[j][i]));
}

// Where the affine trend of least energy takes the directions of the basis; as a list of vectors.
function rbfAffineImages(s, h, basis) {
  const quadratic = (m, p, q) => p[0] * (m[0][0] * q[0] + m[0][1] * q[1]) + p[1] * (m[1][0] * q[0] + m[1][1] * q[1]);
  const rank = basis.length, small = new Float64Array(rank * rank), rhs = new Float64Array(rank * 2);
  for (let i = 0; i < rank; i++) {
    for (let j = 0; j < rank; j++) small[i * rank + j] = quadratic(s, basis[i], basis[j]);
    for (let k = 0; k < 2; k++) rhs[2 * i + k] = basis[i][0] * h[k][0] + basis[i][1] * h[k][1];
  }
  const images = rbfFactored(small, rank)(rhs, 2);
  return basis.map((_, i) => [images[2 * i], images[2 * i + 1]]);
}

// The linear map that sends the directions of the basis to the images and turns and scales what lies across with them.
function rbfComplete(images, basis) {
  if (basis.length === 0) return [[1, 0], [0, 1]];
  const outer = (p, q) => [[p[0] * q[0], p[0] * q[1]], [p[1] * q[0], p[1] * q[1]]];
  const quarter = (p) => [-p[1], p[0]];
  const first = outer(images[0], basis[0]);
  const other = basis.length === 2 ? outer(images[1], basis[1]) : outer(quarter(images[0]), quarter(basis[0]));
  return first.map((row, i) => row.map((value, j) => value + other[i][j]));
}

function rbfNearestRotation(h, size, previous) {
  const least = RBF_NO_ANGLE * Math.max(size, Math.hypot(h[0][0], h[0][1], h[1][0], h[1][1]));
  const c = h[0][0] + h[1][1], s = h[1][0] - h[0][1], length = Math.hypot(c, s);
  return length > least ? [[c / length, -s / length], [s / length, c / length]] : previous;
}

function rbfBorderedAffine(phi, x, d, basis) {
  const n = x.length / 2, rank = basis.length, width = rank + 1, p = new Float64Array(n * width);
  for (let i = 0; i < n; i++) {
    p[i * width] = 1;
    basis.forEach((e, k) => { p[i * width + 1 + k] = x[2 * i] * e[0] + x[2 * i + 1] * e[1]; });
  }
  const factored = rbfFactored(rbfBordered(phi, p, n, width), n + width);
  const solve = (b) => {
    const rhs = new Float64Array(2 * (n + width));
    rhs.set(b);
    const v = factored(rhs, 2);
    return { alpha: v.slice(0, 2 * n), constant: [v[2 * n], v[2 * n + 1]],
      images: basis.map((_, k) => [v[2 * (n + 1 + k)], v[2 * (n + 1 + k) + 1]]) };
  };
  // D on the span of the points: sum of image (outer) direction
  const spanned = (images) => [0, 1].map((i) => [0, 1].map(
    (j) => images.reduce((sum, image, k) => sum + image[i] * basis[k][j], 0)));
  const whole = solve(d);
  if (rank === 2) return { alpha: whole.alpha, linear: spanned(whole.images), constant: whole.constant };
  const m = rbfComplete(whole.images.map((image, k) => [basis[k][0] + image[0], basis[k][1] + image[1]]), basis);
  const linear = [[m[0][0] - 1, m[0][1]], [m[1][0], m[1][1] - 1]];
  // Points that are flat only to rounding lie a little off their span, where the completed map displaces them too.
  const left = Float64Array.from(d, (value, i) => {
    const q = i - (i % 2);
    return value - linear[i % 2][0] * x[q] - linear[i % 2][1] * x[q + 1];
  });
  const rest = solve(left), more = spanned(rest.images);
  return { alpha: rest.alpha, constant: rest.constant,
    linear: linear.map((row, i) => row.map((value, j) => value + more[i][j])) };
}

// Orthonormal directions that span centred points.
function rbfSpan(rows) {
  if (rows.length < 2) return [];
  const { sigma, along } = rbfPrincipal(rows);
  if (sigma[0] === 0) return [];
  return sigma[1] > RBF_FLAT * sigma[0] ? [[1, 0], [0, 1]] : [along];
}

// Singular values of rows of two numbers, falling, and the direction of the first: by one-sided Jacobi, exact to rounding.
function rbfPrincipal(rows) {
  let v = [[1, 0], [0, 1]];
  let columns = [rows.map((r) => r[0]), rows.map((r) => r[1])];
  const dot = (p, q) => p.reduce((sum, value, k) => sum + value * q[k], 0);
  for (let sweep = 0; sweep < 8; sweep++) {
    const gamma = dot(columns[0], columns[1]);
    if (gamma === 0) break;
    const zeta = (dot(columns[1], columns[1]) - dot(columns[0], columns[0])) / (2 * gamma);
    const t = (zeta < 0 ? -1 : 1) / (Math.abs(zeta) + Math.hypot(1, zeta));
    const c = 1 / Math.hypot(1, t), s = c * t;
    const turn = ([p, q]) => [p.map((value, k) => c * value - s * q[k]), p.map((value, k) => s * value + c * q[k])];
    columns = turn(columns);
    v = turn(v);
  }
  const sigma = columns.map((p) => Math.hypot(...p)), first = sigma[0] >= sigma[1] ? 0 : 1;
  return { sigma: [sigma[first], sigma[1 - first]], along: v[first] };
}

const RBF_THIN = 0.25, RBF_SOFTNESS = 0.5, RBF_LEAST_SPREAD = 1e-4;

// How far places spread across their longest direction, relative to it, in the thinner of two sets: deformnb.rbf.trends.
// thin_directions in the plane. A symmetric matrix is [xx, xy, yy].
function rbfSpreads(targets, sources) {
  const [x, y] = [targets, sources].map(rbfScaled);
  const moments = (p, q) => [0, 1].map((i) => [0, 1].map((j) => p.reduce((sum, row, k) => sum + row[i] * q[k][j], 0)));
  const xx = moments(x, x), yy = moments(y, y), yx = moments(y, x);
  const least = 2e-9 * Math.sqrt((xx[0][0] + xx[1][1]) * (yy[0][0] + yy[1][1]));
  const c = yx[0][0] + yx[1][1] + least, s = yx[1][0] - yx[0][1], length = Math.hypot(c, s) || 1;
  const back = y.map(([p, q]) => [(c * p + s * q) / length, (c * q - s * p) / length]);
  const a = rbfRelative(moments(x, x));
  const b = yy[0][0] + yy[1][1] > 0 ? rbfRelative(moments(back, back)) : a, tiny = 1e-12;
  // 2 A (A + B)^-1 B
  const [p, q, r] = [a[0][0] + b[0][0] + 2 * tiny, a[0][1] + b[0][1], a[1][1] + b[1][1] + 2 * tiny], det = p * r - q * q;
  const inverse = [[r / det, -q / det], [-q / det, p / det]];
  const times = (m, k) => [0, 1].map((i) => [0, 1].map((j) => m[i][0] * k[0][j] + m[i][1] * k[1][j]));
  const more = (m) => [[m[0][0] + tiny, m[0][1]], [m[1][0], m[1][1] + tiny]];
  const both = times(times(more(a), inverse), more(b)), off = both[0][1] + both[1][0];
  const mean = both[0][0] + both[1][1], half = Math.hypot(both[0][0] - both[1][1], off);
  const angle = Math.atan2(off, both[0][0] - both[1][1]) / 2;
  return { spread: Math.sqrt(Math.max(2 * (mean - half), 0) / (2 * (mean + half))), along: [Math.cos(angle), Math.sin(angle)] };
}

// Centred, and at most 1 in size: squares of tiny lengths would be zero.
function rbfScaled(places) {
  const mean = [0, 1].map((k) => places.reduce((sum, p) => sum + p[k] / places.length, 0));
  const centred = places.map((p) => [p[0] - mean[0], p[1] - mean[1]]);
  const size = centred.reduce((m, p) => Math.max(m, Math.abs(p[0]), Math.abs(p[1])), 0) || 1;
  return centred.map((p) => [p[0] / size, p[1] / size]);
}

// Second moments relative to their largest eigenvalue.
function rbfRelative(m) {
  const largest = (m[0][0] + m[1][1] + Math.hypot(m[0][0] - m[1][1], 2 * m[0][1])) / 2 || 1;
  return m.map((row) => row.map((value) => value / largest));
}

function rbfSpectralNorm(m) {
  const e = (m[0][0] + m[1][1]) / 2, f = (m[0][0] - m[1][1]) / 2;
  const g = (m[1][0] + m[0][1]) / 2, h = (m[1][0] - m[0][1]) / 2;
  return Math.hypot(e, h) + Math.hypot(f, g);
}

function rbfRotationOf(fit) {
  const m = [[1 + fit.linear[0][0] / fit.support, fit.linear[0][1] / fit.support],
    [fit.linear[1][0] / fit.support, 1 + fit.linear[1][1] / fit.support]];
  const c = m[0][0] + m[1][1], s = m[1][0] - m[0][1], length = Math.hypot(c, s);
  if (!(m[0][0] * m[1][1] - m[0][1] * m[1][0] > 0) || length === 0) return [[1, 0], [0, 1]];
  return [[c / length, -s / length], [s / length, c / length]];
}

// ---- remarks on a fit, as deformnb.rbf.conditioning makes them ------------------------------------------------------------

// Positions of the neighbours of a point, nearest first, itself left out.
function rbfNeighbours(merged, k, count) {
  const distance = (q) => Math.hypot(q.x[0] - merged[k].x[0], q.x[1] - merged[k].x[1]);
  const best = [];
  merged.forEach((q, j) => {
    if (j === k) return;
    const gap = distance(q);
    if (best.length === count && gap >= best[count - 1][0]) return;
    let at = best.length;
    while (at > 0 && best[at - 1][0] > gap) at--;
    best.splice(at, 0, [gap, j]);
    if (best.length > count) best.pop();
  });
  return best;
}

function rbfClosest(ready) {
  if (ready.n < 2) return "a single point";
  let found = [Infinity, 0, 0];
  for (let k = 0; k < ready.n; k++) {
    const [[gap, j]] = rbfNeighbours(ready.merged, k, 1);
    if (gap < found[0]) found = [gap, k, j];
  }
  return `${rbfLabel(ready.merged[found[1]].point)} and ${rbfLabel(ready.merged[found[2]].point)}`;
}

function rbfWarnings(ready, kernel, map) {
  const notes = [];
  const isPlain = ready.trend === "affine_exact" || (ready.trend === "affine" && RBF_KERNELS[kernel].order === 2);
  if (isPlain && rbfSpectralNorm(map) > RBF_STEEP) {
    notes.push(`the affine trend stretches more than ${RBF_STEEP} times: the control points nearly lie on one line or ` +
      "in one plane; the trend similarity would not");
  }
  const spread = (place) => Math.max(...[0, 1].map((k) => {
    const all = ready.merged.map((q) => place(q)[k]);
    return all.reduce((m, v) => Math.max(m, v), -Infinity) - all.reduce((m, v) => Math.min(m, v), Infinity);
  }));
  const collapses = { affine: "the trend collapses everything to one place",
    affine_exact: "the trend collapses everything to one place",
    similarity: "the trend collapses everything to one place", rigid: "the turn is open and stays what it was" };
  const sources = spread((q) => [q.x[0] + q.d[0], q.x[1] + q.d[1]]);
  if (Object.hasOwn(collapses, ready.trend) && sources < RBF_NO_ANGLE * spread((q) => q.x)) {
    notes.push(`the sources nearly coincide: ${collapses[ready.trend]}`);
  } else if (isPlain) {
    const largest = rbfSpectralNorm(map), det = map[0][0] * map[1][1] - map[0][1] * map[1][0];
    if (!(Math.abs(det) >= RBF_NO_ANGLE * largest * largest)) {
      notes.push("the sources lie on one line or in one plane and the targets do not: the affine trend presses " +
        "everything flat");
    }
  }
  return notes;
}

// Ids of points that share a source and have different targets.
function rbfTornPairs({ merged, n, ids }, most = 3) {
  const size = Math.max(0, ...[0, 1].map((k) => rbfExtent(merged.map((q) => [q.x[k], 0]))));
  const found = [];
  for (let i = 0; i < n && size > 0 && found.length < most; i++) {
    for (let j = i + 1; j < n && found.length < most; j++) {
      const gap = [0, 1].map((k) => merged[i].x[k] + merged[i].d[k] - merged[j].x[k] - merged[j].d[k]);
      if (Math.hypot(...gap) <= RBF_SAME_PLACE * size) found.push([ids[i], ids[j]]);
    }
  }
  return found;
}

function rbfCrossingPairs(ready, map, most = 3) {
  const { merged, n } = ready;
  if (n < 2) return [];
  const moved = merged.map(({ d, x }) => [0, 1].map((k) => d[k] + x[k] - map[k][0] * x[0] - map[k][1] * x[1]));
  const pairs = new Map();
  for (let i = 0; i < n; i++) {
    for (const [, j] of rbfNeighbours(merged, i, Math.min(n, 5) - 1)) {
      const gap = [merged[i].x[0] - merged[j].x[0], merged[i].x[1] - merged[j].x[1]];
      const along = Math.max(RBF_COLLAPSED * Math.hypot(...gap), // beyond that the ratio would be rounding
        Math.hypot(...map.map((row) => row[0] * gap[0] + row[1] * gap[1])));
      const beside = Math.hypot(moved[i][0] - moved[j][0], moved[i][1] - moved[j][1]);
      // In quarters of an octave, as in deformnb.rbf.conditioning: neither rounding nor a small move changes who is named.
      const degree = Math.round(4 * Math.log2(beside / along));
      if (beside > along) pairs.set(Math.min(i, j) * n + Math.max(i, j), [Math.min(i, j), Math.max(i, j), degree]);
    }
  }
  const worst = [...pairs].sort(([p, [,, d]], [q, [,, e]]) => e - d || p - q).slice(0, most);
  return worst.filter(([, [,, degree]]) => degree >= worst[0][1][2] - RBF_FAR_BEHIND).sort(([p], [q]) => p - q)
    .map(([, [i, j]]) => [ready.ids[i], ready.ids[j]]);
}
