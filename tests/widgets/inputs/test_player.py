"""The player in Python: what a page may say, and the clock itself run by hand."""

from __future__ import annotations

import logging
from typing import Any

import pytest
from scripts import run_script

from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.widgets.inputs.player import Player


def animation(*times: float, **options: Any) -> Animation:
    points = ControlPoints.from_arrays([[0.0, 0.0], [10.0, 0.0]])
    step = Step((points,), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    return Animation(Deformation(keyframes=tuple(Keyframe(t, (step,)) for t in times)), **options)


def test_it_shows_the_key_frames_of_an_animation() -> None:
    player = Player(animation(0, 0.5, 3, loop="swing"))
    assert (player.duration, player.marks, player.loop) == (3.0, [0.0, 0.5, 3.0], "swing")
    player.time = 2.5
    player.take(animation(0, 2))
    assert (player.time, player.marks) == (2.0, [0.0, 2.0])
    assert Player(animation(0, 1, loop="loop"), loop="once").loop == "once"


def test_times_stay_within_the_duration() -> None:
    player = Player(duration=2.0)
    for asked, shown in ((1.5, 1.5), (9.0, 2.0), (-1.0, 0.0)):
        player.time = asked
        assert player.time == shown
    with pytest.raises(DeformError, match="finite"):
        player.time = float("nan")
    player.play()
    assert player.is_playing
    player.pause()
    assert not player.is_playing


def test_the_page_decides_on_what_it_plays_and_on_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    player = Player(duration=2.0)
    player.set_state({"time": 1.25, "is_playing": True, "speed": 0.5, "loop": "loop"})
    assert (player.time, player.is_playing, player.speed, player.loop) == (1.25, True, 0.5, "loop")
    with caplog.at_level(logging.WARNING):
        player.set_state({"duration": 99.0, "time": "now", "speed": 1e9, "loop": "never", "uid": "x",
                          "_esm": "alert()"})
    assert len(caplog.records) == 6
    assert (player.time, player.duration, player.speed, player.loop) == (1.25, 2.0, 0.5, "loop")
    player.set_state({"time": float("inf")})
    assert player.time == 1.25


CLOCK = """
function main({ loop, duration, speed, ticks, start }) {
  let next = null;
  const page = { requestAnimationFrame: (f) => { next = f; return 1; }, cancelAnimationFrame: () => { next = null; } };
  const told = [], clock = new PlayClock((d) => told.push(d), page);
  clock.set({ duration, speed, loop });
  clock.seek(start);
  clock.play();
  for (const now of ticks) { const f = next; next = null; if (f) f(now); }
  const before = clock.time;
  const wasPlaying = clock.isPlaying;
  clock.play();
  const again = clock.time;
  clock.pause();
  clock.set({ loop: "once" });
  return { times: told.map((d) => d.time), before, wasPlaying, again, kept: clock.time, waits: next !== null };
}
"""


def clock(**options: Any) -> Any:
    given = {"loop": "once", "duration": 1.0, "speed": 1.0, "start": 0.0, "ticks": [], **options}
    return run_script(("inputs/player.js",), CLOCK, given)


def test_the_clock_plays_once_and_ends_exactly() -> None:
    made = clock(ticks=[1000 + 100 * k for k in range(15)])
    assert made["before"] == 1.0
    assert not made["wasPlaying"]
    assert made["again"] == 0  # from the beginning again
    assert made["times"][3:6] == pytest.approx([0, 0.1, 0.2])
    half = clock(ticks=[1000, 1200], speed=0.5, start=0.25)
    assert half["before"] == pytest.approx(0.35)
    assert half["wasPlaying"]
    assert not half["waits"]  # it was paused


def test_the_clock_goes_round_and_back() -> None:
    ticks = [0, *(200 * k for k in range(1, 8))]  # 1.4 s of a second
    assert clock(loop="loop", ticks=ticks)["before"] == pytest.approx(0.4)
    back = clock(loop="swing", ticks=ticks)
    assert back["before"] == pytest.approx(0.6)
    assert back["kept"] == pytest.approx(0.6)  # another loop goes on from the moment that is shown


def test_the_clock_does_not_leap_over_time_that_nobody_saw() -> None:
    assert clock(ticks=[0, 60_000], duration=10.0)["before"] == pytest.approx(0.25)
    assert clock(duration=0.0, ticks=[0, 100])["before"] == 0
