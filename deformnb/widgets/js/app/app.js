// Puts the widgets' own pages into the application's page. Joined behind sync/host_model.js and app/remote.js;
// a plain script, no module.
//
// trame's client brings Vue and the socket. <deformnb-widget name="editor"> is a Vue component that asks for the state
// of that widget, gives it to a PlainModel, and draws the widget with it, as a notebook would. What the widget says
// goes to Python as calls of procedures; what Python says comes under one topic. Picture and volume fill the place they
// are given; the others are as high as they need to be.

import { PlainModel } from "../sync/host_model.js";
import { AppFiles } from "./files.js";
import { APP_PAGE, AppRemote } from "./remote.js";

const APP_TOPIC = "deformnb.widget";

// Bytes come as arrays of the socket's own kind; the widgets expect what Jupyter gives.
function appBytes(value) {
  return value instanceof Uint8Array ? new DataView(value.buffer, value.byteOffset, value.byteLength) : value;
}

function appState(state) {
  return Object.fromEntries(Object.entries(state).map(([name, value]) => [name, appBytes(value)]));
}

class AppWidgets {
  constructor(trame) {
    Object.assign(this, { trame, models: {}, opening: {}, session: null });
  }

  // The socket of now: after a broken connection it is another one, and all state comes anew.
  connect() {
    const session = this.trame.client.getConnection().getSession();
    if (session === this.session) return;
    Object.assign(this, { session, models: {}, opening: {} });
    session.subscribe(APP_TOPIC, ([message]) => this.hear(message));
  }

  hear({ widget, content, buffers, state, origin }) {
    const model = this.models[widget];
    if (!model) return;
    if (state && origin === APP_PAGE) model.answered(appState(state));
    else if (state) model.update(appState(state));
    else model.receive(content, (buffers || []).map(appBytes));
  }

  async open(name) {
    this.connect();
    this.opening[name] ??= this.#open(name);
    return this.opening[name];
  }

  async #open(name) {
    const { session } = this, answer = await session.call("deformnb.open", [name]);
    if (!answer) throw new Error("the server does not know this part of the page");
    const ids = answer.models;
    const model = new PlainModel(appState(answer.state), {
      deliver: (content) => this.call("deformnb.message", [name, content]),
      save: (changed) => this.call("deformnb.state", [name, APP_PAGE, changed], () => model.answered(changed)),
      isAnswered: true,
    });
    model.widget_manager = { get_model: (id) => this.open(ids[id.replace("IPY_MODEL_", "")]) };
    this.models[name] = model;
    return model;
  }

  // A call that fails because the connection has gone is no news: the page says so by itself.
  call(method, given, failed = () => {}) { this.session.call(method, given).catch(failed); }
}

const AppWidget = {
  props: { name: String, source: String, theme: String },
  computed: {
    fills() { return this.name === "editor" || this.name === "live"; },
  },
  watch: {
    theme: { handler() { this.paint(); }, flush: "post" },
  },
  inject: ["trame"],
  template: `<div ref="place" :class="fills ? 'dnb-app-widget' : 'dnb-app-inline'"></div>`,
  methods: {
    // Volumes look best on black. The others take the colours around them, and look again when the body says so.
    paint() {
      if (this.name === "editor") this.model?.update({ theme: this.theme });
      document.body.dataset.jpThemeLight = String(this.theme !== "dark");
    },
    // Undo and redo wherever the focus is, but where text is written or somebody else has heard the key.
    keyed(event) {
      const { target, key } = event, isUndo = key.toLowerCase() === "z", isRedo = key.toLowerCase() === "y";
      if (event.defaultPrevented || event.altKey || !(event.ctrlKey || event.metaKey) || !(isUndo || isRedo)) return;
      if (target.closest?.("input:not([type=range], [type=checkbox], [readonly]), textarea, [contenteditable]")) return;
      event.preventDefault();
      this.trame.trigger(isRedo || event.shiftKey ? "redo" : "undo");
    },
  },
  async mounted() {
    this.paint();
    if (this.name === "editor") document.addEventListener("keydown", this.keyed); // one of the page's widgets for all
    const place = this.$refs.place;
    try {
      const widgets = (this.trame.deformnb ??= new AppWidgets(this.trame));
      const [model, page] = await Promise.all([widgets.open(this.name),
        import(new URL(this.source, document.baseURI).href)]);
      if (this.isGone) return;
      if (!model.isInitialized) { // once for each model, as anywidget does
        model.isInitialized = true;
        await page.default.initialize?.({ model });
      }
      if (this.name === "editor") model.update({ fill: true });
      this.model = model;
      this.paint();
      const close = await page.default.render({ model, el: place });
      const unfit = this.fills ? fitted(this.name, model, place) : null;
      this.close = () => { unfit?.(); close?.(); };
      if (this.isGone) this.close();
    } catch (error) {
      console.error(error);
      place.textContent = `This part of the page could not be shown: ${error.message}`;
    }
  },
  beforeUnmount() {
    this.isGone = true;
    document.removeEventListener("keydown", this.keyed);
    this.close?.();
  },
};

// Picture and volume have sizes of their own; here they fill the place they are given. Returns what ends that.
function fitted(name, model, place) {
  const apply = () => {
    const { width, height } = place.getBoundingClientRect();
    if (width < 80 || height < 80) return;
    if (name === "live") {
      model.update({ width: Math.min(8192, Math.floor(width)), height: Math.min(8192, Math.floor(height)) });
    } else {
      // What the editor says around its picture: a bar above and lines below.
      const root = place.firstElementChild, stage = root?.querySelector(".dnb-ed-stage");
      const around = stage ? Math.ceil(root.offsetHeight - stage.offsetHeight) : 0;
      model.update({ height: Math.max(120, Math.min(4096, Math.floor(height) - around)) });
    }
  };
  let frame = 0; // sizes are set after they were observed, or the browser complains of a loop
  const later = () => { cancelAnimationFrame(frame); frame = requestAnimationFrame(apply); };
  const observer = new ResizeObserver(later);
  observer.observe(place);
  if (place.firstElementChild) observer.observe(place.firstElementChild); // its bars may come to need another row
  apply();
  return () => { observer.disconnect(); cancelAnimationFrame(frame); };
}

window.deformnb_app = {
  install(app) {
    app.component("deformnb-widget", AppWidget);
    app.component("deformnb-remote", AppRemote);
    app.component("deformnb-files", AppFiles);
    const { state } = window.trame; // nothing is drawn yet: what is set here holds from the first picture on
    if (window.matchMedia("(prefers-color-scheme: dark)").matches) state.set("dnb_theme", "dark");
    if (!document.createElement("canvas").getContext("webgl2")) state.set("dnb_viewer", "vtk");
  },
};
