"""Coarser grids: each voxel stands for a block of voxels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.volume.volume import Grid


def coarser(grid: Grid, factors: tuple[int, int, int]) -> Grid:
    """The grid of blocks of so many voxels along x, y, z.

    Examples
    --------
    >>> coarser(Grid((2, 4, 5)), (4, 4, 1)).shape
    (2, 1, 2)
    """
    z, y, x = (-(-n // f) for n, f in zip(grid.shape, factors[::-1], strict=True))
    first = grid.index_to_point((np.asarray(factors) - 1) / 2)  # the middle of the first block
    return replace(grid, shape=(z, y, x), spacing=tuple(np.asarray(grid.spacing) * factors), origin=tuple(first))


def block_means(values: NDArray[Any], factors: tuple[int, int, int]) -> NDArray[Any]:
    """Means over blocks of so many voxels along x, y, z of values [z, y, x]; those at the end may have fewer.

    Examples
    --------
    >>> block_means(np.array([[[1, 3, 8]]]), (2, 1, 1)).tolist()
    [[[2.0, 8.0]]]
    """
    for axis, f in enumerate(factors[::-1]):
        if f > 1:
            n = values.shape[axis]
            total = np.add.reduceat(values, np.arange(0, n, f), axis=axis, dtype=np.float32)
            count = np.minimum(f, n - np.arange(0, n, f)).astype(np.float32)
            values = total / count.reshape([-1 if k == axis else 1 for k in range(3)])
    return values
