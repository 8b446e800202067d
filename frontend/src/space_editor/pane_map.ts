// The map over one of the three slices: the grid that bends with the tissue, and folds. Where the map is of more than
// points, folds are those that Python has found.

import { drawFolds, type FoldPieces, hatchPattern } from "../editor/fold_drawing.ts";
import { context2d, drawGrid, type View } from "../editor/painter.ts";
import { isStill } from "../maths/rigid_stages.ts";
import type { SampledDets } from "../maths/sampled_dets.ts";
import { SliceMap } from "../maths/space_slice.ts";
import type { PaneInfo, Raster, Vector4 } from "../types.ts";
import { pageElement } from "../ui/dom.ts";
import type { SpaceParts } from "./parts.ts";

const LEAST_CELL = 10; // CSS pixels of the grid: a small slice has fewer lines
const CELL = { moving: 14, resting: 7 }, // CSS pixels; where a fold begins, a quarter of it
  WORK = { moving: 4e4, resting: 3.5e5 }; // evaluations of a kernel for one slice

/** Dependencies of the map of a slice on the editor. */
export type PaneMapEditor = SpaceParts<"model" | "frames" | "theme" | "map" | "cursor">;

export class PaneMap {
  canvas: HTMLCanvasElement;
  /** Whether folds are drawn, of tissue or of air alone. */
  folds: "none" | "air" | "tissue" = "none";
  #context: CanvasRenderingContext2D;
  #hatch: string | CanvasPattern;
  /** det J on the slice, of a map that is known to Python alone; null where nothing folds. */
  sampled: SampledDets | null = null;
  #drawn: unknown[] = []; // all that the canvas depends on
  #isUsed = false; // whether there is anything on it

  constructor(
    readonly editor: PaneMapEditor,
    stage: HTMLElement,
  ) {
    this.canvas = pageElement("canvas", "dnb-ed-overlay", stage, { "aria-hidden": "true" });
    this.#context = context2d(this.canvas);
    this.#hatch = hatchPattern(this.#context);
  }

  resize(width: number, height: number) {
    Object.assign(this.canvas, { width, height });
    this.#drawn = []; // which clears it
    this.#isUsed = false;
  }

  draw(view: View, pane: PaneInfo) {
    const {
        cursor,
        frames: { isMoving },
        map,
        model,
        theme,
      } = this.editor,
      fits = cursor.isSlice ? map.currentFits : null,
      depth = cursor.depthIn(pane),
      cells: number = model.get("show_grid") ? model.get("density") : 0,
      marksFolds = model.get("overlay") !== "none",
      sampled = marksFolds && cursor.isSlice && !map.isKnown && !model.get("shows_original") ? this.sampled : null,
      key = [
        fits,
        sampled,
        fits && depth,
        fits && isMoving,
        pane,
        cells,
        marksFolds,
        theme.colours.grid,
        ...Object.values(view),
      ];
    if (key.every((value, k) => value === this.#drawn[k])) return;
    this.#drawn = key;
    this.#clear();
    this.folds = "none";
    if (sampled) this.#drawPieces(sampled.folds, view, false);
    const part = visiblePart(view, pane);
    if (!fits || fits.every(isStill) || !part || !(cells || marksFolds)) return;
    const slice = new SliceMap(fits, pane, depth),
      pace = isMoving ? "moving" : "resting",
      raster = rasterOf(part, CELL[pace] / view.k, WORK[pace] / Math.max(1, slice.count));
    if (cells) this.#drawGrid(slice, raster, view, cells);
    if (marksFolds) this.#drawFolds(slice, raster, view, WORK[pace]);
  }

  #clear() {
    const { canvas } = this;
    this.#context.setTransform(1, 0, 0, 1, 0, 0);
    if (this.#isUsed) this.#context.clearRect(0, 0, canvas.width, canvas.height);
    this.#isUsed = false;
  }

  #drawGrid(slice: SliceMap, raster: Raster, view: View, cells: number) {
    const [a0, a1, b0, b1, c0, c1] = slice.pane.box,
      longest = Math.max(a1 - a0, b1 - b0, c1 - c0) * view.k,
      fewer = 2 ** Math.max(0, Math.ceil(Math.log2((LEAST_CELL * cells) / longest)));
    drawGrid(this.#context, view, slice.gridLines(raster, cells / fewer), this.editor.theme.colours.grid);
    this.#isUsed = true;
  }

  #drawFolds(slice: SliceMap, raster: Raster, view: View, work: number) {
    const pieces = slice.folds(raster, work);
    if (!pieces) return;
    this.#drawPieces(pieces, view, !slice.hasTissue(pieces.fill, this.editor.map.isTissue));
  }

  #drawPieces(pieces: FoldPieces, view: View, isInAir: boolean) {
    if (!pieces.fill.length) return;
    this.folds = isInAir ? "air" : "tissue";
    drawFolds(this.#context, view, pieces, isInAir, this.#hatch);
    this.#isUsed = true;
  }
}

/** The part of a picture that is seen, [a0, a1, b0, b1], or null. */
function visiblePart({ k, x, y, width, height }: View, { box: [a0, a1, b0, b1] }: PaneInfo): Vector4 | null {
  const [left, right] = [Math.max(a0, -x / k), Math.min(a1, (width - x) / k)],
    [top, bottom] = [Math.max(b0, -y / k), Math.min(b1, (height - y) / k)];
  return right > left && bottom > top ? [left, right, top, bottom] : null;
}

/** A lattice of a part, and one cell beyond it, with cells of a size or as many as a number of nodes allows. */
function rasterOf([a0, a1, b0, b1]: Vector4, size: number, most: number): Raster {
  const cell = Math.max(size, Math.sqrt(((a1 - a0) * (b1 - b0)) / Math.max(4, most))),
    columns = Math.max(2, Math.ceil((a1 - a0) / cell) + 1),
    rows = Math.max(2, Math.ceil((b1 - b0) / cell) + 1),
    [da, db] = [(a1 - a0) / (columns - 1), (b1 - b0) / (rows - 1)];
  return { shape: [rows + 2, columns + 2], origin: [a0 - da, b0 - db], spacing: [da, db] };
}
