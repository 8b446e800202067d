"""Evaluation of a radial basis function sum at many points, compiled: the inner loop of everything interactive.

The sum runs in a loop over the centres with the accumulators in registers, tile by tile: writing it as one reduction
over (points x centres) took 24 s instead of 12 ms for 1024^2 points and 32 centres, because XLA does not vectorise it.
The loop's length is a run-time number, so one compiled function serves every number of points up to its capacity.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from numpy.typing import NDArray

from deformnb.compilation import compiled, float64
from deformnb.kernels import AbstractKernel

_TILE = 64  # rows at a time: 64 x 256 float32 accumulators stay in the second-level cache
_GROUP = 4  # centres per turn of the inner loop


def _few_sizes(tiles: int) -> int:
    """A number of tiles rounded up by at most an eighth, so that few shapes compile and little work is wasted."""
    step = max(1, 2 ** (tiles.bit_length() - 4))
    return -(-tiles // step) * step


def _accumulate(p: tuple[Any, ...], centers: Any, coefficients: Any, linear: Any, constant: Any, count: Any,
                kernel: type[AbstractKernel]) -> tuple[Any, ...]:
    """Components of D at relative points p (tuple of dim arrays of one shape); the loop's length is the count."""
    dim = len(p)
    start = tuple(sum(linear[m, k] * p[k] for k in range(dim)) + constant[m] for m in range(dim))

    def body(q: Any, total: tuple[Any, ...]) -> tuple[Any, ...]:
        x = lax.dynamic_slice(centers, (q * _GROUP, q * 0), (_GROUP, dim))
        a = lax.dynamic_slice(coefficients, (q * _GROUP, q * 0), (_GROUP, dim))
        for i in range(_GROUP):
            phi = kernel.profile(sum((p[k] - x[i, k]) ** 2 for k in range(dim)))
            total = tuple(total[m] + a[i, m] * phi for m in range(dim))
        return total

    return lax.fori_loop(0, (count + _GROUP - 1) // _GROUP, body, start)


def _lattice(rows: Any, columns: Any, centers: Any, coefficients: Any, linear: Any, constant: Any, count: Any, *,
             kernel: type[AbstractKernel]) -> Any:
    dim = rows.shape[0]

    def tile(r: Any) -> Any:
        p = tuple(r[k][:, None] + columns[k][None, :] for k in range(dim))
        return jnp.stack(_accumulate(p, centers, coefficients, linear, constant, count, kernel))

    tiles = lax.map(tile, rows.reshape(dim, -1, _TILE).transpose(1, 0, 2))
    return tiles.transpose(1, 0, 2, 3).reshape(dim, rows.shape[1], columns.shape[1])


_evaluate_lattice = compiled(_lattice, static_argnames="kernel")


def _blocks(p: Any, centers: Any, coefficients: Any, linear: Any, constant: Any, count: Any, *,
            kernel: type[AbstractKernel]) -> Any:
    def block(q: Any) -> Any:
        return jnp.stack(_accumulate(tuple(q), centers, coefficients, linear, constant, count, kernel))

    return lax.map(block, p)


_evaluate_blocks = compiled(_blocks, static_argnames="kernel")


def at_lattice(rows: NDArray[np.float64], columns: NDArray[np.float64], leaves: tuple[Any, ...],
               kernel: type[AbstractKernel], dtype: Any) -> NDArray[Any]:
    """Displacements (dim, R, C) at relative points ``rows[:, r] + columns[:, c]``."""
    dim, n = rows.shape
    padded = np.zeros((dim, _few_sizes(-(-n // _TILE)) * _TILE), dtype=dtype)
    padded[:, :n] = rows
    with float64():
        out = _evaluate_lattice(padded, columns.astype(dtype), *leaves, kernel=kernel)
    return np.asarray(out)[:, :n]


def at_points(points: NDArray[np.float64], leaves: tuple[Any, ...], kernel: type[AbstractKernel],
              dtype: Any) -> NDArray[Any]:
    """Displacements (dim, n) at relative points (dim, n)."""
    dim, n = points.shape
    block = 64 if n <= 64 else 4096
    count = _few_sizes(-(-n // block)) if n else 1
    padded = np.zeros((count * block, dim), dtype=dtype)
    padded[:n] = points.T
    with float64():
        out = _evaluate_blocks(padded.reshape(count, block, dim).transpose(0, 2, 1), *leaves, kernel=kernel)
    return np.asarray(out).transpose(1, 0, 2).reshape(dim, -1)[:, :n]
