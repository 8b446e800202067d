// The drawing of folds over a picture: red and hatched where tissue folds, grey where air alone does.

import type { foldPieces } from "../maths/folds.ts";
import type { View } from "./painter.ts";
import { context2d } from "./painter.ts";

export type FoldPieces = ReturnType<typeof foldPieces>;

const FOLD_COLOURS = { fill: "rgba(211, 47, 47, 0.45)", edge: "#d32f2f" };
const AIR_COLOURS = { fill: "rgba(150, 153, 160, 0.25)", edge: "#969aa0" }; // of folds in air alone

/** @param hatch of `hatchPattern`: a fold is seen without its colour too */
export function drawFolds(
  c: CanvasRenderingContext2D,
  { k, x, y, ratio }: View,
  { fill, edge }: FoldPieces,
  isInAir: boolean,
  hatch: string | CanvasPattern,
) {
  const red = new Path2D(),
    rim = new Path2D();
  for (const polygon of fill) {
    red.moveTo(k * polygon[0]! + x, k * polygon[1]! + y);
    // Not closed: a fill does that, and Chromium measures the path at each closePath, for seconds in a large fold.
    for (let n = 2; n < polygon.length; n += 2) red.lineTo(k * polygon[n]! + x, k * polygon[n + 1]! + y);
  }
  for (const [a, b, p, q] of edge) {
    rim.moveTo(k * a + x, k * b + y);
    rim.lineTo(k * p + x, k * q + y);
  }
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  const colours = isInAir ? AIR_COLOURS : FOLD_COLOURS;
  c.fillStyle = colours.fill;
  c.fill(red);
  c.fillStyle = isInAir ? "transparent" : hatch;
  c.fill(red);
  c.strokeStyle = colours.edge;
  c.lineWidth = 1.2;
  c.stroke(rim);
}

/** Diagonal lines, light with a dark rim. */
export function hatchPattern(context: CanvasRenderingContext2D) {
  const tile = document.createElement("canvas"),
    size = 11;
  Object.assign(tile, { width: size, height: size });
  const c = context2d(tile);
  for (const [strokeStyle, lineWidth] of [
    ["rgba(80, 0, 0, 0.7)", 2.2],
    ["rgba(255, 225, 225, 0.85)", 0.9],
  ]) {
    Object.assign(c, { strokeStyle, lineWidth });
    c.beginPath();
    for (const at of [-size, 0, size]) {
      c.moveTo(at - 1, size + 1);
      c.lineTo(at + size + 1, -1);
    }
    c.stroke();
  }
  return context.createPattern(tile, "repeat") ?? "transparent";
}
