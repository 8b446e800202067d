// Edits of a list of control points and their undo. Pure functions of plain lists; no DOM.
// A point is {id, name, source: [a, b], target: [a, b], active, weight, locked, radius}, with three coordinates in space;
// radius is null where it is that of all. No edit changes an object it was given.

function samePoints(p, q) {
  return p === q || JSON.stringify(p) === JSON.stringify(q);
}

// Any list of point-like objects as full points; what is no point is left out.
function cleanPoints(list) {
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

function changed(points, ids, change) {
  const chosen = new Set(ids);
  return points.map((p) => (chosen.has(p.id) ? { ...p, ...change(p) } : p));
}

// Move targets ("target"), sources ("source") or whole points ("both") by (da, db).
function movedPoints(points, ids, da, db, what = "target") {
  const by = ([a, b]) => [a + da, b + db];
  return changed(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source), target: what === "source" ? p.target : by(p.target) }));
}

// Fields in the order in which Python tells them: lists are compared as text.
function newPoint(id, source, target, name = "") {
  return { id, name, source: [...source], target: [...target], active: true, weight: 1, locked: false, radius: null };
}

function addedPoint(points, id, source, target) { return [...points, newPoint(id, source, target)]; }

function removedPoints(points, ids) {
  const gone = new Set(ids);
  return points.filter((p) => !gone.has(p.id));
}

function renamedPoint(points, id, name) {
  return changed(points, [id], () => ({ name: name.trim().slice(0, 80) }));
}

// On if all chosen are off, else off: one press always does something visible.
function switchedPoints(points, ids) {
  const chosen = new Set(ids), some = points.some((p) => chosen.has(p.id) && p.active);
  return changed(points, ids, () => ({ active: !some }));
}

// Locked if some of the chosen are not yet, else free.
function lockedPoints(points, ids) {
  const chosen = new Set(ids), isFree = points.some((p) => chosen.has(p.id) && !p.locked);
  return changed(points, ids, () => ({ locked: isFree }));
}

// Those of the ids that may be moved and removed.
function freeIds(points, ids) {
  const locked = new Set(points.filter((p) => p.locked).map((p) => p.id));
  return ids.filter((id) => !locked.has(id));
}

function resetPoints(points, ids) {
  return changed(points, ids, (p) => ({ target: [...p.source] }));
}

function nextId(points, least) {
  return points.reduce((id, p) => Math.max(id, p.id + 1), least);
}

// ---- cuts and rigid parts, as far as whoever sends them needs to know (shapes.js edits them) ------------------------

// Any lists as full shapes, in one order of their fields. Regions that are there already are kept as the same objects:
// their distances are known (regions.js).
function cleanShapes(list, what, old = []) {
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

function sameShapes(p, q) { return p === q || JSON.stringify(p) === JSON.stringify(q); }

// Undo as a list of old states. Edits of one kind in quick succession (arrow keys) count as one.
class History {
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
