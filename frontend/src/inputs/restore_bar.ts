// An offer to restore edits that were lost when a kernel died; and a message when the front end's Python has ended: what
// is saved, how to go on, and what can be done until then. The studio around the bar has a class meanwhile, which dims
// the controls that need Python; pictures stay and can be turned.
//
// Python owns the offer. Facts that a front end has of its kernel: the notebook's widget manager notifies each model
// that its comm is dead when the kernel is restarted by the user, and the kernel itself signals when it died and was
// started again, or when the connection to it is interrupted. The application's manager notifies the models of the end
// of its connection in the same way.

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
/** Class of a studio whose Python has ended. */
const WITHOUT_PYTHON = "dnb-without-python";
const GONE: Record<string, string> = {
  autorestarting: "The kernel was restarted.",
  restarting: "The kernel was restarted.",
  dead: "The kernel has died.",
  terminating: "The kernel was stopped.",
};
const NOT_SAVED = "Until then the pictures can be turned and points moved, which is not saved.";
const KEPT =
  "Start it again with the same file, and this page continues automatically. Points that are moved until then are sent to it.";
const INTERRUPTED = "The connection to the kernel is interrupted. Edits are sent when it is back.";

/** A signal of Lumino. */
export type StatusSignal = { connect?: (slot: StatusSlot) => void; disconnect?: (slot: StatusSlot) => void };
export type StatusSlot = (kernel: unknown, status: string) => void;
export type NotebookModel = Model & {
  widget_manager?: {
    kernel?: { statusChanged?: StatusSignal; connectionStatusChanged?: StatusSignal } | null;
    /** Of the application's manager */
    isApplication?: boolean;
  };
};

function sentences(...all: string[]) {
  return all.filter(Boolean).join(" ");
}

class RestoreBarView extends Widget {
  text: HTMLSpanElement;
  buttons: HTMLButtonElement[];

  timer = 0;
  isWaiting = false;
  fate = ""; // of the kernel or of the application
  isInterrupted = false;

  constructor(
    readonly model: NotebookModel,
    el: HTMLElement,
  ) {
    super(model, el, "dnb-restore", { role: "status" });
    this.text = pageElement("span", "dnb-restore-text", this.root);
    this.buttons = RESTORE_BUTTONS.map(([what, text, tip]) => {
      const name = `dnb-restore-button dnb-restore-${what}`;
      const button = buttonElement(name, this.root, text, () => this.#act(what, button), { title: tip });
      return button;
    });
    this.onChange(["offer", "version", "written"], () => this.draw());
    this.on("msg:custom", (content: RestoreBarToFrontEnd) => {
      if (content.type === "done") this.#wait(false);
    });
    this.on("comm_live_update", () => this.#showOutcome("restarting"));
    const kernel = model.widget_manager?.kernel;
    this.#follow(kernel?.statusChanged, (status) => this.#showOutcome(status));
    this.#follow(kernel?.connectionStatusChanged, (status) => {
      this.isInterrupted = status !== "connected";
      this.draw();
    });
    this.draw();
  }

  #follow(signal: StatusSignal | undefined, changed: (status: string) => void) {
    const slot: StatusSlot = (_kernel, status) => changed(status);
    signal?.connect?.(slot);
    this.closing.signal.addEventListener("abort", () => signal?.disconnect?.(slot));
  }

  close() {
    clearTimeout(this.timer);
    this.#dim(false);
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

  #dim(isGone: boolean) {
    this.host.closest(".dnb-studio")?.classList.toggle(WITHOUT_PYTHON, isGone);
  }

  /** What has happened to Python, what is saved, and how to go on; empty while it is there. */
  get #message() {
    const written = this.model.get("written"),
      isApplication = this.model.widget_manager?.isApplication;
    if (!this.fate) return this.isInterrupted ? INTERRUPTED : "";
    if (isApplication) {
      return sentences(
        "deformnb has ended, or does not answer.",
        written && `The last edit was autosaved at ${written}.`,
        KEPT,
      );
    }
    const again = document.querySelector("#rendered_cells") ? "Load the page again." : "Run the cell again."; // of Voila
    const saved = written && `The session autosaved at ${written} is offered then, or is under History.`;
    return sentences(this.fate, again, saved, NOT_SAVED);
  }

  draw() {
    clearTimeout(this.timer);
    const offer = this.model.get("offer") || "",
      message = this.#message;
    setText(this.text, message || offer);
    this.buttons.forEach((button, k) => {
      button.hidden = Boolean(message);
      setText(button, RESTORE_BUTTONS[k]![1]);
    });
    this.root.classList.toggle("dnb-restore-gone", Boolean(message));
    this.root.hidden = !message && !offer;
    this.#dim(Boolean(this.fate));
    this.#wait(false);
  }
}

export default widgetOf(RestoreBarView);
