"""Interpolation of voxels: nearest, linear and cubic. The only file with gather loops.

Everything here works on bare arrays [z, y, x] and on indices; the indices are determined in
:mod:`deformnb.warping.planning`, and the samples are used in :mod:`deformnb.warping.warper`.

A place along one axis is stored as a whole number and a fraction, ``whole + part``. The displacement is added to the
fraction, never to the index: a float32 index of 500 resolves 3e-5 voxels only, a fraction resolves 1e-7 everywhere.

Outside rule (ITK's): a place in [-1/2, n - 1/2) reads the nearest edge voxel, anything beyond gives the fill value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._deferred import ndimage
from deformnb._jax import check_process, each, float64, jax, jit, jnp, lax, pytree

WIDE = ("int32", "float64")
"""Voxel types that float32 arithmetic would change; they are interpolated in float64."""

LARGEST_INT32 = 2**31 - 64  # with the values before them in a line of memory, see :class:`Within`

NEAR = 2**21
"""Below this many voxels places are split in a quicker way, see :func:`split`."""

MOST_WORDS = 2**23
"""Voxels of a slice whose numbers float32 holds with a bit to spare, see :func:`_slices_in_words`."""

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
    if not array.flags.c_contiguous or array.ctypes.data % _ALIGNMENT:
        copy = aligned_empty(array.shape, array.dtype)
        np.copyto(copy, array)
        array = copy
    with devices.device_context():
        return jax.device_put(array if shape is None else array.reshape(shape), may_alias=True)


@pytree(("row", "start"), ("shape",))
@dataclass(frozen=True)
class Within:
    """An array of ``shape`` within ``row``, one row of values in JAX's memory, from ``start`` on."""

    row: Any
    start: Any
    shape: tuple[int, ...]

    def at(self, k: Any) -> Any:
        """The k-th part along the first axis."""
        size = int(np.prod(self.shape[1:]))
        return lax.dynamic_slice_in_dim(self.row, self.start + k * size, size).reshape(self.shape[1:])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """The array in NumPy's memory."""
        start = int(self.start)
        values = np.asarray(self.row)[start : start + int(np.prod(self.shape))].reshape(self.shape)
        return np.array(values, dtype, copy=copy)


def share_with_jax(array: NDArray[Any]) -> Any:
    """An array, or a part of a larger one, as JAX sees it: by :func:`to_device`, or :class:`Within` without a copy.

    The row of the latter begins before the array, where memory can be shared; parts of one shape have rows of one
    length. Only a part at the very beginning or end of the larger array is copied.
    """
    whole = array
    while isinstance(whole.base, np.ndarray):
        whole = whole.base
    start = array.ctypes.data % _ALIGNMENT
    # By its strides, not by where it starts alone: all parts of an array along its first axes are then of one kind,
    # and one compilation serves them. Read as a row they take a twentieth longer, copied a quarter.
    is_aligned = not (start or any(stride % _ALIGNMENT for stride in array.strides[:-2]))
    is_part = whole.flags.c_contiguous and array.nbytes < whole.nbytes
    if not devices.is_host() or not array.flags.c_contiguous or start % array.itemsize or not array.size:
        return to_device(array)
    if not is_part and start:
        return Within(to_device(_lines(array)), np.int32(start // array.itemsize), array.shape)
    if is_aligned or not is_part:
        return to_device(array)
    length = array.size + _ALIGNMENT // array.itemsize
    values = whole.reshape(-1).view(np.uint8)
    first = array.ctypes.data - start - values.ctypes.data
    if 0 <= first <= values.size - length * array.itemsize:
        row = values[first : first + length * array.itemsize].view(array.dtype)
        return Within(to_device(row), np.int32(start // array.itemsize), array.shape)
    row = aligned_empty((length,), array.dtype)
    np.copyto(row[: array.size].reshape(array.shape), array)
    return Within(to_device(row), np.int32(0), array.shape)


def _lines(array: NDArray[Any]) -> NDArray[Any]:
    """The row of values in the whole lines of memory that hold an array. A line is in one page, so all may be read.

    The memory before and behind the array is undefined: its values must not be used.
    """
    start = array.ctypes.data % _ALIGNMENT
    count = -(-(start + array.nbytes) // _ALIGNMENT) * (_ALIGNMENT // array.itemsize)
    interface = {"version": 3, "typestr": array.dtype.str, "shape": (count,), "data": (array.ctypes.data - start, True)}
    return np.asarray(SimpleNamespace(__array_interface__=interface, owner=array))


def move_axis(array: NDArray[Any], axis: int, to: int) -> Any:
    """The array in JAX's memory with one axis moved; JAX's own copy turns small types four times as fast as NumPy's.

    It takes twice as long where slices that it reads or writes by turns begin whole pages apart (:func:`add_row_gaps`):
    their lines of memory drive each other out of the cache.
    """
    check_process()
    with devices.device_context():
        return jax.device_put(np.moveaxis(array, axis, to))


def add_row_gaps(array: NDArray[Any]) -> NDArray[Any]:
    """A copy of slices [slice, row, column] with a gap of one line of memory behind each."""
    size = array[0].size
    lines = np.empty((len(array), size + _ALIGNMENT // array.itemsize), array.dtype)
    copy = lines[:, :size].reshape(array.shape)
    np.copyto(copy, array)
    return copy


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


def split(whole: Any, part: Any, *, near: bool = False) -> tuple[Any, Any]:
    """``whole + part`` with the fraction brought into [0, 1].

    near : ``whole`` is below :data:`NEAR` and so is the axis, so that a larger ``part`` leads outside in any case.
    """
    floor = jnp.floor(part)
    if near and part.dtype == jnp.float32:
        # Read off the bits of floor + 1.5 * 2^23, exact up to 2^22. XLA's conversion saturates and tests for NaN on the
        # way, one voxel at a time: the general warp takes 1.3 times as long with it.
        shifted = jnp.minimum(jnp.maximum(floor, -(2.0**22)), 2.0**22) + np.float32(1.5 * 2**23)
        whole_part = lax.bitcast_convert_type(shifted, jnp.int32) - np.int32(0x4B400000)
    else:
        whole_part = floor.astype(jnp.int32)
    return whole + whole_part, part - floor


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


def _near_cell(whole: Any, part: Any, size: int) -> tuple[Any, Any, Any]:
    """The lower voxel of the cell of near places (:func:`split`), the place in it, and whether that is inside.

    Whole numbers are floats here, exact below 2^24: fewer instructions than by way of integers. The axis has two voxels
    at least.
    """
    cell = jnp.clip(whole + jnp.floor(part), 0, size - 2)
    start = cell - whole
    return cell, jnp.minimum(jnp.maximum(part - start, 0), 1), (part >= start - 0.5) & (part < start + 1.5)


def _whole_number(value: Any) -> Any:
    """A whole number from 0 to 2^23 that is held as float32, read off its bits (:func:`split` explains why)."""
    return lax.bitcast_convert_type(value + np.float32(2**23), jnp.int32) - 0x4B000000


def _taps_at(
    places: Iterable[tuple[int, int, Any, Any]], *, method: str, index: str, near: bool
) -> tuple[list[Taps], Any]:
    """Memory offsets and weights along each axis, and which places are inside along all.

    places : of each axis the number of its voxels, their stride, and the place as a whole number and the rest.
    """
    found, ok = [], True
    for size, stride, whole, part in places:
        if near and method == "linear" and size > 1 and part.dtype == jnp.float32:
            cell, t, is_inside = _near_cell(whole.astype(jnp.float32), part, size)
            low = _whole_number(cell)
            taps = _offsets([(low, 0, 1 - t), (low, 1, t)], stride, index)
        else:
            axis = Axis(size, stride, *split(whole, part, near=near))
            taps, is_inside = _axis_taps(method, axis, index), inside([axis])
        found.append(taps)
        ok = ok & is_inside
    return found, ok


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


def products_of(taps: Sequence[Taps]) -> Taps:
    """The same combinations as one list of offsets with their products of weights."""
    result: Taps = [(0, 0, None)]
    for axis in taps:
        result = [
            (offset + place, shift + step, weight if factor is None else factor if weight is None else factor * weight)
            for offset, shift, factor in result
            for place, step, weight in axis
        ]
    return result


def _materialize(taps: Taps) -> Taps:
    """The same taps, behind a barrier: their arrays are computed once, and not again for every voxel."""
    places, weights = lax.optimization_barrier(([tap[0] for tap in taps], [tap[2] for tap in taps]))
    return [(place, tap[1], weight) for place, tap, weight in zip(places, taps, weights, strict=True)]


def to_voxel_type(value: Any, ok: Any, fill: Any, method: str) -> Any:
    """Values in the voxel type of ``fill``: integers rounded (halves up) and clipped, ``fill`` where not ``ok``."""
    if METHODS[method].blends:
        if jnp.issubdtype(fill.dtype, jnp.integer) and METHODS[method].is_spline:  # linear cannot leave the range
            limits = np.iinfo(fill.dtype)
            value = jnp.clip(value, limits.min, limits.max)
        if fill.dtype == jnp.uint8:
            # floor(value + 1/2) read off the bits of value + 256.5, whose exponent is known. XLA's conversion saturates
            # and tests for NaN too, which makes the replicated warp a fifth slower.
            value = lax.bitcast_convert_type((value + 256.5).astype(jnp.float32), jnp.uint32) >> 15
        elif jnp.issubdtype(fill.dtype, jnp.integer):
            value = jnp.floor(value + 0.5)
            if fill.dtype.itemsize < 4:  # read off the bits in the same way
                value = lax.bitcast_convert_type((value + 1.5 * 2**23).astype(jnp.float32), jnp.int32)
        value = value.astype(fill.dtype)
    return jnp.where(ok, value, fill)


def _reader(flat: Any, taps: Sequence[Taps], method: str, compute: Any) -> Callable[[Any, int], Any]:
    """Reads ``flat`` at an index plus a constant, which no combination of ``taps`` exceeds.

    Every constant is the start of a part of the array, and all parts have one length: the index and its test, which
    XLA always makes, are then the same for all taps, and the compiler does them once (1.6 times faster in space). A GPU
    would copy the parts.
    """
    length, on_host = flat.shape[0] - sum(max(step for _, step, _ in axis) for axis in taps), devices.is_host()

    def read(index: Any, shift: int) -> Any:
        part, at = (lax.slice_in_dim(flat, shift, shift + length), index) if on_host else (flat, index + shift)
        value = part.at[at].get(mode="promise_in_bounds", wrap_negative_indices=False)
        return value.astype(compute) if METHODS[method].blends else value

    return read


@pytree(("flat", "first"), ("length",))
@dataclass(frozen=True)
class Rows:
    """The part from ``first`` on, of ``length`` voxels, of each row of the array or :class:`Within` ``flat``."""

    flat: Any
    first: Any
    length: int

    @property
    def shape(self) -> tuple[int, ...]:
        return (*self.flat.shape[:-1], self.length)

    @property
    def size(self) -> int:
        """The number of voxels of all of ``flat``."""
        return int(np.prod(self.flat.shape))

    def reader(self, method: str, compute: Any) -> Callable[[Any, int], Any]:
        """Reads rows (rows, columns, length) at their numbers (rows, columns) plus a constant."""
        (row, start), stride = _row_of(self.flat), self.flat.shape[-1]
        window = lax.GatherDimensionNumbers(offset_dims=(2,), collapsed_slice_dims=(), start_index_map=(0,))

        def read(index: Any, shift: int) -> Any:
            begin = (index + shift) * stride + start + self.first
            values = lax.gather(row, begin[..., None], window, (self.length,), mode="promise_in_bounds")
            return values.astype(compute) if METHODS[method].blends else values

        return read


def _row_of(flat: Any) -> tuple[Any, Any]:
    """The row that contains values, and where they begin."""
    return (flat.row, flat.start) if isinstance(flat, Within) else (flat.reshape(-1), 0)


def _strides(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    return shape[1] * shape[2], shape[2], 1


def _general(
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
    step: int,
    compute: str,
    index: str,
    near: bool = False,
    straight: bool = False,
) -> Any:
    """A block of the output under any field. Axes of arrays come in the order z, y, x throughout.

    flat : the input's voxels (or spline coefficients) in any shape, or :class:`Within`; ``shape`` is their shape.
    field : physical displacement (x, y, z) at every ``step``-th plane and row: three arrays (nodes z, nodes y, nx), or
        one with the components last, which may be within another (:class:`Within`).
    matrix : 3 x 3, from physical displacement (x, y, z) to input voxels (z, y, x).
    whole, part : for output axes z, y, x the contribution (3, n) to the input place (z, y, x).
    nodes : None, or the places of planes and rows of the field instead of at every ``step``-th: for z and y the first
        node that each voxel reads (n,), and the weights (T, n) of T nodes from there.
    straight : each input axis depends on the output axis and the component of its own name only; the others are zero
        in ``matrix``, ``whole`` and ``part`` and need not be added up for every voxel.
    """
    low = np.arange(whole[1].shape[1]) // step
    tail = () if isinstance(field, tuple) else (1,)
    within = jnp.asarray(np.arange(whole[1].shape[1]) % step / step, jnp.float32).reshape(-1, 1, *tail)

    row, start = _row_of(flat)

    def nodes_of(values: Any, k: Any) -> Any:
        return values.at(k) if isinstance(values, Within) else lax.dynamic_index_in_dim(values, k, keepdims=False)

    def between(values: Any, below: Any, t: Any) -> Any:
        # Two slices, a barrier, then rows: one slice of two planes costs 4 to 7 times more.
        first, second = nodes_of(values, below), nodes_of(values, below + 1)
        return lax.optimization_barrier((1 - t) * first + t * second)

    def component(values: Any, q: Any) -> Any:
        if nodes is not None:
            (below, z), (before, y) = nodes
            planes = [lax.dynamic_index_in_dim(values, below[q] + k, keepdims=False) for k in range(len(z))]
            near = lax.optimization_barrier(sum(z[k, q] * plane for k, plane in enumerate(planes)))
            rows = [near.at[before + k].get(mode="promise_in_bounds") for k in range(len(y))]
            return lax.optimization_barrier(sum(y[k][:, None] * row for k, row in enumerate(rows)))
        if step == 1:
            return nodes_of(values, q)
        plane = between(values, q // step, (q % step).astype(jnp.float32) / step)
        return lax.optimization_barrier((1 - within) * plane[low] + within * plane[low + 1])

    def read(d: Any, *along_z: Any) -> Any:
        d = [values.astype(compute) for values in d]
        places = []
        for a, stride in enumerate(_strides(shape)):
            outer, inner = ([a], [2 - a]) if straight else (range(3), range(3))
            w, p = (
                sum((z[a], table[1][a, :, None], table[2][a])[o] for o in outer)
                for z, table in zip(along_z, (whole, part), strict=True)
            )
            places.append((shape[a], stride, w, p + sum(matrix[a, m] * d[m] for m in inner)))
        taps, ok = _taps_at(places, method=method, index=index, near=near)
        return to_voxel_type(weighted_sum(_reader(row, taps, method, compute), taps, start), ok, fill, method)

    def plane(q: Any) -> Any:
        if isinstance(field, tuple):
            d = [component(values, q) for values in field]
        else:  # taken apart plane by plane in the cache; doing it before costs half as much as the warp
            d = list(lax.optimization_barrier(tuple(jnp.moveaxis(component(field, q), -1, 0))))
        return read(d, whole[0][:, q], part[0][:, q])

    if isinstance(field, tuple) and nodes is None and step == 1 and not devices.is_host():
        return read(field, whole[0][:, :, None, None], part[0][:, :, None, None])  # nothing is taken apart there
    return each(plane, jnp.arange(whole[0].shape[1]))


def _sample_listed(
    flat: Any,
    d: Any,
    voxels: Any,
    matrix: Any,
    whole: Any,
    part: Any,
    fill: Any,
    *,
    shape: tuple[int, int, int],
    method: str,
    compute: str,
    index: str,
    near: bool = False,
) -> Any:
    """Single voxels (n,) of the output under displacements (3, n), as :func:`_general` gives them.

    voxels : their indices z, y, x in the output, whose tables ``whole`` and ``part`` are.
    """

    def add(tables: Any) -> tuple[Any, ...]:
        z, y, x = (table.at[:, at].get(mode="promise_in_bounds") for table, at in zip(tables, voxels, strict=True))
        none = jnp.zeros((3, 1), z.dtype)
        return none, none, z + y + x

    row = tuple(component.reshape(1, 1, -1) for component in d)
    return _general(
        flat,
        row,
        matrix,
        add(whole),
        add(part),
        fill,
        shape=shape,
        method=method,
        step=1,
        compute=compute,
        index=index,
        near=near,
    ).reshape(-1)


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
    near: bool = False,
) -> Any:
    """A block of the output under a field that moves nothing along the array axis ``normal``.

    flat : as for :func:`_general`.
    maps : K maps (2, z, y, x) of displacement along the plane's (u, v), of extent 1 along ``normal``.
    weights : (K, n) along ``normal``, or None for one replicated map.
    matrix : 3 x 2, from (u, v) to input voxels. The rest as for :func:`_general`.
    """
    along = [tuple(-1 if k == axis else 1 for k in range(3)) for axis in range(3)]
    factors = [1] if weights is None else [w.reshape(along[normal]) for w in weights]
    d = sum(w * m.astype(compute) for w, m in zip(factors, maps, strict=True))
    strides = _strides(shape)
    fixed = _axis_taps(
        method, Axis(shape[normal], strides[normal], whole[normal][normal].reshape(along[normal]), None), index
    )
    others, places = [axis for axis in range(3) if axis != normal], []
    for a in others:
        w, p = (sum(table[o][a].reshape(along[o]) for o in others) for table in (whole, part))
        places.append((shape[a], strides[a], w, p + (matrix[a, 0] * d[0] + matrix[a, 1] * d[1])))
    taps, ok = _taps_at(places, method=method, index=index, near=near)
    if weights is None:
        # These are as small as the map: compute them once. With weights they are as large as the output: never store.
        taps, ok = [_materialize(axis) for axis in taps], lax.optimization_barrier(ok)
    row, start = _row_of(flat)
    read = _reader(row, [fixed, *taps], method, compute)
    return to_voxel_type(weighted_sum(read, [fixed, *taps], start), ok, fill, method)


def _slices_in_words(
    slices: Any, moves: Any, weights: Any, whole: Any, part: Any, fill: Any, *, shape: tuple[int, int]
) -> Any:
    """Slices of one or two bytes a voxel, each moved within itself and read linearly, like :func:`_sample_extruded`.

    A word per voxel of a slice holds the four voxels of its cell, or with two bytes a voxel those of one row: one or
    two loads for each voxel of the output in place of four. Slices need two rows and two columns at least, and no more
    than :data:`MOST_WORDS` voxels; their places must be near (:func:`split`).

    slices : [slice, row, column] of ``shape``, which may be within another array (:class:`Within`).
    moves : K displacements (2, rows, columns) in voxels along rows and columns, with ``weights`` (K, n).
    whole, part : the input place of each row and column of the output before that, two arrays each for rows and columns
        of the input; of extent 1 along the axes of the output that they do not depend on.
    """
    columns, bits = shape[1], 8 * fill.dtype.itemsize
    held, loads = ((0, 1, columns, columns + 1), (0,)) if bits == 8 else ((0, 1), (0, columns))
    count = shape[0] * columns - held[-1]  # of words; the last voxels begin none
    value_type = jnp.int32 if jnp.issubdtype(fill.dtype, jnp.signedinteger) else jnp.uint32

    def pack(voxels: Any) -> Any:
        wide = lax.bitcast_convert_type(voxels.reshape(-1), jnp.dtype(f"uint{bits}")).astype(jnp.uint32)
        return sum(wide[shift : shift + count] << bits * k for k, shift in enumerate(held))

    def voxel(word: Any, k: int) -> Any:
        high = lax.bitcast_convert_type(word << 32 - bits * (k + 1), value_type)  # its sign is that of the voxel
        return (high >> 32 - bits).astype(jnp.int32).astype(jnp.float32)

    def move(k: Any) -> Any:
        cells, weights_in, ok = [], [], True
        for a in range(2):
            place = part[a] + sum(weights[m, k] * moves[m][a] for m in range(len(moves)))
            cell, within, is_inside = _near_cell(whole[a], place, shape[a])
            cells.append(cell)
            weights_in.append(within)
            ok = ok & is_inside
        at = _whole_number(cells[0] * columns + cells[1])
        # XLA merges loops across its barriers and would pack again for each voxel that is read; what comes out of a
        # conditional is stored. This one's condition always holds.
        voxels = slices.at(k) if isinstance(slices, Within) else lax.dynamic_index_in_dim(slices, k, keepdims=False)
        words = lax.cond(k >= 0, pack, lambda _: jnp.zeros(count, jnp.uint32), voxels)
        parts = [lax.slice_in_dim(words, shift, count - loads[-1] + shift) for shift in loads]
        read = [some.at[at].get(mode="promise_in_bounds", wrap_negative_indices=False) for some in parts]
        read = lax.optimization_barrier(read)  # read, then interpolated: without it words are read for each voxel
        a, b, c, d = (voxel(word, k) for word in read for k in range(len(held)))
        s, t = weights_in
        return to_voxel_type((1 - s) * ((1 - t) * a + t * b) + s * ((1 - t) * c + t * d), ok, fill, "linear")

    return lax.map(move, jnp.arange(weights.shape[1]))


def _row_taps(
    maps: Any,
    matrix: Any,
    whole: Any,
    part: Any,
    *,
    shape: tuple[int, int],
    method: str,
    compute: str,
    index: str,
    near: bool = False,
) -> tuple[list[tuple[Any, Any]], Any]:
    """Rows to read and their weights for each row of the output, and which of these are inside: small arrays.

    maps : (2, rows, columns) of displacement along (u, v).
    matrix : 2 x 2, from (u, v) to input voxels (rows, columns).
    whole, part : for output rows and columns the contribution (2, n) to the input place (row, column).
    """
    d = maps.astype(compute)
    places = []
    for a, stride in ((0, shape[1]), (1, 1)):
        w, p = (t[0][a, :, None] + t[1][a] for t in (whole, part))
        places.append((shape[a], stride, w, p + (matrix[a, 0] * d[0] + matrix[a, 1] * d[1])))
    taps, ok = _taps_at(places, method=method, index=index, near=near)
    return [(offset + shift, weight) for offset, shift, weight in products_of(taps)], ok


def _sample_rows(table: Any, taps: list[tuple[Any, Any]], ok: Any, fill: Any, *, method: str, compute: str) -> Any:
    """Output rows by :func:`_row_taps`.

    table : (shape[0] * shape[1], n), one row of voxels per place on the picture; or [row, column, n]; or :class:`Rows`.
    """
    each: Taps = [(offset, 0, None if weight is None else weight[..., None]) for offset, weight in taps]
    if isinstance(table, Rows):
        read = table.reader(method, compute)
    else:
        read = _reader(table.reshape(-1, table.shape[-1]), [each], method, compute)
    return to_voxel_type(weighted_sum(read, [each]), ok[..., None], fill, method)


def _rows(
    table: Any,
    maps: Any,
    matrix: Any,
    whole: Any,
    part: Any,
    fill: Any,
    *,
    shape: tuple[int, int],
    method: str,
    compute: str,
    index: str,
    near: bool = False,
) -> Any:
    """A chunk of output rows that move as a whole: one replicated map, the axis of replication last in memory.

    The arguments are those of :func:`_row_taps` and :func:`_sample_rows`.
    """
    found = _row_taps(maps, matrix, whole, part, shape=shape, method=method, compute=compute, index=index, near=near)
    # The barrier makes offsets and weights separate small arrays; without it they are computed again for every
    # voxel and the rows are not read as vectors (2.5 times slower).
    taps, ok = lax.optimization_barrier(found)
    return _sample_rows(table, taps, ok, fill, method=method, compute=compute)


_STATIC = ("shape", "method", "compute", "index", "near")
general = jit(_general, on_one_thread=True, static_argnames=(*_STATIC, "step", "straight"))
listed = jit(_sample_listed, on_one_thread=True, static_argnames=_STATIC)
extruded = jit(_sample_extruded, on_one_thread=True, static_argnames=(*_STATIC, "normal"))
slices_in_words = jit(_slices_in_words, on_one_thread=True, static_argnames=("shape",))
rows = jit(_rows, static_argnames=_STATIC)
row_taps = jit(_row_taps, static_argnames=_STATIC)
rows_by = jit(_sample_rows, on_one_thread=True, static_argnames=("method", "compute"))
