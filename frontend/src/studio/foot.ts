// The foot of a studio's panes: its height, and which of the messages on its right are shown, the most dangerous first.

const FACTS = 28; // CSS pixels of the line over a message of the picture, and of the space around it
const MOST = 0.4; // of the panes' height, beyond which messages are scrolled

/** Examples to begin with; messages of the studio, and questions with their answers; the rows of views of the volume. */
const PARTS =
  ":scope > .dnb-studio-start, .dnb-studio-messages :is(.dnb-row, .dnb-message), .dnb-pane-volume .dnb-messages[data-kind]";

/**
 * The most dangerous first. An error that was reported stays beside a question, which wants an answer; the examples come
 * before what a view says of its picture.
 */
const RANKS = [
  "[data-kind='error']",
  ".dnb-row, .dnb-message-error",
  "[data-kind='warning']",
  ".dnb-message",
  ".dnb-studio-start",
  ".dnb-messages",
];

/** What changes when a message comes or goes. */
const CHANGES = { subtree: true, childList: true, attributeFilter: ["data-kind", "style"] };

export class PanesFoot {
  readonly #changes = new MutationObserver(() => this.arrange());

  /** @param sizes observes what gives the foot its height */
  constructor(
    private readonly panes: HTMLElement,
    private readonly sizes: ResizeObserver,
  ) {}

  /** Show the parts of one rank on the right, and give the foot the height of what it shows: a long message, or examples. */
  arrange() {
    const { panes } = this,
      find = (selector: string) => [...panes.querySelectorAll<HTMLElement>(selector)];
    for (const part of find(".dnb-studio-start, .dnb-studio-messages, .dnb-messages")) {
      this.#changes.observe(part, CHANGES);
      this.sizes.observe(part);
    }
    const parts = find(PARTS).filter((part) => !part.parentElement?.closest(".dnb-studio-messages .dnb-row")),
      rankOf = (part: HTMLElement) => RANKS.findIndex((selector) => part.matches(selector));
    for (const part of parts) part.removeAttribute("data-behind");
    const heights = new Map(parts.map((part) => [part, part.scrollHeight])),
      heightOf = (part: HTMLElement | undefined) => (part && heights.get(part)) ?? 0;
    const ranked = parts.filter(heightOf).sort((a, b) => rankOf(a) - rankOf(b)),
      isView = ranked[0]?.matches(".dnb-messages"),
      shown = isView ? ranked.slice(0, 1) : ranked.filter((part) => rankOf(part) === rankOf(ranked[0]!));
    for (const part of parts) part.toggleAttribute("data-behind", !shown.includes(part));
    const start = parts.find((part) => part.matches(".dnb-studio-start")),
      alert = find(".dnb-pane-picture .dnb-ed-status > .dnb-ed-alert")[0];
    if (alert) this.sizes.observe(alert);
    const most = Math.max(
      shown.reduce((sum, part) => sum + heightOf(part), 0),
      heightOf(start), // also behind a message: the panes do not jump
      alert && !alert.hidden ? alert.offsetHeight + FACTS : 0,
    );
    panes.style.setProperty("--dnb-foot-side", `${Math.ceil(Math.min(most, MOST * panes.clientHeight))}px`);
  }

  close() {
    this.#changes.disconnect();
  }
}
