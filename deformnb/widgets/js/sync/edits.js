// The points of an editor in this window, and the one way in which they go to Python. No DOM.
//
// The page sends points as numbered messages only, never as a trait: a front end holds trait updates back while the
// kernel works, and they would overtake each other. Python tells its points by the trait `points`, and by the trait
// `seen` which message of each sender it has taken in. While one of ours is still on its way, Python's points are an
// echo of what we had before, and it will have ours in the end: they are left alone. Otherwise they are news.
// So Python's order decides, and all windows and views end with what Python has.
//
// There is one sender for each editor and window: it lives on the bus (sync/bus.js), and all views of the editor share it.

import { cleanPoints, cleanShapes, History, nextId, samePoints, sameShapes } from "../maths/points.js";

const EDITS_IN_FLIGHT = 2; // movements, and as many ends: beyond that the newest waits
const LOST_AFTER = 2000; // milliseconds without an answer, after which the kernel is taken to be busy or gone
const TRUSTED_FOR = 10000; // milliseconds for which an edit of ours goes before what Python says meanwhile
export const LONGEST_EDIT = 500000; // characters that Python takes of one edit

export const CLOCK = { now: () => performance.now(), later: (f, ms) => setTimeout(f, ms), cancel: (id) => clearTimeout(id) };

export class Sender {
  constructor(clock = CLOCK) {
    Object.assign(this, { clock, id: Math.random().toString(36).slice(2, 12), seq: 0, last: 0, lastAt: -Infinity,
      points: null, nextId: 0, models: [], listeners: new Set(), history: new History(), timer: null, sentAt: 0,
      waiting: { move: new Set(), end: new Set() }, pending: { move: null, end: null }, status: "", isHeard: false,
      isCut: false, shapes: { cuts: [], parts: [] }, drawn: null, steps: [] });
  }

  // ---- models and listeners: whoever shows the points ---------------------------------------------------------------

  attach(model) {
    if (this.models.some((held) => held.model === model)) return;
    const news = () => this.receive(true, model);
    const handlers = { "change:points": news, "change:cuts": news, "change:parts": news,
      "change:seen": () => { this.receive(false, model); this.#notify("history"); },
      "msg:custom": (message) => { if (message?.type === "done") this.done(message.seq, message.sender); },
      comm_live_update: () => { this.isCut = true; } };
    for (const [name, handler] of Object.entries(handlers)) model.on(name, handler);
    this.models.push({ model, handlers });
    this.receive();
  }

  detach(model) {
    const at = this.models.findIndex((held) => held.model === model);
    if (at < 0) return;
    this.flush();
    for (const [name, handler] of Object.entries(this.models[at].handlers)) model.off(name, handler);
    this.models.splice(at, 1);
    if (this.models.length === 0) for (const timer of [this.timer, this.greeting]) this.clock.cancel(timer);
  }

  // listener("points") after other points are there, listener("status") after `status` has changed, listener("history")
  // when other things may be undone although all of that is the same: a step was asked for, or Python has seen it.
  listen(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  get model() { return this.models.at(-1)?.model; }

  // ---- from Python --------------------------------------------------------------------------------------------------

  isBehind(model = this.model) { return this.pending.end !== null || (model?.get("seen")?.[this.id] ?? 0) < this.last; }

  receive(isNews = false, model = this.model) {
    if (!model) return;
    this.nextId = Math.max(this.nextId, model.get("next_id") ?? 0);
    const isLate = isNews && this.clock.now() - this.lastAt > TRUSTED_FOR; // an answer that is lost blocks nothing
    if (this.points !== null && this.isBehind(model) && !isLate) return;
    const points = cleanPoints(model.get("points")), shapes = this.#shapesOf(model);
    if (this.points !== null && samePoints(points, this.points) && sameShapes(shapes, this.shapes)) return;
    if (this.points !== null) this.history.record(this.state);
    this.#take(points, shapes);
  }

  // What can be undone: points, cuts and parts together.
  get state() { return { points: this.points, shapes: this.shapes }; }

  #shapesOf(model) {
    const made = {};
    for (const what of ["cuts", "parts"]) {
      const clean = cleanShapes(model.get(what), what, this.shapes[what]);
      made[what] = sameShapes(clean, this.shapes[what]) ? this.shapes[what] : clean;
    }
    return made;
  }

  done(seq, sender = this.id) {
    if (sender !== this.id) return; // another window's
    for (const kind of ["move", "end"]) this.waiting[kind].delete(seq);
    this.isHeard = true;
    this.isCut = false;
    this.#tell("");
    this.#next();
  }

  // ---- to Python ----------------------------------------------------------------------------------------------------

  // `kind` says what was done; edits that share `join` in quick succession are undone as one.
  edit(points, kind, join = null) {
    const joins = this.history.record(this.state, join);
    this.#leave(points, kind, joins);
  }

  // All cuts or all parts after an edit of one, and the points if it changes them too; `kind` says what was done.
  editShapes(what, shapes, kind, points = this.points) {
    this.history.record(this.state);
    this.#leaveShapes(what, shapes, kind, points);
  }

  // The shape that is chosen, {what, index, shape} or null: Python's lists may have changed meanwhile.
  choose(chosen) {
    this.flush();
    this.last = this.seq + 1;
    this.#send("end", { type: "choose", what: null, ...chosen });
  }

  move(points) {
    this.pending.move = points;
    this.#next();
  }

  get isPythons() { return typeof this.model?.get("history")?.undo === "string"; }

  canStep(way) {
    if (!this.isPythons) return (way === "undo" ? this.history.past : this.history.future).length > 0;
    const history = this.model.get("history"), can = { undo: history.undo !== "", redo: history.redo !== "" };
    for (const step of this.#unseen()) { // an edit can be undone, and leaves nothing to redo
      if (step === "edit") Object.assign(can, { undo: true, redo: false });
      else if (can[step]) can[step === "undo" ? "redo" : "undo"] = true;
    }
    return can[way];
  }

  // What this window did that Python's history does not have yet: "edit", "undo" or "redo", oldest first.
  #unseen() {
    const seen = this.model?.get("seen")?.[this.id] ?? 0;
    this.steps = this.steps.filter(({ seq }) => seq > seen);
    return [...this.steps.map(({ what }) => what), ...(this.pending.end ? ["edit"] : [])];
  }

  // The number of the next message, which changes what can be undone: until Python has seen it, we are ahead of it.
  #counted(what) {
    this.last = this.seq + 1;
    this.steps.push({ seq: this.last, what });
  }

  // One step of the history, this page's or Python's. False where there is none.
  step(way) {
    if (!this.canStep(way)) return false;
    if (!this.isPythons) {
      const { points, shapes } = this.history[way](this.state);
      for (const what of ["cuts", "parts"]) {
        if (!sameShapes(shapes[what], this.shapes[what])) this.#leaveShapes(what, shapes[what], way, points);
      }
      if (!samePoints(points, this.points)) this.#leave(points, way, false);
    } else {
      this.pending.move = null;
      this.flush();
      this.#counted(way);
      this.lastAt = this.clock.now();
      this.#send("end", { type: "history", way });
      this.#notify("history");
    }
    return true;
  }

  // What waits is sent now, for whatever comes next must not overtake it.
  flush() {
    const { pending: { end }, drawn } = this;
    this.pending.end = null;
    if (!end) return;
    this.#counted("edit");
    this.drawn = null; // what a view has measured in the drag goes along once
    this.#send("end", { type: "edit", phase: "end", next_id: this.nextId, ...end, ...(drawn && { drawn }) });
  }

  #leave(points, kind, joins) {
    const waits = this.pending.end;
    this.pending.move = null;
    this.pending.end = waits ? { kind: kind === waits.kind ? kind : "several", joins: joins && waits.joins, points }
      : { kind, joins, points };
    this.lastAt = this.clock.now();
    this.#take(points);
    this.#next();
  }

  // Shapes are drawn now and then, and go at once, behind what waits.
  #leaveShapes(what, shapes, kind, points = this.points) {
    this.pending.move = null;
    this.flush();
    this.lastAt = this.clock.now();
    this.#counted("edit");
    const others = points === this.points ? {} : { points };
    this.#take(points, { ...this.shapes, [what]: cleanShapes(shapes, what, this.shapes[what]) });
    this.#send("end", { type: "shapes", what, kind, shapes: this.shapes[what], ...others });
  }

  #take(points, shapes = this.shapes) {
    this.points = points;
    this.shapes = shapes;
    this.nextId = nextId(points, this.nextId);
    this.#notify("points");
  }

  #next() {
    const { pending, waiting } = this, isBusy = this.status !== "";
    if (pending.end && waiting.end.size < (isBusy ? 1 : EDITS_IN_FLIGHT)) this.flush();
    if (pending.move && !isBusy && waiting.move.size < EDITS_IN_FLIGHT) {
      const points = pending.move;
      pending.move = null;
      this.#send("move", { type: "edit", phase: "move", kind: "move", joins: false, points });
    }
  }

  #send(group, content) {
    this.seq += 1;
    this.waiting[group].add(this.seq);
    this.sentAt = this.clock.now();
    this.#watch();
    try {
      this.model?.send({ ...content, sender: this.id, seq: this.seq });
    } catch (error) { // the connection that it went by is closed
      console.warn("an edit could not be sent:", error);
      this.isCut = true;
      this.#tell("lost");
    }
  }

  // ---- a kernel that does not answer --------------------------------------------------------------------------------

  #watch() {
    this.clock.cancel(this.timer);
    this.timer = this.clock.later(() => this.#unanswered(), LOST_AFTER);
  }

  // What was sent is not sent again: it will be answered late, or never. What waits goes its way.
  #unanswered() {
    const { move, end } = this.waiting;
    if (move.size + end.size === 0) return;
    move.clear();
    end.clear();
    this.#tell(this.isCut ? "lost" : this.isHeard ? "busy" : "silent");
    if (this.status === "silent") this.timer = this.clock.later(() => this.#deaf(), LOST_AFTER);
    this.#next();
  }

  // anywidget gives a model two seconds to load its module. On a busy machine, as when a notebook is loaded again, that
  // is too short, and then it drops all that comes for the model, for good, although the model is shown and can speak.
  #deaf() {
    if (!this.isHeard && this.model?.widget_manager?.kernel?.status === "idle") this.#tell("deaf");
  }

  // A page that opens says so to Python: where nobody hears it, that must be seen before anything is edited. A busy kernel
  // answers later; of one that is idle, no answer will come.
  greet() {
    if (this.isHeard || this.isGreeted || this.model?.widget_manager?.kernel === undefined) return; // a host that does not say
    this.isGreeted = true;
    try { this.model.send({ type: "greet", sender: this.id, seq: 0 }); } catch { this.isCut = true; }
    this.#expectAnswer();
  }

  #expectAnswer() {
    const kernel = this.model?.widget_manager?.kernel;
    if (this.isHeard) return;
    if (this.isCut || kernel === null) { this.#tell("lost"); return; }
    this.greeting = this.clock.later(() => { this.#deaf(); this.#expectAnswer(); }, LOST_AFTER);
  }

  #tell(status) {
    if (status === this.status && status !== "lost") return; // what is lost is said of each edit
    this.status = status;
    this.#notify("status");
  }

  #notify(what) { for (const listener of this.listeners) listener(what); }
}

// A trait that a hand changes several times before it is done, such as what a band selects. It is told after a rest; until
// then what Python says of it is from before.
const REST_OF_HAND = 150; // milliseconds

export class RestingTrait {
  constructor(model, name) { Object.assign(this, { model, name, timer: null }); }

  get isAhead() { return this.timer !== null; }

  tellSoon(value) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.timer = null;
      this.model.set(this.name, value);
      this.model.save_changes();
    }, REST_OF_HAND);
  }

  close() {
    clearTimeout(this.timer);
    this.timer = null;
  }
}

// The sender of an editor's bus, made when first asked for; anywidget's `initialize` asks before any view does.
export function senderOf(bus, model) {
  if (!bus.sender) {
    bus.sender = new Sender();
    bus.sender.attach(model);
  }
  return bus.sender;
}

// A value on its way to Python: movements at most two in flight, the newest kept; ends always sent, and none waits behind
// a movement. Python says in what it shows which end of each page it has seen last: until that is ours, what it shows is
// from before, and the hand goes first. No DOM.

const MOVES_IN_FLIGHT = 2;

export class EditLink {
  constructor(send, now = () => performance.now()) {
    Object.assign(this, { post: send, now, id: Math.random().toString(36).slice(2, 12), seq: 0, last: 0, endedAt: 0,
      waiting: new Set(), pending: null, sentAt: 0 });
  }

  move(value) {
    if (this.waiting.size && this.now() - this.sentAt > LOST_AFTER) this.waiting.clear();
    if (this.waiting.size >= MOVES_IN_FLIGHT) { this.pending = value; return; }
    this.#send("move", value);
  }

  end(value) {
    this.pending = null;
    this.#send("end", value);
    this.last = this.seq;
    this.endedAt = this.now();
  }

  done(seq) {
    this.waiting.delete(seq);
    if (this.pending === null || this.waiting.size >= MOVES_IN_FLIGHT) return;
    const value = this.pending;
    this.pending = null;
    this.#send("move", value);
  }

  isBehind(seen) { return (seen?.[this.id] ?? 0) < this.last && this.now() - this.endedAt < TRUSTED_FOR; }

  #send(phase, value) {
    this.seq += 1;
    if (phase === "move") { this.waiting.add(this.seq); this.sentAt = this.now(); }
    this.post({ type: "edit", seq: this.seq, view: this.id, phase, value });
  }
}
