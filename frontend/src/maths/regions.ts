// Regions of a picture, equal to deformnb.rbf.regions in the plane.
//
// data: {kind: "half_space", point, normal}, {kind: "polygon" | "line", vertices: [[a, b], ...]}, with stops: [first,
// last] where a cut along a line stops at its ends, or
// {kind: "mask", shape: [nv, nu], spacing, origin, bits}, where bits is base64 of zlib of the pixels, eight to a byte,
// the first in the highest bit.
//
// A line continues without end beyond its ends. Inside is to the left of its direction as the picture is seen (b points
// down), the same as everywhere in the package.

import { LARGEST_SHAPE } from "../generated.ts";
import type { HalfSpaceData, LineData, MaskData, OutlineData, Region, RegionData, Vector2 } from "../types.ts";

// ---- masks ----------------------------------------------------------------------------------------------------------

function maskRegion(data: MaskData): Region {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = data,
    isSet = maskPixels(data);
  const outside = boxDistances(isSet, nv, nu, du, dv),
    inside = boxDistances(
      isSet.map((v) => 1 - v),
      nv,
      nu,
      du,
      dv,
    );
  const signed = outside.map((value, k) => (isSet[k] ? -inside[k]! : value));
  const distance = (a: number, b: number) => {
    const u = (a - a0) / du,
      v = (b - b0) / dv;
    const p = Math.max(0, Math.min(nu - 1, u)),
      q = Math.max(0, Math.min(nv - 1, v));
    const i = Math.min(Math.floor(q), Math.max(0, nv - 2)),
      j = Math.min(Math.floor(p), Math.max(0, nu - 2));
    const s = p - j,
      t = q - i,
      at = i * nu + j,
      east = nu > 1 ? 1 : 0,
      south = nv > 1 ? nu : 0;
    const top = signed[at]! + s * (signed[at + east]! - signed[at]!),
      low = at + south;
    const value = top + t * (signed[low]! + s * (signed[low + east]! - signed[low]!) - top);
    return u === p && v === q ? value : value + Math.hypot((u - p) * du, (v - q) * dv);
  };
  return { kind: "mask", distance, near: () => distance, isSet };
}

/** Pixels of masks that were made here, without a text of their bits. */
export const knownPixels: WeakMap<MaskData, Uint8Array> = new WeakMap();

/** The pixels of a mask, 0 or 1. */
export function maskPixels(mask: MaskData) {
  const {
    shape: [nv, nu],
    bits,
  } = mask;
  return knownPixels.get(mask) ?? maskBits(bits, nv * nu);
}

/** The bits of a mask of any dimension, 1 where it is set. */
export function maskBits(bits: string, count: number) {
  const bytes = inflate(Uint8Array.from(atob(bits), (c) => c.charCodeAt(0))),
    out = new Uint8Array(count);
  for (let k = 0; k < out.length; k++) out[k] = (bytes[k >> 3]! >> (7 - (k & 7))) & 1;
  return out;
}

/**
 * Distance of every centre to the nearest pixel that is set, measured to its faces; 1e15 if there is none, for infinity
 * would become NaN where it is interpolated.
 */
function boxDistances(isSet: Uint8Array, nv: number, nu: number, du: number, dv: number) {
  const found = new Float32Array(nv * nu);
  if (!isSet.includes(1)) return found.fill(1e15);
  const above = new Int32Array(nv * nu); // the row of the nearest set pixel in the same column, -1 for none
  for (let j = 0; j < nu; j++) {
    let last = -1;
    for (let i = 0; i < nv; i++) {
      if (isSet[i * nu + j]) last = i;
      above[i * nu + j] = last;
    }
    last = -1;
    for (let i = nv - 1; i >= 0; i--) {
      if (isSet[i * nu + j]) last = i;
      const up = above[i * nu + j]!;
      if (last >= 0 && (up < 0 || last - i < i - up)) above[i * nu + j] = last;
    }
  }
  const feet = new Int32Array(nu),
    from = new Float64Array(nu + 1);
  for (let i = 0; i < nv; i++) {
    const height = (j: number) => ((above[i * nu + j]! - i) * dv) ** 2;
    const row = i * nu;
    let top = -1; // the lower envelope of the columns' parabolas
    for (let j = 0; j < nu; j++) {
      if (above[row + j]! < 0) continue;
      let meet = -Infinity;
      while (top >= 0) {
        const k = feet[top]!;
        meet = (height(j) - height(k) + du * du * (j * j - k * k)) / (2 * du * du * (j - k));
        if (meet > from[top]!) break;
        top -= 1;
      }
      if (top < 0) meet = -Infinity;
      top += 1;
      feet[top] = j;
      from[top] = meet;
    }
    for (let j = 0, k = 0; j < nu; j++) {
      while (k < top && from[k + 1]! < j) k += 1;
      const across = Math.max(0, Math.abs(feet[k]! - j) - 0.5) * du;
      found[row + j] = Math.hypot(across, Math.max(0, Math.abs(above[row + feet[k]!]! - i) - 0.5) * dv);
    }
  }
  return found;
}

// ---- zlib: a browser inflates only in promises, and a picture is drawn now ------------------------------------------

const INFLATE_LENGTHS = [
  3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195, 227, 258,
];
const INFLATE_DISTANCES = [
  1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257, 385, 513, 769, 1025, 1537, 2049, 3073, 4097, 6145,
  8193, 12289, 16385, 24577,
];
const INFLATE_REPEATS: Vector2[] = [
  [2, 3],
  [3, 3],
  [7, 11],
];
const INFLATE_ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

/** The data in a stream of zlib (RFC 1950, 1951). */
export function inflate(bytes: Uint8Array) {
  let at = 16,
    out = new Uint8Array(1 << 14),
    size = 0; // at: in bits; after a header of two bytes
  const take = (n: number) => {
    let value = 0;
    for (let k = 0; k < n; k++, at++) {
      if (at >> 3 >= bytes.length) throw new Error("a mask ends too early");
      value |= ((bytes[at >> 3]! >> (at & 7)) & 1) << k;
    }
    return value;
  };
  const put = (value: number) => {
    if (size === out.length) {
      const more = new Uint8Array(2 * size);
      more.set(out);
      out = more;
    }
    out[size++] = value;
  };
  for (let isLast = 0; !isLast; ) {
    isLast = take(1);
    const kind = take(2);
    if (kind === 0) {
      at = (at + 7) & ~7;
      const length = take(16);
      take(16);
      for (let k = 0; k < length; k++) put(take(8));
      continue;
    }
    if (kind === 3) throw new Error("a mask is not packed as zlib does");
    const [symbols, distances] = kind === 1 ? fixedCodes() : readCodes(take);
    for (let symbol = symbols(take); symbol !== 256; symbol = symbols(take)) {
      if (symbol < 256) {
        put(symbol);
        continue;
      }
      const s = symbol - 257,
        length = INFLATE_LENGTHS[s]! + (s < 8 || s === 28 ? 0 : take((s >> 2) - 1));
      const d = distances(take),
        back = INFLATE_DISTANCES[d]! + (d < 4 ? 0 : take((d >> 1) - 1));
      for (let k = 0; k < length; k++) put(out[size - back]!);
    }
  }
  return out.subarray(0, size);
}

/** The next n bits */
export type Take = (n: number) => number;
/** Readers of lengths and of distances */
type Codes = [symbols: (take: Take) => number, distances: (take: Take) => number];

/** A reader of the Huffman code whose symbols have these numbers of bits. */
function codeReader(lengths: number[]): (take: Take) => number {
  const counts = new Array<number>(16).fill(0),
    table = new Map<number, number>();
  for (const n of lengths) if (n) counts[n]! += 1;
  const next = [0];
  for (let n = 1, code = 0; n < 16; n++) {
    code = (code + (counts[n - 1] ?? 0)) << 1;
    next[n] = code;
  }
  lengths.forEach((n, symbol) => {
    if (n) table.set((n << 16) | next[n]!++, symbol);
  });
  return (take) => {
    for (let n = 1, code = 0; n < 16; n++) {
      code = (code << 1) | take(1);
      const symbol = table.get((n << 16) | code);
      if (symbol !== undefined) return symbol;
    }
    throw new Error("a mask is not packed as zlib does");
  };
}

function fixedCodes(): Codes {
  const lengths = Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8));
  return [codeReader(lengths), codeReader(new Array<number>(30).fill(5))];
}

function readCodes(take: Take): Codes {
  const literals = take(5) + 257,
    distances = take(5) + 1,
    count = take(4) + 4,
    first = new Array<number>(19).fill(0);
  for (let k = 0; k < count; k++) first[INFLATE_ORDER[k]!] = take(3);
  const lengths: number[] = [];
  const read = codeReader(first);
  while (lengths.length < literals + distances) {
    const symbol = read(take);
    if (symbol < 16) lengths.push(symbol);
    else {
      const [bits, least] = INFLATE_REPEATS[symbol - 16]!;
      const value = symbol === 16 ? lengths[lengths.length - 1]! : 0;
      for (let n = take(bits) + least; n > 0; n--) lengths.push(value);
    }
  }
  return [codeReader(lengths.slice(0, literals)), codeReader(lengths.slice(literals))];
}

// ---- any region -----------------------------------------------------------------------------------------------------

const regionsMade: WeakMap<RegionData, Region> = new WeakMap();

/** The signed distance to a region's boundary, negative inside. */
export function regionDistance(data: RegionData) {
  return regionOf(data).distance;
}

/** A region prepared for use, once for each object of data. */
export function regionOf(data: RegionData) {
  const made = regionsMade.get(data);
  if (made) return made;
  const region = newRegion(data);
  regionsMade.set(data, region);
  return region;
}

function newRegion(data: RegionData) {
  if (data.kind === "half_space") return halfSpaceRegion(data);
  if (data.kind === "mask") return maskRegion(data);
  if (data.kind === "polygon" || data.kind === "line") return outlineRegion(data);
  throw new Error(`unknown region '${(data as { kind: string }).kind}'`);
}

function halfSpaceRegion({ kind, point: [pa, pb], normal: [na, nb] }: HalfSpaceData): Region {
  const length = Math.hypot(na, nb),
    u = na / length,
    v = nb / length;
  const distance = (a: number, b: number) => (a - pa) * u + (b - pb) * v;
  return { kind, distance, near: () => distance };
}

// ---- outlines: polygons and lines -----------------------------------------------------------------------------------

/**
 * The edges of an outline, twelve numbers each: from (x, y) by (dx, dy), where t in [low, high] belongs to it, the unit
 * normal to the outside, and its sums with those of the edges before and behind, which decide the side where a corner
 * is nearest.
 */
function outlineEdges({ kind, vertices }: OutlineData) {
  const isClosed = kind === "polygon",
    corners = removeDuplicates(vertices, isClosed),
    n = corners.length;
  const count = isClosed ? n : n - 1,
    turn = isClosed && signedArea(corners) > 0 ? -1 : 1;
  const data = new Float64Array(12 * count);
  const normal = (j: number): Vector2 => {
    const p = corners[j]!,
      q = corners[(j + 1) % n]!,
      length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1;
    return [(-turn * (q[1] - p[1])) / length, (turn * (q[0] - p[0])) / length];
  };
  for (let j = 0; j < count; j++) {
    const p = corners[j]!,
      q = corners[(j + 1) % n]!,
      own = normal(j),
      dx = q[0] - p[0],
      dy = q[1] - p[1];
    const isFirst = !isClosed && j === 0,
      isLast = !isClosed && j === count - 1;
    const before = isFirst ? own : normal((j + n - 1) % n),
      after = isLast ? own : normal((j + 1) % n);
    data.set(
      [
        p[0],
        p[1],
        dx,
        dy,
        isFirst ? -Infinity : 0,
        isLast ? Infinity : 1,
        own[0],
        own[1],
        own[0] + before[0],
        own[1] + before[1],
        own[0] + after[0],
        own[1] + after[1],
      ],
      12 * j,
    );
  }
  return { count, data };
}

/** The vertices without those that repeat the one before. */
function removeDuplicates(vertices: Vector2[], isClosed: boolean) {
  return vertices.filter(([a, b], k) => {
    const before = k ? vertices[k - 1] : isClosed ? vertices.at(-1) : null;
    return !before || vertices.length < 2 || before[0] !== a || before[1] !== b;
  });
}

/** Twice the area, positive where the corners go from the a-axis to the b-axis: clockwise on the screen. */
function signedArea(corners: Vector2[]) {
  return corners.reduce((sum, p, k) => {
    const q = corners[(k + 1) % corners.length]!;
    return sum + p[0] * q[1] - p[1] * q[0];
  }, 0);
}

function outlineRegion(data: OutlineData): Region {
  const edges = outlineEdges(data),
    all = Int32Array.from({ length: edges.count }, (_, k) => k);
  const toEdges =
    (some: Int32Array): Region["distance"] =>
    (a, b) =>
      outlineDistance(edges.data, some, a, b);
  const distance = toEdges(all),
    opening = data.kind === "line" && data.stops?.some(Boolean) ? openingOf(data) : null;
  return {
    kind: data.kind,
    distance,
    edges: edges.count,
    ...(opening && { opening }),
    near: (a, b, radius) => {
      const far = Math.abs(distance(a, b)) + 2 * radius;
      const some = all.filter((j) => edgeDistance(edges.data, j, a, b) <= far);
      return some.length === all.length ? distance : toEdges(some);
    },
  };
}

/**
 * Share of the opening of a cut along a line, as Line.opening in deformnb.rbf.regions: from 0, at its tips and beyond, to 1.
 */
function openingOf({ vertices, stops = [false, false] }: LineData): NonNullable<Region["opening"]> {
  const corners = removeDuplicates(vertices, false),
    n = corners.length;
  const way = (p: Vector2, q: Vector2) => Math.hypot(q[0] - p[0], q[1] - p[1]);
  let whole = 0;
  for (let k = 1; k < n; k++) whole += way(corners[k - 1]!, corners[k]!);
  const ends = [
    { from: corners[1]!, tip: corners[0]! },
    { from: corners[n - 2]!, tip: corners[n - 1]! },
  ]
    .filter((_, k) => stops[k])
    .map(({ from, tip }) => {
      const ea = (2 * (tip[0] - from[0])) / way(from, tip) / whole,
        eb = (2 * (tip[1] - from[1])) / way(from, tip) / whole;
      return { ea, eb, at: tip[0] * ea + tip[1] * eb };
    });
  return (a, b, out) => {
    let w = 1,
      wa = 0,
      wb = 0;
    for (const { ea, eb, at } of ends) {
      const t = Math.max(0, Math.min(1, at - a * ea - b * eb));
      const s = t * t * (3 - 2 * t),
        slope = 6 * t * (1 - t);
      wa = wa * s - w * slope * ea;
      wb = wb * s - w * slope * eb;
      w *= s;
    }
    out[0] = w;
    out[1] = wa;
    out[2] = wb;
    return out;
  };
}

function edgeDistance(e: Float64Array, j: number, a: number, b: number) {
  const k = 12 * j,
    dx = e[k + 2]!,
    dy = e[k + 3]!,
    pa = a - e[k]!,
    pb = b - e[k + 1]!;
  const t = Math.max(e[k + 4]!, Math.min(e[k + 5]!, (pa * dx + pb * dy) / (dx * dx + dy * dy)));
  return Math.hypot(pa - t * dx, pb - t * dy);
}

function outlineDistance(e: Float64Array, some: Int32Array, a: number, b: number) {
  let best = Infinity,
    at = 0,
    where = 0;
  for (let i = 0; i < some.length; i++) {
    const k = 12 * some[i]!,
      dx = e[k + 2]!,
      dy = e[k + 3]!,
      pa = a - e[k]!,
      pb = b - e[k + 1]!;
    let t = (pa * dx + pb * dy) / (dx * dx + dy * dy);
    if (t < e[k + 4]!) t = e[k + 4]!;
    else if (t > e[k + 5]!) t = e[k + 5]!;
    const ra = pa - t * dx,
      rb = pb - t * dy,
      d = ra * ra + rb * rb;
    if (d < best) {
      best = d;
      at = k;
      where = t;
    }
  }
  // The nearest place is an edge, or one of its corners: then the sum of the normals that meet there decides.
  let na = e[at + 6]!,
    nb = e[at + 7]!,
    from = 0;
  if (where <= 0 && e[at + 4] === 0) {
    na = e[at + 8]!;
    nb = e[at + 9]!;
  } else if (where >= 1 && e[at + 5] === 1) {
    na = e[at + 10]!;
    nb = e[at + 11]!;
    from = 1;
  }
  const side = (a - e[at]! - from * e[at + 2]!) * na + (b - e[at + 1]! - from * e[at + 3]!) * nb;
  return side < 0 ? -Math.sqrt(best) : Math.sqrt(best);
}

// ---- faults of regions ----------------------------------------------------------------------------------------------

/** The reason why data cannot be used as a region, in words for users; "" if they can. */
export function regionFault(data: RegionData) {
  if (data.kind === "half_space") {
    return data.normal[0] !== 0 || data.normal[1] !== 0 ? "" : "Give the line two different places.";
  }
  if (data.kind === "mask") return "";
  const isClosed = data.kind === "polygon",
    corners = removeDuplicates(data.vertices, isClosed);
  if (isClosed && corners.length < 3) return "A closed shape needs three corners.";
  if (corners.length < 2) return "A line needs two places.";
  if (corners.length > LARGEST_SHAPE) return `A shape has at most ${LARGEST_SHAPE} corners.`;
  if (isClosed && signedArea(corners) === 0) return "This shape has no area.";
  if (!crossing(corners, isClosed)) return "";
  return isClosed
    ? "This outline crosses itself, so it has no inside."
    : "This line crosses itself, or its straight continuation does, so it does not part the picture in two.";
}

/** Whether two edges that are no neighbours meet; the ends of an open line continue without end. */
export function crossing(corners: Vector2[], isClosed: boolean) {
  const n = corners.length,
    count = isClosed ? n : n - 1;
  for (let i = 0; i < count; i++) {
    for (let j = i + 1; j < count; j++) {
      const isNext = j === i + 1 || (isClosed && i === 0 && j === count - 1);
      if (isNext ? turnsBack(corners, i, j, count) : edgesMeet(corners, i, j, isClosed, count)) return true;
    }
  }
  return false;
}

/**
 * The range of an edge's own parameter: a line's first edge continues backwards and its last one forwards, without end.
 */
function reachOf(j: number, isClosed: boolean, count: number): Vector2 {
  return [!isClosed && j === 0 ? -Infinity : 0, !isClosed && j === count - 1 ? Infinity : 1];
}

function edgesMeet(corners: Vector2[], i: number, j: number, isClosed: boolean, count: number) {
  const n = corners.length,
    p = corners[i]!,
    q = corners[(i + 1) % n]!,
    r = corners[j]!,
    s = corners[(j + 1) % n]!;
  const d: Vector2 = [q[0] - p[0], q[1] - p[1]],
    e: Vector2 = [s[0] - r[0], s[1] - r[1]],
    g: Vector2 = [r[0] - p[0], r[1] - p[1]];
  const [low, high] = reachOf(i, isClosed, count),
    [from, to] = reachOf(j, isClosed, count);
  const det = d[0] * e[1] - d[1] * e[0];
  if (Math.abs(det) > 1e-9 * Math.hypot(...d) * Math.hypot(...e)) {
    // rounding lets parallel ends meet far away
    const t = (g[0] * e[1] - g[1] * e[0]) / det,
      u = (g[0] * d[1] - g[1] * d[0]) / det;
    return t >= low && t <= high && u >= from && u <= to;
  }
  if (g[0] * d[1] - g[1] * d[0] !== 0) return false; // side by side
  const along: (v: Vector2) => number = (v) =>
    ((v[0] - p[0]) * d[0] + (v[1] - p[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1]);
  const a = along(r),
    b = along(s),
    rise = Math.sign(b - a);
  const ends = [from === -Infinity ? -rise * Infinity : a, to === Infinity ? rise * Infinity : b];
  return Math.max(...ends) >= low && Math.min(...ends) <= high;
}

/** Whether neighbours meet in more than their corner: the second runs straight back over the first. */
function turnsBack(corners: Vector2[], i: number, j: number, count: number) {
  const n = corners.length,
    [f, g]: Vector2 = i === 0 && j === count - 1 && count > 2 ? [j, i] : [i, j];
  const p = corners[f]!,
    q = corners[(f + 1) % n]!,
    r = corners[(g + 1) % n]!;
  const d: Vector2 = [q[0] - p[0], q[1] - p[1]],
    e: Vector2 = [r[0] - q[0], r[1] - q[1]];
  return d[0] * e[1] - d[1] * e[0] === 0 && d[0] * e[0] + d[1] * e[1] < 0;
}
