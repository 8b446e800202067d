"""Every kernel and every trend reaches the shaders, of the front end and of VTK, as maps of Python's values."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.document.deformation import Deformation
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.packed_volume import packed_volume
from deformnb.widgets.textures import field_textures

GRID = Grid((12, 20, 30), (1.5, 1.0, 1.2), (5.0, -7.0, 30.0))
VOLUME = Volume(np.zeros(GRID.shape, np.uint8), GRID)
SHOWN = packed_volume(VOLUME, 10**6, 2048)
PAIRS = [
    (kernel, trend) for kernel, row in KERNELS.items() for trend, kind in TRENDS.items() if kind.order >= row.order
]
RANDOM = np.random.default_rng(3)


def _points(dim: int) -> ControlPoints:
    source = GRID.index_to_point(RANDOM.uniform(2, 10, (14, 3)))
    if dim == 2:
        source = Plane.from_view(GRID, "+y").to_plane(source)[:, :2]
    return ControlPoints.from_arrays(source, source + RANDOM.normal(size=source.shape))


@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_the_map_of_a_picture_is_that_of_the_fit(kernel: str, trend: str) -> None:
    document = Deformation.from_picture_points(VOLUME, "+y", _points(2), kernel=kernel, trend=trend)
    field = document.field(GRID)
    made = field_textures(field, SHOWN, None, 32, 16)
    planar = made.content.planar
    assert planar is not None
    _, rows, columns = planar["shape"]
    found = np.frombuffer(made.buffer("maps"), "<f4").reshape(rows, columns, 2)
    wanted = field.maps[0].sample_on_raster(Raster((rows, columns), tuple(planar["spacing"]), tuple(planar["origin"])))
    np.testing.assert_allclose(found, np.moveaxis(wanted, 0, -1), atol=1e-5 * max(1.0, np.abs(wanted).max()))


@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_the_map_in_space_is_that_of_the_fit(kernel: str, trend: str) -> None:
    field = Deformation.from_space_points(_points(3), kernel=kernel, trend=trend).field(GRID)
    made = field_textures(field, SHOWN, None, 32, 16)
    space = made.content.space
    assert space is not None
    counts = np.asarray(space["shape"])
    found = np.frombuffer(made.buffer("space"), "<f4").reshape(*counts[::-1], 3)
    index = np.moveaxis(np.indices(counts[::-1])[::-1], 0, -1)
    places = GRID.index_to_point((index * np.asarray(space["spacing"]) + space["origin"]) / GRID.spacing)
    wanted = field.displacement(places)
    np.testing.assert_allclose(found, wanted, atol=1e-4 * max(1.0, np.abs(wanted).max()))
