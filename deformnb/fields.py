"""Everything that displaces: a field maps points to backward displacements.

``output(x) = input(x + D(x))``: D is looked up at the place in the result and points to where the value comes from.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from deformnb.plane import Raster
    from deformnb.volume import Grid


class AbstractField(ABC):
    """A backward displacement field in the plane (dim 2) or in space (dim 3).

    Subclasses are frozen dataclasses registered as JAX pytrees. They must define :meth:`__call__`; the rest has
    slow but right defaults.
    """

    @property
    @abstractmethod
    def dim(self) -> int:
        """2 for a field over a picture's plane, 3 for a field in space."""

    @abstractmethod
    def __call__(self, points: Any) -> Any:
        """Displacements (..., dim) at points (..., dim): pure JAX, for jit, grad and vmap."""

    @abstractmethod
    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        """Displacements (..., dim) at points (..., dim), in float64 NumPy; the path of scripts and tests."""

    def on_raster(self, raster: Raster) -> NDArray[np.float32]:
        """Displacements at the pixel centres of a raster (dim 2): shape (2, nv, nu), components first."""
        return np.ascontiguousarray(np.moveaxis(self.displacement(raster.points()), -1, 0), dtype=np.float32)

    def on_grid(self, grid: Grid) -> NDArray[np.float32]:
        """Displacements at the voxel centres of a grid (dim 3): shape (3, nz, ny, nx), components x, y, z first."""
        k, j, i = np.indices(grid.shape)
        points = grid.index_to_point(np.stack([i, j, k], axis=-1))
        return np.ascontiguousarray(np.moveaxis(self.displacement(points), -1, 0), dtype=np.float32)
