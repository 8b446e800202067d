// The table of control points. Joined behind the files that deformnb/widgets/inputs/points_table.py names.
//
// Only the rows in sight are in the page. Python sends the points (ids, names, flags, numbers); the page tells what shall
// be done: {type: "act", view, seq, what, ids, field, axis, value}, and is answered {type: "done", view, seq, ok}.
// While the editor drags points, their rows follow it without Python (link.js).

const GO_ICON = "M8 1.5v3M8 11.5v3M1.5 8h3M11.5 8h3M8 5.2a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.6";

// name, words, tip, whether it needs chosen points
const TABLE_BUTTONS = [
  ["reset", "Put back", "Put the selected points back where they were taken", true],
  ["switch", "On/off", "Switch the selected points on or off", true],
  ["lock", "Lock", "Lock the selected points where they are, or unlock them", true],
  ["remove", "Delete", "Delete the selected points (Del)", true],
  ["copy", "Copy", "Copy the selected points, or all, as CSV text (Ctrl+C)", false],
  ["paste", "Paste", "Take points from CSV text (Ctrl+V): rows with a known id change that point, others are added", false],
];

class PointsTablePage extends PointsCells {
  constructor(model, el) {
    super();
    Object.assign(this, { model, view: Math.random().toString(36).slice(2, 12), seq: 0, waiting: new Map(), rows: new Map(),
      sort: { key: null, isDown: false }, active: { id: null, key: "name" }, lastRank: 0, anchor: null, frame: 0,
      points: [], order: [], ranks: new Map(), live: new Map(), dim: 0, said: "", closed: new AbortController() });
    this.selected = new Set(model.get("selected"));
    this.#build(el);
    this.#listen();
    this.read();
  }

  #build(el) {
    this.root = pageElement("div", "dnb-points-table", el, { role: "group", "aria-label": "Control points" });
    this.bar = pageElement("div", "dnb-pt-bar", this.root);
    this.place = pageElement("input", "dnb-pt-place", this.bar, { type: "text", spellcheck: "false", autocomplete: "off",
      "aria-label": "Coordinates of a new point", ...OWN_KEYS });
    this.addButton = this.#button("add", "Add", "Add a point at these coordinates of the picture; nothing moves until it is dragged");
    this.buttons = new Map(TABLE_BUTTONS.map(([name, words, tip]) => [name, this.#button(name, words, tip)]));
    this.pasting = pageElement("div", "dnb-pt-pasting", this.root, { hidden: "" });
    this.text = pageElement("textarea", "dnb-pt-rows", this.pasting, { rows: "4", spellcheck: "false",
      "aria-label": "Rows of points as CSV text", placeholder: "Paste rows here", ...OWN_KEYS });
    this.take = this.#button("take", "Take these points", "Add or change the points of this text", this.pasting);
    this.drop = this.#button("drop", "Cancel", "Take nothing (Esc)", this.pasting);
    this.grid = pageElement("div", "dnb-pt-grid", this.root, { role: "grid", "aria-multiselectable": "true" });
    this.scroller = pageElement("div", "dnb-pt-scroller", this.grid, { role: "presentation" });
    const first = pageElement("div", "dnb-pt-head", this.scroller, { role: "rowgroup" });
    this.head = pageElement("div", "dnb-pt-row", first, { role: "row", "aria-rowindex": 1 });
    this.body = pageElement("div", "dnb-pt-body", this.scroller, { role: "rowgroup" });
    this.status = pageElement("div", "dnb-pt-status", this.root);
    this.facts = pageElement("span", "dnb-pt-facts", this.status);
    this.spoken = pageElement("span", "dnb-pt-said", this.status, { role: "status" });
    this.root.deformnb = this; // for tests and for whoever looks into the page
  }

  #button(name, words, tip, parent = this.bar) {
    const made = pageElement("button", "dnb-pt-button", parent, { type: "button", title: tip, "data-act": name, ...OWN_KEYS });
    made.textContent = words;
    made.addEventListener("click", () => { if (made.getAttribute("aria-disabled") !== "true") this.run(name); });
    return made;
  }

  #listen() {
    const { signal } = this.closed, on = (target, name, handler) => target.addEventListener(name, handler, { signal });
    this.handlers = [["msg:custom", (content) => this.#answered(content)],
      ["change:uid", () => this.follow()], ["change:smoothing_on", () => this.invalidate()],
      ["change:read_only", () => this.invalidate()],
      ["change:selected", () => { this.takeSelection(this.model.get("selected")); }],
      ...["ids", "names", "flags", "numbers", "dim"].map((name) => [`change:${name}`, () => this.#readSoon()])];
    for (const [name, handler] of this.handlers) this.model.on(name, handler);
    on(this.scroller, "scroll", () => this.invalidate());
    on(this.grid, "keydown", (event) => this.key(event));
    on(this.grid, "click", (event) => this.#click(event));
    on(this.grid, "dblclick", (event) => this.#doubleClick(event));
    on(this.grid, "change", (event) => this.#changed(event));
    on(this.grid, "focusin", (event) => this.#focused(event));
    on(this.grid, "copy", (event) => { if (!event.target.closest?.("input")) this.#copyInto(event); });
    on(this.grid, "paste", (event) => this.#pasted(event));
    on(this.place, "keydown", (event) => { if (event.key === "Enter") this.run("add"); event.stopPropagation(); });
    on(this.text, "keydown", (event) => { if (event.key === "Escape") this.run("drop"); event.stopPropagation(); });
    this.sized = new ResizeObserver(() => this.invalidate());
    this.sized.observe(this.scroller);
    // Python sends thousands of points to those tables only that somebody sees.
    this.sight = new IntersectionObserver((entries) => this.act("seen", [], { value: entries.at(-1).isIntersecting }));
    this.sight.observe(this.root);
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.repaint = () => this.#paper();
    this.dark.addEventListener("change", this.repaint);
    this.themes = new MutationObserver(this.repaint);
    this.themes.observe(document.body, { attributes: true });
    this.#paper();
    this.follow();
  }

  close() {
    this.closed.abort();
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.sized.disconnect();
    this.sight.disconnect();
    this.themes.disconnect();
    this.dark.removeEventListener("change", this.repaint);
    this.#leave();
    cancelAnimationFrame(this.frame);
    clearTimeout(this.reading);
    this.act("seen", [], { value: false });
    this.root.remove();
  }

  get isReadOnly() { return Boolean(this.model.get("read_only")); }

  #paper() {
    const [r, g, b, alpha = 1] = (getComputedStyle(this.root).backgroundColor.match(/[\d.]+/g) || []).map(Number);
    const isDark = alpha > 0 && r !== undefined ? 0.2126 * r + 0.7152 * g + 0.0722 * b < 110 : this.dark.matches;
    this.root.classList.toggle("dnb-pt-dark", isDark);
  }

  // ---- the points ---------------------------------------------------------------------------------------------------

  // One message sets several traits: they are read together.
  #readSoon() {
    clearTimeout(this.reading);
    this.reading = setTimeout(() => this.read());
  }

  read() {
    const points = readPoints(this.model), dim = this.model.get("dim");
    if (!points) return;
    if (dim !== this.dim) {
      this.dim = dim;
      this.columns = pointColumns(dim);
      for (const row of this.rows.values()) row.remove();
      this.rows.clear();
      if (!this.columns.some(({ key }) => key === this.active.key)) this.active.key = "name";
      if (!this.columns.some(({ key }) => key === this.sort.key)) this.sort.key = null;
      this.place.placeholder = AXES[dim].join(", ");
      this.makeHead();
    }
    this.points = points;
    this.live.clear();
    if (this.active.id === null && points.length && !this.isFocused()) this.active.id = points[0].id;
    this.arrange();
  }

  arrange() {
    this.order = orderedPoints(this.points, this.columns.find(({ key }) => key === this.sort.key), this.sort.isDown, this.dim);
    this.ranks = new Map(this.order.map((k, rank) => [this.points[k].id, rank]));
    this.draw();
  }

  // Up, down, and as the points were made.
  sortBy(key) {
    if (this.sort.key !== key) this.sort = { key, isDown: false };
    else if (!this.sort.isDown) this.sort.isDown = true;
    else this.sort = { key: null, isDown: false };
    this.active = { id: null, key };
    this.arrange();
    this.focusCell();
  }

  follow() {
    this.#leave();
    const uid = this.model.get("uid");
    if (!uid) return;
    this.bus = busOf({ get: () => uid });
    this.moved = ({ detail: { points } }) => {
      this.live = new Map(); // until Python has heard of it
      for (const { id, source, target } of points) {
        const p = this.points[this.order[this.rankOf(id)]];
        if (p && source.length === this.dim) this.live.set(id, Float64Array.of(...source, ...target, ...p.numbers.slice(2 * this.dim)));
      }
      this.invalidate();
    };
    this.bus.addEventListener("deformnb:points", this.moved);
  }

  #leave() {
    this.bus?.removeEventListener("deformnb:points", this.moved);
    this.bus = null;
  }

  // ---- selection ----------------------------------------------------------------------------------------------------

  chosenIds() { return this.selected.size ? [...this.selected] : this.active.id === null ? [] : [this.active.id]; }

  select(ids) {
    this.selected = new Set(ids);
    this.model.set("selected", [...this.selected]);
    this.model.save_changes();
    this.invalidate();
  }

  // From Python: somebody has selected points in the picture.
  takeSelection(ids) {
    if (ids.length === this.selected.size && ids.every((id) => this.selected.has(id))) return;
    this.selected = new Set(ids);
    const rank = this.rankOf(ids[0]);
    if (rank >= 0 && !this.isFocused()) {
      this.active.id = ids[0];
      this.show(rank);
    }
    this.invalidate();
  }

  choose(rank, isToggled, isRange) {
    const id = this.points[this.order[rank]]?.id, from = this.rankOf(this.anchor);
    if (id === undefined) return;
    if (isRange && from >= 0) {
      const [low, high] = [Math.min(from, rank), Math.max(from, rank)];
      this.select(this.order.slice(low, high + 1).map((k) => this.points[k].id));
      return;
    }
    this.anchor = id;
    if (!isToggled) this.select([id]);
    else this.select(this.selected.has(id) ? [...this.selected].filter((other) => other !== id) : [...this.selected, id]);
  }

  // ---- the mouse ----------------------------------------------------------------------------------------------------

  #cellAt(event) {
    const cell = event.target.closest(".dnb-pt-cell"), row = cell?.closest(".dnb-pt-row[data-id]");
    return row ? { id: Number(row.dataset.id), key: cell.dataset.key } : null;
  }

  #focused(event) {
    const at = this.#cellAt(event), head = at ? null : event.target.closest(".dnb-pt-head-cell");
    if (at) this.active = at;
    else if (head) this.active = { id: null, key: head.dataset.key };
    this.reach();
  }

  #click(event) {
    const at = this.#cellAt(event);
    if (!at || event.target.closest(".dnb-pt-input")) return;
    if (at.key === "go") { if (event.target.closest("button")) this.act("look", [at.id]); return; }
    if (event.target.closest(".dnb-pt-box")) return;
    this.choose(this.rankOf(at.id), event.ctrlKey || event.metaKey, event.shiftKey);
  }

  #doubleClick(event) {
    const at = this.#cellAt(event);
    if (at && !event.target.closest("input, button")) this.write(at.id, at.key);
  }

  #changed(event) {
    const at = this.#cellAt(event), box = event.target;
    if (!at || !box.classList.contains("dnb-pt-box")) return;
    this.act("cell", [at.id], { field: at.key, axis: 0, value: box.checked }, at.key);
    box.checked = !box.checked; // as Python holds it, until it answers
  }

  // ---- what is done -------------------------------------------------------------------------------------------------

  run(name) {
    if (name === "add") this.act("add", [], { value: this.place.value }, "place");
    else if (name === "copy") this.#copyNow();
    else if (name === "paste" || name === "drop") this.#openPasting(name === "paste" && this.pasting.hidden);
    else if (name === "take") this.act("paste", [], { value: this.text.value }, "text");
    else this.act(name, this.chosenIds());
  }

  #openPasting(isOpen) {
    this.pasting.hidden = !isOpen;
    if (isOpen) this.text.focus();
    else this.buttons.get("paste").focus();
  }

  // `key` is where a refusal is shown: a column, "place" or "text".
  act(what, ids = [], { field = "", axis = 0, value = null } = {}, key = "") {
    this.seq += 1;
    if (what !== "seen") this.say("");
    this.waiting.set(this.seq, { what, ids, key });
    this.model.send({ type: "act", view: this.view, seq: this.seq, what, ids, field, axis, value });
  }

  #answered({ type, view, seq, ok, text }) {
    const asked = this.waiting.get(seq);
    if (type !== "done" || view !== this.view || !asked) return;
    this.waiting.delete(seq);
    if (text) this.say(text);
    if (ok && asked.key === "place") this.place.value = "";
    if (ok && asked.key === "text") { this.text.value = ""; this.#openPasting(false); }
    if (!ok && asked.ids.length) this.refuse(asked.ids[0], asked.key);
    for (const [input, key] of [[this.place, "place"], [this.text, "text"]]) {
      if (asked.key === key) setAttributes(input, { "aria-invalid": !ok });
    }
  }

  // A page that was not served over https has no other clipboard.
  #copyNow() {
    const once = (event) => { event.stopPropagation(); this.#copyInto(event); };
    document.addEventListener("copy", once, { capture: true });
    const isDone = document.execCommand("copy");
    document.removeEventListener("copy", once, { capture: true });
    if (!isDone) this.say("This browser does not let a page copy.");
  }

  #copyInto(event) {
    const chosen = this.selected.size ? this.points.filter(({ id }) => this.selected.has(id)) : this.points;
    event.clipboardData.setData("text/plain", pointsAsCsv(chosen, this.dim));
    event.preventDefault();
    this.say(`${chosen.length} ${chosen.length === 1 ? "point" : "points"} copied as CSV.`);
  }

  #pasted(event) {
    if (event.target.closest?.("input, textarea")) return;
    event.preventDefault();
    this.act("paste", [], { value: event.clipboardData.getData("text/plain") });
  }

  // ---- words --------------------------------------------------------------------------------------------------------

  say(text) { setText(this.spoken, text); }

  describe() {
    const { points, selected } = this, count = (n, one, more) => `${n} ${n === 1 ? one : more}`;
    const suspects = points.filter((p) => p.suspect).length, chosen = points.filter((p) => selected.has(p.id)).length;
    setText(this.facts, [count(points.length, "point", "points"), ...(chosen ? [`${chosen} selected`] : []),
      ...(suspects ? [count(suspects, "disagrees with its neighbours", "disagree with their neighbours")] : []),
      ...(this.model.get("smoothing_on") ? [] : ["weights matter only with smoothing, which is off"])].join(" \u00b7 "));
    for (const [name, , , isOfChosen] of TABLE_BUTTONS) {
      setAttributes(this.buttons.get(name), { "aria-disabled": (isOfChosen && !chosen) || (this.isReadOnly && name !== "copy") });
    }
    setAttributes(this.addButton, { "aria-disabled": this.isReadOnly });
  }
}

function render({ model, el }) {
  const page = new PointsTablePage(model, el);
  return () => page.close();
}

export default { render };
