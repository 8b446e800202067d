// Small parts of a view: its scale bar, size, captions and letters of directions, and the alternation of the
// layers of a picture that flickers.

import { AXES, perAxis } from "../maths/axes.ts";
import { scaled, sideOf } from "../maths/camera.ts";
import type { Handlers, Matrix3, Model, ModelHandler, Sides, Vector2, Vector3 } from "../types.ts";
import { pageElement, setText } from "./dom.ts";

const BAR = { least: 44, most: 120, share: 0.22 }; // CSS pixels, and of the picture's width at most
const NO_SCALE =
  "In perspective there is no scale for the whole picture: near objects are larger. " + "Parallel views have a scale.";

/** The largest of 1, 2, 5 times a power of ten that is at most so long. */
export function roundLength(most: number) {
  const ten = 10 ** Math.floor(Math.log10(most) + 1e-9);
  return ten * ([5, 2, 1].find((n) => n * ten <= most * (1 + 1e-9)) ?? 1);
}

const METRIC = ["pm", "nm", "\u00b5m", "mm", "m", "km"]; // a thousand of each are one of the next

/**
 * A round length with its unit: 50 mm, 20 m where mm would have five digits, 20 \u00b5m below a tenth of a mm.
 * @param unit "" where it is not known
 */
export function lengthText(length: number, unit: string) {
  let at = METRIC.indexOf(unit),
    shown = length;
  while (at >= 0 && shown >= 1e4 && at < METRIC.length - 1) {
    shown /= 1000;
    at += 1;
  }
  while (at > 0 && shown < 0.1) {
    shown *= 1000;
    at -= 1;
  }
  return `${Number(shown.toPrecision(1))} ${METRIC[at] ?? unit}`.trim();
}

/** In CSS pixels */
export type Size = { width: number; height: number };

/** A bar of 1, 2 or 5 times a power of ten, with its length in the volume. */
export class ScaleBar {
  element: HTMLDivElement;
  text: HTMLSpanElement;
  bar: HTMLDivElement;

  constructor(root: Element) {
    this.element = pageElement("div", "dnb-scale", root, { hidden: "" });
    this.text = pageElement("span", "dnb-scale-text", this.element);
    this.bar = pageElement("div", "dnb-scale-bar", this.element, { "aria-hidden": "true" });
  }

  /**
   * @param camera height: of the view, a length in space; bend: of a perspective
   * @param unit none shows no bar
   * @param box of the view
   * @param parts pictures side by side
   */
  write(
    { height, bend }: { height: number; bend: number },
    unit: string | null | undefined,
    box: Size,
    parts: number = 1,
  ) {
    this.element.hidden = typeof unit !== "string" || !(height > 0 && box.height > 0);
    if (typeof unit !== "string" || this.element.hidden) return;
    this.element.classList.toggle("dnb-scale-none", bend > 0);
    this.element.title = bend > 0 ? NO_SCALE : "";
    if (bend > 0) {
      setText(this.text, "perspective");
      return;
    }
    const most = Math.max(BAR.least, Math.min(BAR.most, (BAR.share * box.width) / parts));
    const pixel = height / box.height,
      length = roundLength(most * pixel);
    this.bar.style.width = `${(length / pixel).toFixed(1)}px`;
    setText(this.text, lengthText(length, unit));
  }
}

/** The views of the sides of a patient: name, letter and words. */
export const SIDES = [
  ["+y", "A", "from the front"],
  ["-y", "P", "from behind"],
  ["-x", "L", "from the left"],
  ["+x", "R", "from the right"],
  ["-z", "S", "from above"],
  ["+z", "I", "from below"],
] as const;
export type Side = (typeof SIDES)[number][0];
export type ViewName = Side | "home";

const LETTER_SIDES = ["left", "right", "top", "bottom"] as const;
type LetterSide = (typeof LETTER_SIDES)[number];

const FLICKER_MS = 700; // long enough to inspect one place, short enough to see it move

/**
 * Give a view's root the size of its model's traits, as far as there is room; returns its size in CSS pixels and the
 * pixels of the screen for one of them.
 */
export function stageSize(root: HTMLElement, host: HTMLElement, model: Model) {
  const width = model.get("width"),
    height = model.get("height");
  root.style.width = `${width}px`;
  root.style.setProperty("--dnb-shape", `${width} / ${height}`);
  root.style.maxHeight = `${height}px`;
  root.classList.toggle("dnb-fill", Boolean(model.get("fill"))); // instead the size of its container
  host.style.minWidth = "0"; // in a row of widgets it shrinks instead of being cut off
  const ratio = Math.min(2, window.devicePixelRatio || 1),
    box = root.getBoundingClientRect();
  return { width: box.width || width, height: box.height || height, ratio };
}

/** The overlay of a view: a value of its trait `shows`. */
export type Shows = "deformed" | "original" | "side_by_side" | "flicker" | "wipe" | "fade";
const CAPTIONS: Record<"deformed" | "original" | "side_by_side", string[]> = {
  deformed: [""],
  original: ["original"],
  side_by_side: ["original", "deformed"],
};
const COARSE = "cuts of the first steps are shown roughly"; // where more than one step before the last has some

/** Remarks on the picture for the user: their sources, kinds and texts. */
export function remarksOn({
  info,
  field,
  caster,
  isScarce,
}: {
  info?: { note?: string } | null;
  field?: { coarse?: boolean } | null;
  caster?: { folds: boolean } | null;
  isScarce?: boolean;
}) {
  const note = info?.note ?? "";
  return [
    ["folds", "warning", caster?.folds ? "the map folds: tissue there is red" : ""],
    ["cuts", "info", field?.coarse ? COARSE : ""],
    ["resolution", "info", note && isScarce ? `${note}, as much as the graphics memory holds` : note],
  ] as const;
}

/** The caption of each picture; layer: the one that is seen of a picture that flickers. */
export function captionsOf(shows: Shows, layer: number) {
  if (shows === "wipe") return ["original | deformed"];
  if (shows === "fade") return ["original over deformed"];
  return shows === "flicker" ? [layer ? "original" : "deformed"] : CAPTIONS[shows];
}

/** The same in words, to follow a name. */
export function altText(shows: Shows) {
  if (shows === "deformed") return "";
  if (shows === "wipe") return ", original left of a line and deformed right of it";
  if (shows === "fade") return ", original laid over deformed";
  return shows === "flicker" ? ", original and deformed alternating" : `, ${CAPTIONS[shows].join(" and ")}`;
}

/** `whole`: the columns of a larger picture that this one is a part of. */
export type Picture = {
  layer: number;
  original: boolean;
  x: number;
  width: number;
  whole?: { x: number; width: number };
};

/**
 * The pictures in a canvas of this width: see FrameLoop.
 * @param wipe share of the width that shows the original in the mode "wipe"
 */
export function picturesOf(shows: Shows, width: number, wipe: number = 0.5): Picture[] {
  const one = (layer: number, original: boolean, x: number, w: number): Picture => ({
    layer,
    original,
    x,
    width: w,
  });
  const half = Math.floor(width / 2);
  if (shows === "side_by_side") return [one(0, true, 0, half), one(0, false, half, width - half)];
  if (shows === "wipe") {
    const cut = Math.round(width * wipe),
      whole = { x: 0, width };
    return [one(0, true, 0, cut), one(0, false, cut, width - cut)]
      .filter((part) => part.width > 0)
      .map((part) => ({ ...part, whole }));
  }
  if (shows === "flicker" || shows === "fade") return [one(0, false, 0, width), one(1, true, 0, width)];
  return [one(0, shows === "original", 0, width)];
}

/** The corners of a box along the axes of a volume, from its middle, in space. */
export function boxCorners({ low, high }: Sides, axes: Matrix3) {
  const half = perAxis((i) => (high[i] - low[i]) / 2);
  return [0, 1, 2, 3, 4, 5, 6, 7].map((k) =>
    perAxis((row) => AXES.reduce<number>((sum, j) => sum + axes[row][j] * (k & (1 << j) ? half[j] : -half[j]), 0)),
  );
}

/**
 * Handle an event of a model; errors go to `fail`, and `handlers` collects the handlers to be removed at the end.
 */
export function listen(
  model: Model,
  name: string,
  handler: (...given: Parameters<ModelHandler>) => unknown,
  handlers: Handlers,
  fail: (error: unknown) => void,
) {
  const guarded: ModelHandler = (...given) => {
    try {
      const result = handler(...given);
      if (result instanceof Promise) result.catch(fail);
    } catch (error) {
      fail(error);
    }
  };
  model.on(name, guarded);
  handlers.push([name, guarded]);
}

/** The function that closes a view that has just been drawn. */
export function closerOf(view: { elements: { root: HTMLElement }; close: () => void }) {
  Object.assign(view.elements.root, { deformnb: view }); // for tests and for debugging
  return () => view.close();
}

/** The measurements of a FrameLoop, as they are sent to Python. */
export function renderStats({
  times: { drag, full, passes, frames },
  quick: { scale },
  caster: {
    size: [width, height],
  },
}: {
  times: { drag: number[]; full: number; passes: number; frames: number };
  quick: { scale: number };
  caster: { size: Vector2 };
}) {
  const sorted = [...drag].sort((a, b) => a - b);
  return { drag_ms: sorted[sorted.length >> 1] || 0, full_ms: full, passes, frames, scale, width, height };
}

/**
 * A caption and four letters of directions over each picture that is seen, one or two side by side, and a scale.
 */
export class Frames {
  scale: ScaleBar;
  frames: { frame: HTMLDivElement; caption: HTMLDivElement; letters: Record<LetterSide, HTMLSpanElement> }[];

  constructor(root: Element) {
    this.scale = new ScaleBar(root);
    this.frames = [0, 1].map(() => {
      const frame = pageElement("div", "dnb-frame", root, { "aria-hidden": "true" }),
        letter = (side: LetterSide) => pageElement("span", `dnb-letter dnb-${side}`, frame);
      return {
        frame,
        caption: pageElement("div", "dnb-caption", frame),
        letters: { left: letter("left"), right: letter("right"), top: letter("top"), bottom: letter("bottom") },
      };
    });
  }

  /** @param captions one for each picture; an empty one is hidden */
  show(captions: string[]) {
    this.frames.forEach(({ frame, caption }, i) => {
      frame.hidden = i >= captions.length;
      frame.style.left = `${(100 * i) / captions.length}%`;
      frame.style.width = `${100 / captions.length}%`;
      caption.textContent = captions[i] || "";
      caption.hidden = !captions[i];
    });
  }

  /**
   * Write the letters of the directions and the scale.
   * @param unit of lengths; without one there is no scale
   * @param box of the view
   * @param isAnatomical whether the sides of a patient are known
   */
  write(
    camera: { right: Vector3; up: Vector3; height: number; bend: number },
    unit?: string | null | undefined,
    box: Size = { width: 0, height: 0 },
    isAnatomical = true,
  ) {
    const { right, up } = camera;
    this.scale.write(camera, unit, box, this.frames.filter(({ frame }) => !frame.hidden).length || 1);
    const ways = { left: scaled(right, -1), right, top: up, bottom: scaled(up, -1) };
    for (const { letters } of this.frames)
      for (const side of LETTER_SIDES) setText(letters[side], sideOf(ways[side], isAnatomical));
  }
}

/** Alternates two layers while they are visible and the user does not prefer reduced motion; else a press does. */
export class Flicker {
  layer = 0;
  isOn = false;
  isPaused = false;
  isSeen = true;
  timer = 0;
  still: MediaQueryList;
  look: () => void;
  observer: IntersectionObserver;

  constructor(
    root: Element,
    readonly flip: (layer: number) => void,
  ) {
    this.still = window.matchMedia("(prefers-reduced-motion: reduce)");
    this.look = () => this.#run();
    this.still.addEventListener("change", this.look);
    document.addEventListener("visibilitychange", this.look);
    this.observer = new IntersectionObserver((entries) => {
      this.isSeen = Boolean(entries.at(-1)?.isIntersecting);
      this.#run();
    });
    this.observer.observe(root);
  }

  /** Start or end; the first layer is shown in both cases. */
  set(isOn: boolean) {
    this.isOn = isOn;
    this.isPaused = false;
    this.layer = 0;
    this.#run();
  }

  turn() {
    this.layer = 1 - this.layer;
    this.flip(this.layer);
  }

  /** A press: with reduced motion it shows the other layer; else the space key stops and continues. */
  press(isKey: boolean) {
    if (!this.isOn) return false;
    if (this.still.matches) this.turn();
    else if (isKey) {
      this.isPaused = !this.isPaused;
      this.#run();
    }
    return true;
  }

  #run() {
    clearInterval(this.timer);
    this.timer = 0;
    const isFree = this.isOn && !this.isPaused && this.isSeen && !document.hidden && !this.still.matches;
    if (isFree) this.timer = setInterval(() => this.turn(), FLICKER_MS);
  }

  close() {
    clearInterval(this.timer);
    this.isOn = false;
    this.still.removeEventListener("change", this.look);
    document.removeEventListener("visibilitychange", this.look);
    this.observer.disconnect();
  }
}
