"""What all views of a volume have in common, so that one can take another's place."""

from __future__ import annotations

from abc import ABC, ABCMeta, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import traitlets
from numpy.typing import ArrayLike

from deformnb.deformation import Deformation
from deformnb.fields import AbstractField
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume
from deformnb.widgets.camera import Image

if TYPE_CHECKING:
    from deformnb.exports import Seen

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
