// The line under the editor's picture: counts, the legend of the regions, folds, and remarks or advice.

import { shownLength } from "../maths/numbers.js";
import { pageElement, setAttributes, setText, svgElement } from "../ui/dom.js";
import { NEARLY_FOLDED } from "./drawing.js";
import { REGION_FORMS } from "./shape_handles.js";

/** @import { EditorView } from "./editor.js" */

const FOLD_TIP = "the smallest factor by which areas are stretched on the way back from this picture to " +
  "the original. 1 keeps them; below 0 the picture folds over itself";

/** The line's elements and their texts. */
export class StatusLine {
  /** @param {EditorView} editor */
  constructor(editor) {
    this.editor = editor;
    const root = pageElement("div", "dnb-ed-status", editor.root);
    this.facts = pageElement("span", "dnb-ed-facts", root);
    this.legend = pageElement("span", "dnb-ed-legend", root, { role: "img" });
    this.folds = pageElement("span", "dnb-ed-folds", root);
    this.notes = pageElement("div", "dnb-ed-notes", root);
    this.legendKey = ""; // of what is shown
  }

  update() {
    const { points, selected, layered, error, pointTools, gridNodes, shapeTools } = this.editor;
    const off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one ? `point ${one.id}${one.name ? ` ${one.name}` : ""} at ${one.target.map(shownLength).join(", ")}`
      : selected.size ? `${selected.size} selected` : shapeTools.chosenLabel;
    this.#updateLegend();
    setText(this.facts, points.length ? [count, chosen].filter(Boolean).join(" \u00b7 ")
      : "No points yet: three or more bend the picture, one moves it, two turn and scale it");
    const folds = this.editor.folds ?? { least: 1, share: 0 };
    this.#updateFolds(folds);
    // The fit only suspects a fold; the editor has measured it.
    const remarks = (layered?.notes ?? []).filter((note) => folds.least <= 0 || !layered?.doubts.includes(note));
    const notes = error || pointTools.stopNote || gridNodes.warning(folds) || remarks.join("; ");
    setText(this.notes, notes || this.#advice());
    this.notes.classList.toggle("dnb-ed-bad", error !== "");
    this.notes.classList.toggle("dnb-ed-near", error === "" && notes !== "");
  }

  /** @param {{ least: number, share: number }} folds */
  #updateFolds({ least, share }) {
    const value = `min det J ${least.toFixed(2)}`;
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    this.folds.classList.toggle("dnb-ed-bad", least <= 0);
    this.folds.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const words = least <= 0 ? `\u25b2 folds${much}` : least < NEARLY_FOLDED ? "\u25b2 nearly folds"
      : "\u2713 no folds";
    const hasPoints = this.editor.points.length > 0;
    setText(this.folds, hasPoints ? words : "");
    setAttributes(this.folds, { title: hasPoints ? `${value}: ${FOLD_TIP}` : "" });
  }

  /** "2 regions: (disc) 4, (diamond) 3" where cuts part the picture. */
  #updateLegend() {
    /** @type {Map<number, number>} */
    const counts = new Map();
    for (const p of this.editor.points) {
      const mark = this.editor.shapeTools.markOf(p);
      if (mark !== null && p.active) counts.set(mark, (counts.get(mark) ?? 0) + 1);
    }
    const key = JSON.stringify([...counts]);
    if (key === this.legendKey) return;
    this.legendKey = key;
    this.legend.replaceChildren();
    for (const [mark, count] of [...counts].sort(([p], [q]) => p - q)) {
      const title = "points of this region: it bends by these only";
      const entry = pageElement("span", "dnb-ed-region", this.legend, { title });
      const icon = svgElement("svg", { viewBox: "-10 -10 20 20", "aria-hidden": "true", "data-region": mark }, entry);
      if (REGION_FORMS[mark]) svgElement("path", { d: REGION_FORMS[mark] }, icon);
      else svgElement("circle", { r: 7 }, icon);
      pageElement("span", "", entry).textContent = String(count);
    }
    setAttributes(this.legend, { "aria-label": `${counts.size} regions with points` });
  }

  /** Advice on the next step, where there are no remarks. */
  #advice() {
    const { points, selected, model, brush, pen, isSelecting, shapeTools, gridNodes } = this.editor;
    if (model.get("read_only")) return "These points are shown only";
    const isUntouched = points.every((p) => p.source.every((value, k) => value === p.target[k]));
    const start = isUntouched ? "Double-click adds a point. " : "";
    if (brush.isOn) {
      return "Drag in the picture; [ and ] or the wheel change the circle, Ctrl + wheel zooms, Escape ends";
    }
    if (isSelecting) return "Drag a band around points, or tap them; a second tap takes one out again; Escape ends";
    if (pen.isOn) return "Backspace takes the last place back, Escape gives up";
    if (shapeTools.chosenShape) {
      return "Drag corners, or the middle of an edge for a new one; Delete removes, F2 names, O switches off" +
        `${shapeTools.canTurn ? ", F turns it over" : ""}`;
    }
    if (gridNodes.isOn && selected.size === 0) return gridNodes.advice;
    if (selected.size === 0) return `${start}Drag a disc to move what lies under it; ? lists all keys`;
    return "Arrows move the selected points, Delete removes them, Home puts them back";
  }
}
