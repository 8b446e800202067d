// Volumes of files in the browser, as deformnb/io reads them: the same grid, values and labels. The readers of npm were
// measured on the files of tests/js/test_volume_files.py in November 2026: nifti-reader-js 0.8.0 took 7 of 11 damaged
// ones, among them headers of gigabytes, and nrrd-js 0.2.1 unpacks no gzip.

import { AXES } from "../maths/axes.ts";
import type { Matrix3, Vector3 } from "../types.ts";
import type { Affine, Grid } from "../volume/grid.ts";
import { checkGrid, GridError, gridOfAffine, straightenGrid } from "../volume/grid.ts";
import { niftiHeader } from "./nifti.ts";
import { nrrdHeader } from "./nrrd.ts";
import type { Stored, VoxelType, Work } from "./reading.ts";
import { FileError, shownText } from "./reading.ts";

/** All that is known of a file before any voxel is read. */
export interface Header {
  /** [nz, ny, nx] */
  shape: Vector3;
  type: VoxelType;
  /** Whether the highest byte is the first */
  isBig: boolean;
  /** Voxels mean slope * stored + intercept */
  slope: number;
  intercept: number;
  /** Of the indices; null where spacing, origin and direction are stated instead */
  affine: Affine | null;
  spacing: Vector3;
  origin: Vector3;
  direction: Matrix3;
  /** Of lengths; "" where it is not known */
  unit: string;
  isLabels: boolean;
  notes: string[];
  /** The voxels as they are stored */
  read: (work: Work) => Promise<Stored>;
}

export type Values = Int8Array | Uint8Array | Int16Array | Uint16Array | Int32Array | Float32Array | Float64Array;

export interface Volume {
  name: string;
  grid: Grid;
  /** [z, y, x] in one row */
  values: Values;
  /** NumPy's name of their type */
  dtype: string;
  isLabels: boolean;
  notes: string[];
}

/** A row of deformnb/volume/known_spacings.json: a public volume whose files state a wrong spacing. */
export type KnownSpacing = {
  title: string;
  shape: Vector3;
  dtype: string;
  sha256: string;
  header_spacing: Vector3;
  spacing: Vector3;
  reason: string;
};

const FORMATS = { ".nii": niftiHeader, ".nii.gz": niftiHeader, ".nrrd": nrrdHeader };
/** Suffixes of volumes. */
export const VOLUME_SUFFIXES = Object.keys(FORMATS) as (keyof typeof FORMATS)[];

const NAMES: Record<VoxelType, string> = {
  u1: "uint8",
  i1: "int8",
  u2: "uint16",
  i2: "int16",
  u4: "uint32",
  i4: "int32",
  u8: "uint64",
  i8: "int64",
  f4: "float32",
  f8: "float64",
};

/** @param name of a file */
export function volumeSuffix(name: string) {
  return VOLUME_SUFFIXES.filter((suffix) => name.toLowerCase().endsWith(suffix)).at(-1) ?? null;
}

/** A volume of a file. */
export async function readVolume(
  blob: Blob,
  name: string,
  work: Work & { knownSpacings?: KnownSpacing[] } = {},
): Promise<Volume> {
  try {
    const suffix = volumeSuffix(name);
    if (!suffix) throw new FileError(`this is no kind of volume that is read here (${VOLUME_SUFFIXES.join(", ")}).`);
    const header = await FORMATS[suffix](blob),
      grid = gridOf(header);
    const { values, dtype } = scaleVoxels(await header.read(work), header);
    const { isLabels, notes } = header;
    const volume = { name: name.slice(0, -suffix.length) || name, grid, values, dtype, isLabels, notes };
    return await applyKnownSpacing(volume, work.knownSpacings ?? []);
  } catch (error) {
    if (error instanceof FileError || error instanceof GridError) {
      throw new FileError(`${shownText(name)}: ${error.message}`);
    }
    throw error;
  }
}

function gridOf({ shape, affine, spacing, origin, direction, unit, notes }: Header) {
  const grid = affine ? gridOfAffine(shape, affine) : straightenGrid(shape, spacing, origin, direction, notes);
  return { ...grid, unit };
}

/** The values that stored voxels mean, in the type in which Python holds them. */
function scaleVoxels(stored: Stored, { type, slope, intercept, notes }: Header) {
  if (slope !== 1 || intercept !== 0) {
    const isWide = ["i4", "u4", "i8", "u8", "f8"].includes(type);
    const values = isWide ? new Float64Array(stored.length) : new Float32Array(stored.length);
    for (let k = 0; k < values.length; k++) values[k] = Number(stored[k]) * slope + intercept;
    return { values, dtype: isWide ? "float64" : "float32" };
  }
  if (!["u4", "i8", "u8"].includes(type)) return { values: stored as Values, dtype: NAMES[type] };
  let low = stored[0]!,
    high = stored[0]!;
  for (const value of stored) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  const fits = low >= -(2 ** 31) && high < 2 ** 31;
  const values = fits ? new Int32Array(stored.length) : new Float64Array(stored.length);
  for (let k = 0; k < values.length; k++) {
    values[k] = Number(stored[k]);
    if (typeof stored[k] === "bigint" && BigInt(values[k]!) !== stored[k]) {
      throw new FileError(
        `voxels of type ${NAMES[type]} from ${low} to ${high}: neither int32 nor float64 holds all of ` +
          "them exactly. Subtract an offset or renumber the labels first.",
      );
    }
  }
  const dtype = fits ? "int32" : "float64";
  notes.push(`voxels of type ${NAMES[type]} became ${dtype}; no value changed`);
  return { values, dtype };
}

/**
 * SHA-256 of a volume's type, shape and voxels as deformnb/volume/volume.py makes it; null where the browser makes none,
 * as on pages of a server without encryption.
 */
export async function voxelChecksum({ values, dtype, grid: { shape } }: Volume) {
  const subtle = globalThis.crypto?.subtle;
  if (!subtle) return null;
  const about = new TextEncoder().encode(`${dtype} (${shape.join(", ")}) `);
  try {
    const all = new Uint8Array(about.length + values.byteLength);
    all.set(about);
    all.set(new Uint8Array(values.buffer, values.byteOffset, values.byteLength), about.length);
    const digest = new Uint8Array(await subtle.digest("SHA-256", all));
    return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
  } catch {
    // not enough memory for the copy: the document is written without it
    return null;
  }
}

async function applyKnownSpacing(volume: Volume, known: KnownSpacing[]) {
  const { grid, dtype } = volume;
  const likely = known.filter(
    (row) =>
      row.dtype === dtype &&
      AXES.every((k) => row.shape[k] === grid.shape[k]) &&
      AXES.every((k) => Math.abs(row.header_spacing[k] - grid.spacing[k]) <= 1e-5 * grid.spacing[k]),
  );
  const sha256 = likely.length ? await voxelChecksum(volume) : null;
  const row = likely.find((one) => one.sha256 === sha256);
  if (!row) return volume;
  const note =
    `this is the ${row.title}: its file has a wrong spacing, and ${row.spacing.join(" x ")} was taken, ` +
    `after ${row.reason}`;
  return {
    ...volume,
    grid: { ...checkGrid(grid.shape, row.spacing, grid.origin, grid.direction), unit: "mm" },
    notes: [...volume.notes, note],
  };
}
