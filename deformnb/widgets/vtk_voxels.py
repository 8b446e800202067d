"""What a scene of VTK must know of a volume: its voxels as far as can be seen, its frame, and what is white."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deformnb.transfer import levels
from deformnb.volume import Grid, Volume
from deformnb.widgets.shown_volume import ShownVolume


def covering(volume: Volume, output: Grid | None) -> tuple[Volume, NDArray[np.float64]]:
    """The volume with background around it up to the box of ``output``, and where its first voxel (i, j, k) is."""
    grid = volume.grid if output is None else volume.grid.covering(output.corners())
    if grid.shape == volume.grid.shape:
        return volume, np.zeros(3)
    start = np.round(grid.point_to_index(volume.grid.origin))
    values = np.full(grid.shape, volume.dtype.type(volume.background))
    nz, ny, nx = volume.shape
    x, y, z = start.astype(int)
    values[z : z + nz, y : y + ny, x : x + nx] = volume.finite_values
    return replace(volume, values=values, grid=grid), start


def frame_of(volume: Volume) -> ShownVolume:
    """The frame that maps of displacements lie in: lengths along the axes from the centre of the first voxel."""
    return ShownVolume(volume, volume.grid, (0.0, 1.0), (1, 1, 1), "", 0, 1.0)


def white_of(volume: Volume) -> float:
    """The value that is white in a maximum projection."""
    discrete = volume.is_labels or volume.dtype == np.bool_
    return volume.value_range[1] if discrete else levels(volume)[3]
