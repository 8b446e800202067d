// The messages of a pane in one row, one at a time: the most dangerous first, another one by a button.

import { buttonElement, named, pageElement, setAttributes, setText } from "./dom.ts";

/** Failures, what spoils the result, hints, which pass, facts, and the next step where there is nothing else to say. */
const KINDS = ["error", "warning", "hint", "info", "advice"] as const;
export type MessageKind = (typeof KINDS)[number];

/** How screen readers take them: who acts by the keyboard hears of it in other words. */
const SPOKEN: Record<MessageKind, string> = {
  error: "assertive",
  warning: "polite",
  hint: "off",
  info: "polite",
  advice: "off",
};

/** A button beside a text. */
export interface MessageAction {
  name: string;
  text: string;
  tip?: string;
  act: () => void;
}

interface MessageOptions {
  kind?: MessageKind;
  actions?: MessageAction[];
  /** Called when the user closes it */
  closed?: () => void;
  /** Milliseconds after which it is withdrawn */
  duration?: number;
}

type Message = Required<Pick<MessageOptions, "kind" | "actions">> & Pick<MessageOptions, "closed"> & { text: string };

export class MessageRow {
  root: HTMLDivElement;
  #text: HTMLSpanElement;
  #buttons: HTMLSpanElement;
  #next: HTMLElement;
  #close: HTMLElement;
  /** By their sources, in the order in which their texts came */
  #all = new Map<string, Message>();
  /** Texts that were closed by their sources: such a source is silent until it has another text */
  #closed = new Map<string, string>();
  #timers = new Map<string, number>();
  #source = ""; // of the one that is shown

  constructor(parent: ParentNode | null) {
    this.root = pageElement("div", "dnb-messages", parent);
    const body = pageElement("div", "dnb-messages-body", this.root);
    this.#text = pageElement("span", "dnb-messages-text", body, { role: "status" }); // there from the start: so it is read out
    this.#buttons = pageElement("span", "dnb-messages-actions", body);
    const button = (name: string, text: string, act: () => void, tip: string) =>
      buttonElement(`dnb-messages-button dnb-messages-${name}`, this.root, text, act, { hidden: "", ...named(tip) });
    this.#next = button("next", "", () => this.#showNext(), "Next message");
    this.#close = button("close", "\u00d7", () => this.#closeShown(), "Close this message");
  }

  /** Show the message of a source in place of its one before; an empty text withdraws that. */
  set(source: string, text: string, { kind = "info", actions = [], closed, duration }: MessageOptions = {}) {
    clearTimeout(this.#timers.get(source));
    this.#timers.delete(source);
    if (duration && text)
      this.#timers.set(
        source,
        setTimeout(() => this.set(source, ""), duration),
      );
    const before = this.#all.get(source);
    if (this.#closed.get(source) !== text) this.#closed.delete(source);
    if (this.#closed.has(source) || (!text && !before)) return;
    const isSame = before?.text === text;
    if (!isSame) this.#all.delete(source);
    if (text) this.#all.set(source, { text, kind, actions, ...(closed && { closed }) });
    if (isSame && before.kind === kind && namesOf(before) === namesOf({ actions })) return;
    if (!isSame) this.#source = ""; // what is new may be more dangerous
    this.#show();
  }

  /** What a source says now. */
  textOf(source: string) {
    return this.#all.get(source)?.text ?? "";
  }

  /** The sources of all that are not closed, as they are shown one after the other: of a kind the newest first. */
  get #sources() {
    const rank = ([, { kind }]: [string, Message]) => KINDS.indexOf(kind);
    const all = [...this.#all].reverse().sort((a, b) => rank(a) - rank(b)),
      said = all.filter(([, { kind }]) => kind !== "advice");
    return (said.length ? said : all).map(([source]) => source);
  }

  #show() {
    const sources = this.#sources;
    if (!sources.includes(this.#source)) this.#source = sources[0] ?? "";
    const shown = this.#all.get(this.#source);
    if (shown) {
      this.root.dataset.kind = shown.kind;
      setAttributes(this.#text, { "aria-live": SPOKEN[shown.kind] });
    } else delete this.root.dataset.kind;
    setText(this.#text, shown?.text ?? "");
    this.#showActions(shown?.actions ?? []);
    setText(this.#next, sources.length < 2 ? "" : `${sources.indexOf(this.#source) + 1} / ${sources.length}`);
    this.#next.hidden = sources.length < 2;
    this.#close.hidden = !shown || shown.kind === "advice";
  }

  #showActions(actions: MessageAction[]) {
    const key = `${this.#source}: ${namesOf({ actions })}`;
    if (this.#buttons.dataset.key === key) return; // one of them may have the focus
    this.#buttons.dataset.key = key;
    this.#buttons.replaceChildren();
    for (const [index, { name, text, tip }] of actions.entries()) {
      const act = () => this.#all.get(this.#source)?.actions[index]?.act();
      const attributes = { "data-action": name, ...(tip && { title: tip }) };
      buttonElement("dnb-messages-button dnb-messages-action", this.#buttons, text, act, attributes);
    }
  }

  #showNext() {
    const sources = this.#sources;
    this.#source = sources[(sources.indexOf(this.#source) + 1) % sources.length] ?? "";
    this.#show();
  }

  #closeShown() {
    const source = this.#source,
      shown = this.#all.get(source);
    if (!this.#timers.has(source)) this.#closed.set(source, shown?.text ?? "");
    this.#all.delete(source);
    this.#show();
    shown?.closed?.();
  }

  close() {
    for (const timer of this.#timers.values()) clearTimeout(timer);
    this.root.remove();
  }
}

function namesOf({ actions }: { actions: MessageAction[] }) {
  return JSON.stringify(actions.map(({ name, text }) => [name, text]));
}
