// The fit of control points on a picture, equal to deformnb.rbf.interpolant.fit_rbf for dimension 2. Needs rbf_solve.js. No DOM.
//
//   rbfFit(points, settings)    -> fit; throws RbfError with a message for people
//   rbfAt(fit, a, b)            -> [da, db], the backward displacement at a place of the picture
//   rbfJacobianAt(fit, a, b)    -> [[dDa/da, dDa/db], [dDb/da, dDb/db]]
//   rbfOnRaster(fit, raster)    -> Float32Array (nv * nu * 2) of displacements at the pixels of {shape, spacing, origin}
//   RBF_KERNELS, RBF_TRENDS     the same names, in the same order, as KERNELS and TRENDS of the package
//
// points: [{id, name, source: [a, b], target: [a, b], active, weight, radius}]; radius: null, or a support radius of the
//   point's own
// settings: {kernel, support, chosen_support, trend, smoothing, strength, lone_support, previous}; all may be left out.
//   support: a radius, null or "box_diagonal"; chosen_support: what Python chose while it is null
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
const RBF_MOST_GAIN = 1e5;
const RBF_STEEP = 10;
const RBF_LONGEST_SHARE = 100;
const RBF_NO_ANGLE = 1e-6;
const RBF_COLLAPSED = 1e-6, RBF_FAR_BEHIND = 12;

// share: of the box's diagonal that the usual support is; gaps: the longest one beside points in a row, in gaps.
// profile(s) and slope(s) = d profile / d s of the squared relative distance s, as in deformnb.rbf.kernels.
const RBF_KERNELS = {
  wendland_c2: {
    title: "Wendland C2", order: 0, compact: true, share: 1, gaps: 16,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s), q = t * t; return q * q * (5 - 4 * t); },
    slope: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return -10 * t * t * t; },
  },
  wendland_c0: {
    title: "Wendland C0", order: 0, compact: true, share: 1, gaps: Infinity,
    profile: (s) => { if (s >= 1) return 0; const t = 1 - Math.sqrt(s); return t * t; },
    slope: (s) => { const r = Math.sqrt(Math.max(s, RBF_TINY)); return r >= 1 ? 0 : -(1 - r) / r; },
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
    profile: (s) => 0.5 * s * Math.log(Math.max(s, RBF_TINY)),
    slope: (s) => 0.5 * (Math.log(Math.max(s, RBF_TINY)) + 1),
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
  cubic: {
    title: "Cubic", order: 2, compact: false, share: 1, gaps: Infinity,
    profile: (s) => s * Math.sqrt(s),
    slope: (s) => 1.5 * Math.sqrt(s),
  },
  linear: {
    title: "Linear", order: 1, compact: false, share: 1, gaps: Infinity,
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
  affine_exact: { title: "Affine, exact across a row of points too", order: 2 },
};

// ---- the fit --------------------------------------------------------------------------------------------------------

function rbfFit(points, settings = {}) {
  const kernel = settings.kernel ?? "wendland_c2", trend = settings.trend ?? "affine";
  const smoothing = settings.smoothing ?? 0, strength = settings.strength ?? 1;
  rbfCheckSettings(kernel, trend, smoothing, strength, settings.support ?? null);
  rbfCheckPoints(points);
  const active = points.filter((p) => p.active !== false);
  if (RBF_KERNELS[kernel].order > 0 && active.some((p) => (p.radius ?? null) !== null)) {
    throw new RbfError(`control points have support radii of their own, and the ${kernel} kernel, which has no end, knows ` +
      "none; choose a Wendland kernel or the Gaussian, or clear their radii.");
  }
  if (active.length > RBF_LARGEST_SET) {
    throw new RbfError(`${active.length} control points are more than the ${RBF_LARGEST_SET} a dense solve is meant ` +
      "for; switch some off or thin them out.");
  }
  // The radius is that of the points as dragged, at full strength, as in deformnb.document.deformation.Step.
  const radius = rbfRadius(active, rbfSupport(points, settings), trend);
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
    const radius = p.radius ?? 1;
    if (!(radius > 0 && radius <= RBF_LARGEST_COORDINATE)) {
      throw new RbfError(`the radius of ${rbfLabel(p)} is ${radius}; a radius is a positive length, or null for that of all.`);
    }
  }
}

// The places that do not move during a drag: the active sources, or the targets if the sources coincide.
function rbfAtRest(points) {
  const active = points.filter((p) => p.active !== false);
  const sources = active.map((p) => p.source), targets = active.map((p) => p.target);
  return rbfExtent(sources) > RBF_SAME_PLACE * rbfExtent(targets) ? sources : targets;
}

// The diagonal of the box of places; 0 for none.
function rbfExtent(places) {
  const size = [0, 1].map((k) => places.reduce((m, p) => Math.max(m, p[k]), -Infinity) -
    places.reduce((m, p) => Math.min(m, p[k]), Infinity));
  return places.length ? Math.hypot(size[0], size[1]) : 0;
}

function rbfBoxDiagonal(points) {
  return rbfExtent(rbfAtRest(points)) || null;
}

// The support of points that say nothing of it themselves: a share of their box, less for points in a row.
function rbfUsualSupport(points, kernel) {
  const places = rbfAtRest(points), size = rbfExtent(places), { share, gaps } = RBF_KERNELS[kernel];
  if (size === 0) return null;
  const isThin = rbfSpreads(places, places).spread < RBF_THIN;
  return size * (isThin ? Math.min(share, 0.5, gaps / Math.max(1, places.length - 1)) : share);
}

// The support radius of a set of points: as given, by a rule, as it was chosen, the usual one, or that of a lone point.
function rbfSupport(points, settings) {
  const { support, chosen_support: chosen, lone_support: lone, kernel = "wendland_c2" } = settings;
  const own = support === "box_diagonal" ? rbfBoxDiagonal(points)
    : support ?? chosen ?? rbfUsualSupport(points, kernel);
  return own ?? lone ?? null;
}

function rbfRadius(active, radius, trend) {
  if (radius !== null) return radius;
  if (active.length && trend === "none") {
    throw new RbfError(`${rbfLabel(active[0])} is alone and there is no trend, so nothing tells how far it reaches; ` +
      "give a support radius.");
  }
  return 1; // a translation does not depend on it
}

function rbfPrepare(active, kernel, given, trend, smoothing, strength) {
  const places = active.map((p) => ({
    point: p, w: p.weight ?? 1,
    x: [0, 1].map((k) => p.source[k] + strength * (p.target[k] - p.source[k])),
  }));
  if (strength === 1) for (const q of places) q.x = [...q.point.target];
  for (const q of places) q.d = [q.point.source[0] - q.x[0], q.point.source[1] - q.x[1]];
  const box = rbfBoxDiagonal(places.map((q) => ({ source: q.point.source, target: q.x }))) ?? Infinity, limited = [];
  let radius = given;
  if (RBF_KERNELS[kernel].compact && given > RBF_LONGEST_SHARE * box) {
    radius = RBF_LONGEST_SHARE * box;
    limited.push(`the support radius is limited to ${RBF_LONGEST_SHARE} diagonals of the control points' box; beyond that ` +
      "the map hardly changes");
  }
  const { merged, notes } = rbfMerge(places, radius, Math.min(radius, box), smoothing);
  const n = merged.length;
  const origin = n ? [0, 1].map((k) => merged.reduce((sum, q) => sum + q.x[k], 0) / n) : [0, 0];
  const basis = rbfSpan(merged.map((q) => [q.x[0] - origin[0], q.x[1] - origin[1]]));
  const { ridge, where } = rbfThinness(merged, basis);
  const [name, remark] = rbfBearable(trend, kernel, n, basis.length, where);
  return { n, merged, origin, radius, basis, ridge, trend: name, notes: [...limited, ...notes, ...remark],
    ids: merged.map((q) => q.point.id) };
}

// The penalty of the trend "affine" across a row of points, and where the row lies, in words; nothing for wide sets.
function rbfThinness(merged, basis) {
  if (merged.length < 2 || basis.length === 0) return { ridge: null, where: "" };
  const { spread, along } = rbfSpreads(merged.map((q) => q.x), merged.map((q) => [q.x[0] + q.d[0], q.x[1] + q.d[1]]));
  if (spread >= RBF_THIN) return { ridge: null, where: "" };
  const s = Math.max(spread, RBF_LEAST_SPREAD), weight = ((RBF_THIN - s) / s) ** 2 / RBF_SOFTNESS;
  const across = [-along[1], along[0]], quarters = rbfRound(Math.atan2(along[1], along[0]) * 180 / Math.PI / 15);
  const degrees = ((quarters * 15) % 180 + 180) % 180;
  return { ridge: across.map((p) => across.map((q) => weight * p * q)), where: `on one line, at ${degrees} degrees` };
}

function rbfRound(value) { // halves go to the even number, as in Python
  const low = Math.floor(value), rest = value - low;
  return rest < 0.5 || (rest === 0.5 && low % 2 === 0) ? low : low + 1;
}

// Points at one place become one, found through a sort along a so that 2000 points take no longer than a few.
function rbfMerge(places, radius, reach, smoothing) {
  const near = RBF_SAME_PLACE * reach, order = places.map((_, k) => k).sort((i, j) => places[i].x[0] - places[j].x[0]);
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

function rbfBearable(trend, kernel, n, rank, where) {
  if (n === 0 || trend === "none" || trend === "translation") return [trend, []];
  const { order } = RBF_KERNELS[kernel];
  if (rank === 0) return [order === 2 ? trend : "translation", ["one control point: the trend is a translation"]];
  if (!where || !trend.startsWith("affine")) return [trend, []];
  const lie = `the control points lie nearly ${where}: across it`;
  if (trend === "affine" && order < 2) return [trend, [`${lie} the affine trend turns and scales as along it`]];
  return [trend, [`${lie} nothing holds the affine trend, which may shear or stretch without bounds; a Wendland kernel ` +
    "with the trend affine stays calm"]];
}

function rbfIdentity(ready, kernel, trend, support) {
  const centers = new Float64Array(2 * ready.n);
  ready.merged.forEach((q, k) => {
    centers[2 * k] = (q.x[0] - ready.origin[0]) / support;
    centers[2 * k + 1] = (q.x[1] - ready.origin[1]) / support;
  });
  const radii = ready.merged.map((q) => q.point.radius ?? ready.radius), isOwn = radii.some((r) => r !== ready.radius);
  const scales = isOwn ? Float64Array.from(radii, (r) => ready.radius / r) : null;
  return { count: ready.n, scales, centers, coefficients: new Float64Array(2 * ready.n), linear: [[0, 0], [0, 0]],
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
  const { alpha, linear, constant, miss } = rbfSolve(fit.centers, d, nugget, ready, turn, kernel, ready.trend,
    fit.scales);
  const largest = (array) => array.reduce((most, value) => (most >= Math.abs(value) || Number.isNaN(most) ? most
    : Math.abs(value)), 0);
  if (fit.scales && !(largest(alpha) <= RBF_MOST_GAIN * largest(d))) {
    throw new RbfError("the support radii that these control points have of their own do not go together: the system is " +
      `nearly singular (closest are ${rbfClosest(ready)}). Give neighbours more similar radii, or smaller ones.`);
  }
  if (!(largest(miss) <= RBF_RESIDUAL * largest(d) + RBF_ROUNDING * largest(fit.centers))) {
    throw new RbfError(`the ${kernel} kernel with support ${rbfShown(r)} is too flat for these ${n} control points: ` +
      `the system is singular to working precision (closest are ${rbfClosest(ready)}). Use a smaller support, a ` +
      "Wendland kernel, or a little smoothing.");
  }
  const map = [[1 + linear[0][0], linear[0][1]], [linear[1][0], 1 + linear[1][1]]];
  const torn = rbfTornPairs(ready), isTorn = ([i, j]) => torn.some(([p, q]) => p === i && q === j);
  const crossed = torn.map(
    ([i, j]) => `control points ${i} and ${j} share a source and have different targets: the map folds between them`);
  crossed.push(...rbfCrossingPairs(ready, map).filter((pair) => !isTorn(pair)).map(
    ([i, j]) => `control points ${i} and ${j} are pulled past each other: the map may fold there`));
  return { ...fit, coefficients: alpha.map((value) => value * r), linear: linear.map((row) => row.map((m) => m * r)),
    constant: constant.map((value) => value * r), notes: [...ready.notes, ...crossed, ...rbfWarnings(ready, kernel, map)],
    doubts: crossed };
}

// ---- evaluation -----------------------------------------------------------------------------------------------------

function rbfAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const profile = RBF_KERNELS[fit.kernel].profile;
  let u = linear[0][0] * p + linear[0][1] * q + constant[0], v = linear[1][0] * p + linear[1][1] * q + constant[1];
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], s = dp * dp + dq * dq;
    const phi = profile(scales ? s * scales[k] * scales[k] : s);
    u += alpha[j] * phi;
    v += alpha[j + 1] * phi;
  }
  return [u, v];
}

function rbfJacobianAt(fit, a, b) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, count, scales } = fit, slope = RBF_KERNELS[fit.kernel].slope;
  let [[m00, m01], [m10, m11]] = linear;
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

// Displacements at the pixels of a raster {shape: [nv, nu], spacing: [du, dv], origin: [a, b]}, component last.
// One centre after the other, and for compact kernels only the columns that it reaches: the row's distance is constant.
function rbfOnRaster(fit, raster, out = null) {
  const [nv, nu] = raster.shape, [du, dv] = raster.spacing, r = fit.support;
  const map = out ?? new Float32Array(nv * nu * 2);
  const step = du / r, p0 = (raster.origin[0] - fit.origin[0]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const { profile, compact } = RBF_KERNELS[fit.kernel], row = new Float64Array(2 * nu);
  for (let i = 0; i < nv; i++) {
    const q = (raster.origin[1] + i * dv - fit.origin[1]) / r;
    for (let k = 0; k < nu; k++) {
      const p = p0 + k * step;
      row[2 * k] = linear[0][0] * p + linear[0][1] * q + constant[0];
      row[2 * k + 1] = linear[1][0] * p + linear[1][1] * q + constant[1];
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
