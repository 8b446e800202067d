// The elements of an editor: the box with its pictures, and the layers over them.

import type { Vector2 } from "../types.ts";
import { isInUse, OWN_KEYS, pageElement, placeIn, setText, svgElement } from "../ui/dom.ts";

/** The box of an editor, over which it shows a busy message. */
export abstract class EditorRoot {
  veil = pageElement("div", "dnb-ed-veil");
  wait = pageElement("div", "dnb-ed-wait", this.veil, { role: "status" }); // there from the start: so it is read out

  /** Ends the listeners of the editor. */
  closing = new AbortController();

  /**
   * @param host the host page's element for the editor
   * @param root the editor's own element in it
   * @param element the box
   */
  constructor(
    readonly host: HTMLElement,
    readonly root: HTMLElement,
    readonly element: HTMLDivElement,
  ) {
    host.classList.add("dnb-ed-host");
    host.append(root);
    root.append(element);
  }

  close() {
    this.closing.abort();
    this.root.remove();
    this.host.classList.remove("dnb-ed-host");
  }

  /** Give the focus to a picture. */
  abstract focus(): void;

  get isInUse() {
    return isInUse(this.root);
  }

  /** @param words the busy message, "" for none */
  showWaiting(words: string, isWaiting = words !== "") {
    this.element.classList.toggle("dnb-ed-waiting", isWaiting);
    this.element.setAttribute("aria-busy", String(isWaiting));
    setText(this.wait, words);
  }
}

/** The stage of the editor of a picture. */
export class Stage extends EditorRoot {
  canvas: HTMLCanvasElement;
  svg: SVGSVGElement;

  constructor(host: HTMLElement, root: HTMLElement) {
    super(host, root, pageElement("div", "dnb-ed-stage", null, { tabindex: "0", role: "application", ...OWN_KEYS }));
    this.canvas = pageElement("canvas", "dnb-ed-canvas", this.element, { "aria-hidden": "true" });
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.element);
    this.element.append(this.veil);
  }

  focus() {
    this.element.focus({ preventScroll: true });
  }

  /** The place of a pointer in CSS pixels of the view. */
  placeOf(event: MouseEvent): Vector2 {
    return placeIn(this.element, event);
  }
}
