// A file that a user has opened on a page, read and packed without Python, and the data of a page that shows it: the
// traits of the widgets with the file's volume in place of the tiny one that Python has written.

import type { Photograph } from "../formats/pictures.ts";
import { PICTURE_SUFFIXES, readPicture } from "../formats/pictures.ts";
import { FileError, shownText } from "../formats/reading.ts";
import type { KnownSpacing, Volume } from "../formats/volume_files.ts";
import { readVolume, VOLUME_SUFFIXES, volumeSuffix, voxelChecksum } from "../formats/volume_files.ts";
import { PICTURE_SIDES } from "../generated.ts";
import { coarseMask } from "../maths/tissue_extent.ts";
import type { Plane, Values, Vector4 } from "../types.ts";
import { HIDDEN_PIXELS, hidesPixels } from "../ui/canvas_pixels.ts";
import { coarserGrid, lengthsOf, pictureSides, planeAlong, unitOf, voxelRaster } from "../volume/grid.ts";
import type { Measured } from "../volume/levels.ts";
import {
  emptyNote,
  measureLevels,
  repairValues,
  specimen,
  subjectPixels,
  tableOf,
  windowOf,
} from "../volume/levels.ts";
import {
  bytesOfVolume,
  cornerPoints,
  factorsOf,
  maximumProjection,
  packedPicture,
  pictureWindow,
  piecesOf,
  stillField,
  volumeInfo,
} from "../volume/packing.ts";
import { bestView, subjectBox } from "../volume/subject.ts";
import type { Examples } from "./examples.ts";
import type { PageData } from "./standalone_page.ts";

export type Template = PageData & { known_spacings: KnownSpacing[]; examples: Examples };

/** A file that is open. */
export interface Opened {
  volume: Volume;
  /** Why nothing is seen of it; empty where something is */
  warning: string;
  photograph: Photograph | null;
  about: Measured;
  /** Of the voxels, as Python makes it */
  sha256: string | null;
  packed: (Pick<PageData, "chunks"> & { packed: Values }) | null;
  /** The side from which it is seen first */
  side: string;
  /** The box of what a grid is laid on, where that is known; null where it is looked for */
  subject: Vector4 | null;
}

const PICTURE_SIDE = "+z"; // its rows run down and its columns to the right

export type ReportProgress = (words: string, share: number) => void;

let editors = 0; // that were on the page: each has separate undo steps

/** The bytes of a PNG of pixels. */
export async function pngOf(rgba: Uint8ClampedArray<ArrayBuffer>, width: number, height: number) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d")?.putImageData(new ImageData(rgba, width, height), 0, 0);
  return new DataView(await (await blobOf(canvas)).arrayBuffer());
}

export function blobOf(canvas: HTMLCanvasElement): Promise<Blob> {
  if (hidesPixels()) return Promise.reject(new Error(HIDDEN_PIXELS));
  return new Promise((resolve, reject) =>
    canvas.toBlob((blob) => {
      if (blob) resolve(blob);
      else reject(new Error("the browser could not make the picture; there is not enough memory."));
    }, "image/png"),
  );
}

/** Read a file and prepare all that does not depend on the side it is seen from. */
export async function readFile(
  file: File,
  template: Template,
  report: ReportProgress,
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
  return openVolume(volume, photograph, report, signal);
}

/** Prepare a volume, or the photograph it was read from, likewise. */
export async function openVolume(
  volume: Volume,
  photograph: Photograph | null,
  report: ReportProgress,
  signal: AbortSignal,
): Promise<Opened> {
  const sha256 = photograph && !photograph.isExact ? null : await voxelChecksum(volume);
  const warning = emptyNote(volume.values),
    bad = repairValues(volume.values);
  if (bad && !warning) volume.notes.push(`${bad} voxels are not finite, shown as background`);
  const about = measureLevels(volume);
  signal.throwIfAborted();
  return {
    volume,
    warning,
    photograph,
    about,
    sha256,
    packed: photograph ? null : await packVolume(volume, about, report, signal),
    side: photograph ? PICTURE_SIDE : bestView(volume, about),
    subject: null,
  };
}

async function packVolume(volume: Volume, about: Measured, report: ReportProgress, signal: AbortSignal) {
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
export async function dataOf(template: Template, opened: Opened, side: string): Promise<PageData> {
  const { volume, photograph, about, packed } = opened,
    { grid } = volume,
    plane = planeAlong(grid, side);
  const { image, raster, still, outline } = photograph
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
    outline,
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
  };
}

/** The box around the subject of an open file, seen from a side: a0, a1, b0, b1; the whole picture where none is found. */
export function subjectOf({ volume, photograph, subject }: Opened, side: string): Vector4 {
  const plane = planeAlong(volume.grid, side),
    raster = voxelRaster(volume.grid, plane),
    [rows, columns] = raster.shape,
    [a, b] = raster.origin,
    [du, dv] = raster.spacing;
  const pixels = photograph ? volume.values : maximumProjection(volume, plane);
  return subject ?? subjectBox(pixels, raster) ?? [a, a + (columns - 1) * du, b, b + (rows - 1) * dv];
}

async function greyPicture(volume: Volume, about: Measured, plane: Plane) {
  const pixels = maximumProjection(volume, plane),
    air = volume.isLabels ? about.whole[0] : about.levels[1],
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
    outline: {
      tissue: await coarseMask(
        Uint8Array.from(pixels, (value) => Number(value > air)),
        raster,
      ),
      sides: pictureSides(plane),
    },
    raster: { ...raster, ...facts, unit: about.hounsfield ? "HU" : "", lengths: unitOf(volume.grid) },
  };
}

const written = new WeakMap<Photograph["shown"], Promise<DataView<ArrayBuffer>>>();

/** A photograph as a PNG, written once. */
function photographPng({ shown }: Photograph) {
  const png = written.get(shown) ?? pngOf(shown.rgba, shown.width, shown.height);
  written.set(shown, png);
  return png;
}

async function colourPicture(photograph: Photograph, plane: Plane) {
  const {
      shown: { width, height, factor },
      volume,
    } = photograph,
    {
      spacing: [du, dv],
      origin: [a, b],
    } = voxelRaster(volume.grid, plane),
    off = (factor - 1) / 2;
  const image = await photographPng(photograph);
  return {
    image,
    still: image,
    outline: {
      tissue: await coarseMask(subjectPixels(volume), voxelRaster(volume.grid, plane)),
      sides: [...PICTURE_SIDES],
    },
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

/** The identity of an open file. */
export function nameOf({ volume: { name, grid }, sha256 }: Opened) {
  return sha256 ?? `${name} ${grid.shape.join(" ")}`;
}
