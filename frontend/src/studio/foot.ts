// The foot of a studio's panes: its height, and which of the messages on its right are shown, the most dangerous first.

const FACTS = 26; // CSS pixels of the line over a message of the picture, and of the space around it
const MOST = 0.4; // of the panes' height, beyond which messages are scrolled

/** Below the picture. */
const SAID = ".dnb-pane-picture .dnb-ed-status > .dnb-messages";

/** Examples to begin with; messages of the studio, and questions with their answers; the rows of views of the volume. */
const PARTS =
  ":scope > .dnb-studio-start, .dnb-studio-messages :is(.dnb-row, .dnb-message), .dnb-view-pane > .dnb-messages[data-kind]";

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
const CHANGES = { subtree: true, childList: true, attributeFilter: ["data-kind", "class", "style"] };

export class PanesFoot {
  readonly #changes = new MutationObserver(() => this.arrange());
  readonly #closing = new AbortController();
  #hints = { width: 0, height: 0 }; // the highest, as long as the panes have this width: when one ends, nothing jumps
  #height = 0; // of what is below the picture
  #key = ""; // all that the last arrangement depends on

  /**
   * @param sizes observes what gives the foot its height
   * @param schedule calls arrange later
   */
  constructor(
    private readonly panes: HTMLElement,
    private readonly sizes: ResizeObserver,
    schedule: () => void,
  ) {
    const { signal } = this.#closing;
    for (const name of ["pointerup", "pointercancel"]) window.addEventListener(name, schedule, { signal });
  }

  /** Show the parts of one rank on the right, and give the foot the height of what it shows: a long message, or examples. */
  arrange() {
    const { panes } = this,
      find = (selector: string) => [...panes.querySelectorAll<HTMLElement>(selector)];
    for (const part of find(".dnb-studio-start, .dnb-studio-messages, .dnb-view-pane > .dnb-messages")) {
      this.#changes.observe(part, CHANGES);
      this.sizes.observe(part);
    }
    const parts = find(PARTS).filter((part) => !part.parentElement?.closest(".dnb-studio-messages .dnb-row")),
      rankOf = (part: HTMLElement) => RANKS.findIndex((selector) => part.matches(selector));
    const { clientWidth, clientHeight } = panes,
      isHeld = panes.matches(":active");
    const key = JSON.stringify([
      clientWidth,
      clientHeight,
      isHeld,
      parts.map((part) => [rankOf(part), part.className, part.style.cssText, part.textContent]),
      isHeld ? [] : find(SAID).map(({ textContent }) => textContent),
    ]);
    if (key === this.#key) return; // measuring lays out the studio twice, which a drag has no time for
    this.#key = key;
    for (const part of parts) part.removeAttribute("data-behind");
    for (const part of ["side", "status"] as const) this.#setHeight(part, 0); // or a part would be as high as the foot was
    const heights = new Map(parts.map((part) => [part, part.scrollHeight])),
      heightOf = (part: HTMLElement | undefined) => (part && heights.get(part)) ?? 0;
    const ranked = parts.filter(heightOf).sort((a, b) => rankOf(a) - rankOf(b)),
      isView = ranked[0]?.matches(".dnb-messages"),
      shown = isView ? ranked.slice(0, 1) : ranked.filter((part) => rankOf(part) === rankOf(ranked[0]!));
    for (const part of ranked) part.toggleAttribute("data-behind", !shown.includes(part));
    const start = parts.find((part) => part.matches(".dnb-studio-start")),
      total = shown.reduce((sum, part) => sum + heightOf(part), 0);
    this.#setHeight("side", Math.max(total, heightOf(start))); // also behind a message: the panes do not jump
    this.#setHeight("status", this.#statusHeight(find));
  }

  /** The height of what is below the picture; while something is dragged the picture keeps its own. */
  #statusHeight(find: (selector: string) => HTMLElement[]) {
    const { clientWidth: width } = this.panes,
      rows = find(SAID),
      highest = (some: HTMLElement[]) => Math.max(0, ...some.map(({ offsetHeight }) => offsetHeight));
    for (const row of rows) this.sizes.observe(row);
    if (!this.panes.matches(":active")) {
      const before = width === this.#hints.width ? this.#hints.height : 0,
        hint = highest(rows.filter((row) => row.dataset.kind === "hint"));
      this.#hints = { width, height: Math.max(hint, before) };
      this.#height = FACTS + Math.max(highest(rows), this.#hints.height);
    }
    return this.#height;
  }

  #setHeight(part: "side" | "status", height: number) {
    const most = Math.min(height, MOST * this.panes.clientHeight);
    this.panes.style.setProperty(`--dnb-foot-${part}`, `${Math.ceil(most)}px`);
  }

  close() {
    this.#changes.disconnect();
    this.#closing.abort();
  }
}
