// The curve editor: f(z) over the depth, drawn with the pointer or given by a formula.

import type { CurveEditorToFrontEnd } from "../generated.ts";
import type { Node, NodeRules } from "../maths/curves.ts";
import { formatNumber } from "../maths/curves.ts";
import type { Model, Vector2 } from "../types.ts";
import { OWN_KEYS, pageElement, setAttributes, setText } from "../ui/dom.ts";
import { widgetOf } from "../ui/widget.ts";
import { CurvePlot } from "./curve_plot.ts";
import { PlotAxes } from "./plot_axes.ts";

/** The axis of depths, and heights at which places snap to 0 and 1. */
class DepthAxes extends PlotAxes {
  override snaps = [0, 1];

  override placeTicks() {
    return this.box.width < 560 ? [0, 0.25, 0.5, 0.75, 1] : super.placeTicks();
  }

  override endWords(): [string, string] {
    return ["0 front", "back 1"];
  }
}

class CurveEditorView extends CurvePlot {
  chooser: HTMLSelectElement;
  input: HTMLInputElement;
  smoother: HTMLButtonElement;

  isTyping = false;
  /** A formula that Python has not answered yet */
  sent: string | undefined = undefined;

  constructor(model: Model, el: HTMLElement) {
    super(model, el, "dnb-curve-editor", new DepthAxes());
    this.chooser = pageElement("select", "dnb-cv-select", this.bar, { "aria-label": "Ready-made curves", ...OWN_KEYS });
    pageElement("option", "", this.chooser, { value: "" }, "Own curve");
    for (const [name, formula] of Object.entries<string>(this.model.get("presets") ?? {})) {
      pageElement("option", "", this.chooser, { value: formula }, name.replace("-", "\u2212"));
    }
    const label = pageElement("label", "dnb-cv-formula", this.bar);
    pageElement("span", "", label, {}, "f(z) =");
    this.input = pageElement("input", "dnb-cv-input", label, {
      type: "text",
      maxlength: "200",
      spellcheck: "false",
      autocomplete: "off",
      autocapitalize: "off",
      "aria-label": "formula of the curve",
      ...OWN_KEYS,
    });
    const tip = "Round the lines between nodes";
    this.smoother = this.wordButton(this.bar, "Smooth", tip, () => this.toggleSmooth());
    this.bar.append(this.pair);
    this.listen(this.chooser, "change", () => {
      if (this.chooser.value) this.take(this.chooser.value);
      else this.invalidate();
    });
    this.listen(this.input, "change", () => this.take(this.input.value));
    this.listen(this.input, "input", () => {
      this.isTyping = true;
    });
    this.listen(this.input, "blur", () => {
      if (this.sent === undefined) this.isTyping = false;
      this.invalidate();
    });
    this.listen(this.input, "keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter" && this.isTyping) this.take(this.input.value);
      if (event.key === "Escape") this.forget();
    });
    this.onChange(["range", "height"], () => this.invalidate());
    this.start();
  }

  adopt(shown: { nodes: Node[]; samples: number[]; smooth: boolean; formula: string | null }) {
    this.nodes = shown.nodes;
    this.samples = shown.samples.length ? shown.samples : null;
    this.isSmooth = shown.smooth;
    this.named = shown.formula ?? "";
    this.axes.ends = this.ends();
  }

  toggleSmooth() {
    if (this.isReadOnly || this.samples) return;
    this.isSmooth = !this.isSmooth;
    this.commit();
  }

  /** Send a formula. Only Python can read it: until it has replied, the old curve is shown. */
  take(formula: string) {
    if (this.isReadOnly || formula.trim() === "") {
      this.forget();
      return;
    }
    // Enter dispatches both a key and a change.
    if ((!this.isTyping && formula === this.named) || formula === this.sent) return;
    this.settle();
    this.sent = formula;
    this.input.value = formula;
    this.isTyping = false;
    this.end({ formula });
  }

  override message(message: CurveEditorToFrontEnd) {
    super.message(message);
    const isOurs = !message.view || message.view === this.link.id;
    const isRefused = message.type === "error" && isOurs && this.sent !== undefined;
    if (isRefused) this.isTyping = true; // left in the field for correction
    const isAnswered = message.type === "done" && isOurs && message.seq === this.link.last;
    if (isAnswered && this.alert.hidden) this.sent = undefined;
    this.invalidate();
  }

  forget() {
    this.isTyping = false;
    this.sent = undefined;
    this.showMessage("");
    this.invalidate();
  }

  show(nodes: Node[], chosen: number) {
    super.show(nodes, chosen);
    this.forget();
  }

  value() {
    return { nodes: this.nodes, smooth: this.isSmooth };
  }

  // ---- the plot -----------------------------------------------------------------------------------------------------

  rules(): NodeRules {
    return { x: [0, 1], y: this.axes.ends[1], step: 1 / 128, gap: 1 / 128, isPinned: true, most: 64 };
  }

  ends(): [Vector2, Vector2] {
    const [low, high] = this.model.get("range");
    const seen = [...(this.samples ?? []), ...this.nodes.map((node) => node[1])];
    return [
      [0, 1],
      [Math.min(low, ...seen), Math.max(high, ...seen)],
    ];
  }

  words(k: number) {
    const [z, f] = this.nodes[k]!;
    return `z ${z.toFixed(2)}, f ${formatNumber(f, 1)}`;
  }

  describe() {
    super.describe();
    const { input, isReadOnly } = this;
    if (!this.isTyping && this.sent === undefined) {
      if (input.value !== this.named) input.value = this.named;
      this.chooser.value = this.named;
      if (this.chooser.selectedIndex < 0) this.chooser.value = "";
    }
    setAttributes(input, {
      placeholder: this.samples ? "values" : `${this.nodes.length} nodes`,
      "aria-invalid": !this.alert.hidden,
    });
    input.readOnly = this.chooser.disabled = isReadOnly;
    setAttributes(this.smoother, {
      "aria-pressed": this.isSmooth && !this.samples,
      "aria-disabled": isReadOnly || this.samples !== null,
    });
    if (this.samples) setText(this.facts, this.named ? "A formula" : "Values");
    setText(
      this.note,
      isReadOnly ? "shown only" : this.samples ? "drag a node to change it by hand" : "double click adds a node",
    );
  }
}

export default widgetOf(CurveEditorView);
