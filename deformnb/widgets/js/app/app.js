// Puts the widgets into the application's page.
//
// trame's client brings Vue and the socket. <deformnb-widget name="editor"> is a Vue component that requests the state
// of that widget, gives it to a PlainModel, and draws the widget with it, as a notebook would. The widget's messages
// go to Python as calls of procedures; those of Python come under one topic. Picture and volume fill the place they
// are given; the others are as high as they need to be.

import { PlainModel } from "../sync/host_model.js";
import { AppFiles } from "./files.js";
import { AppRemote } from "./remote.js";
import { APP_PAGE, callPython } from "./session.js";

/** @import { Component, Session, Trame } from "./types.d.ts" */

/** @typedef {Record<string, unknown>} State values of traits by their names */
/** @typedef {PlainModel & {isInitialized?: boolean}} AppModel */
/** @typedef {{state: State, models: Record<string, string>}} Answer names of widgets by their ids */

/**
 * @typedef {object} WidgetMessage Python's message to a widget
 * @property {string} widget
 * @property {unknown} [content]
 * @property {unknown[]} [buffers]
 * @property {State} [state]
 * @property {string} [origin]
 */

const APP_TOPIC = "deformnb.widget";
const TEXT = "input:not([type=range], [type=checkbox], [readonly]), textarea, [contenteditable]";

/**
 * Bytes come as arrays of the socket's own kind; the widgets expect what Jupyter gives.
 * @param {unknown} value
 */
function appBytes(value) {
  return value instanceof Uint8Array ? new DataView(value.buffer, value.byteOffset, value.byteLength) : value;
}

/** @param {State} state */
function appState(state) {
  return Object.fromEntries(Object.entries(state).map(([name, value]) => [name, appBytes(value)]));
}

export class AppWidgets {
  /** @param {Trame} trame */
  constructor(trame) {
    this.trame = trame;
    /** @type {Record<string, AppModel>} */
    this.models = {};
    /** @type {Record<string, Promise<AppModel>>} */
    this.pending = {};
    /** @type {Session | null} */
    this.session = null;
  }

  /** The session of now: after a broken connection it is another one, and all state comes anew. */
  connect() {
    const session = this.trame.client.getConnection().getSession();
    if (session === this.session) return session;
    this.session = session;
    this.models = {};
    this.pending = {};
    session.subscribe(APP_TOPIC, (/** @type {WidgetMessage[]} */ [message]) => this.receive(message));
    return session;
  }

  /** @param {WidgetMessage} message */
  receive({ widget, content, buffers, state, origin }) {
    const model = this.models[widget];
    if (!model) return;
    if (state && origin === APP_PAGE) model.answered(appState(state));
    else if (state) model.update(appState(state));
    else model.receive(content, (buffers || []).map(appBytes));
  }

  /**
   * The model of a widget.
   * @param {string} name
   */
  async open(name) {
    const session = this.connect();
    this.pending[name] ??= this.#open(session, name);
    return this.pending[name];
  }

  /**
   * @param {Session} session
   * @param {string} name
   */
  async #open(session, name) {
    /** @type {Answer | null} */
    const answer = await session.call("deformnb.open", [name]);
    if (!answer) throw new Error("the server does not have this part of the page");
    const ids = answer.models;
    /** @type {AppModel} */
    const model = new PlainModel(appState(answer.state), {
      deliver: (content) => this.#call("deformnb.message", [name, content]),
      save: (changed) => this.#call("deformnb.state", [name, APP_PAGE, changed], () => model.answered(changed)),
      isAnswered: true,
    });
    model.widget_manager = { get_model: (/** @type {string} */ id) => this.open(ids[id.replace("IPY_MODEL_", "")]) };
    this.models[name] = model;
    return model;
  }

  /**
   * @param {string} method
   * @param {unknown[]} given
   * @param {() => void} [failed]
   */
  #call(method, given, failed) { if (this.session) callPython(this.session, method, given, failed); }
}

/**
 * @typedef {object} Widget
 * @property {string} name
 * @property {string} source
 * @property {string} theme
 * @property {boolean} fills
 * @property {{place: HTMLElement}} $refs
 * @property {AppModel} [model]
 * @property {boolean} [isGone]
 * @property {() => void} [close]
 * @property {() => void} paint
 * @property {(event: KeyboardEvent) => void} keyed
 */

/** @type {Component<Widget>} */
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
    /** Volumes look best on black. The others take the colours around them, again when the body's data change. */
    paint() {
      if (this.name === "editor") this.model?.update({ theme: this.theme });
      document.body.dataset.jpThemeLight = String(this.theme !== "dark");
    },
    /**
     * Undo and redo wherever the focus is, but where text is written or another listener has taken the key.
     * @param {KeyboardEvent} event
     */
    keyed(event) {
      const { target, key } = event, isUndo = key.toLowerCase() === "z", isRedo = key.toLowerCase() === "y";
      if (event.defaultPrevented || event.altKey || !(event.ctrlKey || event.metaKey) || !(isUndo || isRedo)) return;
      if (target instanceof Element && target.closest(TEXT)) return;
      event.preventDefault();
      this.trame.trigger(isRedo || event.shiftKey ? "redo" : "undo");
    },
  },
  async mounted() {
    this.paint();
    if (this.name === "editor") document.addEventListener("keydown", this.keyed); // one of the page's widgets for all
    const place = this.$refs.place;
    try {
      this.trame.deformnb ??= new AppWidgets(this.trame);
      const widgets = this.trame.deformnb;
      const [model, frontEnd] = await Promise.all([widgets.open(this.name),
        import(new URL(this.source, document.baseURI).href)]);
      if (this.isGone) return;
      if (!model.isInitialized) { // once for each model, as anywidget does
        model.isInitialized = true;
        await frontEnd.default.initialize?.({ model });
      }
      if (this.name === "editor") model.update({ fill: true });
      this.model = model;
      this.paint();
      const close = await frontEnd.default.render({ model, el: place });
      const unfit = this.fills ? fitted(this.name, model, place) : null;
      this.close = () => { unfit?.(); close?.(); };
      if (this.isGone) this.close();
    } catch (error) {
      console.error(error);
      place.textContent = `This part of the page could not be shown: ${/** @type {Error} */ (error).message}`;
    }
  },
  beforeUnmount() {
    this.isGone = true;
    document.removeEventListener("keydown", this.keyed);
    this.close?.();
  },
};

/**
 * Lets a picture or a volume, which have sizes of their own, fill the place they are given. Returns a function that
 * ends that.
 * @param {string} name
 * @param {PlainModel} model
 * @param {HTMLElement} place
 */
function fitted(name, model, place) {
  const apply = () => {
    const { width, height } = place.getBoundingClientRect();
    if (width < 80 || height < 80) return;
    if (name === "live") {
      model.update({ width: Math.min(8192, Math.floor(width)), height: Math.min(8192, Math.floor(height)) });
    } else {
      // The editor has a bar above its picture and lines below.
      const root = place.firstElementChild, stage = root?.querySelector(".dnb-ed-stage");
      const around = root instanceof HTMLElement && stage instanceof HTMLElement
        ? Math.ceil(root.offsetHeight - stage.offsetHeight) : 0;
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
