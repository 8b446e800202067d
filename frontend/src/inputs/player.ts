// The player of an animation: play and pause, a bar with the key frames, speed and loop.
//
// Its clock runs in the front end, so that playing costs no message. All views of a player in one window share one
// clock, found on the player's bus:
//
//   const clock = clockOf(busOf(playerModel));
//   bus.addEventListener("deformnb:time", ...)   event.detail = {time, isPlaying}, at every frame and every change
//
// A view sets the traits time, is_playing, speed and loop: a few times a second while it plays, and exactly at rest.

import { busOf, holdBus, releaseBus } from "../sync/bus.ts";
import { setTrait } from "../sync/edits.ts";
import type { Bus, Model, TimeDetail } from "../types.ts";
import { iconElement, OWN_KEYS, pageElement, placeIn, setAttributes, setText } from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";
import { InputView } from "./base.ts";

const LONGEST_TICK = 250; // ms: after a window was hidden the animation continues where it was, and does not leap

/** The functions of a window by which a clock ticks. */
export type FrameSource = Pick<Window, "requestAnimationFrame" | "cancelAnimationFrame">;

export class PlayClock {
  position = 0;
  duration = 0;
  speed = 1;
  loop = "once";
  isPlaying = false;
  frame = 0;
  /** The time of the last tick */
  last: number | null = null;
  /** The one that sends the time to Python, of those of all views */
  sender: TimeSender | null = null;

  /** @param publish called at every change */
  constructor(
    readonly publish: (detail: TimeDetail) => void,
    readonly frames: FrameSource = window,
  ) {}

  /** The moment from 0 to the duration; in the second half of a swing it falls while the position rises. */
  get time() {
    return momentOf(this.position, this.duration, this.loop);
  }

  /** Change settings; those that are undefined are left unchanged. */
  set({ duration, speed, loop }: { duration?: number; speed?: number; loop?: string }) {
    const time = this.time;
    if (speed !== undefined) this.speed = speed;
    if (loop !== undefined && loop !== this.loop) {
      this.loop = loop;
      this.position = time;
    }
    if (duration !== undefined) this.duration = duration;
    this.position = Math.min(this.position, this.duration * (this.loop === "swing" ? 2 : 1));
    this.#changed();
  }

  seek(time: number) {
    this.position = Math.max(0, Math.min(this.duration, time));
    this.#changed();
  }

  play() {
    if (this.isPlaying || this.duration <= 0) return;
    if (this.loop === "once" && this.position >= this.duration) this.position = 0; // from the beginning again
    this.isPlaying = true;
    this.last = null;
    this.#next();
    this.#changed();
  }

  pause() {
    if (!this.isPlaying) return;
    this.isPlaying = false;
    this.frames.cancelAnimationFrame(this.frame);
    this.#changed();
  }

  #next() {
    this.frame = this.frames.requestAnimationFrame((now) => this.tick(now));
  }

  tick(now: number) {
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
    this.#changed();
  }

  #changed() {
    this.publish({ time: this.time, isPlaying: this.isPlaying });
  }
}

function momentOf(position: number, duration: number, loop: string) {
  if (loop !== "swing" || position <= duration) return Math.min(position, duration);
  return Math.max(0, 2 * duration - position);
}

function clockOf(bus: Bus) {
  bus.clock ??= new PlayClock((detail) => {
    bus.moment = detail;
    bus.dispatchEvent(new CustomEvent("deformnb:time", { detail }));
  });
  return bus.clock;
}

/** The time of a clock as a trait of one view's model: sent at once at rest, else a few times a second. */
class TimeSender {
  #timer = 0;
  #sentAt = -Infinity; // milliseconds
  /** The time that Python got last */
  #last: number | undefined = undefined;

  constructor(
    readonly model: Model,
    readonly clock: PlayClock,
    readonly guard: (action: () => void) => void,
  ) {
    clock.sender ??= this;
    if (clock.sender === this && !clock.isPlaying) clock.position = model.get("time");
  }

  close() {
    clearTimeout(this.#timer);
    if (this.clock.sender === this) this.clock.sender = null;
  }

  /** Take the time of Python. */
  receive() {
    const time = this.model.get("time");
    if (time !== this.#last) this.clock.seek(time);
  }

  send(isAtRest: boolean) {
    const { clock, model } = this;
    clock.sender ??= this;
    if (clock.sender !== this) return;
    const { time, isPlaying } = clock,
      now = performance.now(),
      pause = model.get("sync_ms");
    clearTimeout(this.#timer);
    if (!isAtRest && now - this.#sentAt < pause) {
      this.#timer = setTimeout(() => this.guard(() => this.send(true)), pause - (now - this.#sentAt));
      return;
    }
    const isNew = time !== model.get("time"),
      isTurned = isPlaying !== Boolean(model.get("is_playing"));
    if (!isNew && !isTurned) return;
    this.#sentAt = now;
    this.#last = time;
    if (isNew) model.set("time", time);
    if (isTurned) model.set("is_playing", isPlaying);
    model.save_changes();
  }
}

// ---- the widget -----------------------------------------------------------------------------------------------------

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const LOOP_WORDS = { once: "once", loop: "loop", swing: "there and back" };
const PLAYER_ICONS = {
  first: "M4 3v10M12.5 3.5v9L6 8z",
  play: "M4.5 2.8v10.4L13 8z",
  pause: "M5 3v10M11 3v10",
  last: "M12 3v10M3.5 3.5v9L10 8z",
};
/** Of a drag along the bar. */
type Phase = "start" | "move" | "end";

const KEY_NEAR = 1e-6; // seconds

/** The bar of the time, with the key frames. */
class Track {
  #element: HTMLDivElement;
  #rail: HTMLDivElement;
  #marks: HTMLDivElement;
  #marked = ""; // the key frames that are drawn

  /** @param scrub called with the share of the bar that is pressed */
  constructor(parent: HTMLElement, view: Pick<InputView, "listen">, scrub: (share: number, phase: Phase) => void) {
    const attributes = { role: "slider", tabindex: 0, "aria-valuemin": 0, ...OWN_KEYS };
    this.#element = pageElement("div", "dnb-pl-track", parent, attributes);
    this.#rail = pageElement("div", "dnb-pl-rail", this.#element);
    pageElement("div", "dnb-pl-done", this.#rail);
    this.#marks = pageElement("div", "dnb-pl-marks", this.#rail, { "aria-hidden": "true" });
    pageElement("div", "dnb-pl-knob", this.#rail);
    this.#listen(view, scrub);
  }

  /** Listen to presses and drags along the bar, with the mouse, a pen or a finger. */
  #listen(view: Pick<InputView, "listen">, scrub: (share: number, phase: Phase) => void) {
    const track = this.#element;
    let pointer: number | null = null;
    const share = (event: PointerEvent) =>
      Math.max(0, Math.min(1, placeIn(this.#rail, event)[0] / Math.max(1, this.#rail.getBoundingClientRect().width)));
    view.listen(track, "pointerdown", (event) => {
      if (pointer !== null || event.button !== 0) return;
      pointer = event.pointerId;
      track.setPointerCapture(event.pointerId);
      track.focus({ preventScroll: true });
      scrub(share(event), "start");
    });
    view.listen(track, "pointermove", (event) => {
      if (event.pointerId === pointer) scrub(share(event), "move");
    });
    for (const name of ["pointerup", "pointercancel"] as const) {
      view.listen(track, name, (event) => {
        if (event.pointerId !== pointer) return;
        pointer = null;
        scrub(share(event), "end");
      });
    }
  }

  /** The share of the bar that six pixels are. */
  get reach() {
    return 6 / Math.max(1, this.#rail.clientWidth);
  }

  draw(label: string, keys: number[], { time, duration }: { time: number; duration: number }) {
    this.#rail.style.setProperty("--share", String(duration > 0 ? time / duration : 0));
    setAttributes(this.#element, {
      "aria-label": `${label}, time`,
      "aria-valuemax": duration,
      "aria-valuenow": Number(time.toFixed(3)),
      "aria-valuetext": `${time.toFixed(2)} of ${duration.toFixed(2)} seconds`,
    });
    const marked = JSON.stringify([keys, duration]);
    if (marked !== this.#marked) {
      this.#marked = marked;
      this.#marks.replaceChildren(
        ...keys.map((t, k) => {
          const title = `key frame ${k + 1} at ${Number(t.toFixed(3))} s`;
          const mark = pageElement("span", "dnb-pl-mark", null, { title });
          mark.style.setProperty("--at", String(duration > 0 ? t / duration : 0));
          return mark;
        }),
      );
    }
    [...this.#marks.children].forEach((mark, k) => {
      mark.classList.toggle("dnb-pl-here", Math.abs(keys[k]! - time) < 1e-3);
    });
  }
}

/** The menus of speeds and of what comes after the end. */
class Choices {
  #speed: HTMLSelectElement;
  #loop: HTMLSelectElement;

  /** @param set called with a trait and its value */
  constructor(
    parent: HTMLElement,
    view: Pick<InputView, "listen">,
    set: (name: "speed" | "loop", value: number | string) => void,
  ) {
    const box = pageElement("div", "dnb-pl-choices", parent);
    const select = (label: string, chosen: (value: string) => void) => {
      const made = pageElement("select", "dnb-cv-select", box, { "aria-label": label, title: label, ...OWN_KEYS });
      view.listen(made, "change", () => chosen(made.value));
      return made;
    };
    this.#speed = select("Speed", (value) => set("speed", Number(value)));
    this.#loop = select("What comes after the end", (value) => set("loop", value));
    this.#loop.replaceChildren(...Object.entries(LOOP_WORDS).map(([value, text]) => new Option(text, value)));
  }

  draw(speed: number, loop: string) {
    const speeds = [...new Set([...SPEEDS, speed])].sort((a, b) => a - b);
    if (this.#speed.dataset.all !== speeds.join()) {
      this.#speed.dataset.all = speeds.join();
      this.#speed.replaceChildren(...speeds.map((s) => new Option(`${s} \u00d7`, String(s))));
    }
    this.#speed.value = String(speed);
    this.#loop.value = loop;
  }
}

class PlayerView extends InputView {
  bus: Bus;
  clock: PlayClock;
  sender: TimeSender;
  play: HTMLButtonElement;
  track: Track;
  read: HTMLSpanElement;
  choices: Choices;

  isScrubbed = false;
  wasPlaying = false;
  #uid: string;
  #listener = (event: CustomEvent<TimeDetail>) => this.guard(() => this.moved(event.detail));

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-player");
    this.bus = busOf(model);
    this.#uid = model.get("uid");
    holdBus(this.bus);
    this.clock = clockOf(this.bus);
    this.sender = new TimeSender(model, this.clock, (action) => this.guard(action));
    const bar = pageElement("div", "dnb-pl-bar", this.root);
    const buttons = pageElement("div", "dnb-pl-buttons", bar);
    const icon = (name: keyof typeof PLAYER_ICONS, tip: string, act: () => void) =>
      this.iconButton(buttons, iconElement(PLAYER_ICONS[name]), tip, act, "dnb-pl-button");
    icon("first", "Key frame before (Page up)", () => this.toKey(-1));
    this.play = icon("play", "Play (Space)", () => this.toggle());
    this.play.classList.add("dnb-pl-play");
    icon("last", "Next key frame (Page down)", () => this.toKey(1));
    this.track = new Track(bar, this, (share, phase) => this.scrubbed(share, phase));
    this.read = pageElement("span", "dnb-pl-time", bar);
    this.choices = new Choices(bar, this, (name, value) => {
      setTrait(model, name, value);
      this.#take();
    });
    this.root.append(this.alert);
    this.bus.addEventListener("deformnb:time", this.#listener);
    this.onChange(["duration", "speed", "loop"], () => this.#take());
    this.on("change:time", () => this.sender.receive());
    this.on("change:is_playing", () => this.#run());
    this.on("change:marks", () => this.invalidate());
    this.listen(this.root, "keydown", (event) => this.key(event));
    this.#take();
    this.start();
    this.#run();
  }

  close() {
    this.bus.removeEventListener("deformnb:time", this.#listener);
    this.sender.close();
    releaseBus(this.bus, this.#uid);
    if (this.bus.owners <= 0) this.clock.pause();
    super.close();
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  get duration(): number {
    return this.model.get("duration");
  }

  /** The times of the key frames. */
  get keys(): number[] {
    return this.model.get("marks") || [];
  }

  #take() {
    const [duration, speed, loop] = ["duration", "speed", "loop"].map((name) => this.model.get(name));
    this.clock.set({ duration, speed, loop });
    this.invalidate();
  }

  #run() {
    if (this.model.get("is_playing")) this.clock.play();
    else this.clock.pause();
    this.sender.send(true); // without anything to play it remains paused
  }

  moved({ isPlaying }: TimeDetail) {
    const hasStopped = this.wasPlaying && !isPlaying;
    this.wasPlaying = isPlaying;
    this.sender.send(hasStopped || (!isPlaying && !this.isScrubbed));
    this.invalidate();
  }

  // ---- actions of the user ------------------------------------------------------------------------------------------

  toggle() {
    if (this.clock.isPlaying) this.clock.pause();
    else this.clock.play();
  }

  seek(time: number) {
    this.clock.pause();
    this.clock.seek(time);
  }

  /**
   * Go to the key frame before or after the moment shown.
   * @param way 1 or -1
   */
  toKey(way: number) {
    const { time } = this.clock,
      places = [...new Set([0, ...this.keys, this.duration])].sort((a, b) => a - b);
    const found = way > 0 ? places.find((t) => t > time + KEY_NEAR) : places.findLast((t) => t < time - KEY_NEAR);
    if (found !== undefined) this.seek(found);
  }

  /** @param share of the bar */
  scrubbed(share: number, phase: Phase) {
    this.isScrubbed = phase !== "end";
    if (phase === "start") this.clock.pause();
    // It snaps to a key frame that is nearer than six pixels.
    const time = share * this.duration,
      reach = this.track.reach * this.duration;
    const key = this.keys.find((t) => Math.abs(t - time) < reach);
    this.clock.seek(key ?? time);
    if (phase === "end") this.sender.send(true);
  }

  key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLSelectElement) return;
    const isButton = event.target instanceof HTMLButtonElement,
      { time } = this.clock,
      step = this.model.get("step");
    if (event.key === " " && !isButton) this.toggle();
    else if (event.key === "ArrowRight" || event.key === "ArrowUp") this.seek(time + step * (event.shiftKey ? 10 : 1));
    else if (event.key === "ArrowLeft" || event.key === "ArrowDown") this.seek(time - step * (event.shiftKey ? 10 : 1));
    else if (event.key === "Home") this.seek(0);
    else if (event.key === "End") this.seek(this.duration);
    else if (event.key === "PageUp") this.toKey(-1);
    else if (event.key === "PageDown") this.toKey(1);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    const { time, isPlaying } = this.clock,
      { duration } = this;
    const label = this.model.get("label") || "Animation";
    setAttributes(this.root, { "aria-label": label });
    const tip = isPlaying ? "Pause (Space)" : "Play (Space)";
    setAttributes(this.play, { title: tip, "aria-label": tip, "aria-disabled": duration <= 0 });
    this.play.querySelector("path")?.setAttribute("d", PLAYER_ICONS[isPlaying ? "pause" : "play"]);
    this.play.classList.toggle("dnb-pl-solid", !isPlaying);
    setText(this.read, `${time.toFixed(2)} / ${duration.toFixed(2)} s`);
    this.track.draw(label, this.keys, { time, duration });
    this.choices.draw(this.model.get("speed"), this.model.get("loop"));
  }
}

export default widgetOf(PlayerView);
