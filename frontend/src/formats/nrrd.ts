// NRRD in one file (.nrrd), by the rules of deformnb/io/volumes/nrrd.py. Source: the definition of the NRRD file format of Teem.

import { HEADER_BYTES, MOST_SKIPPED } from "../generated.ts";
import { perAxis } from "../maths/axes.ts";
import { cross, mapVector } from "../maths/camera.ts";
import type { Matrix3, Vector3, Vector4 } from "../types.ts";
import { IDENTITY } from "../volume/grid.ts";
import { commonUnit, statedUnit } from "../volume/units.ts";
import type { VoxelType } from "./reading.ts";
import { ByteReader, FileError, floatsOfText, integerOf, integersOf, shownText, volumeShape } from "./reading.ts";
import type { Header } from "./volume_files.ts";

const TYPES: Record<VoxelType, string[]> = {
  i1: ["signed char", "int8", "int8_t"],
  u1: ["uchar", "unsigned char", "uint8", "uint8_t"],
  i2: ["short", "short int", "signed short", "signed short int", "int16", "int16_t"],
  u2: ["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"],
  i4: ["int", "signed int", "int32", "int32_t"],
  u4: ["uint", "unsigned int", "uint32", "uint32_t"],
  i8: ["longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"],
  u8: ["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"],
  f4: ["float"],
  f8: ["double"],
};

/** The conversion of each space to left-posterior-superior. */
const SPACES: Record<string, Vector3> = {
  "left-posterior-superior": [1, 1, 1],
  lps: [1, 1, 1],
  "right-anterior-superior": [-1, -1, 1],
  ras: [-1, -1, 1],
  "left-anterior-superior": [1, -1, 1],
  las: [1, -1, 1],
  "scanner-xyz": [1, 1, 1],
  "3d-right-handed": [1, 1, 1],
  "3d-left-handed": [1, 1, 1],
};
const PLACES = ["domain", "space", "???", "none"]; // kinds of axes in space

export type Texts = Record<string, string>;
/** Fields of a header; the first four are in every one. */
export type HeaderFields = Texts & Record<(typeof REQUIRED)[number], string>;
const REQUIRED = ["dimension", "type", "sizes", "encoding"] as const;

function fieldsOf(data: Uint8Array) {
  const text = new TextDecoder("latin1").decode(data); // a byte is a character, so that places are counted in bytes
  if (!text.startsWith("NRRD000")) throw new FileError("this is not a NRRD file: it does not begin with NRRD000.");
  const end = /\r?\n\r?\n/.exec(text);
  if (!end) throw new FileError("its header has no end (an empty line); it is cut short or damaged.");
  const fields: Texts = {},
    keys: Texts = {};
  for (const line of text.slice(0, end.index).split(/\r?\n/).slice(1)) {
    if (line.startsWith("#") || !line.trim()) continue;
    const assign = line.indexOf(":=");
    if (assign >= 0 && !line.slice(0, assign).includes(": ")) {
      keys[line.slice(0, assign).trim()] = line.slice(assign + 2).trim();
      continue;
    }
    const colon = line.indexOf(":"),
      name = line.slice(0, Math.max(0, colon)).trim().toLowerCase().replaceAll(" ", "");
    if (colon < 0 || Object.hasOwn(fields, name)) {
      const why = colon < 0 ? "is neither 'field: value' nor 'key:=value'" : "appears twice";
      throw new FileError(`the header's line '${shownText(line)}' ${why}.`);
    }
    fields[name] = line.slice(colon + 1).trim();
  }
  for (const name of REQUIRED) {
    if (!Object.hasOwn(fields, name)) throw new FileError(`its header lacks the field '${name}'.`);
  }
  return { fields: fields as HeaderFields, keys, end: end.index + end[0].length };
}

/** The header of a file. */
export async function nrrdHeader(blob: Blob): Promise<Header> {
  const { fields, keys, end } = fieldsOf(new Uint8Array(await blob.slice(0, HEADER_BYTES).arrayBuffer()));
  const { type, isBig } = typeOf(fields),
    dimension = integerOf("dimension", fields.dimension);
  if (!(dimension >= 1 && dimension <= 16)) {
    throw new FileError(`the field 'dimension' is ${dimension}; a volume has 3.`);
  }
  const sizes = integersOf("sizes", fields.sizes, dimension),
    axes = placesOf(fields, sizes);
  const notes: string[] = [],
    shape = volumeShape(
      axes.map((axis) => sizes[axis]!),
      Number(type[1]),
      notes,
    );
  const { unit, factors } = unitOfAxes(fields, axes, notes);
  const count = shape[0] * shape[1] * shape[2],
    from = await beginningOf(blob, fields, end, count * Number(type[1]));
  return {
    shape,
    type,
    isBig,
    slope: 1,
    intercept: 0,
    ...placeOfVoxels(fields, axes, dimension, factors),
    unit,
    isLabels: keys.deformnb_labels === "yes" || Object.hasOwn(keys, "Segment0_LabelValue"),
    notes,
    read: async (work) => {
      const reader = new ByteReader(blob.slice(from.offset), from.isPacked);
      await reader.skip(from.skip);
      return reader.voxels(type, isBig, count, from.skip, work);
    },
  };
}

function typeOf(fields: HeaderFields) {
  const name = fields.type.toLowerCase().split(/\s+/).join(" ");
  const type = Object.entries(TYPES).find(([, names]) => names.includes(name))?.[0] as VoxelType | undefined;
  if (!type) {
    throw new FileError(`the voxel type '${shownText(fields.type)}' is not supported; save one number per voxel.`);
  }
  const endian = (fields.endian ?? "").toLowerCase();
  if (type[1] !== "1" && !["little", "big"].includes(endian)) {
    throw new FileError(`the field 'endian' is '${shownText(endian)}' but must be little or big.`);
  }
  return { type, isBig: endian === "big" };
}

/** Indices of the axes x, y and z. */
function placesOf(fields: Texts, sizes: number[]) {
  let kinds =
    fields.kinds !== undefined ? fields.kinds.toLowerCase().split(/\s+/).filter(Boolean) : sizes.map(() => "domain");
  if (fields.spacedirections !== undefined) {
    const vectors = vectorsOf("space directions", fields.spacedirections);
    if (vectors.length !== sizes.length) {
      throw new FileError(`the field 'space directions' has ${vectors.length} vectors for ${sizes.length} axes.`);
    }
    if (kinds.length === sizes.length) kinds = kinds.map((kind, k) => (vectors[k] ? kind : "list"));
  }
  if (kinds.length !== sizes.length) {
    throw new FileError(`the field 'kinds' names ${kinds.length} axes but there are ${sizes.length}.`);
  }
  const every = sizes.map((_, axis) => axis),
    places = every.filter((axis) => PLACES.includes(kinds[axis]!));
  const other = every.filter((axis) => !places.slice(0, 3).includes(axis));
  if (other.some((axis) => sizes[axis] !== 1)) {
    throw new FileError(
      `a volume has three axes in space but this file has (${sizes
        .map((size, k) => `${shownText(kinds[k])}: ${size}`)
        .join(", ")}). Save one channel or one time point as a separate file and open that.`,
    );
  }
  return places.slice(0, 3);
}

function vectorsOf(field: string, text: string): (number[] | null)[] {
  const words = text.match(/none|\([^()]*\)/gi) ?? [];
  if (text.replace(/none|\([^()]*\)|\s/gi, "")) {
    throw new FileError(`the field '${field}' should be vectors like (1,0,0) but is '${shownText(text)}'.`);
  }
  return words.map((word) => (word[0] === "(" ? floatsOfText(field, word.slice(1, -1).replaceAll(",", " ")) : null));
}

/**
 * The place in the file at which the voxels begin.
 * @param end of the header
 * @param expected bytes
 */
async function beginningOf(blob: Blob, fields: HeaderFields, end: number, expected: number) {
  const encoding = fields.encoding.toLowerCase(),
    isPacked = ["gzip", "gz"].includes(encoding);
  if (!isPacked && encoding !== "raw") {
    throw new FileError(`the encoding '${shownText(encoding)}' is not supported; save it as raw or gzip.`);
  }
  if (fields.datafile !== undefined) {
    throw new FileError("its voxels are in another file, which a page cannot open by itself; save both as one .nrrd.");
  }
  const lines = integerOf("line skip", fields.lineskip ?? "0"),
    skip = integerOf("byte skip", fields.byteskip ?? "0");
  if (!(lines >= 0 && lines <= HEADER_BYTES && skip >= -1 && skip <= MOST_SKIPPED) || (skip === -1 && isPacked)) {
    throw new FileError(`the fields 'line skip' (${lines}) and 'byte skip' (${skip}) are not usable.`);
  }
  let offset = end;
  if (lines) {
    const data = new Uint8Array(await blob.slice(end, end + HEADER_BYTES).arrayBuffer());
    let at = 0;
    for (let k = 0; k < lines; k++) {
      at = data.indexOf(10, at) + 1;
      if (at === 0) {
        throw new FileError(`the field 'line skip' is ${lines} but the data have fewer lines in their first MiB.`);
      }
    }
    offset += at;
  }
  if (skip === -1) return { offset: Math.max(offset, blob.size - expected), skip: 0, isPacked };
  return { offset, skip, isPacked };
}

/** The unit of lengths, and by how much the numbers along the three axes are multiplied to be in it. */
function unitOfAxes(fields: Texts, axes: number[], notes: string[]): { unit: string; factors: Vector3 } {
  const given = fields.spaceunits ?? fields.units;
  if (given === undefined) {
    const isPatient = /anterior|posterior|^(lps|ras|las)$/.test((fields.space ?? "").toLowerCase());
    return { unit: isPatient ? "mm" : "", factors: [1, 1, 1] };
  }
  const bytes = Uint8Array.from(given, (c) => c.charCodeAt(0)); // the header is read as Latin-1
  const words = [...new TextDecoder().decode(bytes).matchAll(/"([^"]*)"|(\S+)/g)].map(
    (found) => (found[1] ?? found[2])!,
  );
  const wanted = fields.spaceunits === undefined ? axes.slice(0, 3) : words.slice(0, 3).map((_, k) => k);
  if (!wanted.length || Math.max(...wanted) >= words.length) {
    throw new FileError(
      `the field '${fields.spaceunits === undefined ? "units" : "space units"}' names ${
        words.length
      } units for ${axes.length} axes.`,
    );
  }
  const units = wanted.map((axis) => statedUnit(words[axis]!, notes));
  while (units.length < 3) units.push(units[0]!);
  return commonUnit(units, notes);
}

/** @param factors by which the numbers along x, y and z are multiplied */
function placeOfVoxels(
  fields: Texts,
  axes: number[],
  dimension: number,
  factors: Vector3,
): Pick<Header, "affine" | "spacing" | "origin" | "direction"> {
  const space = (fields.space ?? "").toLowerCase();
  if (space && !Object.hasOwn(SPACES, space)) {
    throw new FileError(`the space '${shownText(space)}' is not supported; save it in left-posterior-superior.`);
  }
  const sides: Vector3 = SPACES[space] ?? [1, 1, 1],
    signs = perAxis((k) => sides[k] * factors[k]);
  const [first] = fields.spaceorigin !== undefined ? vectorsOf("space origin", fields.spaceorigin) : [];
  const placed = (vector: Vector3) => perAxis((k) => vector[k] * signs[k]);
  const corner = placed(three("space origin", first === undefined ? [0, 0, 0] : first));
  if (fields.spacedirections === undefined) {
    const { spacing, origin } = spacingsOf(fields, axes, dimension, factors);
    return { affine: null, spacing, origin: first === undefined ? origin : corner, direction: IDENTITY };
  }
  const vectors = vectorsOf("space directions", fields.spacedirections);
  const columns = axes.map((axis) => placed(three("space directions", vectors[axis])));
  while (columns.length < 3) {
    // a single picture: its normal, of length 1
    const normal: Vector3 = columns.length === 2 ? cross(columns[0]!, columns[1]!) : [0, 0, 0];
    const length = Math.hypot(...normal) || 1;
    columns.push(mapVector(normal, (x) => x / length));
  }
  const [x, y, z] = columns as Matrix3;
  const affine = perAxis((i): Vector4 => [x[i], y[i], z[i], corner[i]]);
  return { affine, spacing: [1, 1, 1], origin: corner, direction: IDENTITY };
}

function three(field: string, vector: number[] | null | undefined): Vector3 {
  if (!vector || ![2, 3, 4].includes(vector.length)) {
    throw new FileError(`the field '${field}' should have vectors of three numbers.`);
  }
  const [x = 0, y = 0, z = 0] = vector;
  return [x, y, z];
}

function spacingsOf(fields: Texts, axes: number[], dimension: number, factors: Vector3) {
  const numbersOf = (name: string, shown: string, missing: number): Vector3 => {
    const text = fields[name];
    if (text === undefined) return [missing, missing, missing];
    const values = floatsOfText(shown, text, dimension);
    return perAxis((k) => (axes[k] === undefined ? missing : values[axes[k]]!));
  };
  const spacing = numbersOf("spacings", "spacings", 1),
    least = numbersOf("axismins", "axis mins", 0);
  const centres = (fields.centers ?? fields.centerings ?? "").toLowerCase().split(/\s+/).filter(Boolean);
  // "axis min" is the border of a cell, or the place of a node.
  const first = perAxis((k) => least[k] + (centres[axes[k] ?? -1] === "cell" ? spacing[k] / 2 : 0));
  const from: Vector3 = first.every(Number.isFinite) ? first : [0, 0, 0];
  const scaled = (v: Vector3) => perAxis((k) => v[k] * factors[k]);
  return { spacing: scaled(spacing), origin: scaled(from) };
}
