"""When a live view draws: a page that moves a point beside it is never made to wait for the card, nor asked in vain."""

from __future__ import annotations

from typing import Any

import pytest
from scripts import run_script

FILES = ("view/render_loop.js",)

# A page with a clock of its own: timers, frames, and a card that takes its time. What is put together for the screen
# waits for all that the card was given if a canvas has changed, as browsers do that draw without a card.
PAGE = """
function played({ pixelCost, seconds, moves, isSoftware }) {
  let clock = 0, free = 0, count = 0, isDirty = false, queue = [];
  const log = { waits: [], casts: [], presents: [], caughtUp: 0, moves: 0, reported: 0 };
  const later = (run, at, isFrame) => { queue.push({ run, at, isFrame, id: ++count }); return count; };
  const forget = (id) => { queue = queue.filter((task) => task.id !== id); };
  Object.defineProperty(globalThis, "performance", { value: { now: () => clock }, configurable: true, writable: true });
  globalThis.setTimeout = (run, ms = 0) => later(run, clock + ms, false);
  globalThis.requestAnimationFrame = (run) => later(run, 0, true);
  globalThis.clearTimeout = globalThis.cancelAnimationFrame = forget;
  const give = (ms) => { free = Math.max(free, clock) + ms; };
  const gl = { SIGNALED: 1, SYNC_STATUS: 2, SYNC_GPU_COMMANDS_COMPLETE: 3, isContextLost: () => false, flush() {},
    deleteSync() {}, fenceSync: () => ({ at: free }), getSyncParameter: (sync) => (clock >= sync.at ? 1 : 0) };
  const caster = { gl, isReady: true, isSoftware, canvas: { width: 600, height: 450 },
    cast(name, width, height, picture, { tile }) {
      log.casts.push([clock, name]);
      give(pixelCost * tile[2] * tile[3]);
    },
    enlarge() { give(1); },
    present(name) { isDirty = true; log.presents.push([clock, name]); give(0.5); } };
  const loop = new FrameLoop(caster, (width) => [{ layer: 0, x: 0, width, original: false }],
    () => ({ target: 80, settle: 200 }), () => { log.reported = clock; }, () => { log.caughtUp += 1; });
  for (let k = 0; k < moves; k++) {
    later(() => { log.moves += 1; loop.touch(true); if (k === moves - 1) loop.release(); }, 16 * k, false);
  }
  for (let frame = 16; clock < 1e3 * seconds; frame = Math.max(frame + 16, 16 * Math.ceil(clock / 16))) {
    for (;;) { // what comes before the frame, in the order of time
      queue.sort((a, b) => a.at - b.at || a.id - b.id);
      const next = queue.find((task) => !task.isFrame && task.at <= frame);
      if (!next) break;
      forget(next.id);
      clock = Math.max(clock, next.at);
      next.run();
    }
    clock = Math.max(clock, frame);
    const frames = queue.filter((task) => task.isFrame);
    for (const task of frames) { forget(task.id); task.run(); }
    if (isDirty) { log.waits.push(Math.max(0, free - clock)); clock = Math.max(clock, free); isDirty = false; }
  }
  return log;
}
"""
BUSY = {"pixelCost": 2e-3, "seconds": 12, "moves": 150, "isSoftware": True}


def play(**options: Any) -> Any:
    return run_script(FILES, f"(data) => {{ {PAGE} return played(data); }}", {**BUSY, **options})


def test_no_frame_waits_for_rays() -> None:
    log = play()
    assert len(log["waits"]) > 15
    assert max(log["waits"]) <= 1  # what it takes to put a finished picture on the canvas


def test_the_volume_follows_a_hand_and_is_drawn_in_full_when_it_rests() -> None:
    log = play()
    last = 16 * (log["moves"] - 1)
    quick = [at for at, name in log["presents"] if at <= last]
    assert len(quick) / (last / 1e3) > 6
    assert log["reported"] > last + 200
    assert log["presents"][-1][1] == "full0"
    full = [at for at, name in log["casts"] if name == "full0"]
    assert min(full) > last  # nothing in full under a hand that moves
    # Two passes in pieces of 40 ms, each of which may wait for two frames.
    assert log["reported"] - min(full) < 2 * 2e-3 * 600 * 450 * (40 + 2 * 16) / 40


def test_maps_are_asked_for_once_for_a_picture_and_not_at_every_movement() -> None:
    log = play(moves=150)
    until = 16 * (log["moves"] - 1)
    pictures = len([at for at, name in log["presents"] if at <= until])
    tiles = len([name for _, name in log["casts"] if name == "full0"])
    assert log["caughtUp"] <= pictures + 2 + tiles
    assert pictures < log["moves"] / 3


def test_a_processor_that_draws_rests_between_pictures_however_often_the_hand_moves() -> None:
    log = play()
    last = 16 * (log["moves"] - 1)
    shown = [at for at, _ in log["presents"] if at < last]
    coarse = [at for at, name in log["casts"] if name == "coarse0"]
    after = [min(at for at in coarse if at > done) - done for done in shown[5:-1]]
    assert min(after) > 36
    card = play(isSoftware=False, pixelCost=2e-5)
    shown = [at for at, _ in card["presents"] if at < last]
    assert len(shown) / (last / 1e3) > 25  # a card needs no rest


@pytest.mark.parametrize("moves", [1, 2])
def test_a_single_movement_is_drawn_at_once(moves: int) -> None:
    log = play(moves=moves)
    assert log["presents"][0][0] < 200


LINK = """(details) => {
  const told = [], link = new FieldLink(null, () => told.push("maps"), (isMoving) => told.push(isMoving));
  link.settled = JSON.stringify([]) + JSON.stringify({});
  for (const [phase, draws] of details) {
    link.moved({ phase, points: [], settings: {} });
    if (draws) { told.push(Boolean(link.awaited)); link.catchUp(); told.push(Boolean(link.awaited)); }
  }
  return told;
}"""


def test_the_end_of_a_movement_is_told_though_it_ends_where_it_began() -> None:
    """Else the view would wait for a hand that has long let go, and stay coarse."""
    unseen = run_script(("view/follow_editor.js",), LINK, [["move", False], ["move", False], ["end", False]])
    assert unseen == [True, True, False]
    drawn = run_script(("view/follow_editor.js",), LINK, [["move", True], ["end", True]])
    assert drawn == [True, True, False, False, False, False]
