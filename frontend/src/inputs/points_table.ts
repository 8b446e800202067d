// The table of control points.
//
// Only the rows in sight are elements. Python sends the points (ids, names, flags, numbers); the front end requests
// edits: {type: "act", view, seq, what, ids, field, axis, value}, and is answered {type: "done", view, seq, ok}.
// While the editor drags points, their rows follow it without Python (sync/bus.js).

import type { PointsCommand, PointsTableToFrontEnd } from "../generated.ts";
import { busOf } from "../sync/bus.ts";
import type { Bus, Model, PointsDetail } from "../types.ts";
import {
  buttonElement,
  iconElement,
  OWN_KEYS,
  pageElement,
  setAttributes,
  setText,
  targetOf,
  treeOf,
} from "../ui/dom.ts";
import { ThemeObserver } from "../ui/theme.ts";
import { Widget, widgetOf } from "../ui/widget.ts";
import type { Column, TableRow } from "./point_rows.ts";
import {
  axisNames,
  cellValue,
  editText,
  fittingColumns,
  formatNumber,
  leastWidth,
  pointColumns,
  pointsAsCsv,
  readPoints,
  sortPoints,
} from "./point_rows.ts";

const ROW_HEIGHT = 26;
const SPARE_ROWS = 4; // drawn above and below those in sight
const NUMERIC = /[-+.,\dne]/i; // characters with which a number is written
const GO_ICON = "M8 1.5v3M8 11.5v3M1.5 8h3M11.5 8h3M8 5.2a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.6";

/** Name, text, tip, whether it needs chosen points */
const TABLE_BUTTONS: [string, string, string, boolean][] = [
  ["reset", "Put back", "Put the selected points back where they were taken", true],
  ["switch", "On/off", "Switch the selected points on or off", true],
  ["lock", "Lock", "Lock the selected points where they are, or unlock them", true],
  ["remove", "Delete", "Delete the selected points (Del)", true],
  ["copy", "Copy", "Copy the selected points, or all, as CSV text (Ctrl+C)", false],
  [
    "paste",
    "Paste",
    "Take points from CSV text (Ctrl+V): rows with a known id change that point, others are added",
    false,
  ],
];

class PointsTableView extends Widget {
  selected: Set<number>;
  bar: HTMLDivElement;
  place: HTMLInputElement;
  addButton: HTMLButtonElement;
  buttons: Map<string, HTMLButtonElement>;
  pasting: HTMLDivElement;
  text: HTMLTextAreaElement;
  take: HTMLButtonElement;
  drop: HTMLButtonElement;
  grid: HTMLDivElement;
  scroller: HTMLDivElement;
  head: HTMLDivElement;
  body: HTMLDivElement;
  status: HTMLDivElement;
  facts: HTMLSpanElement;
  liveRegion: HTMLSpanElement;
  sized: ResizeObserver;
  visibility: IntersectionObserver;
  theme: ThemeObserver;
  moved: (event: CustomEvent<PointsDetail>) => void;

  view = Math.random().toString(36).slice(2, 12); // a name for this view
  seq = 0;
  reading = 0; // a timer
  /** Requests without an answer, by seq */
  waiting: Map<number, { what: string; ids: number[]; key: string }> = new Map();
  dim = 0;
  columns: Column[] = [];
  points: TableRow[] = [];
  /** Indices of the points, as sorted */
  order: number[] = [];
  /** Places in the order, by id */
  ranks: Map<number, number> = new Map();
  /** Numbers of points that are being dragged, by id */
  live: Map<number, Float64Array> = new Map();
  /** Elements of the rows in sight, by id */
  rows: Map<number, HTMLElement> = new Map();
  sort: { key: string | null; isDown: boolean } = { key: null, isDown: false };
  /** The marked cell; no id for the headings */
  active: { id: number | null; key: string } = { id: null, key: "name" };
  /** The one cell that Tab reaches */
  reached: HTMLElement | null = null;
  lastRank = 0;
  /** Where a range of selected rows begins */
  anchor: number | null = null;
  bus: Bus | null = null;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-points-table", { role: "group", "aria-label": "Control points" });
    this.selected = new Set(model.get("selected"));
    this.bar = pageElement("div", "dnb-pt-bar", this.root);
    this.place = pageElement("input", "dnb-pt-place", this.bar, {
      type: "text",
      spellcheck: "false",
      autocomplete: "off",
      "aria-label": "Coordinates of a new point",
      ...OWN_KEYS,
    });
    this.addButton = this.#button(
      "add",
      "Add",
      "Add a point at these coordinates of the picture; nothing moves until it is dragged",
    );
    this.buttons = new Map(TABLE_BUTTONS.map(([name, words, tip]) => [name, this.#button(name, words, tip)]));
    this.pasting = pageElement("div", "dnb-pt-pasting", this.root, { hidden: "" });
    this.text = pageElement("textarea", "dnb-pt-rows", this.pasting, {
      rows: "4",
      spellcheck: "false",
      "aria-label": "Rows of points as CSV text",
      placeholder: "Paste rows here",
      ...OWN_KEYS,
    });
    this.take = this.#button("take", "Take these points", "Add or change the points of this text", this.pasting);
    this.drop = this.#button("drop", "Cancel", "Take nothing (Esc)", this.pasting);
    this.grid = pageElement("div", "dnb-pt-grid", this.root, { role: "grid", "aria-multiselectable": "true" });
    this.scroller = pageElement("div", "dnb-pt-scroller", this.grid, { role: "presentation" });
    const first = pageElement("div", "dnb-pt-head", this.scroller, { role: "rowgroup" });
    this.head = pageElement("div", "dnb-pt-row", first, { role: "row", "aria-rowindex": 1 });
    this.body = pageElement("div", "dnb-pt-body", this.scroller, { role: "rowgroup" });
    this.status = pageElement("div", "dnb-pt-status", this.root);
    this.facts = pageElement("span", "dnb-pt-facts", this.status);
    this.liveRegion = pageElement("span", "dnb-pt-said", this.status, { role: "status" });
    this.on("msg:custom", (content) => this.#answered(content));
    this.onChange(["uid"], () => this.follow());
    this.onChange(["smoothing_on", "read_only"], () => this.invalidate());
    this.onChange(["selected"], () => this.takeSelection(this.model.get("selected")));
    this.onChange(["ids", "names", "flags", "numbers", "dim"], () => this.#readSoon());
    this.listen(this.scroller, "scroll", () => this.invalidate());
    this.listen(this.grid, "keydown", (event) => this.key(event));
    this.listen(this.grid, "click", (event) => this.#click(event));
    this.listen(this.grid, "dblclick", (event) => this.#doubleClick(event));
    this.listen(this.grid, "change", (event) => this.#changed(event));
    this.listen(this.grid, "focusin", (event) => this.#focused(event));
    this.listen(this.grid, "copy", (event) => {
      if (!targetOf(event).closest("input")) this.#copyInto(event);
    });
    this.listen(this.grid, "paste", (event) => this.#pasted(event));
    this.listen(this.place, "keydown", (event) => {
      if (event.key === "Enter") this.run("add");
      event.stopPropagation();
    });
    this.listen(this.text, "keydown", (event) => {
      if (event.key === "Escape") this.run("drop");
      event.stopPropagation();
    });
    this.sized = new ResizeObserver(() => {
      if (this.dim) this.#chooseColumns();
      this.invalidate();
    });
    this.sized.observe(this.scroller);
    // Python sends thousands of points to visible tables only.
    this.visibility = new IntersectionObserver((entries) => {
      this.act("seen", [], { value: Boolean(entries.at(-1)?.isIntersecting) });
    });
    this.visibility.observe(this.root);
    this.theme = new ThemeObserver(this.root, () => this.#repaint());
    this.moved = (event: CustomEvent<PointsDetail>) => this.#showDrag(event.detail);
    this.#repaint();
    this.follow();
    this.read();
  }

  #button(name: string, text: string, tip: string, parent: HTMLElement = this.bar) {
    const run = () => {
      if (made.getAttribute("aria-disabled") !== "true") this.run(name);
    };
    const made = buttonElement("dnb-pt-button", parent, text, run, { title: tip, "data-act": name });
    return made;
  }

  close() {
    this.sized.disconnect();
    this.visibility.disconnect();
    this.theme.close();
    this.#leave();
    clearTimeout(this.reading);
    this.act("seen", [], { value: false });
    super.close();
  }

  get isReadOnly() {
    return Boolean(this.model.get("read_only"));
  }

  #repaint() {
    this.root.classList.toggle("dnb-dark", this.theme.isDark);
  }

  // ---- the points ---------------------------------------------------------------------------------------------------

  /** Read the traits together that one message sets. */
  #readSoon() {
    clearTimeout(this.reading);
    this.reading = setTimeout(() => this.read());
  }

  read() {
    const points = readPoints(this.model),
      dim = this.model.get("dim");
    if (!points) return;
    if (dim !== this.dim) {
      this.dim = dim;
      this.place.placeholder = axisNames(dim).join(", ");
      this.#chooseColumns();
    }
    this.points = points;
    this.live.clear();
    if (this.active.id === null && points[0] && !this.isFocused()) this.active.id = points[0].id;
    this.arrange();
  }

  /** Show the columns that have room; more where the table gets wider. */
  #chooseColumns() {
    const { clientWidth } = this.scroller,
      all = pointColumns(this.dim),
      before = this.columns;
    if (this.root.querySelector(".dnb-pt-writing")) return; // text being typed must not be lost
    const columns = clientWidth ? fittingColumns(all, clientWidth) : all;
    if (
      columns.length === before.length &&
      columns.every(({ key, tip }, k) => key === before[k]?.key && tip === before[k].tip)
    )
      return;
    this.columns = columns;
    for (const row of this.rows.values()) row.remove();
    this.rows.clear();
    if (!columns.some(({ key }) => key === this.active.key)) this.active.key = "name";
    if (!columns.some(({ key }) => key === this.sort.key)) this.sort.key = null;
    this.#makeHead();
  }

  /** Sort the points. */
  arrange() {
    const { key, isDown } = this.sort;
    this.order = sortPoints(
      this.points,
      this.columns.find((column) => column.key === key),
      isDown,
      this.dim,
    );
    this.ranks = new Map(this.order.map((k, rank) => [this.points[k]!.id, rank]));
    this.draw();
  }

  /** Sort by a column: upwards, then downwards, then as the points were made. */
  sortBy(key: string) {
    if (this.sort.key !== key) this.sort = { key, isDown: false };
    else if (!this.sort.isDown) this.sort.isDown = true;
    else this.sort = { key: null, isDown: false };
    this.active = { id: null, key };
    this.arrange();
    this.focusCell();
  }

  /** Follow the editor of this uid. */
  follow() {
    this.#leave();
    if (!this.model.get("uid")) return;
    this.bus = busOf(this.model);
    this.bus.addEventListener("deformnb:points", this.moved);
  }

  /** Show the points of a drag, until Python sends them. */
  #showDrag({ points }: PointsDetail) {
    this.live = new Map();
    for (const { id, source, target } of points) {
      const p = this.pointAt(this.rankOf(id));
      if (!p || source.length !== this.dim) continue;
      this.live.set(id, Float64Array.of(...source, ...target, ...p.numbers.slice(2 * this.dim)));
    }
    this.invalidate();
  }

  #leave() {
    this.bus?.removeEventListener("deformnb:points", this.moved);
    this.bus = null;
  }

  // ---- selection ----------------------------------------------------------------------------------------------------

  /** The selected points, else that of the marked cell. */
  chosenIds() {
    return this.selected.size ? [...this.selected] : this.active.id === null ? [] : [this.active.id];
  }

  select(ids: number[]) {
    this.selected = new Set(ids);
    this.model.set("selected", [...this.selected]);
    this.model.save_changes();
    this.invalidate();
  }

  /** Take a selection from Python, as after a click in the picture. */
  takeSelection(ids: number[]) {
    if (ids.length === this.selected.size && ids.every((id) => this.selected.has(id))) return;
    this.selected = new Set(ids);
    const id = ids[0] ?? null,
      rank = this.rankOf(id);
    if (rank >= 0 && !this.isFocused()) {
      this.active.id = id;
      this.show(rank);
    }
    this.invalidate();
  }

  choose(rank: number, isToggled: boolean, isRange: boolean) {
    const id = this.pointAt(rank)?.id,
      from = this.rankOf(this.anchor);
    if (id === undefined) return;
    if (isRange && from >= 0) {
      const [low, high] = [Math.min(from, rank), Math.max(from, rank)];
      this.select(this.order.slice(low, high + 1).map((k) => this.points[k]!.id));
      return;
    }
    this.anchor = id;
    const { selected } = this;
    if (!isToggled) this.select([id]);
    else this.select(selected.has(id) ? [...selected].filter((other) => other !== id) : [...selected, id]);
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    const { order } = this,
      height = this.scroller.clientHeight || 200;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_HEIGHT) - SPARE_ROWS);
    const end = Math.min(order.length, first + Math.ceil(height / ROW_HEIGHT) + 2 * SPARE_ROWS);
    const held = this.isFocused();
    /** Places of the rows to draw, by id */
    const wanted: Map<number, number> = new Map();
    for (let k = first; k < end; k += 1) wanted.set(this.pointAt(k)!.id, k);
    const { id: active } = this.active; // the row with the focus is always drawn
    if (held && active !== null && this.rankOf(active) >= 0) wanted.set(active, this.rankOf(active));
    for (const [id, row] of this.rows)
      if (!wanted.has(id)) {
        row.remove();
        this.rows.delete(id);
      }
    this.body.style.height = `${order.length * ROW_HEIGHT}px`;
    this.grid.setAttribute("aria-rowcount", String(order.length + 1));
    [...wanted]
      .sort((p, q) => p[1] - q[1])
      .forEach(([id, k], place) => {
        const row = this.rows.get(id) ?? this.#row(id);
        if (this.body.children[place] !== row) this.body.insertBefore(row, this.body.children[place] ?? null);
        this.#fill(row, this.pointAt(k)!, k);
      });
    this.#drawHead();
    this.reach();
    if (held && !this.isFocused()) this.focusCell(); // a row that was moved has lost it
    this.describe();
  }

  #makeHead() {
    this.head.replaceChildren();
    this.columns.forEach((column, k) => {
      const cell = pageElement("div", `dnb-pt-cell dnb-pt-head-cell dnb-pt-${column.kind}`, this.head, {
        role: "columnheader",
        "aria-colindex": k + 1,
        "data-key": column.key,
        title: column.tip,
      });
      const title = pageElement("span", "", null, {}, column.title);
      const button = buttonElement("dnb-pt-sort", cell, title, () => this.sortBy(column.key), {
        tabindex: "-1",
        "aria-label": `${column.title || "Go to"}: ${column.tip}. Sort`,
      });
      pageElement("span", "dnb-pt-way", button, { "aria-hidden": "true" });
    });
    const widths = this.columns.map(({ width }) => width).join(" ");
    const least = this.columns.reduce((sum, column) => sum + leastWidth(column), 0);
    this.grid.style.setProperty("--dnb-pt-columns", widths);
    this.grid.style.setProperty("--dnb-pt-least", `${least}px`); // one width for headings and rows
    this.grid.setAttribute("aria-colcount", String(this.columns.length));
  }

  #drawHead() {
    const { key, isDown } = this.sort;
    this.columns.forEach((column, k) => {
      const cell = this.head.children[k]!,
        isSorted = column.key === key,
        way = cell.querySelector(".dnb-pt-way");
      setAttributes(cell, { "aria-sort": isSorted ? (isDown ? "descending" : "ascending") : "none" });
      if (way) setText(way, isSorted ? (isDown ? "\u25be" : "\u25b4") : "");
    });
  }

  #row(id: number) {
    const row = document.createElement("div");
    setAttributes(row, { class: "dnb-pt-row", role: "row", "data-id": id });
    this.columns.forEach((column, k) => {
      const cell = pageElement("div", `dnb-pt-cell dnb-pt-${column.kind}`, row, {
        role: "gridcell",
        "aria-colindex": k + 1,
        "data-key": column.key,
      });
      if (column.kind === "check") {
        pageElement("input", "dnb-pt-box", cell, { type: "checkbox", tabindex: "-1", ...OWN_KEYS });
      } else if (column.kind === "go") {
        const attributes = { type: "button", tabindex: "-1", title: column.tip, ...OWN_KEYS };
        pageElement("button", "dnb-pt-go", cell, attributes, iconElement(GO_ICON));
      } else setAttributes(cell, { tabindex: "-1", ...OWN_KEYS });
    });
    this.rows.set(id, row);
    return row;
  }

  #fill(row: HTMLElement, p: TableRow, rank: number) {
    const isSelected = this.selected.has(p.id),
      who = p.name || `point ${p.id}`,
      { live } = this;
    row.style.top = `${rank * ROW_HEIGHT}px`;
    row.className = `dnb-pt-row${isSelected ? " dnb-pt-selected" : ""}${p.active ? "" : " dnb-pt-off"}`;
    setAttributes(row, { "aria-rowindex": rank + 2, "aria-selected": isSelected });
    this.columns.forEach((column, k) => {
      const cell = row.children[k] as HTMLElement,
        moved = live.get(p.id);
      if (column.kind === "check") {
        const box = cell.firstChild as HTMLInputElement,
          isSet = cellValue(p, column, this.dim) === true;
        if (box.checked !== isSet) box.checked = isSet;
        setAttributes(box, { "aria-label": `${who}: ${column.key === "active" ? "on" : "locked"}` });
      } else if (column.kind === "go") setAttributes(cell.children[0]!, { "aria-label": `Show ${who} in the picture` });
      else if (!cell.classList.contains("dnb-pt-writing")) {
        this.#text(cell, column, moved ? { ...p, numbers: moved } : p);
      }
    });
  }

  #text(cell: HTMLElement, column: Column, p: TableRow) {
    const value = cellValue(p, column, this.dim),
      isNumber = typeof value === "number" && column.key !== "id";
    const isSuspect = column.key === "error" && p.suspect;
    const isFixed = p.locked && column.axis !== undefined;
    const text = isNumber ? formatNumber(value) : String(value);
    setText(cell, `${isSuspect ? "! " : ""}${text}`);
    cell.classList.toggle("dnb-pt-suspect", isSuspect);
    const tip = isSuspect
      ? "This point disagrees with its neighbours: look whether it was put where it belongs"
      : isNumber || column.key === "name"
        ? editText(value)
        : "";
    if (cell.title !== tip) cell.title = tip;
    const isEditable = column.kind === "text" || column.kind === "number";
    setAttributes(cell, { "aria-readonly": !isEditable || isFixed });
    cell.classList.toggle("dnb-pt-fixed", isFixed);
    cell.classList.toggle("dnb-pt-idle", column.key === "weight" && !this.model.get("smoothing_on"));
    if (isSuspect) setAttributes(cell, { "aria-label": `${text}, disagrees with its neighbours` });
    else cell.removeAttribute("aria-label");
  }

  // ---- the marked cell ----------------------------------------------------------------------------------------------

  /** The place of a point in the order, or -1. */
  rankOf(id: number | null) {
    return id === null ? -1 : (this.ranks.get(id) ?? -1);
  }

  /** The point at a place in the order. */
  pointAt(rank: number): TableRow | undefined {
    const k = this.order[rank];
    return k === undefined ? undefined : this.points[k];
  }

  /** The element of a cell that can have the focus; no id for the headings. */
  cellOf(id: number | null, key: string): HTMLElement | null {
    const row = id === null ? this.head : this.rows.get(id);
    const cell: HTMLElement | null | undefined = row?.querySelector(`[data-key="${key}"]`);
    return cell?.querySelector("input.dnb-pt-box, button") ?? cell ?? null;
  }

  isFocused() {
    return this.grid.contains(treeOf(this.root).activeElement);
  }

  focusCell() {
    this.cellOf(this.active.id, this.active.key)?.focus({ preventScroll: true });
  }

  /** Make one cell reachable by Tab; arrows focus the others. */
  reach() {
    if (this.active.id !== null && this.rankOf(this.active.id) < 0) {
      const near = this.pointAt(Math.min(this.lastRank, this.order.length - 1));
      this.active.id = near ? near.id : null;
    }
    this.lastRank = Math.max(0, this.rankOf(this.active.id));
    const reached = this.cellOf(this.active.id, this.active.key) ?? this.cellOf(null, this.active.key);
    if (this.reached && this.reached !== reached) this.reached.tabIndex = -1;
    this.reached = reached;
    if (reached) reached.tabIndex = 0;
  }

  /** @param rank 1 for the headings */
  mark(rank: number, key: string, isFocused: boolean = true) {
    const to = Math.max(-1, Math.min(rank, this.order.length - 1));
    this.active = { id: this.pointAt(to)?.id ?? null, key };
    if (to >= 0) this.show(to);
    this.draw();
    if (isFocused) this.focusCell();
  }

  /** Scroll to a row by the table's own scroll bar: scrollIntoView would move the whole page. */
  show(rank: number) {
    const box = this.scroller,
      top = rank * ROW_HEIGHT,
      seen = box.clientHeight - this.head.offsetHeight;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + ROW_HEIGHT > box.scrollTop + seen) box.scrollTop = top + ROW_HEIGHT - seen;
  }

  // ---- writing ------------------------------------------------------------------------------------------------------

  /**
   * Edit a cell.
   * @param first the text instead of the old value
   */
  write(id: number, key: string, first: string | null = null) {
    const column = this.columns.find((c) => c.key === key),
      p = this.pointAt(this.rankOf(id));
    if (!p || !column || !["text", "number"].includes(column.kind) || this.isReadOnly) return;
    if (p.locked && column.axis !== undefined) {
      this.showMessage(`${p.name || `Point ${p.id}`} is locked. Unlock it to move it.`);
      return;
    }
    this.mark(this.rankOf(id), key, false);
    const cell = this.cellOf(id, key),
      before = editText(cellValue(p, column, this.dim));
    if (!cell) return;
    const input = pageElement("input", "dnb-pt-input", null, {
      type: "text",
      spellcheck: "false",
      autocomplete: "off",
      maxlength: column.kind === "text" ? 80 : 40,
      "aria-label": `${column.tip.split(":")[0]} of ${p.name || `point ${p.id}`}`,
      ...(column.key === "radius" ? { placeholder: "as all" } : {}),
      ...OWN_KEYS,
    });
    input.value = first ?? before;
    cell.classList.add("dnb-pt-writing");
    cell.replaceChildren(input);
    const end = (isTaken: boolean) => {
      if (!cell.classList.contains("dnb-pt-writing")) return;
      cell.classList.remove("dnb-pt-writing");
      cell.replaceChildren();
      const text = input.value.trim();
      this.draw();
      if (!isTaken || text === before) return;
      this.act(
        "cell",
        [id],
        { field: column.field ?? (key as PointsCommand["field"]), axis: column.axis ?? 0, value: text },
        key,
      );
    };
    input.addEventListener("keydown", (event) => this.#writingKey(event, end, id, key));
    input.addEventListener("blur", () => end(true));
    input.focus();
    if (first === null) input.select();
  }

  #writingKey(event: KeyboardEvent, end: (isTaken: boolean) => void, id: number, key: string) {
    event.stopPropagation();
    if (event.isComposing || !["Enter", "Escape", "Tab"].includes(event.key)) return;
    event.preventDefault();
    const rank = this.rankOf(id),
      editable = this.columns.filter((c) => c.kind === "text" || c.kind === "number");
    const next = editable.findIndex((c) => c.key === key) + (event.shiftKey ? -1 : 1);
    end(event.key !== "Escape");
    if (event.key === "Enter" && !event.shiftKey && rank + 1 < this.order.length) this.mark(rank + 1, key);
    else this.mark(rank, event.key === "Tab" ? (editable[next]?.key ?? key) : key);
  }

  /** Show the old value of a cell again, whose text was refused, and that it was refused. */
  refuse(id: number, key: string) {
    const cell = this.rows.get(id)?.querySelector(`[data-key="${key}"]`);
    cell?.classList.add("dnb-pt-refused");
    setTimeout(() => cell?.classList.remove("dnb-pt-refused"), 1600);
  }

  // ---- keys ---------------------------------------------------------------------------------------------------------

  key(event: KeyboardEvent) {
    const target = targetOf(event),
      rank = this.rankOf(this.active.id),
      command = event.ctrlKey || event.metaKey;
    if (event.altKey || target.closest(".dnb-pt-input") || !this.grid.contains(target)) return;
    if (!(command ? this.#commandKey(event, rank) : this.#plainKey(event, rank))) return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Returns whether a key with Ctrl is one of the table. */
  #commandKey({ key, shiftKey }: KeyboardEvent, rank: number) {
    const last = this.order.length - 1;
    switch (key.length === 1 ? key.toLowerCase() : key) {
      case "Home":
        this.mark(0, this.columns[0]!.key);
        break;
      case "End":
        this.mark(last, this.columns[this.columns.length - 1]!.key);
        break;
      case "a":
        this.select(this.points.map((p) => p.id));
        break;
      case "z":
        this.act(shiftKey ? "redo" : "undo");
        break;
      case "y":
        this.act("redo");
        break;
      case " ":
        this.choose(rank, true, false);
        break;
      default:
        return false;
    }
    return true;
  }

  /** Returns whether a key is one of the table. */
  #plainKey(event: KeyboardEvent, rank: number) {
    const { key, shiftKey } = event,
      { active, columns } = this,
      at = columns.findIndex((c) => c.key === active.key);
    const rows = Math.max(1, Math.floor(this.scroller.clientHeight / ROW_HEIGHT) - 2),
      { kind } = columns[at]!;
    const ways: Record<string, number> = { ArrowUp: -1, ArrowDown: 1, PageUp: -rows, PageDown: rows };
    const up = ways[key],
      side = key === "ArrowLeft" ? -1 : key === "ArrowRight" ? 1 : 0;
    const isBox = kind === "check" || kind === "go" || rank < 0;
    if (up) {
      const to = key.startsWith("Page") ? Math.max(0, rank + up) : rank + up;
      this.mark(to, active.key);
      if (shiftKey && to >= 0) this.choose(this.rankOf(this.active.id), false, true);
    } else if (side) this.mark(rank, columns[Math.max(0, Math.min(at + side, columns.length - 1))]!.key);
    else if (key === "Home" || key === "End") this.mark(rank, columns[key === "Home" ? 0 : columns.length - 1]!.key);
    else if (isBox && (key === " " || (key === "Enter" && kind !== "check")))
      return false; // the button's own
    else if ((key === "Enter" || key === "F2") && !isBox && active.id !== null) this.write(active.id, active.key);
    else if (key === " ") this.choose(rank, true, false);
    else if (key === "Delete") this.act("remove", this.chosenIds());
    else if (key === "Escape" && this.selected.size) this.select([]);
    else if (key.length === 1 && active.id !== null && (kind === "text" || (kind === "number" && NUMERIC.test(key)))) {
      this.write(active.id, active.key, key);
    } else return false;
    return true;
  }

  // ---- the mouse ----------------------------------------------------------------------------------------------------

  #cellAt(event: Event) {
    const cell = targetOf(event).closest(".dnb-pt-cell[data-key]"),
      row = cell?.closest(".dnb-pt-row[data-id]");
    return cell && row ? { id: Number(row.getAttribute("data-id")), key: String(cell.getAttribute("data-key")) } : null;
  }

  #focused(event: FocusEvent) {
    const at = this.#cellAt(event),
      head = at ? null : targetOf(event).closest(".dnb-pt-head-cell");
    if (at) this.active = at;
    else if (head) this.active = { id: null, key: String(head.getAttribute("data-key")) };
    this.reach();
  }

  #click(event: MouseEvent) {
    const at = this.#cellAt(event),
      target = targetOf(event);
    if (!at || target.closest(".dnb-pt-input")) return;
    if (at.key === "go") {
      if (target.closest("button")) this.act("look", [at.id]);
      return;
    }
    if (target.closest(".dnb-pt-box")) return;
    this.choose(this.rankOf(at.id), event.ctrlKey || event.metaKey, event.shiftKey);
  }

  #doubleClick(event: MouseEvent) {
    const at = this.#cellAt(event);
    if (at && !targetOf(event).closest("input, button")) this.write(at.id, at.key);
  }

  #changed(event: Event) {
    const at = this.#cellAt(event),
      box = event.target;
    if (!at || !(box instanceof HTMLInputElement) || !box.classList.contains("dnb-pt-box")) return;
    this.act("cell", [at.id], { field: at.key as PointsCommand["field"], axis: 0, value: box.checked }, at.key);
    box.checked = !box.checked; // as Python holds it, until it answers
  }

  // ---- actions ------------------------------------------------------------------------------------------------------

  run(name: string) {
    if (name === "add") this.act("add", [], { value: this.place.value }, "place");
    else if (name === "copy") this.#copyNow();
    else if (name === "paste" || name === "drop") this.#openPasting(name === "paste" && Boolean(this.pasting.hidden));
    else if (name === "take") this.act("paste", [], { value: this.text.value }, "text");
    else this.act(name as PointsCommand["what"], this.chosenIds());
  }

  #openPasting(isOpen: boolean) {
    this.pasting.hidden = !isOpen;
    if (isOpen) this.text.focus();
    else this.buttons.get("paste")?.focus();
  }

  /**
   * Request an action of Python.
   * @param key the place of a refusal: a column, "place" or "text"
   */
  act(
    what: PointsCommand["what"],
    ids: number[] = [],
    { field = "", axis = 0, value = null }: Pick<PointsCommand, "field" | "axis" | "value"> = {},
    key: string = "",
  ) {
    this.seq += 1;
    if (what !== "seen") this.showMessage("");
    this.waiting.set(this.seq, { what, ids, key });
    this.model.send({
      type: "act",
      view: this.view,
      seq: this.seq,
      what,
      ids,
      field,
      axis,
      value,
    } satisfies PointsCommand);
  }

  #answered({ type, view, seq, ok, text }: PointsTableToFrontEnd) {
    const request = this.waiting.get(seq);
    if (type !== "done" || view !== this.view || !request) return;
    this.waiting.delete(seq);
    if (text) this.showMessage(text);
    if (ok && request.key === "place") this.place.value = "";
    if (ok && request.key === "text") {
      this.text.value = "";
      this.#openPasting(false);
    }
    if (!ok && request.ids[0] !== undefined) this.refuse(request.ids[0], request.key);
    if (request.key === "place") setAttributes(this.place, { "aria-invalid": !ok });
    if (request.key === "text") setAttributes(this.text, { "aria-invalid": !ok });
  }

  /** Copy by the browser's command: without https there is no other clipboard. */
  #copyNow() {
    const once = (event: ClipboardEvent) => {
      event.stopPropagation();
      this.#copyInto(event);
    };
    document.addEventListener("copy", once, { capture: true });
    const isDone = document.execCommand("copy");
    document.removeEventListener("copy", once, { capture: true });
    if (!isDone) this.showMessage("This browser does not let a page copy.");
  }

  #copyInto(event: ClipboardEvent) {
    const chosen = this.selected.size ? this.points.filter(({ id }) => this.selected.has(id)) : this.points;
    event.clipboardData?.setData("text/plain", pointsAsCsv(chosen, this.dim));
    event.preventDefault();
    this.showMessage(`${chosen.length} ${chosen.length === 1 ? "point" : "points"} copied as CSV.`);
  }

  #pasted(event: ClipboardEvent) {
    if (targetOf(event).closest("input, textarea")) return;
    event.preventDefault();
    this.act("paste", [], { value: event.clipboardData?.getData("text/plain") });
  }

  // ---- words --------------------------------------------------------------------------------------------------------

  showMessage(text: string) {
    setText(this.liveRegion, text);
  }

  describe() {
    const { points, selected } = this;
    const count = (n: number, one: string, more: string) => `${n} ${n === 1 ? one : more}`;
    const suspects = points.filter((p) => p.suspect).length,
      chosen = points.filter((p) => selected.has(p.id)).length;
    const facts = [
      count(points.length, "point", "points"),
      ...(chosen ? [`${chosen} selected`] : []),
      ...(suspects ? [count(suspects, "disagrees with its neighbours", "disagree with their neighbours")] : []),
      ...(this.model.get("smoothing_on") ? [] : ["weights matter only with smoothing, which is off"]),
    ];
    const hidden = pointColumns(this.dim).length - this.columns.length;
    if (hidden > 0) facts.push(`${count(hidden, "column", "columns")} more where the table is wider`);
    setText(this.facts, facts.join(" \u00b7 "));
    for (const [name, , , isOfChosen] of TABLE_BUTTONS) {
      const isOff = (isOfChosen && !chosen) || (this.isReadOnly && name !== "copy");
      this.buttons.get(name)?.setAttribute("aria-disabled", String(isOff));
    }
    setAttributes(this.addButton, { "aria-disabled": this.isReadOnly });
  }
}

export default widgetOf(PointsTableView);
