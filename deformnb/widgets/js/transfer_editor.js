// The transfer editor: opacity over the histogram of a volume, colours below. Joined behind the files that
// transfer_editor.py names.

const STRIP = 7; // CSS pixels of colours under the plot

class TransferEditorPage extends CurvePlot {
  constructor(model, el) {
    super(model, el, "dnb-transfer-editor");
    this.#build();
    this.on("change:histogram", () => this.invalidate());
    for (const name of ["height", "power"]) this.on(`change:${name}`, () => { this.power = model.get("power"); this.invalidate(); });
    this.power = model.get("power") || 1;
    this.start();
  }

  #build() {
    this.chooser = pageElement("select", "dnb-cv-select", this.bar, { "aria-label": "Presets", ...OWN_KEYS });
    pageElement("option", "", this.chooser, { value: "" }).textContent = "own opacities";
    for (const name of this.model.get("presets") ?? []) {
      pageElement("option", "", this.chooser, { value: name }).textContent = name;
    }
    pageElement("span", "dnb-cv-space", this.bar);
    this.addButtons();
    this.listen(this.chooser, "change", () => {
      if (!this.chooser.value || this.isReadOnly) { this.invalidate(); return; }
      this.settle();
      this.named = this.chooser.value;
      this.end({ preset: this.named });
    });
    const name = `dnb-${this.link.id}`, defs = svgElement("defs", {}, this.svg);
    this.gradient = svgElement("linearGradient", { id: name, gradientUnits: "userSpaceOnUse", y1: 0, y2: 0 }, defs);
    this.bars = svgElement("path", { class: "dnb-cv-bars" }, this.backLayer);
    this.area = svgElement("path", { class: "dnb-cv-area", fill: `url(#${name})` }, this.backLayer);
    this.strip = svgElement("rect", { class: "dnb-cv-strip", fill: `url(#${name})`, height: STRIP }, this.backLayer);
  }

  adopt(shown) {
    Object.assign(this, { nodes: shown.nodes, colors: shown.colors, named: shown.preset, range: shown.range });
    this.view = this.axes();
  }

  value() { return { nodes: this.nodes }; }

  // ---- what is on the plot ------------------------------------------------------------------------------------------

  rules() { return { x: this.view[0], y: [0, 1], step: 0, gap: 0, isPinned: false, most: 64 }; }

  axes() {
    const [low, high] = this.range;
    return [[low, high > low ? high : low + 1], [0, 1]];
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

  endWords() { return this.range.map((value) => shownNumber(value, this.range[1] - this.range[0])); }

  words(k) {
    const [value, alpha] = this.nodes[k], [low, high] = this.range;
    return `value ${shownNumber(value, high - low)}, opacity ${Number(alpha.toPrecision(3))}`;
  }

  drawBack() {
    const { left, top, width, height } = this.box, { low, high, heights } = this.model.get("histogram");
    const x = (value) => this.toPixel([value, 0])[0], floor = top + height, each = (high - low) / heights.length;
    const edge = (k) => Math.max(left, Math.min(left + width, x(low + k * each))).toFixed(2);
    const steps = heights.map((h, k) => `V${(floor - h * height * 0.97).toFixed(2)}H${edge(k + 1)}`);
    this.bars.setAttribute("d", `M${edge(0)} ${floor}${steps.join("")}V${floor}Z`);
    const outline = this.outline();
    this.area.setAttribute("d", `${pathOf(outline)}L${outline[outline.length - 1][0]} ${floor}L${outline[0][0]} ${floor}Z`);
    const first = x(this.colors[0][0]), last = x(this.colors[this.colors.length - 1][0]);
    setAttributes(this.gradient, { x1: first, x2: last });
    this.gradient.replaceChildren(...this.colors.map(([value, ...rgb]) => svgElement("stop", {
      offset: last > first ? (x(value) - first) / (last - first) : 0,
      "stop-color": `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})` })));
    setAttributes(this.strip, { x: left, y: floor - STRIP, width });
  }

  describe() {
    super.describe();
    this.chooser.value = this.named ?? "";
    this.chooser.disabled = this.isReadOnly;
    const { note } = this.model.get("histogram");
    setText(this.note, `log histogram${note ? `, ${note}` : ""}`);
  }
}

function render({ model, el }) {
  const page = new TransferEditorPage(model, el);
  return () => page.close();
}

export default { render };
