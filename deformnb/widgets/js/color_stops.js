// The colours of a transfer function: a strip, and under it stops that are dragged, added, removed and recoloured.
// Needs curves.js, elements.js and edited_page.js; ColorStops belongs to a TransferEditorPage.

const STRIP = { top: 28, height: 12 }; // CSS pixels, from the floor of the plot
const PIN = "M0 -1L6 6V15.5H-6V6Z";

function hexOf(rgb) {
  return `#${rgb.map((v) => Math.round(255 * Math.max(0, Math.min(1, v))).toString(16).padStart(2, "0")).join("")}`;
}

function rgbOf(hex) { return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255); }

// Red, green and blue at a value, linear between stops [value, red, green, blue].
function colorAt(stops, value) { return [1, 2, 3].map((c) => lineAt(stops.map((stop) => [stop[0], stop[c]]), value)); }

// A stop keeps its place among the others. No edit changes the list it is given.
function movedStop(stops, k, value, [first, last]) {
  const low = k > 0 ? stops[k - 1][0] : Math.min(first, stops[0][0]);
  const high = k < stops.length - 1 ? stops[k + 1][0] : Math.max(last, stops[stops.length - 1][0]);
  const [, ...rgb] = stops[k];
  return stops.map((stop, j) => (j === k ? [Math.max(low, Math.min(high, value)), ...rgb] : stop));
}

// [stops, index of the new one]: nothing changes its colour.
function addedStop(stops, value) {
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
