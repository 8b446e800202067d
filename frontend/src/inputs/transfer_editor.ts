// The transfer editor: opacity over the histogram of a volume, below it colours and the window of both.

import type { Node, NodeRules } from "../maths/curves.ts";
import { formatNumber, lineAt } from "../maths/curves.ts";
import type { Model, Vector2, Vector3, Vector4 } from "../types.ts";
import {
  ARROWS,
  buttonElement,
  iconElement,
  OWN_KEYS,
  pageElement,
  setAttributes,
  setText,
  svgElement,
  targetOf,
  treeOf,
} from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";
import { attributeUnder, listenToDrags, numberUnder, targetIndex } from "./base.ts";
import type { NodeDrag, PlotDrag } from "./curve_plot.ts";
import { CurvePlot, PLOT, pathOf } from "./curve_plot.ts";

/** A value and its red, green and blue, from 0 to 1. */
export type ColorStop = Vector4;

export type WindowPart = "level" | "low" | "high";

/** A state before a drag. */
export type Snapshot = { nodes: Node[]; colors: ColorStop[]; named: string };

// ---- the part of the axis of values that is seen, and the window (no DOM) -------------------------------------------

const FINEST = 1 / 500; // share of the whole axis that is seen at most enlarged
const WHEEL_STEP = 0.0022; // of the logarithm of the scale, for a pixel of the wheel

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

/** A value, stretched from one window to another as TransferFunction.windowed does: both ends are met exactly. */
export function stretchValue(value: number, [first, last]: Vector2, [low, high]: Vector2) {
  return value === last ? high : Math.min(high, low + ((value - first) / (last - first)) * (high - low));
}

/** The window of a transfer function, from its first value to its last. */
export function windowOf(nodes: Node[], stops: ColorStop[]): Vector2 {
  const values = [...nodes, ...stops].map((row) => row[0]);
  return [Math.min(...values), Math.max(...values)];
}

/** A window after a drag of one end or of the whole ("level"): at least so wide, and within limits. */
export function moveWindow(
  [low, high]: Vector2,
  part: WindowPart,
  by: number,
  least: number,
  [first, last]: Vector2,
): Vector2 {
  if (part === "low") return [Math.max(Math.min(first, low), Math.min(high - least, low + by)), high];
  if (part === "high") return [low, Math.min(Math.max(last, high), Math.max(low + least, high + by))];
  const shift = Math.max(Math.min(first - low, 0), Math.min(Math.max(last - high, 0), by));
  return [low + shift, high + shift];
}

// ---- the colours: a strip, and under it stops that are dragged, added, removed and recoloured -----------------------

const TITLE = { class: "dnb-cv-text", "text-anchor": "end", "aria-hidden": "true" };
const STRIP = { top: 28, height: 12 }; // CSS pixels, from the floor of the plot
const PIN = "M0 -1L6 6V15.5H-6V6Z";

export function hexOf(rgb: Vector3) {
  return `#${rgb
    .map((v) =>
      Math.round(255 * Math.max(0, Math.min(1, v)))
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
}

export function rgbOf(hex: string): Vector3 {
  const part = (k: number) => parseInt(hex.slice(k, k + 2), 16) / 255;
  return [part(1), part(3), part(5)];
}

/** Red, green and blue at a value, linear between stops. */
export function colorAt(stops: ColorStop[], value: number): Vector3 {
  const part = (c: 1 | 2 | 3) =>
    lineAt(
      stops.map((stop) => [stop[0], stop[c]]),
      value,
    );
  return [part(1), part(2), part(3)];
}

/** Stops with one of them moved, in the same place among the others. No edit changes the given list. */
export function moveStop(stops: ColorStop[], k: number, value: number, [first, last]: Vector2): ColorStop[] {
  const low = k > 0 ? stops[k - 1]![0] : Math.min(first, stops[0]![0]);
  const high = k < stops.length - 1 ? stops[k + 1]![0] : Math.max(last, stops[stops.length - 1]![0]);
  const [, r, g, b] = stops[k]!;
  return stops.map((stop, j) => (j === k ? [Math.max(low, Math.min(high, value)), r, g, b] : stop));
}

/** Stops with another one that changes no colour, and its index. */
export function addStop(stops: ColorStop[], value: number): [ColorStop[], number] {
  const index = stops.findIndex((stop) => stop[0] > value),
    k = index < 0 ? stops.length : index;
  return [[...stops.slice(0, k), [value, ...colorAt(stops, value)], ...stops.slice(k)], k];
}

class ColorStops {
  group: SVGGElement;
  title: SVGTextElement;
  strip: SVGRectElement;
  ground: SVGRectElement;
  cancelDrag: () => boolean;
  picker: HTMLInputElement;

  chosen = 0;
  grips: SVGGElement[] = [];
  isPicking = false;

  /** @param fill of the strip */
  constructor(
    readonly view: TransferEditorView,
    fill: string,
  ) {
    this.group = svgElement("g", { class: "dnb-cv-stops" }, view.svg);
    this.title = svgElement("text", TITLE, this.group, "Colours");
    this.strip = svgElement("rect", { class: "dnb-cv-strip", fill, height: STRIP.height, rx: 2 }, this.group);
    // Double clicks go to this.
    this.ground = svgElement("rect", { class: "dnb-cv-hit", height: STRIP.height + 18 }, this.group);
    this.cancelDrag = listenToDrags(view, this.group, this);
    view.listen(this.group, "dblclick", (event) => this.#doubleClick(event));
    view.listen(this.group, "contextmenu", (event) => {
      const k = this.#at(event);
      if (k === null || view.isReadOnly) return;
      event.preventDefault();
      if (!event.ctrlKey) this.remove(k); // with Ctrl it is a click on a Mac
    });
    // The browser's own input of a colour, for the bar.
    this.picker = pageElement("input", "dnb-cv-color", null, { type: "color", ...OWN_KEYS });
    view.listen(this.picker, "input", () => this.#recolour());
    view.listen(this.picker, "change", () => {
      this.#recolour();
      this.#picked();
    });
    view.listen(this.picker, "blur", () => this.#picked());
  }

  get stops() {
    return this.view.colors;
  }

  /** The value that Python receives. */
  value() {
    return { colors: this.stops.map(([value, ...rgb]) => [value, hexOf(rgb)]) };
  }

  words(k: number) {
    const [value, ...rgb] = this.stops[k]!;
    return `value ${this.view.shownValue(value)}, colour ${hexOf(rgb)}`;
  }

  facts() {
    return `Colour ${this.chosen + 1} of ${this.stops.length}: ${this.words(this.chosen)}`;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The index of the stop under the pointer. */
  #at(event: MouseEvent) {
    return numberUnder(event, this.group, "data-stop");
  }

  #show(stops: ColorStop[], chosen: number = this.chosen) {
    this.chosen = chosen;
    this.view.apply({ colors: stops });
  }

  choose(k: number) {
    this.chosen = k;
    this.view.choose(this);
  }

  press(event: PointerEvent) {
    const { view } = this,
      k = view.isReadOnly ? null : this.#at(event);
    if (k === null) return null;
    view.settle();
    this.grips[k]!.focus({ preventScroll: true });
    this.choose(k);
    view.isHeld = true;
    return { k, from: view.toPixel([this.stops[k]![0], 0])[0], before: view.snapshot() };
  }

  drag({ k, from, before }: { k: number; from: number; before: Snapshot }, [dx]: Vector2) {
    const { view } = this,
      [value] = view.tidy(view.toPlace([from + dx, 0]));
    this.#show(moveStop(before.colors, k, value, view.range), k);
    view.move(this.value());
  }

  drop({ before }: { before: Snapshot }, isCancelled: boolean, isClick: boolean) {
    this.view.endDrag(this, before, isCancelled, isClick);
  }

  nudge(k: number, by: number) {
    const { view } = this;
    view.beginNudge(this);
    this.#show(moveStop(this.stops, k, this.stops[k]![0] + by, view.range), k);
    view.reveal(this.stops[k]![0]);
    view.move(this.value());
  }

  add(value: number) {
    const { view } = this;
    if (view.isReadOnly) return;
    view.settle();
    if (this.stops.length >= view.rules().most) {
      view.showMessage("There is no room for another colour.");
      return;
    }
    this.#show(...addStop(this.stops, value));
    view.choose(this);
    view.commitOf(this);
    this.#focus();
    view.announce(`added ${this.words(this.chosen)}`);
  }

  /** Between a stop and the next, or where there is more room on the other side of the last. */
  addChosen() {
    const { stops, view } = this,
      k = this.chosen,
      next = stops[k + 1]?.[0] ?? view.range[1];
    const at = k === stops.length - 1 && next - stops[k]![0] <= 0 && k > 0 ? stops[k - 1]![0] : next;
    this.add((stops[k]![0] + at) / 2);
  }

  get canRemove() {
    return this.stops.length > 1;
  }

  remove(k: number) {
    const { view } = this;
    if (view.isReadOnly) return;
    view.settle();
    if (!this.canRemove) {
      view.showMessage("One colour stays.");
      return;
    }
    const hadFocus = this.group.contains(treeOf(view.root).activeElement);
    this.#show(
      this.stops.filter((_, j) => j !== k),
      Math.min(k, this.stops.length - 2),
    );
    view.commitOf(this);
    if (hadFocus) this.#focus();
    else view.draw();
    view.announce(`removed; ${this.stops.length} colours are left`);
  }

  removeChosen() {
    this.remove(this.chosen);
  }

  #focus() {
    this.view.draw();
    this.grips[this.chosen]!.focus({ preventScroll: true });
  }

  #doubleClick(event: MouseEvent) {
    event.preventDefault();
    event.stopPropagation();
    const k = this.#at(event),
      { view } = this;
    if (k !== null) {
      this.choose(k);
      this.pick();
      return;
    }
    this.add(view.tidy(view.toPlace(view.pointOf(event)))[0]);
  }

  /** Opens the browser's colours where scripts are allowed to; else focuses the input. */
  pick() {
    if (this.view.isReadOnly) return;
    this.view.draw();
    this.picker.focus({ preventScroll: true });
    try {
      this.picker.showPicker();
    } catch {
      /* only a click of the user may: Enter opens them */
    }
  }

  #recolour() {
    const { view } = this,
      [r, g, b] = rgbOf(this.picker.value),
      [, ...rgb] = this.stops[this.chosen]!;
    if (view.isReadOnly || hexOf(rgb) === this.picker.value) return;
    this.isPicking = view.isHeld = true;
    this.#show(this.stops.map((stop, j) => (j === this.chosen ? [stop[0], r, g, b] : stop)));
    view.choose(this);
    view.move(this.value());
  }

  #picked() {
    if (!this.isPicking) return;
    this.isPicking = false;
    this.view.commitOf(this);
  }

  /** Returns whether the key is one of the stops. */
  key(event: KeyboardEvent) {
    const k = targetIndex(this.grips, event),
      { view } = this;
    if (k < 0 || view.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(k, (step[0] - step[1]) * view.valueStep(event.shiftKey));
    else if (event.key === "Delete" || event.key === "Backspace") this.remove(k);
    else if (event.key.toLowerCase() === "a") this.addChosen();
    else if (event.key === "Enter" || event.key === " ") {
      view.settle();
      this.choose(k);
      this.pick();
    } else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** @param floor of the plot, in pixels */
  draw(floor: number) {
    const { view } = this,
      { left, width } = view.box,
      top = floor + STRIP.top;
    this.chosen = Math.min(this.chosen, this.stops.length - 1);
    setAttributes(this.title, { x: left - 11, y: top + 10 });
    setAttributes(this.strip, { x: left, y: top, width });
    setAttributes(this.ground, { x: left, y: top, width });
    while (this.grips.length > this.stops.length) this.grips.pop()?.remove();
    while (this.grips.length < this.stops.length) this.grips.push(this.#grip(this.grips.length));
    const [first, last] = view.range;
    this.stops.forEach(([value, ...rgb], k) => {
      const [x] = view.toPixel([value, 0]),
        grip = this.grips[k]!,
        isChosen = k === this.chosen;
      setAttributes(grip, {
        transform: `translate(${x.toFixed(2)} ${top + STRIP.height})`,
        tabindex: 0,
        "aria-label": `colour ${k + 1} of ${this.stops.length}`,
        "aria-valuetext": this.words(k),
        "aria-valuenow": value,
        "aria-valuemin": first,
        "aria-valuemax": last,
        "aria-readonly": view.isReadOnly,
      });
      grip.querySelector(".dnb-cv-pin")?.setAttribute("fill", hexOf(rgb));
      grip.classList.toggle("dnb-cv-chosen", isChosen && view.row === this);
      grip.style.display = view.isSeen(value) ? "" : "none";
    });
    this.#drawPicker();
  }

  #grip(k: number) {
    const { view } = this;
    const grip = svgElement("g", { class: "dnb-cv-grip", "data-stop": k, role: "slider", ...OWN_KEYS }, this.group);
    svgElement("rect", { class: "dnb-cv-hit", x: -10, y: -STRIP.height, width: 20, height: STRIP.height + 18 }, grip);
    svgElement("path", { class: "dnb-cv-ring", d: PIN }, grip);
    svgElement("path", { class: "dnb-cv-pin", d: PIN }, grip);
    const tip = "Drag; double click or Enter: another colour; right click or Del: remove";
    svgElement("title", {}, grip, tip);
    view.listen(grip, "focus", () => {
      if (!view.isHeld) this.choose(this.grips.indexOf(grip));
    });
    return grip;
  }

  #drawPicker() {
    const { picker, view } = this,
      [value, ...rgb] = this.stops[this.chosen]!,
      hex = hexOf(rgb);
    if (!this.isPicking && picker.value !== hex) picker.value = hex;
    picker.disabled = view.isReadOnly;
    setAttributes(picker, {
      title: "Another colour for the chosen stop",
      "aria-label": `Colour of stop ${this.chosen + 1} of ${this.stops.length}, at ${view.shownValue(value)}`,
    });
  }
}

// ---- the window: a bar from the first value to the last, whose drags take all nodes and colours along ---------------

const BAR_AT = { top: 64, height: 12 }; // CSS pixels, from the floor of the plot
const WINDOW_PARTS = ["level", "low", "high"] as const;
const NARROWEST = 1 / 1000; // of the values of the volume

class WindowBar {
  group: SVGGElement;
  title: SVGTextElement;
  rail: SVGPathElement;
  grips: { level: SVGGElement; low: SVGGElement; high: SVGGElement };
  cancelDrag: () => boolean;

  part: WindowPart = "level";

  constructor(readonly view: TransferEditorView) {
    this.group = svgElement("g", { class: "dnb-cv-window" }, view.svg);
    this.title = svgElement("text", TITLE, this.group, "Window");
    this.rail = svgElement("path", { class: "dnb-cv-rail", "aria-hidden": "true" }, this.group);
    this.grips = {
      level: this.#grip("level", "level: all values"),
      low: this.#grip("low", "low end"),
      high: this.#grip("high", "high end"),
    };
    this.cancelDrag = listenToDrags(view, this.group, this);
    view.listen(this.group, "dblclick", (event) => {
      event.preventDefault();
      event.stopPropagation();
      if (this.#at(event)) view.zoomToWindow();
    });
  }

  get window() {
    return windowOf(this.view.nodes, this.view.colors);
  }

  /** Limits of either end: as far again as the values of the volume reach. */
  get limits(): Vector2 {
    const { low, high } = this.view.model.get("histogram");
    return [low - (high - low), high + (high - low)];
  }

  get least() {
    const { low, high } = this.view.model.get("histogram");
    return NARROWEST * (high - low);
  }

  /** Nodes that are all at one value cannot be stretched. */
  get isFlat() {
    const [low, high] = this.window;
    return !(high > low);
  }

  /** The value that Python receives. */
  value() {
    return { window: this.window };
  }

  facts() {
    const [low, high] = this.window,
      { view } = this;
    const level = view.shownValue((low + high) / 2),
      width = view.shownValue(high - low);
    return `Window ${view.shownValue(low)} to ${view.shownValue(high)}: level ${level}, width ${width}`;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The part of the bar under the pointer. */
  #at(event: MouseEvent) {
    const found = attributeUnder(event, this.group, "data-window");
    return WINDOW_PARTS.find((part) => part === found) ?? null;
  }

  choose(part: WindowPart) {
    this.part = part;
    this.view.choose(this);
  }

  /** Stretch nodes and colours to a window. */
  #show({ nodes, colors }: { nodes: Node[]; colors: ColorStop[] }, to: Vector2) {
    const from = windowOf(nodes, colors);
    this.view.apply({
      nodes: nodes.map(([value, y]) => [stretchValue(value, from, to), y]),
      colors: colors.map(([value, r, g, b]) => [stretchValue(value, from, to), r, g, b]),
    });
  }

  press(event: PointerEvent) {
    const { view } = this,
      part = view.isReadOnly || this.isFlat ? null : this.#at(event);
    if (part === null) return null;
    view.settle();
    this.grips[part].focus({ preventScroll: true });
    this.choose(part);
    view.isHeld = true;
    return { part, before: view.snapshot() };
  }

  drag({ part, before }: { part: WindowPart; before: Snapshot }, [dx]: Vector2) {
    const { view } = this,
      [[x0, x1]] = view.view,
      [low, high] = windowOf(before.nodes, before.colors);
    const end = part === "high" ? high : low,
      to = end + (dx / view.box.width) * (x1 - x0);
    const by = view.tidy([to, 0], true, false)[0] - end;
    this.#show(before, moveWindow([low, high], part, by, this.least, this.limits));
    view.move(this.value());
  }

  drop({ before }: { before: Snapshot }, isCancelled: boolean, isClick: boolean) {
    this.view.endDrag(this, before, isCancelled, isClick);
  }

  nudge(part: WindowPart, by: number) {
    const { view } = this;
    if (this.isFlat) return;
    view.beginNudge(this);
    this.choose(part);
    this.#show(view, moveWindow(this.window, part, by, this.least, this.limits));
    view.move(this.value());
  }

  /** Returns whether the key is one of the window. */
  key(event: KeyboardEvent) {
    const { view } = this,
      part = WINDOW_PARTS.find((name) => this.grips[name] === event.target);
    if (!part || view.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(part, (step[0] - step[1]) * view.valueStep(event.shiftKey));
    else if (event.key === "Enter" || event.key === " ") {
      view.settle();
      view.zoomToWindow();
    } else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  #grip(part: WindowPart, text: string) {
    const { view } = this,
      grip = svgElement(
        "g",
        {
          class: `dnb-cv-grip dnb-cv-${part}`,
          "data-window": part,
          role: "slider",
          tabindex: 0,
          "aria-label": `window, ${text}`,
          ...OWN_KEYS,
        },
        this.group,
      );
    const tip =
      part === "level"
        ? "Drag: all nodes and colours move; double click or Enter: zoom to the window"
        : "Drag: all nodes and colours are stretched";
    svgElement("title", {}, grip, tip);
    if (part === "level") {
      svgElement("rect", { class: "dnb-cv-hit", y: -6, height: BAR_AT.height + 12 }, grip);
      svgElement("rect", { class: "dnb-cv-span", height: BAR_AT.height, rx: 3 }, grip);
    } else {
      const x = part === "low" ? -14 : -4;
      svgElement("rect", { class: "dnb-cv-hit", x, y: -6, width: 18, height: BAR_AT.height + 12 }, grip);
      svgElement("rect", { class: "dnb-cv-end", x: -4, y: -3, width: 8, height: BAR_AT.height + 6, rx: 3 }, grip);
      svgElement("path", { class: "dnb-cv-notch", d: `M-1 1.5v9M1 1.5v9` }, grip);
    }
    view.listen(grip, "focus", () => {
      if (!view.isHeld) this.choose(part);
    });
    return grip;
  }

  /** @param floor of the plot, in pixels */
  draw(floor: number) {
    const { view } = this,
      { left, width } = view.box,
      top = floor + BAR_AT.top,
      [low, high] = this.window;
    const inside = (value: number) => Math.max(left, Math.min(left + width, view.toPixel([value, 0])[0]));
    const from = inside(low),
      to = inside(high),
      middle = (low + high) / 2;
    setAttributes(this.title, { x: left - 11, y: top + 10 });
    this.rail.setAttribute("d", `M${left} ${top + BAR_AT.height / 2}h${width}`);
    const [first, last] = this.limits;
    const places = { level: { value: middle, x: from }, low: { value: low, x: from }, high: { value: high, x: to } };
    for (const part of WINDOW_PARTS) {
      const grip = this.grips[part],
        { value, x } = places[part];
      setAttributes(grip, {
        transform: `translate(${x.toFixed(2)} ${top})`,
        "aria-valuenow": value,
        "aria-valuemin": first,
        "aria-valuemax": last,
        "aria-valuetext": view.shownValue(value),
        "aria-readonly": view.isReadOnly,
        "aria-disabled": this.isFlat,
      });
      grip.classList.toggle("dnb-cv-chosen", view.row === this && this.part === part);
      grip.classList.toggle("dnb-cv-beyond", part !== "level" && !view.isSeen(value));
    }
    const length = Math.max(0, to - from).toFixed(2);
    for (const rect of this.grips.level.querySelectorAll("rect")) rect.setAttribute("width", length);
  }
}

// ---- the presets: buttons with pictures of this very volume, shown once they are made -------------------------------

const PICTURE = { alt: "", width: 56, height: 56, draggable: "false" }; // CSS pixels

class PresetButtons {
  group: HTMLDivElement;
  buttons: Record<string, { button: HTMLButtonElement; picture: HTMLImageElement }> = {};

  constructor(readonly view: TransferEditorView) {
    this.group = pageElement("div", "dnb-cv-presets", null, { role: "group", "aria-label": "Presets" });
    view.root.insertBefore(this.group, view.bar);
    for (const [name, tip] of Object.entries<string>(view.model.get("presets") ?? {})) {
      const picture = pageElement("img", "dnb-cv-thumbnail", null, PICTURE),
        take = () => view.guard(() => view.take(name));
      const button = buttonElement("dnb-cv-preset", this.group, picture, take, { title: tip });
      pageElement("span", "", button, {}, name);
      this.buttons[name] = { button, picture };
    }
    this.showPictures();
  }

  showPictures() {
    const pictures = this.view.model.get("thumbnails") ?? {};
    for (const [name, { picture }] of Object.entries(this.buttons)) {
      if (pictures[name]) picture.src = pictures[name];
      else picture.removeAttribute("src");
    }
  }

  show(chosen: string, isReadOnly: boolean) {
    for (const [name, { button }] of Object.entries(this.buttons)) {
      setAttributes(button, { "aria-pressed": name === chosen });
      button.disabled = isReadOnly;
    }
  }
}

// ---- the widget -----------------------------------------------------------------------------------------------------

export const ROWS = { ...PLOT, left: 58, bottom: 92 }; // room for colours and window under the axis
const LEAST_BAR = 1.5; // CSS pixels
const VALUE_ICONS = {
  in: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M7.3 5v4.4M5 7.2h4.5",
  out: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M5 7.2h4.5",
  all: "M2 3v10M14 3v10M4.5 8h7M6.5 6l-2 2 2 2M9.5 6l2 2-2 2",
};

class TransferEditorView extends CurvePlot {
  presets: PresetButtons;
  resetter: HTMLButtonElement;
  gradient: SVGLinearGradientElement;
  hole: SVGRectElement;
  bars: SVGPathElement;
  area: SVGPathElement;
  stops: ColorStops;
  window: WindowBar;
  rows: (ColorStops | WindowBar)[];
  nearer: HTMLButtonElement;
  farther: HTMLButtonElement;
  wholer: HTMLButtonElement;

  margins = ROWS;
  colors: ColorStop[] = [];
  back = ""; // the preset that "Reset" takes
  range: Vector2 = [0, 1];
  /** The part of the axis that is seen; null for all of it */
  zoom: Vector2 | null = null;
  /** The row at which the user works; null for the nodes of the curve */
  row: ColorStops | WindowBar | null = null;
  /** The row that arrow keys have changed */
  pending: ColorStops | WindowBar | null = null;
  hintTimer = 0;
  hinted = "";

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-transfer-editor");
    this.presets = new PresetButtons(this);
    this.resetter = this.wordButton(this.bar, "Reset", "", () => {
      if (this.back && !this.named) this.take(this.back);
    });
    pageElement("span", "dnb-cv-space", this.bar);
    const name = `dnb-${this.link.id}`,
      defs = svgElement("defs", {}, this.svg);
    this.gradient = svgElement("linearGradient", { id: name, gradientUnits: "userSpaceOnUse", y1: 0, y2: 0 }, defs);
    this.hole = svgElement("rect", {}, svgElement("clipPath", { id: `${name}-hole` }, defs));
    this.bars = svgElement("path", { class: "dnb-cv-bars" }, this.backLayer);
    this.area = svgElement("path", { class: "dnb-cv-area", fill: `url(#${name})` }, this.backLayer);
    for (const layer of [this.backLayer, this.curveLayer]) layer.setAttribute("clip-path", `url(#${name}-hole)`);
    this.stops = new ColorStops(this, `url(#${name})`);
    this.window = new WindowBar(this);
    this.rows = [this.stops, this.window];
    this.listen(this.frontLayer, "focusin", () => this.choose(null));
    this.bar.append(this.stops.picker, this.pair);
    pageElement("span", "dnb-cv-gap", this.bar);
    const icon = (name: keyof typeof VALUE_ICONS, tip: string, act: () => void) =>
      this.iconButton(this.bar, iconElement(VALUE_ICONS[name], { class: "dnb-cv-icon" }), tip, act);
    this.nearer = icon("in", "Zoom into the values (+, or the wheel)", () => this.zoomBy(2));
    this.farther = icon("out", "Zoom out (\u2212)", () => this.zoomBy(0.5));
    this.wholer = icon("all", "Show all values (0)", () => this.zoomTo(null));
    this.power = model.get("power") || 1;
    this.on("change:histogram", () => {
      this.zoom = null;
      this.invalidate();
    });
    this.on("change:thumbnails", () => this.presets.showPictures());
    this.onChange(["height", "power"], () => {
      this.power = model.get("power");
      this.invalidate();
    });
    this.listen(this.svg, "wheel", (event) => this.wheel(event), { passive: false });
    this.start();
  }

  close() {
    clearTimeout(this.hintTimer);
    super.close();
  }

  adopt(shown: { nodes: Node[]; colors: ColorStop[]; preset: string; range: Vector2; back: string }) {
    this.nodes = shown.nodes;
    this.colors = shown.colors;
    this.named = shown.preset;
    this.range = shown.range;
    this.back = shown.back;
    if (this.zoom) this.zoom = zoomAxis(this.zoom, this.whole, 1, this.zoom[0]);
    this.view = this.axes();
  }

  take(preset: string) {
    if (this.isReadOnly) {
      this.invalidate();
      return;
    }
    this.settle();
    this.named = preset;
    this.end({ preset });
  }

  // ---- edits of nodes, colours and window ------------------------------------------------------------------------

  /** The state that a cancelled drag restores. */
  snapshot(): Snapshot {
    const { nodes, colors, named } = this;
    return { nodes, colors, named };
  }

  apply(what: Partial<Snapshot>) {
    Object.assign(this, what);
    this.named = "";
    this.invalidate();
  }

  /** Make a row the one at which the user works; null for the nodes of the curve. */
  choose(row: ColorStops | WindowBar | null) {
    this.row = row;
    this.invalidate();
  }

  commitOf(row: ColorStops | WindowBar) {
    clearTimeout(this.keyTimer);
    this.pending = null;
    this.isHeld = false;
    this.view = this.axes();
    this.end(row.value());
    this.invalidate();
  }

  /** End a drag of a row. */
  endDrag(row: ColorStops | WindowBar, before: Snapshot, isCancelled: boolean, isClick: boolean) {
    if (!isCancelled && !isClick) {
      this.commitOf(row);
      return;
    }
    this.isHeld = false;
    Object.assign(this, before);
    // A follower of the movements must receive the value at the end; Python's has not changed.
    if (isCancelled && this.model.get("live")) this.end(before.named ? { preset: before.named } : row.value());
    else this.receive();
    this.invalidate();
  }

  /** Begin an edit of a row by an arrow key: keys held down are one edit. */
  beginNudge(row: ColorStops | WindowBar) {
    if (this.pending !== row) this.settle();
    this.pending = row;
    this.isHeld = true;
    this.settleSoon();
  }

  settle() {
    if (this.pending) this.commitOf(this.pending);
    else super.settle();
  }

  show(nodes: Node[], chosen: number) {
    super.show(nodes, chosen);
    this.row = null;
    this.reveal(nodes[chosen]![0]);
  }

  press(event: PointerEvent): NodeDrag | PlotDrag | null {
    const grabbed = super.press(event);
    if (grabbed !== null) {
      this.choose(null);
      return grabbed;
    }
    const [x, y] = this.pointOf(event),
      { left, top, width, height } = this.box;
    const isInside = x > left && x < left + width && y > top && y < top + height;
    return this.zoom && isInside && targetOf(event).closest(".dnb-cv-grip") === null ? { pan: this.zoom } : null;
  }

  drag(grabbed: NodeDrag | PlotDrag, by: Vector2) {
    if (!("pan" in grabbed)) {
      super.drag(grabbed, by);
      return;
    }
    const [low, high] = grabbed.pan;
    this.zoomTo(panAxis(grabbed.pan, this.whole, (-by[0] / this.box.width) * (high - low)));
  }

  addChosen() {
    if (this.row === this.stops) this.stops.addChosen();
    else super.addChosen();
  }

  removeChosen() {
    if (this.row === this.stops) this.stops.removeChosen();
    else super.removeChosen();
  }

  key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey) return;
    const isEscaped = event.key === "Escape" && this.rows.some((row) => row.cancelDrag());
    if (!isEscaped && !this.rows.some((row) => row.key(event)) && !this.#zoomKey(event)) {
      super.key(event);
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }

  // ---- the values that are seen ------------------------------------------------------------------------------------

  /** The ends of the whole axis of values. */
  get whole(): Vector2 {
    const [low, high] = this.range;
    return [low, high > low ? high : low + 1];
  }

  isSeen(value: number) {
    const [[low, high]] = this.view,
      slack = 1e-9 * (high - low);
    return value >= low - slack && value <= high + slack;
  }

  zoomTo(zoom: Vector2 | null) {
    this.zoom = zoom;
    this.view = this.axes();
    this.invalidate();
  }

  /** Zoom about a value, by default the chosen one where it is seen. */
  zoomBy(factor: number, about?: number) {
    const [[low, high]] = this.view;
    const chosen = this.row === this.stops ? this.colors[this.stops.chosen]![0] : this.nodes[this.chosen]![0];
    const at = about ?? (this.isSeen(chosen) && !(this.row === this.window) ? chosen : (low + high) / 2);
    this.zoomTo(zoomAxis([low, high], this.whole, factor, at));
  }

  zoomToWindow() {
    const [low, high] = this.window.window,
      room = 0.1 * (high - low),
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

  #zoomKey(event: KeyboardEvent) {
    if (!this.svg.contains(targetOf(event))) return false;
    if (event.key === "+" || event.key === "=") this.zoomBy(2);
    else if (event.key === "-") this.zoomBy(0.5);
    else if (event.key === "0") this.zoomTo(null);
    else return false;
    return true;
  }

  /** Zoom. The wheel scrolls the page until the user works in here. */
  wheel(event: WheelEvent) {
    const isCommand = event.ctrlKey || event.metaKey,
      isFocused = this.root.contains(treeOf(this.root).activeElement);
    if (!isCommand && !isFocused) {
      this.hint("Click here, or hold Ctrl, to zoom with the wheel");
      return;
    }
    if (!this.zoom && event.deltaY >= 0 && !isCommand) return; // all is seen: the page scrolls
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1,
      [[low, high]] = this.view;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      const by = ((event.deltaX * lines) / this.box.width) * (high - low);
      if (this.zoom) this.zoomTo(panAxis(this.zoom, this.whole, by));
      return;
    }
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    const at = Math.max(low, Math.min(high, this.toPlace(this.pointOf(event))[0]));
    this.zoomBy(Math.exp(-delta * (event.ctrlKey ? 0.01 : WHEEL_STEP)), at);
  }

  hint(text: string) {
    this.hinted = text;
    clearTimeout(this.hintTimer);
    this.hintTimer = setTimeout(
      () =>
        this.guard(() => {
          this.hinted = "";
          this.invalidate();
        }),
      2500,
    );
    this.invalidate();
  }

  // ---- the plot -----------------------------------------------------------------------------------------------------

  rules(): NodeRules {
    return { x: this.whole, y: [0, 1], step: 0, gap: 0, isPinned: false, most: 64 };
  }

  axes(): [Vector2, Vector2] {
    return [this.zoom ?? this.whole, [0, 1]];
  }

  /** The same, limited to the visible part; the ends of the window may leave it. */
  tidy([x, y]: Vector2, isFree: boolean = false, isInside: boolean = true): Vector2 {
    const [[low, high]] = this.view;
    return super.tidy([isInside ? Math.max(low, Math.min(high, x)) : x, y], isFree);
  }

  /** The step of an arrow key along the axis of values. */
  valueStep(isFar: boolean) {
    const [[low, high]] = this.view;
    return ((isFar ? 10 : 1) * (high - low)) / 200;
  }

  ticks() {
    if (this.power === 1) return super.ticks(0, 1);
    let last = Infinity;
    return [0, 0.001, 0.01, 0.1, 0.5, 1].filter((alpha) => {
      const at = this.toPixel([this.range[0], alpha])[1],
        isFar = last - at >= 13;
      if (isFar) last = at;
      return isFar;
    });
  }

  tickText(alpha: number) {
    return String(alpha);
  }

  shownValue(value: number) {
    const [[low, high]] = this.view;
    return formatNumber(value, high - low);
  }

  words(k: number) {
    const [value, alpha] = this.nodes[k]!;
    return `value ${this.shownValue(value)}, opacity ${Number(alpha.toPrecision(3))}`;
  }

  help() {
    return (
      "Tab goes through the nodes, the colours below and the window of all, arrows move them, A adds one, " +
      "Delete removes one, Enter recolours; plus and minus zoom."
    );
  }

  drawBack() {
    const { left, top, width, height } = this.box,
      { low, high, heights } = this.model.get("histogram");
    const floor = top + height,
      each = (high - low) / heights.length;
    const x = (value: number) => this.toPixel([value, 0])[0];
    const edge = (k: number) => Math.max(left, Math.min(left + width, x(Math.min(high, low + k * each)))).toFixed(2);
    const together = Math.max(1, Math.ceil(LEAST_BAR / (x(each) - x(0)))); // finer bars are seen when zoomed
    const steps = [];
    for (let k = 0; k < heights.length; k += together) {
      const h = Math.max(...heights.slice(k, k + together));
      steps.push(`V${(floor - h * height * 0.97).toFixed(2)}H${edge(k + together)}`);
    }
    this.bars.setAttribute("d", `M${edge(0)} ${floor}${steps.join("")}V${floor}Z`);
    const outline = this.outline();
    const [from] = outline[0]!,
      [to] = outline[outline.length - 1]!;
    this.area.setAttribute("d", `${pathOf(outline)}L${to} ${floor}L${from} ${floor}Z`);
    const first = x(this.colors[0]![0]),
      last = x(this.colors[this.colors.length - 1]![0]);
    setAttributes(this.gradient, { x1: first, x2: last });
    this.gradient.replaceChildren(
      ...this.colors.map(([value, ...rgb]) =>
        svgElement("stop", {
          offset: last > first ? (x(value) - first) / (last - first) : 0,
          "stop-color": `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})`,
        }),
      ),
    );
    setAttributes(this.hole, { x: left, y: top - 2, width, height: height + 4 });
    for (const row of this.rows) row.draw(floor);
  }

  drawNodes() {
    super.drawNodes();
    this.marks.forEach((dot, k) => {
      dot.style.display = this.isSeen(this.nodes[k]![0]) ? "" : "none";
      if (this.row !== null) dot.classList.remove("dnb-cv-chosen");
    });
  }

  describe() {
    super.describe();
    if (this.row) setText(this.facts, this.row.facts());
    const { isReadOnly, row, stops, back, named } = this,
      isAtStops = row === stops;
    if (isAtStops) setAttributes(this.remover, { "aria-disabled": isReadOnly || !stops.canRemove });
    const what = isAtStops ? "colour" : "node";
    setAttributes(this.adder, {
      title: `Add a ${what} after the chosen one (A, or double click)`,
      "aria-label": `Add a ${what}`,
    });
    setAttributes(this.remover, {
      title: `Remove the chosen ${what} (Del, or right click)`,
      "aria-label": `Remove the chosen ${what}`,
    });
    const isOwn = !named,
      again = back ? `the preset ${back}` : "a preset";
    setAttributes(this.resetter, {
      "aria-disabled": isReadOnly || !isOwn || !back,
      title: `Take ${again} again: undo does not apply to colours and opacities`,
    });
    this.presets.show(named, isReadOnly);
    setAttributes(this.farther, { "aria-disabled": !this.zoom });
    setAttributes(this.wholer, { "aria-disabled": !this.zoom });
    setText(this.note, this.#remarks());
  }

  #remarks() {
    const { note } = this.model.get("histogram"),
      { hinted, zoom, named, back, isReadOnly } = this;
    if (hinted) return hinted;
    if (isReadOnly) return "shown only";
    if (zoom) return "zoomed: drag the plot to move along, 0 shows all";
    if (!named && back) return `not part of undo; Reset takes ${back} again`;
    return `log histogram${note ? `, ${note}` : ""}`;
  }
}

export default widgetOf(TransferEditorView);
