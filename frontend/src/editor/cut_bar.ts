// The options of the chosen cut, in a bar over the picture: whether it stops at its ends, whether it opens in front only,
// points that pull it open, and points along it in its place: so an outline that was traced becomes points.
// The trait "front_only" is null without Python: then the depth is not offered.

import { newPoint } from "../maths/points.ts";
import { openingPlaces, placesAlong, stopsAt } from "../maths/shapes.ts";
import { setTrait } from "../sync/edits.ts";
import type { RegionData } from "../types.ts";
import { OptionBar } from "./option_bar.ts";
import type { EditorParts } from "./parts.ts";
export type LineRegion = Extract<RegionData, { vertices: number[][] }>;

const CLOSED_POINTS = 16,
  OPEN_POINTS = 9; // along a line that was traced
const NEAR = 0.05; // of the diagonal of the picture: a point so near holds the same as a further one

/** Dependencies of the bar on the editor. */
export type CutBarEditor = EditorParts<
  "model" | "frames" | "messages" | "stage" | "points" | "map" | "picture",
  "modes" | "points" | "shapes" | "bends"
>;

export class CutBar {
  bar: OptionBar;
  stops: HTMLInputElement;
  front: HTMLInputElement;
  pull: HTMLButtonElement;
  apart: HTMLButtonElement;

  constructor(readonly editor: CutBarEditor) {
    this.bar = new OptionBar(editor, "dnb-ed-options dnb-ed-cut-bar", "Chosen cut");
    this.stops = this.bar.checkbox(
      "Stop at the ends",
      "The cut stops at both ends; else it continues straight to the border",
      (isOn) => editor.tools.shapes.stopAtEnds(isOn),
    );
    this.front = this.bar.checkbox(
      "Front only",
      "The front of the volume comes apart, and the back stays as it is; " + "the group Depth has the curve",
      (isOn) => setTrait(editor.model, "front_only", isOn),
    );
    this.pull = this.bar.button(
      "Pull open",
      "Pull open",
      () => this.#pullOpen(),
      "Put a point on either side and pull them apart; points around them hold the rest",
    );
    this.apart = this.bar.button(
      "Move apart rigidly",
      "Move apart rigidly",
      () => {
        const line = this.#line;
        if (line?.kind === "line") editor.tools.bends.moveApart(line);
        editor.stage.focus();
      },
      "Either side moves away from the cut as a whole, unbent",
    );
    this.bar.button(
      "Make points",
      "Make points",
      () => this.#makePoints(),
      "Points along the line, in its place: an outline that was traced becomes points to drag",
    );
  }

  /** The line of the chosen cut; null where it is closed, or none is chosen. */
  get #line(): RegionData | null {
    return this.editor.tools.shapes.choice.canStop ? (this.editor.tools.shapes.choice.shape?.region ?? null) : null;
  }

  /** The chosen cut if it is a line, open or closed. */
  get #outline(): LineRegion | null {
    const { chosen, shape: chosenShape } = this.editor.tools.shapes.choice,
      region = chosen?.what === "cuts" ? chosenShape?.region : null;
    return region?.kind === "line" || region?.kind === "polygon" ? region : null;
  }

  show() {
    const { editor } = this,
      region = this.#line,
      isFront = editor.model.get("front_only");
    const isBusy = editor.tools.modes.activeTool !== undefined || editor.points.isLocked || editor.picture.isBefore;
    this.bar.element.hidden = !this.#outline || isBusy;
    const isOpen = region?.kind === "line";
    for (const part of [this.stops.parentElement, this.pull, this.apart]) part?.toggleAttribute("hidden", !isOpen);
    this.front.parentElement?.toggleAttribute("hidden", !isOpen || typeof isFront !== "boolean");
    if (this.bar.element.hidden || !isOpen) return;
    this.stops.checked = Boolean(stopsAt(region, 0) && stopsAt(region, region.vertices.length - 1));
    this.front.checked = isFront === true;
  }

  #makePoints() {
    const { editor } = this,
      { points: pointTools, shapes: shapeTools } = editor.tools,
      region = this.#outline;
    if (!region) return;
    const made = [...editor.points.list],
      isClosed = region.kind === "polygon";
    let id = editor.points.nextId(),
      count = 0;
    for (const place of placesAlong(region.vertices, isClosed ? CLOSED_POINTS : OPEN_POINTS, isClosed)) {
      const source = editor.map.visiblePlace(place);
      if (source !== null) made.push(newPoint(id++, source, place, `outline ${++count}`));
    }
    if (!pointTools.edit(made, "add")) return;
    shapeTools.remove();
    editor.messages.announce(`${count} points along the line, in its place`);
    editor.messages.hint("Drag the points; Undo brings the line back", 4000);
  }

  #pullOpen() {
    const { editor } = this,
      { points: pointTools } = editor.tools,
      region = this.#line,
      [a0, a1, b0, b1] = editor.picture.box;
    if (region?.kind !== "line") return;
    const { pulled, held } = openingPlaces(region.vertices, editor.picture.box),
      near = NEAR * Math.hypot(a1 - a0, b1 - b0);
    const made = [...editor.points.list];
    let id = editor.points.nextId();
    for (const { from, to } of pulled) {
      const source = editor.map.visiblePlace(from);
      if (source === null) {
        editor.messages.hint("It is open already: drag its points to pull further", 4000);
        return;
      }
      made.push(newPoint(id++, source, to));
    }
    for (const place of held) {
      const source = editor.map.visiblePlace(place);
      const isNear = editor.points.list.some(({ target: [a, b] }) => Math.hypot(a - place[0], b - place[1]) < near);
      if (source !== null && !isNear) made.push(newPoint(id, source, place, `hold ${id++}`));
    }
    if (!pointTools.edit(made, "open")) return;
    editor.messages.announce("pulled open by two points");
    editor.messages.hint("Drag the two points to open it further", 4000);
  }
}
