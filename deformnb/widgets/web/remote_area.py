"""Remote controlled area of trame, for pictures that are rendered here: its pictures, and its mouse as a camera."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from deformnb._typing import Image
from deformnb.errors import DeformError
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.widgets.camera import visible_height
from deformnb.widgets.worker import Worker

AREA = "volume"
"""Name of the area in the client."""

CameraState = dict[str, Any]
Push = Callable[[bytes, dict[str, Any]], None]
"""Called with a picture's JPEG and facts about it for the page."""

_TURN = math.pi  # radians for a drag across the height of the picture
_ZOOM = 1.15  # for one notch of the wheel
_BLINK = 0.7  # seconds of each of two alternating pictures


class MouseCamera:
    """The mouse over the area as changes of a camera: left turns, middle or Shift moves, right or the wheel zooms.

    Parameters
    ----------
    look : called at each movement, in the thread of :meth:`handle_event`, with a function that maps the last camera to
        the next.
    rest : called when the button is released, or the wheel has turned.

    Examples
    --------
    >>> from deformnb.widgets.camera import checked_camera
    >>> camera = checked_camera({})
    >>> mouse = MouseCamera(lambda change: camera.update(change(camera)), lambda: None)
    >>> mouse.handle_event({"type": "MouseWheel", "spinY": -1}, Grid((4, 4, 4)))
    >>> camera["zoom"]
    1.15
    """

    def __init__(self, look: Callable[[Callable[[CameraState], CameraState]], None], rest: Callable[[], None]) -> None:
        self._look, self._rest = look, rest
        self._held: tuple[str, float, float] | None = None

    @property
    def is_pressed(self) -> bool:
        """True while a button is down."""
        return self._held is not None

    def handle_event(self, event: Any, box: Grid, shows: str = "deformed") -> None:
        """Take an event of the mouse from the page.

        Parameters
        ----------
        box : whose box is seen.
        shows : a name of :data:`~deformnb.widgets.view.base.SHOWS`.

        Raises
        ------
        DeformError
            If it is no event of a mouse.
        """
        kind = event.get("type") if isinstance(event, dict) else None
        if not isinstance(kind, str):
            raise DeformError("no event of a mouse.")
        if kind == "MouseWheel":
            notches = max(-3.0, min(3.0, number_of(event, "spinY")))
            self._look(lambda camera: zoom_camera(camera, _ZOOM**-notches))
        elif kind.endswith("ButtonPress"):
            way = {"LeftButtonPress": "turn", "MiddleButtonPress": "move", "RightButtonPress": "zoom"}.get(kind, "turn")
            way = "move" if way == "turn" and event.get("shiftKey") else way
            self._held = (way, number_of(event, "x"), number_of(event, "y"))
        elif kind.endswith("ButtonRelease"):
            self._held = None
        elif kind == "MouseMove" and self._held is not None:
            self._drag(event, box, 2 if shows == "side_by_side" else 1, *self._held)
        if kind.endswith("ButtonRelease") or kind == "MouseWheel":
            self._rest()

    def _drag(self, event: dict[str, Any], box: Grid, pictures: int, way: str, x: float, y: float) -> None:
        now = number_of(event, "x"), number_of(event, "y")
        height = max(16.0, number_of(event, "h", 512.0))
        dx, dy = (now[0] - x) / height, (now[1] - y) / height
        aspect = max(16.0, number_of(event, "w", 512.0)) / height / pictures
        self._held = (way, *now)
        self._look(
            lambda camera: drag_camera(
                camera, way, dx, dy, visible_height(box, camera["direction"], camera["up"], aspect, camera["zoom"])
            )
        )


class Pictures:
    """Sends the newest picture to the area; two that belong together alternate.

    Parameters
    ----------
    push : sends one; called by the thread that draws, and by a separate one.
    """

    def __init__(self, push: Push) -> None:
        self._push = push
        self._lock = threading.RLock()  # a page may answer while a picture is sent
        self._worker = Worker("deformnb-blink")
        self._layers: list[tuple[bytes, dict[str, Any]]] = []

    def show(self, images: tuple[Image, ...], jpegs: list[bytes], camera: CameraState, about: dict[str, Any]) -> None:
        """Send this from now on.

        Parameters
        ----------
        images : one picture or two, of which the second is the original.
        jpegs : the same, packed.
        camera : position of the viewer in them.
        about : further facts for the page: ``n`` (number of the picture), ``full`` and ``shows``.
        """
        with self._lock:
            self._layers = [
                (jpeg, {**about_picture(image, camera), **about, "layer": layer})
                for layer, (image, jpeg) in enumerate(zip(images, jpegs, strict=True))
            ]
            self._push(*self._layers[0])
        if len(images) > 1 and not self._worker.is_closed:
            self._worker.debounce(_BLINK, self._show_other)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def _show_other(self) -> None:
        with self._lock:
            if len(self._layers) < 2 or self._worker.is_closed:
                return
            self._layers.reverse()
            self._push(*self._layers[0])
        self._worker.debounce(_BLINK, self._show_other)


def for_area(answer: Callable[..., None]) -> Callable[..., None]:
    """A remote procedure that clients call with the name of the area first; DeformError for any other area.

    Examples
    --------
    >>> for_area(print)("volume", 300, 200)
    300 200
    """

    def checked(area: str, *given: Any) -> None:
        if area != AREA:
            raise DeformError("there is no such area.")
        answer(*given)

    return checked


def about_picture(image: Any, camera: dict[str, Any]) -> dict[str, Any]:
    """Metadata of a JPEG for trame's area, with the camera that it shows."""
    rows, columns = image.shape[:2]
    return {
        "type": "image/jpeg",
        "codec": "",
        "key": "key",
        "w": columns,
        "h": rows,
        "st": int(time.time() * 1000),
        "camera": {name: camera[name] for name in ("direction", "up")},
    }


def drag_camera(camera: dict[str, Any], way: str, dx: float, dy: float, seen: float) -> dict[str, Any]:
    """A camera after the mouse was dragged.

    Parameters
    ----------
    way : "turn", "move" or "zoom".
    dx, dy : to the right and upwards, as shares of the picture's height.
    seen : length in space that the picture is high.
    """
    if way == "zoom":
        return zoom_camera(camera, math.exp(2 * dy))
    if way == "move":
        right, above = camera["pan"]
        return {**camera, "pan": [right - dx * seen, above - dy * seen]}
    plane = Plane.from_normal((0, 0, 0), camera["direction"], camera["up"])
    right, up, ahead = np.asarray(plane.u), -np.asarray(plane.v), np.asarray(plane.normal)
    # The tissue in front follows the pointer: the viewer moves opposite, and turns towards the pointer's target.
    ahead, right = _rotate(ahead, right, dx * _TURN)
    ahead, up = _rotate(ahead, up, dy * _TURN)
    return {**camera, "direction": ahead.tolist(), "up": up.tolist()}


def zoom_camera(camera: dict[str, Any], factor: float) -> dict[str, Any]:
    """A camera that shows things ``factor`` times as large, within reason."""
    return {**camera, "zoom": float(np.clip(camera["zoom"] * factor, 0.1, 40.0))}


def _rotate(ahead: Any, other: Any, angle: float) -> tuple[Any, Any]:
    """Two directions turned in their plane, the first towards the second."""
    c, s = math.cos(angle), math.sin(angle)
    return c * ahead + s * other, c * other - s * ahead


def number_of(event: Any, key: str, default: float | None = None) -> float:
    """A finite number that the page has sent; DeformError if there is none."""
    value = event.get(key, default) if isinstance(event, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > 1e6:
        raise DeformError(f"{key} of an event is a number.")
    return float(value)
