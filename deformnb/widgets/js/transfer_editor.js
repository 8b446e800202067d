// The transfer editor: opacity over the histogram of a volume, below it colours and the window of both. Joined behind the
// files that widgets/inputs/transfer_editor.py names.

const ROWS = { ...PLOT, left: 58, bottom: 92 }; // room for colours and window under the axis
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
