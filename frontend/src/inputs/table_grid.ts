// The elements of the table of control points: headings, the rows in sight, and the marked cell.

import { nameOf } from "../maths/point_names.ts";
import { buttonElement, iconElement, OWN_KEYS, pageElement, setAttributes, setText, treeOf } from "../ui/dom.ts";
import { targetSize } from "../ui/fingers.ts";
import type { Column, PointList, TableRow } from "./point_rows.ts";
import { cellValue, editText, fittingColumns, formatNumber, leastWidth, pointColumns } from "./point_rows.ts";

const ROW_HEIGHT = targetSize(26);
const SPARE_ROWS = 4; // drawn above and below those in sight
const GO_ICON = "M8 1.5v3M8 11.5v3M1.5 8h3M11.5 8h3M8 5.2a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.6";

/** A cell; no id for the headings. */
export interface CellPlace {
  id: number | null;
  key: string;
}

export const isEditable = ({ kind }: Column) => kind === "text" || kind === "number";

/** Headings and rows. Only the rows in sight are elements. */
export class TableGrid {
  element = pageElement("div", "dnb-pt-grid", null, { role: "grid", "aria-multiselectable": "true" });
  scroller = pageElement("div", "dnb-pt-scroller", this.element, { role: "presentation" });
  columns: Column[] = [];
  #head: HTMLDivElement;
  #body: HTMLDivElement;
  /** Elements of the rows in sight, by id */
  #rows: Map<number, HTMLElement> = new Map();

  constructor(
    readonly list: PointList,
    readonly sortBy: (key: string) => void,
  ) {
    const first = pageElement("div", "dnb-pt-head", this.scroller, { role: "rowgroup" });
    this.#head = pageElement("div", "dnb-pt-row", first, { role: "row", "aria-rowindex": 1 });
    this.#body = pageElement("div", "dnb-pt-body", this.scroller, { role: "rowgroup" });
  }

  get isFocused() {
    return this.element.contains(treeOf(this.element).activeElement);
  }

  /** The number of rows of a page. */
  get pageRows() {
    return Math.max(1, Math.floor(this.scroller.clientHeight / ROW_HEIGHT) - 2);
  }

  hasColumn(key: string | null) {
    return this.columns.some((column) => column.key === key);
  }

  /** Show the columns that have room, more where the table gets wider; false if they are the same. */
  chooseColumns() {
    const { clientWidth } = this.scroller,
      all = pointColumns(this.list.dim),
      before = this.columns;
    if (this.element.querySelector(".dnb-pt-writing")) return false; // text being typed must not be lost
    const columns = clientWidth ? fittingColumns(all, clientWidth) : all;
    if (
      columns.length === before.length &&
      columns.every(({ key, tip }, k) => key === before[k]?.key && tip === before[k].tip)
    )
      return false;
    this.columns = columns;
    for (const row of this.#rows.values()) row.remove();
    this.#rows.clear();
    this.#makeHead();
    return true;
  }

  /** The element of a cell that can have the focus. */
  cellOf({ id, key }: CellPlace): HTMLElement | null {
    const row = id === null ? this.#head : this.#rows.get(id);
    const cell: HTMLElement | null | undefined = row?.querySelector(`[data-key="${key}"]`);
    return cell?.querySelector("input.dnb-pt-box, button") ?? cell ?? null;
  }

  /** Show the old value of a cell again, whose text was refused, and that it was refused. */
  refuse({ id, key }: { id: number; key: string }) {
    const cell = this.#rows.get(id)?.querySelector(`[data-key="${key}"]`);
    cell?.classList.add("dnb-pt-refused");
    setTimeout(() => cell?.classList.remove("dnb-pt-refused"), 1600);
  }

  /** Scroll to a row by the table's own scroll bar: scrollIntoView would move the whole page. */
  show(rank: number) {
    const box = this.scroller,
      top = rank * ROW_HEIGHT,
      seen = box.clientHeight - this.#head.offsetHeight;
    if (top < box.scrollTop) box.scrollTop = top;
    else if (top + ROW_HEIGHT > box.scrollTop + seen) box.scrollTop = top + ROW_HEIGHT - seen;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** @param shown the row with the focus, which is always drawn, and whether weights matter */
  draw(selected: Set<number>, shown: { focused: number | null; isSmoothed: boolean }) {
    const { list } = this,
      body = this.#body,
      height = this.scroller.clientHeight || 200;
    const first = Math.max(0, Math.floor(this.scroller.scrollTop / ROW_HEIGHT) - SPARE_ROWS);
    const end = Math.min(list.order.length, first + Math.ceil(height / ROW_HEIGHT) + 2 * SPARE_ROWS);
    /** Places of the rows to draw, by id */
    const wanted: Map<number, number> = new Map();
    for (let k = first; k < end; k += 1) wanted.set(list.at(k)!.id, k);
    const { focused } = shown;
    if (focused !== null && list.rankOf(focused) >= 0) wanted.set(focused, list.rankOf(focused));
    for (const [id, row] of this.#rows)
      if (!wanted.has(id)) {
        row.remove();
        this.#rows.delete(id);
      }
    body.style.height = `${list.order.length * ROW_HEIGHT}px`;
    this.element.setAttribute("aria-rowcount", String(list.order.length + 1));
    [...wanted]
      .sort((p, q) => p[1] - q[1])
      .forEach(([id, k], place) => {
        const row = this.#rows.get(id) ?? this.#row(id);
        if (body.children[place] !== row) body.insertBefore(row, body.children[place] ?? null);
        row.style.top = `${k * ROW_HEIGHT}px`;
        setAttributes(row, { "aria-rowindex": k + 2, "aria-selected": selected.has(id) });
        this.#fill(row, list.at(k)!, selected.has(id), shown.isSmoothed);
      });
    this.#drawHead();
  }

  #makeHead() {
    this.#head.replaceChildren();
    this.columns.forEach((column, k) => {
      const cell = pageElement("div", `dnb-pt-cell dnb-pt-head-cell dnb-pt-${column.kind}`, this.#head, {
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
    this.element.style.setProperty("--dnb-pt-columns", widths);
    this.element.style.setProperty("--dnb-pt-least", `${least}px`); // one width for headings and rows
    this.element.setAttribute("aria-colcount", String(this.columns.length));
  }

  #drawHead() {
    const { key, isDown } = this.list.sort;
    this.columns.forEach((column, k) => {
      const cell = this.#head.children[k]!,
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
    this.#rows.set(id, row);
    return row;
  }

  #fill(row: HTMLElement, p: TableRow, isSelected: boolean, isSmoothed: boolean) {
    const who = nameOf(p, this.list.numberOf(p.id)),
      moved = this.list.moved(p);
    row.className = `dnb-pt-row${isSelected ? " dnb-pt-selected" : ""}${p.active ? "" : " dnb-pt-off"}`;
    this.columns.forEach((column, k) => {
      const cell = row.children[k] as HTMLElement;
      if (column.kind === "check") {
        const box = cell.firstChild as HTMLInputElement,
          isSet = cellValue(p, column, this.list.dim) === true;
        if (box.checked !== isSet) box.checked = isSet;
        setAttributes(box, { "aria-label": `${who}: ${column.key === "active" ? "on" : "locked"}` });
      } else if (column.kind === "go") setAttributes(cell.children[0]!, { "aria-label": `Show ${who} in the picture` });
      else if (!cell.classList.contains("dnb-pt-writing")) {
        this.#text(cell, column, moved);
        cell.classList.toggle("dnb-pt-idle", column.key === "weight" && !isSmoothed);
      }
    });
  }

  #text(cell: HTMLElement, column: Column, p: TableRow) {
    const value = cellValue(p, column, this.list.dim),
      isNumber = typeof value === "number" && column.key !== "id";
    const isSuspect = column.key === "error" && p.suspect;
    const isFixed = p.locked && column.axis !== undefined;
    const isUnnamed = column.key === "name" && !p.name;
    const text = isNumber ? formatNumber(value) : isUnnamed ? nameOf(p, this.list.numberOf(p.id)) : String(value);
    setText(cell, `${isSuspect ? "! " : ""}${text}`);
    cell.classList.toggle("dnb-pt-suspect", isSuspect);
    cell.classList.toggle("dnb-pt-unnamed", isUnnamed);
    const tip = isSuspect
      ? "This point disagrees with its neighbours: check its place"
      : isNumber || column.key === "name"
        ? editText(value)
        : "";
    if (cell.title !== tip) cell.title = tip;
    setAttributes(cell, { "aria-readonly": !isEditable(column) || isFixed });
    cell.classList.toggle("dnb-pt-fixed", isFixed);
    if (isSuspect) setAttributes(cell, { "aria-label": `${text}, disagrees with its neighbours` });
    else cell.removeAttribute("aria-label");
  }
}

/** The marked cell: keys act on it, and Tab reaches it alone. */
export class MarkedCell {
  at: CellPlace = { id: null, key: "name" };
  #reached: HTMLElement | null = null;
  #lastRank = 0;

  /** @param draw draws the table */
  constructor(
    readonly list: PointList,
    readonly grid: TableGrid,
    readonly draw: () => void,
  ) {}

  /** The place of its point in the order; -1 in the headings. */
  get rank() {
    return this.list.rankOf(this.at.id);
  }

  focus() {
    this.grid.cellOf(this.at)?.focus({ preventScroll: true });
  }

  /** Make it reachable by Tab; arrows focus the others. */
  reach() {
    const { at, grid, list } = this;
    if (at.id !== null && this.rank < 0) at.id = list.at(Math.min(this.#lastRank, list.last))?.id ?? null;
    this.#lastRank = Math.max(0, this.rank);
    const reached = grid.cellOf(at) ?? grid.cellOf({ id: null, key: at.key });
    if (this.#reached && this.#reached !== reached) this.#reached.tabIndex = -1;
    this.#reached = reached;
    if (reached) reached.tabIndex = 0;
  }

  /** @param rank -1 for the headings */
  move(rank: number, key: string, isFocused: boolean = true) {
    const { grid, list } = this,
      to = Math.max(-1, Math.min(rank, list.last));
    this.at = { id: list.at(to)?.id ?? null, key };
    if (to >= 0) grid.show(to);
    this.draw();
    if (isFocused) this.focus();
  }
}
