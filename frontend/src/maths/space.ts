// Points in space and their places in the pictures of a volume. Pure functions of plain lists.

import type { FlatPoint, PaneInfo, Point, RbfFit, Vector3 } from "../types.ts";
import { dot } from "./camera.ts";
import { shownLength } from "./numbers.ts";
import { changed } from "./points.ts";

/** The coordinates [a, b, c] in a picture of a place in space. */
export function inPane({ origin, u, v, n }: PaneInfo, place: number[]): Vector3 {
  const from = place.map((x, k) => x - origin[k]);
  return [dot(from, u), dot(from, v), dot(from, n)];
}

/** The place in space of coordinates in a picture. */
export function fromPane({ origin, u, v, n }: PaneInfo, [a, b, c]: Vector3): Vector3 {
  const at = (k: 0 | 1 | 2) => origin[k] + a * u[k] + b * v[k] + c * n[k];
  return [at(0), at(1), at(2)];
}

/** The displacement in space of a displacement in a picture: it never leads out of the picture's plane. */
export function wayInPane({ u, v }: PaneInfo, da: number, db: number): Vector3 {
  return [da * u[0] + db * v[0], da * u[1] + db * v[1], da * u[2] + db * v[2]];
}

/** Move targets ("target"), sources ("source") or whole points ("both") by a displacement in space. */
export function movedInSpace(points: Point[], ids: number[], way: number[], what: string = "target") {
  const by: (place: number[]) => number[] = (place) => place.map((x, k) => x + way[k]);
  return changed(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source),
    target: what === "source" ? p.target : by(p.target),
  }));
}

/** Targets rotated in a picture (clockwise there) and scaled in space, about their middle. */
export function turnedInSpace(points: Point[], ids: number[], pane: PaneInfo, angle: number, factor: number = 1) {
  const chosen = points.filter((p) => ids.includes(p.id)),
    c = factor * Math.cos(angle),
    s = factor * Math.sin(angle);
  const about = inPane(
    pane,
    [0, 1, 2].map((k) => chosen.reduce((sum, p) => sum + p.target[k], 0) / chosen.length),
  );
  return changed(points, ids, (p) => {
    const [a, b, d] = inPane(pane, p.target).map((x, k) => x - about[k]);
    return { target: fromPane(pane, [about[0] + c * a - s * b, about[1] + s * a + c * b, about[2] + factor * d]) };
  });
}

/**
 * A fit in space, in another frame.
 * @param axes of the frame, which are orthonormal
 * @param origin of the frame
 */
export function fitInFrame(fit: RbfFit, axes: number[][], origin: number[]): RbfFit {
  const turned = (v: number[]) => axes.map((axis) => dot(axis, v));
  const allTurned: (vectors: Float64Array) => Float64Array = (vectors) =>
    Float64Array.from(vectors, (_, i) => dot(axes[i % 3], Array.from(vectors.subarray(i - (i % 3), i - (i % 3) + 3))));
  const seen: (m: number[][]) => number[][] = (m) =>
    axes.map((left) =>
      axes.map((right) =>
        dot(
          left,
          m.map((row) => dot(row, right)),
        ),
      ),
    );
  const forms = fit.quadratic?.map(seen);
  return {
    ...fit,
    centers: allTurned(fit.centers),
    coefficients: allTurned(fit.coefficients),
    linear: seen(fit.linear),
    constant: turned(fit.constant),
    origin: turned(fit.origin.map((x, k) => x - origin[k])),
    quadratic: forms
      ? axes.map((axis) =>
          forms[0].map((row, i) =>
            row.map((_, j) =>
              dot(
                axis,
                forms.map((form) => form[i][j]),
              ),
            ),
          ),
        )
      : null,
  };
}

/** The points with the sources of other points of the same ids, which Python has found meanwhile. */
export function withSources(points: Point[], known: Point[]) {
  const sources = new Map(known.map((p) => [p.id, p.source]));
  return points.map((p) => {
    const source = sources.get(p.id);
    return source ? { ...p, source: [...source] } : p;
  });
}

/**
 * A point as it is drawn in a picture.
 * @param depth of the slice; null in pictures of the whole volume
 */
export function flatPoint(p: Point, pane: PaneInfo, depth: number | null): FlatPoint {
  const target = inPane(pane, p.target),
    source = inPane(pane, p.source);
  const away = depth === null ? 0 : target[2] - depth;
  const isFar = depth !== null && Math.abs(away) > 0.75 * pane.spacing[2];
  const name = isFar ? `${p.name || p.id} ${away > 0 ? "+" : "\u2212"}${shownLength(Math.abs(away))}` : p.name;
  return {
    id: p.id,
    name,
    active: p.active,
    locked: p.locked,
    source: [source[0], source[1]],
    target: [target[0], target[1]],
    away,
    isFar,
    whole: p,
  };
}

/**
 * The opacity of a point that far from the slice: 1 on it, never less than a third.
 * @param depth of the volume
 */
export function clearness(away: number, depth: number) {
  return Math.max(0.34, 1 - (3 * Math.abs(away)) / Math.max(depth, 1e-9));
}

const SIDES = [
  ["L", "R"],
  ["P", "A"],
  ["S", "I"],
]; // of a patient, along growing and falling x, y, z

function wayInWords(way: number[]) {
  const parts = way.map((x, k) => (Math.abs(x) < 0.05 ? "" : `${shownLength(Math.abs(x))} ${SIDES[k][x > 0 ? 0 : 1]}`));
  const shown = parts.filter(Boolean);
  return shown.length ? `dragged ${shown.join(", ")}` : "not dragged";
}

/** The label of a point in a picture for screen readers. */
export function spaceLabel({ whole: p, isFar, away }: FlatPoint) {
  const way = p.target.map((x, k) => x - p.source[k]);
  const far = isFar ? `, ${shownLength(Math.abs(away))} off the slice` : "";
  return (
    `Point ${p.id}${p.name ? ` ${p.name}` : ""}, at ${p.target.map(shownLength).join(", ")}, ${wayInWords(way)}` +
    `${far}${p.active ? "" : ", switched off"}${p.locked ? ", locked" : ""}`
  );
}

/** The tip of a point in a picture. */
export function spaceTip({ whole: p, isFar, away }: FlatPoint) {
  const way = p.target.map((x, k) => x - p.source[k]);
  const far = isFar ? `; ${shownLength(Math.abs(away))} ${away > 0 ? "behind" : "in front of"} this slice` : "";
  return (
    `${p.name || `point ${p.id}`}: ${wayInWords(way)}${p.active ? "" : "; switched off"}` +
    `${p.locked ? "; locked" : ""}${far}`
  );
}
