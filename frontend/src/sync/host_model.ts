// A model without Jupyter: it stands in for anywidget's, over any channel or none.
//
//   const model = new PlainModel(state, { deliver: (message, buffers) => {...}, save: (changed) => {...} });
//   const close = await widget.render({ model, el });
//   model.receive(content, buffers)      a custom message from the other side
//   model.update(state)                  traits that the other side has changed
//   model.answered(state)                its values of traits that we have saved; with `isAnswered` once for each save
//
// `deliver` gets the messages of model.send; `save` gets the traits that the front end has changed. Until our last
// save of a trait is answered, values of that trait from the other side are old.

/** @import { Model } from "../types.d.ts" */

/** @typedef {Record<string, any>} State  values of traits by their names */

/** @implements {Model} */
export class PlainModel {
  /**
   * @param {State} state
   * @param {{ deliver?: (content: any, buffers: any[]) => void, save?: (changed: State) => void,
   *   models?: Record<string, any>, isAnswered?: boolean }} [options]
   */
  constructor(state, { deliver = () => {}, save = () => {}, models = {}, isAnswered = false } = {}) {
    /** @type {State} */
    this.state = { ...state };
    this.deliver = deliver;
    this.save = save;
    this.isAnswered = isAnswered;
    /** @type {Map<string, ((...args: any[]) => void)[]>} */
    this.handlers = new Map();
    /** @type {State} */
    this.changed = {};
    /** @type {Map<string, number>} */
    this.unanswered = new Map();
    this.widget_manager = { get_model: async (/** @type {string} */ id) => {
      if (!models[id]) throw new Error(`there is no model ${id}`);
      return models[id];
    } };
  }

  /** @param {any} name */
  get(name) { return this.state[name]; }

  /**
   * @param {any} name  or values of several traits
   * @param {any} [value]
   */
  set(name, value) {
    /** @type {State} */
    const given = typeof name === "object" ? name : { [name]: value };
    this.#take(given);
    Object.assign(this.changed, given);
  }

  save_changes() {
    const { changed, unanswered } = this, names = Object.keys(changed);
    this.changed = {};
    if (!names.length) return;
    if (this.isAnswered) for (const name of names) unanswered.set(name, (unanswered.get(name) ?? 0) + 1);
    this.save(changed);
  }

  /** @param {any} content @param {any} [_callbacks] @param {any[]} [buffers] */
  send(content, _callbacks, buffers = []) { this.deliver(content, buffers); }

  /** @param {string} names @param {(...args: any[]) => void} handler */
  on(names, handler) {
    for (const name of names.split(" ")) this.handlers.set(name, [...(this.handlers.get(name) ?? []), handler]);
  }

  /** @param {string | null} [names] @param {((...args: any[]) => void) | null} [handler] */
  off(names, handler) {
    if (!names) { this.handlers.clear(); return; }
    for (const name of names.split(" ")) {
      const kept = (this.handlers.get(name) ?? []).filter((other) => handler && other !== handler);
      this.handlers.set(name, kept);
    }
  }

  /** @param {any} content @param {any[]} [buffers] */
  receive(content, buffers = []) { this.#emit("msg:custom", content, buffers); }

  /** @param {State} state */
  update(state) {
    this.#take(Object.fromEntries(Object.entries(state).filter(([name]) => !this.unanswered.get(name))));
  }

  /** @param {State} state */
  answered(state) {
    for (const name of Object.keys(state)) {
      this.unanswered.set(name, Math.max(0, (this.unanswered.get(name) ?? 0) - 1));
    }
    const others = Object.entries(state).filter(([name, value]) => !(name in this.changed)
      && JSON.stringify(value) !== JSON.stringify(this.state[name]));
    this.update(Object.fromEntries(others)); // refused values; the same value again is no change
  }

  /** @param {State} given */
  #take(given) {
    const news = Object.entries(given).filter(([name, value]) => this.state[name] !== value);
    for (const [name, value] of news) this.state[name] = value;
    for (const [name] of news) this.#emit(`change:${name}`);
    if (news.length) this.#emit("change");
  }

  /** @param {string} name @param {any[]} given */
  #emit(name, ...given) {
    for (const handler of this.handlers.get(name) ?? []) handler(...given);
  }
}
