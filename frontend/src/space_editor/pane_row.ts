// The pictures of the editor in space, side by side or below one another.

import { EditorRoot } from "../editor/stage.ts";
import { pageElement } from "../ui/dom.ts";
import type { SpacePane } from "./pane.ts";
import type { PaneGestures } from "./pointer.ts";

const LEAST_HEIGHT = 140; // CSS pixels of a picture

export class PaneRow extends EditorRoot {
  panes: SpacePane[] = [];
  gestures: PaneGestures[] = [];

  constructor(host: HTMLElement, root: HTMLElement) {
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
   */
  layout(most: number, isFilling: boolean) {
    if (isFilling) {
      this.#fillBox();
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

  /** Lay the pictures out in the number of columns that shows them largest. */
  #fillBox() {
    const { clientWidth, clientHeight } = this.element,
      { panes } = this;
    const above = Math.max(0, ...panes.map(({ root, stage }) => root.offsetHeight - stage.offsetHeight));
    const sizes = panes.map((_, k) => {
      const columns = k + 1,
        rows = Math.ceil(panes.length / columns);
      const width = Math.max(60, clientWidth / columns),
        height = Math.max(60, clientHeight / rows - above);
      const scales = this.#boxes.map(([a0, a1, b0, b1]) => Math.min(width / (a1 - a0), height / (b1 - b0)));
      return { columns, height, scale: Math.min(...scales) };
    });
    const { columns, height } = sizes.reduce((best, one) => (one.scale > best.scale ? one : best));
    this.element.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    for (const pane of panes) pane.layout(pane.stage.clientWidth || 60, Math.floor(height) - 1);
  }
}
