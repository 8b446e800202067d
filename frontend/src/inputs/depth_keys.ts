// Depths of the key pictures as marks on a bar, of which one is selected.

import { MOST_KEYS } from "../generated.ts";
import type { Model, Vector2 } from "../types.ts";

import { pageElement, placeIn, setAttributes, setText, svgElement, treeOf } from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";
import { markElement, NodesView } from "./nodes_view.ts";

const BAR = { left: 16, right: 16, line: 42, height: 72, hat: 24 };

/** A drag of a key. */
export type KeyDrag = { k: number; before: { knots: number[]; selected: number } };

class DepthKeysView extends NodesView<KeyDrag> {
  facts: HTMLSpanElement;
  back: SVGGElement;
  front: SVGGElement;

  /** The depths */
  knots: number[] = [];
  selected = 0;
  span = 1; // pixels of the bar

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-depth-keys", "data-key", [
      "Add a key next to the selected one (A, or double click)",
      "Remove the selected key (Del, or right click)",
    ]);
    this.svg.setAttribute("height", String(BAR.height));
    this.facts = pageElement("span", "dnb-cv-facts dnb-cv-space", this.bar);
    this.bar.append(this.adder, this.remover);
    this.back = svgElement("g", { "aria-hidden": "true" }, this.svg);
    this.front = svgElement("g", {}, this.svg);
    this.root.append(this.alert);
    this.start();
  }

  adopt({ knots, selected }: { knots: number[]; selected: number }) {
    this.knots = knots;
    this.selected = Math.min(selected, knots.length - 1);
  }

  // ---- places -------------------------------------------------------------------------------------------------------

  toPixel(depth: number) {
    return BAR.left + depth * this.span;
  }

  depthOf(event: MouseEvent) {
    return (placeIn(this.svg, event)[0] - BAR.left) / this.span;
  }

  get apart(): number {
    return this.model.get("least_apart");
  }

  /** These keys with the k-th one at another depth, limited by its neighbours. */
  moveKnot(knots: number[], k: number, depth: number) {
    const before = knots[k - 1],
      after = knots[k + 1];
    const low = before === undefined ? 0 : before + this.apart,
      high = after === undefined ? 1 : after - this.apart;
    if (low > high) return knots;
    const rounded = Math.round(depth * 200) / 200;
    return knots.map((knot, j) => (j === k ? Number(Math.max(low, Math.min(high, rounded)).toFixed(6)) : knot));
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** The value that Python receives. */
  value(kind: string, index: number) {
    return { kind, index, knots: this.knots, selected: this.selected };
  }

  commit(kind: string, index: number) {
    this.isHeld = false;
    this.nudged = null;
    this.end(this.value(kind, index));
    this.invalidate();
  }

  press(event: PointerEvent): KeyDrag | null {
    const k = this.isReadOnly ? null : this.nodeAt(event);
    if (k === null) return null;
    this.settle();
    this.marks[k]!.focus({ preventScroll: true });
    this.isHeld = true;
    const { knots, selected } = this;
    this.selected = k;
    this.invalidate();
    return { k, before: { knots, selected } };
  }

  drag({ k, before }: KeyDrag, [dx]: Vector2) {
    this.knots = this.moveKnot(before.knots, k, before.knots[k]! + dx / this.span);
    this.move(this.value("move", k));
    this.invalidate();
  }

  drop({ k, before }: KeyDrag, isCancelled: boolean, isClick: boolean) {
    if (isCancelled) Object.assign(this, before);
    if (!isClick && (!isCancelled || this.model.get("live"))) {
      this.commit("move", k);
      return;
    }
    if (!isCancelled && k !== before.selected) {
      this.commit("select", k);
      return;
    }
    this.isHeld = false;
    this.receive();
    this.invalidate();
  }

  nudge(k: number, [dx, dy]: Vector2, isFar: boolean) {
    this.isHeld = true;
    this.nudged = k;
    this.knots = this.moveKnot(this.knots, k, this.knots[k]! + (dx + dy) * (isFar ? 0.1 : 0.01));
    this.move(this.value("move", k));
    this.invalidate();
    this.settleSoon();
  }

  commitNudge(k: number) {
    this.commit("move", k);
  }

  select(k: number) {
    if (this.isReadOnly || k === this.selected) return;
    this.selected = k;
    this.commit("select", k);
  }

  addAt(event: MouseEvent) {
    this.add(this.depthOf(event));
  }

  add(depth: number) {
    if (this.isReadOnly) return;
    this.settle();
    const at = Math.round(Math.max(0, Math.min(1, depth)) * 200) / 200;
    if (this.knots.length >= MOST_KEYS || this.knots.some((knot) => Math.abs(knot - at) < this.apart)) {
      this.showMessage("There is no room for another key here.");
      return;
    }
    this.knots = [...this.knots, at].sort((a, b) => a - b);
    this.selected = this.knots.indexOf(at);
    this.commit("add", this.selected);
    this.focusMark(this.selected);
    this.announce(`added ${this.words(this.selected)}`);
  }

  /** Add a key in the middle of the wider gap next to the selected one; the ends of the bar count as gaps too. */
  addChosen() {
    const { knots, selected: k } = this,
      at = knots[k]!,
      before = knots[k - 1],
      after = knots[k + 1];
    const left: Vector2 = before === undefined ? [0, at] : [(before + at) / 2, (at - before) / 2];
    const right: Vector2 = after === undefined ? [1, 1 - at] : [(after + at) / 2, (after - at) / 2];
    this.add(right[1] >= left[1] ? right[0] : left[0]);
  }

  addAfter() {
    this.addChosen();
  }

  removeChosen() {
    this.remove(this.selected);
  }

  remove(k: number) {
    if (this.isReadOnly) return;
    this.settle();
    if (this.knots.length === 1) {
      this.showMessage("One key stays: the picture that is edited.");
      return;
    }
    const hadFocus = this.svg.contains(treeOf(this.root).activeElement);
    this.knots = this.knots.filter((_, j) => j !== k);
    this.selected = Math.min(this.selected > k ? this.selected - 1 : this.selected, this.knots.length - 1);
    this.commit("remove", k);
    if (hadFocus) this.focusMark(this.selected);
    this.announce(`removed; ${this.knots.length} left`);
  }

  nodeKey(event: KeyboardEvent, k: number) {
    if (event.key !== "Enter" && event.key !== " ") return super.nodeKey(event, k);
    this.settle();
    this.select(k);
    return true;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  words(k: number) {
    return `key ${k + 1} of ${this.knots.length} at depth ${Number(this.knots[k]!.toFixed(3))}`;
  }

  draw() {
    const width = Math.max(160, this.stage.clientWidth || 360),
      label = this.model.get("label") || "Keys";
    this.span = width - BAR.left - BAR.right;
    setAttributes(this.svg, {
      viewBox: `0 0 ${width} ${BAR.height}`,
      "aria-label": `${label}. Tab goes through the keys, Enter selects, arrows move, A adds, Delete removes.`,
    });
    this.root.classList.toggle("dnb-cv-read-only", this.isReadOnly);
    this.#drawBack();
    this.#drawMarks();
    const words = this.words(this.selected);
    setText(this.facts, words.charAt(0).toUpperCase() + words.slice(1));
    const isFull = this.knots.length >= MOST_KEYS;
    setAttributes(this.adder, { "aria-disabled": this.isReadOnly || isFull });
    setAttributes(this.remover, { "aria-disabled": this.isReadOnly || this.knots.length === 1 });
  }

  /** Draw the bar, and over it how much of each key there is at every depth. */
  #drawBack() {
    this.back.replaceChildren();
    const { knots } = this,
      low = BAR.line - 14,
      top = low - BAR.hat;
    knots.forEach((knot, k) => {
      const x = this.toPixel(knot),
        name = `dnb-cv-hat${k === this.selected ? " dnb-cv-chosen" : ""}`;
      const before = knots[k - 1],
        after = knots[k + 1];
      const left =
        before === undefined ? `M${this.toPixel(0)} ${low}V${top}H${x}` : `M${this.toPixel(before)} ${low}L${x} ${top}`;
      const right = after === undefined ? `H${this.toPixel(1)}V${low}Z` : `L${this.toPixel(after)} ${low}Z`;
      svgElement("path", { class: name, d: left + right }, this.back);
    });
    svgElement("path", { class: "dnb-cv-rail", d: `M${this.toPixel(0)} ${BAR.line}H${this.toPixel(1)}` }, this.back);
    this.#drawTick(0, "0 front", "start", -8);
    this.#drawTick(0.5, "0.5", "middle", 0);
    this.#drawTick(1, "back 1", "end", 8);
  }

  #drawTick(depth: number, text: string, anchor: string, dx: number) {
    const x = this.toPixel(depth);
    svgElement("path", { class: "dnb-cv-tick", d: `M${x} ${BAR.line + 13}v3` }, this.back);
    const place = { x: x + dx, y: BAR.height - 3, "text-anchor": anchor };
    svgElement("text", { class: "dnb-cv-text", ...place }, this.back, text);
  }

  makeMark(k: number) {
    const range = { "aria-valuemin": 0, "aria-valuemax": 1 };
    const mark = markElement(this.front, [13, 12, 8.5], { "data-key": k, role: "slider", tabindex: 0, ...range });
    svgElement("text", { class: "dnb-cv-number", y: 3.8, "text-anchor": "middle" }, mark, String(k + 1));
    return mark;
  }

  #drawMarks() {
    this.countMarks(this.knots.length);
    this.knots.forEach((knot, k) => {
      const isSelected = k === this.selected,
        mark = this.marks[k]!;
      setAttributes(mark, {
        transform: `translate(${this.toPixel(knot).toFixed(2)} ${BAR.line})`,
        "aria-label": `key ${k + 1} of ${this.knots.length}${isSelected ? ", selected" : ""}`,
        "aria-valuenow": knot,
        "aria-valuetext": `depth ${Number(knot.toFixed(3))}`,
        "aria-readonly": this.isReadOnly,
      });
      mark.classList.toggle("dnb-cv-chosen", isSelected);
    });
  }
}

export default widgetOf(DepthKeysView);
