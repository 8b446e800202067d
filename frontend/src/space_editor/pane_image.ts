// The pixels of one of the three pictures, with cuts over them.

import type { View } from "../editor/painter.ts";
import type { PaneContent } from "../generated.ts";
import type { Raster } from "../types.ts";
import { pageElement } from "../ui/dom.ts";

const CUT_INK = [255, 214, 10, 0.9]; // red, green, blue and opacity

function makeCanvas(width: number, height: number) {
  return Object.assign(document.createElement("canvas"), { width, height });
}

function contextOf(canvas: HTMLCanvasElement) {
  return canvas.getContext("2d") as CanvasRenderingContext2D;
}

/** Cuts as a translucent picture. */
function tintCuts([height, width]: [number, number], shares: Uint8Array) {
  const made = new ImageData(width, height),
    canvas = makeCanvas(width, height);
  for (let k = 0, j = 0; k < shares.length; k += 1, j += 4) {
    made.data.set(CUT_INK.slice(0, 3), j);
    made.data[j + 3] = CUT_INK[3]! * shares[k]!;
  }
  contextOf(canvas).putImageData(made, 0, 0);
  return canvas;
}

export class PaneImage {
  canvas: HTMLCanvasElement;
  picture: HTMLCanvasElement | null = null;

  /** The cuts over it. */
  #cuts: HTMLCanvasElement | null = null;

  /** The depth that is seen at each pixel of a projection. */
  #depths: Float32Array | null = null;

  #greys: Uint8Array | null = null; // of the picture, rows first

  #raster: Raster = { shape: [1, 1], spacing: [1, 1], origin: [0, 0] };

  /** Content of the canvas: pixels, their place and the colour around them. */
  #painted: unknown[] = [];

  constructor(stage: HTMLElement) {
    this.canvas = pageElement("canvas", "dnb-ed-canvas", stage, { "aria-hidden": "true" });
  }

  resize(width: number, height: number) {
    Object.assign(this.canvas, { width, height });
    this.#painted = []; // which clears it
  }

  /** The number of the pixel at a place. */
  #pixelAt(a: number, b: number) {
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin,
    } = this.#raster;
    const column = Math.max(0, Math.min(nu - 1, Math.round((a - origin[0]) / du)));
    const row = Math.max(0, Math.min(nv - 1, Math.round((b - origin[1]) / dv)));
    return row * nu + column;
  }

  /** The depth that is seen at a place of a projection; undefined of slices. */
  depthAt(a: number, b: number) {
    return this.#depths?.[this.#pixelAt(a, b)];
  }

  /** The grey level at a place, 0 to 255 over the window; null in colours. */
  greyAt(a: number, b: number) {
    return this.#greys?.[this.#pixelAt(a, b)] ?? null;
  }

  /**
   * Take over a picture of Python.
   * @param shares of cuts in each pixel
   */
  take(
    { shape: [height, width], spacing, origin, channels, cuts }: PaneContent,
    pixels: Uint8Array,
    depths: Float32Array | null,
    shares: Uint8Array | null,
  ) {
    const made = new ImageData(width, height),
      out = new Uint32Array(made.data.buffer);
    const [red, green, blue] = channels === 1 ? [0, 0, 0] : [0, 1, 2];
    for (let k = 0, i = 0; k < out.length; k++, i += channels) {
      out[k] = 0xff000000 | (pixels[i + blue]! << 16) | (pixels[i + green]! << 8) | pixels[i + red]!;
    }
    this.picture = makeCanvas(width, height);
    contextOf(this.picture).putImageData(made, 0, 0);
    this.#raster = { shape: [height, width], spacing, origin };
    this.#greys = channels === 1 ? pixels : null;
    this.#depths = depths;
    this.#cuts = cuts && shares && tintCuts(cuts, shares);
  }

  /** Paint it, unless it is on the canvas: most frames with moving points have the same picture. */
  paint({ k, x, y, ratio }: View, around: string) {
    const picture = this.picture,
      cuts = this.#cuts,
      painted = [picture, cuts, around, k, x, y];
    if (painted.every((value, index) => value === this.#painted[index])) return;
    this.#painted = painted;
    const c = contextOf(this.canvas);
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.fillStyle = around;
    c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    if (!picture) return;
    const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a, b],
    } = this.#raster;
    const box = [k * (a - du / 2) + x, k * (b - dv / 2) + y, k * du * nu, k * dv * nv] as const;
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.imageSmoothingQuality = "high";
    c.drawImage(picture, ...box);
    if (cuts) c.drawImage(cuts, ...box);
  }
}
