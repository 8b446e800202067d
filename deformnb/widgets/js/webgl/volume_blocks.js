// Gradients, empty blocks, ambient light and steepness of a volume and its displacement, computed before it is drawn.
// Pure arithmetic on arrays [z][y][x] of bytes; no DOM, no WebGL.

import { AMBIENT_AHEAD, AMBIENT_CELL, AMBIENT_EVEN, AMBIENT_FAR, AMBIENT_NEAR } from "../maths/constants.js";

/** @import { Vector2, Vector3 } from "../types.d.ts" */
/** @import { Extremes } from "./types.d.ts" */

export const BLOCK = 4; // voxels along the edge of a block

// Slope in grey levels per voxel that one byte holds at most; steeper ones keep their direction. Air to bone in one
// voxel is 127, but a surface that steep is as certain as one of 64, and half the range doubles the digits of faint
// ones.
export const STEEPEST = 64;

/**
 * Entries of a table of colours for each byte (see TransferFunction.table).
 * @param {number} entries
 */
function entriesOfByte(entries) { return (entries - 1) / 255; }

/**
 * The opacity that such a table, red, green, blue and alpha of each entry, has for a byte.
 * @param {Float32Array} rgba
 * @param {number} byte
 */
export function opacityOfByte(rgba, byte) { return rgba[4 * entriesOfByte(rgba.length / 4) * byte + 3]; }

/**
 * Weighted sums 1 4 6 4 1 of neighbours along x and y of a slice; beyond the edge lies the voxel at the edge.
 * @param {Uint8Array} values
 * @param {Vector3} shape
 * @param {number} z
 */
function smoothedSlice(values, [nx, ny], z) {
  const along = new Uint16Array(nx * ny), out = new Uint16Array(nx * ny), line = new Uint8Array(nx + 4);
  for (let y = 0; y < ny; y++) {
    const start = (z * ny + y) * nx, row = y * nx;
    line.set(values.subarray(start, start + nx), 2);
    line[0] = line[1] = line[2];
    line[nx + 2] = line[nx + 3] = line[nx + 1];
    for (let x = 0; x < nx; x++) {
      along[row + x] = line[x] + line[x + 4] + 4 * (line[x + 1] + line[x + 3]) + 6 * line[x + 2];
    }
  }
  for (let y = 0; y < ny; y++) {
    const [a, b, c, d, e] = [-2, -1, 0, 1, 2].map((k) => Math.max(0, Math.min(ny - 1, y + k)) * nx);
    for (let x = 0; x < nx; x++) {
      out[c + x] = along[a + x] + along[e + x] + 4 * (along[b + x] + along[d + x]) + 6 * along[c + x];
    }
  }
  return out;
}

const SMOOTHED = 4096; // sum of the weights 1 4 6 4 1 along three axes

/**
 * Gradient (RGB, 128 is zero) and value (A) of the slices z0 <= z < z1, for a texture with four bytes a voxel. Gradients
 * are differences of a volume that is smoothed by 1 4 6 4 1: those of its own values follow the steps between slices, and
 * surfaces look like carved wood; with 1 2 1 a skull still has rings where it is nearly parallel to the slices.
 * @param {Uint8Array} values
 * @param {Vector3} shape
 * @param {number} z0
 * @param {number} z1
 * @param {Vector3} spacing
 * @param {number} fill
 */
export function gradientSlab(values, shape, z0, z1, spacing, fill) {
  const [nx, ny, nz] = shape, row = nx, slice = nx * ny;
  const out = new Uint8Array(4 * slice * (z1 - z0));
  const finest = Math.min(...spacing), unit = 127 / STEEPEST / 2 / SMOOTHED;
  const [sx, sy, sz] = spacing.map((s) => (unit * finest) / s), outside = SMOOTHED * fill;
  const inside = (/** @type {number} */ z) => Math.max(0, Math.min(nz - 1, z));
  /** @type {Map<number, Uint16Array>} */
  const flat = new Map();
  /** @type {Map<number, Uint32Array>} */
  const smooth = new Map();
  for (let z = inside(z0 - 3); z <= inside(z1 + 2); z++) flat.set(z, smoothedSlice(values, shape, z));
  const of = (/** @type {number} */ z) => /** @type {Uint16Array} */ (flat.get(inside(z)));
  for (let z = inside(z0 - 1); z <= inside(z1); z++) {
    const [a, b, c, d, e] = [-2, -1, 0, 1, 2].map((k) => of(z + k)), sum = new Uint32Array(slice);
    for (let i = 0; i < slice; i++) sum[i] = a[i] + e[i] + 4 * (b[i] + d[i]) + 6 * c[i];
    smooth.set(z, sum);
  }
  const plain = new Uint32Array(slice).fill(outside);
  let o = 0;
  for (let z = z0; z < z1; z++) {
    // Beyond the edge lies the background, so that a body that is cut off there has a lit face.
    const front = smooth.get(z - 1) ?? plain, here = /** @type {Uint32Array} */ (smooth.get(z));
    const back = smooth.get(z + 1) ?? plain;
    for (let y = 0; y < ny; y++) {
      const top = y > 0, bottom = y < ny - 1;
      for (let x = 0, i = y * row; x < nx; x++, i++, o += 4) {
        let gx = ((x < nx - 1 ? here[i + 1] : outside) - (x > 0 ? here[i - 1] : outside)) * sx;
        let gy = ((bottom ? here[i + row] : outside) - (top ? here[i - row] : outside)) * sy;
        let gz = (back[i] - front[i]) * sz;
        const most = Math.max(Math.abs(gx), Math.abs(gy), Math.abs(gz));
        if (most > 127) { const k = 127 / most; gx *= k; gy *= k; gz *= k; }
        out[o] = 128.5 + gx; out[o + 1] = 128.5 + gy; out[o + 2] = 128.5 + gz; out[o + 3] = values[z * slice + i];
      }
    }
  }
  return out;
}

/**
 * Smallest and largest value of every block and the voxels next to it, which interpolation may mix in.
 * @param {Uint8Array} values
 * @param {Vector3} shape
 * @returns {Extremes}
 */
export function blockExtremes(values, shape) {
  /** @type {Vector3} */
  const size = [...shape];
  let low = values, high = values;
  for (let axis = 0; axis < 3; axis++) {
    const stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1];
    const n = size[axis], m = Math.ceil(n / BLOCK);
    const rest = size[0] * size[1] * size[2] / n;
    const nextLow = new Uint8Array(rest * m), nextHigh = new Uint8Array(rest * m);
    const outer = rest / stride;
    for (let a = 0; a < outer; a++) {
      for (let b = 0; b < m; b++) {
        const first = Math.max(0, b * BLOCK - 1), last = Math.min(n - 1, (b + 1) * BLOCK);
        for (let c = 0; c < stride; c++) {
          let lo = 255, hi = 0;
          for (let k = first; k <= last; k++) {
            const at = (a * n + k) * stride + c;
            if (low[at] < lo) lo = low[at];
            if (high[at] > hi) hi = high[at];
          }
          const to = (a * m + b) * stride + c;
          nextLow[to] = lo; nextHigh[to] = hi;
        }
      }
    }
    low = nextLow; high = nextHigh; size[axis] = m;
  }
  return { size, low, high };
}

export const OPACITY_SHARE = 0.25; // opacity of 255 and more, since rays take small steps through all that is denser

/**
 * The largest opacity of every block, in units of OPACITY_SHARE / 255 and rounded up: 0 only where nothing stops light.
 * @param {Extremes} extremes
 * @param {Float32Array} alphas of the entries of a table of colours
 */
export function blockOpacities({ low, high }, alphas) {
  const each = entriesOfByte(alphas.length), known = new Int16Array(65536).fill(-1);
  return Uint8Array.from(low, (least, i) => {
    const key = 256 * least + high[i];
    if (known[key] < 0) {
      let most = 0;
      for (let k = each * least; k <= each * high[i]; k++) most = Math.max(most, alphas[k]);
      known[key] = Math.min(255, Math.ceil((255 * most) / OPACITY_SHARE));
    }
    return known[key];
  });
}

/**
 * The light that reaches every cell, 255 all: see ambient_light in imaging/occlusion.py.
 * @param {Uint8Array} values
 * @param {Vector3} shape
 * @param {Float32Array} alphas
 * @param {number} thickness
 */
export function ambientLight(values, shape, alphas, thickness) {
  const [nx, ny, nz] = shape, cells = (/** @type {number} */ n) => Math.ceil(n / AMBIENT_CELL);
  /** @type {Vector3} */
  const size = [cells(nx), cells(ny), cells(nz)];
  const sum = new Float32Array(size[0] * size[1] * size[2]), count = new Float32Array(sum.length);
  const opacity = new Float32Array(256), each = entriesOfByte(alphas.length);
  for (let i = 0; i < 256; i++) opacity[i] = 1 - (1 - Math.min(alphas[each * i], 0.999)) ** thickness;
  const cellOf = Uint32Array.from({ length: Math.max(...shape) }, (_, n) => Math.floor(n / AMBIENT_CELL));
  let i = 0;
  for (let z = 0; z < nz; z++) {
    for (let y = 0; y < ny; y++) {
      const line = (cellOf[z] * size[1] + cellOf[y]) * size[0];
      for (let x = 0; x < nx; x++, i++) { sum[line + cellOf[x]] += opacity[values[i]]; count[line + cellOf[x]] += 1; }
    }
  }
  for (let k = 0; k < sum.length; k++) sum[k] /= count[k];
  const [[close, strength], [wide, strengthFar]] = [AMBIENT_NEAR, AMBIENT_FAR];
  const near = blurred(sum, size, close), far = blurred(blurred(near, size, wide), size, wide);
  const out = new Uint8Array(sum.length);
  aheadOf(near, size, (k, at, share) => {
    const stopped = strength * between(near, size, at, share) + strengthFar * between(far, size, at, share);
    out[k] = 255 * Math.exp(-stopped);
  });
  return { size, values: out };
}

/**
 * Visits every cell k with the place in front of it, where opacity falls: the cell (x, y, z) before that place and how
 * far it lies beyond that. Both arrays are the same ones at every visit: new ones would take most of the time.
 * @param {Float32Array} values
 * @param {Vector3} size
 * @param {(k: number, at: Int32Array, share: Float64Array) => void} visit
 */
function aheadOf(values, size, visit) {
  const [nx, ny] = size, strides = [1, nx, nx * ny];
  const cell = new Int32Array(3), at = new Int32Array(3), slope = new Float64Array(3), share = new Float64Array(3);
  for (let k = 0; k < values.length; k++) {
    cell[0] = k % nx; cell[1] = Math.floor(k / nx) % ny; cell[2] = Math.floor(k / strides[2]);
    let squares = 0;
    for (let axis = 0; axis < 3; axis++) {
      const after = cell[axis] + 1 < size[axis] ? values[k + strides[axis]] : 0;
      slope[axis] = (after - (cell[axis] > 0 ? values[k - strides[axis]] : 0)) / 2;
      squares += slope[axis] ** 2;
    }
    const scale = AMBIENT_AHEAD / Math.max(Math.sqrt(squares), AMBIENT_EVEN);
    for (let axis = 0; axis < 3; axis++) {
      const place = cell[axis] - scale * slope[axis];
      at[axis] = Math.floor(place);
      share[axis] = place - at[axis];
    }
    visit(k, at, share);
  }
}

/**
 * Linear interpolation between cells; 0 beyond them.
 * @param {Float32Array} values
 * @param {Vector3} size
 * @param {Int32Array} at (x, y, z) of the cell before the place
 * @param {Float64Array} share of the way to the next one along each axis
 */
function between(values, size, at, share) {
  const nx = size[0], ny = size[1], nz = size[2];
  let sum = 0;
  for (let dz = 0; dz < 2; dz++) {
    const z = at[2] + dz;
    if (z < 0 || z >= nz) continue;
    for (let dy = 0; dy < 2; dy++) {
      const y = at[1] + dy, x = at[0];
      if (y < 0 || y >= ny) continue;
      const line = (z * ny + y) * nx;
      const low = x >= 0 && x < nx ? values[line + x] : 0, high = x >= -1 && x + 1 < nx ? values[line + x + 1] : 0;
      sum += (dz ? share[2] : 1 - share[2]) * (dy ? share[1] : 1 - share[1]) * (low + share[0] * (high - low));
    }
  }
  return sum;
}

/**
 * Running mean over 2 r + 1 cells along every axis; beyond the edge nothing stops light.
 * @param {Float32Array} values
 * @param {Vector3} size
 * @param {number} r
 */
function blurred(values, size, r) {
  let from = values;
  for (let axis = 0; axis < 3; axis++) {
    const to = new Float32Array(from.length), stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1];
    const n = size[axis];
    for (let start = 0; start < from.length; start++) {
      if (Math.floor(start / stride) % n !== 0) continue;
      let total = 0;
      for (let k = 0; k < Math.min(r, n); k++) total += from[start + k * stride];
      for (let k = 0; k < n; k++) {
        if (k + r < n) total += from[start + (k + r) * stride];
        if (k - r - 1 >= 0) total -= from[start + (k - r - 1) * stride];
        to[start + k * stride] = total / (2 * r + 1);
      }
    }
    from = to;
  }
  return from;
}

/**
 * The largest change per length of the displacement of each of maps [k][row][column][2].
 * @param {Float32Array} maps
 * @param {Vector3} shape
 * @param {Vector2} spacing
 */
export function planarSlopes(maps, [count, rows, columns], [da, db]) {
  const steep = new Float64Array(count);
  for (let k = 0, i = 0; k < count; k++) {
    let steepest = 0; // squared: a root for each node would take ten times as long
    for (let r = 0; r < rows; r++) {
      for (let c = 0; c < columns; c++, i += 2) {
        const u = maps[i], v = maps[i + 1], east = i + (c < columns - 1 ? 2 : 0);
        const south = i + (r < rows - 1 ? 2 * columns : 0);
        const ua = (maps[east] - u) / da, va = (maps[east + 1] - v) / da;
        const ub = (maps[south] - u) / db, vb = (maps[south + 1] - v) / db;
        steepest = Math.max(steepest, ua * ua + va * va + ub * ub + vb * vb);
      }
    }
    steep[k] = Math.sqrt(steepest);
  }
  return steep;
}

/**
 * The largest change per length of a displacement sampled in space, [z][y][x][3].
 * @param {Float32Array} values
 * @param {Vector3} shape
 * @param {Vector3} spacing
 */
export function spaceSlope(values, [nx, ny, nz], spacing) {
  const strides = [3, 3 * nx, 3 * nx * ny];
  let steepest = 0;
  for (let z = 0, i = 0; z < nz; z++) {
    for (let y = 0; y < ny; y++) {
      for (let x = 0; x < nx; x++, i += 3) {
        let total = 0;
        for (let axis = 0; axis < 3; axis++) {
          if ([x < nx - 1, y < ny - 1, z < nz - 1][axis]) {
            const j = i + strides[axis];
            total += ((values[j] - values[i]) ** 2 + (values[j + 1] - values[i + 1]) ** 2
              + (values[j + 2] - values[i + 2]) ** 2) / spacing[axis] ** 2;
          }
        }
        if (total > steepest) steepest = total;
      }
    }
  }
  return Math.sqrt(steepest);
}
