// The messages of an editor: one row below its pictures, and texts for screen readers.

import type { Sender } from "../sync/edits.ts";
import { pageElement, setText } from "../ui/dom.ts";
import { MessageRow } from "../ui/messages.ts";

/** Messages about a kernel that does not answer, by the sender's status. */
const NO_ANSWER: Record<string, string> = {
  busy: "The kernel is busy; the volume in Python follows later",
  unanswered: "No answer from Python yet; these points stay in the browser until it answers",
  detached: "This view was loaded too slowly and receives nothing from Python: run the cell again",
  held: "Python is away: this page holds the edits, and sends them when it is back",
  lost: "The kernel was restarted or is gone: Python does not get these edits. Run the cell again",
};

const FINAL = new Set(["detached", "held", "lost"]), // these messages stay as long as the page is open
  READABLE = 8000; // milliseconds

/** The row, which the editor places. */
export class Messages extends MessageRow {
  liveRegion = pageElement("div", "dnb-ed-spoken", null, { "aria-live": "polite" });

  constructor() {
    super(null);
  }

  showStatus({ channel: { status } }: Sender) {
    const isFinal = FINAL.has(status);
    this.set("kernel", NO_ANSWER[status] ?? "", isFinal ? { kind: "warning" } : { duration: READABLE });
  }

  /** Say that something has failed; what is temporary is withdrawn after a while. */
  show(message: string, isPassing = false) {
    this.#repeat("failure", message);
    this.set("failure", message, { kind: "error", ...(isPassing && { duration: READABLE }) });
  }

  /** Show a hint for some milliseconds. */
  hint(text: string, duration = 2500) {
    this.#repeat("hint", text);
    this.set("hint", text, { kind: "hint", duration });
  }

  /** Withdraw a hint early, if it is one of these. */
  hideHint(texts: string[]) {
    if (texts.includes(this.textOf("hint"))) this.set("hint", "");
  }

  /** Let a text that the user has closed come again: it is about something else. */
  #repeat(source: string, text: string) {
    if (this.textOf(source) !== text) this.set(source, "");
  }

  /** Give a text to screen readers. */
  announce(text: string) {
    setText(this.liveRegion, text);
  }
}
