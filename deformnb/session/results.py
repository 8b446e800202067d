"""The results of a session: the field of its document, the deformed volume, and its box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from deformnb._typing import Progress
from deformnb.analysis.extent import (
    MOST,
    Foreground,
    exceeded_sides,
    field_of_view,
    find_foreground,
    padded,
    reached_places,
)
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.io.files.memory import check_room
from deformnb.rbf.fields import AbstractField
from deformnb.session.editing import Editing
from deformnb.session.latest import Latest
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Grid, Volume


class Results:
    """Results of a session's document on its volume.

    Parameters
    ----------
    volume, channels : that are deformed; channels None where there are none.
    editing : the document.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> from deformnb.session import Session
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> session.results.grow(2)
    >>> session.results.volume().shape
    (10, 10, 10)
    """

    def __init__(self, volume: Volume, channels: Channels | None, editing: Editing) -> None:
        self._volume, self._channels, self._editing = volume, channels, editing
        self._field: Latest[Deformation, AbstractField] = Latest()
        self._foreground: Latest[None, Foreground] = Latest()

    def field(self) -> AbstractField:
        """The backward displacement in space of the whole document."""
        grid = self._editing.grid
        return self._field.of(lambda: self._editing.deformation, lambda deformation: deformation.field(grid))

    def notes(self) -> tuple[str, ...]:
        """Remarks of the fits, each once."""
        return self._editing.deformation.notes(self._editing.grid)

    def volume(self, progress: Progress | None = None) -> Volume:
        """The deformed volume on :attr:`grid`, warped with the document of this moment."""
        return self._deform([self._volume], progress)[0]

    def channels(self, progress: Progress | None = None) -> Channels:
        """The deformed channels, all by one map, on :attr:`grid`.

        Raises
        ------
        DeformError
            If there are none.
        """
        if self._channels is None:
            raise DeformError("this volume has no channels; volume() is the deformed volume.")
        return self._channels.with_volumes(self._deform(self._channels.volumes, progress))

    def _deform(self, volumes: Sequence[Volume], progress: Progress | None) -> list[Volume]:
        deformation = self._editing.deformation
        box = deformation.output
        output = None if box is None else self._volume.to_own_resolution(box)
        check_room(self._volume, output)
        return deformation.apply_all(volumes, output=output, progress=progress)

    # -- the box of the result -----------------------------------------------------------------------------------------

    @property
    def grid(self) -> Grid | None:
        """The box ``output`` of the document in voxels as large as the volume's; None is the volume's own grid."""
        box = self._editing.output
        return None if box is None else self._volume.to_own_resolution(box)

    @property
    def box(self) -> Grid:
        """The grid of the result, the volume's own if there is no other."""
        return self.grid or self._volume.grid

    def grow(self, margin: ArrayLike) -> None:
        """Give the result a margin around the volume, so that tissue dragged out of its box is not cut off.

        Parameters
        ----------
        margin : a length or (x, y, z), rounded up to whole voxels; 0 is the volume's own box again, negative crops.
        """
        own = self._editing.grid
        grid = padded(own, margin)
        self._editing.output = None if grid == own else grid

    def fit_output(self, *, most: float = MOST, joins: bool = False) -> bool:
        """Give the result a box as large as deformed foreground needs, and at least that of the volume.

        Parameters
        ----------
        most : how many times the voxels of the volume it may have; a notice reports if that is too few.
        joins : as part of the last edit, which undo reverts together with it; nothing happens if another edit, or an
            older state, is shown by the time that the box is known.

        Returns
        -------
        Whether all of the foreground fits.
        """
        editing = self._editing
        deformation = editing.deformation
        found = field_of_view(self.foreground(), deformation.field(editing.grid), most=most)
        box = self._volume.to_finest_resolution(found.grid)
        if not joins:
            editing.output = box
        elif box != deformation.output:
            editing.amend(deformation, replace(deformation, output=box), editing.notice)
        if found.is_limited:
            editing.notice = (
                f"Tissue reaches farther than a box of {most:g} times the volume's voxels; the rest is cut off."
            )
        return not found.is_limited

    def exceeded_sides(self) -> tuple[str, ...]:
        """The sides on which dragged foreground leaves the box of the result, in words; takes a moment."""
        if not _moves(self._editing.deformation):
            return ()
        return exceeded_sides(reached_places(self.foreground(), self.field()), self.box)

    def foreground(self) -> Foreground:
        """Foreground of the volume; looked up once."""
        return self._foreground.of(lambda: None, lambda _: find_foreground(self._volume))


def _moves(deformation: Deformation) -> bool:
    """Check whether anything is dragged at all: a scan may be cut through tissue as it is."""
    return any(part.motion is not None for step in deformation.steps for part in step.parts) or any(
        bool(points.displacement.any()) for step in deformation.steps for points in step.maps
    )
