// The pointers of other windows that show the same editor, and what they move: a mark for each that has moved lately, and a
// sentence when one of them has moved a point. A point that another window drags cannot be dragged here until it is let go.
//
// A window announces itself when it opens; the others answer. A pointer is sent while there is somebody to see it, and the
// next one when Python has returned the last, so that a busy Python gets no row of them.

import type { WindowPointer } from "../generated.ts";
import { MOST_NAMED } from "../generated.ts";
import { labelOf } from "../maths/point_names.ts";
import { changedIds } from "../maths/points.ts";
import type { Vector2 } from "../types.ts";
import { pageElement } from "../ui/dom.ts";
import type { EditorParts } from "./parts.ts";

const EVERY = 60; // ms between two pointers
const ANSWERED_WITHIN = 2000; // ms, after which a pointer is taken for lost
const SHOWN_FOR = 4000; // ms after the last movement
const BEAT = 1000; // ms between two messages of a window that drags, however still it holds
const HELD_FOR = 6000; // ms for which a point counts as dragged by a window that has not been heard since
const FORGOTTEN_AFTER = 90000; // ms without a message, after which a window is taken for closed
const LABEL = 130; // CSS pixels that the name takes
const COLOURS = ["#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#f0e442", "#d55e00"]; // Okabe and Ito's

interface Other {
  mark: HTMLElement;
  at: Vector2 | null;
  drags: number[];
  heard: number;
  timer: number;
}

type OthersEditor = EditorParts<"model" | "sender" | "messages" | "viewport" | "stage" | "points", "drag">;

export class OtherWindows {
  readonly others = new Map<string, Other>();
  #at: Vector2 | null = null;
  #moved: number[] = [];
  #sentAt = -Infinity;
  #isWaiting = false; // for our own last pointer
  #timer = 0;
  #beat = 0;

  constructor(readonly editor: OthersEditor) {
    const { model, sender, stage } = editor,
      { signal } = stage.closing;
    const receive = (message: WindowPointer) => {
      if (message?.type === "pointer") this.#receive(message);
    };
    model.on("msg:custom", receive);
    const edited = (ids: number[]) => {
      this.#moved.push(...ids);
      this.#sendSoon();
    };
    sender.editListeners.add(edited);
    signal.addEventListener("abort", () => {
      model.off("msg:custom", receive);
      sender.editListeners.delete(edited);
      this.#close();
    });
    stage.element.addEventListener("pointermove", (event) => this.#point(stage.placeOf(event)), { signal });
    stage.element.addEventListener("pointerleave", () => this.#point(null), { signal });
    window.addEventListener("pagehide", () => this.#send(true), { signal });
    this.#send();
  }

  /** Whether another window drags one of these points. */
  holds(ids: number[]) {
    const now = performance.now();
    return [...this.others.values()].some(
      ({ drags, heard }) => now - heard < HELD_FOR && drags.some((id) => ids.includes(id)),
    );
  }

  /** Place the marks, where the view of the picture has changed. */
  place() {
    const { k, x, y, width } = this.editor.viewport.view;
    for (const { mark, at } of this.others.values()) {
      if (!at) continue;
      const left = x + k * at[0];
      mark.style.transform = `translate(${left}px, ${y + k * at[1]}px)`;
      mark.classList.toggle("dnb-ed-other-left", left > width - LABEL);
    }
  }

  #point(place: Vector2 | null) {
    const { k, x, y } = this.editor.viewport.view;
    this.#at = place && [(place[0] - x) / k, (place[1] - y) / k];
    this.#sendSoon();
  }

  /** Ids of the points that this window is dragging. */
  get #dragged() {
    const { points, sender, tools } = this.editor;
    return tools.drag.drag0 ? changedIds(sender.points, points.list) : [];
  }

  #sendSoon() {
    const now = performance.now();
    for (const [id, { heard }] of this.others) if (now - heard > FORGOTTEN_AFTER) this.#forget(id);
    if (!this.others.size) {
      this.#moved = [];
      return;
    }
    if (this.#timer) return;
    const isLost = now - this.#sentAt > ANSWERED_WITHIN;
    if (this.#isWaiting && !isLost) return; // the answer sends the next one
    this.#timer = setTimeout(() => this.#send(), EVERY);
  }

  #send(leaves: boolean = false) {
    clearTimeout(this.#timer);
    this.#timer = 0;
    this.#isWaiting = true;
    this.#sentAt = performance.now();
    const moved = [...new Set(this.#moved)].slice(0, MOST_NAMED);
    this.#moved = [];
    const drags = this.#dragged.slice(0, MOST_NAMED);
    clearTimeout(this.#beat);
    if (drags.length) this.#beat = setTimeout(() => this.#send(), BEAT); // also to say that they are let go
    const id = this.editor.sender.channel.id;
    try {
      const message: WindowPointer = { type: "pointer", window: id, at: this.#at, drags, moved, leaves };
      this.editor.model.send(message);
    } catch {
      this.#isWaiting = false; // the connection is closed, which the sender says
    }
  }

  #receive({ window: id, at, drags, moved, leaves }: WindowPointer) {
    const { sender } = this.editor;
    if (id === sender.channel.id) {
      this.#isWaiting = false;
      if (this.#moved.length) this.#sendSoon();
      return;
    }
    if (leaves) {
      this.#forget(id);
      return;
    }
    const isNew = !this.others.has(id),
      other = this.others.get(id) ?? this.#meet(id);
    Object.assign(other, { at, drags, heard: performance.now() });
    other.mark.hidden = !at;
    clearTimeout(other.timer);
    other.timer = setTimeout(() => {
      other.mark.hidden = true;
    }, SHOWN_FOR);
    this.place();
    if (isNew) this.#sendSoon(); // it knows of us then
    if (moved.length) this.#report(moved);
  }

  #meet(id: string) {
    let sum = 0;
    for (const letter of id) sum += letter.charCodeAt(0);
    const mark = pageElement("div", "dnb-ed-other", this.editor.stage.element, { "aria-hidden": "true", hidden: "" });
    mark.style.setProperty("--dnb-other", COLOURS[sum % COLOURS.length]!);
    pageElement("span", "dnb-ed-other-name", mark, {}, "Other window");
    const other: Other = { mark, at: null, drags: [], heard: 0, timer: 0 };
    this.others.set(id, other);
    return other;
  }

  #forget(id: string) {
    const other = this.others.get(id);
    if (!other) return;
    clearTimeout(other.timer);
    other.mark.remove();
    this.others.delete(id);
  }

  /** Say which points another window has moved; a drag of the same one here goes on, and counts when it ends. */
  #report(moved: number[]) {
    const { messages, points } = this.editor,
      mine = this.#dragged;
    const one = points.list.find(({ id }) => id === moved[0]),
      name = one ? labelOf(one, points.numberOf(one.id)) : "A point";
    if (moved.some((id) => mine.includes(id))) {
      messages.hint(`${name} was moved in another window too: the place where you let it go counts`, 6000);
    } else if (moved.length === 1) messages.hint(`${name} was moved in another window`, 4000);
    else messages.hint(`${moved.length} points were moved in another window`, 4000);
  }

  #close() {
    this.#send(true);
    clearTimeout(this.#beat);
    for (const id of [...this.others.keys()]) this.#forget(id);
  }
}
