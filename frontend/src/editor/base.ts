// The base of the editors of a picture and in space: frames, messages, colours of the theme. And
// the rate at which pictures follow the pointer, which goes to Python with the edit that ends a drag: a message of its
// own would cost the drag time.

import { busOf, holdBus, releaseBus } from "../sync/bus.ts";
import type { Sender } from "../sync/edits.ts";
import { senderOf } from "../sync/edits.ts";
import type { Bus, Model } from "../types.ts";
import { OWN_KEYS, pageElement, setText } from "../ui/dom.ts";
import { ThemeObserver } from "../ui/theme.ts";

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
  moved(now: number) {
    this.movedAt ??= now;
  }

  /** The picture of the last movement is drawn. */
  drew(now: number) {
    if (this.movedAt === null) return;
    this.waits.push(now - this.movedAt);
    if (this.last !== null && now - this.last < PAUSE) this.spans.push(now - this.last);
    Object.assign(this, { last: now, movedAt: null });
    for (const list of [this.waits, this.spans]) if (list.length > MOST_PICTURES) list.shift();
  }

  /** {hz, ms} of the drag that ends now, or null after a short one; the next begins anew. */
  taken() {
    const { spans, waits } = this;
    Object.assign(this, { movedAt: null, last: null, spans: [], waits: [] });
    if (waits.length < FEWEST_PICTURES || spans.length === 0) return null;
    const mean = spans.reduce((sum, span) => sum + span, 0) / spans.length;
    const middle = waits.sort((a, b) => a - b)[waits.length >> 1]!;
    return { hz: Math.round(10000 / Math.max(mean, 1)) / 10, ms: Math.round(10 * middle) / 10 };
  }
}

/** Messages about a kernel that does not answer, by the sender's status. */
const NO_ANSWER: Record<string, string> = {
  busy: "The kernel is busy; the volume in Python follows later",
  unanswered: "No answer from Python yet; these points stay in the browser until it answers",
  detached: "This view was loaded too slowly and receives nothing from Python: run the cell again",
  lost: "The kernel was restarted or is gone: Python does not get these edits. Run the cell again",
};

const FINAL = new Set(["detached", "lost"]); // these messages stay as long as the page is open
const LONGEST_TIMER = 2 ** 31 - 1; // milliseconds

/** The drawing and the messages that both editors share. */
export class EditorDrawing {
  model: Model;
  bus: Bus;
  sender: Sender;
  root: HTMLDivElement;
  tip: HTMLDivElement;
  alert: HTMLDivElement;
  liveRegion: HTMLDivElement;
  theme: ThemeObserver;
  colours: { stage: string; grid: string };
  frame: number;
  tipTimer: number;
  alertTimer: number;

  constructor(model: Model) {
    this.model = model;
    this.bus = busOf(model);
    this.sender = senderOf(this.bus, model);
    // Wherever a press in it goes, the keys are the editor's from then on.
    this.root = pageElement("div", "dnb-editor", null, { tabindex: "-1", role: "group", ...OWN_KEYS });
    this.tip = pageElement("div", "dnb-ed-hint", null, { hidden: "", "aria-hidden": "true" });
    this.alert = pageElement("div", "dnb-ed-alert", null, { role: "alert", hidden: "" });
    this.liveRegion = pageElement("div", "dnb-ed-spoken", null, { "aria-live": "polite" });
    this.theme = new ThemeObserver(this.root, () => this.guard(() => this.applyTheme()));
    this.colours = { stage: "#777", grid: "#777" };
    this.frame = 0; // the request of the next one, or 0
    this.tipTimer = 0;
    this.alertTimer = 0;
  }

  /** Run an action: an error is shown in the widget, and the editor goes on. */
  guard<T>(action: () => T) {
    try {
      return action();
    } catch (error) {
      console.error(error);
      this.showMessage(`The editor met an error: ${error instanceof Error ? error.message : error}`);
      return undefined;
    }
  }

  // ---- frames -------------------------------------------------------------------------------------------------------

  /** Draw everything: each editor has its own. */
  draw() {}

  invalidate() {
    if (!this.frame)
      this.frame = requestAnimationFrame(() => {
        this.frame = 0;
        this.guard(() => this.draw());
      });
  }

  drawNow() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.guard(() => this.draw());
  }

  /** Take the colours of the page around, light or dark: Jupyter's or VS Code's, else the browser's preference. */
  applyTheme() {
    this.root.dataset.theme = this.model.get("theme") || "auto";
    this.root.classList.toggle("dnb-dark", this.theme.isDark);
    const style = getComputedStyle(this.root);
    const [stage, grid] = ["--dnb-stage", "--dnb-grid"].map(
      (name) => style.getPropertyValue(name).trim() || "#777",
    ) as [string, string];
    this.colours = { stage, grid: grid };
    this.invalidate();
  }

  // ---- messages -----------------------------------------------------------------------------------------------------

  showStatus() {
    const text = NO_ANSWER[this.sender.status];
    if (text) this.hint(text, FINAL.has(this.sender.status) ? LONGEST_TIMER : 8000);
    else if (Object.values(NO_ANSWER).includes(this.tip.textContent)) this.tip.hidden = true;
  }

  /** Show a sentence over the picture; a passing one goes after a while. */
  showMessage(message: string, isPassing = false) {
    clearTimeout(this.alertTimer);
    this.alert.hidden = !message;
    this.alert.textContent = message;
    if (isPassing)
      this.alertTimer = setTimeout(() => {
        this.alert.hidden = true;
      }, 8000);
  }

  /** Show a hint for some milliseconds. */
  hint(text: string, duration = 2500) {
    clearTimeout(this.tipTimer);
    this.tip.hidden = false;
    this.tip.textContent = text;
    this.tipTimer = setTimeout(() => {
      this.tip.hidden = true;
    }, duration);
  }

  /** Take a hint away before its time, if it is one of these. */
  hideHint(texts: string[]) {
    if (texts.includes(this.tip.textContent)) this.tip.hidden = true;
  }

  /** Give a text to screen readers. */
  announce(text: string) {
    setText(this.liveRegion, text);
  }
}

/** Attach the sender of an editor to its model: before any view, and as long as the model lives. */
export function initialize({ model }: { model: Model }) {
  const bus = busOf(model),
    uid = model.get("uid");
  holdBus(bus);
  const sender = senderOf(bus, model),
    leave = () => sender.flush(); // nothing waits when the page goes
  sender.attach(model); // two consoles of one kernel have two models of one editor
  window.addEventListener("pagehide", leave);
  model.on("destroy", () => {
    window.removeEventListener("pagehide", leave);
    sender.detach(model);
    if (sender.models.length === 0) bus.sender = undefined;
    releaseBus(bus, uid);
  });
}
