// A list of things with a name, some facts, a switch and buttons: steps, cuts, rigid parts.
//
// Python owns the list. The front end requests a command for a row, with the state of the list ("version"), and waits
// for the answer: a second click must not meet rows that have moved meanwhile.

import type { ItemListToFrontEnd, RowCommand as RowMessage } from "../generated.ts";
import { LONGEST_ROW_NAME } from "../generated.ts";
import type { Model } from "../types.ts";

import { buttonElement, iconElement, OWN_KEYS, pageElement, setText, targetOf } from "../ui/dom.ts";
import { ThemeObserver } from "../ui/theme.ts";
import { Widget, widgetOf } from "../ui/widget.ts";

/** A row of the list; `mark` is shown instead of its number, `swatch` is a colour, `time` in seconds. */
export interface Row {
  name?: string;
  title?: string;
  on: boolean;
  mark?: string;
  swatch?: string;
  indent?: number;
  facts?: string[];
  time?: number;
  tip?: string;
}

/** Command: tip, icon of 16 x 16 */
const ROW_BUTTONS = {
  rename: ["Rename (F2)", "M3 13l.6-2.8L10.8 3l2.2 2.2-7.2 7.2zM9.4 4.4l2.2 2.2"],
  up: ["Earlier (Alt+Up)", "M8 13V3M4 7l4-4 4 4"],
  down: ["Later (Alt+Down)", "M8 3v10M4 9l4 4 4-4"],
  double: ["Duplicate", "M5.5 5.5h8v8h-8zM10.5 5.5v-3h-8v8h3"],
  remove: ["Delete (Del)", "M3.5 4.5h9M6.5 4.5v-2h3v2M5 4.5l.6 9h4.8l.6-9M7 7v4M9 7v4"],
} as const;
type RowCommand = keyof typeof ROW_BUTTONS;

/** A time in the zone of the front end, which may be another than Python's, as the language around it writes it. */
function timeOfDay(seconds: number, place: Element) {
  const language = place.closest("[lang]")?.getAttribute("lang") || [];
  return new Date(1000 * seconds).toLocaleTimeString(language, {
    hour: "2-digit",
    minute: "2-digit",
    second: "2-digit",
  });
}

class ItemListView extends Widget {
  table: HTMLTableElement;
  head: HTMLTableSectionElement;
  body: HTMLTableSectionElement;
  empty: HTMLDivElement;
  theme: ThemeObserver;
  sized: ResizeObserver;

  chosen = -1; // the row that was in sight last
  current = 0; // the row that Tab reaches
  isWaiting = false;
  isNaming = false;
  isChoosing = false;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-item-list");
    this.table = pageElement("table", "dnb-il-table", this.root);
    this.head = pageElement("thead", "", this.table);
    this.body = pageElement("tbody", "", this.table);
    this.empty = pageElement("div", "dnb-il-empty", this.root);
    this.onChange(["rows", "chosen", "columns"], () => this.draw());
    this.on("msg:custom", (content: ItemListToFrontEnd) => {
      if (content.type !== "done") return;
      this.isChoosing = false;
      this.#wait(false);
    });
    this.listen(this.root, "keydown", (event) => this.#key(event));
    this.theme = new ThemeObserver(this.root, () => this.#repaint());
    this.sized = new ResizeObserver(() => this.#show()); // a tab that was hidden had nothing to scroll
    this.sized.observe(this.root);
    this.draw();
  }

  close() {
    this.sized.disconnect();
    this.theme.close();
    super.close();
  }

  get rows(): Row[] {
    return this.model.get("rows") || [];
  }

  get hasSwitches() {
    return this.model.get("switches") !== false;
  }

  get commands(): RowCommand[] {
    return this.model.get("commands") || [];
  }

  /** @param what the command */
  act(what: RowMessage["what"], index: number, value: string | boolean | null = null) {
    const isKnown = what === "choose" || what === "switch" || this.commands.some((command) => command === what);
    if ((this.isWaiting && what !== "rename") || !this.rows[index] || !isKnown) return;
    if ((what === "up" && index === 0) || (what === "down" && index === this.rows.length - 1)) return;
    this.current = index + Number(what === "down" || what === "double") - Number(what === "up");
    this.isChoosing = what === "choose"; // wherever its row will be then
    this.#wait(true);
    this.model.send({ type: "act", what, index, value, version: this.model.get("version") } satisfies RowMessage);
  }

  #wait(isWaiting: boolean) {
    this.isWaiting = isWaiting;
    this.table.setAttribute("aria-busy", String(isWaiting));
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    if (this.isNaming) return; // text being typed must not be lost; drawn when that is done
    const held = this.#focusedPart(),
      { rows } = this,
      chosen = this.model.get("chosen");
    this.current = Math.max(0, Math.min(this.current, rows.length - 1));
    this.table.setAttribute("aria-label", this.model.get("label") || "List");
    this.table.classList.toggle("dnb-il-commanded", this.commands.length > 0);
    setText(this.empty, rows.length ? "" : this.model.get("empty") || "");
    this.empty.hidden = rows.length > 0;
    this.#drawHead(rows.length > 0);
    this.body.replaceChildren(...rows.map((row, k) => this.#row(row, k, k === chosen)));
    this.#repaint();
    const goesThere = this.isChoosing || (chosen !== this.chosen && !held);
    if (goesThere) this.current = Math.max(0, Math.min(chosen, rows.length - 1));
    this.#reach();
    if (held) this.#focus(this.current, held);
    const isOther = chosen !== this.chosen;
    this.chosen = chosen;
    if (isOther) this.#show();
  }

  /** Scroll to the chosen row by the list's own scroll bar: scrollIntoView would move the whole page. */
  #show() {
    const line = this.body.rows[this.chosen];
    if (!line) return;
    const head = this.head.offsetHeight,
      top = line.offsetTop - head,
      end = line.offsetTop + line.offsetHeight;
    if (top < this.root.scrollTop) this.root.scrollTop = top;
    else if (end > this.root.scrollTop + this.root.clientHeight) this.root.scrollTop = end - this.root.clientHeight;
  }

  #drawHead(isShown: boolean) {
    const columns = this.model.get("columns") || [];
    this.head.replaceChildren();
    if (!columns.length || !isShown) return;
    const line = pageElement("tr", "", this.head);
    for (const text of ["", ...columns, ...(this.hasSwitches ? ["On"] : []), ""]) {
      pageElement(text ? "th" : "td", "", line, text ? { scope: "col" } : {}, text);
    }
  }

  #row(row: Row, k: number, isChosen: boolean) {
    const line = document.createElement("tr"),
      name = row.name || row.title || "";
    line.className = `dnb-il-row${isChosen ? " dnb-il-chosen" : ""}${row.on ? "" : " dnb-il-off"}`;
    line.addEventListener("click", (event) => {
      if (!targetOf(event).closest("button, input")) this.act("choose", k);
    });
    const mark = pageElement("td", "dnb-il-mark", line);
    const look = row.swatch && row.mark ? "dnb-il-badge" : row.swatch ? "dnb-il-swatch" : "dnb-il-number";
    const disc = pageElement("span", look, mark, { "aria-hidden": "true" });
    if (row.swatch) disc.style.background = row.swatch;
    if (!row.swatch || row.mark) disc.textContent = row.mark ?? String(k + 1);
    const cell = pageElement("td", "dnb-il-name", line);
    const facts = [...(row.facts || []), ...(row.time ? [timeOfDay(row.time, this.root)] : [])];
    for (let depth = 0; depth < (row.indent || 0); depth += 1) {
      pageElement("span", "dnb-il-indent", cell, { "aria-hidden": "true" });
    }
    const choose = buttonElement("dnb-il-choose", cell, name, () => this.act("choose", k), {
      "data-part": "choose",
      title: row.tip || name,
      "aria-label": `${row.swatch && !row.mark ? "" : `${k + 1}: `}${[name, ...facts].filter(Boolean).join(", ")}`,
      ...(isChosen ? { "aria-current": "true" } : {}),
    });
    choose.addEventListener("dblclick", () => this.#rename(k));
    for (const fact of facts) pageElement("td", "dnb-il-fact", line, { title: fact }, fact);
    if (this.hasSwitches) this.#switch(line, row, k, name);
    this.#buttons(pageElement("td", "dnb-il-buttons", line), k, name);
    return line;
  }

  #switch(line: HTMLElement, row: Row, k: number, name: string) {
    const on = pageElement("input", "dnb-il-switch", pageElement("td", "dnb-il-on", line), {
      type: "checkbox",
      "data-part": "switch",
      title: "Switch on or off",
      "aria-label": `${name} is on`,
      ...OWN_KEYS,
    });
    on.checked = row.on;
    on.addEventListener("change", () => {
      this.act("switch", k, on.checked);
      on.checked = row.on;
    });
  }

  #buttons(cell: HTMLElement, k: number, name: string) {
    const last = this.rows.length - 1;
    for (const command of this.commands) {
      const [tip, path] = ROW_BUTTONS[command];
      const isOff = (command === "up" && k === 0) || (command === "down" && k === last);
      const act = () => (command === "rename" ? this.#rename(k) : this.act(command, k));
      buttonElement("dnb-il-button", cell, iconElement(path), act, {
        title: tip,
        "data-part": command,
        "aria-label": `${tip.split(" (")[0]} ${name}`,
        "aria-disabled": isOff,
      });
    }
  }

  #repaint() {
    this.root.classList.toggle("dnb-dark", this.theme.isDark);
  }

  // ---- keys and names -----------------------------------------------------------------------------------------------

  #key(event: KeyboardEvent) {
    const target = targetOf(event),
      line = target.closest("tr");
    if (!line || this.isNaming) return;
    const k = [...this.body.rows].indexOf(line);
    const step = event.key === "ArrowUp" ? -1 : event.key === "ArrowDown" ? 1 : 0;
    if (step && event.altKey) this.act(step < 0 ? "up" : "down", k);
    else if (step) this.#focus(Math.max(0, Math.min(k + step, this.rows.length - 1)), target.getAttribute("data-part"));
    else if (event.key === "F2") this.#rename(k);
    else if (event.key === "Delete") this.act("remove", k);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  #rename(k: number) {
    if (!this.commands.includes("rename") || this.isNaming || !this.rows[k]) return;
    const cell = this.body.rows[k]!.querySelector(".dnb-il-name"),
      before = this.rows[k].name || "";
    const input = pageElement("input", "dnb-il-input", null, {
      type: "text",
      maxlength: LONGEST_ROW_NAME,
      spellcheck: "false",
      "aria-label": "Name",
      placeholder: this.rows[k].title || "",
      ...OWN_KEYS,
    });
    input.value = before;
    this.isNaming = true;
    const end = (isTaken: boolean) => {
      if (!this.isNaming) return;
      this.isNaming = false;
      const name = input.value.trim();
      this.current = k;
      this.draw();
      if (isTaken && name !== before) this.act("rename", k, name);
      this.#focus(k, "choose");
    };
    input.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === "Escape") {
        end(event.key === "Enter");
        event.preventDefault();
      }
      event.stopPropagation();
    });
    input.addEventListener("blur", () => end(true));
    cell?.replaceChildren(input);
    input.select();
    input.focus();
  }

  /** The part of a row that has the focus, or null. */
  #focusedPart() {
    const { activeElement } = document;
    return activeElement && this.body.contains(activeElement) ? activeElement.getAttribute("data-part") : null;
  }

  #focus(k: number, part: string | null) {
    const line = this.body.rows[k];
    if (!line) return;
    this.current = k;
    this.#reach();
    const wanted: HTMLElement | null = line.querySelector(`[data-part="${part}"]`) ?? line.querySelector("button");
    wanted?.focus({ preventScroll: false });
  }

  /** Make one row reachable by Tab, and all of it; arrows focus the others. */
  #reach() {
    [...this.body.rows].forEach((line, k) => {
      const index = k === this.current ? "0" : "-1";
      for (const part of line.querySelectorAll("[data-part]")) part.setAttribute("tabindex", index);
    });
  }
}

export default widgetOf(ItemListView);
