"""The drawings of D'Arcy Thompson's grids, cut out of the scans of his book.

Each scan has two figures side by side: an animal on its grid, and a second one on the bent grid. A drawing has the
coordinates of the whole scan, so that the nodes of :func:`~deformnb.datasets.thompson_grid` are on its lines.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.datasets.darcy import thompson_grid, thompson_grids
from deformnb.volume.plane import Picture, Plane, Raster

PLATE_SOURCE = "D'Arcy Wentworth Thompson, On Growth and Form, 1917; Project Gutenberg ebook 55264; public domain"
"""Origin and licence of the drawings, to be printed with them."""

_PLANE = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def thompson_plate(name: str | int) -> Picture:
    """The drawing of an animal on its grid, as Thompson printed it.

    Parameters
    ----------
    name : a species or the beginning of its name, or the number of the figure.

    Returns
    -------
    Picture
        Grey values from 0, black, to 255, with one pixel of the scan as unit of length. Its raster begins where the
        figure does on the scan, so that places on it are those of :attr:`ThompsonGrid.nodes`.

    Raises
    ------
    DeformError
        If there is no such figure.

    Examples
    --------
    >>> thompson_plate("Polyprion")
    <Picture: drawing, 449 x 361 pixels (right, down) of 1 x 1, uint8 from 0 to 255>
    """
    grid = thompson_grid(name)
    left, right = plate_columns(grid.figure)
    drawing = _scan(grid.image)[:, left:right]
    return Picture(drawing, _PLANE, Raster(drawing.shape, (1.0, 1.0), (float(left), 0.0)), "drawing", (0.0, 255.0))


@cache
def _scan(image: str) -> NDArray[Any]:
    """(rows, columns) uint8 of a scan."""
    from PIL import Image

    with resources.files("deformnb.datasets").joinpath("plates", image).open("rb") as stream:
        values = np.array(Image.open(stream).convert("L"))
    values.flags.writeable = False
    return values


def plate_columns(figure: int) -> tuple[int, int]:
    """Columns of a figure on its scan, the first and the one after the last: halfway between the grids of a scan.

    Examples
    --------
    >>> plate_columns(377)
    (0, 449)
    """
    image = thompson_grids()[figure].image
    first, second = sorted((g for g in thompson_grids().values() if g.image == image), key=lambda g: g.figure)
    middle = round(float(first.nodes[..., 0].max() + second.nodes[..., 0].min()) / 2)
    return (0, middle) if figure == first.figure else (middle, _scan(image).shape[1])
