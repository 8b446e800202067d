// Two pictures with a grid on each, of the same numbers of lines, which are laid by hand.

import { foldedCell, resampleNodes } from "../maths/thompson.ts";
import type { Values, Vector2 } from "../types.ts";
import { OWN_KEYS, pageElement } from "../ui/dom.ts";
import type { Drawing } from "./laid_pair.ts";
import type { OwnDrawing, PictureSources } from "./own_drawing.ts";
import { OwnDrawingView } from "./own_drawing.ts";
import { runGuarded } from "./standalone_page.ts";

const LINES: Vector2[] = [
  [3, 4],
  [4, 6],
  [5, 7],
  [7, 8],
]; // rows and columns of grids

const linesOf = ({ nodes }: OwnDrawing): Vector2 => [nodes.length, nodes[0]!.length];

export class GridPairInput {
  /** Below the pictures: room for a button beside the lines. */
  readonly foot: HTMLElement;
  readonly #views: OwnDrawingView[];
  readonly #field: HTMLElement;
  readonly #lines: HTMLSelectElement;

  /**
   * @param drawings the pictures with their grids, which are changed in place; null where there is none yet
   * @param sources of each picture
   * @param changed called after each edit; `isOther` after another picture or other numbers of lines
   */
  constructor(
    parent: Element,
    widgets: Values,
    readonly drawings: (OwnDrawing | null)[],
    sources: [PictureSources, PictureSources],
    readonly changed: (isOther: boolean) => unknown,
  ) {
    const pictures = pageElement("div", "dnb-grid-pair", parent);
    this.#views = sources.map(
      (source, k) =>
        new OwnDrawingView(pictures, widgets, source, (drawing) => runGuarded(() => this.#take(k, drawing))),
    );
    this.foot = pageElement("div", "dnb-grid-pair-foot", parent);
    this.#field = pageElement("label", "dnb-page-field", this.foot, { title: "rows and columns of both grids" });
    pageElement("span", "dnb-page-label", this.#field, {}, "Grid lines");
    this.#lines = pageElement("select", "dnb-page-select", this.#field, { name: "lines", ...OWN_KEYS });
    pageElement("option", "", this.#lines, { value: "", hidden: "" }, "");
    for (const [k, [rows, columns]] of LINES.entries())
      pageElement("option", "", this.#lines, { value: k }, `${rows} \u00d7 ${columns}`);
    this.#lines.addEventListener("change", () => runGuarded(() => this.#chooseLines()));
    this.#showLines();
  }

  /** A sentence about a grid that folds, for which there is no map; "" where none does. */
  get fold() {
    for (const drawing of this.drawings) {
      const cell = drawing && foldedCell(drawing.nodes);
      if (cell)
        return `The grid on ${drawing.name} folds below and right of node r${cell[0]} c${cell[1]}: drag its nodes apart.`;
    }
    return "";
  }

  /** The drawings, once there are two. */
  get pair(): [Drawing, Drawing] | null {
    const [first, second] = this.drawings.map((one, k) => one && this.#views[k]!.drawing(one));
    return first && second ? [first, second] : null;
  }

  /** Show the pictures that there are. */
  async show() {
    await Promise.all(this.drawings.map((drawing, k) => drawing && this.#views[k]!.show(drawing)));
    this.#showLines();
  }

  async #take(k: number, drawing: OwnDrawing) {
    const isOther = this.drawings[k]?.image !== drawing.image;
    this.drawings[k] = drawing;
    if (isOther) await this.#matchLines(k);
    this.#showLines();
    await this.changed(isOther);
  }

  /** Give both grids the lines of one: of the one that was laid by hand, or else of the picture that has just come. */
  async #matchLines(k: number) {
    const [own, other] = [this.drawings[k], this.drawings[1 - k]];
    if (!own || !other || String(linesOf(own)) === String(linesOf(other))) return;
    await (other.placed.length ? this.#setLines(k, linesOf(other)) : this.#setLines(1 - k, linesOf(own)));
  }

  async #setLines(k: number, [rows, columns]: Vector2) {
    const drawing = this.drawings[k];
    if (!drawing) return;
    const made = { ...drawing, nodes: resampleNodes(drawing.nodes, rows, columns), placed: [] };
    this.drawings[k] = made;
    await this.#views[k]!.show(made);
  }

  /** Give both grids other numbers of lines, on the same surfaces. */
  async #chooseLines() {
    const lines = LINES[Number(this.#lines.value)];
    if (!lines) return;
    for (const k of [0, 1]) await this.#setLines(k, lines);
    await this.changed(true);
  }

  #showLines() {
    const shown = this.drawings.find(Boolean),
      index = shown ? LINES.findIndex((lines) => String(lines) === String(linesOf(shown))) : -1;
    this.#lines.value = index < 0 ? "" : String(index);
    this.#field.hidden = !shown;
  }

  hide() {
    for (const view of this.#views) view.hide();
  }
}
