// Menu of the presets of colours and opacities, with a picture of this very volume in the colours of each.

import type { Model } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.ts";
import { Widget, widgetOf } from "../ui/widget.ts";

const PICTURE = 64; // CSS pixels
const EDGE = 4; // CSS pixels between the list and the window's border
const OWN = "Own colours";

/** @param name of a preset */
const labelOf = (name: string) => (name ? name.charAt(0).toUpperCase() + name.slice(1) : OWN);

class PresetMenuView extends Widget {
  button: HTMLButtonElement;
  list: HTMLDivElement;
  options: Map<string, { option: HTMLButtonElement; picture: HTMLImageElement }>;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-preset-menu", OWN_KEYS);
    this.button = pageElement("button", "dnb-pm-button", this.root, { type: "button", "aria-haspopup": "listbox" });
    // In the browser's top layer, since the row over the volume clips all that is higher than itself.
    this.list = pageElement("div", "dnb-pm-list", this.root, {
      role: "listbox",
      "aria-label": "Preset",
      popover: "auto",
    });
    const presets: [string, string][] = Object.entries(model.get("presets") ?? {});
    this.options = new Map(presets.map(([name, tip]) => [name, this.#option(name, tip)]));
    this.listen(this.button, "click", () => this.#open());
    this.listen(this.list, "keydown", (event) => this.#key(event));
    this.listen(this.list, "toggle", () => this.draw());
    this.listen(window, "scroll", () => this.#hide(), { capture: true }); // it would not go along
    this.onChange(["value", "disabled", "thumbnails"], () => this.draw());
    this.draw();
  }

  #option(name: string, tip: string) {
    const option = pageElement("button", "dnb-pm-option", this.list, {
      type: "button",
      role: "option",
      title: tip,
      tabindex: -1,
    });
    const picture = pageElement("img", "", option, { alt: "", width: PICTURE, height: PICTURE, draggable: "false" });
    pageElement("span", "", option, {}, labelOf(name));
    this.listen(option, "click", () => this.#choose(name));
    return { option, picture };
  }

  #open() {
    this.list.showPopover();
    const { left, bottom } = this.button.getBoundingClientRect(),
      { offsetWidth, offsetHeight } = this.list;
    this.list.style.left = `${Math.max(EDGE, Math.min(left, innerWidth - offsetWidth - EDGE))}px`;
    this.list.style.top = `${Math.max(EDGE, Math.min(bottom + EDGE, innerHeight - offsetHeight - EDGE))}px`;
    const first = this.options.get(this.model.get("value")) ?? [...this.options.values()][0];
    first?.option.focus({ preventScroll: true });
  }

  #hide() {
    if (this.list.matches(":popover-open")) this.list.hidePopover();
  }

  #choose(name: string) {
    this.#hide();
    this.button.focus({ preventScroll: true });
    this.model.set("value", name);
    this.model.save_changes();
  }

  /** Arrows go from one to the next, round and round. Enter and space choose, Esc closes: the browser does both. */
  #key(event: KeyboardEvent) {
    const all = [...this.options.values()].map(({ option }) => option),
      at = all.findIndex((option) => option.matches(":focus"));
    const next: Record<string, number> = {
      ArrowDown: at + 1,
      ArrowRight: at + 1,
      ArrowUp: at - 1,
      ArrowLeft: at - 1,
      Home: 0,
      End: -1,
    };
    if (event.key !== "Tab") event.stopPropagation(); // the host has its own keys
    const place = next[event.key];
    if (place === undefined) return;
    event.preventDefault();
    all.at(place % all.length)?.focus();
  }

  draw() {
    const { model } = this,
      value = model.get("value"),
      pictures = model.get("thumbnails") ?? {};
    const isOpen = this.list.matches(":popover-open");
    setText(this.button, labelOf(value));
    setAttributes(this.button, {
      "aria-label": `Preset: ${labelOf(value)}`,
      "aria-expanded": isOpen,
      title: "Colours and opacities of the volume, each as it shows this one",
    });
    this.button.disabled = Boolean(model.get("disabled"));
    for (const [name, { option, picture }] of this.options) {
      setAttributes(option, { "aria-selected": name === value });
      if (pictures[name]) picture.src = pictures[name];
      else picture.removeAttribute("src");
    }
  }
}

export default widgetOf(PresetMenuView);
