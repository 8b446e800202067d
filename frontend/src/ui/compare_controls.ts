// The controls of the display modes that compare original and deformed at one place: the line of "wipe", dragged or moved
// by keys, and the slider of "fade".

import { OWN_KEYS, pageElement, setAttributes } from "./dom.ts";

const STEP = 0.02,
  LARGE_STEP = 0.1; // shares of the width of an arrow key, and with Shift

export class CompareControls {
  share = 0.5; // of the width that shows the original; of the original in the mixture
  shows = "";
  line: HTMLDivElement;
  fade: HTMLLabelElement;
  slider: HTMLInputElement;

  /** @param root of the view */
  constructor(
    readonly root: HTMLElement,
    readonly moved: () => void,
  ) {
    this.line = pageElement("div", "dnb-wipe", root, {
      role: "slider",
      tabindex: "0",
      hidden: "",
      "aria-label": "Line between original and deformed",
      "aria-valuemin": "0",
      "aria-valuemax": "100",
      "aria-orientation": "horizontal",
      title: "Original left of the line, deformed right of it: drag it",
      ...OWN_KEYS,
    });
    this.line.addEventListener("pointerdown", (event) => this.#hold(event));
    this.line.addEventListener("pointermove", (event) => this.#drag(event));
    this.line.addEventListener("keydown", (event) => this.#key(event));
    this.fade = pageElement("label", "dnb-fade", root, {
      hidden: "",
      title: "Opacity of the original over the deformed",
    });
    pageElement("span", "", this.fade, {}, "deformed");
    this.slider = pageElement("input", "", this.fade, {
      type: "range",
      min: 0,
      max: 1,
      step: 0.01,
      "aria-label": "Opacity of the original",
      ...OWN_KEYS,
    });
    pageElement("span", "", this.fade, {}, "original");
    this.slider.addEventListener("input", () => this.move(this.slider.valueAsNumber));
    for (const name of ["pointerdown", "dblclick", "wheel", "keydown"]) {
      // they neither turn nor add anything
      this.fade.addEventListener(name, (event) => event.stopPropagation(), { passive: true });
    }
    this.#place();
  }

  set(shows: string) {
    if (shows === this.shows) return;
    this.shows = shows;
    this.line.hidden = shows !== "wipe";
    this.fade.hidden = shows !== "fade";
  }

  move(share: number) {
    this.share = Math.min(1, Math.max(0, share));
    this.#place();
    this.moved();
  }

  #place() {
    this.line.style.left = `${100 * this.share}%`;
    setAttributes(this.line, { "aria-valuenow": String(Math.round(100 * this.share)) });
    this.slider.value = String(this.share);
  }

  #hold(event: PointerEvent) {
    if (event.button !== 0) return;
    event.stopPropagation(); // it does not turn the volume
    this.line.setPointerCapture(event.pointerId);
  }

  #drag(event: PointerEvent) {
    if (!this.line.hasPointerCapture(event.pointerId)) return;
    const { left, width } = this.root.getBoundingClientRect();
    this.move((event.clientX - left) / width);
  }

  #key(event: KeyboardEvent) {
    const step = event.shiftKey ? LARGE_STEP : STEP,
      ways = { ArrowLeft: -step, ArrowRight: step, Home: -1, End: 1 };
    const way = ways[event.key as keyof typeof ways];
    if (way === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.move(this.share + way);
  }
}
