"""When the newest of many states may go to a page: not before it has shown the one before, and not never."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

_LOG = logging.getLogger(__name__)


class Pacer:
    """Sends the newest state as often as it is confirmed; what comes meanwhile replaces what waits.

    Parameters
    ----------
    send : called with a number that the page confirms. It looks up what is newest itself. Calls never overlap.
    patience : seconds after which a state is sent though none has been confirmed: a kernel that runs a cell hears no
        page, and a hidden page draws nothing.
    """

    def __init__(self, send: Callable[[int], None], patience: float = 0.25) -> None:
        self._send, self._patience = send, patience
        self._lock = threading.RLock()  # offers come from cells and sliders, confirmations from another thread
        self._number = self._seen = 0
        self._sent = 0.0
        self._timer: threading.Timer | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether a state has been offered and not yet sent."""
        return self._timer is not None

    def offer(self) -> None:
        """There is a newer state: send it now, or as soon as the page is ready."""
        with self._lock:
            wait = self._sent + self._patience - time.monotonic() if self._number > self._seen else 0.0
            if wait <= 0:
                self._go()
            elif self._timer is None:
                self._timer = threading.Timer(wait, self._late)
                self._timer.daemon = True
                self._timer.start()

    def seen(self, number: int) -> None:
        """The page shows the state of this number."""
        with self._lock:
            self._seen = max(self._seen, min(number, self._number))
            if self._timer is not None and self._seen == self._number:
                self._go()

    def _late(self) -> None:
        with self._lock:
            if self._timer is not threading.current_thread():
                return  # it was sent meanwhile
            try:
                self._go()
            except Exception:  # in a thread of its own nobody else would hear of it
                _LOG.exception("a deformation could not be sent to its pages")

    def _go(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._number += 1
        self._send(self._number)
        self._sent = time.monotonic()
