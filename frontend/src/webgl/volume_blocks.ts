// Gradients, empty blocks, ambient light and steepness of a volume and its displacement, computed before it is drawn.
// Pure arithmetic on arrays [z][y][x] of bytes; no DOM, no WebGL.

import { AMBIENT_AHEAD, AMBIENT_CELL, AMBIENT_EVEN, AMBIENT_FAR, AMBIENT_NEAR } from "../generated.ts";
import { AXES, perAxis } from "../maths/axes.ts";

import type { Vector2, Vector3 } from "../types.ts";
import type { Extremes } from "./types.ts";

/** A slice, and which of its rows are smoothed background */
export type Smoothed<Sums> = { sums: Sums; empty: Uint8Array };

export const BLOCK = 4; // voxels along the edge of a block

// Slope in grey levels per voxel that one byte holds at most; steeper ones keep their direction. Air to bone in one
// voxel is 127, but a surface that steep is as certain as one of 64, and half the range doubles the digits of faint
// ones.
export const STEEPEST = 64;

/** Entries of a table of colours for each byte (see TransferFunction.table). */
function entriesOfByte(entries: number) {
  return (entries - 1) / 255;
}

/** The opacity that such a table, red, green, blue and alpha of each entry, has for a byte or a value between bytes. */
export function opacityOfByte(rgba: Float32Array, byte: number) {
  return rgba[4 * Math.round(entriesOfByte(rgba.length / 4) * byte) + 3]!;
}

const NEXT = [-2, -1, 0, 1, 2] as const; // the rows, or slices, that are smoothed together
type Five<T> = [T, T, T, T, T];
const SMOOTHED = 4096; // sum of the weights 1 4 6 4 1 along three axes

/**
 * Gradient (RGB, 128 is zero) and value (A) of a volume, slab by slab from the first slice on, for a texture with four
 * bytes a voxel. Gradients are differences of the volume smoothed by 1 4 6 4 1: those of its own values follow the steps
 * between slices, and surfaces resemble carved wood; with 1 2 1 a skull still has rings where it is nearly parallel to
 * the slices. Beyond the edge is the background, so that a body that is cut off there has a lit face; rows of
 * background amid background need no arithmetic.
 */
export class GradientSlabs {
  scales: Vector3;
  /** Along x and y, those that the next slab needs too */
  flat = new Map<number, Smoothed<Uint16Array>>();
  /** Along all axes, with one voxel of background on each side */
  smooth = new Map<number, Smoothed<Uint32Array>>();
  beyond: { sums: Uint32Array<ArrayBuffer>; empty: Uint8Array<ArrayBuffer> };
  along: Uint16Array<ArrayBuffer>;

  /** @param fill the value of the background */
  constructor(
    readonly values: Uint8Array<ArrayBufferLike>,
    readonly shape: Vector3,
    spacing: Vector3,
    readonly fill: number,
  ) {
    const finest = Math.min(...spacing),
      unit = 127 / STEEPEST / 2 / SMOOTHED;
    this.scales = perAxis((i) => (unit * finest) / spacing[i]);
    const [nx, ny] = shape;
    this.beyond = {
      sums: new Uint32Array((nx + 2) * (ny + 2)).fill(SMOOTHED * fill),
      empty: new Uint8Array(ny + 2).fill(1),
    };
    this.along = new Uint16Array(nx * ny);
  }

  /** The bytes of the slices z0 <= z < z1. */
  slab(z0: number, z1: number) {
    const { values, fill } = this,
      [nx, ny] = this.shape,
      row = nx + 2,
      [sx, sy, sz] = this.scales;
    const out = new Uint8Array(4 * nx * ny * (z1 - z0)),
      voxels = new Uint32Array(out.buffer);
    const background = new Uint32Array(Uint8Array.of(128, 128, 128, fill).buffer)[0]!;
    for (let z = z0; z < z1; z++) {
      const { sums: front, empty: isFront } = this.#smoothSlice(z - 1),
        { sums: here, empty: isHere } = this.#smoothSlice(z);
      const { sums: back, empty: isBack } = this.#smoothSlice(z + 1);
      for (let y = 0; y < ny; y++) {
        const from = (z * ny + y) * nx,
          to = ((z - z0) * ny + y) * nx;
        if (isFront[y + 1] && isHere[y] && isHere[y + 1] && isHere[y + 2] && isBack[y + 1]) {
          voxels.fill(background, to, to + nx);
          continue;
        }
        for (let x = 0, i = (y + 1) * row + 1, o = 4 * to; x < nx; x++, i++, o += 4) {
          let gx = (here[i + 1]! - here[i - 1]!) * sx,
            gy = (here[i + row]! - here[i - row]!) * sy;
          let gz = (back[i]! - front[i]!) * sz;
          const most = Math.max(Math.abs(gx), Math.abs(gy), Math.abs(gz));
          if (most > 127) {
            const k = 127 / most;
            gx *= k;
            gy *= k;
            gz *= k;
          }
          out[o] = 128.5 + gx;
          out[o + 1] = 128.5 + gy;
          out[o + 2] = 128.5 + gz;
          out[o + 3] = values[from + x]!;
        }
      }
    }
    for (const kept of [this.flat, this.smooth]) for (const z of kept.keys()) if (z < z1 - 2) kept.delete(z);
    return out;
  }

  #smoothSlice(z: number) {
    const [nx, ny, nz] = this.shape;
    if (z < 0 || z >= nz) return this.beyond;
    const known = this.smooth.get(z);
    if (known) return known;
    const near = NEXT.map((k) => this.#flat(Math.max(0, Math.min(nz - 1, z + k))));
    const [a, b, c, d, e] = near.map(({ sums }) => sums) as Five<Uint16Array>;
    const made = { sums: this.beyond.sums.slice(), empty: this.beyond.empty.slice() },
      { sums } = made;
    for (let y = 0; y < ny; y++) {
      if (near.every(({ empty }) => empty[y])) continue;
      made.empty[y + 1] = 0;
      for (let x = 0, i = y * nx, o = (y + 1) * (nx + 2) + 1; x < nx; x++, i++, o++) {
        sums[o] = a[i]! + e[i]! + 4 * (b[i]! + d[i]!) + 6 * c[i]!;
      }
    }
    this.smooth.set(z, made);
    return made;
  }

  #flat(z: number) {
    const known = this.flat.get(z);
    if (known) return known;
    const { values, along, fill } = this,
      [nx, ny] = this.shape,
      isEmpty = new Uint8Array(ny);
    for (let y = 0; y < ny; y++) {
      const start = (z * ny + y) * nx,
        end = start + nx,
        row = y * nx - start;
      let i = start;
      while (i < end && values[i] === fill) i++;
      if (i === end) {
        isEmpty[y] = 1;
        along.fill(16 * fill, start + row, end + row);
        continue;
      }
      // Beyond the edge of a slice is the voxel at the edge.
      let a = values[start]!,
        b = a,
        c = a,
        d = values[Math.min(start + 1, end - 1)]!;
      for (i = start; i < end; i++) {
        const e = values[i + 2 < end ? i + 2 : end - 1]!;
        along[row + i] = a + e + 4 * (b + d) + 6 * c;
        a = b;
        b = c;
        c = d;
        d = e;
      }
    }
    const made = { sums: new Uint16Array(nx * ny), empty: new Uint8Array(ny) },
      { sums, empty } = made;
    for (let y = 0; y < ny; y++) {
      const rows = NEXT.map((k) => Math.max(0, Math.min(ny - 1, y + k)));
      const [a, b, c, d, e] = rows.map((r) => r * nx) as Five<number>;
      if (rows.every((r) => isEmpty[r])) {
        empty[y] = 1;
        sums.fill(256 * fill, c, c + nx);
        continue;
      }
      for (let x = 0; x < nx; x++) {
        sums[c + x] = along[a + x]! + along[e + x]! + 4 * (along[b + x]! + along[d + x]!) + 6 * along[c + x]!;
      }
    }
    this.flat.set(z, made);
    return made;
  }
}

/** Smallest and largest value of every block and the voxels next to it, which interpolation may mix in. */
export function blockExtremes(values: Uint8Array, shape: Vector3): Extremes {
  const size: Vector3 = [...shape];
  let low = values,
    high = values;
  for (const axis of AXES) {
    const stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1];
    const n = size[axis],
      m = Math.ceil(n / BLOCK);
    const rest = (size[0] * size[1] * size[2]) / n;
    const nextLow = new Uint8Array(rest * m),
      nextHigh = new Uint8Array(rest * m);
    const outer = rest / stride;
    for (let a = 0; a < outer; a++) {
      for (let b = 0; b < m; b++) {
        const first = Math.max(0, b * BLOCK - 1),
          last = Math.min(n - 1, (b + 1) * BLOCK);
        for (let c = 0; c < stride; c++) {
          let lo = 255,
            hi = 0;
          for (let k = first; k <= last; k++) {
            const at = (a * n + k) * stride + c;
            if (low[at]! < lo) lo = low[at]!;
            if (high[at]! > hi) hi = high[at]!;
          }
          const to = (a * m + b) * stride + c;
          nextLow[to] = lo;
          nextHigh[to] = hi;
        }
      }
    }
    low = nextLow;
    high = nextHigh;
    size[axis] = m;
  }
  return { size, low, high };
}

export const OPACITY_SHARE = 0.25; // opacity of 255 and more, since rays take small steps through all that is denser

/**
 * The largest opacity of every block, in units of OPACITY_SHARE / 255 and rounded up: 0 only where nothing stops light.
 * @param alphas of the entries of a table of colours
 */
export function blockOpacities({ low, high }: Extremes, alphas: Float32Array) {
  const each = entriesOfByte(alphas.length),
    known = new Int16Array(65536).fill(-1);
  return low.map((least, i) => {
    const key = 256 * least + high[i]!;
    if (known[key]! < 0) {
      let most = 0;
      for (let k = each * least; k <= each * high[i]!; k++) most = Math.max(most, alphas[k]!);
      known[key] = Math.min(255, Math.ceil((255 * most) / OPACITY_SHARE));
    }
    return known[key]!;
  });
}

/** The light that reaches every cell, 255 all: see ambient_light in imaging/occlusion.py. */
export function ambientLight(values: Uint8Array, shape: Vector3, alphas: Float32Array, thickness: number) {
  const [nx, ny, nz] = shape,
    cells = (n: number) => Math.ceil(n / AMBIENT_CELL);
  const size: Vector3 = [cells(nx), cells(ny), cells(nz)];
  const sum = new Float32Array(size[0] * size[1] * size[2]);
  const opacity = new Float32Array(256),
    each = entriesOfByte(alphas.length);
  for (let i = 0; i < 256; i++) opacity[i] = 1 - (1 - Math.min(alphas[each * i]!, 0.999)) ** thickness;
  for (let z = 0, i = 0; z < nz; z++) {
    for (let y = 0; y < ny; y++) {
      let cell = (Math.floor(z / AMBIENT_CELL) * size[1] + Math.floor(y / AMBIENT_CELL)) * size[0];
      for (let x = 0; x < nx; cell++) {
        const end = Math.min(nx, x + AMBIENT_CELL);
        let total = 0;
        for (; x < end; x++, i++) total += opacity[values[i]!]!;
        sum[cell]! += total;
      }
    }
  }
  const along = (n: number, k: number) => Math.min(AMBIENT_CELL, n - AMBIENT_CELL * k);
  for (let k = 0; k < sum.length; k++) {
    const x = k % size[0],
      y = Math.floor(k / size[0]) % size[1],
      z = Math.floor(k / size[0] / size[1]);
    sum[k]! /= along(nx, x) * along(ny, y) * along(nz, z);
  }
  const [close, strength] = AMBIENT_NEAR,
    [wide, strengthFar] = AMBIENT_FAR;
  const near = blur(sum, size, close),
    far = blur(blur(near, size, wide), size, wide);
  const out = new Uint8Array(sum.length);
  visitForward(near, size, (k, at, share) => {
    const stopped = strength * between(near, size, at, share) + strengthFar * between(far, size, at, share);
    out[k] = 255 * Math.exp(-stopped);
  });
  return { size, values: out };
}

/**
 * Visit every cell k with the place in front of it, where opacity falls: the cell (x, y, z) before that place and how
 * far it is beyond that. Both arrays are the same ones at every visit: new ones would take most of the time.
 */
function visitForward(values: Float32Array, size: Vector3, visit: (k: number, at: Vector3, share: Vector3) => void) {
  const [nx, ny] = size,
    strides: Vector3 = [1, nx, nx * ny];
  const cell: Vector3 = [0, 0, 0],
    at: Vector3 = [0, 0, 0],
    slope: Vector3 = [0, 0, 0],
    share: Vector3 = [0, 0, 0];
  for (let k = 0; k < values.length; k++) {
    cell[0] = k % nx;
    cell[1] = Math.floor(k / nx) % ny;
    cell[2] = Math.floor(k / strides[2]);
    let squares = 0;
    for (const axis of AXES) {
      const after = cell[axis] + 1 < size[axis] ? values[k + strides[axis]]! : 0;
      slope[axis] = (after - (cell[axis] > 0 ? values[k - strides[axis]]! : 0)) / 2;
      squares += slope[axis] ** 2;
    }
    const scale = AMBIENT_AHEAD / Math.max(Math.sqrt(squares), AMBIENT_EVEN);
    for (const axis of AXES) {
      const place = cell[axis] - scale * slope[axis];
      at[axis] = Math.floor(place);
      share[axis] = place - at[axis];
    }
    visit(k, at, share);
  }
}

/**
 * Linear interpolation between cells; 0 beyond them.
 * @param at (x, y, z) of the cell before the place
 * @param share of the distance to the next one along each axis
 */
function between(values: Float32Array, size: Vector3, at: Vector3, share: Vector3) {
  const nx = size[0],
    ny = size[1],
    nz = size[2];
  let sum = 0;
  for (let dz = 0; dz < 2; dz++) {
    const z = at[2] + dz;
    if (z < 0 || z >= nz) continue;
    for (let dy = 0; dy < 2; dy++) {
      const y = at[1] + dy,
        x = at[0];
      if (y < 0 || y >= ny) continue;
      const line = (z * ny + y) * nx;
      const low = x >= 0 && x < nx ? values[line + x]! : 0,
        high = x >= -1 && x + 1 < nx ? values[line + x + 1]! : 0;
      sum += (dz ? share[2] : 1 - share[2]) * (dy ? share[1] : 1 - share[1]) * (low + share[0] * (high - low));
    }
  }
  return sum;
}

/** Running mean over 2 r + 1 cells along every axis; beyond the edge nothing stops light. */
function blur(values: Float32Array, size: Vector3, r: number) {
  let from = values;
  for (const axis of AXES) {
    const to = new Float32Array(from.length),
      stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1];
    const n = size[axis];
    for (let start = 0; start < from.length; start++) {
      if (Math.floor(start / stride) % n !== 0) continue;
      let total = 0;
      for (let k = 0; k < Math.min(r, n); k++) total += from[start + k * stride]!;
      for (let k = 0; k < n; k++) {
        if (k + r < n) total += from[start + (k + r) * stride]!;
        if (k - r - 1 >= 0) total -= from[start + (k - r - 1) * stride]!;
        to[start + k * stride] = total / (2 * r + 1);
      }
    }
    from = to;
  }
  return from;
}

/** The largest change per length of the displacement of each of maps [k][row][column][2]. */
export function planarSlopes(maps: Float32Array, [count, rows, columns]: Vector3, [da, db]: Vector2) {
  const steep = new Float64Array(count);
  for (let k = 0, i = 0; k < count; k++) {
    let steepest = 0; // squared: a root for each node would take ten times as long
    for (let r = 0; r < rows; r++) {
      for (let c = 0; c < columns; c++, i += 2) {
        const u = maps[i]!,
          v = maps[i + 1]!,
          east = i + (c < columns - 1 ? 2 : 0);
        const south = i + (r < rows - 1 ? 2 * columns : 0);
        const ua = (maps[east]! - u) / da,
          va = (maps[east + 1]! - v) / da;
        const ub = (maps[south]! - u) / db,
          vb = (maps[south + 1]! - v) / db;
        steepest = Math.max(steepest, ua * ua + va * va + ub * ub + vb * vb);
      }
    }
    steep[k] = Math.sqrt(steepest);
  }
  return steep;
}

/** The largest change per length of a displacement sampled in space, [z][y][x][3]. */
export function spaceSlope(values: Float32Array, [nx, ny, nz]: Vector3, spacing: Vector3) {
  const strides: Vector3 = [3, 3 * nx, 3 * nx * ny];
  let steepest = 0;
  for (let z = 0, i = 0; z < nz; z++) {
    for (let y = 0; y < ny; y++) {
      for (let x = 0; x < nx; x++, i += 3) {
        let total = 0;
        for (const axis of AXES) {
          if (axis === 0 ? x < nx - 1 : axis === 1 ? y < ny - 1 : z < nz - 1) {
            const j = i + strides[axis];
            total +=
              ((values[j]! - values[i]!) ** 2 +
                (values[j + 1]! - values[i + 1]!) ** 2 +
                (values[j + 2]! - values[i + 2]!) ** 2) /
              spacing[axis] ** 2;
          }
        }
        if (total > steepest) steepest = total;
      }
    }
  }
  return Math.sqrt(steepest);
}
