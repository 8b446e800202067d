"""Camera of a view, and the settings that every view of a volume has: contents, clipping, background."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Image, Progress
from deformnb.errors import DeformError
from deformnb.imaging.camera import Camera
from deformnb.volume.clip import WHOLE, Clip, check_clip
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid

BACKGROUNDS = {"dark": (0.09, 0.097, 0.115), "light": (0.918, 0.923, 0.932)}
"""The middle tone of the view's two backgrounds."""

STANDOFF = 1 / 0.7
"""Distance of the viewer in perspective, in heights of the visible box, as in camera.js."""

INKS = {"dark": (0.97, 0.96, 0.93), "light": (0.09, 0.1, 0.13)}
"""The colour of words on the two backgrounds."""
VIEW_AIR = 1.02  # as in camera.js
SMALLEST_SHARE = 0.62  # as in camera.js

SHOWS = {
    "deformed": "the deformed volume",
    "original": "the volume as it was given",
    "side_by_side": "original on the left and deformed on the right, turned together",
    "flicker": "original and deformed alternating, at the same place",
    "wipe": "original left of a line that can be dragged, deformed right of it",
    "fade": "original overlaid on the deformed volume, with an opacity that can be changed",
}
"""Display modes of a volume and its deformation, by name; the first is the default."""


COMPARISONS = ("wipe", "fade")
"""Display modes that show original and deformed at one place."""

PICTURE_SHOWS = ("deformed", "original", *COMPARISONS)
"""Those of them that a picture has, the default first."""


def picture_mode(shows: str) -> str:
    """The display mode of a picture next to a view in this one.

    Examples
    --------
    >>> picture_mode("wipe"), picture_mode("side_by_side")
    ('wipe', 'deformed')
    """
    return shows if shows in PICTURE_SHOWS else PICTURE_SHOWS[0]


def comparison_image(shows: str, original: Image, deformed: Image) -> Image:
    """A still of a display mode: the line of "wipe" is in the middle, "fade" has half of each.

    Parameters
    ----------
    shows : "side_by_side", or a name of :data:`COMPARISONS`.
    original, deformed : pictures (height, width, 3) from one camera.
    """
    if shows == "fade":
        return ((original.astype(np.uint16) + deformed + 1) // 2).astype(np.uint8)
    middle = original.shape[1] // 2
    parts = [original[:, :middle], deformed[:, middle:]] if shows == "wipe" else [original, deformed]
    return np.concatenate(parts, axis=1)


HOME = {"direction": [0.4, 1.0, -0.3], "up": [0.0, 0.0, 1.0], "zoom": 1.0, "pan": [0.0, 0.0]}
"""The camera of a view at the start; ``pan`` is the displacement of the eye to the right and up, a length."""


_FARTHEST = {"zoom": 1e6, "pan": 1e12}  # no volume is seen from there, and the numbers of a picture would overflow


class ShowsTrait(traitlets.TraitType[str, str]):
    """A name of :data:`SHOWS`."""

    default_value = "deformed"
    info_text = f"one of {', '.join(SHOWS)}"

    def validate(self, obj: Any, value: Any) -> str:
        if not isinstance(value, str) or value not in SHOWS:
            raise DeformError(f"a view cannot show {value!r}; choose one of {', '.join(SHOWS)}.")
        return value


class CameraTrait(traitlets.TraitType[dict[str, Any], Mapping[str, Any]]):
    """Camera: direction, up, zoom, pan and perspective; missing entries are as in :data:`HOME`."""

    info_text = "a dictionary of direction, up, zoom, pan and perspective"

    def make_dynamic_default(self) -> dict[str, Any]:
        return checked_camera({})

    def validate(self, obj: Any, value: Any) -> dict[str, Any]:
        return checked_camera(value)


class ClipTrait(traitlets.TraitType[Clip, Any]):
    """Three pairs (low, high) of shares from 0 to 1: the part of the box along x, y and z that is seen."""

    default_value = WHOLE
    info_text = "three rising pairs of shares from 0 to 1"

    def validate(self, obj: Any, value: Any) -> Clip:
        return check_clip(value)


def checked_camera(value: Any) -> dict[str, Any]:
    """A camera as plain numbers, complete.

    Raises
    ------
    DeformError
        For other objects than a camera.

    Examples
    --------
    >>> checked_camera({"direction": (0, 2, 0)})["direction"]
    [0.0, 2.0, 0.0]
    """
    unknown = set(value) - {*HOME, "perspective"} if isinstance(value, Mapping) else {repr(value)}
    if unknown:
        raise DeformError(f"a camera has direction, up, zoom, pan and perspective, not {', '.join(map(str, unknown))}.")
    given = {name: value[name] for name in value if value[name] is not None}
    try:
        camera = {name: np.asarray(given.get(name, home), dtype=np.float64) for name, home in HOME.items()}
    except (TypeError, ValueError):
        raise DeformError(f"the numbers of a camera must be numbers, got {given}.") from None
    if [n.shape for n in camera.values()] != [(3,), (3,), (), (2,)] or not all(map(_is_finite, camera.values())):
        raise DeformError("direction and up of a camera have three finite numbers, pan has two, zoom is one.")
    if camera["zoom"] <= 0:
        raise DeformError(f"zoom must be a positive number, got {given['zoom']}.")
    far = _FARTHEST["zoom"]
    if not (1 / far < camera["zoom"] < far and np.abs(camera["pan"]).max() < _FARTHEST["pan"]):
        raise DeformError("pan and zoom of the camera lead to where nothing can be seen; set them to (0, 0) and 1.")
    plane = Plane.from_normal((0, 0, 0), camera["direction"], camera["up"] if "up" in given else None)
    if "direction" in given and "up" not in given:
        camera["up"] = -np.asarray(plane.v)
    whole = {name: (numbers + 0.0).tolist() for name, numbers in camera.items()}  # no -0.0
    return {**whole, "perspective": True} if given.get("perspective") else whole


def update_camera(
    camera: Mapping[str, Any],
    direction: ArrayLike | None = None,
    up: ArrayLike | None = None,
    zoom: float | None = None,
    perspective: bool | None = None,
) -> dict[str, Any]:
    """A camera with all that is not None changed; another direction centres the picture again.

    Examples
    --------
    >>> update_camera(checked_camera({"pan": (1, 2)}), direction=(0, 0, -3))["up"]
    [0.0, -1.0, 0.0]
    """
    changed = dict(camera)
    if direction is not None:
        plane = Plane.from_normal((0, 0, 0), direction, up)  # refuses the zero vector
        changed |= {"direction": list(plane.normal), "up": [-c for c in plane.v], "pan": [0.0, 0.0]}
    elif up is not None:
        changed["up"] = [-c for c in Plane.from_normal((0, 0, 0), changed["direction"], up).v]
    if zoom is not None:
        changed["zoom"] = zoom
    if perspective is not None:
        changed["perspective"] = bool(perspective)
    return checked_camera(changed)


def _is_finite(numbers: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(numbers).all())


def visible_height(grid: Grid, direction: Any, up: Any, aspect: float, zoom: float = 1.0) -> float:
    """The length in space that a view's picture is high; camera.js does the same.

    Parameters
    ----------
    grid : whose box is shown.
    aspect : width of the picture by its height.
    """
    plane = Plane.from_normal(grid.center, direction, up)
    corners = np.abs(plane.to_plane(grid.corners()))
    far = grid.diagonal / 2
    tall = max(corners[:, 1].max(), corners[:, 0].max() / aspect, SMALLEST_SHARE * far * min(1.0, 1 / aspect))
    return float(2 * VIEW_AIR * tall / zoom)


def camera_of(view: Mapping[str, Any], box: Grid, aspect: float) -> Camera:
    """The camera of a picture, from a view's ``camera``.

    Parameters
    ----------
    box : grid whose box is shown.
    aspect : width of the picture by its height.
    """
    sides = view["direction"], view.get("up")
    height = visible_height(box, *sides, aspect, float(view.get("zoom") or 1.0))
    plane = Plane.from_normal(box.center, *sides)
    right, above = view.get("pan") or (0.0, 0.0)
    plane = replace(plane, origin=tuple(plane.from_plane([right, -above])))
    return Camera(plane, height, STANDOFF * height if view.get("perspective") else None)


def partial_progress(progress: Progress | None, first: float, last: float) -> Progress | None:
    """Progress of a part of some work, reported as that part of the whole."""
    return None if progress is None else lambda share: progress(first + share * (last - first))
