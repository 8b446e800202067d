// Mirror symmetry: what is done to a point is done to its partner on the other side of an axis. Pure functions of plain
// lists; needs edits.js. A mirror is {on, axis: "a" | "b", at}: the coordinate that changes its sign, and the line.

function mirrorPlace({ axis, at }, [a, b]) { return axis === "a" ? [2 * at - a, b] : [a, 2 * at - b]; }

// 1 or -1 for the side of the axis on which a place lies, 0 on it.
function sideOf({ axis, at }, place, near) {
  const away = place[axis === "a" ? 0 : 1] - at;
  return Math.abs(away) <= near ? 0 : Math.sign(away);
}

function onAxis({ axis, at }, [a, b]) { return axis === "a" ? [at, b] : [a, at]; }

// The point whose source lies where the mirror shows that of `p`, or null.
function partnerOf(mirror, points, p, near) {
  const [a, b] = mirrorPlace(mirror, p.source);
  let best = null, least = near;
  for (const q of points) {
    const away = Math.hypot(q.source[0] - a, q.source[1] - b);
    if (q.id !== p.id && away <= least) { best = q; least = away; }
  }
  return best;
}

// A target that stays on the side of its source: beyond the axis it would meet its partner.
function keptOnSide(mirror, place, side, near) {
  const c = mirror.axis === "a" ? 0 : 1;
  if ((place[c] - mirror.at) * side >= near) return place;
  return place.map((value, k) => (k === c ? mirror.at + side * near : value));
}

// An edit (`before` to `after`) and the same on the other side. `near` are the lengths within which a source is on the
// axis and a partner is found; `id` that of the next new point; `lead` the side that decides where both have changed.
function mirroredEdit(mirror, before, after, { near, id, lead = 0 }) {
  const was = new Map(before.map((p) => [p.id, p])), result = new Map(after.map((p) => [p.id, p]));
  const moved = after.filter((p) => !was.has(p.id) || !isUnmoved(was.get(p.id), p));
  const first = moved.map((p) => sideOf(mirror, p.source, near.axis)).find((side) => side !== 0) ?? 1;
  const leads = lead || first, sideNow = (p) => sideOf(mirror, (was.get(p.id) ?? p).source, near.axis);
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
    if (!partner) id += 1;
    result.set(made.id, made);
  }
  return [...result.values()];
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
