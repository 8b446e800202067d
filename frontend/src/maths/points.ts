// Edits of a list of control points and their undo. No edit changes an object it was given.

import type { Mirror, PicturePoint, Point, RegionData, ShapeKind, Shapes, Vector, Vector2 } from "../types.ts";
import { difference, mapVector } from "./camera.ts";

/** Whether two lists are equal; of a drag most points are the same objects as before. */
export function samePoints(p: unknown, q: unknown) {
  const isSame = (a: unknown, b: unknown) => a === b || JSON.stringify(a) === JSON.stringify(b);
  if (!Array.isArray(p) || !Array.isArray(q)) return isSame(p, q);
  return p.length === q.length && p.every((one, k) => isSame(one, q[k]));
}

/** Equal for points that give the same fit. */
export function pointsKey(points: Point[]) {
  return JSON.stringify(
    points.map(({ id, source, target, active, weight, radius }) => [
      id,
      source,
      target,
      active !== false,
      weight ?? 1,
      radius ?? null,
    ]),
  );
}

/** Any list of point-like objects as full points; other objects are left out. */
export function cleanPoints<V extends Vector>(list: unknown): Point<V>[] {
  const good = (place: unknown) =>
    Array.isArray(place) && [2, 3].includes(place.length) && place.every(Number.isFinite);
  const seen = new Set<number>();
  return (Array.isArray(list) ? list : [])
    .filter((p) => {
      if (!p || !Number.isInteger(p.id) || !good(p.source) || !good(p.target) || seen.has(p.id)) return false;
      seen.add(p.id);
      return true;
    })
    .map((p) => ({
      id: p.id,
      name: String(p.name ?? ""),
      source: [...p.source] as Vector as V,
      target: [...p.target] as Vector as V,
      active: p.active !== false,
      weight: Number.isFinite(p.weight) && p.weight > 0 ? p.weight : 1,
      locked: p.locked === true,
      radius: Number.isFinite(p.radius) && p.radius > 0 ? p.radius : null,
    }));
}

/** The place at a share of the line from p to q. */
export function placeBetween<V extends Vector>(p: V, q: V, share: number) {
  return mapVector(p, (value, k) => value + share * (q[k]! - value));
}

function copyVector<V extends Vector>(vector: V) {
  return mapVector(vector, (x) => x);
}

/** The points with these ids changed. */
export function updatePoints<V extends Vector>(
  points: Point<V>[],
  ids: number[],
  change: (point: Point<V>) => Partial<Point<V>>,
) {
  const chosen = new Set(ids);
  return points.map((p): Point<V> => (chosen.has(p.id) ? { ...p, ...change(p) } : p));
}

/** Move targets ("target"), sources ("source") or whole points ("both") by (da, db). */
export function translatePoints(
  points: PicturePoint[],
  ids: number[],
  da: number,
  db: number,
  what: string = "target",
) {
  const by = ([a, b]: Vector2): Vector2 => [a + da, b + db];
  return updatePoints(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source),
    target: what === "source" ? p.target : by(p.target),
  }));
}

/** A point with its fields in the order in which Python sends them: lists are compared as text. */
export function newPoint<V extends Vector>(id: number, source: V, target: V, name: string = ""): Point<V> {
  return {
    id,
    name,
    source: copyVector(source),
    target: copyVector(target),
    active: true,
    weight: 1,
    locked: false,
    radius: null,
  };
}

export function addPoint<V extends Vector>(points: Point<V>[], id: number, source: V, target: V) {
  return [...points, newPoint(id, source, target)];
}

export function removePoints<V extends Vector>(points: Point<V>[], ids: number[]) {
  const gone = new Set(ids);
  return points.filter((p) => !gone.has(p.id));
}

export function renamePoint<V extends Vector>(points: Point<V>[], id: number, name: string) {
  return updatePoints(points, [id], () => ({ name: name.trim().slice(0, 80) }));
}

/** Switch points on if all chosen are off, else off: one press always has a visible effect. */
export function togglePoints<V extends Vector>(points: Point<V>[], ids: number[]) {
  const chosen = new Set(ids),
    some = points.some((p) => chosen.has(p.id) && p.active);
  return updatePoints(points, ids, () => ({ active: !some }));
}

/** Lock points if some of the chosen are free, else unlock them. */
export function toggleLocks<V extends Vector>(points: Point<V>[], ids: number[]) {
  const chosen = new Set(ids),
    isFree = points.some((p) => chosen.has(p.id) && !p.locked);
  return updatePoints(points, ids, () => ({ locked: isFree }));
}

/** The ids of points that may be moved and removed. */
export function freeIds(points: Point[], ids: number[]) {
  const locked = new Set(points.filter((p) => p.locked).map((p) => p.id));
  return ids.filter((id) => !locked.has(id));
}

export function resetPoints<V extends Vector>(points: Point<V>[], ids: number[]) {
  return updatePoints(points, ids, (p) => ({ target: copyVector(p.source) }));
}

/** The next free id, at least `least`. */
export function nextId(points: Point[], least: number) {
  return points.reduce((id, p) => Math.max(id, p.id + 1), least);
}

// ---- cuts and rigid parts in the form in which they are sent (maths/shapes.js edits them) --------------------------

/**
 * Any lists as full shapes, in one order of their fields. Regions that are in `old` already stay the same
 * objects: their distances are known (maths/regions.js).
 */
export function cleanShapes<K extends ShapeKind>(list: unknown, what: K, old: Shapes[ShapeKind] = []): Shapes[K] {
  const known = new Map(old.map(({ region }) => [JSON.stringify(region), region]));
  const clean = (Array.isArray(list) ? list : [])
    .filter((shape) => shape?.region?.kind)
    .map((shape) => {
      const plain = plainRegion(shape.region),
        region = known.get(JSON.stringify(plain)) ?? plain;
      const kept = { name: String(shape.name ?? ""), enabled: shape.enabled !== false };
      if (what === "cuts") return { ...kept, region };
      const { weight, reach, motion, pivot } = shape;
      return {
        ...kept,
        weight: weight ?? "saturated",
        reach: reach ?? null,
        motion: motion ?? null,
        ...(pivot && { pivot }),
        region,
      };
    });
  return clean as Shapes[ShapeKind] as Shapes[K];
}

/** A region without fields that do not belong to its kind. */
function plainRegion(region: RegionData): RegionData {
  const { kind } = region;
  if (kind === "half_space") return { kind, point: region.point, normal: region.normal };
  if (kind === "polygon") return { kind, vertices: region.vertices };
  if (kind === "line") {
    const { vertices, stops } = region,
      isStop: [boolean, boolean] = [Boolean(stops?.[0]), Boolean(stops?.[1])];
    return { kind, vertices, ...(isStop.includes(true) && { stops: isStop }) };
  }
  const { shape, spacing, origin, direction, bits } = region;
  return { kind, shape, spacing, origin, ...(direction && { direction }), bits };
}

export function sameShapes(p: unknown, q: unknown) {
  return p === q || JSON.stringify(p) === JSON.stringify(q);
}

// ---- points rotated and scaled about their middle, and the rim of a single one -------------------------------------
// A single point cannot be rotated; three still ones around it, its rim, are rotated instead.

/**
 * Keys that rotate, clockwise is 1. With Shift the same keys write other signs, with Alt on some keyboards as well.
 */
export const TURN_WAYS: Record<string, number> = { ",": -1, "<": -1, ";": -1, ".": 1, ">": 1, ":": 1 };
export const TURN_CODES: Record<string, string> = { Comma: ",", Period: "." };
const TURN_STEPS: Vector2 = [2, 15]; // degrees, or percent, of a key alone and with Shift
const RIM_ANGLES = 12; // starts that are tried, so that no rim point falls next to another point

/** The middle of the targets. */
export function middleOf(points: { target: Vector }[]): Vector2 {
  const mean = (c: 0 | 1) => points.reduce((sum, p) => sum + p.target[c], 0) / points.length;
  return [mean(0), mean(1)];
}

/** Targets rotated by an angle (clockwise on the screen, where b runs down) and scaled, about a place. */
export function rotatePoints(points: PicturePoint[], ids: number[], about: Vector2, angle: number, factor: number = 1) {
  const c = factor * Math.cos(angle),
    s = factor * Math.sin(angle);
  return updatePoints(points, ids, (p) => {
    const x = p.target[0] - about[0],
      y = p.target[1] - about[1];
    return { target: [about[0] + c * x - s * y, about[1] + s * x + c * y] };
  });
}

/** The angle and the factor of a key, one of which does nothing. */
export function turnOfKey(way: number, { isLarge, isScale }: { isLarge?: boolean; isScale?: boolean }): Vector2 {
  const step = TURN_STEPS[isLarge ? 1 : 0] * way;
  return isScale ? [0, (1 + Math.abs(step) / 100) ** Math.sign(step)] : [(step * Math.PI) / 180, 1];
}

/**
 * The angle and the factor of a drag between two places relative to the middle: Alt scales, Shift snaps to steps.
 */
export function turnOfDrag([x, y]: Vector2, to: Vector2, event: { altKey: boolean; shiftKey: boolean }): Vector2 {
  if (event.altKey) {
    const factor = Math.max(0.1, Math.min(10, Math.hypot(...to) / Math.hypot(x, y)));
    return [0, event.shiftKey ? Math.max(0.1, Math.round(10 * factor) / 10) : factor];
  }
  const angle = Math.atan2(x * to[1] - y * to[0], x * to[0] + y * to[1]),
    step = Math.PI / 12;
  return [event.shiftKey ? step * Math.round(angle / step) : angle, 1];
}

function rimName(pin: Point) {
  return `${pin.name || `point ${pin.id}`} rim`;
}

/** The rim that a point has already, three at most: the nearest ones of that name. */
export function rimOf<V extends Vector>(points: Point<V>[], pin: Point) {
  const name = rimName(pin),
    [x, y] = pin.source;
  const away = (p: Point<V>) => Math.hypot(p.source[0] - x, p.source[1] - y);
  return points
    .filter((p) => p.name === name && p.id !== pin.id)
    .sort((p, q) => away(p) - away(q))
    .slice(0, 3);
}

/** The ids with those of the points' rims. */
export function includeRims(points: Point[], ids: number[]) {
  const chosen = new Set(ids);
  for (const p of points) if (ids.includes(p.id)) for (const rim of rimOf(points, p)) chosen.add(rim.id);
  return [...chosen];
}

/**
 * The points with a rim of three points around a pin, each holding the tissue there.
 * @param id of the first new point
 * @param sourceAt null outside the tissue
 */
export function addRim(
  points: PicturePoint[],
  pin: PicturePoint,
  distance: number,
  id: number,
  sourceAt: (place: Vector2) => Vector2 | null,
) {
  const others = points.filter((p) => p.active && p.id !== pin.id);
  const placesFrom: (start: number) => Vector2[] = (start) =>
    [0, 1, 2].map((k) => {
      const angle = start + (k * 2 * Math.PI) / 3;
      return [pin.target[0] + distance * Math.cos(angle), pin.target[1] + distance * Math.sin(angle)];
    });
  const room: (places: Vector2[]) => number = (places) =>
    Math.min(...places.flatMap(([a, b]) => others.map((p) => Math.hypot(p.target[0] - a, p.target[1] - b))), distance);
  const tried = Array.from({ length: RIM_ANGLES }, (_, k) =>
    placesFrom(-Math.PI / 2 + (k * 2 * Math.PI) / 3 / RIM_ANGLES),
  );
  const best = tried.reduce((p, q) => (room(q) > room(p) + 1e-9 * distance ? q : p)),
    made = [...points];
  for (const target of best) {
    const source = sourceAt(target);
    if (source) made.push(newPoint(id + made.length - points.length, source, target, rimName(pin)));
  }
  return made;
}

// ---- mirror symmetry: an edit of a point is also done to its partner on the other side of an axis ------------------

function mirrorNormal({ normal, axis }: Mirror): Vector {
  return normal ?? (axis === "a" ? [1, 0] : [0, 1]);
}

/** The signed distance of a place from the axis. */
function axisDistance(mirror: Mirror, place: Vector) {
  return mirrorNormal(mirror).reduce((sum, n, k) => sum + n * place[k]!, 0) - mirror.at;
}

/** Move a place along the normal. */
function moveAcross<V extends Vector>(mirror: Mirror, place: V, way: number) {
  const normal = mirrorNormal(mirror);
  return mapVector(place, (x, k) => x + way * normal[k]!);
}

function mirrorPlace<V extends Vector>(mirror: Mirror, place: V) {
  return moveAcross(mirror, place, -2 * axisDistance(mirror, place));
}

/** 1 or -1 for the side of the axis for a place, 0 within `near` of it. */
export function mirrorSide(mirror: Mirror, place: Vector, near: number) {
  const away = axisDistance(mirror, place);
  return Math.abs(away) <= near ? 0 : Math.sign(away);
}

/** The nearest place on the axis. */
export function projectOnAxis<V extends Vector>(mirror: Mirror, place: V) {
  return moveAcross(mirror, place, -axisDistance(mirror, place));
}

export function distance(p: Vector, q: Vector) {
  return Math.hypot(...difference(p, q));
}

/** The point whose source is the mirror image of that of `p`, or null. */
function findPartner<V extends Vector>(mirror: Mirror, points: Point<V>[], p: Point<V>, near: number) {
  const place = mirrorPlace(mirror, p.source);
  let best = null,
    least = near;
  for (const q of points) {
    const away = distance(q.source, place);
    if (q.id !== p.id && away <= least) {
      best = q;
      least = away;
    }
  }
  return best;
}

/** Keep a target on the side of its source: beyond the axis it would meet its partner. */
function clampToSide<V extends Vector>(mirror: Mirror, place: V, side: number, near: number) {
  const away = axisDistance(mirror, place);
  return away * side >= near ? place : moveAcross(mirror, place, side * near - away);
}

/**
 * Mirror an edit (`before` to `after`) to the other side.
 *
 * near: the lengths within which a source is on the axis and a partner is found; id: of the next new point; lead: the
 * side that decides where both have changed; findVisible(source): where that tissue is seen now, or null. The partner of a
 * new point holds it there, and moves nothing, also where the two sides have been deformed in different ways.
 */
export function mirrorEdit<V extends Vector>(
  mirror: Mirror,
  before: Point<V>[],
  after: Point<V>[],
  {
    near,
    id,
    lead = 0,
    findVisible = () => null,
  }: {
    near: { axis: number; partner: number };
    id: number;
    lead?: number;
    findVisible?: (source: V) => V | null;
  },
) {
  const was = new Map(before.map((p) => [p.id, p])),
    result = new Map(after.map((p) => [p.id, p]));
  const moved = after.filter((p) => !isUnmoved(was.get(p.id), p));
  const first = moved.map((p) => mirrorSide(mirror, p.source, near.axis)).find((side) => side !== 0) ?? 1;
  const leads = lead || first;
  const sideNow = (p: Point<V>) => mirrorSide(mirror, (was.get(p.id) ?? p).source, near.axis);
  for (const p of before) {
    if (result.has(p.id) || sideNow(p) === 0) continue;
    const partner = findPartner(mirror, before, p, near.partner);
    if (partner && !partner.locked) result.delete(partner.id);
  }
  const handled = new Set<number>(),
    isLed = moved.some((p) => !was.has(p.id) && sideNow(p) === leads);
  for (const p of [...moved].sort((p, q) => Number(sideNow(q) === leads) - Number(sideNow(p) === leads))) {
    const side = sideNow(p),
      old = was.get(p.id);
    if (handled.has(p.id) || !result.has(p.id)) continue;
    if (side === 0) {
      result.set(p.id, projectPoint(mirror, p, old));
      continue;
    }
    if (side !== leads && !old && isLed) {
      result.delete(p.id);
      continue;
    } // its partner is being moved
    const kept = { ...p, target: clampToSide(mirror, p.target, side, near.axis) };
    result.set(p.id, kept);
    const partner = findPartner(mirror, before, old ?? p, near.partner);
    if (partner && (partner.locked || !result.has(partner.id))) continue;
    if (partner) handled.add(partner.id);
    else if (old && !hasMoved(old, p)) continue; // switched only: nothing to make
    const made = mirrorPoint(mirror, kept, old, partner, partner ? partner.id : id);
    if (!partner && !old) made.target = visiblePlace(made, findVisible(made.source), near.axis);
    if (!partner) id += 1;
    result.set(made.id, made);
  }
  return [...result.values()];
}

/** The place where the tissue is visible; one that differs by rounding alone is the mirror's own. */
function visiblePlace<V extends Vector>({ target }: Point<V>, seen: V | null, near: number) {
  return seen === null || distance(seen, target) < 1e-3 * near ? target : seen;
}

function hasMoved(p: Point, q: Point) {
  return !samePoints(p.source, q.source) || !samePoints(p.target, q.target);
}

function isUnmoved(p: Point | undefined, q: Point) {
  return p !== undefined && !hasMoved(p, q) && p.active === q.active;
}

/** Project the places of a point on the axis. */
function projectPoint<V extends Vector>(mirror: Mirror, p: Point<V>, old?: Point<V>) {
  const isTaken = old && samePoints(old.source, p.source);
  return {
    ...p,
    source: isTaken ? p.source : projectOnAxis(mirror, p.source),
    target: projectOnAxis(mirror, p.target),
  };
}

/** The point on the other side: the partner, or a new one with this id. */
function mirrorPoint<V extends Vector>(
  mirror: Mirror,
  p: Point<V>,
  old: Point<V> | undefined,
  partner: Point<V> | null,
  id: number,
): Point<V> {
  const target = mirrorPlace(mirror, p.target),
    source = mirrorPlace(mirror, p.source);
  if (partner === null) return { ...p, id, name: old ? "" : p.name, source, target, locked: false };
  const isSame = old && samePoints(old.source, p.source);
  return { ...partner, active: p.active, source: isSame ? partner.source : source, target };
}

/** Ids of the points that are elsewhere than before, or new. */
export function changedIds<V extends Vector>(before: Point<V>[], after: Point<V>[]) {
  const was = new Map(before.map((point) => [point.id, point]));
  const isChanged = ({ id, source, target }: Point<V>) => {
    const old = was.get(id);
    return !old || `${old.source} ${old.target}` !== `${source} ${target}`;
  };
  return after.filter(isChanged).map(({ id }) => id);
}
