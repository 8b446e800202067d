// Edits of cuts and rigid parts as plain data. Pure functions, no DOM. Needs maths/points.js.
// A cut is {name, enabled, region}, a part also {weight, reach, motion}; no edit changes an object it was given.

export const MOST_SHAPES = { cuts: 8, parts: 32 };
export const SHAPE_NAMES = { cuts: "cut", parts: "rigid part" };

export function withShape(shapes, index, change) {
  return shapes.map((shape, k) => (k === index ? { ...shape, ...change } : shape));
}

// Where the shape at a place of a list is after an edit of the list, or null: the same one is equal, or the only one
// that was changed. Python follows by the same rule (widgets/protocol.py).
export function followedShape(before, after, index) {
  if (before[index] === undefined) return null;
  const texts = after.map((shape) => JSON.stringify(shape)), was = before.map((shape) => JSON.stringify(shape));
  const places = texts.flatMap((text, k) => (text === was[index] ? [k] : []));
  if (places.length) return places.reduce((p, q) => (Math.abs(q - index) < Math.abs(p - index) ? q : p));
  const isChanged = before.length === after.length && texts.every((text, k) => (text === was[k]) === (k !== index));
  return isChanged ? index : null;
}

// As much of a shape as tells it from others in a message: a mask without its pixels.
export function toldShape(shape) {
  const { bits, ...region } = shape.region;
  return { ...shape, region };
}

// ---- the corners that a hand moves ----------------------------------------------------------------------------------

// Of a half plane they are two places on its line, `reach` apart from the one that is told. A mask has none.
export function cornersOf(region, reach) {
  if (region.kind === "half_space") {
    const [a, b] = region.point, [na, nb] = region.normal;
    return [[a - nb * reach, b + na * reach], [a + nb * reach, b - na * reach]];
  }
  return region.vertices ?? [];
}

export function movedCorner(region, k, place, reach) {
  if (region.kind !== "half_space") return { ...region, vertices: region.vertices.map((v, i) => (i === k ? [...place] : v)) };
  const other = cornersOf(region, reach)[1 - k], [p, q] = k === 0 ? [place, other] : [other, place];
  const length = Math.hypot(q[0] - p[0], q[1] - p[1]);
  if (length === 0) return region;
  const along = [(q[0] - p[0]) / length, (q[1] - p[1]) / length], way = k === 0 ? reach : -reach;
  return { kind: "half_space", point: [place[0] + way * along[0], place[1] + way * along[1]], normal: [-along[1], along[0]] };
}

// Between corner k and the next one.
export function insertedCorner(region, k, place) {
  return { ...region, vertices: [...region.vertices.slice(0, k + 1), [...place], ...region.vertices.slice(k + 1)] };
}

// null where too few would be left.
export function removedCorner(region, k) {
  if (!region.vertices || region.vertices.length <= (region.kind === "polygon" ? 3 : 2)) return null;
  return { ...region, vertices: region.vertices.filter((_, i) => i !== k) };
}

export function movedRegion(region, da, db) {
  const by = ([a, b]) => [a + da, b + db];
  if (region.kind === "half_space") return { ...region, point: by(region.point) };
  return region.kind === "mask" ? { ...region, origin: by(region.origin) } : { ...region, vertices: region.vertices.map(by) };
}

// The other side of a straight or open line; what is closed has only one inside.
export function turnedRegion(region) {
  if (region.kind === "half_space") return { ...region, normal: region.normal.map((v) => -v) };
  return region.kind === "line" ? { ...region, vertices: [...region.vertices].reverse() } : null;
}

// ---- drawing --------------------------------------------------------------------------------------------------------

// All on the other side of the line from p to q than the middle of the picture.
export function groundThrough(p, q, middle) {
  const length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1, n = [-(q[1] - p[1]) / length, (q[0] - p[0]) / length];
  const isTowards = (middle[0] - p[0]) * n[0] + (middle[1] - p[1]) * n[1] >= 0;
  return { kind: "half_space", point: [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], normal: n.map((v) => (isTowards ? v : -v) + 0) };
}

// The corners of a drawn stroke: no place of it is farther than `tolerance` from them (Douglas and Peucker).
export function simplified(path, tolerance) {
  if (path.length < 3) return path;
  const [p, q] = [path[0], path[path.length - 1]], d = [q[0] - p[0], q[1] - p[1]], size = d[0] * d[0] + d[1] * d[1];
  let far = -1, at = 0;
  path.forEach(([a, b], k) => {
    const t = size ? Math.max(0, Math.min(1, ((a - p[0]) * d[0] + (b - p[1]) * d[1]) / size)) : 0;
    const away = Math.hypot(a - p[0] - t * d[0], b - p[1] - t * d[1]);
    if (away > far) { far = away; at = k; }
  });
  if (far <= tolerance) return [p, q];
  return [...simplified(path.slice(0, at + 1), tolerance).slice(0, -1), ...simplified(path.slice(at), tolerance)];
}

// ---- words ----------------------------------------------------------------------------------------------------------

export function shapeName(shape, what, index) { return shape.name || `${SHAPE_NAMES[what]} ${index + 1}`; }

const REGION_WORDS = { line: "open line", polygon: "closed line", half_space: "half plane", mask: "mask" };

export function shapeLabel(shape, what, index) {
  const { region } = shape, corners = region.vertices ? ` with ${region.vertices.length} corners` : "";
  const sort = SHAPE_NAMES[what], name = shape.name ? ` ${shape.name}` : "";
  return `${sort[0].toUpperCase()}${sort.slice(1)} ${index + 1}${name}, ${REGION_WORDS[region.kind]}${corners}` +
    `${shape.motion ? ", moved" : ""}${shape.enabled ? "" : ", switched off"}`;
}
