"""Plain loops in numba: the same arithmetic, nothing more. Places outside get the fill value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(inline="always")
def _cell(place: Any, n: Any) -> Any:
    place = min(max(place, np.float32(0)), np.float32(n - 1))
    low = min(np.int64(place), n - 2)
    return low, np.float32(place - low)


@numba.njit(parallel=False, fastmath=True)
def _rows(values: Any, row: Any, column: Any, half: Any, fill: Any, out: Any) -> None:
    nq, np_, n = values.shape
    for q in range(nq):
        for p in range(np_):
            y, x = q + row[q, p], p + column[q, p]
            target = out[q, p]
            if y < -0.5 or x < -0.5 or y >= nq - 0.5 or x >= np_ - 0.5:
                target[:] = fill
                continue
            i, s = _cell(y, nq)
            j, t = _cell(x, np_)
            d = s * t
            c, b = s - d, t - d
            a = np.float32(1) - s - b
            v00, v01, v10, v11 = values[i, j], values[i, j + 1], values[i + 1, j], values[i + 1, j + 1]
            for k in range(n):
                target[k] = a * v00[k] + b * v01[k] + c * v10[k] + d * v11[k] + half


@numba.njit(parallel=False, fastmath=True)
def _general(values: Any, displacement: Any, half: Any, fill: Any, out: Any) -> None:
    nz, ny, nx = values.shape
    one = np.float32(1)
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                d = displacement[k, j, i]
                x, y, z = i + d[0], j + d[1], k + d[2]
                if x < -0.5 or y < -0.5 or z < -0.5 or x >= nx - 0.5 or y >= ny - 0.5 or z >= nz - 0.5:
                    out[k, j, i] = fill
                    continue
                a, r = _cell(x, nx)
                b, s = _cell(y, ny)
                c, t = _cell(z, nz)
                low = (one - s) * ((one - r) * values[c, b, a] + r * values[c, b, a + 1]) + s * (
                    (one - r) * values[c, b + 1, a] + r * values[c, b + 1, a + 1]
                )
                high = (one - s) * ((one - r) * values[c + 1, b, a] + r * values[c + 1, b, a + 1]) + s * (
                    (one - r) * values[c + 1, b + 1, a] + r * values[c + 1, b + 1, a + 1]
                )
                out[k, j, i] = (one - t) * low + t * high + half


def _half(dtype: np.dtype[Any]) -> np.float32:
    return np.float32(0.5 if dtype.kind in "iu" else 0)


def rows(values: NDArray[Any], row: NDArray[Any], column: NDArray[Any], fill: float, axis: int) -> Callable[[], Any]:
    """A replicated map; the volume was laid out with the axis of replication last before."""
    table = np.ascontiguousarray(np.moveaxis(values, axis, 2))
    row, column = np.ascontiguousarray(row), np.ascontiguousarray(column)

    def run() -> NDArray[Any]:
        out = np.empty_like(table)
        _rows(table, row, column, _half(values.dtype), values.dtype.type(fill), out)
        return np.moveaxis(out, 2, axis)

    return run


def general(values: NDArray[Any], displacement: NDArray[Any], fill: float) -> Callable[[], Any]:
    """Any field."""

    def run() -> NDArray[Any]:
        out = np.empty_like(values)
        _general(values, displacement, _half(values.dtype), values.dtype.type(fill), out)
        return out

    return run
