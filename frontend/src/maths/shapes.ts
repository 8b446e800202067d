// Edits of cuts and rigid parts as plain data. Pure functions; no edit changes an object it was given.

import type {
  HalfSpaceData,
  LineData,
  MaskData,
  Motion,
  OutlineData,
  PartData,
  RegionData,
  ShapeData,
  ShapeKind,
  Vector,
  Vector2,
  Vector4,
} from "../types.ts";
import { difference } from "./camera.ts";
import { formatLength } from "./numbers.ts";
import { maskPixels } from "./regions.ts";

export const MOST_SHAPES = { cuts: 8, parts: 32 };
export const SHAPE_NAMES = { cuts: "cut", parts: "rigid part" };

/** Change one of the shapes. */
export function updateShape<S extends ShapeData>(shapes: S[], index: number, change: Partial<NoInfer<S>>) {
  return shapes.map((shape, k) => (k === index ? { ...shape, ...change } : shape));
}

/**
 * The index of a shape after an edit of its list, or null: the same shape is the equal one, or the only one that was
 * changed. Python follows by the same rule (widgets/messages/shapes.py).
 */
export function trackShape(before: ShapeData[], after: ShapeData[], index: number) {
  if (before[index] === undefined) return null;
  const texts = after.map((shape) => JSON.stringify(shape)),
    was = before.map((shape) => JSON.stringify(shape));
  const places = texts.flatMap((text, k) => (text === was[index] ? [k] : []));
  if (places.length) return places.reduce((p, q) => (Math.abs(q - index) < Math.abs(p - index) ? q : p));
  const isChanged = before.length === after.length && texts.every((text, k) => (text === was[k]) === (k !== index));
  return isChanged ? index : null;
}

/** A shape in a message that only has to identify it: a mask without its pixels. */
export function shapeRecord(shape: ShapeData) {
  if (shape.region.kind !== "mask") return shape;
  const { bits, ...region } = shape.region;
  return { ...shape, region };
}

// ---- the corners that the user drags --------------------------------------------------------------------------------

/** Whether a region has corners. */
export function isOutline(region: RegionData): region is OutlineData {
  return region.kind === "polygon" || region.kind === "line";
}

/**
 * The corners of a region. Of a half plane they are two places on its line, `reach` away from its point. A mask has
 * none.
 */
export function cornersOf(region: RegionData, reach: number): Vector2[] {
  if (region.kind === "half_space") {
    const [a, b] = region.point,
      [na, nb] = region.normal;
    return [
      [a - nb * reach, b + na * reach],
      [a + nb * reach, b - na * reach],
    ];
  }
  return isOutline(region) ? region.vertices : [];
}

/** The region with corner k at a place. */
export function moveCorner(region: RegionData, k: number, place: Vector2, reach: number): RegionData {
  if (region.kind === "mask") return region;
  if (region.kind !== "half_space") {
    return { ...region, vertices: region.vertices.map((v, i) => (i === k ? place : v)) };
  }
  const [start, end] = cornersOf(region, reach) as [Vector2, Vector2],
    [p, q] = k === 0 ? [place, end] : [start, place];
  const length = Math.hypot(q[0] - p[0], q[1] - p[1]);
  if (length === 0) return region;
  const along: Vector2 = [(q[0] - p[0]) / length, (q[1] - p[1]) / length],
    way = k === 0 ? reach : -reach;
  return {
    kind: "half_space",
    point: [place[0] + way * along[0], place[1] + way * along[1]],
    normal: [-along[1], along[0]],
  };
}

/** The region with a new corner between corner k and the next one. */
export function insertCorner(region: RegionData, k: number, place: Vector2): RegionData {
  if (!isOutline(region)) return region;
  return { ...region, vertices: [...region.vertices.slice(0, k + 1), place, ...region.vertices.slice(k + 1)] };
}

/** The region without corner k; null where too few would be left. */
export function removeCorner(region: RegionData, k: number): OutlineData | null {
  if (!isOutline(region) || region.vertices.length <= (region.kind === "polygon" ? 3 : 2)) return null;
  return { ...region, vertices: region.vertices.filter((_, i) => i !== k) };
}

export function translateRegion(region: RegionData, da: number, db: number): RegionData {
  const by = ([a, b]: Vector2): Vector2 => [a + da, b + db];
  if (region.kind === "half_space") return { ...region, point: by(region.point) };
  if (region.kind === "mask") return { ...region, origin: by(region.origin) };
  return { ...region, vertices: region.vertices.map(by) };
}

/** The other side of a straight or open line; null for closed ones, which have only one inside. */
export function swapRegionSides(region: RegionData): RegionData | null {
  if (region.kind === "half_space") return { ...region, normal: [-region.normal[0], -region.normal[1]] };
  if (region.kind !== "line") return null;
  const { stops } = region;
  return { ...region, vertices: [...region.vertices].reverse(), ...(stops && { stops: [stops[1], stops[0]] }) };
}

/** Whether a cut along a region stops at its corner k; null where the corner is no end of a line. */
export function stopsAt(region: RegionData, k: number) {
  if (region.kind !== "line" || (k !== 0 && k !== region.vertices.length - 1)) return null;
  return region.stops?.[k === 0 ? 0 : 1] ?? false;
}

/** The region of a cut that stops at its corner k, or does not; null where the corner is no end of a line. */
export function setStop(region: RegionData, k: number, isStop: boolean): RegionData | null {
  if (region.kind !== "line" || stopsAt(region, k) === null) return null;
  const { kind, vertices, stops = [false, false] } = region,
    next: [boolean, boolean] = k === 0 ? [isStop, stops[1]] : [stops[0], isStop];
  return { kind, vertices, ...(next.some(Boolean) && { stops: next }) };
}

/** Places evenly spread along a line, of an open one with both ends. */
export function placesAlong(vertices: Vector2[], count: number, isClosed: boolean) {
  const line = isClosed ? [...vertices, ...vertices.slice(0, 1)] : vertices;
  return Array.from({ length: count }, (_, k) => alongLine(line, k / (isClosed ? count : count - 1)).place);
}

/**
 * The places of points that open a cut: `pulled`, one on either side of its middle and where each is dragged to, and
 * `held` around them, in a box.
 * @param vertices of the cut
 * @param box [a0, a1, b0, b1]
 */
export function openingPlaces(vertices: Vector2[], [a0, a1, b0, b1]: Vector4) {
  const first = vertices[0]!,
    last = vertices.at(-1)!,
    chord = Math.hypot(last[0] - first[0], last[1] - first[1]);
  const { place: middle, way } = alongLine(vertices, 0.5);
  const [u, v] = chord > 0 ? [(last[0] - first[0]) / chord, (last[1] - first[1]) / chord] : way,
    half = chord / 2 || 1;
  /** Towards a side, u being the direction across, and no farther than the box. */
  const room: (across: Vector2) => number = ([x, y]) =>
    Math.min(roomAlong(x, middle[0], a0, a1), roomAlong(y, middle[1], b0, b1));
  const at = (along: number, across: number): Vector2 => [
    Math.min(a1, Math.max(a0, middle[0] + along * u - across * v)),
    Math.min(b1, Math.max(b0, middle[1] + along * v + across * u)),
  ];
  const pulled: { from: Vector2; to: Vector2 }[] = [];
  const held = [at(-1.4 * half, 0), at(1.4 * half, 0)];
  for (const side of [-1, 1]) {
    const reach = Math.min(1.2 * half, 0.9 * room([-side * v, side * u]));
    const from = side * Math.min(0.12 * half, 0.2 * reach),
      to = from + side * Math.min(0.42 * half, 0.45 * reach);
    pulled.push({ from: at(0, from), to: at(0, to) });
    held.push(at(0, side * reach), at(-0.95 * half, 0.85 * side * reach), at(0.95 * half, 0.85 * side * reach));
  }
  return { pulled, held };
}

/**
 * The two sides of a cut in a box: all of it on either side, or, of a cut that stops in the tissue, a flap along it.
 * @param box [a0, a1, b0, b1]
 * @returns polygons: that on the left of the line as it is drawn on a screen, and that on the right
 */
export function cutSides({ vertices, stops }: LineData, box: Vector4): [Vector2[], Vector2[]] {
  const first = vertices[0]!,
    last = vertices.at(-1)!,
    chord = Math.hypot(last[0] - first[0], last[1] - first[1]) || 1,
    u: Vector2 = [(last[0] - first[0]) / chord, (last[1] - first[1]) / chord],
    isFlap = Boolean(stops?.some(Boolean)),
    far = isFlap ? 0 : 2 * Math.hypot(box[1] - box[0], box[3] - box[2]);
  const [start, end] = [ray(vertices[1] ?? last, first, far), ray(vertices.at(-2) ?? first, last, far)],
    line = isFlap ? vertices : [start, ...vertices, end];
  const side = (sign: number): Vector2[] => {
    const n: Vector2 = [sign * u[1], -sign * u[0]],
      depth = isFlap ? FLAP * chord : far,
      shift = ([a, b]: Vector2): Vector2 => [a + depth * n[0], b + depth * n[1]];
    return clipToBox([...line, shift(line.at(-1)!), shift(line[0]!)], box);
  };
  return [side(1), side(-1)];
}

const FLAP = 0.35; // of the length of a cut that stops in the tissue: how far a flap reaches from it

/** The place at a distance beyond the end of a segment. */
function ray(from: Vector2, to: Vector2, away: number): Vector2 {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
  return [to[0] + (away * (to[0] - from[0])) / length, to[1] + (away * (to[1] - from[1])) / length];
}

/** The part of a polygon in a box (Sutherland and Hodgman). */
export function clipToBox(polygon: Vector2[], [a0, a1, b0, b1]: Vector4): Vector2[] {
  let kept = polygon;
  for (const [c, limit, sign] of [
    [0, a0, 1],
    [0, a1, -1],
    [1, b0, 1],
    [1, b1, -1],
  ] as const) {
    const before = kept;
    kept = [];
    before.forEach((p, k) => {
      const q = before[(k + 1) % before.length]!,
        [isIn, isNext] = [sign * (p[c] - limit) >= 0, sign * (q[c] - limit) >= 0];
      if (isIn) kept.push(p);
      if (isIn === isNext) return;
      const t = (limit - p[c]) / (q[c] - p[c]);
      kept.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
    });
  }
  return kept.filter((p, k) => {
    const q = kept[(k + 1) % kept.length]!;
    return Math.hypot(p[0] - q[0], p[1] - q[1]) > 1e-9 * (a1 - a0 + b1 - b0);
  });
}

/** Whether a place is inside a polygon, by the even-odd rule. */
export function isInside(polygon: Vector2[], [a, b]: Vector2) {
  let isInside = false;
  polygon.forEach(([p, q], k) => {
    const [r, s] = polygon[(k + 1) % polygon.length]!;
    if (q > b !== s > b && a < p + ((b - q) * (r - p)) / (s - q)) isInside = !isInside;
  });
  return isInside;
}

/** Number of times that a displacement fits between a place and the end of the range in its direction. */
function roomAlong(way: number, from: number, low: number, high: number) {
  return way > 0 ? (high - from) / way : way < 0 ? (low - from) / way : Infinity;
}

/**
 * A place on a line at a share of its length, and the direction there.
 * @param share 0 to 1
 */
function alongLine(vertices: Vector2[], share: number): { place: Vector2; way: Vector2 } {
  const lengths = vertices.slice(1).map(([a, b], k) => Math.hypot(a - vertices[k]![0], b - vertices[k]![1]));
  let left = share * lengths.reduce((sum, length) => sum + length, 0),
    k = 0;
  while (k < lengths.length - 1 && left > lengths[k]!) left -= lengths[k++]!;
  const p = vertices[k]!,
    q = vertices[k + 1]!,
    length = lengths[k] || 1,
    way: Vector2 = [(q[0] - p[0]) / length, (q[1] - p[1]) / length];
  return { place: [p[0] + left * way[0], p[1] + left * way[1]], way };
}

// ---- the motion of a rigid part -------------------------------------------------------------------------------------
// A part is turned about its pivot by an angle, from the a-axis to the b-axis and so clockwise on the screen, and then
// shifted. The pivot is a place of the region, before the motion.

/** The motion of a shape; null of a cut, and of a part that is fixed or switched off. */
export function motionOf(shape: ShapeData) {
  return "motion" in shape && shape.enabled ? shape.motion : null;
}

/** The image of a place under a motion. */
export function movePlace(motion: Motion, [a, b]: Vector): Vector2 {
  if (!motion) return [a, b];
  const {
    matrix: [[c, d], [e, f]],
    shift: [s, t],
  } = motion;
  return [c * a + d * b + s, e * a + f * b + t];
}

/** A direction as it was before a motion. */
export function inverseDirection(motion: Motion, [a, b]: Vector2): Vector2 {
  if (!motion) return [a, b];
  const {
    matrix: [[c, d], [e, f]],
  } = motion;
  return [c * a + e * b, d * a + f * b];
}

/** The place whose image under a motion is this one. */
export function placeBefore(motion: Motion, [a, b]: Vector2) {
  const [s, t] = motion?.shift ?? [0, 0];
  return inverseDirection(motion, [a - s, b - t]);
}

/** Middles of masks: all pixels are counted once. */
const maskMiddles: WeakMap<MaskData, Vector2> = new WeakMap();

function maskMiddle(mask: MaskData): Vector2 {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = mask,
    isSet = maskPixels(mask);
  let count = 0,
    columns = 0,
    rows = 0;
  for (let i = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++)
      if (isSet[i * nu + j]) {
        count += 1;
        columns += j;
        rows += i;
      }
  }
  return [a0 + (du * columns) / (count || 1), b0 + (dv * rows) / (count || 1)];
}

/** The middle of a region, as of widgets/studio/panels/shapes.py. */
export function middleOfRegion(region: RegionData): Vector2 {
  if (region.kind === "half_space") return region.point;
  if (region.kind === "mask") {
    const middle = maskMiddles.get(region) ?? maskMiddle(region);
    maskMiddles.set(region, middle);
    return middle;
  }
  let a = 0,
    b = 0,
    sum = 0;
  region.vertices.forEach(([p, q], k, all) => {
    const [r, s] = all[(k + 1) % all.length]!,
      cross = p * s - r * q;
    a += (p + r) * cross;
    b += (q + s) * cross;
    sum += cross;
  });
  return [a / (3 * sum), b / (3 * sum)];
}

/** The place about which a part is turned, before its motion. */
export function pivotOf(part: PartData) {
  return part.pivot ?? middleOfRegion(part.region);
}

/** The motion of a part as an angle about its pivot, in radians, and a shift. */
export function turnAndShift(part: PartData): { angle: number; shift: Vector2 } {
  const { motion } = part,
    [a, b] = pivotOf(part),
    [x, y] = movePlace(motion, [a, b]);
  return { angle: motion ? Math.atan2(motion.matrix[1][0], motion.matrix[0][0]) : 0, shift: [x - a, y - b] };
}

/** A part turned by an angle and shifted, after any other motion. */
export function rotatePart(part: PartData, angle: number, [da, db]: Vector2): PartData {
  const [a, b] = pivotOf(part),
    c = Math.cos(angle),
    s = Math.sin(angle);
  return {
    ...part,
    motion: {
      matrix: [
        [c, -s],
        [s, c],
      ],
      shift: [a + da - c * a + s * b, b + db - s * a - c * b],
    },
  };
}

/** "moved 12, -3.5, turned 15\u00b0"; "" of a part without motion. */
export function motionWords(part: PartData) {
  const { angle, shift } = turnAndShift(part),
    degrees = formatLength((angle * 180) / Math.PI);
  const by = shift.map(formatLength).map((text) => text.replace(/^-0$/, "0"));
  return [
    by.some((text) => text !== "0") ? `moved ${by.join(", ")}` : "",
    Number(degrees) !== 0 ? `turned ${degrees}\u00b0` : "",
  ]
    .filter(Boolean)
    .join(", ");
}

// ---- drawing --------------------------------------------------------------------------------------------------------

/** The half plane on the other side of the line from p to q than a place. */
export function oppositeHalfPlane(p: Vector2, q: Vector2, place: Vector2): HalfSpaceData {
  const length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1,
    n: Vector2 = [-(q[1] - p[1]) / length, (q[0] - p[0]) / length];
  const isTowards = (place[0] - p[0]) * n[0] + (place[1] - p[1]) * n[1] >= 0;
  return {
    kind: "half_space",
    point: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2],
    normal: isTowards ? [n[0] + 0, n[1] + 0] : [-n[0] + 0, -n[1] + 0],
  };
}

/** Reduce a drawn stroke to corners: no place of it is farther than `tolerance` from them (Douglas and Peucker). */
export function simplifyPath(path: Vector2[], tolerance: number): Vector2[] {
  if (path.length < 3) return path;
  const p = path[0]!,
    q = path.at(-1)!,
    d = difference(q, p),
    size = d[0] * d[0] + d[1] * d[1];
  let far = -1,
    at = 0;
  path.forEach(([a, b], k) => {
    const t = size ? Math.max(0, Math.min(1, ((a - p[0]) * d[0] + (b - p[1]) * d[1]) / size)) : 0;
    const away = Math.hypot(a - p[0] - t * d[0], b - p[1] - t * d[1]);
    if (away > far) {
      far = away;
      at = k;
    }
  });
  if (far <= tolerance) return [p, q];
  return [...simplifyPath(path.slice(0, at + 1), tolerance).slice(0, -1), ...simplifyPath(path.slice(at), tolerance)];
}

// ---- words ----------------------------------------------------------------------------------------------------------

export function shapeName(shape: { name: string }, what: ShapeKind, index: number) {
  return shape.name || `${SHAPE_NAMES[what]} ${index + 1}`;
}

const REGION_WORDS: Record<string, string> = {
  line: "open line",
  polygon: "closed line",
  half_space: "half plane",
  mask: "mask",
};

/** The ends at which a cut stops, in words. */
function stopWords([first, last]: [boolean, boolean]) {
  return first && last ? "stops at both ends" : first ? "stops at its first end" : last ? "stops at its last end" : "";
}

/** The label of a shape for screen readers. */
export function shapeLabel(shape: ShapeData, what: ShapeKind, index: number) {
  const { region } = shape,
    corners = isOutline(region) ? ` with ${region.vertices.length} corners` : "";
  const sort = SHAPE_NAMES[what],
    name = shape.name ? ` ${shape.name}` : "";
  const stops = region.kind === "line" && region.stops ? stopWords(region.stops) : "";
  const motion = "motion" in shape ? motionWords(shape) : "";
  return [
    `${sort.charAt(0).toUpperCase()}${sort.slice(1)} ${index + 1}${name}`,
    `${REGION_WORDS[region.kind]}${corners}`,
    stops,
    motion,
    shape.enabled ? "" : "switched off",
  ]
    .filter(Boolean)
    .join(", ");
}
