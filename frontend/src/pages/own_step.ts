// Two pictures of the user's with a grid on each, and the first deformed by them beside the second.

import { resampleNodes } from "../maths/thompson.ts";
import type { Values, Vector2 } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, saveFile } from "../ui/dom.ts";
import type { StepTools } from "./drawing_step.ts";
import { DrawingStep } from "./drawing_step.ts";
import type { Examples } from "./examples.ts";
import { drawingOf } from "./examples.ts";
import { LaidPair } from "./laid_pair.ts";
import { OwnDrawingView } from "./own_drawing.ts";
import type { ShareSlider } from "./share_slider.ts";
import { runGuarded } from "./standalone_page.ts";
import type { OwnDrawing } from "./thompson_state.ts";

const TITLES = ["1. The first animal, leaf or face", "2. The second one"];
const NEEDED = "Choose two pictures, and drag the corners and then the nodes of each grid to the same parts of both.";

const LINES: Vector2[] = [
  [3, 4],
  [4, 6],
  [5, 7],
  [7, 8],
]; // rows and columns of grids

const linesOf = ({ nodes }: OwnDrawing): Vector2 => [nodes.length, nodes[0]!.length];

/** A figure of the book as a user's drawing. */
async function exampleOf(examples: Examples, figure: string): Promise<OwnDrawing> {
  const { image, part, nodes, name } = await drawingOf(examples, examples.figures[figure]!),
    { width, height } = image as ImageBitmap,
    canvas = Object.assign(document.createElement("canvas"), { width, height });
  canvas.getContext("2d")!.drawImage(image, 0, 0);
  return { name, image: canvas.toDataURL("image/png"), nodes, placed: [], part, factor: 1 };
}

export class OwnStep {
  readonly result: DrawingStep;
  readonly #views: OwnDrawingView[];
  readonly #show: HTMLButtonElement;
  readonly #lines: HTMLSelectElement;
  readonly #buttons: HTMLElement;
  #pair: LaidPair | null = null;

  /**
   * @param drawings of the user's, which are changed in place
   * @param changed called after each edit
   */
  constructor(
    readonly place: Element,
    readonly tools: StepTools,
    examples: Examples,
    readonly drawings: (OwnDrawing | null)[],
    readonly changed: () => void,
    readonly slider: ShareSlider,
  ) {
    const pictures = pageElement("div", "dnb-th-pictures", place),
      [first, second] = examples.pairs[0]!;
    this.#views = [first, second].map(
      (number, k) =>
        new OwnDrawingView(
          pictures,
          tools.widgets,
          TITLES[k]!,
          {
            words: `Use ${examples.figures[number]!.species}`,
            make: () => exampleOf(examples, String(number)),
          },
          (drawing) => runGuarded(() => this.#take(k, drawing)),
        ),
    );
    const bar = pageElement("div", "dnb-th-own-foot", place),
      field = pageElement("label", "dnb-page-field", bar, { title: "rows and columns of both grids" });
    pageElement("span", "dnb-page-label", field, {}, "Grid lines");
    this.#lines = pageElement("select", "dnb-page-select", field, { name: "lines", ...OWN_KEYS });
    pageElement("option", "", this.#lines, { value: "", hidden: "" }, "");
    for (const [k, [rows, columns]] of LINES.entries())
      pageElement("option", "", this.#lines, { value: k }, `${rows} \u00d7 ${columns}`);
    this.#lines.addEventListener("change", () => runGuarded(() => this.#chooseLines()));
    this.#show = buttonElement("dnb-page-button dnb-th-next", bar, "Show the map", () =>
      runGuarded(() => this.#showMap(1)),
    );
    const result = pageElement("div", "dnb-th-pictures dnb-th-result-place", place);
    result.append(slider.element);
    this.result = new DrawingStep(result, tools);
    this.result.goal.element.hidden = true;
    this.#buttons = pageElement("div", "dnb-th-buttons", place, { hidden: "" });
    buttonElement("dnb-page-button", this.#buttons, "Show areas", () => runGuarded(() => this.#toggleAreas()));
    buttonElement("dnb-page-button", this.#buttons, "Download picture", () =>
      runGuarded(() => this.result.page?.savePicture()),
    );
    buttonElement("dnb-page-button", this.#buttons, "Download session", () => this.#saveSession());
    this.#update();
  }

  async show() {
    await Promise.all(this.drawings.map((drawing, k) => drawing && this.#views[k]!.show(drawing)));
    this.#update();
  }

  async #take(k: number, drawing: OwnDrawing) {
    const isOther = this.drawings[k]?.image !== drawing.image;
    this.drawings[k] = drawing;
    if (isOther) await this.#matchLines(k);
    this.changed();
    this.#update();
    if (isOther) this.#forgetMap();
    else if (this.#pair) await this.#showMap(1);
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
    this.changed();
    this.#forgetMap();
    this.#update();
  }

  #update() {
    const isReady = this.drawings.every(Boolean),
      shown = this.drawings.find(Boolean);
    const index = shown ? LINES.findIndex((lines) => String(lines) === String(linesOf(shown))) : -1;
    this.#lines.value = index < 0 ? "" : String(index);
    this.#lines.disabled = !shown;
    this.#show.disabled = !isReady;
    if (!this.#pair) this.tools.report({ words: NEEDED, percent: null });
  }

  #forgetMap() {
    this.result.hide();
    this.result.goal.element.hidden = this.#buttons.hidden = this.slider.element.hidden = true;
    this.#pair = null;
  }

  async #showMap(share: number) {
    const [first, second] = this.drawings.map((one, k) => one && this.#views[k]!.drawing(one));
    if (!first || !second) return;
    const isFirst = !this.#pair,
      mode = this.result.mode === "growth" ? "growth" : "morph";
    this.#pair = new LaidPair(first, second);
    this.result.goal.element.hidden = this.#buttons.hidden = this.slider.element.hidden = false;
    this.slider.name(first.name, second.name);
    this.slider.set(share);
    await this.result.show(this.#pair, mode, share, null);
    if (isFirst) this.result.place.scrollIntoView({ behavior: "smooth", block: "nearest" });
  }

  #toggleAreas() {
    if (!this.#pair) return null;
    return this.result.show(this.#pair, this.result.mode === "growth" ? "morph" : "growth", 1, null);
  }

  /** The document of the map for the file of the first picture, whose pixels it counts. */
  #saveSession() {
    const { page } = this.result,
      [first] = this.drawings,
      pair = this.#pair;
    if (!page || !first || !pair) return;
    const document = page.document() as Values,
      [step] = document.steps,
      inFile = (place: Vector2) =>
        place.map((x, k) => (x - pair.origin[k as 0 | 1] + 0.5) * first.factor - 0.5) as Vector2;
    for (const point of step.maps[0].points) {
      point.source = inFile(point.source);
      point.target = inFile(point.target);
    }
    const text = `${JSON.stringify({ ...document, volume: null }, null, 1)}\n`;
    saveFile(new Blob([text], { type: "application/json" }), `${page.fileName}.json`);
  }

  hide() {
    this.#forgetMap();
    for (const view of this.#views) view.hide();
    this.place.replaceChildren();
  }
}
