// A page without a kernel: says to the pages of an editor and a live view what Python would have said.
// Joined behind sync/host_model.js; the modules of the widgets stand before it and have left what they export.
// The data is what deformnb/widgets/standalone.py writes: traits, packed voxels, the message "field", the document.

import { ClipSliders } from "./inputs/clip_sliders.js";
import { clipOf, isClipped } from "./maths/clipping.js";
import { PlainModel } from "./sync/host_model.js";

const STRENGTHS = { min: -1, max: 3, step: 0.05 };
export const NARROW = 860; // CSS pixels below which picture and volume stand one above the other
const CONTROLS = { "data-lm-suppress-shortcuts": "true" }; // should the page be shown in a notebook

// Everything binary in the data as DataView, as Jupyter hands it over; the rest as it is.
async function decodedData(value) {
  if (Array.isArray(value)) return Promise.all(value.map(decodedData));
  if (!value || typeof value !== "object") return value;
  if (typeof value.base64 === "string") return decodedBytes(value.base64, value.gzip);
  const pairs = Object.entries(value).map(async ([name, inner]) => [name, await decodedData(inner)]);
  return Object.fromEntries(await Promise.all(pairs));
}

async function decodedBytes(text, isPacked = false) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  if (!isPacked) return new DataView(bytes.buffer);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new DataView(await new Response(stream).arrayBuffer());
}

// ---- what Python would have said ------------------------------------------------------------------------------------

// Answers come later, as those of a kernel do: a page asks while it is still being built. An editor hears of its points
// first, then which of its messages they include, then that the message is done.
function editorAnswers(model) {
  return ({ type, sender, seq, phase, points, what, shapes, next_id: next = 0 }) => queueMicrotask(() => {
    const m = model();
    if (type === "shapes") m.update({ [what]: shapes });
    if (type === "edit" && phase === "end") m.update({ points, next_id: Math.max(next, m.get("next_id")) });
    if (phase !== "move") m.update({ seen: { ...m.get("seen"), [sender]: seq } });
    m.receive({ type: "done", sender, seq });
  });
}

function viewAnswers(model, { chunks, field, still, falls }) {
  const answers = {
    hello: ({ largest, voxels }) => {
      if (!largest || voxels) falls(); // no card, no volume; and no Python that could make it smaller
      if (voxels) return answers.still();
      return [field.content, field.buffers];
    },
    chunk: ({ id, index }) => [{ type: "chunk", id, index, start: chunks[index].start }, [chunks[index].packed]],
    still: () => [{ type: "still" }, [still]],
  };
  return (message) => queueMicrotask(() => {
    if (!Object.hasOwn(answers, message.type)) return;
    const [content, buffers] = answers[message.type](message);
    model().receive({ ...content, view: message.view }, buffers);
  });
}

// ---- the page -------------------------------------------------------------------------------------------------------

function pageNode(tag, className, parent, attributes = {}, text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = text;
  parent?.append(made);
  return made;
}

const pagePart = (name) => document.querySelector(`.dnb-page-${name}`);

function sayOnPage(text) {
  const alert = pagePart("alert");
  alert.textContent = text;
  alert.hidden = !text;
}

class StandalonePage {
  constructor(data, widgets) {
    this.data = data;
    this.image = pagePart("still");
    const still = new DataView(Uint8Array.from(atob(this.image.src.split(",")[1]), (c) => c.charCodeAt(0)).buffer);
    this.editor = new PlainModel(data.editor, { deliver: editorAnswers(() => this.editor) });
    this.view = data.view && new PlainModel(data.view, { models: { editor: this.editor },
      deliver: viewAnswers(() => this.view, { ...data, still, falls: () => this.fall() }) });
    this.widgets = widgets;
  }

  async open() {
    this.#controls();
    this.fit();
    await this.widgets.editor.initialize?.({ model: this.editor });
    await this.widgets.editor.render({ model: this.editor, el: pagePart("picture") });
    if (this.view) {
      await this.widgets.view.initialize?.({ model: this.view });
      await this.widgets.view.render({ model: this.view, el: pagePart("volume") });
    } else pagePart("volume").remove();
    this.image.remove();
    document.body.classList.toggle("dnb-page-alone", !this.view);
    this.fit();
    window.addEventListener("resize", () => this.fit());
  }

  // Without WebGL2 the volume is the picture that Python has made, and only the editor's picture follows.
  fall() {
    this.isStill = true;
    pagePart("volume").classList.add("dnb-page-flat");
    sayOnPage("This browser offers no WebGL2, so the volume is a still picture; the picture beside it can be dragged.");
    document.querySelector(".dnb-page-select[name=shows]")?.setAttribute("disabled", "");
    if (this.cut) this.cut.hidden = true;
    this.view.update({ background: this.data.still_background });
    this.fit();
  }

  // As large as the window allows: two columns where it is wide, and no more height than is seen at once.
  fit() {
    const main = pagePart("main"), width = main.clientWidth, isWide = width >= NARROW && this.view;
    main.classList.toggle("dnb-page-wide", Boolean(isWide));
    const column = isWide ? (width - 16) / 2 : width, above = main.getBoundingClientRect().top + window.scrollY;
    const bars = 130; // of the editor: its buttons and its status line
    // On a phone both fit into the window once it is scrolled to them.
    const most = isWide || !this.view ? window.innerHeight - above - bars - 40 : 0.45 * window.innerHeight;
    const height = Math.round(Math.max(isWide ? 260 : 200, Math.min(1.1 * column, most)));
    this.editor.update({ height });
    const beside = isWide ? pagePart("picture").clientHeight : 0; // of a flat picture less than it may be
    this.view?.update({ width: Math.round(column), height: Math.round(this.isStill ? 0.75 * column
      : isWide ? Math.max(beside, 0.72 * column) : Math.min(0.8 * column, 0.45 * window.innerHeight)) });
  }

  // ---- controls -----------------------------------------------------------------------------------------------------

  #controls() {
    const bar = pagePart("controls");
    this.#slider(bar, "Strength", setting(this.editor, "strength"), STRENGTHS, (value) => `${Math.round(value * 100)} %`,
      "how far the points are dragged: 100 % as they are, 0 not at all, below 0 the opposite way");
    this.#kernels(bar);
    if (this.view && this.view.get("shows") !== undefined) this.#shows(bar);
    this.#slider(bar, "Grid", trait(this.editor, "density"), { min: 0, max: 64, step: 1 }, (value) => (value ? `${value} cells` : "none"),
      "cells of the grid along the longer side of the picture");
    const buttons = pageNode("div", "dnb-page-buttons", bar);
    this.#button(buttons, "Reset", "points, settings and side as they are in this file; Undo brings back the points",
      () => this.reset());
    this.#button(buttons, "Download points", "a JSON file that deformnb opens", () => this.download());
    if (this.view?.get("clip")) this.#clip(bar);
  }

  #field(bar, label, title) {
    const box = pageNode("label", "dnb-page-field", bar, { title });
    pageNode("span", "dnb-page-label", box, {}, label);
    return box;
  }

  #button(bar, text, title, action) {
    const button = pageNode("button", "dnb-page-button", bar, { type: "button", title, ...CONTROLS }, text);
    button.addEventListener("click", () => guarded(action));
  }

  #slider(bar, label, { name, get: now, set, listen }, { min, max, step }, shown, title) {
    const box = this.#field(bar, label, title);
    const input = pageNode("input", "dnb-page-range", box, { type: "range", min: Math.min(min, now()),
      max: Math.max(max, now()), step, name, ...CONTROLS });
    const output = pageNode("output", "dnb-page-value", box);
    const show = () => { input.value = now(); output.textContent = shown(now()); };
    input.addEventListener("input", () => guarded(() => set(Number(input.value))));
    listen(show);
    show();
  }

  #menu(bar, label, { name, get, set, listen }, choices, title) {
    const box = this.#field(bar, label, title);
    const select = pageNode("select", "dnb-page-select", box, { name, ...CONTROLS });
    for (const [value, text, about = ""] of choices) pageNode("option", "", select, { value, title: about }, text);
    const show = () => { select.value = get(); };
    select.addEventListener("change", () => guarded(() => set(select.value)));
    listen(show);
    show();
    return select;
  }

  #kernels(bar) {
    const names = this.data.kernels.map(([name, title]) => [name, title]);
    const select = this.#menu(bar, "Kernel", setting(this.editor, "kernel"), names,
      "how the influence of a point falls off with distance");
    const order = this.data.trends[this.editor.get("settings").trend]; // the page changes no trend
    this.data.kernels.forEach(([, , least], k) => { select.options[k].disabled = order < least; }); // no fit exists
  }

  // In a box of its own under the others, which is opened where one wants to see inside.
  #clip(bar) {
    this.cut = pageNode("details", "dnb-page-clip", bar);
    pageNode("summary", "dnb-page-label", this.cut, { title: "cut away parts of the volume to see inside", ...CONTROLS }, "See inside");
    this.sliders = new ClipSliders(this.cut, this.view);
    this.cut.open = isClipped(clipOf(this.view));
    this.cut.addEventListener("toggle", () => this.fit());
  }

  #shows(bar) {
    this.#menu(bar, "Show", trait(this.view, "shows"), this.data.shows, "what of the volume is seen");
  }

  reset() {
    const { points, settings, density, show_net } = this.data.editor;
    this.editor.update({ points, selected: [], settings, density, show_net });
    const { camera, shows, clip } = this.data.view ?? {};
    this.view?.update({ camera: { ...camera }, shows, clip });
  }

  // Locks and radii stand beside the points, as deformnb/document/json_format.py writes them.
  #own(points) {
    const locked = points.filter((p) => p.locked).map((p) => p.id);
    const radii = points.filter((p) => (p.radius ?? null) !== null).map((p) => [p.id, p.radius]);
    return { ...(locked.length && { locked: [locked] }), ...(radii.length && { radii: [radii] }) };
  }

  // ---- the points as a file -----------------------------------------------------------------------------------------

  document() {
    const points = this.editor.get("points"), next = this.editor.get("next_id");
    const { chosen_support: radius, ...settings } = this.editor.get("settings");
    if (radius) settings.chosen_support = { radius, kernel: settings.kernel };
    if (!this.data.document) return { points, ...settings };
    const [{ locked: _, radii: __, ...step }] = this.data.document.steps, own = this.#own(points);
    const plain = points.map(({ locked, radius, ...point }) => point);
    return { ...this.data.document, steps: [{ ...step, ...settings, ...own, maps: [{ dim: 2, next_id: next, points: plain }] }] };
  }

  download() {
    const text = `${JSON.stringify(this.document(), null, 1)}\n`;
    const link = pageNode("a", "", null, { download: "deformation.json" });
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
}

// A trait of a model, as a control shows and changes it.
function trait(model, name) {
  return { name, get: () => model.get(name), set: (value) => model.update({ [name]: value }),
    listen: (show) => model.on(`change:${name}`, show) };
}

// A setting of an editor's fit, likewise.
function setting(model, name) {
  return { name, get: () => model.get("settings")[name], set: (value) => model.update({ settings: { ...model.get("settings"), [name]: value } }),
    listen: (show) => model.on("change:settings", show) };
}

// What goes wrong is said on the page, which goes on.
function guarded(action) {
  try { return action(); } catch (error) {
    console.error(error);
    sayOnPage(`This page met an error: ${error.message || error}`);
    return undefined;
  }
}

async function openStandalone() {
  const data = await decodedData(JSON.parse(document.getElementById("dnb-data").textContent));
  const page = new StandalonePage(data, globalThis[Symbol.for("deformnb.standalone")]);
  document.body.deformnb = page; // for tests and for whoever looks into the page
  await page.open();
}

openStandalone().catch((error) => {
  console.error(error);
  const isOld = typeof DecompressionStream === "undefined";
  sayOnPage(isOld ? "This browser is too old to unpack the volume; a still picture is shown."
    : `This page could not be opened: ${error.message || error}`);
});
