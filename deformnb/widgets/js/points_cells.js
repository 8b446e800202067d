// The cells of the table of control points: the rows that are in sight, the marked cell, writing into cells, keys.
// PointsTablePage (points_table.js) is this and the talk with Python.

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
