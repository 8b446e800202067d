// The line under the editor's picture: counts, the legend of the regions, folds, and remarks or advice.

import { NEARLY_FOLDED } from "../generated.ts";
import { placeOf } from "../maths/cuts.ts";
import { formatLength } from "../maths/numbers.ts";
import type { Vector2 } from "../types.ts";
import { pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import type { EditorParts } from "./parts.ts";
import { REGION_FORMS } from "./shape_handles.ts";
import { formatValue } from "./window_tool.ts";

const FOLD_TIP =
  "the smallest factor by which the backward map stretches areas, from this picture to " +
  "the original. 1 keeps them; below 0 the picture folds over itself";

const VALUE_TIP =
  "the place under the pointer in the picture, and the grey value there, as it is in the picture " +
  "before the deformation at the place that is seen here";

/** Dependencies of the line on the editor. */
export type StatusEditor = EditorParts<
  "model" | "messages" | "stage" | "viewport" | "points" | "map" | "picture",
  "parts" | "modes" | "foldStop" | "shapes",
  "nodes"
>;

/** The line's elements and their texts. */
export class StatusLine {
  root: HTMLDivElement;
  slice: HTMLSpanElement;
  facts: HTMLSpanElement;
  legend: HTMLSpanElement;
  value: HTMLSpanElement;
  folds: HTMLSpanElement;
  legendKey = ""; // of the status shown

  constructor(readonly editor: StatusEditor) {
    this.root = pageElement("div", "dnb-ed-status", editor.stage.root);
    const state = pageElement("div", "dnb-ed-state", this.root); // one line, and below it the next step
    this.slice = pageElement("span", "dnb-ed-slice", state, { title: "the slice, and its depth from the middle" });
    this.facts = pageElement("span", "dnb-ed-facts", state);
    this.legend = pageElement("span", "dnb-ed-legend", state, { role: "img" });
    this.value = pageElement("span", "dnb-ed-value", state, { title: VALUE_TIP });
    this.folds = pageElement("span", "dnb-ed-folds", state);
    this.root.append(editor.messages.root);
  }

  /** Such as "slice 57 / 128, 12.0 mm"; empty where the picture is no slice. */
  get sliceWords() {
    const {
      picture: {
        slices: { current: slices },
      },
      model,
    } = this.editor;
    if (!slices) return "";
    const depth = (slices.first + slices.index * slices.spacing).toFixed(1),
      { lengths = "" } = model.get("raster");
    return `slice ${slices.index + 1} / ${slices.count}, ${depth} ${lengths}`.trim();
  }

  /**
   * Show the place under the pointer, and the grey value there.
   * @param at CSS pixels of the view; null for none
   */
  pointAt(at: Vector2 | null) {
    const {
      editor,
      editor: {
        picture: {
          painter: { source },
        },
        model,
      },
    } = this;
    const place = at && source ? editor.viewport.placeAt(at) : null,
      fit = at ? editor.map.fitAt(at) : null;
    if (!place || !source) {
      setText(this.value, "");
      return;
    }
    const [da, db] = fit ? placeOf(fit, place[0], place[1], source.raster.spacing[0]) : ([0, 0] as const);
    const value = source.valueAt([place[0] + da, place[1] + db]),
      { grey } = source;
    const { lengths = "" } = model.get("raster"),
      where = `${place.map(formatLength).join(", ")} ${lengths}`.trim();
    setText(
      this.value,
      value === null || !grey ? where : `${where}: ${formatValue(value, grey.range)} ${grey.unit}`.trim(),
    );
  }

  update() {
    setText(this.slice, this.sliceWords);
    const {
      points: { list: points, selected },
      tools: { shapes: shapeTools },
    } = this.editor;
    const off = points.filter((p) => !p.active).length;
    const count = `${points.length} ${points.length === 1 ? "point" : "points"}${off ? `, ${off} off` : ""}`;
    const one = selected.size === 1 ? points.find((p) => selected.has(p.id)) : null;
    const chosen = one
      ? `point ${this.editor.points.numberOf(one.id)}${one.name ? ` ${one.name}` : ""} at ${one.target.map(formatLength).join(", ")}`
      : selected.size
        ? `${selected.size} selected`
        : shapeTools.choice.name;
    this.#updateLegend();
    const facts = points.length || chosen ? [chosen, count].filter(Boolean).join(" \u00b7 ") : "No points yet";
    setText(this.facts, facts);
    setAttributes(this.facts, { title: facts }); // where it is cut off
    const folds = this.editor.map.folds ?? { least: 1, share: 0, air: 0 };
    this.#updateFolds(folds);
    this.#say(folds);
  }

  /** Say what is wrong with the map, or the next step. */
  #say(folds: { least: number }) {
    const {
      map: { layered, error },
      messages,
      tools: { foldStop },
      layers: { nodes: gridNodes },
    } = this.editor;
    const remarks = this.#isUntouched ? [] : (layered?.notes ?? []);
    messages.set("fit", error, { kind: "error" });
    messages.set("remarks", remarks.join("; "), { kind: folds.least <= 0 ? "warning" : "info" });
    messages.set("nodes", gridNodes.warning(folds), { kind: "warning" });
    messages.set("stop", foldStop.remark, { kind: "warning" });
    messages.set("advice", this.#advice(), { kind: "advice" });
  }

  #updateFolds({ least, share, air }: { least: number; share: number; air: number }) {
    const value = `min det J ${least.toFixed(2)}`;
    const much = share > 0 ? ` on ${(100 * share).toFixed(share < 0.1 ? 1 : 0)} %` : "";
    this.folds.classList.toggle("dnb-ed-bad", least <= 0);
    this.folds.classList.toggle("dnb-ed-near", least > 0 && least < NEARLY_FOLDED);
    const words =
      least <= 0
        ? `\u25b2 folds${much}`
        : least < NEARLY_FOLDED
          ? "\u25b2 nearly folds"
          : `\u2713 no folds${air > 0 ? " in tissue" : ""}`;
    const hasPoints = this.editor.points.list.length > 0;
    setText(this.folds, hasPoints ? words : "");
    const inAir =
      air > 0
        ? `\nThe map also folds in air, on ${(100 * air).toFixed(1)} % of the picture, where nothing is seen`
        : "";
    setAttributes(this.folds, { title: hasPoints ? `${value}: ${FOLD_TIP}${inAir}` : "" });
  }

  /** "2 regions: (disc) 4, (diamond) 3" where cuts part the picture. */
  #updateLegend() {
    const counts: Map<number, number> = new Map();
    for (const p of this.editor.points.list) {
      const mark = this.editor.tools.shapes.markOf(p);
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
      pageElement("span", "", entry, {}, String(count));
    }
    setAttributes(this.legend, { "aria-label": `${counts.size} regions with points` });
  }

  /** Whether nothing is dragged or moved yet: the fit has nothing to report. */
  get #isUntouched() {
    const { list: points, shapes } = this.editor.points;
    return (
      points.every((p) => p.source.every((value, k) => value === p.target[k])) && shapes.parts.every((p) => !p.motion)
    );
  }

  /**
   * Advice on the next step, where there are no remarks. Two lines of the narrowest pane have 76 characters; the rest is
   * in the list of keys.
   */
  #advice() {
    const {
      points: { list: points, selected },
      model,
      tools: { modes, shapes: shapeTools, parts: partTools },
      layers: { nodes: gridNodes },
    } = this.editor;
    if (model.get("read_only")) return "These points are shown only";
    const start = this.#isUntouched ? "Double-click adds a point. " : "";
    if (modes.advice) return modes.advice;
    if (shapeTools.choice.isSide) return "The hatched half stays fixed. The arrows on the line swap the sides";
    if (partTools.isLimb) return "Drag the inside or the ring to turn it about the joint, the cross to move the joint";
    if (partTools.isOn) return "Drag the inside to move it, the ring to turn it, the cross to set its pivot";
    if (shapeTools.choice.canStop) return "Drag a corner, or an edge; double-click an end to stop the cut there";
    if (shapeTools.choice.shape) return "Drag a corner, or the middle of an edge for a new one; Delete removes it";
    if (gridNodes.isOn && selected.size === 0) return gridNodes.advice;
    if (selected.size === 0) {
      if (!points.length) return "Double-click adds a point: one moves the picture, two turn it, three bend it";
      return `${start}Drag a disc to move what is under it; ? for keys`;
    }
    return "Arrows move the selected points, Delete removes them, Home puts them back";
  }
}
