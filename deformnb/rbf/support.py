"""The support radius of control points: chosen, by a rule, or the usual one; its limits.

A step without its own support takes, in this order: what :func:`choose_support` found when its points were added
or removed (``chosen_support``), the usual share of the diameter of the points (:func:`usual_support`), and for points
at one place a share of the volume (:func:`lone_support`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import is_finite, short_value
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import (
    LARGEST_SET,
    SAME_DISTANCE,
    box_diagonal,
    diameter,
    diameter_of,
    prepare,
    resting_places,
)
from deformnb.rbf.cross_validation import balls_of, gap_of, parameters_of, prediction_errors, sample_of
from deformnb.rbf.interpolant import probe_places, solve_prepared
from deformnb.rbf.kernels import AbstractKernel, as_kernel
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import THIN, are_wide, find_trend, spreads_of
from deformnb.volume.volume import Grid

SupportRuleName: TypeAlias = Literal["box_diagonal"]
"""Names of the rules for a support radius."""

SUPPORT_RULES: dict[str, Callable[[ControlPoints], float | None]] = {"box_diagonal": box_diagonal}
"""Supports by rule instead of by number: what each makes of a set of control points."""


def lone_support(grid: Grid) -> float:
    """The support radius of points that do not determine one, such as one point without trend.

    A quarter of the volume's diagonal is a bump that one can see and grab.
    """
    return 0.25 * grid.diagonal


class ChosenSupport(NamedTuple):
    """A support radius in physical units, and the name of the kernel that it was chosen for."""

    radius: float
    kernel: str


CHOOSE_SUPPORT = frozenset({"kernel", "trend", "smoothing", "support", "direction"})
"""Settings that the chosen support depends on, in addition to the points."""


# Errors that differ by less than this share are equivalent, for any noise.
_ALIKE = 0.1


def longest_support(points: ControlPoints, kernel: type[AbstractKernel]) -> float:
    """The longest support that may be chosen for control points at several places: limited in thin directions.

    A wide kernel extrapolates across a row of points (in space: across a flat set too) more wildly the more points
    the row has; half of its length makes the map next to it smooth, and for smooth kernels a number of gaps.
    """
    places = resting_places(points)
    if are_wide(places - places.mean(axis=0), np.zeros_like(places)):
        return np.inf
    wide = int((spreads_of(places, places)[1] >= THIN).sum())
    if wide == points.dim:
        return np.inf
    gaps = max(1.0, len(places) ** (1 / wide) - 1)
    return diameter_of(places) * min(0.5, kernel.gaps / gaps)


def shortest_support(points: ControlPoints) -> float:
    """The shortest support that may be chosen: the distance at which the points hang together (:func:`gap_of`).

    With less some of them would reach no neighbour, and the map would be a needle at each of these.
    """
    places = resting_places(points)
    return gap_of(places[sample_of(places)])


def usual_support(points: ControlPoints, kernel: type[AbstractKernel]) -> float | None:
    """The usual support of points: a fixed share of their diameter; None for points at one place."""
    size = diameter(points)
    if size is None:
        return None
    usual = kernel.shares[len(kernel.shares) // 2] * size
    return min(usual if usual >= size else max(usual, shortest_support(points)), longest_support(points, kernel))


def choose_support(
    sets: Sequence[ControlPoints],
    *,
    kernel: str | type[AbstractKernel] = "wendland_c2",
    trend: str = "affine",
    smoothing: float = 0.0,
    current: float | None = None,
) -> float | None:
    """The support radius for sets of control points by which they predict best what no point is at.

    Candidates are the kernel's shares of the diameter of the set (the largest distance between two points) that are not
    below the distance at which the points hang together. Of each the errors are found at every point that is left out
    alone, and at the middle of every ball that is left out whole, as wide as the widest gap between points
    (:mod:`deformnb.rbf.cross_validation`). Those are equal whose mean square is worse than the least by no more than
    one standard error of the paired differences, or whose root is by no more than a tenth; the longest of these is
    taken that solves and does not fold between the points; if none of them solves, as of a flat kernel for a thousand
    points, the longest of all that does. The choice is made when points are added or
    removed: chosen again during a drag, the map would jump.

    With dim + 2 dragged points or fewer (with the quadratic trend one more than it has parameters) it is a fixed share
    of the diameter: one drag among points that are held gives no evidence of its range, and the errors of so few with
    an affine trend are the same for every support. Points in a row (in space: in a flat set too) get no more than half
    of it (:func:`longest_support`), and of more than 2000 points none is left out.

    Parameters
    ----------
    sets : of one dimension, fitted separately with the same support; inactive points are left out.
    kernel, trend, smoothing : as for :func:`~deformnb.rbf.fitting.fit_rbf`.
    current : the radius of the points before some were added or removed: it stays where it is as good, so that the map
        stays as it is.

    Returns
    -------
    The radius in physical units; None if all points are at one place.

    Examples
    --------
    >>> square = [[0, 0], [40, 0], [0, 30], [40, 30]]
    >>> choose_support([ControlPoints.from_arrays(square)])
    50.0
    """
    kind = as_kernel(kernel)
    used = [points.subset(np.flatnonzero(points.active)) for points in sets if points.active.any()]
    sizes = [size for points in used if (size := diameter(points))]
    if not sizes:
        return None
    limit = min(longest_support(points, kind) for points in used)
    least = min(limit, max(map(shortest_support, used)))
    usual = max(least, min(kind.shares[len(kind.shares) // 2] * max(sizes), limit))
    radii = [share * max(sizes) for share in kind.shares if _is_within(share * max(sizes), least, limit)]
    informative = [
        points
        for points in used
        if np.count_nonzero(points.displacement.any(axis=1)) > 1 + parameters_of(trend, points.dim)
    ]
    if len(radii) < 2 or not informative or max(map(len, used)) > LARGEST_SET:
        return usual
    if current is not None and _is_within(current, least, limit):
        radii.append(current)
    near = _equivalent_radii(_errors_of(informative, radii, kind, trend, smoothing))
    near, solved = near or [usual], list[float]()
    for radius in sorted({*radii, usual}, key=lambda radius: (radius in near, radius == current, radius), reverse=True):
        if solved and radius not in near:  # worse ones are for points that no better one solves
            break
        with contextlib.suppress(DeformError):
            folds = any(_folds(points, radius, kind, trend, smoothing) for points in informative)
            solved.append(radius)
            if radius not in near or not folds:
                return radius
    return solved[0] if solved else max(near)


def _is_within(radius: float, least: float, most: float) -> bool:
    return least * (1 - SAME_DISTANCE) <= radius <= most * (1 + SAME_DISTANCE)


def _errors_of(
    sets: Sequence[ControlPoints], radii: Sequence[float], kernel: type[AbstractKernel], trend: str, smoothing: float
) -> dict[float, NDArray[np.float64]]:
    """Squared errors of prediction of all sets together by radius; radii that cannot be fitted are missing."""
    errors, balls = {}, dict[Any, Any]()
    for radius in radii:
        with contextlib.suppress(np.linalg.LinAlgError, DeformError):  # the fit itself raises the error
            errors[radius] = np.concatenate(
                [_squared_errors(points, radius, kernel, trend, smoothing, balls) for points in sets]
            )
    if not errors:
        return {}
    known = np.isfinite(np.stack(list(errors.values()))).all(axis=0)
    return {radius: squared[known] for radius, squared in errors.items()} if known.sum() > 1 else {}


def _equivalent_radii(errors: Mapping[float, NDArray[np.float64]]) -> list[float]:
    """The radii whose errors are those of the best one, but for their noise or a tenth."""
    if not errors:
        return []
    best = min(errors, key=lambda radius: float(errors[radius].mean()))
    least = float(errors[best].mean())
    excess = {radius: squared - errors[best] for radius, squared in errors.items()}
    return [
        radius
        for radius, e in excess.items()
        if e.mean() <= max(e.std(ddof=1) / np.sqrt(len(e)), ((1 + _ALIKE) ** 2 - 1) * least)
    ]


def _folds(points: ControlPoints, radius: float, kernel: type[AbstractKernel], trend: str, smoothing: float) -> bool:
    """Check whether the map of active points folds at or between them, or between a sample of many."""
    ready = prepare(points, kernel, radius, find_trend(trend), smoothing)
    fit = solve_prepared(ready, kernel, smoothing, None)
    if fit.missed > ready.missed:
        raise DeformError("a support with which the points are missed is no choice.")
    sample = sample_of(ready.targets)
    return (
        fit.folds_at(probe_places(ready.targets[sample])) if len(sample) < ready.count else (fit.folds_between_points())
    )


def _squared_errors(
    points: ControlPoints,
    radius: float,
    kernel: type[AbstractKernel],
    trend: str,
    smoothing: float,
    known: dict[Any, Any],
) -> NDArray[np.float64]:
    """Squared lengths of the errors of active points that are left out, alone and with those around them.

    Parameters
    ----------
    known : the balls of places that were found for other radii; those of these are added.
    """
    sample = sample_of(resting_places(points))
    if len(sample) < len(points):
        points = points.take(sample)
    if not len(points):
        raise DeformError("points that are all equally far from their centroid are not sampled.")
    ready = prepare(points, kernel, radius, find_trend(trend), smoothing)
    is_shrunk = ready.trend in ("affine", "quadratic") and ready.span.ridge.any()
    rule = "similarity" if is_shrunk and kernel.order < 3 else ready.trend
    key = ready.targets.tobytes(), ready.trend
    if key not in known:
        known[key] = balls_of(ready.targets - ready.origin, 1 + parameters_of(ready.trend, points.dim))
    balls = known[key]
    errors = radius * prediction_errors(
        ready.relative, ready.displacements / radius, kernel, rule, smoothing / ready.weights, balls
    )
    return np.asarray(errors[ready.place_of] ** 2).ravel()  # as many for each radius, though merged for some


def check_support(support: Any) -> None:
    """Raise a DeformError unless this is a support radius, the name of a rule or None."""
    if support is None or (isinstance(support, str) and support in SUPPORT_RULES):
        return
    if not (is_finite(support) and support > 0):
        raise DeformError(
            "the support radius must be a positive length, None or one of "
            f"{', '.join(SUPPORT_RULES)}, got {short_value(support)}."
        )
