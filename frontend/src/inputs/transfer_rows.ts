// The rows under the plot of the transfer editor: colours, and the window of colours and opacities.

import type { Node } from "../maths/curves.ts";
import { lineAt } from "../maths/curves.ts";
import type { Vector2, Vector3, Vector4 } from "../types.ts";
import { ARROWS, OWN_KEYS, pageElement, placeIn, setAttributes, svgElement, treeOf } from "../ui/dom.ts";
import type { InputView } from "./base.ts";
import { attributeUnder, listenToDrags, numberUnder, targetIndex } from "./base.ts";
import type { ValueAxes } from "./value_axes.ts";

/** A value and its red, green and blue, from 0 to 1. */
export type ColorStop = Vector4;

export type WindowPart = "level" | "low" | "high";

/** A state before a drag. */
export type Snapshot = { nodes: Node[]; colors: ColorStop[]; named: string };

export const MOST_NODES = 64; // of the curve, and stops of colour

// ---- edits of rows --------------------------------------------------------------------------------------------------

/** Colours or window. */
interface Row {
  /** The value that Python receives. */
  value(): object;
  facts(): string;
  /** Returns whether the key is one of the row. */
  key(event: KeyboardEvent): boolean;
  cancelDrag(): boolean;
  /** @param floor of the plot, in pixels */
  draw(floor: number): void;
}

/** The editor whose nodes and colours rows edit. */
interface EditedTransfer
  extends Snapshot,
    Pick<InputView, "model" | "isHeld" | "move" | "end" | "receive" | "invalidate"> {
  settle: () => void;
  settleSoon: () => void;
}

/** Edits of rows: drags, and arrow keys, of which those held down are one edit. */
export class RowEdits {
  /** The row at which the user works; null for the nodes of the curve */
  row: Row | null = null;
  /** The row that arrow keys have changed */
  #nudged: Row | null = null;

  constructor(readonly editor: EditedTransfer) {}

  /** Make a row the one at which the user works. */
  choose(row: Row | null) {
    this.row = row;
    this.editor.invalidate();
  }

  get isHeld() {
    return this.editor.isHeld;
  }

  /** Begin an edit: until its end Python's values are not taken. Returns the state that a cancelled one restores. */
  begin(): Snapshot {
    const { nodes, colors, named } = this.editor;
    this.editor.isHeld = true;
    return { nodes, colors, named };
  }

  /** Show other colours or nodes: they are no preset any more. */
  show(what: Partial<Snapshot>) {
    Object.assign(this.editor, what, { named: "" });
    this.editor.invalidate();
  }

  move(row: Row) {
    this.editor.move(row.value());
  }

  commit(row: Row) {
    const { editor } = this;
    this.#nudged = null;
    editor.isHeld = false;
    editor.end(row.value());
    editor.invalidate();
  }

  /** End a drag of a row. */
  end(row: Row, before: Snapshot, isCancelled: boolean, isClick: boolean) {
    const { editor } = this;
    if (!isCancelled && !isClick) {
      this.commit(row);
      return;
    }
    editor.isHeld = false;
    Object.assign(editor, before);
    // A follower of the movements must receive the value at the end; Python's has not changed.
    if (isCancelled && editor.model.get("live")) editor.end(before.named ? { preset: before.named } : row.value());
    else editor.receive();
    editor.invalidate();
  }

  /** Begin an edit of a row by an arrow key. */
  beginNudge(row: Row) {
    const { editor } = this;
    if (this.#nudged !== row) editor.settle();
    this.#nudged = row;
    editor.isHeld = true;
    editor.settleSoon();
  }

  /** End what arrow keys do. */
  settle() {
    if (this.#nudged) this.commit(this.#nudged);
  }
}

/** What a row uses of the editor. */
interface RowEditor
  extends Omit<Snapshot, "named">,
    Pick<InputView, "model" | "isReadOnly" | "listen" | "closing" | "draw" | "showMessage" | "announce"> {
  svg: SVGSVGElement;
  settle: () => void;
  axes: ValueAxes;
  edits: RowEdits;
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

export class ColorStops {
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
    readonly editor: RowEditor,
    fill: string,
  ) {
    this.group = svgElement("g", { class: "dnb-cv-stops" }, editor.svg);
    this.title = svgElement("text", TITLE, this.group, "Colours");
    this.strip = svgElement("rect", { class: "dnb-cv-strip", fill, height: STRIP.height, rx: 2 }, this.group);
    // Double clicks go to this.
    this.ground = svgElement("rect", { class: "dnb-cv-hit", height: STRIP.height + 18 }, this.group);
    this.cancelDrag = listenToDrags(editor, this.group, this);
    editor.listen(this.group, "dblclick", (event) => this.#doubleClick(event));
    editor.listen(this.group, "contextmenu", (event) => {
      const k = this.#at(event);
      if (k === null || editor.isReadOnly) return;
      event.preventDefault();
      if (!event.ctrlKey) this.remove(k); // with Ctrl it is a click on a Mac
    });
    // The browser's own input of a colour, for the bar.
    this.picker = pageElement("input", "dnb-cv-color", null, { type: "color", ...OWN_KEYS });
    editor.listen(this.picker, "input", () => this.#recolour());
    editor.listen(this.picker, "change", () => {
      this.#recolour();
      this.#picked();
    });
    editor.listen(this.picker, "blur", () => this.#picked());
  }

  get stops() {
    return this.editor.colors;
  }

  /** The value that Python receives. */
  value() {
    return { colors: this.stops.map(([value, ...rgb]) => [value, hexOf(rgb)]) };
  }

  words(k: number) {
    const [value, ...rgb] = this.stops[k]!;
    return `value ${this.editor.axes.words(value)}, colour ${hexOf(rgb)}`;
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
    this.editor.edits.show({ colors: stops });
  }

  choose(k: number) {
    this.chosen = k;
    this.editor.edits.choose(this);
  }

  press(event: PointerEvent) {
    const { editor } = this,
      k = editor.isReadOnly ? null : this.#at(event);
    if (k === null) return null;
    editor.settle();
    this.grips[k]!.focus({ preventScroll: true });
    this.choose(k);
    return { k, from: editor.axes.toPixel([this.stops[k]![0], 0])[0], before: editor.edits.begin() };
  }

  drag({ k, from, before }: { k: number; from: number; before: Snapshot }, [dx]: Vector2) {
    const { axes, edits } = this.editor,
      [value] = axes.tidy(axes.toPlace([from + dx, 0]));
    this.#show(moveStop(before.colors, k, value, axes.range), k);
    edits.move(this);
  }

  drop({ before }: { before: Snapshot }, isCancelled: boolean, isClick: boolean) {
    this.editor.edits.end(this, before, isCancelled, isClick);
  }

  nudge(k: number, by: number) {
    const { axes, edits } = this.editor;
    edits.beginNudge(this);
    this.#show(moveStop(this.stops, k, this.stops[k]![0] + by, axes.range), k);
    axes.reveal(this.stops[k]![0]);
    edits.move(this);
  }

  add(value: number) {
    const { editor } = this,
      { edits } = editor;
    if (editor.isReadOnly) return;
    editor.settle();
    if (this.stops.length >= MOST_NODES) {
      editor.showMessage("There is no room for another colour.");
      return;
    }
    this.#show(...addStop(this.stops, value));
    edits.choose(this);
    edits.commit(this);
    this.#focus();
    editor.announce(`added ${this.words(this.chosen)}`);
  }

  /** Between a stop and the next, or where there is more room on the other side of the last. */
  addChosen() {
    const { stops, editor } = this,
      k = this.chosen,
      next = stops[k + 1]?.[0] ?? editor.axes.range[1];
    const at = k === stops.length - 1 && next - stops[k]![0] <= 0 && k > 0 ? stops[k - 1]![0] : next;
    this.add((stops[k]![0] + at) / 2);
  }

  get canRemove() {
    return this.stops.length > 1;
  }

  remove(k: number) {
    const { editor } = this;
    if (editor.isReadOnly) return;
    editor.settle();
    if (!this.canRemove) {
      editor.showMessage("One colour stays.");
      return;
    }
    const hadFocus = this.group.contains(treeOf(this.group).activeElement);
    this.#show(
      this.stops.filter((_, j) => j !== k),
      Math.min(k, this.stops.length - 2),
    );
    editor.edits.commit(this);
    if (hadFocus) this.#focus();
    else editor.draw();
    editor.announce(`removed; ${this.stops.length} colours are left`);
  }

  removeChosen() {
    this.remove(this.chosen);
  }

  #focus() {
    this.editor.draw();
    this.grips[this.chosen]!.focus({ preventScroll: true });
  }

  #doubleClick(event: MouseEvent) {
    event.preventDefault();
    event.stopPropagation();
    const k = this.#at(event),
      { axes, svg } = this.editor;
    if (k !== null) {
      this.choose(k);
      this.pick();
      return;
    }
    this.add(axes.tidy(axes.toPlace(placeIn(svg, event)))[0]);
  }

  /** Opens the browser's colours where scripts are allowed to; else focuses the input. */
  pick() {
    if (this.editor.isReadOnly) return;
    this.editor.draw();
    this.picker.focus({ preventScroll: true });
    try {
      this.picker.showPicker();
    } catch {
      /* only a click of the user may: Enter opens them */
    }
  }

  #recolour() {
    const { editor } = this,
      [r, g, b] = rgbOf(this.picker.value),
      [, ...rgb] = this.stops[this.chosen]!;
    if (editor.isReadOnly || hexOf(rgb) === this.picker.value) return;
    editor.edits.begin();
    this.isPicking = true;
    this.#show(this.stops.map((stop, j) => (j === this.chosen ? [stop[0], r, g, b] : stop)));
    editor.edits.choose(this);
    editor.edits.move(this);
  }

  #picked() {
    if (!this.isPicking) return;
    this.isPicking = false;
    this.editor.edits.commit(this);
  }

  /** Returns whether the key is one of the stops. */
  key(event: KeyboardEvent) {
    const k = targetIndex(this.grips, event),
      { editor } = this;
    if (k < 0 || editor.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(k, (step[0] - step[1]) * editor.axes.step(event.shiftKey));
    else if (event.key === "Delete" || event.key === "Backspace") this.remove(k);
    else if (event.key.toLowerCase() === "a") this.addChosen();
    else if (event.key === "Enter" || event.key === " ") {
      editor.settle();
      this.choose(k);
      this.pick();
    } else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** @param floor of the plot, in pixels */
  draw(floor: number) {
    const { axes, edits, isReadOnly } = this.editor,
      { left, width } = axes.box,
      top = floor + STRIP.top;
    this.chosen = Math.min(this.chosen, this.stops.length - 1);
    setAttributes(this.title, { x: left - 11, y: top + 10 });
    setAttributes(this.strip, { x: left, y: top, width });
    setAttributes(this.ground, { x: left, y: top, width });
    while (this.grips.length > this.stops.length) this.grips.pop()?.remove();
    while (this.grips.length < this.stops.length) this.grips.push(this.#grip(this.grips.length));
    const [first, last] = axes.range;
    this.stops.forEach(([value, ...rgb], k) => {
      const [x] = axes.toPixel([value, 0]),
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
        "aria-readonly": isReadOnly,
      });
      grip.querySelector(".dnb-cv-pin")?.setAttribute("fill", hexOf(rgb));
      grip.classList.toggle("dnb-cv-chosen", isChosen && edits.row === this);
      grip.style.display = axes.isSeen(value) ? "" : "none";
    });
    this.#drawPicker();
  }

  #grip(k: number) {
    const { editor } = this;
    const grip = svgElement("g", { class: "dnb-cv-grip", "data-stop": k, role: "slider", ...OWN_KEYS }, this.group);
    svgElement("rect", { class: "dnb-cv-hit", x: -10, y: -STRIP.height, width: 20, height: STRIP.height + 18 }, grip);
    svgElement("path", { class: "dnb-cv-ring", d: PIN }, grip);
    svgElement("path", { class: "dnb-cv-pin", d: PIN }, grip);
    const tip = "Drag; double click or Enter: another colour; right click or Del: remove";
    svgElement("title", {}, grip, tip);
    editor.listen(grip, "focus", () => {
      if (!editor.edits.isHeld) this.choose(this.grips.indexOf(grip));
    });
    return grip;
  }

  #drawPicker() {
    const { picker, editor } = this,
      [value, ...rgb] = this.stops[this.chosen]!,
      hex = hexOf(rgb);
    if (!this.isPicking && picker.value !== hex) picker.value = hex;
    picker.disabled = editor.isReadOnly;
    setAttributes(picker, {
      title: "Another colour for the chosen stop",
      "aria-label": `Colour of stop ${this.chosen + 1} of ${this.stops.length}, at ${editor.axes.words(value)}`,
    });
  }
}

// ---- the window: a bar from the first value to the last, whose drags take all nodes and colours along ---------------

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

const BAR_AT = { top: 64, height: 12 }; // CSS pixels, from the floor of the plot
const WINDOW_PARTS = ["level", "low", "high"] as const;
const NARROWEST = 1 / 1000; // of the values of the volume

export class WindowBar {
  group: SVGGElement;
  title: SVGTextElement;
  rail: SVGPathElement;
  grips: { level: SVGGElement; low: SVGGElement; high: SVGGElement };
  cancelDrag: () => boolean;

  part: WindowPart = "level";

  constructor(readonly editor: RowEditor) {
    this.group = svgElement("g", { class: "dnb-cv-window" }, editor.svg);
    this.title = svgElement("text", TITLE, this.group, "Window");
    this.rail = svgElement("path", { class: "dnb-cv-rail", "aria-hidden": "true" }, this.group);
    this.grips = {
      level: this.#grip("level", "level: all values"),
      low: this.#grip("low", "low end"),
      high: this.#grip("high", "high end"),
    };
    this.cancelDrag = listenToDrags(editor, this.group, this);
    editor.listen(this.group, "dblclick", (event) => {
      event.preventDefault();
      event.stopPropagation();
      if (this.#at(event)) editor.axes.zoomToWindow(this.window);
    });
  }

  get window() {
    return windowOf(this.editor.nodes, this.editor.colors);
  }

  /** Limits of either end: as far again as the values of the volume reach. */
  get limits(): Vector2 {
    const { low, high } = this.editor.model.get("histogram");
    return [low - (high - low), high + (high - low)];
  }

  get least() {
    const { low, high } = this.editor.model.get("histogram");
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
      { axes } = this.editor;
    const level = axes.words((low + high) / 2),
      width = axes.words(high - low);
    return `Window ${axes.words(low)} to ${axes.words(high)}: level ${level}, width ${width}`;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The part of the bar under the pointer. */
  #at(event: MouseEvent) {
    const found = attributeUnder(event, this.group, "data-window");
    return WINDOW_PARTS.find((part) => part === found) ?? null;
  }

  choose(part: WindowPart) {
    this.part = part;
    this.editor.edits.choose(this);
  }

  /** Stretch nodes and colours to a window. */
  #show({ nodes, colors }: { nodes: Node[]; colors: ColorStop[] }, to: Vector2) {
    const from = windowOf(nodes, colors);
    this.editor.edits.show({
      nodes: nodes.map(([value, y]) => [stretchValue(value, from, to), y]),
      colors: colors.map(([value, r, g, b]) => [stretchValue(value, from, to), r, g, b]),
    });
  }

  press(event: PointerEvent) {
    const { editor } = this,
      part = editor.isReadOnly || this.isFlat ? null : this.#at(event);
    if (part === null) return null;
    editor.settle();
    this.grips[part].focus({ preventScroll: true });
    this.choose(part);
    return { part, before: editor.edits.begin() };
  }

  drag({ part, before }: { part: WindowPart; before: Snapshot }, [dx]: Vector2) {
    const { axes, edits } = this.editor,
      [[x0, x1]] = axes.ends,
      [low, high] = windowOf(before.nodes, before.colors);
    const end = part === "high" ? high : low,
      to = end + (dx / axes.box.width) * (x1 - x0);
    const by = axes.tidy([to, 0], true, false)[0] - end;
    this.#show(before, moveWindow([low, high], part, by, this.least, this.limits));
    edits.move(this);
  }

  drop({ before }: { before: Snapshot }, isCancelled: boolean, isClick: boolean) {
    this.editor.edits.end(this, before, isCancelled, isClick);
  }

  nudge(part: WindowPart, by: number) {
    const { editor } = this,
      { edits } = editor;
    if (this.isFlat) return;
    edits.beginNudge(this);
    this.choose(part);
    this.#show(editor, moveWindow(this.window, part, by, this.least, this.limits));
    edits.move(this);
  }

  /** Returns whether the key is one of the window. */
  key(event: KeyboardEvent) {
    const { editor } = this,
      part = WINDOW_PARTS.find((name) => this.grips[name] === event.target);
    if (!part || editor.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(part, (step[0] - step[1]) * editor.axes.step(event.shiftKey));
    else if (event.key === "Enter" || event.key === " ") {
      editor.settle();
      editor.axes.zoomToWindow(this.window);
    } else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  #grip(part: WindowPart, text: string) {
    const { editor } = this,
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
    editor.listen(grip, "focus", () => {
      if (!editor.edits.isHeld) this.choose(part);
    });
    return grip;
  }

  /** @param floor of the plot, in pixels */
  draw(floor: number) {
    const { axes, edits, isReadOnly } = this.editor,
      { left, width } = axes.box,
      top = floor + BAR_AT.top,
      [low, high] = this.window;
    const inside = (value: number) => Math.max(left, Math.min(left + width, axes.toPixel([value, 0])[0]));
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
        "aria-valuetext": axes.words(value),
        "aria-readonly": isReadOnly,
        "aria-disabled": this.isFlat,
      });
      grip.classList.toggle("dnb-cv-chosen", edits.row === this && this.part === part);
      grip.classList.toggle("dnb-cv-beyond", part !== "level" && !axes.isSeen(value));
    }
    const length = Math.max(0, to - from).toFixed(2);
    for (const rect of this.grips.level.querySelectorAll("rect")) rect.setAttribute("width", length);
  }
}
