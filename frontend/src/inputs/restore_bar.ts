// An offer to restore what was lost when a kernel died; and a message when the front end's own kernel has gone.
//
// Python owns the offer. Facts that a front end has of its kernel: the notebook's widget manager notifies each model
// that its comm is dead when the kernel is restarted by the user, and the kernel itself signals when it died and was
// started again. Other hosts signal nothing.

/** @import { Model } from "../types.d.ts" */

import { OWN_KEYS, pageElement, setText } from "../ui/dom.js";

/** @type {[string, string, string][]} command, text, tip */
const RESTORE_BUTTONS = [
  ["restore", "Restore", "Go on with it; can be undone"],
  ["skip", "Skip", "Don't show again; it stays under History"],
  ["delete", "Delete", "Remove its file"],
];
const SURE = "Delete for good?";
const SURE_FOR = 5000; // ms in which a second click deletes
/** @type {Record<string, string>} */
const GONE = { autorestarting: "was restarted", restarting: "was restarted", dead: "has died",
  terminating: "was stopped" };

/**
 * A signal of Lumino.
 * @typedef {{ connect?: (slot: StatusSlot) => void, disconnect?: (slot: StatusSlot) => void }} StatusSignal
 */
/** @typedef {(kernel: unknown, status: string) => void} StatusSlot */
/** @typedef {Model & { widget_manager?: { kernel?: { statusChanged?: StatusSignal } | null } }} NotebookModel */

class RestoreBarView {
  timer = 0;
  isWaiting = false;
  fate = ""; // of the kernel

  /**
   * @param {NotebookModel} model
   * @param {HTMLElement} el
   */
  constructor(model, el) {
    this.model = model;
    this.root = pageElement("div", "dnb-restore", el, { role: "status" });
    this.text = pageElement("span", "dnb-restore-text", this.root);
    this.buttons = RESTORE_BUTTONS.map(([what, text, tip]) => {
      const button = pageElement("button", `dnb-restore-button dnb-restore-${what}`, this.root,
        { type: "button", title: tip, ...OWN_KEYS });
      button.textContent = text;
      button.addEventListener("click", () => this.#act(what, button));
      return button;
    });
    this.draw = () => this.#draw();
    this.answered = (/** @type {any} */ content) => { if (content.type === "done") this.#wait(false); };
    this.died = () => this.#gone("restarting");
    /** @type {StatusSlot} */
    this.changed = (_kernel, status) => { if (GONE[status]) this.#gone(status); };
    for (const name of ["offer", "version"]) model.on(`change:${name}`, this.draw);
    model.on("msg:custom", this.answered);
    model.on("comm_live_update", this.died);
    this.kernel = model.widget_manager?.kernel?.statusChanged;
    this.kernel?.connect?.(this.changed);
    this.#draw();
  }

  close() {
    clearTimeout(this.timer);
    for (const name of ["offer", "version"]) this.model.off(`change:${name}`, this.draw);
    this.model.off("msg:custom", this.answered);
    this.model.off("comm_live_update", this.died);
    this.kernel?.disconnect?.(this.changed);
    this.root.remove();
  }

  /**
   * @param {string} what
   * @param {HTMLButtonElement} button
   */
  #act(what, button) {
    if (this.isWaiting) return;
    if (what === "delete" && button.textContent !== SURE) {
      button.textContent = SURE;
      this.timer = setTimeout(() => this.#draw(), SURE_FOR);
      return;
    }
    this.#wait(true);
    this.model.send({ type: "act", what, version: this.model.get("version") });
  }

  /** @param {boolean} isWaiting */
  #wait(isWaiting) {
    this.isWaiting = isWaiting;
    for (const button of this.buttons) button.disabled = isWaiting;
  }

  /** @param {string} status */
  #gone(status) {
    this.fate = GONE[status];
    this.#draw();
  }

  #draw() {
    clearTimeout(this.timer);
    const offer = this.model.get("offer") || "", written = this.model.get("written");
    const found = written ? ` What was written by itself at ${written} is offered then, or stands under History.` : "";
    setText(this.text, this.fate ? `The kernel ${this.fate}: run the cell again.${found}` : offer);
    this.buttons.forEach((button, k) => {
      button.hidden = Boolean(this.fate);
      setText(button, RESTORE_BUTTONS[k][1]);
    });
    this.root.classList.toggle("dnb-restore-gone", Boolean(this.fate));
    this.root.hidden = !this.fate && !offer;
    this.#wait(false);
  }
}

export default {
  /** @param {{ model: NotebookModel, el: HTMLElement }} widget */
  render({ model, el }) {
    const view = new RestoreBarView(model, el);
    return () => view.close();
  },
};
