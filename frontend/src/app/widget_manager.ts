// The widget manager of the application's page: ipywidgets' own front end, over trame's socket instead of a kernel's.
//
// Python sends messages for widgets under one topic; those of the page are calls of a procedure, which returns when
// Python's widget has taken the message. That is what a kernel's state "idle" says.

import * as base from "@jupyter-widgets/base";
import { ManagerBase } from "@jupyter-widgets/base-manager";
import * as controls from "@jupyter-widgets/controls";
import { defined } from "./amd.js"; // before the next: anywidget's package is an AMD module
import "anywidget";
import { showInLanguage } from "../ui/words.js";
import { APP_PAGE, callPython } from "./session.js";

/** @import { Session } from "./types.d.ts" */

/** @typedef {Record<string, unknown>} State  values of traits by their names */
/** @typedef {{method: string, state?: State, content?: unknown, buffer_paths?: unknown[][]}} CommData */

/**
 * @typedef {object} CommMessage  Python's message to a widget
 * @property {string} widget
 * @property {CommData} data
 * @property {unknown[]} buffers
 * @property {string} [parent]  id of the message by a page that this is the echo of
 * @property {Record<string, State>} [opened]  states of widgets that the data are the first to refer to
 */

const TOPIC = "deformnb.comm";

/** @type {Record<string, object>} */
const MODULES = { "@jupyter-widgets/base": base, "@jupyter-widgets/controls": controls, anywidget: defined.exports };

/**
 * Bytes come as arrays of the socket's own kind; the widgets expect what Jupyter gives.
 * @param {any} value
 * @returns {any}
 */
function withViews(value) {
  if (value instanceof Uint8Array) return new DataView(value.buffer, value.byteOffset, value.byteLength);
  if (Array.isArray(value)) return value.map(withViews);
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([key, part]) => [key, withViews(part)]));
}

/** @param {any} buffer */
function asBytes(buffer) {
  return ArrayBuffer.isView(buffer) ? new Uint8Array(buffer.buffer, buffer.byteOffset, buffer.byteLength)
    : new Uint8Array(buffer);
}

let sent = 0; // messages of this page

/** The channel of one widget. */
class SocketComm {
  target_name = "jupyter.widget";

  /**
   * @param {Session} session
   * @param {string} id
   */
  constructor(session, id) {
    this.session = session;
    this.comm_id = id;
    /** @type {(message: any) => void} */
    this.receive = () => {};
  }

  /** @param {(message: any) => void} handler */
  on_msg(handler) { this.receive = handler; }

  /** Widgets are closed by Python, which then shows others. */
  on_close() {}

  close() { return ""; }

  /**
   * @param {CommData} data
   * @param {any} [callbacks]
   * @param {unknown} [_metadata]
   * @param {any[]} [buffers]
   */
  send(data, callbacks, _metadata, buffers = []) {
    const id = `${APP_PAGE}-${++sent}`;
    const idle = () => callbacks?.iopub?.status?.({ content: { execution_state: "idle" } });
    callPython(this.session, "deformnb.comm", [this.comm_id, data, id, buffers.map(asBytes)]).then(idle);
    return id;
  }
}

export class WidgetManager extends ManagerBase {
  /** @param {Session} session */
  constructor(session) {
    super();
    this.session = session;
    /** @type {Map<string, SocketComm>} */
    this.comms = new Map();
    this.isClosed = false;
    /** @type {Promise<void>} the states of all widgets are there; messages may come before them */
    this.opened = new Promise((resolve) => { this.haveOpened = resolve; });
    this.subscription = session.subscribe(TOPIC, (/** @type {CommMessage[]} */ [message]) => this.receive(message));
  }

  /** The view of the studio. */
  async open() {
    const { studio, widgets } = await this.session.call("deformnb.open", []);
    this.#add(widgets);
    this.haveOpened?.();
    const { words = {}, language = "" } = Object.values(widgets).find(({ words: its }) => Object.keys(its ?? {}).length) ?? {};
    if (language) showInLanguage(document.body, words, language); // what stands beside the studio too
    return this.create_view(await this.get_model(studio));
  }

  /** @param {CommMessage} message */
  async receive({ widget, data, buffers, parent, opened = {} }) {
    await this.opened;
    if (this.isClosed) return;
    this.#add(opened);
    await this.get_model(widget); // it listens from then on
    this.comms.get(widget)?.receive({ content: { data: withViews(data) }, buffers: buffers.map(withViews),
      parent_header: { msg_id: parent } });
  }

  /** @param {Record<string, State>} states */
  #add(states) {
    for (const [id, state] of Object.entries(states)) {
      if (this.has_model(id)) continue;
      const comm = new SocketComm(this.session, id);
      this.comms.set(id, comm);
      const [model_name, model_module, model_module_version] = ["_model_name", "_model_module",
        "_model_module_version"].map((name) => String(state[name]));
      this.new_model({ model_name, model_module, model_module_version, model_id: id, comm }, withViews(state));
    }
  }

  /**
   * @param {string} className
   * @param {string} moduleName
   */
  async loadClass(className, moduleName) {
    const found = /** @type {any} */ (MODULES[moduleName])?.[className];
    if (!found) throw new Error(`the page has no ${className} of ${moduleName}`);
    return found;
  }

  /** @returns {Promise<never>} */
  async _create_comm() { throw new Error("the page makes no widgets of its own"); }

  async _get_comm_info() { return {}; }

  async close() {
    this.isClosed = true;
    await this.session.unsubscribe(this.subscription)?.catch?.(() => {});
    await this.clear_state();
  }
}
