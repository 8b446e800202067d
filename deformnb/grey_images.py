"""Pictures and volumes as grey values that can be read anywhere: what is compared when targets are found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from deformnb.control_points import ControlPoints
from deformnb.errors import DeformError
from deformnb.plane import Picture
from deformnb.volume import Volume

Pictured: TypeAlias = Picture | Volume


@dataclass(frozen=True, eq=False)
class GreyImage:
    """Grey values in [0, 1] and where they lie: ``index = matrix @ point + offset``, in the order of the array's axes.

    Parameters
    ----------
    values : (nv, nu) or (nz, ny, nx) float64; 0 is background.
    matrix, offset : from picture coordinates (a, b), or (x, y, z), to indices.
    """

    values: NDArray[np.float64]
    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]

    @classmethod
    def of(cls, given: Pictured) -> GreyImage:
        """The grey values of a picture, or of a volume between its background and its largest value."""
        if isinstance(given, Picture):
            (du, dv), (a, b) = given.raster.spacing, given.raster.origin
            matrix = np.array([[0.0, 1 / dv], [1 / du, 0.0]])
            return cls(given.grey().astype(np.float64), matrix, -matrix @ np.array([a, b]))
        if isinstance(given, Volume):
            low, high = given.background, given.value_range[1]
            values = np.clip((given.finite_values.astype(np.float64) - low) / ((high - low) or 1.0), 0, 1)
            matrix = np.asarray(np.linalg.inv(given.grid.matrix)[::-1], np.float64)
            return cls(values, matrix, -matrix @ np.asarray(given.grid.origin))
        raise DeformError(f"what is matched must be a Picture or a Volume, got {type(given).__name__}.")

    @property
    def dim(self) -> int:
        """2 for a picture, 3 for a volume."""
        return self.values.ndim

    @property
    def pixel(self) -> float:
        """The smallest distance of neighbouring pixels."""
        return float(1 / np.linalg.norm(self.matrix, axis=1).max())

    @property
    def diagonal(self) -> float:
        """Length from the first pixel to the last."""
        return float(np.linalg.norm(np.linalg.solve(self.matrix, np.array(self.values.shape) - 1.0)))

    def points(self, *indices: Any) -> NDArray[np.float64]:
        """The points (..., dim) of all combinations of indices along the axes."""
        index = np.stack(np.meshgrid(*indices, indexing="ij"), axis=-1)
        return np.asarray(np.linalg.solve(self.matrix, (index - self.offset)[..., None])[..., 0])

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at points (..., dim), linearly; background outside the outer edges of the pixels."""
        index = np.moveaxis(points @ self.matrix.T + self.offset, -1, 0)
        values = ndimage.map_coordinates(self.values, index, order=1, mode="nearest")
        return np.asarray(np.where(self.covers(points), values, 0.0))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """True for the points that lie in it."""
        index = points @ self.matrix.T + self.offset
        return np.asarray(((index >= -0.5) & (index <= np.array(self.values.shape) - 0.5)).all(axis=-1))

    def smoothed(self, length: float) -> GreyImage:
        """Smoothed by a Gaussian of this standard deviation."""
        if length == 0:
            return self
        sigma = length * np.linalg.norm(self.matrix, axis=1)
        return replace(self, values=ndimage.gaussian_filter(self.values, sigma, mode="constant"))


def grey_pair(points: ControlPoints, moving: Pictured, fixed: Pictured) -> tuple[GreyImage, GreyImage]:
    """The grey values of both, refused where they do not go with the points or with one another."""
    pair = GreyImage.of(moving), GreyImage.of(fixed)
    for image, given in zip(pair, (moving, fixed), strict=True):
        if image.dim != points.dim:
            need = "pictures" if points.dim == 2 else "volumes"
            raise DeformError(f"control points of {points.dim} dimensions are matched on {need}, got a "
                              f"{type(given).__name__}; project the volume, or take points in space.")
    return pair
