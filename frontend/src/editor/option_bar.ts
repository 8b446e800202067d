// A bar over the picture with the options of a tool.

import type { Attributes } from "../ui/dom.ts";
import { buttonElement, OWN_KEYS, pageElement } from "../ui/dom.ts";
import type { Frames } from "./frames.ts";

export class OptionBar {
  readonly element: HTMLDivElement;
  readonly #frames: Pick<Frames, "guard">;

  constructor(
    { frames, stage }: { frames: Pick<Frames, "guard">; stage: { readonly element: HTMLElement } },
    className: string,
    label: string,
  ) {
    const attributes = { hidden: "", role: "group", "aria-label": label };
    this.#frames = frames;
    this.element = pageElement("div", `dnb-ed-brush ${className}`.trim(), stage.element, attributes);
  }

  /** @param label of the button for screen readers */
  button(text: string, label: string, act: () => void, title: string = "") {
    const attributes = { "aria-label": label, ...(title && { title }) };
    return buttonElement("dnb-ed-button", this.element, text, () => this.#frames.guard(act), attributes);
  }

  checkbox(words: string, title: string, change: (isOn: boolean) => void) {
    const label = pageElement("label", "dnb-ed-wand-through", this.element, { title });
    const input = pageElement("input", "", label, { type: "checkbox", "aria-label": words, ...OWN_KEYS });
    pageElement("span", "", label, {}, words);
    input.addEventListener("change", () => this.#frames.guard(() => change(input.checked)));
    return input;
  }

  /** A slider from 0 to 100. */
  slider(label: string, change: (value: number) => void, attributes: Attributes = {}) {
    const range = { type: "range", min: 0, max: 100, "aria-label": label, ...attributes, ...OWN_KEYS };
    const input = pageElement("input", "", this.element, range);
    input.addEventListener("input", () => this.#frames.guard(() => change(input.valueAsNumber)));
    return input;
  }

  text(className: string = "", attributes: Attributes = {}) {
    return pageElement("span", className, this.element, attributes);
  }
}
