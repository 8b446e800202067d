"""Render loop of a scene: quick pictures while something changes, the full one at rest. No Jupyter, no VTK in here.

The scene is made, drawn and closed by one thread. Changes may come from any thread and faster than pictures: of each
kind only the newest stays, and the last is always drawn.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from deformnb._typing import Image
from deformnb.errors import DeformError
from deformnb.widgets.camera import COMPARISONS
from deformnb.widgets.worker import Worker

_LOG = logging.getLogger(__name__)
_Result = TypeVar("_Result")

_BAND_MS = 50.0  # a part of a full picture: a change waits for this and one quick picture
_SMALLEST, _FIRST = 0.12, 0.3  # shares of the full width
_AIMED_AT = 0.75  # of the time that a quick picture may take, for pictures differ
_RETRY = 1.0  # seconds after which the confirmation of a picture by a front end is no longer awaited
_KEPT = 50  # times that medians are taken of
_RATES = 3
_WAY = 5  # of Linux's steps from 0 to 19: next to a browser that is busy too, a third of what would be its share


class LoopScene(Protocol):
    """Scene of a render loop: :class:`~deformnb.widgets.vtk.scene.VtkScene` and any other with these methods."""

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""

    def set_size(self, size: tuple[int, int]) -> None:
        """Another one."""

    def render(
        self,
        *,
        scale: float = 1.0,
        coarseness: float = 1.0,
        shows: str | None = None,
        bands: int = 1,
        interrupted: Callable[[], bool] | None = None,
    ) -> Image | None:
        """The picture, or None if it was interrupted."""

    def close(self) -> None:
        """Give back all that is held."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture, or two of the same place that alternate.

    Parameters
    ----------
    images : (height, width, 3) uint8 each.
    is_full : False for a quick picture, which is smaller.
    """

    images: tuple[Image, ...]
    is_full: bool


class Pace:
    """Resolution of pictures that follows from the times that the last ones took.

    Parameters
    ----------
    target_ms : time that a quick picture may take; longest_ms : that a full one may.

    Attributes
    ----------
    scale : share of the full width that quick pictures have.
    """

    def __init__(self, target_ms: float, longest_ms: float) -> None:
        self.target_ms, self.longest_ms, self.scale = target_ms, longest_ms, _FIRST
        self._rates: deque[float] = deque(maxlen=_RATES)  # milliseconds of recent full pictures
        self._times: dict[str, deque[float]] = {name: deque(maxlen=_KEPT) for name in ("edit", "frame")}
        self._full_ms, self._frames = 0.0, 0

    def learn(self, edit_ms: float, ms: float) -> None:
        """Note the times of changes and of a quick picture, and let the next ones be smaller or larger."""
        self._times["edit"].append(edit_ms)
        self._times["frame"].append(ms)
        is_first, self._frames = not self._frames, self._frames + 1
        self._rates.append(ms / self.scale**2 * _coarseness(self.scale))
        if is_first:  # it compiles shaders: its time is no measure of the others
            self._rates[-1] = min(self._rates[-1], self.longest_ms)
            return
        change = float(np.sqrt(_AIMED_AT * self.target_ms / max(ms, 1.0)))
        self.scale = min(1.0, max(_SMALLEST, self.scale * min(1.35, max(0.5, change))))

    def full(self) -> tuple[float, int]:
        """Share of the full width that the picture at rest has, and the parts in which it is drawn."""
        rate = min(self._rates, default=0.0)  # a picture that compiles something takes seconds once
        scale = float(min(1.0, max(self.scale, np.sqrt(self.longest_ms / max(rate, 1.0)))))
        return scale, int(np.ceil(rate * scale**2 / _BAND_MS)) or 1

    def learn_full(self, ms: float, scale: float) -> None:
        """Note the time of a picture at rest."""
        self._full_ms, self._frames = ms, self._frames + 1
        self._rates = deque([ms / scale**2], maxlen=_RATES)

    def stats(self) -> dict[str, Any]:
        """Medians ``edit_ms`` (changes) and ``frame_ms`` (quick pictures), ``full_ms``, ``frames`` and ``scale``."""
        medians = {f"{name}_ms": float(np.median(list(t))) if t else 0.0 for name, t in self._times.items()}
        return {**medians, "full_ms": self._full_ms, "frames": self._frames, "scale": self.scale}


class SceneLoop:
    """Draws one scene whenever it has changed.

    Parameters
    ----------
    make : makes the scene; called in the thread, before the first picture.
    deliver : called in the thread with each picture.
    failed : called in the thread with what went wrong, for people; the last good picture stays.
    ready : returns whether another picture may be delivered; one that returns False calls :meth:`touch` later.
    target_ms : time that a quick picture may take.
    settle_ms : rest after which the full picture is drawn.
    longest_ms : time that a full picture may take; on slow machines it has fewer pixels.
    is_needed : whether the scene must stay when nothing has been requested for a while; else it is closed, its thread
        ends, and both are made again by the next wish.
    """

    def __init__(
        self,
        make: Callable[[], Any],
        deliver: Callable[[Frame], None],
        failed: Callable[[str], None],
        *,
        ready: Callable[[], bool] = lambda: True,
        target_ms: float = 250.0,
        settle_ms: float = 250.0,
        longest_ms: float = 4000.0,
        is_needed: Callable[[], bool] = lambda: True,
    ) -> None:
        self.pace, self.settle_ms = Pace(target_ms, longest_ms), settle_ms
        self._make, self._deliver, self._failed, self._ready = make, deliver, failed, ready
        self._holder = _Holder()
        self._thread = Worker(at_end=self._holder.close, is_needed=is_needed)
        self._lock = threading.Lock()
        self._changes: dict[str, Callable[[Any], None]] = {}
        self._shows = "deformed"
        self._is_rough = False  # whether the last picture was a quick one
        self._asked = self._drawing = self._settled = 0  # how many wishes came, were begun, are shown in full

    def change(self, key: str, function: Callable[[Any], None], *, draw: bool = True) -> None:
        """Change the scene by ``function(scene)`` before the next picture, instead of what waits under this key.

        Parameters
        ----------
        draw : False where no picture is shown: the next one that is requested is early enough.
        """
        with self._lock:
            self._changes[key] = function
        if draw:
            self.touch()

    def set_shows(self, shows: str) -> None:
        """Set the mode, a name of :data:`~deformnb.widgets.camera.SHOWS`, and draw nothing.

        "flicker", "wipe" and "fade" deliver two pictures of one place.
        """
        self._shows = shows

    def touch(self) -> None:
        """Draw again, soon."""
        with self._lock:
            self._asked += 1
        if not self._thread.is_closed:
            self._thread.latest("frame", self._request_preview)

    @property
    def is_settled(self) -> bool:
        """True if all requests so far have been delivered in full."""
        return self._settled == self._asked

    def do(self, function: Callable[[Any], _Result]) -> Future[_Result]:
        """Call ``function(scene)`` in the thread after all changes so far, and return its result."""
        if self._thread.is_current_thread:
            raise DeformError("this is the thread that renders, and would wait for itself; use what you were given.")

        def work() -> _Result:
            scene = self._holder.get(self._make)
            self._apply(scene)
            try:
                return function(scene)
            finally:
                if self._is_rough:  # a full picture may have stopped for this
                    self._thread.debounce(self.settle_ms / 1e3, self._full)

        return self._thread.call(work)

    def close(self, wait: float = 0.1) -> None:
        """End the thread after its current work, and close the scene; takes at most ``wait`` seconds."""
        self._thread.close(wait)

    # -- in the thread -------------------------------------------------------------------------------------------------

    def _request_preview(self) -> None:
        if not self._ready():
            self._thread.debounce(_RETRY, self._draw_preview)
            return
        self._draw_preview()

    def _draw_preview(self) -> None:
        try:
            scene = self._holder.get(self._make)
            start = time.perf_counter()
            self._drawing = self._asked
            self._apply(scene)
            drawn = time.perf_counter()
            scale = self.pace.scale
            images = self._images(scene, scale=scale, coarseness=_coarseness(scale))
            if images is None:
                return
            self.pace.learn(1e3 * (drawn - start), 1e3 * (time.perf_counter() - drawn))
            self._deliver(Frame(images, is_full=False))
            self._is_rough = True
            self._thread.debounce(self.settle_ms / 1e3, self._full)
        except Exception as error:
            self._report_error(error)

    def _full(self) -> None:
        try:
            scene = self._holder.get(self._make)
            scale, bands = self.pace.full()
            start = time.perf_counter()
            images = self._images(scene, scale=scale, bands=bands, interrupted=lambda: self._thread.is_wanted)
            if images is None:
                return  # what came between draws again
            self.pace.learn_full(1e3 * (time.perf_counter() - start), scale)
            self._deliver(Frame(images, is_full=True))
            self._is_rough, self._settled = False, self._drawing
        except Exception as error:
            self._report_error(error)

    def _images(self, scene: LoopScene, **options: Any) -> tuple[Image, ...] | None:
        both = ("deformed", "original") if self._shows in ("flicker", *COMPARISONS) else (self._shows,)
        images = []
        for shows in both:
            image = scene.render(shows=shows, **options)
            if image is None:
                return None
            images.append(image)
        return tuple(images)

    def _apply(self, scene: Any) -> None:
        with self._lock:
            changes, self._changes = self._changes, {}
        for change in changes.values():
            try:
                change(scene)
            except Exception as error:  # one wrong change does not undo the others
                self._report_error(error)

    def _report_error(self, error: Exception) -> None:
        if not isinstance(error, DeformError):
            _LOG.error("a picture could not be drawn", exc_info=error)
        text = str(error) if isinstance(error, DeformError) else f"{type(error).__name__}: {error}"
        self._failed(text)


class _Holder:
    """The scene, from the first picture to the end of its thread; it has no reference to the loop."""

    def __init__(self) -> None:
        self._scene: Any = None

    def get(self, make: Callable[[], Any]) -> Any:
        if self._scene is None:
            _lower_priority()
            self._scene = make()
        return self._scene

    def close(self) -> None:
        if self._scene is not None:
            self._scene.close()
            self._scene = None


def _lower_priority() -> None:
    """Let others on this machine come first, above all a browser that moves the points and shows these pictures.

    It goes for this thread and for those that it starts, such as VTK's own; only Linux can do that.
    """
    if sys.platform == "linux":
        here = (os.PRIO_PROCESS, threading.get_native_id())
        with contextlib.suppress(OSError):
            os.setpriority(*here, max(_WAY, os.getpriority(*here)))


def _coarseness(scale: float) -> float:
    """Samples farther apart in smaller pictures: the time saved would else be spent on invisible depth."""
    return 1.0 + 2.2 * (1.0 - scale)
