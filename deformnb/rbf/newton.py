"""Damped Newton method for places: y with ``y + D(y) = x`` for many points x together.

``y <- y - t (1 + dD/dx)^-1 (y + D(y) - x)`` with t halved until the error falls. Near a solution the error is squared
at every turn. Where the result depends on the start, several are tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import adjugate, determinant, one_plus
from deformnb._typing import Floats
from deformnb.rbf.fields import AbstractField

# A Newton step halved this far without gain leads nowhere.
SHORTEST_STEP = 1e-4

# Below this share of the product of a matrix's rows its determinant counts as none, and the step is damped instead.
_SINGULAR = 1e-9


@dataclass(frozen=True)
class BackwardMap:
    """D (n, dim) and its derivative (n, dim, dim), of places (n, dim) and the numbers (n) of their points."""

    displacement: Callable[[Floats, NDArray[np.intp]], Floats]
    jacobian: Callable[[Floats, NDArray[np.intp]], Floats]


def map_of(field: AbstractField) -> BackwardMap:
    """A field and its derivative as the method evaluates them."""
    return BackwardMap(lambda y, _: field.displacement(y), lambda y, _: field.jacobian(y))


def search(
    x: Floats, at: BackwardMap, tolerance: float, max_iterations: int, start: Floats | None
) -> tuple[Floats, Floats]:
    """The best places found for points x (N, dim), and their errors, from two or three starts."""
    d = at.displacement(x, np.arange(len(x)))
    starts = (start, np.where(np.isfinite(d), x - d, x), x)
    y, error = x.copy(), np.full(len(x), np.inf)
    for first in starts:
        if first is None:
            continue
        left = np.flatnonzero(~(error <= tolerance))
        if not len(left):
            break
        keep_better(y, error, left, *newton(first[left], x[left], left, at, tolerance, max_iterations))
    return y, error


def keep_better(y: Floats, error: Floats, k: NDArray[np.intp], y_new: Floats, error_new: Floats) -> None:
    """Replace places y[k] and their errors, in place, by new ones where these are better."""
    better = error_new < error[k]
    y[k[better]], error[k[better]] = y_new[better], error_new[better]


def lengths_of(r: Floats) -> Floats:
    """Lengths (n) of vectors (n, dim); infinite where not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.sqrt(np.einsum("nk,nk->n", r, r))
    return np.where(np.isfinite(error), error, np.inf)


def newton(
    start: Floats, x: Floats, numbers: NDArray[np.intp], at: BackwardMap, tolerance: float, max_iterations: int
) -> tuple[Floats, Floats]:
    """The best places y found from ``start`` and their errors |y + D(y) - x|."""
    y = start.copy()
    r = y + at.displacement(y, numbers) - x
    error = lengths_of(r)
    active = np.flatnonzero(np.isfinite(error) & (error > tolerance))
    for _ in range(max_iterations):
        if not len(active):
            break
        step = _newton_step(at.jacobian(y[active], numbers[active]), r[active])
        t, left = 1.0, np.arange(len(active))
        while len(left) and t > SHORTEST_STEP:
            k = active[left]
            trial = y[k] + t * step[left]
            r_trial = trial + at.displacement(trial, numbers[k]) - x[k]
            error_trial = lengths_of(r_trial)
            good = error_trial < error[k]
            y[k[good]], r[k[good]], error[k[good]] = trial[good], r_trial[good], error_trial[good]
            t, left = t / 2, left[~good]
        active = np.delete(active, left)  # those are stuck
        active = active[error[active] > tolerance]
    return y, error


def _newton_step(jacobian: Floats, r: Floats) -> Floats:
    """Minus the inverse of 1 + dD/dx (n, dim, dim), times the residual; finite also where there is no inverse."""
    a = one_plus(np.moveaxis(jacobian, 0, -1))
    det = determinant(a)
    size = np.sqrt(np.einsum("mkn,mkn->mn", a, a)).prod(axis=0)
    singular = ~(np.abs(det) > _SINGULAR * size)
    step = -np.einsum("mkn,nk->nm", adjugate(a), r) / np.where(singular, 1.0, det)[:, None]
    if singular.any():
        b = np.moveaxis(a[:, :, singular], -1, 0)
        normal = np.einsum("nki,nkj->nij", b, b)
        damping = 1e-12 * np.trace(normal, axis1=1, axis2=2) + 1e-300  # a trace of it: Newton's speed is preserved
        normal += damping[:, None, None] * np.eye(b.shape[1])
        step[singular] = -np.linalg.solve(normal, np.einsum("nki,nk->ni", b, r[singular])[..., None])[..., 0]
    return step
