// The grid of a volume's voxels and the planes of pictures of it, as deformnb/volume/volume.py and plane.py have them.
// Arrays are [z, y, x]; places are (x, y, z) in space (LPS).

import { LARGEST_COORDINATE, ORTHONORMAL_TOLERANCE, SPACING_LIMITS } from "../generated.ts";
import type { Axis } from "../maths/axes.ts";
import { AXES, perAxis } from "../maths/axes.ts";
import { added, cross, difference, dot, mapVector, scaled, unitVector } from "../maths/camera.ts";
import { toPane } from "../maths/space.ts";
import type { Matrix3, Plane, Raster, Sides, Vector3, Vector4 } from "../types.ts";

export interface Grid {
  /** [nz, ny, nx] */
  shape: Vector3;
  /** Along x, y, z */
  spacing: Vector3;
  /** The centre of the first voxel */
  origin: Vector3;
  /** Rows; the columns are the directions of the x, y and z index */
  direction: Matrix3;
  /** Of spacing and origin; "" where it is not known */
  unit: string;
}

export const IDENTITY: Matrix3 = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
];

/** A grid that cannot be. */
export class GridError extends Error {}

type AxisName = (typeof AXIS_NAMES)[number];

/** Up of the picture for each viewing axis: the head, or in a picture along z the front of the patient. */
const UP: Record<AxisName, Vector3> = { x: [0, 0, 1], y: [0, 0, 1], z: [0, -1, 0] };
const AXIS_NAMES = ["x", "y", "z"] as const;

const column = (rows: Matrix3, k: Axis) => perAxis((i) => rows[i][k]);

const times = (rows: Matrix3, vector: Vector3) => perAxis((i) => dot(rows[i], vector));

const plain = (value: number) => value + 0; // -0 is 0 in a file

/** A grid whose numbers are checked. */
export function checkGrid(shape: Vector3, spacing: Vector3, origin: Vector3, direction: Matrix3): Grid {
  const all = [...spacing, ...origin, ...direction.flat()];
  if (!all.every(Number.isFinite)) throw new GridError("spacing, origin or direction are not finite.");
  if (Math.min(...spacing) <= 0) throw new GridError(`spacing must be positive, got ${spacing.join(", ")}.`);
  if (Math.min(...spacing) < SPACING_LIMITS[0] || Math.max(...spacing) > SPACING_LIMITS[1]) {
    throw new GridError(
      `spacing must be from ${SPACING_LIMITS[0]} to ${SPACING_LIMITS[1]}, got ${spacing.join(", ")}.`,
    );
  }
  if (Math.max(...origin.map(Math.abs)) > LARGEST_COORDINATE) {
    throw new GridError(`the origin is ${origin.join(", ")}; coordinates must be below ${LARGEST_COORDINATE}.`);
  }
  for (const i of AXES) {
    for (const j of AXES) {
      const wanted = i === j ? 1 : 0,
        off = Math.abs(dot(column(direction, i), column(direction, j)) - wanted);
      if (off > ORTHONORMAL_TOLERANCE + 1e-5 * wanted) {
        throw new GridError(
          "its axes are sheared or scaled (direction is not orthonormal); resample the volume onto " +
            "a straight grid first.",
        );
      }
    }
  }
  return { shape, spacing, origin, direction, unit: "" };
}

/** Three rows of four numbers. */
export type Affine = [Vector4, Vector4, Vector4];

/** The grid of an affine map of the indices (i, j, k). */
export function gridOfAffine(shape: Vector3, affine: Affine) {
  const columns = perAxis((k) => perAxis((i) => affine[i][k]));
  const largest = perAxis((k) => Math.max(...columns[k].map(Math.abs)));
  if (!affine.flat().every(Number.isFinite)) throw new GridError("the place of its voxels is not finite.");
  if (largest.some((length) => length === 0)) throw new GridError("the axes of its voxels do not span space.");
  const lengths = perAxis((k) => Math.sqrt(columns[k].reduce((sum, x) => sum + (x / largest[k]) ** 2, 0)));
  const rows = perAxis((i) => perAxis((k) => columns[k][i] / largest[k] / lengths[k]));
  const spacing = perAxis((k) => lengths[k] * largest[k]);
  return checkGrid(
    shape,
    spacing,
    perAxis((i) => affine[i][3]),
    rows,
  );
}

/** The grid of spacings of which some may be negative: the axis is flipped then, and a note added. */
export function straightenGrid(shape: Vector3, spacing: Vector3, origin: Vector3, direction: Matrix3, notes: string[]) {
  const signs = perAxis((k) => (spacing[k] < 0 ? -1 : 1)),
    names = AXES.filter((k) => signs[k] < 0).map((k) => AXIS_NAMES[k]);
  if (names.length) {
    notes.push(`the spacing along ${names.join(" and ")} is negative in the file: the axis is flipped instead`);
  }
  const turned = perAxis((i) => perAxis((k) => direction[i][k] * signs[k]));
  return checkGrid(
    shape,
    perAxis((k) => spacing[k] * signs[k]),
    origin,
    turned,
  );
}

/** The place of an index (i, j, k). */
export function placeOf({ spacing, origin, direction }: Grid, index: Vector3) {
  return added(
    origin,
    times(
      direction,
      perAxis((k) => index[k] * spacing[k]),
    ),
  );
}

/** The eight corners of the box; `centres` uses those of the outermost voxels' centres. */
export function cornersOf(grid: Grid, centres = false) {
  const [nz, ny, nx] = grid.shape,
    edge = centres ? 0 : 0.5;
  return [0, 1].flatMap((k) =>
    [0, 1].flatMap((j) =>
      [0, 1].map((i) =>
        placeOf(grid, [i ? nx - 1 + edge : -edge, j ? ny - 1 + edge : -edge, k ? nz - 1 + edge : -edge]),
      ),
    ),
  );
}

/** The edge lengths of the box along its axes. */
export function lengthsOf({ shape, spacing }: Grid): Vector3 {
  const [nz, ny, nx] = shape;
  return [spacing[0] * nx, spacing[1] * ny, spacing[2] * nz];
}

/** The rows of the inverse of the direction: from vectors in space to lengths along the index axes. */
export function frameOf({ direction }: Grid): Matrix3 {
  const [a, b, c] = perAxis((k) => column(direction, k)),
    det = dot(a, cross(b, c));
  return [scaled(cross(b, c), 1 / det), scaled(cross(c, a), 1 / det), scaled(cross(a, b), 1 / det)];
}

/** A place in space as lengths along the index axes from the first voxel's centre. */
export function toFrame(grid: Grid, place: Vector3) {
  return times(frameOf(grid), difference(place, grid.origin));
}

/** The grid of blocks of so many voxels along x, y, z. */
export function coarserGrid(grid: Grid, factors: Vector3): Grid {
  const [nz, ny, nx] = grid.shape,
    [fx, fy, fz] = factors;
  const shape: Vector3 = [Math.ceil(nz / fz), Math.ceil(ny / fy), Math.ceil(nx / fx)];
  const spacing = perAxis((k) => grid.spacing[k] * factors[k]);
  return {
    ...grid,
    shape,
    spacing,
    origin: placeOf(
      grid,
      perAxis((k) => (factors[k] - 1) / 2),
    ),
  };
}

/** The axis along which a vector is longest, the first of several. */
function longestOf(vector: Vector3) {
  return AXES.reduce((longest, k) => (Math.abs(vector[k]) > Math.abs(vector[longest]) ? k : longest));
}

/** Index and sign of the column of a direction nearest to a vector, not counting the one parallel to `without`. */
function nearestColumn(direction: Matrix3, toward: Vector3, without: Vector3 | null = null) {
  const columns = perAxis((k) => column(direction, k));
  const score = perAxis((k) => (without && Math.abs(dot(columns[k], without)) > 0.5 ? 0 : dot(columns[k], toward)));
  const k = longestOf(score);
  return scaled(columns[k], score[k] >= 0 ? 1 : -1);
}

/** The plane of a picture seen along one of the grid's own axes, such as "+y", in the middle of its depth. */
export function planeAlong(grid: Grid, view: string): Plane {
  const axis = view[1] as AxisName,
    sign = view[0] === "+" ? 1 : -1;
  const unit = (vector: Vector3) => unitVector(vector)!;
  const n = unit(
    nearestColumn(
      grid.direction,
      perAxis((k) => (AXIS_NAMES[k] === axis ? sign : 0)),
    ),
  );
  const down = scaled(nearestColumn(grid.direction, UP[axis], n), -1),
    along = dot(down, n);
  const v = unit(perAxis((k) => down[k] - along * n[k])),
    u = cross(v, n);
  const corners = cornersOf(grid, true),
    least = (w: Vector3) => Math.min(...corners.map((p) => dot(p, w))),
    [a, b, c] = [least(u), least(v), least(n)];
  const depth = c + (Math.max(...corners.map((p) => dot(p, n))) - c) / 2;
  const origin = perAxis((k) => plain(a * u[k] + b * v[k] + depth * n[k]));
  return { origin, u: mapVector(u, plain), v: mapVector(v, plain), n: mapVector(n, plain) };
}

/** Coordinates [a, b, c] in a plane of places in space. */
export function toPlane(plane: Plane, places: Vector3[]) {
  return places.map((place) => toPane(plane, place));
}

/** Least and largest of each coordinate. */
export function boundsOf(places: Vector3[]): Sides {
  const range = (least: (...values: number[]) => number) => perAxis((k) => least(...places.map((place) => place[k])));
  return { low: range(Math.min), high: range(Math.max) };
}

/** Index axis (0 is x) and sign of depth, v and u of a plane along the grid's axes. */
export function voxelOrder(grid: Grid, { u, v, n }: Plane) {
  const along = (w: Vector3) => {
    const cosines = perAxis((k) => dot(w, column(grid.direction, k))),
      axis = longestOf(cosines);
    return { axis, sign: cosines[axis] > 0 ? 1 : -1 };
  };
  return [along(n), along(v), along(u)] as const;
}

/** The number of voxels along an index axis. */
export function countAlong({ shape }: Grid, axis: Axis) {
  return shape[(2 - axis) as Axis];
}

/** The raster of a picture along the grid's axes: a pixel is a column of voxels. */
export function voxelRaster(grid: Grid, plane: Plane): Raster {
  const [, v, u] = voxelOrder(grid, plane),
    { low } = boundsOf(toPlane(plane, cornersOf(grid, true)));
  return {
    shape: [countAlong(grid, v.axis), countAlong(grid, u.axis)],
    spacing: [grid.spacing[u.axis], grid.spacing[v.axis]],
    origin: [low[0], low[1]],
  };
}

const TOWARDS = [
  ["left side (L)", "right side (R)"],
  ["back (P)", "front (A)"],
  ["top (S)", "bottom (I)"],
] as const;

/** The sides of the box that are those of a picture, in words: where a is lowest and highest, then b. */
export function pictureSides({ u, v }: Plane) {
  return [u, v].flatMap((along) => {
    const world = longestOf(along),
      [positive, negative] = TOWARDS[world];
    return along[world] < 0 ? [positive, negative] : [negative, positive];
  });
}

/** The displayed unit of lengths: voxels where it is not known and the spacing is 1. */
export function unitOf({ spacing, unit }: Grid) {
  return unit || (spacing.every((s) => s === 1) ? "voxels" : "");
}
