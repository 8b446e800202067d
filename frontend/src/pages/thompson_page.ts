// "How one fish becomes another": the page about D'Arcy Thompson's grids, in five steps. His drawing is deformed by a
// slider; nodes are dragged by hand; a carp is bent in three dimensions; areas are compared; and the user's own pictures.

import type { Vector2 } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, saveFile, setText } from "../ui/dom.ts";
import { localize } from "../ui/words.ts";
import { CarpStep } from "./carp_step.ts";
import type { DrawingMode, Report, StepTools } from "./drawing_step.ts";
import { DrawingStep } from "./drawing_step.ts";
import type { Examples, Figure } from "./examples.ts";
import { drawingOf } from "./examples.ts";
import { LaidPair } from "./laid_pair.ts";
import type { Template } from "./opened_file.ts";
import { OwnStep } from "./own_step.ts";
import { pageWithState } from "./page_copy.ts";
import { ShareSlider } from "./share_slider.ts";
import { messageOf, showAlert } from "./standalone_page.ts";
import type { StepName, ThompsonState } from "./thompson_state.ts";
import { STEPS, storeState } from "./thompson_state.ts";

export interface ThompsonTemplate extends Template {
  /** The words of each language by the English ones */
  tables: Record<string, Record<string, string>>;
  /** The name of each language in itself, by its code */
  languages: Record<string, string>;
  /** Its title, and what may be relied on, in English */
  title: string;
  facts: string;
  /** The address of the lessons, "" for none */
  lessons: string;
}

const NARROW = 860; // CSS pixels below which pictures are stacked
// CSS pixels of a phone that is held across, where they are not: the least height of a picture, and what is below it.
const FLAT = { width: 600, height: 500, picture: [150, 100] } as const;
const STAGE_SHARE = 0.38; // of a phone's height, for a picture
const BELOW = 250; // CSS pixels that wide pages need under the pictures
const GAP = 16;
const STORED_AFTER = 300; // milliseconds after a movement of the slider

/** Of each step the words of its button, and what there is to do. */
const WORDS: Record<StepName, [string, string]> = {
  morph: [
    "Watch",
    "In 1917 D'Arcy Thompson drew this fish on a grid. Drag the slider: the grid bends, and it is another fish.",
  ],
  drag: ["Try", "Drag each numbered point to the place with its number in the second drawing."],
  carp: ["In 3D", "The same grid bends a carp. Drag the slider, and turn the carp with a finger or the mouse."],
  growth: ["Growth", "Green parts have grown more than the whole animal, purple parts less."],
  own: ["Yours", "Lay a grid on two pictures of your own, and see one become the other."],
};
const SLIDES: StepName[] = ["morph", "carp"];

/** The first word of the name of a species. */
const genus = ({ species }: Figure) => species.split(" ")[0]!;

/** The elements of the page between its title and its foot. */
class Elements {
  readonly bar: HTMLElement;
  readonly pairs: HTMLSelectElement;
  readonly tabs: Record<StepName, HTMLButtonElement>;
  readonly task: HTMLElement;
  readonly stage: HTMLElement;
  readonly own: HTMLElement;
  readonly score: HTMLMeterElement;
  readonly report: HTMLElement;
  readonly buttons: HTMLElement;

  constructor(root: Element, examples: Examples, choose: (step: StepName) => void) {
    this.bar = pageElement("div", "dnb-th-bar", root);
    const pairs = pageElement("label", "dnb-page-field dnb-th-pair", this.bar);
    pageElement("span", "dnb-page-label", pairs, {}, "Animals");
    this.pairs = pageElement("select", "dnb-page-select", pairs, { name: "pair", translate: "no", ...OWN_KEYS });
    for (const [k, numbers] of examples.pairs.entries()) {
      const [source, target] = numbers.map((number) => examples.figures[number]!.species);
      pageElement("option", "", this.pairs, { value: k }, `${source} \u2192 ${target}`);
    }
    const steps = pageElement("nav", "dnb-th-steps", root, { "aria-label": "Steps" });
    const tab = (step: StepName, k: number) =>
      buttonElement("dnb-th-tab", steps, "", () => choose(step), { "data-step": step, "data-number": k + 1 });
    this.tabs = Object.fromEntries(STEPS.map((step, k) => [step, tab(step, k)])) as Elements["tabs"];
    for (const step of STEPS) pageElement("span", "", this.tabs[step], {}, WORDS[step][0]);
    this.task = pageElement("p", "dnb-th-task", root, { "aria-live": "polite" });
    this.stage = pageElement("div", "dnb-th-pictures", root);
    this.own = pageElement("div", "dnb-th-own-step", root);
    this.score = pageElement("meter", "dnb-th-score", root, { min: 0, max: 100, "aria-label": "Score", hidden: "" });
    this.report = pageElement("p", "dnb-th-report", root, { role: "status" });
    this.buttons = pageElement("div", "dnb-th-buttons", root);
  }
}

export class ThompsonPage {
  readonly elements: Elements;
  readonly slider: ShareSlider;
  readonly drawing: DrawingStep;
  readonly carp: CarpStep;
  own: OwnStep | null = null;
  readonly #undo: HTMLButtonElement;
  readonly #ghost: HTMLButtonElement;
  readonly #next: HTMLButtonElement;
  readonly #pairs = new Map<number, Promise<LaidPair>>();
  #storing = 0; // the timer of a movement of the slider

  constructor(
    readonly template: ThompsonTemplate,
    widgets: StepTools["widgets"],
    readonly root: HTMLElement,
    readonly state: ThompsonState,
  ) {
    const { examples } = template;
    this.elements = new Elements(root, examples, (step) => this.choose({ step }));
    const tools: StepTools = { template, widgets, room: () => this.#room(), report: (report) => this.#report(report) };
    this.drawing = new DrawingStep(this.elements.stage, tools);
    this.carp = new CarpStep(this.elements.stage, tools, examples);
    this.slider = new ShareSlider((share) => this.#setShare(share));
    const { buttons } = this.elements,
      button = (words: string, title: string, act: () => void) =>
        buttonElement("dnb-page-button", buttons, words, act, { title });
    this.#undo = button("Undo", "take back the last drag", () => this.drawing.undo());
    this.#ghost = button("Lay the second drawing over it", "to compare both", () => this.#toggleGhost());
    button("Start again", "as the page was at first; your own pictures are kept", () => this.#restart());
    button("Share as a file", "a copy of this page with what you have done in it", () => this.#shareCopy());
    this.#next = buttonElement("dnb-page-button dnb-th-next", buttons, "", () => this.#goOn());
    this.drawing.moved = (targets) => this.#keepDragged(targets);
    this.elements.pairs.addEventListener("change", () =>
      this.choose({ pair: Number(this.elements.pairs.value), share: 0 }),
    );
    window.addEventListener("resize", () => this.#fit());
    document.addEventListener("fullscreenchange", () => this.#placeSlider());
    window.addEventListener("pagehide", () => this.#store());
    this.#footer(root);
  }

  #footer(root: Element) {
    const { examples, lessons } = this.template;
    const foot = pageElement("p", "dnb-th-origin", root);
    pageElement("span", "", foot, { translate: "no" }, `${examples.origin}. `);
    if (lessons) pageElement("a", "", foot, { href: lessons, target: "_top" }, "The lesson about these drawings");
  }

  /** The room of a picture. */
  #room() {
    const width = this.elements.stage.clientWidth || this.elements.own.clientWidth,
      above = this.elements.stage.getBoundingClientRect().top + window.scrollY;
    const isFlat = width >= FLAT.width && window.innerHeight < FLAT.height;
    if (width < NARROW && !isFlat) return { width, height: STAGE_SHARE * window.innerHeight };
    const isOwn = this.state.step === "own", // where the map is farther down
      [least, below] = isFlat ? FLAT.picture : [260, BELOW];
    const height = isOwn ? 0.6 * window.innerHeight : Math.max(least, window.innerHeight - above - below);
    return { width: (width - GAP) / 2, height };
  }

  /** Put the slider between the pictures, or below the carp in full screen. */
  #placeSlider() {
    const pane = document.fullscreenElement,
      { element } = this.slider;
    if (pane && this.elements.stage.contains(pane)) pane.append(element);
    else this.drawing.goal.element.before(element);
  }

  #fit() {
    this.root.style.setProperty("--dnb-th-room", `${this.#room().height}px`);
    for (const page of [this.drawing.page, this.carp.page, this.own?.result.page]) page?.fit();
  }

  #pairOf(number: number) {
    const { examples } = this.template,
      figures = examples.pairs[number]!.map((name) => examples.figures[name]!);
    const made =
      this.#pairs.get(number) ??
      Promise.all(figures.map((figure) => drawingOf(examples, figure))).then(
        ([first, second]) => new LaidPair(first!, second!),
      );
    this.#pairs.set(number, made);
    return made;
  }

  /** Go to another step, or to another pair. */
  choose(change: Partial<Pick<ThompsonState, "step" | "pair" | "share">>) {
    this.slider.stop();
    Object.assign(this.state, change);
    this.#store();
    return this.show();
  }

  #store() {
    return storeState(this.state);
  }

  /** Show the step of the state. */
  async show() {
    showAlert("");
    const { elements, state } = this,
      { step } = state;
    elements.pairs.value = String(state.pair);
    for (const one of STEPS) elements.tabs[one].setAttribute("aria-current", one === step ? "step" : "false");
    setText(elements.task, WORDS[step][1]);
    document.body.dataset.shown = ""; // until all of the step is there
    elements.stage.hidden = step === "own";
    elements.own.hidden = step !== "own";
    elements.bar.hidden = step === "own";
    this.#undo.hidden = step !== "drag";
    this.#ghost.hidden = step !== "drag" && step !== "morph";
    this.#next.hidden = step === "own";
    setText(this.#next, `Next: ${WORDS[STEPS[STEPS.indexOf(step) + 1] ?? "own"][0]}`);
    this.#report({ words: "", percent: null });
    try {
      this.#fit();
      await this.#showStep(step);
      this.#fit(); // the words above are as long as they are in its language
      document.body.dataset.shown = state.step;
    } catch (error) {
      console.error(error);
      showAlert(`This page met an error: ${messageOf(error)}`);
    }
  }

  async #showStep(step: StepName) {
    const { carp, drawing, elements, slider, state } = this,
      { examples } = this.template,
      numbers = examples.pairs[state.pair]!;
    const [source, target] = numbers.map((number) => examples.figures[number]!) as [Figure, Figure];
    if (step !== "carp") carp.hide();
    if (step === "carp" || step === "own") drawing.hide();
    if (step !== "own") {
      this.own?.hide();
      this.own = null;
    }
    drawing.goal.element.hidden = step === "own";
    slider.name(genus(source), genus(target));
    if (step === "own") {
      this.own = new OwnStep(elements.own, drawing.tools, examples, state.own, () => this.#storeOwn(), slider);
      await this.own.show();
      return;
    }
    slider.element.hidden = !SLIDES.includes(step);
    drawing.goal.element.before(slider.element);
    slider.set(state.share);
    const pair = await this.#pairOf(state.pair);
    if (state.step !== step) return;
    if (step === "carp") {
      await Promise.all([carp.show(source, target, state.share), drawing.showGoal(pair)]);
    } else {
      await drawing.show(pair, step as DrawingMode, state.share, state.dragged[state.pair] ?? null);
      if (step !== "growth") this.#showGhost(false);
    }
  }

  #setShare(share: number) {
    const { state } = this;
    if (state.step === "own") {
      this.own?.result.setShare(share);
      return;
    }
    state.share = share;
    this.drawing.setShare(share);
    this.carp.setShare(share);
    clearTimeout(this.#storing); // pictures of the user's are in what is stored: not with each movement
    this.#storing = setTimeout(() => this.#store(), STORED_AFTER);
  }

  #report({ words, percent }: Report) {
    const { report, score } = this.elements;
    setText(report, percent === null ? words : `${percent} %. ${words}`);
    score.hidden = percent === null;
    score.value = Math.max(0, percent ?? 0);
  }

  #showGhost(isShown: boolean) {
    this.#ghost.setAttribute("aria-pressed", String(isShown));
    this.drawing.setGhost(isShown ? 0.5 : 0);
  }

  #toggleGhost() {
    this.#showGhost(this.#ghost.getAttribute("aria-pressed") !== "true");
  }

  #keepDragged(targets: Vector2[]) {
    this.state.dragged[this.state.pair] = targets;
    this.#store();
  }

  #storeOwn() {
    if (!this.#store())
      showAlert("This browser has no room to keep your pictures: share the page as a file to keep them.");
  }

  #goOn() {
    const next = STEPS[STEPS.indexOf(this.state.step) + 1];
    if (next) this.choose({ step: next });
    window.scrollTo({ top: 0 });
  }

  #restart() {
    Object.assign(this.state, { step: "morph", pair: 0, share: 0, dragged: {} });
    this.#store();
    this.show();
  }

  /** Give a copy of the page to another program, such as a message, or save it. */
  async #shareCopy() {
    const copy = crypto.getRandomValues(new Uint32Array(2)).join("-"),
      name = "thompson.html",
      page = pageWithState({ ...this.state, copy }),
      files = [new File([page], name, { type: "text/html" })];
    try {
      if (navigator.canShare?.({ files })) await navigator.share({ files, title: localize(document.title) });
      else saveFile(page, name);
    } catch (error) {
      if ((error as Error).name !== "AbortError") saveFile(page, name); // sharing that the browser refuses
    }
  }
}
