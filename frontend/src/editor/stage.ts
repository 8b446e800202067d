// The stage of the editor of a picture: the box with the picture, and what is drawn over it.

import type { Vector2 } from "../types.ts";
import { isWorkedIn, OWN_KEYS, pageElement, setText, svgElement } from "../ui/dom.ts";

export class Stage {
  element: HTMLDivElement;
  canvas: HTMLCanvasElement;
  svg: SVGSVGElement;
  wait: HTMLDivElement;

  /** Ends the listeners of the editor. */
  closing = new AbortController();

  /**
   * @param host the element that the page gives to the editor
   * @param root the editor's own element in it
   */
  constructor(
    readonly host: HTMLElement,
    readonly root: HTMLElement,
  ) {
    this.element = pageElement("div", "dnb-ed-stage", root, { tabindex: "0", role: "application", ...OWN_KEYS });
    this.canvas = pageElement("canvas", "dnb-ed-canvas", this.element, { "aria-hidden": "true" });
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.element);
    const veil = pageElement("div", "dnb-ed-veil", this.element);
    this.wait = pageElement("div", "dnb-ed-wait", veil, { role: "status" }); // there from the start: so it is read out
  }

  close() {
    this.closing.abort();
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  /** Give the focus to the stage. */
  focus() {
    this.element.focus({ preventScroll: true });
  }

  get isWorkedIn() {
    return isWorkedIn(this.root);
  }

  /** The place of a pointer in CSS pixels of the view. */
  placeOf(event: MouseEvent): Vector2 {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** @param words what is waited for, "" for nothing */
  showWaiting(words: string) {
    this.element.classList.toggle("dnb-ed-waiting", words !== "");
    this.element.setAttribute("aria-busy", String(words !== ""));
    setText(this.wait, words);
  }
}
