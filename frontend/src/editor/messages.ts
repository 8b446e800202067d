// Messages over the picture of an editor, temporary hints, and texts for screen readers.

import type { Sender } from "../sync/edits.ts";
import { buttonElement, named, pageElement, setText } from "../ui/dom.ts";

/** Messages about a kernel that does not answer, by the sender's status. */
const NO_ANSWER: Record<string, string> = {
  busy: "The kernel is busy; the volume in Python follows later",
  unanswered: "No answer from Python yet; these points stay in the browser until it answers",
  detached: "This view was loaded too slowly and receives nothing from Python: run the cell again",
  held: "Python is away: this page holds the edits, and sends them when it is back",
  lost: "The kernel was restarted or is gone: Python does not get these edits. Run the cell again",
};

const FINAL = new Set(["detached", "held", "lost"]); // these messages stay as long as the page is open
const LONGEST_TIMER = 2 ** 31 - 1; // milliseconds

/** The elements of the messages, which the editor places. */
export class Messages {
  tip = pageElement("div", "dnb-ed-hint", null, { hidden: "", "aria-hidden": "true" });

  alert = pageElement("div", "dnb-ed-alert", null, { role: "alert", hidden: "" });

  liveRegion = pageElement("div", "dnb-ed-spoken", null, { "aria-live": "polite" });

  /** Called before a message replaces the one over the picture. */
  onReplace: () => void = () => {};

  #tipTimer = 0;

  #alertTimer = 0;

  close() {
    for (const timer of [this.#tipTimer, this.#alertTimer]) clearTimeout(timer);
  }

  showStatus({ channel: { status } }: Sender) {
    const text = NO_ANSWER[status];
    if (text) this.hint(text, FINAL.has(status) ? LONGEST_TIMER : 8000);
    else if (Object.values(NO_ANSWER).includes(this.tip.textContent)) this.tip.hidden = true;
  }

  /** Show a message over the picture; a temporary one is hidden after a while. */
  show(message: string, isPassing = false) {
    this.onReplace();
    clearTimeout(this.#alertTimer);
    this.alert.hidden = !message;
    this.alert.textContent = message;
    if (message) buttonElement("dnb-ed-close", this.alert, "\u00d7", () => this.show(""), named("Close this message"));
    if (isPassing)
      this.#alertTimer = setTimeout(() => {
        this.alert.hidden = true;
      }, 8000);
  }

  /** Show a hint for some milliseconds. */
  hint(text: string, duration = 2500) {
    clearTimeout(this.#tipTimer);
    this.tip.hidden = false;
    this.tip.textContent = text;
    this.#tipTimer = setTimeout(() => {
      this.tip.hidden = true;
    }, duration);
  }

  /** Hide a hint early, if it is one of these. */
  hideHint(texts: string[]) {
    if (texts.includes(this.tip.textContent)) this.tip.hidden = true;
  }

  /** Give a text to screen readers. */
  announce(text: string) {
    setText(this.liveRegion, text);
  }
}
