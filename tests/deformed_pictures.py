"""Pictures with texture and known deformations of them, for the tests of what finds targets by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Plane, Raster

PLANE = Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))


def texture(shape: tuple[int, ...], seed: int = 1, scales: tuple[float, ...] = (2.0, 5.0, 12.0)) -> NDArray[np.float64]:
    """Grey values in [0, 1] with structure of several sizes, fading to 0 at the edge."""
    rng = np.random.default_rng(seed)
    values = sum(ndimage.gaussian_filter(rng.standard_normal(shape), s) * s for s in scales)
    values = (values - values.min()) / np.ptp(values)
    lines = [np.clip(4 - 4 * np.abs(np.linspace(-1, 1, n)) ** 3, 0, 1) for n in shape]
    return values * np.prod(np.meshgrid(*lines, indexing="ij"), axis=0)


def picture(values: NDArray[Any], spacing: float = 1.0, origin: tuple[float, float] = (0.0, 0.0)) -> Picture:
    """A picture of grey values in [0, 1]."""
    return Picture(values, PLANE, Raster(values.shape, (spacing, spacing), origin), "slice", (0.0, 1.0))


def warp_by_scipy(shown: Picture, field: AbstractField) -> Picture:
    """The picture warped by a backward displacement, by SciPy."""
    places = shown.raster.points()
    places = (places + field.displacement(places) - shown.raster.origin) / shown.raster.spacing
    return picture(
        ndimage.map_coordinates(shown.values, [places[..., 1], places[..., 0]], order=1),
        shown.raster.spacing[0],
        shown.raster.origin,
    )


def lattice_points(size: float, count: int = 4, shift: float = 0.0, seed: int = 3) -> ControlPoints:
    """count x count points over the middle of a square, their targets moved by random amounts of ``shift``."""
    line = np.linspace(0.2, 0.8, count) * size
    source = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return ControlPoints.from_arrays(source, source + np.random.default_rng(seed).normal(0, shift, source.shape))
