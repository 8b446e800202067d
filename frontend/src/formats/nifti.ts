// NIfTI-1 and NIfTI-2 in one file, by the rules of deformnb/io/volumes/nifti.py: the sform if its code is above 0, else the qform
// if its code is above 0, else the voxel sizes alone. NIfTI is RAS: x and y change sign. Source: nifti1.h and nifti2.h.

import { FIRST_VOXEL, LABEL_INTENT, MOST_EXTENSIONS } from "../generated.ts";
import type { Axis } from "../maths/axes.ts";
import { perAxis } from "../maths/axes.ts";
import type { Vector2, Vector3, Vector4 } from "../types.ts";
import { IDENTITY } from "../volume/grid.ts";
import type { VoxelType } from "./reading.ts";
import { ByteReader, FileError, volumeShape } from "./reading.ts";
import type { Header } from "./volume_files.ts";

const TYPES: Record<number, VoxelType> = {
  2: "u1",
  4: "i2",
  8: "i4",
  16: "f4",
  64: "f8",
  256: "i1",
  512: "u2",
  768: "u4",
  1024: "i8",
  1280: "u8",
};
const REFUSED: Record<number, string> = {
  1: "single bits",
  32: "complex numbers",
  128: "colours",
  1536: "128-bit floats",
  1792: "complex numbers",
  2048: "complex numbers",
  2304: "colours",
};
const UNITS = ["", "m", "mm", "\u00b5m"]; // by their codes

export interface Fields {
  dim: [axes: number, ...sizes: number[]];
  pixdim: [...Vector4, ...number[]];
  datatype: number;
  offset: number;
  scaling: Vector2;
  codes: Vector2;
  quatern: [...Vector3, ...Vector3];
  srow: number[];
  intent: number;
  units: number;
  isBig: boolean;
}

function fieldsOf(data: Uint8Array): Fields {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const text = (from: number) => String.fromCharCode(...data.subarray(from, from + 3));
  for (const little of [true, false]) {
    const size = data.length >= 4 ? view.getInt32(0, little) : 0;
    const list = <L extends number[]>(count: number, read: (k: number) => number) =>
      Array.from({ length: count }, (_, k) => read(k)) as L;
    const floats = <L extends number[]>(from: number, count: number) =>
      list<L>(count, (k) => view.getFloat32(from + 4 * k, little));
    const doubles = <L extends number[]>(from: number, count: number) =>
      list<L>(count, (k) => view.getFloat64(from + 8 * k, little));
    if (size === 348 && data.length >= 352) {
      if (text(344) === "ni1")
        throw new FileError("this is the header of a pair .hdr and .img; save both as one .nii.");
      if (text(344) !== "n+1") {
        throw new FileError(
          "this is Analyze 7.5 or a damaged NIfTI file (no NIfTI mark at byte 344); convert it first.",
        );
      }
      return {
        dim: list(8, (k) => view.getInt16(40 + 2 * k, little)),
        pixdim: floats(76, 8),
        datatype: view.getInt16(70, little),
        offset: view.getFloat32(108, little),
        scaling: floats(112, 2),
        codes: [view.getInt16(252, little), view.getInt16(254, little)],
        quatern: floats(256, 6),
        srow: floats(280, 12),
        intent: view.getInt16(68, little),
        units: view.getUint8(123),
        isBig: !little,
      };
    }
    if (size === 540 && data.length >= 544) {
      if (text(4) !== "n+2") throw new FileError("this is a damaged NIfTI-2 file or the header of a pair.");
      return {
        dim: list(8, (k) => Number(view.getBigInt64(16 + 8 * k, little))),
        pixdim: doubles(104, 8),
        datatype: view.getInt16(12, little),
        offset: Number(view.getBigInt64(168, little)),
        scaling: doubles(176, 2),
        codes: [view.getInt32(344, little), view.getInt32(348, little)],
        quatern: doubles(352, 6),
        srow: doubles(400, 12),
        intent: view.getInt32(504, little),
        units: view.getInt32(500, little) & 255,
        isBig: !little,
      };
    }
  }
  throw new FileError("this is not a NIfTI file: its header's own size is neither 348 nor 540.");
}

/** The header of a file. */
export async function niftiHeader(blob: Blob): Promise<Header> {
  const [a, b] = new Uint8Array(await blob.slice(0, 2).arrayBuffer()),
    isPacked = a === 0x1f && b === 0x8b;
  const reader = new ByteReader(blob, isPacked),
    start = await reader.take(544);
  const fields = fieldsOf(start),
    { datatype, dim, offset } = fields,
    type = TYPES[datatype];
  await reader.close();
  if (REFUSED[datatype]) throw new FileError(`its voxels are ${REFUSED[datatype]}; save one real number per voxel.`);
  if (!type) throw new FileError(`the field 'datatype' is ${datatype}, which NIfTI does not define.`);
  if (!(dim[0] >= 1 && dim[0] <= 7)) throw new FileError(`the field 'dim' starts with ${dim[0]} axes; a volume has 3.`);
  const notes: string[] = [],
    shape = volumeShape(dim.slice(1, 1 + dim[0]), Number(type[1]), notes);
  if (!(Number.isInteger(offset) && offset >= FIRST_VOXEL && offset <= MOST_EXTENSIONS)) {
    throw new FileError(`the field 'vox_offset' is ${offset}; it should be a whole number from ${FIRST_VOXEL} on.`);
  }
  const [slope, intercept] = scalingOf(fields),
    code = fields.units & 7,
    unit = UNITS[code] ?? "";
  if (code >= UNITS.length) {
    notes.push(`the code ${code} of its unit of lengths is none of NIfTI; its numbers stay as they are`);
  }
  const { affine, direction, origin } = placeOfVoxels(fields, notes);
  const spacing = perAxis((k) => fields.pixdim[k + 1]!);
  return {
    shape,
    type,
    isBig: fields.isBig,
    slope,
    intercept,
    affine,
    spacing,
    origin,
    direction,
    unit,
    isLabels: fields.intent === LABEL_INTENT,
    notes,
    read: async (work) => {
      const voxels = new ByteReader(blob, isPacked);
      await voxels.skip(offset);
      return voxels.voxels(type, fields.isBig, shape[0] * shape[1] * shape[2], offset, work);
    },
  };
}

function scalingOf({ scaling: [slope, intercept] }: Fields): Vector2 {
  if (slope === 0 || Number.isNaN(slope)) return [1, 0]; // "not scaled" in the standard
  if (!(Number.isFinite(slope) && Number.isFinite(intercept))) {
    throw new FileError(`the fields 'scl_slope' and 'scl_inter' are ${slope} and ${intercept}; they must be finite.`);
  }
  return [slope, intercept];
}

type Place = Pick<Header, "affine" | "direction" | "origin">;

/** The sform as an affine map if it counts, else direction and origin. */
function placeOfVoxels(fields: Fields, notes: string[]): Place {
  const [qform, sform] = fields.codes,
    { srow, pixdim } = fields;
  if (sform <= 0) {
    if (qform <= 0) {
      notes.push("the file states no place of the volume: its axes were taken as right, anterior, superior");
    }
    return { affine: null, ...qformOf(fields) };
  }
  if (!srow.every(Number.isFinite)) throw new FileError("the sform (srow_x, srow_y, srow_z) is not finite.");
  const affine = perAxis((k) => srow.slice(4 * k, 4 * k + 4).map((x) => (k < 2 ? -x : x)) as Vector4);
  const place: Place = { affine, direction: IDENTITY, origin: [0, 0, 0] };
  if (qform > 0) {
    const { direction, origin } = qformOf(fields);
    const most = Math.max(...affine.flatMap((row) => row.slice(0, 3).map(Math.abs)));
    const isSame = affine.every((row, i) =>
      row.every((x, k) => {
        const other = k < 3 ? direction[i as Axis][k as Axis] * pixdim[1 + k]! : origin[i as Axis];
        return Math.abs(other - x) <= 1e-2 * most + 1e-3 * Math.abs(x);
      }),
    );
    if (!isSame) notes.push("the file holds two different places (qform and sform); the sform is used");
  }
  return place;
}

/** Direction and origin of the qform, or of the bare axes if it does not count. */
function qformOf({ codes, quatern, pixdim }: Fields): Omit<Place, "affine"> {
  if (codes[0] <= 0)
    return {
      direction: [
        [-1, 0, 0],
        [0, -1, 0],
        [0, 0, 1],
      ],
      origin: [0, 0, 0],
    };
  let [b, c, d] = quatern;
  const [, , , x, y, z] = quatern,
    length = Math.sqrt(b * b + c * c + d * d);
  if (!Number.isFinite(length)) throw new FileError("the qform's quaternion is not finite.");
  if (length > 1) {
    b /= length;
    c /= length;
    d /= length;
  }
  const a = Math.sqrt(Math.max(0, 1 - (b * b + c * c + d * d))),
    flip = pixdim[0] < 0 ? -1 : 1;
  return {
    direction: [
      [-(a * a + b * b - c * c - d * d), -2 * (b * c - a * d), -2 * flip * (b * d + a * c)],
      [-2 * (b * c + a * d), -(a * a + c * c - b * b - d * d), -2 * flip * (c * d - a * b)],
      [2 * (b * d - a * c), 2 * (c * d + a * b), flip * (a * a + d * d - b * b - c * c)],
    ],
    origin: [-x, -y, z],
  };
}
