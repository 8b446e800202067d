// The studio's button "Save", and Ctrl+S anywhere in the studio.

/** @import { Model } from "../types.d.ts" */

import { OWN_KEYS, pageElement } from "../ui/dom.js";

class SaveButtonView {
  /**
   * @param {Model} model
   * @param {HTMLElement} el
   */
  constructor(model, el) {
    this.model = model;
    this.host = el;
    // Looks like the buttons beside it, which ipywidgets has drawn.
    this.button = pageElement("button", "jupyter-widgets jupyter-button widget-button dnb-save", el,
      { type: "button", ...OWN_KEYS });
    this.button.textContent = "Save";
    this.button.addEventListener("click", () => this.save());
    this.draw = () => this.#draw();
    for (const name of ["unsaved", "tip"]) model.on(`change:${name}`, this.draw);
    this.pressed = (/** @type {KeyboardEvent} */ event) => this.#key(event);
    // On the way down: the host's own listeners may end the event. They still get it, so that a notebook is saved too.
    window.addEventListener("keydown", this.pressed, true);
    this.#draw();
  }

  save() { this.model.send({ type: "save" }); }

  close() {
    for (const name of ["unsaved", "tip"]) this.model.off(`change:${name}`, this.draw);
    window.removeEventListener("keydown", this.pressed, true);
    this.button.remove();
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const isCommand = (event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey, { target } = event;
    const studio = target instanceof Element ? target.closest(".dnb-studio") : null;
    if (!isCommand || event.key.toLowerCase() !== "s" || !studio?.contains(this.host)) return;
    event.preventDefault(); // else the browser would offer to save the page
    if (!event.repeat) this.save();
  }

  #draw() {
    const isUnsaved = Boolean(this.model.get("unsaved")), tip = this.model.get("tip") || "";
    this.button.title = isUnsaved ? `There are unsaved edits. ${tip}` : tip;
    this.button.setAttribute("aria-label", isUnsaved ? "Save; there are unsaved edits" : "Save");
    this.button.classList.toggle("dnb-save-unsaved", isUnsaved);
  }
}

export default {
  /** @param {{ model: Model, el: HTMLElement }} widget */
  render({ model, el }) {
    const view = new SaveButtonView(model, el);
    return () => view.close();
  },
};
