// The part of a volume's box that is seen: three pairs of shares along the index axes, and the box that they leave.

export const UNCLIPPED = [[0, 1], [0, 1], [0, 1]];

/** What a model says of it; everything where it says nothing. */
export function clipOf(model) { return model.get("clip") ?? UNCLIPPED; }

export function isClipped(clip) { return clip.some(([low, high]) => low > 0 || high < 1); }

/** Where a box is cut off, as lengths like its own; infinite where it is not. */
export function clipSides({ low, high }, clip) {
  const at = (i, share) => low[i] + share * (high[i] - low[i]);
  return { low: clip.map(([share], i) => (share > 0 ? at(i, share) : -Infinity)),
    high: clip.map(([, share], i) => (share < 1 ? at(i, share) : Infinity)) };
}

/** What such sides leave of a box, flat where that is nothing, and which of its sides are new (1 or 0). */
export function leftOf(box, sides) {
  const low = box.low.map((l, i) => Math.max(l, sides.low[i])), high = box.high.map((h, i) => Math.min(h, sides.high[i]));
  return { low, high: high.map((h, i) => Math.max(h, low[i])),
    openLow: box.low.map((l, i) => Number(sides.low[i] > l)), openHigh: box.high.map((h, i) => Number(sides.high[i] < h)) };
}
