// A grid on a drawing: its nodes are dragged to the parts of the body they belong to. Nodes that nobody has placed follow
// the thin-plate spline through those that were, and the corners, over the regular grid.

import { newPoint } from "../maths/points.ts";
import { rbfAt, rbfFit } from "../maths/rbf.ts";
import type { Model, Point, Vector2 } from "../types.ts";
import { ARROWS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import { isForFingers } from "../ui/fingers.ts";
import { widgetOf } from "../ui/widget.ts";
import { InputView, listenToDrags, targetIndex } from "./base.ts";
import { markElement } from "./nodes_view.ts";

export type NodeDrag = { index: number; before: Grid };
export type Grid = { nodes: Vector2[][]; placed: number[] };

const STEP = 1 / 200; // of the picture's longer side, for an arrow key; Shift makes it five times as large
const EDGE = 0.03; // around the picture, as a share of its longer side: nodes on its border are whole
const MOST_UNDO = 100;
const HINT = "Drag the corners first, then nodes; arrow keys move the node that has the focus";
const FINGER_HINT = "Drag the corners first, then nodes";

class GridDrawingView extends InputView {
  svg: SVGSVGElement;
  image: SVGImageElement;
  lines: SVGPathElement;
  nodes: SVGGElement;
  undo: HTMLButtonElement;
  spread: HTMLButtonElement;
  note: HTMLSpanElement;
  cancelDrag: () => boolean;
  url: string | undefined;

  grid: Grid = { nodes: [], placed: [] };
  marks: SVGGElement[] = [];
  undone: Grid[] = [];
  current = 0; // the node that Tab reaches

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-grid-drawing");
    this.svg = svgElement(
      "svg",
      { class: "dnb-gd-svg", role: "group", preserveAspectRatio: "xMidYMid meet" },
      this.root,
    );
    this.image = svgElement("image", { preserveAspectRatio: "none", "aria-hidden": "true" }, this.svg);
    this.lines = svgElement("path", { class: "dnb-gd-line", "aria-hidden": "true" }, this.svg);
    this.nodes = svgElement("g", {}, this.svg);
    const bar = pageElement("div", "dnb-cv-bar", this.root, { role: "toolbar" });
    this.undo = this.wordButton(bar, "Undo", "Undo the last drag (Ctrl+Z)", () => this.undoDrag());
    this.spread = this.wordButton(bar, "Spread evenly", "Let all nodes but the corners follow the corners again", () =>
      this.spreadEvenly(),
    );
    this.note = pageElement("span", "dnb-gd-note", bar);
    this.root.append(this.alert);
    this.cancelDrag = listenToDrags(this, this.svg, this);
    this.listen(this.root, "keydown", (event) => this.key(event));
    this.onChange(["image", "box", "height"], () => this.invalidate());
    this.showImage();
    this.on("change:image", () => this.showImage());
    this.start();
  }

  close() {
    URL.revokeObjectURL(this.url ?? "");
    super.close();
  }

  showImage() {
    URL.revokeObjectURL(this.url ?? "");
    this.url = URL.createObjectURL(new Blob([this.model.get("image")], { type: "image/png" }));
    setAttributes(this.image, { href: this.url });
  }

  adopt({ nodes, placed }: Grid) {
    if (nodes.length !== this.grid.nodes.length || nodes[0]!.length !== this.columns) this.undone = [];
    this.grid = { nodes, placed };
  }

  get rows() {
    return this.grid.nodes.length;
  }

  get columns() {
    return this.grid.nodes[0]?.length ?? 0;
  }

  get corners() {
    return [0, this.columns - 1, (this.rows - 1) * this.columns, this.rows * this.columns - 1];
  }

  /** CSS pixels to a unit of the picture. */
  get scale() {
    return this.svg.getScreenCTM()?.a || 1;
  }

  placeOf(grid: Grid, index: number): Vector2 {
    return grid.nodes[Math.floor(index / this.columns)]![index % this.columns]!;
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /**
   * The grid with a node at another place. It moves there, the corners and the other nodes that were placed stay,
   * and all between them follow.
   */
  moveNode(before: Grid, index: number, place: Vector2): Grid {
    const placed = before.placed.includes(index) ? before.placed : [...before.placed, index];
    return { nodes: this.spline(before, placed, index, place), placed };
  }

  /**
   * All nodes by the thin-plate spline through corners and placed ones.
   * @param place of the node of that index, if it has moved
   */
  spline(before: Grid, placed: number[], index: number = -1, place: Vector2 | null = null) {
    const { rows, columns } = this,
      knots = [...new Set([...this.corners, ...placed])];
    const regular = (k: number): Vector2 => [(k % columns) / (columns - 1), Math.floor(k / columns) / (rows - 1)];
    const points: Point[] = knots.map((k, n) =>
      newPoint(n, k === index && place ? place : this.placeOf(before, k), regular(k)),
    );
    const fit = rbfFit(points, { kernel: "thin_plate", trend: "affine", support: 1 });
    return before.nodes.map((row, i) =>
      row.map((_, j): Vector2 => {
        const [u, v] = [j / (columns - 1), i / (rows - 1)],
          [da, db] = rbfAt(fit, u, v);
        return [u + da, v + db];
      }),
    );
  }

  edit(grid: Grid, before: Grid) {
    this.undone = [...this.undone, before].slice(-MOST_UNDO);
    this.grid = grid;
    this.end(grid);
    this.invalidate();
  }

  undoDrag() {
    const before = this.undone.at(-1);
    if (!before || this.isReadOnly) return;
    this.undone = this.undone.slice(0, -1);
    this.grid = before;
    this.end(before);
    this.announce("taken back");
    this.invalidate();
  }

  spreadEvenly() {
    if (this.isReadOnly) return;
    const placed = this.grid.placed.filter((k) => this.corners.includes(k));
    this.edit({ nodes: this.spline(this.grid, placed), placed }, this.grid);
  }

  // ---- drags and keys -----------------------------------------------------------------------------------------------

  press(event: PointerEvent): NodeDrag | null {
    if (this.isReadOnly) return null;
    const at = event.target instanceof Element ? event.target.closest(".dnb-cv-node") : null;
    const index = at ? this.marks.indexOf(at as SVGGElement) : -1;
    if (index < 0) return null;
    this.isHeld = true;
    this.current = index;
    this.marks[index]!.focus({ preventScroll: true });
    return { index, before: this.grid };
  }

  drag({ index, before }: NodeDrag, [dx, dy]: Vector2) {
    const [a, b] = this.placeOf(before, index),
      { scale } = this;
    this.grid = this.moveNode(before, index, this.inside([a + dx / scale, b + dy / scale]));
    this.move(this.grid);
    this.invalidate();
  }

  drop({ index, before }: NodeDrag, isCancelled: boolean, isClick: boolean) {
    this.isHeld = false;
    if (isCancelled || isClick) this.grid = before;
    else this.edit(this.grid, before);
    if (!isCancelled && !isClick) this.announce(this.words(index));
    this.invalidate();
  }

  inside([a, b]: Vector2): Vector2 {
    const [a0, a1, b0, b1] = this.model.get("box");
    return [Math.max(a0, Math.min(a1, a)), Math.max(b0, Math.min(b1, b))];
  }

  key(event: KeyboardEvent) {
    const arrow = ARROWS[event.key];
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") this.undoDrag();
    else if (event.key === "Escape") {
      if (!this.cancelDrag()) return;
    } else if (arrow && !event.ctrlKey && !event.metaKey) this.nudge(event, arrow);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** With Alt an arrow focuses the next node, else it moves the focused one. */
  nudge(event: KeyboardEvent, [di, dj]: Vector2) {
    const index = targetIndex(this.marks, event);
    if (index < 0) return;
    if (event.altKey) {
      const i = (index % this.columns) + di,
        j = Math.floor(index / this.columns) + dj;
      if (i < 0 || j < 0 || i >= this.columns || j >= this.rows) return;
      this.current = i + j * this.columns;
      this.invalidate();
      this.marks[this.current]!.focus({ preventScroll: true });
      return;
    }
    if (this.isReadOnly) return;
    const [a0, a1, b0, b1] = this.model.get("box"),
      [a, b] = this.placeOf(this.grid, index);
    const step = (event.shiftKey ? 5 : 1) * STEP * Math.max(a1 - a0, b1 - b0);
    this.edit(this.moveNode(this.grid, index, this.inside([a + di * step, b + dj * step])), this.grid);
    this.announce(this.words(index));
  }

  words(index: number) {
    const [a, b] = this.placeOf(this.grid, index);
    return `node r${Math.floor(index / this.columns)} c${index % this.columns} at ${a.toFixed(1)}, ${b.toFixed(1)}`;
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    const [a0, a1, b0, b1] = this.model.get("box"),
      { nodes, placed } = this.grid;
    const edge = EDGE * Math.max(a1 - a0, b1 - b0),
      sides = [a0 - edge, b0 - edge, a1 - a0 + 2 * edge, b1 - b0 + 2 * edge];
    setAttributes(this.svg, { viewBox: sides.join(" "), "aria-label": this.model.get("label") });
    this.svg.style.maxHeight = `${this.model.get("height")}px`;
    setAttributes(this.image, { x: a0, y: b0, width: a1 - a0, height: b1 - b0 });
    const columns = nodes[0]!.map((_, j) => nodes.map((row) => row[j]!));
    setAttributes(this.lines, {
      d: [...nodes, ...columns]
        .map((line) => `M${line.map(([a, b]) => `${a.toFixed(2)} ${b.toFixed(2)}`).join("L")}`)
        .join(""),
    });
    const { corners } = this,
      radius = 1 / this.scale,
      count = this.rows * this.columns;
    for (const mark of this.marks.splice(count)) mark.remove();
    this.current = Math.min(this.current, count - 1);
    for (let k = 0; k < count; k++) {
      const mark = this.marks[k] ?? this.#make(k),
        [a, b] = this.placeOf(this.grid, k);
      const kind = corners.includes(k) ? " dnb-gd-corner" : placed.includes(k) ? " dnb-gd-placed" : "";
      setAttributes(mark, {
        transform: `translate(${a} ${b}) scale(${radius})`,
        class: `dnb-cv-node${kind}`,
        tabindex: k === this.current ? "0" : "-1",
        "aria-label": this.words(k),
      });
    }
    this.undo.disabled = this.isReadOnly || this.undone.length === 0;
    this.spread.disabled = this.isReadOnly || placed.every((k) => corners.includes(k));
    setText(this.note, this.isReadOnly ? "shown only" : isForFingers() ? FINGER_HINT : HINT);
  }

  #make(k: number) {
    const mark = markElement(this.nodes, [11, 9, 4.5], { role: "button" });
    this.marks[k] = mark;
    return mark;
  }
}

export default widgetOf(GridDrawingView);
