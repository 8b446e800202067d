"""Coarser grids: each voxel represents a block of voxels."""

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

    Returns
    -------
    float32; the values themselves where a block is one voxel. Sums of integers of one or two bytes are exact.

    Examples
    --------
    >>> block_means(np.array([[[1, 3, 8]]]), (2, 1, 1)).tolist()
    [[[2.0, 8.0]]]
    """
    if max(factors) == 1:
        return values
    total, count = values, np.ones((1, 1, 1), int)
    kind = _sum_type(values.dtype, int(np.prod(factors)))
    for axis, f in enumerate(factors[::-1]):
        if f > 1:
            n = values.shape[axis]
            held = np.minimum(f, n - np.arange(0, n, f))
            count = count * held.reshape([-1 if k == axis else 1 for k in range(3)])
            total = _sums(total, axis, f, kind)
    return np.asarray(np.divide(total, count.astype(np.float32), dtype=np.float32))


def _sum_type(kind: np.dtype[Any], count: int) -> np.dtype[Any]:
    """The smallest type that holds sums of so many values: less written memory is faster."""
    if kind.kind not in "iu" or kind.itemsize > 2:
        return np.dtype(np.float32)
    return np.min_scalar_type(count * (np.iinfo(kind).min or np.iinfo(kind).max))


def _sums(values: NDArray[Any], axis: int, f: int, kind: np.dtype[Any]) -> NDArray[Any]:
    """Sums over f voxels along an axis; np.add.reduceat takes six times as long for so few."""

    def every(k: int) -> NDArray[Any]:
        return values[(slice(None),) * axis + (slice(k, None, f),)]

    total = every(0).astype(kind)
    for k in range(1, min(f, values.shape[axis])):
        part = every(k)
        into = total[(slice(None),) * axis + (slice(part.shape[axis]),)]
        np.add(into, part, out=into, casting="unsafe")
    return total
