// The examples that a page holds: a carp, and D'Arcy Thompson's drawings with the nodes of his grids. They become what a
// file becomes that is read.

import type { Volume } from "../formats/volume_files.ts";
import type { Nodes } from "../maths/thompson.ts";
import { boxOfNodes } from "../maths/thompson.ts";
import type { Matrix3, Vector2, Vector3, Vector4 } from "../types.ts";
import { checkGrid } from "../volume/grid.ts";
import type { Drawing } from "./laid_pair.ts";
import { photographOf } from "./laid_pair.ts";
import type { OwnDrawing } from "./own_drawing.ts";

/** A figure of the book, as deformnb/widgets/file_pages.py writes it. */
export interface Figure {
  figure: number;
  species: string;
  modern: string;
  /** The name of its scan */
  image: string;
  /** Of the scan: its first column, and the one after its last */
  columns: Vector2;
  nodes: Nodes;
}

export interface Examples {
  carp: {
    name: string;
    values: DataView<ArrayBuffer>;
    shape: Vector3;
    spacing: Vector3;
    origin: Vector3;
    direction: Matrix3;
    unit: string;
  };
  /** PNG by their names */
  scans: Record<string, DataView<ArrayBuffer>>;
  /** By their numbers */
  figures: Record<string, Figure>;
  /** Numbers of source and target */
  pairs: Vector2[];
  /** Book, year and licence */
  origin: string;
}

const AROUND = 0.06; // of the longer side of a grid: what a drawing shows around it, such as a mouth

/** The carp, as a volume that was read. */
export function carpVolume({ carp: { name, values, shape, spacing, origin, direction, unit } }: Examples): Volume {
  return {
    name,
    grid: { ...checkGrid(shape, spacing, origin, direction), unit },
    values: new Uint8Array(values.buffer.slice(0)),
    dtype: "uint8",
    isLabels: false,
    notes: [],
  };
}

const decoded = new WeakMap<DataView, Promise<ImageBitmap>>(); // most scans show more than one figure

/** The scan of a figure, decoded once. */
export function scanOf({ scans }: Examples, { image }: Figure): Promise<ImageBitmap> {
  const bytes = scans[image]!,
    scan = decoded.get(bytes) ?? createImageBitmap(new Blob([bytes], { type: "image/png" }));
  decoded.set(bytes, scan);
  return scan;
}

/** A figure as a drawing with a grid: the part of its scan with the grid and what reaches a little beyond. */
export async function drawingOf(examples: Examples, figure: Figure): Promise<Drawing> {
  const image = await scanOf(examples, figure),
    { nodes, columns, species, modern } = figure,
    [a0, a1, b0, b1] = boxOfNodes(nodes),
    margin = AROUND * Math.max(a1 - a0, b1 - b0);
  const part: Vector4 = [
    Math.max(columns[0], Math.floor(a0 - margin)),
    Math.min(columns[1], Math.ceil(a1 + margin)),
    Math.max(0, Math.floor(b0 - margin)),
    Math.min(image.height, Math.ceil(b1 + margin)),
  ];
  const today = modern.startsWith(species) ? modern : `${species}, today ${modern}`,
    title = `Thompson's figure ${figure.figure}: ${today}`;
  return { image, part, nodes, name: species, title, isFigure: true };
}

/** A figure as a user's drawing, which has its grid already. */
export async function exampleDrawing(examples: Examples, figure: Figure): Promise<OwnDrawing> {
  const { image, part, nodes, name } = await drawingOf(examples, figure),
    { width, height } = image as ImageBitmap,
    canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d")!.drawImage(image, 0, 0);
  return { name, image: canvas.toDataURL("image/png"), nodes, placed: [], part, factor: 1 };
}

/** A figure as a picture that was read, and the box of its grid on it. */
export async function examplePicture(examples: Examples, figure: Figure) {
  const { image, part, nodes, name } = await drawingOf(examples, figure),
    [a0, a1, b0, b1] = part,
    canvas = Object.assign(document.createElement("canvas"), { width: a1 - a0, height: b1 - b0 });
  canvas.getContext("2d", { willReadFrequently: true })!.drawImage(image, -a0, -b0);
  const [c0, c1, d0, d1] = boxOfNodes(nodes);
  return { photograph: photographOf(canvas, name), subject: [c0 - a0, c1 - a0, d0 - b0, d1 - b0] as Vector4 };
}
