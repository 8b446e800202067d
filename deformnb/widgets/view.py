"""What all views of a volume have in common, so that one can take another's place."""

from __future__ import annotations

from abc import ABC, ABCMeta, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb.clipping import WHOLE, Clip, checked_clip
from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.plane import Plane
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume

if TYPE_CHECKING:
    from deformnb.exports import Seen

Image = NDArray[np.uint8]

SHOWS = {
    "deformed": "the deformed volume",
    "original": "the volume as it was given",
    "side_by_side": "original on the left and deformed on the right, turned together",
    "flicker": "original and deformed in turn, at the same place",
}
"""What of a volume and its deformation is seen, by name; the first is the default."""

SIDES = {"+y": "from the front (+y)", "-y": "from behind (-y)", "+x": "from the right (+x)", "-x": "from the left (-x)",
         "-z": "from above (-z)", "+z": "from below (+z)"}
"""The six views in words, for a patient or an animal in LPS."""

HOME = {"direction": [0.4, 1.0, -0.3], "up": [0.0, 0.0, 1.0], "zoom": 1.0, "pan": [0.0, 0.0]}
"""The camera of a view at the start; ``pan`` is the way of the eye to the right and up, a length."""


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
    """Where the viewer stands: direction, up, zoom, pan and perspective; what is missing is as in :data:`HOME`."""

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
        return checked_clip(value)


def checked_camera(value: Any) -> dict[str, Any]:
    """A camera as plain numbers, complete.

    Raises
    ------
    DeformError
        For what is no camera.

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
    plane = Plane.through((0, 0, 0), camera["direction"], camera["up"] if "up" in given else None)
    if "direction" in given and "up" not in given:
        camera["up"] = -np.asarray(plane.v)
    whole = {name: (numbers + 0.0).tolist() for name, numbers in camera.items()}  # no -0.0
    return {**whole, "perspective": True} if given.get("perspective") else whole


def known(name: str, names: tuple[str, ...], what: str) -> str:
    """A name that must be one of ``names``; DeformError names them if it is none."""
    if name not in names:
        raise DeformError(f"unknown {what} {name!r}; choose one of {', '.join(names)}.")
    return name


def turned(camera: Mapping[str, Any], direction: ArrayLike | None = None, up: ArrayLike | None = None,
           zoom: float | None = None, perspective: bool | None = None) -> dict[str, Any]:
    """A camera with what is not None changed; another direction looks at the middle again.

    Examples
    --------
    >>> turned(checked_camera({"pan": (1, 2)}), direction=(0, 0, -3))["up"]
    [0.0, -1.0, 0.0]
    """
    changed = dict(camera)
    if direction is not None:
        plane = Plane.through((0, 0, 0), direction, up)  # refuses what is no direction
        changed |= {"direction": list(plane.normal), "up": [-c for c in plane.v], "pan": [0.0, 0.0]}
    elif up is not None:
        changed["up"] = [-c for c in Plane.through((0, 0, 0), changed["direction"], up).v]
    if zoom is not None:
        changed["zoom"] = zoom
    if perspective is not None:
        changed["perspective"] = bool(perspective)
    return checked_camera(changed)


def _is_finite(numbers: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(numbers).all())


class ViewMeta(ABCMeta, traitlets.MetaHasTraits):
    """For views that are widgets: ABC and HasTraits have a metaclass each, and Python wants one."""


class AbstractView(ABC):
    """A window on one volume and its deformation.

    A view keeps the volume it was shown; edits send displacements only. All lengths are physical, all directions in
    space (LPS). A view never changes what it is given.

    Attributes
    ----------
    shows : a name of :data:`SHOWS`; setting it changes the picture at once, :meth:`still` included (a still of
        "flicker" shows the deformed volume). Widgets declare it as a :class:`ShowsTrait`.
    clip : the part of the box that is seen, a :class:`ClipTrait`; see :meth:`set_clip`.
    camera : where the viewer stands, a :class:`CameraTrait`; :meth:`set_camera` and the viewer's hand change it.
    draws_by_vtk : whether its pictures are VTK's, and so those in files too.
    """

    shows: Any
    clip: Any
    camera: Any
    draws_by_vtk = False
    _following: Any = None
    _followed_output: Grid | None = None

    @abstractmethod
    def show(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""

    @abstractmethod
    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        """Deform what is shown.

        Parameters
        ----------
        deformation : a document, a backward field in space, or None for the volume as it is.
        output : its box is what can be seen (the field of view); default is the volume's own.
        """

    def follow(self, editor: Any, field: AbstractField, index: int = 0, *, output: Grid | None = None) -> None:
        """Let an editor move what is shown: each movement of its points, not only the end of an edit.

        Parameters
        ----------
        editor : an :class:`~deformnb.widgets.Editor`, or None to end it.
        field : what is shown until the next movement: an extrusion over the editor's plane, or a composition that ends
            with one. Its plane, depths and weights stay, also while points move.
        index : which of its maps the editor's points make.

        Notes
        -----
        May be called after every edit: what is dragged meanwhile stays where the hand is. Unless a view has a way of
        its own, the core fits the map anew and :meth:`show_deformation` shows it.
        """
        from deformnb.widgets.refit import Following, Refit

        following, self._followed_output = self._following, output
        if following is not None and following.goes_on(editor, index):
            self.show_deformation(following.show(field)(), output=output)
            return
        self._stop_following()
        self.show_deformation(field, output=output)
        if editor is not None:
            self._following = Following(editor, Refit(field, index), self._show_followed)

    def _show_followed(self, make: Callable[[], AbstractField | None]) -> None:
        self.show_deformation(make(), output=self._followed_output)

    def _stop_following(self) -> None:
        """Hear the editor no more."""
        following, self._following = self._following, None
        if following is not None:
            following.close()

    @abstractmethod
    def set_transfer(self, transfer: TransferFunction | str) -> None:
        """Show with other colours and opacities: a transfer function, or the name of a preset."""

    @abstractmethod
    def set_camera(self, direction: ArrayLike | None = None, up: ArrayLike | None = None,
                   zoom: float | None = None) -> None:
        """Look from another side.

        Parameters
        ----------
        direction : where the viewer looks, any length; None keeps it.
        up : what points up; default is +z, or -y for a view along z.
        zoom : 1 shows the whole box, 2 half of it; None keeps it.
        """

    def set_clip(self, x: Sequence[float] | None = None, y: Sequence[float] | None = None,
                 z: Sequence[float] | None = None) -> None:
        """Cut away what lies outside of a part of the box: in space, whatever the deformation brings there.

        Parameters
        ----------
        x, y, z : lowest and highest share of the box along that index axis, from 0 to 1; None keeps them.
        """
        self.clip = [old if new is None else new for old, new in zip(self.clip, (x, y, z), strict=True)]

    def seen(self) -> Seen:
        """What this view shows now, apart from the deformation: what a picture in a file needs to show the same."""
        from deformnb.exports import Seen
        from deformnb.widgets.core_scene import StillAsSeen, scene_as_seen

        looks = {name: getattr(self, name) for name in ("camera", "projection", "show_folds") if hasattr(self, name)}
        return Seen(shows=self.shows, clip=self.clip, background=self._shade(), scene=scene_as_seen,
                    still=None if self.draws_by_vtk else StillAsSeen, **looks)

    def _shade(self) -> str:
        """The background on the page, "dark" or "light"."""
        return "light" if getattr(self, "background", "") == "light" else "dark"

    @abstractmethod
    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a screen the one of :meth:`still`."""

    @abstractmethod
    def still(self, size: tuple[int, int] | None = None) -> Image:
        """The same picture rendered by the core, at once and without a screen, (height, width, 3)."""

    @abstractmethod
    def stats(self) -> dict[str, Any]:
        """Frame times in milliseconds, bytes sent and the resolution; keys differ between views."""
