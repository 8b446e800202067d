// A drawing with nodes that are dragged, moved by arrow keys, added and removed: those of a curve, depths on a bar.

import type { Model, Vector2 } from "../types.ts";
import type { Attributes } from "../ui/dom.ts";
import { ARROWS, OWN_KEYS, pageElement, svgElement } from "../ui/dom.ts";
import type { DragHandler } from "./base.ts";
import { InputView, KEYS_REST, listenToDrags, numberUnder, targetIndex } from "./base.ts";

/** A mark of a node: circles for the hit area, for a halo, and for a dot. */
export function markElement(parent: Element, [hit, halo, dot]: [number, number, number], attributes: Attributes = {}) {
  const mark = svgElement("g", { class: "dnb-cv-node", ...attributes, ...OWN_KEYS }, parent);
  svgElement("circle", { class: "dnb-cv-hit", r: hit }, mark);
  svgElement("circle", { class: "dnb-cv-halo", r: halo }, mark);
  svgElement("circle", { class: "dnb-cv-dot", r: dot }, mark);
  return mark;
}

export abstract class NodesView<Drag> extends InputView implements DragHandler<Drag> {
  bar: HTMLDivElement;
  stage: HTMLDivElement;
  svg: SVGSVGElement;
  adder: HTMLButtonElement;
  remover: HTMLButtonElement;
  cancelDrag: () => boolean;

  marks: SVGGElement[] = [];
  nudged: number | null = null; // the node that arrow keys move
  keyTimer = 0;

  /**
   * @param attribute of a mark, with the index of its node
   * @param tips of the buttons that add and remove a node; the widget places them
   */
  constructor(
    model: Model,
    el: HTMLElement,
    name: string,
    readonly attribute: string,
    tips: [string, string],
  ) {
    super(model, el, name);
    this.bar = pageElement("div", "dnb-cv-bar", this.root, { role: "toolbar" });
    this.stage = pageElement("div", "dnb-cv-stage", this.root);
    this.svg = svgElement("svg", { class: "dnb-cv-svg", role: "group" }, this.stage);
    this.adder = this.iconButton(null, "+", tips[0], () => this.addChosen());
    this.remover = this.iconButton(null, "\u2212", tips[1], () => this.removeChosen());
    this.cancelDrag = listenToDrags(this, this.svg, this);
    this.listen(this.svg, "dblclick", (event) => {
      if (this.nodeAt(event) !== null) return;
      event.preventDefault();
      this.addAt(event);
    });
    this.listen(this.svg, "contextmenu", (event) => {
      const k = this.nodeAt(event);
      if (k === null || this.isReadOnly) return;
      event.preventDefault();
      if (!event.ctrlKey) this.remove(k); // with Ctrl it is a click on a Mac
    });
    this.listen(this.root, "keydown", (event) => this.key(event));
    this.listen(this.root, "keyup", (event) => {
      if (ARROWS[event.key]) this.settle();
    });
    this.listen(this.svg, "focusout", () => this.settle());
  }

  close() {
    clearTimeout(this.keyTimer);
    super.close();
  }

  abstract press(event: PointerEvent): Drag | null;
  abstract drag(grabbed: Drag, by: Vector2): void;
  abstract drop(grabbed: Drag, isCancelled: boolean, isClick: boolean): void;
  /** Add a node where an event was. */
  abstract addAt(event: MouseEvent): void;
  abstract addAfter(k: number): void;
  abstract addChosen(): void;
  abstract remove(k: number): void;
  abstract removeChosen(): void;
  /** Move a node by an arrow key; up is positive. */
  abstract nudge(k: number, by: Vector2, isFar: boolean): void;
  abstract commitNudge(k: number): void;
  /** A new mark for the node of an index. */
  abstract makeMark(k: number): SVGGElement;

  /** The node under the pointer. */
  nodeAt(event: MouseEvent) {
    return numberUnder(event, this.svg, this.attribute);
  }

  /** Settle when no arrow key is pressed any more. */
  settleSoon() {
    clearTimeout(this.keyTimer);
    this.keyTimer = setTimeout(() => this.guard(() => this.settle()), KEYS_REST);
  }

  /** End what arrow keys do: those held down are one edit. */
  settle() {
    clearTimeout(this.keyTimer);
    if (this.nudged !== null) this.commitNudge(this.nudged);
  }

  key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey) return;
    const isEscaped = event.key === "Escape" && this.cancelDrag();
    const k = isEscaped || this.isReadOnly ? -1 : targetIndex(this.marks, event);
    if (!isEscaped && !(k >= 0 && this.nodeKey(event, k))) return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Returns whether the key is one of a node. */
  nodeKey(event: KeyboardEvent, k: number) {
    const arrow = ARROWS[event.key];
    if (arrow) this.nudge(k, [arrow[0], -arrow[1]], event.shiftKey);
    else if (event.key === "Delete" || event.key === "Backspace") this.remove(k);
    else if (event.key.toLowerCase() === "a") this.addAfter(k);
    else return false;
    return true;
  }

  /** Make as many marks as there are nodes. */
  countMarks(count: number) {
    while (this.marks.length > count) this.marks.pop()?.remove();
    while (this.marks.length < count) this.marks.push(this.makeMark(this.marks.length));
  }

  focusMark(k: number) {
    this.draw();
    this.marks[k]!.focus({ preventScroll: true });
  }
}
