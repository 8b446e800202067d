// The rigid parts of a step in space: which is chosen, their edits, and what each slice shows of them.

import { ShapeEdits } from "../editor/shape_edits.ts";
import { namePlace } from "../editor/shape_handles.ts";
import { sameShapes } from "../maths/points.ts";
import { shapeName } from "../maths/shapes.ts";
import { partOnSlice, spaceMotionWords, spacePartsOf } from "../maths/space_parts.ts";
import { MOST_CHARACTERS } from "../sync/edits.ts";
import type { PaneInfo, PartData, ShapeData, ShapeKind, Shapes, SpacePart, SpacePoint } from "../types.ts";
import type { SpacePane } from "./pane.ts";
import { PartPen } from "./part_pen.ts";
import { SpacePartTools } from "./part_tools.ts";
import type { SpaceParts } from "./parts.ts";

/** Dependencies of the shapes on the editor. */
export type SpaceShapesEditor = SpaceParts<
  "model" | "sender" | "frames" | "messages" | "row" | "points" | "edits" | "cursor" | "names" | "foldStop" | "shapes"
>;

/** One of the three pictures. */
export interface PaneInSpace {
  readonly info: PaneInfo;
}

/** The parts of a list as they are seen in a picture. */
type Seen = { of: PartData[]; at: string; parts: PartData[] };

export class SpaceShapes extends ShapeEdits {
  /** The motion of the chosen part. */
  readonly moves: SpacePartTools;
  readonly pen: PartPen;
  #seen = new WeakMap<PaneInSpace, Seen>();

  constructor(readonly space: SpaceShapesEditor) {
    const { row: stage, ...editor } = space;
    super({ ...editor, stage }, (part) => spaceMotionWords(spacePartsOf([part])[0]!));
    this.moves = new SpacePartTools(space);
    this.pen = new PartPen(space);
  }

  get parts(): SpacePart[] {
    return spacePartsOf(this.space.points.shapes.parts);
  }

  /** The rigid part that is chosen, if it is switched on. */
  get own() {
    const { chosen } = this.choice,
      part = chosen?.what === "parts" ? this.parts[chosen.index] : null;
    return chosen && part?.enabled ? { part, index: chosen.index } : null;
  }

  edit(
    what: ShapeKind,
    shapes: ShapeData[],
    kind: string,
    { points = this.space.points.list, join = null }: { points?: SpacePoint[]; join?: string | null } = {},
  ) {
    const { messages, points: edited, sender } = this.space;
    if (edited.isLocked || sameShapes(shapes, sender.shapes[what])) return false;
    if (JSON.stringify(shapes).length > MOST_CHARACTERS) {
      messages.show("These shapes are too large to send.", true);
      return false;
    }
    sender.editShapes(what, shapes, kind, points, join); // which notifies all views
    return true;
  }

  rename(pane: SpacePane) {
    const { chosen, shape } = this.choice,
      { names, points, row } = this.space;
    if (points.isLocked || !chosen || !shape) return;
    const { what, index } = chosen,
      seen = this.onSlice(pane)[index];
    if (!seen) return;
    const [x, y] = namePlace(seen.region, null, pane.viewport.view, pane.parts.reach),
      box = row.element.getBoundingClientRect(),
      stage = pane.stage.getBoundingClientRect();
    names.prompt(
      shape.name,
      shapeName({ ...shape, name: "" }, what, index),
      [stage.left - box.left + x, stage.top - box.top + y],
      {
        take: (text) => this.setName(text),
        focus: () => {
          pane.parts.shapes.focus(chosen);
          return true;
        },
      },
    );
  }

  /** Take new lists; the chosen shape stays chosen, at any index. */
  follow(shapes: Shapes) {
    this.choice.follow(shapes);
    this.space.points.shapes = shapes;
    this.choice.receive();
  }

  /** The parts as they are seen in a picture: none of the whole volume. */
  onSlice(pane: PaneInSpace): PartData[] {
    const { cursor, model, points } = this.space;
    if (!cursor.isSlice) return [];
    const isBefore = Boolean(model.get("shows_original")),
      depth = cursor.depthIn(pane.info),
      at = JSON.stringify([pane.info, depth, isBefore]),
      of = points.shapes.parts,
      last = this.#seen.get(pane);
    if (last?.of === of && last.at === at) return last.parts;
    const parts = this.parts.map((part, k) => {
      if (last?.at === at && last.of[k] === of[k]) return last.parts[k]!;
      return partOnSlice(isBefore ? { ...part, motion: null } : part, pane.info, depth);
    });
    this.#seen.set(pane, { of, at, parts });
    return parts;
  }
}
