// The clipping of a volume: three pairs of shares along the index axes, and the box that they leave.

/** @import { Model, Sides } from "../types.d.ts" */

/** @type {number[][]} */
export const UNCLIPPED = [[0, 1], [0, 1], [0, 1]];

/**
 * The clipping of a model's view; the whole box where the model has none.
 * @param {Pick<Model, "get">} model
 * @returns {number[][]}
 */
export function clipOf(model) { return model.get("clip") ?? UNCLIPPED; }

/** @param {number[][]} clip */
export function isClipped(clip) { return clip.some(([low, high]) => low > 0 || high < 1); }

/**
 * The sides at which a box is clipped, as lengths like its own; infinite where it is not.
 * @param {Sides} box
 * @param {number[][]} clip
 * @returns {Sides}
 */
export function clipSides({ low, high }, clip) {
  /** @type {(i: number, share: number) => number} */
  const at = (i, share) => low[i] + share * (high[i] - low[i]);
  return { low: clip.map(([share], i) => (share > 0 ? at(i, share) : -Infinity)),
    high: clip.map(([, share], i) => (share < 1 ? at(i, share) : Infinity)) };
}

/**
 * The rest of a box within such sides, flat where nothing is left, and which of its sides are new (1 or 0).
 * @param {Sides} box
 * @param {Sides} sides
 */
export function leftOf(box, sides) {
  const low = box.low.map((l, i) => Math.max(l, sides.low[i]));
  const high = box.high.map((h, i) => Math.min(h, sides.high[i]));
  return { low, high: high.map((h, i) => Math.max(h, low[i])),
    openLow: box.low.map((l, i) => Number(sides.low[i] > l)),
    openHigh: box.high.map((h, i) => Number(sides.high[i] < h)) };
}
