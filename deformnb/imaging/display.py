"""Display settings of a view, by which a file shows the same, and the renderer that draws it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from deformnb._typing import Image, Progress
from deformnb.rbf.fields import AbstractField
from deformnb.volume.clip import WHOLE, Clip
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

_HOME = {"direction": (0.4, 1.0, -0.3), "up": None, "zoom": 1.0}


class ViewRenderer(Protocol):
    """Renderer of a volume as a view shows it; used and closed by one thread."""

    def set_field(self, field: AbstractField | None, output: Grid | None = None) -> None:
        """Deform the scene, in the box of a grid."""

    def render(self, *, bands: int = 1, progress: Progress | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8, in about ``bands`` parts; ``progress`` is called in between."""

    def close(self) -> None:
        """Release its resources."""


@dataclass(frozen=True)
class DisplaySettings:
    """Display settings of a view: all that a picture in a file needs to show the same.

    Parameters
    ----------
    camera : direction, up, zoom, pan and perspective, as a view's ``camera``.
    projection : "shaded", "composite" or "mip".
    shows : a name of :data:`~deformnb.widgets.camera.SHOWS`.
    background : "dark" or "light".
    clip : the part of the box that is seen, as a view's ``clip``.
    frame : the part of the volume's box that the camera frames, as a view's ``frame``.
    show_folds : whether tissue is red where the map folds.
    ambient_occlusion : whether hollows are darker, where the renderer has that: VTK does not.
    scene : makes the renderer, of (volume, transfer, size, seen); None draws the whole box from this direction.
    still : makes an equal renderer that is faster for a single picture; None takes ``scene``.
    """

    camera: Mapping[str, Any] = field(default_factory=lambda: dict(_HOME))
    projection: str = "shaded"
    shows: str = "deformed"
    background: str = "dark"
    clip: Clip = WHOLE
    frame: Clip = WHOLE
    show_folds: bool = False
    ambient_occlusion: bool = False
    scene: Callable[[Volume, TransferFunction, tuple[int, int], DisplaySettings], ViewRenderer] | None = None
    still: Callable[[Volume, TransferFunction, tuple[int, int], DisplaySettings], ViewRenderer] | None = None

    @classmethod
    def of(cls, given: DisplaySettings | Mapping[str, Any] | None) -> DisplaySettings:
        """Make display settings of a camera alone; display settings are returned as they are."""
        return given if isinstance(given, DisplaySettings) else cls({**_HOME, **(given or {})})
