// A page of a file that a user has opened: pictures and the session are downloaded.

import type { EditorView } from "../editor/editor.ts";
import { Painter } from "../editor/painter.ts";
import { fieldAt } from "../maths/rigid_stages.ts";
import type { Values } from "../types.ts";
import { saveFile, viewOf } from "../ui/dom.ts";
import type { LiveVolumeView } from "../view/live_view.ts";
import { blobOf } from "./opened_file.ts";
import type { PageData } from "./standalone_page.ts";
import { StandalonePage } from "./standalone_page.ts";

const LONGEST_PICTURE = 4096; // pixels along a side of a picture that is saved
const SHORTEST_PICTURE = 1024; // the same of a picture of a volume

/** A page of an open file. */
export class FilePage extends StandalonePage {
  isSaved = true;

  /**
   * @param name of the file without suffix
   * @param root of the page's parts
   */
  constructor(
    data: PageData,
    widgets: Values,
    readonly name: string,
    root?: HTMLElement,
  ) {
    super(data, widgets, root);
  }

  get downloads() {
    return "Download session";
  }

  get fileName() {
    return this.name.replace(/[^\p{L}\p{N}._ -]/gu, "_") || "deformation";
  }

  addButtons() {
    const bar = this.part("buttons");
    this.button(bar, "Download picture", "the deformed picture as PNG", () => this.savePicture());
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
    const editor = viewOf<EditorView>(this.part("picture").querySelector(".dnb-editor"));
    if (!editor) throw new Error("the page has no editor");
    return editor;
  }

  /** Displacements [da, db] of the picture at places [a, b], for tests: from where the pixels there were sampled. */
  displacements(places: [number, number][]) {
    const { fit } = this.#editorView.parts.map;
    return fit && places.map(([a, b]) => fieldAt(fit, a, b));
  }

  async savePicture() {
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
    const view = viewOf<LiveVolumeView>(this.part("volume").querySelector(".dnb-view"));
    if (!view?.loop) return;
    view.loop.drawNow(2);
    saveFile(await blobOf(view.elements.canvas), `${this.fileName} volume.png`);
  }
}
