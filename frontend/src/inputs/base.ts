// The base of small widgets whose value the user edits: their link to Python, theme and messages.
// To Python: edit (seq, view, phase, value). From Python: done (seq, view), error (view, message).

import type { CurveEditorToFrontEnd } from "../generated.ts";
import { EditLink } from "../sync/edits.ts";
import type { Model, Values, Vector2 } from "../types.ts";
import { buttonElement, named, pageElement, setText, slackOf, targetOf } from "../ui/dom.ts";
import { elementUnder, grabNearest } from "../ui/fingers.ts";
import { ThemeObserver } from "../ui/theme.ts";
import { Widget } from "../ui/widget.ts";

// Milliseconds after the last arrow key, when a held key that sends no keyup counts as released.
export const KEYS_REST = 600;

/** The index of the element to which an event was sent, or -1. */
export function targetIndex(elements: Element[], event: Event) {
  return elements.indexOf(targetOf(event));
}

/**
 * The value of an attribute of the element under the pointer, or null. The place is looked up because
 * the clicks of a captured pointer are dispatched to the element that has captured it.
 */
export function attributeUnder(event: MouseEvent, within: Element, name: string) {
  const hit = elementUnder(within, event)?.closest(`[${name}]`);
  return hit && within.contains(hit) ? hit.getAttribute(name) : null;
}

/** The same for a number. */
export function numberUnder(event: MouseEvent, within: Element, name: string) {
  const found = attributeUnder(event, within, name);
  return found === null ? null : Number(found);
}

export class InputView extends Widget {
  link: EditLink;
  isHeld = false;
  alert: HTMLDivElement;
  liveRegion: HTMLDivElement;
  theme: ThemeObserver;
  observer: ResizeObserver;

  constructor(model: Model, el: HTMLElement, name: string) {
    super(model, el, `dnb-curves ${name}`, { role: "group" });
    this.link = new EditLink((message) => model.send(message));
    this.alert = pageElement("div", "dnb-cv-alert", null, { role: "alert", hidden: "" }); // placed by each widget
    this.liveRegion = pageElement("div", "dnb-cv-spoken", null, { "aria-live": "polite" });
    const repaint = () => this.guard(() => this.applyTheme());
    this.theme = new ThemeObserver(this.root, repaint);
    this.observer = new ResizeObserver(repaint); // a style sheet may be loaded late
  }

  /** Called by a widget once its elements exist. */
  start() {
    this.root.append(this.liveRegion);
    this.on("change:shown", () => this.receive());
    this.on("change:theme", () => this.applyTheme());
    this.onChange(["label", "read_only"], () => this.invalidate());
    this.on("msg:custom", (message) => this.message(message));
    this.observer.observe(this.root);
    this.guard(() => {
      this.adopt(this.model.get("shown"));
      this.applyTheme();
      this.draw();
    });
  }

  /** A button with a sign or an icon, which its tip explains. */
  iconButton(
    parent: ParentNode | null,
    content: string | Node,
    tip: string,
    act: () => void,
    className = "dnb-cv-button",
  ) {
    return buttonElement(className, parent, content, () => this.guard(act), named(tip));
  }

  /** A button with words. */
  wordButton(parent: ParentNode, words: string, title: string, act: () => void) {
    return buttonElement("dnb-cv-button dnb-cv-wide", parent, words, () => this.guard(act), title ? { title } : {});
  }

  close() {
    this.observer.disconnect();
    this.theme.close();
    super.close();
  }

  fail(error: unknown) {
    super.fail(error);
    this.showMessage(`The widget met an error: ${error instanceof Error ? error.message : error}`);
  }

  // ---- the model ----------------------------------------------------------------------------------------------------

  get isReadOnly() {
    return Boolean(this.model.get("read_only"));
  }

  receive() {
    const shown = this.model.get("shown");
    if (this.isHeld || this.link.isBehind(shown.seen)) return;
    this.adopt(shown);
    this.invalidate();
  }

  /** Take over the value of the trait `shown`. */
  adopt(_shown: Values) {}

  message(message: CurveEditorToFrontEnd) {
    if (message.view && message.view !== this.link.id) return; // another view of the same model
    if (message.type === "error") this.showMessage(message.message);
    if (message.type === "done") this.link.done(message.seq);
  }

  move(value: object) {
    if (this.model.get("live")) this.link.move(value);
  }

  end(value: object) {
    this.showMessage("");
    this.link.end(value);
  }

  // ---- the widget ---------------------------------------------------------------------------------------------------

  showMessage(text: string) {
    setText(this.alert, text);
    this.alert.hidden = text === "";
  }

  announce(text: string) {
    setText(this.liveRegion, text);
  }

  applyTheme() {
    this.root.dataset.theme = this.model.get("theme") || "auto";
    this.root.classList.toggle("dnb-dark", this.theme.isDark);
    this.invalidate();
  }
}

/** The effect of a drag. `press` returns what is grabbed, or null. */
export interface DragHandler<T> {
  press: (event: PointerEvent) => T | null;
  drag: (grabbed: T, by: Vector2) => void;
  drop: (grabbed: T, isCancelled: boolean, isClick: boolean) => void;
}

/**
 * Listen to presses that become drags, with the mouse, a pen or a finger. Returns a function that cancels the drag and
 * returns whether there was one.
 */
export function listenToDrags<T>(
  view: Pick<InputView, "isReadOnly" | "listen" | "closing">,
  target: SVGElement,
  handler: DragHandler<T>,
) {
  let held: { grabbed: T; pointer: number; from: Vector2; isPress: boolean } | null = null;
  const drop = (isCancelled: boolean) => {
    if (!held) return;
    const { grabbed, isPress } = held;
    held = null;
    handler.drop(grabbed, isCancelled, isPress);
  };
  // A finger on a node must not scroll the page; touch-action of a part of an SVG does not prevent that.
  view.listen(target, "touchmove", (event) => held && event.cancelable && event.preventDefault(), { passive: false });
  grabNearest(target, view.closing.signal);
  view.listen(target, "pointerdown", (event) => {
    if (held || event.button !== 0) return;
    const grabbed = handler.press(event);
    if (grabbed === null) return;
    event.preventDefault();
    target.setPointerCapture(event.pointerId);
    held = { grabbed, pointer: event.pointerId, from: [event.clientX, event.clientY], isPress: true };
  });
  view.listen(target, "pointermove", (event) => {
    if (held?.pointer !== event.pointerId) return;
    const by: Vector2 = [event.clientX - held.from[0], event.clientY - held.from[1]];
    if (held.isPress && Math.hypot(...by) < slackOf(event.pointerType)) return;
    held.isPress = false;
    handler.drag(held.grabbed, by);
  });
  const over = (isCancelled: boolean) => (event: PointerEvent) => {
    if (held?.pointer === event.pointerId) drop(isCancelled);
  };
  view.listen(target, "pointerup", over(false));
  view.listen(target, "pointercancel", over(true));
  view.listen(target, "lostpointercapture", over(true));
  return () => {
    if (held === null) return false;
    drop(true);
    return true;
  };
}
