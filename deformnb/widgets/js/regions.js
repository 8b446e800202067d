// Regions of a picture, equal to deformnb/rbf/regions.py in the plane. No DOM. Masks need region_masks.js.
//
//   regionDistance(data)    -> (a, b) => signed distance to the region's boundary, negative inside
//   regionOf(data)          -> {kind, distance(a, b), near(a, b, radius)}, made once for each object of data
//   regionFault(data)       -> "" or why nobody can take this for a region, in words for people
//
// data: {kind: "half_space", point, normal}, {kind: "polygon" | "line", vertices: [[a, b], ...]}, or {kind: "mask", ...}.
// `near` gives a quicker distance that holds for all places not farther than `radius` from (a, b).
//
// A line goes on for ever beyond its ends. Inside is on the left for one who looks at the picture and walks along it
// (b points down), the same as everywhere in the package.

const REGION_MOST_VERTICES = 512;

const regionsMade = new WeakMap();

function regionDistance(data) { return regionOf(data).distance; }

function regionOf(data) {
  let region = regionsMade.get(data);
  if (!region) {
    const make = { half_space: halfSpaceRegion, polygon: outlineRegion, line: outlineRegion, mask: maskRegion }[data.kind];
    if (!make) throw new Error(`unknown region '${data.kind}'`);
    regionsMade.set(data, region = make(data));
  }
  return region;
}

function halfSpaceRegion({ kind, point: [pa, pb], normal: [na, nb] }) {
  const length = Math.hypot(na, nb), u = na / length, v = nb / length;
  const distance = (a, b) => (a - pa) * u + (b - pb) * v;
  return { kind, distance, near: () => distance };
}

// ---- outlines: polygons and lines -----------------------------------------------------------------------------------

// The edges of an outline in arrays: from (x, y) by (dx, dy), where t in [low, high] belongs to it, with unit normals to
// the outside (n) and their sums at the edge's begin and end (m, e), which tell the side where a corner is nearest.
function outlineEdges({ kind, vertices }) {
  const isClosed = kind === "polygon", corners = withoutTwins(vertices, isClosed), n = corners.length;
  const count = isClosed ? n : n - 1, turn = isClosed && signedArea(corners) > 0 ? -1 : 1;
  const e = { count, data: new Float64Array(12 * count) };
  const normal = (j) => {
    const p = corners[j], q = corners[(j + 1) % n], length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1;
    return [-turn * (q[1] - p[1]) / length, turn * (q[0] - p[0]) / length];
  };
  for (let j = 0; j < count; j++) {
    const p = corners[j], q = corners[(j + 1) % n], own = normal(j), dx = q[0] - p[0], dy = q[1] - p[1];
    const isFirst = !isClosed && j === 0, isLast = !isClosed && j === count - 1;
    const before = isFirst ? own : normal((j + n - 1) % n), after = isLast ? own : normal((j + 1) % n);
    e.data.set([p[0], p[1], dx, dy, isFirst ? -Infinity : 0, isLast ? Infinity : 1, own[0], own[1],
      own[0] + before[0], own[1] + before[1], own[0] + after[0], own[1] + after[1]], 12 * j);
  }
  return e;
}

function withoutTwins(vertices, isClosed) {
  return vertices.filter(([a, b], k) => {
    const before = k ? vertices[k - 1] : isClosed ? vertices[vertices.length - 1] : null;
    return !before || vertices.length < 2 || before[0] !== a || before[1] !== b;
  });
}

// Twice the area, positive where the corners go from the a-axis to the b-axis: clockwise on the screen.
function signedArea(corners) {
  return corners.reduce((sum, p, k) => {
    const q = corners[(k + 1) % corners.length];
    return sum + p[0] * q[1] - p[1] * q[0];
  }, 0);
}

function outlineRegion(data) {
  const edges = outlineEdges(data), all = Int32Array.from({ length: edges.count }, (_, k) => k);
  const distance = (a, b) => outlineDistance(edges.data, all, a, b);
  const near = (a, b, radius) => {
    const far = Math.abs(distance(a, b)) + 2 * radius;
    const some = all.filter((j) => edgeDistance(edges.data, j, a, b) <= far);
    return some.length === all.length ? distance : (p, q) => outlineDistance(edges.data, some, p, q);
  };
  return { kind: data.kind, distance, near, edges: edges.count };
}

function edgeDistance(e, j, a, b) {
  const k = 12 * j, dx = e[k + 2], dy = e[k + 3], pa = a - e[k], pb = b - e[k + 1];
  const t = Math.max(e[k + 4], Math.min(e[k + 5], (pa * dx + pb * dy) / (dx * dx + dy * dy)));
  return Math.hypot(pa - t * dx, pb - t * dy);
}

function outlineDistance(e, some, a, b) {
  let best = Infinity, at = 0, where = 0;
  for (let i = 0; i < some.length; i++) {
    const k = 12 * some[i], dx = e[k + 2], dy = e[k + 3], pa = a - e[k], pb = b - e[k + 1];
    let t = (pa * dx + pb * dy) / (dx * dx + dy * dy);
    if (t < e[k + 4]) t = e[k + 4];
    else if (t > e[k + 5]) t = e[k + 5];
    const ra = pa - t * dx, rb = pb - t * dy, d = ra * ra + rb * rb;
    if (d < best) { best = d; at = k; where = t; }
  }
  // The nearest place is an edge, or one of its corners: then the sum of the normals that meet there decides.
  let na = e[at + 6], nb = e[at + 7], from = 0;
  if (where <= 0 && e[at + 4] === 0) { na = e[at + 8]; nb = e[at + 9]; }
  else if (where >= 1 && e[at + 5] === 1) { na = e[at + 10]; nb = e[at + 11]; from = 1; }
  const side = (a - e[at] - from * e[at + 2]) * na + (b - e[at + 1] - from * e[at + 3]) * nb;
  return side < 0 ? -Math.sqrt(best) : Math.sqrt(best);
}

// ---- what is no region ----------------------------------------------------------------------------------------------

function regionFault(data) {
  if (data.kind === "half_space") return data.normal.some((v) => v !== 0) ? "" : "Give the line two different places.";
  if (data.kind === "mask") return "";
  const isClosed = data.kind === "polygon", corners = withoutTwins(data.vertices, isClosed);
  if (corners.length < (isClosed ? 3 : 2)) return isClosed ? "A closed shape needs three corners." : "A line needs two places.";
  if (corners.length > REGION_MOST_VERTICES) return `A shape has at most ${REGION_MOST_VERTICES} corners.`;
  if (isClosed && signedArea(corners) === 0) return "This shape has no area.";
  return crossing(corners, isClosed) ? (isClosed ? "This outline crosses itself, so inside and outside are not told apart."
    : "This line crosses itself, or its straight continuation does, so it does not part the picture in two.") : "";
}

// Whether two edges that are no neighbours meet; the ends of an open line go on for ever.
function crossing(corners, isClosed) {
  const n = corners.length, count = isClosed ? n : n - 1;
  for (let i = 0; i < count; i++) {
    for (let j = i + 1; j < count; j++) {
      const isNext = j === i + 1 || (isClosed && i === 0 && j === count - 1);
      if (isNext ? turnsBack(corners, i, j, isClosed, count) : edgesMeet(corners, i, j, isClosed, count)) return true;
    }
  }
  return false;
}

// Where an edge's own parameters lie: a line's first edge reaches back and its last one on, without end.
function reachOf(j, isClosed, count) {
  return [!isClosed && j === 0 ? -Infinity : 0, !isClosed && j === count - 1 ? Infinity : 1];
}

function edgesMeet(corners, i, j, isClosed, count) {
  const n = corners.length, [p, q, r, s] = [corners[i], corners[(i + 1) % n], corners[j], corners[(j + 1) % n]];
  const d = [q[0] - p[0], q[1] - p[1]], e = [s[0] - r[0], s[1] - r[1]], g = [r[0] - p[0], r[1] - p[1]];
  const det = d[0] * e[1] - d[1] * e[0], [low, high] = reachOf(i, isClosed, count), [from, to] = reachOf(j, isClosed, count);
  if (Math.abs(det) > 1e-9 * Math.hypot(...d) * Math.hypot(...e)) { // rounding lets parallel ends meet far away
    const t = (g[0] * e[1] - g[1] * e[0]) / det, u = (g[0] * d[1] - g[1] * d[0]) / det;
    return t >= low && t <= high && u >= from && u <= to;
  }
  if (g[0] * d[1] - g[1] * d[0] !== 0) return false; // side by side
  const along = (v) => ((v[0] - p[0]) * d[0] + (v[1] - p[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1]);
  const a = along(r), b = along(s), rise = Math.sign(b - a);
  const ends = [from === -Infinity ? -rise * Infinity : a, to === Infinity ? rise * Infinity : b];
  return Math.max(...ends) >= low && Math.min(...ends) <= high;
}

// Neighbours meet in their corner; more than that only if the second goes straight back over the first.
function turnsBack(corners, i, j, isClosed, count) {
  const n = corners.length, [f, g] = i === 0 && j === count - 1 && count > 2 ? [j, i] : [i, j];
  const [p, q, r] = [corners[f], corners[(f + 1) % n], corners[(g + 1) % n]];
  const d = [q[0] - p[0], q[1] - p[1]], e = [r[0] - q[0], r[1] - q[1]];
  return d[0] * e[1] - d[1] * e[0] === 0 && d[0] * e[0] + d[1] * e[1] < 0;
}
