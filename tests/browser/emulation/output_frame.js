// The script of a frame with outputs of an emulated notebook: a widget manager on ipywidgets' own base classes, with
// ipywidgets' controls and anywidget's front end. All messages pass the parent window.
//
// Of two kinds, as the notebook page says in the frame's address:
//   one    the frame has all outputs, and all comms of the kernel, as the webview of VS Code
//   each   the frame has one output, and loads only the models that this one refers to, by the interface of Colab's
//          widget managers: createWidgetManager({ getModelState, openCommChannel, renderOutput })

import * as base from "@jupyter-widgets/base";
import { ManagerBase } from "@jupyter-widgets/base-manager";
import * as controls from "@jupyter-widgets/controls";
import "@jupyter-widgets/controls/css/widgets.css";
import { Widget } from "@lumino/widgets";
import { defined } from "../../../frontend/src/app/amd.ts"; // before the next: anywidget's package is an AMD module
import "anywidget";

const MODULES = {
  "@jupyter-widgets/base": base,
  "@jupyter-widgets/controls": controls,
  anywidget: defined.exports,
};

/** What the managers of both kinds have in common: the classes of this frame, and no widget that is made in the page. */
class PageManager extends ManagerBase {
  async loadClass(className, moduleName) {
    const found = MODULES[moduleName]?.[className];
    if (!found) throw new Error(`the frame has no ${className} of ${moduleName}`);
    return found;
  }

  async _create_comm() {
    throw new Error("no widget is made in the page");
  }

  async _get_comm_info() {
    return {};
  }

  async render(id, element) {
    const view = await this.create_view(await this.get_model(id));
    Widget.attach(view.luminoWidget, element);
  }
}

const parts = (buffers = []) =>
  buffers.map((b) =>
    ArrayBuffer.isView(b) ? b.buffer.slice(b.byteOffset, b.byteOffset + b.byteLength) : b.slice(0),
  );

const post = (message) => window.parent.postMessage(message, "*");

// ---- one frame for all outputs ----------------------------------------------------------------------------------------

class KernelComm {
  target_name = "jupyter.widget";
  heard = () => {};
  closed = () => {};

  constructor(manager, id) {
    this.manager = manager;
    this.comm_id = id;
  }

  on_msg(heard) {
    this.heard = heard;
  }

  on_close(closed) {
    this.closed = closed;
  }

  send(data, callbacks, metadata, buffers) {
    const id = crypto.randomUUID?.() ?? String(Math.random());
    this.manager.awaited.set(id, callbacks);
    post({ type: "send", id, comm: this.comm_id, data: JSON.parse(JSON.stringify(data)), buffers: parts(buffers) });
    return id;
  }

  close() {
    return "";
  }
}

class FrameManager extends PageManager {
  comms = new Map();
  awaited = new Map();

  /** A message of the kernel, in the order in which they come. */
  async receive({ kind, content, buffers, parent }) {
    const views = buffers.map((b) => new DataView(b)),
      message = { content, buffers: views, parent_header: { msg_id: parent }, metadata: { version: "2.1.0" } };
    if (kind === "comm_open") {
      if (content.target_name !== "jupyter.widget") return;
      const comm = new KernelComm(this, content.comm_id);
      this.comms.set(content.comm_id, comm);
      await this.handle_comm_open(comm, message);
    } else if (kind === "comm_msg") this.comms.get(content.comm_id)?.heard(message);
    else if (kind === "comm_close") {
      this.comms.get(content.comm_id)?.closed(message);
      this.comms.delete(content.comm_id);
    } else if (kind === "status" && content.execution_state === "idle") {
      this.awaited.get(parent)?.iopub?.status?.(message);
      this.awaited.delete(parent);
    }
  }
}

// ---- a frame for each output ------------------------------------------------------------------------------------------

class ChannelComm {
  target_name = "";

  constructor(id, channel) {
    this.comm_id = id;
    this.channel = channel;
  }

  async on_msg(heard) {
    for await (const { data, buffers } of this.channel.messages) {
      heard({ content: { comm_id: this.comm_id, data }, buffers: buffers.map((b) => new Uint8Array(b)) });
    }
  }

  async on_close(closed) {
    for await (const _ of this.channel.messages);
    closed();
  }

  send(data, callbacks, metadata, buffers) {
    const idle = () => callbacks?.iopub?.status?.({ content: { execution_state: "idle" } });
    this.channel.send(JSON.parse(JSON.stringify(data)), { buffers: parts(buffers) }).then(idle);
    return ""; // this interface gives no ids of messages
  }

  close() {
    this.channel.close();
    return "";
  }
}

class LazyManager extends PageManager {
  asked = new Map();

  constructor(environment) {
    super();
    this.environment = environment;
  }

  /** A model is made when something refers to it. */
  get_model(id) {
    if (!this.asked.has(id)) this.asked.set(id, this.#load(id));
    return this.asked.get(id);
  }

  async #load(id) {
    const found = await this.environment.getModelState(id);
    if (!found) throw new Error(`no model ${id}`);
    const { modelName: model_name, modelModule: model_module, modelModuleVersion: model_module_version } = found,
      { buffer_paths, buffers } = base.remove_buffers(found.state);
    base.put_buffers(found.state, buffer_paths, buffers);
    const comm = found.comm && new ChannelComm(id, found.comm);
    return this.new_model({ model_name, model_module, model_module_version, model_id: id, comm }, found.state);
  }
}

/** The channel of a comm: several readers, each of which gets all messages from when it begins. */
class Channel {
  queues = new Set();

  constructor(id) {
    this.id = id;
  }

  receive(message) {
    for (const queue of this.queues) queue(message);
  }

  get messages() {
    const waiting = [],
      { queues } = this;
    let wake = () => {};
    const add = (message) => {
      waiting.push(message);
      wake();
    };
    queues.add(add);
    return (async function* read() {
      for (;;) {
        while (!waiting.length)
          await new Promise((done) => {
            wake = done;
          });
        const next = waiting.shift();
        if (!next) return;
        yield next;
      }
    })();
  }

  send(data, { buffers = [] } = {}) {
    return request({ type: "send", comm: this.id, data, buffers: parts(buffers) });
  }

  close() {}
}

const channels = new Map(),
  answers = new Map();

function request(message) {
  const id = crypto.randomUUID?.() ?? String(Math.random());
  return new Promise((done) => {
    answers.set(id, done);
    post({ ...message, id });
  });
}

const environment = {
  async getModelState(modelId) {
    const found = await request({ type: "state", comm: modelId });
    if (!found) return undefined;
    channels.set(modelId, new Channel(modelId));
    const { _model_name, _model_module, _model_module_version } = found;
    return {
      modelName: _model_name,
      modelModule: _model_module,
      modelModuleVersion: _model_module_version,
      state: found,
      comm: channels.get(modelId),
    };
  },
};

// ---- the conversation with the notebook page --------------------------------------------------------------------------

const isShared = new URLSearchParams(window.location.search).get("outputs") === "one";
const chosen = new URLSearchParams(window.location.search).get("manager");
const container = document.querySelector("#outputs");
const manager = isShared
  ? new FrameManager()
  : chosen
    ? (await import(chosen)).createWidgetManager(environment)
    : new LazyManager(environment);

let last = Promise.resolve();
window.addEventListener("message", ({ data }) => {
  if (data.type === "answer") {
    answers.get(data.id)?.(data.answer);
    answers.delete(data.id);
  } else if (data.type === "kernel" && isShared) last = last.then(() => manager.receive(data)).catch(report);
  else if (data.type === "kernel") {
    const { kind, content, buffers } = data;
    if (kind === "comm_msg") channels.get(content.comm_id)?.receive({ data: content.data, buffers });
    if (kind === "comm_close") channels.get(content.comm_id)?.receive(null);
  } else if (data.type === "render") {
    const output = document.createElement("div");
    output.className = "output";
    container.append(output);
    last = last.then(() => manager.render(data.model, output)).catch(report);
  } else if (data.type === "theme") setTheme(data);
});

function report(error) {
  console.error(error);
  setTimeout(() => {
    throw error; // the tests watch for the errors of a page
  });
}

function setTheme({ classes, attributes, variables }) {
  document.body.className = classes;
  for (const [name, value] of Object.entries(attributes)) document.body.setAttribute(name, value);
  for (const [name, value] of Object.entries(variables)) document.documentElement.style.setProperty(name, value);
}

new ResizeObserver(() => post({ type: "height", height: container.offsetHeight })).observe(container);
post({ type: "ready" });
