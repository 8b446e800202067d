// The transfer editor: opacity over the histogram of a volume, below it colours and the window of both.

import type { Node, NodeRules } from "../maths/curves.ts";
import type { Model, Vector2 } from "../types.ts";
import {
  buttonElement,
  iconElement,
  pageElement,
  placeIn,
  setAttributes,
  setText,
  svgElement,
  targetOf,
  treeOf,
} from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";
import type { NodeDrag, PlotDrag } from "./curve_plot.ts";
import { CurvePlot, pathOf } from "./curve_plot.ts";
import type { ColorStop } from "./transfer_rows.ts";
import { ColorStops, MOST_NODES, RowEdits, WindowBar } from "./transfer_rows.ts";
import { ValueAxes } from "./value_axes.ts";

/** Heights from 0 to 1 of equal parts of a range of values. */
type Histogram = { low: number; high: number; heights: number[] };

// ---- the presets: buttons with pictures of this very volume, shown once they are made -------------------------------

const PICTURE = { alt: "", width: 56, height: 56, draggable: "false" }; // CSS pixels

class PresetButtons {
  group: HTMLDivElement;
  buttons: Record<string, { button: HTMLButtonElement; picture: HTMLImageElement }> = {};

  /** @param take called with the name of a preset */
  constructor(
    readonly model: Model,
    take: (name: string) => void,
  ) {
    this.group = pageElement("div", "dnb-cv-presets", null, { role: "group", "aria-label": "Presets" });
    for (const [name, tip] of Object.entries<string>(model.get("presets") ?? {})) {
      const picture = pageElement("img", "dnb-cv-thumbnail", null, PICTURE);
      const button = buttonElement("dnb-cv-preset", this.group, picture, () => take(name), { title: tip });
      pageElement("span", "", button, {}, name);
      this.buttons[name] = { button, picture };
    }
    this.showPictures();
  }

  showPictures() {
    const pictures = this.model.get("thumbnails") ?? {};
    for (const [name, { picture }] of Object.entries(this.buttons)) {
      if (pictures[name]) picture.src = pictures[name];
      else picture.removeAttribute("src");
    }
  }

  show(chosen: string, isReadOnly: boolean) {
    for (const [name, { button }] of Object.entries(this.buttons)) {
      setAttributes(button, { "aria-pressed": name === chosen });
      button.disabled = isReadOnly;
    }
  }
}

// ---- zooming --------------------------------------------------------------------------------------------------------

const WHEEL_STEP = 0.0022; // of the logarithm of the scale, for a pixel of the wheel
const HINT_MS = 2500;
const VALUE_ICONS = {
  in: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M7.3 5v4.4M5 7.2h4.5",
  out: "M11.4 11.4l3 3M12.5 7.2a5.2 5.2 0 1 1-10.4 0 5.2 5.2 0 0 1 10.4 0M5 7.2h4.5",
  all: "M2 3v10M14 3v10M4.5 8h7M6.5 6l-2 2 2 2M9.5 6l2 2-2 2",
};

/** What the controls of the zoom use of the editor. */
interface ZoomEditor
  extends Pick<CurvePlot<ValueAxes>, "axes" | "bar" | "svg" | "iconButton" | "guard" | "invalidate"> {
  /** The value at which the user works, if any */
  readonly chosenValue: number | null;
}

/** Buttons, keys and the wheel, which zoom into the values. */
class ZoomControls {
  /** A hint, for a while */
  hinted = "";
  #timer = 0;
  #farther: HTMLButtonElement;
  #whole: HTMLButtonElement;

  constructor(readonly editor: ZoomEditor) {
    const icon = (name: keyof typeof VALUE_ICONS, tip: string, act: () => void) =>
      editor.iconButton(editor.bar, iconElement(VALUE_ICONS[name], { class: "dnb-cv-icon" }), tip, act);
    icon("in", "Zoom into the values (+, or the wheel)", () => this.#zoomBy(2));
    this.#farther = icon("out", "Zoom out (\u2212)", () => this.#zoomBy(0.5));
    this.#whole = icon("all", "Show all values (0)", () => editor.axes.zoomTo(null));
  }

  close() {
    clearTimeout(this.#timer);
  }

  /** Zoom about the chosen value where it is seen. */
  #zoomBy(factor: number) {
    const { axes, chosenValue: chosen } = this.editor,
      [[low, high]] = axes.ends;
    axes.zoomBy(factor, chosen !== null && axes.isSeen(chosen) ? chosen : (low + high) / 2);
  }

  /** Returns whether the key is one of the zoom. */
  key(event: KeyboardEvent) {
    const { axes, svg } = this.editor;
    if (!svg.contains(targetOf(event))) return false;
    if (event.key === "+" || event.key === "=") this.#zoomBy(2);
    else if (event.key === "-") this.#zoomBy(0.5);
    else if (event.key === "0") axes.zoomTo(null);
    else return false;
    return true;
  }

  /** Zoom. The wheel scrolls the page until the user works in here. */
  wheel(event: WheelEvent, isFocused: boolean) {
    const { axes, svg } = this.editor,
      isCommand = event.ctrlKey || event.metaKey;
    if (!isCommand && !isFocused) {
      this.#hint("Click here, or hold Ctrl, to zoom with the wheel");
      return;
    }
    if (!axes.zoom && event.deltaY >= 0 && !isCommand) return; // all is seen: the page scrolls
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1,
      [[low, high]] = axes.ends;
    if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      if (axes.zoom) axes.pan(axes.zoom, (event.deltaX * lines) / axes.box.width);
      return;
    }
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines));
    const at = Math.max(low, Math.min(high, axes.toPlace(placeIn(svg, event))[0]));
    axes.zoomBy(Math.exp(-delta * (event.ctrlKey ? 0.01 : WHEEL_STEP)), at);
  }

  #hint(text: string) {
    const { editor } = this,
      show = (hinted: string) => {
        this.hinted = hinted;
        editor.invalidate();
      };
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => editor.guard(() => show("")), HINT_MS);
    show(text);
  }

  draw() {
    for (const button of [this.#farther, this.#whole])
      setAttributes(button, { "aria-disabled": !this.editor.axes.zoom });
  }
}

// ---- the background -------------------------------------------------------------------------------------------------

const LEAST_BAR = 1.5; // CSS pixels

/** The histogram of the volume, and the area under the curve in the colours of its values. */
class Background {
  /** The colours as a fill */
  readonly fill: string;
  bars: SVGPathElement;
  #area: SVGPathElement;
  #gradient: SVGLinearGradientElement;
  #hole: SVGRectElement;

  /** @param layers which are limited to the plot; the background is in the first */
  constructor(
    readonly axes: ValueAxes,
    svg: SVGSVGElement,
    layers: [SVGGElement, SVGGElement],
    name: string,
  ) {
    const defs = svgElement("defs", {}, svg);
    this.fill = `url(#${name})`;
    this.#gradient = svgElement("linearGradient", { id: name, gradientUnits: "userSpaceOnUse", y1: 0, y2: 0 }, defs);
    this.#hole = svgElement("rect", {}, svgElement("clipPath", { id: `${name}-hole` }, defs));
    this.bars = svgElement("path", { class: "dnb-cv-bars" }, layers[0]);
    this.#area = svgElement("path", { class: "dnb-cv-area", fill: this.fill }, layers[0]);
    for (const layer of layers) layer.setAttribute("clip-path", `url(#${name}-hole)`);
  }

  draw({ low, high, heights }: Histogram, outline: Vector2[], colors: ColorStop[]) {
    const { axes } = this,
      { left, top, width, height } = axes.box;
    const floor = top + height,
      each = (high - low) / heights.length;
    const x = (value: number) => axes.toPixel([value, 0])[0];
    const edge = (k: number) => Math.max(left, Math.min(left + width, x(Math.min(high, low + k * each)))).toFixed(2);
    const together = Math.max(1, Math.ceil(LEAST_BAR / (x(each) - x(0)))); // finer bars are seen when zoomed
    const steps = [];
    for (let k = 0; k < heights.length; k += together) {
      const h = Math.max(...heights.slice(k, k + together));
      steps.push(`V${(floor - h * height * 0.97).toFixed(2)}H${edge(k + together)}`);
    }
    this.bars.setAttribute("d", `M${edge(0)} ${floor}${steps.join("")}V${floor}Z`);
    const [from] = outline[0]!,
      [to] = outline[outline.length - 1]!;
    this.#area.setAttribute("d", `${pathOf(outline)}L${to} ${floor}L${from} ${floor}Z`);
    const first = x(colors[0]![0]),
      last = x(colors[colors.length - 1]![0]);
    setAttributes(this.#gradient, { x1: first, x2: last });
    this.#gradient.replaceChildren(
      ...colors.map(([value, ...rgb]) =>
        svgElement("stop", {
          offset: last > first ? (x(value) - first) / (last - first) : 0,
          "stop-color": `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})`,
        }),
      ),
    );
    setAttributes(this.#hole, { x: left, y: top - 2, width, height: height + 4 });
  }
}

// ---- the widget -----------------------------------------------------------------------------------------------------

class TransferEditorView extends CurvePlot<ValueAxes> {
  presets: PresetButtons;
  resetter: HTMLButtonElement;
  background: Background;
  stops: ColorStops;
  window: WindowBar;
  zoom: ZoomControls;

  edits = new RowEdits(this);
  colors: ColorStop[] = [];
  back = ""; // the preset that "Reset" takes

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-transfer-editor", new ValueAxes());
    this.axes.changed = () => this.invalidate();
    this.presets = new PresetButtons(model, (name) => this.guard(() => this.take(name)));
    this.root.insertBefore(this.presets.group, this.bar);
    this.resetter = this.wordButton(this.bar, "Reset", "", () => {
      if (this.back && !this.named) this.take(this.back);
    });
    pageElement("span", "dnb-cv-space", this.bar);
    const { axes, backLayer, curveLayer, svg } = this;
    this.background = new Background(axes, svg, [backLayer, curveLayer], `dnb-${this.link.id}`);
    this.stops = new ColorStops(this, this.background.fill);
    this.window = new WindowBar(this);
    this.listen(this.frontLayer, "focusin", () => this.edits.choose(null));
    this.bar.append(this.stops.picker, this.pair);
    pageElement("span", "dnb-cv-gap", this.bar);
    this.zoom = new ZoomControls(this);
    axes.power = model.get("power") || 1;
    this.on("change:histogram", () => {
      axes.zoom = null;
      this.invalidate();
    });
    this.on("change:thumbnails", () => this.presets.showPictures());
    this.onChange(["height", "power"], () => {
      axes.power = model.get("power");
      this.invalidate();
    });
    this.listen(svg, "wheel", (event) => this.zoom.wheel(event, this.root.contains(treeOf(this.root).activeElement)), {
      passive: false,
    });
    this.start();
  }

  close() {
    this.zoom.close();
    super.close();
  }

  get rows() {
    return [this.stops, this.window];
  }

  adopt(shown: { nodes: Node[]; colors: ColorStop[]; preset: string; range: Vector2; back: string }) {
    this.nodes = shown.nodes;
    this.colors = shown.colors;
    this.named = shown.preset;
    this.back = shown.back;
    this.axes.setRange(shown.range);
    this.axes.ends = this.ends();
  }

  take(preset: string) {
    if (this.isReadOnly) {
      this.invalidate();
      return;
    }
    this.settle();
    this.named = preset;
    this.end({ preset });
  }

  // ---- edits --------------------------------------------------------------------------------------------------------

  settle() {
    super.settle();
    this.edits.settle();
  }

  show(nodes: Node[], chosen: number) {
    super.show(nodes, chosen);
    this.edits.row = null;
    this.axes.reveal(nodes[chosen]![0]);
  }

  press(event: PointerEvent): NodeDrag | PlotDrag | null {
    const grabbed = super.press(event);
    if (grabbed !== null) {
      this.edits.choose(null);
      return grabbed;
    }
    const [x, y] = placeIn(this.svg, event),
      { zoom } = this.axes,
      { left, top, width, height } = this.axes.box;
    const isInside = x > left && x < left + width && y > top && y < top + height;
    return zoom && isInside && targetOf(event).closest(".dnb-cv-grip") === null ? { pan: zoom } : null;
  }

  drag(grabbed: NodeDrag | PlotDrag, by: Vector2) {
    if ("pan" in grabbed) this.axes.pan(grabbed.pan, -by[0] / this.axes.box.width);
    else super.drag(grabbed, by);
  }

  get isAtStops() {
    return this.edits.row === this.stops;
  }

  /** The value at which the user works; null in the window. */
  get chosenValue() {
    if (this.edits.row === this.window) return null;
    return this.isAtStops ? this.colors[this.stops.chosen]![0] : this.nodes[this.chosen]![0];
  }

  addChosen() {
    if (this.isAtStops) this.stops.addChosen();
    else super.addChosen();
  }

  removeChosen() {
    if (this.isAtStops) this.stops.removeChosen();
    else super.removeChosen();
  }

  key(event: KeyboardEvent) {
    if (event.ctrlKey || event.metaKey) return;
    const isEscaped = event.key === "Escape" && this.rows.some((row) => row.cancelDrag());
    if (!isEscaped && !this.rows.some((row) => row.key(event)) && !this.zoom.key(event)) {
      super.key(event);
      return;
    }
    event.preventDefault();
    event.stopPropagation();
  }

  // ---- the plot -----------------------------------------------------------------------------------------------------

  rules(): NodeRules {
    return { x: this.axes.whole, y: [0, 1], step: 0, gap: 0, isPinned: false, most: MOST_NODES };
  }

  ends(): [Vector2, Vector2] {
    return [this.axes.zoom ?? this.axes.whole, [0, 1]];
  }

  words(k: number) {
    const [value, alpha] = this.nodes[k]!;
    return `value ${this.axes.words(value)}, opacity ${Number(alpha.toPrecision(3))}`;
  }

  help() {
    return (
      "Tab goes through the nodes, the colours below and the window of all, arrows move them, A adds one, " +
      "Delete removes one, Enter recolours; plus and minus zoom."
    );
  }

  drawBack() {
    const { top, height } = this.axes.box;
    this.background.draw(this.model.get("histogram"), this.outline(), this.colors);
    for (const row of this.rows) row.draw(top + height);
  }

  drawNodes() {
    super.drawNodes();
    this.marks.forEach((dot, k) => {
      dot.style.display = this.axes.isSeen(this.nodes[k]![0]) ? "" : "none";
      if (this.edits.row !== null) dot.classList.remove("dnb-cv-chosen");
    });
  }

  describe() {
    super.describe();
    const { isAtStops, isReadOnly, stops, back, named } = this;
    if (this.edits.row) setText(this.facts, this.edits.row.facts());
    if (isAtStops) setAttributes(this.remover, { "aria-disabled": isReadOnly || !stops.canRemove });
    const what = isAtStops ? "colour" : "node";
    setAttributes(this.adder, {
      title: `Add a ${what} after the chosen one (A, or double click)`,
      "aria-label": `Add a ${what}`,
    });
    setAttributes(this.remover, {
      title: `Remove the chosen ${what} (Del, or right click)`,
      "aria-label": `Remove the chosen ${what}`,
    });
    const isOwn = !named,
      again = back ? `the preset ${back}` : "a preset";
    setAttributes(this.resetter, {
      "aria-disabled": isReadOnly || !isOwn || !back,
      title: `Take ${again} again: undo does not apply to colours and opacities`,
    });
    this.presets.show(named, isReadOnly);
    this.zoom.draw();
    setText(this.note, this.#remarks());
  }

  #remarks() {
    const { note } = this.model.get("histogram"),
      { zoom, named, back, isReadOnly } = this;
    if (zoom.hinted) return zoom.hinted;
    if (isReadOnly) return "shown only";
    if (this.axes.zoom) return "zoomed: drag the plot to move along, 0 shows all";
    if (!named && back) return `not part of undo; Reset takes ${back} again`;
    return `log histogram${note ? `, ${note}` : ""}`;
  }
}

export default widgetOf(TransferEditorView);
