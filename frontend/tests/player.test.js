// The clock of a player, run by hand.

import assert from "node:assert/strict";
import test from "node:test";
import { PlayClock } from "../src/inputs/player.ts";

const near = (found, wanted) => assert.ok(Math.abs(found - wanted) < 1e-6, `${found} is not ${wanted}`);

function played({ loop = "once", duration = 1, speed = 1, start = 0, ticks = [] }) {
  let next = null;
  const page = {
    requestAnimationFrame: (f) => {
      next = f;
      return 1;
    },
    cancelAnimationFrame: () => {
      next = null;
    },
  };
  const details = [],
    clock = new PlayClock((detail) => details.push(detail), page);
  clock.set({ duration, speed, loop });
  clock.seek(start);
  clock.play();
  for (const now of ticks) {
    const f = next;
    next = null;
    f?.(now);
  }
  const time = clock.time,
    wasPlaying = clock.isPlaying;
  clock.play();
  const again = clock.time;
  clock.pause();
  clock.set({ loop: "once" });
  const times = details.map((detail) => detail.time);
  return { times, time, wasPlaying, again, kept: clock.time, waits: next !== null };
}

test("it plays once and ends exactly", () => {
  const whole = played({ ticks: Array.from({ length: 15 }, (_, k) => 1000 + 100 * k) });
  assert.equal(whole.time, 1);
  assert.equal(whole.wasPlaying, false);
  assert.equal(whole.again, 0); // from the beginning again
  for (const k of [0, 1, 2]) near(whole.times[3 + k], 0.1 * k);
  const half = played({ ticks: [1000, 1200], speed: 0.5, start: 0.25 });
  near(half.time, 0.35);
  assert.equal(half.wasPlaying, true);
  assert.equal(half.waits, false); // it was paused
});

test("it goes round, and there and back", () => {
  const ticks = [0, 200, 400, 600, 800, 1000, 1200, 1400]; // 1.4 s of a second
  near(played({ loop: "loop", ticks }).time, 0.4);
  const back = played({ loop: "swing", ticks });
  near(back.time, 0.6);
  near(back.kept, 0.6); // another loop continues from the moment that is shown
});

test("it does not leap over time in which the page was hidden", () => {
  near(played({ ticks: [0, 60_000], duration: 10 }).time, 0.25);
  assert.equal(played({ duration: 0, ticks: [0, 100] }).time, 0);
});
