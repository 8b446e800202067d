// Mirror symmetry: what is done to a point is done to its partner on the other side of an axis. Pure functions of plain
// lists; needs edits.js. A mirror of a picture is {on, axis: "a" | "b", at}: the coordinate that changes its sign, and the
// line; one in space has a `normal`, along which its plane lies at `at`.

function mirrorNormal({ normal, axis }) { return normal ?? (axis === "a" ? [1, 0] : [0, 1]); }

// How far a place lies on the positive side.
function awayFrom(mirror, place) { return mirrorNormal(mirror).reduce((sum, n, k) => sum + n * place[k], 0) - mirror.at; }

// A place, moved along the normal.
function acrossBy(mirror, place, way) { return mirrorNormal(mirror).map((n, k) => place[k] + way * n); }

function mirrorPlace(mirror, place) { return acrossBy(mirror, place, -2 * awayFrom(mirror, place)); }

// 1 or -1 for the side of the axis on which a place lies, 0 on it.
function mirrorSide(mirror, place, near) {
  const away = awayFrom(mirror, place);
  return Math.abs(away) <= near ? 0 : Math.sign(away);
}

function onAxis(mirror, place) { return acrossBy(mirror, place, -awayFrom(mirror, place)); }

function distance(p, q) { return Math.hypot(...p.map((value, k) => value - q[k])); }

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
function mirroredEdit(mirror, before, after, { near, id, lead = 0, seenAt = () => null }) {
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
