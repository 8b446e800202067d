// Edits of a list of control points and their undo. Pure functions of plain lists; no DOM.
// A point is {id, name, source: [a, b], target: [a, b], active, weight, locked, radius}, with three coordinates in space;
// radius is null where it is that of all. No edit changes an object it was given.

export function samePoints(p, q) {
  return p === q || JSON.stringify(p) === JSON.stringify(q);
}

// Any list of point-like objects as full points; what is no point is left out.
export function cleanPoints(list) {
  const good = (place) => Array.isArray(place) && [2, 3].includes(place.length) && place.every(Number.isFinite);
  const seen = new Set();
  return (Array.isArray(list) ? list : []).filter((p) => {
    if (!p || !Number.isInteger(p.id) || !good(p.source) || !good(p.target) || seen.has(p.id)) return false;
    seen.add(p.id);
    return true;
  }).map((p) => ({ id: p.id, name: String(p.name ?? ""), source: [...p.source], target: [...p.target],
    active: p.active !== false, weight: Number.isFinite(p.weight) && p.weight > 0 ? p.weight : 1,
    locked: p.locked === true, radius: Number.isFinite(p.radius) && p.radius > 0 ? p.radius : null }));
}

export function changed(points, ids, change) {
  const chosen = new Set(ids);
  return points.map((p) => (chosen.has(p.id) ? { ...p, ...change(p) } : p));
}

// Move targets ("target"), sources ("source") or whole points ("both") by (da, db).
export function movedPoints(points, ids, da, db, what = "target") {
  const by = ([a, b]) => [a + da, b + db];
  return changed(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source), target: what === "source" ? p.target : by(p.target) }));
}

// Fields in the order in which Python tells them: lists are compared as text.
export function newPoint(id, source, target, name = "") {
  return { id, name, source: [...source], target: [...target], active: true, weight: 1, locked: false, radius: null };
}

export function addedPoint(points, id, source, target) { return [...points, newPoint(id, source, target)]; }

export function removedPoints(points, ids) {
  const gone = new Set(ids);
  return points.filter((p) => !gone.has(p.id));
}

export function renamedPoint(points, id, name) {
  return changed(points, [id], () => ({ name: name.trim().slice(0, 80) }));
}

// On if all chosen are off, else off: one press always does something visible.
export function switchedPoints(points, ids) {
  const chosen = new Set(ids), some = points.some((p) => chosen.has(p.id) && p.active);
  return changed(points, ids, () => ({ active: !some }));
}

// Locked if some of the chosen are not yet, else free.
export function lockedPoints(points, ids) {
  const chosen = new Set(ids), isFree = points.some((p) => chosen.has(p.id) && !p.locked);
  return changed(points, ids, () => ({ locked: isFree }));
}

// Those of the ids that may be moved and removed.
export function freeIds(points, ids) {
  const locked = new Set(points.filter((p) => p.locked).map((p) => p.id));
  return ids.filter((id) => !locked.has(id));
}

export function resetPoints(points, ids) {
  return changed(points, ids, (p) => ({ target: [...p.source] }));
}

export function nextId(points, least) {
  return points.reduce((id, p) => Math.max(id, p.id + 1), least);
}

// ---- cuts and rigid parts, as far as whoever sends them needs to know (maths/shapes.js edits them) ------------------------

// Any lists as full shapes, in one order of their fields. Regions that are there already are kept as the same objects:
// their distances are known (maths/regions.js).
export function cleanShapes(list, what, old = []) {
  const known = new Map(old.map(({ region }) => [JSON.stringify(region), region]));
  return (Array.isArray(list) ? list : []).filter((shape) => shape?.region?.kind).map((shape) => {
    const plain = plainRegion(shape.region), region = known.get(JSON.stringify(plain)) ?? plain;
    const kept = { name: String(shape.name ?? ""), enabled: shape.enabled !== false };
    if (what === "cuts") return { ...kept, region };
    return { ...kept, weight: shape.weight ?? "saturated", reach: shape.reach ?? null, motion: shape.motion ?? null, region };
  });
}

function plainRegion({ kind, vertices, point, normal, shape, spacing, origin, bits }) {
  if (kind === "half_space") return { kind, point, normal };
  return kind === "mask" ? { kind, shape, spacing, origin, bits } : { kind, vertices };
}

export function sameShapes(p, q) { return p === q || JSON.stringify(p) === JSON.stringify(q); }

// Undo as a list of old states. Edits of one kind in quick succession (arrow keys) count as one.
export class History {
  constructor(most = 200) {
    Object.assign(this, { past: [], future: [], most, kind: null, at: -Infinity });
  }

  // `before` is the state that the edit leaves; kind null never joins the edit before it. Returns whether it joins.
  record(before, kind = null, now = Date.now()) {
    const joins = kind !== null && kind === this.kind && now - this.at < 800 && this.past.length > 0;
    if (!joins) this.past.push(before);
    if (this.past.length > this.most) this.past.shift();
    this.future = [];
    this.kind = kind;
    this.at = now;
    return joins;
  }

  undo(current) { return this.#step(this.past, this.future, current); }

  redo(current) { return this.#step(this.future, this.past, current); }

  #step(from, to, current) {
    if (from.length === 0) return null;
    to.push(current);
    this.kind = null;
    return from.pop();
  }
}

// Points turned and scaled about their middle, and the rim of a single one. Pure functions of plain lists; needs maths/points.js.
// A point alone has nothing to turn; three still ones around it, its rim, are turned instead.

// Ways of a turn: clockwise is 1. With Shift the same keys write other signs, with Alt on some keyboards as well.
export const TURN_WAYS = { ",": -1, "<": -1, ";": -1, ".": 1, ">": 1, ":": 1 }, TURN_CODES = { Comma: ",", Period: "." };
const TURN_STEPS = [2, 15]; // degrees, or percent, of a key alone and with Shift
const RIM_ANGLES = 12; // starts that are tried, so that no rim point falls beside another point

export function middleOf(points) {
  return [0, 1].map((c) => points.reduce((sum, p) => sum + p.target[c], 0) / points.length);
}

// Targets turned by an angle (clockwise on the screen, where b runs down) and scaled, about a place.
export function turnedPoints(points, ids, about, angle, factor = 1) {
  const c = factor * Math.cos(angle), s = factor * Math.sin(angle);
  return changed(points, ids, (p) => {
    const x = p.target[0] - about[0], y = p.target[1] - about[1];
    return { target: [about[0] + c * x - s * y, about[1] + s * x + c * y] };
  });
}

// The angle and the factor of a key, one of which does nothing.
export function turnOfKey(way, { isLarge, isScale }) {
  const step = TURN_STEPS[isLarge ? 1 : 0] * way;
  return isScale ? [0, (1 + Math.abs(step) / 100) ** Math.sign(step)] : [step * Math.PI / 180, 1];
}

// The angle and the factor of a hand that goes from one place beside the middle to another: Alt scales, Shift goes in steps.
export function turnOfHand([x, y], to, event) {
  if (event.altKey) {
    const factor = Math.max(0.1, Math.min(10, Math.hypot(...to) / Math.hypot(x, y)));
    return [0, event.shiftKey ? Math.max(0.1, Math.round(10 * factor) / 10) : factor];
  }
  const angle = Math.atan2(x * to[1] - y * to[0], x * to[0] + y * to[1]), step = Math.PI / 12;
  return [event.shiftKey ? step * Math.round(angle / step) : angle, 1];
}

function rimName(pin) { return `${pin.name || `point ${pin.id}`} rim`; }

// The rim that a point has already, three at most: the nearest ones of that name.
export function rimOf(points, pin) {
  const name = rimName(pin), away = (p) => Math.hypot(p.source[0] - pin.source[0], p.source[1] - pin.source[1]);
  return points.filter((p) => p.name === name && p.id !== pin.id).sort((p, q) => away(p) - away(q)).slice(0, 3);
}

// Those points, and the rims of those that have one: what goes with a pin.
export function withRims(points, ids) {
  const chosen = new Set(ids);
  for (const p of points) if (ids.includes(p.id)) for (const rim of rimOf(points, p)) chosen.add(rim.id);
  return [...chosen];
}

// A rim of three points around a pin, each holding what is there; `sourceAt(place)` is null where nothing is.
export function rimmedPoints(points, pin, distance, id, sourceAt) {
  const others = points.filter((p) => p.active && p.id !== pin.id);
  const placesFrom = (start) => [0, 1, 2].map((k) => {
    const angle = start + k * 2 * Math.PI / 3;
    return [pin.target[0] + distance * Math.cos(angle), pin.target[1] + distance * Math.sin(angle)];
  });
  const room = (places) => Math.min(...places.flatMap(([a, b]) => others.map(
    (p) => Math.hypot(p.target[0] - a, p.target[1] - b))), distance);
  const tried = Array.from({ length: RIM_ANGLES }, (_, k) => placesFrom(-Math.PI / 2 + k * 2 * Math.PI / 3 / RIM_ANGLES));
  const best = tried.reduce((p, q) => (room(q) > room(p) + 1e-9 * distance ? q : p));
  const made = best.map((target) => ({ target, source: sourceAt(target) })).filter(({ source }) => source !== null);
  return [...points, ...made.map(({ target, source }, k) => newPoint(id + k, source, target, rimName(pin)))];
}

// Mirror symmetry: what is done to a point is done to its partner on the other side of an axis. Pure functions of plain
// lists; needs maths/points.js. A mirror of a picture is {on, axis: "a" | "b", at}: the coordinate that changes its sign, and the
// line; one in space has a `normal`, along which its plane lies at `at`.

function mirrorNormal({ normal, axis }) { return normal ?? (axis === "a" ? [1, 0] : [0, 1]); }

// How far a place lies on the positive side.
function awayFrom(mirror, place) { return mirrorNormal(mirror).reduce((sum, n, k) => sum + n * place[k], 0) - mirror.at; }

// A place, moved along the normal.
function acrossBy(mirror, place, way) { return mirrorNormal(mirror).map((n, k) => place[k] + way * n); }

function mirrorPlace(mirror, place) { return acrossBy(mirror, place, -2 * awayFrom(mirror, place)); }

// 1 or -1 for the side of the axis on which a place lies, 0 on it.
export function mirrorSide(mirror, place, near) {
  const away = awayFrom(mirror, place);
  return Math.abs(away) <= near ? 0 : Math.sign(away);
}

export function onAxis(mirror, place) { return acrossBy(mirror, place, -awayFrom(mirror, place)); }

export function distance(p, q) { return Math.hypot(...p.map((value, k) => value - q[k])); }

// The point whose source lies where the mirror shows that of `p`, or null.
function partnerOf(mirror, points, p, near) {
  const place = mirrorPlace(mirror, p.source);
  let best = null, least = near;
  for (const q of points) {
    const away = distance(q.source, place);
    if (q.id !== p.id && away <= least) { best = q; least = away; }
  }
  return best;
}

// A target that stays on the side of its source: beyond the axis it would meet its partner.
function keptOnSide(mirror, place, side, near) {
  const away = awayFrom(mirror, place);
  return away * side >= near ? place : acrossBy(mirror, place, side * near - away);
}

// An edit (`before` to `after`) and the same on the other side. `near` are the lengths within which a source is on the
// axis and a partner is found; `id` that of the next new point; `lead` the side that decides where both have changed.
// `seenAt(source)` is where that matter is seen now, or null: the partner of a new point takes hold of it there, and
// moves nothing, also where the two sides have been bent in different ways.
export function mirroredEdit(mirror, before, after, { near, id, lead = 0, seenAt = () => null }) {
  const was = new Map(before.map((p) => [p.id, p])), result = new Map(after.map((p) => [p.id, p]));
  const moved = after.filter((p) => !was.has(p.id) || !isUnmoved(was.get(p.id), p));
  const first = moved.map((p) => mirrorSide(mirror, p.source, near.axis)).find((side) => side !== 0) ?? 1;
  const leads = lead || first, sideNow = (p) => mirrorSide(mirror, (was.get(p.id) ?? p).source, near.axis);
  for (const p of before) {
    if (result.has(p.id) || sideNow(p) === 0) continue;
    const partner = partnerOf(mirror, before, p, near.partner);
    if (partner && !partner.locked) result.delete(partner.id);
  }
  const handled = new Set(), isLed = moved.some((p) => !was.has(p.id) && sideNow(p) === leads);
  for (const p of [...moved].sort((p, q) => (sideNow(q) === leads) - (sideNow(p) === leads))) {
    const side = sideNow(p);
    if (handled.has(p.id) || !result.has(p.id)) continue;
    if (side === 0) { result.set(p.id, centredPoint(mirror, p, was.get(p.id))); continue; }
    if (side !== leads && !was.has(p.id) && isLed) { result.delete(p.id); continue; } // its partner is on its way
    const kept = { ...p, target: keptOnSide(mirror, p.target, side, near.axis) };
    result.set(p.id, kept);
    const partner = partnerOf(mirror, before, was.get(p.id) ?? p, near.partner);
    if (partner && (partner.locked || !result.has(partner.id))) continue;
    if (partner) handled.add(partner.id);
    else if (was.has(p.id) && !hasMoved(was.get(p.id), p)) continue; // switched only: nothing to make
    const made = mirroredPoint(mirror, kept, was.get(p.id), partner ?? null, partner ? partner.id : id);
    if (!partner && !was.has(p.id)) made.target = heldPlace(made, seenAt(made.source), near.axis);
    if (!partner) id += 1;
    result.set(made.id, made);
  }
  return [...result.values()];
}

// A place that differs by rounding alone is the mirror's own.
function heldPlace({ target }, seen, near) {
  return seen === null || distance(seen, target) < 1e-3 * near ? target : seen;
}

function hasMoved(p, q) { return !samePoints(p.source, q.source) || !samePoints(p.target, q.target); }

function isUnmoved(p, q) { return !hasMoved(p, q) && p.active === q.active; }

function centredPoint(mirror, p, old) {
  const isTaken = old && samePoints(old.source, p.source);
  return { ...p, source: isTaken ? p.source : onAxis(mirror, p.source), target: onAxis(mirror, p.target) };
}

function mirroredPoint(mirror, p, old, partner, id) {
  const target = mirrorPlace(mirror, p.target), source = mirrorPlace(mirror, p.source);
  if (partner === null) return { ...p, id, name: old ? "" : p.name, source, target, locked: false };
  const isSame = old && samePoints(old.source, p.source);
  return { ...partner, active: p.active, source: isSame ? partner.source : source, target };
}
