// The points of a picture in a view of the volume: each is shown at a depth, on the tissue that it lies over.

import { dot } from "../maths/camera.ts";
import { fromPane, toPane } from "../maths/space.ts";
import type { PicturePoint, Plane, SpacePoint, Vector2, Vector3 } from "../types.ts";
import type { Body } from "./body.ts";

/** The depth of a point behind the plane of its picture. */
interface Depth {
  value: number;
  /** Whether the user has put it there: it stays. */
  isChosen: boolean;
  /** The place of the picture that it was found for */
  at: Vector2 | null;
  /** Whether no tissue is seen there */
  misses: boolean;
}

export class LiftedPoints {
  #depths = new Map<number, Depth>();
  #lifted = new WeakMap<PicturePoint, SpacePoint>();

  /** @param middle the depth of a point under which nothing is seen */
  constructor(
    readonly plane: Plane,
    readonly middle: number,
  ) {}

  depthOf(id: number) {
    return this.#depths.get(id)?.value ?? this.middle;
  }

  /** Whether a point lies beside the body, as corners do. */
  misses(id: number) {
    return this.#depths.get(id)?.misses ?? false;
  }

  /** Set the depth of a point that the user has put at a place, or moved. */
  choose(id: number, value: number) {
    this.#depths.set(id, { value, isChosen: true, at: null, misses: false });
    this.#lifted = new WeakMap();
  }

  /** The points in space; those that have not changed are the same objects as before. */
  lift(points: PicturePoint[]): SpacePoint[] {
    return points.map((p) => {
      const known = this.#lifted.get(p);
      if (known) return known;
      const c = this.depthOf(p.id),
        made = { ...p, source: this.#place(p.source, c), target: this.#place(p.target, c) };
      this.#lifted.set(p, made);
      return made;
    });
  }

  #place([a, b]: Vector2, c: number): Vector3 {
    return fromPane(this.plane, [a, b, c]);
  }

  /** The place of the picture that a place in space is projected on, along the extrusion. */
  lower(place: Vector3): Vector2 {
    const [a, b] = toPane(this.plane, place);
    return [a, b];
  }

  /** A displacement in space as one in the picture. */
  lowerVector(way: Vector3): Vector2 {
    return [dot(way, this.plane.u), dot(way, this.plane.v)];
  }

  depth(place: Vector3) {
    return toPane(this.plane, place)[2];
  }

  /** The place over a point on the plane itself. */
  foot(place: Vector3): Vector3 {
    const [a, b] = toPane(this.plane, place);
    return fromPane(this.plane, [a, b, 0]);
  }

  /**
   * Bring points whose depths nobody has chosen to the first surface that the picture's viewer sees there.
   * Returns whether one has moved.
   */
  settle(points: PicturePoint[], body: Body) {
    let hasMoved = false;
    for (const { id, target } of points) {
      const known = this.#depths.get(id);
      if (known && (known.isChosen || (known.at?.[0] === target[0] && known.at[1] === target[1]))) continue;
      const found = body.surface({ start: this.#place(target, 0), ray: this.plane.n }),
        value = found ? this.depth(found) : this.middle;
      hasMoved ||= value !== this.depthOf(id);
      this.#depths.set(id, { value, isChosen: false, at: [target[0], target[1]], misses: !found });
    }
    if (hasMoved) this.#lifted = new WeakMap();
    return hasMoved;
  }
}
