// The edits that this window sends to Python: a Sender for the points, cuts and parts of an editor, an EditLink
// for a single value such as a curve.
//
// Edits are sent as numbered messages only, never as a trait: a front end holds trait updates back while the kernel
// works, and they would overtake each other. At most two are in flight, and the newest waits; ends of edits are always
// sent, and do not wait behind movements. Python sends with its values (the trait `seen`) the number of the last
// message it has received from each sender. While one of ours is not yet received, Python's values are an echo of what
// we had before, and it will have ours in the end: they are left alone. Otherwise they are new. So Python's order
// decides, and all windows and views end with what Python has.
//
// There is one Sender for each editor and window: it lives on the bus (sync/bus.js), and all views of the editor share
// it.

import type {
  DrawnPart,
  EditorToPython,
  Greeting,
  MovedPart,
  PointsEdit,
  ShapeChoice,
  ValueEdit,
  WandRequest,
  WindowPointer,
} from "../generated.ts";
import { LONGEST_EDIT } from "../generated.ts";
import { changedIds, cleanPoints, cleanShapes, nextId, samePoints, sameShapes } from "../maths/points.ts";
import type { Bus, Model, ModelHandler, Point, ShapeData, ShapeKind, Shapes, Vector, Without } from "../types.ts";
import { History } from "./undo_list.ts";

/** Settings of the fit that an edit of points changes with them */
export type FitChange = { support?: number | null; stages?: number };
/** `fit`: settings that an edit has changed, as they were. */
export type State<V extends Vector> = { points: Point<V>[]; shapes: Shapes; fit?: FitChange };
export type Change = "points" | "status" | "history";
export type Clock = { now: () => number; later: (f: () => void, ms: number) => number; cancel: (id: number) => void };

const MOST_IN_FLIGHT = 2; // movements, and as many ends
const LOST_AFTER = 2000; // milliseconds without an answer, after which the kernel is assumed to be busy or dead
const PRECEDENCE_MS = 10000; // milliseconds for which an edit of ours takes precedence over Python's values
/** Characters of an edit at most; Python counts the bytes of its own JSON, which has blanks and escapes. */
export const MOST_CHARACTERS = LONGEST_EDIT / 2;

const SHAPE_KINDS: ShapeKind[] = ["cuts", "parts"];

const newId = () => Math.random().toString(36).slice(2, 12);

export const CLOCK: Clock = {
  now: () => performance.now(),
  later: (f, ms) => setTimeout(f, ms),
  cancel: (id) => clearTimeout(id),
};

/** Numbered messages to Python and their answers, also of a kernel that does not answer. */
class EditChannel {
  readonly id = newId();
  seq = 0; // number of the last message
  /** Numbers of the messages in flight */
  readonly waiting: Record<"move" | "end", Set<number>> = { move: new Set(), end: new Set() };
  status = ""; // "", "busy", "unanswered", "detached", "lost" or "held"
  isAnswered = false;
  isCut = false;
  #isGreeted = false;
  #timer = 0;
  #greeting = 0;

  /**
   * @param model returns the model that sends the messages
   * @param events `changed` is called with another status, `next` when there may be room for messages
   */
  constructor(
    readonly clock: Clock,
    readonly model: () => Model | undefined,
    readonly events: { changed: () => void; next: () => void },
  ) {}

  close() {
    for (const timer of [this.#timer, this.#greeting]) this.clock.cancel(timer);
  }

  /** Whether a message may be sent: to a busy kernel one end, and no movements. */
  hasRoom(group: "move" | "end") {
    const most = this.status === "" ? MOST_IN_FLIGHT : group === "end" ? 1 : 0;
    return this.waiting[group].size < most;
  }

  /** Take the answer to a message. */
  done(seq: number, sender: string = this.id) {
    if (sender !== this.id) return; // another window's
    this.waiting.move.delete(seq);
    this.waiting.end.delete(seq);
    this.isAnswered = true;
    this.isCut = false;
    this.#setStatus("");
    this.events.next();
  }

  send(
    group: "move" | "end",
    content: Without<Exclude<EditorToPython, WandRequest | WindowPointer> | DrawnPart, "sender" | "seq">,
  ) {
    this.seq += 1;
    this.waiting[group].add(this.seq);
    this.clock.cancel(this.#timer);
    this.#timer = this.clock.later(() => this.#unanswered(), LOST_AFTER);
    try {
      this.model()?.send({ ...content, sender: this.id, seq: this.seq });
    } catch (error) {
      // the connection is closed
      console.warn("an edit could not be sent:", error);
      this.isCut = true;
      this.#setStatus(this.#whenCut);
    }
  }

  // Sent edits are not sent again: they will be answered late, or never. Pending ones are sent.
  #unanswered() {
    const { move, end } = this.waiting;
    if (move.size + end.size === 0) return;
    move.clear();
    end.clear();
    this.#setStatus(this.isCut ? this.#whenCut : this.isAnswered ? "busy" : "unanswered");
    if (this.status === "unanswered") this.#timer = this.clock.later(() => this.#reportDetached(), LOST_AFTER);
    this.events.next();
  }

  /** Of a dead connection; a page of the application holds its edits until Python is back. */
  get #whenCut() {
    return (this.model()?.widget_manager as { isApplication?: boolean } | undefined)?.isApplication ? "held" : "lost";
  }

  /** The kernel of a Jupyter front end, null where it is dead; undefined of other hosts. */
  get #kernel(): { status: string } | null | undefined {
    return (this.model()?.widget_manager as { kernel?: { status: string } | null } | undefined)?.kernel;
  }

  // anywidget gives a model two seconds to load its module. On a busy machine, as when a notebook is loaded again, that
  // is too short, and then it drops all messages to the model, for good, although the model is shown and can send.
  #reportDetached() {
    if (!this.isAnswered && this.#kernel?.status === "idle") this.#setStatus("detached");
  }

  /**
   * Send a first message when a view opens: where no reply follows, that must be seen before anything is edited. A busy
   * kernel replies later; an idle one never will.
   */
  greet() {
    if (this.isAnswered || this.#isGreeted || this.#kernel === undefined) return;
    this.#isGreeted = true;
    try {
      this.model()?.send({ type: "greet", sender: this.id, seq: 0 } satisfies Greeting);
    } catch {
      this.isCut = true;
    }
    this.#expectAnswer();
  }

  #expectAnswer() {
    if (this.isAnswered) return;
    if (this.isCut || this.#kernel === null) {
      this.#setStatus(this.#whenCut);
      return;
    }
    this.#greeting = this.clock.later(() => {
      this.#reportDetached();
      this.#expectAnswer();
    }, LOST_AFTER);
  }

  #setStatus(status: string) {
    if (status === this.status && status !== "lost" && status !== "held") return; // a loss is reported for each edit
    this.status = status;
    this.events.changed();
  }
}

/** The points, cuts and parts of an editor, as all of its views in a window share them. */
export class Sender<V extends Vector = Vector> {
  readonly channel: EditChannel;
  last = 0; // number of the last message that Python has to have seen before its values are taken
  lastAt = -Infinity;
  points: Point<V>[] = [];
  shapes: Shapes = { cuts: [], parts: [] };
  nextId = 0;
  models: { model: Model; handlers: Record<string, ModelHandler> }[] = [];
  listeners = new Set<(what: Change) => void>();
  /** Called with the ids of the points that an edit of this window has moved or added */
  editListeners = new Set<(ids: number[]) => void>();
  history: History<State<V>> = new History();
  pending: {
    move: { points: Point<V>[]; part?: MovedPart } | null;
    end: { kind: PointsEdit["kind"]; joins: boolean; points: Point<V>[]; fit?: FitChange } | null;
  } = { move: null, end: null };
  /** Measurements of a view during a drag, sent with its end */
  drawn: PointsEdit["drawn"] | null = null;
  steps: { seq: number; what: string }[] = [];

  #isFilled = false; // whether points have been received

  constructor(readonly clock: Clock = CLOCK) {
    const events = { changed: () => this.#notify("status"), next: () => this.#next() };
    this.channel = new EditChannel(clock, () => this.model, events);
  }

  // ---- models and listeners -----------------------------------------------------------------------------------------

  attach(model: Model) {
    if (this.models.some((held) => held.model === model)) return;
    const news = () => this.receive(true, model);
    const handlers: Record<string, ModelHandler> = {
      "change:points": news,
      "change:cuts": news,
      "change:parts": news,
      "change:seen": () => {
        this.receive(false, model);
        this.#notify("history");
      },
      "msg:custom": (message) => {
        if (message?.type === "done") this.channel.done(message.seq, message.sender);
      },
      comm_live_update: () => {
        this.channel.isCut = true;
      },
    };
    for (const [name, handler] of Object.entries(handlers)) model.on(name, handler);
    this.models.push({ model, handlers });
    this.receive();
  }

  detach(model: Model) {
    const held = this.models.find((one) => one.model === model);
    if (!held) return;
    this.flush();
    for (const [name, handler] of Object.entries(held.handlers)) model.off(name, handler);
    this.models.splice(this.models.indexOf(held), 1);
    if (this.models.length === 0) this.channel.close();
  }

  /**
   * Call a listener after changes of the points or of the status, or ("history") when other steps may be undone although
   * all of that is the same: a step was requested, or Python has seen it. Returns the function that ends it.
   */
  listen(listener: (what: Change) => void) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  get model() {
    return this.models.at(-1)?.model;
  }

  // ---- from Python --------------------------------------------------------------------------------------------------

  /** Whether Python's values are older than ours. */
  isBehind(model = this.model) {
    return this.pending.end !== null || (model?.get("seen")?.[this.channel.id] ?? 0) < this.last;
  }

  receive(isNews = false, model = this.model) {
    if (!model) return;
    this.nextId = Math.max(this.nextId, model.get("next_id") ?? 0);
    const isLate = isNews && this.clock.now() - this.lastAt > PRECEDENCE_MS; // an answer that is lost blocks nothing
    if (this.#isFilled && this.isBehind(model) && !isLate) return;
    const points = cleanPoints<V>(model.get("points"));
    const shapes = { cuts: this.#shapesOf(model, "cuts"), parts: this.#shapesOf(model, "parts") };
    if (this.#isFilled && samePoints(points, this.points) && sameShapes(shapes, this.shapes)) return;
    if (this.#isFilled) this.history.record(this.state);
    this.#isFilled = true;
    this.#take(points, shapes);
  }

  /** The state that an undo restores: points, cuts and parts together. */
  get state() {
    return { points: this.points, shapes: this.shapes };
  }

  /** The shapes of a model; the same list where nothing has changed. */
  #shapesOf<K extends ShapeKind>(model: Model, what: K) {
    const held = this.shapes[what],
      clean = cleanShapes(model.get(what), what, held);
    return sameShapes(clean, held) ? held : clean;
  }

  // ---- to Python ----------------------------------------------------------------------------------------------------

  /**
   * Send the points after an edit; edits that share `join` in quick succession are undone as one.
   * @param kind of the edit, for the history
   * @param fit settings that it changes too
   */
  edit(points: Point<V>[], kind: PointsEdit["kind"], join: string | null = null, fit: FitChange | null = null) {
    const joins = this.history.record({ ...this.state, ...(fit && { fit: this.#fit }) }, join);
    this.#leave(points, kind, joins, fit);
  }

  get #fit(): FitChange {
    const { support = null, stages = 1 } = this.model?.get("settings") ?? {};
    return { support, stages };
  }

  /** Change settings in this window; Python follows with the edit. */
  #changeFit(fit: FitChange) {
    this.model?.set("settings", { ...this.model.get("settings"), ...fit });
  }

  /**
   * Send all cuts or all parts after an edit of one, and the points if it changes them too; `join` as of an edit.
   */
  editShapes(
    what: ShapeKind,
    shapes: ShapeData[],
    kind: string,
    points: Point<V>[] = this.points,
    join: string | null = null,
  ) {
    this.history.record(this.state, join);
    this.#leaveShapes(what, shapes, kind, points, join !== null);
  }

  /** Let Python make a rigid part of what was drawn. */
  drawPart(part: Without<DrawnPart, "type" | "sender" | "seq">) {
    this.pending.move = null;
    this.flush();
    this.#counted("edit");
    this.lastAt = this.clock.now();
    this.channel.send("end", { type: "part", ...part });
    this.#notify("history");
  }

  /** Send the shape that is chosen; with a copy of it, for Python's lists may have changed meanwhile. */
  choose(chosen: Pick<ShapeChoice, "what" | "index" | "shape"> | null) {
    this.flush();
    this.last = this.channel.seq + 1;
    this.channel.send("end", { type: "choose", what: null, ...chosen });
  }

  /** Send points during a drag, or a rigid part being moved and the points with it. */
  move(points: Point<V>[], part: MovedPart | null = null) {
    this.pending.move = { points, ...(part && { part }) };
    this.#next();
  }

  get isPythons() {
    return typeof this.model?.get("history")?.undo === "string";
  }

  /** Whether there is a step to undo or redo. */
  canStep(way: "undo" | "redo") {
    if (!this.isPythons) return (way === "undo" ? this.history.past : this.history.future).length > 0;
    const { undo, redo } = this.model?.get("history") ?? {},
      can = { undo: undo !== "", redo: redo !== "" };
    for (const step of this.#unseen()) {
      // an edit can be undone, and leaves nothing to redo
      if (step === "edit") Object.assign(can, { undo: true, redo: false });
      else if (step === "undo" && can.undo) can.redo = true;
      else if (step === "redo" && can.redo) can.undo = true;
    }
    return can[way];
  }

  // The steps of this window that Python's history does not have yet: "edit", "undo" or "redo", oldest first.
  #unseen() {
    const seen = this.model?.get("seen")?.[this.channel.id] ?? 0;
    this.steps = this.steps.filter(({ seq }) => seq > seen);
    return [...this.steps.map(({ what }) => what), ...(this.pending.end ? ["edit"] : [])];
  }

  /** Note that the next message changes what can be undone: until Python has seen it, we are ahead of it. */
  #counted(what: string) {
    this.last = this.channel.seq + 1;
    this.steps.push({ seq: this.last, what });
  }

  /** Do one step of the history, this window's or Python's; false where there is none. */
  step(way: "undo" | "redo") {
    if (!this.canStep(way)) return false;
    if (!this.isPythons) {
      const {
        points,
        shapes,
        fit = null,
      } = this.history[way]({ ...this.state, fit: this.#fit }) ?? { ...this.state, fit: null };
      for (const what of SHAPE_KINDS) {
        if (!sameShapes(shapes[what], this.shapes[what])) this.#leaveShapes(what, shapes[what], way, points);
      }
      const isChanged = fit !== null && JSON.stringify(fit) !== JSON.stringify(this.#fit);
      if (!samePoints(points, this.points) || isChanged) this.#leave(points, way, false, isChanged ? fit : null);
    } else {
      this.pending.move = null;
      this.flush();
      this.#counted(way);
      this.lastAt = this.clock.now();
      this.channel.send("end", { type: "history", way });
      this.#notify("history");
    }
    return true;
  }

  /** Send an edit that waits, for the next message must not overtake it. */
  flush() {
    const {
      pending: { end },
      drawn,
    } = this;
    this.pending.end = null;
    if (!end) return;
    this.#counted("edit");
    this.drawn = null; // sent once
    this.channel.send("end", { type: "edit", phase: "end", next_id: this.nextId, ...end, ...(drawn && { drawn }) });
  }

  #leave(points: Point<V>[], kind: PointsEdit["kind"], joins: boolean, fit: FitChange | null = null) {
    const waits = this.pending.end,
      settings = waits?.fit || fit ? { fit: { ...waits?.fit, ...fit } } : {};
    this.pending.move = null;
    this.pending.end = waits
      ? { kind: kind === waits.kind ? kind : "several", joins: joins && waits.joins, points, ...settings }
      : { kind, joins, points, ...settings };
    if (fit) this.#changeFit(fit);
    this.lastAt = this.clock.now();
    if (this.editListeners.size) {
      const ids = changedIds(this.points, points);
      for (const edited of this.editListeners) edited(ids);
    }
    this.#take(points);
    this.#next();
  }

  /** Send shapes at once, behind what waits: they are drawn only now and then. */
  #leaveShapes(
    what: ShapeKind,
    shapes: ShapeData[],
    kind: string,
    points: Point<V>[] = this.points,
    joins: boolean = false,
  ) {
    this.pending.move = null;
    this.flush();
    this.lastAt = this.clock.now();
    this.#counted("edit");
    const others = points === this.points ? {} : { points };
    this.#take(points, { ...this.shapes, [what]: cleanShapes(shapes, what, this.shapes[what]) });
    this.channel.send("end", {
      type: "shapes",
      what,
      kind,
      shapes: this.shapes[what],
      ...others,
      ...(joins && { joins }),
    });
  }

  #take(points: Point<V>[], shapes: Shapes = this.shapes) {
    this.points = points;
    this.shapes = shapes;
    this.nextId = nextId(points, this.nextId);
    this.#notify("points");
  }

  #next() {
    const { channel, pending } = this,
      canMove = channel.hasRoom("move");
    if (pending.end && channel.hasRoom("end")) this.flush();
    if (pending.move && canMove) {
      const moved = pending.move;
      pending.move = null;
      this.channel.send("move", { type: "edit", phase: "move", kind: "move", joins: false, ...moved });
    }
  }

  #notify(what: Change) {
    for (const listener of this.listeners) listener(what);
  }
}

const REST = 150; // milliseconds

/**
 * A trait that the user changes several times in a row, such as the selection of a band. It is sent after a rest, or
 * before the user turns to another widget, which may change it too; until then Python's value is old.
 */
export class RestingTrait {
  #timer = 0;

  /** What waits */
  #value: unknown = null;

  constructor(
    readonly model: Model,
    readonly name: string,
  ) {}

  get isAhead() {
    return this.#timer !== 0;
  }

  sendSoon(value: unknown) {
    clearTimeout(this.#timer);
    this.#value = value;
    this.#timer = setTimeout(() => this.flush(), REST);
  }

  /** Send what waits now. */
  flush() {
    if (!this.isAhead) return;
    this.close();
    this.model.set(this.name, this.#value);
    this.model.save_changes();
  }

  /** Drop what waits. */
  close() {
    clearTimeout(this.#timer);
    this.#timer = 0;
  }
}

/** The sender of an editor's bus, made by the first call, which is that of anywidget's `initialize`. */
export function senderOf<V extends Vector>(bus: Bus, model: Model) {
  if (!bus.sender) {
    bus.sender = new Sender();
    bus.sender.attach(model);
  }
  return bus.sender as Sender<V>;
}

/** A value that one view sends to Python, such as a curve. */
export class EditLink {
  post: (message: ValueEdit) => void;
  id: string;
  seq = 0;
  last = 0; // number of the last end
  waiting = new Set<number>();

  #sentAt = 0;
  #endedAt = 0;
  /** A movement that waits, null for none */
  #pending: object | null = null;

  /** @param now milliseconds */
  constructor(
    send: (message: ValueEdit) => void,
    readonly now: () => number = () => performance.now(),
  ) {
    this.post = send;
    this.id = newId();
  }

  /** Send a value during a drag. */
  move(value: object) {
    if (this.waiting.size && this.now() - this.#sentAt > LOST_AFTER) this.waiting.clear();
    if (this.waiting.size >= MOST_IN_FLIGHT) {
      this.#pending = value;
      return;
    }
    this.#send("move", value);
  }

  /** Send a value at the end of an edit. */
  end(value: object) {
    this.#pending = null;
    this.#send("end", value);
    this.last = this.seq;
    this.#endedAt = this.now();
  }

  /** Take the answer to a message. */
  done(seq: number) {
    this.waiting.delete(seq);
    if (this.#pending === null || this.waiting.size >= MOST_IN_FLIGHT) return;
    const value = this.#pending;
    this.#pending = null;
    this.#send("move", value);
  }

  /** Whether Python's value is older than ours. `seen`: the last end that it has received of each view. */
  isBehind(seen: Record<string, number> | null | undefined) {
    return (seen?.[this.id] ?? 0) < this.last && this.now() - this.#endedAt < PRECEDENCE_MS;
  }

  #send(phase: "move" | "end", value: object) {
    this.seq += 1;
    if (phase === "move") {
      this.waiting.add(this.seq);
      this.#sentAt = this.now();
    }
    this.post({ type: "edit", seq: this.seq, view: this.id, phase, value });
  }
}

/** Set a trait, and send it to Python at once. */
export function setTrait(model: Model, name: string, value: unknown) {
  model.set(name, value);
  model.save_changes();
}
