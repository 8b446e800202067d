// Levels of the values of a volume and the colours that follow from them, as deformnb/volume/transfer.py finds them: the
// preset "specimen". What only shows at volumes with padding in the corners of another scale than Hounsfield's is left
// to Python.

import type { Values, Volume } from "../formats/volume_files.ts";
import {
  AIR_HU,
  AIR_SHARE,
  BINS,
  BONE_HU,
  FEW_VOXELS,
  FINEST,
  HISTOGRAM_SLICES,
  NEAR_AIR,
  NEAR_TISSUE,
  NO_VALUE,
  NOTHING_HU,
  ONE_VALUE,
  OUTLIERS,
  RESAMPLED,
  STRETCH,
} from "../generated.ts";
import { lineAt } from "../maths/curves.ts";
import type { Vector2, Vector3, Vector4 } from "../types.ts";
import { lengthsOf } from "./grid.ts";

/** Air, the edges of tissue and of dense tissue, the densest value */
export type Levels = Vector4;
export type Measured = { range: Vector2; whole: Vector2; levels: Levels; airEnd: number; hounsfield: boolean };
/** Nodes: a value with red, green and blue, and a value with its opacity */
export type Transfer = { colors: Vector4[]; opacities: Vector2[]; unit: number };

/** A note on values without contrast, as deformnb/volume/volume.py writes it; empty for others. */
export function emptyNote(values: Values) {
  const first = values[0]!;
  if (values.every((value: number) => value === first))
    return ONE_VALUE.replace("{n}", `${Number(first.toPrecision(6))}`);
  return values.some((value: number) => Number.isFinite(value)) ? "" : NO_VALUE;
}

/** Replace values that are not finite by the smallest finite one; returns how many there were. */
export function repairValues(values: Values) {
  if (!(values instanceof Float32Array || values instanceof Float64Array)) return 0;
  let low = Infinity,
    bad = 0;
  for (const value of values) {
    if (!Number.isFinite(value)) bad += 1;
    else if (value < low) low = value;
  }
  if (bad)
    for (let k = 0; k < values.length; k++) if (!Number.isFinite(values[k])) values[k] = low < Infinity ? low : 0;
  return bad;
}

/**
 * The pixels of a picture that show its subject, as deformnb/warping/foreground.py finds them: the bright ones, where the
 * rim is bright the dark ones.
 */
export function subjectPixels(picture: Volume): Uint8Array {
  const { values } = picture,
    [, high, wide] = picture.grid.shape,
    above = (some: Values) => {
      const [, edge] = measureLevels({ ...picture, values: some }).levels;
      return Uint8Array.from(some, (value) => Number(value > edge));
    },
    bright = above(values);
  let count = 0;
  for (let j = 0; j < wide; j++) count += bright[j]! + bright[(high - 1) * wide + j]!;
  for (let i = 0; i < high; i++) count += bright[i * wide]! + bright[i * wide + wide - 1]!;
  if (count <= high + wide) return bright;
  const { high: most } = rangeOf(values);
  return above(values.map((value: number) => most - value));
}

/** The smallest and the largest value from a limit on. */
function rangeOf(values: Values, from: number = -Infinity, to: number = Infinity) {
  let low = Infinity,
    high = -Infinity,
    count = 0;
  for (const value of values) {
    if (value >= from && value <= to) {
      if (value < low) low = value;
      if (value > high) high = value;
      count += 1;
    }
  }
  return { low, high, count };
}

/** Counts of the values of slices spread through the volume. */
function histogram(
  {
    values,
    grid: {
      shape: [nz, ny, nx],
    },
  }: Volume,
  low: number,
  high: number,
) {
  const counts = new Float64Array(BINS),
    every = Math.max(1, Math.floor(nz / HISTOGRAM_SLICES)),
    size = ny * nx;
  for (let z = 0; z < nz; z += every) {
    for (let k = z * size; k < (z + 1) * size; k++) {
      const value = values[k]!;
      if (value >= low && value <= high) {
        counts[Math.min(BINS - 1, Math.trunc(((value - low) / (high - low)) * BINS))]! += 1;
      }
    }
  }
  return { counts, low, high };
}

/** Otsu's threshold, IEEE Trans. SMC 9 (1979) 62-66: the last bin of the lower class. */
function otsu(counts: Float64Array) {
  let total = 0,
    sum = 0;
  counts.forEach((count, k) => {
    total += count;
    sum += count * k;
  });
  let n = 0,
    s = 0,
    best = 0,
    most = -1;
  counts.forEach((count, k) => {
    n += count;
    s += count * k;
    const between = ((sum * n) / total - s) ** 2 / (n * (total - n));
    if (Number.isFinite(between) && between > most) {
      most = between;
      best = k;
    }
  });
  return best;
}

/**
 * The range without padding and outliers, and the levels.
 * @param volume whose values are finite
 */
export function measureLevels(volume: Volume): Measured {
  const { values, isLabels, dtype } = volume,
    whole = rangeOf(values);
  const all: Vector2 = [whole.low, whole.high];
  const low = isLabels ? whole.low : skipPadding(values, whole.low, whole.high),
    { high } = whole;
  if (high <= low)
    return { range: [low, low], whole: all, levels: [low, low, low, low], airEnd: low, hounsfield: false };
  const mayHave = !isLabels && !dtype.endsWith("int8") && values.length >= FEW_VOXELS;
  const found = mayHave ? typical(volume, histogram(volume, low, high), whole.low) : histogram(volume, low, high);
  const levels = levelsOf(found),
    hounsfield = !isLabels && levels[0] <= AIR_HU && levels[3] >= BONE_HU;
  return { range: [found.low, found.high], whole: all, levels, airEnd: airEndOf(found), hounsfield };
}

function skipPadding(values: Values, low: number, high: number) {
  if (!(low < NOTHING_HU && high >= BONE_HU)) return low;
  const near = low + (NOTHING_HU - low) / 8,
    air = rangeOf(values, NOTHING_HU).low;
  let between = 0;
  for (const value of values) if (value > near && value < NOTHING_HU) between += 1;
  return air <= AIR_HU && between <= RESAMPLED * values.length ? air : low;
}

export type Histogram = ReturnType<typeof histogram>;

/** The histogram over the range of all but a few outliers, where these stretch it sixteenfold or more. */
function typical(volume: Volume, whole: Histogram, background: number) {
  const { values } = volume,
    size = whole.low > background ? rangeOf(values, whole.low).count : values.length;
  const most = Math.max(1, Math.trunc(OUTLIERS * size));
  let found = whole;
  for (let ends = crowdedRange(found, most); ends; ends = crowdedRange(found, most)) {
    const { low, high, count } = rangeOf(values, ends[0], ends[1]);
    if (!(low < high) || size - count > most) return whole;
    if (low === found.low && high === found.high) break;
    found = histogram(volume, low, high);
  }
  return found;
}

/** Edges of the few bins that hold all that is counted but `most` voxels; null if they are not few. */
function crowdedRange({ counts, low, high }: Histogram, most: number): [number, number] | null {
  const below = [0];
  for (const count of counts) below.push(below.at(-1)! + count);
  const needed = below[BINS]! - most;
  let first = 0,
    width = Infinity;
  for (let k = 0, end = 0; k <= BINS; k++) {
    while (end <= BINS && below[end]! < below[k]! + needed) end += 1;
    if (end > BINS) break;
    if (end - k < width) {
      width = end - k;
      first = k;
    }
  }
  if (width > Math.floor(BINS / STRETCH)) return null;
  const bin = (high - low) / BINS;
  return [low + first * bin, low + (first + width) * bin];
}

function levelsOf({ counts, low, high }: Histogram): Levels {
  const middle = (k: number) => low + (k + 0.5) * ((high - low) / BINS),
    first = otsu(counts);
  const upper = counts.subarray(first + 1),
    above = upper.reduce((sum, count) => sum + count, 0);
  const second = above ? first + 1 + otsu(upper) : first;
  let top = BINS - 1;
  for (let sum = counts[top]!; sum <= 1e-4 * above && top > 0; sum += counts[top]!) top -= 1;
  return [low, middle(first), middle(second), middle(top)];
}

/** The value that nearly all voxels below the edge between air and tissue are below; some way from the lowest. */
function airEndOf({ counts, low, high }: Histogram) {
  const below = counts.subarray(0, otsu(counts) + 1),
    most = AIR_SHARE * below.reduce((sum, count) => sum + count, 0);
  let last = 0;
  for (let sum = below[0]!; sum < most && last + 1 < below.length; sum += below[last]!) last += 1;
  return low + Math.max(last + 1, NEAR_AIR * below.length) * ((high - low) / BINS);
}

/** The preset "specimen": faint flesh and bright bones. */
export function specimen({ grid }: Volume, { levels, airEnd, hounsfield }: Measured): Transfer {
  const [low, air, dense, high] = levels,
    skin: Vector3 = [0.55, 0.28, 0.18],
    isThin = airEnd <= air - NEAR_TISSUE * (air - low); // parts are fainter than the edge of tissue
  const body = air + 0.35 * (dense - air),
    unit = Math.min(...lengthsOf(grid)) / 100;
  const nodes: { value: number; colour: Vector3; opacity: number }[] = hounsfield
    ? [
        { value: low, colour: skin, opacity: 0 },
        { value: -200, colour: [0.78, 0.5, 0.34], opacity: 0 },
        { value: -80, colour: [0.86, 0.6, 0.42], opacity: 0.008 },
        { value: 60, colour: [0.78, 0.36, 0.25], opacity: 0.01 },
        { value: 160, colour: [0.9, 0.52, 0.36], opacity: 0.03 },
        { value: 300, colour: [0.98, 0.86, 0.66], opacity: 0.22 },
        { value: 700, colour: [1, 0.96, 0.86], opacity: 0.6 },
        { value: Math.max(high, 1000), colour: [1, 1, 0.97], opacity: 0.9 },
      ]
    : [
        { value: low, colour: skin, opacity: 0 },
        ...(isThin ? [{ value: (airEnd + air) / 2, colour: skin, opacity: 0 }] : []),
        { value: air, colour: [0.62, 0.33, 0.2], opacity: isThin ? 0.03 : 0 },
        { value: body, colour: [0.86, 0.55, 0.38], opacity: 0.03 },
        { value: dense, colour: [0.98, 0.86, 0.66], opacity: 0.045 },
        { value: dense + 0.35 * (high - dense), colour: [1, 0.96, 0.86], opacity: 0.45 },
        { value: high, colour: [1, 1, 0.97], opacity: 0.9 },
      ];
  let most = -Infinity; // values never fall
  const rising = nodes.map((node) => {
    most = Math.max(most, node.value);
    return { ...node, value: most };
  });
  return {
    colors: rising.map(({ value, colour }) => [value, ...colour]),
    opacities: rising.map(({ value, opacity }) => [value, opacity]),
    unit,
  };
}

/** Red, green, blue and opacity at a value: lines between the nodes, constant beyond. */
function colourAt({ colors, opacities }: Transfer, value: number) {
  const parts = ([1, 2, 3] as const).map((part) => colors.map((node): Vector2 => [node[0], node[part]]));
  return [...parts, opacities].map((nodes) => lineAt(nodes, value));
}

/** Neighbouring nodes between which the function changes. */
function changesOf(transfer: Transfer) {
  const values = [...new Set([...transfer.colors, ...transfer.opacities].map(([value]) => value))].sort(
    (a, b) => a - b,
  );
  const rgba = values.map((value) => colourAt(transfer, value));
  return values
    .slice(1)
    .flatMap((high, k): Vector2[] =>
      rgba[k]!.some((part, j) => part !== rgba[k + 1]![j]) ? [[values[k]!, high]] : [],
    );
}

/** Red, green, blue and alpha of evenly spaced values from low to high. */
export function tableOf(transfer: Transfer, low: number, high: number) {
  const widths = changesOf(transfer).flatMap(([a, b]) => (b >= low && a <= high ? [b - a] : []));
  const narrowest = Math.min(...widths);
  const fine = [1, 2, 4, FINEST].find((k) => narrowest >= (16 * (high - low)) / (255 * k)) ?? FINEST;
  const entries = 255 * fine + 1;
  return Float32Array.from(
    Array.from({ length: entries }, (_, k) => colourAt(transfer, low + ((high - low) * k) / (entries - 1))).flat(),
  );
}

/**
 * The values that bytes distinguish: all of bytes and labels, else up to the densest tissue, and only those among which
 * colours change where these are less than a quarter.
 */
export function windowOf(
  { dtype, isLabels }: Volume,
  { whole, levels }: Measured,
  transfer: Transfer,
): { window: Vector2; share: number } {
  const isPlain = isLabels || dtype === "uint8",
    [low, most] = isPlain ? whole : [levels[0], levels[3]];
  const high = most > low ? most : low + Math.max(1, Math.abs(low)) * 1e-6,
    all = high - low;
  const step = dtype.startsWith("float") ? 0 : 1,
    changes = changesOf(transfer);
  if (!isLabels && all > 255 * step && changes.length) {
    const clipped = (value: number) => Math.min(high, Math.max(low, value));
    const first = clipped(changes[0]![0]),
      last = clipped(changes.at(-1)![1]);
    if (last > first && last - first < 0.25 * all) {
      const width = Math.max(1.1 * (last - first), all / 64, 255 * step),
        middle = (first + last) / 2;
      const window: Vector2 = [Math.max(low, middle - width / 2), Math.min(high, middle + width / 2)];
      return { window, share: (window[1] - window[0]) / all };
    }
  }
  return { window: [low, high], share: 1 };
}
