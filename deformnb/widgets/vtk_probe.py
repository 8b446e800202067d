"""A small volume and a deformation that show whether a shader deforms rightly: every part has a visible effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from deformnb.cuts import Decoupled
from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField, Composed, DisplacementField
from deformnb.plane import Plane, Raster
from deformnb.regions import Line
from deformnb.volume import Grid, Volume
from deformnb.widgets.camera import Image

# Mean grey levels of 255 between two pictures of the volume below. Voxels that are warped before they are drawn are
# interpolated twice, which costs 1.1; a shader that deforms nothing is off by 13, one that forgets the slopes by 8, one
# that takes two deformations in the wrong order by 4.
_LIKE = 2.0


# Of the volume with cuts: cut faces have the colour of what is inside in one of them, and of what lies between it and
# nothing in the other, which costs 2.6; a shader that hides nothing is off by 4.8, one without slopes there by 3.7.
_LIKE_WITH_CUTS = 3.2


def is_like(image: Image, other: Image, *, has_cuts: bool = False) -> bool:
    """Whether two pictures of a volume below, 96 x 96, show the same."""
    return float(np.abs(image.astype(int) - other.astype(int)).mean()) < (_LIKE_WITH_CUTS if has_cuts else _LIKE)


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


def cut_probe() -> tuple[Volume, AbstractField]:
    """The same bar, cut along two lines and pulled apart, more at one end than at the other."""
    volume, moved = probe()
    grid = volume.grid
    plane = Plane.through(grid.center, (0.3, 2.0, -0.5))
    lines = (Line(((-2.0, -9.0), (3.0, 9.0))), Line(((-9.0, 1.0), (9.0, 3.0))))
    sides = ((False, False), (False, True), (True, False))
    pulls = ((4.0, -2.0), (3.0, 3.0), (-3.0, -2.0))
    box = Raster((2, 2), (1.0, 1.0), (0.0, 0.0))
    fields = tuple(Extrusion(plane, plane.depth_range(grid), (DisplacementField(np.full((2, 2, 2), pull), box),),
                             np.array([0.0, 1.0]), np.array([[0.4, 1.0]])) for pull in pulls)
    assert isinstance(moved, Composed)
    return volume, Composed(moved.first, Decoupled(fields, sides, lines, plane, "source", 0.6))


def warped(volume: Volume, field: AbstractField) -> Volume:
    """As :func:`deformnb.warp.warp` does it, without the second that it takes to compile."""
    index = np.moveaxis(np.indices(volume.shape)[::-1], 0, -1)
    points = volume.grid.index_to_point(index)
    at = volume.grid.point_to_index(points + field.displacement(points))
    values = ndimage.map_coordinates(volume.values, np.moveaxis(at, -1, 0)[::-1], order=1, mode="grid-constant")
    opacity = field.opacity(points)  # of which little is one where the background is zero
    return replace(volume, values=(values * opacity).astype(values.dtype))
