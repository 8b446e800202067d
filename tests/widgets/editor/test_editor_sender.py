"""The editor's points on their way between windows and Python: whatever is late or crosses, all end with the same."""

from __future__ import annotations

from typing import Any

import pytest
from scripts import run_script

FILES = ("sync/host_model.js", "maths/points.js", "sync/edits.js")

# Time that runs from event to event, a kernel that takes one message at a time, and windows with lanes of their own.
# What one connection carries stays in order; trait updates and custom messages are two lanes, since a front end
# applies the former by promises. `service` and `delay` are the longest times, in milliseconds.
WORLD = """
function worldOf(seed, { delay, service, isPythons }) {
  let state = seed >>> 0, count = 0;
  const random = () => { state = (state + 0x6d2b79f5) >>> 0; let t = state;
    t = Math.imul(t ^ (t >>> 15), t | 1); t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296; };
  const w = { now: 0, queue: [], windows: [], random, taken: [] };
  w.later = (f, ms) => { const e = { at: w.now + ms, n: count++, f }; w.queue.push(e); return e; };
  w.cancel = (e) => { w.queue = w.queue.filter((other) => other !== e); };
  w.step = () => {
    if (w.queue.length === 0) return false;
    const e = w.queue.reduce((p, q) => (q.at < p.at || (q.at === p.at && q.n < p.n) ? q : p));
    w.cancel(e);
    w.now = e.at;
    e.f();
    return true;
  };
  w.until = (time) => { while (w.queue.some((e) => e.at <= time)) w.step(); w.now = time; };
  const lane = () => { let last = 0; return (f) => {
    last = Math.max(last + 1e-6, w.now + random() * delay); w.later(f, last - w.now); }; };
  const cutAt = w.cutAt = (name, a) => ({ name, enabled: true, region: { kind: "line", vertices: [[a, 0], [a, 9]] } });
  const place = (k) => ({ id: k, name: "", source: [k, k], target: [k, k], active: true, weight: 1 });
  const k = w.kernel = { points: [0, 1, 2].map(place), cuts: [], seen: {}, next_id: 3, free: 0, past: [], future: [] };
  const history = () => (isPythons ? { undo: k.past.length ? "edit" : "", redo: k.future.length ? "edit" : "" } : {});
  k.tell = (state) => { const text = JSON.stringify(state);
    for (const win of w.windows) win.updates(() => win.model.update(JSON.parse(text))); };
  k.set = (points) => { k.points = points; k.tell({ points });
    k.next_id = points.reduce((id, p) => Math.max(id, p.id + 1), k.next_id); k.tell({ next_id: k.next_id }); };
  k.setCuts = (cuts) => { k.cuts = cuts; k.tell({ cuts }); };
  k.done = () => { k.past.push({ points: k.points, cuts: k.cuts }); k.future = []; };
  k.own = (points) => { k.done(); k.set(points); k.tell({ history: history() }); };
  k.cut = (cuts) => { k.done(); k.setCuts(cuts); k.tell({ history: history() }); };
  k.take = (m) => {
    w.taken.push(m);
    if (m.type === "history") {
      const [from, to] = m.way === "undo" ? [k.past, k.future] : [k.future, k.past];
      if (from.length) {
        const { points, cuts } = from.pop();
        to.push({ points: k.points, cuts: k.cuts });
        k.set(points);
        k.setCuts(cuts);
        k.tell({ history: history() });
      }
    } else if (m.type === "shapes") k.cut(m.shapes.filter((cut) => cut.name !== "refused"));
    else if (m.phase === "end") k.own(m.points);
    if (m.phase !== "move") { k.seen = { ...k.seen, [m.sender]: m.seq }; k.tell({ seen: k.seen }); }
  };
  k.arrived = (win, m) => {
    const start = Math.max(k.free, w.now);
    k.free = start + random() * service; // callbacks run after the points are taken, and then comes the answer
    w.later(() => k.take(m), start - w.now);
    w.later(() => win.answers(() => win.model.receive({ type: "done", sender: m.sender, seq: m.seq })), k.free - w.now);
  };
  w.open = () => {
    const win = { updates: lane(), answers: lane(), messages: lane(), shown: [], status: [] };
    win.model = new PlainModel(JSON.parse(JSON.stringify({ points: k.points, cuts: k.cuts, parts: [], seen: k.seen,
      next_id: k.next_id, history: history() })), { deliver: (m) => { const t = JSON.stringify(m);
        win.messages(() => k.arrived(win, JSON.parse(t))); }, save: () => { throw new Error("a trait was saved"); } });
    win.sender = new Sender({ now: () => w.now, later: w.later, cancel: w.cancel });
    win.sender.attach(win.model);
    win.views = [0, 1].map(() => { const view = { points: win.sender.points };
      win.sender.listen(() => { view.points = win.sender.points; }); return view; });
    win.sender.listen((what) => {
      if (what === "points") win.shown.push(win.sender.points.map((p) => p.target[0]));
      if (what === "status") win.status.push(win.sender.status);
    });
    const buttons = () => { win.lit = ["undo", "redo"].map((way) => win.sender.canStep(way)); }; // as a page draws them
    buttons();
    win.sender.listen(buttons);
    win.model.on("change:history", buttons);
    w.windows.push(win);
    return win;
  };
  w.act = (win) => {
    const { sender } = win, { points } = sender, r = random();
    const moved = () => points.map((p) => ({ ...p, target: [Math.floor(1000 * random()), w.now] }));
    if (r < 0.35) sender.edit(moved(), "move");
    else if (r < 0.5) sender.edit(addedPoint(points, nextId(points, sender.nextId), [w.now, 1], [w.now, 1]), "add");
    else if (r < 0.6 && points.length) sender.edit(points.slice(1), "remove");
    else if (r < 0.75) sender.step("undo");
    else if (r < 0.83) sender.step("redo");
    else if (r < 0.9) {
      const cut = cutAt(random() < 0.2 ? "refused" : "", w.now);
      sender.editShapes("cuts", [...sender.shapes.cuts.slice(-2), cut], "add cut");
    }
    else for (let i = 0; i < 4; i++) sender.move(moved());
  };
  return w;
}
"""


def played(seeds: list[int], main: str, **options: Any) -> Any:
    text = f"({{ seeds, options }}) => {{ {WORLD} return seeds.map((seed) => ({main})(worldOf(seed, options))); }}"
    options = {"delay": 50, "service": 20, "isPythons": False, **options}
    return run_script(FILES, text, {"seeds": seeds, "options": options})


@pytest.mark.sampled(4)
@pytest.mark.parametrize("is_pythons", [False, True])
@pytest.mark.parametrize(("delay", "service"), [(1, 1), (300, 50), (30, 900), (3000, 3000), (20000, 500)])
def test_windows_views_and_python_end_with_the_same(delay: int, service: int, is_pythons: bool) -> None:
    main = """(w) => {
      w.open(); w.open();
      for (let n = 0; n < 40; n++) {
        const r = w.random();
        if (r < 0.15) w.kernel.own(w.kernel.points.map((p) => ({ ...p, target: [-n, w.random()] })));
        else if (r < 0.18 && w.windows.length < 5) w.open(); // as if the page was loaded again, beside the old one
        else w.act(w.windows[Math.floor(w.random() * w.windows.length)]);
        w.until(w.now + w.random() ** 3 * 1500);
      }
      while (w.step());
      const all = w.windows.flatMap((win) => [win.sender.points, ...win.views.map((v) => v.points)]);
      const ids = w.taken.filter((m) => m.type === "edit" && m.phase === "end").map((m) => m.points.map((p) => p.id));
      const { past, future } = w.kernel;
      return { isSame: all.every((points) => samePoints(points, w.kernel.points)),
        isLit: !options.isPythons || w.windows.every(({ lit }) =>
          sameShapes(lit, [past.length > 0, future.length > 0])),
        isCutTheSame: w.windows.every((win) => sameShapes(win.sender.shapes.cuts, w.kernel.cuts)),
        isAllTaken: w.windows.every((win) => !win.sender.isBehind() && !win.sender.pending.move),
        isUnique: ids.every((list) => new Set(list).size === list.length) };
    }"""
    outcomes = played(list(range(40)), main, delay=delay, service=service, isPythons=is_pythons)
    wanted = dict.fromkeys(["isSame", "isLit", "isCutTheSame", "isAllTaken", "isUnique"], True)
    assert outcomes == [wanted] * 40


def test_no_echo_of_an_old_state_is_shown_between_quick_edits() -> None:
    main = """(w) => {
      const { sender, shown } = w.open();
      sender.edit(sender.points.map((p) => ({ ...p, target: [p.id + 10, 0] })), "move");
      w.until(w.now + 3);
      sender.edit(sender.points.slice(1), "remove");
      w.until(w.now + 3); sender.step("undo");
      w.until(w.now + 3); sender.step("undo");
      while (w.step()); // the last waits here for the answer to the first
      return [shown, w.kernel.points.map((p) => p.target[0])];
    }"""
    ways = [[10, 11, 12], [11, 12], [10, 11, 12], [0, 1, 2]]
    assert played(list(range(20)), main, delay=400, service=100) == [[ways, [0, 1, 2]]] * 20


def test_python_goes_last_if_it_comes_last_and_the_page_may_undo_it() -> None:
    main = """(w) => {
      const { sender } = w.open();
      sender.edit(sender.points.slice(1), "remove");
      while (w.step());
      w.kernel.own(w.kernel.points.slice(1));
      while (w.step());
      const ids = [sender.points.map((p) => p.id)];
      for (let n = 0; n < 3; n++) { sender.step("undo"); while (w.step()); ids.push(w.kernel.points.map((p) => p.id)); }
      return ids;
    }"""
    assert played([1], main) == [[[2], [1, 2], [0, 1, 2], [0, 1, 2]]]


def test_a_busy_kernel_gets_the_newest_and_knows_what_was_joined() -> None:
    main = """(w) => {
      const { sender, status } = w.open();
      w.kernel.free = 3500; // it works on something else
      for (let n = 0; n < 8; n++) {
        const [kind, join] = n === 3 || n === 4 ? ["move", null] : ["nudge", "nudge 1"];
        sender.edit(sender.points.map((p) => ({ ...p, target: [n, n] })), kind, join);
        w.until(w.now + 10);
      }
      while (w.step());
      return [w.taken.map((m) => [m.kind, m.joins, m.points[0].target[0]]), status, sender.isBehind()];
    }"""
    ((taken, status, is_behind),) = played([1], main, delay=5)
    # Joining goes by the wall clock, as the user's hand does: eight edits at once are well within 0.8 seconds.
    assert taken == [["nudge", False, 0], ["nudge", True, 1], ["several", False, 7]]
    assert status == ["silent", ""]
    assert is_behind is False


def test_movements_never_queue_up() -> None:
    main = """(w) => {
      const { sender } = w.open();
      for (let n = 1; n <= 200; n++) { sender.move([n]); w.until(w.now + 16); }
      sender.edit(sender.points.slice(1), "move");
      while (w.step());
      const moves = w.taken.filter((m) => m.phase === "move").map((m) => m.points[0]);
      return { moves: moves.length, isRising: moves.every((n, k) => k === 0 || n > moves[k - 1]), at: w.now,
        last: w.taken.at(-1).phase };
    }"""
    (outcome,) = played([3], main, delay=1, service=400)
    # 3.2 seconds of a drag, some 200 ms for each of the kernel's answers: the rest was never sent.
    assert 8 <= outcome["moves"] <= 40
    assert outcome["isRising"]
    assert outcome["last"] == "end"
    assert outcome["at"] < 3200 + 3 * 400 + 2000  # and the watch that ends it


def test_a_lost_connection_is_said_and_blocks_nothing() -> None:
    main = """(w) => {
      const { sender, model, status } = w.open(), send = model.send.bind(model), sent = [];
      model.send = () => { throw new Error("Cannot send"); };
      for (let n = 0; n < 3; n++) sender.edit(sender.points.map((p) => ({ ...p, target: [n, 9] })), "move");
      while (w.step());
      const shown = sender.points[0].target[0];
      model.send = (m) => { sent.push(m.seq); send(m); };
      sender.edit(sender.points.slice(1), "remove");
      while (w.step());
      const end = w.kernel.points.map((p) => p.target[0]);
      return [shown, new Set(status.slice(0, -1)).size, status[0], status.at(-1), end];
    }"""
    assert played([1], main) == [[2, 1, "lost", "", [2, 2]]]


@pytest.mark.parametrize(("kernel", "said"), [("idle", ["silent", "deaf", ""]), ("busy", ["silent", ""])])
def test_a_model_that_hears_nothing_of_an_idle_kernel_is_told_from_a_busy_one(kernel: str, said: list[str]) -> None:
    main = """(w) => {
      const { sender, model, status } = w.open();
      model.widget_manager = { kernel: { status: options.kernel } };
      sender.edit(sender.points.slice(1), "remove");
      w.queue = w.queue.filter((e) => e.at === w.now + 2000); // the answer never comes, but time goes on
      while (w.step());
      sender.done(sender.seq);
      return status;
    }"""
    assert played([1], main, kernel=kernel) == [said]


GREETED: dict[str, list[str]] = {"idle": ["deaf"], "busy then idle": ["deaf"], "busy then answered": [],
                                 "none": ["lost"], "unknown": []}


@pytest.mark.parametrize("kernel", GREETED)
def test_a_page_that_opens_says_when_nobody_hears_it(kernel: str) -> None:
    main = """(w) => {
      const { sender, model, status } = w.open(), sent = [], [first, then] = options.kernel.split(" then ");
      model.send = (message) => sent.push(message);
      const shown = { none: null, unknown: undefined }, kernel = { status: first };
      model.widget_manager = { kernel: first in shown ? shown[first] : kernel };
      sender.greet(); sender.greet();
      w.until(w.now + 9000);
      const early = [...status];
      if (then === "answered") sender.done(0);
      kernel.status = "idle";
      w.until(w.now + 9000);
      sender.done(0);
      w.until(w.now + 9000);
      return [sent.map((m) => m.type), first === "busy" ? early : [], [...status].filter(Boolean), status.at(-1) ?? ""];
    }"""
    assert played([1], main, kernel=kernel) == [[["greet"] if kernel != "unknown" else [], [], GREETED[kernel], ""]]


def test_an_answer_that_is_lost_does_not_hide_python_for_ever() -> None:
    main = """(w) => {
      const { sender, model } = w.open();
      sender.edit(sender.points.slice(1), "remove");
      w.queue = []; // neither points nor answer ever come
      w.until(w.now + 3000);
      model.update({ points: [] });
      const soon = sender.points.length;
      w.until(w.now + 8000);
      model.update({ points: w.kernel.points.slice(2) });
      return [soon, sender.points.map((p) => p.id)];
    }"""
    assert played([1], main) == [[2, [2]]]


def test_python_undoes_what_has_not_arrived_yet() -> None:
    main = """(w) => {
      const { sender } = w.open();
      const isOff = !sender.step("undo");
      for (let n = 1; n <= 4; n++) sender.edit(sender.points.map((p) => ({ ...p, target: [n, n] })), "move");
      sender.step("undo"); sender.step("undo");
      while (w.step());
      const taken = w.taken.map((m) => m.way ?? m.points[0].target[0]);
      return [isOff, taken, sender.points[0].target[0], w.kernel.past.length];
    }"""
    # Two were in flight, the third and fourth went as one before the undo.
    assert played([1], main, isPythons=True) == [[True, [1, 2, 4, "undo", "undo"], 1, 1]]


def test_what_can_be_done_again_is_known_before_python_has_answered() -> None:
    main = """(w) => {
      const win = w.open(), { sender } = win, lit = [];
      const look = (act) => { act(); lit.push(["undo", "redo"].map((way) => sender.canStep(way))); };
      const move = () => sender.edit(sender.points.map((p) => ({ ...p, target: [w.now, 9] })), "move");
      look(() => {}); look(move); look(() => sender.step("undo")); look(() => sender.step("redo"));
      look(() => sender.step("undo")); look(move); // right after the undo: nothing is left to do again
      while (w.step());
      look(() => {});
      return [lit, win.lit];
    }"""
    ((lit, shown),) = played([1], main, isPythons=True)
    assert lit == [[False, False], [True, False], [True, True], [True, True], [True, True], [True, False],
                   [True, False]]
    assert shown == [True, False]


def test_shapes_go_behind_the_points_before_them_and_are_undone_in_order() -> None:
    main = """(w) => {
      const { sender } = w.open();
      for (let n = 1; n <= 4; n++) sender.edit(sender.points.map((p) => ({ ...p, target: [n, n] })), "move");
      sender.editShapes("cuts", [w.cutAt("", 5)], "add cut");
      sender.edit(sender.points.slice(1), "remove");
      sender.step("undo"); sender.step("undo");
      const shown = [sender.points.length, sender.shapes.cuts.length];
      while (w.step());
      return [shown, w.taken.map((m) => m.kind), w.kernel.cuts.length, w.kernel.points.map((p) => p.target[0])];
    }"""
    # Two edits were in flight, the third and fourth went as one before the cut.
    ((shown, taken, cuts, targets),) = played([1], main)
    assert taken == ["move", "move", "move", "add cut", "several", "undo"]
    assert (shown, cuts, targets) == ([3, 0], 0, [4, 4, 4])


def test_shapes_that_python_does_not_take_are_given_up() -> None:
    main = """(w) => {
      const { sender } = w.open();
      sender.editShapes("cuts", [w.cutAt("refused", 5)], "add cut");
      const before = sender.shapes.cuts.length;
      while (w.step());
      return [before, sender.shapes.cuts.length, sender.isBehind()];
    }"""
    assert played([1], main) == [[1, 0, False]]
