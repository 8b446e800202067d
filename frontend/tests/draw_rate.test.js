// The rate at which an editor draws during a drag.

import assert from "node:assert/strict";
import test from "node:test";
import { DrawRate } from "../src/editor/frames.ts";
import { Sender } from "../src/sync/edits.ts";

function measured(events) {
  const rate = new DrawRate();
  for (const [what, at] of events) rate[what](at);
  return rate.finish();
}

test("pictures of movements are counted and no others", () => {
  const events = Array.from({ length: 11 }, (_, k) => [
    ["recordMove", 20 * k],
    ["recordMove", 20 * k + 3],
    ["recordFrame", 20 * k + 8],
    ["recordFrame", 20 * k + 9],
  ]).flat();
  assert.deepEqual(measured(events), { hz: 50, ms: 8 });
});

test("a rest of the pointer is no slow picture", () => {
  const events = [0, 20, 40, 5000, 5020, 5040].flatMap((at) => [
    ["recordMove", at],
    ["recordFrame", at + 5],
  ]);
  assert.deepEqual(measured(events), { hz: 50, ms: 5 });
});

test("a short drag gives nothing, and the next begins anew", () => {
  assert.equal(
    measured(
      [0, 20, 40].flatMap((at) => [
        ["recordMove", at],
        ["recordFrame", at + 5],
      ]),
    ),
    null,
  );
  const rate = new DrawRate();
  for (let at = 0; at < 200; at += 20) {
    rate.recordMove(at);
    rate.recordFrame(at + 5);
  }
  assert.deepEqual([rate.finish(), rate.finish()], [{ hz: 50, ms: 5 }, null]);
});

test("it is sent with the next end of an edit only", () => {
  const sent = [],
    values = { points: [], cuts: [], parts: [], next_id: 0, seen: {}, history: {} };
  const model = { get: (name) => values[name], on() {}, off() {}, send: (message) => sent.push(message) };
  const sender = new Sender({ now: () => 0, later: () => 1, cancel() {} });
  sender.attach(model);
  const at = (x) => [
    { id: 0, name: "", source: [0, 0], target: [x, 0], active: true, weight: 1, locked: false, radius: null },
  ];
  sender.move(at(1));
  sender.drawn = { hz: 40, ms: 9 };
  sender.edit(at(2), "move");
  sender.edit(at(3), "move");
  assert.deepEqual(
    sent.map((m) => [m.phase, m.drawn ?? null]),
    [
      ["move", null],
      ["end", { hz: 40, ms: 9 }],
      ["end", null],
    ],
  );
});
