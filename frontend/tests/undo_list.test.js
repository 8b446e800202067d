// What Ctrl+Z takes back on a page.

import assert from "node:assert/strict";
import test from "node:test";
import { History } from "../src/sync/undo_list.ts";

test("undo goes back to the start and redo to the end", () => {
  const history = new History(3),
    seen = [];
  for (let k = 0; k < 5; k++) history.record(k, null, 5000 * k);
  for (const way of ["undo", "redo"]) {
    let state = history[way](seen.at(-1) ?? 5);
    for (; state !== null; state = history[way](state)) seen.push(state);
  }
  assert.deepEqual(seen, [4, 3, 2, 3, 4, 5]); // the oldest two are forgotten
  history.undo(5);
  history.record(99);
  assert.equal(history.redo(0), null);
});

test("quick steps of one kind are undone as one", () => {
  const history = new History();
  const steps = [
    ["nudge 1", 0],
    ["nudge 1", 100],
    ["nudge 1", 500],
    ["nudge 2", 600],
    ["nudge 2", 5000],
    [null, 5001],
    [null, 5002],
  ];
  for (const [k, [kind, at]] of steps.entries()) history.record(k, kind, at);
  assert.deepEqual(history.past, [0, 3, 4, 5, 6]);
});
