// The line under the editor's picture: counts, the legend of the regions, folds, and remarks or advice.

import { placeOf } from "../maths/cuts.js";
import { shownLength } from "../maths/numbers.js";
import { pageElement, setAttributes, setText, svgElement } from "../ui/dom.js";
import { NEARLY_FOLDED } from "./base.js";
import { REGION_FORMS } from "./shape_handles.js";
import { shownValue } from "./window_tool.js";

/** @import { EditorView } from "./editor.js" */

const FOLD_TIP = "the smallest factor by which areas are stretched on the way back from this picture to " +
  "the original. 1 keeps them; below 0 the picture folds over itself";

const VALUE_TIP = "the place under the pointer in the picture, and the grey value there, as it is in the picture " +
  "before the deformation at the place that is seen here";

/** The line's elements and their texts. */
export class StatusLine {
  /** @param {EditorView} editor */
  constructor(editor) {
    this.editor = editor;
    const root = pageElement("div", "dnb-ed-status", editor.root);
    this.slice = pageElement("span", "dnb-ed-slice", root, { title: "the slice, and its depth from the middle" });
    this.facts = pageElement("span", "dnb-ed-facts", root);
    this.legend = pageElement("span", "dnb-ed-legend", root, { role: "img" });
    this.value = pageElement("span", "dnb-ed-value", root, { title: VALUE_TIP });
    this.folds = pageElement("span", "dnb-ed-folds", root);
    this.notes = pageElement("div", "dnb-ed-notes", root);
    this.legendKey = ""; // of what is shown
  }

  /** Such as "slice 57 / 128, 12.0 mm"; empty where the picture is no slice. */
  get sliceWords() {
    const { slices, model } = this.editor;
    if (!slices) return "";
    const depth = (slices.first + slices.index * slices.spacing).toFixed(1), { lengths = "" } = model.get("raster");
    return `slice ${slices.index + 1} / ${slices.count}, ${depth} ${lengths}`.trim();
  }

  /**
   * Show the place under the pointer, and the grey value that is seen there.
   * @param {number[] | null} at CSS pixels of the view; null for none
   */
  pointAt(at) {
    const { editor, editor: { painter: { source }, model } } = this;
    const place = at && source ? editor.placeAt(at) : null, fit = at ? editor.fitAt(at) : null;
    if (!place || !source) { setText(this.value, ""); return; }
    const [da, db] = fit ? placeOf(fit, place[0], place[1], source.raster.spacing[0]) : [0, 0];
    const value = source.valueAt([place[0] + da, place[1] + db]), { grey } = source;
    const { lengths = "" } = model.get("raster"), where = `${place.map(shownLength).join(", ")} ${lengths}`.trim();
    setText(this.value, value === null || !grey ? where
      : `${where}: ${shownValue(value, grey.range)} ${grey.unit}`.trim());
  }

  update() {
    setText(this.slice, this.sliceWords);
    const { points, selected, layered, error, foldStop, gridNodes, shapeTools } = this.editor;
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
    const notes = error || foldStop.note || gridNodes.warning(folds) || remarks.join("; ");
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
    const { points, selected, model, brush, pen, wand, isSelecting, shapeTools, partTools, gridNodes } = this.editor;
    if (model.get("read_only")) return "These points are shown only";
    const isUntouched = points.every((p) => p.source.every((value, k) => value === p.target[k]));
    const start = isUntouched ? "Double-click adds a point. " : "";
    if (brush.isOn) {
      return "Drag in the picture; [ and ] or the wheel change the circle, Ctrl + wheel zooms, Escape ends";
    }
    if (wand.isOn) return "Click on what is to be selected; [ and ] change the tolerance, Escape ends";
    if (isSelecting) return "Drag a band around points, or tap them; a second tap takes one out again; Escape ends";
    if (pen.isOn) return "Backspace takes the last place back, Escape gives up";
    if (partTools.isOn) {
      return "Drag the inside to move it, the ring to turn it, the cross to set the pivot, corners and edges to " +
        "reshape it; Home puts it back";
    }
    if (shapeTools.chosenShape) {
      return "Drag corners, or the middle of an edge for a new one; Delete removes, F2 names, O switches off" +
        `${shapeTools.canTurn ? ", F turns it over" : ""}${shapeTools.canStop ? "; a double-click on an end stops it there"
          : ""}`;
    }
    if (gridNodes.isOn && selected.size === 0) return gridNodes.advice;
    if (selected.size === 0) return `${start}Drag a disc to move what lies under it; ? lists all keys`;
    return "Arrows move the selected points, Delete removes them, Home puts them back";
  }
}
