// Two pictures of the user's with a grid on each, and the first deformed by them beside the second.

import type { Values, Vector2 } from "../types.ts";
import { buttonElement, pageElement, saveFile, setText } from "../ui/dom.ts";
import type { StepTools } from "./drawing_step.ts";
import { DrawingStep } from "./drawing_step.ts";
import type { Examples } from "./examples.ts";
import { exampleDrawing } from "./examples.ts";
import { GridPairInput } from "./grid_pair_input.ts";
import { LaidPair } from "./laid_pair.ts";
import type { OwnDrawing } from "./own_drawing.ts";
import type { ShareSlider } from "./share_slider.ts";
import { runGuarded } from "./standalone_page.ts";

const TITLES = ["1. The first animal, leaf or face", "2. The second one"] as const;
const NEEDED = "Choose two pictures: a grid is laid on each.";
const LAID = "Drag the corners and then the nodes of each grid to the same parts of both pictures, and show the map.";

export class OwnStep {
  readonly result: DrawingStep;
  readonly #input: GridPairInput;
  readonly #show: HTMLButtonElement;
  readonly #areas: HTMLButtonElement;
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
    drawings: (OwnDrawing | null)[],
    readonly changed: () => void,
    readonly slider: ShareSlider,
  ) {
    const [first, second] = examples.pairs[0]!.map((number) => examples.figures[number]!),
      sources = (title: string, figure: typeof first) => ({
        title,
        isFile: true,
        example: { words: `Use ${figure!.species}`, make: () => exampleDrawing(examples, figure!) },
      });
    this.#input = new GridPairInput(
      place,
      tools.widgets,
      drawings,
      [sources(TITLES[0], first), sources(TITLES[1], second)],
      (isOther) => this.#take(isOther),
    );
    this.#show = buttonElement("dnb-page-button dnb-th-next", this.#input.foot, "Show the map", () =>
      runGuarded(() => this.#showMap()),
    );
    const result = pageElement("div", "dnb-th-pictures dnb-th-result-place", place);
    result.append(slider.element);
    slider.element.hidden = true; // until there is a map
    this.result = new DrawingStep(result, tools);
    this.result.goal.element.hidden = true;
    this.#buttons = pageElement("div", "dnb-th-buttons", place, { hidden: "" });
    const button = (words: string, act: () => unknown) =>
      buttonElement("dnb-page-button", this.#buttons, words, () => runGuarded(act));
    this.#areas = button("Show areas", () => this.#toggleAreas());
    button("Download picture", () => this.result.page?.savePicture());
    button("Download session", () => this.#saveSession());
    this.#update();
  }

  async show() {
    await this.#input.show();
    this.#update();
  }

  async #take(isOther: boolean) {
    this.changed();
    if (isOther || this.#input.fold) this.#forgetMap();
    else if (this.#pair) await this.#showMap();
    this.#update();
  }

  #update() {
    const { drawings, fold } = this.#input;
    this.#show.disabled = !drawings.every(Boolean) || Boolean(fold);
    if (!this.#pair) this.tools.report({ words: fold || (drawings.every(Boolean) ? LAID : NEEDED), percent: null });
  }

  #forgetMap() {
    this.result.hide();
    this.result.goal.element.hidden = this.#buttons.hidden = this.slider.element.hidden = true;
    this.#pair = null;
  }

  async #showMap() {
    const drawings = this.#input.pair;
    if (!drawings) return;
    const isFirst = !this.#pair,
      isGrowth = this.result.mode === "growth";
    this.#pair = new LaidPair(...drawings);
    this.result.goal.element.hidden = this.#buttons.hidden = false;
    this.slider.element.hidden = isGrowth;
    this.slider.name(drawings[0].name, drawings[1].name);
    this.slider.set(1);
    await this.result.show(this.#pair, isGrowth ? "growth" : "morph", 1, null);
    if (isFirst) this.result.place.scrollIntoView({ behavior: "smooth", block: "nearest" });
  }

  async #toggleAreas() {
    if (!this.#pair) return;
    const isGrowth = this.result.mode !== "growth";
    setText(this.#areas, isGrowth ? "Hide areas" : "Show areas");
    this.slider.element.hidden = isGrowth;
    this.slider.set(1);
    await this.result.show(this.#pair, isGrowth ? "growth" : "morph", 1, null);
  }

  /** The document of the map for the file of the first picture, whose pixels it counts. */
  #saveSession() {
    const { page } = this.result,
      [first] = this.#input.drawings,
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
    this.#input.hide();
    this.place.replaceChildren();
  }
}
