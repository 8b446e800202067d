// Points in space and where they are in a picture of it. Pure functions of plain lists, behind maths/camera.js; no DOM.
// A pane is what Python says of a picture: {name, origin, u, v, n, box, depths, spacing}; a and b run to the right and
// down in the picture, c into it, all three in the volume's unit.

import { dot } from "./camera.js";
import { shownLength } from "./numbers.js";
import { changed } from "./points.js";

export function inPane({ origin, u, v, n }, place) {
  const from = place.map((x, k) => x - origin[k]);
  return [dot(from, u), dot(from, v), dot(from, n)];
}

export function fromPane({ origin, u, v, n }, [a, b, c]) {
  return origin.map((o, k) => o + a * u[k] + b * v[k] + c * n[k]);
}

// The way in space of a way in a picture: it never leads out of the picture's plane.
export function wayInPane({ u, v }, da, db) { return u.map((x, k) => da * x + db * v[k]); }

// Move targets ("target"), sources ("source") or whole points ("both") by a way in space.
export function movedInSpace(points, ids, way, what = "target") {
  const by = (place) => place.map((x, k) => x + way[k]);
  return changed(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source), target: what === "source" ? p.target : by(p.target) }));
}

// Targets turned in a picture (clockwise there) and scaled in space, about their middle.
export function turnedInSpace(points, ids, pane, angle, factor = 1) {
  const chosen = points.filter((p) => ids.includes(p.id)), c = factor * Math.cos(angle), s = factor * Math.sin(angle);
  const about = inPane(pane, [0, 1, 2].map((k) => chosen.reduce((sum, p) => sum + p.target[k], 0) / chosen.length));
  return changed(points, ids, (p) => {
    const [a, b, d] = inPane(pane, p.target).map((x, k) => x - about[k]);
    return { target: fromPane(pane, [about[0] + c * a - s * b, about[1] + s * a + c * b, about[2] + factor * d]) };
  });
}

// What Python has made of the sources of points, in a list that has gone on meanwhile.
export function withSources(points, known) {
  const sources = new Map(known.map((p) => [p.id, p.source]));
  return points.map((p) => (sources.has(p.id) ? { ...p, source: [...sources.get(p.id)] } : p));
}

// A point as it is drawn in a picture. `away` is how far it lies behind the slice at `depth`; null for all at once.
export function flatPoint(p, pane, depth) {
  const target = inPane(pane, p.target), source = inPane(pane, p.source);
  const away = depth === null ? 0 : target[2] - depth, isFar = depth !== null && Math.abs(away) > 0.75 * pane.spacing[2];
  const name = isFar ? `${p.name || p.id} ${away > 0 ? "+" : "\u2212"}${shownLength(Math.abs(away))}` : p.name;
  return { id: p.id, name, active: p.active, locked: p.locked, source: source.slice(0, 2), target: target.slice(0, 2), away, isFar, whole: p };
}

// How clearly a point is drawn that far from the slice, on a volume so deep: 1 on it, never less than a third.
export function clearness(away, depth) { return Math.max(0.34, 1 - 3 * Math.abs(away) / Math.max(depth, 1e-9)); }

const SIDES = [["L", "R"], ["P", "A"], ["S", "I"]]; // of a patient, along growing and falling x, y, z

function wayInWords(way) {
  const parts = way.map((x, k) => [x, SIDES[k]]).filter(([x]) => Math.abs(x) >= 0.05)
    .map(([x, [more, less]]) => `${shownLength(Math.abs(x))} ${x > 0 ? more : less}`);
  return parts.length ? `dragged ${parts.join(", ")}` : "not dragged";
}

// What a screen reader says of a point in a picture, and what is shown where the mouse rests on it.
export function spaceLabel({ whole: p, isFar, away }) {
  const way = p.target.map((x, k) => x - p.source[k]), far = isFar ? `, ${shownLength(Math.abs(away))} off the slice` : "";
  return `Point ${p.id}${p.name ? ` ${p.name}` : ""}, at ${p.target.map(shownLength).join(", ")}, ${wayInWords(way)}` +
    `${far}${p.active ? "" : ", switched off"}${p.locked ? ", locked" : ""}`;
}

export function spaceTip({ whole: p, isFar, away }) {
  const way = p.target.map((x, k) => x - p.source[k]);
  const far = isFar ? `; ${shownLength(Math.abs(away))} ${away > 0 ? "behind" : "in front of"} this slice` : "";
  return `${p.name || `point ${p.id}`}: ${wayInWords(way)}${p.active ? "" : "; switched off"}${p.locked ? "; locked" : ""}${far}`;
}
