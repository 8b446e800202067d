"""Transplant of a document from the volume on which it was made to another one, with its points aligned.

The alignment "none" leaves all coordinates unchanged: right for volumes in one space, such as two scans of one
patient that were aligned. The alignment "box" maps the box of the volume it was made on to the box of the other
one, axis by axis: right for specimens of one posture that differ in size and position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from deformnb.checks import check_arguments
from deformnb.document.deformation import Deformation, Keyframe
from deformnb.document.space_maps import SAME, SpaceMap
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.volume.volume import Grid


def _align_nothing(deformation: Deformation, _grid: Grid) -> Deformation:
    return deformation


def _align_box(deformation: Deformation, grid: Grid) -> Deformation:
    made = deformation.volume
    if made is None or made.grid is None:
        raise DeformError(
            "this document has no place of the volume that it was made on, so its box cannot be "
            "aligned with another; open it on that volume and save it again."
        )
    if replace(made.grid, unit=grid.unit) == grid:
        return deformation
    box = _Box(made.grid, grid)
    keys = tuple(Keyframe(key.time, tuple(map(box.step, key.steps))) for key in deformation.keyframes)
    # Its box is this grid's now, and not the one that it was made on: it must not be aligned a second time.
    output = None if deformation.output is None else box.grid(deformation.output)
    return replace(
        deformation, steps=tuple(map(box.step, deformation.steps)), keyframes=keys, volume=None, output=output
    )


AlignmentName: TypeAlias = Literal["none", "box"]
"""Names of the alignments of a document with another volume."""

ALIGNMENTS: dict[str, Callable[[Deformation, Grid], Deformation]] = {"none": _align_nothing, "box": _align_box}
"""Alignments of a document with another volume by name; the first is the default."""


@check_arguments
def transplant(deformation: Deformation, grid: Grid, alignment: AlignmentName = "none") -> Deformation:
    """The document for a volume of another grid; after the alignment "box" it has no volume any more.

    Parameters
    ----------
    deformation : made on any volume.
    grid : of the volume it should be applied to.
    alignment : a name of :data:`ALIGNMENTS`.

    Raises
    ------
    DeformError
        If the name is unknown; for "box", if the document does not have the box of its volume, or holds what
        unequal scales would bend: turns, oblique planes.

    Examples
    --------
    >>> from deformnb.document.deformation import VolumeReference
    >>> from deformnb.rbf.points import ControlPoints
    >>> points = ControlPoints.from_arrays([[2, 4]], [[3, 4]])
    >>> small, large = Grid((8, 8, 8)), Grid((8, 8, 16), (2.0, 1.0, 1.0))
    >>> made = VolumeReference("small", small.shape, small.spacing, "0" * 64, small.origin, small.direction)
    >>> document = replace(Deformation.from_picture_points(small, "+z", points), volume=made)
    >>> transplant(document, large, "box").steps[0].points.source.tolist()
    [[8.0, 4.0]]
    """
    if alignment not in ALIGNMENTS:
        raise DeformError(f"unknown alignment {alignment!r}; choose one of {', '.join(ALIGNMENTS)}.")
    return ALIGNMENTS[alignment](deformation.to_unit(grid.unit), grid)


def with_true_spacing(deformation: Deformation, grid: Grid) -> tuple[Deformation, str]:
    """A document for a volume whose file has a wrong spacing, and a notice; any other document unchanged, and "".

    One that was made with the spacing of the file (see :meth:`Deformation.older_spacing`) is aligned with the
    same voxels in the true spacing, to be edited further: at its points the map is the same, between them it is not.

    Parameters
    ----------
    grid : of the volume on which it should be edited.

    Raises
    ------
    OtherVolumeError
        If it holds what cannot be aligned with them.
    """
    deformation = deformation.to_unit(grid.unit)
    known, made = deformation.older_spacing(grid), deformation.volume
    if known is None or made is None:
        return deformation, ""
    there = made.grid or known.to_file_spacing(grid)
    was = replace(made, origin=there.origin, direction=there.direction)
    try:
        moved = transplant(replace(deformation, volume=was), grid, "box")
    except DeformError as error:
        raise OtherVolumeError(
            f"{known.older_note}, and cannot be moved to the true one: {error} To continue, read "
            f"the volume with spacing={known.header_spacing}."
        ) from None
    now = replace(made, spacing=grid.spacing, origin=grid.origin, direction=grid.direction, unit=grid.unit)
    return replace(moved, volume=now), (
        f"{known.older_note}. Its points were moved to the same voxels; between them the map differs a little. "
        "Deformation.apply and deformnb warp still give the voxels of then, from the document as it was saved."
    )


class _Box(SpaceMap):
    """The map of one grid's box to another's: index axes to index axes, edges to edges."""

    def __init__(self, old: Grid, new: Grid) -> None:
        cells = np.array(new.shape[::-1]) / np.array(old.shape[::-1])
        matrix = new.matrix @ np.diag(cells) @ np.linalg.inv(old.matrix)
        corner = [g.origin - g.matrix @ np.full(3, 0.5) for g in (old, new)]
        super().__init__(matrix, corner[1] - matrix @ corner[0])
        self.old, self.new = old, new

    def grid(self, output: Grid) -> Grid:
        """A box around the other volume, made of its voxels."""
        corners = (output.corners() @ self.matrix.T) + self.shift
        index = self.new.point_to_index(corners)
        low, high = np.floor(index.min(axis=0) + 0.5 + SAME), np.ceil(index.max(axis=0) + 0.5 - SAME)
        x, y, z = (int(n) for n in low)
        nx, ny, nz = (max(1, int(n)) for n in high - low)
        return self.new.crop((z, y, x), (nz, ny, nx))
