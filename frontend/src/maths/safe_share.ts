// The search for the largest share of a drag that is allowed.

const NEAR = 1 / 16,
  CLOSE = 1 / 64, // shares of the way: the pointer is near where it was, and the stop is found as exactly as this
  CHECKS = 4e4, // of one movement, once a share is known that is allowed, by the square of the number of points
  PATIENCE = 3, // movements of a stopped drag of many points from one try to get further to the next
  MANY = 4, // checks of a movement: with fewer there are many points
  SHORTER = 0.9; // of the way that was refused: the pointer comes back, and may be where it is allowed

/** The most checks of one movement of a number of points, each of which fits all of them. */
export const checksOf = (points: number) => Math.max(1, Math.floor(CHECKS / (1 + points ** 2)));

/** The share of its way at which a drag stands, from one movement to the next. */
export class SafeShare {
  /** The share at which the drag stood last, and the one to try next. */
  #stood = 1 - NEAR;
  #next = 1 - NEAR;
  /** The length of the way that was refused last, and the movements since then. */
  #refused = 0;
  #since = 0;

  /** Forget the movements before: all of the way is allowed. */
  reset() {
    this.#stood = this.#next = 1 - NEAR;
    this.#refused = this.#since = 0;
  }

  /** Whether a stopped drag ends where it may not have been checked. The next movement is checked. */
  isOverdue() {
    const isOverdue = this.#since > 0;
    if (isOverdue) this.#since = PATIENCE;
    return isOverdue;
  }

  /**
   * Whether the whole way of a drag is refused. While a drag of many points is stopped and the pointer stays away, only
   * some of its movements are checked there.
   * @param way its length, and the most checks of a movement
   */
  refusesWay({ length, checks }: { length: number; checks: number }, check: () => boolean) {
    if (checks < MANY && this.#refused > 0 && this.#since < PATIENCE && length > SHORTER * this.#refused) {
      this.#since += 1;
      return true;
    }
    const isRefused = check();
    this.#refused = isRefused ? length : 0;
    this.#since = 0;
    return isRefused;
  }

  /**
   * The largest share that is allowed where the whole way is refused, from the shares of the movement before: of hundreds
   * of points one movement makes one or two checks. What is left to try is tried at a later movement.
   * @param most checks of this movement
   */
  find<S>(make: (share: number) => S, isRefused: (state: S) => boolean, most = MANY) {
    const isDue = most >= MANY || this.#refused === Infinity || this.#since === PATIENCE - 1; // not after the whole way
    let low = 0,
      high = 1,
      away = NEAR,
      checks = 0,
      stood = this.#stood,
      probe = isDue ? this.#next : stood;
    while (high - low > CLOSE && !(low > 0 && checks >= most)) {
      checks += 1;
      if (isRefused(make(probe))) high = probe;
      else low = probe;
      if (low > 0) probe = high < 1 ? (low + high) / 2 : Math.min((low + high) / 2, low + away);
      else if (stood < high) [probe, stood] = [stood, 1];
      else probe = Math.max(high / 2, high - away);
      away *= 2;
    }
    this.#stood = Math.max(CLOSE, low);
    // A way that is refused from its start needs one check at the next movement.
    const isOpen = low > 0 && high - low > CLOSE;
    if (isDue || !isOpen || high < 1) this.#next = isOpen ? probe : this.#stood;
    return low;
  }
}
