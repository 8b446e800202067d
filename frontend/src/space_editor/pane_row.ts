// The pictures of the editor in space: alike, or one of them large with the other two beside it or below.

import { EditorRoot } from "../editor/stage.ts";
import { pageElement } from "../ui/dom.ts";
import type { SpacePane } from "./pane.ts";
import type { PaneGestures } from "./pointer.ts";

const LEAST_HEIGHT = 140; // CSS pixels of a picture
const SMALL_SHARE = 0.26; // of the box: the small pictures beside a large one
const SMALL_PIXELS = [92, 260] as const; // their least and most width or height

/** The columns and rows of the pictures, and the size that each has with its title. */
interface PaneGrid {
  template: string;
  areas: string[];
  sizes: { width: number; height: number }[];
}

export class PaneRow extends EditorRoot {
  panes: SpacePane[] = [];
  gestures: PaneGestures[] = [];

  /** @param enlarge makes a picture larger than the others, or all of them alike again */
  constructor(
    host: HTMLElement,
    root: HTMLElement,
    readonly enlarge: (index: number) => void,
  ) {
    super(host, root, pageElement("div", "dnb-sp-row"));
  }

  /** Cancel what drags; false where nothing does. */
  cancelGestures() {
    return this.gestures.map((gestures) => gestures.cancel()).some(Boolean);
  }

  /** The picture that contains an element, else the first. */
  paneOf(element: Element | null) {
    return this.panes.find((pane) => pane.root.contains(element)) ?? this.panes[0]!;
  }

  focus() {
    this.paneOf(document.activeElement).stage.focus({ preventScroll: true });
  }

  /**
   * @param most the largest height of a picture
   * @param isFilling whether the row has the size of the box around it
   * @param large the number of the picture that is larger than the others, -1 for none
   */
  layout(most: number, isFilling: boolean, large: number) {
    this.panes.forEach(({ root }, k) => {
      root.classList.toggle("dnb-sp-small", large >= 0 && k !== large);
      root.style.gridArea = "";
    });
    this.element.style.gridTemplate = "";
    if (isFilling || large >= 0) {
      const width = Math.max(120, this.element.clientWidth),
        height = isFilling ? Math.max(120, this.element.clientHeight) : Math.min(1.6 * most, Math.max(most, width / 2));
      this.#apply(large >= 0 ? this.#gridAround(large, width, height) : this.#equalGrid(width, height));
      return;
    }
    const widths = this.panes.map((pane) => Math.max(100, pane.stage.clientWidth || 260));
    const wanted = this.#boxes.map(([a0, a1, b0, b1], k) => (widths[k]! * (b1 - b0)) / (a1 - a0));
    const height = Math.round(Math.max(LEAST_HEIGHT, Math.min(most, Math.max(...wanted))));
    this.panes.forEach((pane, k) => {
      pane.layout(widths[k]!, height);
    });
  }

  get #boxes() {
    return this.panes.map(({ info }) => info.box);
  }

  /** The scale at which a picture fits a place, without its title and slider. */
  #scale(index: number, width: number, height: number) {
    const [a0, a1, b0, b1] = this.#boxes[index]!;
    return Math.min(width / (a1 - a0), (height - this.#above(index)) / (b1 - b0));
  }

  /** The height of the title and the slider of a picture. */
  #above(index: number) {
    const { head, slider } = this.panes[index]!;
    return (head.title.parentElement?.offsetHeight ?? 0) + (slider.offsetHeight && slider.offsetHeight + 4); // its margin
  }

  #apply({ template, areas, sizes }: PaneGrid) {
    this.element.style.gridTemplate = template;
    this.panes.forEach((pane, k) => {
      const { width, height } = sizes[k]!;
      pane.root.style.gridArea = areas[k]!;
      pane.layout(Math.max(60, Math.floor(width)), Math.max(60, Math.floor(height - this.#above(k)) - 1));
    });
  }

  /** The pictures in the number of columns that shows them largest. */
  #equalGrid(width: number, height: number): PaneGrid {
    const { panes } = this;
    const found = panes.map((_, k) => {
      const columns = k + 1,
        rows = Math.ceil(panes.length / columns);
      const size = { width: width / columns, height: height / rows };
      return { columns, size, scale: Math.min(...panes.map((_, i) => this.#scale(i, size.width, size.height))) };
    });
    const { columns, size } = found.reduce((best, one) => (one.scale > best.scale ? one : best));
    return {
      template: `none / repeat(${columns}, minmax(0, 1fr))`,
      areas: panes.map(() => ""),
      sizes: panes.map(() => size),
    };
  }

  /** One picture large, the others beside it or below, whichever shows it larger. */
  #gridAround(large: number, width: number, height: number): PaneGrid {
    const small = (length: number) => Math.max(SMALL_PIXELS[0], Math.min(SMALL_PIXELS[1], SMALL_SHARE * length)),
      side = small(width),
      below = small(height) + this.#above((large + 1) % 3),
      isBeside = this.#scale(large, width - side, height) >= this.#scale(large, width, height - below);
    const others = this.panes.map((_, k) => k).filter((k) => k !== large),
      place = (k: number) => (k === large ? 0 : 1 + others.indexOf(k)),
      areas = isBeside ? ["1 / 1 / 3 / 2", "1 / 2", "2 / 2"] : ["1 / 1 / 2 / 3", "2 / 1", "2 / 2"],
      rest = isBeside ? { width: side, height: height / 2 } : { width: width / 2, height: below };
    const whole = isBeside ? { width: width - side, height } : { width, height: height - below };
    return {
      template: isBeside
        ? `1fr 1fr / minmax(0, 1fr) ${Math.floor(side)}px`
        : `minmax(0, 1fr) ${Math.floor(below)}px / 1fr 1fr`,
      areas: this.panes.map((_, k) => areas[place(k)]!),
      sizes: this.panes.map((_, k) => (k === large ? whole : rest)),
    };
  }
}
