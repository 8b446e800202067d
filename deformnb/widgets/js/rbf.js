// The fit of control points on a picture, equal to deformnb.rbf.fit_rbf for dimension 2. Needs rbf_solve.js. No DOM.
//
//   rbfFit(points, settings)    -> fit; throws RbfError with a message for people
//   rbfAt(fit, a, b)            -> [da, db], the backward displacement at a place of the picture
//   rbfJacobianAt(fit, a, b)    -> [[dDa/da, dDa/db], [dDb/da, dDb/db]]
//   rbfOnRaster(fit, raster)    -> Float32Array (nv * nu * 2) of displacements at the pixels of {shape, spacing, origin}
//   RBF_KERNELS, RBF_TRENDS     the same names, in the same order, as KERNELS and TRENDS of the package
//
// points: [{id, name, source: [a, b], target: [a, b], active, weight}]
// settings: {kernel, support, trend, smoothing, strength, lone_support, previous}; all may be left out.
// fit.notes are for people; those of them in fit.doubts say that the map may fold, which is not measured here.
// All arithmetic is in float64, as in the package; a test compares the two for every kernel and trend.

class RbfError extends Error {}

const RBF_TINY = 1e-30;
const RBF_SAME_PLACE = 1e-6;
const RBF_SAME_DISPLACEMENT = 1e-9;
const RBF_FLAT = 1e-7;
const RBF_LARGEST_SET = 2000;
const RBF_LARGEST_COORDINATE = 1e15;
const RBF_RESIDUAL = 1e-7;
const RBF_ROUNDING = 1e-10;
const RBF_STEEP = 10;
const RBF_NO_ANGLE = 1e-6;
const RBF_COLLAPSED = 1e-6, RBF_FAR_BEHIND = 12;

// profile(s) and slope(s) = d profile / d s of the squared relative distance s, as in deformnb.kernels.
const RBF_KERNELS = {
  wendland_c2: {
    title: "Wendland C2", order: 0, compact: true,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s), q = t * t; return q * q * (5 - 4 * t); },
    slope: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return -10 * t * t * t; },
  },
  wendland_c0: {
    title: "Wendland C0", order: 0, compact: true,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return t * t; },
    slope: (s) => { const r = Math.sqrt(Math.max(s, RBF_TINY)); return r >= 1 ? 0 : -(1 - r) / r; },
  },
  wendland_c4: {
    title: "Wendland C4", order: 0, compact: true,
    profile: (s) => {
      if (s >= 1) return 0;
      const r = Math.sqrt(s), t = 1 - r, q = t * t;
      return q * q * q * (35 * s + 18 * r + 3) / 3;
    },
    slope: (s) => { if (s >= 1) return 0; const r = Math.sqrt(s); return (-28 / 3) * (1 + 5 * r) * (1 - r) ** 5; },
  },
  thin_plate: {
    title: "Thin-plate spline", order: 2, compact: false,
    profile: (s) => 0.5 * s * Math.log(Math.max(s, RBF_TINY)),
    slope: (s) => 0.5 * (Math.log(Math.max(s, RBF_TINY)) + 1),
  },
  gaussian: {
    title: "Gaussian", order: 0, compact: false,
    profile: (s) => Math.exp(-4.5 * s),
    slope: (s) => -4.5 * Math.exp(-4.5 * s),
  },
  multiquadric: {
    title: "Multiquadric", order: 1, compact: false,
    profile: (s) => -Math.sqrt(1 + 16 * s),
    slope: (s) => -8 / Math.sqrt(1 + 16 * s),
  },
  cubic: {
    title: "Cubic", order: 2, compact: false,
    profile: (s) => s * Math.sqrt(s),
    slope: (s) => 1.5 * Math.sqrt(s),
  },
  linear: {
    title: "Linear", order: 1, compact: false,
    profile: (s) => -Math.sqrt(s),
    slope: (s) => -0.5 / Math.sqrt(Math.max(s, RBF_TINY)),
  },
};

// order: the largest order of a kernel that the trend can be paired with.
const RBF_TRENDS = {
  affine: { title: "Affine", order: 2 },
  similarity: { title: "Similarity (turn, scale, shift)", order: 1 },
  rigid: { title: "Rigid (turn, shift)", order: 1 },
  translation: { title: "Translation", order: 1 },
  none: { title: "None", order: 0 },
};

// ---- the fit --------------------------------------------------------------------------------------------------------

function rbfFit(points, settings = {}) {
  const kernel = settings.kernel ?? "wendland_c2", trend = settings.trend ?? "affine";
  const smoothing = settings.smoothing ?? 0, strength = settings.strength ?? 1;
  rbfCheckSettings(kernel, trend, smoothing, strength, settings.support ?? null);
  rbfCheckPoints(points);
  const active = points.filter((p) => p.active !== false);
  if (active.length > RBF_LARGEST_SET) {
    throw new RbfError(`${active.length} control points are more than the ${RBF_LARGEST_SET} a dense solve is meant ` +
      "for; switch some off or thin them out.");
  }
  // The radius is that of the points as dragged, at full strength, as in deformnb.deformation.Step.
  const radius = rbfRadius(active, settings.support ?? rbfDefaultSupport(active) ?? settings.lone_support ?? null, trend);
  const ready = rbfPrepare(active, kernel, radius, trend, smoothing, strength);
  if (ready.n === 0) return rbfIdentity(ready, kernel, "none", 1);
  return rbfSolvePrepared(ready, kernel, smoothing, settings.previous ?? null);
}

function rbfCheckSettings(kernel, trend, smoothing, strength, support) {
  if (!Object.hasOwn(RBF_KERNELS, kernel)) {
    throw new RbfError(`unknown kernel '${kernel}'; choose one of ${Object.keys(RBF_KERNELS).join(", ")}.`);
  }
  if (!Object.hasOwn(RBF_TRENDS, trend)) {
    throw new RbfError(`unknown trend '${trend}'; choose one of ${Object.keys(RBF_TRENDS).join(", ")}.`);
  }
  if (support !== null && !(Number.isFinite(support) && support > 0)) {
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

function rbfLabel(point) {
  return `control point ${point.id}${point.name ? ` ("${point.name}")` : ""}`;
}

function rbfCheckPoints(points) {
  for (const p of points) {
    for (const what of ["source", "target"]) {
      const place = p[what];
      const good = Array.isArray(place) && place.length === 2 &&
        place.every((v) => Number.isFinite(v) && Math.abs(v) <= RBF_LARGEST_COORDINATE);
      if (!good) {
        throw new RbfError(`the ${what} of ${rbfLabel(p)} is [${place}]; coordinates must be finite and below 1e15. ` +
          "Correct or remove that point.");
      }
    }
    const weight = p.weight ?? 1;
    if (!(Number.isFinite(weight) && weight > 0)) {
      throw new RbfError(`the weight of ${rbfLabel(p)} is ${weight}; weights must be positive numbers.`);
    }
  }
}

function rbfBoxDiagonal(points, key) {
  const size = [0, 1].map((k) => {
    let low = Infinity, high = -Infinity;
    for (const p of points) { low = Math.min(low, p[key][k]); high = Math.max(high, p[key][k]); }
    return high - low;
  });
  return Math.hypot(size[0], size[1]);
}

// The diagonal of the box of the active sources (of the targets if the sources coincide); null for one place.
function rbfDefaultSupport(points) {
  const active = points.filter((p) => p.active !== false);
  if (active.length === 0) return null;
  const sources = rbfBoxDiagonal(active, "source"), targets = rbfBoxDiagonal(active, "target");
  return (sources > RBF_SAME_PLACE * targets ? sources : targets) || null;
}

function rbfRadius(active, radius, trend) {
  if (radius !== null) return radius;
  if (active.length && trend === "none") {
    throw new RbfError(`${rbfLabel(active[0])} is alone and there is no trend, so nothing tells how far it reaches; ` +
      "give a support radius.");
  }
  return 1; // a translation does not depend on it
}

function rbfPrepare(active, kernel, radius, trend, smoothing, strength) {
  const places = active.map((p) => ({
    point: p, w: p.weight ?? 1,
    x: [0, 1].map((k) => p.source[k] + strength * (p.target[k] - p.source[k])),
  }));
  if (strength === 1) for (const q of places) q.x = [...q.point.target];
  for (const q of places) q.d = [q.point.source[0] - q.x[0], q.point.source[1] - q.x[1]];
  const { merged, notes } = rbfMerge(places, radius, smoothing);
  const n = merged.length;
  const origin = n ? [0, 1].map((k) => merged.reduce((sum, q) => sum + q.x[k], 0) / n) : [0, 0];
  const basis = rbfSpan(merged.map((q) => [q.x[0] - origin[0], q.x[1] - origin[1]]));
  const [name, remark] = rbfBearable(trend, kernel, n, basis.length);
  return { n, merged, origin, radius, basis, trend: name, notes: [...notes, ...remark],
    ids: merged.map((q) => q.point.id) };
}

// Points at one place become one, found through a sort along a so that 2000 points take no longer than a few.
function rbfMerge(places, radius, smoothing) {
  const near = RBF_SAME_PLACE * radius, order = places.map((_, k) => k).sort((i, j) => places[i].x[0] - places[j].x[0]);
  const parent = places.map((_, k) => k);
  const root = (k) => { while (parent[k] !== k) k = parent[k] = parent[parent[k]]; return k; };
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
  const groups = new Map();
  places.forEach((q, k) => { const r = root(k); if (groups.has(r)) groups.get(r).push(q); else groups.set(r, [q]); });
  const merged = [], notes = [];
  for (const members of groups.values()) { // in the order of their first members
    const w = members.reduce((sum, q) => sum + q.w, 0);
    const mean = (key) => [0, 1].map((k) => members.reduce((sum, q) => sum + q.w * q[key][k], 0) / w);
    merged.push({ point: members[0].point, w, x: mean("x"), d: mean("d") });
    if (members.length > 1) {
      notes.push(`${members.map((q) => rbfLabel(q.point)).join(", ")} are at one place and count as one`);
    }
  }
  return { merged, notes };
}

function rbfRefuseConflicts(places, pairs, radius) {
  for (const [i, j] of pairs) {
    const p = places[i], q = places[j];
    if (Math.hypot(p.d[0] - q.d[0], p.d[1] - q.d[1]) <= RBF_SAME_DISPLACEMENT * radius) continue;
    const [place, one, two] = [p.x, p.d, q.d].map((v) => `(${v.map(rbfShown).join(", ")})`);
    throw new RbfError(`${rbfLabel(p.point)} and ${rbfLabel(q.point)} are at the same place ${place} but ask for ` +
      `different displacements ${one} and ${two}; move or delete one, or turn smoothing on.`);
  }
}

function rbfShown(value) {
  return String(Number(value.toPrecision(6)));
}

function rbfBearable(trend, kernel, n, rank) {
  if (n === 0 || trend === "none" || trend === "translation" || rank === 2) return [trend, []];
  if (rank === 0) {
    return [RBF_KERNELS[kernel].order === 2 ? trend : "translation", ["one control point: the trend is a translation"]];
  }
  if (trend !== "affine") return [trend, []];
  return [trend, ["the control points lie on one line: across it the affine trend goes on as a similarity"]];
}

function rbfIdentity(ready, kernel, trend, support) {
  const centers = new Float64Array(2 * ready.n);
  ready.merged.forEach((q, k) => {
    centers[2 * k] = (q.x[0] - ready.origin[0]) / support;
    centers[2 * k + 1] = (q.x[1] - ready.origin[1]) / support;
  });
  return { count: ready.n, centers, coefficients: new Float64Array(2 * ready.n), linear: [[0, 0], [0, 0]],
    constant: [0, 0], origin: ready.origin, support, kernel, trend, ids: ready.ids, notes: ready.notes, doubts: [] };
}

function rbfSolvePrepared(ready, kernel, smoothing, previous) {
  const { n, radius: r } = ready;
  const fit = rbfIdentity(ready, kernel, ready.trend, r);
  const d = new Float64Array(2 * n);
  ready.merged.forEach((q, k) => { d[2 * k] = q.d[0] / r; d[2 * k + 1] = q.d[1] / r; });
  if (d.every((value) => value === 0)) return fit; // exactly the identity, which a solve would miss by rounding
  const nugget = ready.merged.map((q) => smoothing / q.w);
  const turn = previous === null ? [[1, 0], [0, 1]] : rbfRotationOf(previous);
  const { alpha, linear, constant, miss } = rbfSolve(fit.centers, d, nugget, ready.basis, turn, kernel, ready.trend);
  const largest = (array) => array.reduce((most, value) => (Math.abs(value) <= most ? most : Math.abs(value)), 0);
  if (!(largest(miss) <= RBF_RESIDUAL * largest(d) + RBF_ROUNDING * largest(fit.centers))) {
    throw new RbfError(`the ${kernel} kernel with support ${rbfShown(r)} is too flat for these ${n} control points: ` +
      `the system is singular to working precision (closest are ${rbfClosest(ready)}). Use a smaller support, a ` +
      "Wendland kernel, or a little smoothing.");
  }
  const map = [[1 + linear[0][0], linear[0][1]], [linear[1][0], 1 + linear[1][1]]];
  const crossed = rbfCrossingPairs(ready, map).map(
    ([i, j]) => `control points ${i} and ${j} are pulled past each other: the map may fold there`);
  return { ...fit, coefficients: alpha.map((value) => value * r), linear: linear.map((row) => row.map((m) => m * r)),
    constant: constant.map((value) => value * r), notes: [...ready.notes, ...crossed, ...rbfWarnings(ready, map)],
    doubts: crossed };
}

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

function rbfWarnings(ready, map) {
  const notes = [];
  if (ready.trend === "affine" && rbfSpectralNorm(map) > RBF_STEEP) {
    notes.push(`the affine trend stretches more than ${RBF_STEEP} times: the control points nearly lie on one line or ` +
      "in one plane; the trend similarity would not");
  }
  const spread = (place) => Math.max(...[0, 1].map((k) => {
    const all = ready.merged.map((q) => place(q)[k]);
    return all.reduce((m, v) => Math.max(m, v), -Infinity) - all.reduce((m, v) => Math.min(m, v), Infinity);
  }));
  const collapses = { affine: "the trend collapses everything to one place",
    similarity: "the trend collapses everything to one place", rigid: "the turn is open and stays what it was" };
  const sources = spread((q) => [q.x[0] + q.d[0], q.x[1] + q.d[1]]);
  if (Object.hasOwn(collapses, ready.trend) && sources < RBF_NO_ANGLE * spread((q) => q.x)) {
    notes.push(`the sources nearly coincide: ${collapses[ready.trend]}`);
  }
  return notes;
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
      // In quarters of an octave, as in deformnb.degenerate: neither rounding nor a small move changes who is named.
      const degree = Math.round(4 * Math.log2(beside / along));
      if (beside > along) pairs.set(Math.min(i, j) * n + Math.max(i, j), [Math.min(i, j), Math.max(i, j), degree]);
    }
  }
  const worst = [...pairs].sort(([p, [,, d]], [q, [,, e]]) => e - d || p - q).slice(0, most);
  return worst.filter(([, [,, degree]]) => degree >= worst[0][1][2] - RBF_FAR_BEHIND).sort(([p], [q]) => p - q)
    .map(([, [i, j]]) => [ready.ids[i], ready.ids[j]]);
}

// ---- evaluation -----------------------------------------------------------------------------------------------------

function rbfAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count } = fit;
  const profile = RBF_KERNELS[fit.kernel].profile;
  let u = linear[0][0] * p + linear[0][1] * q + constant[0], v = linear[1][0] * p + linear[1][1] * q + constant[1];
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], phi = profile(dp * dp + dq * dq);
    u += alpha[j] * phi;
    v += alpha[j + 1] * phi;
  }
  return [u, v];
}

function rbfJacobianAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, count } = fit, slope = RBF_KERNELS[fit.kernel].slope;
  let [[m00, m01], [m10, m11]] = linear;
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], g = 2 * slope(dp * dp + dq * dq);
    m00 += alpha[j] * g * dp;
    m01 += alpha[j] * g * dq;
    m10 += alpha[j + 1] * g * dp;
    m11 += alpha[j + 1] * g * dq;
  }
  return [[m00 / r, m01 / r], [m10 / r, m11 / r]];
}

// Displacements at the pixels of a raster {shape: [nv, nu], spacing: [du, dv], origin: [a, b]}, component last.
// One centre after the other, and for compact kernels only the columns that it reaches: the row's distance is constant.
function rbfOnRaster(fit, raster, out = null) {
  const [nv, nu] = raster.shape, [du, dv] = raster.spacing, r = fit.support;
  const map = out ?? new Float32Array(nv * nu * 2);
  const step = du / r, p0 = (raster.origin[0] - fit.origin[0]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count } = fit;
  const { profile, compact } = RBF_KERNELS[fit.kernel], row = new Float64Array(2 * nu);
  for (let i = 0; i < nv; i++) {
    const q = (raster.origin[1] + i * dv - fit.origin[1]) / r;
    for (let k = 0; k < nu; k++) {
      const p = p0 + k * step;
      row[2 * k] = linear[0][0] * p + linear[0][1] * q + constant[0];
      row[2 * k + 1] = linear[1][0] * p + linear[1][1] * q + constant[1];
    }
    for (let c = 0, j = 0; c < count; c++, j += 2) {
      const au = alpha[j], av = alpha[j + 1], dq2 = (q - x[j + 1]) ** 2;
      if ((au === 0 && av === 0) || (compact && dq2 >= 1)) continue;
      const reach = compact ? Math.sqrt(1 - dq2) : Infinity;
      const first = Math.max(0, Math.ceil((x[j] - reach - p0) / step));
      const last = Math.min(nu - 1, Math.floor((x[j] + reach - p0) / step));
      for (let k = first; k <= last; k++) {
        const dp = p0 + k * step - x[j], phi = profile(dp * dp + dq2);
        row[2 * k] += au * phi;
        row[2 * k + 1] += av * phi;
      }
    }
    map.set(row, 2 * nu * i);
  }
  return map;
}
