"""Points move forwards: where the matter of a place goes, found by inverting the backward map."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.cuts import Decoupled
from deformnb.errors import DeformError
from deformnb.fields import AbstractField, Composed

# Newton's method ends at this share of the extent of the points: three digits better than a thousandth of a voxel in a
# volume of 1000 voxels, and far above the rounding of a stored float32 field (1e-7 of its displacement).
_POINT_TOLERANCE = 1e-6

# A Newton step halved this far without gain leads nowhere.
_SHORTEST_STEP = 1e-4


def warp_points(points: ArrayLike, field: AbstractField, *, tolerance: float | None = None,
                max_iterations: int = 50) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Where points of the input are in the result: y with ``y + D(y) = x``, the inverse of the backward map.

    Damped Newton with the field's own derivative, from ``x - D(x)`` and, for what that does not reach, from x itself.
    Where the map folds there are several such places and one of them is found.

    Parameters
    ----------
    points : (..., dim), physical; (a, b) on the plane for a field of dimension 2.
    field : backward displacements.
    tolerance : largest error of ``y + D(y)``, as a length; default is 1e-6 of the extent of points and displacements.
    max_iterations : Newton steps at most, of each start.

    Returns
    -------
    moved : (..., dim), float64 and finite, the best place found.
    converged : (...), bool; False where the map has no such place, where it was not found, and where the paper's rule
        of cuts hides it. Never ignore it.

    Raises
    ------
    DeformError
        If points are not finite or do not have the field's dimension.

    Examples
    --------
    >>> from deformnb.fields import Identity
    >>> moved, converged = warp_points([[1.0, 2.0, 3.0]], Identity())
    >>> moved.tolist(), converged.tolist()
    ([[1.0, 2.0, 3.0]], [True])
    """
    array = np.asarray(points, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != field.dim:
        raise DeformError(f"points need {field.dim} coordinates for this field, got an array of shape {array.shape}.")
    x = array.reshape(-1, field.dim)
    bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(bad):
        raise DeformError(f"point {bad[0]} is not finite ({x[bad[0]].tolist()}); remove it or give its place.")
    if not len(x):
        return array.copy(), np.ones(array.shape[:-1], dtype=bool)
    y, found = _moved(x, field, tolerance, max_iterations)
    return y.reshape(array.shape), found.reshape(array.shape[:-1])


def _moved(x: NDArray[np.float64], field: AbstractField, tolerance: float | None,
           max_iterations: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """What holds for points (N, dim), at least one."""
    if isinstance(field, Composed) and field.has_cuts:  # a map that jumps is followed one step at a time
        between, first = _moved(x, field.first, tolerance, max_iterations)
        y, then = _moved(between, field.then, tolerance, max_iterations)
        return y, first & then
    if isinstance(field, Decoupled):
        return _beside_cuts(x, field, tolerance, max_iterations)
    return _solved(x, field, tolerance, max_iterations)


def _beside_cuts(x: NDArray[np.float64], field: Decoupled, tolerance: float | None,
                 max_iterations: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Matter moves with the region it lies in; by the paper's rule none is seen across a cut."""
    y, found = x.copy(), np.ones(len(x), dtype=bool)
    for mask, own in field.of_source(x):
        if own is not None and mask.any():
            y[mask], found[mask] = _moved(x[mask], own, tolerance, max_iterations)
    if field.rule == "paper":
        found &= field.regions_of(y) == field.regions_of(x)
    return y, found


def _solved(x: NDArray[np.float64], field: AbstractField, tolerance: float | None,
            max_iterations: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    d = field.displacement(x)
    if tolerance is None:
        tolerance = _POINT_TOLERANCE * max(float(np.ptp(x, axis=0).max()), float(np.abs(d).max()))
    y, error = _newton(np.where(np.isfinite(d), x - d, x), x, field, tolerance, max_iterations)
    left = np.flatnonzero(~(error <= tolerance))
    if len(left):
        again, error_again = _newton(x[left], x[left], field, tolerance, max_iterations)
        better = error_again < error[left]
        y[left[better]], error[left[better]] = again[better], error_again[better]
    return y, error <= tolerance


def _newton(start: NDArray[np.float64], x: NDArray[np.float64], field: AbstractField, tolerance: float,
            max_iterations: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The best places y found from ``start`` and their errors |y + D(y) - x|."""

    def residual(y: NDArray[np.float64], target: NDArray[np.float64]) -> tuple[Any, Any]:
        r = y + field.displacement(y) - target
        error = np.linalg.norm(r, axis=1)
        return r, np.where(np.isfinite(error), error, np.inf)

    y = start.copy()
    r, error = residual(y, x)
    for _ in range(max_iterations):
        active = np.flatnonzero(np.isfinite(error) & (error > tolerance))
        if not len(active):
            break
        step = _newton_step(y[active], r[active], field)
        t, left = 1.0, np.arange(len(active))
        while len(left) and t > _SHORTEST_STEP:
            k = active[left]
            trial = y[k] + t * step[left]
            r_trial, error_trial = residual(trial, x[k])
            good = error_trial < error[k]
            y[k[good]], r[k[good]], error[k[good]] = trial[good], r_trial[good], error_trial[good]
            t, left = t / 2, left[~good]
        if len(left) == len(active):
            break
    return y, error


def _newton_step(y: NDArray[np.float64], r: NDArray[np.float64], field: AbstractField) -> NDArray[np.float64]:
    """Minus the inverse of 1 + dD/dx, times the residual; finite where the map folds and there is no inverse."""
    # JAX compiles for each number of points: round it up to a power of two.
    padded = np.resize(np.arange(len(y)), 1 << (len(y) - 1).bit_length())
    jacobian = np.eye(y.shape[1]) + field.jacobian(y[padded])[: len(y)]
    normal = np.einsum("nki,nkj->nij", jacobian, jacobian)
    damping = 1e-12 * np.trace(normal, axis1=1, axis2=2) + 1e-300  # a trace of it: Newton's speed is kept
    normal += damping[:, None, None] * np.eye(y.shape[1])
    return -np.linalg.solve(normal, np.einsum("nki,nk->ni", jacobian, r)[..., None])[..., 0]
