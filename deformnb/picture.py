"""Pictures of a volume: slice, maximum intensity projection (MIP), mean, composite, from any side.

The light goes along the normal of a plane, front to back. Seen along an axis of the volume a pixel is exactly a column
of voxels; an oblique view resamples the volume trilinearly onto a lattice that is parallel to the picture, block by
block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from numpy.typing import NDArray

from deformnb.compilation import compiled
from deformnb.errors import DeformError
from deformnb.fields import Identity
from deformnb.plane import Plane, Raster
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Grid, Volume
from deformnb.warp import warp

Progress = Callable[[float], None]

# Layers resampled at a time for an oblique view: 32 of 512 x 512 float32 are 32 MiB.
_LAYERS = 32
# Colours of a transfer function: 1024 steps keep the error of a ramp below half a grey level of 256.
_COLOURS = 1024


def _f32(*numbers: float) -> NDArray[np.float32]:
    return np.array(numbers, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture and where it lies.

    Parameters
    ----------
    values : (nv, nu) grey values, or (nv, nu, 4) float32 red, green, blue (times alpha) and alpha.
    plane, raster : where its pixels are in space.
    method : name of the projection.
    window : values shown as black and white.
    """

    values: NDArray[Any]
    plane: Plane
    raster: Raster
    method: str
    window: tuple[float, float]

    def grey(self) -> NDArray[np.float32]:
        """(nv, nu) in [0, 1], black to white of the window; luminance over black for a coloured picture."""
        v = np.asarray(self.values, dtype=np.float32)
        if v.ndim == 3:
            return np.clip(v[..., :3] @ _f32(0.2126, 0.7152, 0.0722), 0, 1)
        low, high = self.window
        return np.clip((v - np.float32(low)) / np.float32(high - low), 0, 1)

    def rgb8(self, background: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> NDArray[np.uint8]:
        """(nv, nu, 3) uint8 over a background colour."""
        if self.values.ndim == 3:
            color = self.values[..., :3] + (1 - self.values[..., 3:]) * _f32(*background)
        else:
            color = np.repeat(self.grey()[..., None], 3, axis=2)
        return (np.clip(color, 0, 1) * 255 + 0.5).astype(np.uint8)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(a_min, a_max, b_max, b_min): matplotlib's ``imshow(..., extent=..., origin="upper")``."""
        a0, a1, b0, b1 = self.raster.box
        return (a0, a1, b1, b0)


@dataclass(frozen=True)
class Projection:
    """One way to make a picture of layers, front to back.

    Parameters
    ----------
    name, title : in code and in menus.
    start : (first layers, settings) -> state; add : (state, layers, settings) -> state; finish : state -> values.
    whole : (array, axis) -> values, a faster way for all layers at once; or None.
    """

    name: str
    title: str
    add: Callable[[Any, NDArray[Any], dict[str, Any]], Any]
    finish: Callable[[Any], NDArray[Any]]
    whole: Callable[[NDArray[Any], int], NDArray[Any]] | None = None


def _add_max(state: Any, layers: NDArray[Any], settings: dict[str, Any]) -> Any:
    largest = layers.max(axis=0)
    return largest if state is None else np.maximum(state, largest)


def _add_sum(state: Any, layers: NDArray[Any], settings: dict[str, Any]) -> Any:
    total = layers.sum(axis=0, dtype=np.float64)
    return (total, len(layers)) if state is None else (state[0] + total, state[1] + len(layers))


def _finish_mean(state: Any) -> NDArray[Any]:
    return np.asarray(state[0] / state[1], dtype=np.float32)


def _whole_mean(values: NDArray[Any], axis: int) -> NDArray[Any]:
    return values.mean(axis=axis, dtype=np.float32 if values.dtype.kind != "f" else values.dtype).astype(np.float32)


def _add_light(state: Any, layers: NDArray[Any], settings: dict[str, Any]) -> Any:
    if state is None:
        state = np.zeros((*layers.shape[1:], 4), np.float32)
    return _composite(state, np.ascontiguousarray(layers), settings["table"], settings["range"], settings["spacing"],
                      settings["light"], shaded=settings["shaded"])


PROJECTIONS: dict[str, Projection] = {
    p.name: p
    for p in (
        Projection("mip", "Maximum (MIP)", _add_max, np.asarray, lambda v, axis: v.max(axis=axis)),
        Projection("slice", "Slice", lambda state, layers, _: layers[0], np.asarray),
        Projection("mean", "Mean", _add_sum, _finish_mean, _whole_mean),
        Projection("composite", "Composite", _add_light, np.asarray),
        Projection("shaded", "Shaded composite", _add_light, np.asarray),
    )
}
"""All projections by name; the first is the default."""


def project(volume: Volume, view: str | Plane = "+y", method: str = "mip", *, transfer: TransferFunction | None = None,
            depth: float | None = None, spacing: float | None = None, progress: Progress | None = None) -> Picture:
    """A picture of a volume.

    Parameters
    ----------
    volume : what to look at; voxels that are not finite count as background.
    view : one of :data:`~deformnb.plane.VIEWS`, or any plane: its u points right, its v down, its normal away.
    method : a name of :data:`PROJECTIONS`.
    transfer : colours and opacities of "composite" and "shaded"; default is the preset "specimen".
    depth : place of a "slice" along the normal, from the plane; default is the plane itself (the middle of the volume
        for a view by name).
    spacing : pixel size of an oblique view; default is the smallest voxel size.
    progress : called with the finished share from 0 to 1.

    Raises
    ------
    DeformError
        For an unknown method, a slice outside the volume, or a plane that is not one.

    Examples
    --------
    >>> volume = Volume(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), Grid((2, 3, 4)))
    >>> project(volume, "+z").values.tolist()
    [[12, 13, 14, 15], [16, 17, 18, 19], [20, 21, 22, 23]]
    """
    if method not in PROJECTIONS:
        raise DeformError(f"unknown projection {method!r}; choose one of {', '.join(PROJECTIONS)}.")
    plane = Plane.along(volume.grid, view) if isinstance(view, str) else view
    order = _voxel_order(volume.grid, plane)
    make = _project_voxels if order is not None and spacing is None else _project_lattice
    settings = _settings(volume, transfer, method)
    picture = make(volume, plane, PROJECTIONS[method], settings, depth, spacing, progress)
    if progress is not None:
        progress(1.0)
    return picture if picture.values.ndim == 3 else replace(picture, window=_window(picture.values, volume))


def _window(values: NDArray[Any], volume: Volume) -> tuple[float, float]:
    """Black is the background; white is what only 1 in 300 pixels of the subject exceeds.

    So one dense spot (a filling, a clip) does not darken the rest.
    """
    low = volume.background
    subject = values[values > low]
    high = float(np.quantile(subject, 1 - 1 / 300)) if subject.size else low
    # One grey level of the type, or one step of a float, where everything is alike: never a window without width.
    return low, high if high > low else low + max(1.0, abs(low)) * (1.0 if values.dtype.kind != "f" else 1e-6)


def _settings(volume: Volume, transfer: TransferFunction | None, method: str) -> dict[str, Any]:
    settings: dict[str, Any] = {"shaded": method == "shaded"}
    if method in ("composite", "shaded"):
        settings["transfer"] = preset("specimen", volume) if transfer is None else transfer
        first, last = volume.value_range
        settings["range"] = _f32(first, last if last > first else first + 1)
    return settings


def _with_steps(settings: dict[str, Any], du: float, dv: float, dn: float) -> dict[str, Any]:
    if "transfer" not in settings:
        return settings
    table = settings["transfer"].table(*settings["range"], dn, _COLOURS)
    # A lamp above the viewer's left shoulder: pure headlight looks flat, light from far aside leaves half in the dark.
    light = _f32(-0.35, -0.45, -0.82)
    return {**settings, "table": table, "spacing": _f32(dn, dv, du), "light": light / np.linalg.norm(light)}


def _voxel_order(grid: Grid, plane: Plane) -> list[tuple[int, int]] | None:
    """Array axis and sign of depth, v and u if the plane lies along the voxel axes, else None."""
    cosines = plane.frame[[2, 1, 0]] @ np.asarray(grid.direction)
    best = np.abs(cosines).argmax(axis=1)
    if sorted(best) != [0, 1, 2] or not np.allclose(np.abs(cosines[[0, 1, 2], best]), 1, atol=1e-9):
        return None
    return [(2 - int(k), 1 if cosines[row, k] > 0 else -1) for row, k in enumerate(best)]


def _project_voxels(volume: Volume, plane: Plane, how: Projection, settings: dict[str, Any], depth: float | None,
                    spacing: float | None, progress: Progress | None) -> Picture:
    order = _voxel_order(volume.grid, plane)
    assert order is not None
    turned = volume.finite_values.transpose([axis for axis, _ in order])
    turned = turned[tuple(slice(None, None, sign) for _, sign in order)]  # [depth, v, u], a view
    dn, dv, du = (volume.grid.spacing[2 - axis] for axis, _ in order)
    corner = plane.to_plane(volume.grid.corners(centres=True)).min(axis=0)
    raster = Raster((turned.shape[1], turned.shape[2]), (du, dv), (float(corner[0]), float(corner[1])))
    if how.name == "slice":
        index = round(((depth or 0.0) - float(corner[2])) / dn)
        _check_depth(index, len(turned))
        values = turned[index]
    elif how.whole is not None:
        values = how.whole(turned, 0)
    else:
        blocks = (turned[k : k + _LAYERS] for k in range(0, len(turned), _LAYERS))
        values = _accumulate(how, blocks, _with_steps(settings, du, dv, dn), len(turned), progress)
    return Picture(np.ascontiguousarray(values), plane, raster, how.name, (0.0, 1.0))


def _check_depth(index: int, count: int) -> None:
    if not 0 <= index < count:
        raise DeformError(f"the slice would be number {index} of {count}: outside the volume. Choose another depth.")


def _accumulate(how: Projection, blocks: Iterator[NDArray[Any]], settings: dict[str, Any], layers: int,
                progress: Progress | None) -> NDArray[Any]:
    state, done = None, 0
    for block in blocks:
        state = how.add(state, block, settings)
        done += len(block)
        if progress is not None:
            progress(min(1.0, done / layers))
    return how.finish(state)


def _project_lattice(volume: Volume, plane: Plane, how: Projection, settings: dict[str, Any], depth: float | None,
                     spacing: float | None, progress: Progress | None) -> Picture:
    """An oblique view, through a lattice parallel to the picture."""
    lattice = plane_lattice(volume.grid, plane, spacing)
    d = lattice.spacing[0]
    low = plane.to_plane(lattice.origin)
    raster = Raster(lattice.shape[1:], (d, d), (float(low[0]), float(low[1])))
    if how.name == "slice":
        at = plane.from_plane([low[0], low[1], depth or 0.0])
        near, far = plane.depth_range(volume.grid)
        if not near - d <= (depth or 0.0) <= far + d:
            raise DeformError(f"the slice at depth {depth or 0.0:g} is outside the volume ({near:g} to {far:g}).")
        one = replace(lattice, shape=(1, *lattice.shape[1:]), origin=tuple(at))
        values = warp(volume, Identity(3), output=one).values[0]
    else:
        values = _accumulate(how, _resampled_blocks(volume, lattice), _with_steps(settings, d, d, d),
                             lattice.shape[0], progress)
    return Picture(np.ascontiguousarray(values), plane, raster, how.name, (0.0, 1.0))


def plane_lattice(grid: Grid, plane: Plane, spacing: float | None = None) -> Grid:
    """A grid with axes u, v, n of a plane that covers ``grid``, with voxels of one size (default: its smallest)."""
    d = min(grid.spacing) if spacing is None else float(spacing)
    if not (np.isfinite(d) and d > 0):
        raise DeformError(f"the pixel size must be a positive length, got {spacing}.")
    corners = plane.to_plane(grid.corners())
    low, high = corners.min(axis=0), corners.max(axis=0)
    count = np.maximum(1, np.ceil((high - low) / d - 1e-9)).astype(int)
    first = (low + high) / 2 - d * (count - 1) / 2
    # The layers of a picture are counted in whole blocks, so that one compiled function resamples all of them.
    layers = -(-int(count[2]) // _LAYERS) * _LAYERS
    first[2] -= d * (layers - int(count[2])) / 2
    shape = (layers, int(count[1]), int(count[0]))
    axes = tuple(map(tuple, plane.frame.T))
    return Grid(shape, (d, d, d), tuple(plane.from_plane(first)), axes)  # type: ignore[arg-type]


def _resampled_blocks(volume: Volume, lattice: Grid) -> Iterator[NDArray[Any]]:
    for k in range(0, lattice.shape[0], _LAYERS):
        block = lattice.crop((k, 0, 0), (_LAYERS, *lattice.shape[1:]))
        yield warp(volume, Identity(3), output=block).values


def _light_layers(state: Any, layers: Any, table: Any, limits: Any, spacing: Any, light: Any, *,
                  shaded: bool) -> Any:
    """Front to back: C += (1 - A) alpha c, A += (1 - A) alpha, over layers [n, v, u] of values."""
    scale = (table.shape[0] - 1) / (limits[1] - limits[0])

    def add(total: Any, k: Any) -> tuple[Any, None]:
        here = layers[k].astype(jnp.float32)
        rgba = table[jnp.clip((here - limits[0]) * scale + 0.5, 0, table.shape[0] - 1).astype(jnp.int32)]
        color = rgba[..., :3] * _shade(layers, k, spacing, light, limits)[..., None] if shaded else rgba[..., :3]
        share = (1 - total[..., 3:]) * rgba[..., 3:]
        return total + share * jnp.concatenate([color, jnp.ones_like(color[..., :1])], axis=-1), None

    return lax.scan(add, state, jnp.arange(layers.shape[0]))[0]


def _shade(layers: Any, k: Any, spacing: Any, light: Any, limits: Any) -> Any:
    """Brightness by Blinn and Phong, lit from both sides; 1 where the gradient says nothing."""
    last = layers.shape[0] - 1
    first, second = jnp.maximum(k - 1, 0), jnp.minimum(k + 1, last)  # one-sided at the ends of a block
    before, after = (layers[q].astype(jnp.float32) * 2 / jnp.maximum(second - first, 1) for q in (first, second))
    here = jnp.pad(layers[k].astype(jnp.float32), 1, mode="edge")
    g = jnp.stack([(after - before) / spacing[0], (here[2:, 1:-1] - here[:-2, 1:-1]) / spacing[1],
                   (here[1:-1, 2:] - here[1:-1, :-2]) / spacing[2]], axis=-1)
    size = jnp.sqrt(jnp.sum(g * g, axis=-1))
    lamp = jnp.stack([light[2], light[1], light[0]])
    half = lamp + jnp.array([-1.0, 0.0, 0.0])
    half = half / jnp.sqrt(jnp.sum(half * half))
    n = g / jnp.maximum(size, 1e-6)[..., None]
    lit = 0.35 + 0.75 * jnp.abs(n @ lamp) + 0.35 * jnp.abs(n @ half) ** 24
    # An even region has no surface: fade to plain colour where the slope is below a hundredth of the range per voxel.
    sure = jnp.clip(size * jnp.min(spacing) / (0.02 * (limits[1] - limits[0])), 0, 1)
    return sure * lit + (1 - sure) * 0.8


_composite = compiled(_light_layers, static_argnames="shaded")
