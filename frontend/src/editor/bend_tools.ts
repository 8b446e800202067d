// Straightening along a centre line, hinges, and halves of a cut that move apart: points, or two rigid parts.

import { distanceToLine, halfWidthAlong, straightenedPlaces } from "../maths/centre_line.ts";
import { hingeOutlines } from "../maths/hinge.ts";
import { cleanShapes, newPoint } from "../maths/points.ts";
import { clipToBox, cutSides, isInside, openingPlaces, placesAlong } from "../maths/shapes.ts";
import type { LineData, PicturePoint, Vector2 } from "../types.ts";
import type { MapState } from "./fold_stop.ts";
import type { EditorParts } from "./parts.ts";

const SIDES = ["one half", "other half"];
const NEAR = 0.03; // of the diagonal of the picture: a point so near holds the same
const WIDTH = 0.125; // of the length of the line: half the width where the picture does not show the subject

/** Dependencies of the tools on the editor. */
export type BendEditor = EditorParts<
  "model" | "messages" | "points" | "map" | "picture",
  "points" | "shapes" | "foldStop"
>;

export class BendTools {
  constructor(readonly editor: BendEditor) {}

  /** Half of the width of the subject along a line, from the picture. */
  #halfWidth(line: Vector2[]) {
    const { map, model } = this.editor,
      layered = map.layered,
      isTissue = layered ? map.tissueTest(layered) : undefined;
    let length = 0;
    for (let k = 1; k < line.length; k++) {
      length += Math.hypot(line[k]![0] - line[k - 1]![0], line[k]![1] - line[k - 1]![1]);
    }
    if (!isTissue) return WIDTH * length;
    return halfWidthAlong(line, isTissue, Math.min(...(model.get("raster").spacing as Vector2)));
  }

  /** Unbend what lies along a line: points along it, in the place of free points there and where it goes. */
  straighten(line: Vector2[]) {
    const { editor } = this,
      width = this.#halfWidth(line),
      pairs = shiftInto(editor.picture.sheet, straightenedPlaces(line, width));
    const straight = pairs.filter((_, k) => k % 3 === 1).map(({ to }) => to);
    const made: PicturePoint[] = editor.points.list.filter(
      ({ locked, target }) =>
        locked || Math.min(distanceToLine(line, target), distanceToLine(straight, target)) > 2 * width,
    );
    let id = editor.points.nextId(),
      count = 0;
    for (const { from, to } of pairs) {
      const source = editor.map.visiblePlace(from);
      if (source !== null) made.push(newPoint(id++, source, to, `line ${++count}`));
    }
    if (!editor.tools.points.edit(made, "straighten")) return;
    editor.messages.announce(`straightened by ${count} points along the line`);
    editor.messages.hint("Straight along your line; drag its points to adjust it, Undo brings it back", 5000);
  }

  /** Set two parts on either side of a pivot, and choose the one that turns. */
  hinge(pivot: Vector2, end: Vector2) {
    const { editor } = this,
      { shapes } = editor.tools,
      box = editor.picture.sheet,
      back: Vector2 = [2 * pivot[0] - end[0], 2 * pivot[1] - end[1]];
    const [turning, staying] = hingeOutlines(pivot, end, 1.15 * this.#halfWidth([back, end])).map((outline) => ({
      kind: "polygon" as const,
      vertices: clipToBox(outline, box),
    }));
    const parts = cleanShapes(
      [
        { region: turning!, name: "turns", pivot },
        { region: staying!, name: "stays" },
      ],
      "parts",
    );
    const before = editor.points.shapes.parts;
    if (!shapes.edit("parts", [...before, ...parts], "set a hinge")) return;
    shapes.choice.choose({ what: "parts", index: before.length });
    editor.messages.announce("A hinge: two rigid parts and a pivot");
    editor.messages.hint("Drag the side that turns about the pivot, or its ring", 6000);
  }

  /**
   * Move the two sides of a cut apart, as far as tissue folds nowhere: all points of a side by the same way, so that it
   * stays as it is. Of a cut that stops in the tissue a flap on either side does.
   */
  moveApart(region: LineData) {
    const { editor } = this,
      { foldStop, points: pointTools } = editor.tools,
      { box } = editor.picture,
      { pulled, held } = openingPlaces(region.vertices, box),
      isFlap = Boolean(region.stops?.some(Boolean)),
      sides = cutSides(region, box),
      all = [...editor.points.list],
      near = NEAR * Math.hypot(box[1] - box[0], box[3] - box[2]);
    let id = editor.points.nextId();
    const add = (place: Vector2, name: string) => {
      const source = editor.map.visiblePlace(place);
      if (source === null || all.some(({ target: [a, b] }) => Math.hypot(a - place[0], b - place[1]) < near)) return;
      all.push(newPoint(id, source, place, name || `hold ${id}`));
      id += 1;
    };
    for (const [k, side] of sides.entries()) {
      const { from, to } = pulled[k]!,
        size = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
      for (const { place, depth } of halfPlaces(region, [(to[0] - from[0]) / size, (to[1] - from[1]) / size])) {
        if (isInside(side, place)) add(place, `${SIDES[k]} ${depth}`);
      }
    }
    if (isFlap) for (const place of held) add(place, "");
    const owner = new Map(all.map((p) => [p.id, sides.findIndex((side) => isInside(side, p.source))]));
    const make = (share: number): MapState => ({
      shapes: editor.points.shapes,
      points: all.map((p) => {
        const way = p.locked ? undefined : pulled[owner.get(p.id)!],
          [a, b] = p.target;
        if (!way) return p;
        return { ...p, target: [a + share * (way.to[0] - way.from[0]), b + share * (way.to[1] - way.from[1])] };
      }),
    });
    foldStop.begin();
    if (!pointTools.edit(foldStop.limit(make).points, "apart")) return;
    editor.points.select([...owner].filter(([, side]) => side === 0).map(([one]) => one));
    editor.messages.announce("moved apart rigidly");
    editor.messages.hint("The points of one half are selected: drag one of them, or turn them by their handle", 6000);
    foldStop.end();
  }
}

/** The pairs with their targets moved back into a box, as far as they fit into it. */
function shiftInto([a0, a1, b0, b1]: readonly number[], pairs: { from: Vector2; to: Vector2 }[]) {
  const way = (c: 0 | 1, low: number, high: number) => {
    const values = pairs.map(({ to }) => to[c]),
      [least, most] = [Math.min(...values), Math.max(...values)];
    if (most - least > high - low) return (low + high - least - most) / 2;
    return Math.max(0, low - least) + Math.min(0, high - most);
  };
  const [da, db] = [way(0, a0!, a1!), way(1, b0!, b1!)];
  return pairs.map(({ from, to }) => ({ from, to: [to[0] + da, to[1] + db] as Vector2 }));
}

/** Places beside a cut on the side of a direction, near it and deeper: they determine the motion of a half. */
function halfPlaces({ vertices }: LineData, [u, v]: Vector2) {
  const line = placesAlong(vertices, 7, false),
    chord = Math.hypot(line[6]![0] - line[0]![0], line[6]![1] - line[0]![1]);
  return [1, 3, 5].flatMap((k, n) =>
    (k === 3 ? [0.06, 0.25] : [0.06]).map((share, m) => {
      const [a, b] = line[k]!;
      return { depth: n + 1 + 3 * m, place: [a + share * chord * u, b + share * chord * v] as Vector2 };
    }),
  );
}
