"""Waits of tests for states that other threads bring about; a state that is never reached fails the test."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

PATIENCE = 60.0  # seconds, on a machine that is busy with other tests


def wait_for(condition: Callable[[], Any], seconds: float = PATIENCE) -> None:
    """Wait until a condition holds.

    What another thread does behind it is not waited for: the condition must name all that the test requires next.
    """
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.005)


class Threads:
    """Threads that were started since this was made: those of others or from before do not count.

    Counts of all threads mislead: while one that this test must wait for begins, one of an earlier test may end.
    """

    def __init__(self) -> None:
        self._before = set(threading.enumerate())

    @property
    def alive(self) -> list[threading.Thread]:
        """Those that are still alive."""
        return [thread for thread in threading.enumerate() if thread not in self._before]

    def wait(self) -> None:
        """Wait until all of them have ended."""
        wait_for(lambda: not self.alive)
