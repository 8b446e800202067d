// The window of a picture of grey values, changed by the tool, or by a drag with the right button. And the bar
// of the tool.

import { mapVector } from "../maths/camera.ts";
import { RestingTrait } from "../sync/edits.ts";
import type { Vector2 } from "../types.ts";
import { setText } from "../ui/dom.ts";
import { WindowGesture } from "./gestures.ts";
import { OptionBar } from "./option_bar.ts";
import type { EditorParts } from "./parts.ts";

const WIDTH_PIXELS = 150; // CSS pixels of a drag to the right that make the window e times as wide
const LEVEL_PIXELS = 300; // CSS pixels of a drag upwards that raise the level by a width of the window
const KEY_PIXELS = [4, 20]; // CSS pixels of a drag that an arrow key with and without Shift equals
const STEPS = 1000; // of the range of values, at least: what widths and levels are rounded to
const WIDEST = 4; // times the range of values
const HINT = "Drag left and right for the width, up and down for the level; double-click resets, Esc ends";
const NO_WINDOW = "Only pictures of grey values have a window: a slice, the maximum or the mean";

const clamp = (value: number, least: number, most: number) => Math.max(least, Math.min(most, value));

/** The exponent of ten of the step to which values of a range are rounded. */
function exponent([first, last]: Vector2) {
  return Math.floor(Math.log10((last - first) / STEPS));
}

/** The step to which the values of a window are rounded. */
export function windowStep(range: Vector2) {
  return 10 ** exponent(range);
}

/** A value of a range, rounded as it is shown. */
export function formatValue(value: number, range: Vector2) {
  return Number(value.toFixed(clamp(-exponent(range), 0, 20)));
}

/**
 * The window after a drag by CSS pixels: to the right it gets wider, upwards its level rises.
 * @param window the values shown as black and white
 * @param range the smallest and the largest value of the picture
 */
export function dragWindow([low, high]: Vector2, [dx, dy]: Vector2, [first, last]: Vector2): Vector2 {
  const step = windowStep([first, last]),
    whole = last - first;
  const rounded = (value: number) => Math.round(value / step) * step;
  const width = rounded(clamp((high - low) * Math.exp(dx / WIDTH_PIXELS), step, WIDEST * whole));
  const level = rounded(clamp((low + high) / 2 - (dy / LEVEL_PIXELS) * (high - low), first, last));
  const ends: Vector2 = [level - width / 2, level + width / 2];
  return mapVector(ends, (value) => Number(value.toPrecision(15)));
}

/** Such as "window 80, level 40 HU". */
export function windowWords([low, high]: Vector2, range: Vector2, unit: string) {
  const words = `window ${formatValue(high - low, range)}, level ${formatValue((low + high) / 2, range)}`;
  return unit ? `${words} ${unit}` : words;
}

/** Dependencies of the tool of the window on the editor. */
export type WindowEditor = EditorParts<"model" | "frames" | "messages" | "stage" | "picture", "modes">;

/** The tool, and a drag of the window under way. */
export class WindowTool {
  trait: RestingTrait;
  bar: OptionBar;
  value: HTMLSpanElement;

  isOn = false;

  /** The trait's window when a drag began. */
  from: Vector2 | null = null;

  /** The same in values. */
  start: Vector2 = [0, 1];

  constructor(readonly editor: WindowEditor) {
    this.trait = new RestingTrait(editor.model, "window");
    this.bar = new OptionBar(editor, "", "Window");
    this.value = this.bar.text("dnb-ed-brush-value");
    const automatic = "automatic window (Home, or double-click)";
    this.bar.button("Auto", "Auto", () => this.reset(), automatic);
    const done = () => {
      this.stop();
      editor.stage.focus();
    };
    this.bar.button("Done", "Done", done, "put the tool away");
  }

  /** The values of the picture, and its unit; null without a picture of grey values. */
  get #grey() {
    return this.editor.picture.painter.source?.grey ?? null;
  }

  /** The values shown as black and white. */
  get window(): Vector2 | null {
    const own: Vector2 | [] = this.editor.model.get("window") ?? [];
    return own.length === 2 ? own : (this.#grey?.window ?? null);
  }

  get words() {
    const { window } = this,
      grey = this.#grey;
    return grey && window ? windowWords(window, grey.range, grey.unit) : "";
  }

  /** Show the picture in the window of the trait. */
  apply() {
    if (this.window) this.editor.picture.setWindow(this.window);
    this.editor.frames.markMoving();
  }

  toggle() {
    const { editor } = this;
    if (this.stop()) return;
    if (!this.#grey) {
      editor.messages.hint(NO_WINDOW, 5000);
      return;
    }
    editor.tools.modes.deactivateTools();
    editor.tools.modes.setAdding(false);
    editor.tools.modes.setSelecting(false);
    this.isOn = true;
    editor.stage.element.classList.add("dnb-ed-windowing");
    editor.messages.hint(HINT, 8000);
    editor.messages.announce(
      `${this.words}: left and right change the width, up and down the level, Home resets, Escape ends`,
    );
    editor.stage.focus();
    editor.frames.invalidate();
  }

  /** False if the tool was not in use. */
  stop() {
    if (!this.isOn) return false;
    this.end(true);
    this.isOn = false;
    this.editor.stage.element.classList.remove("dnb-ed-windowing");
    this.editor.messages.hideHint([HINT]);
    this.editor.frames.invalidate();
    return true;
  }

  show() {
    this.bar.element.hidden = !this.isOn;
    if (this.isOn) setText(this.value, this.words);
  }

  close() {
    this.trait.close();
  }

  // ---- drags and keys -----------------------------------------------------------------------------------------------

  ignores(isOthers: boolean) {
    return isOthers;
  }

  grab(at: Vector2) {
    return new WindowGesture(at, this, null);
  }

  begin() {
    const { window, editor } = this;
    if (!window || !this.#grey) {
      editor.messages.hint(NO_WINDOW, 5000);
      return;
    }
    this.trait.close(); // a change by keys is sent with the drag
    this.from = editor.model.get("window") ?? [];
    this.start = window;
  }

  /** @param by CSS pixels since the drag began */
  drag(by: Vector2) {
    const grey = this.#grey;
    if (!this.from || !grey) return;
    this.#set(dragWindow(this.start, by, grey.range));
  }

  end(isCancelled: boolean) {
    const { from, editor } = this;
    if (!from) return;
    this.from = null;
    if (isCancelled) this.#set(from);
    else {
      editor.model.save_changes();
      editor.messages.announce(this.words);
    }
  }

  reset() {
    this.trait.close();
    this.#set([]);
    this.editor.model.save_changes();
    this.editor.messages.announce(`automatic ${this.words}`);
  }

  /**
   * Show a window that is being changed.
   * @param window empty for the automatic one
   */
  put(window: Vector2 | []) {
    this.editor.model.set("window", window);
    this.apply();
  }

  /** Send the window that is shown. */
  keep() {
    this.trait.close();
    this.editor.model.save_changes();
    this.editor.messages.announce(this.words);
  }

  /** @param window empty for the automatic one */
  #set(window: Vector2 | []) {
    this.put(window);
    if (!this.isOn) this.editor.messages.hint(this.words); // else the bar shows it
  }

  /**
   * Handle a key; returns whether the tool uses it.
   * @param arrow the direction of an arrow key
   */
  key(key: string, event: KeyboardEvent, arrow?: Vector2) {
    const grey = this.#grey,
      { window } = this;
    if (key === "Home") {
      this.reset();
      return true;
    }
    if (!arrow || !grey || !window) return false;
    const pixels = KEY_PIXELS[event.shiftKey ? 0 : 1]!;
    const next = dragWindow(window, [pixels * arrow[0], pixels * arrow[1]], grey.range);
    this.#set(next);
    this.trait.sendSoon(next);
    this.editor.messages.announce(this.words);
    return true;
  }
}
