// The colour bar of a picture of grey values: its colours along the values, and two handles that set the window.

import type { Vector2 } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.ts";
import { context2d } from "./painter.ts";
import type { EditorParts } from "./parts.ts";
import { formatValue, windowStep } from "./window_tool.ts";

const ROWS = 256;
const AIR = 0.3; // of the automatic window, on either side of it
const KEY_STEPS = [0.01, 0.1]; // of the bar, of an arrow key, and with Shift
const LEAST_HEIGHT = 60,
  MARGIN = 56; // CSS pixels

/** Dependencies of the bar on the editor. */
export type ColourBarEditor = EditorParts<"frames" | "stage" | "viewport" | "picture", "window">;

export class ColourBar {
  root: HTMLDivElement;
  canvas: HTMLCanvasElement;
  context: CanvasRenderingContext2D;
  unit: HTMLSpanElement;
  handles: HTMLDivElement[];

  /** The values at the lower and the upper end of the bar. */
  ends: Vector2 = [0, 1];

  /** The handle that is dragged: 0 black, 1 white. */
  held: number | null = null;

  drawn = "";

  constructor(readonly editor: ColourBarEditor) {
    this.root = pageElement("div", "dnb-ed-colours", editor.stage.element, {
      hidden: "",
      role: "group",
      "aria-label": "Colour bar",
    });
    this.canvas = pageElement("canvas", "", this.root, { width: 1, height: ROWS, "aria-hidden": "true" });
    this.context = context2d(this.canvas);
    this.unit = pageElement("span", "dnb-ed-colours-unit", this.root);
    this.handles = ["black", "white"].map((name, k) => {
      const handle = pageElement("div", "dnb-ed-colours-handle", this.root, {
        role: "slider",
        tabindex: "0",
        "aria-orientation": "vertical",
        title: `Drag: the value shown as ${name}; double-click: automatic window`,
        "aria-label": `Value shown as ${name}`,
        ...OWN_KEYS,
      });
      const on = <K extends keyof HTMLElementEventMap>(type: K, handler: (event: HTMLElementEventMap[K]) => void) =>
        handle.addEventListener(type, (event) => editor.frames.guard(() => handler(event)));
      on("pointerdown", (event) => this.#hold(event, k));
      on("pointermove", (event) => this.#drag(event));
      for (const type of ["pointerup", "pointercancel"] as const) on(type, () => this.#drop());
      on("keydown", (event) => this.#key(event, k));
      on("dblclick", (event) => {
        event.stopPropagation();
        editor.tools.window.reset();
      });
      return handle;
    });
  }

  /** Show the bar next to grey values in colours, and while their window is changed. */
  update() {
    const { editor, held } = this,
      {
        tools: { window: windowTool },
        viewport: { view },
        picture: { painter },
      } = editor,
      grey = painter.source?.grey,
      { window } = windowTool;
    const height = view.height - 2 * MARGIN;
    const isShown = Boolean(
      grey && window && (windowTool.isOn || windowTool.from || held !== null || editor.picture.hasColours),
    );
    this.root.hidden = !isShown || height < LEAST_HEIGHT;
    if (this.root.hidden || !grey || !window) return;
    if (held === null) this.ends = this.#endsFor(window, grey.window);
    const [first, last] = this.ends,
      key = JSON.stringify([window, this.ends, [...painter.colours.slice(100, 102)]]);
    if (key !== this.drawn) this.#draw(window);
    this.drawn = key;
    this.root.style.height = `${Math.min(240, height)}px`;
    setText(this.unit, grey.unit);
    for (const [k, handle] of this.handles.entries()) {
      handle.style.bottom = `${(100 * (window[k]! - first)) / (last - first)}%`;
      const value = String(formatValue(window[k]!, grey.range));
      setText(handle, value);
      setAttributes(handle, {
        "aria-valuenow": value,
        "aria-valuemin": formatValue(first, grey.range),
        "aria-valuemax": formatValue(last, grey.range),
        "aria-valuetext": `${value} ${grey.unit}`.trim(),
      });
    }
  }

  /** The automatic window with some air, and the window itself. */
  #endsFor([low, high]: Vector2, [first, last]: Vector2): Vector2 {
    const air = AIR * (last - first);
    return [Math.min(low, first - air), Math.max(high, last + air)];
  }

  #draw([low, high]: Vector2) {
    const {
      context,
      ends: [first, last],
      editor: {
        picture: {
          painter: { colours },
        },
      },
    } = this;
    const image = context.createImageData(1, ROWS),
      pixels = new Uint32Array(image.data.buffer);
    for (let row = 0; row < ROWS; row++) {
      const value = last! + ((first! - last!) * (row + 0.5)) / ROWS,
        share = Math.max(0, Math.min(1, (value - low) / (high - low)));
      pixels[row] = colours[Math.floor(255 * share + 0.5)]!;
    }
    context.putImageData(image, 0, 0);
  }

  #hold(event: PointerEvent, k: number) {
    event.stopPropagation();
    if (event.button !== 0) return;
    this.held = k;
    this.handles[k]!.setPointerCapture(event.pointerId);
  }

  #drag(event: PointerEvent) {
    if (this.held === null) return;
    const { top, height } = this.canvas.getBoundingClientRect(),
      [first, last] = this.ends;
    const share = Math.max(0, Math.min(1, (event.clientY - top) / height));
    this.editor.tools.window.put(this.#moveValue(this.held, last + (first - last) * share));
  }

  #drop() {
    if (this.held === null) return;
    this.held = null;
    this.editor.tools.window.keep();
  }

  #key(event: KeyboardEvent, k: number) {
    const ways = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 },
      windowTool = this.editor.tools.window;
    const way = ways[event.key as keyof typeof ways],
      { window } = windowTool;
    if (event.key === "Tab" || event.key === "Escape") return;
    event.stopPropagation(); // keys of the picture would move points
    if (event.key === "Home") windowTool.reset();
    if (!way || !window) return;
    event.preventDefault();
    windowTool.put(
      this.#moveValue(k, window[k]! + way * KEY_STEPS[event.shiftKey ? 1 : 0]! * (this.ends[1]! - this.ends[0]!)),
    );
    windowTool.keep();
  }

  /** The window with one of its values moved, black below white. */
  #moveValue(k: number, value: number): Vector2 {
    const {
        tools: { window: windowTool },
        picture: { painter },
      } = this.editor,
      step = windowStep(painter.source?.grey?.range ?? [0, 1]);
    const [low, high]: Vector2 = windowTool.window ?? [0, 1],
      rounded = Number((Math.round(value / step) * step).toPrecision(15));
    return k === 0 ? [Math.min(rounded, high - step), high] : [low, Math.max(rounded, low + step)];
  }
}
