// The projection of space on one picture of a view: from places to pixels and back. No DOM.

import type { Vector2, Vector3 } from "../types.ts";
import { perAxis } from "./axes.ts";
import { added, type Camera, dot, scaled, unitVector } from "./camera.ts";

/** In CSS pixels */
export type ScreenBox = { left: number; top: number; width: number; height: number };

/** A half line in space; its direction has length 1. */
export type Ray = { start: Vector3; ray: Vector3 };

/** A vector that is not zero, with length 1. */
export function normalized(vector: Vector3): Vector3 {
  return unitVector(vector) ?? vector;
}

export class SpaceCamera {
  right: Vector3;
  up: Vector3;
  ahead: Vector3;
  half: Vector2;
  bend: number;
  eye: Vector3;

  /**
   * @param bend of a perspective
   * @param middle of the visible box
   * @param box of the picture
   */
  constructor(
    camera: Camera,
    bend: number,
    middle: Vector3,
    public box: ScreenBox,
  ) {
    const { right, up, direction, pan, height } = camera,
      aspect = box.width / box.height;
    this.right = right;
    this.up = up;
    this.ahead = direction;
    this.half = [(height / 2) * aspect, height / 2];
    this.bend = bend / height;
    this.eye = added(middle, added(scaled(right, pan[0]), scaled(up, pan[1])));
  }

  /** The pixel of a place, its distance, and the length in space of one pixel there. */
  see(place: Vector3): { at: Vector2; depth: number; scale: number } {
    const { box, bend, half } = this,
      from = perAxis((k) => place[k] - this.eye[k]),
      depth = dot(from, this.ahead);
    const near = bend > 0 ? Math.max(1e-6, 1 + depth * bend) : 1; // how much smaller things appear there
    const a = dot(from, this.right) / near / half[0],
      b = dot(from, this.up) / near / half[1];
    return {
      at: [box.left + ((a + 1) / 2) * box.width, box.top + ((1 - b) / 2) * box.height],
      depth,
      scale: (2 * half[1] * near) / box.height,
    };
  }

  /** The displacement in space, parallel to the screen, of one on it at a place. */
  way(place: Vector3, [dx, dy]: Vector2): Vector3 {
    const { scale } = this.see(place);
    return added(scaled(this.right, dx * scale), scaled(this.up, -dy * scale));
  }

  /** The same along a direction in space, of length 1: as far as brings its picture nearest to the pointer. */
  wayAlong(unit: Vector3, place: Vector3, [dx, dy]: Vector2): Vector3 {
    const { at, scale } = this.see(place),
      there = this.see(added(place, scaled(unit, scale))).at,
      [u, v] = [there[0] - at[0], there[1] - at[1]];
    const steep = u * u + v * v;
    if (steep < 0.01) return [0, 0, 0]; // seen from its end it does not move
    return scaled(unit, (scale * (dx * u + dy * v)) / steep);
  }

  /** The ray of a pixel. */
  ray([x, y]: Vector2): Ray {
    const { box, half, bend } = this;
    const a = ((x - box.left) / box.width) * 2 - 1,
      b = 1 - ((y - box.top) / box.height) * 2;
    const aside = added(scaled(this.right, a * half[0]), scaled(this.up, b * half[1]));
    if (!(bend > 0)) return { start: added(this.eye, aside), ray: this.ahead };
    const ray = normalized(added(aside, scaled(this.ahead, 1 / bend)));
    return { start: added(this.eye, scaled(this.ahead, -1 / bend)), ray };
  }

  /** The direction from a place to the viewer. */
  toViewer(place: Vector3) {
    if (!(this.bend > 0)) return scaled(this.ahead, -1);
    const eye = added(this.eye, scaled(this.ahead, -1 / this.bend));
    return normalized(perAxis((k) => eye[k] - place[k]));
  }
}
