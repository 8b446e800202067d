"""The test problem: a volume that looks like a scan, and control points that deform it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume

AMPLITUDE = 0.05
"""Size of the drags as a share of the edge of the volume: 13 voxels of 256."""

SUPPORT = 0.5
"""Support radius as a share of the edge."""


def volume(size: int, dtype: str) -> Volume:
    """Shells and texture, smooth at the scale of voxels, from 0 to 255."""
    x = np.linspace(-1, 1, size, dtype=np.float32)
    z, y, x = np.meshgrid(x, x, x, indexing="ij", sparse=True)
    r = np.sqrt(1.2 * x**2 + 1.6 * y**2 + 1.1 * z**2)
    texture = 90 * (r < 0.5) * (0.6 + 0.4 * np.sin(14 * x) * np.sin(11 * y) * np.sin(9 * z))
    values = 120 * np.exp(-(((r - 0.55) / 0.06) ** 2)) + texture + 30 * np.exp(-(((r - 0.85) / 0.03) ** 2))
    return Volume(np.clip(values, 0, 255).astype(dtype), Grid((size, size, size)))


def control_points(count: int, dim: int, size: int, seed: int = 0) -> ControlPoints:
    """Well spread targets in the box of a volume, dragged smoothly with some scatter."""
    rng = np.random.default_rng(seed)
    target = qmc.Halton(dim, rng=rng).random(count)
    wave = np.sin(2 * np.pi * (target @ rng.normal(size=(dim, dim)) + rng.random(dim)))
    moved = AMPLITUDE * (wave + 0.1 * rng.normal(size=(count, dim)))
    return ControlPoints.from_arrays((target + moved) * (size - 1), target * (size - 1))


def lookup(displacement: NDArray[Any]) -> NDArray[np.float64]:
    """Lookup of each voxel, (3, nz, ny, nx) in the order z, y, x, for unit voxels."""
    return np.indices(displacement.shape[:3]) + np.moveaxis(displacement[..., ::-1], -1, 0).astype(np.float64)
