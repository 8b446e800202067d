// Two drawings with a grid on each, laid on sheets of paper of one size: the first as it is, the second with the same area
// and middle, so that the first deformed by the grids is as large as the second beside it.

import type { Photograph } from "../formats/pictures.ts";
import type { Nodes } from "../maths/thompson.ts";
import { boxOfNodes, placePair } from "../maths/thompson.ts";
import type { Vector2, Vector4 } from "../types.ts";
import { checkGrid, IDENTITY } from "../volume/grid.ts";
import { blobOf } from "./opened_file.ts";

/** A picture with a grid on it. */
export interface Drawing {
  image: CanvasImageSource;
  /** What is shown of it: a0, a1, b0, b1 in its pixels */
  part: Vector4;
  /** In its pixels, from the middle of the first one */
  nodes: Nodes;
  /** Of what is drawn */
  name: string;
  /** A longer name */
  title: string;
  /** Whether it is a figure of an animal, with its head on the left */
  isFigure: boolean;
}

/** The grey of paper, from 0 to 255. */
export const PAPER = 255;
const MARGIN = 0.03; // of the longer side of what is shown: room for marks at its border
const GREY = [0.2126, 0.7152, 0.0722] as const; // luminance of red, green and blue

/** A picture on a sheet: the middle p of a pixel of it is at scale * p + shift of the sheet. */
type OnSheet = { image: CanvasImageSource; part: Vector4; scale: Vector2; shift: Vector2 };

/** A sheet of white paper with a picture, a pixel for a unit. */
function sheetOf([a0, a1, b0, b1]: Vector4, { image, part: [p0, p1, q0, q1], scale, shift }: OnSheet) {
  const canvas = Object.assign(document.createElement("canvas"), { width: a1 - a0, height: b1 - b0 }),
    c = canvas.getContext("2d", { willReadFrequently: true });
  if (!c) throw new Error("there is not enough memory for the picture.");
  c.fillStyle = `rgb(${PAPER} ${PAPER} ${PAPER})`;
  c.fillRect(0, 0, canvas.width, canvas.height);
  c.imageSmoothingQuality = "high";
  const begin = (k: 0 | 1, first: number) => shift[k] + (1 - scale[k]) / 2 - first; // a pixel's edge, not its middle
  c.setTransform(scale[0], 0, 0, scale[1], begin(0, a0), begin(1, b0));
  c.drawImage(image, p0, q0, p1 - p0, q1 - q0, p0, q0, p1 - p0, q1 - q0);
  c.resetTransform();
  return canvas;
}

/** A canvas as a picture that was read. */
export function photographOf(canvas: HTMLCanvasElement, name: string): Photograph {
  const { width, height } = canvas,
    rgba = canvas.getContext("2d")!.getImageData(0, 0, width, height).data as Uint8ClampedArray<ArrayBuffer>,
    values = new Uint8Array(width * height);
  for (let k = 0; k < values.length; k++) {
    values[k] = GREY.reduce((sum, share, part) => sum + share * rgba[4 * k + part]!, 0);
  }
  const grid = checkGrid([1, height, width], [1, 1, 1], [0, 0, 0], IDENTITY);
  const volume = { name, grid, values, dtype: "uint8", isLabels: false, notes: [] };
  return { volume, isExact: false, shown: { rgba, width, height, factor: 1 } };
}

export class LaidPair {
  /** Nodes of the grids on the sheets, whose first pixel has its middle at 0. */
  readonly source: Nodes;
  readonly target: Nodes;
  readonly photograph: Photograph;
  /** The sheet of the second drawing. */
  readonly goal: HTMLCanvasElement;
  /** Where the middle of the first drawing's first pixel is on the sheets. */
  readonly origin: Vector2;
  #goalPicture: Promise<Blob> | null = null;

  constructor(
    readonly first: Drawing,
    readonly second: Drawing,
  ) {
    const { source, target, scale, shift } = placePair(first.nodes, second.nodes, { box: boxOfNodes(first.nodes) });
    const corner = (k: 0 | 1, n: number) => scale[k] * second.part[n]! + shift[k];
    const [a0, a1, b0, b1] = [
      Math.min(first.part[0], corner(0, 0)),
      Math.max(first.part[1], corner(0, 1)),
      Math.min(first.part[2], corner(1, 2)),
      Math.max(first.part[3], corner(1, 3)),
    ] as const;
    const margin = MARGIN * Math.max(a1 - a0, b1 - b0);
    const box: Vector4 = [
      Math.floor(a0 - margin),
      Math.ceil(a1 + margin),
      Math.floor(b0 - margin),
      Math.ceil(b1 + margin),
    ];
    const onSheet = (nodes: Nodes) => nodes.map((row) => row.map(([a, b]): Vector2 => [a - box[0], b - box[2]]));
    this.source = onSheet(source);
    this.target = onSheet(target);
    this.origin = [-box[0], -box[2]];
    this.photograph = photographOf(
      sheetOf(box, { image: first.image, part: first.part, scale: [1, 1], shift: [0, 0] }),
      first.name,
    );
    this.goal = sheetOf(box, { image: second.image, part: second.part, scale, shift });
  }

  /** The sheet of the second drawing as a PNG, written once. */
  goalPicture() {
    this.#goalPicture ??= blobOf(this.goal);
    return this.#goalPicture;
  }

  /** The edges of the sheets: a0, a1, b0, b1. */
  get box(): Vector4 {
    const { width, height } = this.goal;
    return [-0.5, width - 0.5, -0.5, height - 0.5];
  }
}
