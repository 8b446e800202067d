// The deformed body as a ray caster sees it, for a few rays: the counterpart of imaging/picking.py.

import { FAINT_VALUE } from "../generated.ts";
import { AXES, perAxis } from "../maths/axes.ts";
import { added, dot, scaled } from "../maths/camera.ts";
import { type Clip, clipSides, leftOf } from "../maths/clipping.ts";
import { normalized, type Ray } from "../maths/space_camera.ts";
import type { Sides, Vector2, Vector3 } from "../types.ts";
import { opacityOfByte } from "../webgl/volume_blocks.ts";
import { originByPlane, originInSpace } from "./field_samples.ts";
import type { Field, VolumeInfo } from "./types.ts";

const HALF_SEEN = 0.5; // a surface is where half of the light is stopped
const MOST_OPAQUE = 0.9999; // of one thickness, as in the shader

/** The input of a body, as a view shows it. */
export interface ShownBody {
  values: Uint8Array;
  info: VolumeInfo;
  field?: Field | null;
  table: Float32Array;
  /** The thickness that the table's opacities hold for */
  unit: number;
  clip?: Clip | null;
  /** "mip" shows largest values, any other projection opacities. */
  projection?: string;
}

/** Lengths along the index axes, from the first voxel. */
export class Body {
  #shown: ShownBody;
  box: Sides;
  step: number;
  #grey: Vector2;

  constructor(shown: ShownBody) {
    const { info, field, clip } = shown,
      box = field?.box ?? info.box;
    this.#shown = { ...shown, field: field && { ...field } }; // a drag replaces its parts
    this.box = clip ? leftOf(box, clipSides(box, clip)) : box; // tissue cut away is no body
    this.step = Math.min(...info.spacing);
    this.#grey = info.grey ?? [0, 1];
  }

  /** A place of space in the volume's own frame. */
  toFrame(place: Vector3) {
    return this.turned(perAxis((k) => place[k] - this.#shown.info.origin[k]));
  }

  /** A vector of space in the volume's own frame. */
  turned(vector: Vector3) {
    return perAxis((k) => dot(this.#shown.info.to_frame[k], vector));
  }

  /** The origin of the value at x; null in the gap of a cut. */
  #origin(x: Vector3): Vector3 | null {
    const { field } = this.#shown,
      moved = field?.planar ? originByPlane(field.planar, x) : x;
    return moved && field?.space ? originInSpace(field.space, moved) : moved;
  }

  /** The byte at x, between voxels; null beyond the volume and in gaps. */
  #byteAt(x: Vector3) {
    const { info, values } = this.#shown,
      { shape, spacing } = info,
      from = this.#origin(x);
    if (!from) return null;
    const at = perAxis((k) => from[k] / spacing[k]);
    if (AXES.some((k) => at[k] < -0.5 || at[k] >= shape[k] - 0.5)) return null;
    const value = (i: number, j: number, k: number) => values[(k * shape[1] + j) * shape[0] + i]!;
    if (info.is_labels) return value(...perAxis((k) => Math.max(0, Math.min(shape[k] - 1, Math.round(at[k])))));
    const inside = perAxis((k) => Math.max(0, Math.min(shape[k] - 1, at[k]))),
      low = perAxis((k) => Math.floor(inside[k])),
      high = perAxis((k) => Math.min(shape[k] - 1, low[k] + 1)),
      [f, g, h] = perAxis((k) => inside[k] - low[k]);
    const row = (j: number, k: number) => value(low[0], j, k) * (1 - f) + value(high[0], j, k) * f;
    const slice = (k: number) => row(low[1], k) * (1 - g) + row(high[1], k) * g;
    return slice(low[2]) * (1 - h) + slice(high[2]) * h;
  }

  #opacity(byte: number | null) {
    return byte === null ? 0 : Math.min(MOST_OPAQUE, opacityOfByte(this.#shown.table, byte));
  }

  /** The parts of a ray in the box. */
  #reach(start: Vector3, ray: Vector3, from: number): Vector2 {
    const { low, high } = this.box;
    let first = from,
      last = Infinity;
    for (const k of AXES) {
      const slope = Math.abs(ray[k]) < 1e-9 ? 1e-9 : ray[k];
      const a = (low[k] - start[k]) / slope,
        b = (high[k] - start[k]) / slope;
      first = Math.max(first, Math.min(a, b));
      last = Math.min(last, Math.max(a, b));
    }
    return [first, last];
  }

  /**
   * The place where half of the light along a ray is stopped, as a length along it; null if it never is.
   * @param weakest also returns the place that stops most where it is less than half
   */
  meet(start: Vector3, ray: Vector3, from = 0, weakest = false) {
    const { step } = this,
      [first, last] = this.#reach(start, ray, from);
    let passed = 1,
      most = 0,
      place: number | null = null;
    for (let t = first; t < last; t += step) {
      const opacity = this.#opacity(this.#byteAt(added(start, scaled(ray, t + step / 2))));
      if (!opacity) continue;
      const rest = passed * (1 - opacity) ** (step / this.#shown.unit);
      if (rest <= 1 - HALF_SEEN) return t + (step * Math.log((1 - HALF_SEEN) / passed)) / Math.log(rest / passed);
      if (passed - rest > most) [most, place] = [passed - rest, t + step / 2];
      passed = rest;
    }
    return weakest ? place : null;
  }

  /**
   * The place of the largest value along a ray, the first of those within a grey level; null where nothing is seen.
   */
  #brightest(start: Vector3, ray: Vector3) {
    const { step } = this,
      [first, last] = this.#reach(start, ray, -Infinity),
      [low, high] = this.#grey.map((share) => 255 * share) as Vector2,
      bytes: number[] = [];
    for (let t = first + step / 2; t < last; t += step) bytes.push(this.#byteAt(added(start, scaled(ray, t))) ?? 0);
    const most = bytes.reduce((a, b) => Math.max(a, b), 0);
    if (most <= low + FAINT_VALUE * (high - low)) return null;
    return first + (bytes.findIndex((byte) => byte >= most - (high - low) / 255) + 0.5) * step;
  }

  /**
   * True if tissue is between a place in space and the viewer; tissue nearer than two voxels does not count.
   */
  hides(place: Vector3, toViewer: Vector3) {
    return this.meet(this.toFrame(place), normalized(this.turned(toViewer)), 2 * this.step) !== null;
  }

  /** The first visible surface along a ray in space, or null where nothing is seen. */
  surface({ start, ray }: Ray) {
    const from = this.toFrame(start),
      along = normalized(this.turned(ray));
    const t = this.#shown.projection === "mip" ? this.#brightest(from, along) : this.meet(from, along, -Infinity, true);
    return t === null ? null : added(start, scaled(ray, t));
  }
}
