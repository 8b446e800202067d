// Cells of the result without visible tissue, so that rays skip them without looking up where anything comes from: for
// each cell a box is found that holds the origins of all of its places, and the blocks of the volume in it are looked
// at. Pure arithmetic; no DOM, no WebGL. Lengths are physical, along the index axes of the volume (its own frame).

import { AXES, perAxis } from "../maths/axes.ts";
import type { Matrix3, Sides, Vector2, Vector3 } from "../types.ts";
import type { CastPlanar, CastSpace, Extremes, SpaceField } from "./types.ts";
import { BLOCK } from "./volume_blocks.ts";

export const CELL = 8,
  QUICK_CELL = 16; // voxels along the edge of a cell; an eighth of them while something moves
const MOST_CELLS = 64; // along an axis: of a box much larger than the volume they are larger
const MOST_RINGS = 250; // a byte holds them
const PLANAR_TILE = 4,
  SPACE_TILE = 2; // nodes along the edge of a tile, whose smallest and largest values are stored
const MARGIN = 0.1; // voxels: GPUs interpolate with few digits

/** The ranges of a planar field's maps over boxes of one size. */
class PlanarRanges {
  knots: number;
  matrix: Matrix3;
  offset: Vector3;
  half: Vector3;
  tiles: Vector2;
  values: Float32Array<ArrayBuffer>;

  /** @param half extents of a box */
  constructor(
    public planar: CastPlanar,
    half: Vector3,
  ) {
    const {
      maps,
      shape: [layers, rows, columns],
      weights,
      count,
      toMap: { matrix, offset },
    } = planar;
    this.knots = weights.length / count;
    const size: Vector3 = [columns, rows, this.knots];
    this.matrix = perAxis((j) => perAxis((i) => matrix[j][i] * size[i])); // to (column, row, knot)
    this.offset = perAxis((i) => offset[i] * size[i] - 0.5);
    this.half = perAxis((i) => AXES.reduce<number>((sum, j) => sum + half[j] * Math.abs(this.matrix[j][i]), 0));
    const tiles = (n: number) => Math.max(1, Math.ceil((n - 1) / PLANAR_TILE));
    this.tiles = [tiles(columns), tiles(rows)];
    this.values = planarTiles(maps, [layers, rows, columns], this.tiles);
    for (const axis of [0, 1] as const) {
      // of all tiles that a box meets, at the first of them: one texture access for each box
      const stride = axis ? 4 * this.tiles[0] : 4,
        most = Math.ceil((2 * this.half[axis]) / PLANAR_TILE);
      this.values = gatherTiles(this.values, stride, this.tiles[axis], most);
    }
  }

  /**
   * Widen a box around `middle` by the displacements of a region in it.
   * @param box low and high along x, y, z
   */
  widen(middle: Vector3, region: number, box: Float64Array) {
    const {
      planar: { count, isReplicated, weights, plane },
      matrix: [mx, my, mz],
      offset,
      half,
      values,
    } = this;
    const [wide, high] = this.tiles;
    const x = middle[0],
      y = middle[1],
      z = middle[2];
    const column = tileOf(mx[0] * x + my[0] * y + mz[0] * z + offset[0] - half[0], PLANAR_TILE, wide);
    const row = tileOf(mx[1] * x + my[1] * y + mz[1] * z + offset[1] - half[1], PLANAR_TILE, high);
    let u0 = 0,
      u1 = 0,
      v0 = 0,
      v1 = 0;
    for (let k = 0; k < count; k++) {
      const i = 4 * (((region * count + k) * high + row) * wide + column);
      const lowU = values[i]!,
        highU = values[i + 1]!,
        lowV = values[i + 2]!,
        highV = values[i + 3]!;
      let w0 = 1,
        w1 = 1;
      if (!isReplicated) {
        const depth = mx[2] * x + my[2] * y + mz[2] * z + offset[2],
          last = this.knots - 1;
        const from = Math.max(0, Math.min(last, Math.floor(depth - half[2])));
        const to = Math.max(0, Math.min(last, Math.ceil(depth + half[2])));
        w0 = Infinity;
        w1 = -Infinity;
        for (let n = from; n <= to; n++) {
          const w = weights[k * this.knots + n]!;
          w0 = Math.min(w0, w);
          w1 = Math.max(w1, w);
        }
      }
      u0 += Math.min(w0 * lowU, w0 * highU, w1 * lowU, w1 * highU);
      u1 += Math.max(w0 * lowU, w0 * highU, w1 * lowU, w1 * highU);
      v0 += Math.min(w0 * lowV, w0 * highV, w1 * lowV, w1 * highV);
      v1 += Math.max(w0 * lowV, w0 * highV, w1 * lowV, w1 * highV);
    }
    for (let i = 0; i < 3; i++) {
      const u = plane.u[i]!,
        v = plane.v[i]!;
      box[i]! += Math.min(u * u0, u * u1) + Math.min(v * v0, v * v1);
      box[3 + i]! += Math.max(u * u0, u * u1) + Math.max(v * v0, v * v1);
    }
  }
}

/** The tile of a node, with those beyond the edge in the outermost ones. */
function tileOf(node: number, edge: number, count: number) {
  return Math.max(0, Math.min(count - 1, Math.floor(node / edge)));
}

/**
 * Smallest (even places) and largest values (odd ones) of every tile and as many as `most` behind it along an axis.
 * @param values four of each tile
 * @param tiles along the axis
 */
function gatherTiles(values: Float32Array, stride: number, tiles: number, most: number) {
  const out = values.slice();
  for (let i = 0; i < values.length; i++) {
    const left = Math.min(most, tiles - 1 - (Math.floor(i / stride) % tiles));
    for (let k = 1; k <= left; k++) {
      const other = values[i + k * stride]!;
      if (i % 2 ? other > out[i]! : other < out[i]!) out[i] = other;
    }
  }
  return out;
}

/**
 * Smallest and largest value of both components in every tile, whose outermost nodes it shares with its neighbours.
 * @param tiles columns and rows of them
 */
function planarTiles(maps: Float32Array, [layers, rows, columns]: Vector3, [wide, high]: Vector2) {
  const out = new Float32Array(4 * layers * high * wide);
  for (let layer = 0, o = 0; layer < layers; layer++) {
    for (let b = 0; b < high; b++) {
      const rowEnd = Math.min(rows - 1, (b + 1) * PLANAR_TILE);
      for (let a = 0; a < wide; a++, o += 4) {
        const end = Math.min(columns - 1, (a + 1) * PLANAR_TILE);
        let lowU = Infinity,
          highU = -Infinity,
          lowV = Infinity,
          highV = -Infinity;
        for (let row = b * PLANAR_TILE; row <= rowEnd; row++) {
          let i = 2 * ((layer * rows + row) * columns + a * PLANAR_TILE);
          for (let column = a * PLANAR_TILE; column <= end; column++, i += 2) {
            const u = maps[i]!,
              v = maps[i + 1]!;
            if (u < lowU) lowU = u;
            if (u > highU) highU = u;
            if (v < lowV) lowV = v;
            if (v > highV) highV = v;
          }
        }
        out[o] = lowU;
        out[o + 1] = highU;
        out[o + 2] = lowV;
        out[o + 3] = highV;
      }
    }
  }
  return out;
}

/** The ranges of a displacement sampled in space, over boxes. */
export class SpaceRanges {
  spacing: Vector3;
  origin: Vector3;
  regions: number;
  tiles: Vector3;
  ranges: Float32Array<ArrayBuffer>[];

  constructor(space: SpaceField) {
    const { shape, spacing, origin, values, cut } = space;
    this.spacing = spacing;
    this.origin = origin;
    this.regions = cut ? cut.regions : 1;
    this.tiles = perAxis((i) => tilesOf(shape[i]));
    const parts = cut ? 4 : 3,
      floats = cut ? halfFloats(values as Uint16Array) : values;
    const each = shape[0] * shape[1] * shape[2] * parts;
    /** Smallest and largest values along x, y, z in every tile of each region. */
    this.ranges = Array.from({ length: this.regions }, (_, r) =>
      spaceTiles(floats.subarray(r * each, (r + 1) * each), shape, parts),
    );
  }

  /**
   * Widen a box by the displacements of a region in it.
   * @param box low and high along x, y, z
   */
  widen(region: number, box: Float64Array) {
    const {
      tiles: [wide, high, deep],
      origin,
      spacing,
      ranges,
    } = this;
    const x0 = tileOf((box[0]! - origin[0]) / spacing[0], SPACE_TILE, wide);
    const x1 = tileOf((box[3]! - origin[0]) / spacing[0], SPACE_TILE, wide);
    const y0 = tileOf((box[1]! - origin[1]) / spacing[1], SPACE_TILE, high);
    const y1 = tileOf((box[4]! - origin[1]) / spacing[1], SPACE_TILE, high);
    const z0 = tileOf((box[2]! - origin[2]) / spacing[2], SPACE_TILE, deep);
    const z1 = tileOf((box[5]! - origin[2]) / spacing[2], SPACE_TILE, deep);
    const own = ranges[region]!,
      moves = MOVES.fill(Infinity, 0, 3).fill(-Infinity, 3);
    for (let z = z0; z <= z1; z++) {
      for (let y = y0; y <= y1; y++) {
        for (let x = x0, i = 6 * ((z * high + y) * wide + x0); x <= x1; x++, i += 6) {
          for (let c = 0; c < 3; c++) {
            if (own[i + c]! < moves[c]!) moves[c] = own[i + c]!;
            if (own[i + 3 + c]! > moves[3 + c]!) moves[3 + c] = own[i + 3 + c]!;
          }
        }
      }
    }
    for (let c = 0; c < 6; c++) box[c]! += moves[c]!;
  }
}

const MOVES = new Float64Array(6); // one for all: an array for each box would take longer than the rest

/**
 * The smallest values of the three components, then the largest, in every tile.
 * @param values [z][y][x][parts]
 */
function spaceTiles(values: Float32Array | Uint16Array, [nx, ny, nz]: Vector3, parts: number) {
  const wide = tilesOf(nx),
    high = tilesOf(ny),
    deep = tilesOf(nz);
  const out = new Float32Array(6 * wide * high * deep);
  let o = 0;
  for (let z = 0; z < deep; z++) {
    const endZ = Math.min(nz - 1, (z + 1) * SPACE_TILE);
    for (let y = 0; y < high; y++) {
      const endY = Math.min(ny - 1, (y + 1) * SPACE_TILE);
      for (let x = 0; x < wide; x++, o += 6) {
        const endX = Math.min(nx - 1, (x + 1) * SPACE_TILE);
        out.fill(Infinity, o, o + 3);
        out.fill(-Infinity, o + 3, o + 6);
        for (let k = z * SPACE_TILE; k <= endZ; k++) {
          for (let j = y * SPACE_TILE; j <= endY; j++) {
            for (let i = x * SPACE_TILE, at = parts * ((k * ny + j) * nx + i); i <= endX; i++, at += parts) {
              for (let c = 0; c < 3; c++) {
                const value = values[at + c]!;
                if (value < out[o + c]!) out[o + c] = value;
                if (value > out[o + 3 + c]!) out[o + 3 + c] = value;
              }
            }
          }
        }
      }
    }
  }
  return out;
}

/** Tiles along an axis of a lattice. */
function tilesOf(nodes: number) {
  return Math.max(1, Math.ceil((nodes - 1) / SPACE_TILE));
}

/** Numbers of half precision. */
function halfFloats(bits: Uint16Array) {
  const known = Float32Array.from({ length: 2 ** 16 }, (_, h) => {
    const exponent = (h >> 10) & 31,
      share = h & 1023,
      sign = h & 0x8000 ? -1 : 1;
    if (exponent === 31) return share ? 0 : sign * Infinity;
    return sign * (exponent ? (1 + share / 1024) * 2 ** (exponent - 15) : share * 2 ** -24);
  });
  return Float32Array.from(bits, (h) => known[h]!);
}

/**
 * Of each cell of a box two bytes: how many rings of cells around it, itself being one, have nothing that is seen, and
 * the largest opacity in it. For a projection of largest values the second is the largest value within one cell of it.
 * @returns `edge`: lengths of a cell's edges
 */
export function emptyCells(
  {
    box,
    shape,
    spacing,
    extremes,
    pairs,
    beyond,
    isLargest,
    voxels,
  }: {
    /** Of the result */
    box: Sides;
    /** Of the volume */
    shape: Vector3;
    spacing: Vector3;
    /** Of its blocks */
    extremes: Extremes;
    /** Of the largest values of the blocks, or of their largest opacities */
    pairs: Uint8Array;
    /** The same outside the volume */
    beyond: number;
    /** Whether largest values are projected */
    isLargest: boolean;
    /** Along the edge of a cell, at least */
    voxels: number;
  },
  { planar, space }: { planar: CastPlanar | null; space: CastSpace | null },
): { size: Vector3; cells: Uint8Array; edge: Vector3 } {
  const lengths = perAxis((i) => box.high[i] - box.low[i]);
  const size = perAxis((i) => Math.max(1, Math.min(MOST_CELLS, Math.ceil(lengths[i] / (voxels * spacing[i]) - 1e-6))));
  const edge = perAxis((i) => Math.max(voxels * spacing[i], lengths[i] / size[i]));
  const half = perAxis((i) => edge[i] / 2);
  const plane = planar && new PlanarRanges(planar, half),
    rest = space?.ranges;
  const regions = planar?.cut ? planar.cut.bits.length : 1,
    later = rest ? rest.regions : 1;
  const margin = planar || space ? MARGIN : 0,
    values = new Uint8Array(size[0] * size[1] * size[2]);
  const middle: Vector3 = [0, 0, 0],
    first = new Float64Array(6),
    last = new Float64Array(6);
  let o = 0;
  for (let z = 0; z < size[2]; z++) {
    middle[2] = box.low[2] + (z + 0.5) * edge[2];
    for (let y = 0; y < size[1]; y++) {
      middle[1] = box.low[1] + (y + 0.5) * edge[1];
      for (let x = 0; x < size[0]; x++, o++) {
        middle[0] = box.low[0] + (x + 0.5) * edge[0];
        let found = 0;
        for (let r = 0; r < regions && found < 255; r++) {
          for (let i = 0; i < 3; i++) {
            first[i] = middle[i]! - half[i]!;
            first[3 + i] = middle[i]! + half[i]!;
          }
          plane?.widen(middle, r, first);
          for (let s = 0; s < later && found < 255; s++) {
            last.set(first);
            rest?.widen(s, last);
            found = Math.max(found, largestIn(last, shape, spacing, margin, extremes.size, pairs, beyond));
          }
        }
        values[o] = found;
      }
    }
  }
  const rings = emptyRings(values, size),
    most = isLargest ? dilate(values, size) : values;
  const cells = new Uint8Array(2 * o);
  for (let i = 0; i < o; i++) {
    cells[2 * i] = rings[i]!;
    cells[2 * i + 1] = most[i]!;
  }
  return { size, edge, cells };
}

/** The largest value of the blocks that a box meets. */
function largestIn(
  box: Float64Array,
  shape: Vector3,
  spacing: Vector3,
  margin: number,
  [nx, ny, nz]: Vector3,
  pairs: Uint8Array,
  beyond: number,
) {
  const x0 = box[0]! / spacing[0] + 0.5 - margin,
    x1 = box[3]! / spacing[0] + 0.5 + margin;
  const y0 = box[1]! / spacing[1] + 0.5 - margin,
    y1 = box[4]! / spacing[1] + 0.5 + margin;
  const z0 = box[2]! / spacing[2] + 0.5 - margin,
    z1 = box[5]! / spacing[2] + 0.5 + margin;
  const isBeyond = x0 < 0 || y0 < 0 || z0 < 0 || x1 > shape[0] || y1 > shape[1] || z1 > shape[2];
  let most = isBeyond ? beyond : 0;
  const small = 1e-5; // of a block: a cell that ends where a block does is not in the next one
  const a0 = Math.max(0, Math.floor(x0 / BLOCK + small)),
    a1 = Math.min(nx, Math.ceil(x1 / BLOCK - small));
  const b0 = Math.max(0, Math.floor(y0 / BLOCK + small)),
    b1 = Math.min(ny, Math.ceil(y1 / BLOCK - small));
  const c0 = Math.max(0, Math.floor(z0 / BLOCK + small)),
    c1 = Math.min(nz, Math.ceil(z1 / BLOCK - small));
  for (let c = c0; c < c1; c += 2) {
    const slice = Math.max(c0, Math.min(c, c1 - 2)) * ny;
    for (let b = b0; b < b1; b += 2) {
      const line = (slice + Math.max(b0, Math.min(b, b1 - 2))) * nx;
      for (let a = a0; a < a1; a += 2) {
        const value = pairs[line + Math.max(a0, Math.min(a, a1 - 2))]!;
        if (value > most) most = value;
      }
    }
  }
  return most;
}

/**
 * The largest value of each block and its next neighbours along the three axes and between them: eight blocks. A box
 * that meets fewer than two blocks along an axis gets the neighbour's as well.
 */
export function blockPairs(blocks: Uint8Array, size: Vector3) {
  let from = blocks;
  for (const axis of AXES) {
    const stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1],
      n = size[axis],
      to = from.slice();
    for (let i = 0; i < from.length; i++) {
      if (Math.floor(i / stride) % n < n - 1 && from[i + stride]! > to[i]!) to[i] = from[i + stride]!;
    }
    from = to;
  }
  return from;
}

/**
 * The number of rings of cells that are 0, itself being one; a sweep forth and one back find the distance in the
 * largest of the three coordinates (Rosenfeld and Pfaltz 1966).
 */
export function emptyRings(values: Uint8Array, [nx, ny, nz]: Vector3) {
  const [row, slice] = [nx + 2, (nx + 2) * (ny + 2)],
    wide = new Uint8Array(slice * (nz + 2)).fill(MOST_RINGS);
  const before = new Int32Array(13);
  before.set([-row - slice, -slice, row - slice, -row].flatMap((line) => [line - 1, line, line + 1]));
  before[12] = -1;
  for (let z = 0, i = 0; z < nz; z++) {
    for (let y = 0; y < ny; y++) {
      for (let at = (z + 1) * slice + (y + 1) * row + 1, end = at + nx; at < end; at++, i++) {
        let least = MOST_RINGS - 1;
        if (values[i]) least = -1;
        else for (let k = 0; k < 13; k++) if (wide[at + before[k]!]! < least) least = wide[at + before[k]!]!;
        wide[at] = least + 1;
      }
    }
  }
  const out = new Uint8Array(values.length);
  for (let z = nz - 1, i = out.length - 1; z >= 0; z--) {
    for (let y = ny - 1; y >= 0; y--) {
      for (let at = (z + 1) * slice + (y + 1) * row + nx, end = at - nx; at > end; at--, i--) {
        let least = wide[at]! - 1;
        for (let k = 0; k < 13; k++) if (wide[at - before[k]!]! < least) least = wide[at - before[k]!]!;
        out[i] = wide[at] = least + 1;
      }
    }
  }
  return out;
}

/** The largest of every value and its 26 neighbours. */
function dilate(values: Uint8Array, size: Vector3) {
  let from = values;
  for (const axis of AXES) {
    const stride = axis === 0 ? 1 : axis === 1 ? size[0] : size[0] * size[1],
      n = size[axis],
      to = from.slice();
    for (let i = 0; i < from.length; i++) {
      const place = Math.floor(i / stride) % n;
      if (place > 0 && from[i - stride]! > to[i]!) to[i] = from[i - stride]!;
      if (place < n - 1 && from[i + stride]! > to[i]!) to[i] = from[i + stride]!;
    }
    from = to;
  }
  return from;
}
