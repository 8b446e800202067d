// Points turned and scaled about their middle, and the rim of a single one. Pure functions of plain lists; needs edits.js.
// A point alone has nothing to turn; three still ones around it, its rim, are turned instead.

// Ways of a turn: clockwise is 1. With Shift the same keys write other signs, with Alt on some keyboards as well.
const TURN_WAYS = { ",": -1, "<": -1, ";": -1, ".": 1, ">": 1, ":": 1 }, TURN_CODES = { Comma: ",", Period: "." };
const TURN_STEPS = [2, 15]; // degrees, or percent, of a key alone and with Shift
const RIM_ANGLES = 12; // starts that are tried, so that no rim point falls beside another point

function middleOf(points) {
  return [0, 1].map((c) => points.reduce((sum, p) => sum + p.target[c], 0) / points.length);
}

// Targets turned by an angle (clockwise on the screen, where b runs down) and scaled, about a place.
function turnedPoints(points, ids, about, angle, factor = 1) {
  const c = factor * Math.cos(angle), s = factor * Math.sin(angle);
  return changed(points, ids, (p) => {
    const x = p.target[0] - about[0], y = p.target[1] - about[1];
    return { target: [about[0] + c * x - s * y, about[1] + s * x + c * y] };
  });
}

// The angle and the factor of a key, one of which does nothing.
function turnOfKey(way, { isLarge, isScale }) {
  const step = TURN_STEPS[isLarge ? 1 : 0] * way;
  return isScale ? [0, (1 + Math.abs(step) / 100) ** Math.sign(step)] : [step * Math.PI / 180, 1];
}

// The angle and the factor of a hand that goes from one place beside the middle to another: Alt scales, Shift goes in steps.
function turnOfHand([x, y], to, event) {
  if (event.altKey) {
    const factor = Math.max(0.1, Math.min(10, Math.hypot(...to) / Math.hypot(x, y)));
    return [0, event.shiftKey ? Math.max(0.1, Math.round(10 * factor) / 10) : factor];
  }
  const angle = Math.atan2(x * to[1] - y * to[0], x * to[0] + y * to[1]), step = Math.PI / 12;
  return [event.shiftKey ? step * Math.round(angle / step) : angle, 1];
}

function rimName(pin) { return `${pin.name || `point ${pin.id}`} rim`; }

// The rim that a point has already, three at most: the nearest ones of that name.
function rimOf(points, pin) {
  const name = rimName(pin), away = (p) => Math.hypot(p.source[0] - pin.source[0], p.source[1] - pin.source[1]);
  return points.filter((p) => p.name === name && p.id !== pin.id).sort((p, q) => away(p) - away(q)).slice(0, 3);
}

// Those points, and the rims of those that have one: what goes with a pin.
function withRims(points, ids) {
  const chosen = new Set(ids);
  for (const p of points) if (ids.includes(p.id)) for (const rim of rimOf(points, p)) chosen.add(rim.id);
  return [...chosen];
}

// A rim of three points around a pin, each holding what is there; `sourceAt(place)` is null where nothing is.
function rimmedPoints(points, pin, distance, id, sourceAt) {
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
