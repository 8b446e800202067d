// The widget manager of the application's client: ipywidgets' own front end, over trame's socket instead of a kernel's.
//
// Python sends messages for widgets under one topic; those of the client are calls of a procedure, which returns when
// Python's widget has received the message. A kernel's state "idle" means the same.

import * as base from "@jupyter-widgets/base";
import { ManagerBase } from "@jupyter-widgets/base-manager";
import * as controls from "@jupyter-widgets/controls";
import { defined } from "./amd.ts"; // before the next: anywidget's package is an AMD module
import "anywidget";

import type { Model, Values } from "../types.ts";
import { showInLanguage } from "../ui/words.ts";
import { APP_PAGE, callPython } from "./session.ts";
import type { Session } from "./types.ts";

/** Values of traits by their names */
export type State = Record<string, unknown>;
export type CommData = { method: string; state?: State; content?: unknown; buffer_paths?: unknown[][] };

/** Python's message to a widget */
export interface CommMessage {
  widget: string;
  data: CommData;
  buffers: unknown[];
  /** Id of the message by a client that this is the echo of */
  parent?: string;
  /** States of widgets that the data are the first to refer to */
  opened?: Record<string, State>;
}

const TOPIC = "deformnb.comm";

const MODULES: Record<string, object> = {
  "@jupyter-widgets/base": base,
  "@jupyter-widgets/controls": controls,
  anywidget: defined.exports,
};

/** Bytes are received as arrays of the socket's type; the widgets expect those of Jupyter. */
function withViews(value: unknown): unknown {
  if (value instanceof Uint8Array) return new DataView(value.buffer, value.byteOffset, value.byteLength);
  if (Array.isArray(value)) return value.map(withViews);
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([key, part]) => [key, withViews(part)]));
}

function asBytes(buffer: ArrayBuffer | ArrayBufferView) {
  return ArrayBuffer.isView(buffer)
    ? new Uint8Array(buffer.buffer, buffer.byteOffset, buffer.byteLength)
    : new Uint8Array(buffer);
}

let sent = 0; // messages of this client

/** The channel of one widget. */
class SocketComm {
  comm_id: string;
  receive: (message: object) => void;

  target_name = "jupyter.widget";

  constructor(
    readonly session: Session,
    id: string,
  ) {
    this.comm_id = id;
    this.receive = () => {};
  }

  on_msg(handler: (message: object) => void) {
    this.receive = handler;
  }

  /** Widgets are closed by Python, which then shows others. */
  on_close() {}

  close() {
    return "";
  }

  send(data: CommData, callbacks?: Values, _metadata?: unknown, buffers: (ArrayBuffer | ArrayBufferView)[] = []) {
    const id = `${APP_PAGE}-${++sent}`;
    const idle = () => callbacks?.iopub?.status?.({ content: { execution_state: "idle" } });
    callPython(this.session, "deformnb.comm", [this.comm_id, data, id, buffers.map(asBytes)]).then(idle);
    return id;
  }
}

/** The studio's model and the states of all widgets; one of them holds the words of its language. */
interface Opened {
  studio: string;
  widgets: Record<string, State>;
}

export class WidgetManager extends ManagerBase {
  /** Of this host, for widgets that name it. */
  readonly isApplication = true;
  comms = new Map<string, SocketComm>();
  isClosed = false;
  opened: Promise<void>;
  haveOpened: () => void = () => {};
  subscription: object;

  constructor(readonly session: Session) {
    super();
    /** The states of all widgets are loaded; messages may be received before */
    this.opened = new Promise((resolve) => {
      this.haveOpened = resolve;
    });
    this.subscription = session.subscribe<CommMessage>(TOPIC, ([message]) => this.receive(message));
  }

  /** The view of the studio. */
  async open() {
    const { studio, widgets } = await this.session.call<Opened>("deformnb.open", []);
    this.#add(widgets);
    this.haveOpened();
    const { words = {}, language = "" }: { words?: Record<string, string>; language?: string } =
      Object.values(widgets).find(({ words: its }) => Object.keys(its ?? {}).length > 0) ?? {};
    if (language) showInLanguage(document.body, words, language); // the page around the studio too
    return this.create_view(await this.get_model(studio));
  }

  async receive({ widget, data, buffers, parent, opened = {} }: CommMessage) {
    await this.opened;
    if (this.isClosed) return;
    this.#add(opened);
    await this.get_model(widget); // it listens from then on
    this.comms.get(widget)?.receive({
      content: { data: withViews(data) },
      buffers: buffers.map(withViews),
      parent_header: { msg_id: parent },
    });
  }

  #add(states: Record<string, State>) {
    for (const [id, state] of Object.entries(states)) {
      if (this.has_model(id)) continue;
      const comm = new SocketComm(this.session, id);
      this.comms.set(id, comm);
      const model = {
        model_name: String(state._model_name),
        model_module: String(state._model_module),
        model_module_version: String(state._model_module_version),
      };
      this.new_model({ ...model, model_id: id, comm }, withViews(state));
    }
  }

  /** The models of all widgets. */
  models() {
    return Promise.all([...this.comms.keys()].map((id) => this.get_model(id))) as unknown as Promise<Model[]>;
  }

  /** The id of a model; empty for none. */
  idOf(model: Model | undefined) {
    return String((model as { model_id?: string } | undefined)?.model_id ?? "");
  }

  /** Notify the widgets that their Python is away. */
  async lose() {
    for (const model of await this.models()) Object.assign(model, { comm_live: false });
  }

  async loadClass(className: string, moduleName: string) {
    const found = (MODULES[moduleName] as Values | undefined)?.[className];
    if (!found) throw new Error(`the page has no ${className} of ${moduleName}`);
    return found;
  }

  async _create_comm(): Promise<never> {
    throw new Error("the client makes no widgets itself");
  }

  async _get_comm_info() {
    return {};
  }

  async close() {
    this.isClosed = true;
    await this.session.unsubscribe(this.subscription)?.catch?.(() => {});
    await this.clear_state();
  }
}
