// The frames of an editor: what it draws, when, and whether something moves. And the rate at which pictures follow the
// pointer, which is sent to Python with the edit that ends a drag: a separate message would cost the drag time.

import type { Messages } from "./messages.ts";

const FEWEST_PICTURES = 4; // of a drag, below which a rate means nothing
const MOST_PICTURES = 1200;
const PAUSE = 400; // milliseconds: after such a rest of the pointer the next picture is not a slow one

/** Pictures a second while points move, and milliseconds from a movement to its picture. No DOM. */
export class DrawRate {
  movedAt: number | null = null;

  last: number | null = null;

  spans: number[] = [];

  waits: number[] = [];

  /** The pointer has moved points, at this time in milliseconds. */
  recordMove(now: number) {
    this.movedAt ??= now;
  }

  /** The picture of the last movement is drawn. */
  recordFrame(now: number) {
    if (this.movedAt === null) return;
    this.waits.push(now - this.movedAt);
    if (this.last !== null && now - this.last < PAUSE) this.spans.push(now - this.last);
    Object.assign(this, { last: now, movedAt: null });
    for (const list of [this.waits, this.spans]) if (list.length > MOST_PICTURES) list.shift();
  }

  /** {hz, ms} of the drag that ends now, or null after a short one; the next starts from zero. */
  finish() {
    const { spans, waits } = this;
    Object.assign(this, { movedAt: null, last: null, spans: [], waits: [] });
    if (waits.length < FEWEST_PICTURES || spans.length === 0) return null;
    const mean = spans.reduce((sum, span) => sum + span, 0) / spans.length;
    const middle = waits.sort((a, b) => a - b)[waits.length >> 1]!;
    return { hz: Math.round(10000 / Math.max(mean, 1)) / 10, ms: Math.round(10 * middle) / 10 };
  }
}

const LONGEST_GAP = 25; // ms between two pictures of a movement, where a view draws on the same processors

const REST = 120; // milliseconds after which the full picture is drawn

/** Requests of frames, and actions whose errors are shown. */
export class Frames {
  request = 0; // of the next frame, or 0

  isMoving = false; // whether something has moved within the last moments

  isResting = false; // whether the next frame is the first after a movement: its full picture takes all of it

  rate = new DrawRate();

  #restTimer = 0;

  #next = 0; // when the next picture of a movement may be drawn

  constructor(
    private readonly messages: Messages,
    private readonly draw: () => void,
    private readonly isShared: () => boolean = () => false,
  ) {}

  close() {
    cancelAnimationFrame(this.request);
    clearTimeout(this.#restTimer);
  }

  /** Run an action: an error is shown in the widget, and the editor continues. */
  guard<T>(action: () => T) {
    try {
      return action();
    } catch (error) {
      console.error(error);
      this.messages.show(`The editor met an error: ${error instanceof Error ? error.message : error}`);
      return undefined;
    }
  }

  /** Call a handler at an event; an error of it is shown. */
  listen<K extends keyof HTMLElementEventMap>(
    target: EventTarget,
    name: K,
    handler: (event: HTMLElementEventMap[K]) => void,
    options: AddEventListenerOptions = {},
  ) {
    target.addEventListener(name, (event) => this.guard(() => handler(event as HTMLElementEventMap[K])), options);
  }

  invalidate() {
    if (!this.request) this.request = requestAnimationFrame(() => this.#run());
  }

  drawNow() {
    cancelAnimationFrame(this.request);
    this.#run();
  }

  #run() {
    this.request = 0;
    const start = performance.now();
    if (this.isMoving && start < this.#next) {
      this.invalidate();
      return;
    }
    this.guard(() => this.draw());
    const end = performance.now();
    this.#next = this.isShared() ? end + Math.min(LONGEST_GAP, end - start) : 0; // half of the time is the view's
  }

  markMoving() {
    this.isMoving = true;
    clearTimeout(this.#restTimer);
    this.#restTimer = 0;
    this.invalidate();
  }

  /**
   * Rest a while after this frame, if something moves. From a picture on, not from a movement: a slow machine would
   * draw full pictures in between.
   */
  restSoon(rested: () => void) {
    if (!this.isMoving || this.#restTimer) return;
    this.#restTimer = setTimeout(() => {
      this.#restTimer = 0;
      this.isMoving = false;
      this.isResting = true;
      rested();
      this.invalidate();
    }, REST);
  }
}
