"""The volume drawn by VTK here and sent to the page as pictures, for browsers that cannot draw it themselves.

trame's remote controlled area shows the pictures and sends sizes and mouse; in between is a scene that lives in a
thread of its own, for OpenGL belongs to the thread that began with it. While something moves, pictures are small and
coarse, and the newest wish takes the place of older ones; the full picture is drawn once all is at rest.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from deformnb.errors import DeformError
from deformnb.plane import Plane
from deformnb.volume import Grid
from deformnb.widgets.stills import seen_height
from deformnb.widgets.view import checked_camera
from deformnb.widgets.worker import Worker

AREA = "volume"
"""Name of the area in the page."""

_REST = 0.3  # seconds without a wish, after which the full picture is drawn
_QUICK = 0.45  # share of the full size while something moves
_COARSE = 2.0  # and samples along a ray so many times farther apart
_MOST_PIXELS = 1600 * 1200
_TURN = math.pi  # radians for a drag across the height of the picture
_ZOOM = 1.15  # for one notch of the wheel
_QUALITY = {True: 70, False: 90}  # of the JPEG of a quick and of a full picture

_LONGEST_WORK = 30.0  # seconds: the first picture, with its shaders, on a slow machine

_LOG = logging.getLogger(__name__)


class RemoteView:
    """A scene of VTK behind trame's remote controlled area.

    Parameters
    ----------
    make_scene : makes the scene, in the thread of the scene; called at the first size that a page sends.
    fail : called with what is wrong if there can be no scene.
    push : called with a picture's bytes and what trame wants to know of them, in the thread of the scene.
    grid : whose box is seen.
    camera : of the first picture.
    """

    def __init__(self, make_scene: Callable[[tuple[int, int]], Any], fail: Callable[[str], None],
                 push: Callable[[bytes, dict[str, Any]], None], grid: Grid,
                 camera: dict[str, Any] | None = None) -> None:
        self._make_scene, self._fail, self._push, self._grid = make_scene, fail, push, grid
        self._thread = Worker("deformnb-remote", at_end=self._close_scene)
        self._scene: Any = None
        self._is_broken = False
        self._camera = checked_camera(camera or {})
        self._held: tuple[str, float, float] | None = None

    # -- what trame calls, in the thread of its loop -------------------------------------------------------------------

    def update_size(self, size: Any) -> None:
        """The page shows the area with this size, in CSS pixels."""
        width, height, ratio = (_number(size, key, 1.0) for key in ("w", "h", "p"))
        if not (16 <= width <= 8192 and 16 <= height <= 8192 and 0.2 <= ratio <= 8):
            raise DeformError("no size of a picture.")
        factor = min(ratio, math.sqrt(_MOST_PIXELS / (width * height)))
        whole = (max(16, round(width * factor)), max(16, round(height * factor)))
        self._thread.latest("size", lambda: self._resize(whole))

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
            way, x, y = self._held
            now = _number(event, "x"), _number(event, "y")
            height = max(16.0, _number(event, "h", 512.0))
            dx, dy = (now[0] - x) / height, (now[1] - y) / height
            aspect = max(16.0, _number(event, "w", 512.0)) / height
            self._held = (way, *now)
            self._look(lambda camera: dragged(camera, way, dx, dy, seen_height(
                self._grid, camera["direction"], camera["up"], aspect, camera["zoom"])))

    # -- what the desk calls -------------------------------------------------------------------------------------------

    def change(self, function: Callable[[Any], None]) -> None:
        """Do something to the scene, and draw it."""
        if self._scene is not None:
            self._thread.call(lambda: function(self._scene))
            self._draw()

    def set_camera(self, direction: Any, up: Any = None) -> None:
        """Look from another side, at all of it."""
        self._look(lambda camera: checked_camera({"direction": direction, "up": up}))

    def close(self) -> None:
        """End the thread, and the scene with it."""
        self._thread.close(_LONGEST_WORK)  # a process that ends while VTK draws ends in a crash

    # -- in the scene's thread -----------------------------------------------------------------------------------------

    def _resize(self, size: tuple[int, int]) -> None:
        if self._is_broken:
            return
        try:
            if self._scene is None:
                self._scene = self._make_scene(size)
                self._scene.set_camera(self._camera)
            self._scene.set_size(size)
        except Exception as error:  # of VTK, OpenGL or their absence: the page must hear of it
            if not isinstance(error, DeformError):
                _LOG.exception("the scene could not be made")
            self._is_broken = True
            self._fail(str(error))
            return
        self._draw()

    def _look(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._camera = change(self._camera)
        camera = self._camera
        if self._scene is not None:
            self._thread.latest("camera", lambda: self._scene.set_camera(camera))
            self._draw()

    def _draw(self) -> None:
        self._thread.latest("draw", self._draw_quickly)

    def _draw_quickly(self) -> None:
        self._send(self._scene.render(scale=_QUICK, coarseness=_COARSE), is_quick=True)
        if not self._thread.is_closed:
            self._thread.at_rest(_REST, self._draw_fully)

    def _draw_fully(self) -> None:
        picture = self._scene.render(bands=8, interrupted=lambda: self._thread.is_wanted)
        if picture is not None:
            self._send(picture, is_quick=False)

    def _send(self, picture: Any, *, is_quick: bool) -> None:
        from trame_rca.encoders import RcaImageEncoder

        whole = np.ascontiguousarray(picture)
        rows, columns = whole.shape[:2]
        data, about, _ = RcaImageEncoder.JPEG.encode(whole, columns, rows, _QUALITY[is_quick])
        self._push(data, about)

    def _close_scene(self) -> None:
        if self._scene is not None:
            self._scene.close()


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
    # What is in front follows the hand: the viewer goes the other way, and looks more to where the hand goes.
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
