// The brush: its circle, its bar, and its strokes (maths/brushes.js) by mouse, pen, finger or keys.

import type { Stroke } from "../maths/brushes.ts";
import { formatLength } from "../maths/numbers.ts";
import type { Model, Vector, Vector2 } from "../types.ts";
import { setText } from "../ui/dom.ts";
import { type KeyTable, keyPlace } from "../ui/keys.ts";
import type { Frames } from "./frames.ts";
import { BrushGesture } from "./gestures.ts";
import type { Messages } from "./messages.ts";
import { OptionBar } from "./option_bar.ts";
import type { View } from "./painter.ts";

const BRUSH_WORDS: Record<string, string> = { move: "Move", grow: "Grow" };
const BRUSH_HINTS: Record<string, string> = {
  move: "Drag to move the tissue in the circle; [ and ] change its size, Esc ends",
  grow: "Drag right to grow the tissue in the circle, left to shrink it; Esc ends",
};
const BRUSH_PIXELS: Vector2 = [8, 400]; // CSS pixels of the radius, least and most
const BRUSH_SHARE = 0.09; // of the picture's diagonal: the radius at first
const BRUSH_SWELL = 120; // CSS pixels of a drag that scale the middle by e
const BRUSH_KEYS = [2, 10]; // CSS pixels of an arrow key with and without Shift

/** What a brush is used on: a picture, or slices of a volume. */
export interface BrushHost<V extends Vector> {
  readonly model: Model;
  readonly frames: Frames;
  readonly messages: Messages;
  readonly stage: { readonly element: HTMLElement; focus(): void };
  readonly keys: KeyTable;
  /** The view of the picture under the pointer, and the places that are seen there. */
  readonly viewport: { readonly view: View; placeAt(at: Vector2): V };
  /** Of the picture or the volume. */
  readonly diagonal: number;
  /** Begin a stroke; null and a hint where none can begin. */
  begin(place: V, radius: number, tool: string): Stroke<V> | null;
  /** Show a stroke as it is now; false where it must not continue. */
  paint(stroke: Stroke<V>): boolean;
  /** A stroke has ended, and was not cancelled. */
  finish(stroke: Stroke<V>): void;
  end(isCancelled: boolean): void;
}

/** A brush in use, its circle and its bar. */
export class Brush<V extends Vector = Vector> {
  readonly advice = "Drag in the picture; [ and ] or the wheel change the circle; Esc ends";
  tool: string | null = null;
  /** The place of the circle in CSS pixels. */
  at: Vector2 | null = null;
  from: Vector2 = [0, 0]; // the start of the stroke
  stroke: Stroke<V> | null = null;
  isByKeys = false;
  timer = 0;
  bar: OptionBar;
  title: HTMLSpanElement;
  slider: HTMLInputElement;
  value: HTMLSpanElement;

  constructor(readonly editor: BrushHost<V>) {
    this.bar = new OptionBar(editor, "", "Brush");
    this.title = this.bar.text();
    this.slider = this.bar.slider("radius of the brush", (value) => {
      const [least, most] = this.#limits;
      this.setRadius(least * (most / least) ** (value / 100));
    });
    const end = () => {
      this.stop();
      editor.stage.focus();
    };
    this.slider.addEventListener("change", () => editor.frames.guard(() => editor.stage.focus()));
    this.slider.addEventListener("keydown", ({ key }) => {
      if (key === "Escape") editor.frames.guard(end);
    });
    this.value = this.bar.text("dnb-ed-brush-value");
    this.bar.button("Done", "Done", end, "put the brush away");
  }

  get isOn() {
    return this.tool !== null;
  }

  get #limits(): Vector2 {
    const { k } = this.editor.viewport.view;
    return [BRUSH_PIXELS[0] / k, BRUSH_PIXELS[1] / k];
  }

  /** In units of the picture. */
  get radius(): number {
    return this.editor.model.get("brush_radius") || BRUSH_SHARE * this.editor.diagonal;
  }

  setRadius(radius: number) {
    const [least, most] = this.#limits;
    this.editor.model.set("brush_radius", Math.max(least, Math.min(most, radius)));
    clearTimeout(this.timer); // a slider moves pixel by pixel
    this.timer = setTimeout(() => this.editor.model.save_changes(), 200);
    this.editor.frames.invalidate();
  }

  /** Notches of the wheel or presses of a key. */
  grow(notches: number) {
    this.setRadius(this.radius * 1.1 ** notches);
  }

  /** @param tool a name of BRUSH_WORDS */
  start(tool: string) {
    const { editor } = this;
    this.tool = tool;
    this.isByKeys = false;
    editor.stage.element.classList.add("dnb-ed-brushing");
    editor.messages.hint(BRUSH_HINTS[tool]!, 8000);
    editor.messages.announce(`${BRUSH_WORDS[tool]} brush: arrows move it, Enter presses and lifts it, Escape ends`);
    editor.frames.invalidate();
  }

  stop() {
    if (!this.isOn) return false;
    this.lift(true);
    this.tool = null;
    this.editor.stage.element.classList.remove("dnb-ed-brushing");
    this.editor.messages.hideHint(Object.values(BRUSH_HINTS));
    this.editor.frames.invalidate();
    return true;
  }

  show() {
    this.bar.element.hidden = !this.isOn;
    if (!this.tool) return;
    const [least, most] = this.#limits;
    setText(this.title, BRUSH_WORDS[this.tool]!);
    setText(this.value, formatLength(this.radius));
    this.slider.value = String((100 * Math.log(this.radius / least)) / Math.log(most / least));
  }

  // ---- strokes ------------------------------------------------------------------------------------------------------

  hover(at: Vector2 | null) {
    this.at = at;
    this.isByKeys = false;
    this.editor.frames.invalidate();
  }

  leave() {
    if (!this.isByKeys) this.hover(null);
  }

  ignores(_isOthers: boolean, mark: string | null) {
    return mark === "axis";
  }

  grab(at: Vector2, isFinger: boolean) {
    return new BrushGesture(at, this, isFinger);
  }

  press(at: Vector2) {
    this.at = this.from = at;
    this.begin(this.editor.viewport.placeAt(at));
  }

  drag(at: Vector2) {
    this.at = at;
    this.follow(this.editor.viewport.placeAt(at), at[0] - this.from[0] + this.from[1] - at[1]);
  }

  /** Begin a stroke at a place. */
  begin(place: V) {
    const stroke = this.tool ? this.editor.begin(place, this.radius, this.tool) : null;
    if (!stroke) return;
    this.stroke = stroke;
    this.editor.paint(stroke);
  }

  /**
   * Continue a stroke to a place.
   * @param growth CSS pixels of the drag to the right and upwards
   */
  follow(place: V, growth: number) {
    const { stroke, editor } = this;
    editor.frames.invalidate();
    if (!stroke) return;
    const was = { points: stroke.points, middle: stroke.middle, swell: stroke.swell };
    if (stroke.tool === "move") stroke.move(place);
    else stroke.grow(growth / BRUSH_SWELL);
    if (editor.paint(stroke)) return;
    Object.assign(stroke, was); // no further: it would fold, or enter a rigid part
  }

  lift(isCancelled = false) {
    if (!this.stroke) return;
    const { stroke } = this;
    this.stroke = null;
    const isIdle = stroke.tool === "move" ? stroke.done === 0 : stroke.swell === 0;
    if (!isCancelled && !isIdle) this.editor.finish(stroke);
    this.editor.end(isCancelled || isIdle);
    if (!isCancelled && !isIdle) this.editor.messages.announce(`${stroke.name} done`);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  /**
   * Handle a key; returns whether the brush uses it.
   * @param arrow the direction of an arrow key
   */
  key(key: string, event: KeyboardEvent, arrow?: Vector2) {
    const { editor } = this,
      { height, width } = editor.viewport.view,
      middle: Vector2 = [width / 2, height / 2];
    const size = keyPlace(editor.keys, "brush-radius", key);
    if (size >= 0) {
      this.grow(size ? 1 : -1);
      return true;
    }
    if (key === "Escape") {
      if (this.stroke) this.lift(true);
      else this.stop();
      return true;
    }
    if (arrow) {
      const step = BRUSH_KEYS[event.shiftKey ? 0 : 1]!;
      const [x, y] = this.at ?? middle,
        next: Vector2 = [x + step * arrow[0], y + step * arrow[1]];
      if (this.stroke) this.drag(next);
      else this.at = next;
      this.isByKeys = true;
      editor.messages.announce(`brush at ${editor.viewport.placeAt(next).map(formatLength).join(", ")}`);
      editor.frames.invalidate();
      return true;
    }
    if (key !== "Enter") return false;
    if (this.stroke) this.lift();
    else {
      this.press(this.at ?? middle);
      editor.messages.announce(this.stroke ? "brush pressed" : "no stroke here");
    }
    return true;
  }
}
