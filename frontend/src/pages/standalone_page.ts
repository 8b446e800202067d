// A page without a kernel: it sends to the front ends of an editor and a live view the messages of Python. Their data is
// written by deformnb/widgets/standalone.py, or made of a file that a user has chosen: traits, packed voxels, the message
// "field", the document.

import type { EditDone, EditorToPython } from "../generated.ts";
import { ClipSliders } from "../inputs/clip_sliders.ts";
import { clipOf, isClipped } from "../maths/clipping.ts";
import { PlainModel } from "../sync/host_model.ts";
import type { KernelTable, Point, Values } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, saveFile, viewOf } from "../ui/dom.ts";
import type { LiveVolumeView } from "../view/live_view.ts";

/** The content of a message and its buffers */
export type Packet = [Values, DataView<ArrayBuffer>[]];

interface ParameterWords {
  label: string;
  tooltip: string;
}
export interface SliderParameter extends ParameterWords {
  low: number;
  high: number;
  step: number;
}
export interface MenuParameter extends ParameterWords {
  options: [value: string, text: string][];
}

export interface PageData {
  /** Traits */
  editor: Values;
  /** Traits */
  view: Values | null;
  chunks: { start: number; lag: number; packed: DataView<ArrayBuffer> }[];
  field: { content: Values; buffers: DataView<ArrayBuffer>[] };
  still_background: string;
  /** Their orders by their names */
  kernels: Record<string, number>;
  /** Those of the kernels that the scripts have no formula of */
  kernel_tables: Record<string, KernelTable>;
  /** Likewise */
  trends: Record<string, number>;
  /** Display modes of the picture */
  picture_shows: string[];
  /** Names of those in the page */
  controls: string[];
  /** Names of the sides of the box; a warning, where "%" is replaced by them */
  cut_off: { sides: string[]; text: string } | null;
  /** Of the controls, as deformnb/widgets/parameters.py has them */
  parameters: { view: MenuParameter; [name: string]: SliderParameter | MenuParameter };
  document: Values | null;
  /** Its code */
  language: string;
  /** Of that language by the English ones; none for English */
  words: Record<string, string>;
  /** A picture of the volume, where the page shows none before it is opened */
  still?: DataView<ArrayBuffer>;
}

const NARROW = 860; // CSS pixels below which picture and volume are stacked

/** The exports of the widgets' scripts, by the names of the widgets: they have run before. */
export function exportedWidgets(): Values {
  return Object(globalThis)[Symbol.for("deformnb.standalone")];
}

/** Everything binary in the data as DataView, as Jupyter delivers it; the rest as it is. */
export async function decodeData<Data>(value: unknown): Promise<Data> {
  return (await decodeArrays(value)) as Data;
}

async function decodeArrays(value: unknown): Promise<unknown> {
  if (Array.isArray(value)) return Promise.all(value.map(decodeArrays));
  if (!value || typeof value !== "object") return value;
  const { base64, gzip }: Values = value;
  if (typeof base64 === "string") return decodeBytes(base64, gzip);
  const pairs = Object.entries(value).map(async ([name, inner]) => [name, await decodeArrays(inner)]);
  return Object.fromEntries(await Promise.all(pairs));
}

/**
 * @param text in base64
 * @param isPacked whether by gzip
 */
async function decodeBytes(text: string, isPacked: boolean = false) {
  const bytes = bytesOfText(text);
  if (!isPacked) return new DataView(bytes.buffer);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new DataView(await new Response(stream).arrayBuffer());
}

/** @param text in base64 */
function bytesOfText(text: string) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

// ---- answers in place of Python's -----------------------------------------------------------------------------------

/**
 * Replies to an editor, dispatched later, as by a kernel: a front end sends while it is still being built. An
 * editor receives its points first, then which of its messages they include, then that the message is done.
 */
function editorAnswers(model: () => PlainModel): (message: Values) => void {
  return (content) =>
    queueMicrotask(() => {
      const m = model(),
        message = content as EditorToPython;
      if (!("sender" in message)) return; // these need Python, and other windows
      const { sender, seq } = message,
        isMove = message.type === "edit" && message.phase === "move";
      if (message.type === "shapes") m.update({ [message.what]: message.shapes });
      if (message.type === "edit" && !isMove)
        m.update({
          points: message.points,
          next_id: Math.max(message.next_id ?? 0, m.get("next_id")),
          ...(message.fit && { settings: { ...m.get("settings"), ...message.fit } }),
        });
      if (!isMove) m.update({ seen: { ...m.get("seen"), [sender]: seq } });
      m.receive({ type: "done", sender, seq } satisfies EditDone);
    });
}

/** Answers to a live view. */
function viewAnswers(
  model: () => PlainModel | null,
  {
    chunks,
    field,
    still,
    falls,
    warn,
  }: Pick<PageData, "chunks" | "field"> & {
    still: DataView<ArrayBuffer>;
    falls: () => void;
    warn: (sides: number[]) => void;
  },
): (message: Values) => void {
  const picture = (): Packet => [{ type: "still" }, [still]];
  const answers: Record<string, (message: Values) => Packet> = {
    hello: ({ largest, voxels }) => {
      if (!largest || voxels) falls(); // no GPU, no volume; and no Python that could make it smaller
      return voxels ? picture() : [field.content, field.buffers];
    },
    chunk: ({ id, index }) => {
      const { packed, ...about } = chunks[index]!;
      return [{ type: "chunk", id, index, ...about }, [packed]];
    },
    still: picture,
  };
  return (message) =>
    queueMicrotask(() => {
      if (message.type === "stats" && message.sides) warn(message.sides);
      if (!Object.hasOwn(answers, message.type)) return;
      const [content, buffers] = answers[message.type]!(message);
      model()?.receive({ ...content, view: message.view }, buffers);
    });
}

// ---- the page -------------------------------------------------------------------------------------------------------

/** A part of the page, or of a section of it. */
export function pagePart(name: string, root: ParentNode = document) {
  return root.querySelector(`.dnb-page-${name}`) as HTMLElement;
}

export function showAlert(text: string) {
  const alert = pagePart("alert");
  alert.textContent = text;
  alert.hidden = !text;
}

export class StandalonePage {
  isStill = false;
  cut: HTMLDetailsElement | null = null; // the sliders that cut the volume
  image: HTMLImageElement | null;
  closing = new AbortController();
  /** Functions that close the widgets */
  ends: (() => void)[] = [];
  editor: PlainModel;
  view: PlainModel | null;
  sliders: ClipSliders | undefined;

  /**
   * @param widgets their exports
   * @param root of the page's parts: the document, or a section of a page that shows several
   */
  constructor(
    readonly data: PageData,
    readonly widgets: Values,
    readonly root: HTMLElement = document.body,
  ) {
    this.image = root.querySelector(".dnb-page-still");
    const still = data.still ?? new DataView(bytesOfText(this.image?.src.split(",")[1] ?? "").buffer);
    this.editor = new PlainModel(data.editor, { deliver: editorAnswers(() => this.editor) });
    this.view =
      data.view &&
      new PlainModel(data.view, {
        models: { editor: this.editor },
        deliver: viewAnswers(() => this.view, {
          ...data,
          still,
          falls: () => this.fall(),
          warn: (sides) => this.warn(sides),
        }),
      });
  }

  /** A part of this page. */
  part(name: string) {
    return pagePart(name, this.root);
  }

  async open() {
    this.#controls();
    this.fit();
    await this.widgets.editor.initialize?.({ model: this.editor });
    if (this.part("picture")) await this.#render("editor", this.editor, "picture");
    this.part("volume").hidden = !this.view;
    if (this.view) {
      await this.widgets.view.initialize?.({ model: this.view });
      await this.#render("view", this.view, "volume");
    }
    this.image?.remove();
    this.root.classList.toggle("dnb-page-alone", !this.view);
    this.fit();
    window.addEventListener("resize", () => this.fit(), { signal: this.closing.signal });
  }

  /** @param part of the page */
  async #render(widget: string, model: PlainModel, part: string) {
    const end = await this.widgets[widget].render({ model, el: this.part(part) });
    if (end) this.ends.push(end);
  }

  /** Ends the widgets and empties the page for another volume. */
  close() {
    this.closing.abort();
    for (const end of this.ends) end();
    this.part("controls").replaceChildren();
    this.part("picture")?.replaceChildren();
    this.part("volume").replaceChildren();
    this.part("volume").classList.remove("dnb-page-flat");
  }

  /** Shows the volume as the picture that Python has made, without WebGL2; only the editor's picture follows. */
  fall() {
    this.isStill = true;
    this.part("volume").classList.add("dnb-page-flat");
    showAlert(
      "This browser offers no WebGL2, so the volume is a still picture; the picture next to it can be " + "dragged.",
    );
    this.root.querySelector(".dnb-page-select[name=shows]")?.setAttribute("disabled", "");
    if (this.cut) this.cut.hidden = true;
    this.view?.update({ background: this.data.still_background });
    this.fit();
  }

  /** Reports the sides of the box beyond which there is tissue that is not visible. */
  warn(sides: number[] = []) {
    const { cut_off: cutOff } = this.data,
      view = viewOf<LiveVolumeView>(this.part("volume").querySelector(".dnb-view")),
      names = sides.map((side) => cutOff?.sides[side]);
    const listed = names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : `${names[0]}`;
    const text = names.length ? `${cutOff?.text.replace("%", listed)}` : "";
    view?.elements.messages.set("extent", text, { kind: "warning" });
  }

  /**
   * Make all as large as the window allows: two columns where it is wide, and no more height than the window's.
   */
  fit() {
    const main = this.part("main"),
      width = main.clientWidth,
      isWide = width >= NARROW && this.view;
    main.classList.toggle("dnb-page-wide", Boolean(isWide));
    const column = isWide ? (width - 16) / 2 : width,
      above = main.getBoundingClientRect().top + window.scrollY;
    const bars = 130; // of the editor: its buttons and its status line
    // On a phone both fit into the window once it is scrolled to them.
    const most = isWide || !this.view ? window.innerHeight - above - bars - 40 : 0.45 * window.innerHeight;
    const height = Math.round(Math.max(isWide ? 260 : 200, Math.min(1.1 * column, most)));
    this.editor.update({ height });
    const beside = isWide ? this.part("picture").clientHeight : 0; // of a flat picture less than it may be
    this.view?.update({
      width: Math.round(column),
      height: Math.round(
        this.isStill
          ? 0.75 * column
          : isWide
            ? Math.max(beside, 0.72 * column)
            : Math.min(0.8 * column, 0.45 * window.innerHeight),
      ),
    });
  }

  // ---- controls -----------------------------------------------------------------------------------------------------

  #controls() {
    const bar = this.part("controls"),
      has = (name: string) => this.data.controls.includes(name);
    if (has("strength")) {
      this.#slider(bar, setting(this.editor, "strength"), (value) => value.toFixed(2));
    }
    if (has("kernel")) this.#kernels(bar);
    if (has("shows")) this.#shows(bar);
    if (has("density")) {
      this.#slider(bar, trait(this.editor, "density"), (value) => (value ? `${value} cells` : "none"));
    }
    const buttons = has("reset") || has("download") ? pageElement("div", "dnb-page-buttons", bar) : bar;
    if (has("reset")) {
      this.button(
        buttons,
        "Reset",
        "points, settings and side as they are in this file; Undo brings back the points",
        () => this.reset(),
      );
    }
    if (has("download")) {
      this.button(buttons, this.downloads, "a JSON file that deformnb opens", () => this.download());
    }
    if (has("clip") && this.view?.get("clip")) this.#clip(bar, this.view);
  }

  #field(bar: Element, label: string, title: string) {
    const box = pageElement("label", "dnb-page-field", bar, { title });
    pageElement("span", "dnb-page-label", box, {}, label);
    return box;
  }

  button(bar: Element, text: string, title: string, action: () => void) {
    buttonElement("dnb-page-button", bar, text, () => runGuarded(action), { title });
  }

  #slider(bar: Element, { name, now, set, listen }: Bound<number>, shown: (value: number) => string) {
    const { label, tooltip, low, high, step } = this.data.parameters[name] as SliderParameter;
    const box = this.#field(bar, label, tooltip);
    const input = pageElement("input", "dnb-page-range", box, {
      type: "range",
      min: Math.min(low, now()),
      max: Math.max(high, now()),
      step,
      name,
      ...OWN_KEYS,
    });
    const output = pageElement("output", "dnb-page-value", box, {});
    const show = () => {
      input.value = String(now());
      output.textContent = shown(now());
    };
    input.addEventListener("input", () => runGuarded(() => set(Number(input.value))));
    listen(show);
    show();
  }

  #menu(bar: Element, { name, now, set, listen }: Bound<string>) {
    const { label, tooltip, options } = this.data.parameters[name] as MenuParameter;
    const box = this.#field(bar, label, tooltip);
    const select = pageElement("select", "dnb-page-select", box, { name, ...OWN_KEYS });
    for (const [value, text] of options) pageElement("option", "", select, { value }, text);
    const show = () => {
      select.value = now();
    };
    select.addEventListener("change", () => runGuarded(() => set(select.value)));
    listen(show);
    show();
    return select;
  }

  #kernels(bar: Element) {
    const { kernels, kernel_tables: tables, trends } = this.data,
      bound = setting<string>(this.editor, "kernel");
    const set = (kernel: string) => {
      const { kernel_table: _, ...settings } = this.editor.get("settings"),
        table = tables[kernel];
      this.editor.update({ settings: { ...settings, kernel, ...(table && { kernel_table: table }) } });
    };
    const select = this.#menu(bar, { ...bound, set });
    const order = trends[this.editor.get("settings").trend]!; // the page changes no trend
    for (const option of select.options) option.disabled = order < kernels[option.value]!; // no fit exists
  }

  /** Adds the sliders that cut the volume, in a separate box under the others. */
  #clip(bar: Element, view: PlainModel) {
    const box = pageElement("details", "dnb-page-clip", bar, {});
    pageElement("summary", "dnb-page-label", box, { title: "show only a part of the volume", ...OWN_KEYS }, "Clipping");
    this.cut = box;
    this.sliders = new ClipSliders(box, view);
    box.open = isClipped(clipOf(view));
    box.addEventListener("toggle", () => this.fit());
  }

  /** Adds the menu of the comparison, of picture and volume. */
  #shows(bar: Element) {
    const { editor, view } = this,
      modes = this.data.picture_shows;
    const select = this.#menu(bar, trait(view ?? editor, "shows"));
    if (view)
      view.on("change:shows", () =>
        editor.update({ shows: modes.includes(view.get("shows")) ? view.get("shows") : modes[0] }),
      );
    else for (const option of [...select.options]) if (!modes.includes(option.value)) option.remove();
  }

  reset() {
    const { points, settings, density, show_grid, shows: picture } = this.data.editor;
    this.editor.update({ points, selected: [], settings, density, show_grid, shows: picture });
    const { camera, shows, clip } = this.data.view ?? {};
    this.view?.update({ camera: { ...camera }, shows, clip });
  }

  /** Locks and radii of the points, as deformnb/document/json_format.py writes them. */
  #own(points: Point[]) {
    const locked = points.filter((p) => p.locked).map((p) => p.id);
    const radii = points.filter((p) => (p.radius ?? null) !== null).map((p) => [p.id, p.radius]);
    return { ...(locked.length && { locked: [locked] }), ...(radii.length && { radii: [radii] }) };
  }

  /** Cuts and rigid parts, as far as there are any. */
  #shapes() {
    const [cuts, parts] = ["cuts", "parts"].map((name) => this.editor.get(name) ?? []);
    return { ...(cuts.length && { cuts, cut_rule: this.editor.get("cut_rule") }), ...(parts.length && { parts }) };
  }

  // ---- the points as a file -----------------------------------------------------------------------------------------

  document() {
    const points: Point[] = this.editor.get("points");
    const next = this.editor.get("next_id");
    const { chosen_support: radius, kernel_table: _table, ...settings } = this.editor.get("settings");
    if (radius) settings.chosen_support = { radius, kernel: settings.kernel };
    if (!this.data.document) return { points, ...settings };
    const [{ locked: _, radii: __, ...step }] = this.data.document.steps,
      own = this.#own(points);
    const plain = points.map(({ locked, radius, ...point }) => point);
    const maps = [{ dim: 2, next_id: next, points: plain }],
      { cuts: _c, parts: _p, ...rest } = step;
    return { ...this.data.document, steps: [{ ...rest, ...settings, ...own, ...this.#shapes(), maps }] };
  }

  /** The words of the button that saves the document. */
  get downloads() {
    return "Download points";
  }

  /** The names of files that are saved, without suffix. */
  get fileName() {
    return "deformation";
  }

  download() {
    const text = `${JSON.stringify(this.document(), null, 1)}\n`;
    saveFile(new Blob([text], { type: "application/json" }), `${this.fileName}.json`);
  }
}

/** A value that a control shows and changes. */
export type Bound<T> = {
  name: string;
  now: () => T;
  set: (value: T) => void;
  listen: (show: () => void) => void;
};

/** A trait of a model. */
function trait<T>(model: PlainModel, name: string): Bound<T> {
  return {
    name,
    now: () => model.get(name),
    set: (value) => model.update({ [name]: value }),
    listen: (show) => model.on(`change:${name}`, show),
  };
}

/** A setting of an editor's fit. */
function setting<T>(model: PlainModel, name: string): Bound<T> {
  return {
    name,
    now: () => model.get("settings")[name],
    set: (value) => model.update({ settings: { ...model.get("settings"), [name]: value } }),
    listen: (show) => model.on("change:settings", show),
  };
}

/** Reports an action that has failed on the page, at once or later; the page stays usable. */
export async function runGuarded(action: () => unknown) {
  try {
    await action();
  } catch (error) {
    console.error(error);
    showAlert(`This page met an error: ${messageOf(error)}`);
  }
}

export function messageOf(error: unknown) {
  return (error instanceof Error && error.message) || error;
}
