// The line below the pictures: points, folds, and a remark or a next step.

import { NEARLY_FOLDED } from "../generated.ts";
import { formatLength } from "../maths/numbers.ts";
import type { Vector2, Vector3 } from "../types.ts";
import { pageElement, setAttributes, setText } from "../ui/dom.ts";
import type { SpaceParts } from "./parts.ts";

const SPACE_FOLD_TIP =
  "Smallest factor by which volumes are stretched, on a coarse lattice: 1 keeps them; below 0 " +
  "the volume folds over itself";

/**
 * Remarks of Python: the least det J and the share of the volume that folds, the place where it folds most, a sentence.
 */
export type Facts = {
  folds?: [number, number] | null;
  worst?: Vector3 | null;
  note?: string;
  isBad?: boolean;
  /** The values that are black and white. */
  window?: Vector2;
};

export class SpaceStatus {
  facts: Facts = {};
  root: HTMLDivElement;
  #line: HTMLSpanElement;
  #folds: HTMLSpanElement;
  #value: HTMLSpanElement;

  constructor(
    readonly editor: SpaceParts<"model" | "messages" | "points" | "edits" | "brush" | "cursor" | "foldStop" | "shapes">,
    root: HTMLElement,
  ) {
    this.root = pageElement("div", "dnb-ed-status", root);
    const state = pageElement("div", "dnb-ed-state", this.root);
    this.#line = pageElement("span", "dnb-ed-facts", state);
    this.#folds = pageElement("span", "dnb-ed-folds", state);
    this.#value = pageElement("span", "dnb-ed-value", state);
    this.root.append(editor.messages.root);
  }

  /** Show the value under a pointer, whose ends are those of the window; null for none. */
  showValue(found: { grey: number; value: number } | null) {
    const sign = found?.grey === 0 ? "\u2264 " : found?.grey === 255 ? "\u2265 " : "";
    setText(this.#value, found ? `value ${sign}${formatLength(found.value)}` : "");
  }

  /** The place where the map folds most, found by Python when the points last rested; null where nothing folds. */
  get worst() {
    const { folds, worst = null } = this.facts;
    const { points, shapes } = this.editor;
    return points.list.length + shapes.parts.length > 0 && folds && folds[0] <= 0 ? worst : null;
  }

  update() {
    const { facts } = this,
      { edits, foldStop, messages, points, shapes } = this.editor,
      { list, selected } = points;
    const isFolded = (facts.folds?.[0] ?? 1) <= 0;
    messages.set("facts", facts.note ?? "", { kind: facts.isBad ? "error" : isFolded ? "warning" : "info" });
    messages.set("stop", foldStop.remark, { kind: "warning" });
    messages.set("advice", this.#advice(), { kind: "advice" });
    if (edits.isViewer) return;
    const off = list.filter((p) => !p.active).length,
      count = `${list.length} ${list.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`,
      one = selected.size === 1 ? list.find((p) => selected.has(p.id)) : null;
    const chosen = one
      ? `point ${points.numberOf(one.id)}${one.name ? ` ${one.name}` : ""} at ${one.target.map(formatLength).join(", ")}`
      : selected.size
        ? `${selected.size} selected`
        : shapes.choice.name;
    setText(
      this.#line,
      list.length || shapes.parts.length
        ? [count, chosen].filter(Boolean).join(" \u00b7 ")
        : "No points yet: four or more in space bend the volume, one moves it",
    );
    this.#updateFolds(list.length || shapes.parts.length ? facts.folds : null);
  }

  #updateFolds(folds: [number, number] | null | undefined) {
    const [least, share] = folds ?? [1, 0],
      value = `min det J ${least.toFixed(2)}`;
    this.#folds.classList.toggle("dnb-ed-bad", least <= 0);
    this.#folds.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    const words =
      least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds" : "\u2713 no folds";
    setText(this.#folds, folds ? words : "");
    setAttributes(this.#folds, { title: folds ? `${value}. ${SPACE_FOLD_TIP}` : "" });
  }

  /** A next step for the user, where there is nothing to remark. */
  #advice() {
    const { brush, cursor, edits, model, points, shapes } = this.editor;
    if (edits.isViewer) return "Click or drag the cross-hair; the wheel goes through the slices";
    if (model.get("read_only")) return "These points are shown only";
    if (brush.isOn) return brush.advice;
    if (shapes.pen.isOn) return shapes.pen.advice;
    if (shapes.own) return "Drag inside the part to move it, its ring to turn it; Home puts it back, Delete removes it";
    if (points.list.length === 0) {
      return "Double-click adds a point; a click brings the slices there; ? for keys";
    }
    if (points.selected.size === 0) {
      const wheel = cursor.isSlice ? "goes through the slices" : "zooms";
      return `Drag a disc to move what is under it; the wheel ${wheel}; ? for keys`;
    }
    return "Arrows move the selected points, J brings the slices to them, Delete removes them, Home puts them back";
  }
}
