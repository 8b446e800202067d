// Rigid parts of a step in space: their motions, as deformnb.rbf.rigid has them, and what a slice shows of them.

import { SAME_MOTION } from "../generated.ts";
import type {
  Matrix3,
  PaneInfo,
  PartData,
  RegionData,
  SpaceMask,
  SpaceMotion,
  SpacePart,
  SpacePoint,
  SpaceRegion,
  Vector2,
  Vector3,
  Vector4,
} from "../types.ts";
import { perAxis } from "./axes.ts";
import { added, cross, difference, dot, scaled } from "./camera.ts";
import { sampledMask } from "./mask_outlines.ts";
import { formatLength } from "./numbers.ts";
import { maskBits } from "./regions.ts";
import { fromPane, toPane, vectorFromPane } from "./space.ts";

const MOST_SAMPLES = 128; // along each side of what a slice shows of a part
const MOST_VOXELS = 2 ** 25; // of a mask that is read here
const LEVEL = 0.05; // length of the normal of a half space within a slice, below which the slice is parallel to it

/** The parts in space that a message or a trait has. */
export const spacePartsOf = (parts: PartData[]) => parts as unknown as SpacePart[];

/** The same of a message. */
export const partDataOf = (part: SpacePart) => part as unknown as PartData;

// ---- motions --------------------------------------------------------------------------------------------------------

/** The image of a place under a motion. */
export function moveInSpace(motion: SpaceMotion | null, place: Vector3): Vector3 {
  return motion
    ? added(
        perAxis((k) => dot(motion.matrix[k], place)),
        motion.shift,
      )
    : place;
}

/** The place whose image under a motion is this one. */
export function placeBeforeInSpace(motion: SpaceMotion | null, place: Vector3): Vector3 {
  if (!motion) return place;
  const from = difference(place, motion.shift),
    { matrix } = motion;
  return perAxis((k) => matrix[0][k] * from[0] + matrix[1][k] * from[1] + matrix[2][k] * from[2]);
}

/** A vector turned about an axis by the right hand. */
function turnedAbout(axis: Vector3, angle: number, v: Vector3): Vector3 {
  const c = Math.cos(angle);
  return added(added(scaled(v, c), scaled(cross(axis, v), Math.sin(angle))), scaled(axis, dot(axis, v) * (1 - c)));
}

const STILL: SpaceMotion = {
  matrix: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  shift: [0, 0, 0],
};

/** A part shifted after its motion. */
export function shiftInSpace(part: SpacePart, way: Vector3): SpacePart {
  const { matrix, shift } = part.motion ?? STILL;
  return { ...part, motion: { matrix, shift: added(shift, way) } };
}

/** A part turned about its pivot after its motion. */
export function turnInSpace(part: SpacePart, axis: Vector3, angle: number): SpacePart {
  const { matrix, shift } = part.motion ?? STILL,
    about = pivotInSpace(part),
    columns = perAxis((k) =>
      turnedAbout(
        axis,
        angle,
        perAxis((row) => matrix[row][k]),
      ),
    );
  const turned: Matrix3 = perAxis((row) => perAxis((k) => columns[k][row]));
  return {
    ...part,
    motion: { matrix: turned, shift: added(about, turnedAbout(axis, angle, difference(shift, about))) },
  };
}

/** The place about which a part is turned, where its motion has brought it. */
export function pivotInSpace({ motion, pivot, region }: SpacePart) {
  return moveInSpace(motion, pivot ?? middleInSpace(region));
}

/** The angle of a part about an axis, in radians: the twist of its motion. */
export function twistOf({ motion }: SpacePart, axis: Vector3) {
  if (!motion) return 0;
  const [[a, b, c], [d, e, f], [g, h, i]] = motion.matrix;
  return 2 * Math.atan2(dot(axis, [h - f, c - g, d - b]), 1 + a + e + i);
}

/** "moved 12, -3.5, 0, turned 15\u00b0"; "" of a part without motion. */
export function spaceMotionWords(part: SpacePart) {
  const { motion } = part;
  if (!motion) return "";
  const before = part.pivot ?? middleInSpace(part.region),
    by = difference(moveInSpace(motion, before), before).map((x) => formatLength(x).replace(/^-0$/, "0")),
    trace = motion.matrix[0][0] + motion.matrix[1][1] + motion.matrix[2][2],
    degrees = formatLength((Math.acos(Math.max(-1, Math.min(1, (trace - 1) / 2))) * 180) / Math.PI);
  return [
    by.some((text) => text !== "0") ? `moved ${by.join(", ")}` : "",
    Number(degrees) !== 0 ? `turned ${degrees}\u00b0` : "",
  ]
    .filter(Boolean)
    .join(", ");
}

// ---- regions --------------------------------------------------------------------------------------------------------

const maskVoxels: WeakMap<SpaceMask, Uint8Array> = new WeakMap();

function voxelsOf(mask: SpaceMask) {
  const count = mask.shape[0] * mask.shape[1] * mask.shape[2],
    voxels = maskVoxels.get(mask) ?? (count > MOST_VOXELS ? new Uint8Array(count) : maskBits(mask.bits, count));
  maskVoxels.set(mask, voxels);
  return voxels;
}

/** The columns of the direction of a mask. */
function axesOf({ direction: d = [1, 0, 0, 0, 1, 0, 0, 0, 1] }: Partial<SpaceMask>): Matrix3 {
  return perAxis((k) => perAxis((row) => d[3 * row + k]!));
}

/** The index of a place among the voxels of a mask, x first. */
function indexIn(mask: SpaceMask, place: Vector3): Vector3 {
  const from = difference(place, mask.origin),
    axes = axesOf(mask);
  return perAxis((k) => dot(axes[k], from) / mask.spacing[k]);
}

/** How much of the place of an index is in a mask: values of the voxels around it, interpolated. */
function maskValue(mask: SpaceMask): (p: number, q: number, r: number) => number {
  const voxels = voxelsOf(mask),
    [nz, ny, nx] = mask.shape,
    at = (i: number, j: number, k: number) =>
      i >= 0 && j >= 0 && k >= 0 && i < nx && j < ny && k < nz ? voxels[(k * ny + j) * nx + i]! : 0;
  return (p, q, r) => {
    const i = Math.floor(p),
      j = Math.floor(q),
      k = Math.floor(r);
    if (i < -1 || j < -1 || k < -1 || i >= nx || j >= ny || k >= nz) return 0;
    const s = p - i,
      t = q - j,
      u = r - k,
      front =
        (at(i, j, k) * (1 - s) + at(i + 1, j, k) * s) * (1 - t) +
        (at(i, j + 1, k) * (1 - s) + at(i + 1, j + 1, k) * s) * t,
      l = k + 1,
      back =
        (at(i, j, l) * (1 - s) + at(i + 1, j, l) * s) * (1 - t) +
        (at(i, j + 1, l) * (1 - s) + at(i + 1, j + 1, l) * s) * t;
    return front * (1 - u) + back * u;
  };
}

/** Whether a place is in a region. */
export function isInSpace(region: SpaceRegion, place: Vector3) {
  if (region.kind === "half_space") return dot(difference(place, region.point), region.normal) <= 0;
  return maskValue(region)(...indexIn(region, place)) >= 0.5;
}

const maskMiddles: WeakMap<SpaceMask, Vector3> = new WeakMap();

/** The middle of a region, as of widgets/studio/panels/shapes.py. */
function middleInSpace(region: SpaceRegion): Vector3 {
  if (region.kind === "half_space") return region.point;
  const known = maskMiddles.get(region);
  if (known) return known;
  const voxels = voxelsOf(region),
    [, ny, nx] = region.shape,
    axes = axesOf(region),
    sums: Vector3 = [0, 0, 0];
  let count = 0;
  voxels.forEach((is, n) => {
    if (!is) return;
    count += 1;
    sums[0] += n % nx;
    sums[1] += Math.floor(n / nx) % ny;
    sums[2] += Math.floor(n / (nx * ny));
  });
  const middle = perAxis((k) => (region.spacing[k] * sums[k]) / (count || 1)),
    found = added(
      region.origin,
      perAxis((row) =>
        dot(
          perAxis((k) => axes[k][row]),
          middle,
        ),
      ),
    );
  maskMiddles.set(region, found);
  return found;
}

/** The points after a change of a part's motion: the active points in it that require its motion follow it. */
export function carryInSpace(points: SpacePoint[], before: SpacePart, after: SpacePart) {
  const all = points.flatMap((p) => [p.source, p.target]),
    size = Math.hypot(...perAxis((k) => Math.max(...all.map((at) => at[k])) - Math.min(...all.map((at) => at[k]))));
  return points.map((p) => {
    const gap = Math.hypot(...difference(moveInSpace(before.motion, p.source), p.target));
    if (!p.active || gap > SAME_MOTION * size || !isInSpace(before.region, p.source)) return p;
    return { ...p, target: moveInSpace(after.motion, p.source) };
  });
}

// ---- parts on a slice -----------------------------------------------------------------------------------------------

/**
 * A part as it is seen on a slice: at its moved place, the pivot in the plane of the picture.
 * @param depth of the slice
 */
export function partOnSlice(part: SpacePart, pane: PaneInfo, depth: number): PartData {
  const [a, b] = toPane(pane, pivotInSpace(part)),
    { name, enabled, weight, reach } = part;
  return { name, enabled, weight, reach, motion: null, pivot: [a, b], region: regionOnSlice(part, pane, depth) };
}

const NOTHING = sampledMask({ shape: [1, 1], spacing: [1, 1], origin: [0, 0] }, new Float64Array(1));

function regionOnSlice({ motion, region }: SpacePart, pane: PaneInfo, depth: number): RegionData {
  const [a0, a1, b0, b1] = pane.box;
  if (region.kind === "mask") return maskOnSlice(region, motion, pane, depth);
  const point = toPane(pane, moveInSpace(motion, region.point)),
    normal = difference(moveInSpace(motion, region.normal), moveInSpace(motion, [0, 0, 0])),
    [na, nb, nc] = [dot(normal, pane.u), dot(normal, pane.v), dot(normal, pane.n)],
    length = Math.hypot(na, nb),
    middle: Vector2 = [(a0 + a1) / 2, (b0 + b1) / 2],
    away = na * (middle[0] - point[0]) + nb * (middle[1] - point[1]) + nc * (depth - point[2]);
  if (length < LEVEL * Math.hypot(...normal)) {
    const corners: Vector2[] = [
      [a0, b0],
      [a1, b0],
      [a1, b1],
      [a0, b1],
    ];
    return away <= 0 ? { kind: "polygon", vertices: corners } : NOTHING;
  }
  const n: Vector2 = [na / length, nb / length],
    back = away / length;
  return { kind: "half_space", point: [middle[0] - back * n[0], middle[1] - back * n[1]], normal: n };
}

function maskOnSlice(mask: SpaceMask, motion: SpaceMotion | null, pane: PaneInfo, depth: number): RegionData {
  const box = boxOnSlice(mask, motion, pane, depth);
  if (!box) return NOTHING;
  const [a0, a1, b0, b1] = box,
    cell = Math.max(Math.min(...mask.spacing), (a1 - a0) / MOST_SAMPLES, (b1 - b0) / MOST_SAMPLES),
    [columns, rows] = [Math.ceil((a1 - a0) / cell) + 3, Math.ceil((b1 - b0) / cell) + 3],
    origin: Vector2 = [a0 - cell, b0 - cell],
    valueAt = maskValue(mask),
    indexAt = (column: number, row: number) => {
      const at: Vector3 = [origin[0] + column * cell, origin[1] + row * cell, depth];
      return indexIn(mask, placeBeforeInSpace(motion, fromPane(pane, at)));
    };
  const first = indexAt(0, 0),
    across = difference(indexAt(1, 0), first),
    down = difference(indexAt(0, 1), first),
    values = new Float64Array(rows * columns);
  for (let i = 0, n = 0; i < rows; i++) {
    const [p, q, r] = added(first, scaled(down, i));
    for (let j = 0; j < columns; j++, n++) {
      values[n] = valueAt(p + j * across[0], q + j * across[1], r + j * across[2]);
    }
  }
  return sampledMask({ shape: [rows, columns], spacing: [cell, cell], origin }, values);
}

/** The part of a picture in which a moved mask may be seen at a depth; null where it is not. */
function boxOnSlice(mask: SpaceMask, motion: SpaceMotion | null, pane: PaneInfo, depth: number): Vector4 | null {
  const axes = axesOf(mask),
    ends = [0, 1],
    corners = ends
      .flatMap((i) => ends.flatMap((j) => ends.map((k): Vector3 => [i, j, k])))
      .map((corner) => {
        const along = perAxis((k) => (corner[k] * mask.shape[2 - k]! - 0.5) * mask.spacing[k]),
          place = added(
            mask.origin,
            perAxis((row) =>
              dot(
                perAxis((k) => axes[k][row]),
                along,
              ),
            ),
          );
        return toPane(pane, moveInSpace(motion, place));
      });
  const [[a0, a1], [b0, b1], [c0, c1]] = perAxis((k): Vector2 => {
    const all = corners.map((corner) => corner[k]);
    return [Math.min(...all), Math.max(...all)];
  });
  if (depth < c0 || depth > c1) return null;
  const [left, right, top, bottom] = pane.box,
    found: Vector4 = [Math.max(a0, left), Math.min(a1, right), Math.max(b0, top), Math.min(b1, bottom)];
  return found[0] < found[1] && found[2] < found[3] ? found : null;
}

/** A displacement in the plane of a picture, in space. */
export const wayFromSlice = (pane: PaneInfo, [da, db]: Vector2) => vectorFromPane(pane, da, db);
