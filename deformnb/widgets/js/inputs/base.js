// The page of a small widget whose value is changed by hand: its link to Python, theme, and words.
// To Python: edit (seq, view, phase, value). From Python: done (seq, view), error (view, message).

import { EditLink } from "../sync/edits.js";
import { pageElement, setText, SLACK } from "../ui/dom.js";

export const KEYS_REST = 600; // milliseconds after the last arrow key, when a held key that sends no keyup counts as let go

export class EditedPage {
  constructor(model, el, name) {
    this.model = model;
    this.link = new EditLink((message) => model.send(message));
    Object.assign(this, { handlers: [], frame: 0, isHeld: false });
    this.closed = new AbortController();
    this.root = pageElement("div", `dnb-curves ${name}`, el, { role: "group" });
    this.root.deformnb = this; // for tests and for whoever looks into the page
  }

  // Called by the widget's page once its elements exist.
  start() {
    this.spoken = pageElement("div", "dnb-cv-spoken", this.root, { "aria-live": "polite" });
    this.on("change:shown", () => this.receive());
    this.on("change:theme", () => this.applyTheme());
    this.on("change:label", () => this.invalidate());
    this.on("change:read_only", () => this.invalidate());
    this.on("msg:custom", (message) => this.message(message));
    this.observer = new ResizeObserver(() => this.guard(() => this.applyTheme())); // a style sheet may come late
    this.observer.observe(this.root);
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.listen(this.dark, "change", () => this.applyTheme());
    this.themes = new MutationObserver(() => this.guard(() => this.applyTheme())); // Jupyter and VS Code change the body
    this.themes.observe(document.body, { attributes: true, attributeFilter: ["class", "data-jp-theme-light",
      "data-jp-theme-name", "data-vscode-theme-kind"] });
    this.guard(() => { this.adopt(this.model.get("shown")); this.applyTheme(); this.draw(); });
  }

  on(name, handler) {
    const guarded = (...given) => this.guard(() => handler(...given));
    this.model.on(name, guarded);
    this.handlers.push([name, guarded]);
  }

  listen(target, name, handler, options = {}) {
    target.addEventListener(name, (event) => this.guard(() => handler(event)), { signal: this.closed.signal, ...options });
  }

  close() {
    this.closed.abort();
    for (const [name, handler] of this.handlers) this.model.off(name, handler);
    this.observer.disconnect();
    this.themes.disconnect();
    cancelAnimationFrame(this.frame);
    this.root.remove();
  }

  // Whatever goes wrong in here is said in the widget, and the page goes on.
  guard(action) {
    try { return action(); } catch (error) {
      console.error(error);
      this.say(`The page met an error: ${error.message}`);
      return undefined;
    }
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  get isReadOnly() { return Boolean(this.model.get("read_only")); }

  receive() {
    const shown = this.model.get("shown");
    if (this.isHeld || this.link.isBehind(shown.seen)) return;
    this.adopt(shown);
    this.invalidate();
  }

  message(message) {
    if (message?.view && message.view !== this.link.id) return; // another view of the same model
    if (message?.type === "error") this.say(String(message.message));
    if (message?.type === "done") this.link.done(message.seq);
  }

  move(value) { if (this.model.get("live")) this.link.move(value); }

  end(value) {
    this.say("");
    this.link.end(value);
  }

  // ---- the page -----------------------------------------------------------------------------------------------------

  say(text) {
    if (!this.alert) return;
    setText(this.alert, text);
    this.alert.hidden = text === "";
  }

  speak(text) { setText(this.spoken, text); }

  invalidate() {
    if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.guard(() => this.draw()); });
  }

  // Colours of the page around, light or dark: Jupyter's and VS Code's own variables, else the browser's preference.
  applyTheme() {
    this.root.dataset.theme = this.model.get("theme") || "auto";
    const [r, g, b, alpha = 1] = (getComputedStyle(this.root).backgroundColor.match(/[\d.]+/g) ?? []).map(Number);
    const isDark = alpha > 0 && r !== undefined ? 0.2126 * r + 0.7152 * g + 0.0722 * b < 110 : this.dark.matches;
    this.root.classList.toggle("dnb-cv-dark", isDark);
    this.invalidate();
  }
}

// A press that becomes a drag, with the mouse, a pen or a finger. `hand` has press(event), which returns what is
// grabbed or null, drag(grabbed, [dx, dy]), and drop(grabbed, isCancelled, isClick).

export function listenToDrags(page, target, hand) {
  let held = null;
  const drop = (isCancelled) => {
    const { grabbed, isPress } = held;
    held = null;
    hand.drop(grabbed, isCancelled, isPress);
  };
  // A finger on a node must not scroll the page; touch-action of a part of an SVG does not keep it from that.
  page.listen(target, "touchstart", (event) => {
    if (event.target.closest(".dnb-cv-node, .dnb-cv-grip") && !page.isReadOnly) event.preventDefault();
  }, { passive: false });
  page.listen(target, "pointerdown", (event) => {
    if (held || event.button !== 0) return;
    const grabbed = hand.press(event);
    if (grabbed === null) return;
    event.preventDefault();
    target.setPointerCapture(event.pointerId);
    held = { grabbed, pointer: event.pointerId, from: [event.clientX, event.clientY], isPress: true };
  });
  page.listen(target, "pointermove", (event) => {
    if (held?.pointer !== event.pointerId) return;
    const by = [event.clientX - held.from[0], event.clientY - held.from[1]];
    if (held.isPress && Math.hypot(...by) < (SLACK[event.pointerType] ?? SLACK.mouse)) return;
    held.isPress = false;
    hand.drag(held.grabbed, by);
  });
  const over = (isCancelled) => (event) => { if (held?.pointer === event.pointerId) drop(isCancelled); };
  page.listen(target, "pointerup", over(false));
  page.listen(target, "pointercancel", over(true));
  page.listen(target, "lostpointercapture", over(true));
  return () => { // cancels; says whether there was anything to cancel
    if (held === null) return false;
    drop(true);
    return true;
  };
}
