// A model without Jupyter: it replaces anywidget's, over any channel or none.
//
//   const model = new PlainModel(state, { deliver: (message, buffers) => {...}, save: (changed) => {...} });
//   const close = await widget.render({ model, el });
//   model.receive(content, buffers)      a custom message from the other side
//   model.update(state)                  traits that the other side has changed
//   model.confirm(state)                 its values of traits that we have saved; with `isAnswered` once for each save
//
// `deliver` receives the messages of model.send; `save` the traits that the front end has changed. Until our last
// save of a trait is answered, values of that trait from the other side are old.

import type { AnyModel } from "@anywidget/types";
import type { Model, ModelHandler, Values } from "../types.ts";

type Buffers = ArrayBuffer[] | ArrayBufferView[];

export class PlainModel implements Model {
  state: Values;
  deliver: (content: Values, buffers: Buffers) => void;
  save: (changed: Values) => void;
  isAnswered: boolean;
  handlers = new Map<string, ModelHandler[]>();
  changed: Values = {};
  unanswered = new Map<string, number>();
  widget_manager: Model["widget_manager"];

  constructor(
    state: Values,
    {
      deliver = () => {},
      save = () => {},
      models = {},
      isAnswered = false,
    }: {
      deliver?: (content: Values, buffers: Buffers) => void;
      save?: (changed: Values) => void;
      models?: Record<string, Model>;
      isAnswered?: boolean;
    } = {},
  ) {
    this.state = { ...state };
    this.deliver = deliver;
    this.save = save;
    this.isAnswered = isAnswered;
    this.widget_manager = {
      get_model: async <Traits extends Values>(id: string) => {
        const model = models[id];
        if (!model) throw new Error(`there is no model ${id}`);
        return model as AnyModel<Traits>;
      },
    };
  }

  get(name: string) {
    return this.state[name];
  }

  /** @param name or values of several traits */
  set(name: string | Values, value?: unknown) {
    const given: Values = typeof name === "object" ? name : { [name]: value };
    this.#take(given);
    Object.assign(this.changed, given);
  }

  save_changes() {
    const { changed, unanswered } = this,
      names = Object.keys(changed);
    this.changed = {};
    if (!names.length) return;
    if (this.isAnswered) for (const name of names) unanswered.set(name, (unanswered.get(name) ?? 0) + 1);
    this.save(changed);
  }

  send(content: Values, _callbacks?: unknown, buffers: Buffers = []) {
    this.deliver(content, buffers);
  }

  on(names: string, handler: ModelHandler) {
    for (const name of names.split(" ")) this.handlers.set(name, [...(this.handlers.get(name) ?? []), handler]);
  }

  off(names?: string | null, handler?: ModelHandler | null) {
    if (!names) {
      this.handlers.clear();
      return;
    }
    for (const name of names.split(" ")) {
      const kept = (this.handlers.get(name) ?? []).filter((other) => handler && other !== handler);
      this.handlers.set(name, kept);
    }
  }

  receive(content: Values, buffers: Buffers = []) {
    this.#emit("msg:custom", content, buffers);
  }

  update(state: Values) {
    this.#take(Object.fromEntries(Object.entries(state).filter(([name]) => !this.unanswered.get(name))));
  }

  confirm(state: Values) {
    for (const name of Object.keys(state)) {
      this.unanswered.set(name, Math.max(0, (this.unanswered.get(name) ?? 0) - 1));
    }
    const others = Object.entries(state).filter(
      ([name, value]) => !(name in this.changed) && JSON.stringify(value) !== JSON.stringify(this.state[name]),
    );
    this.update(Object.fromEntries(others)); // refused values; the same value again is no change
  }

  #take(given: Values) {
    const news = Object.entries(given).filter(([name, value]) => this.state[name] !== value);
    for (const [name, value] of news) this.state[name] = value;
    for (const [name] of news) this.#emit(`change:${name}`);
    if (news.length) this.#emit("change");
  }

  #emit(name: string, ...given: unknown[]) {
    for (const handler of this.handlers.get(name) ?? []) handler(...given);
  }
}
