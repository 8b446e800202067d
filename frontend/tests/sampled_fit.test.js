// The grid of a drag is traced on the raster of its picture: as near to that of the fit as half a pixel of the screen.

import assert from "node:assert/strict";
import test from "node:test";
import { layeredFit } from "../src/maths/cuts.ts";
import { fieldAt, fieldOnRaster } from "../src/maths/rigid_stages.ts";
import { clampedFits, sampledFits, sampledWithSlope } from "../src/maths/sampled_fit.ts";
import { deformedGrid, fieldWithSlope } from "../src/maths/warp_map.ts";

const SCALE = 1.6,
  PIXELS = 8; // CSS pixels for a unit of the picture, and between the nodes
const BOX = [0, 256, 0, 256],
  CELLS = 16;

/** A raster over the box. @param {number} step */
const rasterOf = (step) => {
  const count = Math.ceil(256 / step) + 1;
  return { shape: [count, count], spacing: [step, step], origin: [0, 0] };
};

test("any quadratic field and its slopes are met exactly, also at the rim", () => {
  const u = (a, b) => 3 + 0.2 * a - 0.1 * b + 0.004 * a * a - 0.003 * a * b + 0.001 * b * b;
  const v = (a, b) => -1 + 0.1 * a + 0.3 * b - 0.002 * a * a + 0.005 * a * b - 0.004 * b * b;
  const raster = { shape: [6, 7], spacing: [3, 4], origin: [-2, 5] },
    values = [],
    out = new Float64Array(6);
  for (let i = 0; i < 6; i++) for (let j = 0; j < 7; j++) values.push(u(3 * j - 2, 4 * i + 5), v(3 * j - 2, 4 * i + 5));
  for (const a of [-2, -1.2, 0, 2.7, 9.1, 15.5, 16]) {
    for (const b of [5, 6, 12.3, 23, 25]) {
      assert.ok(sampledWithSlope({ raster, values }, a, b, out));
      const exact = [
        a + u(a, b),
        b + v(a, b),
        1.2 + 0.008 * a - 0.003 * b,
        -0.1 - 0.003 * a + 0.002 * b,
        0.1 - 0.004 * a + 0.005 * b,
        1.3 + 0.005 * a - 0.008 * b,
      ];
      exact.forEach((value, k) => {
        assert.ok(Math.abs(out[k] - value) < 1e-9, `${a}, ${b}: ${k}`);
      });
    }
  }
  for (const [a, b] of [
    [-2.01, 6],
    [3, 25.1],
  ])
    assert.ok(!sampledWithSlope({ raster, values }, a, b, out));
});

/** Two hundred points all over the picture that make waves, one of them dragged. @param {(p: number[]) => boolean} isFree */
function points(isFree) {
  const all = [];
  for (let id = 1; all.length < 200; id++) {
    const target = [256 * ((id * 0.7548776662) % 1), 256 * ((id * 0.569840291) % 1)],
      [a, b] = target;
    const source = [a + 5 * Math.sin(a / 40) * Math.cos(b / 50), b + 4 * Math.cos(a / 45 + b / 60)];
    if (isFree(target) && isFree(source)) all.push({ id, source, target });
  }
  all[7].target = [all[7].target[0] + 6, all[7].target[1] + 4];
  return all;
}

const CUT = {
  region: {
    kind: "line",
    vertices: [
      [122, -10],
      [140, 115],
      [127, 266],
    ],
  },
};
const SLITS = [
  [
    "a cut that stops",
    [
      [120, -10],
      [140, 60],
      [127, 150],
    ],
    [false, true],
  ],
  [
    "a slit",
    [
      [90, 118],
      [170, 140],
    ],
    [true, true],
  ],
];
const PART = {
  region: {
    kind: "polygon",
    vertices: [
      [100, 100],
      [140, 96],
      [144, 150],
      [98, 146],
    ],
  },
};
const isFree = ([a, b]) => Math.hypot(a - 120, b - 122) > 52;

for (const [name, settings, own] of [
  ["many points", {}, points(() => true)],
  ["a cut", { cuts: [CUT] }, points(() => true)],
  ...SLITS.map(([name, vertices, stops]) => [
    name,
    { cuts: [{ region: { kind: "line", vertices, stops } }] },
    points(() => true),
  ]),
  ["a rigid part", { parts: [PART] }, points(isFree)],
]) {
  test(`lines traced between the nodes lie on those of the fit, with ${name}`, () => {
    const layered = layeredFit(own, settings),
      raster = rasterOf(PIXELS / SCALE);
    const sampled = sampledFits(
      layered,
      raster,
      layered.fits.map(({ fit }) => fieldOnRaster(fit, raster)),
    );
    const exact = deformedGrid(layered, BOX, CELLS, 2, 1e-6),
      traced = deformedGrid(sampled, BOX, CELLS, 2, 0.05 / SCALE);
    let worst = 0,
      count = 0;
    exact.forEach(({ runs }, n) => {
      assert.equal(traced[n].runs.length, runs.length);
      const [places, others] = [runs.flat(), traced[n].runs.flat()];
      assert.equal(others.length, places.length);
      for (let k = 0; k < places.length; k += 2, count++) {
        worst = Math.max(worst, SCALE * Math.hypot(places[k] - others[k], places[k + 1] - others[k + 1]));
      }
    });
    assert.ok(count > 1000 && worst < 0.5 && worst > 0, `${worst} CSS pixels`);
    // Of the middle alone: what is seen there is the same, though beyond it no fit is evaluated.
    const [low, high] = [30, 150],
      middle = {
        ...raster,
        origin: [low, low],
        shape: [0, 1].map((k) => Math.floor((high - low) / raster.spacing[k]) + 1),
      };
    const part = clampedFits(
      sampledFits(
        { ...layered, fits: layered.fits.map(({ fit, ...rest }) => ({ ...rest, fit })) },
        middle,
        layered.fits.map(({ fit }) => fieldOnRaster(fit, middle)),
      ),
    );
    const isWithin = (x, y) => x > low + 1 && x < high - 2 && y > low + 1 && y < high - 2;
    let least = 0;
    deformedGrid(part, BOX, CELLS, 2, 0.05 / SCALE).forEach(({ runs }, n) => {
      const of = exact[n].runs.flat();
      const seen = [...of.keys()].filter((k) => k % 2 === 0 && isWithin(of[k], of[k + 1])),
        places = runs.flat();
      for (const k of seen) {
        let away = Infinity;
        for (let i = 0; i < places.length; i += 2)
          away = Math.min(away, Math.hypot(places[i] - of[k], places[i + 1] - of[k + 1]));
        least = Math.max(least, SCALE * away);
      }
    });
    assert.ok(least < 0.5, `${least} CSS pixels within the raster`);
    if (name !== "many points") return;
    // By the formula itself: what is seen at a place of the first line was at a = 0 and on the first row at b = 0.
    const { origin, support, centers, coefficients, linear, constant } = layered.fits[0].fit;
    const seen = (place, c) => {
      const [p, q] = place.map((x, k) => (x - origin[k]) / support);
      let sum = place[c] + linear[c][0] * p + linear[c][1] * q + constant[c];
      for (let k = 0; k < own.length; k++) {
        const t = Math.max(0, 1 - Math.hypot(p - centers[2 * k], q - centers[2 * k + 1]));
        sum += coefficients[2 * k + c] * t ** 4 * (5 - 4 * t);
      }
      return sum;
    };
    for (const [line, c] of [
      [0, 0],
      [CELLS + 1, 1],
    ]) {
      for (const [lines, most] of [
        [exact, 1e-5],
        [traced, 0.5 / SCALE],
      ]) {
        const run = lines[line].runs.flat();
        for (let k = 0; k < run.length; k += 2) assert.ok(Math.abs(seen([run[k], run[k + 1]], c)) < most);
      }
    }
  });
}

test("beyond the raster, and where it has too few nodes, the fit itself is used", () => {
  const layered = layeredFit(points(() => true)),
    raster = rasterOf(5),
    [{ fit }] = layered.fits;
  const [{ fit: sampled }] = sampledFits(layered, raster, [fieldOnRaster(fit, raster)]).fits;
  assert.deepEqual(fieldAt(sampled, -3, 20), fieldAt(fit, -3, 20));
  const [p, q] = [sampled, fit].map((one) => fieldWithSlope(one, 300, 20, new Float64Array(6)));
  assert.deepEqual(p, q);
  const wide = { shape: [70, 70], spacing: [4, 4], origin: [-8, -8] };
  const [exact, near] = [fit, sampled].map((one) => fieldOnRaster(one, wide));
  let worst = 0;
  exact.forEach((value, n) => {
    const [i, j] = [Math.floor(n / 140), Math.floor(n / 2) % 70],
      isBeyond = Math.min(i, j) < 2 || Math.max(i, j) > 67;
    if (isBeyond) assert.ok(Math.abs(value - near[n]) < 1e-4);
    worst = Math.max(worst, SCALE * Math.abs(value - near[n]));
  });
  assert.ok(worst < 0.5 && worst > 0, `${worst} CSS pixels`);
  const few = rasterOf(100);
  assert.equal(sampledFits(layered, { ...few, shape: [3, 4] }, []), layered);
});
