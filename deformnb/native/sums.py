"""Sums of radial functions over centres at many places, by the compiled loops."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.native import jobs, library


def can_sum(kernel: str) -> bool:
    """Check that there are compiled loops for a kernel, by its name."""
    return kernel in jobs.RADIAL_FUNCTIONS and library.loops() is not None


def _contiguous(a: NDArray[Any]) -> NDArray[np.float64]:
    is_ready = type(a) is np.ndarray and a.dtype == np.float64 and a.flags.c_contiguous and a.flags.aligned
    return a if is_ready else np.require(a, np.float64, ("C", "A"))


def sum_lattice(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    centers: NDArray[Any],
    coefficients: NDArray[Any],
    linear: NDArray[Any],
    constant: NDArray[Any],
    kernel: str,
    *,
    scales: NDArray[Any] | None = None,
    quadratic: NDArray[Any] | None = None,
    dtype: Any = np.float64,
    is_compact: bool = False,
    derivatives: bool = False,
) -> NDArray[Any]:
    """``D(p) = t + A p + p H p + sum_j a_j phi(|p - x_j|^2 scale_j^2)`` at ``p = rows[:, r] + columns[:, c]``.

    Parameters
    ----------
    rows, columns : (dim, R) and (dim, C), of dimension 2 or 3.
    centers, coefficients : (n, dim) the x_j and a_j.
    linear, constant, quadratic : A (dim, dim), t (dim,), and H (dim, dim, dim) or None.
    kernel : a name of :data:`~deformnb.native.jobs.RADIAL_FUNCTIONS`.
    scales : (n,), or None where all are 1.
    dtype : of the sums, float32 or float64. Places are counted from the centres in float64 in any case.
    is_compact : the kernel is zero from a relative distance of 1 on, so that centres farther away are left out.
    derivatives : by the coordinates of p instead of D.

    Returns
    -------
    (dim, R, C), or derivatives (dim, dim, R, C).
    """
    loops = library.loops()
    dim = len(rows)
    n = len(centers)
    given = [_contiguous(a) for a in (rows, columns, centers, coefficients, linear, constant)]
    optional = [None if a is None else _contiguous(a) for a in (scales, quadratic)]
    shapes = [(dim, rows.shape[1]), (dim, columns.shape[1]), (n, dim), (n, dim), (dim, dim), (dim,)]
    if dim not in (2, 3) or [a.shape for a in given] != shapes:
        raise ValueError(f"arrays of shapes {[a.shape for a in given]} are no sum over centres.")
    if [None if a is None else a.shape for a in optional] not in [
        [s, q] for s in (None, (n,)) for q in (None, (dim, dim, dim))
    ]:
        raise ValueError("scales are (n,) and a quadratic part is (dim, dim, dim).")
    if loops is None:
        raise ValueError(f"no loops: {library.why_absent()}.")
    parts = (dim, dim) if derivatives else (dim,)
    out = np.empty((*parts, rows.shape[1], columns.shape[1]), dtype)
    if out.dtype not in (np.float32, np.float64):
        raise ValueError(f"sums are float32 or float64, not {out.dtype}.")
    row, column, center, coefficient, a, t = (array.ctypes.data for array in given)
    scale, bent = (None if array is None else array.ctypes.data for array in optional)
    job = jobs.LatticeSum(
        row=row,
        column=column,
        center=center,
        coefficient=coefficient,
        scale=scale,
        linear=a,
        constant=t,
        quadratic=bent,
        out=out.ctypes.data,
        rows=rows.shape[1],
        columns=columns.shape[1],
        count=n,
        first=0,
        stop=rows.shape[1],
        dim=dim,
        kernel=jobs.RADIAL_FUNCTIONS.index(kernel),
        is_compact=is_compact,
        is_double=out.dtype == np.float64,
        derivatives=derivatives,
    )
    if out.size and loops.sum_lattice(ctypes.byref(job)):
        raise MemoryError
    return out
