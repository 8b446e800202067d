"""Every projection as slow, literal loops in float64, and small volumes of all kinds to compare on."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from deformnb.volume.plane import Picture
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Volume

# Towards the lamp in (u, v, n): above the viewer's left shoulder.
LAMP = np.array([-0.35, -0.45, -0.82]) / np.linalg.norm([-0.35, -0.45, -0.82])

TOP = 93
RAMP = TransferFunction(((0, 0.1, 0.2, 0.3), (40, 0.9, 0.4, 0.1), (TOP, 1, 1, 0.8)), ((0, 0.0), (30, 0.02), (TOP, 0.4)))

# Layouts of a stored volume: plain, RAS, axes swapped, and swapped with flips.
DIRECTIONS = {
    "LPS": np.eye(3),
    "RAS": np.diag([-1.0, -1, 1]),
    "PIR": np.array([[0, 0, -1.0], [1, 0, 0], [0, -1, 0]]),
    "SLA": np.array([[0, 1.0, 0], [0, 0, -1], [1, 0, 0]]),
}


def volume_of(values: Any, spacing: Any = (1.0, 1.0, 1.0), direction: Any = None, origin: Any = (0, 0, 0)) -> Volume:
    matrix = np.eye(3) if direction is None else np.asarray(direction)
    return Volume.from_array(values, spacing, origin, tuple(map(tuple, matrix.tolist())))


def noise(shape: tuple[int, int, int], dtype: str = "uint8", top: int = TOP) -> np.ndarray:
    values = np.random.default_rng(7).integers(0, top + 1, shape)
    values.flat[0], values.flat[-1] = 0, top  # the whole range in each random draw
    return values.astype(dtype)


def column(volume: Volume, picture: Picture, row: int, col: int) -> list[float]:
    """The voxels under a pixel, front to back, found by walking through space and not through the array."""
    a, b = picture.raster.columns[col], picture.raster.rows[row]
    near, far = picture.plane.depth_range(volume.grid)
    step = min(volume.grid.spacing) / 4
    seen: list[tuple[int, int, int]] = []
    for c in np.arange(near, far + step / 2, step):
        i, j, k = np.floor(volume.grid.point_to_index(picture.plane.from_plane([a, b, c])) + 0.5 + 1e-9).astype(int)
        if (k, j, i) not in seen:
            seen.append((k, j, i))
    return [volume.values[place] for place in seen]


def shine(slope: np.ndarray, spacing: float) -> float:
    """Blinn and Phong: ambient 0.35, diffuse 0.75, specular 0.35 with exponent 24; fading out where all is even."""
    size = float(np.linalg.norm(slope))
    sure = min(1.0, size * spacing / (0.02 * TOP))
    if size == 0:
        return 0.8
    half = LAMP + np.array([0.0, 0.0, -1.0])
    half = half / np.linalg.norm(half)
    normal = slope / size
    return sure * (0.35 + 0.75 * abs(normal @ LAMP) + 0.35 * abs(normal @ half) ** 24) + (1 - sure) * 0.8


def composite(
    layers: list[np.ndarray],
    spacing: float,
    transfer: TransferFunction,
    *,
    slopes: tuple[float, float, float] | None = None,
) -> np.ndarray:
    """C += (1 - A) alpha c, A += (1 - A) alpha, over layers (v, u) front to back.

    ``slopes`` are the distances (du, dv, dn) of neighbours: then it is shaded.
    """
    nv, nu = layers[0].shape
    padded = np.pad(np.array(layers, dtype=float), 1)
    out = np.zeros((nv, nu, 4))
    for row, col in itertools.product(range(nv), range(nu)):
        light, shade = np.zeros(3), 0.0
        for k in range(len(layers)):
            r, g, b, alpha = transfer([float(layers[k][row, col])])[0]
            alpha = 1 - (1 - alpha) ** (spacing / transfer.unit)
            color = np.array([r, g, b])
            if slopes is not None:
                z, y, x = k + 1, row + 1, col + 1
                du, dv, dn = slopes
                slope = np.array(
                    [
                        (padded[z, y, x + 1] - padded[z, y, x - 1]) / du,
                        (padded[z, y + 1, x] - padded[z, y - 1, x]) / dv,
                        (padded[z + 1, y, x] - padded[z - 1, y, x]) / dn,
                    ]
                )
                color = color * shine(slope, min(slopes))
            light += (1 - shade) * alpha * color
            shade += (1 - shade) * alpha
        out[row, col] = [*light, shade]
    return out


def trilinear(volume: Volume, point: np.ndarray) -> float:
    """The rule of the edge: clamped within half a voxel of the outermost centres, background beyond."""
    index = volume.grid.point_to_index(point)[::-1]
    if any(not -0.5 <= x < n - 0.5 for x, n in zip(index, volume.shape, strict=True)):
        return volume.background
    total = 0.0
    for bits in itertools.product((0, 1), repeat=3):
        weight, place = 1.0, []
        for at, n, bit in zip(index, volume.shape, bits, strict=True):
            x = min(max(at, 0.0), n - 1.0)
            first = min(math.floor(x), n - 1)
            part = x - first
            weight *= part if bit else 1 - part
            place.append(min(first + bit, n - 1))
        total += weight * float(volume.values[tuple(place)])
    return total
