"""Corrections of voxel spacing for public volumes whose files state a wrong one.

The table is data, ``known_spacings.json`` next to this file. A row names a volume by properties of any copy of it,
for any name and any compression of its file: ``shape`` [z, y, x], ``dtype``, ``header_spacing`` (x, y, z),
and ``sha256``, the checksum of :func:`voxel_checksum`. Only a volume that agrees in the first three is
hashed, so that the rule costs nothing for any other.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Float3
from deformnb.volume.volume import Grid


@dataclass(frozen=True)
class KnownSpacing:
    """A row of the table.

    Parameters
    ----------
    title : which volume it is.
    shape, dtype, sha256 : of its voxels [z, y, x].
    header_spacing : (x, y, z) in its files; wrong.
    spacing : (x, y, z), the true one in mm.
    reason : how that is known.
    """

    title: str
    shape: tuple[int, int, int]
    dtype: str
    sha256: str
    header_spacing: Float3
    spacing: Float3
    reason: str

    @property
    def note(self) -> str:
        """Note for a volume that got its true spacing."""
        return (
            f"this is the {self.title}: its file has a spacing of {_spacing_text(self.header_spacing)}, which is wrong"
            f"; {_spacing_text(self.spacing)} was taken, after {self.reason} (pass the spacing to have another)"
        )

    @property
    def older_note(self) -> str:
        """Note for a document that was made with the spacing of the file."""
        return (
            f"this document was made on the {self.title} with the wrong spacing of its file, "
            f"{_spacing_text(self.header_spacing)} instead of {_spacing_text(self.spacing)}"
        )

    def is_right(self, grid: Grid) -> bool:
        """Check whether a grid is that of this volume with its true spacing."""
        return grid.shape == self.shape and bool(np.allclose(grid.spacing, self.spacing, rtol=1e-5, atol=0))

    def to_file_spacing(self, grid: Grid) -> Grid:
        """The volume's grid with the spacing of its file."""
        return replace(grid, spacing=self.header_spacing)

    def correct_spacing(self, output: Grid, grid: Grid) -> Grid:
        """The grid of a result that was made with the spacing of the file, on the same voxels with the true one.

        Parameters
        ----------
        output : its directions are those of the volume.
        grid : of the volume, with the true spacing.
        """
        index = self.to_file_spacing(grid).point_to_index(output.origin)
        x, y, z = (float(s) for s in np.asarray(output.spacing) / self.header_spacing * self.spacing)
        return replace(grid, shape=output.shape, spacing=(x, y, z), origin=tuple(grid.index_to_point(index)))


@cache
def known_spacings() -> tuple[KnownSpacing, ...]:
    """The rows of the table.

    Examples
    --------
    >>> known_spacings()[0].spacing
    (0.390625, 1.0, 0.78125)
    """
    rows = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
    return tuple(
        KnownSpacing(
            row["title"],
            tuple(row["shape"]),
            row["dtype"],
            row["sha256"],
            tuple(row["header_spacing"]),
            tuple(row["spacing"]),
            row["reason"],
        )
        for row in rows
    )


def known_spacing(grid: Grid, dtype: Any, checksum: Callable[[], str]) -> KnownSpacing | None:
    """The row of a volume, None if its file is not known to be wrong.

    Parameters
    ----------
    grid : as in the file.
    dtype : of the voxels.
    checksum : gives :func:`deformnb.volume.volume.voxel_checksum`; computed only where all the rest agrees.
    """
    likely = [
        row
        for row in known_spacings()
        if row.shape == grid.shape
        and row.dtype == np.dtype(dtype).name
        and np.allclose(row.header_spacing, grid.spacing, rtol=1e-5, atol=0)
    ]
    if not likely:
        return None
    found = checksum()
    return next((row for row in likely if row.sha256 == found), None)


def older_document(sha256: str, spacing: Float3, grid: Grid) -> KnownSpacing | None:
    """The row of a document's volume, if the document was made with the file's spacing and ``grid`` has the true one.

    Parameters
    ----------
    sha256, spacing : of the document's volume.
    grid : of the volume that the document is applied to.
    """
    return next(
        (
            row
            for row in known_spacings()
            if row.sha256 == sha256
            and row.is_right(grid)
            and np.allclose(row.header_spacing, spacing, rtol=1e-5, atol=0)
        ),
        None,
    )


def _spacing_text(spacing: Float3) -> str:
    return " x ".join(f"{s:.6g}" for s in spacing)
