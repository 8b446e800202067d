// Where the nodes of the net are on the deformed picture, and how matter is strained there. Needs maps.js. No DOM.
//
//   netShape(box, cells)                     -> [across, down]: cells of the net that netLines draws
//   netPlaces(layered, box, cells, tolerance) -> {columns, rows, source, target, isSeen}: nodes row by row, as numbers
//                                                a, b, a, b, ...; where a node is not seen its target says nothing
//   placeSeen(layered, source, tolerance)    -> [a, b] where the matter of a place is seen, null where it is not
//   strainsAt(layered, places)               -> {stretch, angle}: for each node both principal stretches of the matter
//                                                there (2 is twice as long) and the direction of the first; NaN where
//                                                the map folds or the node is not seen
//   strainGain(strains)                      -> a plain factor by which the longest arm is nearly a cell long

const LONGEST_ARM = 0.9; // of a cell, tip to tip of a cross

function netShape([a0, a1, b0, b1], cells) {
  const size = Math.max(a1 - a0, b1 - b0) / cells;
  return [Math.max(1, Math.round((a1 - a0) / size)), Math.max(1, Math.round((b1 - b0) / size))];
}

function netPlaces(layered, box, cells, tolerance) {
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

function placeSeen(layered, [x, y], tolerance) {
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

function strainsAt(layered, { source, target, isSeen }) {
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

function strainGain({ stretch }) {
  const known = [...stretch].filter(Number.isFinite).map((s) => Math.abs(s - 1)).sort((p, q) => p - q);
  const most = known.length ? known[Math.floor(0.95 * (known.length - 1))] : 0;
  return most > 1e-9 ? plainNumber(Math.min(1e4, LONGEST_ARM / most)) : 1;
}

// The largest of 1, 2, 5, 10, ... up to a positive number.
function plainNumber(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return Number((power * [5, 2, 1].find((step) => step * power <= most * (1 + 1e-9))).toPrecision(3));
}
