"""Evaluation of a radial basis function sum at many points, compiled: the inner loop of everything interactive.

The sum runs in a loop over the centres with the accumulators in registers, tile by tile: writing it as one reduction
over (points x centres) took 24 s instead of 12 ms for 1024^2 points and 32 centres, because XLA does not vectorise it.
The loop's length is a run-time number, so one compiled function serves every number of points up to its capacity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax import lax
from numpy.typing import NDArray

from deformnb.compilation import compiled, float64
from deformnb.kernels import AbstractKernel

_TILE = 64  # rows at a time: 64 x 256 float32 accumulators stay in the second-level cache
_GROUP = 4  # centres per turn of the inner loop


def few_sizes(tiles: int) -> int:
    """A number of tiles rounded up by at most an eighth, so that few shapes compile and little work is wasted."""
    step = max(1, 2 ** (tiles.bit_length() - 4))
    return -(-tiles // step) * step


class Leaves(NamedTuple):
    """The arrays of an interpolant in the type that it is evaluated in; ``scales`` (C,) is None if all are 1."""

    centers: Any
    coefficients: Any
    linear: Any
    constant: Any
    count: Any
    scales: Any = None


Sum: TypeAlias = Callable[[tuple[Any, ...], Leaves, type[AbstractKernel]], tuple[Any, ...]]


def _displacement(p: tuple[Any, ...], leaves: Leaves, kernel: type[AbstractKernel]) -> tuple[Any, ...]:
    """Components of D at relative points p (tuple of dim arrays of one shape); the loop's length is the count."""
    dim, linear = len(p), leaves.linear
    start = tuple(sum(linear[m, k] * p[k] for k in range(dim)) + leaves.constant[m] for m in range(dim))

    def add(total: tuple[Any, ...], offset: list[Any], a: Any, square: Any) -> tuple[Any, ...]:
        phi = kernel.profile(sum(o**2 for o in offset) * square)
        return tuple(total[m] + a[m] * phi for m in range(dim))

    return _over_centers(p, leaves, start, add)


def _jacobian(p: tuple[Any, ...], leaves: Leaves, kernel: type[AbstractKernel]) -> tuple[Any, ...]:
    """All dD_m/dp_k at relative points, row by row: ``A + 2 sum_j alpha_j slope(s_j) (p - c_j)^T``."""
    dim, linear = len(p), leaves.linear
    start = tuple(linear[m, k] + 0 * p[0] for m in range(dim) for k in range(dim))

    def add(total: tuple[Any, ...], offset: list[Any], a: Any, square: Any) -> tuple[Any, ...]:
        slope = 2 * square * kernel.slope(sum(o**2 for o in offset) * square)
        along = [slope * o for o in offset]
        return tuple(total[m * dim + k] + a[m] * along[k] for m in range(dim) for k in range(dim))

    return _over_centers(p, leaves, start, add)


def _over_centers(p: tuple[Any, ...], leaves: Leaves, start: tuple[Any, ...],
                  add: Callable[..., tuple[Any, ...]]) -> tuple[Any, ...]:
    dim = len(p)

    def body(q: Any, total: tuple[Any, ...]) -> tuple[Any, ...]:
        x = lax.dynamic_slice(leaves.centers, (q * _GROUP, q * 0), (_GROUP, dim))
        a = lax.dynamic_slice(leaves.coefficients, (q * _GROUP, q * 0), (_GROUP, dim))
        scale = None if leaves.scales is None else lax.dynamic_slice(leaves.scales, (q * _GROUP,), (_GROUP,))
        for i in range(_GROUP):
            offset = [p[k] - x[i, k] for k in range(dim)]
            total = add(total, offset, a[i], 1 if scale is None else scale[i] ** 2)
        return total

    return lax.fori_loop(0, (leaves.count + _GROUP - 1) // _GROUP, body, start)


def _lattice(rows: Any, columns: Any, leaves: Leaves, *, kernel: type[AbstractKernel], what: Sum) -> Any:
    dim = rows.shape[0]

    def tile(r: Any) -> Any:
        return jnp.stack(what(tuple(r[k][:, None] + columns[k][None, :] for k in range(dim)), leaves, kernel))

    tiles = lax.map(tile, rows.reshape(dim, -1, _TILE).transpose(1, 0, 2))
    return tiles.transpose(1, 0, 2, 3).reshape(-1, rows.shape[1], columns.shape[1])


_evaluate_lattice = compiled(_lattice, static_argnames=("kernel", "what"))


def _blocks(p: Any, leaves: Leaves, *, kernel: type[AbstractKernel], what: Sum) -> Any:
    return lax.map(lambda q: jnp.stack(what(tuple(q), leaves, kernel)), p)


_evaluate_blocks = compiled(_blocks, static_argnames=("kernel", "what"))


def at_lattice(rows: NDArray[np.float64], columns: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel],
               dtype: Any) -> NDArray[Any]:
    """Displacements (dim, R, C) at relative points ``rows[:, r] + columns[:, c]``."""
    return _at_lattice(rows, columns, leaves, kernel, dtype, _displacement)


def jacobian_at_lattice(rows: NDArray[np.float64], columns: NDArray[np.float64], leaves: Leaves,
                        kernel: type[AbstractKernel], dtype: Any) -> NDArray[Any]:
    """Derivatives (dim, dim, R, C) of D with respect to the relative coordinates, as :func:`at_lattice`."""
    dim = len(rows)
    return _at_lattice(rows, columns, leaves, kernel, dtype, _jacobian).reshape(dim, dim, rows.shape[1], -1)


def _at_lattice(rows: NDArray[np.float64], columns: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel],
                dtype: Any, what: Sum) -> NDArray[Any]:
    dim, n = rows.shape
    padded = np.zeros((dim, few_sizes(-(-n // _TILE)) * _TILE), dtype=dtype)
    padded[:, :n] = rows
    with float64():
        out = _evaluate_lattice(padded, columns.astype(dtype), leaves, kernel=kernel, what=what)
    return np.asarray(out)[:, :n]


def at_points(points: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel], dtype: Any) -> NDArray[Any]:
    """Displacements (dim, n) at relative points (dim, n)."""
    return _at_points(points, leaves, kernel, dtype, _displacement)


def jacobian_at_points(points: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel],
                       dtype: Any) -> NDArray[Any]:
    """Derivatives (dim, dim, n) of D with respect to the relative coordinates, as :func:`at_points`."""
    dim = len(points)
    return _at_points(points, leaves, kernel, dtype, _jacobian).reshape(dim, dim, -1)


def _at_points(points: NDArray[np.float64], leaves: Leaves, kernel: type[AbstractKernel], dtype: Any,
               what: Sum) -> NDArray[Any]:
    dim, n = points.shape
    block = 64 if n <= 64 else 4096
    count = few_sizes(-(-n // block)) if n else 1
    padded = np.zeros((count * block, dim), dtype=dtype)
    padded[:n] = points.T
    with float64():
        out = _evaluate_blocks(padded.reshape(count, block, dim).transpose(0, 2, 1), leaves, kernel=kernel, what=what)
    out = np.asarray(out)  # [block, component, point]
    return out.transpose(1, 0, 2).reshape(out.shape[1], -1)[:, :n]
