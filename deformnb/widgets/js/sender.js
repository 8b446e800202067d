// Edits on their way to Python: at most two in flight, the newest kept, the last of a drag always sent. No DOM.

const EDITS_IN_FLIGHT = 2;
const LOST_AFTER = 2000; // milliseconds without an answer, after which the kernel is taken to be busy or gone

class Sender {
  constructor(model, now = () => performance.now()) {
    Object.assign(this, { model, now, seq: 0, waiting: new Set(), pending: null, sentAt: 0, bytes: 0 });
  }

  move(points) {
    if (this.waiting.size && this.now() - this.sentAt > LOST_AFTER) this.waiting.clear();
    if (this.waiting.size >= EDITS_IN_FLIGHT) { this.pending = points; return; }
    this.#send("move", points);
  }

  end(points) {
    this.pending = null;
    this.#send("end", points);
  }

  done(seq) {
    this.waiting.delete(seq);
    if (this.pending === null || this.waiting.size >= EDITS_IN_FLIGHT) return;
    const points = this.pending;
    this.pending = null;
    this.#send("move", points);
  }

  #send(phase, points) {
    this.seq += 1;
    this.waiting.add(this.seq);
    this.sentAt = this.now();
    this.model.send({ type: "edit", seq: this.seq, phase, points });
  }
}
