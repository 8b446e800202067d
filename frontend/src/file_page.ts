// A page without Python in which a user opens a volume or a picture: it is read here, and shown by the same
// page as an exported volume. The edits are saved as the document that "deformnb replay" applies to the same file.
// The data is written by deformnb/widgets/standalone.py: the traits of the widgets with a tiny volume, in whose place
// the file's is put.

import type { EditorView } from "./editor/editor.ts";
import { Painter } from "./editor/painter.ts";
import type { Photograph } from "./formats/pictures.ts";
import { PICTURE_SUFFIXES, readPicture } from "./formats/pictures.ts";
import { FileError, shownText } from "./formats/reading.ts";
import type { KnownSpacing, Volume } from "./formats/volume_files.ts";
import { readVolume, VOLUME_SUFFIXES, volumeSuffix, voxelChecksum } from "./formats/volume_files.ts";
import { fieldAt } from "./maths/rigid_stages.ts";
import type { PageData } from "./standalone_page.ts";
import {
  decodeData,
  exportedWidgets,
  messageOf,
  pagePart,
  runGuarded,
  StandalonePage,
  showAlert,
} from "./standalone_page.ts";
import type { Plane, Point, Values } from "./types.ts";
import { buttonElement, OWN_KEYS, pageElement, saveFile, viewOf } from "./ui/dom.ts";
import { localize, showInLanguage } from "./ui/words.ts";
import type { LiveVolumeView } from "./view/live_view.ts";
import { coarserGrid, lengthsOf, planeAlong, sideNames, unitOf, voxelRaster } from "./volume/grid.ts";
import type { Measured } from "./volume/levels.ts";
import { measureLevels, repairValues, specimen, tableOf, windowOf } from "./volume/levels.ts";
import {
  bytesOfVolume,
  cornerPoints,
  factorsOf,
  maximumProjection,
  packedPicture,
  pictureWindow,
  piecesOf,
  stillField,
  tissueCheck,
  volumeInfo,
} from "./volume/packing.ts";

export type Template = PageData & { known_spacings: KnownSpacing[] };

/** A file that is open. */
export interface Opened {
  volume: Volume;
  photograph: Photograph | null;
  about: Measured;
  /** Of the voxels, as Python makes it */
  sha256: string | null;
  packed: (Pick<PageData, "chunks"> & { packed: Values }) | null;
}

const STORED = "deformnb.page"; // the key of the last edits in the browser's storage
const KEPT = ["points", "next_id", "settings", "cuts", "parts"]; // traits of the editor
const LONGEST_PICTURE = 4096; // pixels along a side of a picture that is saved
const SHORTEST_PICTURE = 1024; // the same of a picture of a volume
const SIDE = "+y",
  PICTURE_SIDE = "+z";

let editors = 0; // that were on the page: each has separate undo steps

/** The bytes of a PNG of pixels. */
async function pngOf(rgba: Uint8ClampedArray<ArrayBuffer>, width: number, height: number) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d")?.putImageData(new ImageData(rgba, width, height), 0, 0);
  return new DataView(await (await blobOf(canvas)).arrayBuffer());
}

function blobOf(canvas: HTMLCanvasElement): Promise<Blob> {
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => {
      if (blob) resolve(blob);
      else reject(new Error("the browser could not make the picture; there is not enough memory."));
    }, "image/png"),
  );
}

/** Read a file and prepare all that does not depend on the side it is seen from. */
async function readFile(
  file: File,
  template: Template,
  report: (words: string, share: number) => void,
  signal: AbortSignal,
): Promise<Opened> {
  const { name } = file,
    isPicture = PICTURE_SUFFIXES.some((suffix) => name.toLowerCase().endsWith(suffix));
  if (!isPicture && !volumeSuffix(name)) {
    throw new FileError(
      `${shownText(name)}: this page opens volumes (${VOLUME_SUFFIXES.join(", ")}) and pictures ` +
        `(${PICTURE_SUFFIXES.join(", ")}). deformnb app opens more.`,
    );
  }
  report(`Reading ${name}`, 0);
  const photograph = isPicture ? await readPicture(file, name) : null;
  const volume =
    photograph?.volume ??
    (await readVolume(file, name, {
      signal,
      knownSpacings: template.known_spacings,
      progress: (share) => report(`Reading ${name}`, 0.6 * share),
    }));
  signal.throwIfAborted();
  const sha256 = photograph && !photograph.isExact ? null : await voxelChecksum(volume);
  const bad = repairValues(volume.values);
  if (bad) volume.notes.push(`${bad} voxels are not finite, shown as background`);
  const about = measureLevels(volume);
  signal.throwIfAborted();
  return {
    volume,
    photograph,
    about,
    sha256,
    packed: photograph ? null : await packVolume(volume, about, report, signal),
  };
}

async function packVolume(
  volume: Volume,
  about: Measured,
  report: (words: string, share: number) => void,
  signal: AbortSignal,
) {
  const transfer = specimen(volume, about),
    { window, share } = windowOf(volume, about, transfer);
  const factors = factorsOf(volume.grid),
    grid = coarserGrid(volume.grid, factors),
    words = "Preparing the view";
  const bytes = await bytesOfVolume(volume, factors, window, (done) => report(words, 0.6 + 0.2 * done), signal);
  report(words, 0.85);
  const chunks = await piecesOf(bytes, grid.shape, signal),
    id = crypto.getRandomValues(new Uint32Array(2)).join("-");
  const table = tableOf(transfer, window[0], window[1]);
  return { chunks, packed: { window, share, grid, id, unit: transfer.unit, table: new DataView(table.buffer) } };
}

/** The payload of the page of an open file, seen from a side. */
async function dataOf(template: Template, opened: Opened, side: string): Promise<PageData> {
  const { volume, photograph, about, packed } = opened,
    { grid } = volume,
    plane = planeAlong(grid, side);
  const { image, raster, still } = photograph
    ? await colourPicture(photograph, plane)
    : await greyPicture(volume, about, plane);
  editors += 1;
  const points = cornerPoints(grid, plane),
    diagonal = Math.hypot(...lengthsOf(grid));
  const editor = {
    ...template.editor,
    uid: `standalone ${editors}`,
    image,
    raster,
    points,
    next_id: points.length,
    label: `Picture of ${volume.name}`,
    lone_support: 0.25 * diagonal,
    settings: { ...template.editor.settings, chosen_support: null },
    air: photograph ? null : volume.isLabels ? 0 : about.levels[1],
  };
  const document = documentOf(template, opened, plane);
  const data = { ...template, editor, document, still };
  if (!packed) return { ...data, view: null, chunks: [] };
  const { window, share, grid: shown, id, table, unit } = packed.packed,
    chunks = packed.chunks.length;
  const { n, v } = plane,
    views = template.parameters.view.options.map(([name]) => name);
  const view = {
    ...template.view,
    label: `Volume ${volume.name}`,
    table,
    unit,
    volume_info: volumeInfo(volume, about, { ...packed.packed, chunks, views, id, window, share, grid: shown }),
    tissue_check: tissueCheck(volume, about, window),
    camera: { direction: [...n], up: v.map((x) => -x), zoom: 1, pan: [0, 0] },
    clip: [
      [0, 1],
      [0, 1],
      [0, 1],
    ],
  };
  return {
    ...data,
    view,
    chunks: packed.chunks,
    field: stillField(grid, shown, plane),
    cut_off: template.cut_off && { ...template.cut_off, sides: sideNames(grid) },
  };
}

async function greyPicture(volume: Volume, about: Measured, plane: Plane) {
  const pixels = maximumProjection(volume, plane),
    raster = voxelRaster(volume.grid, plane),
    [high, wide] = raster.shape;
  const { rgba, facts } = packedPicture(pixels, pictureWindow(pixels, volume, about));
  const image = await pngOf(rgba, wide, high),
    [black, white] = facts.window,
    [low, most] = facts.range!;
  const numbers = facts.channels === 1 ? 255 : 65535,
    seen = new Uint8ClampedArray(rgba.length);
  for (let k = 0; k < rgba.length; k += 4) {
    const number = facts.channels === 1 ? rgba[k]! : 256 * rgba[k]! + rgba[k + 1]!;
    const grey = (255 * (low + ((most - low) * number) / numbers - black)) / (white - black);
    seen.set([grey, grey, grey, 255], k);
  }
  return {
    image,
    still: await pngOf(seen, wide, high),
    raster: { ...raster, ...facts, unit: about.hounsfield ? "HU" : "", lengths: unitOf(volume.grid) },
  };
}

async function colourPicture({ shown: { rgba, width, height, factor }, volume }: Photograph, plane: Plane) {
  const {
      spacing: [du, dv],
      origin: [a, b],
    } = voxelRaster(volume.grid, plane),
    off = (factor - 1) / 2;
  const image = await pngOf(rgba, width, height);
  return {
    image,
    still: image,
    raster: {
      shape: [height, width],
      spacing: [factor * du, factor * dv],
      origin: [a + off * du, b + off * dv],
      channels: 3,
      lengths: "voxels",
    },
  };
}

function documentOf({ document }: Template, { volume: { name, grid }, sha256 }: Opened, { origin, u, v }: Plane) {
  if (!document) throw new Error("the page holds no document");
  const { chosen_support: _, ...step } = document.steps[0],
    { shape, spacing, direction, unit } = grid;
  const volume = sha256 && { name, shape, spacing, sha256, origin: grid.origin, direction };
  return { ...document, ...(unit ? { unit } : {}), name, volume, steps: [{ ...step, plane: { origin, u, v } }] };
}

/** A page of an open file. */
class FilePage extends StandalonePage {
  isSaved = true;

  /** @param name of the file without suffix */
  constructor(
    data: PageData,
    widgets: Values,
    readonly name: string,
  ) {
    super(data, widgets);
  }

  get downloads() {
    return "Download session";
  }

  get fileName() {
    return this.name.replace(/[^\p{L}\p{N}._ -]/gu, "_") || "deformation";
  }

  addButtons() {
    const bar = pagePart("buttons");
    this.button(bar, "Download picture", "the deformed picture as PNG", () => this.#savePicture());
    if (this.view && !this.isStill) {
      this.button(bar, "Download rendering", "the volume as it is seen here, as PNG", () => this.#saveRendering());
    }
  }

  download() {
    super.download();
    this.isSaved = true;
  }

  /** The editor that is on the page. */
  get #editorView() {
    const editor = viewOf<EditorView>(pagePart("picture").querySelector(".dnb-editor"));
    if (!editor) throw new Error("the page has no editor");
    return editor;
  }

  /** Displacements [da, db] of the picture at places [a, b], for tests: from where the pixels there were sampled. */
  displacements(places: [number, number][]) {
    const { fit } = this.#editorView.parts.map;
    return fit && places.map(([a, b]) => fieldAt(fit, a, b));
  }

  async #savePicture() {
    const editor = this.#editorView,
      { source } = editor.parts.picture.painter;
    if (!source) return;
    const {
      raster: {
        spacing: [du, dv],
      },
      box: [a0, a1, b0, b1],
    } = source;
    const longest = Math.max(a1 - a0, b1 - b0),
      least = this.view ? SHORTEST_PICTURE / longest : 0;
    const k = Math.min(Math.max(1 / du, 1 / dv, least), LONGEST_PICTURE / longest);
    const painter = new Painter(document.createElement("canvas")),
      width = (a1 - a0) * k,
      height = (b1 - b0) * k;
    Object.assign(painter, { source, colours: editor.parts.picture.painter.colours });
    painter.resize(width, height, 1);
    painter.paint({ k, x: -a0 * k, y: -b0 * k, width, height, ratio: 1 }, editor.parts.map.layered, {
      isMoving: false,
      paper: "#000000",
    });
    saveFile(await blobOf(painter.canvas), `${this.fileName} deformed.png`);
  }

  async #saveRendering() {
    const view = viewOf<LiveVolumeView>(pagePart("volume").querySelector(".dnb-view"));
    if (!view?.loop) return;
    view.loop.drawNow(2);
    saveFile(await blobOf(view.elements.canvas), `${this.fileName} volume.png`);
  }
}

/** The page, with a file or without. */
class FileOpener {
  page: FilePage | null = null;
  opened: Opened | null = null;
  side: string;
  work: AbortController | null = null;
  chooser: HTMLInputElement;
  button: HTMLButtonElement;
  words: HTMLSpanElement;
  sideBox: HTMLLabelElement;
  sides: HTMLSelectElement;
  bar: HTMLProgressElement;
  cancel: HTMLButtonElement;

  constructor(
    readonly template: Template,
    readonly widgets: Values,
  ) {
    this.side = SIDE;
    const root = pagePart("open");
    this.chooser = pageElement("input", "", root, { type: "file", hidden: "", "aria-label": "A volume or a picture" });
    const name = "dnb-page-button dnb-page-choose";
    this.button = buttonElement(name, root, "Open a file\u2026", () => this.chooser.click());
    this.words = pageElement(
      "span",
      "dnb-page-words",
      root,
      { role: "status" },
      `or drop one here: a volume (${VOLUME_SUFFIXES.join(", ")}) or a picture (${PICTURE_SUFFIXES.join(", ")}). ` +
        "It stays on this device.",
    );
    const { label, tooltip, options } = this.template.parameters.view;
    this.sideBox = pageElement("label", "dnb-page-field", root, { hidden: "", title: tooltip });
    pageElement("span", "dnb-page-label", this.sideBox, {}, label);
    this.sides = pageElement("select", "dnb-page-select", this.sideBox, { name: "side", ...OWN_KEYS });
    for (const [value, text] of options) pageElement("option", "", this.sides, { value }, text);
    this.bar = pageElement("progress", "dnb-page-progress", root, {
      max: 1,
      hidden: "",
      "aria-label": "share that is done",
    });
    this.cancel = buttonElement("dnb-page-button", root, "Cancel", () => this.work?.abort(), { hidden: "" });
    this.chooser.addEventListener("change", () => {
      const [file] = this.chooser.files ?? [];
      if (file) this.open(file);
      this.chooser.value = ""; // the same file can be chosen again
    });
    this.sides.addEventListener("change", () => this.turn(this.sides.value));
    this.#takeDrops();
    window.addEventListener("beforeunload", (event) => {
      if (this.isUnsaved) event.preventDefault();
    });
  }

  get isUnsaved() {
    return Boolean(this.page && !this.page.isSaved);
  }

  #takeDrops() {
    const veil = (isOver: boolean) => document.body.classList.toggle("dnb-page-over", isOver);
    const hasFiles = ({ dataTransfer }: DragEvent) => Boolean(dataTransfer?.types.includes("Files"));
    window.addEventListener("dragover", (event) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      veil(true);
    });
    window.addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) veil(false);
    });
    window.addEventListener("drop", (event) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      veil(false);
      const [file] = event.dataTransfer?.files ?? [];
      if (file) this.open(file);
    });
  }

  #report(words: string, share: number) {
    const isBusy = share < 1;
    this.words.textContent = isBusy ? `${words} \u2026` : words;
    this.bar.value = share;
    this.bar.hidden = this.cancel.hidden = !isBusy;
    this.button.disabled = this.sides.disabled = isBusy;
    this.sideBox.hidden = !this.opened || Boolean(this.opened.photograph) || isBusy;
  }

  /** Open a file in place of the one that is open, which stays open where the new one cannot be read. */
  async open(file: File) {
    if (this.work) return;
    if (this.isUnsaved && !window.confirm(localize(`Open ${file.name}? What you did is not downloaded yet.`))) return;
    const work = new AbortController(),
      before = this.words.textContent ?? "";
    this.work = work;
    showAlert("");
    try {
      const opened = await readFile(file, this.template, (words, share) => this.#report(words, share), work.signal);
      const stored = readStored(opened),
        side = stored?.side ?? (opened.photograph ? PICTURE_SIDE : SIDE);
      const data = await dataOf(this.template, opened, side);
      work.signal.throwIfAborted();
      this.opened = opened;
      this.side = side;
      await this.#show(data, stored);
      this.#report(this.#facts(Boolean(stored)), 1);
    } catch (error) {
      this.#report(before, 1);
      if (work.signal.aborted) return;
      if (!(error instanceof FileError)) console.error(error);
      showAlert(
        error instanceof RangeError
          ? `${shownText(file.name)}: there is not enough memory for it; save it coarser.`
          : `${messageOf(error)}`,
      );
    } finally {
      this.work = null;
    }
  }

  /** See the volume from another side, without points. */
  async turn(side: string) {
    const { opened, sides } = this;
    if (!opened || this.work || side === this.side) return;
    if (
      this.isUnsaved &&
      !window.confirm(localize("See it from another side? The points of this side are not downloaded yet."))
    ) {
      sides.value = this.side;
      return;
    }
    try {
      const data = await dataOf(this.template, opened, side);
      this.side = side;
      await this.#show(data, null);
      this.#report(this.#facts(false), 1);
    } catch (error) {
      console.error(error);
      sides.value = this.side;
      showAlert(`${messageOf(error)}`);
    }
  }

  async #show(data: PageData, stored: Values | null) {
    const { opened } = this;
    if (!opened) return;
    this.page?.close();
    document.title = `${opened.volume.name} \u2013 deformnb`;
    pagePart("main").hidden = false;
    pagePart("about").hidden = true; // room for the picture
    this.sides.value = this.side;
    const page = new FilePage(data, this.widgets, opened.volume.name);
    this.page = page;
    Object.assign(document.body, { deformnb: page }); // for tests and for debugging
    await page.open();
    page.addButtons();
    if (stored) {
      page.isSaved = false;
      page.editor.update(Object.fromEntries(KEPT.map((name) => [name, stored[name] ?? page.editor.get(name)])));
    }
    for (const name of KEPT) page.editor.on(`change:${name}`, () => this.#keep(page));
    page.fit();
  }

  #facts(isRestored: boolean) {
    const { volume, photograph } = this.opened as Opened,
      { grid, notes } = volume;
    const size = grid.shape.toReversed(),
      words = photograph
        ? [`${size[0]} x ${size[1]} pixels`]
        : [
            `${size.join(" x ")} voxels of ${grid.spacing.map((s) => Number(s.toPrecision(4))).join(" x ")}${
              grid.unit && ` ${grid.unit}`
            }`,
          ];
    if (volume.isLabels) words.push("labels");
    return [
      `${volume.name}: ${words.join(", ")}`,
      ...notes,
      ...(isRestored ? ["the points of last time are back; Reset puts them back"] : []),
    ].join(". ");
  }

  /** Stores the edits, for the case that the page is closed by mistake. */
  #keep(page: FilePage) {
    if (page !== this.page || !this.opened) return;
    page.isSaved = false;
    const kept = Object.fromEntries(KEPT.map((name) => [name, page.editor.get(name)]));
    try {
      localStorage.setItem(STORED, JSON.stringify({ of: nameOf(this.opened), side: this.side, ...kept }));
    } catch {
      /* a browser that stores nothing for a file, or has no room */
    }
  }
}

/** The identity of an open file. */
function nameOf({ volume: { name, grid }, sha256 }: Opened) {
  return sha256 ?? `${name} ${grid.shape.join(" ")}`;
}

/** The last edits of a file, if the browser has stored them. */
function readStored(opened: Opened): Values | null {
  try {
    const stored = JSON.parse(localStorage.getItem(STORED) ?? "null");
    const isPoint = (p: Point) =>
      [p.source, p.target].every((place) => place.length === 2 && place.every(Number.isFinite));
    return stored?.of === nameOf(opened) && stored.points.every(isPoint) ? stored : null;
  } catch {
    return null;
  }
}

async function openPage() {
  const template = await decodeData<Template>(JSON.parse(document.getElementById("dnb-data")?.textContent ?? ""));
  showInLanguage(document.body, template.words, template.language);
  Object.assign(document.body, { opener: new FileOpener(template, exportedWidgets()) }); // for tests and for debugging
}

openPage().catch((error) => {
  console.error(error);
  runGuarded(() => showAlert(`This page could not be opened: ${messageOf(error)}`));
});
