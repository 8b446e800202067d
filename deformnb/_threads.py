"""Threads, and work at once where none can be started: Python in a browser (Pyodide, JupyterLite) has no threads."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

__all__ = ["Timer", "can_start_threads"]

_has_started = False  # only a success is remembered: a process may have too many threads for a while


def can_start_threads() -> bool:
    """Check whether this Python starts threads.

    >>> can_start_threads()
    True
    """
    global _has_started  # noqa: PLW0603
    if not _has_started:
        try:
            threading.Thread(target=int, name="deformnb-first", daemon=True).start()
        except RuntimeError:
            return False
        _has_started = True
    return True


class Timer:
    """A call after a delay, once: in a thread, else in the event loop that runs, else at the start without a delay.

    Parameters
    ----------
    delay : seconds.
    function : to call.

    Examples
    --------
    >>> called = threading.Event()
    >>> timer = Timer(0.001, called.set)
    >>> timer.start()
    >>> called.wait(10)
    True
    """

    def __init__(self, delay: float, function: Callable[[], object]) -> None:
        self._delay, self._function = delay, function
        self._handle: threading.Timer | asyncio.TimerHandle | None = None

    def start(self) -> None:
        """Begin to wait."""
        if can_start_threads():
            self._handle = thread = threading.Timer(self._delay, self._function)
            thread.daemon = True
            thread.start()
            return
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            self._function()
        else:
            self._handle = loop.call_later(self._delay, self._function)

    def cancel(self) -> None:
        """Do not call the function, if it is not being called already."""
        if self._handle is not None:
            self._handle.cancel()
