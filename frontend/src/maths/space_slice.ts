// The map of points in space on one slice: det J, where that folds, and the lines of the grid that bends with the
// tissue. Coordinates are those of the slice's picture.

import type { Lattice, PaneInfo, Raster, Vector2, Vector3 } from "../types.ts";
import { added } from "./camera.ts";
import { type DetMap, foldPieces, type Probe } from "./folds.ts";
import { rbfOnLattice } from "./rbf.ts";
import { fitInFrame, fromPane, type SpaceFit, type SpaceFits } from "./space.ts";
import { costOf, detOfFits, type IsTissueAt, placesNear, sourceOfFits } from "./space_folds.ts";

const NEARLY = 0.3; // det J on the nodes of a lattice above which nothing folds between them

/** A line of the grid: its pieces as lists of coordinates, and whether it is a face of the volume. */
export interface SliceLine {
  runs: number[][];
  isEdge: boolean;
}

/** The fits of points in space in the frame of a picture, at a depth. */
export class SliceMap implements DetMap {
  readonly count: number;
  readonly #fits: SpaceFits;

  constructor(
    fits: SpaceFits,
    readonly pane: PaneInfo,
    readonly depth: number,
  ) {
    this.#fits = fits.map((fit) => fitInFrame(fit, [pane.u, pane.v, pane.n], pane.origin));
    this.count = costOf(fits);
  }

  detAt(a: number, b: number) {
    return detOfFits(this.#fits, [a, b, this.depth]);
  }

  #detsOnRaster({ shape: [rows, columns], spacing: [da, db], origin: [a0, b0] }: Raster) {
    const dets = new Float64Array(rows * columns);
    for (let n = 0; n < dets.length; n++)
      dets[n] = this.detAt(a0 + (n % columns) * da, b0 + Math.floor(n / columns) * db);
    return dets;
  }

  /** Probes around the points, where a lattice might miss a small fold. */
  #probes(most: number): Probe[] {
    return Array.from(placesNear(this.#fits.at(-1) as SpaceFit, most / this.#fits.length), ([a, b]) => [
      a,
      b,
      this.detAt(a, b),
    ]);
  }

  /**
   * The folds on a lattice of the slice, as of foldPieces; null where nothing folds.
   * @param most evaluations of a kernel
   */
  folds(raster: Raster, most: number) {
    const dets = this.#detsOnRaster(raster),
      probes = this.#probes(most / 4);
    if (!probes.some(([, , det]) => det <= 0) && dets.every((det) => det > NEARLY)) return null;
    const pieces = foldPieces(this, raster, dets, probes, most);
    return pieces.fill.length ? pieces : null;
  }

  /** Whether tissue is in one of these polygons, at a corner or in the middle. */
  hasTissue(polygons: number[][], isTissue: IsTissueAt) {
    const isAt = (a: number, b: number) => {
      const [x, y, z] = sourceOfFits(this.#fits, [a, b, this.depth]);
      return isTissue(fromPane(this.pane, [x, y, z]));
    };
    return polygons.some((polygon) => {
      const corners = polygon.length / 2;
      let [a, b] = [0, 0];
      for (let k = 0; k < polygon.length; k += 2) {
        if (isAt(polygon[k]!, polygon[k + 1]!)) return true;
        a += polygon[k]! / corners;
        b += polygon[k + 1]! / corners;
      }
      return isAt(a, b);
    });
  }

  /**
   * The lines of a grid of the volume as it was where they cross the slice: those along u and v of the picture.
   * @param raster of the slice, between whose nodes displacements are linear
   * @param cells of the grid along the longest side of the volume
   */
  gridLines(raster: Raster, cells: number): SliceLine[] {
    const {
        shape: [rows, columns],
        spacing: [da, db],
        origin: [a0, b0],
      } = raster,
      [left, right, top, bottom, front, back] = this.pane.box,
      size = Math.max(right - left, bottom - top, back - front) / cells,
      lattice: Lattice = { shape: [columns, rows, 1], spacing: [da, db, 1], origin: [a0, b0, this.depth] },
      moves = rbfOnLattice(this.#fits.at(-1)!, lattice),
      earlier = this.#fits.slice(0, -1);
    const places = Array.from({ length: rows * columns }, (_, n): Vector3 => {
      const at: Vector3 = [a0 + (n % columns) * da, b0 + Math.floor(n / columns) * db, this.depth];
      return sourceOfFits(earlier, added(at, [moves[3 * n]!, moves[3 * n + 1]!, moves[3 * n + 2]!]));
    });
    const along = (k: 0 | 1) => Float64Array.from(places, (at) => at[k]);
    return [...levelLines(along(0), raster, [left, right], size), ...levelLines(along(1), raster, [top, bottom], size)];
  }
}

/** Pieces of the lines on which values on a raster have a level, four coordinates each. */
export function levelRuns(values: Float64Array, raster: Raster, level: number) {
  return levelLines(values, raster, [level, level + 1], 1)[0]!.runs;
}

/** The lines on which values on a raster are those of equidistant levels from end to end. */
function levelLines(values: Float64Array, raster: Raster, [first, last]: Vector2, size: number): SliceLine[] {
  const {
      shape: [rows, columns],
      spacing: [da, db],
      origin: [a0, b0],
    } = raster,
    count = Math.max(1, Math.round((last - first) / size)),
    step = (last - first) / count,
    lines = Array.from({ length: count + 1 }, (_, k) => ({ runs: [] as number[][], isEdge: k === 0 || k === count }));
  for (let i = 0; i + 1 < rows; i++) {
    for (let j = 0; j + 1 < columns; j++) {
      const n = i * columns + j,
        corners = [values[n]!, values[n + 1]!, values[n + columns + 1]!, values[n + columns]!] as const,
        from = Math.max(0, Math.ceil((Math.min(...corners) - first) / step)),
        to = Math.min(count, Math.floor((Math.max(...corners) - first) / step));
      for (let k = from; k <= to; k++) {
        const places = crossings(corners, first + k * step).map((at, m) =>
          m % 2 ? b0 + (i + at) * db : a0 + (j + at) * da,
        );
        for (let m = 0; m + 3 < places.length; m += 4) lines[k]!.runs.push(places.slice(m, m + 4));
      }
    }
  }
  return lines;
}

const SIDES = [
  [0, 0, 1, 0],
  [1, 0, 0, 1],
  [1, 1, -1, 0],
  [0, 1, 0, -1],
] as const; // of a cell: a corner, and the way to the next

/** The places on the sides of a cell, as shares of it, where values at its corners cross a level. */
function crossings(corners: readonly [number, number, number, number], level: number) {
  const found: number[] = [];
  SIDES.forEach(([x, y, dx, dy], k) => {
    const p = corners[k]!,
      q = corners[(k + 1) % 4]!;
    if (p <= level === q <= level) return;
    const share = (level - p) / (q - p);
    found.push(x + share * dx, y + share * dy);
  });
  return found;
}
