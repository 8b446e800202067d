// The viewport of a picture in an editor: the visible part of the picture, and its scale.

import type { Vector2, Vector4 } from "../types.ts";
import type { Frames } from "./frames.ts";
import type { Band } from "./gesture.ts";
import type { View } from "./painter.ts";

export const MARGIN = 20; // CSS pixels around the picture, so that points on its edge can be seen and grabbed
const MARGIN_SHARE = 0.04; // of a small view's shorter side, to which its margin is limited
const LEAST_SEEN = 0.1; // share of the picture, or of the view, that stays in view
const LOOK_ZOOM = 2.5; // times the whole picture, when a point is centred

export class Viewport {
  view: View = { k: 1, x: 0, y: 0, width: 1, height: 1, ratio: 1 };

  isFitted = true; // whether the view shows all of the picture, or of its framed part

  isWhole = false; // whether that is the picture, with the air around its framed part

  /**
   * @param box the sides of the picture: a0, a1, b0, b1
   * @param margin CSS pixels around it
   * @param framed the sides of the part that is fitted first
   */
  constructor(
    private readonly frames: Frames,
    private readonly box: () => readonly [...Vector4, ...number[]],
    private readonly margin = MARGIN,
    private readonly framed = box,
  ) {}

  /**
   * The place of the picture at a place of the view.
   * @param at CSS pixels
   */
  placeAt([x, y]: Vector2): Vector2 {
    return [(x - this.view.x) / this.view.k, (y - this.view.y) / this.view.k];
  }

  /** The place of the view at a place of the picture. */
  toView([a, b]: Vector2): Vector2 {
    return [this.view.k * a + this.view.x, this.view.k * b + this.view.y];
  }

  /** Whether a place of the picture is in a rectangle of the view. */
  isInside(place: Vector2, { x, y, width, height }: Band) {
    const [px, py] = this.toView(place);
    return px >= x && py >= y && px - x <= width && py - y <= height;
  }

  /** Take another size in CSS pixels: the whole picture, or the same middle. */
  resize(width: number, height: number, ratio: number) {
    const v = this.view,
      [dx, dy] = [(width - v.width) / 2, (height - v.height) / 2];
    Object.assign(v, { width, height, ratio });
    if (this.isFitted) this.fit();
    else Object.assign(v, { x: v.x + dx, y: v.y + dy });
  }

  get #fitted() {
    return this.isWhole ? this.box() : this.framed();
  }

  get #fittedScale() {
    const [a0, a1, b0, b1] = this.#fitted,
      { width, height } = this.view;
    const margin = Math.min(this.margin, Math.max(8, MARGIN_SHARE * Math.min(width, height)));
    return Math.max(1e-9, Math.min((width - 2 * margin) / (a1 - a0), (height - 2 * margin) / (b1 - b0)));
  }

  /** Show the framed part of the picture; a second time all of the picture, where that is more. */
  toggleFit() {
    this.isWhole = this.isFitted && !this.isWhole && String(this.framed()) !== String(this.box());
    this.fit();
  }

  /** Show the framed part of the picture, or all of it, as chosen last. */
  fit() {
    const [a0, a1, b0, b1] = this.#fitted,
      { width, height } = this.view,
      k = this.#fittedScale;
    Object.assign(this.view, { k, x: width / 2 - (k * (a0 + a1)) / 2, y: height / 2 - (k * (b0 + b1)) / 2 });
    this.isFitted = true;
    this.frames.invalidate();
  }

  panBy(dx: number, dy: number) {
    Object.assign(this.view, { x: this.view.x + dx, y: this.view.y + dy });
    this.#keepInView();
  }

  zoomAt(factor: number, x = this.view.width / 2, y = this.view.height / 2) {
    const v = this.view,
      fitted = this.#fittedScale,
      k = Math.max(fitted / 4, Math.min(fitted * 64, v.k * factor));
    const f = k / v.k;
    Object.assign(v, { k, x: x + f * (v.x - x), y: y + f * (v.y - y) });
    this.#keepInView();
  }

  /** Show a place of the picture in the middle of the view, magnified enough to show its content. */
  lookAt([a, b]: Vector2) {
    const v = this.view,
      k = Math.max(v.k, LOOK_ZOOM * this.#fittedScale);
    Object.assign(v, { k, x: v.width / 2 - k * a, y: v.height / 2 - k * b });
    this.#keepInView();
  }

  /**
   * Show a part of the picture.
   * @param k CSS pixels of a unit of length
   */
  see([a, b]: Vector2, k: number) {
    const v = this.view,
      fitted = this.#fittedScale;
    v.k = Math.max(fitted / 4, Math.min(fitted * 64, k));
    Object.assign(v, { x: v.width / 2 - v.k * a, y: v.height / 2 - v.k * b });
    this.#keepInView();
  }

  /** Keep at least a tenth of the picture in the view, or fill a tenth of it. */
  #keepInView() {
    const [a0, a1, b0, b1] = this.box(),
      v = this.view;
    const least = (length: number, room: number) => LEAST_SEEN * Math.min(v.k * length, room);
    const across = least(a1 - a0, v.width),
      down = least(b1 - b0, v.height);
    v.x = Math.max(across - v.k * a1, Math.min(v.width - across - v.k * a0, v.x));
    v.y = Math.max(down - v.k * b1, Math.min(v.height - down - v.k * b0, v.y));
    this.isFitted = false;
    this.frames.markMoving();
  }
}
