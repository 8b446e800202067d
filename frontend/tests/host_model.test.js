// The model of a host without Jupyter.

import assert from "node:assert/strict";
import test from "node:test";
import { PlainModel } from "../src/sync/host_model.ts";

test("changes are reported and saved once", () => {
  const events = [],
    saved = [],
    sent = [];
  const model = new PlainModel(
    { a: 1, b: 2 },
    { save: (state) => saved.push(state), deliver: (content, buffers) => sent.push([content, buffers.length]) },
  );
  const changed = () => events.push(["a", model.get("a")]);
  model.on("change:a", changed);
  model.on("change", () => events.push("any"));
  model.on("msg:custom", (content, buffers) => events.push([content, buffers.length]));
  model.set("a", 5);
  model.set("b", 2);
  model.save_changes();
  model.save_changes();
  model.update({ a: 6 });
  model.update({ a: 6 });
  model.off("change:a", changed);
  model.update({ a: 7 });
  model.receive({ type: "done" }, [1]);
  model.send({ type: "edit" });
  assert.deepEqual(events, [["a", 5], "any", ["a", 6], "any", "any", [{ type: "done" }, 1]]);
  assert.deepEqual(saved, [{ a: 5, b: 2 }]);
  assert.deepEqual(sent, [[{ type: "edit" }, 0]]);
});

test("a saved value takes precedence until it is answered", () => {
  const model = new PlainModel({ a: [0], b: 0 }, { isAnswered: true });
  let events = [];
  model.on("change:a", () => events.push(model.get("a")[0]));
  const save = (a) => {
    model.set("a", [a]);
    model.save_changes();
  };
  const expect = (wanted, a) => {
    assert.deepEqual([events, model.get("a")], [wanted, [a]]);
    events = [];
  };
  model.update({ a: [1] });
  save(2);
  model.update({ a: [1], b: 3 }); // on its way when ours was saved
  expect([1, 2], 2);
  assert.equal(model.get("b"), 3);
  save(4);
  model.confirm({ a: [2] }); // the first of two
  expect([4], 4);
  model.update({ a: [2] });
  model.confirm({ a: [4] });
  expect([], 4);
  model.update({ a: [5] });
  save(9);
  model.confirm({ a: [5] }); // refused
  expect([5, 9, 5], 5);
  save(6);
  model.set("a", [7]);
  model.confirm({ a: [6] }); // a change that is not saved yet is newer
  expect([6, 7], 7);
  model.save_changes();
  model.confirm({ a: [7] });
  model.update({ a: [8] });
  expect([8], 8);
});
