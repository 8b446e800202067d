"""Flow control of pictures sent to front ends: JPEG, numbered, as many in flight as confirmations allow.

Of many states the newest is sent: not before the front end has shown the one before, and not never.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from deformnb._threads import Timer
from deformnb._typing import Image
from deformnb.widgets.image_encoding import PREVIEW_SHARE, PREVIEW_SIZE, as_jpeg, as_png
from deformnb.widgets.messages.views import FrameSent
from deformnb.widgets.vtk.render_loop import Frame, LoopScene

_IN_FLIGHT = 2  # pictures that no front end has confirmed: the second hides the latency of the first
_LOST_AFTER = 2.0  # seconds; a front end that was closed confirms nothing


class FrameSender:
    """Makes messages of frames and records which of them have been seen; may be used by several threads.

    All front ends get all frames, so the slowest of those that answer sets the pace: pictures sent faster than a front
    end shows it would wait there, and the front end would lag behind more and more.

    Attributes
    ----------
    last : the newest frame.
    was_full : True while someone has been refused: the confirmation that makes room draws again.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number = self._last_bytes = self._bytes = 0
        self._sent: dict[int, float] = {}  # when, of the frames that some front end may still have to show
        self._seen: dict[str, int] = {}  # the newest frame of each front end that answers
        self.last: Frame | None = None
        self.was_full = False

    @property
    def may_send(self) -> bool:
        """True if few enough pictures are in flight; once it was False, :meth:`confirm` returns True in the end."""
        with self._lock:
            self.was_full = self._frames_in_flight() >= _IN_FLIGHT
            return not self.was_full

    def _frames_in_flight(self) -> int:
        """Count the frames that the slowest front end has yet to show, without those that are silent for too long."""
        late = time.monotonic() - _LOST_AFTER
        for view, newest in list(self._seen.items()):
            if any(at < late for number, at in self._sent.items() if number > newest):
                del self._seen[view]
        slowest = min(self._seen.values(), default=0)
        self._sent = {n: at for n, at in self._sent.items() if n > slowest and at >= late}
        return len(self._sent)

    def pack(self, frame: Frame, *, camera: int = 0, by: str = "") -> tuple[FrameSent, list[bytes]]:
        """The message of a frame and its buffers. It counts as sent.

        Parameters
        ----------
        camera : number of the change of the camera that it shows.
        by : id of the front end that made it.
        """
        buffers = [as_jpeg(image) for image in frame.images]
        with self._lock:
            self._number += 1
            number = self._number
            self.last = frame
            self._sent[number] = time.monotonic()
            self._last_bytes = sum(map(len, buffers))
            self._bytes += self._last_bytes
        return FrameSent(seq=number, full=frame.is_full, camera=camera, by=by), buffers

    def confirm(self, number: int, view: str = "") -> bool:
        """Record that a front end shows this frame. Returns whether a refused send may be made now."""
        with self._lock:
            self._seen[view] = max(min(number, self._number), self._seen.get(view, 0))
            return self._is_free_again()

    def remove_view(self, view: str) -> bool:
        """A front end is closed. Returns what :meth:`confirm` does."""
        with self._lock:
            self._seen.pop(view, None)
            return self._is_free_again()

    def forget_frames(self) -> None:
        """Drop the frames in flight, which have no receiver: a new front end did not exist when they were sent."""
        with self._lock:
            self._sent.clear()

    def _is_free_again(self) -> bool:
        if not self.was_full or self._frames_in_flight() >= _IN_FLIGHT:
            return False
        self.was_full = False
        return True

    def forget(self) -> None:
        """No front end is left that could confirm anything."""
        with self._lock:
            self._sent.clear()
            self._seen.clear()
            self.last = None

    def stats(self) -> dict[str, int]:
        """``bytes_per_frame`` (of the last), ``frame_bytes`` (of all) and ``sent`` (how many)."""
        return {"bytes_per_frame": self._last_bytes, "frame_bytes": self._bytes, "sent": self._number}


def draw_still(scene: LoopScene, size: tuple[int, int], shows: str, **options: Any) -> Image:
    """A picture of another size than the scene's own, which stays."""
    before = scene.size
    scene.set_size(size)
    try:
        image = scene.render(shows=shows, **options)
    finally:
        scene.set_size(before)
    assert image is not None
    return image


def preview_png(scene: LoopScene, shows: str) -> bytes:
    """A small picture as a PNG, from fewer pixels than it has: it must not hold up its cell."""
    from PIL import Image as Pillow

    few = Pillow.fromarray(draw_still(scene, PREVIEW_SIZE, shows, scale=PREVIEW_SHARE, coarseness=2.0))
    return as_png(np.asarray(few.resize(PREVIEW_SIZE, Pillow.Resampling.BICUBIC)))


_LOG = logging.getLogger(__name__)


class Pacer:
    """Sends the newest state as often as it is confirmed; what comes meanwhile replaces what waits.

    Parameters
    ----------
    send : called with a number that the front end confirms. It takes the newest picture itself. Calls never overlap.
    patience : seconds after which a state is sent though none has been confirmed: a kernel that runs a cell receives
        nothing from a view, and a hidden view draws nothing.
    """

    def __init__(self, send: Callable[[int], None], patience: float = 0.25) -> None:
        self._send, self.patience = send, patience
        self._lock = threading.RLock()  # offers come from cells and sliders, confirmations from another thread
        self._number = self._seen = 0
        self._sent = 0.0
        self._timer: Timer | None = None
        self._is_closed = False

    @property
    def is_waiting(self) -> bool:
        """True if a state has been offered and not yet sent."""
        return self._timer is not None

    @property
    def is_idle(self) -> bool:
        """True if all that was offered has been sent and confirmed."""
        with self._lock:
            return self._timer is None and self._seen == self._number

    def offer(self) -> None:
        """Offer a newer state: it is sent now, or as soon as the front end is ready."""
        with self._lock:
            if self._is_closed:
                return
            wait = self._sent + self.patience - time.monotonic() if self._number > self._seen else 0.0
            if wait <= 0:
                self._go()
            elif self._timer is None:
                self._timer = timer = Timer(wait, lambda: self._late(timer))
                timer.start()

    def confirm(self, number: int) -> None:
        """The front end shows or draws the state of this number."""
        with self._lock:
            self._seen = max(self._seen, min(number, self._number))
            if self._timer is not None and self._seen == self._number:
                self._go()

    def close(self) -> None:
        """Send nothing more, nor the waiting picture: the widget is closed. Does not wait for a send in progress."""
        self._is_closed = True
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()

    def _late(self, timer: Timer) -> None:
        with self._lock:
            if self._is_closed or self._timer is not timer:
                return  # it was sent meanwhile
            try:
                self._go()
            except Exception:  # in a separate thread nothing else would report it
                if not self._is_closed:
                    _LOG.exception("a deformation could not be sent to its front ends")

    def _go(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._number += 1
        self._send(self._number)
        self._sent = time.monotonic()
