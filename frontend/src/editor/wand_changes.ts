// The extent of the wand's region: through the depth, its holes filled, its outline smoothed, grown or shrunk, and its largest piece alone.

import { MOST_CHANGES, type WandRequest } from "../generated.ts";
import type { OptionBar } from "./option_bar.ts";

export class WandChanges {
  through: HTMLInputElement;
  fill: HTMLInputElement;
  largest: HTMLInputElement;
  #smooth = 0;
  #grow = 0;

  /** @param apply called after each change */
  constructor(
    bar: OptionBar,
    readonly apply: () => void,
  ) {
    const tip = "What is connected in the volume, not only in this picture";
    this.through = bar.checkbox("Through the depth", tip, apply);
    this.fill = bar.checkbox("Fill holes", "Holes inside the region belong to it", apply);
    this.fill.checked = true;
    bar.button("Smooth", "Smooth", () => this.#change(1, 0), "Smooth the outline, more with each press");
    bar.button("Grow", "Grow", () => this.#change(0, 1), "One pixel larger with each press");
    bar.button("Shrink", "Shrink", () => this.#change(0, -1), "One pixel smaller with each press");
    this.largest = bar.checkbox("Largest only", "Only the largest of the pieces", apply);
  }

  /** The changes as a message has them. */
  get values(): Pick<WandRequest, "through" | "fill" | "smooth" | "grow" | "largest"> {
    return {
      through: this.through.checked,
      fill: this.fill.checked,
      largest: this.largest.checked,
      smooth: this.#smooth,
      grow: this.#grow,
    };
  }

  /** Another region begins: only whether holes are filled stays. */
  reset() {
    this.#smooth = this.#grow = 0;
    this.largest.checked = false;
  }

  /** @param pieces of the region: with one there is no largest */
  show(pieces: number) {
    this.largest.parentElement?.toggleAttribute("hidden", pieces < 2 && !this.largest.checked);
  }

  #change(smooth: number, grow: number) {
    this.#smooth = Math.min(MOST_CHANGES, this.#smooth + smooth);
    this.#grow = Math.max(-MOST_CHANGES, Math.min(MOST_CHANGES, this.#grow + grow));
    this.apply();
  }
}
