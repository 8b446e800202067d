// Strokes of a brush.

import assert from "node:assert/strict";
import test from "node:test";
import { pictureFrame, Stroke } from "../src/maths/brushes.ts";
import { newPoint } from "../src/maths/points.ts";

test("each stroke has a number of its own in the names of its points", () => {
  const named = (id, name) => newPoint(id, [90 + id, 90], [90 + id, 90], name);
  const stroke = (points, tool) =>
    new Stroke(
      points,
      [20, 20],
      10,
      { tool, id: 7 },
      { sourceAt: () => (place) => place, frame: pictureFrame([0, 100, 0, 100]), reach: 0, settle: (place) => place },
    );
  const first = stroke([], "move");
  assert.equal(first.name, "move 1");
  assert.equal(first.points.find((p) => p.id === first.held).name, "move 1");
  const others = [named(0, "grow 2"), named(1, "move 4"), named(2, "jaw 9")];
  assert.equal(stroke(others, "grow").name, "grow 5");
});
