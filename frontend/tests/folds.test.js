// Folds of a map on a picture, and those of them where there is no tissue.

import assert from "node:assert/strict";
import test from "node:test";
import { NEARLY_FOLDED } from "../src/generated.ts";
import { layeredFit } from "../src/maths/cuts.ts";
import { detsOnRaster, foldsOf, probesOf } from "../src/maths/folds.ts";
import { newPoint } from "../src/maths/points.ts";
import { fieldAt } from "../src/maths/rigid_stages.ts";

const BOX = [0, 60, 0, 40];

/** A point dragged too far to the right, as in the example of deformnb/analysis/folds.py. */
function dragged() {
  return layeredFit([newPoint(1, [20, 20], [32, 20])], {
    kernel: "wendland_c2",
    trend: "none",
    support: 20,
    chosen_support: null,
    smoothing: 0,
    strength: 1,
    stages: 1,
  });
}

test("without tissue a fold is one in air, and what is left has none", () => {
  const fit = dragged(),
    all = foldsOf(fit, BOX, 33),
    none = foldsOf(fit, BOX, 33, probesOf(fit), () => false);
  assert.ok(all.least < -0.2 && all.share > 0);
  assert.equal(all.air, 0);
  assert.ok(none.least > NEARLY_FOLDED); // beside a fold the map nearly folds: that is in air as well
  assert.deepEqual([none.share, none.air], [0, all.share]);
});

test("a fold counts where it meets tissue", () => {
  const fit = dragged(),
    { place, share } = foldsOf(fit, BOX, 33);
  const near = foldsOf(fit, BOX, 33, probesOf(fit), (a, b) => Math.hypot(a - place[0], b - place[1]) < 1.2);
  assert.ok(near.least < 0);
  assert.ok(near.share < share);
  assert.ok(Math.abs(near.share + near.air - share) < 1e-12);
});

test("det J around a rigid part is that of differences of the map", () => {
  const points = [newPoint(1, [6, 6], [6, 6]), newPoint(2, [52, 8], [50, 11]), newPoint(3, [30, 36], [33, 34])],
    region = { kind: "polygon", vertices: [[20, 14], [34, 12], [36, 26], [21, 25]] }; // biome-ignore format: corners
  const turn = { matrix: [[0.94, -0.34], [0.34, 0.94]], shift: [8, -7] }; // biome-ignore format: a turn
  for (const settings of [{}, { support: 25, trend: "none" }]) {
    const layered = layeredFit(points, { ...settings, parts: [{ region, motion: turn }] }),
      [{ fit }] = layered.fits,
      raster = { shape: [21, 31], spacing: [2, 2], origin: [0, 0] };
    assert.ok(fit.rigid && fit.base.count > 0);
    const dets = detsOnRaster(layered, raster),
      h = 1e-4;
    let wrong = 0;
    dets.forEach((det, n) => {
      const [a, b] = [2 * (n % 31), 2 * Math.floor(n / 31)],
        at = (p, q) => fieldAt(fit, p, q).map((d, k) => d + (k ? q : p));
      const [east, west, south, north] = [at(a + h, b), at(a - h, b), at(a, b + h), at(a, b - h)];
      const slope = (one, other, k) => (one[k] - other[k]) / (2 * h);
      const expected = slope(east, west, 0) * slope(south, north, 1) - slope(south, north, 0) * slope(east, west, 1);
      if (Math.abs(det - expected) > 1e-3) wrong += 1;
    });
    assert.equal(wrong, 0);
    assert.ok(new Set([...dets].map((det) => det.toFixed(3))).size > 50);
  }
});
