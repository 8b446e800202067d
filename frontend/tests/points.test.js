// Edits of points.

import assert from "node:assert/strict";
import test from "node:test";
import {
  addPoint,
  cleanPoints,
  newPoint,
  nextId,
  removePoints,
  renamePoint,
  resetPoints,
  togglePoints,
  translatePoints,
} from "../src/maths/points.ts";

const points = [0, 1, 2, 3].map((k) => newPoint(k, [10 * k, 5 * k], [10 * k + 1, 7 * k]));
const targets = points.map((p) => p.target),
  sources = points.map((p) => p.source);
const before = JSON.stringify(points);

test.after(() => assert.equal(JSON.stringify(points), before, "an edit has changed the list that it was given"));

test("targets, sources or whole points are moved", () => {
  const moved = translatePoints(points, [1, 3], 5, -2);
  assert.deepEqual(
    moved.map((p) => p.target),
    [targets[0], [targets[1][0] + 5, targets[1][1] - 2], targets[2], [targets[3][0] + 5, targets[3][1] - 2]],
  );
  assert.deepEqual(
    moved.map((p) => p.source),
    sources,
  );
  const [both] = translatePoints(points, [0], 1, 1, "both");
  assert.deepEqual(
    [both.source, both.target],
    [
      [1, 1],
      [2, 1],
    ],
  );
  const taken = translatePoints(points, [2], 3, 0, "source");
  assert.deepEqual(
    taken.map((p) => p.target),
    targets,
  );
  assert.deepEqual(taken[2].source, [23, 10]);
  assert.deepEqual(
    resetPoints(points, [3]).map((p) => p.target),
    [...targets.slice(0, 3), sources[3]],
  );
});

test("points are removed, added and named", () => {
  assert.deepEqual(
    removePoints(points, [0, 2]).map((p) => p.id),
    [1, 3],
  );
  assert.equal(renamePoint(points, 2, "  fin ")[2].name, "fin");
  assert.deepEqual(addPoint(points, 9, [1, 2], [3, 4])[4], {
    id: 9,
    name: "",
    source: [1, 2],
    target: [3, 4],
    active: true,
    weight: 1,
    locked: false,
    radius: null,
  });
  assert.equal(nextId(points, 7), 7);
  assert.equal(nextId(points, 2), 4);
});

test("points are switched off, and on only where all are off", () => {
  const active = (list) => list.map((p) => p.active),
    off = togglePoints(points, [1]);
  assert.deepEqual(active(off), [true, false, true, true]);
  assert.deepEqual(active(togglePoints(off, [1])), [true, true, true, true]);
  assert.deepEqual(active(togglePoints(off, [0, 1])), [false, false, true, true]);
});

test("points from anywhere are cleaned", () => {
  assert.deepEqual(cleanPoints(null), []);
  const good = {
    id: 4,
    name: "",
    source: [1, 2],
    target: [3, 4],
    active: true,
    weight: 1,
    locked: false,
    radius: null,
  };
  assert.deepEqual(
    cleanPoints([
      3,
      null,
      { id: 1, source: [1, 2] },
      { id: 0.5, source: [1, 2], target: [1, 2] },
      { id: 4, source: [1, 2], target: [3, 4], weight: -1 },
      { id: 4, source: [1, 2], target: [3, 4] },
      { id: 5, source: [1, NaN], target: [3, 4] },
    ]),
    [good],
  );
});
