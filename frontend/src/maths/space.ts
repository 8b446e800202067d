// Points in space and their places in the pictures of a volume. Pure functions of plain lists.

import { dot } from "./camera.js";
import { shownLength } from "./numbers.js";
import { changed } from "./points.js";

/** @import { FlatPoint, PaneInfo, Point, RbfFit, Vector3 } from "../types.d.ts" */

/**
 * The coordinates [a, b, c] in a picture of a place in space.
 * @param {PaneInfo} pane
 * @param {number[]} place
 * @returns {Vector3}
 */
export function inPane({ origin, u, v, n }, place) {
  const from = place.map((x, k) => x - origin[k]);
  return [dot(from, u), dot(from, v), dot(from, n)];
}

/**
 * The place in space of coordinates in a picture.
 * @param {PaneInfo} pane
 * @param {number[]} place
 */
export function fromPane({ origin, u, v, n }, [a, b, c]) {
  return origin.map((o, k) => o + a * u[k] + b * v[k] + c * n[k]);
}

/**
 * The displacement in space of a displacement in a picture: it never leads out of the picture's plane.
 * @param {PaneInfo} pane
 * @param {number} da
 * @param {number} db
 */
export function wayInPane({ u, v }, da, db) { return u.map((x, k) => da * x + db * v[k]); }

/**
 * Move targets ("target"), sources ("source") or whole points ("both") by a displacement in space.
 * @param {Point[]} points
 * @param {number[]} ids
 * @param {number[]} way
 * @param {string} [what]
 */
export function movedInSpace(points, ids, way, what = "target") {
  /** @type {(place: number[]) => number[]} */
  const by = (place) => place.map((x, k) => x + way[k]);
  return changed(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source), target: what === "source" ? p.target : by(p.target) }));
}

/**
 * Targets rotated in a picture (clockwise there) and scaled in space, about their middle.
 * @param {Point[]} points
 * @param {number[]} ids
 * @param {PaneInfo} pane
 * @param {number} angle
 * @param {number} [factor]
 */
export function turnedInSpace(points, ids, pane, angle, factor = 1) {
  const chosen = points.filter((p) => ids.includes(p.id)), c = factor * Math.cos(angle), s = factor * Math.sin(angle);
  const about = inPane(pane, [0, 1, 2].map((k) => chosen.reduce((sum, p) => sum + p.target[k], 0) / chosen.length));
  return changed(points, ids, (p) => {
    const [a, b, d] = inPane(pane, p.target).map((x, k) => x - about[k]);
    return { target: fromPane(pane, [about[0] + c * a - s * b, about[1] + s * a + c * b, about[2] + factor * d]) };
  });
}

/**
 * A fit in space, in another frame.
 * @param {RbfFit} fit
 * @param {number[][]} axes  of the frame, which are orthonormal
 * @param {number[]} origin  of the frame
 * @returns {RbfFit}
 */
export function fitInFrame(fit, axes, origin) {
  const turned = (/** @type {number[]} */ v) => axes.map((axis) => dot(axis, v));
  /** @type {(vectors: Float64Array) => Float64Array} */
  const allTurned = (vectors) => Float64Array.from(vectors, (_, i) => (
    dot(axes[i % 3], Array.from(vectors.subarray(i - (i % 3), i - (i % 3) + 3)))));
  /** @type {(m: number[][]) => number[][]} */
  const seen = (m) => axes.map((left) => axes.map((right) => dot(left, m.map((row) => dot(row, right)))));
  const forms = fit.quadratic?.map(seen);
  return { ...fit, centers: allTurned(fit.centers), coefficients: allTurned(fit.coefficients), linear: seen(fit.linear),
    constant: turned(fit.constant), origin: turned(fit.origin.map((x, k) => x - origin[k])),
    quadratic: forms ? axes.map((axis) => forms[0].map((row, i) => row.map((_, j) => (
      dot(axis, forms.map((form) => form[i][j])))))) : null };
}

/**
 * The points with the sources of other points of the same ids, which Python has found meanwhile.
 * @param {Point[]} points
 * @param {Point[]} known
 */
export function withSources(points, known) {
  const sources = new Map(known.map((p) => [p.id, p.source]));
  return points.map((p) => {
    const source = sources.get(p.id);
    return source ? { ...p, source: [...source] } : p;
  });
}

/**
 * A point as it is drawn in a picture.
 * @param {Point} p
 * @param {PaneInfo} pane
 * @param {number | null} depth  of the slice; null in pictures of the whole volume
 * @returns {FlatPoint}
 */
export function flatPoint(p, pane, depth) {
  const target = inPane(pane, p.target), source = inPane(pane, p.source);
  const away = depth === null ? 0 : target[2] - depth;
  const isFar = depth !== null && Math.abs(away) > 0.75 * pane.spacing[2];
  const name = isFar ? `${p.name || p.id} ${away > 0 ? "+" : "\u2212"}${shownLength(Math.abs(away))}` : p.name;
  return { id: p.id, name, active: p.active, locked: p.locked, source: source.slice(0, 2), target: target.slice(0, 2),
    away, isFar, whole: p };
}

/**
 * The opacity of a point that far from the slice: 1 on it, never less than a third.
 * @param {number} away
 * @param {number} depth  of the volume
 */
export function clearness(away, depth) { return Math.max(0.34, 1 - 3 * Math.abs(away) / Math.max(depth, 1e-9)); }

const SIDES = [["L", "R"], ["P", "A"], ["S", "I"]]; // of a patient, along growing and falling x, y, z

/** @param {number[]} way */
function wayInWords(way) {
  const parts = way.map((x, k) => (Math.abs(x) < 0.05 ? "" : `${shownLength(Math.abs(x))} ${SIDES[k][x > 0 ? 0 : 1]}`));
  const shown = parts.filter(Boolean);
  return shown.length ? `dragged ${shown.join(", ")}` : "not dragged";
}

/** The label of a point in a picture for screen readers. @param {FlatPoint} point */
export function spaceLabel({ whole: p, isFar, away }) {
  const way = p.target.map((x, k) => x - p.source[k]);
  const far = isFar ? `, ${shownLength(Math.abs(away))} off the slice` : "";
  return `Point ${p.id}${p.name ? ` ${p.name}` : ""}, at ${p.target.map(shownLength).join(", ")}, ${wayInWords(way)}` +
    `${far}${p.active ? "" : ", switched off"}${p.locked ? ", locked" : ""}`;
}

/** The tip of a point in a picture. @param {FlatPoint} point */
export function spaceTip({ whole: p, isFar, away }) {
  const way = p.target.map((x, k) => x - p.source[k]);
  const far = isFar ? `; ${shownLength(Math.abs(away))} ${away > 0 ? "behind" : "in front of"} this slice` : "";
  return `${p.name || `point ${p.id}`}: ${wayInWords(way)}${p.active ? "" : "; switched off"}` +
    `${p.locked ? "; locked" : ""}${far}`;
}
