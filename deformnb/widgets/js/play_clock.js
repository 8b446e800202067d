// The clock of a player: which moment of an animation is shown. It runs in the page, so that playing costs no message.
//
// All views of a player on one page share one clock, found on the player's bus:
//
//   const clock = clockOf(busOf(playerModel));
//   bus.addEventListener("deformnb:time", ...)   event.detail = {time, isPlaying}, at every picture and every change

const LONGEST_TICK = 250; // ms: a page that was hidden goes on where it was, and does not leap

class PlayClock {
  /** tell({time, isPlaying}) at every change; `page` has requestAnimationFrame and cancelAnimationFrame. */
  constructor(tell, page = globalThis) {
    Object.assign(this, { tell, page, position: 0, duration: 0, speed: 1, loop: "once", isPlaying: false, frame: 0,
      last: null, leader: null });
  }

  /** The moment from 0 to the duration; on the way back of a swing it falls while the position rises. */
  get time() { return momentOf(this.position, this.duration, this.loop); }

  /** What Python or a view says; what is undefined stays. */
  set({ duration, speed, loop }) {
    const time = this.time;
    if (speed !== undefined) this.speed = speed;
    if (loop !== undefined && loop !== this.loop) Object.assign(this, { loop, position: time });
    if (duration !== undefined) this.duration = duration;
    this.position = Math.min(this.position, this.duration * (this.loop === "swing" ? 2 : 1));
    this.#told();
  }

  seek(time) {
    this.position = Math.max(0, Math.min(this.duration, time));
    this.#told();
  }

  play() {
    if (this.isPlaying || this.duration <= 0) return;
    if (this.loop === "once" && this.position >= this.duration) this.position = 0; // from the beginning again
    this.isPlaying = true;
    this.last = null;
    this.#next();
    this.#told();
  }

  pause() {
    if (!this.isPlaying) return;
    this.isPlaying = false;
    this.page.cancelAnimationFrame(this.frame);
    this.#told();
  }

  #next() { this.frame = this.page.requestAnimationFrame((now) => this.tick(now)); }

  tick(now) {
    if (!this.isPlaying) return;
    const passed = this.last === null ? 0 : Math.min(LONGEST_TICK, Math.max(0, now - this.last)) / 1000;
    this.last = now;
    const end = this.duration * (this.loop === "swing" ? 2 : 1);
    this.position += passed * this.speed;
    if (this.loop === "once" && this.position >= end) {
      this.position = end;
      this.isPlaying = false;
    } else {
      this.position %= Math.max(end, 1e-9);
      this.#next();
    }
    this.#told();
  }

  #told() { this.tell({ time: this.time, isPlaying: this.isPlaying }); }
}

function momentOf(position, duration, loop) {
  if (loop !== "swing" || position <= duration) return Math.min(position, duration);
  return Math.max(0, 2 * duration - position);
}

function clockOf(bus) {
  bus.clock ??= new PlayClock((detail) => {
    bus.moment = detail;
    bus.dispatchEvent(new CustomEvent("deformnb:time", { detail }));
  });
  return bus.clock;
}
