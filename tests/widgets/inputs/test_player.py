"""The player in Python, and messages of a front end."""

from __future__ import annotations

import logging
from typing import Any

import pytest

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
        player.set_state(
            {"duration": 99.0, "time": "now", "speed": 1e9, "loop": "never", "uid": "x", "_esm": "alert()"}
        )
    assert len(caplog.records) == 6
    assert (player.time, player.duration, player.speed, player.loop) == (1.25, 2.0, 0.5, "loop")
    player.set_state({"time": float("inf")})
    assert player.time == 1.25
