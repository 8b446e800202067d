// The matrix of a kernel while centres move: equal to one that is made anew, whatever has moved before.

import assert from "node:assert/strict";
import { test } from "node:test";

import { kernelMatrix } from "../src/maths/kernel_matrix.ts";
import { RBF_KERNELS } from "../src/maths/rbf.ts";

const { profile } = RBF_KERNELS.wendland_c2;

/** Numbers from 0 to 1, the same at each run. */
function random(seed) {
  let state = seed;
  return () => {
    state = (1103515245 * state + 12345) % 2 ** 31;
    return state / 2 ** 31;
  };
}

/** phi(|x_i - x_j| / R_j) + nugget, entry by entry. */
function written({ places, radius, nugget, radii }) {
  const n = nugget.length;
  return Float64Array.from({ length: n * n }, (_, at) => {
    const i = Math.floor(at / n),
      j = at % n,
      r = radii ? radii[j] : radius;
    const s = ((places[2 * i] - places[2 * j]) / r) ** 2 + ((places[2 * i + 1] - places[2 * j + 1]) / r) ** 2;
    return profile(s) + (i === j ? nugget[i] : 0);
  });
}

function assertRight(centres, rhs, m) {
  const matrix = kernelMatrix(centres, profile),
    n = centres.nugget.length,
    phi = written(centres);
  assert.deepEqual(
    [...matrix.phi].map((value, at) => Math.abs(value - phi[at]) < 1e-15),
    Array(n * n).fill(true),
  );
  if (centres.radii) return;
  const x = matrix.solve(rhs, m);
  for (let i = 0; i < n; i++) {
    for (let c = 0; c < m; c++) {
      let sum = -rhs[i * m + c];
      for (let j = 0; j < n; j++) sum += phi[i * n + j] * x[j * m + c];
      assert.ok(Math.abs(sum) < 1e-10, `row ${i} misses by ${sum}`);
    }
  }
}

for (const count of [1, 2, 5, 40]) {
  test(`${count} centres of which some move are solved as if all were new`, () => {
    const next = random(count),
      places = Float64Array.from({ length: 2 * count }, next),
      m = 3;
    const nugget = Array.from({ length: count }, () => 0.01 * next()),
      rhs = Float64Array.from({ length: count * m }, next);
    for (let step = 0; step < 30; step++) {
      const moved = 1 + Math.floor(next() * Math.min(4, count));
      for (let k = 0; k < moved; k++) places[Math.floor(next() * 2 * count)] = next();
      if (step % 7 === 3) nugget[Math.floor(next() * count)] = next();
      assertRight(
        { kernel: "wendland_c2", radius: 0.4, places: places.slice(), nugget: [...nugget], radii: null },
        rhs,
        m,
      );
    }
  });
}

test("sets that take turns, other radii and a system that is singular for a while leave nothing behind", () => {
  const next = random(7),
    sets = [6, 6, 9].map((n) => Float64Array.from({ length: 2 * n }, next));
  for (let step = 0; step < 24; step++) {
    const places = sets[step % 3],
      n = places.length / 2,
      nugget = Array(n).fill(0);
    if (step % 6 === 4)
      places.copyWithin(0, 2, 4); // two centres at one place
    else places[0] += 0.1 * next() + 0.05;
    const centres = { kernel: "wendland_c2", radius: 1 + (step % 2), places: places.slice(), nugget, radii: null };
    if (step % 6 === 4) kernelMatrix(centres, profile).solve(new Float64Array(n).fill(1), 1);
    else assertRight(centres, Float64Array.from({ length: n }, next), 1);
    assertRight({ ...centres, radii: nugget.map((_, k) => 1 + 0.1 * k) }, new Float64Array(n), 1);
  }
});
