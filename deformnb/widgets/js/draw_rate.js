// How the picture follows a hand: pictures a second while points move, and milliseconds from a movement to its picture.
// No DOM. What was measured goes to Python with the edit that ends the drag, for no message is worth a drag's time.

const FEWEST_PICTURES = 4; // of a drag, below which a rate says nothing
const MOST_PICTURES = 1200;
const PAUSE = 400; // milliseconds: a hand that rests is not followed slowly

class DrawRate {
  constructor() { this.forget(); }

  forget() { Object.assign(this, { asked: null, last: null, spans: [], waits: [] }); }

  /** A hand has moved points, at this time in milliseconds. */
  moved(now) { this.asked ??= now; }

  /** The picture of what was moved last is drawn. */
  drew(now) {
    if (this.asked === null) return;
    this.waits.push(now - this.asked);
    if (this.last !== null && now - this.last < PAUSE) this.spans.push(now - this.last);
    Object.assign(this, { last: now, asked: null });
    for (const list of [this.waits, this.spans]) if (list.length > MOST_PICTURES) list.shift();
  }

  /** {hz, ms} of the drag that ends now, or null after a short one; the next begins anew. */
  taken() {
    const { spans, waits } = this, middle = (list) => [...list].sort((a, b) => a - b)[list.length >> 1];
    this.forget();
    if (waits.length < FEWEST_PICTURES || spans.length === 0) return null;
    const mean = spans.reduce((sum, span) => sum + span, 0) / spans.length;
    return { hz: Math.round(10000 / Math.max(mean, 1)) / 10, ms: Math.round(10 * middle(waits)) / 10 };
  }
}
