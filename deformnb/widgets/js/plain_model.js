// A model without Jupyter: what a widget's page expects of anywidget's, over any channel or none. No DOM.
//
//   const model = new PlainModel(state, { deliver: (message, buffers) => {...}, save: (changed) => {...} });
//   const close = await widget.render({ model, el });
//   model.receive(content, buffers)      a custom message for the page
//   model.update(state)                  traits that the other side has changed
//
// `deliver` gets what the page sends with model.send; `save` gets the traits that the page has changed.

class PlainModel {
  constructor(state, { deliver = () => {}, save = () => {}, models = {} } = {}) {
    Object.assign(this, { state: { ...state }, deliver, save, handlers: new Map(), changed: {} });
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
    const { changed } = this;
    this.changed = {};
    if (Object.keys(changed).length) this.save(changed);
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

  update(state) { this.#take(state); }

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
