// The edits of the table of control points: requests to Python, the input in a cell, and points as CSV text.

import type { PointsCommand, PointsTableToFrontEnd } from "../generated.ts";
import { nameOf } from "../maths/point_names.ts";
import type { Model } from "../types.ts";
import { OWN_KEYS, pageElement, setText, targetOf } from "../ui/dom.ts";
import type { Column, PointList, Selection } from "./point_rows.ts";
import { cellValue, editText, pointsAsCsv } from "./point_rows.ts";
import { isEditable, type MarkedCell, type TableGrid } from "./table_grid.ts";

/** Actions that are requested of Python, and its answers. */
export class TableRequests {
  seq = 0;
  /** Called with the answers, by seq */
  waiting: Map<number, (isDone: boolean) => void> = new Map();
  liveRegion = pageElement("span", "dnb-pt-said", null, { role: "status" });
  #view = Math.random().toString(36).slice(2, 12); // a name for this view

  constructor(readonly model: Model) {}

  get isReadOnly() {
    return Boolean(this.model.get("read_only"));
  }

  showMessage(text: string) {
    setText(this.liveRegion, text);
  }

  /** Request an action. `answered` is called with whether it was done. */
  send(
    what: PointsCommand["what"],
    ids: number[] = [],
    { field = "", axis = 0, value = null }: Pick<PointsCommand, "field" | "axis" | "value"> = {},
    answered: (isDone: boolean) => void = () => {},
  ) {
    this.seq += 1;
    if (what !== "seen") this.showMessage("");
    this.waiting.set(this.seq, answered);
    this.model.send({
      type: "act",
      view: this.#view,
      seq: this.seq,
      what,
      ids,
      field,
      axis,
      value,
    } satisfies PointsCommand);
  }

  receive({ type, view, seq, ok, text }: PointsTableToFrontEnd) {
    const answered = this.waiting.get(seq);
    if (type !== "done" || view !== this.#view || !answered) return;
    this.waiting.delete(seq);
    if (text) this.showMessage(text);
    answered(Boolean(ok));
  }
}

/** The input in a cell. */
export class CellInput {
  constructor(
    readonly list: PointList,
    readonly grid: TableGrid,
    readonly cell: MarkedCell,
    readonly requests: TableRequests,
  ) {}

  /**
   * Edit a cell.
   * @param first the text instead of the old value
   */
  open(id: number, key: string, first: string | null = null) {
    const { grid, list, requests } = this,
      column = grid.columns.find((c) => c.key === key),
      p = list.at(list.rankOf(id));
    if (!p || !column || !isEditable(column) || requests.isReadOnly) return;
    if (p.locked && column.axis !== undefined) {
      requests.showMessage(`${p.name || `Point ${list.numberOf(p.id)}`} is locked. Unlock it to move it.`);
      return;
    }
    this.cell.move(list.rankOf(id), key, false);
    const cell = grid.cellOf({ id, key }),
      before = editText(cellValue(p, column, list.dim));
    if (!cell) return;
    const input = pageElement("input", "dnb-pt-input", null, {
      type: "text",
      spellcheck: "false",
      autocomplete: "off",
      maxlength: column.kind === "text" ? 80 : 40,
      "aria-label": `${column.tip.split(":")[0]} of ${nameOf(p, list.numberOf(p.id))}`,
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
      this.cell.draw();
      if (isTaken && text !== before) this.#request(id, column, text);
    };
    input.addEventListener("keydown", (event) => this.#key(event, end, id, key));
    input.addEventListener("blur", () => end(true));
    input.focus();
    if (first === null) input.select();
  }

  #key(event: KeyboardEvent, end: (isTaken: boolean) => void, id: number, key: string) {
    event.stopPropagation();
    if (event.isComposing || !["Enter", "Escape", "Tab"].includes(event.key)) return;
    event.preventDefault();
    const { cell, list } = this,
      rank = list.rankOf(id),
      editable = this.grid.columns.filter(isEditable);
    const next = editable.findIndex((c) => c.key === key) + (event.shiftKey ? -1 : 1);
    end(event.key !== "Escape");
    if (event.key === "Enter" && !event.shiftKey && rank < list.last) cell.move(rank + 1, key);
    else cell.move(rank, event.key === "Tab" ? (editable[next]?.key ?? key) : key);
  }

  /** Request another value of a cell, and show where it is refused. */
  #request(id: number, { key, field, axis = 0 }: Column, value: string | boolean) {
    const change = { field: field ?? (key as PointsCommand["field"]), axis, value };
    this.requests.send("cell", [id], change, (isDone) => {
      if (!isDone) this.grid.refuse({ id, key });
    });
  }

  /** Request what a check box was set to; it shows what Python has, until it answers. */
  check(id: number, key: string, box: HTMLInputElement) {
    const column = this.grid.columns.find((c) => c.key === key);
    if (column) this.#request(id, column, box.checked);
    box.checked = !box.checked;
  }
}

/** Points as CSV text on the clipboard. */
export class TableClipboard {
  constructor(
    readonly list: PointList,
    readonly selection: Selection,
    readonly requests: TableRequests,
  ) {}

  /** Copy by the browser's command: without https there is no other clipboard. */
  copy() {
    const once = (event: ClipboardEvent) => {
      event.stopPropagation();
      this.copyInto(event);
    };
    document.addEventListener("copy", once, { capture: true });
    const isDone = document.execCommand("copy");
    document.removeEventListener("copy", once, { capture: true });
    if (!isDone) this.requests.showMessage("This browser does not let a page copy.");
  }

  copyInto(event: ClipboardEvent) {
    const { ids } = this.selection,
      { points, dim } = this.list,
      chosen = ids.size ? points.filter(({ id }) => ids.has(id)) : points;
    event.clipboardData?.setData("text/plain", pointsAsCsv(chosen, dim));
    event.preventDefault();
    this.requests.showMessage(`${chosen.length} ${chosen.length === 1 ? "point" : "points"} copied as CSV.`);
  }

  paste(event: ClipboardEvent) {
    if (targetOf(event).closest("input, textarea")) return;
    event.preventDefault();
    this.requests.send("paste", [], { value: event.clipboardData?.getData("text/plain") });
  }
}
