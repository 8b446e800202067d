// What an editor shows of a fit: where lines of the picture go, and whether the map folds. No DOM.

// y + D(y) and its Jacobian at (a, b) in one pass over the centres: [a', b', j00, j01, j10, j11].
function mapWithSlope(fit, a, b, out) {
  const r = fit.support, p = (a - fit.origin[0]) / r, q = (b - fit.origin[1]) / r;
  const { centers: x, coefficients: alpha, linear, constant, count } = fit;
  const { profile, slope } = RBF_KERNELS[fit.kernel];
  let u = linear[0][0] * p + linear[0][1] * q + constant[0], v = linear[1][0] * p + linear[1][1] * q + constant[1];
  let j00 = linear[0][0], j01 = linear[0][1], j10 = linear[1][0], j11 = linear[1][1];
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j], dq = q - x[j + 1], s = dp * dp + dq * dq, phi = profile(s), g = 2 * slope(s);
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

// Where the feature at (a, b) of the input appears: y with y + D(y) = (a, b), by damped Newton from a start.
// Writes y to `at` (which holds the start) and returns true where it was found; a fold may have no such place.
function mapInverse(fit, a, b, at, tolerance, work) {
  const t = work ?? new Float64Array(6);
  mapWithSlope(fit, at[0], at[1], t);
  let error = Math.hypot(t[0] - a, t[1] - b);
  for (let turn = 0; turn < 12 && error > tolerance; turn++) {
    const det = t[2] * t[5] - t[3] * t[4], ea = a - t[0], eb = b - t[1];
    if (!(Math.abs(det) > 1e-9)) return false;
    const sa = (t[5] * ea - t[3] * eb) / det, sb = (t[2] * eb - t[4] * ea) / det;
    const a0 = at[0], b0 = at[1];
    let share = 1, better = Infinity;
    for (let halvings = 0; halvings < 6; halvings++, share /= 2) {
      mapWithSlope(fit, a0 + share * sa, b0 + share * sb, t);
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
function follow(at, da, db, [, , j00, j01, j10, j11]) {
  const det = j00 * j11 - j01 * j10, isFlat = !(Math.abs(det) > 1e-3);
  at[0] += isFlat ? da : (j11 * da - j01 * db) / det;
  at[1] += isFlat ? db : (j00 * db - j10 * da) / det;
}

// The net as it lies on the deformed picture: each line as runs of places, broken where the map folds.
// `parts` pieces of a line per cell; each place is found from the one before it and the slope there, so that Newton has
// a step to do at most.
function deformedNet(fit, box, cells, parts, tolerance) {
  const work = new Float64Array(6), at = new Float64Array(2);
  return netLines(box, cells).map(({ from, to, pieces, isEdge }) => {
    const n = pieces * parts, runs = [];
    let run = null, a = from[0], b = from[1];
    for (let k = 0; k <= n; k++) {
      const share = k / n, x = from[0] + (to[0] - from[0]) * share, y = from[1] + (to[1] - from[1]) * share;
      if (run) follow(at, x - a, y - b, work);
      else {
        const [da, db] = rbfAt(fit, x, y);
        at[0] = x - da;
        at[1] = y - db;
      }
      let found = mapInverse(fit, x, y, at, tolerance, work);
      if (!found) {
        at[0] = x;
        at[1] = y;
        found = mapInverse(fit, x, y, at, tolerance, work);
      }
      if (found && run === null) runs.push(run = []);
      if (found) run.push(at[0], at[1]);
      else run = null;
      a = x;
      b = y;
    }
    return { runs, isEdge };
  });
}

// The smallest det J of the map x + D(x) over a lattice in a box and at the points, and the share that folds (<= 0).
function foldsOf(fit, box, nodes) {
  const [a0, a1, b0, b1] = box, work = new Float64Array(6);
  let least = Infinity, folded = 0;
  const look = (a, b) => {
    mapWithSlope(fit, a, b, work);
    const det = work[2] * work[5] - work[3] * work[4];
    if (det < least) least = det;
    return det <= 0;
  };
  for (let i = 0; i < nodes; i++) {
    for (let k = 0; k < nodes; k++) {
      if (look(a0 + (a1 - a0) * k / (nodes - 1), b0 + (b1 - b0) * i / (nodes - 1))) folded += 1;
    }
  }
  for (let k = 0; k < fit.count; k++) {
    look(fit.origin[0] + fit.centers[2 * k] * fit.support, fit.origin[1] + fit.centers[2 * k + 1] * fit.support);
  }
  return { least, share: folded / (nodes * nodes) };
}
