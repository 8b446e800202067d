// Folds of a map on a picture, and those of them where there is no tissue.

import assert from "node:assert/strict";
import test from "node:test";
import { NEARLY_FOLDED } from "../src/generated.ts";
import { layeredFit } from "../src/maths/cuts.ts";
import { foldsOf, probesOf } from "../src/maths/folds.ts";
import { newPoint } from "../src/maths/points.ts";

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
