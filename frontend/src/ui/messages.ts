// The messages of a pane in one row, one at a time: the most dangerous first, another one by a button.

import { buttonElement, named, pageElement, setText } from "./dom.ts";

/** Failures, what spoils the result, and facts: the most dangerous first. */
const KINDS = ["error", "warning", "info"] as const;
export type MessageKind = (typeof KINDS)[number];

interface MessageOptions {
  kind?: MessageKind;
  /** A button beside the text: its name, and what it does */
  action?: [name: string, act: () => void];
  /** Milliseconds after which it is withdrawn */
  duration?: number;
}

type Message = Required<Pick<MessageOptions, "kind">> & Pick<MessageOptions, "action"> & { text: string };

export class Messages {
  root: HTMLDivElement;
  #text: HTMLSpanElement;
  #action: HTMLElement;
  #next: HTMLElement;
  #close: HTMLElement;
  /** By their sources, in the order in which they came */
  #all = new Map<string, Message>();
  /** Texts that were closed by their sources: such a source is silent until it has another text */
  #closed = new Map<string, string>();
  #timers = new Map<string, number>();
  #source = ""; // of the one that is shown

  constructor(parent: ParentNode) {
    this.root = pageElement("div", "dnb-messages", parent);
    this.#text = pageElement("span", "dnb-messages-text", this.root, { role: "status" }); // there from the start: so it is read out
    const button = (name: string, text: string, act: () => void, attributes = {}) =>
      buttonElement(`dnb-messages-button dnb-messages-${name}`, this.root, text, act, { hidden: "", ...attributes });
    this.#action = button("action", "", () => this.#all.get(this.#source)?.action?.[1]());
    this.#next = button("next", "", () => this.#showNext(), named("Next message"));
    this.#close = button("close", "\u00d7", () => this.#closeShown(), named("Close this message"));
  }

  /** Show the message of a source in place of its one before; an empty text withdraws that. */
  set(source: string, text: string, { kind = "info", action, duration }: MessageOptions = {}) {
    clearTimeout(this.#timers.get(source));
    if (duration && text)
      this.#timers.set(
        source,
        setTimeout(() => this.set(source, ""), duration),
      );
    const before = this.#all.get(source);
    if (this.#closed.get(source) !== text) this.#closed.delete(source);
    if (!text) this.#all.delete(source);
    else if (!this.#closed.has(source)) this.#all.set(source, { text, kind, ...(action && { action }) });
    if (before?.text !== this.#all.get(source)?.text) this.#source = ""; // what is new may be more dangerous
    this.#show();
  }

  /** The sources of all that are not closed, as they are shown one after the other. */
  get #sources() {
    const rank = ([, { kind }]: [string, Message]) => KINDS.indexOf(kind);
    return [...this.#all].sort((a, b) => rank(a) - rank(b)).map(([source]) => source);
  }

  #show() {
    const sources = this.#sources;
    if (!sources.includes(this.#source)) this.#source = sources[0] ?? "";
    const shown = this.#all.get(this.#source);
    if (shown) this.root.dataset.kind = shown.kind;
    else delete this.root.dataset.kind;
    setText(this.#text, shown?.text ?? "");
    setText(this.#action, shown?.action?.[0] ?? "");
    setText(this.#next, sources.length < 2 ? "" : `${sources.indexOf(this.#source) + 1} / ${sources.length}`);
    this.#action.hidden = !shown?.action;
    this.#next.hidden = sources.length < 2;
    this.#close.hidden = !shown;
  }

  #showNext() {
    const sources = this.#sources;
    this.#source = sources[(sources.indexOf(this.#source) + 1) % sources.length] ?? "";
    this.#show();
  }

  #closeShown() {
    const text = this.#all.get(this.#source)?.text ?? "";
    this.#closed.set(this.#source, text);
    this.#all.delete(this.#source);
    this.#show();
  }

  close() {
    for (const timer of this.#timers.values()) clearTimeout(timer);
    this.root.remove();
  }
}
