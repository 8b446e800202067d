// The page of an emulated notebook: its cells, the frames of their outputs, and the socket to the server that has the
// kernel. Frames have other origins than this page, and reach it by messages alone.

const settings = JSON.parse(document.querySelector("#settings").textContent);
const socket = new WebSocket(`ws://${location.host}/kernel`);
socket.binaryType = "arraybuffer";
const opened = new Promise((done) => { socket.onopen = done; });

/** States of all models by the ids of their comms, as the kernel has sent them. */
const states = new Map();

/** [iframe, messages until it is loaded or null, ids of comms that it has asked for] */
const frames = [];
const runs = new Map(); // by the id of the request

function decode(data) {
  const head = new DataView(data).getUint32(0), { sizes, ...message } = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, head)));
  let at = 4 + head;
  message.buffers = sizes.map((size) => { const part = data.slice(at, at + size); at += size; return part; });
  return message;
}

function encode({ buffers = [], ...message }) {
  const head = new TextEncoder().encode(JSON.stringify({ ...message, sizes: buffers.map((b) => b.byteLength) }));
  const all = new Uint8Array(4 + head.length + buffers.reduce((sum, b) => sum + b.byteLength, 0));
  new DataView(all.buffer).setUint32(0, head.length);
  all.set(head, 4);
  let at = 4 + head.length;
  for (const b of buffers) { all.set(new Uint8Array(b), at); at += b.byteLength; }
  return all;
}

function put(state, paths, buffers) {
  paths.forEach((path, k) => {
    let at = state;
    for (const name of path.slice(0, -1)) at = at[name];
    at[path.at(-1)] = buffers[k];
  });
  return state;
}

function post(frame, message) {
  if (frame.waiting) frame.waiting.push(message);
  else frame.element.contentWindow.postMessage(message, "*");
}

socket.onmessage = ({ data }) => {
  const { kind, content, parent, buffers } = decode(data);
  const { comm_id: comm, data: { state, buffer_paths: paths = [], method } = {} } = content;
  if (kind === "comm_open" && state) states.set(comm, put(structuredClone(state), paths, buffers));
  if (kind === "comm_msg" && (method === "update" || method === "echo_update"))
    Object.assign(states.get(comm) ?? {}, put(structuredClone(state), paths, buffers));
  if (kind === "comm_close") states.delete(comm);
  for (const frame of frames) {
    const isMeant = settings.outputs === "one" ? kind.startsWith("comm") || kind === "status" : frame.comms.has(comm);
    if (isMeant) post(frame, { type: "kernel", kind, content, parent, buffers });
    if (kind === "status" && content.execution_state === "idle" && frame.sent.delete(parent))
      post(frame, { type: "answer", id: parent });
  }
  const run = runs.get(parent);
  if (run) run(kind, content);
};

window.addEventListener("message", ({ data, source }) => {
  const frame = frames.find(({ element }) => element.contentWindow === source);
  if (!frame) return;
  const { type, id, comm } = data;
  if (type === "ready") {
    const waiting = frame.waiting;
    frame.waiting = null;
    post(frame, { type: "theme", ...settings.theme });
    for (const message of waiting) post(frame, message);
  } else if (type === "height") frame.element.style.height = `${data.height}px`;
  else if (type === "state") {
    frame.comms.add(comm);
    post(frame, { type: "answer", id, answer: structuredClone(states.get(comm)) });
  } else if (type === "send") {
    frame.sent.add(id);
    const { method, state, buffer_paths: paths = [] } = data.data;
    if (method === "update" && states.has(comm)) Object.assign(states.get(comm), put(structuredClone(state), paths, data.buffers));
    socket.send(encode({ kind: "comm_msg", id, content: { comm_id: comm, data: data.data }, buffers: data.buffers }));
  }
});

function addFrame(place) {
  const element = document.createElement("iframe");
  element.setAttribute("sandbox", settings.sandbox);
  element.src = settings.frame.replace("{number}", frames.length);
  element.style.cssText = "width: 100%; border: 0; height: 0";
  const frame = { element, waiting: [], comms: new Set(), sent: new Set() };
  frames.push(frame);
  place.append(element);
  return frame;
}

const notebook = { outputs: "", frames };
window.notebook = notebook;
const cells = document.querySelector("#cells");
// The one frame of a notebook is there before its cells run.
if (settings.outputs === "one") addFrame(document.querySelector("#webview"));

let count = 0;
function request(code, cell, received) {
  const id = `run-${++count}`;
  return new Promise((done) => {
    runs.set(id, (kind, content) => {
      received(kind, content);
      if (kind === "status" && content.execution_state === "idle") { runs.delete(id); done(); }
    });
    opened.then(() => socket.send(encode({ kind: "execute_request", id, cell, content: { code, silent: false,
      store_history: Boolean(cell), user_expressions: {}, allow_stdin: true, stop_on_error: true } })));
  });
}

/** Run a new cell, or run one again; its widgets are shown in frames. */
notebook.run = (code, number = cells.children.length) => {
  const cell = cells.children[number] ?? cells.appendChild(document.createElement("div"));
  cell.replaceChildren(Object.assign(document.createElement("pre"), { textContent: code.slice(0, 200) }));
  const place = cell.appendChild(document.createElement("div"));
  notebook.started = performance.timeOrigin + performance.now();
  return request(code, settings.cells ? `cell-${number}` : "", (kind, { data, text, traceback }) => {
    const view = data?.["application/vnd.jupyter.widget-view+json"];
    if (view) post(settings.outputs === "one" ? frames[0] : addFrame(place), { type: "render", model: view.model_id });
    else if (traceback) notebook.outputs += traceback.join("\n");
    else if (text) notebook.outputs += text;
  });
};

/** The printed text of a code that belongs to no cell. */
notebook.ask = async (code) => {
  let printed = "";
  await request(code, "", (kind, { text, traceback }) => { printed += text ?? traceback?.join("\n") ?? ""; });
  return printed;
};

/** Change the theme of the frames. */
notebook.setTheme = (theme) => {
  settings.theme = theme;
  for (const frame of frames) post(frame, { type: "theme", ...theme });
};
