// What an editor shows of a fit: its slope, and where lines of the picture go. Needs maths/cuts.js. No DOM.

import { marginOf, regionKey } from "./cuts.js";
import { RBF_KERNELS } from "./rbf.js";
import { fieldAt, partsAt } from "./rigid_stages.js";

export const NO_CUTS = { fits: [], regions: [], rule: "source", count: 0, byKey: new Map() };

const PARTS_AROUND = Array.from({ length: 5 }, () => new Float64Array(3)); // at a place and beside it

// y + D(y) and its Jacobian at (a, b) of any fit: [a', b', j00, j01, j10, j11]. What rigid parts do is differenced.
export function fieldWithSlope(fit, a, b, out) {
  if (fit.stages) return stagedWithSlope(fit, a, b, out);
  if (!fit.rigid) return mapWithSlope(fit, a, b, out);
  const { rigid, base } = fit, h = 1e-5 * base.support, [at, east, west, south, north] = PARTS_AROUND, d = 1 / (2 * h);
  partsAt(rigid, a, b, at);
  partsAt(rigid, a + h, b, east);
  partsAt(rigid, a - h, b, west);
  partsAt(rigid, a, b + h, south);
  partsAt(rigid, a, b - h, north);
  mapWithSlope(base, a, b, out);
  const w = at[2], u = out[0] - a, v = out[1] - b, wa = d * (east[2] - west[2]), wb = d * (south[2] - north[2]);
  out[0] = a + at[0] + w * u;
  out[1] = b + at[1] + w * v;
  out[2] = 1 + d * (east[0] - west[0]) + w * (out[2] - 1) + wa * u;
  out[3] = d * (south[0] - north[0]) + w * out[3] + wb * u;
  out[4] = d * (east[1] - west[1]) + w * out[4] + wa * v;
  out[5] = 1 + d * (south[1] - north[1]) + w * (out[5] - 1) + wb * v;
  return out;
}

const STAGE_WORK = new Float64Array(6);

// The same of stages, by the chain rule: the last comes first.
function stagedWithSlope({ stages }, a, b, out) {
  const t = STAGE_WORK;
  let m00 = 1, m01 = 0, m10 = 0, m11 = 1, x = a, y = b;
  for (let k = stages.length - 1; k >= 0; k--) {
    fieldWithSlope(stages[k], x, y, t);
    [x, y] = t;
    [m00, m10] = [t[2] * m00 + t[3] * m10, t[4] * m00 + t[5] * m10];
    [m01, m11] = [t[2] * m01 + t[3] * m11, t[4] * m01 + t[5] * m11];
  }
  out.set([x, y, m00, m01, m10, m11]);
  return out;
}

// y + D(y) and its Jacobian at (a, b) in one pass over the centres: [a', b', j00, j01, j10, j11].
function mapWithSlope(fit, a, b, out) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count, scales } = fit;
  const { profile, slope } = RBF_KERNELS[fit.kernel];
  let u = linear[0][0] * p + linear[0][1] * q + constant[0], v = linear[1][0] * p + linear[1][1] * q + constant[1];
  let j00 = linear[0][0], j01 = linear[0][1], j10 = linear[1][0], j11 = linear[1][1];
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], w = scales ? scales[k] * scales[k] : 1;
    const s = (dp * dp + dq * dq) * w, phi = profile(s), g = 2 * w * slope(s);
    u += alpha[j] * phi;
    v += alpha[j + 1] * phi;
    j00 += alpha[j] * g * dp;
    j01 += alpha[j] * g * dq;
    j10 += alpha[j + 1] * g * dp;
    j11 += alpha[j + 1] * g * dq;
  }
  out[0] = a + u;
  out[1] = b + v;
  out[2] = 1 + j00 / r;
  out[3] = j01 / r;
  out[4] = j10 / r;
  out[5] = 1 + j11 / r;
  return out;
}

// Where the feature at (a, b) of the input appears: y with y + D(y) = (a, b), by damped Newton from a start; in stages,
// where that goes astray, one after the other. Writes y to `at` (which holds the start) and returns true where it was
// found; a fold may have no such place.
export function mapInverse(fit, a, b, at, tolerance, work) {
  if (newtonInverse(fit, a, b, at, tolerance, work)) return true;
  if (!fit.stages) return false;
  at[0] = a;
  at[1] = b;
  for (const stage of fit.stages) if (!newtonInverse(stage, at[0], at[1], at, 0.1 * tolerance)) return false;
  return newtonInverse(fit, a, b, at, tolerance, work);
}

function newtonInverse(fit, a, b, at, tolerance, work) {
  const t = work ?? new Float64Array(6);
  fieldWithSlope(fit, at[0], at[1], t);
  let error = Math.hypot(t[0] - a, t[1] - b);
  for (let turn = 0; turn < 12 && error > tolerance; turn++) {
    const det = t[2] * t[5] - t[3] * t[4], ea = a - t[0], eb = b - t[1];
    if (!(Math.abs(det) > 1e-9)) return false;
    const sa = (t[5] * ea - t[3] * eb) / det, sb = (t[2] * eb - t[4] * ea) / det;
    const a0 = at[0], b0 = at[1];
    let share = 1, better = Infinity;
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

// The lines of a net of square cells over a box [a0, a1, b0, b1]; `cells` along its longer side.
function netLines(box, cells) {
  const [a0, a1, b0, b1] = box, size = Math.max(a1 - a0, b1 - b0) / cells;
  const across = Math.max(1, Math.round((a1 - a0) / size)), down = Math.max(1, Math.round((b1 - b0) / size));
  const lines = [];
  for (let k = 0; k <= across; k++) {
    const a = a0 + (a1 - a0) * k / across;
    lines.push({ from: [a, b0], to: [a, b1], pieces: down, isEdge: k === 0 || k === across });
  }
  for (let k = 0; k <= down; k++) {
    const b = b0 + (b1 - b0) * k / down;
    lines.push({ from: [a0, b], to: [a1, b], pieces: across, isEdge: k === 0 || k === down });
  }
  return lines;
}

// Moves a place along with its image, by the Jacobian that the last look of mapWithSlope has left.
export function follow(at, da, db, [, , j00, j01, j10, j11]) {
  const det = j00 * j11 - j01 * j10, isFlat = !(Math.abs(det) > 1e-3);
  at[0] += isFlat ? da : (j11 * da - j01 * db) / det;
  at[1] += isFlat ? db : (j00 * db - j10 * da) / det;
}

// The net as it lies on the deformed picture: each line as runs of places, broken where the map folds and at cuts.
// `parts` pieces of a line per cell.
export function deformedNet(layered, box, cells, parts, tolerance) {
  const work = new Float64Array(6);
  return netLines(box, cells).map(({ from, to, pieces, isEdge }) => {
    const n = pieces * parts, runs = [];
    for (const { first, last, k } of piecesOfLine(layered, from, to, n)) {
      const count = Math.max(1, Math.ceil((last - first) * n - 1e-9));
      traceLine(layered, k, (at) => { const t = first + (last - first) * at / count;
        return [from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t]; }, count, tolerance, work, runs);
    }
    return { runs, isEdge };
  });
}

// The stretches of a straight line that lie in one region each, as shares of it, with the number of the region's fit.
function piecesOfLine(layered, from, to, n) {
  if (!layered.regions.length) return [{ first: 0, last: 1, k: layered.fits.length ? 0 : -1 }];
  const keyAt = (t) => regionKey(layered, from[0] + (to[0] - from[0]) * t, from[1] + (to[1] - from[1]) * t);
  const found = [];
  let first = 0, key = keyAt(0);
  const end = (last) => found.push({ first, last, k: layered.byKey.get(key) ?? -1 });
  for (let i = 1; i <= n; i++) {
    const next = keyAt(i / n);
    if (next === key) continue;
    let low = (i - 1) / n, high = i / n;
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

// Each place is found from the one before it and the slope there, so that Newton has a step to do at most.
function traceLine(layered, k, place, count, tolerance, work, runs) {
  const fit = k < 0 ? null : layered.fits[k].fit, at = new Float64Array(2), hasCuts = layered.regions.length > 0;
  let run = null, before = null;
  const find = (x, y) => {
    if (!fit) { at[0] = x; at[1] = y; return true; }
    if (run) follow(at, x - before[0], y - before[1], work);
    else {
      const [da, db] = fieldAt(fit, x, y);
      at[0] = x - da;
      at[1] = y - db;
    }
    if (mapInverse(fit, x, y, at, tolerance, work)) return true;
    at[0] = x;
    at[1] = y;
    return mapInverse(fit, x, y, at, tolerance, work);
  };
  for (let j = 0; j <= count; j++) {
    const [x, y] = place(j);
    const isSeen = find(x, y) && (!hasCuts || isSeenFrom(layered, k, at[0], at[1]));
    // Where other matter begins to cover the line, it is followed to the very place.
    if (hasCuts && j > 0 && isSeen !== (run !== null) && fit) {
      let low = j - 1, high = j;
      const kept = run, last = [at[0], at[1]];
      run = null;
      for (let turn = 0; turn < 6; turn++) {
        const middle = (low + high) / 2, good = find(...place(middle)) && isSeenFrom(layered, k, at[0], at[1]);
        if (good === isSeen) { high = middle; if (isSeen) last.splice(2, 2, at[0], at[1]); }
        else { low = middle; if (!isSeen) last.splice(2, 2, at[0], at[1]); }
      }
      if (!isSeen) { if (kept && last.length > 2) kept.push(last[2], last[3]); }
      else {
        runs.push(run = last.length > 2 ? [last[2], last[3]] : []);
        [at[0], at[1]] = last;
        fieldWithSlope(fit, at[0], at[1], work);
      }
    }
    if (isSeen && run === null) runs.push(run = []);
    if (isSeen) run.push(at[0], at[1]);
    else run = null;
    before = [x, y];
  }
}

// Whether a place of the result shows what fit k (-1: what stays) has brought there.
function isSeenFrom(layered, k, a, b) {
  const own = regionKey(layered, a, b), at = layered.byKey.get(own) ?? -1;
  if (at === k || layered.rule === "paper") return at === k;
  if (at < 0) return true; // what stays gives way to what comes
  const [da, db] = fieldAt(layered.fits[at].fit, a, b);
  return marginOf(layered.regions, own, a + da, b + db) < 0;
}

// Where the nodes of the net are on the deformed picture, and how matter is strained there. Needs maths/warp_map.js. No DOM.
//
//   netShape(box, cells)                     -> [across, down]: cells of the net that netLines draws
//   netPlaces(layered, box, cells, tolerance) -> {columns, rows, source, target, isSeen}: nodes row by row, as numbers
//                                                a, b, a, b, ...; where a node is not seen its target says nothing
//   placeSeen(layered, source, tolerance)    -> [a, b] where the matter of a place is seen, null where it is not
//   strainsAt(layered, places)               -> {stretch, angle}: for each node both principal stretches of the matter
//                                                there (2 is twice as long) and the direction of the first; NaN where
//                                                the map folds or the node is not seen
//   strainGain(strains)                      -> a plain factor by which the longest arm is nearly a cell long

export const LONGEST_ARM = 0.9; // of a cell, tip to tip of a cross

export function netShape([a0, a1, b0, b1], cells) {
  const size = Math.max(a1 - a0, b1 - b0) / cells;
  return [Math.max(1, Math.round((a1 - a0) / size)), Math.max(1, Math.round((b1 - b0) / size))];
}

export function netPlaces(layered, box, cells, tolerance) {
  const [a0, a1, b0, b1] = box, [across, down] = netShape(box, cells), columns = across + 1, rows = down + 1;
  const count = columns * rows, source = new Float64Array(2 * count), target = new Float64Array(2 * count);
  const isSeen = new Uint8Array(count), work = new Float64Array(6), at = new Float64Array(2);
  let last = null; // the fit of the node before, whose slope is in `work`
  for (let n = 0; n < count; n++) {
    const x = a0 + (a1 - a0) * (n % columns) / across, y = b0 + (b1 - b0) * Math.floor(n / columns) / down;
    source.set([x, y], 2 * n);
    const k = layered?.fits.length ? layered.byKey.get(regionKey(layered, x, y)) ?? -1 : -1;
    const fit = k < 0 ? null : layered.fits[k].fit;
    let isFound = true;
    if (!fit) { at[0] = x; at[1] = y; }
    else {
      if (last === fit && n % columns > 0) follow(at, x - source[2 * n - 2], y - source[2 * n - 1], work);
      else startFrom(fit, x, y, at);
      isFound = mapInverse(fit, x, y, at, tolerance, work);
      if (!isFound) { startFrom(fit, x, y, at); isFound = mapInverse(fit, x, y, at, tolerance, work); }
      if (!isFound) { at[0] = x; at[1] = y; isFound = mapInverse(fit, x, y, at, tolerance, work); }
    }
    last = isFound ? fit : null;
    isSeen[n] = isFound && (!layered?.regions.length || isSeenFrom(layered, k, at[0], at[1])) ? 1 : 0;
    target.set(at, 2 * n);
  }
  return { columns, rows, source, target, isSeen };
}

export function placeSeen(layered, [x, y], tolerance) {
  const k = layered?.fits.length ? layered.byKey.get(regionKey(layered, x, y)) ?? -1 : -1, at = new Float64Array(2);
  if (k < 0) return [x, y];
  const { fit } = layered.fits[k];
  startFrom(fit, x, y, at);
  let isFound = mapInverse(fit, x, y, at, tolerance);
  if (!isFound) { at[0] = x; at[1] = y; isFound = mapInverse(fit, x, y, at, tolerance); }
  return isFound && (!layered.regions.length || isSeenFrom(layered, k, at[0], at[1])) ? [...at] : null;
}

function startFrom(fit, x, y, at) {
  const [da, db] = fieldAt(fit, x, y);
  at[0] = x - da;
  at[1] = y - db;
}

export function strainsAt(layered, { source, target, isSeen }) {
  const count = isSeen.length, stretch = new Float64Array(2 * count).fill(NaN), angle = new Float64Array(count);
  const work = new Float64Array(6);
  for (let n = 0; n < count; n++) {
    if (!isSeen[n]) continue;
    const k = layered?.fits.length ? layered.byKey.get(regionKey(layered, source[2 * n], source[2 * n + 1])) ?? -1 : -1;
    if (k < 0) { stretch.fill(1, 2 * n, 2 * n + 2); continue; }
    fieldWithSlope(layered.fits[k].fit, target[2 * n], target[2 * n + 1], work);
    const [,, j00, j01, j10, j11] = work;
    if (!(j00 * j11 - j01 * j10 > 0)) continue;
    // The map looks backwards: matter is stretched by 1 / s where s^2 are the eigenvalues of J^T J.
    const p = j00 * j00 + j10 * j10, q = j00 * j01 + j10 * j11, r = j01 * j01 + j11 * j11;
    const mean = (p + r) / 2, spread = Math.hypot((p - r) / 2, q);
    stretch[2 * n] = 1 / Math.sqrt(Math.max(mean - spread, 1e-12 * mean));
    stretch[2 * n + 1] = 1 / Math.sqrt(mean + spread);
    angle[n] = Math.atan2(2 * q, p - r) / 2 + Math.PI / 2;
  }
  return { stretch, angle };
}

export function strainGain({ stretch }) {
  const known = [...stretch].filter(Number.isFinite).map((s) => Math.abs(s - 1)).sort((p, q) => p - q);
  const most = known.length ? known[Math.floor(0.95 * (known.length - 1))] : 0;
  return most > 1e-9 ? plainNumber(Math.min(1e4, LONGEST_ARM / most)) : 1;
}

// The largest of 1, 2, 5, 10, ... up to a positive number.
export function plainNumber(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return Number((power * [5, 2, 1].find((step) => step * power <= most * (1 + 1e-9))).toPrecision(3));
}
