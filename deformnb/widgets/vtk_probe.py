"""A small volume and a deformation that show whether a shader deforms rightly: every part has a visible effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField, Composed, DisplacementField
from deformnb.plane import Plane, Raster
from deformnb.volume import Grid, Volume
from deformnb.widgets.view import Image

# Mean grey levels of 255 between two pictures of the volume below. Voxels that are warped before they are drawn are
# interpolated twice, which costs 1.1; a shader that deforms nothing is off by 13, one that forgets the slopes by 8, one
# that takes two deformations in the wrong order by 4.
_LIKE = 2.0


def is_like(image: Image, other: Image) -> bool:
    """Whether two pictures of the volume below, 96 x 96, show the same."""
    return float(np.abs(image.astype(int) - other.astype(int)).mean()) < _LIKE


def probe() -> tuple[Volume, AbstractField]:
    """A bar without symmetry, moved by maps over an oblique plane that change with depth, after a shift in space."""
    grid = Grid((40, 48, 56), (0.6, 0.5, 0.7), (3.0, -5.0, 2.0))
    k, j, i = (a / n for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    bar = np.maximum(np.abs(i - 0.5) / 0.3, np.maximum(np.abs(j - 0.45) / 0.16, np.abs(k - 0.55) / 0.2))
    ball = np.sqrt((i - 0.35) ** 2 + (j - 0.6) ** 2 + (k - 0.35) ** 2) / 0.22
    volume = Volume((np.clip(4 * (1.2 - np.minimum(bar, ball)), 0, 1) * 200).astype(np.uint8), grid)
    plane = Plane.through(grid.center, (1.0, 2.0, -0.7))
    ripple = np.array([[[2.0, 0.0], [-3.0, 2.0], [0.0, 3.0]], [[4.0, -2.0], [0.0, 5.0], [-4.0, 1.0]],
                       [[0.0, 2.0], [3.0, 0.0], [2.0, -3.0]]])
    maps = tuple(DisplacementField(a, Raster((3, 3), (12.0, 10.0), (-12.0, -10.0))) for a in (ripple, -ripple[::-1]))
    bend = Extrusion(plane, plane.depth_range(grid), maps, np.array([0.2, 0.9]), np.eye(2))
    shift = np.zeros((2, 2, 2, 3))
    shift[1, ..., 0], shift[:, 1, :, 2] = 3.0, -2.0
    lattice = Grid((2, 2, 2), grid.lengths, grid.origin)
    return volume, Composed(DisplacementField(shift, lattice), bend)


def warped(volume: Volume, field: AbstractField) -> Volume:
    """As :func:`deformnb.warp.warp` does it, without the second that it takes to compile."""
    index = np.moveaxis(np.indices(volume.shape)[::-1], 0, -1)
    points = volume.grid.index_to_point(index)
    at = volume.grid.point_to_index(points + field.displacement(points))
    values = ndimage.map_coordinates(volume.values, np.moveaxis(at, -1, 0)[::-1], order=1, mode="grid-constant")
    return replace(volume, values=values)
