// The window of a transfer function: a bar from its first to its last node. Its ends are the window's, all of it is the
// level; what is dragged takes all nodes and colours along. Needs value_axis.js, elements.js and edited_page.js;
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
