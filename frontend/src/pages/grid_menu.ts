// D'Arcy Thompson's grids, and grids of one's own, as control points of the picture that a page shows.

import type { Nodes } from "../maths/thompson.ts";
import { boxOfNodes, pairPoints, placePair } from "../maths/thompson.ts";
import type { PictureRaster, Vector2, Vector4 } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement } from "../ui/dom.ts";
import type { Examples } from "./examples.ts";
import { GridPairInput } from "./grid_pair_input.ts";
import { regularNodes } from "./own_drawing.ts";
import type { StandalonePage } from "./standalone_page.ts";
import { runGuarded } from "./standalone_page.ts";

const OWN = "own";
const TITLES = ["Grid on this picture", "Grid on a second drawing"] as const;

/** What grids are laid on. */
export interface GridPicture {
  name: string;
  /** The picture as it is seen, an address "data:" */
  image: string;
  raster: PictureRaster;
  /** The box of the subject, in the picture's coordinates: a0, a1, b0, b1 */
  subject: () => Vector4;
}

export class GridMenu {
  readonly element: HTMLElement;
  readonly #menu: HTMLSelectElement;
  readonly #right: HTMLInputElement;
  #own: { input: GridPairInput; box: HTMLElement } | null = null;

  constructor(
    parent: Element,
    readonly page: StandalonePage,
    readonly examples: Examples,
    readonly picture: GridPicture,
  ) {
    this.element = pageElement("div", "dnb-page-grids", parent);
    const field = pageElement("label", "dnb-page-field", this.element, {
      title: "Points at the nodes of a grid, in place of those that are there; can be undone",
    });
    pageElement("span", "dnb-page-label", field, {}, "Grids of");
    this.#menu = pageElement("select", "dnb-page-select", field, { name: "grids", ...OWN_KEYS });
    pageElement("option", "", this.#menu, { value: "" }, "choose\u2026");
    for (const [k, pair] of examples.pairs.entries()) {
      const [source, target] = pair.map((number) => examples.figures[number]!.species);
      pageElement("option", "", this.#menu, { value: k, translate: "no" }, `${source} \u2192 ${target}`);
    }
    pageElement("option", "", this.#menu, { value: OWN }, "Own drawings");
    const head = pageElement("label", "dnb-page-field", this.element, {
      title: "Where the head is on this picture: in Thompson's drawings it is on the left",
    });
    this.#right = pageElement("input", "dnb-page-check", head, { type: "checkbox", name: "head", ...OWN_KEYS });
    pageElement("span", "dnb-page-label", head, {}, "head on the right");
    this.#menu.addEventListener("change", () => runGuarded(() => this.#choose()));
    this.#right.addEventListener("change", () => runGuarded(() => this.#choose()));
  }

  /** The edges of the picture. */
  get #frame(): Vector4 {
    const {
      shape: [rows, columns],
      spacing: [du, dv],
      origin: [a, b],
    } = this.picture.raster;
    return [a - du / 2, a + (columns - 0.5) * du, b - dv / 2, b + (rows - 0.5) * dv];
  }

  async #choose() {
    const { value } = this.#menu;
    if (value === OWN) {
      await this.#openOwn();
      return;
    }
    this.#closeOwn();
    const pair = this.examples.pairs[Number(value)];
    if (value === "" || !pair) return;
    const [source, target] = pair.map((number) => this.examples.figures[number]!.nodes);
    this.#apply(source!, target!, this.picture.subject(), this.#right.checked ? "right" : "left");
  }

  #apply(source: Nodes, target: Nodes, box: Vector4, head: "left" | "right" = "left") {
    const points = pairPoints(placePair(source, target, { box, frame: this.#frame, head }));
    const first = this.page.editor.get("next_id");
    this.page.editor.update({
      points: points.map((p) => ({ ...p, id: first + p.id })),
      next_id: first + points.length,
      selected: [],
    });
  }

  /** The place of the picture at a pixel of it. */
  #placeAt([x, y]: Vector2): Vector2 {
    const {
      spacing: [du, dv],
      origin: [a, b],
    } = this.picture.raster;
    return [a + x * du, b + y * dv];
  }

  async #openOwn() {
    if (this.#own) return;
    const { name, image, raster, subject } = this.picture,
      box = pageElement("div", "dnb-page-own-grids", this.element);
    const pixel = (value: number, k: number) =>
      Math.min(
        raster.shape[k < 2 ? 1 : 0] - 1,
        Math.max(0, (value - raster.origin[k < 2 ? 0 : 1]) / raster.spacing[k < 2 ? 0 : 1]),
      );
    const first = {
      name,
      image,
      nodes: regularNodes(subject().map(pixel) as Vector4),
      placed: [],
      part: null,
      factor: 1,
    };
    const apply = buttonElement("dnb-page-button", null, "Apply own grids", () =>
      runGuarded(() => {
        const [source, target] = input.drawings.map((drawing) => drawing?.nodes);
        if (!source || !target) return;
        if (input.fold) throw new Error(input.fold);
        const placed = source.map((row) => row.map((place) => this.#placeAt(place)));
        this.#apply(placed, target, boxOfNodes(placed));
      }),
    );
    const update = () => {
      apply.disabled = !input.drawings.every(Boolean);
    };
    const input: GridPairInput = new GridPairInput(
      box,
      this.page.widgets,
      [first, null],
      [{ title: TITLES[0] }, { title: TITLES[1], isFile: true }],
      update,
    );
    input.foot.append(apply);
    this.#own = { input, box };
    update();
    await input.show();
  }

  #closeOwn() {
    this.#own?.input.hide();
    this.#own?.box.remove();
    this.#own = null;
  }
}
