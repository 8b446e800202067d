// The steps that Ctrl+Z reverts in a front end. Python has a separate history: deformnb.session.history.

/** Undo as a list of old states. Edits of one kind in quick succession (arrow keys) count as one. */
export class History<S> {
  past: S[] = [];
  future: S[] = [];
  kind: string | null = null;
  at = -Infinity;

  constructor(readonly most: number = 200) {}

  /**
   * Record an edit; returns whether it joins the edit before it.
   * @param before the state that the edit leaves
   * @param kind null never joins
   * @param now milliseconds
   */
  record(before: S, kind: string | null = null, now: number = Date.now()) {
    const joins = kind !== null && kind === this.kind && now - this.at < 800 && this.past.length > 0;
    if (!joins) this.past.push(before);
    if (this.past.length > this.most) this.past.shift();
    this.future = [];
    this.kind = kind;
    this.at = now;
    return joins;
  }

  undo(current: S) {
    return this.#step(this.past, this.future, current);
  }

  redo(current: S) {
    return this.#step(this.future, this.past, current);
  }

  #step(from: S[], to: S[], current: S) {
    const state = from.pop();
    if (state === undefined) return null;
    to.push(current);
    this.kind = null;
    return state;
  }
}
