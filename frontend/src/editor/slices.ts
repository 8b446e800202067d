// The slices of a volume, one of which the editor's picture is. Python makes the pictures.

import { setTrait } from "../sync/edits.ts";
import type { Model } from "../types.ts";
import type { Messages } from "./messages.ts";

export class Slices {
  #model: Model;

  #messages: Messages;

  constructor(model: Model, messages: Messages) {
    this.#model = model;
    this.#messages = messages;
  }

  /** The slices, one of which is visible; null for another projection. */
  get current() {
    const { count = 0, first = 0, spacing = 1 } = this.#model.get("slices") ?? {};
    return count > 0 ? { count, first, spacing, index: Number(this.#model.get("slice")) || 0 } : null;
  }

  /** Such as "slice 57 / 128, 12.0 mm"; empty where the picture is no slice. */
  get words() {
    const { current } = this;
    if (!current) return "";
    const depth = (current.first + current.index * current.spacing).toFixed(1),
      { lengths = "" } = this.#model.get("raster");
    return `slice ${current.index + 1} / ${current.count}, ${depth} ${lengths}`.trim();
  }

  /**
   * Show another slice, unless it is the last one or something is being dragged; false where there are none.
   * @param by so many slices to the back
   */
  move(by: number, isDragging: boolean) {
    const { current } = this;
    if (!current) return false;
    const next = Math.max(0, Math.min(current.count - 1, current.index + by));
    if (next !== current.index && !isDragging) {
      setTrait(this.#model, "slice", next);
      this.#messages.announce(this.words);
    }
    return true;
  }
}
