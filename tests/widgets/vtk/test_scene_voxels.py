"""Voxels of a scene of VTK for a volume in a larger box, and the limits of memory."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.vtk.scene import pad_to_box

GRID = Grid((4, 5, 6))


def test_a_larger_box_is_filled_with_background() -> None:
    volume = Volume(np.arange(120, dtype=np.uint8).reshape(GRID.shape), GRID)
    around, first = pad_to_box(volume, GRID.crop((-1, 0, -2), (5, 5, 8)))
    np.testing.assert_allclose(around.grid.index_to_point(first), GRID.origin, atol=1e-9)
    x, y, z = first.astype(int)
    assert (x >= 2, z >= 1) == (True, True)
    np.testing.assert_array_equal(around.values[z : z + 4, y : y + 5, x : x + 6], volume.values)
    assert around.values.sum() == volume.values.sum()


@pytest.mark.parametrize("box", [Grid((8, 8, 8), (2000.0,) * 3), Grid((4, 4, 4), origin=(1e5, 1e5, 0.0))])
def test_few_voxels_that_are_large_or_far_away_are_refused_before_the_memory_is_gone(box: Grid) -> None:
    with pytest.raises(DeformError, match="are free; choose a box nearer to the volume"):
        pad_to_box(Volume(np.zeros(GRID.shape, np.uint8), GRID), box)
