// The window of grey values: how a drag changes it, and the table by which it is shown.

import assert from "node:assert/strict";
import test from "node:test";
import { greyTable } from "../src/editor/painter.ts";
import { dragWindow, formatValue, windowWords } from "../src/editor/window_tool.ts";

const CT = [-1000, 3000];

/** @param {number[]} window */
const parts = ([low, high]) => ({ width: high - low, level: (low + high) / 2 });

test("to the right the window gets wider, upwards its level rises", () => {
  const was = parts([0, 80]),
    wider = parts(dragWindow([0, 80], [60, 0], CT));
  assert.ok(wider.width > was.width && wider.level === was.level);
  assert.ok(parts(dragWindow([0, 80], [-60, 0], CT)).width < was.width);
  const higher = parts(dragWindow([0, 80], [0, -60], CT));
  assert.ok(higher.level > was.level && higher.width === was.width);
  assert.deepEqual(dragWindow([0, 80], [0, 0], CT), [0, 80]);
});

test("a window always has a width, and a level within the values", () => {
  for (const by of [
    [-1e6, 0],
    [1e6, 0],
    [0, 1e6],
    [0, -1e6],
    [-1e6, 1e6],
  ]) {
    for (const range of [CT, [0, 255], [0, 1e-9], [-1e12, 1e12]]) {
      const { width, level } = parts(dragWindow([range[0], range[1]], by, range));
      assert.ok(width > 0 && width <= 4.001 * (range[1] - range[0]), `${by} ${range}`);
      assert.ok(level >= range[0] - 1e-9 * Math.abs(range[0]) && level <= range[1] * (1 + 1e-9), `${by} ${range}`);
    }
  }
});

test("width and level are shown in as many digits as tell values apart", () => {
  assert.equal(windowWords([0, 80], CT, "HU"), "window 80, level 40 HU");
  assert.equal(windowWords([0.125, 0.625], [0, 1], ""), "window 0.5, level 0.375");
  assert.equal(formatValue(40.123456, CT), 40);
  assert.equal(formatValue(40.123456, [0, 255]), 40.1);
});

test("a table shows values from black to white of the window", () => {
  const table = greyTable(255, [0, 255], [100, 200]);
  assert.deepEqual([table[0], table[100], table[150], table[200], table[255]], [0, 0, 128, 255, 255]);
  assert.deepEqual(
    [...greyTable(255, [0, 255], [0, 255])],
    Array.from({ length: 256 }, (_, k) => k),
  );
  const fine = greyTable(65535, CT, [0, 80]);
  assert.equal(fine.length, 65536);
  assert.ok(Math.abs(fine[Math.round((1040 / 4000) * 65535)] - 127.5) <= 1);
});
