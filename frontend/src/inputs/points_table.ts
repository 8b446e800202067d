// The table of control points.
//
// Only the rows in sight are elements. Python sends the points (ids, names, flags, numbers); the front end requests
// edits: {type: "act", view, seq, what, ids, field, axis, value}, and is answered {type: "done", view, seq, ok}.
// While the editor drags points, their rows follow it without Python (sync/bus.js).

import type { PointsCommand } from "../generated.ts";
import { busOf } from "../sync/bus.ts";
import type { Bus, Model, PointsDetail } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, setAttributes, setText, targetOf } from "../ui/dom.ts";
import { ThemeObserver } from "../ui/theme.ts";
import { Widget, widgetOf } from "../ui/widget.ts";
import { axisNames, PointList, pointColumns, Selection } from "./point_rows.ts";
import { CellInput, TableClipboard, TableRequests } from "./table_edits.ts";
import { type CellPlace, MarkedCell, TableGrid } from "./table_grid.ts";

const NUMERIC = /[-+.,\dne]/i; // characters with which a number is written

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

/** The buttons above the table, the coordinates of a new point, and rows that are pasted as text. */
class TableBar {
  element = pageElement("div", "dnb-pt-bar");
  pasting = pageElement("div", "dnb-pt-pasting", null, { hidden: "" });
  place = pageElement("input", "dnb-pt-place", this.element, {
    type: "text",
    spellcheck: "false",
    autocomplete: "off",
    "aria-label": "Coordinates of a new point",
    ...OWN_KEYS,
  });
  text = pageElement("textarea", "dnb-pt-rows", this.pasting, {
    rows: "4",
    spellcheck: "false",
    "aria-label": "Rows of points as CSV text",
    placeholder: "Paste rows here",
    ...OWN_KEYS,
  });
  #buttons: Map<string, HTMLButtonElement>;
  #adder: HTMLButtonElement;

  /** @param chosen returns the points that a button acts on */
  constructor(
    readonly requests: TableRequests,
    readonly clipboard: TableClipboard,
    readonly chosen: () => number[],
  ) {
    this.#adder = this.#button(
      "add",
      "Add",
      "Add a point at these coordinates of the picture; nothing moves until it is dragged",
    );
    this.#buttons = new Map(TABLE_BUTTONS.map(([name, words, tip]) => [name, this.#button(name, words, tip)]));
    this.#button("take", "Take these points", "Add or change the points of this text", this.pasting);
    this.#button("drop", "Cancel", "Take nothing (Esc)", this.pasting);
  }

  #button(name: string, text: string, tip: string, parent: HTMLElement = this.element) {
    const run = () => {
      if (made.getAttribute("aria-disabled") !== "true") this.run(name);
    };
    const made = buttonElement("dnb-pt-button", parent, text, run, { title: tip, "data-act": name });
    return made;
  }

  run(name: string) {
    if (name === "add") this.#send("add", this.place);
    else if (name === "copy") this.clipboard.copy();
    else if (name === "paste" || name === "drop") this.#openPasting(name === "paste" && Boolean(this.pasting.hidden));
    else if (name === "take") this.#send("paste", this.text, () => this.#openPasting(false));
    else this.requests.send(name as PointsCommand["what"], this.chosen());
  }

  /** Send the text of a field, which is emptied once it is taken. */
  #send(what: "add" | "paste", field: HTMLInputElement | HTMLTextAreaElement, done: () => void = () => {}) {
    this.requests.send(what, [], { value: field.value }, (isDone) => {
      if (isDone) {
        field.value = "";
        done();
      }
      setAttributes(field, { "aria-invalid": !isDone });
    });
  }

  #openPasting(isOpen: boolean) {
    this.pasting.hidden = !isOpen;
    if (isOpen) this.text.focus();
    else this.#buttons.get("paste")?.focus();
  }

  enable(hasChosen: boolean) {
    const { isReadOnly } = this.requests;
    for (const [name, , , isOfChosen] of TABLE_BUTTONS) {
      const isOff = (isOfChosen && !hasChosen) || (isReadOnly && name !== "copy");
      this.#buttons.get(name)?.setAttribute("aria-disabled", String(isOff));
    }
    setAttributes(this.#adder, { "aria-disabled": isReadOnly });
  }
}

/** The parts of the table that keys and the pointer act on. */
interface TableParts {
  list: PointList;
  grid: TableGrid;
  cell: MarkedCell;
  selection: Selection;
  requests: TableRequests;
  input: CellInput;
}

class TableKeys {
  constructor(readonly table: TableParts) {}

  press(event: KeyboardEvent) {
    const target = targetOf(event),
      { cell, grid } = this.table,
      command = event.ctrlKey || event.metaKey;
    if (event.altKey || target.closest(".dnb-pt-input") || !grid.element.contains(target)) return;
    if (!(command ? this.#command(event, cell.rank) : this.#plain(event, cell.rank))) return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Returns whether a key with Ctrl is one of the table. */
  #command({ key, shiftKey }: KeyboardEvent, rank: number) {
    const { cell, grid, list, requests, selection } = this.table;
    switch (key.length === 1 ? key.toLowerCase() : key) {
      case "Home":
        cell.move(0, grid.columns[0]!.key);
        break;
      case "End":
        cell.move(list.last, grid.columns.at(-1)!.key);
        break;
      case "a":
        selection.select(list.points.map((p) => p.id));
        break;
      case "z":
        requests.send(shiftKey ? "redo" : "undo");
        break;
      case "y":
        requests.send("redo");
        break;
      case " ":
        selection.choose(rank, true, false);
        break;
      default:
        return false;
    }
    return true;
  }

  /** Returns whether a key is one of the table. */
  #plain(event: KeyboardEvent, rank: number) {
    const { key, shiftKey } = event,
      { cell, grid, input, requests, selection } = this.table,
      { columns, pageRows: rows } = grid,
      { id, key: column } = cell.at,
      at = columns.findIndex((c) => c.key === column),
      { kind } = columns[at]!;
    const ways: Record<string, number> = { ArrowUp: -1, ArrowDown: 1, PageUp: -rows, PageDown: rows };
    const up = ways[key],
      side = key === "ArrowLeft" ? -1 : key === "ArrowRight" ? 1 : 0;
    const isBox = kind === "check" || kind === "go" || rank < 0;
    if (up) {
      const to = key.startsWith("Page") ? Math.max(0, rank + up) : rank + up;
      cell.move(to, column);
      if (shiftKey && to >= 0) selection.choose(cell.rank, false, true);
    } else if (side) cell.move(rank, columns[Math.max(0, Math.min(at + side, columns.length - 1))]!.key);
    else if (key === "Home" || key === "End") cell.move(rank, columns.at(key === "Home" ? 0 : -1)!.key);
    else if (isBox && (key === " " || (key === "Enter" && kind !== "check")))
      return false; // the button's own
    else if ((key === "Enter" || key === "F2") && !isBox && id !== null) input.open(id, column);
    else if (key === " ") selection.choose(rank, true, false);
    else if (key === "Delete") requests.send("remove", selection.or(id));
    else if (key === "Escape" && selection.ids.size) selection.select([]);
    else if (key.length === 1 && id !== null && (kind === "text" || (kind === "number" && NUMERIC.test(key)))) {
      input.open(id, column, key);
    } else return false;
    return true;
  }
}

class TablePointer {
  constructor(readonly table: Omit<TableParts, "grid">) {}

  #cellAt(event: Event) {
    const cell = targetOf(event).closest(".dnb-pt-cell[data-key]"),
      row = cell?.closest(".dnb-pt-row[data-id]");
    return cell && row ? { id: Number(row.getAttribute("data-id")), key: String(cell.getAttribute("data-key")) } : null;
  }

  focus(event: FocusEvent) {
    const { cell } = this.table,
      at: CellPlace | null = this.#cellAt(event),
      head = at ? null : targetOf(event).closest(".dnb-pt-head-cell");
    if (at) cell.at = at;
    else if (head) cell.at = { id: null, key: String(head.getAttribute("data-key")) };
    cell.reach();
  }

  click(event: MouseEvent) {
    const { list, requests, selection } = this.table,
      at = this.#cellAt(event),
      target = targetOf(event);
    if (!at || target.closest(".dnb-pt-input")) return;
    if (at.key === "go") {
      if (target.closest("button")) requests.send("look", [at.id]);
      return;
    }
    if (target.closest(".dnb-pt-box")) return;
    selection.choose(list.rankOf(at.id), event.ctrlKey || event.metaKey, event.shiftKey);
  }

  doubleClick(event: MouseEvent) {
    const at = this.#cellAt(event);
    if (at && !targetOf(event).closest("input, button")) this.table.input.open(at.id, at.key);
  }

  change(event: Event) {
    const at = this.#cellAt(event),
      box = event.target;
    if (!at || !(box instanceof HTMLInputElement) || !box.classList.contains("dnb-pt-box")) return;
    this.table.input.check(at.id, at.key, box);
  }
}

class PointsTableView extends Widget {
  list = new PointList();
  selection: Selection;
  requests: TableRequests;
  grid: TableGrid;
  cell: MarkedCell;
  input: CellInput;
  clipboard: TableClipboard;
  bar: TableBar;
  facts: HTMLSpanElement;
  theme: ThemeObserver;
  #bus: Bus | null = null;
  #moved = (event: CustomEvent<PointsDetail>) => this.#showDrag(event.detail);
  #reading = 0; // a timer

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-points-table", { role: "group", "aria-label": "Control points" });
    const { list } = this;
    this.selection = new Selection(model, list, () => this.invalidate());
    this.requests = new TableRequests(model);
    this.grid = new TableGrid(list, (key) => this.sortBy(key));
    this.cell = new MarkedCell(list, this.grid, () => this.draw());
    this.input = new CellInput(list, this.grid, this.cell, this.requests);
    this.clipboard = new TableClipboard(list, this.selection, this.requests);
    this.bar = new TableBar(this.requests, this.clipboard, () => this.selection.or(this.cell.at.id));
    this.root.append(this.bar.element, this.bar.pasting, this.grid.element);
    const status = pageElement("div", "dnb-pt-status", this.root);
    this.facts = pageElement("span", "dnb-pt-facts", status);
    status.append(this.requests.liveRegion);
    this.on("msg:custom", (content) => this.requests.receive(content));
    this.onChange(["uid"], () => this.follow());
    this.onChange(["smoothing_on", "read_only"], () => this.invalidate());
    this.onChange(["selected"], () => this.takeSelection(this.model.get("selected")));
    this.onChange(["ids", "names", "flags", "numbers", "dim"], () => this.#readSoon());
    this.#listen();
    this.#observe();
    this.theme = new ThemeObserver(this.root, () => this.#repaint());
    this.#repaint();
    this.follow();
    this.read();
  }

  #listen() {
    const { bar, clipboard } = this,
      { element, scroller } = this.grid,
      keys = new TableKeys(this),
      pointer = new TablePointer(this);
    this.listen(scroller, "scroll", () => this.invalidate());
    this.listen(element, "keydown", (event) => keys.press(event));
    this.listen(element, "click", (event) => pointer.click(event));
    this.listen(element, "dblclick", (event) => pointer.doubleClick(event));
    this.listen(element, "change", (event) => pointer.change(event));
    this.listen(element, "focusin", (event) => pointer.focus(event));
    this.listen(element, "copy", (event) => {
      if (!targetOf(event).closest("input")) clipboard.copyInto(event);
    });
    this.listen(element, "paste", (event) => clipboard.paste(event));
    this.listen(bar.place, "keydown", (event) => {
      if (event.key === "Enter") bar.run("add");
      event.stopPropagation();
    });
    this.listen(bar.text, "keydown", (event) => {
      if (event.key === "Escape") bar.run("drop");
      event.stopPropagation();
    });
  }

  #observe() {
    const sizes = new ResizeObserver(() => {
      if (this.list.dim) this.#chooseColumns();
      this.invalidate();
    });
    sizes.observe(this.grid.scroller);
    // Python sends thousands of points to visible tables only.
    const visibility = new IntersectionObserver((entries) => {
      this.requests.send("seen", [], { value: Boolean(entries.at(-1)?.isIntersecting) });
    });
    visibility.observe(this.root);
    for (const observer of [sizes, visibility])
      this.closing.signal.addEventListener("abort", () => observer.disconnect());
  }

  close() {
    this.theme.close();
    this.#leave();
    clearTimeout(this.#reading);
    super.close();
    this.requests.send("seen", [], { value: false });
  }

  #repaint() {
    this.root.classList.toggle("dnb-dark", this.theme.isDark);
  }

  // ---- the points ---------------------------------------------------------------------------------------------------

  /** Read the traits together that one message sets. */
  #readSoon() {
    clearTimeout(this.#reading);
    this.#reading = setTimeout(() => this.read());
  }

  read() {
    const { cell, grid, list } = this,
      { dim } = list;
    if (!list.read(this.model)) return;
    if (list.dim !== dim) {
      this.bar.place.placeholder = axisNames(list.dim).join(", ");
      this.#chooseColumns();
    }
    if (cell.at.id === null && list.points[0] && !grid.isFocused) cell.at.id = list.points[0].id;
    this.arrange();
  }

  #chooseColumns() {
    const { cell, grid, list } = this;
    if (!grid.chooseColumns()) return;
    if (!grid.hasColumn(cell.at.key)) cell.at.key = "name";
    if (!grid.hasColumn(list.sort.key)) list.sort.key = null;
  }

  arrange() {
    this.list.arrange(this.grid.columns);
    this.draw();
  }

  sortBy(key: string) {
    this.list.sortBy(key);
    this.cell.at = { id: null, key };
    this.arrange();
    this.cell.focus();
  }

  /** Follow the editor of this uid. */
  follow() {
    this.#leave();
    if (!this.model.get("uid")) return;
    this.#bus = busOf(this.model);
    this.#bus.addEventListener("deformnb:points", this.#moved);
  }

  #showDrag({ points }: PointsDetail) {
    this.list.drag(points);
    this.invalidate();
  }

  #leave() {
    this.#bus?.removeEventListener("deformnb:points", this.#moved);
    this.#bus = null;
  }

  /** Take a selection from Python, as after a click in the picture. */
  takeSelection(ids: number[]) {
    const { cell, grid, list } = this;
    if (!this.selection.take(ids)) return;
    const id = ids[0] ?? null,
      rank = list.rankOf(id);
    if (rank >= 0 && !grid.isFocused) {
      cell.at.id = id;
      grid.show(rank);
    }
    this.invalidate();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    const { cell, grid } = this,
      isFocused = grid.isFocused,
      isSmoothed = Boolean(this.model.get("smoothing_on"));
    grid.draw(this.selection.ids, { focused: isFocused ? cell.at.id : null, isSmoothed });
    cell.reach();
    if (isFocused && !grid.isFocused) cell.focus(); // a row that was moved has lost it
    this.describe(isSmoothed);
  }

  describe(isSmoothed: boolean) {
    const { points, dim } = this.list,
      { ids } = this.selection;
    const count = (n: number, one: string, more: string) => `${n} ${n === 1 ? one : more}`;
    const suspects = points.filter((p) => p.suspect).length,
      chosen = points.filter((p) => ids.has(p.id)).length;
    const facts = [
      count(points.length, "point", "points"),
      ...(chosen ? [`${chosen} selected`] : []),
      ...(suspects ? [count(suspects, "disagrees with its neighbours", "disagree with their neighbours")] : []),
      ...(isSmoothed ? [] : ["weights matter only with smoothing, which is off"]),
    ];
    const hidden = pointColumns(dim).length - this.grid.columns.length;
    if (hidden > 0) facts.push(`${count(hidden, "column", "columns")} more where the table is wider`);
    setText(this.facts, facts.join(" \u00b7 "));
    this.bar.enable(chosen > 0);
  }
}

export default widgetOf(PointsTableView);
