// The deformed grid over the editor's picture.

import { isStill } from "../maths/rigid_stages.ts";
import { clampedFits } from "../maths/sampled_fit.ts";
import { deformedGrid, NO_CUTS } from "../maths/warp_map.ts";
import type { LayeredFit } from "../types.ts";
import { drawGrid } from "./painter.ts";
import type { EditorParts } from "./parts.ts";

export type GridLines = ReturnType<typeof deformedGrid>;

/** Dependencies of the grid on the editor. */
export type GridEditor = EditorParts<"model" | "frames" | "points" | "stage" | "theme" | "picture" | "viewport">;

const FAINT = 0.3;

export class GridLayer {
  /** The grid drawn last, and its inputs; null where it has to be computed again. */
  last: { key: unknown[]; lines: GridLines } | null = null;

  constructor(readonly editor: GridEditor) {}

  /** Whether the user has asked for the grid before the first edit. */
  isWanted = false;

  /** Whether there is a grid to show. */
  get isOn() {
    const { model } = this.editor;
    return Boolean(model.get("show_grid") && model.get("density") > 0 && this.opacity > 0);
  }

  /** Whether the grid waits for the first edit: until then the picture is shown without it. */
  get isWaiting() {
    const { model, points } = this.editor;
    if (!model.get("grid_waits") || this.isWanted || model.get("drag_grid") || model.get("history")?.undo) return false;
    return points.list.every(({ source, target }) => source[0] === target[0] && source[1] === target[1]);
  }

  /** Of its lines: faint under the pointer while it waits. */
  get opacity() {
    if (!this.isWaiting) return 1;
    return this.editor.stage.element.matches(":hover, :focus-visible") ? FAINT : 0;
  }

  /** Draw the grid: straight left of a share of the width, deformed right of it. */
  draw(layered: LayeredFit | null, share: number) {
    const {
      model,
      picture: { box, painter },
      theme: { colours },
      viewport: { view },
    } = this.editor;
    const { context: c } = painter,
      { width, height } = painter.canvas,
      cut = share * width;
    if (cut <= 0) {
      drawGrid(c, view, this.#linesOf(layered), colours.grid);
      return;
    }
    const straight = deformedGrid(NO_CUTS, box, model.get("density"), 1, 1);
    for (const { lines, x, wide } of [
      { lines: straight, x: 0, wide: cut },
      { lines: this.#linesOf(layered), x: cut, wide: width - cut },
    ]) {
      c.save();
      c.beginPath();
      c.rect(x, 0, wide, height);
      c.clip();
      drawGrid(c, view, lines, colours.grid);
      c.restore();
    }
  }

  #linesOf(layered: LayeredFit | null) {
    const {
      model,
      frames: { isMoving },
      picture: { box },
      viewport: { view },
    } = this.editor;
    const cells = model.get("density"),
      count = layered?.count ?? 0;
    const affordable = Math.floor((isMoving ? 8e4 : 32e4) / (cells * cells * Math.max(1, count)));
    const isBent = (layered?.fits ?? []).some(({ fit }) => !isStill(fit)) || (layered?.regions.length ?? 0) > 0;
    const parts = isBent ? Math.min(isMoving ? 3 : 8, Math.max(isMoving ? 1 : 2, affordable)) : 1;
    const key = [layered, cells, parts, String(box)],
      { last } = this;
    const isSame = last !== null && key.every((value, k) => value === last.key[k]);
    const lines = isSame
      ? last.lines
      : deformedGrid(layered ? clampedFits(layered) : NO_CUTS, box, cells, parts, (isMoving ? 0.2 : 0.05) / view.k);
    this.last = { key, lines };
    return lines;
  }
}
