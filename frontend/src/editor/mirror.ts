// The mirror of the editor: a line, at which edits of points are mirrored.

import { mirrorEdit, mirrorSide } from "../maths/points.ts";
import { findVisiblePlace } from "../maths/warp_map.ts";
import { setTrait } from "../sync/edits.ts";
import type { PicturePoint, Vector } from "../types.ts";
import type { EditorParts } from "./parts.ts";

/** Dependencies of the mirror on the editor. */
export type MirrorEditor = EditorParts<"model" | "frames" | "messages" | "points" | "map" | "picture">;

export class PointMirror {
  constructor(readonly editor: MirrorEditor) {}

  /** Whether it is on, the axis that it crosses, "a" or "b", and where. */
  get state() {
    const { on = false, axis = "a", at = null } = this.editor.model.get("mirror") ?? {};
    return { on: Boolean(on), axis: String(axis), at: Number(at ?? this.#middle(axis)) };
  }

  #middle(axis: string) {
    const [a0, a1, b0, b1] = this.editor.picture.box;
    return axis === "a" ? (a0 + a1) / 2 : (b0 + b1) / 2;
  }

  /** The lengths within which a source is on the axis, and a partner is found: parts of a pixel. */
  get #near() {
    const pixel = Math.max(...this.editor.model.get("raster").spacing);
    return { axis: 0.5 * pixel, partner: pixel };
  }

  #set(change: { on: boolean; axis?: string; at?: number }) {
    setTrait(this.editor.model, "mirror", { ...this.state, ...change });
    const { on, axis } = this.state,
      line = axis === "a" ? "vertical" : "horizontal";
    if (on) this.editor.messages.hint(`What you do on one side of the ${line} line is done on the other too`, 4000);
  }

  toggle() {
    this.#set({ on: !this.state.on });
  }

  /** Switch it on, along the other axis. */
  turn() {
    const axis = this.state.axis === "a" ? "b" : "a";
    this.#set({ on: true, axis, at: this.#middle(axis) });
  }

  /** Move the axis; Python gets it at the end. */
  moveAxis(at: number, isEnd: boolean) {
    const { frames, model, picture } = this.editor,
      c = this.state.axis === "a" ? 0 : 1;
    const low = picture.box[2 * c]!,
      high = picture.box[2 * c + 1]!;
    model.set("mirror", { ...this.state, at: Math.max(low, Math.min(high, at)) });
    if (isEnd) model.save_changes();
    frames.invalidate();
  }

  /** The side of a point when its drag began: 1, -1, or 0 on the axis and without a mirror. */
  sideOf(id: number) {
    const { state } = this,
      p = this.editor.points.withId(id);
    return p && state.on ? mirrorSide(state, p.source, this.#near.axis) : 0;
  }

  /**
   * An edit from `before` to `after` with its mirror image.
   * @param lead the side that decides, or 0
   * @param holds whether new points hold the visible tissue, on both sides
   */
  edit(before: PicturePoint[], after: PicturePoint[], lead: number = 0, holds: boolean = false) {
    const { map, picture, points } = this.editor,
      { layered } = map,
      { state } = this,
      near = this.#near;
    if (!state.on) return after;
    const findVisible = (source: Vector) =>
      holds && layered && map.strength === 1 && !picture.isOriginal
        ? findVisiblePlace(layered, source, 1e-6 * near.axis)
        : null;
    return mirrorEdit(state, before, after, { near, lead, id: points.nextId(after), findVisible });
  }
}
