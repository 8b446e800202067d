// The edits of windows on their way to Python: whatever is late or crosses, all end with the same.

import assert from "node:assert/strict";
import test from "node:test";
import { addPoint, nextId, samePoints, sameShapes } from "../src/maths/points.ts";
import { EditLink, RestingTrait, Sender } from "../src/sync/edits.ts";
import { PlainModel } from "../src/sync/host_model.ts";

const cutAt = (name, a) => ({
  name,
  enabled: true,
  region: {
    kind: "line",
    vertices: [
      [a, 0],
      [a, 9],
    ],
  },
});
const firsts = (points) => points.map((p) => p.target[0]);
const ids = (points) => points.map((p) => p.id);
const moved = (points, target) => points.map((p) => ({ ...p, target }));

/**
 * Time that runs from event to event, a kernel that takes one message at a time, and windows with lanes of their own.
 * What one connection carries stays in order; trait updates and custom messages are two lanes, since a front end
 * applies the former by promises. `service` and `delay` are the longest times, in milliseconds.
 */
function worldOf(seed, { delay = 50, service = 20, isPythons = false } = {}) {
  let state = seed >>> 0,
    count = 0;
  const random = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = state;
    t = Math.imul(t ^ (t >>> 15), t | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  const w = { now: 0, queue: [], windows: [], random, taken: [] };
  w.later = (f, ms) => {
    const event = { at: w.now + ms, n: count++, f };
    w.queue.push(event);
    return event;
  };
  w.cancel = (event) => {
    w.queue = w.queue.filter((other) => other !== event);
  };
  w.step = () => {
    if (w.queue.length === 0) return false;
    const event = w.queue.reduce((p, q) => (q.at < p.at || (q.at === p.at && q.n < p.n) ? q : p));
    w.cancel(event);
    w.now = event.at;
    event.f();
    return true;
  };
  w.finish = () => {
    while (w.step());
  };
  w.until = (time) => {
    while (w.queue.some((event) => event.at <= time)) w.step();
    w.now = time;
  };
  const lane = () => {
    let last = 0;
    return (f) => {
      last = Math.max(last + 1e-6, w.now + random() * delay);
      w.later(f, last - w.now);
    };
  };
  const place = (k) => ({ id: k, name: "", source: [k, k], target: [k, k], active: true, weight: 1 });
  const k = { points: [0, 1, 2].map(place), cuts: [], seen: {}, next_id: 3, free: 0, past: [], future: [] };
  w.kernel = k;
  const history = () => (isPythons ? { undo: k.past.length ? "edit" : "", redo: k.future.length ? "edit" : "" } : {});
  k.send = (changes) => {
    const text = JSON.stringify(changes);
    for (const win of w.windows) win.updates(() => win.model.update(JSON.parse(text)));
  };
  k.set = (points) => {
    k.points = points;
    k.send({ points });
    k.next_id = nextId(points, k.next_id);
    k.send({ next_id: k.next_id });
  };
  k.setCuts = (cuts) => {
    k.cuts = cuts;
    k.send({ cuts });
  };
  k.done = () => {
    k.past.push({ points: k.points, cuts: k.cuts });
    k.future = [];
  };
  k.own = (points) => {
    k.done();
    k.set(points);
    k.send({ history: history() });
  };
  k.cut = (cuts) => {
    k.done();
    k.setCuts(cuts);
    k.send({ history: history() });
  };
  k.step = (way) => {
    const [from, to] = way === "undo" ? [k.past, k.future] : [k.future, k.past];
    if (!from.length) return;
    const { points, cuts } = from.pop();
    to.push({ points: k.points, cuts: k.cuts });
    k.set(points);
    k.setCuts(cuts);
    k.send({ history: history() });
  };
  k.take = (m) => {
    w.taken.push(m);
    if (m.type === "history") k.step(m.way);
    else if (m.type === "shapes") k.cut(m.shapes.filter((cut) => cut.name !== "refused"));
    else if (m.phase === "end") k.own(m.points);
    if (m.phase !== "move") {
      k.seen = { ...k.seen, [m.sender]: m.seq };
      k.send({ seen: k.seen });
    }
  };
  k.arrived = (win, m) => {
    const start = Math.max(k.free, w.now);
    k.free = start + random() * service; // callbacks run after the points are taken, and then comes the answer
    w.later(() => k.take(m), start - w.now);
    w.later(() => win.answers(() => win.model.receive({ type: "done", sender: m.sender, seq: m.seq })), k.free - w.now);
  };
  w.open = () => {
    const win = { updates: lane(), answers: lane(), messages: lane(), shown: [], status: [] };
    const { points, cuts, seen, next_id } = k;
    win.model = new PlainModel(structuredClone({ points, cuts, parts: [], seen, next_id, history: history() }), {
      deliver: (m) => {
        const text = JSON.stringify(m);
        win.messages(() => k.arrived(win, JSON.parse(text)));
      },
      save: () => assert.fail("a trait was saved"),
    });
    const sender = new Sender({ now: () => w.now, later: w.later, cancel: w.cancel });
    sender.attach(win.model);
    win.sender = sender;
    win.views = [0, 1].map(() => {
      const view = { points: sender.points };
      sender.listen(() => {
        view.points = sender.points;
      });
      return view;
    });
    const buttons = () => {
      win.lit = ["undo", "redo"].map((way) => sender.canStep(way));
    }; // as an editor draws them
    buttons();
    sender.listen((what) => {
      if (what === "points") win.shown.push(firsts(sender.points));
      if (what === "status") win.status.push(sender.channel.status);
      buttons();
    });
    win.model.on("change:history", buttons);
    w.windows.push(win);
    return win;
  };
  w.act = ({ sender }) => {
    const { points } = sender,
      r = random();
    const here = () => points.map((p) => ({ ...p, target: [Math.floor(1000 * random()), w.now] }));
    if (r < 0.35) sender.edit(here(), "move");
    else if (r < 0.5) sender.edit(addPoint(points, nextId(points, sender.nextId), [w.now, 1], [w.now, 1]), "add");
    else if (r < 0.6 && points.length) sender.edit(points.slice(1), "remove");
    else if (r < 0.75) sender.step("undo");
    else if (r < 0.83) sender.step("redo");
    else if (r < 0.9) {
      const cut = cutAt(random() < 0.2 ? "refused" : "", w.now);
      sender.editShapes("cuts", [...sender.shapes.cuts.slice(-2), cut], "add cut");
    } else for (let i = 0; i < 4; i++) sender.move(here());
  };
  return w;
}

for (const [delay, service] of [
  [1, 1],
  [300, 50],
  [30, 900],
  [3000, 3000],
  [20000, 500],
]) {
  for (const isPythons of [false, true]) {
    const owner = isPythons ? "Python" : "the window";
    test(`windows, views and Python end with the same (${delay} ms, ${service} ms, history of ${owner})`, () => {
      for (let seed = 0; seed < 40; seed++) {
        const w = worldOf(seed, { delay, service, isPythons }),
          { kernel } = w;
        w.open();
        w.open();
        for (let n = 0; n < 40; n++) {
          const r = w.random();
          if (r < 0.15) kernel.own(kernel.points.map((p) => ({ ...p, target: [-n, w.random()] })));
          else if (r < 0.18 && w.windows.length < 5)
            w.open(); // as if the page was loaded again, beside the old one
          else w.act(w.windows[Math.floor(w.random() * w.windows.length)]);
          w.until(w.now + w.random() ** 3 * 1500);
        }
        w.finish();
        for (const { sender, views, lit } of w.windows) {
          for (const { points } of [sender, ...views]) assert.ok(samePoints(points, kernel.points), `seed ${seed}`);
          assert.ok(sameShapes(sender.shapes.cuts, kernel.cuts), `cuts of seed ${seed}`);
          assert.ok(!sender.isBehind() && !sender.pending.move, `an edit of seed ${seed} waits`);
          if (isPythons) assert.deepEqual(lit, [kernel.past.length > 0, kernel.future.length > 0], `seed ${seed}`);
        }
        for (const m of w.taken.filter(({ type, phase }) => type === "edit" && phase === "end")) {
          assert.equal(new Set(ids(m.points)).size, m.points.length, `ids of seed ${seed}`);
        }
      }
    });
  }
}

test("no echo of an old state is shown between quick edits", () => {
  for (let seed = 0; seed < 20; seed++) {
    const w = worldOf(seed, { delay: 400, service: 100 }),
      { sender, shown } = w.open();
    sender.edit(
      sender.points.map((p) => ({ ...p, target: [p.id + 10, 0] })),
      "move",
    );
    w.until(w.now + 3);
    sender.edit(sender.points.slice(1), "remove");
    for (let n = 0; n < 2; n++) {
      w.until(w.now + 3);
      sender.step("undo");
    }
    w.finish(); // the last waits here for the answer to the first
    assert.deepEqual(
      [shown, firsts(w.kernel.points)],
      [
        [
          [10, 11, 12],
          [11, 12],
          [10, 11, 12],
          [0, 1, 2],
        ],
        [0, 1, 2],
      ],
    );
  }
});

test("Python's edit holds if it comes last, and the window may undo it", () => {
  const w = worldOf(1),
    { sender } = w.open();
  sender.edit(sender.points.slice(1), "remove");
  w.finish();
  w.kernel.own(w.kernel.points.slice(1));
  w.finish();
  assert.deepEqual(ids(sender.points), [2]);
  for (const wanted of [
    [1, 2],
    [0, 1, 2],
    [0, 1, 2],
  ]) {
    sender.step("undo");
    w.finish();
    assert.deepEqual(ids(w.kernel.points), wanted);
  }
});

test("a busy kernel gets the newest and knows which edits were joined", () => {
  const w = worldOf(1, { delay: 5 }),
    { sender, status } = w.open();
  w.kernel.free = 3500; // it works on something else
  for (let n = 0; n < 8; n++) {
    const [kind, join] = n === 3 || n === 4 ? ["move", null] : ["nudge", "nudge 1"];
    sender.edit(moved(sender.points, [n, n]), kind, join);
    w.until(w.now + 10);
  }
  w.finish();
  // Joining goes by the wall clock, as the user's hand does: eight edits at once are well within 0.8 seconds.
  assert.deepEqual(
    w.taken.map((m) => [m.kind, m.joins, m.points[0].target[0]]),
    [
      ["nudge", false, 0],
      ["nudge", true, 1],
      ["several", false, 7],
    ],
  );
  assert.deepEqual(status, ["unanswered", ""]);
  assert.equal(sender.isBehind(), false);
});

test("movements never queue up", () => {
  const w = worldOf(3, { delay: 1, service: 400 }),
    { sender } = w.open();
  for (let n = 1; n <= 200; n++) {
    sender.move([n]);
    w.until(w.now + 16);
  }
  sender.edit(sender.points.slice(1), "move");
  w.finish();
  const moves = w.taken.filter((m) => m.phase === "move").map((m) => m.points[0]);
  // 3.2 seconds of a drag, some 200 ms for each of the kernel's answers: the rest was never sent.
  assert.ok(moves.length >= 8 && moves.length <= 40);
  assert.ok(moves.every((n, k) => k === 0 || n > moves[k - 1]));
  assert.equal(w.taken.at(-1).phase, "end");
  assert.ok(w.now < 3200 + 3 * 400 + 2000); // and the timer that ends it
});

test("a lost connection is reported and blocks nothing", (t) => {
  t.mock.method(console, "warn", () => {});
  const w = worldOf(1),
    { sender, model, status } = w.open(),
    send = model.send.bind(model);
  model.send = () => {
    throw new Error("Cannot send");
  };
  for (let n = 0; n < 3; n++) sender.edit(moved(sender.points, [n, 9]), "move");
  w.finish();
  assert.equal(sender.points[0].target[0], 2);
  model.send = send;
  sender.edit(sender.points.slice(1), "remove");
  w.finish();
  assert.deepEqual([...new Set(status.slice(0, -1)), status.at(-1)], ["lost", ""]);
  assert.deepEqual(firsts(w.kernel.points), [2, 2]);
});

for (const [kernel, wanted] of [
  ["idle", ["unanswered", "detached", ""]],
  ["busy", ["unanswered", ""]],
]) {
  test(`a model that receives nothing of a kernel that is ${kernel}`, () => {
    const w = worldOf(1),
      { sender, model, status } = w.open();
    model.widget_manager = { kernel: { status: kernel } };
    sender.edit(sender.points.slice(1), "remove");
    w.queue = w.queue.filter((event) => event.at === w.now + 2000); // the answer never comes, but time goes on
    w.finish();
    sender.channel.done(sender.channel.seq);
    assert.deepEqual(status, wanted);
  });
}

const GREETED = {
  idle: ["detached"],
  "busy then idle": ["detached"],
  "busy then answered": [],
  none: ["lost"],
  unknown: [],
};
for (const [name, wanted] of Object.entries(GREETED)) {
  test(`a view that opens says when it receives no answer (kernel: ${name})`, () => {
    const w = worldOf(1),
      { sender, model, status } = w.open(),
      sent = [],
      [first, then] = name.split(" then ");
    model.send = (message) => sent.push(message.type);
    const shown = { none: null, unknown: undefined },
      kernel = { status: first };
    model.widget_manager = { kernel: first in shown ? shown[first] : kernel };
    sender.channel.greet();
    sender.channel.greet();
    w.until(w.now + 9000);
    if (first === "busy") assert.deepEqual(status, []);
    if (then === "answered") sender.channel.done(0);
    kernel.status = "idle";
    w.until(w.now + 9000);
    sender.channel.done(0);
    w.until(w.now + 9000);
    assert.deepEqual(sent, name === "unknown" ? [] : ["greet"]);
    assert.deepEqual(status.filter(Boolean), wanted);
    assert.equal(status.at(-1) ?? "", "");
  });
}

test("a lost answer does not hide Python's values for ever", () => {
  const w = worldOf(1),
    { sender, model } = w.open();
  sender.edit(sender.points.slice(1), "remove");
  w.queue = []; // neither points nor answer ever come
  w.until(w.now + 3000);
  model.update({ points: [] });
  assert.equal(sender.points.length, 2);
  w.until(w.now + 8000);
  model.update({ points: w.kernel.points.slice(2) });
  assert.deepEqual(ids(sender.points), [2]);
});

test("Python undoes an edit that has not arrived yet", () => {
  const w = worldOf(1, { isPythons: true }),
    { sender } = w.open();
  assert.equal(sender.step("undo"), false);
  for (let n = 1; n <= 4; n++) sender.edit(moved(sender.points, [n, n]), "move");
  sender.step("undo");
  sender.step("undo");
  w.finish();
  // Two were in flight, the third and fourth went as one before the undo.
  assert.deepEqual(
    w.taken.map((m) => m.way ?? m.points[0].target[0]),
    [1, 2, 4, "undo", "undo"],
  );
  assert.equal(sender.points[0].target[0], 1);
  assert.equal(w.kernel.past.length, 1);
});

test("the steps that can be undone and redone are known before Python has answered", () => {
  const w = worldOf(1, { isPythons: true }),
    win = w.open(),
    { sender } = win;
  const move = () => sender.edit(moved(sender.points, [w.now, 9]), "move");
  const expect = (...wanted) =>
    assert.deepEqual(
      ["undo", "redo"].map((way) => sender.canStep(way)),
      wanted,
    );
  expect(false, false);
  move();
  expect(true, false);
  for (const way of ["undo", "redo", "undo"]) {
    sender.step(way);
    expect(true, true);
  }
  move(); // right after the undo: nothing is left to redo
  expect(true, false);
  w.finish();
  expect(true, false);
  assert.deepEqual(win.lit, [true, false]);
});

test("shapes go behind the points before them and are undone in order", () => {
  const w = worldOf(1),
    { sender } = w.open();
  for (let n = 1; n <= 4; n++) sender.edit(moved(sender.points, [n, n]), "move");
  sender.editShapes("cuts", [cutAt("", 5)], "add cut");
  sender.edit(sender.points.slice(1), "remove");
  sender.step("undo");
  sender.step("undo");
  assert.deepEqual([sender.points.length, sender.shapes.cuts.length], [3, 0]);
  w.finish();
  // Two edits were in flight, the third and fourth went as one before the cut.
  assert.deepEqual(
    w.taken.map((m) => m.kind),
    ["move", "move", "move", "add cut", "several", "undo"],
  );
  assert.equal(w.kernel.cuts.length, 0);
  assert.deepEqual(firsts(w.kernel.points), [4, 4, 4]);
});

test("shapes that Python does not take are given up", () => {
  const w = worldOf(1),
    { sender } = w.open();
  sender.editShapes("cuts", [cutAt("refused", 5)], "add cut");
  assert.equal(sender.shapes.cuts.length, 1);
  w.finish();
  assert.deepEqual([sender.shapes.cuts.length, sender.isBehind()], [0, false]);
});

test("of a single value two movements are in flight and the newest is kept", () => {
  let now = 0;
  const sent = [],
    link = new EditLink(
      (m) => sent.push([m.seq, m.phase, m.value]),
      () => now,
    );
  for (const value of ["a", "b", "c", "d"]) link.move(value);
  assert.equal(sent.length, 2);
  link.done(1);
  link.end("z");
  link.done(2);
  link.done(3);
  assert.deepEqual(
    [{}, { [link.id]: 3 }, { [link.id]: link.last }].map((seen) => link.isBehind(seen)),
    [true, true, false],
  );
  for (const value of ["e", "f", "g"]) link.move(value);
  now = 3000;
  link.move("h");
  assert.equal(link.isBehind({}), true);
  now = 11000;
  assert.equal(link.isBehind({}), false);
  assert.deepEqual(sent, [
    [1, "move", "a"],
    [2, "move", "b"],
    [3, "move", "d"],
    [4, "end", "z"],
    [5, "move", "e"],
    [6, "move", "f"],
    [7, "move", "h"],
  ]);
});

test("an edit of shapes can be undone like one of points", () => {
  const w = worldOf(1, { service: 1 }),
    { sender } = w.open();
  assert.equal(sender.canStep("undo"), false);
  sender.editShapes("cuts", [cutAt("one", 5)], "add cut");
  assert.equal(sender.canStep("undo"), true);
  w.finish();
  sender.step("undo");
  w.finish();
  assert.deepEqual(sender.shapes.cuts, []);
});

test("a trait is sent after a rest, the newest value once, at once if that is requested, and not after the end", (t) => {
  t.mock.timers.enable({ apis: ["setTimeout"] });
  const sent = [];
  const trait = new RestingTrait({ set: (name, value) => sent.push([name, value]), save_changes() {} }, "selected");
  for (const value of [[1], [1, 2]]) {
    trait.sendSoon(value);
    t.mock.timers.tick(149);
  }
  assert.deepEqual([sent, trait.isAhead], [[], true]);
  t.mock.timers.tick(1);
  assert.deepEqual([sent, trait.isAhead], [[["selected", [1, 2]]], false]);
  trait.sendSoon([2]);
  trait.flush();
  trait.flush();
  t.mock.timers.tick(1000);
  assert.deepEqual([sent.slice(1), trait.isAhead], [[["selected", [2]]], false]);
  trait.sendSoon([3]);
  trait.close();
  t.mock.timers.tick(1000);
  assert.deepEqual([sent.length, trait.isAhead], [2, false]);
});
