// How long things are on a picture: a bar of 1, 2 or 5 times a power of ten, as long as it is in the volume.

import { scaled, sideOf } from "../maths/camera.js";
import { pageElement, setText } from "./dom.js";

const BAR = { least: 44, most: 120, share: 0.22 }; // CSS pixels, and of the picture's width at most
const NO_SCALE = "In perspective no length holds for the whole picture: what is near is larger. Parallel views have a scale.";

/** The largest of 1, 2, 5 times a power of ten that is at most so long. */
function roundLength(most) {
  const ten = 10 ** Math.floor(Math.log10(most) + 1e-9), times = [5, 2, 1].find((n) => n * ten <= most * (1 + 1e-9)) ?? 1;
  return times * ten;
}

/** A round length with its unit: 50 mm, 20 m where mm would have five digits, 20 \u00b5m below a tenth of a mm. */
export function lengthText(length, unit) {
  const [factor, name] = unit !== "mm" ? [1, unit] : length >= 1e4 ? [1e-3, "m"] : length < 0.1 ? [1e3, "\u00b5m"] : [1, unit];
  return `${Number((length * factor).toPrecision(1))} ${name}`;
}

class ScaleBar {
  constructor(root) {
    this.root = root;
    this.element = pageElement("div", "dnb-scale", root, { hidden: "" });
    this.text = pageElement("span", "dnb-scale-text", this.element);
    this.bar = pageElement("div", "dnb-scale-bar", this.element, { "aria-hidden": "true" });
  }

  /** height: the length in space that the picture is high; bend: of a perspective; unit: none shows no bar; parts: side by side. */
  write({ height, bend }, unit, parts = 1) {
    const { clientWidth, clientHeight } = this.root;
    this.element.hidden = !(unit && height > 0 && clientHeight > 0);
    if (this.element.hidden) return;
    this.element.classList.toggle("dnb-scale-none", bend > 0);
    this.element.title = bend > 0 ? NO_SCALE : "";
    if (bend > 0) { setText(this.text, "perspective"); return; }
    const pixel = height / clientHeight, most = Math.max(BAR.least, Math.min(BAR.most, (BAR.share * clientWidth) / parts));
    const length = roundLength(most * pixel);
    this.bar.style.width = `${(length / pixel).toFixed(1)}px`;
    setText(this.text, lengthText(length, unit));
  }
}

// Small parts of a view's page: its size, captions and letters of directions, the page's theme, the turns of
// a picture that flickers.

export const VIEW_NAMES = { "+y": "A", "-y": "P", "-x": "L", "+x": "R", "-z": "S", "+z": "I" };
export const VIEW_TITLES = { A: "from the front", P: "from behind", L: "from the left", R: "from the right", S: "from above",
  I: "from below" };

const FLICKER_MS = 700; // long enough to look at one place, short enough to see it move

/** Gives a view's root the size that its model asks for, as far as there is room; returns its pixels. */
export function sized(root, host, model) {
  const width = model.get("width"), height = model.get("height");
  root.style.width = `${width}px`;
  root.style.setProperty("--dnb-shape", `${width} / ${height}`);
  root.style.maxHeight = `${height}px`;
  root.classList.toggle("dnb-fill", Boolean(model.get("fill"))); // the size of the box it stands in instead
  host.style.minWidth = "0"; // in a row of widgets it gets narrower instead of being cut off
  const ratio = Math.min(2, window.devicePixelRatio || 1), box = root.getBoundingClientRect();
  return [(box.width || width) * ratio, (box.height || height) * ratio].map(Math.round);
}

const CAPTIONS = { deformed: [""], original: ["original"], side_by_side: ["original", "deformed"] };
const COARSE = "cuts of the first steps are shown roughly"; // where more than one step before the last has some

/** What people must know of what they see. */
export function remarksOn({ info, field, caster, isScarce }) {
  return [info?.note && isScarce ? `${info.note}, as much as the graphics memory holds` : info?.note, field?.coarse && COARSE, caster?.folds && "red: where the map folds"].filter(Boolean).join("; ");
}

/** What stands over each picture; layer: the one that is seen of a picture that flickers. */
export function captionsOf(shows, layer) { return shows === "flicker" ? [["deformed", "original"][layer]] : CAPTIONS[shows]; }

/** The same in words, behind a name. */
export function aboutShown(shows) {
  return { deformed: "", flicker: ", original and deformed in turn" }[shows] ?? `, ${CAPTIONS[shows].join(" and ")}`;
}

/** What is seen in a canvas of this width: see FrameLoop. */
export function picturesOf(shows, width) {
  const one = (layer, original, x, w) => ({ layer, original, x, width: w }), half = Math.floor(width / 2);
  if (shows === "side_by_side") return [one(0, true, 0, half), one(0, false, half, width - half)];
  if (shows === "flicker") return [one(0, false, 0, width), one(1, true, 0, width)];
  return [one(0, shows === "original", 0, width)];
}

/** The corners of a box along the axes of a volume, from its middle, in space. */
export function boxCorners({ low, high }, axes) {
  const half = low.map((l, i) => (high[i] - l) / 2);
  return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((row) => [0, 1, 2].reduce((sum, j) => (
    sum + axes[row][j] * (k & (1 << j) ? half[j] : -half[j])), 0)));
}

/** Hears what a model tells; what goes wrong is said, and `handlers` keeps what is to be taken off at the end. */
export function listen(model, name, handler, handlers, fail) {
  const guarded = (...args) => {
    try {
      const result = handler(...args);
      if (result && result.catch) result.catch(fail);
    } catch (error) { fail(error); }
  };
  model.on(name, guarded);
  handlers.push([name, guarded]);
}

/** What ends a page that has just been drawn. */
export function opened(page) {
  page.root.deformnb = page; // for tests and for whoever looks into the page
  return () => page.close();
}

/** What a FrameLoop has measured, as Python is told. */
export function measuredBy({ times: { drag, full, passes, frames }, scale, caster: { canvas } }) {
  const sorted = [...drag].sort((a, b) => a - b);
  return { drag_ms: sorted[sorted.length >> 1] || 0, full_ms: full, passes, frames, scale, width: canvas.width,
    height: canvas.height };
}

/** A caption and four letters of directions over each picture that is seen, one or two side by side, and a scale. */
export class Frames {
  constructor(root) {
    this.scale = new ScaleBar(root);
    this.frames = [0, 1].map(() => {
      const frame = pageElement("div", "dnb-frame", root, { "aria-hidden": "true" });
      return { frame, caption: pageElement("div", "dnb-caption", frame),
        letters: ["left", "right", "top", "bottom"].map((side) => pageElement("span", `dnb-letter dnb-${side}`, frame)) };
    });
  }

  /** captions: one for each picture; empty shows none. */
  show(captions) {
    this.frames.forEach(({ frame, caption }, i) => {
      frame.hidden = i >= captions.length;
      frame.style.left = `${(100 * i) / captions.length}%`;
      frame.style.width = `${100 / captions.length}%`;
      caption.textContent = captions[i] || "";
      caption.hidden = !captions[i];
    });
  }

  /** unit: of lengths; without one nothing is told of them. */
  write(camera, unit) {
    const { right, up } = camera;
    this.scale.write(camera, unit, this.frames.filter(({ frame }) => !frame.hidden).length || 1);
    const texts = [sideOf(scaled(right, -1)), sideOf(right), sideOf(up), sideOf(scaled(up, -1))];
    for (const { letters } of this.frames) letters.forEach((letter, i) => { letter.textContent = texts[i]; });
  }
}

/** Whether the page around is dark: by Jupyter's word, by the colours of VS Code, else by the browser's preference. */
export class PageTheme {
  constructor(root, changed) {
    this.probe = pageElement("span", "dnb-paper", root, { hidden: "" });
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.changed = changed;
    this.dark.addEventListener("change", changed);
    this.observer = new MutationObserver(changed);
    this.observer.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
  }

  get name() {
    const told = document.body.dataset.jpThemeLight; // Jupyter's own word: in Voila the colours come after the widgets
    if (told !== undefined) return told === "false" ? "dark" : "light";
    const [r, g, b, alpha = 1] = (getComputedStyle(this.probe).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    const isDark = alpha > 0 && b !== undefined ? 0.2126 * r + 0.7152 * g + 0.0722 * b < 110 : this.dark.matches;
    return isDark ? "dark" : "light";
  }

  close() {
    this.dark.removeEventListener("change", this.changed);
    this.observer.disconnect();
  }
}

/** Turns between two layers, while it can be seen and motion is welcome; else a press turns them. */
export class Flicker {
  constructor(root, flip) {
    Object.assign(this, { flip, layer: 0, isOn: false, isPaused: false, isSeen: true });
    this.still = window.matchMedia("(prefers-reduced-motion: reduce)");
    this.look = () => this.#run();
    this.still.addEventListener("change", this.look);
    document.addEventListener("visibilitychange", this.look);
    this.observer = new IntersectionObserver((entries) => { this.isSeen = entries.at(-1).isIntersecting; this.#run(); });
    this.observer.observe(root);
  }

  /** Starts or ends; either way the first layer is shown. */
  set(isOn) {
    this.isOn = isOn;
    this.isPaused = false;
    this.layer = 0;
    this.#run();
  }

  turn() {
    this.layer = 1 - this.layer;
    this.flip(this.layer);
  }

  /** Space: where nothing moves by itself it turns, elsewhere it stops and goes on. A click turns, never stops. */
  press(isKey) {
    if (!this.isOn) return false;
    if (this.still.matches) this.turn();
    else if (isKey) { this.isPaused = !this.isPaused; this.#run(); }
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
