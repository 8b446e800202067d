// The origin of a place of the result, from the displacement that a view shows, for a few places: maps over a plane,
// samples in space, and the choice at cuts, as the ray caster's shader makes it. Lengths are along the index axes.

import { AXES, perAxis } from "../maths/axes.ts";
import { added, dot, scaled } from "../maths/camera.ts";
import type { Vector2, Vector3 } from "../types.ts";
import type { PlanarField, PlaneCut, SpaceField } from "../webgl/types.ts";

const CLOSED_BY_PLACE = "paper"; // the rule by which a place takes its value from its own region only

/** The place between samples along an axis: the sample before, and the share of the next one. */
function between(value: number, count: number): [number, number] {
  const at = Math.max(0, Math.min(count - 1, value)),
    first = Math.max(0, Math.min(count - 2, Math.floor(at)));
  return [first, at - first];
}

/** A number of half precision from its bits. */
function numberOfHalf(bits: number) {
  const exponent = (bits >> 10) & 31,
    share = bits & 1023,
    sign = bits & 0x8000 ? -1 : 1;
  if (exponent === 31) return sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + share / 1024) : 2 ** -24 * share);
}

/** The values of a region at x, between samples. */
function sampleAt(
  { shape: n, origin, spacing }: SpaceField,
  list: Float32Array | Uint16Array,
  width: number,
  region: number,
  x: Vector3,
) {
  const corners = perAxis((k) => between((x[k] - origin[k]) / spacing[k], n[k])),
    read = list instanceof Uint16Array ? numberOfHalf : (value: number) => value,
    sum = new Array<number>(width).fill(0);
  for (let corner = 0; corner < 8; corner++) {
    const weight = AXES.reduce<number>((w, k) => w * ((corner >> k) & 1 ? corners[k][1] : 1 - corners[k][1]), 1);
    if (!weight) continue;
    const at = perAxis((k) => Math.min(n[k] - 1, corners[k][0] + ((corner >> k) & 1)));
    const j = width * (((region * n[2] + at[2]) * n[1] + at[1]) * n[0] + at[0]);
    for (let m = 0; m < width; m++) sum[m]! += weight * read(list[j + m]!);
  }
  return sum;
}

/** The place in the volume that a field in space leads to; null in a gap of its cuts. */
export function originInSpace(field: SpaceField, x: Vector3): Vector3 | null {
  const { cut, depths, values } = field;
  if (!cut || !depths) return added(x, sampleAt(field, values, 3, 0, x) as Vector3);
  const inside = Array.from({ length: cut.regions }, (_, r) => sampleAt(field, depths, 2, r, x)[0]!),
    own = inside.indexOf(Math.max(...inside)),
    others = cut.rule === CLOSED_BY_PLACE ? [] : [...inside.keys()].filter((r) => r !== own);
  let best: { depth: number; way: Vector3 } | null = null;
  for (const region of [own, ...others]) {
    const [dx, dy, dz, depth] = sampleAt(field, values, 4, region, x) as [number, number, number, number];
    if (depth < 0 || (best && depth <= best.depth)) continue;
    best = { depth, way: [dx, dy, dz] };
    if (region === own) break;
  }
  return best && added(x, best.way);
}

/** The displacement along u and v of the maps of a region, weighted along the normal. */
function planarAt(field: PlanarField, region: number, [a, b, c]: Vector3): Vector2 {
  const {
      shape: [layers, rows, columns],
      origin,
      spacing,
      depth,
      maps,
      weights,
      cut,
    } = field,
    count = layers / (cut ? cut.sides.length : 1),
    knots = weights.length / count;
  const [i, s] = between((a - origin[0]) / spacing[0], columns),
    [j, t] = between((b - origin[1]) / spacing[1], rows),
    share = depth[1] > depth[0] ? Math.max(0, Math.min(1, (c - depth[0]) / (depth[1] - depth[0]))) : 0,
    [k, w] = between(share * (knots - 1), knots),
    sum: Vector2 = [0, 0];
  for (let m = 0; m < count; m++) {
    const weight = weights[m * knots + k]! * (1 - w) + (knots > 1 ? weights[m * knots + k + 1]! * w : 0);
    if (!weight) continue;
    const row = ((region * count + m) * rows + j) * columns + i,
      down = rows > 1 ? columns : 0,
      east = columns > 1 ? 1 : 0;
    for (const n of [0, 1] as const) {
      const value = (at: number) => maps[2 * at + n]!;
      sum[n] +=
        weight *
        ((1 - t) * ((1 - s) * value(row) + s * value(row + east)) +
          t * ((1 - s) * value(row + down) + s * value(row + down + east)));
    }
  }
  return sum;
}

/** The signed distances to the cuts of a plane, negative inside. */
function distancesAt({ shape: [count, rows, columns], origin, spacing, distances }: PlaneCut, a: number, b: number) {
  const [i, s] = between((a - origin[0]) / spacing[0], columns),
    [j, t] = between((b - origin[1]) / spacing[1], rows);
  return Array.from({ length: count }, (_, c) => {
    const value = (down: number, east: number) => distances[(c * rows + j + down) * columns + i + east]!;
    return (1 - t) * ((1 - s) * value(0, 0) + s * value(0, 1)) + t * ((1 - s) * value(1, 0) + s * value(1, 1));
  });
}

/** The place in the volume that maps over a plane lead to; null in a gap of their cuts. */
export function originByPlane(field: PlanarField, x: Vector3): Vector3 | null {
  const { plane, cut } = field,
    from = perAxis((k) => x[k] - plane.origin[k]),
    at: Vector3 = [dot(from, plane.u), dot(from, plane.v), dot(from, plane.n)],
    moved = ([da, db]: Vector2) => added(x, added(scaled(plane.u, da), scaled(plane.v, db)));
  if (!cut) return moved(planarAt(field, 0, at));
  const isInside = distancesAt(cut, at[0], at[1]).map((d) => d < 0),
    own = Math.max(
      0,
      cut.sides.findIndex((sides) => sides.every((side, c) => side === isInside[c])),
    ),
    others = cut.rule === CLOSED_BY_PLACE ? [] : [...cut.sides.keys()].filter((r) => r !== own);
  let best: { depth: number; way: Vector2 } | null = null;
  for (const region of [own, ...others]) {
    const way = planarAt(field, region, at),
      distances = distancesAt(cut, at[0] + way[0], at[1] + way[1]),
      depth = Math.min(...distances.map((d, c) => (cut.sides[region]![c] ? -d : d)));
    if (depth < 0 || (best && depth <= best.depth)) continue;
    best = { depth, way };
    if (region === own) break;
  }
  return best && moved(best.way);
}
