// Fits by their displacements at the nodes of a raster, cubic between them: while a point is dragged, the grid and the
// folds are found on the raster that the picture is warped with, and a place costs the same with any number of points.
// Keys, "Cubic Convolution Interpolation for Digital Image Processing", 1981: the error falls with the third power of
// the distance of the nodes. The picture at rest is of the fit itself.

import type { LayeredFit, Numbers6, Raster, Sampled, Vector2 } from "../types.ts";

const PLACE_COST = 20; // evaluations of a kernel that take as long as a place between the nodes
const FEWEST_NODES = 4; // of a side
const WITHIN = 1 - 1e-12; // the last node is found again in spite of rounding

/**
 * The fits with their displacements at the nodes of a raster; where there are too few nodes, the fits themselves.
 * @param values of each fit, nv * nu * 2 numbers as of fieldOnRaster
 */
export function sampledFits(layered: LayeredFit, raster: Raster, values: ArrayLike<number>[]): LayeredFit {
  if (Math.min(...raster.shape) < FEWEST_NODES) return layered;
  const sampled = (one: LayeredFit["fits"][number], k: number): LayeredFit["fits"][number] => ({
    ...one,
    fit: { ...one.fit, sampled: { raster, values: values[k]!, fit: one.fit } },
  });
  const fits = layered.fits.map(sampled);
  const cost = PLACE_COST * (layered.regions.length ? 2 * fits.length : 1); // the visible fit at a place, and its slope
  return { ...layered, fits, fit: layered.fit && fits[0]!.fit, count: Math.min(layered.count, cost) };
}

/** Weights of four nodes, then those of the slope. */
type Weights = Float64Array & Record<0 | 1 | 2 | 3 | 4 | 5 | 6 | 7, number>;

const ACROSS = new Float64Array(8) as Weights,
  DOWN = new Float64Array(8) as Weights;

/**
 * The first of four nodes around a place, in units of the nodes, and their weights; -1 beyond the outermost nodes.
 * @param count of the nodes
 */
function nodesAround(place: number, count: number, w: Weights) {
  if (!(place >= 0 && place <= count - 1)) return -1;
  const cell = Math.min(count - 2, Math.floor(place)),
    t = place - cell;
  w[0] = t * (-0.5 + t * (1 - 0.5 * t));
  w[1] = 1 + t * t * (-2.5 + 1.5 * t);
  w[2] = t * (0.5 + t * (2 - 1.5 * t));
  w[3] = t * t * (-0.5 + 0.5 * t);
  w[4] = -0.5 + t * (2 - 1.5 * t);
  w[5] = t * (-5 + 4.5 * t);
  w[6] = 0.5 + t * (4 - 4.5 * t);
  w[7] = t * (-1 + 1.5 * t);
  for (const at of [0, 4]) {
    // a node beyond the rim is 3 p - 3 q + r of those within
    const p = w[at]!,
      q = w[at + 1]!,
      r = w[at + 2]!,
      s = w[at + 3]!;
    if (cell === 0) {
      w[at] = q + 3 * p;
      w[at + 1] = r - 3 * p;
      w[at + 2] = s + p;
      w[at + 3] = 0;
    }
    if (cell === count - 2) {
      w[at] = 0;
      w[at + 1] = p + s;
      w[at + 2] = q - 3 * s;
      w[at + 3] = r + 3 * s;
    }
  }
  return Math.max(0, Math.min(count - 4, cell - 1));
}

/** y + D(y) and its Jacobian at (a, b), as of fieldWithSlope; false beyond the raster. */
export function sampledWithSlope(
  {
    raster: {
      shape: [nv, nu],
      spacing: [du, dv],
      origin,
    },
    values,
  }: Sampled,
  a: number,
  b: number,
  out: Numbers6,
) {
  const j = nodesAround((a - origin[0]) / du, nu, ACROSS),
    i = nodesAround((b - origin[1]) / dv, nv, DOWN);
  if (i < 0 || j < 0) return false;
  let u = 0,
    v = 0,
    ua = 0,
    va = 0,
    ub = 0,
    vb = 0;
  for (let row = 0; row < 4; row++) {
    let p = 0,
      q = 0,
      pa = 0,
      qa = 0;
    for (let column = 0, n = 2 * ((i + row) * nu + j); column < 4; column++, n += 2) {
      const w = ACROSS[column]!,
        slope = ACROSS[4 + column]!;
      p += w * values[n]!;
      q += w * values[n + 1]!;
      pa += slope * values[n]!;
      qa += slope * values[n + 1]!;
    }
    const w = DOWN[row]!,
      slope = DOWN[4 + row]!;
    u += w * p;
    v += w * q;
    ua += w * pa;
    va += w * qa;
    ub += slope * p;
    vb += slope * q;
  }
  out[0] = a + u;
  out[1] = b + v;
  out[2] = 1 + ua / du;
  out[3] = ub / dv;
  out[4] = va / du;
  out[5] = 1 + vb / dv;
  return true;
}

/** The same, and beyond the raster with the displacement of the nearest place within it. */
export function clampedWithSlope(sampled: Sampled, a: number, b: number, out: Numbers6) {
  const {
    raster: {
      shape: [nv, nu],
      spacing: [du, dv],
      origin,
    },
  } = sampled;
  const nearest = (place: number, first: number, length: number) => Math.max(first, Math.min(first + length, place));
  const x = nearest(a, origin[0], (nu - 1) * du * WITHIN),
    y = nearest(b, origin[1], (nv - 1) * dv * WITHIN);
  sampledWithSlope(sampled, x, y, out);
  if (x !== a) {
    out[0] += a - x;
    out[2] = 1;
    out[4] = 0;
  }
  if (y !== b) {
    out[1] += b - y;
    out[3] = 0;
    out[5] = 1;
  }
  return out;
}

/** The fits for what is drawn within the raster alone: beyond it they have the displacement of its rim. */
export function clampedFits(layered: LayeredFit): LayeredFit {
  const clamped = ({ fit, ...rest }: LayeredFit["fits"][number]): LayeredFit["fits"][number] => ({
    ...rest,
    fit: fit.sampled ? { ...fit, sampled: { ...fit.sampled, isClamped: true } } : fit,
  });
  return { ...layered, fits: layered.fits.map(clamped) };
}

const PLACE = new Float64Array(6) as Numbers6;

/** The displacement at (a, b), null beyond the raster. */
export function sampledAt(sampled: Sampled, a: number, b: number): Vector2 | null {
  return sampledWithSlope(sampled, a, b, PLACE) ? [PLACE[0] - a, PLACE[1] - b] : null;
}

/**
 * The displacements at the pixels of another raster, as of fieldOnRaster.
 * @param exactly the displacement beyond the nodes
 */
export function sampledOnRaster(
  { raster: nodes, values }: Sampled,
  { shape: [rows, columns], spacing: [du, dv], origin }: Raster,
  out: Float32Array,
  exactly: (a: number, b: number) => Vector2,
) {
  const [nv, nu] = nodes.shape,
    across = new Float64Array(4 * columns),
    first = new Int32Array(columns);
  for (let j = 0; j < columns; j++) {
    first[j] = nodesAround((origin[0] + j * du - nodes.origin[0]) / nodes.spacing[0], nu, ACROSS);
    across.set(ACROSS.subarray(0, 4), 4 * j);
  }
  const line = new Float64Array(2 * nu); // of the nodes, at the row's place down
  for (let i = 0, n = 0; i < rows; i++) {
    const b = origin[1] + i * dv,
      top = nodesAround((b - nodes.origin[1]) / nodes.spacing[1], nv, DOWN);
    for (let m = 0, at = 2 * nu * top; top >= 0 && m < 2 * nu; m++, at++) {
      line[m] =
        DOWN[0] * values[at]! +
        DOWN[1] * values[at + 2 * nu]! +
        DOWN[2] * values[at + 4 * nu]! +
        DOWN[3] * values[at + 6 * nu]!;
    }
    for (let j = 0; j < columns; j++, n += 2) {
      if (top < 0 || first[j]! < 0) {
        [out[n], out[n + 1]] = exactly(origin[0] + j * du, b);
        continue;
      }
      let u = 0,
        v = 0;
      for (let k = 0, m = 2 * first[j]!; k < 4; k++, m += 2) {
        u += across[4 * j + k]! * line[m]!;
        v += across[4 * j + k]! * line[m + 1]!;
      }
      out[n] = u;
      out[n + 1] = v;
    }
  }
  return out;
}
