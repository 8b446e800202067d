// det J at the middles of pixels over a picture, as Python sends it, linear between them.

import type { Raster, Vector4 } from "../types.ts";
import { type DetMap, foldPieces } from "./folds.ts";

const MOST_SAMPLES = 1e5; // places between the nodes, of which each costs little

export class SampledDets implements DetMap {
  readonly count = 1;
  readonly raster: Raster;

  /** @param box the sides of the picture: a0, a1, b0, b1 */
  constructor(
    [rows, columns]: [number, number],
    readonly values: Float32Array,
    [a0, a1, b0, b1]: readonly [...Vector4, ...number[]],
  ) {
    const [da, db] = [(a1 - a0) / columns, (b1 - b0) / rows];
    this.raster = { shape: [rows, columns], spacing: [da, db], origin: [a0 + da / 2, b0 + db / 2] };
  }

  detAt(a: number, b: number) {
    const {
        shape: [rows, columns],
        spacing: [da, db],
        origin: [a0, b0],
      } = this.raster,
      u = Math.max(0, Math.min(columns - 1, (a - a0) / da)),
      v = Math.max(0, Math.min(rows - 1, (b - b0) / db)),
      j = Math.min(Math.floor(u), Math.max(0, columns - 2)),
      i = Math.min(Math.floor(v), Math.max(0, rows - 2)),
      at = (di: number, dj: number) =>
        this.values[Math.min(rows - 1, i + di) * columns + Math.min(columns - 1, j + dj)]!,
      top = at(0, 0) + (u - j) * (at(0, 1) - at(0, 0)),
      low = at(1, 0) + (u - j) * (at(1, 1) - at(1, 0));
    return top + (v - i) * (low - top);
  }

  /** The folds, as of foldPieces. */
  get folds() {
    return foldPieces(this, this.raster, this.values, [], MOST_SAMPLES);
  }
}
