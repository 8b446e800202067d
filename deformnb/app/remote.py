"""Server-side rendering: the volume drawn by VTK here, for clients that cannot draw it themselves.

trame's remote controlled area shows the pictures and sends sizes and mouse events; in between is a loop that draws a
scene in a thread of its own, because an OpenGL context belongs to the thread that made it. While something moves,
pictures are small and coarse, the newest request replaces older ones, and no more pictures are under way than the
client's confirmations allow; the full picture is drawn once all is at rest.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from deformnb.errors import DeformError
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.widgets.camera import checked_camera, seen_height
from deformnb.widgets.protocol import text, whole
from deformnb.widgets.view.transport import FrameSender
from deformnb.widgets.vtk.render_loop import Frame, SceneLoop
from deformnb.widgets.worker import Worker

AREA = "volume"
"""Name of the area in the client."""

_TARGET_MS = 200.0  # of a quick picture; its size adapts
_SETTLE_MS = 300.0  # of rest, after which the full picture is drawn
_MOST_PIXELS = 1600 * 1200
_TURN = math.pi  # radians for a drag across the height of the picture
_ZOOM = 1.15  # for one notch of the wheel
_BLINK = 0.7  # seconds of each of two pictures that are shown in turn

_LONGEST_WORK = 30.0  # seconds: the first picture, with its shaders, on a slow machine


class MouseLooks:
    """Turns the mouse over trame's remote controlled area into other cameras; the thread is that of trame's loop.

    Attributes
    ----------
    box : whose box is seen.
    """

    box: Grid
    _shows = "deformed"
    _held: tuple[str, float, float] | None = None

    def on_event(self, event: Any) -> None:
        """The mouse over the area: left turns, middle or Shift moves, right or the wheel zooms."""
        kind = event.get("type") if isinstance(event, dict) else None
        if not isinstance(kind, str):
            raise DeformError("no event of a mouse.")
        if kind == "MouseWheel":
            notches = max(-3.0, min(3.0, _number(event, "spinY")))
            self._look(lambda camera: zoomed(camera, _ZOOM**-notches))
        elif kind.endswith("ButtonPress"):
            way = {"LeftButtonPress": "turn", "MiddleButtonPress": "move", "RightButtonPress": "zoom"}.get(kind, "turn")
            way = "move" if way == "turn" and event.get("shiftKey") else way
            self._held = (way, _number(event, "x"), _number(event, "y"))
        elif kind.endswith("ButtonRelease"):
            self._held = None
        elif kind == "MouseMove" and self._held is not None:
            self._drag(event, *self._held)
        if kind.endswith("ButtonRelease") or kind == "MouseWheel":
            self._at_rest()

    def _drag(self, event: dict[str, Any], way: str, x: float, y: float) -> None:
        now = _number(event, "x"), _number(event, "y")
        height = max(16.0, _number(event, "h", 512.0))
        dx, dy = (now[0] - x) / height, (now[1] - y) / height
        aspect = max(16.0, _number(event, "w", 512.0)) / height / (2 if self._shows == "side_by_side" else 1)
        self._held = (way, *now)
        self._look(lambda camera: dragged(camera, way, dx, dy, seen_height(
            self.box, camera["direction"], camera["up"], aspect, camera["zoom"])))

    def _look(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        raise NotImplementedError

    def _at_rest(self) -> None:
        """The mouse has let go, or the wheel has turned."""
        raise NotImplementedError


class RemoteView(MouseLooks):
    """A scene behind trame's remote controlled area.

    What is asked of it may come from any thread, before the first size of a client as well.

    Parameters
    ----------
    make_scene : makes the scene from a size in pixels, in the thread of the scene, once a client has sent its size: a
        :class:`~deformnb.widgets.vtk.render_loop.Scene` that has ``set_camera`` and ``set_shows``.
    fail : called in that thread with what is wrong, for people; the last good picture stays.
    push : called with a picture's JPEG and what the client wants to know of it: what trame's area does, and ``n`` (its
        number, that the client answers by :meth:`seen`), ``full``, ``camera`` (direction and up), ``shows``, ``layer``
        (1 for the original that is shown in turn) and ``badge`` (words for the corner).
    grid : whose box is seen.
    camera : of the first picture.
    turned : called when the user has turned it, in the thread of trame's loop.
    target_ms, settle_ms : time that a quick picture may take, and rest before the full one.
    """

    def __init__(self, make_scene: Callable[[tuple[int, int]], Any], fail: Callable[[str], None],
                 push: Callable[[bytes, dict[str, Any]], None], grid: Grid, camera: dict[str, Any] | None = None, *,
                 turned: Callable[[], None] = lambda: None, target_ms: float = _TARGET_MS,
                 settle_ms: float = _SETTLE_MS) -> None:
        self._make_scene, self._fail, self._push, self._tell_turned = make_scene, fail, push, turned
        self.box = grid
        self._lock = threading.RLock()
        self._frames = FrameSender()
        self._loop = SceneLoop(self._make, self._deliver, self._say, ready=lambda: self._frames.may_send,
                               target_ms=target_ms, settle_ms=settle_ms)
        self._blink = Worker("deformnb-blink")
        self._layers: list[tuple[bytes, dict[str, Any]]] = []
        self._size: tuple[int, int] | None = None
        self._camera = self._drawn = checked_camera(camera or {})
        self._scene: Any = None
        self._said = ""

    # -- what trame calls, in the thread of its event loop -------------------------------------------------------------

    def update_size(self, size: Any) -> None:
        """The client shows the area with this size, in CSS pixels."""
        width, height, ratio = (_number(size, key, 1.0) for key in ("w", "h", "p"))
        if not (16 <= width <= 8192 and 16 <= height <= 8192 and 0.2 <= ratio <= 8):
            raise DeformError("no size of a picture.")
        factor = min(ratio, math.sqrt(_MOST_PIXELS / (width * height)))
        pixels = (max(16, round(width * factor)), max(16, round(height * factor)))
        self._size = pixels
        self._loop.change("size", lambda scene: scene.set_size(pixels))

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
        """Look from another side, at all of it."""
        self._look(lambda camera: checked_camera({"direction": direction, "up": up}))

    def stats(self) -> dict[str, Any]:
        """Medians ``edit_ms`` and ``frame_ms``, ``full_ms``, ``frames``, ``scale``, ``bytes_per_frame`` and more."""
        return {**self._loop.stats(), **self._frames.stats()}

    def close(self) -> None:
        """End the thread, and the scene with it."""
        self._blink.close()
        self._loop.close(_LONGEST_WORK)  # a process that ends while VTK draws ends in a crash

    def _at_rest(self) -> None:
        self._tell_turned()

    def _look(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        with self._lock:  # the user of a client and a button of the desk are two threads
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
        layers = []
        for layer, (image, picture) in enumerate(zip(frame.images, pictures, strict=True)):
            about = {"n": message["seq"], "full": frame.is_full, "layer": layer, "shows": self._shows,
                     "badge": self._badge()}
            layers.append((picture, {**about_picture(image, self._drawn), **about}))
        with self._lock:
            self._layers = layers
            self._push(*layers[0])
        if len(layers) > 1 and not self._blink.is_closed:
            self._blink.at_rest(_BLINK, self._show_other)

    def _badge(self) -> str:
        folding = getattr(self._scene, "folding", None)
        return "" if folding is None or self._shows == "original" else str(folding.remark)

    def _say(self, text: str) -> None:
        if text != self._said:  # once, not with every picture that cannot be made
            self._said = text
            self._fail(text)

    # -- in the thread of two pictures that are shown in turn ----------------------------------------------------------

    def _show_other(self) -> None:
        with self._lock:
            if len(self._layers) < 2 or self._blink.is_closed:
                return
            self._layers.reverse()
            self._push(*self._layers[0])
        self._blink.at_rest(_BLINK, self._show_other)


def about_picture(image: Any, camera: dict[str, Any]) -> dict[str, Any]:
    """Metadata of a JPEG for trame's area, with the camera that it shows."""
    rows, columns = image.shape[:2]
    return {"type": "image/jpeg", "codec": "", "key": "key", "w": columns, "h": rows, "st": int(time.time() * 1000),
            "camera": {name: camera[name] for name in ("direction", "up")}}


def dragged(camera: dict[str, Any], way: str, dx: float, dy: float, seen: float) -> dict[str, Any]:
    """A camera after the mouse was dragged.

    Parameters
    ----------
    way : "turn", "move" or "zoom".
    dx, dy : to the right and upwards, as shares of the picture's height.
    seen : length in space that the picture is high.
    """
    if way == "zoom":
        return zoomed(camera, math.exp(2 * dy))
    if way == "move":
        right, above = camera["pan"]
        return {**camera, "pan": [right - dx * seen, above - dy * seen]}
    plane = Plane.through((0, 0, 0), camera["direction"], camera["up"])
    right, up, ahead = np.asarray(plane.u), -np.asarray(plane.v), np.asarray(plane.normal)
    # What is in front follows the pointer: the viewer goes the other way, and looks more to where the pointer goes.
    ahead, right = _turned(ahead, right, dx * _TURN)
    ahead, up = _turned(ahead, up, dy * _TURN)
    return {**camera, "direction": ahead.tolist(), "up": up.tolist()}


def zoomed(camera: dict[str, Any], factor: float) -> dict[str, Any]:
    """A camera that shows things ``factor`` times as large, within reason."""
    return {**camera, "zoom": float(np.clip(camera["zoom"] * factor, 0.1, 40.0))}


def _turned(ahead: Any, other: Any, angle: float) -> tuple[Any, Any]:
    """Two directions turned in their plane, the first towards the second."""
    c, s = math.cos(angle), math.sin(angle)
    return c * ahead + s * other, c * other - s * ahead


def _number(event: Any, key: str, default: float | None = None) -> float:
    value = event.get(key, default) if isinstance(event, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e6:
        raise DeformError(f"{key} of an event is a number.")
    return float(value)
