"""Interpolation of voxels: nearest, linear and cubic, by JAX. The only file of Python with gather loops.

This plain form is the reference, and computes on GPUs, and by NumPy where neither JAX nor the compiled loops of
:mod:`deformnb.native` are there; a processor reads voxels by these loops, where they are built. Everything here works
on bare arrays [z, y, x] and on indices; the indices are determined in :mod:`deformnb.warping.planning`, and the samples
are used in :mod:`deformnb.warping.voxel_readers`.

A place along one axis is stored as a whole number and a fraction, ``whole + part``. The displacement is added to the
fraction, never to the index: a float32 index of 500 resolves 3e-5 voxels only, a fraction resolves 1e-7 everywhere.

Outside rule (ITK's): a place in [-1/2, n - 1/2) reads the nearest edge voxel, anything beyond gives the fill value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._deferred import ndimage
from deformnb._jax import HAS_JAX, check_process, float64, jax, jit, jnp

WIDE = ("int32", "float64")
"""Voxel types that float32 arithmetic would change; they are interpolated in float64."""

LARGEST_INT32 = 2**31 - 1

NEAR = 2**21
"""Below this many voxels float32 tells places in neighbouring voxels apart."""

# Device memory is shared with NumPy without a copy only where it starts on this boundary (found by trying: 8, 16 and
# 32 are copied by jaxlib 0.10).
_ALIGNMENT = 64


@dataclass(frozen=True)
class Axis:
    """Places to read along one axis: ``index + fraction`` of ``size`` voxels ``stride`` apart in memory.

    ``fraction`` is in [0, 1], or None where the index is known to be whole and inside.
    """

    size: int
    stride: int
    index: Any
    fraction: Any | None


def compute_type(dtype: np.dtype[Any]) -> str:
    """The type in which voxels of a type are interpolated."""
    return "float64" if dtype.name in WIDE else "float32"


def arithmetic(dtype: np.dtype[Any], size: int) -> Any:
    """The context in which to compile and run for a voxel type and a number of voxels (64 bits where needed)."""
    return float64() if dtype.name in WIDE or size > LARGEST_INT32 else devices.device_context()


def to_device(array: NDArray[Any], shape: tuple[int, ...] | None = None) -> Any:
    """The array as JAX sees it, sharing memory where it can; one copy (with large pages) where it cannot.

    ``shape`` is applied here: reshaping on JAX's side would be one more copy.
    """
    check_process()
    if not devices.is_host():
        return jax.device_put(array if shape is None else array.reshape(shape), devices.device_in_use())
    if not HAS_JAX:
        return array if shape is None else array.reshape(shape)
    if not array.flags.c_contiguous or array.ctypes.data % _ALIGNMENT:
        copy = aligned_empty(array.shape, array.dtype)
        np.copyto(copy, array)
        array = copy
    with devices.device_context():
        return jax.device_put(array if shape is None else array.reshape(shape), may_alias=True)


def aligned_empty(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array that JAX can share. NumPy alone starts large arrays 16 bytes into a page."""
    count = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    buffer = np.empty(count + _ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % _ALIGNMENT
    return buffer[start : start + count].view(dtype).reshape(shape)


def spline_coefficients(values: NDArray[Any], compute: str, axes: Sequence[int] = (0, 1, 2)) -> NDArray[Any]:
    """Coefficients of the cubic B-spline through the voxels along ``axes``, mirrored at the edges."""
    result = values
    for axis in axes:
        if values.shape[axis] > 1:
            result = ndimage.spline_filter1d(result, order=3, axis=axis, output=np.dtype(compute), mode="mirror")
    return result.astype(compute, copy=False)


def split(whole: Any, part: Any) -> tuple[Any, Any]:
    """``whole + part`` with the fraction brought into [0, 1]."""
    floor = jnp.floor(part)
    return whole + floor.astype(jnp.int32), part - floor


def rounded_index(axis: Axis) -> Any:
    """The nearest voxel, halves upwards as ITK does: floor(place + 1/2)."""
    return axis.index if axis.fraction is None else axis.index + (axis.fraction >= 0.5)


def inside(axes: Sequence[Axis]) -> Any:
    """True where every place is in [-1/2, n - 1/2): exactly where the nearest voxel exists, so no float is compared."""
    result: Any = True
    for axis in axes:
        if axis.fraction is not None:
            result = result & (rounded_index(axis).astype(jnp.uint32) < axis.size)
    return result


def _cell(axis: Axis) -> tuple[Any, Any]:
    """The lower voxel of the cell and the place in it, clamped to the axis; the upper edge is fraction 1."""
    fraction: Any = axis.fraction
    low = jnp.clip(axis.index, 0, axis.size - 2)
    return low, jnp.minimum(jnp.maximum((axis.index - low).astype(fraction.dtype) + fraction, 0), 1)


Taps = list[tuple[Any, int, Any | None]]
"""Voxel indices along one axis as arrays and constant steps to be added, and their weights (None: one)."""


def nearest(axis: Axis) -> Taps:
    """The nearest voxel."""
    return [(jnp.clip(rounded_index(axis), 0, axis.size - 1), 0, None)]


def linear(axis: Axis) -> Taps:
    """The two neighbours.

    The form (1 - t) a + t b costs as much as a + t (b - a) with fused multiply-add, and gives a and b exactly at the
    two ends; the other one misses b by a rounding, so that an identity would change the last plane.
    """
    low, t = _cell(axis)
    return [(low, 0, 1 - t), (low, 1, t)]


def cubic(axis: Axis) -> Taps:
    """Four coefficients of the cubic B-spline through the voxels, mirrored at the edges.

    Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Processing Magazine 16(6), 1999.
    """
    low, t = _cell(axis)
    weights = ((1 - t) ** 3 / 6, 2 / 3 - t * t * (1 - t / 2), 2 / 3 - (1 - t) ** 2 * (1 + t) / 2, t**3 / 6)
    last = axis.size - 1
    return [(last - jnp.abs(last - jnp.abs(low + k)), 0, w) for k, w in zip((-1, 0, 1, 2), weights, strict=True)]


@dataclass(frozen=True)
class Method:
    """An interpolation method.

    ``taps`` gives the voxels and weights along one axis. ``blends``: whether values can come out that are in no
    voxel; ``is_spline``: whether it reads B-spline coefficients (:func:`spline_coefficients`) instead of voxels.
    """

    taps: Callable[[Axis], Taps]
    blends: bool
    is_spline: bool = False


SamplingName: TypeAlias = Literal["nearest", "linear", "cubic"]
"""Names of the ways to sample between voxels."""

METHODS: dict[str, Method] = {
    "nearest": Method(nearest, blends=False),
    "linear": Method(linear, blends=True),
    "cubic": Method(cubic, blends=True, is_spline=True),
}


def _axis_taps(method: str, axis: Axis, index: Any) -> Taps:
    """Memory offsets and weights along one axis; a whole place and an axis of one voxel need one tap."""
    if axis.fraction is None or axis.size == 1:
        taps: Taps = [(jnp.clip(axis.index, 0, axis.size - 1), 0, None)]
    else:
        taps = METHODS[method].taps(axis)
    return _offsets(taps, axis.stride, index)


def _offsets(taps: Taps, stride: int, index: Any) -> Taps:
    return [(place.astype(index) * stride, step * stride, weight) for place, step, weight in taps]


def _taps_at(places: Iterable[tuple[int, int, Any, Any]], *, method: str, index: str) -> tuple[list[Taps], Any]:
    """Memory offsets and weights along each axis, and which places are inside along all.

    places : of each axis the number of its voxels, their stride, and the place as a whole number and the rest.
    """
    axes = [Axis(size, stride, *split(whole, part)) for size, stride, whole, part in places]
    return [_axis_taps(method, axis, index) for axis in axes], inside(axes)


def weighted_sum(read: Callable[[Any, int], Any], taps: Sequence[Taps], offset: Any = 0, shift: int = 0) -> Any:
    """The weighted sum over all combinations of taps, one axis inside the other."""
    if not taps:
        return read(offset, shift)
    total: Any = None
    for place, step, weight in taps[0]:
        value = weighted_sum(read, taps[1:], offset + place, shift + step)
        value = value if weight is None else weight * value
        total = value if total is None else total + value
    return total


def to_voxel_type(value: Any, ok: Any, fill: Any, method: str) -> Any:
    """Values in the voxel type of ``fill``: integers rounded (halves up) and clipped, ``fill`` where not ``ok``."""
    if METHODS[method].blends:
        if jnp.issubdtype(fill.dtype, jnp.integer):
            if METHODS[method].is_spline:  # linear cannot leave the range
                limits = np.iinfo(fill.dtype)
                value = jnp.clip(value, limits.min, limits.max)
            value = jnp.floor(value + 0.5)
        value = value.astype(fill.dtype)
    return jnp.where(ok, value, fill)


def _take(array: Any, index: Any) -> Any:
    """Entries along the last axis, at indices that there are."""
    if not HAS_JAX:
        return array[..., index]
    return array.at[..., index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _reader(flat: Any, method: str, compute: Any) -> Callable[[Any, int], Any]:
    """Reads ``flat`` at an index plus a constant."""
    row = flat.reshape(-1)

    def read(index: Any, shift: int) -> Any:
        value = _take(row, index + shift)
        return value.astype(compute) if METHODS[method].blends else value

    return read


def _strides(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    return shape[1] * shape[2], shape[2], 1


# Shapes of tables along z, y and x.
_ALONG = ((-1, 1, 1), (-1, 1), (-1,))


def _interpolate_nodes(d: Any, nodes: Any) -> Any:
    """A component (z, y, x) at nodes, at the voxels that read them: first along x, then along y and z."""
    for axis in (2, 1, 0) if nodes is not None else ():
        first, weights = nodes[axis]
        d = sum(w.reshape(_ALONG[axis]) * jnp.take(d, first + k, axis) for k, w in enumerate(weights))
    return d


def read_displaced(
    flat: Any,
    field: Any,
    matrix: Any,
    whole: Any,
    part: Any,
    fill: Any,
    nodes: Any = None,
    *,
    shape: tuple[int, int, int],
    method: str,
    compute: str,
    index: str,
    is_straight: bool = False,
) -> Any:
    """A block of the output under any field. Axes of arrays come in the order z, y, x throughout.

    flat : the input's voxels (or spline coefficients) in any shape; ``shape`` is their shape.
    field : physical displacement along x, y, z: three arrays (z, y, x), at voxels or at nodes.
    matrix : 3 x 3, from physical displacement (x, y, z) to input voxels (z, y, x).
    whole, part : for output axes z, y, x the contribution (3, n) to the input place (z, y, x).
    nodes : None, or for z, y, x the first node that each voxel reads (n,), and the weights (T, n) of nodes from there.
    is_straight : each input axis depends on the output axis and the displacement of its own name only, so that less is
        added up.
    """
    d = [_interpolate_nodes(component, nodes).astype(compute) for component in field]
    places = []
    for a, stride in enumerate(_strides(shape)):
        axes, components = ((a,), (2 - a,)) if is_straight else (range(3), range(3))
        w, p = (sum(table[o][a].reshape(_ALONG[o]) for o in axes) for table in (whole, part))
        places.append((shape[a], stride, w, p + sum(matrix[a, m] * d[m] for m in components)))
    taps, ok = _taps_at(places, method=method, index=index)
    return to_voxel_type(weighted_sum(_reader(flat, method, compute), taps), ok, fill, method)


def _sample_listed(
    flat: Any, d: Any, voxels: Any, matrix: Any, whole: Any, part: Any, fill: Any, **settings: Any
) -> Any:
    """Single voxels (n,) of the output under displacements (3, n), as :func:`read_displaced` gives them.

    voxels : their indices z, y, x in the output, whose tables ``whole`` and ``part`` are.
    """

    def add(tables: Any) -> tuple[Any, ...]:
        z, y, x = (_take(table, at) for table, at in zip(tables, voxels, strict=True))
        none = jnp.zeros((3, 1), z.dtype)
        return none, none, z + y + x

    row = tuple(component.reshape(1, 1, -1) for component in d)
    return read_displaced(flat, row, matrix, add(whole), add(part), fill, **settings).reshape(-1)


def _sample_extruded(
    flat: Any,
    maps: Any,
    weights: Any,
    matrix: Any,
    whole: Any,
    part: Any,
    fill: Any,
    *,
    shape: tuple[int, int, int],
    normal: int,
    method: str,
    compute: str,
    index: str,
) -> Any:
    """A block of the output under a field that moves nothing along the array axis ``normal``.

    flat : as for :func:`read_displaced`.
    maps : K maps (2, z, y, x) of displacement along the plane's (u, v), of extent 1 along ``normal``.
    weights : (K, n) along ``normal``, or None for one replicated map.
    matrix : 3 x 2, from (u, v) to input voxels. The rest as for :func:`read_displaced`.
    """
    factors = [1] if weights is None else [w.reshape(_ALONG[normal]) for w in weights]
    d = sum(w * m.astype(compute) for w, m in zip(factors, maps, strict=True))
    strides = _strides(shape)
    fixed = _axis_taps(
        method, Axis(shape[normal], strides[normal], whole[normal][normal].reshape(_ALONG[normal]), None), index
    )
    others, places = [axis for axis in range(3) if axis != normal], []
    for a in others:
        w, p = (sum(table[o][a].reshape(_ALONG[o]) for o in others) for table in (whole, part))
        places.append((shape[a], strides[a], w, p + (matrix[a, 0] * d[0] + matrix[a, 1] * d[1])))
    taps, ok = _taps_at(places, method=method, index=index)
    return to_voxel_type(weighted_sum(_reader(flat, method, compute), [fixed, *taps]), ok, fill, method)


_STATIC = ("shape", "method", "compute", "index")
general = jit(read_displaced, on_one_thread=True, static_argnames=(*_STATIC, "is_straight"))
listed = jit(_sample_listed, on_one_thread=True, static_argnames=_STATIC)
extruded = jit(_sample_extruded, on_one_thread=True, static_argnames=(*_STATIC, "normal"))
