// An offer to restore edits that were lost when a kernel died; and a message when the front end's kernel has died.
//
// Python owns the offer. Facts that a front end has of its kernel: the notebook's widget manager notifies each model
// that its comm is dead when the kernel is restarted by the user, and the kernel itself signals when it died and was
// started again. Other hosts signal nothing.

import type { RestoreBarToFrontEnd, RestoreCommand } from "../generated.ts";
import type { Model } from "../types.ts";

import { buttonElement, pageElement, setText } from "../ui/dom.ts";
import { Widget, widgetOf } from "../ui/widget.ts";

/** Command, text, tip */
const RESTORE_BUTTONS: [RestoreCommand["what"], string, string][] = [
  ["restore", "Restore", "Go on with it; can be undone"],
  ["skip", "Skip", "Don't show again; it stays under History"],
  ["delete", "Delete", "Remove its file"],
];
const SURE = "Delete for good?";
const SURE_FOR = 5000; // ms in which a second click deletes
const GONE: Record<string, string> = {
  autorestarting: "was restarted",
  restarting: "was restarted",
  dead: "has died",
  terminating: "was stopped",
};

/** A signal of Lumino. */
export type StatusSignal = { connect?: (slot: StatusSlot) => void; disconnect?: (slot: StatusSlot) => void };
export type StatusSlot = (kernel: unknown, status: string) => void;
export type NotebookModel = Model & { widget_manager?: { kernel?: { statusChanged?: StatusSignal } | null } };

class RestoreBarView extends Widget {
  text: HTMLSpanElement;
  buttons: HTMLButtonElement[];

  timer = 0;
  isWaiting = false;
  fate = ""; // of the kernel

  constructor(model: NotebookModel, el: HTMLElement) {
    super(model, el, "dnb-restore", { role: "status" });
    this.text = pageElement("span", "dnb-restore-text", this.root);
    this.buttons = RESTORE_BUTTONS.map(([what, text, tip]) => {
      const name = `dnb-restore-button dnb-restore-${what}`;
      const button = buttonElement(name, this.root, text, () => this.#act(what, button), { title: tip });
      return button;
    });
    this.onChange(["offer", "version"], () => this.draw());
    this.on("msg:custom", (content: RestoreBarToFrontEnd) => {
      if (content.type === "done") this.#wait(false);
    });
    this.on("comm_live_update", () => this.#showOutcome("restarting"));
    const kernel = model.widget_manager?.kernel?.statusChanged,
      changed: StatusSlot = (_kernel, status) => this.#showOutcome(status);
    kernel?.connect?.(changed);
    this.closing.signal.addEventListener("abort", () => kernel?.disconnect?.(changed));
    this.draw();
  }

  close() {
    clearTimeout(this.timer);
    super.close();
  }

  #act(what: RestoreCommand["what"], button: HTMLButtonElement) {
    if (this.isWaiting) return;
    if (what === "delete" && button.textContent !== SURE) {
      button.textContent = SURE;
      this.timer = setTimeout(() => this.draw(), SURE_FOR);
      return;
    }
    this.#wait(true);
    this.model.send({ type: "act", what, version: this.model.get("version") } satisfies RestoreCommand);
  }

  #wait(isWaiting: boolean) {
    this.isWaiting = isWaiting;
    for (const button of this.buttons) button.disabled = isWaiting;
  }

  #showOutcome(status: string) {
    const fate = GONE[status];
    if (!fate) return;
    this.fate = fate;
    this.draw();
  }

  draw() {
    clearTimeout(this.timer);
    const offer = this.model.get("offer") || "",
      written = this.model.get("written");
    const found = written ? ` The session autosaved at ${written} is offered then, or is under History.` : "";
    setText(this.text, this.fate ? `The kernel ${this.fate}: run the cell again.${found}` : offer);
    this.buttons.forEach((button, k) => {
      button.hidden = Boolean(this.fate);
      setText(button, RESTORE_BUTTONS[k]![1]);
    });
    this.root.classList.toggle("dnb-restore-gone", Boolean(this.fate));
    this.root.hidden = !this.fate && !offer;
    this.#wait(false);
  }
}

export default widgetOf(RestoreBarView);
