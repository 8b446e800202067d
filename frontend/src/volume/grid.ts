// The grid of a volume's voxels and the planes of pictures of it, as deformnb/volume/volume.py and plane.py have them.
// Arrays are [z, y, x]; places are (x, y, z) in space (LPS).

import { cross, dot, scaled, unitVector } from "../maths/camera.ts";

import type { Raster, Vector3 } from "../types.ts";

export interface Grid {
  /** [nz, ny, nx] */
  shape: Vector3;
  /** along x, y, z */
  spacing: Vector3;
  /** the centre of the first voxel */
  origin: Vector3;
  /** rows; the columns are the directions of the x, y and z index */
  direction: Vector3[];
  /** of spacing and origin; "" where it is not known */
  unit: string;
}

export type Plane = { origin: Vector3; u: Vector3; v: Vector3; n: Vector3 };

/** A grid that cannot be. */
export class GridError extends Error {}

const ORTHONORMAL_TOLERANCE = 2e-4;
const SPACINGS = [1e-12, 1e12];
const LARGEST_COORDINATE = 1e15;

/** Up of the picture for each viewing axis: the head, or in a picture along z the front of the patient. */
const UP = { x: [0, 0, 1], y: [0, 0, 1], z: [0, -1, 0] };
const AXES = ["x", "y", "z"] as const;

const column = (rows: Vector3[], k: number) => rows.map((row) => row[k]) as Vector3;

const times = (rows: Vector3[], vector: number[]) => rows.map((row) => dot(row, vector)) as Vector3;

const plain = (value: number) => value + 0; // -0 is 0 in a file

/** A grid whose numbers are checked. */
export function checkedGrid(shape: Vector3, spacing: Vector3, origin: Vector3, direction: Vector3[]): Grid {
  const all = [...spacing, ...origin, ...direction.flat()];
  if (!all.every(Number.isFinite)) throw new GridError("spacing, origin or direction are not finite.");
  if (Math.min(...spacing) <= 0) throw new GridError(`spacing must be positive, got ${spacing.join(", ")}.`);
  if (Math.min(...spacing) < SPACINGS[0] || Math.max(...spacing) > SPACINGS[1]) {
    throw new GridError(`spacing must be from ${SPACINGS[0]} to ${SPACINGS[1]}, got ${spacing.join(", ")}.`);
  }
  if (Math.max(...origin.map(Math.abs)) > LARGEST_COORDINATE) {
    throw new GridError(`the origin is ${origin.join(", ")}; coordinates must be below ${LARGEST_COORDINATE}.`);
  }
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
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

/** The grid of an affine map of the indices (i, j, k), three rows of four numbers. */
export function gridOfAffine(shape: Vector3, affine: number[][]) {
  const columns = [0, 1, 2].map((k) => affine.map((row) => row[k]));
  const largest = columns.map((c) => Math.max(...c.map(Math.abs)));
  if (!affine.flat().every(Number.isFinite)) throw new GridError("the place of its voxels is not finite.");
  if (largest.some((length) => length === 0)) throw new GridError("the axes of its voxels do not span space.");
  const lengths = columns.map((c, k) => Math.sqrt(c.reduce((sum, x) => sum + (x / largest[k]) ** 2, 0)));
  const rows = [0, 1, 2].map((i) => columns.map((c, k) => c[i] / largest[k] / lengths[k]) as Vector3);
  const spacing = lengths.map((length, k) => length * largest[k]) as Vector3;
  return checkedGrid(shape, spacing, affine.map((row) => row[3]) as Vector3, rows);
}

/** The grid of spacings of which some may be negative: the axis is flipped then, which a note says. */
export function straightenedGrid(
  shape: Vector3,
  spacing: Vector3,
  origin: Vector3,
  direction: Vector3[],
  notes: string[],
) {
  const signs = spacing.map((s) => (s < 0 ? -1 : 1)),
    names = AXES.filter((_, k) => signs[k] < 0);
  if (names.length) {
    notes.push(`the spacing along ${names.join(" and ")} is negative in the file: the axis is flipped instead`);
  }
  const turned = direction.map((row) => row.map((x, k) => x * signs[k]) as Vector3);
  return checkedGrid(shape, spacing.map((s, k) => s * signs[k]) as Vector3, origin, turned);
}

/** The place of an index (i, j, k). */
export function placeOf({ spacing, origin, direction }: Grid, index: number[]) {
  const moved = times(
    direction,
    index.map((n, k) => n * spacing[k]),
  );
  return origin.map((o, k) => o + moved[k]) as Vector3;
}

/** The eight corners of the box; `centres` takes those of the outermost voxels' centres. */
export function cornersOf(grid: Grid, centres = false) {
  const [nx, ny, nz] = grid.shape.toReversed(),
    edge = centres ? 0 : 0.5;
  return [0, 1].flatMap((k) =>
    [0, 1].flatMap((j) =>
      [0, 1].map((i) =>
        placeOf(grid, [i ? nx - 1 + edge : -edge, j ? ny - 1 + edge : -edge, k ? nz - 1 + edge : -edge]),
      ),
    ),
  );
}

/** The edge lengths of the box along its own axes. */
export function lengthsOf({ shape, spacing }: Grid) {
  return spacing.map((s, k) => s * shape[2 - k]) as Vector3;
}

/** The rows of the inverse of the direction: from vectors in space to lengths along the index axes. */
export function frameOf({ direction }: Grid): Vector3[] {
  const [a, b, c] = [0, 1, 2].map((k) => column(direction, k)),
    det = dot(a, cross(b, c));
  return [scaled(cross(b, c), 1 / det), scaled(cross(c, a), 1 / det), scaled(cross(a, b), 1 / det)];
}

/** A place in space as lengths along the index axes from the first voxel's centre. */
export function inFrame(grid: Grid, place: number[]) {
  return times(
    frameOf(grid),
    place.map((x, k) => x - grid.origin[k]),
  );
}

/** The grid of blocks of so many voxels along x, y, z. */
export function coarserGrid(grid: Grid, factors: number[]): Grid {
  const shape = grid.shape.map((n, k) => Math.ceil(n / factors[2 - k])) as Vector3;
  const spacing = grid.spacing.map((s, k) => s * factors[k]) as Vector3;
  return {
    ...grid,
    shape,
    spacing,
    origin: placeOf(
      grid,
      factors.map((f) => (f - 1) / 2),
    ),
  };
}

/** Index and sign of the column of a direction nearest to a vector, not counting the one parallel to `without`. */
function nearestColumn(direction: Vector3[], toward: number[], without: number[] | null = null) {
  const columns = [0, 1, 2].map((k) => column(direction, k));
  const score = columns.map((c) => (without && Math.abs(dot(c, without)) > 0.5 ? 0 : dot(c, toward)));
  let k = 0;
  for (let j = 1; j < 3; j++) if (Math.abs(score[j]) > Math.abs(score[k])) k = j;
  return scaled(columns[k], score[k] >= 0 ? 1 : -1);
}

/** The plane of a picture seen along one of the grid's own axes, such as "+y", in the middle of its depth. */
export function planeAlong(grid: Grid, view: string): Plane {
  const axis = view[1] as "x" | "y" | "z",
    sign = view[0] === "+" ? 1 : -1;
  const unit = (vector: Vector3) => unitVector(vector) as Vector3;
  const n = unit(
    nearestColumn(
      grid.direction,
      AXES.map((name) => (name === axis ? sign : 0)),
    ),
  );
  const down = scaled(nearestColumn(grid.direction, UP[axis], n), -1),
    along = dot(down, n);
  const v = unit(down.map((x, k) => x - along * n[k]) as Vector3),
    u = cross(v, n);
  const corners = cornersOf(grid, true),
    [a, b, c] = [u, v, n].map((w) => Math.min(...corners.map((p) => dot(p, w))));
  const depth = c + (Math.max(...corners.map((p) => dot(p, n))) - c) / 2;
  const origin = [0, 1, 2].map((k) => plain(a * u[k] + b * v[k] + depth * n[k]));
  const straight = [u, v, n].map((w) => w.map(plain) as Vector3);
  return { origin: origin as Vector3, u: straight[0], v: straight[1], n: straight[2] };
}

/** Coordinates [a, b, c] in a plane of places in space. */
export function toPlane({ origin, u, v, n }: Plane, places: Vector3[]) {
  return places.map((place) => {
    const away = place.map((x, k) => x - origin[k]);
    return [dot(away, u), dot(away, v), dot(away, n)];
  });
}

/** Least and largest of each coordinate. */
export function boundsOf(places: number[][]) {
  const range = (least: (...values: number[]) => number) =>
    places[0].map((_, k) => least(...places.map((place) => place[k])));
  return { low: range(Math.min), high: range(Math.max) };
}

/** Index axis (0 is x) and sign of depth, v and u of a plane along the grid's axes. */
export function voxelOrder(grid: Grid, { u, v, n }: Plane) {
  return [n, v, u].map((w) => {
    const cosines = [0, 1, 2].map((k) => dot(w, column(grid.direction, k)));
    let axis = 0;
    for (let k = 1; k < 3; k++) if (Math.abs(cosines[k]) > Math.abs(cosines[axis])) axis = k;
    return { axis, sign: cosines[axis] > 0 ? 1 : -1 };
  });
}

/** The raster of a picture along the grid's axes: a pixel is a column of voxels. */
export function voxelRaster(grid: Grid, plane: Plane): Raster {
  const [, v, u] = voxelOrder(grid, plane),
    { low } = boundsOf(toPlane(plane, cornersOf(grid, true)));
  return {
    shape: [grid.shape[2 - v.axis], grid.shape[2 - u.axis]],
    spacing: [grid.spacing[u.axis], grid.spacing[v.axis]],
    origin: [low[0], low[1]],
  };
}

const TOWARDS = [
  ["left side (L)", "right side (R)"],
  ["back (P)", "front (A)"],
  ["top (S)", "bottom (I)"],
];

/** The six sides of the box in words: where x is lowest and highest, then y, then z. */
export function sideNames({ direction }: Grid) {
  return [0, 1, 2].flatMap((k) => {
    const along = column(direction, k);
    let world = 0;
    for (let j = 1; j < 3; j++) if (Math.abs(along[j]) > Math.abs(along[world])) world = j;
    const [here, there] = along[world] < 0 ? [0, 1] : [1, 0];
    return [TOWARDS[world][here], TOWARDS[world][there]];
  });
}

/** The unit of lengths as it is shown: voxels where it is not known and the spacing is 1. */
export function unitOf({ spacing, unit }: Grid) {
  return unit || (spacing.every((s) => s === 1) ? "voxels" : "");
}
