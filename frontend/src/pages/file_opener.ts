// The page on which a user opens a volume or a picture: the choice of the file, its progress, its sides, and the edits that
// the browser has stored. The edits are saved as the document that "deformnb replay" applies to the same file.

import { PICTURE_SUFFIXES } from "../formats/pictures.ts";
import { FileError, shownText } from "../formats/reading.ts";
import { VOLUME_SUFFIXES } from "../formats/volume_files.ts";
import type { Point, Values } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement } from "../ui/dom.ts";
import { localize } from "../ui/words.ts";
import type { Opening } from "./begin_cards.ts";
import { beginCards } from "./begin_cards.ts";
import { FilePage } from "./file_page.ts";
import { GridMenu } from "./grid_menu.ts";
import type { Opened, Template } from "./opened_file.ts";
import { dataOf, nameOf, readFile, subjectOf } from "./opened_file.ts";
import type { PageData } from "./standalone_page.ts";
import { messageOf, pagePart, showAlert } from "./standalone_page.ts";

const STORED = "deformnb.page"; // the key of the last edits in the browser's storage
const KEPT = ["points", "next_id", "settings", "cuts", "parts"]; // traits of the editor

/** The page, with a file or without. */
export class FileOpener {
  page: FilePage | null = null;
  opened: Opened | null = null;
  side = "";
  work: AbortController | null = null;
  chooser: HTMLInputElement;
  button: HTMLButtonElement;
  words: HTMLSpanElement;
  sideBox: HTMLLabelElement;
  sides: HTMLSelectElement;
  bar: HTMLProgressElement;
  cancel: HTMLButtonElement;
  begin: HTMLElement;

  constructor(
    readonly template: Template,
    readonly widgets: Values,
  ) {
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
    this.begin = beginCards(
      pagePart("main"),
      template.examples,
      (made, opening) => this.#take(made, opening),
      () => this.chooser.click(),
    );
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
  open(file: File) {
    return this.#take(file.name, (report, signal) => readFile(file, this.template, report, signal));
  }

  /** Open what is made or read. */
  async #take(name: string, opening: Opening) {
    if (this.work) return;
    if (this.isUnsaved && !window.confirm(localize(`Open ${name}? What you did is not downloaded yet.`))) return;
    const work = new AbortController(),
      before = this.words.textContent ?? "";
    this.work = work;
    showAlert("");
    try {
      const opened = await opening((words, share) => this.#report(words, share), work.signal);
      const stored = readStored(opened),
        side = stored?.side ?? opened.side;
      const data = await dataOf(this.template, opened, side);
      work.signal.throwIfAborted();
      this.opened = opened;
      this.side = side;
      await this.#show(data, stored);
      this.#report(this.#facts(Boolean(stored)), 1);
      if (opened.warning) showAlert(opened.warning);
    } catch (error) {
      this.#report(before, 1);
      if (work.signal.aborted) return;
      if (!(error instanceof FileError)) console.error(error);
      showAlert(
        error instanceof RangeError
          ? `${shownText(name)}: there is not enough memory for it; save it coarser.`
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
    this.begin.hidden = true;
    pagePart("about").hidden = true; // room for the picture
    this.sides.value = this.side;
    const page = new FilePage(data, this.widgets, opened.volume.name);
    this.page = page;
    Object.assign(document.body, { deformnb: page }); // for tests and for debugging
    await page.open();
    page.addButtons();
    const image = URL.createObjectURL(new Blob([data.still!], { type: "image/png" }));
    page.closing.signal.addEventListener("abort", () => URL.revokeObjectURL(image));
    new GridMenu(page.part("controls"), page, this.template.examples, {
      name: opened.volume.name,
      image,
      raster: data.editor.raster,
      subject: () => subjectOf(opened, this.side),
    });
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
      ...(isRestored ? ["the points of the last session are restored; Reset puts them back"] : []),
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
