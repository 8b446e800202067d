// The camera: parallel projection along a direction, with an up vector and the height of the view.
// Vectors are in space (LPS); the ray caster gets them in the volume's own frame.

import { SMALLEST_SHARE, VIEW_AIR } from "../generated.ts";
import type { Matrix3, Vector, Vector2, Vector3 } from "../types.ts";

export const dot = (a: Vector3, b: Vector3) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector3, b: Vector3): Vector3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const scaled = ([x, y, z]: Vector3, k: number): Vector3 => [x * k, y * k, z * k];
export const added = (a: Vector3, b: Vector3): Vector3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** The vector of the values of a function of each coordinate. */
export const mapVector = <V extends Vector>(vector: V, value: (x: number, k: number) => number) =>
  vector.map(value) as Vector as V;
/** a - b */
export const difference = <V extends Vector>(a: V, b: V) => mapVector(a, (x, k) => x - b[k]!);
export const unitVector = (a: Vector3): Vector3 | null => {
  const n = Math.hypot(...a);
  return n > 1e-9 ? scaled(a, 1 / n) : null;
};
const rotated: (a: Vector3, side: Vector3, angle: number) => Vector3 = (a, side, angle) =>
  added(scaled(a, Math.cos(angle)), scaled(side, Math.sin(angle)));

const LEAST_SEEN = 0.1; // share of the box, or of the view, that stays in view

export class Camera {
  direction: Vector3 = [0.4, 1, -0.3];
  up: Vector3 = [0, 0, 1];
  height = 1; // a length in space
  pan: Vector2 = [0, 0];
  bend = 0; // of a perspective, 0 for a parallel projection

  constructor() {
    this.#straighten();
  }

  get right() {
    return cross(this.direction, this.up);
  }

  #straighten() {
    this.direction = unitVector(this.direction) || [0, 1, 0];
    const other: Vector3 = Math.abs(this.direction[2]) > 0.99 ? [0, -1, 0] : [0, 0, 1];
    const across = unitVector(cross(this.direction, this.up)) ?? unitVector(cross(this.direction, other)) ?? [1, 0, 0];
    this.up = unitVector(cross(across, this.direction)) ?? this.up;
  }

  /**
   * Set the direction of view; without an up vector, up is towards the head, or the front in views from above or below.
   */
  look(direction: Vector3, up?: Vector3 | null) {
    const [x, y, z] = direction,
      [u, v, w] = up ?? (Math.abs(z) > 0.999 * Math.hypot(x, y, z) ? [0, -1, 0] : [0, 0, 1]);
    this.direction = [x, y, z];
    this.up = [u, v, w];
    this.#straighten();
  }

  /** Turn the scene as if the pointer held its front: dx to the right, dy downwards, in radians. */
  turn(dx: number, dy: number) {
    const right = this.right;
    const direction = rotated(this.direction, scaled(right, -1), -dx);
    const up = this.up;
    this.direction = rotated(direction, up, -dy);
    this.up = rotated(up, scaled(direction, -1), -dy);
    this.#straighten();
  }

  /** Turn the picture itself, anticlockwise. */
  roll(angle: number) {
    this.up = rotated(this.up, this.right, angle);
    this.#straighten();
  }

  /** The height of the view, a length in space, at which all corners (vectors from the middle) are visible. */
  fit(corners: Vector3[], aspect: number) {
    const right = this.right;
    let a = 0,
      b = 0,
      far = 0;
    for (const corner of corners) {
      a = Math.max(a, Math.abs(dot(corner, right)));
      b = Math.max(b, Math.abs(dot(corner, this.up)));
      far = Math.max(far, Math.hypot(...corner));
    }
    return 2 * VIEW_AIR * Math.max(b, a / aspect, SMALLEST_SHARE * far * Math.min(1, 1 / aspect));
  }

  /**
   * Move the view so that at least a tenth of the span of all corners (vectors from the middle) stays in it, or fills a
   * tenth of it.
   */
  keepInView(corners: Vector3[], aspect: number) {
    const height = this.height / 2,
      clampPan = (way: number, axis: Vector3, side: number) => {
        const half = Math.max(...corners.map((corner) => Math.abs(dot(corner, axis))));
        const most = half + side - 2 * LEAST_SEEN * Math.min(half, side);
        return Math.max(-most, Math.min(most, way));
      };
    const [across, up] = this.pan;
    this.pan = [clampPan(across, this.right, height * aspect), clampPan(up, this.up, height)];
  }

  /**
   * The camera in the volume's frame, for the ray caster.
   * @param toFrame 3 x 3, from space to the volume's frame
   * @param middle in the volume's frame
   */
  frameCamera([first, second, third]: Matrix3, middle: Vector3, aspect: number) {
    const turned = (v: Vector3): Vector3 => [dot(first, v), dot(second, v), dot(third, v)];
    const right = turned(this.right),
      up = turned(this.up),
      ahead = turned(this.direction),
      half = this.height / 2;
    const eye = added(middle, added(scaled(right, this.pan[0]), scaled(up, this.pan[1])));
    return { eye, right: scaled(right, half * aspect), up: scaled(up, half), ahead, bend: this.bend / this.height };
  }
}

/**
 * The side of a patient of a direction in space, one or two letters: "L", "PS"; where the sides are not known its axes:
 * "+x", "+y+z".
 */
export function sideOf([x, y, z]: Vector3, isAnatomical = true) {
  const [left, back, top] = isAnatomical ? ["RL", "AP", "IS"] : ["x", "y", "z"],
    name = (letters: string, value: number) =>
      isAnatomical ? letters[value < 0 ? 0 : 1]! : `${value < 0 ? "\u2212" : "+"}${letters}`;
  const sides = [
    { way: Math.abs(x), name: name(left!, x) },
    { way: Math.abs(y), name: name(back!, y) },
    { way: Math.abs(z), name: name(top!, z) },
  ].sort((p, q) => q.way - p.way);
  return sides
    .filter(({ way }, k) => k === 0 || (k === 1 && way > 0.45))
    .map(({ name }) => name)
    .join("");
}
