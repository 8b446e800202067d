// The axes of the transfer editor: values, of which a part may be seen, and opacities.

import { formatNumber } from "../maths/curves.ts";
import type { Vector2 } from "../types.ts";
import { PLOT, PlotAxes } from "./plot_axes.ts";

export const ROWS = { ...PLOT, left: 58, bottom: 92 }; // room for colours and window under the axis
const FINEST = 1 / 500; // share of the whole axis that is seen at most enlarged

/**
 * The seen part of the axis, zoomed by a factor about a value and limited to the whole axis; null where all of it is
 * seen.
 */
export function zoomAxis([low, high]: Vector2, [first, last]: Vector2, factor: number, at: number): Vector2 | null {
  const span = last - first,
    width = Math.max(FINEST * span, (high - low) / factor);
  if (width >= span * (1 - 1e-9)) return null;
  return clampInterval([at - ((at - low) * width) / (high - low), width], [first, last]);
}

/** The seen part of the axis, moved and limited to the whole axis. */
export function panAxis([low, high]: Vector2, whole: Vector2, by: number) {
  return clampInterval([low + by, high - low], whole);
}

/** @param part its low end and its width */
function clampInterval([low, width]: Vector2, [first, last]: Vector2): Vector2 {
  const from = Math.max(first, Math.min(last - width, low));
  return [from, from + width];
}

export class ValueAxes extends PlotAxes {
  range: Vector2 = [0, 1];
  /** The part of the axis that is seen; null for all of it */
  zoom: Vector2 | null = null;
  /** Called after a zoom */
  changed = () => {};

  constructor() {
    super(ROWS);
  }

  /** The ends of the whole axis of values. */
  get whole(): Vector2 {
    const [low, high] = this.range;
    return [low, high > low ? high : low + 1];
  }

  setRange(range: Vector2) {
    this.range = range;
    if (this.zoom) this.zoom = zoomAxis(this.zoom, this.whole, 1, this.zoom[0]);
  }

  isSeen(value: number) {
    const [[low, high]] = this.ends,
      slack = 1e-9 * (high - low);
    return value >= low - slack && value <= high + slack;
  }

  zoomTo(zoom: Vector2 | null) {
    this.zoom = zoom;
    this.ends = [zoom ?? this.whole, [0, 1]];
    this.changed();
  }

  /** Zoom by a factor about a value. */
  zoomBy(factor: number, at: number) {
    this.zoomTo(zoomAxis(this.ends[0], this.whole, factor, at));
  }

  zoomToWindow([low, high]: Vector2) {
    const room = 0.1 * (high - low),
      whole = this.whole;
    if (!(high > low)) return;
    this.zoomTo(zoomAxis([Math.max(whole[0], low - room), Math.min(whole[1], high + room)], whole, 1, low));
  }

  /** Bring a value back into sight that an arrow key has moved beyond the edge. */
  reveal(value: number) {
    if (!this.zoom || this.isSeen(value)) return;
    const [low, high] = this.zoom;
    this.zoomTo(panAxis(this.zoom, this.whole, value < low ? value - low : value - high));
  }

  /** Move a zoomed axis by a share of the visible range. */
  pan(from: Vector2, share: number) {
    this.zoomTo(panAxis(from, this.whole, share * (from[1] - from[0])));
  }

  /** The same, limited to the visible part; the ends of the window may leave it. */
  override tidy([x, y]: Vector2, isFree: boolean = false, isInside: boolean = true): Vector2 {
    const [[low, high]] = this.ends;
    return super.tidy([isInside ? Math.max(low, Math.min(high, x)) : x, y], isFree);
  }

  /** The step of an arrow key along the axis of values. */
  step(isFar: boolean) {
    const [[low, high]] = this.ends;
    return ((isFar ? 10 : 1) * (high - low)) / 200;
  }

  override ticks() {
    if (this.power === 1) return super.ticks();
    let last = Infinity;
    return [0, 0.001, 0.01, 0.1, 0.5, 1].filter((alpha) => {
      const at = this.toPixel([this.range[0], alpha])[1],
        isFar = last - at >= 13;
      if (isFar) last = at;
      return isFar;
    });
  }

  override tickText(alpha: number) {
    return String(alpha);
  }

  /** A value in words. */
  words(value: number) {
    const [[low, high]] = this.ends;
    return formatNumber(value, high - low);
  }
}
