// A value on its way to Python: movements at most two in flight, the newest kept; ends always sent, and none waits behind
// a movement. Python says in what it shows which end of each page it has seen last: until that is ours, what it shows is
// from before, and the hand goes first. No DOM.

const MOVES_IN_FLIGHT = 2;
const LOST_AFTER = 2000; // milliseconds without an answer, after which movements go on without
const TRUSTED_FOR = 10000; // milliseconds for which an end of ours goes before what Python shows

class EditLink {
  constructor(send, now = () => performance.now()) {
    Object.assign(this, { post: send, now, id: Math.random().toString(36).slice(2, 12), seq: 0, last: 0, endedAt: 0,
      waiting: new Set(), pending: null, sentAt: 0 });
  }

  move(value) {
    if (this.waiting.size && this.now() - this.sentAt > LOST_AFTER) this.waiting.clear();
    if (this.waiting.size >= MOVES_IN_FLIGHT) { this.pending = value; return; }
    this.#send("move", value);
  }

  end(value) {
    this.pending = null;
    this.#send("end", value);
    this.last = this.seq;
    this.endedAt = this.now();
  }

  done(seq) {
    this.waiting.delete(seq);
    if (this.pending === null || this.waiting.size >= MOVES_IN_FLIGHT) return;
    const value = this.pending;
    this.pending = null;
    this.#send("move", value);
  }

  isBehind(seen) { return (seen?.[this.id] ?? 0) < this.last && this.now() - this.endedAt < TRUSTED_FOR; }

  #send(phase, value) {
    this.seq += 1;
    if (phase === "move") { this.waiting.add(this.seq); this.sentAt = this.now(); }
    this.post({ type: "edit", seq: this.seq, view: this.id, phase, value });
  }
}
