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
import type { Bus, Model, TimeDetail } from "../types.ts";
import { iconElement, OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.ts";
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
  /** The one view that sends the time to Python */
  leader: PlayerView | null = null;

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

// ---- the widget -----------------------------------------------------------------------------------------------------

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const LOOP_WORDS = { once: "once", loop: "loop", swing: "there and back" };
const PLAYER_ICONS = {
  first: "M4 3v10M12.5 3.5v9L6 8z",
  play: "M4.5 2.8v10.4L13 8z",
  pause: "M5 3v10M11 3v10",
  last: "M12 3v10M3.5 3.5v9L10 8z",
};
const KEY_NEAR = 1e-6; // seconds

class PlayerView extends InputView {
  bus: Bus;
  uid: string;
  clock: PlayClock;
  back: HTMLButtonElement;
  play: HTMLButtonElement;
  next: HTMLButtonElement;
  track: HTMLDivElement;
  rail: HTMLDivElement;
  done: HTMLDivElement;
  diamonds: HTMLDivElement;
  knob: HTMLDivElement;
  read: HTMLSpanElement;
  speed: HTMLSelectElement;
  loop: HTMLSelectElement;
  listener: (event: CustomEvent<TimeDetail>) => void;

  later = 0; // a timer
  sent = -Infinity; // milliseconds
  /** The time that Python got last */
  lastTime: number | undefined = undefined;
  isScrubbed = false;
  wasPlaying = false;
  markedFor = ""; // the key frames that are drawn

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-player");
    this.bus = busOf(model);
    this.uid = model.get("uid");
    holdBus(this.bus);
    this.clock = clockOf(this.bus);
    this.clock.leader ??= this;
    const bar = pageElement("div", "dnb-pl-bar", this.root);
    const buttons = pageElement("div", "dnb-pl-buttons", bar);
    const icon = (name: keyof typeof PLAYER_ICONS, tip: string, act: () => void) =>
      this.iconButton(buttons, iconElement(PLAYER_ICONS[name]), tip, act, "dnb-pl-button");
    this.back = icon("first", "Key frame before (Page up)", () => this.toKey(-1));
    this.play = icon("play", "Play (Space)", () => this.toggle());
    this.play.classList.add("dnb-pl-play");
    this.next = icon("last", "Next key frame (Page down)", () => this.toKey(1));
    this.track = pageElement("div", "dnb-pl-track", bar, {
      role: "slider",
      tabindex: 0,
      "aria-valuemin": 0,
      ...OWN_KEYS,
    });
    this.rail = pageElement("div", "dnb-pl-rail", this.track);
    this.done = pageElement("div", "dnb-pl-done", this.rail);
    this.diamonds = pageElement("div", "dnb-pl-marks", this.rail, { "aria-hidden": "true" });
    this.knob = pageElement("div", "dnb-pl-knob", this.rail);
    this.read = pageElement("span", "dnb-pl-time", bar);
    const choices = pageElement("div", "dnb-pl-choices", bar);
    this.speed = this.#select(choices, "Speed", (value) => this.#set("speed", Number(value)));
    this.loop = this.#select(choices, "What comes after the end", (value) => this.#set("loop", value));
    this.loop.replaceChildren(...Object.entries(LOOP_WORDS).map(([value, text]) => new Option(text, value)));
    this.root.append(this.alert);
    listenToScrub(this, this.track);
    this.listener = (event: CustomEvent<TimeDetail>) => {
      this.guard(() => this.moved(event.detail));
    };
    this.bus.addEventListener("deformnb:time", this.listener);
    this.onChange(["duration", "speed", "loop"], () => this.#take());
    this.on("change:time", () => {
      if (model.get("time") !== this.lastTime) this.clock.seek(model.get("time"));
    });
    this.on("change:is_playing", () => this.#run());
    this.on("change:marks", () => this.invalidate());
    this.listen(this.root, "keydown", (event) => this.key(event));
    if (this.clock.leader === this && !this.clock.isPlaying) this.clock.position = model.get("time");
    this.#take();
    this.start();
    this.#run();
  }

  close() {
    this.bus.removeEventListener("deformnb:time", this.listener);
    clearTimeout(this.later);
    if (this.clock.leader === this) this.clock.leader = null;
    releaseBus(this.bus, this.uid);
    if (this.bus.owners <= 0) this.clock.pause();
    super.close();
  }

  #select(parent: HTMLElement, label: string, chosen: (value: string) => void) {
    const select = pageElement("select", "dnb-cv-select", parent, { "aria-label": label, title: label, ...OWN_KEYS });
    this.listen(select, "change", () => chosen(select.value));
    return select;
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
    this.#send(true); // without anything to play it remains paused
  }

  #set(name: "speed" | "loop", value: number | string) {
    this.model.set(name, value);
    this.model.save_changes();
    this.#take();
  }

  /** Send the time to Python: at once at rest, else a few times a second. */
  #send(isAtRest: boolean) {
    if (this.clock.leader === null) this.clock.leader = this;
    if (this.clock.leader !== this) return;
    const { time, isPlaying } = this.clock,
      now = performance.now(),
      pause = this.model.get("sync_ms");
    clearTimeout(this.later);
    if (!isAtRest && now - this.sent < pause) {
      this.later = setTimeout(() => this.guard(() => this.#send(true)), pause - (now - this.sent));
      return;
    }
    const isNew = time !== this.model.get("time"),
      isTurned = isPlaying !== Boolean(this.model.get("is_playing"));
    if (!isNew && !isTurned) return;
    this.sent = now;
    this.lastTime = time;
    if (isNew) this.model.set("time", time);
    if (isTurned) this.model.set("is_playing", isPlaying);
    this.model.save_changes();
  }

  moved({ isPlaying }: TimeDetail) {
    const hasStopped = this.wasPlaying && !isPlaying;
    this.wasPlaying = isPlaying;
    this.#send(hasStopped || (!isPlaying && !this.isScrubbed));
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
  scrubbed(share: number, phase: "start" | "move" | "end") {
    this.isScrubbed = phase !== "end";
    if (phase === "start") this.clock.pause();
    // It snaps to a key frame that is nearer than six pixels.
    const time = share * this.duration,
      reach = (6 / Math.max(1, this.rail.clientWidth)) * this.duration;
    const key = this.keys.find((t) => Math.abs(t - time) < reach);
    this.clock.seek(key ?? time);
    if (phase === "end") this.#send(true);
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
      { duration, keys } = this,
      share = duration > 0 ? time / duration : 0;
    const label = this.model.get("label") || "Animation";
    setAttributes(this.root, { "aria-label": label });
    this.rail.style.setProperty("--share", String(share));
    const tip = isPlaying ? "Pause (Space)" : "Play (Space)";
    setAttributes(this.play, { title: tip, "aria-label": tip, "aria-disabled": duration <= 0 });
    this.play.querySelector("path")?.setAttribute("d", PLAYER_ICONS[isPlaying ? "pause" : "play"]);
    this.play.classList.toggle("dnb-pl-solid", !isPlaying);
    setText(this.read, `${time.toFixed(2)} / ${duration.toFixed(2)} s`);
    setAttributes(this.track, {
      "aria-label": `${label}, time`,
      "aria-valuemax": duration,
      "aria-valuenow": Number(time.toFixed(3)),
      "aria-valuetext": `${time.toFixed(2)} of ${duration.toFixed(2)} seconds`,
    });
    this.#drawMarks(keys, duration, time);
    this.#drawChoices();
  }

  #drawMarks(keys: number[], duration: number, time: number) {
    const shown = JSON.stringify([keys, duration]);
    if (shown !== this.markedFor) {
      this.markedFor = shown;
      this.diamonds.replaceChildren(
        ...keys.map((t, k) => {
          const title = `key frame ${k + 1} at ${Number(t.toFixed(3))} s`;
          const mark = pageElement("span", "dnb-pl-mark", null, { title });
          mark.style.setProperty("--at", String(duration > 0 ? t / duration : 0));
          return mark;
        }),
      );
    }
    [...this.diamonds.children].forEach((mark, k) => {
      mark.classList.toggle("dnb-pl-here", Math.abs(keys[k]! - time) < 1e-3);
    });
  }

  #drawChoices() {
    const speed = this.model.get("speed"),
      speeds = [...new Set([...SPEEDS, speed])].sort((a, b) => a - b);
    if (this.speed.dataset.all !== speeds.join()) {
      this.speed.dataset.all = speeds.join();
      this.speed.replaceChildren(...speeds.map((s) => new Option(`${s} \u00d7`, String(s))));
    }
    this.speed.value = speed;
    this.loop.value = this.model.get("loop");
  }
}

/** Listen to presses and drags along the bar, with the mouse, a pen or a finger. */
function listenToScrub(view: PlayerView, track: HTMLElement) {
  let pointer: number | null = null;
  const share = (event: PointerEvent) => {
    const { left, width } = view.rail.getBoundingClientRect();
    return Math.max(0, Math.min(1, (event.clientX - left) / Math.max(1, width)));
  };
  view.listen(track, "pointerdown", (event) => {
    if (pointer !== null || event.button !== 0) return;
    pointer = event.pointerId;
    track.setPointerCapture(event.pointerId);
    track.focus({ preventScroll: true });
    view.scrubbed(share(event), "start");
  });
  view.listen(track, "pointermove", (event) => {
    if (event.pointerId === pointer) view.scrubbed(share(event), "move");
  });
  for (const name of ["pointerup", "pointercancel"] as const) {
    view.listen(track, name, (event) => {
      if (event.pointerId !== pointer) return;
      pointer = null;
      view.scrubbed(share(event), "end");
    });
  }
}

export default widgetOf(PlayerView);
