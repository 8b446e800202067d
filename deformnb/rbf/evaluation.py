"""Sums of radial functions at many points, ``D(x) = A x + t + sum_j alpha_j phi(|x - x_j| / R)``; their derivatives.

Evaluation of the sum at many points is compiled: it is the inner loop of everything interactive. It runs in a loop over
the centres with the accumulators in registers, tile by tile: writing it as one reduction over (points x centres) took
24 s instead of 12 ms for 1024^2 points and 32 centres, because XLA does not vectorise it. The loop's length is a
run-time number, so one compiled function serves every number of points up to its capacity. Where JAX is not installed
NumPy takes many centres in one turn of the same loop.

Kernels of compact support reach few of many places. The loop leaves out the centres that do not reach a tile; of
:data:`CULLED` and more, a tile gets the list of those that do, and counts its places from its middle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import mul
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._jax import HAS_JAX, as_numpy, each, float64, jax, jit, jnp, lax, pytree
from deformnb.native import sums
from deformnb.rbf.kernels import BUILT_IN, AbstractKernel

CAPACITIES = (8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)
"""Numbers of points that are compiled for; a fit is padded to the next one, so adding a point rarely recompiles."""

CULLED = 512
"""Centres of a compact kernel from which on tiles have lists of them."""


def is_culled(kernel: type[AbstractKernel], count: Any) -> bool:
    """Check that tiles of places have lists of the centres that reach them."""
    return kernel.compact and int(count) >= CULLED


def is_compiled(kernel: type[AbstractKernel]) -> bool:
    """Check that sums are computed by loops compiled ahead (:mod:`deformnb.native.sums`), of :class:`PlainLeaves`."""
    return kernel.name in BUILT_IN and devices.is_host() and sums.can_sum(kernel.name)


# Centres that arrays of sums hold at least where loops over them end at their number, so that fewer would save nothing;
# those of a GPU go over all.
_LEAST = 128


def pad_centers(values: Any, dtype: Any) -> NDArray[Any]:
    """A copy of numbers of centres (C, ...), with zeros up to the number of centres that is compiled for at least."""
    values = np.asarray(values)
    filled = np.zeros((max(len(values), _LEAST if devices.is_host() else 0), *values.shape[1:]), dtype)
    filled[: len(values)] = values
    return filled


def capacity(n: int) -> int:
    """The smallest of :data:`CAPACITIES` that holds n points."""
    return next(c for c in CAPACITIES if c >= n)


_TILE = 32  # rows at a time: 32 x 256 float32 accumulators and four kernels stay in the second-level cache
_SIDE = 64  # columns of a tile at least, of many centres of a compact kernel
_GROUP = 4  # centres per turn of the inner loop
_GROUP_OF_GPU = 32  # a turn is a launch there, and reads and writes the sums once
_BLOCK = 4096  # points at a time, whose accumulators stay in the cache as well
_AT_ONCE = 2**15  # places times centres at a time, of NumPy


def few_sizes(tiles: int) -> int:
    """A number of tiles rounded up by at most an eighth, so that few shapes compile and little work is wasted."""
    step = max(1, 2 ** (tiles.bit_length() - 4))
    return -(-tiles // step) * step


def profile_of(square: NDArray[np.float64], kernel: type[AbstractKernel]) -> NDArray[np.float64]:
    """A kernel's phi at squared relative distances (n,), float64; a user's own is compiled for few sizes."""
    if kernel.name in BUILT_IN:
        with np.errstate(all="ignore"):
            return np.asarray(kernel.profile(square))
    padded = np.zeros(max(256, few_sizes(len(square))))
    padded[: len(square)] = square
    with float64():
        return np.asarray(_profile(padded, kernel=kernel))[: len(square)]


@cache
def steepest_distance(kernel: type[AbstractKernel]) -> float:
    """The relative distance within the support at which the profile of a kernel is steepest: 1/4 for Wendland's C2."""
    rho = np.linspace(0.0, 1.0, 129)
    steepest = int(np.abs(np.diff(profile_of(rho**2, kernel))).argmax())
    return float(rho[steepest : steepest + 2].mean())


_profile = jit(lambda s, kernel: kernel.profile(s), static_argnames="kernel")


class Leaves(NamedTuple):
    """The arrays of an interpolant in the type that it is evaluated in.

    ``scales`` (C,) is None if all are 1, ``quadratic`` (dim, dim, dim) if the trend has no quadratic part.
    """

    centers: Any
    coefficients: Any
    linear: Any
    constant: Any
    count: Any
    scales: Any = None
    quadratic: Any = None


class PlainLeaves(NamedTuple):
    """Those of loops compiled ahead: in float64 for any type of the sums, and without padding."""

    arrays: Leaves


Times: TypeAlias = Callable[[Any, Any], Any]
"""Coefficients of centres times a function of each, added up where there are several."""

Sum: TypeAlias = Callable[[tuple[Any, ...], Leaves, type[AbstractKernel]], tuple[Any, ...]]


def _displacement(p: tuple[Any, ...], leaves: Leaves, kernel: type[AbstractKernel]) -> tuple[Any, ...]:
    """Components of D at relative points p (tuple of dim arrays of one shape); the loop's length is the count."""
    dim, linear, h = len(p), leaves.linear, leaves.quadratic
    start = tuple(sum(linear[m, k] * p[k] for k in range(dim)) + leaves.constant[m] for m in range(dim))
    if h is not None:
        start = tuple(
            start[m] + sum(h[m, k, j] * p[k] * p[j] for k in range(dim) for j in range(dim)) for m in range(dim)
        )

    def add(total: tuple[Any, ...], offset: list[Any], a: Any, phi: Any, times: Times) -> tuple[Any, ...]:
        return tuple(total[m] + times(a[m], phi) for m in range(dim))

    return _add_centers(p, leaves, start, lambda s, _: kernel.profile(s), add)


def _jacobian(p: tuple[Any, ...], leaves: Leaves, kernel: type[AbstractKernel]) -> tuple[Any, ...]:
    """All dD_m/dp_k at relative points, row by row: ``A + 2 sum_j alpha_j slope(s_j) (p - c_j)^T``."""
    dim, linear, h = len(p), leaves.linear, leaves.quadratic
    start = tuple(linear[m, k] + 0 * p[0] for m in range(dim) for k in range(dim))
    if h is not None:
        start = tuple(
            start[m * dim + k] + 2 * sum(h[m, k, j] * p[j] for j in range(dim)) for m in range(dim) for k in range(dim)
        )

    def add(total: tuple[Any, ...], offset: list[Any], a: Any, slope: Any, times: Times) -> tuple[Any, ...]:
        along = [slope * o for o in offset]
        return tuple(total[m * dim + k] + times(a[m], along[k]) for m in range(dim) for k in range(dim))

    return _add_centers(p, leaves, start, lambda s, square: 2 * square * kernel.slope(s), add)


def _add_centers(
    p: tuple[Any, ...],
    leaves: Leaves,
    start: tuple[Any, ...],
    radial: Callable[[Any, Any], Any],
    add: Callable[..., tuple[Any, ...]],
) -> tuple[Any, ...]:
    """Add the share of every centre to the sums ``start``.

    Parameters
    ----------
    radial : from squared distances, relative to the support of a centre, and the square of its scale, to a function of
        them that all sums share.
    add : from the sums, the offsets from a centre, its coefficients and its radial function, to the sums; and the
        product of the last two, which adds up those of several centres.
    """
    if not HAS_JAX:
        return _add_groups(p, leaves, start, radial, add)
    dim, on_host = len(p), devices.is_host()
    group = _GROUP if on_host else min(_GROUP_OF_GPU, len(leaves.centers))
    # On a GPU the centres that fill up a capacity count too, with coefficients of 0: a number that is only known when
    # the program runs would be waited for in each turn.
    turns = (leaves.count + group - 1) // group if on_host else len(leaves.centers) // group

    def body(q: Any, total: tuple[Any, ...]) -> tuple[Any, ...]:
        x = lax.dynamic_slice(leaves.centers, (q * group, q * 0), (group, dim))
        a = lax.dynamic_slice(leaves.coefficients, (q * group, q * 0), (group, dim))
        scale = None if leaves.scales is None else lax.dynamic_slice(leaves.scales, (q * group,), (group,))

        def offset(i: int) -> list[Any]:  # computed again by each reader: it takes longer to load than to compute
            return [p[k] - x[i, k] for k in range(dim)]

        def functions() -> tuple[Any, ...]:
            squares = [1 if scale is None else scale[i] ** 2 for i in range(group)]
            return tuple(radial(sum(o**2 for o in offset(i)) * squares[i], squares[i]) for i in range(group))

        for i, function in enumerate(_materialize(functions, q >= 0) if on_host else functions()):
            total = add(total, offset(i), a[i], function, mul)
        return total

    return lax.fori_loop(0, turns, body, start)


def _add_groups(
    p: tuple[Any, ...],
    leaves: Leaves,
    start: tuple[Any, ...],
    radial: Callable[[Any, Any], Any],
    add: Callable[..., tuple[Any, ...]],
) -> tuple[Any, ...]:
    """:func:`_add_centers` in NumPy: so many centres at once that their arrays stay in the cache."""
    total, shape = start, (-1, *(1,) * p[0].ndim)
    group = max(1, _AT_ONCE // max(1, p[0].size))
    for first in range(0, int(leaves.count), group):
        own = slice(first, min(first + group, int(leaves.count)))
        squares = 1 if leaves.scales is None else leaves.scales[own].reshape(shape) ** 2
        offset = [place - x.reshape(shape) for place, x in zip(p, leaves.centers[own].T, strict=True)]
        function = radial(sum(o * o for o in offset) * squares, squares)
        total = add(total, offset, leaves.coefficients[own].T, function, lambda a, values: np.tensordot(a, values, 1))
    return total


def _materialize(values: Callable[[], tuple[Any, ...]], always: Any) -> tuple[Any, ...]:
    """Arrays that several sums read, held in memory: XLA on the CPU would compute them again for each of the sums.

    Nothing is fused across the edge of a conditional (an ``optimization_barrier`` is taken out before fusion, and a
    loop's carry is copied). On 256^2 pixels 32 compact points took 0.95 ms instead of 0.83, 128 thin-plate points 12.6
    instead of 10.1, and the derivatives of 32 points 1.75 instead of 1.18.

    Parameters
    ----------
    always : true, and not known to be before the program runs.
    """
    return tuple(lax.cond(always, values, lambda: tuple(map(jnp.zeros_like, jax.eval_shape(values)))))


def outer_sum(rows: Any, columns: Any) -> tuple[Any, ...]:
    """Coordinates (R, C) of all places ``rows[:, r] + columns[:, c]``."""
    return tuple(r[:, None] + c[None, :] for r, c in zip(rows, columns, strict=True))


def _leaves_in_reach(leaves: Leaves, low: Any, high: Any) -> Leaves:
    """The centres whose support of 1 (or of 1 / scale) meets a box with corners (dim,), in their order, then zeros."""
    n = len(leaves.centers)
    gap = jnp.maximum(jnp.maximum(low - leaves.centers, leaves.centers - high), 0.0)
    square = jnp.sum(gap * gap, axis=1) * (1 if leaves.scales is None else leaves.scales**2)
    is_near = (square < 1) & (jnp.arange(n) < leaves.count)
    if not HAS_JAX:
        centers, coefficients, scales = (
            None if a is None else a[is_near] for a in (leaves.centers, leaves.coefficients, leaves.scales)
        )
        return leaves._replace(
            centers=centers, coefficients=coefficients, scales=scales, count=np.count_nonzero(is_near)
        )
    place = jnp.where(is_near, jnp.cumsum(is_near) - 1, n)
    order = jnp.full(n, n, place.dtype).at[place].set(jnp.arange(n, dtype=place.dtype), mode="drop")

    def select(array: Any) -> Any:
        return jnp.take(array, order, axis=0, mode="fill", fill_value=0)

    return leaves._replace(
        centers=select(leaves.centers),
        coefficients=select(leaves.coefficients),
        scales=None if leaves.scales is None else select(leaves.scales),
        count=jnp.sum(is_near, dtype=leaves.count.dtype),
    )


def _lattice(rows: Any, columns: Any, leaves: Leaves, *, kernel: type[AbstractKernel], what: Sum) -> Any:
    if not devices.is_host():
        return jnp.stack(what(outer_sum(rows, columns), leaves, kernel))
    dim, width = columns.shape
    # To write tiles of some of the columns takes 0.1 ms of 256 x 256 pixels, more than few centres take.
    across = max(1, width // _SIDE) if kernel.compact and len(leaves.centers) > _LEAST else 1
    side = -(-width // across)

    def values(r: Any, c: Any) -> Any:
        own = leaves
        if kernel.compact:
            own = _leaves_in_reach(leaves, r.min(axis=1) + c.min(axis=1), r.max(axis=1) + c.max(axis=1))
        return jnp.stack(what(outer_sum(r, c), own, kernel))

    def add(t: Any, out: Any) -> Any:
        i, j = t // across * _TILE, jnp.minimum(t % across * side, width - side)  # the last tile may overlap
        own = lax.dynamic_slice(rows, (0 * t, i), (dim, _TILE)), lax.dynamic_slice(columns, (0 * t, j), (dim, side))
        return lax.dynamic_update_slice(out, values(*own), (0 * t, i, j))

    count = dim if what is _displacement else dim * dim
    out = jnp.zeros((count, rows.shape[1], width), rows.dtype)
    # Stacked by lax.map, it would all be copied once more.
    return lax.fori_loop(0, rows.shape[1] // _TILE * across, add, out)


_compiled_lattice = jit(_lattice, on_one_thread=True, static_argnames=("kernel", "what"))


def _blocks(p: Any, leaves: Leaves, *, kernel: type[AbstractKernel], what: Sum) -> Any:
    return each(lambda q: jnp.stack(what(tuple(q), leaves, kernel)), p)


evaluate_blocks = jit(_blocks, on_one_thread=True, static_argnames=("kernel", "what"))


def evaluate_lattice(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves | PlainLeaves,
    kernel: type[AbstractKernel],
    dtype: Any,
) -> NDArray[Any]:
    """Displacements (dim, R, C) at relative points ``rows[:, r] + columns[:, c]``."""
    return _evaluate_lattice(rows, columns, leaves, kernel, dtype, _displacement)


def jacobian_at_lattice(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves | PlainLeaves,
    kernel: type[AbstractKernel],
    dtype: Any,
) -> NDArray[Any]:
    """Derivatives (dim, dim, R, C) of D with respect to the relative coordinates, as :func:`evaluate_lattice`."""
    dim = len(rows)
    return _evaluate_lattice(rows, columns, leaves, kernel, dtype, _jacobian).reshape(dim, dim, rows.shape[1], -1)


def _evaluate_lattice(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves | PlainLeaves,
    kernel: type[AbstractKernel],
    dtype: Any,
    what: Sum,
) -> NDArray[Any]:
    dim, n = rows.shape
    if isinstance(leaves, PlainLeaves):
        return _sum_compiled(rows, columns, leaves.arrays, kernel, dtype, what)
    if is_culled(kernel, leaves.count):
        return _culled_lattice(rows, columns, leaves, kernel, dtype, what)
    padded = np.zeros((dim, few_sizes(-(-n // _TILE)) * _TILE), dtype=dtype)
    padded[:, :n] = rows
    with float64():
        return as_numpy(_compiled_lattice(padded, columns.astype(dtype), leaves, kernel=kernel, what=what))[:, :n]


def _sum_compiled(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves,
    kernel: type[AbstractKernel],
    dtype: Any,
    what: Sum,
) -> NDArray[Any]:
    centers, coefficients, linear, constant, _, scales, quadratic = leaves
    found = sums.sum_lattice(
        rows,
        columns,
        centers,
        coefficients,
        linear,
        constant,
        kernel.name,
        scales=scales,
        quadratic=quadratic,
        dtype=dtype,
        is_compact=kernel.compact,
        derivatives=what is _jacobian,
    )
    return found.reshape(int(np.prod(found.shape[:-2])), *found.shape[-2:])


def check_parts(components: Iterable[Any]) -> tuple[tuple[Any, ...], Any]:
    """Components in float32, and whether all numbers are finite; a GPU would compute them again for the check."""
    held = lax.optimization_barrier(tuple(one.astype(jnp.float32) for one in components))
    return held, jnp.isfinite(sum(jnp.vdot(one, one) for one in held))


def _components(
    rows: Any, columns: Any, leaves: Leaves, *, kernel: type[AbstractKernel], shape: tuple[int, ...]
) -> tuple[tuple[Any, ...], Any]:
    return check_parts(one.reshape(shape) for one in _displacement(outer_sum(rows, columns), leaves, kernel))


_evaluate_components = jit(_components, static_argnames=("kernel", "shape"))


def lattice_on_device(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves,
    kernel: type[AbstractKernel],
    dtype: Any,
    shape: tuple[int, ...],
) -> tuple[tuple[Any, ...], Any]:
    """:func:`evaluate_lattice` for those that read it in the memory of a GPU.

    Returns
    -------
    dim components, float32, of ``shape`` for R and C, and whether all are finite.
    """
    if is_culled(kernel, leaves.count):
        d = evaluate_lattice(rows, columns, leaves, kernel, dtype).astype(np.float32).reshape(-1, *shape)
        return tuple(map(jnp.asarray, d)), np.isfinite(np.vdot(d, d))
    with float64():
        return _evaluate_components(rows.astype(dtype), columns.astype(dtype), leaves, kernel=kernel, shape=shape)


def evaluate_points(
    points: NDArray[np.float64], leaves: Leaves | PlainLeaves, kernel: type[AbstractKernel], dtype: Any
) -> NDArray[Any]:
    """Displacements (dim, n) at relative points (dim, n)."""
    return _evaluate_points(points, leaves, kernel, dtype, _displacement)


def jacobian_at_points(
    points: NDArray[np.float64], leaves: Leaves | PlainLeaves, kernel: type[AbstractKernel], dtype: Any
) -> NDArray[Any]:
    """Derivatives (dim, dim, n) of D with respect to the relative coordinates, as :func:`evaluate_points`."""
    dim = len(points)
    return _evaluate_points(points, leaves, kernel, dtype, _jacobian).reshape(dim, dim, -1)


def _evaluate_points(
    points: NDArray[np.float64], leaves: Leaves | PlainLeaves, kernel: type[AbstractKernel], dtype: Any, what: Sum
) -> NDArray[Any]:
    dim, n = points.shape
    if isinstance(leaves, PlainLeaves):
        return _sum_compiled(np.zeros((dim, 1)), points, leaves.arrays, kernel, dtype, what)[:, 0]
    if is_culled(kernel, leaves.count) and n > 64:
        return _culled_points(points, leaves, kernel, dtype, what)
    block = 64 if n <= 64 else _BLOCK
    count = few_sizes(-(-n // block)) if n else 1
    padded = np.zeros((count * block, dim), dtype=dtype)
    padded[:n] = points.T
    with float64():
        out = evaluate_blocks(padded.reshape(count, block, dim).transpose(0, 2, 1), leaves, kernel=kernel, what=what)
    out = np.asarray(out)  # [block, component, point]
    return out.transpose(1, 0, 2).reshape(out.shape[1], -1)[:, :n]


@pytree(data_fields=["leaves", "origin", "scale"], meta_fields=["kernel"])
@dataclass(frozen=True, eq=False)
class RadialSum:
    """A sum at places in physical units, in pure JAX.

    Parameters
    ----------
    leaves : in the type that is exact enough. origin, scale : (dim,) and 1 / support of the relative coordinates.
    """

    leaves: Leaves
    origin: Any
    scale: Any
    kernel: type[AbstractKernel]

    def relative(self, places: Sequence[Any]) -> tuple[Any, ...]:
        """Components of places, relative, in the type of the leaves."""
        return tuple(
            ((x - o) * self.scale).astype(self.leaves.centers.dtype) for x, o in zip(places, self.origin, strict=True)
        )

    def __call__(self, places: Sequence[Any]) -> list[Any]:
        """Components of the displacements at places (components of one shape), in the type of these."""
        found = _displacement(self.relative(places), self.leaves, self.kernel)
        return [d.astype(x.dtype) for d, x in zip(found, places, strict=True)]


def stack_sums(sums: Sequence[RadialSum]) -> RadialSum:
    """Sums with arrays of the same shapes as one, with a first axis along which ``lax.scan`` iterates."""
    return jax.tree.map(lambda *parts: np.stack(parts), *sums)


# ---- compact kernels with many centres -------------------------------------------------------------------------------

_BOX = (32, 64)  # rows and columns of a tile with a separate list
_MOST = 1024  # tiles at a time: their lists take little memory, and few enough calls


class Reached(NamedTuple):
    """The arrays of :class:`Leaves` for each of T tiles, relative to its middle: the centres that reach it."""

    centers: Any
    coefficients: Any
    linear: Any
    constant: Any
    count: Any
    scales: Any


def _centers_in_reach(low: NDArray[np.float64], high: NDArray[np.float64], leaves: Leaves) -> Reached:
    """The centres whose support meets boxes (T, dim), padded to one number; float32 has more digits next to them."""
    n = int(leaves.count)
    x = np.asarray(leaves.centers)[:n]
    reach = np.ones(n) if leaves.scales is None else 1 / np.asarray(leaves.scales)[:n]
    gap = sum(
        np.maximum(np.maximum(low[:, None, k] - x[None, :, k], x[None, :, k] - high[:, None, k]), 0.0) ** 2
        for k in range(x.shape[1])
    )
    tile, centre = np.nonzero(gap < reach**2)
    counts = np.bincount(tile, minlength=len(low))
    place = np.arange(len(tile)) - np.repeat(np.cumsum(counts) - counts, counts)
    width = capacity(int(counts.max(initial=1)))
    index = np.full((len(low), width), n)
    index[tile, place] = centre

    def select(array: Any) -> Any:
        padded = np.concatenate([np.asarray(array)[:n], np.zeros((1, *np.shape(array)[1:]), np.asarray(array).dtype)])
        return padded[index]

    scales = None if leaves.scales is None else select(leaves.scales)
    m, a = (low + high) / 2, np.asarray(leaves.linear)
    linear, constant = np.broadcast_to(a, (len(m), *a.shape)), m @ a.T + leaves.constant
    if leaves.quadratic is not None:
        bent = m @ np.asarray(leaves.quadratic)  # [component, tile, coordinate]
        linear, constant = linear + 2 * bent.transpose(1, 0, 2), constant + (bent * m).sum(axis=2).T
    return Reached(
        select(leaves.centers) - m[:, None],
        select(leaves.coefficients),
        linear,
        constant,
        counts.astype(np.int32),
        scales,
    )


def _tiles(rows: Any, columns: Any, reached: Any, leaves: Leaves, *, kernel: type[AbstractKernel], what: Sum) -> Any:
    dim = rows.shape[1]

    def tile(given: Any) -> Any:
        r, c, own = given
        p = tuple(r[k][:, None] + c[k][None, :] for k in range(dim))
        return jnp.stack(what(p, leaves._replace(**own._asdict()), kernel))

    return each(tile, (rows, columns, reached))


_compiled_tiles = jit(_tiles, on_one_thread=True, static_argnames=("kernel", "what"))


def local_sums(leaves: Leaves) -> NDArray[np.float64]:
    """The largest sums (dim + 1,) over the centres whose supports, of 1, can meet at one place, by cells of 1/2: of
    their squared coefficients, and of ones, which is how many they are.
    """
    n = int(leaves.count)
    x = np.asarray(leaves.centers)[:n]
    squares = np.concatenate([np.asarray(leaves.coefficients)[:n] ** 2, np.ones((n, 1))], axis=1)
    cells = np.floor(2 * (x - x.min(axis=0))).astype(np.int64)
    shape = tuple(cells.max(axis=0) + 1)
    if np.prod(shape, dtype=float) > 1e6:
        return np.asarray(squares.sum(axis=0))
    flat = np.ravel_multi_index(tuple(cells.T), shape)
    sums = np.stack([np.bincount(flat, column, int(np.prod(shape))).reshape(shape) for column in squares.T])
    for axis in range(1, sums.ndim):  # of five cells along it
        lines = np.moveaxis(sums, axis, 0)
        wide = np.zeros((len(lines) + 4, *lines.shape[1:]))
        for k in range(5):
            wide[k : k + len(lines)] += lines
        sums = np.moveaxis(wide, 0, axis)
    return np.minimum(sums.reshape(len(sums), -1).max(axis=1), squares.sum(axis=0))


def _evaluate_tiles(
    rows: NDArray[Any], columns: NDArray[Any], leaves: Leaves, kernel: type[AbstractKernel], dtype: Any, what: Sum
) -> NDArray[Any]:
    """Values (T, components, r, c) at ``rows[t, :, i] + columns[t, :, j]`` of T tiles."""
    center = columns.mean(axis=2, keepdims=True)  # the lines of a tile are small numbers then
    rows, columns = rows + center, columns - center
    low = rows.min(axis=2) + columns.min(axis=2)
    high = rows.max(axis=2) + columns.max(axis=2)
    middle = ((low + high) / 2)[:, :, None]
    bent = None if leaves.quadratic is None else np.asarray(leaves.quadratic, dtype=dtype)
    common = Leaves(0, 0, 0, 0, 0, None, bent)
    parts = []
    for start in range(0, len(rows), _MOST):
        at = slice(start, start + _MOST)
        reached = _centers_in_reach(low[at], high[at], leaves)
        count = len(reached.count)
        extra = few_sizes(count) - count

        def widen(array: Any, extra: int = extra) -> Any:
            return None if array is None else np.concatenate([array, np.zeros((extra, *array.shape[1:]), array.dtype)])

        own = Reached(*(a if a is None or a.dtype == np.int32 else a.astype(dtype) for a in map(widen, reached)))
        with float64():
            found = _compiled_tiles(
                widen((rows[at] - middle[at]).astype(dtype)),
                widen(columns[at].astype(dtype)),
                own,
                common,
                kernel=kernel,
                what=what,
            )
        parts.append(np.asarray(found)[:count])
    return np.concatenate(parts)


def _split_lines(lines: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """Lines (dim, n) in pieces (k, dim, side); the last one is repeated to fill its piece."""
    n = lines.shape[1]
    count = -(-n // side)
    filled = lines[:, np.minimum(np.arange(count * side), n - 1)]
    return filled.reshape(len(lines), count, side).transpose(1, 0, 2)


def _culled_lattice(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    leaves: Leaves,
    kernel: type[AbstractKernel],
    dtype: Any,
    what: Sum,
) -> NDArray[Any]:
    r, c = _split_lines(rows, min(_BOX[0], rows.shape[1])), _split_lines(columns, min(_BOX[1], columns.shape[1]))
    first, second = np.repeat(r, len(c), axis=0), np.tile(c, (len(r), 1, 1))
    out = _evaluate_tiles(first, second, leaves, kernel, dtype, what)
    shape = (len(r), len(c), out.shape[1], r.shape[2], c.shape[2])
    whole = out.reshape(shape).transpose(2, 0, 3, 1, 4).reshape(out.shape[1], len(r) * r.shape[2], -1)
    return whole[:, : rows.shape[1], : columns.shape[1]]


def _culled_points(
    points: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel], dtype: Any, what: Sum
) -> NDArray[Any]:
    """Points in any order: by cells of half a support, and blocks of neighbours of these."""
    n, block = points.shape[1], 256
    cells = np.floor(2 * points).clip(-(2**20), 2**20)
    order = np.lexsort(cells[::-1])
    c = _split_lines(points[:, order], block)
    out = _evaluate_tiles(np.zeros((*c.shape[:2], 1)), c, leaves, kernel, dtype, what)
    flat = out[:, :, 0].transpose(1, 0, 2).reshape(out.shape[1], -1)[:, :n]
    found = np.empty_like(flat)
    found[:, order] = flat
    return found
