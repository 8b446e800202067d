// The part of a value axis that is seen, and values that are stretched from one window to another. Pure functions; no DOM.

import { lineAt, shownNumber } from "../maths/curves.js";
import { OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.js";
import { KEYS_REST, listenToDrags } from "./base.js";
import { ARROWS, CurvePlot, pathOf, PLOT } from "./curve_plot.js";

const FINEST = 1 / 500; // share of the whole axis that is seen at most enlarged
const WHEEL_STEP = 0.0022; // of the logarithm of the scale, for a pixel of the wheel

// [low, high] with a value kept where it is, within the whole axis; null where all of it is seen.
export function zoomedAxis([low, high], [first, last], factor, at) {
  const span = last - first, width = Math.max(FINEST * span, (high - low) / factor);
  if (width >= span * (1 - 1e-9)) return null;
  return keptInside([at - (at - low) * width / (high - low), width], [first, last]);
}

// The axis moved along, within the whole axis.
export function pannedAxis([low, high], whole, by) { return keptInside([low + by, high - low], whole); }

function keptInside([low, width], [first, last]) {
  const from = Math.max(first, Math.min(last - width, low));
  return [from, from + width];
}

// As TransferFunction.windowed does: both ends are met exactly.
export function stretchedValue(value, [first, last], [low, high]) {
  return value === last ? high : Math.min(high, low + (value - first) / (last - first) * (high - low));
}

export function windowOf(nodes, stops) {
  const values = [...nodes, ...stops].map(([value]) => value);
  return [Math.min(...values), Math.max(...values)];
}

// What a drag of one end ("low", "high") or of the whole ("level") makes of a window: at least this wide, within limits.
export function movedWindow([low, high], part, by, least, [first, last]) {
  if (part === "low") return [Math.max(Math.min(first, low), Math.min(high - least, low + by)), high];
  if (part === "high") return [low, Math.min(Math.max(last, high), Math.max(low + least, high + by))];
  const shift = Math.max(Math.min(first - low, 0), Math.min(Math.max(last - high, 0), by));
  return [low + shift, high + shift];
}

// The colours of a transfer function: a strip, and under it stops that are dragged, added, removed and recoloured.
// Needs maths/curves.js, ui/dom.js and inputs/base.js; ColorStops belongs to a TransferEditorPage.

const STRIP = { top: 28, height: 12 }; // CSS pixels, from the floor of the plot
const PIN = "M0 -1L6 6V15.5H-6V6Z";

export function hexOf(rgb) {
  return `#${rgb.map((v) => Math.round(255 * Math.max(0, Math.min(1, v))).toString(16).padStart(2, "0")).join("")}`;
}

export function rgbOf(hex) { return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255); }

// Red, green and blue at a value, linear between stops [value, red, green, blue].
export function colorAt(stops, value) { return [1, 2, 3].map((c) => lineAt(stops.map((stop) => [stop[0], stop[c]]), value)); }

// A stop keeps its place among the others. No edit changes the list it is given.
export function movedStop(stops, k, value, [first, last]) {
  const low = k > 0 ? stops[k - 1][0] : Math.min(first, stops[0][0]);
  const high = k < stops.length - 1 ? stops[k + 1][0] : Math.max(last, stops[stops.length - 1][0]);
  const [, ...rgb] = stops[k];
  return stops.map((stop, j) => (j === k ? [Math.max(low, Math.min(high, value)), ...rgb] : stop));
}

// [stops, index of the new one]: nothing changes its colour.
export function addedStop(stops, value) {
  const index = stops.findIndex((stop) => stop[0] > value), k = index < 0 ? stops.length : index;
  return [[...stops.slice(0, k), [value, ...colorAt(stops, value)], ...stops.slice(k)], k];
}

class ColorStops {
  constructor(page, fill) {
    Object.assign(this, { page, chosen: 0, grips: [], isPicking: false });
    this.group = svgElement("g", { class: "dnb-cv-stops" }, page.svg);
    this.title = svgElement("text", { class: "dnb-cv-text", "text-anchor": "end", "aria-hidden": "true" }, this.group);
    this.title.textContent = "Colours";
    this.strip = svgElement("rect", { class: "dnb-cv-strip", fill, height: STRIP.height, rx: 2 }, this.group);
    this.ground = svgElement("rect", { class: "dnb-cv-hit", height: STRIP.height + 18 }, this.group); // for double clicks
    this.cancelDrag = listenToDrags(page, this.group, this);
    page.listen(this.group, "dblclick", (event) => this.#doubleClick(event));
    page.listen(this.group, "contextmenu", (event) => {
      const k = this.#at(event);
      if (k === null || page.isReadOnly) return;
      event.preventDefault();
      if (!event.ctrlKey) this.remove(k); // with Ctrl it is a click on a Mac
    });
  }

  /** The browser's own input of a colour, for the chosen stop. */
  addPicker(bar) {
    const { page } = this;
    this.picker = pageElement("input", "dnb-cv-color", bar, { type: "color", ...OWN_KEYS });
    page.listen(this.picker, "input", () => this.#recolour());
    page.listen(this.picker, "change", () => { this.#recolour(); this.#picked(); });
    page.listen(this.picker, "blur", () => this.#picked());
  }

  get stops() { return this.page.colors; }

  value() { return { colors: this.stops.map(([value, ...rgb]) => [value, hexOf(rgb)]) }; }

  words(k) {
    const [value, ...rgb] = this.stops[k];
    return `value ${this.page.shownValue(value)}, colour ${hexOf(rgb)}`;
  }

  facts() { return `Colour ${this.chosen + 1} of ${this.stops.length}: ${this.words(this.chosen)}`; }

  // ---- edits --------------------------------------------------------------------------------------------------------

  #at(event) {
    const hit = this.page.root.getRootNode().elementFromPoint(event.clientX, event.clientY)?.closest?.("[data-stop]");
    return hit && this.group.contains(hit) ? Number(hit.dataset.stop) : null;
  }

  #show(stops, chosen = this.chosen) {
    this.chosen = chosen;
    this.page.changed({ colors: stops });
  }

  choose(k) {
    this.chosen = k;
    this.page.choose(this);
  }

  press(event) {
    const { page } = this, k = page.isReadOnly ? null : this.#at(event);
    if (k === null) return null;
    page.settle();
    this.grips[k].focus({ preventScroll: true });
    this.choose(k);
    page.isHeld = true;
    return { k, from: page.toPixel([this.stops[k][0], 0])[0], before: page.kept() };
  }

  drag({ k, from, before }, [dx]) {
    const { page } = this, [value] = page.tidy(page.toPlace([from + dx, 0]));
    this.#show(movedStop(before.colors, k, value, page.range), k);
    page.move(this.value());
  }

  drop({ before }, isCancelled, isClick) { this.page.dropped(this, before, isCancelled, isClick); }

  nudge(k, by) {
    const { page } = this;
    page.nudging(this);
    this.#show(movedStop(this.stops, k, this.stops[k][0] + by, page.range), k);
    page.reveal(this.stops[k][0]);
    page.move(this.value());
  }

  add(value) {
    const { page } = this;
    if (page.isReadOnly) return;
    page.settle();
    if (this.stops.length >= page.rules().most) { page.say("There is no room for another colour."); return; }
    this.#show(...addedStop(this.stops, value));
    page.choose(this);
    page.commitOf(this);
    this.#focus();
    page.speak(`added ${this.words(this.chosen)}`);
  }

  /** Between a stop and the next, or where there is more room on the other side of the last. */
  addChosen() {
    const { stops, page } = this, k = this.chosen, next = stops[k + 1]?.[0] ?? page.range[1];
    const at = k === stops.length - 1 && next - stops[k][0] <= 0 && k > 0 ? stops[k - 1][0] : next;
    this.add((stops[k][0] + at) / 2);
  }

  get canRemove() { return this.stops.length > 1; }

  remove(k) {
    const { page } = this;
    if (page.isReadOnly) return;
    page.settle();
    if (!this.canRemove) { page.say("One colour stays."); return; }
    const hadFocus = this.group.contains(page.root.getRootNode().activeElement);
    this.#show(this.stops.filter((_, j) => j !== k), Math.min(k, this.stops.length - 2));
    page.commitOf(this);
    if (hadFocus) this.#focus(); else page.draw();
    page.speak(`removed; ${this.stops.length} colours are left`);
  }

  removeChosen() { this.remove(this.chosen); }

  #focus() {
    this.page.draw();
    this.grips[this.chosen].focus({ preventScroll: true });
  }

  #doubleClick(event) {
    event.preventDefault();
    event.stopPropagation();
    const k = this.#at(event), { page } = this;
    if (k !== null) { this.choose(k); this.pick(); return; }
    this.add(page.tidy(page.toPlace(page.pointOf(event)))[0]);
  }

  /** Opens the browser's colours where it lets a script do so; else the input has the focus. */
  pick() {
    if (this.page.isReadOnly) return;
    this.page.draw();
    this.picker.focus({ preventScroll: true });
    try { this.picker.showPicker(); } catch { /* not without a hand's own click: Enter opens them */ }
  }

  #recolour() {
    const { page } = this, rgb = rgbOf(this.picker.value);
    if (page.isReadOnly || hexOf(this.stops[this.chosen].slice(1)) === this.picker.value) return;
    this.isPicking = page.isHeld = true;
    this.#show(this.stops.map((stop, j) => (j === this.chosen ? [stop[0], ...rgb] : stop)));
    page.choose(this);
    page.move(this.value());
  }

  #picked() {
    if (!this.isPicking) return;
    this.isPicking = false;
    this.page.commitOf(this);
  }

  key(event) {
    const k = this.grips.indexOf(event.target), { page } = this;
    if (k < 0 || page.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(k, (step[0] + step[1]) * page.valueStep(event.shiftKey));
    else if (event.key === "Delete" || event.key === "Backspace") this.remove(k);
    else if (event.key.toLowerCase() === "a") this.addChosen();
    else if (event.key === "Enter" || event.key === " ") { page.settle(); this.choose(k); this.pick(); }
    else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw(floor) {
    const { page } = this, { left, width } = page.box, top = floor + STRIP.top;
    this.chosen = Math.min(this.chosen, this.stops.length - 1);
    setAttributes(this.title, { x: left - 11, y: top + 10 });
    setAttributes(this.strip, { x: left, y: top, width });
    setAttributes(this.ground, { x: left, y: top, width });
    while (this.grips.length > this.stops.length) this.grips.pop().remove();
    while (this.grips.length < this.stops.length) this.grips.push(this.#grip(this.grips.length));
    const [first, last] = page.range;
    this.stops.forEach(([value, ...rgb], k) => {
      const [x] = page.toPixel([value, 0]), grip = this.grips[k], isChosen = k === this.chosen;
      setAttributes(grip, { transform: `translate(${x.toFixed(2)} ${top + STRIP.height})`, tabindex: 0,
        "aria-label": `colour ${k + 1} of ${this.stops.length}`, "aria-valuetext": this.words(k), "aria-valuenow": value,
        "aria-valuemin": first, "aria-valuemax": last, "aria-readonly": page.isReadOnly });
      grip.querySelector(".dnb-cv-pin").setAttribute("fill", hexOf(rgb));
      grip.classList.toggle("dnb-cv-chosen", isChosen && page.row === this);
      grip.style.display = page.isSeen(value) ? "" : "none";
    });
    this.#drawPicker();
  }

  #grip(k) {
    const { page } = this, grip = svgElement("g", { class: "dnb-cv-grip", "data-stop": k, role: "slider", ...OWN_KEYS }, this.group);
    svgElement("rect", { class: "dnb-cv-hit", x: -10, y: -STRIP.height, width: 20, height: STRIP.height + 18 }, grip);
    svgElement("path", { class: "dnb-cv-ring", d: PIN }, grip);
    svgElement("path", { class: "dnb-cv-pin", d: PIN }, grip);
    svgElement("title", {}, grip).textContent = "Drag; double click or Enter: another colour; right click or Del: remove";
    page.listen(grip, "focus", () => { if (!page.isHeld) this.choose(this.grips.indexOf(grip)); });
    return grip;
  }

  #drawPicker() {
    const { picker, page } = this, hex = hexOf(this.stops[this.chosen].slice(1));
    if (!this.isPicking && picker.value !== hex) picker.value = hex;
    picker.disabled = page.isReadOnly;
    setAttributes(picker, { title: "Another colour for the chosen stop",
      "aria-label": `Colour of stop ${this.chosen + 1} of ${this.stops.length}, at ${page.shownValue(this.stops[this.chosen][0])}` });
  }
}

// The window of a transfer function: a bar from its first to its last node. Its ends are the window's, all of it is the
// level; what is dragged takes all nodes and colours along. Needs inputs/transfer_editor.js, ui/dom.js and inputs/base.js;
// WindowBar belongs to a TransferEditorPage.

const BAR_AT = { top: 64, height: 12 }; // CSS pixels, from the floor of the plot
const WINDOW_PARTS = { level: "level: all values", low: "low end", high: "high end" };
const NARROWEST = 1 / 1000; // of the values of the volume

class WindowBar {
  constructor(page) {
    Object.assign(this, { page, part: "level", grips: {} });
    this.group = svgElement("g", { class: "dnb-cv-window" }, page.svg);
    this.title = svgElement("text", { class: "dnb-cv-text", "text-anchor": "end", "aria-hidden": "true" }, this.group);
    this.title.textContent = "Window";
    this.rail = svgElement("path", { class: "dnb-cv-rail", "aria-hidden": "true" }, this.group);
    for (const [part, text] of Object.entries(WINDOW_PARTS)) this.grips[part] = this.#grip(part, text);
    this.cancelDrag = listenToDrags(page, this.group, this);
    page.listen(this.group, "dblclick", (event) => {
      event.preventDefault();
      event.stopPropagation();
      if (this.#at(event)) page.zoomToWindow();
    });
  }

  get window() { return windowOf(this.page.nodes, this.page.colors); }

  /** How far either end may go: as far again as the values of the volume reach. */
  get limits() {
    const { low, high } = this.page.model.get("histogram");
    return [low - (high - low), high + (high - low)];
  }

  get least() {
    const { low, high } = this.page.model.get("histogram");
    return NARROWEST * (high - low);
  }

  /** Nodes that all lie at one value cannot be stretched. */
  get isFlat() {
    const [low, high] = this.window;
    return !(high > low);
  }

  value() { return { window: this.window }; }

  facts() {
    const [low, high] = this.window, { page } = this;
    return `Window ${page.shownValue(low)} to ${page.shownValue(high)}: level ${page.shownValue((low + high) / 2)}, width ${page.shownValue(high - low)}`;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  #at(event) {
    const hit = this.page.root.getRootNode().elementFromPoint(event.clientX, event.clientY)?.closest?.("[data-window]");
    return hit && this.group.contains(hit) ? hit.dataset.window : null;
  }

  choose(part) {
    this.part = part;
    this.page.choose(this);
  }

  #show({ nodes, colors }, to) {
    const from = windowOf(nodes, colors), at = (row) => [stretchedValue(row[0], from, to), ...row.slice(1)];
    this.page.changed({ nodes: nodes.map(at), colors: colors.map(at) });
  }

  press(event) {
    const { page } = this, part = page.isReadOnly || this.isFlat ? null : this.#at(event);
    if (part === null) return null;
    page.settle();
    this.grips[part].focus({ preventScroll: true });
    this.choose(part);
    page.isHeld = true;
    return { part, before: page.kept() };
  }

  drag({ part, before }, [dx]) {
    const { page } = this, [[x0, x1]] = page.view, [low, high] = windowOf(before.nodes, before.colors);
    const end = part === "high" ? high : low, by = page.tidy([end + dx / page.box.width * (x1 - x0), 0], true, false)[0] - end;
    this.#show(before, movedWindow([low, high], part, by, this.least, this.limits));
    page.move(this.value());
  }

  drop({ before }, isCancelled, isClick) { this.page.dropped(this, before, isCancelled, isClick); }

  nudge(part, by) {
    const { page } = this;
    if (this.isFlat) return;
    page.nudging(this);
    this.choose(part);
    this.#show(page, movedWindow(this.window, part, by, this.least, this.limits));
    page.move(this.value());
  }

  key(event) {
    const { page } = this, part = Object.keys(this.grips).find((name) => this.grips[name] === event.target);
    if (!part || page.isReadOnly) return false;
    const step = ARROWS[event.key];
    if (step) this.nudge(part, (step[0] + step[1]) * page.valueStep(event.shiftKey));
    else if (event.key === "Enter" || event.key === " ") { page.settle(); page.zoomToWindow(); }
    else return false;
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  #grip(part, text) {
    const { page } = this, grip = svgElement("g", { class: `dnb-cv-grip dnb-cv-${part}`, "data-window": part, role: "slider",
      tabindex: 0, "aria-label": `window, ${text}`, ...OWN_KEYS }, this.group);
    const tip = part === "level" ? "Drag: all nodes and colours move; double click or Enter: zoom to the window"
      : "Drag: all nodes and colours are stretched";
    svgElement("title", {}, grip).textContent = tip;
    if (part === "level") {
      svgElement("rect", { class: "dnb-cv-hit", y: -6, height: BAR_AT.height + 12 }, grip);
      svgElement("rect", { class: "dnb-cv-span", height: BAR_AT.height, rx: 3 }, grip);
    } else {
      svgElement("rect", { class: "dnb-cv-hit", x: part === "low" ? -14 : -4, y: -6, width: 18, height: BAR_AT.height + 12 }, grip);
      svgElement("rect", { class: "dnb-cv-end", x: -4, y: -3, width: 8, height: BAR_AT.height + 6, rx: 3 }, grip);
      svgElement("path", { class: "dnb-cv-notch", d: `M-1 1.5v9M1 1.5v9` }, grip);
    }
    page.listen(grip, "focus", () => { if (!page.isHeld) this.choose(part); });
    return grip;
  }

  draw(floor) {
    const { page } = this, { left, width } = page.box, top = floor + BAR_AT.top, [low, high] = this.window;
    const inside = (value) => Math.max(left, Math.min(left + width, page.toPixel([value, 0])[0]));
    const from = inside(low), to = inside(high), middle = (low + high) / 2;
    setAttributes(this.title, { x: left - 11, y: top + 10 });
    this.rail.setAttribute("d", `M${left} ${top + BAR_AT.height / 2}h${width}`);
    const [first, last] = this.limits;
    for (const [part, value, x] of [["level", middle, from], ["low", low, from], ["high", high, to]]) {
      const grip = this.grips[part];
      setAttributes(grip, { transform: `translate(${x.toFixed(2)} ${top})`, "aria-valuenow": value, "aria-valuemin": first,
        "aria-valuemax": last, "aria-valuetext": page.shownValue(value), "aria-readonly": page.isReadOnly,
        "aria-disabled": this.isFlat });
      grip.classList.toggle("dnb-cv-chosen", page.row === this && this.part === part);
      grip.classList.toggle("dnb-cv-beyond", part !== "level" && !page.isSeen(value));
    }
    for (const rect of this.grips.level.querySelectorAll("rect")) rect.setAttribute("width", Math.max(0, to - from).toFixed(2));
  }
}

// The transfer editor: opacity over the histogram of a volume, below it colours and the window of both. Joined behind the
// files that widgets/inputs/transfer_editor.py names.

export const ROWS = { ...PLOT, left: 58, bottom: 92 }; // room for colours and window under the axis
const LEAST_BAR = 1.5; // CSS pixels
const VALUE_ICONS = {
  in: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M7.3 5v4.4M5 7.2h4.5",
  out: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M5 7.2h4.5",
  all: "M2 3v10M14 3v10M4.5 8h7M6.5 6l-2 2 2 2M9.5 6l2 2-2 2",
};

class TransferEditorPage extends CurvePlot {
  constructor(model, el) {
    super(model, el, "dnb-transfer-editor");
    Object.assign(this, { margins: ROWS, zoom: null, row: null, pending: null, hintTimer: 0, hinted: "" });
    this.#build();
    this.on("change:histogram", () => { this.zoom = null; this.invalidate(); });
    for (const name of ["height", "power"]) this.on(`change:${name}`, () => { this.power = model.get("power"); this.invalidate(); });
    this.power = model.get("power") || 1;
    this.listen(this.svg, "wheel", (event) => this.wheel(event), { passive: false });
    this.start();
  }

  close() {
    clearTimeout(this.hintTimer);
    super.close();
  }

  #build() {
    this.chooser = pageElement("select", "dnb-cv-select", this.bar, { "aria-label": "Presets", ...OWN_KEYS });
    pageElement("option", "", this.chooser, { value: "" }).textContent = "own settings";
    for (const name of this.model.get("presets") ?? []) {
      pageElement("option", "", this.chooser, { value: name }).textContent = name;
    }
    this.listen(this.chooser, "change", () => {
      if (this.chooser.value) this.take(this.chooser.value); else this.invalidate();
    });
    this.resetter = pageElement("button", "dnb-cv-button dnb-cv-wide", this.bar, { type: "button", ...OWN_KEYS });
    this.resetter.textContent = "Reset";
    this.listen(this.resetter, "click", () => { if (this.back && !this.named) this.take(this.back); });
    pageElement("span", "dnb-cv-space", this.bar);
    const name = `dnb-${this.link.id}`, defs = svgElement("defs", {}, this.svg);
    this.gradient = svgElement("linearGradient", { id: name, gradientUnits: "userSpaceOnUse", y1: 0, y2: 0 }, defs);
    this.hole = svgElement("rect", {}, svgElement("clipPath", { id: `${name}-hole` }, defs));
    this.bars = svgElement("path", { class: "dnb-cv-bars" }, this.backLayer);
    this.area = svgElement("path", { class: "dnb-cv-area", fill: `url(#${name})` }, this.backLayer);
    for (const layer of [this.backLayer, this.curveLayer]) layer.setAttribute("clip-path", `url(#${name}-hole)`);
    this.stops = new ColorStops(this, `url(#${name})`);
    this.window = new WindowBar(this);
    this.rows = [this.stops, this.window];
    this.listen(this.frontLayer, "focusin", () => this.choose(null));
    this.stops.addPicker(this.bar);
    this.addButtons();
    pageElement("span", "dnb-cv-gap", this.bar);
    this.nearer = this.#button("in", "Zoom into the values (+, or the wheel)", () => this.zoomBy(2));
    this.farther = this.#button("out", "Zoom out (\u2212)", () => this.zoomBy(0.5));
    this.wholer = this.#button("all", "Show all values (0)", () => this.zoomTo(null));
  }

  #button(icon, tip, action) {
    const button = pageElement("button", "dnb-cv-button", this.bar, { type: "button", title: tip, "aria-label": tip, ...OWN_KEYS });
    const drawn = svgElement("svg", { class: "dnb-cv-icon", viewBox: "0 0 16 16", "aria-hidden": "true", focusable: "false" }, button);
    svgElement("path", { d: VALUE_ICONS[icon] }, drawn);
    this.listen(button, "click", action);
    return button;
  }

  adopt(shown) {
    const { nodes, colors, preset: named, range, back } = shown;
    Object.assign(this, { nodes, colors, named, range, back });
    if (this.zoom) this.zoom = zoomedAxis(this.zoom, this.whole, 1, this.zoom[0]);
    this.view = this.axes();
  }

  value() { return { nodes: this.nodes }; }

  take(preset) {
    if (this.isReadOnly) { this.invalidate(); return; }
    this.settle();
    this.named = preset;
    this.end({ preset });
  }

  // ---- edits of nodes, colours and window ------------------------------------------------------------------------

  /** What a drag may have to come back to. */
  kept() {
    const { nodes, colors, named } = this;
    return { nodes, colors, named };
  }

  changed(what) {
    Object.assign(this, what);
    this.named = "";
    this.invalidate();
  }

  /** The row that a hand is at; null for the nodes of the curve. */
  choose(row) {
    this.row = row;
    this.invalidate();
  }

  commitOf(row) {
    clearTimeout(this.keyTimer);
    this.pending = null;
    this.isHeld = false;
    this.view = this.axes();
    this.end(row.value());
    this.invalidate();
  }

  dropped(row, before, isCancelled, isClick) {
    if (!isCancelled && !isClick) { this.commitOf(row); return; }
    this.isHeld = false;
    Object.assign(this, before);
    // Whoever followed the movements hears where it ended; Python's value has not changed.
    if (isCancelled && this.model.get("live")) this.end(before.named ? { preset: before.named } : row.value());
    else this.receive();
    this.invalidate();
  }

  /** An arrow key is at work on a row: keys held down are one edit. */
  nudging(row) {
    if (this.pending !== row) this.settle();
    this.pending = row;
    this.isHeld = true;
    clearTimeout(this.keyTimer);
    this.keyTimer = setTimeout(() => this.guard(() => this.settle()), KEYS_REST);
  }

  settle() {
    if (this.pending) this.commitOf(this.pending);
    else super.settle();
  }

  show(nodes, chosen) {
    super.show(nodes, chosen);
    this.row = null;
    this.reveal(nodes[chosen][0]);
  }

  press(event) {
    const grabbed = super.press(event);
    if (grabbed !== null) { this.choose(null); return grabbed; }
    const [x, y] = this.pointOf(event), { left, top, width, height } = this.box;
    const isInside = x > left && x < left + width && y > top && y < top + height;
    return this.zoom && isInside && event.target.closest(".dnb-cv-grip") === null ? { pan: this.zoom } : null;
  }

  drag(grabbed, by) {
    if (!grabbed.pan) { super.drag(grabbed, by); return; }
    const [low, high] = grabbed.pan;
    this.zoomTo(pannedAxis(grabbed.pan, this.whole, -by[0] / this.box.width * (high - low)));
  }

  drop(grabbed, isCancelled, isClick) { if (!grabbed.pan) super.drop(grabbed, isCancelled, isClick); }

  addChosen() { if (this.row === this.stops) this.stops.addChosen(); else super.addChosen(); }

  removeChosen() { if (this.row === this.stops) this.stops.removeChosen(); else super.removeChosen(); }

  key(event) {
    if (event.ctrlKey || event.metaKey) return;
    const isEscaped = event.key === "Escape" && this.rows.some((row) => row.cancelDrag());
    if (!isEscaped && !this.rows.some((row) => row.key(event)) && !this.#zoomKey(event)) { super.key(event); return; }
    event.preventDefault();
    event.stopPropagation();
  }

  // ---- the values that are seen ------------------------------------------------------------------------------------

  get whole() {
    const [low, high] = this.range;
    return [low, high > low ? high : low + 1];
  }

  isSeen(value) {
    const [[low, high]] = this.view, slack = 1e-9 * (high - low);
    return value >= low - slack && value <= high + slack;
  }

  zoomTo(zoom) {
    this.zoom = zoom;
    this.view = this.axes();
    this.invalidate();
  }

  /** About a value, by default the chosen one where it is seen. */
  zoomBy(factor, about) {
    const [[low, high]] = this.view, chosen = this.row === this.stops ? this.colors[this.stops.chosen][0] : this.nodes[this.chosen][0];
    const at = about ?? (this.isSeen(chosen) && !(this.row === this.window) ? chosen : (low + high) / 2);
    this.zoomTo(zoomedAxis([low, high], this.whole, factor, at));
  }

  zoomToWindow() {
    const [low, high] = this.window.window, room = 0.1 * (high - low), whole = this.whole;
    if (!(high > low)) return;
    const wanted = [Math.max(whole[0], low - room), Math.min(whole[1], high + room)];
    this.zoomTo(zoomedAxis(wanted, whole, 1, low));
  }

  /** What an arrow key takes beyond the edge is seen again. */
  reveal(value) {
    if (!this.zoom || this.isSeen(value)) return;
    const [low, high] = this.zoom;
    this.zoomTo(pannedAxis(this.zoom, this.whole, value < low ? value - low : value - high));
  }

  #zoomKey(event) {
    if (!this.svg.contains(event.target)) return false;
    if (event.key === "+" || event.key === "=") this.zoomBy(2);
    else if (event.key === "-") this.zoomBy(0.5);
    else if (event.key === "0") this.zoomTo(null);
    else return false;
    return true;
  }

  // The wheel belongs to the page that scrolls, until someone works in here.
  wheel(event) {
    const isWanted = event.ctrlKey || event.metaKey || this.root.contains(this.root.getRootNode().activeElement);
    if (!isWanted) { this.hint("Click here, or hold Ctrl, to zoom with the wheel"); return; }
    if (!this.zoom && event.deltaY >= 0 && !event.ctrlKey && !event.metaKey) return; // all is seen: let the page scroll
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1, [[low, high]] = this.view;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      if (this.zoom) this.zoomTo(pannedAxis(this.zoom, this.whole, event.deltaX * lines / this.box.width * (high - low)));
      return;
    }
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    const at = Math.max(low, Math.min(high, this.toPlace(this.pointOf(event))[0]));
    this.zoomBy(Math.exp(-delta * (event.ctrlKey ? 0.01 : WHEEL_STEP)), at);
  }

  hint(text) {
    this.hinted = text;
    clearTimeout(this.hintTimer);
    this.hintTimer = setTimeout(() => this.guard(() => { this.hinted = ""; this.invalidate(); }), 2500);
    this.invalidate();
  }

  // ---- what is on the plot ------------------------------------------------------------------------------------------

  rules() { return { x: this.whole, y: [0, 1], step: 0, gap: 0, isPinned: false, most: 64 }; }

  axes() { return [this.zoom ?? this.whole, [0, 1]]; }

  // A hand keeps what it drags within what is seen; the ends of the window may leave it.
  tidy([x, y], isFree = false, isInside = true) {
    const [[low, high]] = this.view;
    return super.tidy([isInside ? Math.max(low, Math.min(high, x)) : x, y], isFree);
  }

  valueStep(isFar) {
    const [[low, high]] = this.view;
    return (isFar ? 10 : 1) * (high - low) / 200;
  }

  ticks() {
    if (this.power === 1) return super.ticks(0, 1);
    let last = Infinity;
    return [0, 0.001, 0.01, 0.1, 0.5, 1].filter((alpha) => {
      const at = this.toPixel([this.range[0], alpha])[1], isFar = last - at >= 13;
      if (isFar) last = at;
      return isFar;
    });
  }

  tickText(alpha) { return String(alpha); }

  shownValue(value) {
    const [[low, high]] = this.view;
    return shownNumber(value, high - low);
  }

  endWords() { return this.view[0].map((value) => this.shownValue(value)); }

  words(k) {
    const [value, alpha] = this.nodes[k];
    return `value ${this.shownValue(value)}, opacity ${Number(alpha.toPrecision(3))}`;
  }

  help() {
    return "Tab goes through the nodes, the colours below and the window of all, arrows move them, A adds one, Delete removes "
      + "one, Enter recolours; plus and minus zoom.";
  }

  drawBack() {
    const { left, top, width, height } = this.box, { low, high, heights } = this.model.get("histogram");
    const x = (value) => this.toPixel([value, 0])[0], floor = top + height, each = (high - low) / heights.length;
    const edge = (k) => Math.max(left, Math.min(left + width, x(Math.min(high, low + k * each)))).toFixed(2);
    const together = Math.max(1, Math.ceil(LEAST_BAR / (x(each) - x(0)))), steps = []; // finer bars are seen when zoomed
    for (let k = 0; k < heights.length; k += together) {
      const h = Math.max(...heights.slice(k, k + together));
      steps.push(`V${(floor - h * height * 0.97).toFixed(2)}H${edge(k + together)}`);
    }
    this.bars.setAttribute("d", `M${edge(0)} ${floor}${steps.join("")}V${floor}Z`);
    const outline = this.outline();
    this.area.setAttribute("d", `${pathOf(outline)}L${outline[outline.length - 1][0]} ${floor}L${outline[0][0]} ${floor}Z`);
    const first = x(this.colors[0][0]), last = x(this.colors[this.colors.length - 1][0]);
    setAttributes(this.gradient, { x1: first, x2: last });
    this.gradient.replaceChildren(...this.colors.map(([value, ...rgb]) => svgElement("stop", {
      offset: last > first ? (x(value) - first) / (last - first) : 0,
      "stop-color": `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})` })));
    setAttributes(this.hole, { x: left, y: top - 2, width, height: height + 4 });
    for (const row of this.rows) row.draw(floor);
  }

  drawNodes() {
    super.drawNodes();
    this.dots.forEach((dot, k) => {
      dot.style.display = this.isSeen(this.nodes[k][0]) ? "" : "none";
      if (this.row !== null) dot.classList.remove("dnb-cv-chosen");
    });
  }

  describe() {
    super.describe();
    if (this.row) setText(this.facts, this.row.facts());
    const { isReadOnly, row, stops, back, named } = this, isAtStops = row === stops;
    if (isAtStops) setAttributes(this.remover, { "aria-disabled": isReadOnly || !stops.canRemove });
    const what = isAtStops ? "colour" : "node";
    setAttributes(this.adder, { title: `Add a ${what} after the chosen one (A, or double click)`, "aria-label": `Add a ${what}` });
    setAttributes(this.remover, { title: `Remove the chosen ${what} (Del, or right click)`, "aria-label": `Remove the chosen ${what}` });
    const isOwn = !named, again = back ? `the preset ${back}` : "a preset";
    setAttributes(this.resetter, { "aria-disabled": isReadOnly || !isOwn || !back,
      title: `Take ${again} again: undo knows nothing of colours and opacities` });
    this.chooser.value = named ?? "";
    this.chooser.disabled = isReadOnly;
    setAttributes(this.farther, { "aria-disabled": !this.zoom });
    setAttributes(this.wholer, { "aria-disabled": !this.zoom });
    setText(this.note, this.#remarks());
  }

  #remarks() {
    const { note } = this.model.get("histogram"), { hinted, zoom, named, back, isReadOnly } = this;
    if (hinted) return hinted;
    if (isReadOnly) return "shown only";
    if (zoom) return "zoomed: drag the plot to move along, 0 shows all";
    if (!named && back) return `not part of undo; Reset takes ${back} again`;
    return `log histogram${note ? `, ${note}` : ""}`;
  }
}

function render({ model, el }) {
  const page = new TransferEditorPage(model, el);
  return () => page.close();
}

export default { render };
