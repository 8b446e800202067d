"""Planning of a warp: checks of options, the input place of each output voxel, the kernel, and the blocks of work.

There are three kernels to choose from. All of this is small (tables along axes, maps of one picture) and is computed on
the host in float64; displacements stay on a GPU that computes them.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._jax import jnp
from deformnb._threads import can_start_threads
from deformnb._typing import Progress
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, DisplacementField, grid_lines, raster_lines
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.sampling import METHODS, NEAR, SamplingName
from deformnb.volume.volume import Grid

_Part = TypeVar("_Part")

BlockSlices: TypeAlias = tuple[slice, slice]
"""Planes and rows of an output."""

# Fractions of a voxel that float32 cannot distinguish from a whole number; geometry computed in two ways differs by
# 1e-13.
_WHOLE = 1e-7

# Direction cosines from files are rounded to float32 (1e-7). Axes this close count as parallel: over 1000 voxels the
# map is sampled at most 1e-3 voxels off.
_PARALLEL = 1e-6

# What that amounts to over a whole volume, in voxels.
_SKEW = 1e-3

# Far outside any volume, and small enough to add up without leaving int32.
_FAR = 2**29

BLOCK_VOXELS = 2**20
"""Output voxels computed at once: 16 parts of a volume of 256^3. Their displacements take 12 MiB, which stays in the
cache; memory above 32 MiB would be given back to the system after every part, which costs as much as the warp."""

_MORE_BETWEEN_NODES = 4
"""Factor of the voxels computed at once between nodes that many voxels apart: blocks of 64 planes of 256^3
voxels evaluate 68 planes of nodes in all, those of 16 planes 80. A warp takes 0.8 times as long."""

_MORE_ON_GPU = 32
"""Factor of the work of a GPU at once: its memory holds it, and each call has to be launched and waited for."""


NOT_FINITE = (
    "the field is not finite everywhere (or beyond all sizes); look for control points far away or nearly "
    "on top of each other."
)


def check_method(method: SamplingName | None, *, discrete: bool) -> SamplingName:
    """The method, or its default; refused where it would make up labels."""
    if method is None:
        return "nearest" if discrete else "linear"
    if not isinstance(method, str) or method not in METHODS:
        raise DeformError(f"unknown method {short_value(method)}; choose one of {', '.join(METHODS)}.")
    if discrete and METHODS[method].blends:
        raise DeformError(f"method {method!r} would invent values between labels; leave it at 'nearest'.")
    return method


def as_voxel(value: float, dtype: np.dtype[Any]) -> Any:
    """The fill value in the voxel type, refused where the type does not hold it; bool as uint8."""
    try:
        with np.errstate(all="ignore"):
            voxel = np.asarray(value)
            voxel = voxel.astype(dtype, casting="same_kind" if voxel.dtype.kind == "c" else "unsafe")
            same = voxel.shape == () and (voxel.item() == value or (dtype.kind == "f" and not np.isinf(voxel)))
    except (TypeError, ValueError, OverflowError):
        same = False
    if not same:
        raise DeformError(f"fill must be one value that {dtype} voxels can hold, got {short_value(value)}.")
    return voxel.view(np.uint8)[()] if dtype == np.bool_ else voxel[()]


@dataclass(frozen=True)
class Places:
    """Places of the output voxels in the input, in voxels, before any displacement.

    The place of output voxel (k, j, i) along input axis a (both in the order z, y, x) is
    ``sum over o of whole[o][a, index o] + part[o][a, index o]``.

    whole, part : one table (axes, n) per output axis; integers, and fractions in [0, 1).
    matrix : from a displacement to input voxels.
    """

    whole: tuple[NDArray[np.int32], ...]
    part: tuple[NDArray[np.floating[Any]], ...]
    matrix: NDArray[np.floating[Any]]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels of the output in space along each axis."""
        z, y, x = (table.shape[1] for table in self.whole)
        return z, y, x

    def block(self, slices: Sequence[slice]) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """``whole`` and ``part`` of a block; axes without a slice are whole, slices may end beyond the last voxel."""
        every = (*slices, *[slice(None)] * (len(self.whole) - len(slices)))
        whole = tuple(_cut_table(table, s) for table, s in zip(self.whole, every, strict=True))
        return whole, tuple(_cut_table(table, s) for table, s in zip(self.part, every, strict=True))

    def is_near(self, shape: Sequence[int]) -> bool:
        """Check whether all places, and an input of this shape, are within :data:`NEAR` voxels of the first one."""
        farthest = sum(np.abs(table).max(axis=1, initial=0).astype(np.int64) for table in self.whole)
        return bool(max(*shape, np.max(farthest)) < NEAR - len(self.whole))

    @cached_property
    def is_straight(self) -> bool:
        """True where each input axis depends on the output axis and the displacement of its own name only."""
        others = self.matrix[:, ::-1][~np.eye(len(self.matrix), dtype=np.bool_)]
        return _is_parallel(self) and not others.any()

    def with_slices(self) -> Places:
        """Places of pixels as those of a volume of one slice."""
        none = tuple(np.zeros((3, 1), tables[0].dtype) for tables in (self.whole, self.part))
        whole, part = (
            (zero, *(np.concatenate([zero[:1].repeat(table.shape[1], 1), table]) for table in tables))
            for zero, tables in zip(none, (self.whole, self.part), strict=True)
        )
        matrix = np.zeros((3, 3), self.matrix.dtype)
        matrix[1:, :2] = self.matrix
        return Places(whole, part, matrix)


def _cut_table(table: NDArray[Any], part: slice) -> NDArray[Any]:
    """A part of a table along its last axis; beyond the end it repeats the last entry."""
    if part.stop is None or part.stop <= table.shape[1]:
        return table[:, part]
    return np.take(table, np.arange(part.start, part.stop), axis=1, mode="clip")


def _tables(
    steps: NDArray[np.float64], start: NDArray[np.float64], shape: tuple[int, ...], compute: str
) -> tuple[tuple[NDArray[np.int32], ...], tuple[NDArray[Any], ...]]:
    """Split ``start + sum_o steps[:, o] * index_o`` into integers and fractions, axis by axis of the output."""
    whole, part = [], []
    for o, n in enumerate(shape):
        place = steps[:, o, None] * np.arange(n, dtype=np.float64)
        place[o] += start[o]  # to its own axis: where a kernel leaves an axis out, nothing that others need is lost
        place = np.where(np.abs(place - np.round(place)) < _WHOLE, np.round(place), place)
        floor = np.floor(place)
        whole.append(np.clip(floor, -_FAR, _FAR).astype(np.int32))
        part.append((place - floor).astype(compute))
    return tuple(whole), tuple(part)


def places(source: Grid, output: Grid, compute: str) -> Places:
    """Places of the voxels of ``output`` in ``source``; ``compute`` is the type of the fractions."""
    inverse = source.inverse[::-1]
    steps = (inverse @ output.matrix)[:, ::-1]
    start = source.point_to_index(np.asarray(output.origin))[::-1]
    whole, part = _tables(steps, start, output.shape, compute)
    return Places(whole, part, inverse.astype(compute))


def picture_places(source: Raster, output: Raster, compute: str) -> Places:
    """Places (row, column) of the pixels of ``output`` in ``source``."""
    sizes = np.array(source.spacing[::-1])
    steps = np.diag(np.array(output.spacing[::-1]) / sizes)
    start = (np.array(output.origin[::-1]) - np.array(source.origin[::-1])) / sizes
    whole, part = _tables(steps, start, output.shape, compute)
    return Places(whole, part, np.array([[0, 1 / sizes[0]], [1 / sizes[1], 0]], dtype=compute))


@dataclass(frozen=True)
class Extruded:
    """An extruded field on an output grid that shares the axis of extrusion with the input, voxel by voxel.

    normal : the array axis (0, 1, 2 for z, y, x) along the plane's normal.
    maps : K maps (2, rows, columns), float32, on the GPU that has computed them or of NumPy; rows and columns are the
        two other array axes in order.
    weights : (K, n) along ``normal``; None if one map holds everywhere.
    matrix : 3 x 2, from displacement along (u, v) to input voxels (z, y, x).
    opacity : (rows, columns) of what cuts leave; None if there are none.
    """

    normal: int
    maps: NDArray[np.float32]
    weights: NDArray[np.float32] | None
    matrix: NDArray[np.floating[Any]]
    opacity: NDArray[np.float32] | None = None


def shared_axis(plane: Plane, source: Grid, output: Grid) -> int | None:
    """The array axis along the plane's normal, if input and output have the same voxels along it; else None."""
    directions = np.asarray(output.direction)
    cosines = np.abs(directions.T @ plane.frame.T)  # [axis x y z, u v n]
    if np.abs(np.sort(cosines, axis=0)[:2]).max() > _PARALLEL:
        return None
    axis = int(np.argmax(cosines[:, 2]))
    steps = source.inverse @ output.matrix
    start = source.point_to_index(np.asarray(output.origin))[axis]
    n_source, n_output = source.shape[2 - axis], output.shape[2 - axis]
    unit = np.eye(3)[axis]
    skew = max(np.abs(steps[axis] - unit).max() * max(output.shape), np.abs(steps[:, axis] - unit).max() * n_output)
    same = skew < _SKEW and abs(start - round(start)) < _WHOLE
    return 2 - axis if same and 0 <= round(start) <= n_source - n_output else None


def plan_extrusion(field: AbstractField, source: Grid, output: Grid, compute: str) -> Extruded | None:
    """Plan the short cut for ``field``, or None where only the general kernel is right."""
    if isinstance(field, Decoupled):
        return _plan_replicated_cut(field, source, output, compute)
    if not isinstance(field, Extrusion):
        return None
    normal = shared_axis(field.plane, source, output)
    if normal is None:
        return None
    with devices.device_context():
        found = [_sample_plane(m, field.plane, output, normal)[0] for m in field.maps]
        maps: Any = np.stack(found) if devices.is_host() else jnp.stack(found)
    n = np.arange(output.shape[normal])
    index = np.zeros((len(n), 3))
    index[:, 2 - normal] = n
    weights = np.asarray(field.weights_at(field.plane.to_plane(output.index_to_point(index))[:, 2]), dtype=np.float64)
    check_finite(weights)
    kept: NDArray[np.float32] | None = None
    if field.is_replication:
        if len(maps) > 1 or weights[0, 0] != 1:
            maps = np.einsum("k,k...->...", weights[:, 0], maps, dtype=np.float64)[None].astype(np.float32)
    else:
        kept = weights.astype(np.float32)
    return Extruded(normal, maps, kept, to_voxels(field.plane, source, compute))


def _plan_replicated_cut(field: Decoupled, source: Grid, output: Grid, compute: str) -> Extruded | None:
    """Equal cuts on every slice: the choice among the regions is made once, on the picture's plane."""
    plane = field.plane
    if plane is None or not all(isinstance(f, Extrusion) and f.plane == plane and f.is_plain for f in field.fields):
        return None
    normal = shared_axis(plane, source, output)
    if normal is None:
        return None
    flat = replace(field, fields=tuple(f.maps[0] for f in field.fields), plane=None)  # type: ignore[attr-defined]
    map_, opacity = _sample_plane(flat, plane, output, normal)
    return Extruded(normal, map_[None], None, to_voxels(plane, source, compute), opacity)


def to_voxels(plane: Plane, source: Grid, compute: str) -> NDArray[np.floating[Any]]:
    """3 x 2, from displacement along (u, v) to input voxels (z, y, x)."""
    return (source.inverse @ plane_vectors(plane))[::-1].astype(compute)


def plane_vectors(plane: Plane) -> NDArray[np.float64]:
    """The vectors u and v as columns, 3 x 2."""
    return plane.frame[:2].T


def _sample_plane(
    field: AbstractField, plane: Plane, output: Grid, normal: int
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """A 2-D field at the voxel centres of one plane of the grid: (2, rows, columns) in the order of array axes.

    The opacity (rows, columns) comes along; None if there are no cuts.
    """
    axes = [axis for axis in range(3) if axis != normal]
    cosines = np.asarray(output.direction).T @ plane.frame.T
    along_u = max(axes, key=lambda axis: abs(cosines[2 - axis, 0]))
    along_v = axes[0] if along_u == axes[1] else axes[1]
    start = plane.to_plane(output.origin)
    first, flip = [], []
    for axis, k in ((along_u, 0), (along_v, 1)):
        reverse = cosines[2 - axis, k] < 0
        flip.append(-1 if reverse else 1)
        first.append(start[k] - (output.shape[axis] - 1) * output.spacing[2 - axis] * reverse)
    raster = Raster(
        (output.shape[along_v], output.shape[along_u]),
        (output.spacing[2 - along_u], output.spacing[2 - along_v]),
        (first[0], first[1]),
    )
    values, opacity = raster_with_opacity(field, raster)
    turned = [a if a is None else a[..., :: flip[1], :: flip[0]] for a in (values, opacity)]
    if along_v > along_u:
        turned = [a if a is None else a.swapaxes(-1, -2) for a in turned]
    return turned[0], turned[1]  # type: ignore[return-value]


def lattice(grid: Grid, block: tuple[slice, slice], step: int) -> Grid:
    """The lattice of the field for a block: its voxels if ``step`` is 1, else every ``step``-th along each axis."""
    (z, y), extra = block, int(step > 1)
    nz, ny, nx = (ceil(n / step) + extra for n in (z.stop - z.start, y.stop - y.start, grid.shape[2]))
    sx, sy, sz = (step * s for s in grid.spacing)
    ox, oy, oz = grid.index_to_point([0, y.start, z.start])
    return replace(grid, shape=(nz, ny, nx), spacing=(sx, sy, sz), origin=(ox, oy, oz))


Tables = tuple[tuple[NDArray[np.int32], NDArray[np.float32]], ...]
"""Along z, y, x: the first node that each voxel reads (n,), and the weights (T, n) of T nodes from there."""


def step_tables(lengths: Sequence[int], step: int) -> Tables:
    """Tables of a block of voxels, [z, y, x], of which every ``step``-th is a node."""
    tables = []
    for length in lengths:
        low, rest = np.divmod(np.arange(length), step)
        t = (rest / step).astype(np.float32)
        tables.append((low.astype(np.int32), np.stack([1 - t, t])))
    return tuple(tables)


def interpolation_tables(field: AbstractField, grid: Grid) -> tuple[tuple[Any, ...], Tables] | None:
    """A field stored on a coarser grid with parallel axes; None if it is no such field.

    Returns
    -------
    displacements along x, y, z at the nodes (z, y, x) around the voxels, and the nodes next to each voxel. The warp's
    loops interpolate between these plane by plane, in the cache: displacements of all voxels would take twelve bytes
    for each. Blocks of one shape have equally many nodes.
    """
    if not (isinstance(field, DisplacementField) and isinstance(field.lattice, Grid)):
        return None
    at = places(field.lattice, grid, "float64")
    if not _is_parallel(at):
        return None
    parts, tables = [], []
    for axis, (n, count) in enumerate(zip(grid.shape, field.lattice.shape, strict=True)):
        low, t = _cells(at, axis, count)
        apart = abs(field.lattice.spacing[2 - axis])
        most = min(count, int((n - 1) * grid.spacing[2 - axis] / apart + _WHOLE) + 3)
        if count < 2 or (axis < 2 and most >= n):
            return None
        first = min(int(low.min()), count - most)
        parts.append(slice(first, first + most))
        tables.append(((low - first).astype(np.int32), np.stack([1 - t, t]).astype(np.float32)))
    some = np.moveaxis(np.asarray(field.values[tuple(parts)], dtype=np.float32), -1, 0)
    return tuple(np.ascontiguousarray(some)), tuple(tables)


def _is_parallel(at: Places) -> bool:
    """Check whether each output axis runs along the input axis of its number."""
    axes = range(len(at.whole))
    return not any(at.whole[o][axis].any() or at.part[o][axis].any() for axis in axes for o in axes if o != axis)


def _cells(at: Places, axis: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Along an axis of ``count`` samples: the sample before each place, with one after it, and the place in between."""
    low, rest = _nodes_below(at, axis, count)
    before = np.minimum(low, max(count - 2, 0))
    return before, rest + (low - before)


def displacements(field: AbstractField, grid: Grid) -> Any:
    """The field on a lattice: components x, y, z as three arrays (z, y, x); their reader checks that they
    are finite.
    """
    if isinstance(field, DisplacementField) and isinstance(field.lattice, Grid):
        d = _resample(np.asarray(field.values), places(field.lattice, grid, "float64"))
        if d is not None:
            return tuple(np.moveaxis(np.asarray(d, np.float32), -1, 0))
    with devices.device_context():  # else JAX would move operations on the result to the device that it prefers
        stays = _device_components(field, grid)
        return tuple(np.asarray(field.components_on_grid(grid), np.float32)) if stays is None else stays


def samples_at_voxels(field: AbstractField, grid: Grid) -> tuple[NDArray[np.float32], ...] | None:
    """Components [z, y, x] of a stored field, as views of its samples; None unless each voxel of the grid is one."""
    if not (isinstance(field, DisplacementField) and isinstance(field.lattice, Grid)):
        return None
    values = np.asarray(field.values)
    at = places(field.lattice, grid, "float64")
    if values.dtype != np.float32 or not _is_parallel(at):
        return None
    parts = [_consecutive(*_nodes_below(at, axis, n)) for axis, n in enumerate(field.lattice.shape)]
    if None in parts:
        return None
    return tuple(np.moveaxis(values[tuple(part for part in parts if part)], -1, 0))


def _device_components(field: AbstractField, on: Grid | Raster) -> tuple[Any, ...] | None:
    """Components of the displacements that stay on the device that computes them; None where NumPy shares its memory,
    or the field is computed by NumPy. Refused as by :func:`check_finite`.

    To be called within :func:`deformnb.devices.device_context`.
    """
    if devices.is_host() or not isinstance(field, RBFInterpolant):
        return None
    d, is_finite = field.evaluate_on_device(on)
    if not is_finite:
        raise DeformError(NOT_FINITE)
    return d


def displacements_and_opacity(field: AbstractField, grid: Grid) -> tuple[Any, NDArray[np.float32] | None]:
    """:func:`displacements` of a field on a lattice, and its opacity [z, y, x] if it has cuts."""
    if not field.has_cuts:
        return displacements(field, grid), None
    d, opacity = field.lattice_values_and_opacity(*grid_lines(grid), min(grid.spacing))
    d = np.asarray(d, np.float32).reshape(3, *grid.shape)
    return tuple(d), None if opacity is None else opacity.reshape(grid.shape)


def raster_with_opacity(field: AbstractField, raster: Raster) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """A field on a raster, (2, nv, nu), and its opacity (nv, nu); None if it has no cuts."""
    if isinstance(field, DisplacementField) and isinstance(field.lattice, Raster):
        d = _resample(np.asarray(field.values), picture_places(field.lattice, raster, "float64"))
        if d is not None:
            return check_finite(np.moveaxis(d, -1, 0)), None
    with devices.device_context():
        stays = _device_components(field, raster)
        if stays is not None:
            return jnp.stack(stays), None  # type: ignore[return-value]
    values, opacity = field.lattice_values_and_opacity(*raster_lines(raster), min(raster.spacing))
    return check_finite(values), opacity


def _nodes_below(at: Places, axis: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Along an axis of ``count`` samples: the sample at or before each place, and the place between it and the next."""
    place = np.clip(at.whole[axis][axis] + at.part[axis][axis].astype(np.float64), 0, count - 1)
    low = place.astype(np.int64)
    return low, place - low


def _consecutive(low: NDArray[np.int64], rest: NDArray[np.float64]) -> slice | None:
    """Samples one after the other; None where a place lies between two, or samples are left out."""
    return slice(int(low[0]), int(low[-1]) + 1) if not rest.any() and (np.diff(low) == 1).all() else None


def _resample(samples: NDArray[Any], at: Places) -> NDArray[Any] | None:
    """Stored samples read linearly, one axis after the other; None if the axes are not parallel.

    Where the places are samples themselves this is a view, so a field stored on the output's grid costs nothing. No
    products of matrices: the threads of BLAS wait for each other, on a loaded machine longer than they compute.
    """
    if not _is_parallel(at):
        return None
    samples = samples.astype(np.result_type(samples, np.float32), copy=False)  # whole numbers lie between none
    for axis in reversed(range(samples.ndim - 1)):  # the longest array comes last
        n = samples.shape[axis]
        low, rest = _nodes_below(at, axis, n)
        run = _consecutive(low, rest)
        if run is not None:
            samples = samples[(slice(None),) * axis + (run,)]
            continue
        t = rest.astype(samples.dtype).reshape([-1 if k == axis else 1 for k in range(samples.ndim)])
        samples = (1 - t) * samples.take(low, axis) + t * samples.take(np.minimum(low + 1, n - 1), axis)
    return samples


def check_finite(values: Any) -> NDArray[np.float32]:
    """Displacements, refused if any is not finite. One dot product finds that six times faster than ``np.isfinite``."""
    array = np.ascontiguousarray(values, dtype=np.float32)
    if not np.isfinite(np.vdot(array, array)):
        raise DeformError(NOT_FINITE)
    return array


def blocks(shape: tuple[int, int, int], step: int) -> list[tuple[slice, slice]]:
    """Parts of the output along z and y, all of one size so that one compilation serves all.

    The last part along an axis overlaps the one before, or ends up to ``step`` - 1 beyond the array, so that every part
    starts on a node of the lattice.
    """
    nz, ny, nx = shape
    most = batch_size(BLOCK_VOXELS)
    if step > 1:  # nodes take less memory than voxels, and each block has its own at the end
        most = max(most, min(most * min(step, _MORE_BETWEEN_NODES), nz * ny * nx // processors()))
    rows = _length(ny, most // nx, step)
    planes = _length(nz, most // (nx * rows), step)
    starts = ((z, y) for z in _starts(nz, planes, step) for y in _starts(ny, rows, step))
    return [(slice(z, z + planes), slice(y, y + rows)) for z, y in starts]


def batch_size(most: int) -> int:
    """Amount to compute in one call on the device in use, where a processor computes ``most``."""
    return most if devices.is_host() else _MORE_ON_GPU * most


def square_blocks(shape: tuple[int, int, int]) -> list[tuple[slice, slice]]:
    """:func:`blocks` that are about as long along z as along y: they read few nodes beyond their rims."""
    nz, ny, nx = shape
    side = max(1, round((BLOCK_VOXELS / nx) ** 0.5))
    rows = _length(ny, max(side, BLOCK_VOXELS // (nx * nz)), 1)
    planes = _length(nz, max(1, BLOCK_VOXELS // (nx * rows)), 1)
    return [(slice(z, z + planes), slice(y, y + rows)) for z in _starts(nz, planes, 1) for y in _starts(ny, rows, 1)]


def parts(count: int, most: int) -> list[slice]:
    """Parts of ``count`` slices, at most ``most`` (or one) at a time, all of one length; the last one overlaps."""
    length = _length(count, most, 1)
    return [slice(start, start + length) for start in _starts(count, length, 1)]


def _length(n: int, most: int, step: int) -> int:
    """About the largest length up to ``most`` that divides n evenly, in whole steps."""
    return ceil(ceil(n / ceil(n / max(1, most))) / step) * step


def _starts(n: int, length: int, step: int) -> list[int]:
    last = max(0, ceil((n - length) / step) * step)
    return sorted({min(start, last) for start in range(0, n, length)})


def run_parts(parts: Sequence[_Part], work: Callable[[_Part], None], progress: Progress | None) -> None:
    """Run the work for all parts, on as many threads as this process may use."""
    threads = min(len(parts), processors()) if can_start_threads() else 1
    done = 0.0
    if not parts and progress:
        progress(1.0)
    if threads <= 1:
        for part in parts:
            work(part)
            done += 1
            if progress:
                progress(done / len(parts))
        return
    with _threads(processors()) as pool:
        futures = [pool.submit(work, part) for part in parts]
        try:
            for future in as_completed(futures):
                future.result()
                done += 1
                if progress:
                    progress(done / len(parts))
        except BaseException:  # the reason may be Cancelled: what has not begun must not run on
            for future in futures:
                future.cancel()
            wait(futures)
            raise


# Threads that wait for work, by their number: to start them takes longer than an edit on a picture may. Work that runs
# at the same time, or within other work, has separate ones, so that none waits for the other.
_idle: defaultdict[int, list[ThreadPoolExecutor]] = defaultdict(list)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a child has no threads but its own


@contextmanager
def _threads(count: int) -> Iterator[ThreadPoolExecutor]:
    try:
        pool = _idle[count].pop()
    except IndexError:
        pool = ThreadPoolExecutor(count, "deformnb-warp")
    try:
        yield pool
    finally:
        _idle[count].append(pool)


def processors() -> int:
    """Processors this process may use, which is fewer than the machine's in a container or under taskset."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
