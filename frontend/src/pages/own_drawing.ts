// A picture of the user's with a grid that is laid on it by its corners, in one place of the page.

import { PICTURE_SUFFIXES, readPicture } from "../formats/pictures.ts";
import { FileError } from "../formats/reading.ts";
import { PlainModel } from "../sync/host_model.ts";
import type { Values, Vector2, Vector4 } from "../types.ts";
import { buttonElement, pageElement } from "../ui/dom.ts";
import { planeAlong, voxelRaster } from "../volume/grid.ts";
import { subjectBox } from "../volume/subject.ts";
import type { Drawing } from "./laid_pair.ts";
import { blobOf } from "./opened_file.ts";
import { messageOf, showAlert } from "./standalone_page.ts";

const ROWS = 4, // of a grid that begins: few nodes are quickly laid
  COLUMNS = 6;
const LONGEST = 1000; // pixels along a side of a picture that is kept
const QUALITY = 0.85; // of a picture that is kept, as JPEG
const PICTURE_SIDE = "+z";

/** A picture of the user's, with the grid that was laid on it. */
export interface OwnDrawing {
  name: string;
  /** An address "data:" */
  image: string;
  nodes: Vector2[][];
  /** Numbers of the nodes that were placed by hand */
  placed: number[];
  /** What is shown of it; null for all. */
  part: Vector4 | null;
  /** Pixels of the file along a side of one of the image's */
  factor: number;
}

/** Where a picture with a grid can come from. */
export interface PictureSources {
  /** Of its place on the page */
  title: string;
  /** Whether a file can be chosen */
  isFile?: boolean;
  /** A drawing for those who have no picture, and the words of its button */
  example?: { words: string; make: () => Promise<OwnDrawing> };
}

/** Places of a regular grid in a box. */
export function regularNodes([a0, a1, b0, b1]: Vector4): Vector2[][] {
  return Array.from({ length: ROWS }, (_, i) =>
    Array.from(
      { length: COLUMNS },
      (_, j): Vector2 => [a0 + ((a1 - a0) * j) / (COLUMNS - 1), b0 + ((b1 - b0) * i) / (ROWS - 1)],
    ),
  );
}

/** The picture at an address "data:". */
async function imageOf(address: string) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return image;
}

/** A picture as a user's drawing with a grid around its subject. */
async function drawingOfFile(file: File): Promise<OwnDrawing> {
  const { volume, shown } = await readPicture(file, file.name),
    { rgba, width, height, factor } = shown;
  const whole = document.createElement("canvas");
  Object.assign(whole, { width, height });
  whole.getContext("2d")!.putImageData(new ImageData(rgba, width, height), 0, 0);
  const size = Math.min(1, LONGEST / Math.max(width, height)),
    kept = Object.assign(document.createElement("canvas"), {
      width: Math.max(1, Math.round(size * width)),
      height: Math.max(1, Math.round(size * height)),
    });
  const c = kept.getContext("2d")!;
  c.fillStyle = "#ffffff"; // JPEG has no clear pixels
  c.fillRect(0, 0, kept.width, kept.height);
  c.imageSmoothingQuality = "high";
  c.drawImage(whole, 0, 0, kept.width, kept.height);
  const times = (factor * width) / kept.width,
    raster = voxelRaster(volume.grid, planeAlong(volume.grid, PICTURE_SIDE)),
    box = subjectBox(volume.values, raster) ?? [0, factor * width, 0, factor * height];
  const inside = (value: number, most: number) => Math.min(most - 1, Math.max(0, value / times));
  const nodes = regularNodes([
    inside(box[0], kept.width),
    inside(box[1], kept.width),
    inside(box[2], kept.height),
    inside(box[3], kept.height),
  ]);
  return {
    name: volume.name,
    image: kept.toDataURL("image/jpeg", QUALITY),
    nodes,
    placed: [],
    part: null,
    factor: times,
  };
}

export class OwnDrawingView {
  readonly element: HTMLElement;
  readonly #place: HTMLElement;
  readonly #chooser: HTMLInputElement;
  #close: (() => void) | null = null;
  #image: HTMLImageElement | null = null;

  /** @param changed called with the drawing after each edit */
  constructor(
    parent: Element,
    readonly widgets: Values,
    { title, isFile, example }: PictureSources,
    readonly changed: (drawing: OwnDrawing) => void,
  ) {
    this.element = pageElement("section", "dnb-grid-own", parent);
    pageElement("h2", "dnb-grid-own-title", this.element, {}, title);
    const bar = pageElement("div", "dnb-grid-own-bar", this.element);
    this.#chooser = pageElement("input", "", bar, {
      type: "file",
      hidden: "",
      accept: PICTURE_SUFFIXES.join(","),
      "aria-label": title,
    });
    if (isFile) buttonElement("dnb-page-button", bar, "Photo or file\u2026", () => this.#chooser.click());
    if (example) buttonElement("dnb-page-button", bar, example.words, () => this.#take(example.make()));
    this.#place = pageElement("div", "", this.element);
    this.#chooser.addEventListener("change", () => {
      const [file] = this.#chooser.files ?? [];
      this.#chooser.value = ""; // the same file can be chosen again
      if (file) this.#take(drawingOfFile(file));
    });
  }

  async #take(made: Promise<OwnDrawing>) {
    showAlert("");
    try {
      const drawing = await made;
      await this.show(drawing);
      this.changed(drawing);
    } catch (error) {
      if (!(error instanceof FileError)) console.error(error);
      showAlert(`${messageOf(error)}`);
    }
  }

  /** Show a drawing, whose grid can be changed. */
  async show(drawing: OwnDrawing) {
    const image = await imageOf(drawing.image),
      [a0, a1, b0, b1] = drawing.part ?? [0, image.width, 0, image.height],
      canvas = Object.assign(document.createElement("canvas"), { width: a1 - a0, height: b1 - b0 });
    canvas.getContext("2d")!.drawImage(image, -a0, -b0);
    const png = await (await blobOf(canvas)).arrayBuffer();
    this.#close?.();
    this.#place.replaceChildren();
    this.#image = image;
    let current = drawing;
    const model = new PlainModel(
      {
        image: new DataView(png),
        box: [a0 - 0.5, a1 - 0.5, b0 - 0.5, b1 - 0.5],
        height: Math.round(0.5 * window.innerHeight),
        shown: { nodes: drawing.nodes, placed: drawing.placed, seen: {} },
        label: `Grid on ${drawing.name}`,
        live: false,
        read_only: false,
        theme: "auto",
      },
      {
        deliver: ({ type, view, seq, value }) =>
          queueMicrotask(() => {
            if (type !== "edit") return;
            current = { ...current, nodes: value.nodes, placed: value.placed };
            model.update({ shown: { ...value, seen: { [view]: seq } } });
            model.receive({ type: "done", view, seq });
            this.changed(current);
          }),
      },
    );
    this.#close = await this.widgets.grid.render({ model, el: this.#place });
  }

  /** The drawing for the page, once there is one. */
  drawing({ nodes, name, part }: OwnDrawing): Drawing | null {
    const image = this.#image;
    return (
      image && { image, part: part ?? [0, image.width, 0, image.height], nodes, name, title: name, isFigure: false }
    );
  }

  hide() {
    this.#close?.();
    this.#close = null;
    this.element.remove();
  }
}
