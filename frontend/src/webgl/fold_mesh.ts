// Folds of a volume's displacement: searched for in its maps once, and shown by the shader where there are some.

import { MOST_BENDS } from "../generated.ts";
import { AXES } from "../maths/axes.ts";
import type { Matrix2, Matrix3, Vector2, Vector3 } from "../types.ts";
import type { PlanarField } from "./types.ts";

export const FOLDS_GLSL = `
#ifdef FOLDS
// Whether tissue is turned over at x, whose origin is there: the sign of the determinant of the places around it.
bool folded(vec3 x, vec3 at) {
  vec3 u = onward(x + slopeStep * axisU) - at, v = onward(x + slopeStep * axisV) - at;
  vec3 n = onward(x + slopeStep * axisN) - at;
  return dot(cross(u, v), n) * dot(cross(axisU, axisV), axisN) <= 0.;
}

// Red with stripes: a fold is seen without its colour too.
vec3 foldRed(vec3 rgb) {
  float stripe = step(mod(gl_FragCoord.x + gl_FragCoord.y, 9.), 2.2);
  return mix(mix(rgb, vec3(.827, .184, .184), .72), vec3(1., .78, .78), .55 * stripe);
}
#endif`;

/**
 * True if a planar field folds: a cell of its maps is turned over, seen at its upper left or at its lower right
 * corner. One map is tested at every weight that it has, det(1 + w M) being a parabola in w; several at all weights
 * between two knots, as widgets/vtk/folds.py does.
 */
export function planarFolds(
  { maps, shape, spacing, weights }: Pick<PlanarField, "maps" | "shape" | "spacing" | "weights">,
  count: number,
  steep: Float64Array,
) {
  const [layers, rows, columns] = shape,
    [da, db] = spacing;
  if (count > 1) return severalFold({ maps, shape, spacing, weights }, count, steep);
  const low = weights.reduce((a, b) => Math.min(a, b), Infinity);
  const high = weights.reduce((a, b) => Math.max(a, b), -Infinity);
  const turned = (a: number, b: number, c: number, d: number) => {
    // the smallest 1 + w (a + d) + w^2 (ad - bc) for low <= w <= high
    const trace = a + d,
      det = a * d - b * c,
      top = -trace / (2 * det);
    const at = (w: number) => 1 + w * (trace + w * det);
    return at(low) <= 0 || at(high) <= 0 || (det > 0 && top > low && top < high && at(top) <= 0);
  };
  for (let k = 0; k < layers; k++) {
    for (let r = 0; r + 1 < rows; r++) {
      let i = 2 * ((k * rows + r) * columns),
        j = i + 2 * columns;
      for (let c = 0; c + 1 < columns; c++, i += 2, j += 2) {
        if (
          turned(
            (maps[i + 2]! - maps[i]!) / da,
            (maps[j]! - maps[i]!) / db,
            (maps[i + 3]! - maps[i + 1]!) / da,
            (maps[j + 1]! - maps[i + 1]!) / db,
          )
        )
          return true;
        if (
          turned(
            (maps[j + 2]! - maps[j]!) / da,
            (maps[j + 2]! - maps[i + 2]!) / db,
            (maps[j + 3]! - maps[j + 1]!) / da,
            (maps[j + 3]! - maps[i + 3]!) / db,
          )
        )
          return true;
      }
    }
  }
  return false;
}

/** The same of several maps in each region, from knot to knot of their weights. */
function severalFold(
  {
    maps,
    shape: [layers, rows, columns],
    spacing,
    weights,
  }: Pick<PlanarField, "maps" | "shape" | "spacing" | "weights">,
  count: number,
  steep: Float64Array,
) {
  const knots = weights.length / count,
    ends = bendsOf(weights, count),
    plane = 2 * rows * columns;
  for (let r = 0; r < layers / count; r++) {
    for (let n = 0; n + 1 < ends.length; n++) {
      let most = 0;
      const parts = Array.from({ length: count }, (_, k) => {
        const from = weights[k * knots + ends[n]!]!,
          to = weights[k * knots + ends[n + 1]!]!;
        most += Math.max(Math.abs(from), Math.abs(to)) * steep[r * count + k]!;
        return { at: (r * count + k) * plane, from, way: to - from };
      });
      if (most < 1) continue; // displacements less than the distance of the places turn nothing over
      if (ends.length > MOST_BENDS || isTurnedOver(maps, parts, [rows, columns], spacing)) return true;
    }
  }
  return false;
}

/** The knots between which all weights change evenly. */
function bendsOf(weights: Float32Array, count: number) {
  const knots = weights.length / count,
    ends = [0];
  for (let i = 1; i + 1 < knots; i++) {
    for (let k = 0; k < count; k++) {
      const at = k * knots + i;
      if (Math.abs(weights[at - 1]! - 2 * weights[at]! + weights[at + 1]!) > 1e-6) {
        ends.push(i);
        break;
      }
    }
  }
  return [...ends, knots - 1];
}

/**
 * Whether a cell of a sum of maps is turned over while their weights change.
 * @param parts of each map its first value, its weight and the change of it
 */
function isTurnedOver(
  maps: Float32Array,
  parts: { at: number; from: number; way: number }[],
  [rows, columns]: Vector2,
  [da, db]: Vector2,
) {
  const steps: Vector2 = [2, 2 * columns],
    lengths: Vector2 = [da, db];
  const [p, q]: Matrix2 = [
      [0, 0],
      [0, 0],
    ], // rows of 1 + sum w M
    [dp, dq]: Matrix2 = [
      [0, 0],
      [0, 0],
    ]; // and of its change
  for (let row = 0; row + 1 < rows; row++) {
    for (let column = 0; column + 1 < columns; column++) {
      for (const isLast of [false, true]) {
        p[0] = q[1] = 1;
        p[1] = q[0] = dp[0] = dp[1] = dq[0] = dq[1] = 0;
        for (const { at, from, way } of parts) {
          for (const axis of [0, 1] as const) {
            const first = at + 2 * (row * columns + column) + (isLast ? steps[axis ? 0 : 1] : 0);
            const u = (maps[first + steps[axis]]! - maps[first]!) / lengths[axis];
            const v = (maps[first + steps[axis] + 1]! - maps[first + 1]!) / lengths[axis];
            p[axis] += from * u;
            q[axis] += from * v;
            dp[axis] += way * u;
            dq[axis] += way * v;
          }
        }
        const start = p[0] * q[1] - p[1] * q[0],
          bow = dp[0] * dq[1] - dp[1] * dq[0];
        const tilt = p[0] * dq[1] + q[1] * dp[0] - p[1] * dq[0] - q[0] * dp[1],
          lowest = -tilt / (2 * bow);
        const least =
          bow > 0 && lowest > 0 && lowest < 1
            ? start + lowest * (tilt + lowest * bow)
            : Math.min(start, start + tilt + bow);
        if (!(least > 0)) return true;
      }
    }
  }
  return false;
}

/** True if a displacement sampled in space, [z][y][x][3], turns over a cell, seen at its corner nearest to 0. */
export function spaceFolds(values: Float32Array, [nx, ny, nz]: Vector3, spacing: Vector3) {
  const strides: Vector3 = [3, 3 * nx, 3 * nx * ny],
    [p, q, r]: Matrix3 = [
      [0, 0, 0],
      [0, 0, 0],
      [0, 0, 0],
    ]; // rows of 1 + the slopes
  for (let z = 0; z + 1 < nz; z++) {
    for (let y = 0; y + 1 < ny; y++) {
      for (let x = 0, i = 3 * (z * ny + y) * nx; x + 1 < nx; x++, i += 3) {
        for (const axis of AXES) {
          const j = i + strides[axis];
          p[axis] = (axis === 0 ? 1 : 0) + (values[j]! - values[i]!) / spacing[axis];
          q[axis] = (axis === 1 ? 1 : 0) + (values[j + 1]! - values[i + 1]!) / spacing[axis];
          r[axis] = (axis === 2 ? 1 : 0) + (values[j + 2]! - values[i + 2]!) / spacing[axis];
        }
        const det =
          p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0]) + p[2] * (q[0] * r[1] - q[1] * r[0]);
        if (det <= 0) return true;
      }
    }
  }
  return false;
}
