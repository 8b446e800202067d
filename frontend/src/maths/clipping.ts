// The clipping of a volume: three pairs of shares along the index axes, and the box that they leave.

import type { Model, Sides, Vector2 } from "../types.ts";
import { type Axis, perAxis } from "./axes.ts";

/** The first and the last share along each index axis. */
export type Clip = [Vector2, Vector2, Vector2];

export const UNCLIPPED: Clip = [
  [0, 1],
  [0, 1],
  [0, 1],
];

/** The clipping of a model's view; the whole box where the model has none. */
export function clipOf(model: Pick<Model, "get">): Clip {
  return model.get("clip") ?? UNCLIPPED;
}

export function isClipped(clip: Clip) {
  return clip.some(([low, high]) => low > 0 || high < 1);
}

/** The sides at which a box is clipped, as lengths like its own; infinite where it is not. */
export function clipSides({ low, high }: Sides, clip: Clip): Sides {
  const at = (i: Axis, share: number) => low[i] + share * (high[i] - low[i]);
  return {
    low: perAxis((i) => (clip[i][0] > 0 ? at(i, clip[i][0]) : -Infinity)),
    high: perAxis((i) => (clip[i][1] < 1 ? at(i, clip[i][1]) : Infinity)),
  };
}

/** The rest of a box within such sides, flat where nothing is left, and which of its sides are new (1 or 0). */
export function leftOf(box: Sides, sides: Sides) {
  const low = perAxis((i) => Math.max(box.low[i], sides.low[i]));
  return {
    low,
    high: perAxis((i) => Math.max(Math.min(box.high[i], sides.high[i]), low[i])),
    openLow: perAxis((i) => Number(sides.low[i] > box.low[i])),
    openHigh: perAxis((i) => Number(sides.high[i] < box.high[i])),
  };
}
