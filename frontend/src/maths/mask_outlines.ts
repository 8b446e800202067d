// Outlines of masks, and masks that are sampled from values on a raster.

import type { MaskData, Raster, Vector2 } from "../types.ts";
import { knownPixels, maskPixels } from "./regions.ts";
import { levelRuns } from "./space_slice.ts";

/**
 * Outlines of masks: faces from one place to another, rows of pixels by their four corners, and the box around all.
 */
const maskOutlines: WeakMap<MaskData, ReturnType<typeof maskOutline>> = new WeakMap();

export function outlineOf(region: MaskData) {
  const outline = maskOutlines.get(region) ?? maskOutline(region);
  maskOutlines.set(region, outline);
  return outline;
}

/** The faces of the pixels of a mask where it ends, row by row and column by column. */
function maskOutline(region: MaskData) {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = region,
    isSet = maskPixels(region);
  const faces: Vector2[][] = [],
    rows: Vector2[][] = [];
  const at = (i: number, j: number) => i >= 0 && j >= 0 && i < nv && j < nu && isSet[i * nu + j] === 1;
  const corner = (i: number, j: number): Vector2 => [a0 + (j - 0.5) * du, b0 + (i - 0.5) * dv];
  for (let i = 0; i <= nv; i++)
    for (let j = 0, from = -1; j <= nu; j++) {
      const is = j < nu && at(i, j) !== at(i - 1, j);
      if (is && from < 0) from = j;
      if (!is && from >= 0) {
        faces.push([corner(i, from), corner(i, j)]);
        from = -1;
      }
    }
  for (let j = 0; j <= nu; j++)
    for (let i = 0, from = -1; i <= nv; i++) {
      const is = i < nv && at(i, j) !== at(i, j - 1);
      if (is && from < 0) from = i;
      if (!is && from >= 0) {
        faces.push([corner(from, j), corner(i, j)]);
        from = -1;
      }
    }
  for (let i = 0; i < nv; i++)
    for (let j = 0, from = -1; j <= nu; j++) {
      if (at(i, j) && from < 0) from = j;
      if (!at(i, j) && from >= 0) {
        rows.push([corner(i, from), corner(i, j), corner(i + 1, j), corner(i + 1, from)]);
        from = -1;
      }
    }
  const [low, high] = [Math.min, Math.max].map((most) =>
    [0, 1].map((c) => faces.flat().reduce((best, place) => most(best, place[c]!), faces[0]?.[0]?.[c] ?? 0)),
  ) as [number[], number[]];
  return { faces, rows, corners: [low, [low[0], high[1]], high, [high[0], low[1]]] };
}

/** The mask where values on a raster reach one half; its outline runs between the nodes. */
export function sampledMask(raster: Raster, values: Float64Array): MaskData {
  const mask: MaskData = { kind: "mask", ...raster, bits: "" };
  knownPixels.set(
    mask,
    Uint8Array.from(values, (value) => Number(value >= 0.5)),
  );
  const faces = levelRuns(values, raster, 0.5).map(([a, b, c, d]): Vector2[] => [
    [a!, b!],
    [c!, d!],
  ]);
  maskOutlines.set(mask, { ...maskOutline(mask), faces });
  return mask;
}
