// Folds of a volume's displacement: looked for in its maps once, and shown by the shader where there are some.

/** @import { Vector3 } from "../types.d.ts" */
/** @import { PlanarField } from "./types.d.ts" */

export const FOLDS_GLSL = `
#ifdef FOLDS
// Whether tissue is turned over at x, which comes from there: the sign of the determinant of what lies around it.
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
 * corner. One map is tested at every weight that it has, det(1 + w M) being a parabola in w; of several a bound is
 * taken, so they fold at most there.
 * @param {Pick<PlanarField, "maps" | "shape" | "spacing" | "weights">} field
 * @param {number} count
 * @param {Float64Array} steep
 */
export function planarFolds({ maps, shape: [layers, rows, columns], spacing: [da, db], weights }, count, steep) {
  const knots = weights.length / count;
  if (count > 1) {
    const regions = layers / count;
    return Array.from({ length: knots * regions }, (_, n) => [n % knots, Math.floor(n / knots)]).some(([i, r]) => {
      let sum = 0;
      for (let k = 0; k < count; k++) sum += Math.abs(weights[k * knots + i]) * steep[r * count + k];
      return sum >= 1;
    });
  }
  const low = weights.reduce((a, b) => Math.min(a, b), Infinity);
  const high = weights.reduce((a, b) => Math.max(a, b), -Infinity);
  /** @type {(a: number, b: number, c: number, d: number) => boolean} */
  const turned = (a, b, c, d) => { // the smallest 1 + w (a + d) + w^2 (ad - bc) for low <= w <= high
    const trace = a + d, det = a * d - b * c, top = -trace / (2 * det);
    const at = (/** @type {number} */ w) => 1 + w * (trace + w * det);
    return at(low) <= 0 || at(high) <= 0 || (det > 0 && top > low && top < high && at(top) <= 0);
  };
  for (let k = 0; k < layers; k++) {
    for (let r = 0; r + 1 < rows; r++) {
      let i = 2 * ((k * rows + r) * columns), j = i + 2 * columns;
      for (let c = 0; c + 1 < columns; c++, i += 2, j += 2) {
        if (turned((maps[i + 2] - maps[i]) / da, (maps[j] - maps[i]) / db, (maps[i + 3] - maps[i + 1]) / da,
          (maps[j + 1] - maps[i + 1]) / db)) return true;
        if (turned((maps[j + 2] - maps[j]) / da, (maps[j + 2] - maps[i + 2]) / db, (maps[j + 3] - maps[j + 1]) / da,
          (maps[j + 3] - maps[i + 3]) / db)) return true;
      }
    }
  }
  return false;
}

/**
 * True if a displacement sampled in space, [z][y][x][3], turns over a cell, seen at its corner nearest to 0.
 * @param {Float32Array} values
 * @param {Vector3} shape
 * @param {Vector3} spacing
 */
export function spaceFolds(values, [nx, ny, nz], spacing) {
  const strides = [3, 3 * nx, 3 * nx * ny], m = new Float64Array(9);
  for (let z = 0; z + 1 < nz; z++) {
    for (let y = 0; y + 1 < ny; y++) {
      for (let x = 0, i = 3 * (z * ny + y) * nx; x + 1 < nx; x++, i += 3) {
        for (let axis = 0; axis < 3; axis++) {
          const j = i + strides[axis];
          for (let c = 0; c < 3; c++) {
            m[3 * c + axis] = (c === axis ? 1 : 0) + (values[j + c] - values[i + c]) / spacing[axis];
          }
        }
        const det = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6])
          + m[2] * (m[3] * m[7] - m[4] * m[6]);
        if (det <= 0) return true;
      }
    }
  }
  return false;
}
