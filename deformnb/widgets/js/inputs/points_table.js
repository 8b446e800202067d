// The rows of the table of control points: what Python sends of them, columns, order, text. Pure functions; no DOM.

import { busOf } from "../sync/bus.js";
import { OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.js";

const AXES = { 2: ["a", "b"], 3: ["x", "y", "z"] };
const FLAGS = { active: 1, locked: 2, suspect: 4 };

// kind: "fact" and "go" cannot be edited. `at` is the place in a row of numbers.
function pointColumns(dim) {
  const axes = AXES[dim] ?? AXES[2], unit = "in the volume's unit";
  return [
    { key: "id", title: "Id", kind: "fact", width: "52px", tip: "Number of the point; never given twice" },
    { key: "name", title: "Name", kind: "text", width: "minmax(90px, 1fr)", tip: "Name of the point" },
    { key: "active", title: "On", kind: "check", width: "42px", tip: "A point that is off keeps its place and has no say" },
    { key: "locked", title: "Lock", kind: "check", width: "48px", tip: "A locked point stays where it is until it is unlocked" },
    ...axes.map((axis, k) => ({ key: `source_${axis}`, field: "source", axis: k, title: `from ${axis}`, kind: "number", at: k,
      width: "minmax(64px, 92px)", tip: `Source, ${axis}: where the feature is, ${unit}` })),
    ...axes.map((axis, k) => ({ key: `target_${axis}`, field: "target", axis: k, title: `to ${axis}`, kind: "number",
      at: dim + k, width: "minmax(64px, 92px)", tip: `Target, ${axis}: where it shall go, ${unit}` })),
    { key: "drag", title: "Drag", kind: "fact", width: "minmax(56px, 80px)", tip: `How far it is dragged, ${unit}` },
    { key: "weight", title: "Weight", kind: "number", at: 2 * dim, width: "64px",
      tip: "How much the point counts beside others. It matters only with smoothing" },
    { key: "radius", title: "Radius", kind: "number", at: 2 * dim + 1, width: "64px",
      tip: `How far this point reaches, ${unit}; empty: as far as all (Support, under Interpolation)` },
    { key: "error", title: "Off by", kind: "fact", at: 2 * dim + 2, width: "minmax(64px, 80px)",
      tip: `How far all other points would miss this one (leave-one-out error), ${unit}. ! marks a point that disagrees with its neighbours` },
    { key: "go", title: "", kind: "go", width: "34px", tip: "Show the point in the picture" },
  ];
}

function bytesOf(view) {
  return view ? view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength) : new ArrayBuffer(0);
}

// All points of a model, or null while its traits do not fit together yet.
function readPoints(model) {
  const ids = model.get("ids") ?? [], names = model.get("names") ?? [], dim = model.get("dim"), width = 2 * dim + 3;
  const numbers = bytesOf(model.get("numbers")), flags = new Uint8Array(bytesOf(model.get("flags")));
  if (names.length !== ids.length || flags.length !== ids.length || numbers.byteLength !== 8 * width * ids.length) return null;
  const all = new Float64Array(numbers);
  return ids.map((id, k) => ({ id, name: names[k], active: Boolean(flags[k] & FLAGS.active),
    locked: Boolean(flags[k] & FLAGS.locked), suspect: Boolean(flags[k] & FLAGS.suspect),
    numbers: all.subarray(k * width, (k + 1) * width) }));
}

function dragOf(p, dim) {
  let sum = 0;
  for (let k = 0; k < dim; k += 1) sum += (p.numbers[dim + k] - p.numbers[k]) ** 2;
  return Math.sqrt(sum);
}

// What a cell is about, for its order and its text.
function cellValue(p, column, dim) {
  if (column.key === "drag") return dragOf(p, dim);
  return column.at === undefined ? p[column.key] : p.numbers[column.at];
}

// In full, as one edits it; no number is the empty text.
function editedText(value) {
  return typeof value === "number" ? (Number.isNaN(value) ? "" : String(value)) : value;
}

export function shownNumber(value) {
  if (Number.isNaN(value)) return "";
  const size = Math.abs(value);
  if (size === 0) return "0";
  return size < 0.005 || size >= 1e7 ? value.toExponential(1) : value.toFixed(2);
}

// Positions in the order of a column; what has no value comes last, either way round.
function orderedPoints(points, column, isDown, dim) {
  const places = points.map((_, k) => k);
  if (!column) return places;
  const values = points.map((p) => cellValue(p, column, dim)), sign = isDown ? -1 : 1;
  const isNothing = (v) => v === "" || Number.isNaN(v);
  return places.sort((i, j) => {
    const p = values[i], q = values[j];
    if (isNothing(p) || isNothing(q)) return isNothing(p) - isNothing(q) || i - j;
    return sign * (typeof p === "string" ? p.localeCompare(q, undefined, { numeric: true }) : p - q) || i - j;
  });
}

// The points as CSV with a line of names, which Python takes back (deformnb.io.landmarks).
function pointsAsCsv(points, dim) {
  const columns = pointColumns(dim).filter(({ key }) => !["drag", "error", "go"].includes(key));
  const quoted = (text) => (/[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const line = (p) => columns.map((c) => quoted(String(editedText(cellValue(p, c, dim)))));
  return [columns.map(({ key }) => key), ...points.map(line)].map((row) => `${row.join(",")}\n`).join("");
}

// The cells of the table of control points: the rows that are in sight, the marked cell, writing into cells, keys.
// PointsTablePage (inputs/points_table.js) is this and the talk with Python.

const ROW_HEIGHT = 26;
const SPARE_ROWS = 4; // drawn above and below those in sight

class PointsCells {
  // ---- drawing ------------------------------------------------------------------------------------------------------

  invalidate() {
    if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.draw(); });
  }

  draw() {
    const { points, order } = this, height = this.scroller.clientHeight || 200;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_HEIGHT) - SPARE_ROWS);
    const end = Math.min(order.length, first + Math.ceil(height / ROW_HEIGHT) + 2 * SPARE_ROWS);
    const held = this.isFocused(), wanted = new Map();
    for (let k = first; k < end; k += 1) wanted.set(points[order[k]].id, k);
    const at = this.rankOf(this.active.id); // the row that holds the focus stays, wherever it is
    if (held && at >= 0) wanted.set(this.active.id, at);
    for (const [id, row] of this.rows) if (!wanted.has(id)) { row.remove(); this.rows.delete(id); }
    this.body.style.height = `${order.length * ROW_HEIGHT}px`;
    this.grid.setAttribute("aria-rowcount", order.length + 1);
    [...wanted].sort((p, q) => p[1] - q[1]).forEach(([id, k], place) => {
      const row = this.rows.get(id) ?? this.#row(id);
      if (this.body.children[place] !== row) this.body.insertBefore(row, this.body.children[place] ?? null);
      this.#fill(row, points[order[k]], k);
    });
    this.#drawHead();
    this.reach();
    if (held && !this.isFocused()) this.focusCell(); // a row that was moved has lost it
    this.describe();
  }

  makeHead() {
    this.head.replaceChildren();
    this.columns.forEach((column, k) => {
      const cell = pageElement("div", `dnb-pt-cell dnb-pt-head-cell dnb-pt-${column.kind}`, this.head, { role: "columnheader",
        "aria-colindex": k + 1, "data-key": column.key, title: column.tip });
      const button = pageElement("button", "dnb-pt-sort", cell, { type: "button", tabindex: "-1", ...OWN_KEYS,
        "aria-label": `${column.title || "Go to"}: ${column.tip}. Sort` });
      pageElement("span", "", button).textContent = column.title;
      pageElement("span", "dnb-pt-way", button, { "aria-hidden": "true" });
      button.addEventListener("click", () => this.sortBy(column.key));
    });
    const widths = this.columns.map(({ width }) => width).join(" ");
    const least = this.columns.reduce((sum, { width }) => sum + Number(width.match(/(\d+)px/)[1]), 0);
    this.grid.style.setProperty("--dnb-pt-columns", widths);
    this.grid.style.setProperty("--dnb-pt-least", `${least}px`); // one width for headings and rows
    this.grid.setAttribute("aria-colcount", this.columns.length);
  }

  #drawHead() {
    for (const cell of this.head.children) {
      const isSorted = cell.dataset.key === this.sort.key, way = this.sort.isDown ? "descending" : "ascending";
      setAttributes(cell, { "aria-sort": isSorted ? way : "none" });
      setText(cell.querySelector(".dnb-pt-way"), isSorted ? (this.sort.isDown ? "\u25be" : "\u25b4") : "");
    }
  }

  #row(id) {
    const row = document.createElement("div");
    setAttributes(row, { class: "dnb-pt-row", role: "row", "data-id": id });
    this.columns.forEach((column, k) => {
      const cell = pageElement("div", `dnb-pt-cell dnb-pt-${column.kind}`, row, { role: "gridcell", "aria-colindex": k + 1,
        "data-key": column.key });
      if (column.kind === "check") {
        pageElement("input", "dnb-pt-box", cell, { type: "checkbox", tabindex: "-1", ...OWN_KEYS });
      } else if (column.kind === "go") {
        const button = pageElement("button", "dnb-pt-go", cell, { type: "button", tabindex: "-1", title: column.tip, ...OWN_KEYS });
        svgElement("path", { d: GO_ICON }, svgElement("svg", { viewBox: "0 0 16 16", "aria-hidden": "true" }, button));
      } else setAttributes(cell, { tabindex: "-1", ...OWN_KEYS });
    });
    this.rows.set(id, row);
    return row;
  }

  #fill(row, p, rank) {
    const isSelected = this.selected.has(p.id), who = p.name || `point ${p.id}`, { live } = this;
    row.style.top = `${rank * ROW_HEIGHT}px`;
    row.className = `dnb-pt-row${isSelected ? " dnb-pt-selected" : ""}${p.active ? "" : " dnb-pt-off"}`;
    setAttributes(row, { "aria-rowindex": rank + 2, "aria-selected": isSelected });
    this.columns.forEach((column, k) => {
      const cell = row.children[k], moved = live.get(p.id);
      if (column.kind === "check") {
        const box = cell.firstChild;
        if (box.checked !== p[column.key]) box.checked = p[column.key];
        setAttributes(box, { "aria-label": `${who}: ${column.key === "active" ? "on" : "locked"}` });
      } else if (column.kind === "go") setAttributes(cell.firstChild, { "aria-label": `Show ${who} in the picture` });
      else if (!cell.classList.contains("dnb-pt-writing")) this.#text(cell, column, moved ? { ...p, numbers: moved } : p);
    });
  }

  #text(cell, column, p) {
    const value = cellValue(p, column, this.dim), isNumber = typeof value === "number" && column.key !== "id";
    const isSuspect = column.key === "error" && p.suspect;
    const isFixed = p.locked && column.axis !== undefined;
    setText(cell, `${isSuspect ? "! " : ""}${isNumber ? shownNumber(value) : value}`);
    cell.classList.toggle("dnb-pt-suspect", isSuspect);
    const tip = isSuspect ? "This point disagrees with its neighbours: look whether it was put where it belongs"
      : isNumber ? editedText(value) : column.key === "name" ? value : "";
    if (cell.title !== tip) cell.title = tip;
    const isEditable = column.kind === "text" || column.kind === "number";
    setAttributes(cell, { "aria-readonly": !isEditable || isFixed });
    cell.classList.toggle("dnb-pt-fixed", isFixed);
    cell.classList.toggle("dnb-pt-idle", column.key === "weight" && !this.model.get("smoothing_on"));
    if (isSuspect) setAttributes(cell, { "aria-label": `${shownNumber(value)}, disagrees with its neighbours` });
    else cell.removeAttribute("aria-label");
  }

  // ---- the marked cell ----------------------------------------------------------------------------------------------

  rankOf(id) { return this.ranks.get(id) ?? -1; }

  cellOf(id, key) {
    const row = id === null ? this.head : this.rows.get(id);
    const cell = row?.querySelector(`[data-key="${key}"]`);
    return cell?.querySelector("input.dnb-pt-box, button") ?? cell ?? null;
  }

  isFocused() { return this.grid.contains(this.root.getRootNode().activeElement); }

  focusCell() { this.cellOf(this.active.id, this.active.key)?.focus({ preventScroll: true }); }

  // Tab reaches one cell only; arrows go to the others.
  reach() {
    if (this.active.id !== null && this.rankOf(this.active.id) < 0) {
      this.active.id = this.order.length ? this.points[this.order[Math.min(this.lastRank, this.order.length - 1)]].id : null;
    }
    this.lastRank = Math.max(0, this.rankOf(this.active.id));
    const reached = this.cellOf(this.active.id, this.active.key) ?? this.cellOf(null, this.active.key);
    if (this.reached && this.reached !== reached) this.reached.tabIndex = -1;
    this.reached = reached;
    if (reached) reached.tabIndex = 0;
  }

  // rank -1 is the line of headings.
  mark(rank, key, isFocused = true) {
    const to = Math.max(-1, Math.min(rank, this.order.length - 1));
    this.active = { id: to < 0 ? null : this.points[this.order[to]].id, key };
    if (to >= 0) this.show(to);
    this.draw();
    if (isFocused) this.focusCell();
  }

  // By its own scroll bar: scrollIntoView would move the whole page.
  show(rank) {
    const box = this.scroller, top = rank * ROW_HEIGHT, seen = box.clientHeight - this.head.offsetHeight;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + ROW_HEIGHT > box.scrollTop + seen) box.scrollTop = top + ROW_HEIGHT - seen;
  }

  // ---- writing ------------------------------------------------------------------------------------------------------

  write(id, key, first = null) {
    const column = this.columns.find((c) => c.key === key), p = this.points[this.order[this.rankOf(id)]];
    if (!p || !["text", "number"].includes(column?.kind) || this.isReadOnly) return;
    if (p.locked && column.axis !== undefined) {
      this.say(`${p.name || `Point ${p.id}`} is locked. Unlock it to move it.`);
      return;
    }
    this.mark(this.rankOf(id), key, false);
    const cell = this.cellOf(id, key), before = String(editedText(cellValue(p, column, this.dim)));
    const input = pageElement("input", "dnb-pt-input", null, { type: "text", spellcheck: "false", autocomplete: "off",
      maxlength: column.kind === "text" ? 80 : 40, "aria-label": `${column.tip.split(":")[0]} of ${p.name || `point ${p.id}`}`,
      ...(column.key === "radius" ? { placeholder: "as all" } : {}), ...OWN_KEYS });
    input.value = first ?? before;
    cell.classList.add("dnb-pt-writing");
    cell.replaceChildren(input);
    const end = (isTaken) => {
      if (!cell.classList.contains("dnb-pt-writing")) return;
      cell.classList.remove("dnb-pt-writing");
      cell.replaceChildren();
      const text = input.value.trim();
      this.draw();
      if (isTaken && text !== before) this.act("cell", [id], { field: column.field ?? key, axis: column.axis ?? 0, value: text }, key);
    };
    input.addEventListener("keydown", (event) => this.#writingKey(event, end, id, key));
    input.addEventListener("blur", () => end(true));
    input.focus();
    if (first === null) input.select();
  }

  #writingKey(event, end, id, key) {
    event.stopPropagation();
    if (event.isComposing || !["Enter", "Escape", "Tab"].includes(event.key)) return;
    event.preventDefault();
    const rank = this.rankOf(id), editable = this.columns.filter((c) => c.kind === "text" || c.kind === "number");
    const next = editable.findIndex((c) => c.key === key) + (event.shiftKey ? -1 : 1);
    end(event.key !== "Escape");
    if (event.key === "Enter" && !event.shiftKey && rank + 1 < this.order.length) this.mark(rank + 1, key);
    else this.mark(rank, event.key === "Tab" ? (editable[next]?.key ?? key) : key);
  }

  // A cell whose text was refused shows the old value again, and that it was refused.
  refuse(id, key) {
    const cell = this.rows.get(id)?.querySelector(`[data-key="${key}"]`);
    cell?.classList.add("dnb-pt-refused");
    setTimeout(() => cell?.classList.remove("dnb-pt-refused"), 1600);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  key(event) {
    if (event.altKey || event.target.closest(".dnb-pt-input") || !this.grid.contains(event.target)) return;
    const rank = this.active.id === null ? -1 : this.rankOf(this.active.id), command = event.ctrlKey || event.metaKey;
    if (!(command ? this.#commandKey(event, rank) : this.#plainKey(event, rank))) return;
    event.preventDefault();
    event.stopPropagation();
  }

  #commandKey({ key, shiftKey }, rank) {
    const last = this.order.length - 1, done = { Home: () => this.mark(0, this.columns[0].key),
      End: () => this.mark(last, this.columns.at(-1).key), a: () => this.select(this.points.map((p) => p.id)),
      z: () => this.act(shiftKey ? "redo" : "undo"), y: () => this.act("redo"), " ": () => this.choose(rank, true, false) };
    const found = done[key] ?? done[key.toLowerCase()];
    found?.();
    return Boolean(found);
  }

  #plainKey(event, rank) {
    const { key, shiftKey } = event, { active, columns } = this, at = columns.findIndex((c) => c.key === active.key);
    const page = Math.max(1, Math.floor(this.scroller.clientHeight / ROW_HEIGHT) - 2), { kind } = columns[at];
    const up = { ArrowUp: -1, ArrowDown: 1, PageUp: -page, PageDown: page }[key], side = { ArrowLeft: -1, ArrowRight: 1 }[key];
    const isBox = kind === "check" || kind === "go" || rank < 0;
    if (up) {
      const to = key.startsWith("Page") ? Math.max(0, rank + up) : rank + up;
      this.mark(to, active.key);
      if (shiftKey && to >= 0) this.choose(this.rankOf(this.active.id), false, true);
    } else if (side) this.mark(rank, columns[Math.max(0, Math.min(at + side, columns.length - 1))].key);
    else if (key === "Home" || key === "End") this.mark(rank, columns.at(key === "Home" ? 0 : -1).key);
    else if (isBox && (key === " " || (key === "Enter" && kind !== "check"))) return false; // the button's own
    else if ((key === "Enter" || key === "F2") && !isBox) this.write(active.id, active.key);
    else if (key === " ") this.choose(rank, true, false);
    else if (key === "Delete") this.act("remove", this.chosenIds());
    else if (key === "Escape" && this.selected.size) this.select([]);
    else if (key.length === 1 && (kind === "text" || (kind === "number" && /[-+.,\dne]/i.test(key)))) this.write(active.id, active.key, key);
    else return false;
    return true;
  }
}

// The table of control points. Joined behind the files that deformnb/widgets/inputs/points_table.py names.
//
// Only the rows in sight are in the page. Python sends the points (ids, names, flags, numbers); the page tells what shall
// be done: {type: "act", view, seq, what, ids, field, axis, value}, and is answered {type: "done", view, seq, ok}.
// While the editor drags points, their rows follow it without Python (sync/bus.js).

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
