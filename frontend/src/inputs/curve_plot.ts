// A plot with a curve through nodes that are dragged, added and removed. A widget extends it and defines its axes:
// rules() as in maths/curves.js, ends() of both, and the texts.

import type { Node, NodeRules } from "../maths/curves.ts";
import { addNode, curveOfSamples, curveThrough, moveNode, removeNode } from "../maths/curves.ts";
import type { Model, Vector2 } from "../types.ts";
import { pageElement, placeIn, setAttributes, setText, svgElement, treeOf } from "../ui/dom.ts";
import { markElement, NodesView } from "./nodes_view.ts";
import type { PlotAxes } from "./plot_axes.ts";

const TOUCH_RADIUS = 13;
/** A drag of a node. */
export interface NodeDrag {
  k: number;
  /** Its place in pixels */
  from: Vector2;
  before: { nodes: Node[]; samples: number[] | null; named: string };
  /** Whether nothing snaps */
  isFree: boolean;
}

/** A drag of the plot itself, which had these ends. */
export type PlotDrag = { pan: Vector2 };

export class CurvePlot<Axes extends PlotAxes = PlotAxes> extends NodesView<NodeDrag | PlotDrag> {
  facts: HTMLSpanElement;
  note: HTMLSpanElement;
  backLayer: SVGGElement;
  curveLayer: SVGGElement;
  frontLayer: SVGGElement;
  line: SVGPathElement;
  pair: HTMLSpanElement;

  nodes: Node[] = [];
  /** Values of a formula instead of nodes */
  samples: number[] | null = null;
  named = ""; // the preset or formula that made the curve
  isSmooth = false;
  chosen = 0;
  #axesLayer: SVGGElement;

  constructor(
    model: Model,
    el: HTMLElement,
    name: string,
    readonly axes: Axes,
  ) {
    super(model, el, name, "data-node", [
      "Add a node after the chosen one (A, or double click)",
      "Remove the chosen node (Del, or right click)",
    ]);
    const status = pageElement("div", "dnb-cv-status", this.root);
    this.facts = pageElement("span", "dnb-cv-facts", status);
    this.note = pageElement("span", "dnb-cv-note", status);
    this.root.append(this.alert);
    const makeLayer = (layer: string) => svgElement("g", { class: `dnb-cv-${layer}` }, this.svg);
    this.backLayer = makeLayer("back");
    this.#axesLayer = makeLayer("axes");
    this.curveLayer = makeLayer("curve");
    this.frontLayer = makeLayer("front");
    for (const layer of [this.backLayer, this.#axesLayer, this.curveLayer]) layer.setAttribute("aria-hidden", "true");
    this.line = svgElement("path", { class: "dnb-cv-line" }, this.curveLayer);
    this.pair = pageElement("span", "dnb-cv-pair", null, {}, this.adder, this.remover); // for the bar
  }

  // ---- the axes -----------------------------------------------------------------------------------------------------

  /** The rules of edits. */
  rules(): NodeRules {
    return { x: [0, 1], y: [0, 1], step: 0, gap: 0, isPinned: false, most: 64 };
  }

  /** The ends of the axes when nothing is dragged. */
  ends(): [Vector2, Vector2] {
    const { x, y } = this.rules();
    return [x, y];
  }

  /** The value that Python receives. */
  value(): object {
    return { nodes: this.nodes };
  }

  addChosen() {
    this.addAfter(this.chosen);
  }

  removeChosen() {
    this.remove(this.chosen);
  }

  curve() {
    return this.samples ? curveOfSamples(this.samples) : curveThrough(this.nodes, this.isSmooth);
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  /** Show other nodes: they are no formula any more. */
  show(nodes: Node[], chosen: number) {
    this.nodes = nodes;
    this.chosen = chosen;
    this.samples = null;
    this.named = "";
    this.invalidate();
  }

  commit() {
    this.isHeld = false;
    this.nudged = null;
    this.axes.ends = this.ends();
    this.end(this.value());
    this.invalidate();
  }

  press(event: PointerEvent): NodeDrag | PlotDrag | null {
    const k = this.isReadOnly ? null : this.nodeAt(event);
    if (k === null) return null;
    this.settle();
    this.chosen = k;
    this.marks[k]!.focus({ preventScroll: true });
    this.isHeld = true;
    this.invalidate();
    const { nodes, samples, named } = this;
    return { k, from: this.axes.toPixel(nodes[k]!), before: { nodes, samples, named }, isFree: event.altKey };
  }

  drag(grabbed: NodeDrag | PlotDrag, [dx, dy]: Vector2) {
    if ("pan" in grabbed) return;
    const { k, from, before, isFree } = grabbed;
    const place = this.axes.tidy(this.axes.toPlace([from[0] + dx, from[1] + dy]), isFree);
    this.show(moveNode(before.nodes, k, place, this.rules()), k);
    this.move(this.value());
  }

  drop(grabbed: NodeDrag | PlotDrag, isCancelled: boolean, isClick: boolean) {
    if ("pan" in grabbed) return;
    this.isHeld = false;
    if (isClick) {
      this.receive();
      return;
    }
    if (!isCancelled) {
      this.commit();
      return;
    }
    Object.assign(this, grabbed.before);
    // A follower of the movements must receive the value at the end; Python's has not changed.
    if (this.model.get("live")) this.commit();
    else this.receive();
    this.invalidate();
  }

  /** Move a node by an arrow key. */
  nudge(k: number, [dx, dy]: Vector2, isFar: boolean) {
    const { step } = this.rules(),
      times = isFar ? 10 : 1,
      [[x0, x1]] = this.axes.ends,
      [x, y] = this.nodes[k]!;
    const [px, py] = this.axes.toPixel([x, y]),
      moved = this.axes.toPlace([px, py - (dy * times * this.axes.box.height) / 100]);
    const place: Vector2 = dy ? this.axes.tidy([x, moved[1]], true) : [x + dx * times * (step || (x1 - x0) / 200), y];
    this.nudged ??= k;
    this.isHeld = true;
    this.show(moveNode(this.nodes, k, place, this.rules()), k);
    this.move(this.value());
    this.settleSoon();
  }

  commitNudge() {
    this.commit();
  }

  add(place: Vector2) {
    if (this.isReadOnly) return;
    this.settle();
    const added = addNode(this.nodes, place, this.rules());
    if (!added) {
      this.showMessage("There is no room for another node here.");
      return;
    }
    const [nodes, chosen] = added;
    this.show(nodes, chosen);
    this.commit();
    this.focusMark(this.chosen);
    this.announce(`added ${this.words(this.chosen)}`);
  }

  addAfter(k: number) {
    const from = Math.max(0, Math.min(this.nodes.length - 2, k));
    const x = (this.nodes[from]![0] + this.nodes[from + 1]![0]) / 2;
    this.add([x, this.axes.tidy([x, this.curve()(x)], true)[1]]);
  }

  remove(k: number) {
    if (this.isReadOnly) return;
    this.settle();
    const nodes = removeNode(this.nodes, k, this.rules());
    if (!nodes) {
      this.showMessage(
        this.nodes.length <= 2 ? "A curve needs two nodes." : "The outer nodes stay: the curve runs from end to end.",
      );
      return;
    }
    const hadFocus = this.svg.contains(treeOf(this.root).activeElement);
    this.show(nodes, Math.min(k, nodes.length - 1));
    this.commit();
    if (hadFocus) this.focusMark(this.chosen);
    else this.draw();
    this.announce(`removed; ${nodes.length} nodes are left`);
  }

  addAt(event: MouseEvent) {
    this.add(this.axes.tidy(this.axes.toPlace(placeIn(this.svg, event)), event.altKey));
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  draw() {
    const { axes } = this;
    if (!this.nodes.length) return;
    if (!this.isHeld) axes.ends = this.ends();
    const least = this.model.get("height") || 150,
      width = Math.max(160, this.stage.clientWidth || 360);
    const label = this.model.get("label") || "Curve",
      height = axes.resize(width, least);
    setAttributes(this.svg, { viewBox: `0 0 ${width} ${height}`, height, "aria-label": `${label}. ${this.help()}` });
    this.bar.setAttribute("aria-label", label);
    this.root.classList.toggle("dnb-cv-read-only", this.isReadOnly);
    this.root.classList.toggle("dnb-cv-sampled", this.samples !== null);
    axes.draw(this.#axesLayer);
    this.drawBack();
    this.line.setAttribute("d", pathOf(this.outline()));
    this.drawNodes();
    this.describe();
  }

  help() {
    return "Tab goes through the nodes, arrows move them, A adds one, Delete removes one.";
  }

  /** Draw the background of the curve. */
  drawBack() {}

  /** The curve in pixels, from edge to edge. */
  outline() {
    const [[x0, x1]] = this.axes.ends,
      curve = this.curve(),
      { nodes } = this;
    const at = (x: number) => this.axes.toPixel([x, curve(x)]);
    /** Its visible part. */
    const between = (from: number, to: number) => {
      const a = Math.max(from, x0),
        b = Math.min(to, x1);
      if (!(b > a)) return [];
      const parts = Math.max(1, Math.ceil((((b - a) / (x1 - x0)) * this.axes.box.width) / 2));
      const inner = Array.from({ length: parts - 1 }, (_, k) => at(a + ((b - a) * (k + 1)) / parts));
      return [...(a > from ? [at(a)] : []), ...inner, ...(b < to ? [at(b)] : [])];
    };
    if (this.samples) return [at(x0), ...between(x0, x1), at(x1)];
    const found = [this.axes.toPixel([x0, nodes[0]![1]])];
    nodes.forEach((node, k) => {
      found.push(this.axes.toPixel(node));
      if (k + 1 < nodes.length) found.push(...between(node[0], nodes[k + 1]![0]));
    });
    found.push(this.axes.toPixel([x1, nodes[nodes.length - 1]![1]]));
    return found;
  }

  /** The place of a node in words. */
  words(k: number) {
    return this.nodes[k]!.join(", ");
  }

  makeMark(k: number) {
    const mark = markElement(this.frontLayer, [TOUCH_RADIUS, 8.5, 5], { "data-node": k, role: "slider" });
    this.listen(mark, "focus", () => {
      this.chosen = k;
      this.invalidate();
    });
    return mark;
  }

  drawNodes() {
    this.countMarks(this.nodes.length);
    const [, [y0, y1]] = this.axes.ends;
    this.chosen = Math.min(this.chosen, this.nodes.length - 1);
    this.nodes.forEach((node, k) => {
      const [x, y] = this.axes.toPixel(node);
      setAttributes(this.marks[k]!, {
        transform: `translate(${x.toFixed(2)} ${y.toFixed(2)})`,
        tabindex: 0,
        "aria-label": `node ${k + 1} of ${this.nodes.length}`,
        "aria-valuetext": this.words(k),
        "aria-valuenow": node[1],
        "aria-valuemin": y0,
        "aria-valuemax": y1,
        "aria-readonly": this.isReadOnly,
      });
      this.marks[k]!.classList.toggle("dnb-cv-chosen", k === this.chosen);
    });
  }

  describe() {
    setText(this.facts, `Node ${this.chosen + 1} of ${this.nodes.length}: ${this.words(this.chosen)}`);
    const { isReadOnly } = this;
    setAttributes(this.adder, { "aria-disabled": isReadOnly || this.nodes.length >= this.rules().most });
    const canRemove = removeNode(this.nodes, this.chosen, this.rules()) !== null;
    setAttributes(this.remover, { "aria-disabled": isReadOnly || !canRemove });
  }
}

/** A path of straight lines. */
export function pathOf(points: Vector2[]) {
  return points.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");
}
