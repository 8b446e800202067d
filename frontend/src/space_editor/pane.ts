// One of the three pictures: its pixels, the cross-hair of the other two, and the points in it.

import type { Band } from "../editor/gesture.ts";
import { Handles, ToolMarks } from "../editor/handles.ts";
import { Viewport } from "../editor/viewport.ts";
import { dot, scaled, sideOf } from "../maths/camera.ts";
import { clearness, flatPoint, fromPane, spaceLabel, spaceTip, toPane } from "../maths/space.ts";
import type { FlatPoint, PaneInfo, SpacePoint, Vector2, Vector3 } from "../types.ts";
import { buttonElement, OWN_KEYS, pageElement, setAttributes, setText, svgElement } from "../ui/dom.ts";
import { ScaleBar } from "../ui/view_parts.ts";
import { PaneImage } from "./pane_image.ts";
import { PaneMap } from "./pane_map.ts";
import { LINES, type Line, PaneMarks } from "./pane_marks.ts";
import { PaneRigidParts } from "./pane_parts.ts";
import type { SpaceParts } from "./parts.ts";

const MOST_LABELS = 10; // of points off the slice; of more, only the chosen and the pointed at show their distance
const PANE_MARGIN = 8; // CSS pixels around the picture

/** Dependencies of a picture on the editor. */
export type PaneEditor = SpaceParts<
  | "model"
  | "frames"
  | "theme"
  | "row"
  | "points"
  | "map"
  | "tools"
  | "strokes"
  | "modes"
  | "cursor"
  | "status"
  | "shapes"
>;

export class SpacePane {
  root: HTMLDivElement;
  head: { title: HTMLButtonElement; place: HTMLSpanElement; letters: HTMLSpanElement[]; scale: ScaleBar };
  stage: HTMLDivElement;
  image: PaneImage;
  map: PaneMap;
  svg: SVGSVGElement;
  overlay: PaneMarks;
  parts: PaneRigidParts;
  handles: Handles<FlatPoint>;
  marks: ToolMarks;
  slider: HTMLInputElement;
  viewport: Viewport;

  /** Points as they are drawn in this picture, at this depth. */
  #flat = { at: "", points: new WeakMap<SpacePoint, FlatPoint>() };

  constructor(
    readonly editor: PaneEditor,
    readonly index: number,
  ) {
    const { cursor, frames } = editor;
    this.root = pageElement("div", `dnb-sp-pane dnb-sp-pane${index}`, editor.row.element, { role: "group" });
    const head = pageElement("div", "dnb-sp-head", this.root);
    this.stage = pageElement("div", "dnb-ed-stage dnb-sp-stage", this.root, {
      tabindex: "0",
      role: "application",
      ...OWN_KEYS,
    });
    this.image = new PaneImage(this.stage);
    this.map = new PaneMap(editor, this.stage);
    this.svg = svgElement("svg", { class: "dnb-ed-svg" }, this.stage);
    this.overlay = new PaneMarks(this.svg);
    this.parts = new PaneRigidParts(editor, this);
    this.handles = new Handles(this.svg, (id) => editor.points.numberOf(id), { label: spaceLabel, tip: spaceTip });
    this.marks = new ToolMarks(this.svg, this.handles.points);
    this.head = {
      title: buttonElement("dnb-sp-title", head, "", () => frames.guard(() => editor.row.enlarge(index))),
      place: pageElement("span", "dnb-sp-place", head),
      letters: ["left", "right", "top", "bottom"].map((side) =>
        pageElement("span", `dnb-sp-letter dnb-sp-${side}`, this.stage, { "aria-hidden": "true" }),
      ),
      scale: new ScaleBar(this.stage),
    };
    this.slider = pageElement("input", "dnb-sp-slider", this.root, { type: "range", ...OWN_KEYS });
    frames.listen(this.slider, "input", () => cursor.setDepth(this.info, Number(this.slider.value)));
    frames.listen(this.slider, "change", () => cursor.rest());
    this.viewport = new Viewport(frames, () => this.info.box, PANE_MARGIN);
  }

  get info(): PaneInfo {
    return this.editor.cursor.panes[this.index]!;
  }

  /** The number of the picture that a line represents, by the direction of a or b in this picture. */
  #crossing(name: Line) {
    const along = name === "v" ? this.info.u : this.info.v;
    return this.editor.row.panes.find((other) => Math.abs(dot(other.info.n, along)) > 0.9)?.index;
  }

  describe() {
    const { name, u, v, depths, spacing } = this.info,
      { isSlice } = this.editor.cursor,
      depth = this.editor.cursor.depthIn(this.info);
    setText(this.head.title, name);
    const isLarge = this.editor.model.get("large_slice") === this.index;
    setAttributes(this.head.title, {
      "aria-pressed": String(isLarge),
      title: isLarge ? "Show the three slices at one size" : "Show this slice large",
    });
    this.root.setAttribute("aria-label", `${name} picture`);
    this.stage.setAttribute(
      "aria-label",
      `${name} picture with control points. Arrows move the selected points, or ` +
        "the cross-hair; page up and down go through the slices; question mark lists the keys.",
    );
    [scaled(u, -1), u, scaled(v, -1), v].forEach((way, k) => {
      setText(this.head.letters[k]!, sideOf(way, this.info.anatomical));
    });
    setAttributes(this.slider, { min: depths[0], max: depths[1], step: spacing[2], "aria-label": `${name} slice` });
    this.slider.hidden = !isSlice;
    const count = Math.round((depths[1] - depths[0]) / spacing[2]) + 1;
    const number = Math.round((depth - depths[0]) / spacing[2]) + 1;
    const isHeld = document.activeElement === this.slider && Number(this.slider.value) === depth;
    if (!isHeld) this.slider.value = String(depth);
    setText(this.head.place, isSlice ? `${number} / ${count}` : "whole volume");
    this.slider.setAttribute("aria-valuetext", `slice ${number} of ${count}`);
  }

  layout(width: number, height: number) {
    const ratio = Math.min(2, Math.max(1, window.devicePixelRatio || 1));
    this.stage.style.height = `${height}px`;
    for (const layer of [this.image, this.map]) layer.resize(Math.round(width * ratio), Math.round(height * ratio));
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.viewport.resize(width, height, ratio);
  }

  /** The value of the volume under a place of the view; null beyond the picture and for colours. */
  valueAt(at: Vector2) {
    const { window } = this.editor.status.facts,
      [a, b] = this.viewport.placeAt(at),
      grey = this.isInside(at) && this.editor.cursor.isSlice ? this.image.greyAt(a, b) : null;
    return grey === null || !window ? null : { grey, value: window[0] + (grey / 255) * (window[1] - window[0]) };
  }

  // ---- places -------------------------------------------------------------------------------------------------------

  /** Bring a place into the middle of the view, if the picture is not fully visible. */
  lookAt(place: Vector3) {
    const [x, y] = this.toView(place),
      { isFitted, view } = this.viewport;
    if (!isFitted) this.viewport.panBy(view.width / 2 - x, view.height / 2 - y);
  }

  /** The place of the view at a place in space. */
  toView(place: Vector3) {
    const [a, b] = toPane(this.info, place);
    return this.viewport.toView([a, b]);
  }

  /** The place in space under a place of the view: on the slice, or the visible tissue there of the whole volume. */
  under(at: Vector2) {
    const [a, b] = this.viewport.placeAt(at),
      { cursor } = this.editor,
      depth = cursor.depthIn(this.info);
    return fromPane(this.info, [a, b, cursor.isSlice ? depth : (this.image.depthAt(a, b) ?? depth)]);
  }

  isInside(at: Vector2) {
    const [a, b] = this.viewport.placeAt(at),
      [a0, a1, b0, b1] = this.info.box;
    return a >= a0 && a <= a1 && b >= b0 && b <= b1;
  }

  /**
   * The points as they are in this picture; those that have not moved since the last frame are the same objects, not
   * drawn again.
   */
  flatPoints() {
    const { cursor, points } = this.editor,
      { info } = this,
      depth = cursor.isSlice ? cursor.depthIn(info) : null,
      at = JSON.stringify([info, depth, points.list.length]); // of which the numbers depend
    if (at !== this.#flat.at) this.#flat = { at, points: new WeakMap() };
    return points.list.map((p, k) => {
      const made = this.#flat.points.get(p) ?? flatPoint(p, info, depth, k + 1);
      this.#flat.points.set(p, made);
      return made;
    });
  }

  /** The ids of the points in a rectangle of the view; on slices of those near the slice only. */
  pointsInside(band: Band) {
    return this.flatPoints()
      .filter(({ target, isFar }) => !isFar && this.viewport.isInside(target, band))
      .map((p) => p.id);
  }

  /** Move the cross-hair to a place of the view: all of it, or one line only. */
  moveCross(at: Vector2, line: Line | null, isMoving: boolean) {
    const { cursor } = this.editor,
      [a, b] = this.viewport.placeAt(at),
      [a0, b0, c0] = toPane(this.info, cursor.place);
    const isFlat = cursor.isSlice || line; // of the whole volume: the visible tissue there
    const place = fromPane(this.info, [line === "h" ? a0 : a, line === "v" ? b0 : b, c0]);
    cursor.set(isFlat ? place : this.under(at), isMoving);
  }

  // ---- drawing ------------------------------------------------------------------------------------------------------

  /** Return whether the focus was on a point that is gone. */
  draw() {
    const { cursor, model, status, theme } = this.editor,
      { view } = this.viewport,
      { worst } = status;
    this.image.paint(view, theme.colours.stage);
    this.map.draw(view, this.info);
    this.head.scale.write({ height: view.height / view.k, bend: 0 }, this.editor.cursor.unit, view);
    this.describe();
    this.overlay.drawCross(
      this.toView(cursor.place),
      view,
      LINES.map((line) => this.#crossing(line)),
    );
    this.overlay.drawWorst(worst && this.toView(worst));
    this.overlay.drawNodes(model.get("snap") || 0, view, this.info);
    return [this.parts.draw(view), this.#drawPoints()].some(Boolean);
  }

  #drawPoints(): boolean {
    const { info } = this,
      flat = this.flatPoints(),
      thick = info.box[5] - info.box[4];
    flat.sort((p, q) => Number(q.isFar) - Number(p.isFar)); // those on the slice are drawn last and grabbed first
    this.svg.classList.toggle("dnb-sp-many", flat.filter((p) => p.isFar).length > MOST_LABELS);
    const isFocusLost = this.handles.update(flat, this.editor.points.selected, this.viewport.view, 0, 0);
    for (const p of flat) {
      const parts = this.handles.byId.get(p.id);
      if (!parts) continue;
      for (const part of [parts.target, parts.source, parts.arrow]) {
        part.classList.toggle("dnb-sp-far", p.isFar);
        part.style.opacity = p.isFar ? String(clearness(p.away, thick)) : "";
      }
    }
    this.#drawMarks(flat);
    return isFocusLost;
  }

  /** Draw the handle that turns, and the plane of the mirror where it is seen from its edge. */
  #drawMarks(flat: FlatPoint[]) {
    const { modes, points, strokes, tools } = this.editor,
      { viewport } = this,
      none = { isOn: false };
    this.marks.update({
      mirror: tools.mirrorIn(this.info) ?? { on: false, axis: "a", at: 0 },
      view: viewport.view,
      gripAway: 34,
      points: flat,
      selected: points.selected.size > 1 ? points.selected : new Set<number>(), // one point has nothing to turn
      brush: strokes.circleIn(this),
      pen: none,
      isLocked: points.isLocked,
      isHolding: points.isDragging,
      isAdding: modes.isAdding,
      toView: (place) => viewport.toView(place),
    });
  }
}
