// The steps that Ctrl+Z takes back in a front end. Python has a history of its own: deformnb.session.history.

/**
 * Undo as a list of old states. Edits of one kind in quick succession (arrow keys) count as one.
 * @template S
 */
export class History {
  constructor(most = 200) {
    /** @type {S[]} */
    this.past = [];
    /** @type {S[]} */
    this.future = [];
    this.most = most;
    /** @type {string | null} */
    this.kind = null;
    this.at = -Infinity;
  }

  /**
   * Record an edit; returns whether it joins the edit before it.
   * @param {S} before  the state that the edit leaves
   * @param {string | null} [kind]  null never joins
   * @param {number} [now]  milliseconds
   */
  record(before, kind = null, now = Date.now()) {
    const joins = kind !== null && kind === this.kind && now - this.at < 800 && this.past.length > 0;
    if (!joins) this.past.push(before);
    if (this.past.length > this.most) this.past.shift();
    this.future = [];
    this.kind = kind;
    this.at = now;
    return joins;
  }

  /** @param {S} current */
  undo(current) { return this.#step(this.past, this.future, current); }

  /** @param {S} current */
  redo(current) { return this.#step(this.future, this.past, current); }

  /** @param {S[]} from @param {S[]} to @param {S} current */
  #step(from, to, current) {
    const state = from.pop();
    if (state === undefined) return null;
    to.push(current);
    this.kind = null;
    return state;
  }
}
