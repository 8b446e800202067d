"""The loop that draws a scene: the newest of all changes, quick and then full pictures, error messages. No VTK."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from waiting import PATIENCE, wait_for

from deformnb.errors import DeformError
from deformnb.widgets.view.transport import FrameSender
from deformnb.widgets.vtk.render_loop import Frame, SceneLoop


class Canvas:
    """A scene of one grey level: every picture shows its inputs."""

    def __init__(self) -> None:
        self.grey, self.size, self.asked, self.closed = 0, (40, 30), [], 0
        self.gate = threading.Event()
        self.gate.set()
        self.threads: set[threading.Thread] = set()

    def set_size(self, size: tuple[int, int]) -> None:
        self.size = size

    def render(
        self,
        *,
        scale: float = 1.0,
        coarseness: float = 1.0,
        shows: str | None = None,
        bands: int = 1,
        interrupted: Callable[[], bool] | None = None,
    ) -> Any:
        self.threads.add(threading.current_thread())
        self.asked.append((scale, shows, interrupted is not None))
        self.gate.wait(PATIENCE)
        if interrupted is not None and interrupted():
            return None
        grey = 255 - self.grey if shows == "original" else self.grey
        return np.full((max(1, int(30 * scale)), max(1, int(40 * scale)), 3), grey, np.uint8)

    def close(self) -> None:
        self.closed += 1


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has priorities of threads")
def test_drawing_and_what_it_starts_gives_way_to_others() -> None:
    def way() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    def started(_canvas: Any) -> tuple[int, int]:
        found: list[int] = []
        own = threading.Thread(target=lambda: found.append(way()))
        own.start()
        own.join()
        return way(), found[0]

    before = way()
    loop, *_ = open_loop()
    try:
        assert loop.do(started).result(PATIENCE) == (max(5, before), max(5, before))
        assert way() == before
    finally:
        loop.close()


def open_loop(**options: Any) -> tuple[SceneLoop, Canvas, list[Frame], list[str]]:
    canvas, frames, said = Canvas(), [], []
    loop = SceneLoop(lambda: canvas, frames.append, said.append, **{"settle_ms": 0.0, **options})
    return loop, canvas, frames, said


def grey(value: int) -> Callable[[Canvas], None]:
    return lambda canvas: setattr(canvas, "grey", value)


def test_a_change_is_drawn_quickly_and_then_in_full_by_another_thread() -> None:
    loop, canvas, frames, said = open_loop()
    loop.change("grey", grey(7))
    wait_for(lambda: loop.is_settled)
    assert [f.is_full for f in frames] == [False, True]
    assert frames[0].images[0].shape[0] < frames[1].images[0].shape[0] == 30
    assert int(frames[1].images[0][0, 0, 0]) == 7
    assert canvas.threads.isdisjoint({threading.current_thread()})
    assert len(canvas.threads) == 1
    assert loop.pace.stats()["frames"] == 2
    loop.close()
    wait_for(lambda: canvas.closed == 1)
    assert said == []


def test_of_many_changes_the_newest_is_drawn_and_the_last_always() -> None:
    loop, canvas, frames, _ = open_loop()
    canvas.gate.clear()
    for k in range(50):
        loop.change("grey", grey(k))
    canvas.gate.set()
    wait_for(lambda: bool(frames) and frames[-1].is_full and int(frames[-1].images[0][0, 0, 0]) == 49)
    assert len(canvas.asked) < 10
    loop.close()


def test_a_full_picture_gives_way_to_a_change_and_is_drawn_after_it() -> None:
    loop, canvas, frames, _ = open_loop()
    loop.change("grey", grey(1))
    wait_for(lambda: bool(frames))
    canvas.gate.clear()
    loop.change("grey", grey(2))
    wait_for(lambda: len(canvas.asked) > 1 or canvas.grey == 2)
    loop.change("grey", grey(3))
    canvas.gate.set()
    wait_for(lambda: frames[-1].is_full and int(frames[-1].images[0][0, 0, 0]) == 3)
    assert all(int(f.images[0][0, 0, 0]) != 2 for f in frames if f.is_full)
    loop.close()


def test_what_goes_wrong_is_said_and_the_other_changes_are_made() -> None:
    loop, _, frames, said = open_loop()

    def wrong(canvas: Canvas) -> None:
        raise DeformError("this cannot be")

    loop.change("bad", wrong, draw=False)
    loop.change("grey", grey(9))
    wait_for(lambda: bool(frames))
    assert said == ["this cannot be"]
    assert int(frames[0].images[0][0, 0, 0]) == 9
    loop.close()


def test_a_scene_that_cannot_be_made_is_said_and_tried_again() -> None:
    frames, said, canvas = [], [], Canvas()
    makes = iter([ZeroDivisionError("no"), None])

    def make() -> Canvas:
        error = next(makes)
        if error is not None:
            raise error
        return canvas

    loop = SceneLoop(make, frames.append, said.append, settle_ms=0.0)
    loop.touch()
    wait_for(lambda: bool(said))
    assert said == ["ZeroDivisionError: no"]
    loop.touch()
    wait_for(lambda: bool(frames))
    loop.close()


@pytest.mark.parametrize("shows", ["flicker", "wipe"])
def test_both_pictures_of_one_place_are_delivered(shows: str) -> None:
    loop, _, frames, _ = open_loop()
    loop.set_shows(shows)
    loop.change("grey", grey(5))
    wait_for(lambda: bool(frames))
    assert [int(i[0, 0, 0]) for i in frames[0].images] == [5, 250]
    loop.close()


def test_what_is_asked_of_the_scene_comes_after_the_changes_and_from_elsewhere_only() -> None:
    loop, _, _, _ = open_loop()
    loop.change("grey", grey(4), draw=False)
    assert loop.do(lambda canvas: canvas.grey).result(PATIENCE) == 4
    with pytest.raises(DeformError, match="would wait for itself"):
        loop.do(lambda canvas: loop.do(lambda c: c.grey).result(PATIENCE)).result(PATIENCE)
    loop.close()


def test_slow_pictures_get_smaller_and_fast_ones_larger() -> None:
    loop, _, frames, _ = open_loop(target_ms=1e-3, settle_ms=60000.0)
    for k in range(6):
        loop.change("grey", grey(k))
        wait_for(lambda k=k: len(frames) == k + 1)
    small = loop.pace.stats()["scale"]
    assert small == pytest.approx(0.12)
    loop.pace.target_ms = 1e6
    for k in range(6, 9):
        loop.change("grey", grey(k))
        wait_for(lambda k=k: len(frames) == k + 1)
    assert loop.pace.stats()["scale"] == pytest.approx(0.12 * 1.35**3)
    loop.close()


def test_no_third_picture_is_sent_before_one_is_seen() -> None:
    sender = FrameSender()
    loop, _, frames, _ = open_loop(ready=lambda: sender.may_send, settle_ms=60000.0)
    frame = Frame((np.zeros((4, 4, 3), np.uint8),), is_full=False)
    assert [sender.pack(frame)[0].seq for _ in range(2)] == [1, 2]
    loop.change("grey", grey(1))
    wait_for(lambda: sender.was_full)
    assert frames == []
    assert sender.confirm(1)  # and a refused sender is called again
    loop.touch()
    wait_for(lambda: bool(frames))
    assert not sender.confirm(2)
    loop.close()


def test_all_is_settled_once_the_full_picture_of_the_last_wish_is_delivered() -> None:
    loop, canvas, frames, _ = open_loop()
    loop.change("grey", grey(1))
    assert not loop.is_settled
    wait_for(lambda: loop.is_settled)
    assert frames[-1].is_full
    canvas.gate.clear()
    loop.change("grey", grey(2))
    wait_for(lambda: len(canvas.asked) > 2)
    loop.change("grey", grey(3))
    assert not loop.is_settled
    canvas.gate.set()
    wait_for(lambda: loop.is_settled)
    assert int(frames[-1].images[0][0, 0, 0]) == 3
    loop.close()
