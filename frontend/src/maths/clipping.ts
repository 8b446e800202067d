// The clipping of a volume: three pairs of shares along the index axes, and the box that they leave.

import type { Model, Sides, Vector3 } from "../types.ts";

export const UNCLIPPED: number[][] = [
  [0, 1],
  [0, 1],
  [0, 1],
];

/** The clipping of a model's view; the whole box where the model has none. */
export function clipOf(model: Pick<Model, "get">): number[][] {
  return model.get("clip") ?? UNCLIPPED;
}

export function isClipped(clip: number[][]) {
  return clip.some(([low, high]) => low > 0 || high < 1);
}

/** The sides at which a box is clipped, as lengths like its own; infinite where it is not. */
export function clipSides({ low, high }: Sides, clip: number[][]): Sides {
  const at: (i: number, share: number) => number = (i, share) => low[i] + share * (high[i] - low[i]);
  return {
    low: clip.map(([share], i) => (share > 0 ? at(i, share) : -Infinity)) as Vector3,
    high: clip.map(([, share], i) => (share < 1 ? at(i, share) : Infinity)) as Vector3,
  };
}

/** The rest of a box within such sides, flat where nothing is left, and which of its sides are new (1 or 0). */
export function leftOf(box: Sides, sides: Sides) {
  const low = box.low.map((l, i) => Math.max(l, sides.low[i])) as Vector3;
  const high = box.high.map((h, i) => Math.min(h, sides.high[i]));
  return {
    low,
    high: high.map((h, i) => Math.max(h, low[i])) as Vector3,
    openLow: box.low.map((l, i) => Number(sides.low[i] > l)) as Vector3,
    openHigh: box.high.map((h, i) => Number(sides.high[i] < h)) as Vector3,
  };
}
