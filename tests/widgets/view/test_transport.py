"""Pictures in flight to several front ends: the slowest that answers sets the pace, and one that is silent does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.widgets.view import transport as frames
from deformnb.widgets.view.transport import FrameSender
from deformnb.widgets.vtk.render_loop import Frame

FRAME = Frame((np.zeros((4, 4, 3), np.uint8),), is_full=False)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Any:
    class Clock:
        now = 100.0

        def monotonic(self) -> float:
            return self.now

    made = Clock()
    monkeypatch.setattr(frames, "time", made)
    return made


def test_the_slowest_of_two_pages_sets_the_pace(clock: Any) -> None:
    sender = FrameSender()
    sender.pack(FRAME)
    for page in ("quick", "slow"):
        sender.confirm(1, page)
    for number in (2, 3):
        assert sender.may_send
        assert sender.pack(FRAME)[0].seq == number
    assert not sender.may_send
    assert not sender.confirm(3, "quick")  # nobody draws for that: the other has two to show yet
    assert not sender.may_send
    assert sender.confirm(2, "slow")
    assert sender.may_send


def test_a_page_that_is_silent_or_gone_holds_nobody_back(clock: Any) -> None:
    sender = FrameSender()
    for page in ("quick", "slow"):
        sender.confirm(0, page)
    for number in (1, 2):
        sender.pack(FRAME)
        sender.confirm(number, "quick")
    assert not sender.may_send
    clock.now += 1.0
    assert not sender.may_send
    clock.now += 1.5
    assert sender.may_send
    sender.confirm(1, "slow")  # it is there again
    for number in (3, 4):
        sender.pack(FRAME)
        sender.confirm(number, "quick")
    assert not sender.may_send
    assert sender.remove_view("slow")
    assert sender.may_send


def test_what_was_sent_to_nobody_does_not_hold_back_a_page_that_is_new(clock: Any) -> None:
    sender = FrameSender()
    for _ in range(2):
        sender.pack(FRAME)
    assert not sender.may_send
    sender.forget_frames()
    for _ in range(4):
        assert sender.may_send
        sender.confirm(sender.pack(FRAME)[0].seq, "new")


def test_a_page_cannot_confirm_what_was_not_sent(clock: Any) -> None:
    sender = FrameSender()
    sender.confirm(2**50, "odd")
    for _ in range(2):
        sender.pack(FRAME)
    assert not sender.may_send
