// The subject of a picture and of a volume: its box, as deformnb/imaging/demo.py finds it, and the side that shows most of
// it, as deformnb/session/inputs.py does.

import type { Values, Volume } from "../formats/volume_files.ts";
import { SILHOUETTE_SMOOTHING, SUBJECT_LEVEL, SUBJECT_SHARE } from "../generated.ts";
import type { Raster, Vector2, Vector4 } from "../types.ts";
import { planeAlong, voxelRaster } from "./grid.ts";
import type { Measured } from "./levels.ts";
import { maximumProjection } from "./packing.ts";

const MARGIN = 0.02; // by which the box is grown, as a share of its size
const LEAST_SIGMA = 0.5; // pixels
const TAIL = 16; // pixels beyond four sigma after which the weights of a narrow Gaussian have faded
const SIDES = ["+y", "-x", "-z"]; // that can be the best; the opposite ones have the same silhouettes

/** Whether a picture is ink on paper: the pixels of its border are mostly bright. */
function isPaper(pixels: Values, [rows, columns]: Vector2, [low, high]: Vector2) {
  const rim = [...pixels].filter((_, k) => {
    const i = Math.floor(k / columns),
      j = k % columns;
    return i === 0 || i === rows - 1 || j === 0 || j === columns - 1;
  });
  return rim.sort((p, q) => p - q)[rim.length >> 1]! > (low + high) / 2;
}

/**
 * The box a0, a1, b0, b1 around the foreground of a picture, bright on dark or ink on paper; null where there is none.
 */
export function subjectBox(pixels: Values, raster: Raster): Vector4 | null {
  const {
      shape: [rows, columns],
      spacing: [du, dv],
      origin: [a, b],
    } = raster,
    inColumn = new Float64Array(columns),
    inRow = new Float64Array(rows);
  let low = Infinity,
    high = -Infinity;
  for (const value of pixels) {
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (!(low < high)) return null;
  const isInk = isPaper(pixels, raster.shape, [low, high]),
    level = SUBJECT_LEVEL * (high - low);
  for (let k = 0; k < pixels.length; k++) {
    const height = isInk ? high - pixels[k]! : pixels[k]! - low;
    if (!(height > level)) continue;
    inColumn[k % columns]! += 1 / rows;
    inRow[Math.floor(k / columns)]! += 1 / columns;
  }
  const range = (shares: Float64Array, spacing: number, first: number): Vector2 => {
    const from = shares.findIndex((share) => share > SUBJECT_SHARE),
      to = shares.findLastIndex((share) => share > SUBJECT_SHARE);
    const grow = MARGIN * (to - from) * spacing;
    return from < 0 ? [0, 0] : [first + from * spacing - grow, first + to * spacing + grow];
  };
  const [a0, a1] = range(inColumn, du, a),
    [b0, b1] = range(inRow, dv, b);
  return a1 > a0 && b1 > b0 ? [a0, a1, b0, b1] : null;
}

/**
 * Weights of a Gaussian or of its derivative, with the frequencies that pixels can have and no others, as the Fourier
 * transform of `count` pixels has them.
 */
function gaussian(sigma: number, isSlope: boolean, count: number) {
  const reach = Math.min((count - 1) >> 1, Math.ceil(4 * sigma) + TAIL),
    top = Math.floor(count / 2);
  return Array.from({ length: 2 * reach + 1 }, (_, n) => {
    let sum = isSlope ? 0 : 1;
    for (let f = 1; f <= top; f++) {
      const omega = (2 * Math.PI * f) / count,
        weight = Math.exp(-0.5 * (sigma * omega) ** 2) * (2 * f === count ? 1 : 2),
        phase = omega * (n - reach);
      sum += isSlope ? weight * omega * Math.sin(phase) : weight * Math.cos(phase);
    }
    return sum / count;
  });
}

/** Values on a raster after a row of weights along an axis; what is beyond the raster is 0. */
function filtered(values: Float64Array, [rows, columns]: Vector2, weights: number[], isAcross: boolean) {
  const out = new Float64Array(values.length),
    reach = (weights.length - 1) / 2,
    step = isAcross ? 1 : columns;
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const at = isAcross ? j : i,
        count = isAcross ? columns : rows;
      let sum = 0;
      for (let k = Math.max(-reach, -at); k <= Math.min(reach, count - 1 - at); k++) {
        sum += weights[k + reach]! * values[i * columns + j + k * step]!;
      }
      out[i * columns + j] = sum;
    }
  }
  return out;
}

/** The length of the outline of a silhouette: its total variation, slightly smoothed. */
function silhouetteLength(silhouette: Float64Array, [rows, columns]: Vector2, [du, dv]: Vector2) {
  const size = Math.hypot(rows * dv, columns * du),
    sigma = (spacing: number) => Math.max((SILHOUETTE_SMOOTHING * size) / spacing, LEAST_SIGMA);
  const [across, down] = [sigma(du), sigma(dv)],
    margin = Math.ceil(4 * Math.max(across, down)) + 2,
    shape: Vector2 = [rows + 2 * margin, columns + 2 * margin],
    padded = new Float64Array(shape[0] * shape[1]);
  for (let i = 0; i < rows; i++) {
    padded.set(silhouette.subarray(i * columns, (i + 1) * columns), (i + margin) * shape[1] + margin);
  }
  const slope = (isAcross: boolean) =>
    filtered(
      filtered(padded, shape, gaussian(across, isAcross, shape[1]), true),
      shape,
      gaussian(down, !isAcross, shape[0]),
      false,
    );
  const [da, db] = [slope(true), slope(false)];
  return da.reduce((sum, value, k) => sum + Math.hypot(value / du, db[k]! / dv), 0) * du * dv;
}

/** The side that shows most of the subject of a volume: the one with the longest silhouette; that of a picture for a slice. */
export function bestView(volume: Volume, { levels }: Measured): string {
  if (volume.grid.shape[0] === 1) return "+z"; // a picture, which is mirrored from the other side
  const lengths = SIDES.map((side) => {
    const plane = planeAlong(volume.grid, side),
      { shape, spacing } = voxelRaster(volume.grid, plane);
    const silhouette = Float64Array.from(maximumProjection(volume, plane), (value) => Number(value > levels[1]));
    return silhouetteLength(silhouette, shape, spacing);
  });
  return SIDES[lengths.indexOf(Math.max(...lengths))]!;
}
