"""Server-side rendering: the volume drawn by VTK here, for clients that cannot draw it themselves.

trame's remote controlled area shows the pictures and sends sizes and mouse events; in between is a loop that draws a
scene in a thread of its own, because an OpenGL context belongs to the thread that made it. While something moves,
pictures are small and coarse, the newest request replaces older ones, and no more pictures are under way than the
client's confirmations allow; the full picture is drawn once all is at rest.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

from deformnb.errors import DeformError
from deformnb.volume.volume import Grid
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.protocol import text, whole
from deformnb.widgets.view.transport import FrameSender
from deformnb.widgets.vtk.render_loop import Frame, SceneLoop
from deformnb.widgets.web.remote_area import MouseCamera, Pictures, Push, number_of

_TARGET_MS = 200.0  # of a quick picture; its size adapts
_SETTLE_MS = 300.0  # of rest, after which the full picture is drawn
_MOST_PIXELS = 1600 * 1200
_LONGEST_WORK = 30.0  # seconds: the first picture, with its shaders, on a slow machine


class RemoteView:
    """A scene behind trame's remote controlled area.

    Requests may come from any thread, before the first size of a client as well.

    Parameters
    ----------
    make_scene : makes the scene from a size in pixels, in the thread of the scene, once a client has sent its size: a
        :class:`~deformnb.widgets.vtk.render_loop.LoopScene` that has ``set_camera`` and ``set_shows``.
    fail : called in that thread with what is wrong, for people; the last good picture stays.
    push : called with a picture's JPEG and facts for the client: what trame's area does, and ``n`` (its
        number, that the client answers by :meth:`seen`), ``full``, ``camera`` (direction and up), ``shows``, ``layer``
        (1 for the original that is shown in turn) and ``badge`` (words for the corner).
    grid : whose box is seen; kept as ``box``, which may be set.
    camera : of the first picture.
    turned : called when the user has turned it, in the thread of trame's loop.
    target_ms, settle_ms : time that a quick picture may take, and rest before the full one.
    """

    def __init__(self, make_scene: Callable[[tuple[int, int]], Any], fail: Callable[[str], None],
                 push: Push, grid: Grid, camera: dict[str, Any] | None = None, *,
                 turned: Callable[[], None] = lambda: None, target_ms: float = _TARGET_MS,
                 settle_ms: float = _SETTLE_MS) -> None:
        self._make_scene, self._fail = make_scene, fail
        self.box = grid
        self._mouse, self._pictures = MouseCamera(self._look, turned), Pictures(push)
        self._lock = threading.RLock()
        self._frames = FrameSender()
        self._loop = SceneLoop(self._make, self._deliver, self._report_failure, ready=lambda: self._frames.may_send,
                               target_ms=target_ms, settle_ms=settle_ms)
        self._size: tuple[int, int] | None = None
        self._camera = self._drawn = checked_camera(camera or {})
        self._scene: Any = None
        self._said, self._shows = "", "deformed"

    # -- what trame calls, in the thread of its event loop -------------------------------------------------------------

    def update_size(self, size: Any) -> None:
        """The client shows the area with this size, in CSS pixels."""
        width, height, ratio = (number_of(size, key, 1.0) for key in ("w", "h", "p"))
        if not (16 <= width <= 8192 and 16 <= height <= 8192 and 0.2 <= ratio <= 8):
            raise DeformError("no size of a picture.")
        factor = min(ratio, math.sqrt(_MOST_PIXELS / (width * height)))
        pixels = (max(16, round(width * factor)), max(16, round(height * factor)))
        self._size = pixels
        self._loop.change("size", lambda scene: scene.set_size(pixels))

    def on_event(self, event: Any) -> None:
        """The mouse over the area, see :class:`~deformnb.widgets.web.remote_area.MouseCamera`."""
        self._mouse.on_event(event, self.box, self._shows)

    def seen(self, number: Any, page: Any = "") -> None:
        """A client, by a name of its own, has received the picture of this number."""
        if self._frames.seen(whole(number, 1, 2**53), text(page)):
            self._loop.touch()

    # -- what is shown -------------------------------------------------------------------------------------------------

    @property
    def is_used(self) -> bool:
        """True if a client has requested pictures."""
        return self._size is not None

    @property
    def camera(self) -> dict[str, Any]:
        """Camera of the viewer, as in :class:`~deformnb.widgets.camera.CameraTrait`."""
        return self._camera

    def change(self, key: str, function: Callable[[Any], None]) -> None:
        """Change the scene by ``function(scene)`` before the next picture, instead of what waits under this key.

        ``function`` is called in the thread of the scene; what it raises is reported by ``fail``.
        """
        self._loop.change(key, function, draw=self.is_used)

    def set_shows(self, shows: str) -> None:
        """Set the display mode, a name of :data:`~deformnb.widgets.camera.SHOWS`."""
        self._shows = shows
        self._loop.set_shows(shows)
        self.change("shows", lambda scene: scene.set_shows(shows))

    def set_camera(self, direction: Any, up: Any = None) -> None:
        """Set the direction of view, with all of the box in it."""
        self._look(lambda camera: checked_camera({"direction": direction, "up": up}))

    def stats(self) -> dict[str, Any]:
        """Medians ``edit_ms`` and ``frame_ms``, ``full_ms``, ``frames``, ``scale``, ``bytes_per_frame`` and more."""
        return {**self._loop.stats(), **self._frames.stats()}

    def close(self) -> None:
        """End the thread, and the scene with it."""
        self._pictures.close()
        self._loop.close(_LONGEST_WORK)  # a process that ends while VTK draws ends in a crash

    def _look(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        with self._lock:  # the user of a client and a button of the application are two threads
            camera = self._camera = change(self._camera)
            self.change("camera", lambda scene: self._turn(scene, camera))

    # -- in the scene's thread -----------------------------------------------------------------------------------------

    def _make(self) -> Any:
        assert self._size is not None
        self._scene = self._make_scene(self._size)
        self._turn(self._scene, self._camera)
        return self._scene

    def _turn(self, scene: Any, camera: dict[str, Any]) -> None:
        scene.set_camera(camera)
        self._drawn = camera

    def _deliver(self, frame: Frame) -> None:
        self._said = ""
        message, pictures = self._frames.pack(frame)
        self._pictures.show(frame.images, pictures, self._drawn, {
            "n": message["seq"], "full": frame.is_full, "shows": self._shows, "badge": self._badge()})

    def _badge(self) -> str:
        folding = getattr(self._scene, "folding", None)
        return "" if folding is None or self._shows == "original" else str(folding.remark)

    def _report_failure(self, text: str) -> None:
        if text != self._said:  # once, not with every picture that cannot be made
            self._said = text
            self._fail(text)
