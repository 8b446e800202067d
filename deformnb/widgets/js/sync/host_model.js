// A model without Jupyter: what a widget's page expects of anywidget's, over any channel or none. No DOM.
//
//   const model = new PlainModel(state, { deliver: (message, buffers) => {...}, save: (changed) => {...} });
//   const close = await widget.render({ model, el });
//   model.receive(content, buffers)      a custom message for the page
//   model.update(state)                  traits that the other side has changed
//   model.answered(state)                its values of traits that we have saved: where `isAnswered`, once for each save
//
// `deliver` gets what the page sends with model.send; `save` gets the traits that the page has changed. Until our last
// save of a trait is answered, what the other side says of that trait is from before.

export class PlainModel {
  constructor(state, { deliver = () => {}, save = () => {}, models = {}, isAnswered = false } = {}) {
    Object.assign(this, { state: { ...state }, deliver, save, isAnswered, handlers: new Map(), changed: {},
      unanswered: new Map() });
    this.widget_manager = { get_model: async (id) => {
      if (!models[id]) throw new Error(`there is no model ${id}`);
      return models[id];
    } };
  }

  get(name) { return this.state[name]; }

  set(name, value) {
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

  send(content, _callbacks, buffers = []) { this.deliver(content, buffers); }

  on(names, handler) {
    for (const name of names.split(" ")) this.handlers.set(name, [...(this.handlers.get(name) ?? []), handler]);
  }

  off(names, handler) {
    if (!names) { this.handlers.clear(); return; }
    for (const name of names.split(" ")) {
      const kept = (this.handlers.get(name) ?? []).filter((other) => handler && other !== handler);
      this.handlers.set(name, kept);
    }
  }

  receive(content, buffers = []) { this.#tell("msg:custom", content, buffers); }

  update(state) {
    this.#take(Object.fromEntries(Object.entries(state).filter(([name]) => !this.unanswered.get(name))));
  }

  answered(state) {
    for (const name of Object.keys(state)) this.unanswered.set(name, Math.max(0, (this.unanswered.get(name) ?? 0) - 1));
    const others = Object.entries(state).filter(([name, value]) => JSON.stringify(value) !== JSON.stringify(this.state[name])
      && !(name in this.changed));
    this.update(Object.fromEntries(others)); // what was refused; the same value again is no news
  }

  #take(given) {
    const news = Object.entries(given).filter(([name, value]) => this.state[name] !== value);
    for (const [name, value] of news) this.state[name] = value;
    for (const [name] of news) this.#tell(`change:${name}`);
    if (news.length) this.#tell("change");
  }

  #tell(name, ...given) {
    for (const handler of this.handlers.get(name) ?? []) handler(...given);
  }
}
