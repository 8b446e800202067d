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
  get seen() {
    const { count = 0, first = 0, spacing = 1 } = this.#model.get("slices") ?? {};
    return count > 0 ? { count, first, spacing, index: Number(this.#model.get("slice")) || 0 } : null;
  }

  /** Such as "slice 57 / 128, 12.0 mm"; empty where the picture is no slice. */
  get words() {
    const { seen } = this;
    if (!seen) return "";
    const depth = (seen.first + seen.index * seen.spacing).toFixed(1),
      { lengths = "" } = this.#model.get("raster");
    return `slice ${seen.index + 1} / ${seen.count}, ${depth} ${lengths}`.trim();
  }

  /**
   * Show another slice, unless it is the last one or something is being dragged; false where there are none.
   * @param by so many slices to the back
   */
  move(by: number, isDragging: boolean) {
    const { seen } = this;
    if (!seen) return false;
    const next = Math.max(0, Math.min(seen.count - 1, seen.index + by));
    if (next !== seen.index && !isDragging) {
      setTrait(this.#model, "slice", next);
      this.#messages.announce(this.words);
    }
    return true;
  }
}
