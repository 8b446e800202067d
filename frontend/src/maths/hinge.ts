// A hinge, as deformnb.document.hinge: the outlines of the part that turns about a pivot and of the part that stays.

import type { Vector2 } from "../types.ts";

const JOINT = 0.25,
  OPENING = 1.2; // of the half width, as in Python

/** The outline of the part that turns, from a pivot towards an end, and of the part that stays. */
export function hingeOutlines(pivot: Vector2, end: Vector2, halfWidth: number): [Vector2[], Vector2[]] {
  const length = Math.hypot(end[0] - pivot[0], end[1] - pivot[1]),
    [u, v] = [(end[0] - pivot[0]) / length, (end[1] - pivot[1]) / length];
  const near = JOINT * halfWidth,
    edge = near + OPENING * halfWidth,
    far = Math.max(length, edge + 0.5 * halfWidth);
  const corners = [
    [near, 0],
    [edge, halfWidth],
    [far, halfWidth],
    [far, -halfWidth],
    [edge, -halfWidth],
  ] as Vector2[];
  const outline = (way: number) =>
    corners.map(
      ([along, across]): Vector2 => [pivot[0] + way * along * u - across * v, pivot[1] + way * along * v + across * u],
    );
  return [outline(1), outline(-1)];
}
