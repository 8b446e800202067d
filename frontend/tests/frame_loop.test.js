// The drawing of a live view: a drag in an editor beside it never waits for the GPU, and maps are not requested in
// vain.

import assert from "node:assert/strict";
import test from "node:test";
import { FieldLink } from "../src/view/follow_editor.ts";
import { FrameLoop } from "../src/view/render_loop.ts";

const SOFTWARE = {
  pixelCost: 4e-4, // ms: a quick picture has half of the pixels in each direction, and takes 27 ms
  seconds: 12,
  moves: 150,
  isSoftware: true,
  plays: 0,
  cost: () => 1,
  isHeld: true,
  answer: 0,
  inputs: null, // of all pictures; otherwise those of each are others
};

/**
 * A page with a clock of its own: timers, frames, and a GPU that takes its time, `cost` times as long as usual. The
 * compositor waits for all work of the GPU if a canvas has changed, as browsers do that draw in software.
 */
function played(options = {}) {
  const { pixelCost, seconds, moves, isSoftware, plays, cost, isHeld, answer, inputs } = { ...SOFTWARE, ...options };
  let clock = 0,
    free = 0,
    count = 0,
    isDirty = false,
    queue = [];
  const log = { waits: [], casts: [], presents: [], caughtUp: 0, moves: 0, reported: 0 };
  const later = (run, at, isFrame) => {
    queue.push({ run, at, isFrame, id: ++count });
    return count;
  };
  const forget = (id) => {
    queue = queue.filter((task) => task.id !== id);
  };
  const own = {
    performance: { now: () => clock },
    setTimeout: (run, ms = 0) => later(run, clock + ms, false),
    requestAnimationFrame: (run) => later(run, 0, true),
    clearTimeout: forget,
    cancelAnimationFrame: forget,
  };
  const before = Object.keys(own).map((name) => [name, Object.getOwnPropertyDescriptor(globalThis, name)]);
  const restore = () => {
    for (const [name, old] of before) {
      delete globalThis[name];
      if (old) Object.defineProperty(globalThis, name, old);
    }
  };
  for (const [name, value] of Object.entries(own)) {
    Object.defineProperty(globalThis, name, { value, configurable: true, writable: true });
  }
  const give = (ms) => {
    free = Math.max(free, clock) + ms;
  };
  const gl = {
    SIGNALED: 1,
    SYNC_STATUS: 2,
    SYNC_GPU_COMMANDS_COMPLETE: 3,
    isContextLost: () => false,
    flush() {},
    deleteSync() {},
    fenceSync: () => ({ at: free }),
    getSyncParameter: (sync) => (clock >= sync.at ? 1 : 0),
  };
  const caster = {
    gpu: { gl, isSoftware },
    isReady: true,
    size: [600, 450],
    cast(name, _width, _height, _picture, { tile, pass = 0 }) {
      log.casts.push([clock, name, { tile, pass }]);
      give(cost() * pixelCost * tile[2] * tile[3]);
    },
    inputsOf: () => [inputs ?? ++count],
    present(name) {
      isDirty = true;
      log.presents.push([clock, name]);
      give(0.5);
    },
  };
  try {
    const loop = new FrameLoop(
      caster,
      (width) => [{ layer: 0, x: 0, width, original: false }],
      () => ({ target: 80, settle: 200 }),
      () => {
        log.reported = clock;
      },
      () => {
        log.caughtUp += 1;
      },
    );
    for (let k = 0; k < moves; k++) {
      later(
        () => {
          log.moves += 1;
          loop.touch(isHeld);
          if (k === moves - 1) loop.release();
        },
        16 * k,
        false,
      );
    }
    if (answer) later(() => loop.touch(), 16 * (moves - 1) + answer, false);
    const tick = () => {
      // an animation asks for its next frame and shows another moment
      if (clock < 1e3 * plays) {
        requestAnimationFrame(tick);
        loop.touch(true);
      } else loop.release();
    };
    if (plays) tick();
    for (let frame = 16; clock < 1e3 * seconds; frame = Math.max(frame + 16, 16 * Math.ceil(clock / 16))) {
      for (;;) {
        // the tasks before the frame, in the order of time
        queue.sort((a, b) => a.at - b.at || a.id - b.id);
        const next = queue.find((task) => !task.isFrame && task.at <= frame);
        if (!next) break;
        forget(next.id);
        clock = Math.max(clock, next.at);
        next.run();
      }
      clock = Math.max(clock, frame);
      for (const task of queue.filter((other) => other.isFrame)) {
        if (!queue.includes(task)) continue; // another of this frame has cancelled it
        forget(task.id);
        task.run();
      }
      if (isDirty) {
        log.waits.push(Math.max(0, free - clock));
        clock = Math.max(clock, free);
        isDirty = false;
      }
    }
  } finally {
    restore();
  }
  return log;
}

test("no frame waits for rays", () => {
  const { waits } = played();
  assert.ok(waits.length > 15);
  assert.ok(Math.max(...waits) <= 1); // the time to put a finished picture on the canvas
});

test("an animation that changes in every frame is seen while it plays", () => {
  const { presents, reported } = played({ moves: 0, plays: 5 });
  assert.ok(presents.filter(([at]) => at < 5e3).length > 30);
  assert.ok(reported > 5e3);
});

test("the volume follows the pointer and is drawn in full when it rests", () => {
  const log = played(),
    last = 16 * (log.moves - 1);
  assert.ok(log.presents.filter(([at]) => at <= last).length / (last / 1e3) > 12);
  assert.equal(log.presents.at(-1)[1], "full0");
  const full = Math.min(...log.casts.filter(([, name]) => name !== "coarse0").map(([at]) => at));
  assert.ok(full >= last && full < last + 100); // nothing in full during a drag, and no wait after it
  // Four passes in pieces of 40 ms, each of which may wait for two frames.
  assert.ok(log.reported - full < (4 * SOFTWARE.pixelCost * 600 * 450 * (40 + 2 * 16)) / 40);
});

test("what changes without a pointer settles before the full picture, but not an answer to a drag", () => {
  const begins = (log) => Math.min(...log.casts.filter(([, name]) => name !== "coarse0").map(([at]) => at));
  const turned = played({ moves: 10, isHeld: false }),
    answered = played({ moves: 10, answer: 150 });
  assert.ok(begins(turned) >= 16 * 9 + 200);
  assert.ok(answered.casts.some(([at, name]) => name === "coarse0" && at >= 16 * 9 + 150));
  assert.ok(answered.reported < turned.reported);
});

test("at rest the whole picture comes after the quick one, in pieces, and no ray is cast twice for it", () => {
  const log = played({ moves: 30, pixelCost: 2e-2, seconds: 40 });
  const shown = log.presents.map(([, name]) => name).filter((name) => name !== "coarse0");
  assert.deepEqual(shown, ["full0"]);
  const seen = new Set();
  for (const [, , { tile, pass }] of log.casts.filter(([, n]) => n !== "coarse0")) {
    const [x, y, width, height] = tile;
    assert.equal(pass, 0);
    for (let j = y; j < y + height; j++) for (let i = x; i < x + width; i++) seen.add(i + 600 * j);
  }
  assert.equal(seen.size, 600 * 450);
  const pixels = log.casts.reduce((sum, [, name, { tile }]) => sum + (name === "coarse0" ? 0 : tile[2] * tile[3]), 0);
  assert.equal(pixels, 600 * 450);
});

test("maps are requested once for a picture and not at every movement", () => {
  const log = played(),
    until = 16 * (log.moves - 1);
  const pictures = log.presents.filter(([at]) => at <= until).length;
  const tiles = log.casts.filter(([, name]) => name !== "coarse0").length;
  assert.ok(log.caughtUp <= pictures + 2 + tiles);
  assert.ok(pictures < log.moves / 1.5);
});

test("a drag that is stopped, where nothing changes, casts no ray", () => {
  const log = played({ inputs: "the same" }),
    last = 16 * (log.moves - 1),
    moving = log.casts.filter(([at]) => at < last);
  const pixels = moving.reduce((sum, [, , { tile }]) => sum + tile[2] * tile[3], 0);
  assert.equal(pixels, 300 * 225); // of the first picture
  assert.ok(log.caughtUp > log.moves / 4); // but each movement may change something
  assert.ok(log.reported > last);
});

test("a GPU does not wait for the page between two pieces of a picture", () => {
  const log = played({ pixelCost: 1.6e-3 }); // 108 ms: three pieces
  const starts = log.casts.filter(([, name]) => name === "coarse0").map(([at]) => at);
  const begun = starts.filter((at, k) => k === 0 || at > starts[k - 1]).length;
  assert.ok(begun < starts.length);
});

test("quick pictures keep their size while what they take changes by a third, and a single slow one changes none", () => {
  let k = 0;
  const log = played({ cost: () => [1.15, 0.85, 1, 6, 0.9, 1.1, 1][k++ % 7] }),
    last = 16 * (log.moves - 1);
  const sizes = log.casts.filter(([at]) => at > 500 && at < last).map(([, , { tile }]) => tile[2]);
  assert.equal(new Set(sizes).size, 1);
});

test("a quick picture has pixels enough to be looked at however long others keep the processors", () => {
  const quick = (options) => played(options).casts.filter(([, name]) => name === "coarse0");
  const least = (options) => Math.min(...quick(options).map(([, , { tile }]) => tile[2]));
  assert.ok(least({ pixelCost: 1e-2, seconds: 30 }) >= 100);
  assert.ok(least({ pixelCost: 1e-3 }) > 100);
});

for (const moves of [1, 2]) {
  test(`the first of ${moves} is drawn at once`, () => assert.ok(played({ moves }).presents[0][0] < 200));
}

/** The calls of a link's listeners; after drawn movements also whether maps are awaited, before and after. */
function linked(details) {
  const calls = [],
    link = new FieldLink(
      null,
      () => calls.push("maps"),
      (isMoving) => calls.push(isMoving),
    );
  link.settled = JSON.stringify([]) + JSON.stringify({});
  for (const [phase, draws] of details) {
    link.followMove({ phase, points: [], settings: {} });
    if (draws) {
      calls.push(Boolean(link.awaited));
      link.catchUp();
      calls.push(Boolean(link.awaited));
    }
  }
  return calls;
}

// Else the view would wait for a drag that has ended long ago, and stay coarse.
test("the end of a movement is reported even if it ends where it began", () => {
  assert.deepEqual(
    linked([
      ["move", false],
      ["move", false],
      ["end", false],
    ]),
    [true, true, false],
  );
  assert.deepEqual(
    linked([
      ["move", true],
      ["end", true],
    ]),
    [true, true, false, false, false, false],
  );
});
