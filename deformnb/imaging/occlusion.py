"""Ambient occlusion: the share of the light from all around that reaches a place between its opaque neighbours.

The live view takes it from a coarse grid that is computed once for the colours of a volume, and samples it where
tissue comes from: it follows a deformation at the cost of one texture sample. The ray caster on the CPU does the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb.volume.coarsening import block_means, coarser
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Volume

AMBIENT_CELL = 4
"""Voxels along an edge of a cell; finer ones would show the noise of the voxels as shadow."""

AMBIENT_NEAR = (1, 1.0)
"""Cells to each side of the near surroundings, and how strongly their mean opacity stops light."""

AMBIENT_FAR = (3, 4.0)
"""The same of the far surroundings, of which the mean is taken twice."""

AMBIENT_AHEAD = 3.0
"""Cells in front of a surface at which both are taken: half of the space there is the body."""

AMBIENT_EVEN = 0.04
"""Slope of opacity per cell below which there is no surface, and the place itself counts."""

_MOST_ALPHA = 0.999  # an opaque sample, whose power is finite


def ambient_light(volume: Volume, transfer: TransferFunction) -> Volume:
    """The share of the light from all around that reaches each place of a volume.

    The mean opacities ``a`` of the near and of the far surroundings stop light: ``exp(-sum s a)`` is left. They are box
    filters over cells of 4 x 4 x 4 voxels, as in Diaz, Yela and Vazquez, "Vicinity Occlusion Maps" (2008), which take
    them instead of casting rays; here they are taken in front of a surface, on the side where opacity falls, so that a
    hollow is darker than an even or convex place.

    Parameters
    ----------
    transfer : opacities, for a thickness of ``transfer.unit``.

    Returns
    -------
    Volume
        float32 from 0, no light, to 1, all of it, on the grid of the cells.

    Examples
    --------
    >>> ball = np.zeros((32, 32, 32), np.uint8)
    >>> ball[8:24, 8:24, 8:24] = 100
    >>> light = ambient_light(Volume.from_array(ball), TransferFunction(((0, 1, 1, 1),), ((0, 0), (100, 0.9))))
    >>> light.shape, bool(light.values[0, 0, 0] > light.values[4, 4, 4])
    ((8, 8, 8), True)
    """
    factors = (AMBIENT_CELL,) * 3
    thickness = AMBIENT_CELL * min(volume.grid.spacing) / transfer.unit
    opacity = block_means(_opacities(volume, transfer, thickness), factors)
    near = _mean(opacity, AMBIENT_NEAR[0])
    far = _mean(_mean(near, AMBIENT_FAR[0]), AMBIENT_FAR[0])
    open_side = _ahead(near)
    stopped = [
        strength * ndimage.map_coordinates(mean, open_side, order=1, mode="grid-constant")
        for mean, (_, strength) in ((near, AMBIENT_NEAR), (far, AMBIENT_FAR))
    ]
    light = np.exp(-sum(stopped)).astype(np.float32)
    return Volume(light, coarser(volume.grid, factors), "ambient light")


def _opacities(volume: Volume, transfer: TransferFunction, thickness: float) -> NDArray[np.float32]:
    """Opacity of so thick a layer at each voxel."""

    def of(values: NDArray[np.generic]) -> NDArray[np.float32]:
        alphas = np.minimum(transfer(values)[..., 3], _MOST_ALPHA)
        return np.asarray(1 - (1 - alphas) ** thickness, np.float32)

    if volume.dtype == np.uint8:
        return of(np.arange(256))[volume.values]
    return np.stack([of(layer) for layer in volume.finite_values])


def _ahead(opacity: NDArray[np.float32]) -> NDArray[np.float64]:
    """Places (z, y, x) in front of every cell, where opacity falls; beyond the edge there is none."""
    padded = np.pad(opacity, 1)
    slopes = []
    for axis in range(3):
        after, before = (np.roll(padded, shift, axis)[1:-1, 1:-1, 1:-1] for shift in (-1, 1))
        slopes.append((after - before) / 2)
    slope = np.stack(slopes).astype(np.float64)
    length = np.maximum(np.linalg.norm(slope, axis=0), AMBIENT_EVEN)
    return np.indices(opacity.shape) - AMBIENT_AHEAD * slope / length


def _mean(values: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Mean over so many cells to each side along every axis; beyond the edge nothing stops light."""
    return np.asarray(ndimage.uniform_filter(values, 2 * reach + 1, mode="constant", cval=0.0))
