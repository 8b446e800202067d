// The folds of a fit in space: the smallest det J of the backward map on a lattice of the volume and around the points.

import { NEARLY_FOLDED } from "../generated.ts";
import type { Matrix3, PaneInfo, RbfFit, SpaceMask, Vector3 } from "../types.ts";
import { perAxis } from "./axes.ts";
import { added, difference, dot } from "./camera.ts";
import { RBF_KERNELS, rbfQuadraticAt } from "./rbf.ts";
import { maskBits } from "./regions.ts";
import { fromPane, type SpaceFit, type SpaceFits } from "./space.ts";

const RINGS = [0.2, 0.45, 0.7], // of the distance to the nearest point, where a fold near a point may hide
  FEWEST = 5,
  MOST = 17; // nodes along the longest side
const DIRECTIONS: Vector3[] = [
  [1, 0, 0],
  [-1, 0, 0],
  [0, 1, 0],
  [0, -1, 0],
  [0, 0, 1],
  [0, 0, -1],
];

/** A test whether tissue is at a place of the volume as it was. */
export type IsTissueAt = (place: Vector3) => boolean;

/** det J of the backward map x + D(x) at a place. */
export function detInSpace(fit: RbfFit, place: Vector3) {
  const { centers: x, coefficients: alpha, count, scales, support: r, origin, linear, quadratic } = fit as SpaceFit;
  const slope = RBF_KERNELS[fit.kernel]!.slope,
    p = (place[0] - origin[0]) / r,
    q = (place[1] - origin[1]) / r,
    s = (place[2] - origin[2]) / r;
  const m: Matrix3 = quadratic
    ? perAxis((i) => perAxis((j) => linear[i][j] + 2 * dot(quadratic[i][j], [p, q, s])))
    : perAxis((i) => [...linear[i]]);
  const [m0, m1, m2] = m;
  for (let k = 0, j = 0; k < count; k++, j += 3) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      ds = s - x[j + 2]!,
      w = scales ? scales[k]! * scales[k]! : 1,
      g = 2 * w * slope((dp * dp + dq * dq + ds * ds) * w);
    if (g === 0) continue;
    const [a, b, c] = [g * alpha[j]!, g * alpha[j + 1]!, g * alpha[j + 2]!];
    m0[0] += a * dp;
    m0[1] += a * dq;
    m0[2] += a * ds;
    m1[0] += b * dp;
    m1[1] += b * dq;
    m1[2] += b * ds;
    m2[0] += c * dp;
    m2[1] += c * dq;
    m2[2] += c * ds;
  }
  const [a, b, c] = [1 + m0[0] / r, m0[1] / r, m0[2] / r],
    [d, e, f] = [m1[0] / r, 1 + m1[1] / r, m1[2] / r],
    [g, h, i] = [m2[0] / r, m2[1] / r, 1 + m2[2] / r];
  return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
}

/** The backward displacement of a fit at a place. */
function moveInFit(fit: RbfFit, place: Vector3): Vector3 {
  const {
      centers: x,
      coefficients: alpha,
      count,
      scales,
      support: r,
      origin,
      linear,
      constant,
      quadratic,
    } = fit as SpaceFit,
    { profile } = RBF_KERNELS[fit.kernel]!,
    at = perAxis((k) => (place[k] - origin[k]) / r),
    [p, q, s] = at;
  let [u, v, w] = perAxis((k) => dot(linear[k], at) + constant[k] + (quadratic ? rbfQuadraticAt(quadratic[k], at) : 0));
  for (let k = 0, j = 0; k < count; k++, j += 3) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      ds = s - x[j + 2]!,
      scale = scales ? scales[k]! * scales[k]! : 1,
      phi = profile((dp * dp + dq * dq + ds * ds) * scale);
    u += phi * alpha[j]!;
    v += phi * alpha[j + 1]!;
    w += phi * alpha[j + 2]!;
  }
  return [u, v, w];
}

/** The place before some fits that is seen at a place. */
export function sourceOfFits(fits: SpaceFits, place: Vector3): Vector3 {
  return fits.reduceRight<Vector3>((at, fit) => added(at, moveInFit(fit, at)), place);
}

/** det J of fits done one after the other, at a place of the result. */
export function detOfFits(fits: SpaceFits, place: Vector3) {
  let det = 1,
    at = place;
  for (let k = fits.length - 1; k >= 0; k--) {
    det *= detInSpace(fits[k]!, at);
    if (k > 0) at = sourceOfFits([fits[k]!], at);
  }
  return det;
}

/** Evaluations of a kernel that det J of fits costs at a place. */
export const costOf = (fits: SpaceFits) => fits.reduce((sum, fit) => sum + fit.count, 0);

/** Places around the centres of a fit, along the axes and along their displacement, as many as a number of evaluations allows. */
export function* placesNear(
  { centers, coefficients, count, origin, support }: SpaceFit,
  most: number,
): Generator<Vector3> {
  const placeOf = (k: number) => perAxis((i) => centers[3 * k + i]!),
    step = Math.max(1, Math.ceil((count * count * RINGS.length * (DIRECTIONS.length + 2)) / most));
  for (let k = 0; k < count; k += step) {
    const at = placeOf(k),
      pull = perAxis((i) => coefficients[3 * k + i]!),
      size = Math.hypot(...pull);
    let near = 1;
    for (let j = 0; j < count; j++) if (j !== k) near = Math.min(near, Math.hypot(...difference(placeOf(j), at)));
    const along: Vector3[] = size ? [perAxis((i) => pull[i] / size), perAxis((i) => -pull[i] / size)] : [];
    for (const share of [0, ...RINGS]) {
      for (const way of [...along, ...DIRECTIONS]) {
        yield perAxis((i) => origin[i] + support * (at[i] + share * near * way[i]));
        if (share === 0) break;
      }
    }
  }
}

/**
 * The smallest det J of fits in a volume; where there is no tissue, one up to NEARLY_FOLDED does not count.
 * @param pane a picture of the volume, whose box is that of the volume
 * @param work evaluations of a kernel
 */
export function leastDetInSpace(fits: SpaceFits, pane: PaneInfo, isTissue: IsTissueAt, work: number) {
  const [a0, a1, b0, b1, c0, c1] = pane.box,
    sizes = [a1 - a0, b1 - b0, c1 - c0],
    longest = Math.max(...sizes),
    nodes = Math.max(FEWEST, Math.min(MOST, Math.floor(Math.cbrt(work / (costOf(fits) + 1)))));
  const [na, nb, nc] = perAxis((k) => Math.max(2, Math.round((nodes * sizes[k]!) / longest)));
  let least = 1;
  const look = (place: Vector3) => {
    const det = detOfFits(fits, place);
    if (det < least && (det > NEARLY_FOLDED || isTissue(sourceOfFits(fits, place)))) least = det;
  };
  for (let i = 0; i < na; i++) {
    for (let j = 0; j < nb; j++) {
      for (let k = 0; k < nc; k++) {
        look(
          fromPane(pane, [
            a0 + (i * sizes[0]!) / (na - 1),
            b0 + (j * sizes[1]!) / (nb - 1),
            c0 + (k * sizes[2]!) / (nc - 1),
          ]),
        );
      }
    }
  }
  for (const place of placesNear(fits.at(-1) as SpaceFit, work / fits.length)) look(place);
  return least;
}

/** The test of a mask of tissue, at a place or within a voxel of the mask, which is coarser than the volume. */
export function tissueOfMask(mask: SpaceMask): IsTissueAt {
  const {
      shape: [nz, ny, nx],
      spacing,
      origin,
      direction: d,
    } = mask,
    bits = maskBits(mask.bits, nx * ny * nz),
    steps = [-1, 0, 1];
  return (place) => {
    const from = difference(place, origin),
      [i, j, k] = perAxis((axis) =>
        Math.round((d[axis]! * from[0] + d[3 + axis]! * from[1] + d[6 + axis]! * from[2]) / spacing[axis]),
      );
    const isSet = (x: number, y: number, z: number) =>
      x >= 0 && y >= 0 && z >= 0 && x < nx && y < ny && z < nz && bits[(z * ny + y) * nx + x] === 1;
    return steps.some((a) => steps.some((b) => steps.some((c) => isSet(i + a, j + b, k + c))));
  };
}
