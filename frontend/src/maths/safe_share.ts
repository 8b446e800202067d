// The search for the largest share of a drag that is allowed.

const NEAR = 1 / 16,
  CLOSE = 1 / 64, // shares of the way: the hand is near where it was, and the stop is found as exactly as this
  CHECKS_MS = 12; // of one movement, once a share is known that is allowed

/** The share of its way at which a drag stands, from one movement to the next. */
export class SafeShare {
  /** The share at which the drag stood last, and the one to try next. */
  #stood = 1 - NEAR;
  #next = 1 - NEAR;

  /** Forget the movements before: all of the way is allowed. */
  reset() {
    this.#stood = this.#next = 1 - NEAR;
  }

  /**
   * The largest share that is allowed where the whole way is refused, from the shares of the movement before: each check
   * fits all points, and of hundreds of points one movement makes two or three. What is left to try is tried at the next
   * movement.
   */
  find<S>(make: (share: number) => S, isRefused: (state: S) => boolean) {
    const end = performance.now() + CHECKS_MS;
    let low = 0,
      high = 1,
      away = NEAR,
      stood = this.#stood,
      probe = this.#next;
    while (high - low > CLOSE && !(low > 0 && performance.now() > end)) {
      if (isRefused(make(probe))) high = probe;
      else low = probe;
      if (low > 0) probe = high < 1 ? (low + high) / 2 : Math.min((low + high) / 2, low + away);
      else if (stood < high) [probe, stood] = [stood, 1];
      else probe = Math.max(high / 2, high - away);
      away *= 2;
    }
    this.#stood = Math.max(CLOSE, low);
    // A way that is refused from its start needs one check at the next movement.
    this.#next = low > 0 && high - low > CLOSE ? probe : this.#stood;
    return low;
  }
}
