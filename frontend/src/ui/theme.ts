// The theme of the host of a widget: of Jupyter, of VS Code, or the browser's preference.

import { pageElement } from "./dom.ts";

const DARK_BELOW = 110; // luminance of the background, of 255

/**
 * Finds whether an element has a dark background, and calls `changed` when its host changes the theme, and when the
 * element is shown first: it has no colours before it is in the document.
 */
export class ThemeObserver {
  preference: MediaQueryList;
  observer: MutationObserver;
  shown: ResizeObserver;

  /** @param box the element, or a parent of one that is hidden */
  constructor(
    readonly element: Element,
    readonly changed: () => void,
    box = element,
  ) {
    this.preference = window.matchMedia("(prefers-color-scheme: dark)");
    this.preference.addEventListener("change", changed);
    this.observer = new MutationObserver(changed); // Jupyter and VS Code change attributes of the body
    this.observer.observe(document.body, {
      attributes: true,
      attributeFilter: ["class", "data-jp-theme-light", "data-jp-theme-name", "data-vscode-theme-kind"],
    });
    this.shown = new ResizeObserver(() => {
      if (!element.isConnected) return;
      this.shown.disconnect();
      changed();
    });
    this.shown.observe(box);
  }

  /** By the element's own colour, which variables of Jupyter and VS Code set; else by the browser's preference. */
  get isDark() {
    const [r, g, b, alpha = 1] = (getComputedStyle(this.element).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    return alpha > 0 && r !== undefined && g !== undefined && b !== undefined
      ? 0.2126 * r + 0.7152 * g + 0.0722 * b < DARK_BELOW
      : this.preference.matches;
  }

  close() {
    this.preference.removeEventListener("change", this.changed);
    this.observer.disconnect();
    this.shown.disconnect();
  }
}

/** The theme of the host by name, for a view, whose own background is that of its volume. */
export class Theme {
  observer: ThemeObserver;

  constructor(root: Element, changed: () => void) {
    this.observer = new ThemeObserver(pageElement("span", "dnb-paper", root, { hidden: "" }), changed, root);
  }

  get name(): "dark" | "light" {
    const attribute = document.body.dataset.jpThemeLight; // of Jupyter: Voila loads the colours after the widgets
    return (attribute === undefined ? this.observer.isDark : attribute === "false") ? "dark" : "light";
  }

  close() {
    this.observer.close();
  }
}
