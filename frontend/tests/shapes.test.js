// Edits of cuts and rigid parts.

import assert from "node:assert/strict";
import test from "node:test";
import { cleanShapes, sameShapes } from "../src/maths/points.ts";
import {
  cornersOf,
  insertCorner,
  inverseDirection,
  middleOfRegion,
  motionOf,
  motionWords,
  moveCorner,
  movePlace,
  openingPlaces,
  oppositeHalfPlane,
  placeBefore,
  placesAlong,
  removeCorner,
  rotatePart,
  setStop,
  shapeLabel,
  simplifyPath,
  stopsAt,
  swapRegionSides,
  translateRegion,
  turnAndShift,
} from "../src/maths/shapes.ts";

const line = {
    kind: "line",
    vertices: [
      [0, 0],
      [5, 5],
      [9, 0],
    ],
  },
  polygon = { ...line, kind: "polygon" };

test("a half plane is turned by two places on its line", () => {
  const region = { kind: "half_space", point: [5, 5], normal: [0, 1] }; // all above b = 5 is inside
  assert.deepEqual(cornersOf(region, 10), [
    [-5, 5],
    [15, 5],
  ]);
  const moved = moveCorner(region, 0, [-5, 15], 10),
    [p, q] = cornersOf(moved, 10);
  assert.ok(Math.hypot(p[0] + 5, p[1] - 15) < 1e-9);
  assert.ok(Math.abs((q[0] - p[0]) * -10 - (q[1] - p[1]) * 20) < 1e-9); // through the other place as before
  assert.ok(moved.normal[1] > 0.8); // the same side
  assert.deepEqual(
    swapRegionSides(region).normal.map((v) => v + 0),
    [0, -1],
  );
});

for (const [p, q] of [
  [
    [0, 40],
    [100, 50],
  ],
  [
    [100, 50],
    [0, 40],
  ],
]) {
  test(`the ground from ${p} to ${q} is away from the middle`, () => {
    const { point, normal } = oppositeHalfPlane(p, q, [50, 10]);
    assert.ok((50 - point[0]) * normal[0] + (10 - point[1]) * normal[1] > 0);
    assert.ok(Math.abs(Math.hypot(...normal) - 1) < 1e-12);
  });
}

test("a stroke keeps its corners and nothing else", () => {
  const steps = Array.from({ length: 20 }, (_, k) => k);
  const stroke = [
    ...steps.map((k) => [k, 0]),
    ...steps.map((k) => [20, k]),
    ...steps.map((k) => [20 + k, 20 + 0.2 * (k % 2)]),
  ];
  assert.deepEqual(simplifyPath(stroke, 0.5), [
    [0, 0],
    [20, 0],
    [20, 20],
    [39, 20.2],
  ]);
});

test("a line keeps two corners and a closed one three", () => {
  const less = removeCorner(line, 1);
  assert.deepEqual(less.vertices, [
    [0, 0],
    [9, 0],
  ]);
  assert.equal(removeCorner(less, 0), null);
  assert.equal(removeCorner(polygon, 0), null);
  assert.deepEqual(insertCorner(line, 1, [7, 3]).vertices, [
    [0, 0],
    [5, 5],
    [7, 3],
    [9, 0],
  ]);
  assert.deepEqual(translateRegion(line, 1, 2).vertices, [
    [1, 2],
    [6, 7],
    [10, 2],
  ]);
  assert.deepEqual(swapRegionSides(line).vertices[0], [9, 0]);
  assert.equal(swapRegionSides(polygon), null);
});

test("regions that are known stay the same objects", () => {
  const list = [
      {
        region: {
          vertices: [
            [0, 1],
            [2, 3],
          ],
          kind: "line",
        },
      },
    ],
    old = cleanShapes(list, "cuts");
  const again = cleanShapes(structuredClone(list), "cuts", old);
  assert.equal(again[0].region, old[0].region);
  assert.ok(sameShapes(again, old));
  assert.deepEqual(cleanShapes([null, 3, {}], "cuts"), []);
});

test("a part is turned about its pivot, and what is done is read back", () => {
  const part = { ...cleanShapes([{ region: polygon }], "parts")[0], pivot: [9, 0] };
  const turned = rotatePart(part, Math.PI / 2, [3, -4]),
    place = movePlace(turned.motion, [10, 0]);
  assert.ok(Math.hypot(place[0] - 12, place[1] + 3) < 1e-12); // a turns to b, and then the shift
  assert.ok(Math.hypot(...placeBefore(turned.motion, place).map((v, c) => v - [10, 0][c])) < 1e-12);
  assert.deepEqual(inverseDirection(turned.motion, [0, 5]).map(Math.round), [5, 0]);
  const { angle, shift } = turnAndShift(turned);
  assert.ok(Math.abs(angle - Math.PI / 2) < 1e-12);
  assert.ok(Math.hypot(shift[0] - 3, shift[1] + 4) < 1e-12);
  assert.equal(motionWords(turned), "moved 3, -4, turned 90\u00b0");
  assert.equal(motionWords(rotatePart(part, 0, [0.01, -0.01])), "");
  assert.equal(motionOf({ ...turned, enabled: false }), null);
});

test("the middle of a region is that of its area, and of a half plane the place on its boundary", () => {
  assert.deepEqual(
    middleOfRegion({
      kind: "polygon",
      vertices: [
        [0, 0],
        [0, 6],
        [3, 0],
      ],
    }),
    [1, 2],
  );
  assert.deepEqual(middleOfRegion({ kind: "half_space", point: [3, 4], normal: [0, 1] }), [3, 4]);
});

test("a cut stops at the ends of a line, and nowhere else", () => {
  assert.deepEqual(
    [0, 1, 2].map((k) => stopsAt(line, k)),
    [false, null, false],
  );
  assert.deepEqual([stopsAt(polygon, 0), setStop(polygon, 0, true), setStop(line, 1, true)], [null, null, null]);
  const last = setStop(line, 2, true),
    both = setStop(last, 0, true);
  assert.deepEqual(
    [last.stops, both.stops],
    [
      [false, true],
      [true, true],
    ],
  );
  assert.deepEqual(swapRegionSides(last).stops, [true, false]); // the same end of the line
  assert.deepEqual(setStop(last, 2, false), line);
  const [cut] = cleanShapes([{ region: { ...last, more: 1 } }], "cuts");
  assert.deepEqual(cut.region, last);
  assert.ok(sameShapes(cleanShapes([{ region: { ...line, stops: [false, false] } }], "cuts")[0].region, line));
  assert.match(shapeLabel(cut, "cuts", 0), /stops at its last end/);
});

test("the points that open a cut lie on its sides, in the box, and hold its ends", () => {
  const vertices = [
      [50, 20],
      [50, 80],
    ],
    { pulled, held } = openingPlaces(vertices, [0, 100, 0, 100]);
  assert.deepEqual(
    pulled.map(({ from, to }) => [from[1], to[1]]),
    [
      [50, 50],
      [50, 50],
    ],
  );
  const [p, q] = pulled.map(({ from, to }) => [from[0] - 50, to[0] - 50]);
  assert.deepEqual([p[0] + q[0], p[1] + q[1]].map(Math.abs), [0, 0]); // alike on both sides
  assert.ok(Math.abs(p[0]) > 1 && Math.abs(p[1]) > 2 * Math.abs(p[0]) && p[0] * p[1] > 0); // away from the cut
  assert.ok(held.every(([a, b]) => a >= 0 && a <= 100 && b >= 0 && b <= 100));
  const farthest = Math.max(...held.filter(([, b]) => b === 50).map(([a]) => a));
  assert.ok(farthest > 50 + Math.abs(p[1])); // no pulled point passes one that is held
  assert.deepEqual(held.slice(0, 2), [
    [50, 8],
    [50, 92],
  ]);
  const narrow = openingPlaces(vertices, [45, 52, 0, 100]);
  assert.ok([...narrow.held, ...narrow.pulled.map(({ to }) => to)].every(([a]) => a > 45 - 1e-9 && a < 52 + 1e-9));
});

test("places are spread evenly along a line, and around a closed one", () => {
  assert.deepEqual(
    placesAlong(
      [
        [0, 0],
        [3, 0],
        [3, 3],
      ],
      3,
      false,
    ),
    [
      [0, 0],
      [3, 0],
      [3, 3],
    ],
  );
  assert.deepEqual(
    placesAlong(
      [
        [0, 0],
        [2, 0],
        [2, 2],
        [0, 2],
      ],
      8,
      true,
    ),
    [
      [0, 0],
      [1, 0],
      [2, 0],
      [2, 1],
      [2, 2],
      [1, 2],
      [0, 2],
      [0, 1],
    ],
  );
});
