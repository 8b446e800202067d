"""Voxelisation of a list of painted solids: the one renderer that all phantoms share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Progress
from deformnb.datasets.phantoms.shapes import Float32s, Solid, window
from deformnb.errors import DeformError
from deformnb.volume.volume import DTYPES, Grid, Volume

SolidValue = float | Callable[[Float32s, Float32s, Float32s], Float32s]

SLAB_VOXELS = 1_500_000
"""Voxels painted at a time: about 6 MB of float32, so that temporaries stay near the processor's cache."""

TISSUE = 60.0
"""Grey value from which voxels carry the full noise. Air stays exactly 0, so it compresses well, is the volume's
background and a warp that pulls in outside meets no visible border."""


@dataclass(frozen=True)
class Part:
    """A solid and its paint.

    Parameters
    ----------
    solid : the shape.
    layers : (depth, value) from the surface inwards: ``((0, 220), (2, 120))`` is a shell 2 thick of 220 round 120. A
        value may be a function of the coordinates. A depth below 0 paints outside of the surface.
    label : its number in the label volume; 0 leaves the label volume as it is, -1 clears it.
    """

    solid: Solid
    layers: tuple[tuple[float, SolidValue], ...]
    label: int = 0


@dataclass(frozen=True)
class PhantomScene:
    """Everything a phantom is: a box of ``lengths`` (x, y, z) mm and parts painted one over the other.

    ``texture`` is the relative strength of a slow, fixed ripple (muscle is not one grey), ``noise`` the standard
    deviation of the noise, and ``seed`` its seed.
    ``axes`` is where the voxel axes point: "LPS", or "RAS" as in most NIfTI files (the direction then turns x and y).
    """

    name: str
    lengths: Float3
    shape: tuple[int, int, int]
    parts: tuple[Part, ...]
    texture: float = 0.04
    seed: int = 1917
    noise: float = 3.0
    axes: str = "LPS"
    label_names: dict[int, str] = field(default_factory=dict)


def scene_grid(scene: PhantomScene, shape: tuple[int, int, int] | None) -> Grid:
    """The grid of ``shape`` that fills the scene's box, whose corner is at 0: anatomy is independent of it."""
    size = scene.shape if shape is None else tuple(int(n) for n in shape)
    if len(size) != 3 or min(size) < 1:
        raise DeformError(f"the shape of a phantom is (nz, ny, nx), each at least 1, got {shape!r}.")
    x, y, z = (length / n for length, n in zip(scene.lengths, size[::-1], strict=True))
    if scene.axes == "LPS":
        return Grid((size[0], size[1], size[2]), (x, y, z), (x / 2, y / 2, z / 2), unit="mm")
    origin = (scene.lengths[0] - x / 2, scene.lengths[1] - y / 2, z / 2)
    return Grid(
        (size[0], size[1], size[2]), (x, y, z), origin, ((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)), "mm"
    )


def render(
    scene: PhantomScene,
    shape: tuple[int, int, int] | None = None,
    *,
    dtype: str = "uint8",
    noise: float | None = None,
    progress: Progress | None = None,
) -> Volume:
    """Voxels of a scene.

    Parameters
    ----------
    scene : the scene to draw.
    shape : (nz, ny, nx), default the scene's own; the box in space is the same for every shape.
    dtype : voxel type; integers are rounded, floats are not. Values run from 0 (air) to 255.
    noise : standard deviation of the noise inside tissue, in grey values; default the scene's own.
    progress : called with 0..1 after each slab.
    """
    if dtype not in DTYPES or dtype in ("bool", "int8"):
        raise DeformError(f"a phantom has grey values 0 to 255, which {dtype!r} cannot hold; use 'uint8' or 'float32'.")
    noise = scene.noise if noise is None else noise
    if not (np.isfinite(noise) and noise >= 0):
        raise DeformError(f"noise is a standard deviation in grey values, 0 or more, got {noise!r}.")
    grid = scene_grid(scene, shape)
    values = np.empty(grid.shape, dtype=dtype)
    for slab, x, y, z in _slabs(grid):
        canvas = _paint(scene, grid, x, y, z)
        _roughen(canvas, scene, slab.start, (x, y, z), noise)
        values[slab] = np.clip(canvas if np.dtype(dtype).kind == "f" else np.rint(canvas), 0, 255)
        if progress is not None:
            progress(slab.stop / grid.shape[0])
    return Volume(values, grid, name=scene.name)


def render_labels(
    scene: PhantomScene, shape: tuple[int, int, int] | None = None, *, progress: Progress | None = None
) -> Volume:
    """Label volume of a scene on the same grid as :func:`render`: the part on top at each voxel's centre wins."""
    grid = scene_grid(scene, shape)
    values = np.zeros(grid.shape, dtype=np.uint16)
    for slab, x, y, z in _slabs(grid):
        for part in scene.parts:
            at = window(part.solid.box, 0.0, x, y, z) if part.label else None
            if at is not None:
                inside = part.solid.distance(x[..., at[2]], y[:, at[1]], z[at[0]]) <= 0
                values[slab][at][np.broadcast_to(inside, values[slab][at].shape)] = max(part.label, 0)
        if progress is not None:
            progress(slab.stop / grid.shape[0])
    return Volume(values, grid, name=f"{scene.name} labels", is_labels=True)


def _slabs(grid: Grid) -> list[tuple[slice, Float32s, Float32s, Float32s]]:
    nz, ny, nx = grid.shape
    # Coordinates of voxels along their own axes: solids are independent of the direction.
    x, y, z = (
        np.float32(s) * (np.arange(n, dtype=np.float32) + np.float32(0.5))
        for s, n in zip(grid.spacing, (nx, ny, nz), strict=True)
    )
    thick = max(1, SLAB_VOXELS // (ny * nx))
    cuts = [slice(k, min(k + thick, nz)) for k in range(0, nz, thick)]
    return [(cut, x[None, None, :], y[None, :, None], z[cut, None, None]) for cut in cuts]


def _paint(scene: PhantomScene, grid: Grid, x: Float32s, y: Float32s, z: Float32s) -> Float32s:
    # An edge is as wide as a mean voxel: sharper shows stairs, wider blurs fin rays away.
    edge = float(np.prod(grid.spacing)) ** (1 / 3)
    inverse = np.float32(1 / edge)
    canvas = np.zeros((z.size, y.size, x.size), dtype=np.float32)
    for part in scene.parts:
        at = window(part.solid.box, edge, x, y, z)
        if at is None:
            continue
        there = (x[..., at[2]], y[:, at[1]], z[at[0]])
        d, target = part.solid.distance(*there), canvas[at]
        for depth, value in part.layers:
            cover = np.clip(np.float32(0.5) - (d + np.float32(depth)) * inverse, 0, 1)
            paint = value(*there) if callable(value) else np.float32(value)
            target += cover * (paint - target)
    return canvas


def _roughen(
    canvas: Float32s, scene: PhantomScene, first: int, at: tuple[Float32s, Float32s, Float32s], noise: float
) -> None:
    x, y, z = (p * np.float32(2 * np.pi / max(scene.lengths)) for p in at)
    # Three plane waves with incommensurate directions: smooth, never periodic inside the box, and cheap.
    ripple = np.sin(31 * x + 17 * y) * np.sin(23 * z - 11 * y) + np.sin(41 * y - 29 * x + 7 * z)
    canvas *= 1 + np.float32(scene.texture / 2) * ripple
    if noise:
        for k in range(canvas.shape[0]):
            # One generator per slice, so that the voxels do not depend on how the volume was cut into slabs.
            grain: NDArray[np.float32] = np.random.default_rng((scene.seed, first + k)).standard_normal(
                canvas.shape[1:], dtype=np.float32
            )
            canvas[k] += grain * (np.float32(noise / TISSUE) * np.clip(canvas[k], 0, np.float32(TISSUE)))
