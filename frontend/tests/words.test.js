// Words of directions and lengths.

import assert from "node:assert/strict";
import test from "node:test";
import { sideOf } from "../src/maths/camera.ts";
import { lengthText } from "../src/ui/view_parts.ts";

test("the side of the patient is that of LPS", () => {
  for (const [vector, side] of [
    [[1, 0, 0], "L"],
    [[-1, 0, 0], "R"],
    [[0, 1, 0], "P"],
    [[0, -1, 0], "A"],
    [[0, 0, 1], "S"],
    [[0, 0, -1], "I"],
    [[0, 0.8, -0.6], "PI"],
    [[-0.6, 0, 0.8], "SR"],
    [[0.95, 0.3, 0], "L"],
  ]) {
    assert.equal(sideOf(vector), side);
  }
});

test("lengths have a unit that keeps them short", () => {
  for (const [length, unit, wanted] of [
    [50, "mm", "50 mm"],
    [20000, "mm", "20 m"],
    [0.05, "mm", "50 \u00b5m"],
    [0.2, "mm", "0.2 mm"],
    [5, "voxels", "5 voxels"],
    [50, "", "50"],
    [0.05, "nm", "50 pm"],
    [2e4, "\u00b5m", "20 mm"],
    [5e10, "nm", "50 m"],
    [2e4, "in", "20000 in"],
  ]) {
    assert.equal(lengthText(length, unit), wanted);
  }
});
