// A slider from one drawing to another, which also plays by itself.

import { buttonElement, OWN_KEYS, pageElement, setText } from "../ui/dom.ts";

const PLAYED_MS = 2500; // from one end to the other

export class ShareSlider {
  readonly element: HTMLElement;
  readonly #input: HTMLInputElement;
  readonly #play: HTMLButtonElement;
  readonly #ends: [HTMLElement, HTMLElement];
  #frame = 0; // of the animation, 0 for none

  /** @param changed called with the share, from 0 to 1 */
  constructor(readonly changed: (share: number) => void) {
    this.element = pageElement("div", "dnb-th-slider");
    this.#play = buttonElement("dnb-page-button dnb-th-play", this.element, "Play", () =>
      this.#frame ? this.stop() : this.play(),
    );
    const first = pageElement("span", "dnb-th-end", this.element, { translate: "no" });
    this.#input = pageElement("input", "dnb-page-range", this.element, {
      type: "range",
      min: 0,
      max: 1,
      step: 0.01,
      name: "share",
      "aria-label": "Share of the deformation",
      ...OWN_KEYS,
    });
    this.#ends = [first, pageElement("span", "dnb-th-end", this.element, { translate: "no" })];
    this.#input.addEventListener("input", () => {
      this.stop();
      this.changed(Number(this.#input.value));
    });
  }

  /** Name what is at both ends. */
  name(first: string, second: string) {
    setText(this.#ends[0], first);
    setText(this.#ends[1], second);
  }

  /** Show a share, without a call. */
  set(share: number) {
    this.#input.value = String(share);
  }

  /** Move to the other end, at once where the user wants no motion. */
  play() {
    const from = Number(this.#input.value),
      to = from < 0.5 ? 1 : 0,
      still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    const begin = performance.now();
    const step = (now: number) => {
      const passed = still ? 1 : Math.min(1, Math.max(0, (now - begin) / (PLAYED_MS * Math.abs(to - from)))),
        share = from + (to - from) * passed;
      this.set(share);
      this.changed(share);
      this.#frame = passed < 1 ? requestAnimationFrame(step) : 0;
      setText(this.#play, this.#frame ? "Stop" : "Play");
    };
    this.#frame = requestAnimationFrame(step);
    setText(this.#play, "Stop");
  }

  stop() {
    cancelAnimationFrame(this.#frame);
    this.#frame = 0;
    setText(this.#play, "Play");
  }
}
