// Throttled requests of pictures: at the rate at which pictures arrive, and the newest only.

import type { PicturesWanted, Seen, SlicesMoved } from "../generated.ts";
import type { Model } from "../types.ts";

const SLOW_PICTURES = 500; // milliseconds after which a message reports that pictures are being made
const LOOK_PATIENCE = 400; // milliseconds after which a place is sent although pictures of the last one have not come

/** A request for the pictures. */
export type ViewRequest = Pick<SlicesMoved, "cursor" | "projection" | "original" | "window">;

export class PictureRequests {
  shownCount = 0; // of the messages with pictures
  isSlow = false; // whether pictures have been waited for long

  /** The pending request. */
  pending: (ViewRequest & { moving: boolean }) | null = null;

  #sent = new Set<string>(); // places
  #since = -Infinity; // milliseconds: the last request without an answer
  #timer = 0;
  #slowTimer = 0;

  /**
   * @param view its id
   * @param changed called when `isSlow` has changed
   */
  constructor(
    readonly model: Model,
    readonly view: string,
    readonly changed: () => void,
  ) {}

  close() {
    for (const timer of [this.#slowTimer, this.#timer]) clearTimeout(timer);
  }

  /** Request the first pictures. */
  begin() {
    this.model.send({ type: "hello", view: this.view } satisfies PicturesWanted);
    this.#expect();
  }

  /** The first pictures of a large volume take seconds, as do those of a projection. */
  #expect() {
    clearTimeout(this.#slowTimer);
    this.#slowTimer = setTimeout(() => {
      this.isSlow = true;
      this.changed();
    }, SLOW_PICTURES);
  }

  look(what: ViewRequest, isMoving = false) {
    this.pending = { ...this.pending, ...what, moving: isMoving };
    if ("projection" in what || "original" in what) this.#expect();
    this.#send();
  }

  #send() {
    clearTimeout(this.#timer);
    if (!this.pending) return;
    const now = performance.now(),
      since = now - this.#since;
    if (since < LOOK_PATIENCE) {
      this.#timer = setTimeout(() => this.#send(), LOOK_PATIENCE - since);
      return;
    }
    this.#since = now;
    if (this.pending.cursor) this.#sent.add(JSON.stringify(this.pending.cursor));
    for (const oldest of [...this.#sent].slice(0, -20)) this.#sent.delete(oldest);
    this.model.send({ type: "look", view: this.view, ...this.pending } satisfies SlicesMoved);
    this.pending = null;
  }

  /** Whether a place that comes from Python is one that was sent, or older than a pending one. */
  knows(place: unknown) {
    return this.#sent.delete(JSON.stringify(place)) || this.pending !== null;
  }

  /** Pictures have arrived and are shown; `seq` is the number of their message. */
  confirm(seq: number) {
    clearTimeout(this.#slowTimer);
    if (this.isSlow) {
      this.isSlow = false;
      this.changed();
    }
    this.shownCount += 1;
    if (seq) this.model.send({ type: "seen", view: this.view, seq } satisfies Seen);
    this.#since = -Infinity;
    this.#send();
  }
}
