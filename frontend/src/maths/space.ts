// Points in space and their places in the pictures of a volume. Pure functions of plain lists.

import type { FlatPoint, Matrix3, PaneInfo, Plane, Point, RbfFit, SpacePoint, Vector, Vector3 } from "../types.ts";
import type { Axis } from "./axes.ts";
import { perAxis } from "./axes.ts";
import { added, difference, dot, mapVector, scaled } from "./camera.ts";
import { formatLength } from "./numbers.ts";
import { nameOf } from "./point_names.ts";
import { updatePoints } from "./points.ts";

/** The coordinates [a, b, c] in a picture of a place in space. */
export function toPane({ origin, u, v, n }: Plane, place: Vector3): Vector3 {
  const from = difference(place, origin);
  return [dot(from, u), dot(from, v), dot(from, n)];
}

/** The place in space of coordinates in a picture. */
export function fromPane({ origin, u, v, n }: Plane, [a, b, c]: Vector3): Vector3 {
  return perAxis((k) => origin[k] + a * u[k] + b * v[k] + c * n[k]);
}

/** The displacement in space of a displacement in a picture: it is parallel to the picture's plane. */
export function vectorFromPane({ u, v }: Plane, da: number, db: number) {
  return added(scaled(u, da), scaled(v, db));
}

/** Move targets ("target"), sources ("source") or whole points ("both") by a displacement in space. */
export function translateInSpace(points: SpacePoint[], ids: number[], way: Vector3, what: string = "target") {
  const by = (place: Vector3) => added(place, way);
  return updatePoints(points, ids, (p) => ({
    source: what === "target" ? p.source : by(p.source),
    target: what === "source" ? p.target : by(p.target),
  }));
}

/** Targets rotated in a picture (clockwise there) and scaled in space, about their middle. */
export function rotateInSpace(points: SpacePoint[], ids: number[], pane: PaneInfo, angle: number, factor: number = 1) {
  const chosen = points.filter((p) => ids.includes(p.id)),
    c = factor * Math.cos(angle),
    s = factor * Math.sin(angle);
  const mean = (k: number) => chosen.reduce((sum, p) => sum + p.target[k]!, 0) / chosen.length,
    about = toPane(pane, perAxis(mean));
  return updatePoints(points, ids, (p) => {
    const [a, b, d] = difference(toPane(pane, p.target), about);
    return { target: fromPane(pane, [about[0] + c * a - s * b, about[1] + s * a + c * b, about[2] + factor * d]) };
  });
}

/** The lists of a fit in space, all of three. */
export interface SpaceFit extends RbfFit {
  linear: Matrix3;
  constant: Vector3;
  origin: Vector3;
  quadratic: [Matrix3, Matrix3, Matrix3] | null;
}

/** Fits of the stages of points in space, the first stage first; one fit where there are no stages. */
export type SpaceFits = RbfFit[];

/**
 * A fit in space, expressed in a second frame.
 * @param axes of the frame, which are orthonormal
 * @param origin of the frame
 */
export function fitInFrame(fit: RbfFit, axes: Matrix3, origin: Vector3): RbfFit {
  const { linear, constant, origin: middle, quadratic } = fit as SpaceFit;
  const turned = (v: Vector3) => perAxis((k) => dot(axes[k], v));
  const allTurned: (vectors: Float64Array) => Float64Array = (vectors) =>
    Float64Array.from(vectors, (_, i) =>
      dot(
        axes[(i % 3) as Axis],
        perAxis((k) => vectors[i - (i % 3) + k]!),
      ),
    );
  const seen: (m: Matrix3) => Matrix3 = (m) =>
    perAxis((i) =>
      perAxis((j) =>
        dot(
          axes[i],
          perAxis((k) => dot(m[k], axes[j])),
        ),
      ),
    );
  const forms = quadratic && perAxis((k) => seen(quadratic[k]));
  return {
    ...fit,
    centers: allTurned(fit.centers),
    coefficients: allTurned(fit.coefficients),
    linear: seen(linear),
    constant: turned(constant),
    origin: turned(difference(middle, origin)),
    quadratic:
      forms &&
      perAxis((m) =>
        perAxis((i) =>
          perAxis((j) =>
            dot(
              axes[m],
              perAxis((k) => forms[k][i][j]),
            ),
          ),
        ),
      ),
  };
}

/** Replace sources by those of points of the same ids, which Python has found meanwhile. */
export function updateSources<V extends Vector>(points: Point<V>[], known: Point<V>[]) {
  const sources = new Map(known.map((p) => [p.id, p.source]));
  return points.map((p) => {
    const source = sources.get(p.id);
    return source ? { ...p, source: mapVector(source, (x) => x) } : p;
  });
}

/**
 * A point as it is drawn in a picture.
 * @param depth of the slice; null in pictures of the whole volume
 */
export function flatPoint(p: SpacePoint, pane: PaneInfo, depth: number | null, number = 0): FlatPoint {
  const target = toPane(pane, p.target),
    source = toPane(pane, p.source);
  const away = depth === null ? 0 : target[2] - depth;
  const isFar = depth !== null && Math.abs(away) > 0.75 * pane.spacing[2];
  const name = isFar ? `${p.name || number} ${away > 0 ? "+" : "\u2212"}${formatLength(Math.abs(away))}` : p.name;
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
] as const; // of a patient, along growing and falling x, y, z

function shiftWords(way: Vector3) {
  const parts = perAxis((k) =>
    Math.abs(way[k]) < 0.05 ? "" : `${formatLength(Math.abs(way[k]))} ${SIDES[k][way[k] > 0 ? 0 : 1]}`,
  );
  const shown = parts.filter(Boolean);
  return shown.length ? `dragged by ${shown.join(", ")}` : "not dragged";
}

/** The label of a point in a picture for screen readers. */
export function spaceLabel({ whole: p, isFar, away }: FlatPoint, number: number) {
  const way = difference(p.target, p.source);
  const far = isFar ? `, ${formatLength(Math.abs(away))} off the slice` : "";
  return (
    `Point ${number}${p.name ? ` ${p.name}` : ""}, at ${p.target.map(formatLength).join(", ")}, ${shiftWords(way)}` +
    `${far}${p.active ? "" : ", switched off"}${p.locked ? ", locked" : ""}`
  );
}

/** The tip of a point in a picture. */
export function spaceTip({ whole: p, isFar, away }: FlatPoint, number: number) {
  const way = difference(p.target, p.source);
  const far = isFar ? `; ${formatLength(Math.abs(away))} ${away > 0 ? "behind" : "in front of"} this slice` : "";
  return (
    `${nameOf(p, number)}: ${shiftWords(way)}${p.active ? "" : "; switched off"}` +
    `${p.locked ? "; locked" : ""}${far}`
  );
}
