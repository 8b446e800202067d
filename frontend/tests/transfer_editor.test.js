// The window, the axis of values and the colour stops of the transfer editor.

import assert from "node:assert/strict";
import test from "node:test";
import { addStop, colorAt, hexOf, moveStop, moveWindow, rgbOf } from "../src/inputs/transfer_rows.ts";
import { panAxis, zoomAxis } from "../src/inputs/value_axes.ts";

test("the ends of a window keep apart and within limits", () => {
  for (const [part, by, wanted] of [
    ["low", 30, [30, 100]],
    ["low", -500, [-200, 100]],
    ["low", 95, [90, 100]],
    ["high", -95, [0, 10]],
    ["high", 900, [0, 300]],
    ["level", -500, [-200, -100]],
    ["level", 25, [25, 125]],
    ["level", 900, [200, 300]],
  ]) {
    assert.deepEqual(moveWindow([0, 100], part, by, 10, [-200, 300]), wanted);
  }
});

test("the axis of values zooms about a value and stays inside", () => {
  const whole = [-1000, 3000];
  assert.deepEqual(zoomAxis(whole, whole, 4, 0), [-250, 750]);
  assert.deepEqual(zoomAxis([-250, 750], whole, 2, 750), [250, 750]);
  assert.deepEqual(zoomAxis([0, 1000], whole, 9e9, 500), [496, 504]);
  assert.deepEqual(zoomAxis([-1000, 0], whole, 0.5, 0), [-1000, 1000]);
  assert.equal(zoomAxis([0, 1000], whole, 0.25, 0), null);
  assert.deepEqual(panAxis([0, 100], whole, -5000), [-1000, -900]);
  assert.deepEqual(panAxis([0, 100], whole, 40), [40, 140]);
});

test("colour stops keep their order and a new one changes nothing", () => {
  const stops = [
      [0, 1, 0, 0],
      [4, 0, 1, 0],
      [8, 0, 0, 1],
    ],
    before = structuredClone(stops);
  assert.deepEqual(moveStop(stops, 1, 7, [0, 9])[1], [7, 0, 1, 0]);
  assert.deepEqual(moveStop(stops, 1, -7, [0, 9])[1], [0, 0, 1, 0]);
  assert.deepEqual(moveStop(stops, 2, 99, [0, 9])[2], [9, 0, 0, 1]);
  assert.deepEqual(addStop(stops, 2), [[stops[0], [2, 0.5, 0.5, 0], ...stops.slice(1)], 1]);
  const [first, k] = addStop(stops, -1),
    [last, n] = addStop(stops, 8);
  assert.deepEqual([first[0], k, last[3], n], [[-1, 1, 0, 0], 0, [8, 0, 0, 1], 3]);
  assert.deepEqual(colorAt(stops, 3), [0.25, 0.75, 0]);
  assert.deepEqual(stops, before);
});

test("colours are written in hexadecimal digits", () => {
  assert.equal(hexOf([1, 0.5, -3]), "#ff8000");
  assert.deepEqual(rgbOf("#0080ff"), [0, 128 / 255, 1]);
});
