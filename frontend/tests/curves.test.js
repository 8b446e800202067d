// Curves through nodes, and edits of them.

import assert from "node:assert/strict";
import test from "node:test";
import { addNode, curveThrough, formatNumber, moveNode, removeNode, ticksOf } from "../src/maths/curves.ts";

const TENT = [
  [0, 0],
  [0.25, 1],
  [1, -0.5],
];

test("nodes stay between their neighbours and on the grid", () => {
  const rules = { x: [0, 1], y: [-1, 1.5], step: 1 / 128, gap: 1 / 128, isPinned: true, most: 4 };
  const free = { ...rules, isPinned: false },
    before = structuredClone(TENT);
  assert.deepEqual(moveNode(TENT, 1, [0.501, 9], rules)[1], [0.5, 1.5]);
  assert.deepEqual(moveNode(TENT, 1, [7, -9], rules)[1], [127 / 128, -1]);
  assert.deepEqual(moveNode(TENT, 1, [-7, 0], rules)[1], [1 / 128, 0]);
  assert.deepEqual(moveNode(TENT, 0, [0.4, 0.7], rules)[0], [0, 0.7]);
  assert.deepEqual(moveNode(TENT, 2, [0.4, 0.7], free)[2], [51 / 128, 0.7]);
  assert.deepEqual(addNode(TENT, [0.7, 0.1], rules), [[TENT[0], TENT[1], [90 / 128, 0.1], TENT[2]], 2]);
  assert.equal(addNode(TENT, [0.2501, 0.1], rules), null);
  assert.equal(addNode([...TENT, [1, 1]], [0.7, 0.1], rules), null);
  assert.deepEqual(removeNode(TENT, 1, rules), [TENT[0], TENT[2]]);
  assert.equal(removeNode(TENT, 0, rules), null);
  assert.equal(removeNode(TENT, 0, free).length, 2);
  assert.deepEqual(TENT, before);
});

test("a step in the opacities is drawn as one", () => {
  assert.deepEqual(
    [4.9, 5, 5.1, -9, 99].map(
      curveThrough([
        [0, 0],
        [5, 0],
        [5, 1],
        [9, 1],
      ]),
    ),
    [0, 1, 1, 0, 1],
  );
});

test("ticks are round", () => {
  const ticks = (low, high, count) => ticksOf(low, high, count).map((x) => Number(x.toFixed(9)));
  assert.deepEqual(ticks(0, 1, 5), [0, 0.2, 0.4, 0.6, 0.8, 1]);
  assert.deepEqual(ticks(-1024, 3071, 5), [-1000, 0, 1000, 2000, 3000]);
  assert.deepEqual(ticks(0.2, 0.21, 3), [0.2, 0.205, 0.21]);
});

test("numbers are short", () => {
  assert.deepEqual(
    [
      [-0.5, 2],
      [1234.567, 4000],
      [0.12345, 1],
      [5e7, 1e8],
    ].map(([x, range]) => formatNumber(x, range)),
    ["\u22120.5", "1235", "0.12", "5.00e+7"],
  );
});
