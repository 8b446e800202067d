// Tissue that is moved out of the box of the result: found from its outline, which is followed to where it is seen, and
// from what is seen beyond the sides of the box, where a map that folds shows tissue which nothing leads to.

import { CUT_OFF, LEAVES } from "../generated.ts";
import type { LayeredFit, MaskData, Raster, Vector2, Vector4 } from "../types.ts";
import { placeOf } from "./cuts.ts";
import { maskPixels } from "./regions.ts";
import { findVisiblePlace } from "./warp_map.ts";

const CELLS = 128; // along the longest side of a mask of which an outline is made
const SEEN = 128; // places beyond each side of the box
const EXACTNESS = 0.05; // of a pixel of the mask: how exactly places are followed

/** A mask with its outline: the middles of the faces of its pixels where it ends. */
interface Outlined {
  isTissue: (a: number, b: number) => boolean;
  places: Vector2[];
}

const outlines: WeakMap<MaskData, Outlined> = new WeakMap();

function outlined(mask: MaskData) {
  const found = outlines.get(mask) ?? outlineOf(mask);
  outlines.set(mask, found);
  return found;
}

function outlineOf(mask: MaskData): Outlined {
  const {
      shape: [nv, nu],
      spacing: [du, dv],
      origin: [a0, b0],
    } = mask,
    isSet = maskPixels(mask),
    places: Vector2[] = [],
    ways = [
      [0, -1],
      [0, 1],
      [-1, 0],
      [1, 0],
    ] as const;
  const at = (i: number, j: number) => i >= 0 && j >= 0 && i < nv && j < nu && isSet[i * nu + j] === 1;
  for (let i = 0; i < nv; i++)
    for (let j = 0; j < nu; j++)
      for (const [di, dj] of ways)
        if (at(i, j) && !at(i + di, j + dj)) places.push([a0 + (j + dj / 2) * du, b0 + (i + di / 2) * dv]);
  return { places, isTissue: (a, b) => at(Math.round((b - b0) / dv), Math.round((a - a0) / du)) };
}

/** Places along a side of a box, so far beyond it, and on past its corners. */
function placesBeyond([a0, a1, b0, b1]: Vector4, most: Vector2, side: number): Vector2[] {
  const along = Array.from({ length: SEEN }, (_, k) => (2 * (k + 0.5)) / SEEN - 0.5);
  if (side < 2) {
    const a = side ? a1 + most[0] : a0 - most[0];
    return along.map((share) => [a, b0 + share * (b1 - b0)]);
  }
  const b = side > 2 ? b1 + most[1] : b0 - most[1];
  return along.map((share) => [a0 + share * (a1 - a0), b]);
}

/**
 * The sides of a box (low a, high a, low b, high b) beyond which a map moves tissue by more than a pixel and one
 * hundredth of the box, as deformnb.analysis.extent finds it in space.
 * @param box a0, a1, b0, b1
 * @param pixel its size along a and b
 * @param targets of the points, where tissue may be seen that is far from the rest
 */
export function exceededSides(
  layered: LayeredFit | null,
  tissue: MaskData,
  box: Vector4,
  { pixel, targets }: { pixel: Vector2; targets: Vector2[] },
) {
  if (!layered?.fits.length) return [];
  const [a0, a1, b0, b1] = box,
    most: Vector2 = [pixel[0] + LEAVES * (a1 - a0), pixel[1] + LEAVES * (b1 - b0)],
    { isTissue, places } = outlined(tissue),
    over = [false, false, false, false];
  const mark = ([a, b]: Vector2) => {
    over[0] ||= a0 - a > most[0];
    over[1] ||= a - a1 > most[0];
    over[2] ||= b0 - b > most[1];
    over[3] ||= b - b1 > most[1];
  };
  for (const place of places) {
    const found = findVisiblePlace(layered, place, EXACTNESS * Math.min(...tissue.spacing));
    if (found) mark(found);
  }
  const isSeen = ([a, b]: Vector2) => {
    const [da, db, opacity] = placeOf(layered, a, b, pixel[0]);
    return opacity > 0.5 && isTissue(a + da, b + db);
  };
  for (const place of targets) if (isSeen(place)) mark(place);
  return over.flatMap((isOver, side) => (isOver || placesBeyond(box, most, side).some(isSeen) ? [side] : []));
}

/** A warning of tissue that is cut off at sides of the box, by their names; empty for none. */
export function cutOffText(names: string[]) {
  const listed = names.length > 1 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names[0];
  return listed ? CUT_OFF.replace("{sides}", listed) : "";
}

/** The mask of what is set in most pixels of each square, of at most so many squares along a side. */
export async function coarseMask(isSet: Uint8Array, { shape: [nv, nu], spacing, origin }: Raster): Promise<MaskData> {
  const factor = Math.max(1, Math.ceil(Math.max(nv, nu) / CELLS)),
    rows = Math.max(1, Math.floor(nv / factor)),
    columns = Math.max(1, Math.floor(nu / factor)),
    middle = (factor - 1) / 2,
    bits = new Uint8Array(Math.ceil((rows * columns) / 8));
  for (let i = 0; i < rows; i++)
    for (let j = 0; j < columns; j++) {
      let count = 0;
      for (let y = i * factor; y < (i + 1) * factor; y++)
        for (let x = j * factor; x < (j + 1) * factor; x++) count += isSet[y * nu + x]!;
      const n = i * columns + j;
      if (2 * count >= factor * factor) bits[n >> 3]! |= 128 >> (n & 7);
    }
  const stream = new Blob([bits]).stream().pipeThrough(new CompressionStream("deflate"));
  const packed = new Uint8Array(await new Response(stream).arrayBuffer());
  return {
    kind: "mask",
    shape: [rows, columns],
    spacing: [factor * spacing[0], factor * spacing[1]],
    origin: [origin[0] + middle * spacing[0], origin[1] + middle * spacing[1]],
    bits: btoa(String.fromCharCode(...packed)),
  };
}
