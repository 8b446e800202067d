// The grid of a volume's voxels and the planes of pictures of it, as deformnb/volume/volume.py and plane.py have them.
// Arrays are [z, y, x]; places are (x, y, z) in space (LPS).

import { cross, dot, scaled, unitVector } from "../maths/camera.js";

/** @import { Raster, Vector3 } from "../types.d.ts" */

/**
 * @typedef {object} Grid
 * @property {Vector3} shape [nz, ny, nx]
 * @property {Vector3} spacing along x, y, z
 * @property {Vector3} origin the centre of the first voxel
 * @property {Vector3[]} direction rows; the columns are the directions of the x, y and z index
 * @property {string} unit of spacing and origin; "" where it is not known
 */

/** @typedef {{origin: Vector3, u: Vector3, v: Vector3, n: Vector3}} Plane */

/** A grid that cannot be. */
export class GridError extends Error {}

const ORTHONORMAL_TOLERANCE = 2e-4;
const SPACINGS = [1e-12, 1e12];
const LARGEST_COORDINATE = 1e15;

/** Up of the picture for each viewing axis: the head, or in a picture along z the front of the patient. */
const UP = { x: [0, 0, 1], y: [0, 0, 1], z: [0, -1, 0] };
const AXES = /** @type {const} */ (["x", "y", "z"]);

/** @param {Vector3[]} rows @param {number} k */
const column = (rows, k) => /** @type {Vector3} */ (rows.map((row) => row[k]));

/** @param {Vector3[]} rows @param {number[]} vector */
const times = (rows, vector) => /** @type {Vector3} */ (rows.map((row) => dot(row, vector)));

/** @param {number} value */
const plain = (value) => value + 0; // -0 is 0 in a file

/**
 * A grid whose numbers are checked.
 * @param {Vector3} shape
 * @param {Vector3} spacing
 * @param {Vector3} origin
 * @param {Vector3[]} direction
 * @returns {Grid}
 */
export function checkedGrid(shape, spacing, origin, direction) {
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
      const wanted = i === j ? 1 : 0, off = Math.abs(dot(column(direction, i), column(direction, j)) - wanted);
      if (off > ORTHONORMAL_TOLERANCE + 1e-5 * wanted) {
        throw new GridError("its axes are sheared or scaled (direction is not orthonormal); resample the volume onto " +
          "a straight grid first.");
      }
    }
  }
  return { shape, spacing, origin, direction, unit: "" };
}

/**
 * The grid of an affine map of the indices (i, j, k), three rows of four numbers.
 * @param {Vector3} shape
 * @param {number[][]} affine
 */
export function gridOfAffine(shape, affine) {
  const columns = [0, 1, 2].map((k) => affine.map((row) => row[k]));
  const largest = columns.map((c) => Math.max(...c.map(Math.abs)));
  if (!affine.flat().every(Number.isFinite)) throw new GridError("the place of its voxels is not finite.");
  if (largest.some((length) => length === 0)) throw new GridError("the axes of its voxels do not span space.");
  const lengths = columns.map((c, k) => Math.sqrt(c.reduce((sum, x) => sum + (x / largest[k]) ** 2, 0)));
  const rows = [0, 1, 2].map((i) => /** @type {Vector3} */ (columns.map((c, k) => c[i] / largest[k] / lengths[k])));
  const spacing = /** @type {Vector3} */ (lengths.map((length, k) => length * largest[k]));
  return checkedGrid(shape, spacing, /** @type {Vector3} */ (affine.map((row) => row[3])), rows);
}

/**
 * The grid of spacings of which some may be negative: the axis is flipped then, which a note says.
 * @param {Vector3} shape
 * @param {Vector3} spacing
 * @param {Vector3} origin
 * @param {Vector3[]} direction
 * @param {string[]} notes
 */
export function straightenedGrid(shape, spacing, origin, direction, notes) {
  const signs = spacing.map((s) => (s < 0 ? -1 : 1)), names = AXES.filter((_, k) => signs[k] < 0);
  if (names.length) {
    notes.push(`the spacing along ${names.join(" and ")} is negative in the file: the axis is flipped instead`);
  }
  const turned = direction.map((row) => /** @type {Vector3} */ (row.map((x, k) => x * signs[k])));
  return checkedGrid(shape, /** @type {Vector3} */ (spacing.map((s, k) => s * signs[k])), origin, turned);
}

/**
 * The place of an index (i, j, k).
 * @param {Grid} grid
 * @param {number[]} index
 */
export function placeOf({ spacing, origin, direction }, index) {
  const moved = times(direction, index.map((n, k) => n * spacing[k]));
  return /** @type {Vector3} */ (origin.map((o, k) => o + moved[k]));
}

/**
 * The eight corners of the box; `centres` takes those of the outermost voxels' centres.
 * @param {Grid} grid
 */
export function cornersOf(grid, centres = false) {
  const [nx, ny, nz] = grid.shape.toReversed(), edge = centres ? 0 : 0.5;
  return [0, 1].flatMap((k) => [0, 1].flatMap((j) => [0, 1].map((i) => placeOf(grid,
    [i ? nx - 1 + edge : -edge, j ? ny - 1 + edge : -edge, k ? nz - 1 + edge : -edge]))));
}

/** The edge lengths of the box along its own axes. @param {Grid} grid */
export function lengthsOf({ shape, spacing }) {
  return /** @type {Vector3} */ (spacing.map((s, k) => s * shape[2 - k]));
}

/**
 * The rows of the inverse of the direction: from vectors in space to lengths along the index axes.
 * @param {Grid} grid
 * @returns {Vector3[]}
 */
export function frameOf({ direction }) {
  const [a, b, c] = [0, 1, 2].map((k) => column(direction, k)), det = dot(a, cross(b, c));
  return [scaled(cross(b, c), 1 / det), scaled(cross(c, a), 1 / det), scaled(cross(a, b), 1 / det)];
}

/**
 * A place in space as lengths along the index axes from the first voxel's centre.
 * @param {Grid} grid
 * @param {number[]} place
 */
export function inFrame(grid, place) { return times(frameOf(grid), place.map((x, k) => x - grid.origin[k])); }

/**
 * The grid of blocks of so many voxels along x, y, z.
 * @param {Grid} grid
 * @param {number[]} factors
 * @returns {Grid}
 */
export function coarserGrid(grid, factors) {
  const shape = /** @type {Vector3} */ (grid.shape.map((n, k) => Math.ceil(n / factors[2 - k])));
  const spacing = /** @type {Vector3} */ (grid.spacing.map((s, k) => s * factors[k]));
  return { ...grid, shape, spacing, origin: placeOf(grid, factors.map((f) => (f - 1) / 2)) };
}

/**
 * Index and sign of the column of a direction nearest to a vector, not counting the one parallel to `without`.
 * @param {Vector3[]} direction
 * @param {number[]} toward
 * @param {number[] | null} without
 */
function nearestColumn(direction, toward, without = null) {
  const columns = [0, 1, 2].map((k) => column(direction, k));
  const score = columns.map((c) => (without && Math.abs(dot(c, without)) > 0.5 ? 0 : dot(c, toward)));
  let k = 0;
  for (let j = 1; j < 3; j++) if (Math.abs(score[j]) > Math.abs(score[k])) k = j;
  return scaled(columns[k], score[k] >= 0 ? 1 : -1);
}

/**
 * The plane of a picture seen along one of the grid's own axes, such as "+y", in the middle of its depth.
 * @param {Grid} grid
 * @param {string} view
 * @returns {Plane}
 */
export function planeAlong(grid, view) {
  const axis = /** @type {"x" | "y" | "z"} */ (view[1]), sign = view[0] === "+" ? 1 : -1;
  const unit = (/** @type {Vector3} */ vector) => /** @type {Vector3} */ (unitVector(vector));
  const n = unit(nearestColumn(grid.direction, AXES.map((name) => (name === axis ? sign : 0))));
  const down = scaled(nearestColumn(grid.direction, UP[axis], n), -1), along = dot(down, n);
  const v = unit(/** @type {Vector3} */ (down.map((x, k) => x - along * n[k]))), u = cross(v, n);
  const corners = cornersOf(grid, true), [a, b, c] = [u, v, n].map((w) => Math.min(...corners.map((p) => dot(p, w))));
  const depth = c + (Math.max(...corners.map((p) => dot(p, n))) - c) / 2;
  const origin = [0, 1, 2].map((k) => plain(a * u[k] + b * v[k] + depth * n[k]));
  const straight = [u, v, n].map((w) => /** @type {Vector3} */ (w.map(plain)));
  return { origin: /** @type {Vector3} */ (origin), u: straight[0], v: straight[1], n: straight[2] };
}

/**
 * Coordinates [a, b, c] in a plane of places in space.
 * @param {Plane} plane
 * @param {Vector3[]} places
 */
export function toPlane({ origin, u, v, n }, places) {
  return places.map((place) => {
    const away = place.map((x, k) => x - origin[k]);
    return [dot(away, u), dot(away, v), dot(away, n)];
  });
}

/** Least and largest of each coordinate. @param {number[][]} places */
export function boundsOf(places) {
  const range = (/** @type {(...values: number[]) => number} */ least) =>
    places[0].map((_, k) => least(...places.map((place) => place[k])));
  return { low: range(Math.min), high: range(Math.max) };
}

/**
 * Index axis (0 is x) and sign of depth, v and u of a plane along the grid's axes.
 * @param {Grid} grid
 * @param {Plane} plane
 */
export function voxelOrder(grid, { u, v, n }) {
  return [n, v, u].map((w) => {
    const cosines = [0, 1, 2].map((k) => dot(w, column(grid.direction, k)));
    let axis = 0;
    for (let k = 1; k < 3; k++) if (Math.abs(cosines[k]) > Math.abs(cosines[axis])) axis = k;
    return { axis, sign: cosines[axis] > 0 ? 1 : -1 };
  });
}

/**
 * The raster of a picture along the grid's axes: a pixel is a column of voxels.
 * @param {Grid} grid
 * @param {Plane} plane
 * @returns {Raster}
 */
export function voxelRaster(grid, plane) {
  const [, v, u] = voxelOrder(grid, plane), { low } = boundsOf(toPlane(plane, cornersOf(grid, true)));
  return { shape: [grid.shape[2 - v.axis], grid.shape[2 - u.axis]],
    spacing: [grid.spacing[u.axis], grid.spacing[v.axis]], origin: [low[0], low[1]] };
}

const TOWARDS = [["left side (L)", "right side (R)"], ["back (P)", "front (A)"], ["top (S)", "bottom (I)"]];

/** The six sides of the box in words: where x is lowest and highest, then y, then z. @param {Grid} grid */
export function sideNames({ direction }) {
  return [0, 1, 2].flatMap((k) => {
    const along = column(direction, k);
    let world = 0;
    for (let j = 1; j < 3; j++) if (Math.abs(along[j]) > Math.abs(along[world])) world = j;
    const [here, there] = along[world] < 0 ? [0, 1] : [1, 0];
    return [TOWARDS[world][here], TOWARDS[world][there]];
  });
}

/** The unit of lengths as it is shown: voxels where it is not known and the spacing is 1. @param {Grid} grid */
export function unitOf({ spacing, unit }) { return unit || (spacing.every((s) => s === 1) ? "voxels" : ""); }
