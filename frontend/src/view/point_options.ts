// The choice of the way that points are dragged in a view of the volume, and the depth of the selected one.

import { buttonElement, pageElement, setAttributes, setText } from "../ui/dom.ts";
import type { PointDrag } from "./point_drag.ts";

export class PointOptions {
  #bar: HTMLDivElement;
  #depth: HTMLSpanElement;
  #buttons: HTMLButtonElement[];

  constructor(
    root: HTMLElement,
    readonly drag: PointDrag,
  ) {
    this.#bar = pageElement("div", "dnb-sp-options", root, {
      hidden: "",
      role: "group",
      "aria-label": "How points are dragged in the volume",
    });
    this.#buttons = (
      [
        ["View plane", "Points are dragged parallel to the screen", false],
        ["Along surface", "Points are dragged over the visible surface", true],
      ] as const
    ).map(([text, title, isAlongSurface]) =>
      buttonElement("dnb-sp-option", this.#bar, text, () => this.#choose(isAlongSurface), { title }),
    );
    this.#depth = pageElement("span", "dnb-sp-depth", this.#bar);
    this.#mark();
  }

  #choose(isAlongSurface: boolean) {
    this.drag.isAlongSurface = isAlongSurface;
    this.#mark();
  }

  #mark() {
    this.#buttons.forEach((button, k) => {
      setAttributes(button, { "aria-pressed": String(Boolean(k) === this.drag.isAlongSurface) });
    });
  }

  /** @param depth of the selected point in words; null where none is selected */
  show(depth: string | null) {
    this.#bar.hidden = depth === null;
    setText(this.#depth, depth ?? "");
  }

  close() {
    this.#bar.remove();
  }
}
