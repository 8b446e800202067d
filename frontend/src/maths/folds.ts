// The folds of a map, and its changes of areas, on lattices over the picture.
//
// det J is that of the backward map x + D(x): 1 keeps areas, 1/2 is tissue twice as large, and at 0 the map folds.

import { NEARLY_FOLDED } from "../generated.ts";
import type { Fit, LayeredFit, Numbers6, Raster, RbfFit, ReadyPart, Vector2, Vector4 } from "../types.ts";
import { chosenPlace, layersOnRaster, placeOf } from "./cuts.ts";
import { forwardTargets } from "./forward_fit.ts";
import { RBF_KERNELS, rbfLinearAt, rbfOnRaster } from "./rbf.ts";
import { fieldWithSlope, withParts } from "./warp_map.ts";

/** A place and det J there */
export type Probe = [a: number, b: number, det: number];
/** Its corners x, y, x, y, ... */
export type Polygon = number[];
/** [x, y, x', y'] */
export type Segment = Vector4;

const FOLD_RINGS = [0.2, 0.45, 0.7]; // of the distance to the nearest point, where a fold near a point may hide
const FOLD_FINE = 4; // parts of the side of a cell in which a fold begins

/** det J of a fit at a place. */
function detOf(fit: Fit, a: number, b: number, work: Numbers6) {
  if (isPlain(fit)) return rbfDetAt(fit, a, b);
  fieldWithSlope(fit, a, b, work);
  return work[2] * work[5] - work[3] * work[4];
}

/** Whether a fit is one of points only, with no rigid parts or stages, in its own direction. */
function isPlain({ rigid, stages, forward, sampled, blend }: Fit) {
  return !rigid && !stages && !forward && !sampled && !blend;
}

/** The same of a plain fit, without its displacement: a compact kernel's centres beyond its reach cost nothing. */
function rbfDetAt(fit: RbfFit, a: number, b: number) {
  const { support: r, origin, centers: x, coefficients: alpha, scales, count } = fit,
    { slope, compact } = RBF_KERNELS[fit.kernel]!,
    p = (a - origin[0]) / r,
    q = (b - origin[1]) / r;
  let [[j00, j01], [j10, j11]] = rbfLinearAt(fit, p, q);
  for (let k = 0, j = 0; k < count; k++, j += 2) {
    const dp = p - x[j]!,
      dq = q - x[j + 1]!,
      w = scales ? scales[k]! * scales[k]! : 1,
      s = (dp * dp + dq * dq) * w;
    if (compact && s >= 1) continue;
    const g = 2 * w * slope(s),
      u = alpha[j]! * g,
      v = alpha[j + 1]! * g;
    j00 += u * dp;
    j01 += u * dq;
    j10 += v * dp;
    j11 += v * dq;
  }
  return (1 + j00 / r) * (1 + j11 / r) - (j01 * j10) / (r * r);
}

const DET_WORK = new Float64Array(6) as Numbers6,
  DET_SEEN: Vector4 = [0, 0, 1, 0];

/** det J of the visible fit at a place. */
function detAt(layered: LayeredFit, a: number, b: number) {
  if (!layered.regions.length) return layered.fits.length ? detOf(layered.fits[0]!.fit, a, b, DET_WORK) : 1;
  const [, , opacity, k] = placeOf(layered, a, b, 1e-9, DET_SEEN);
  return k < 0 ? 1 : opacity > 0 ? detOf(layered.fits[k]!.fit, a, b, DET_WORK) : NaN;
}

/** det J of the visible fit at the pixels of a raster; 1 where nothing moves, NaN in a gap. */
export function detsOnRaster(layered: LayeredFit, raster: Raster, out: Float64Array | null = null) {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = raster,
    dets = out ?? new Float64Array(nv * nu);
  const one = layered.regions.length ? null : layered.fits[0]?.fit;
  if (one && isPlain(one)) return rbfDetsOnRaster(one, raster, dets);
  if (one?.rigid && one.base?.count && !one.sampled && !one.stages && !one.forward && !one.blend) {
    return partsDetsOnRaster(one.rigid, one.base, raster, dets);
  }
  if (layered.regions.length && layered.fits.every(({ fit }) => isPlain(fit))) {
    return visibleDetsOnRaster(layered, raster, dets);
  }
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n++) dets[n] = detAt(layered, a0 + j * du, b0 + i * dv);
  }
  return dets;
}

/** The same of plain fits between cuts: that of each fit on the raster, and of them the visible one. */
function visibleDetsOnRaster(layered: LayeredFit, raster: Raster, dets: Float64Array) {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = raster,
    { fits, regions } = layered,
    moves = layersOnRaster(layered, raster),
    own = fits.map(({ fit }) => rbfDetsOnRaster(fit, raster, new Float64Array(nv * nu)));
  for (let i = 0, n = 0; i < nv; i++) {
    for (let j = 0; j < nu; j++, n++) {
      const move = (k: number): Vector2 => [moves[k]![2 * n]!, moves[k]![2 * n + 1]!];
      const [, , opacity, k] = chosenPlace(layered, regions, a0 + j * du, b0 + i * dv, move, 1e-9, DET_SEEN);
      dets[n] = k < 0 ? 1 : opacity > 0 ? own[k]![n]! : NaN;
    }
  }
  return dets;
}

/** The same of a plain fit. */
function rbfDetsOnRaster(fit: RbfFit, raster: Raster, dets: Float64Array) {
  const [, nu] = raster.shape;
  slopeRows(fit, raster, (i, row) => {
    for (let k = 0, n = nu * i; k < 4 * nu; k += 4, n++) {
      dets[n] = (1 + row[k]!) * (1 + row[k + 3]!) - row[k + 1]! * row[k + 2]!;
    }
  });
  return dets;
}

/** The same of rigid parts in a smooth map. */
function partsDetsOnRaster(rigid: ReadyPart[], base: RbfFit, raster: Raster, dets: Float64Array) {
  const [, nu] = raster.shape,
    [du, dv] = raster.spacing,
    [a0, b0] = raster.origin,
    moves = rbfOnRaster(base, raster),
    work = DET_WORK;
  slopeRows(base, raster, (i, row) => {
    for (let j = 0, n = nu * i; j < nu; j++, n++) {
      const a = a0 + j * du,
        b = b0 + i * dv,
        k = 4 * j;
      work[0] = a + moves[2 * n]!;
      work[1] = b + moves[2 * n + 1]!;
      work[2] = 1 + row[k]!;
      work[3] = row[k + 1]!;
      work[4] = row[k + 2]!;
      work[5] = 1 + row[k + 3]!;
      withParts(rigid, base, a, b, work);
      dets[n] = work[2] * work[5] - work[3] * work[4];
    }
  });
  return dets;
}

/**
 * Slopes of a plain fit at the pixels of a raster, row by row, [du/da, du/db, dv/da, dv/db] of each: one centre after the
 * other, and for compact kernels only the columns that it reaches, as rbfOnRaster.
 */
function slopeRows(
  fit: RbfFit,
  { shape: [nv, nu], spacing: [du, dv], origin }: Raster,
  take: (i: number, row: Float64Array) => void,
) {
  const {
    support: r,
    centers: x,
    coefficients: alpha,
    scales,
    linear: [[m00, m01], [m10, m11]],
    count,
    quadratic,
  } = fit;
  const { slope, compact } = RBF_KERNELS[fit.kernel]!,
    step = du / r,
    p0 = (origin[0] - fit.origin[0]) / r;
  const row = new Float64Array(4 * nu);
  for (let i = 0; i < nv; i++) {
    const q = (origin[1] + i * dv - fit.origin[1]) / r;
    for (let k = 0; k < 4 * nu; k += 4) {
      row[k] = m00;
      row[k + 1] = m01;
      row[k + 2] = m10;
      row[k + 3] = m11;
    }
    if (quadratic) for (let k = 0; k < nu; k++) row.set(rbfLinearAt(fit, p0 + k * step, q).flat(), 4 * k);
    for (let c = 0, j = 0; c < count; c++, j += 2) {
      const au = alpha[j]!,
        av = alpha[j + 1]!,
        w = scales ? scales[c]! * scales[c]! : 1,
        dq = q - x[j + 1]!,
        dq2 = dq * dq;
      if ((au === 0 && av === 0) || (compact && dq2 * w >= 1)) continue;
      const reach = compact ? Math.sqrt(1 / w - dq2) : Infinity;
      const first = Math.max(0, Math.ceil((x[j]! - reach - p0) / step));
      const last = Math.min(nu - 1, Math.floor((x[j]! + reach - p0) / step));
      for (let k = first; k <= last; k++) {
        const dp = p0 + k * step - x[j]!,
          g = 2 * w * slope((dp * dp + dq2) * w),
          gu = au * g,
          gv = av * g,
          at = 4 * k;
        row[at]! += gu * dp;
        row[at + 1]! += gu * dq;
        row[at + 2]! += gv * dp;
        row[at + 3]! += gv * dq;
      }
    }
    for (let k = 0; k < 4 * nu; k++) row[k]! /= r;
    take(i, row);
  }
}

/**
 * Probes at and around the points of every fit, where a lattice might miss a small fold.
 * @param most evaluations of a kernel
 */
export function probesOf(layered: LayeredFit, most: number = 2e5) {
  const found: Probe[] = [];
  for (const { fit } of layered.fits) {
    const one = fit.blend?.fits.findLast(Boolean) ?? fit,
      last = one.stages ? one.stages.at(-1)! : one;
    const { count: n, support: r, origin } = last,
      x = last.forward ? forwardTargets(last.forward) : last.centers;
    const look = (p: number, q: number) => {
      const a = origin[0] + p * r,
        b = origin[1] + q * r;
      found.push([a, b, detOf(fit, a, b, DET_WORK)]);
    };
    for (let k = 0; k < n; k++) look(x[2 * k]!, x[2 * k + 1]!);
    const directions = Math.min(8, Math.floor(most / (n * fit.count * FOLD_RINGS.length + 1)));
    if (n < 2 || directions < 3) continue;
    for (let k = 0; k < n; k++) {
      let near = Infinity;
      for (let j = 0; j < n; j++) {
        if (j !== k) near = Math.min(near, (x[2 * k]! - x[2 * j]!) ** 2 + (x[2 * k + 1]! - x[2 * j + 1]!) ** 2);
      }
      FOLD_RINGS.forEach((share, ring) => {
        for (let d = 0; d < directions; d++) {
          const angle = (2 * Math.PI * (d + ring / 3)) / directions,
            way = share * Math.sqrt(near);
          look(x[2 * k]! + way * Math.cos(angle), x[2 * k + 1]! + way * Math.sin(angle));
        }
      });
    }
  }
  return found;
}

/**
 * The smallest det J over a lattice in a box and near the points in it, followed downhill from there, its place, and
 * the share of the lattice that folds (<= 0). With cuts, only visible tissue counts, and points. Where there is no
 * tissue, a det J up to NEARLY_FOLDED does not count: `air` is the share of such folds, and NEARLY_FOLDED < least where
 * all folds are such.
 * @param box [a0, a1, b0, b1]
 * @param nodes of each side of the lattice
 * @param isTissue at a place; default everywhere
 */
export function foldsOf(
  layered: LayeredFit,
  box: Vector4,
  nodes: number,
  probes: Probe[] = probesOf(layered),
  isTissue: (a: number, b: number) => boolean = () => true,
) {
  const [a0, a1, b0, b1] = box,
    da = (a1 - a0) / (nodes - 1),
    db = (b1 - b0) / (nodes - 1);
  const dets = detsOnRaster(layered, { shape: [nodes, nodes], spacing: [da, db], origin: [a0, b0] });
  let least = Infinity,
    place: Vector2 = [(a0 + a1) / 2, (b0 + b1) / 2],
    folded = 0,
    inAir = 0;
  for (let n = 0; n < dets.length; n++) {
    const at: Vector2 = [a0 + (n % nodes) * da, b0 + Math.floor(n / nodes) * db],
      isFold = dets[n]! <= 0;
    const counts = !(dets[n]! <= NEARLY_FOLDED) || isTissue(at[0], at[1]);
    if (isFold && counts) folded += 1;
    else if (isFold) inAir += 1;
    if (counts && dets[n]! < least) {
      least = dets[n]!;
      place = at;
    }
  }
  for (const [a, b, det] of probes) {
    if (!(det < least && a >= a0 && a <= a1 && b >= b0 && b <= b1)) continue;
    if (det > NEARLY_FOLDED || isTissue(a, b)) {
      least = det;
      place = [a, b];
    } else if (det <= 0) inAir ||= 1; // between the nodes
  }
  const isMoved = least !== 1 && Number.isFinite(least),
    step = Math.max(da, db) / 2;
  const end = isMoved ? downhill(layered, box, { least, place }, step, isTissue) : { least, place };
  return {
    least: Number.isFinite(end.least) ? end.least : 1,
    place: end.place,
    share: folded / (nodes * nodes),
    air: inAir / (nodes * nodes),
  };
}

/**
 * From a place in a box to the least det J nearby, never out of the box.
 * @param isTissue the places where a fold counts
 */
function downhill(
  layered: LayeredFit,
  [a0, a1, b0, b1]: Vector4,
  start: { least: number; place: Vector2 },
  step: number,
  isTissue: (a: number, b: number) => boolean,
) {
  let { least, place } = start;
  for (let turn = 0, h = step; turn < 24 && h > step / 64; turn++) {
    let better: Vector2 | null = null;
    for (const [u, v] of [
      [h, 0],
      [-h, 0],
      [0, h],
      [0, -h],
    ] as const) {
      const a = place[0] + u,
        b = place[1] + v;
      if (a < a0 || a > a1 || b < b0 || b > b1) continue;
      const det = detAt(layered, a, b);
      if (det < least && (det > NEARLY_FOLDED || isTissue(a, b))) {
        least = det;
        better = [a, b];
      }
    }
    if (better) place = better;
    else h /= 2;
  }
  return { least, place };
}

// ---- outlines -------------------------------------------------------------------------------------------------------

/**
 * The part of a square [x, x + s] x [y, y + t] where values at its corners (nw, ne, se, sw), linear along the sides,
 * are below a level: adds its polygon to `fill`, and the piece of the level's line in it to `edge`.
 */
function clippedCell(
  x: number,
  y: number,
  s: number,
  t: number,
  nw: number,
  ne: number,
  se: number,
  sw: number,
  level: number,
  fill: Polygon[] | null,
  edge: Segment[],
) {
  const corners: Probe[] = [
    [x, y, nw],
    [x + s, y, ne],
    [x + s, y + t, se],
    [x, y + t, sw],
  ];
  const polygon: Polygon = [];
  const ends: number[] = [];
  for (let k = 0; k < 4; k++) {
    const [px, py, p] = corners[k]!,
      [qx, qy, q] = corners[(k + 1) % 4]!,
      isIn = p <= level;
    if (isIn) polygon.push(px, py);
    if (isIn === q <= level) continue;
    const f = (level - p) / (q - p),
      cx = px + f * (qx - px),
      cy = py + f * (qy - py);
    polygon.push(cx, cy);
    ends.push(cx, cy);
  }
  if (polygon.length >= 6) fill?.push(polygon);
  for (let k = 0; k + 3 < ends.length; k += 4) edge.push(ends.slice(k, k + 4) as Segment);
}

/** A gap neither folds nor bounds a fold. */
const notFolded = (det: number) => (Number.isNaN(det) ? 1 : det);

/** det J at places of a plane, and the evaluations of a kernel that one costs. */
export interface DetMap {
  count: number;
  detAt: (a: number, b: number) => number;
}

/** det J of the visible fit. */
export function detMapOf(layered: LayeredFit): DetMap {
  return { count: layered.count, detAt: (a, b) => detAt(layered, a, b) };
}

/**
 * The folds on a lattice of det J: polygons that fill them, and segments of their outlines. Cells in which a fold may
 * begin or end, or with a probe that folds, are refined as far as the number of evaluations allows.
 * @param most evaluations of a kernel
 */
export function foldPieces(map: DetMap, raster: Raster, dets: ArrayLike<number>, probes: Probe[], most: number) {
  const {
      shape: [rows, columns],
      spacing: [da, db],
      origin: [a0, b0],
    } = raster,
    hit = new Set<number>(),
    near: Vector2[] = [];
  const fill: Polygon[] = [];
  const edge: Segment[] = [];
  for (const [a, b, det] of probes) {
    const j = Math.floor((a - a0) / da),
      i = Math.floor((b - b0) / db);
    if (det <= 0 && i >= 0 && j >= 0 && i < rows - 1 && j < columns - 1) hit.add(i * columns + j);
  }
  for (let i = 0; i + 1 < rows; i++) {
    let run = -1;
    for (let j = 0; j < columns; j++) {
      const n = i * columns + j,
        isCell = j + 1 < columns;
      const corners = isCell ? [n, n + 1, n + columns + 1, n + columns].map((corner) => notFolded(dets[corner]!)) : [1];
      const low = Math.min(...corners),
        high = Math.max(...corners),
        air = 0.5 * (high - low);
      const isWhole = isCell && high + air < 0 && !hit.has(n);
      if (isWhole && run < 0) run = j;
      if (!isWhole && run >= 0) {
        const [left, right, top, bottom] = [a0 + run * da, a0 + j * da, b0 + i * db, b0 + (i + 1) * db];
        fill.push([left, top, right, top, right, bottom, left, bottom]);
        run = -1;
      }
      if (isCell && !isWhole && (low - air <= 0 || hit.has(n))) near.push([i, j]);
    }
  }
  let parts = FOLD_FINE;
  while (parts > 1 && near.length * (parts + 1) ** 2 * Math.max(1, map.count) > most) parts -= 1;
  const runs = new Runs(fill, [a0, b0], [da / parts, db / parts]);
  for (const [i, j] of near) finePieces(map, raster, i, j, parts, { fill, edge, runs });
  runs.end();
  return { fill, edge };
}

/** Squares of a lattice side by side as one rectangle: a canvas is slow with many small ones. */
export class Runs {
  /** The open run of each row */
  open = new Map<number, [first: number, last: number]>();

  constructor(
    readonly fill: Polygon[],
    readonly origin: Vector2,
    readonly spacing: Vector2,
  ) {}

  add(row: number, column: number) {
    const run = this.open.get(row);
    if (run && run[1] === column) {
      run[1] += 1;
      return;
    }
    if (run) this.#close(row, run);
    this.open.set(row, [column, column + 1]);
  }

  end() {
    for (const [row, run] of this.open) this.#close(row, run);
  }

  #close(row: number, [first, last]: Vector2) {
    const [a0, b0] = this.origin,
      [da, db] = this.spacing,
      top = b0 + row * db,
      bottom = b0 + (row + 1) * db;
    const left = a0 + first * da,
      right = a0 + last * da;
    this.fill.push([left, top, right, top, right, bottom, left, bottom]);
  }
}

/**
 * The folds in one cell, from a finer lattice.
 * @param parts of the side of the cell
 */
function finePieces(
  map: DetMap,
  { spacing: [da, db], origin: [a0, b0] }: Raster,
  i: number,
  j: number,
  parts: number,
  { fill, edge, runs }: { fill: Polygon[]; edge: Segment[]; runs: Runs },
) {
  const side = parts + 1,
    values = new Float64Array(side * side),
    s = da / parts,
    t = db / parts;
  let least = Infinity;
  for (let v = 0; v < side; v++) {
    for (let u = 0; u < side; u++) {
      const det = notFolded(map.detAt(a0 + (j + u / parts) * da, b0 + (i + v / parts) * db));
      values[v * side + u] = det;
      least = Math.min(least, det);
    }
  }
  if (least > 0) return;
  for (let v = 0; v < parts; v++) {
    for (let u = 0; u < parts; u++) {
      const n = v * side + u;
      if (Math.max(values[n]!, values[n + 1]!, values[n + side]!, values[n + side + 1]!) <= 0) {
        runs.add(i * parts + v, j * parts + u);
        continue;
      }
      const x = a0 + (j + u / parts) * da,
        y = b0 + (i + v / parts) * db;
      clippedCell(x, y, s, t, values[n]!, values[n + 1]!, values[n + side + 1]!, values[n + side]!, 0, fill, edge);
    }
  }
}

/**
 * The line of a level in a lattice of values: segments in columns and rows.
 * @param shape [rows, columns]
 */
export function contourOf(values: ArrayLike<number>, [rows, columns]: Vector2, level: number) {
  const edge: Segment[] = [];
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < columns; j++) {
      const n = i * columns + j;
      clippedCell(
        j,
        i,
        1,
        1,
        values[n]!,
        values[n + 1]!,
        values[n + columns + 1]!,
        values[n + columns]!,
        level,
        null,
        edge,
      );
    }
  }
  return edge;
}
