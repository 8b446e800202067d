"""The support radius of control points: chosen, by a rule, or the usual one; its limits.

A step without a support of its own takes, in this order: what :func:`choose_support` found when its points were added
or removed (``chosen_support``), the usual share of the box of the points (:func:`usual_support`), and for points at one
place a share of the volume (:func:`lone_support`).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import is_finite, shown_value
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import LARGEST_SET, at_rest, box_diagonal, prepare
from deformnb.rbf.interpolant import MOST_LEFT_OUT, left_out, parameters_of, solve_prepared
from deformnb.rbf.kernels import AbstractKernel, kernel_named
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import THIN, are_wide, spreads_of, trend_named
from deformnb.volume.volume import Grid

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
"""Settings that the chosen support depends on, besides the points."""


MANY = 1000
"""More points than this get a support that reaches :data:`MOST_NEIGHBOURS`: solves and sums stay fast."""

MOST_NEIGHBOURS = 64
"""Neighbours within the support of one of many points that are spread evenly: sums of float32 were right to 1e-4 of a
pixel with 50, and to 0.07 with half of 2048."""


def longest_support(points: ControlPoints, kernel: type[AbstractKernel]) -> float:
    """The longest support that may be chosen for control points at several places: limited in thin directions.

    A wide kernel extrapolates across a row of points (in space: across a flat set too) more wildly the more points
    the row has; half of its length keeps the map beside it calm, and for smooth kernels a number of gaps. Of more than
    :data:`MANY` points each reaches :data:`MOST_NEIGHBOURS`.
    """
    places = at_rest(points)
    is_wide = are_wide(places - places.mean(axis=0), np.zeros_like(places))
    wide = points.dim if is_wide else int((spreads_of(places, places)[1] >= THIN).sum())
    gaps, size = max(1.0, len(places) ** (1 / wide) - 1), box_diagonal(points) or np.inf
    longest = np.inf
    if len(places) > MANY and kernel.order < 2:
        ball = (2.0, np.pi, 4 / 3 * np.pi)[wide - 1]
        longest = size / np.sqrt(wide) / gaps * (MOST_NEIGHBOURS / ball) ** (1 / wide)
    if wide < points.dim:
        longest = min(longest, size * min(0.5, kernel.gaps / gaps))
    return longest


def usual_support(points: ControlPoints, kernel: type[AbstractKernel]) -> float | None:
    """The usual support of points: a fixed share of their box; None for points at one place."""
    size = box_diagonal(points)
    return size and min(kernel.shares[len(kernel.shares) // 2] * size, longest_support(points, kernel))


def choose_support(sets: Sequence[ControlPoints], *, kernel: str | type[AbstractKernel] = "wendland_c2",
                   trend: str = "affine", smoothing: float = 0.0, current: float | None = None) -> float | None:
    """The support radius for sets of control points by which they predict each other best.

    Of the kernel's candidates, which are shares of the diagonal of the points' box, the one with the least mean squared
    leave-one-out error is found, and then the longest that is worse by no more than one standard error of the paired
    differences ("one standard error rule"), if the map does not fold between the points. The choice belongs to the
    moment when points are added or removed: chosen anew during a drag, the map would jump.

    With dim + 2 dragged points or fewer (with the quadratic trend one more than it has parameters) it is a fixed share
    of the diagonal: one drag among points that are held gives no evidence of its range, and the errors of so few with
    an affine trend are the same for every support. Points in a row (in space: in a flat set too) get no more than half
    of it, and of more than 2000 points none is left out; see :func:`longest_support`.

    Parameters
    ----------
    sets : of one dimension, fitted with the same support each on its own; inactive points are left out.
    kernel, trend, smoothing : as for :func:`~deformnb.rbf.fitting.fit_rbf`.
    current : the radius of the points before some were added or removed: it stays where it is worse by no more than one
        standard error, so that the map stays as it is.

    Returns
    -------
    The radius in physical units; None if all points are at one place.

    Examples
    --------
    >>> square = [[0, 0], [40, 0], [0, 30], [40, 30]]
    >>> choose_support([ControlPoints.from_arrays(square)])
    50.0
    """
    kind = kernel_named(kernel)
    used = [points.take(np.flatnonzero(points.active)) for points in sets if points.active.any()]
    sizes = [size for points in used if (size := box_diagonal(points))]
    if not sizes:
        return None
    limit = min(longest_support(points, kind) for points in used)
    usual = min(kind.shares[len(kind.shares) // 2] * max(sizes), limit)
    radii = [share * max(sizes) for share in kind.shares if share * max(sizes) <= limit]
    informative = [points for points in used if np.count_nonzero(points.displacement.any(axis=1)) > 1 + parameters_of(
        trend, points.dim)]
    if len(radii) < 2 or not informative or max(map(len, used)) > LARGEST_SET:
        return usual
    errors = {}
    if current is not None and current <= limit:
        radii.append(current)
    for radius in radii:
        with contextlib.suppress(np.linalg.LinAlgError, DeformError):  # the fit itself raises the error
            errors[radius] = np.concatenate([_squared_errors(points, radius, kind, trend, smoothing)
                                             for points in informative])
    if not errors:
        return usual
    best = min(errors, key=lambda radius: float(errors[radius].mean()))
    excess = {radius: squared - errors[best] for radius, squared in errors.items()}
    alike = 1e-9 * float(errors[best].mean())  # what differs by rounding only is as good
    near = [r for r, e in excess.items() if e.mean() <= e.std(ddof=1) / np.sqrt(len(e)) + alike]
    for radius in sorted(near, key=lambda radius: (radius == current, radius), reverse=True):
        with contextlib.suppress(DeformError):
            fits = (solve_prepared(prepare(points, kind, radius, trend_named(trend), smoothing), kind, smoothing, None)
                    for points in informative)
            if not any(fit.folds_between_points() for fit in fits):
                return radius
    return max(near)


def _squared_errors(points: ControlPoints, radius: float, kernel: type[AbstractKernel], trend: str,
                    smoothing: float) -> NDArray[np.float64]:
    """Squared lengths of the leave-one-out errors of active points."""
    if len(points) > MOST_LEFT_OUT:
        points = points.take(np.linspace(0, len(points) - 1, MOST_LEFT_OUT).astype(int))
    ready = prepare(points, kernel, radius, trend_named(trend), smoothing)
    is_shrunk = ready.trend in ("affine", "quadratic") and ready.span.ridge.any()
    errors = left_out((ready.targets - ready.origin) / radius, ready.displacements, kernel,
                      "similarity" if is_shrunk and kernel.order < 3 else ready.trend, smoothing / ready.weights)
    return np.asarray((errors**2).sum(axis=1))[ready.place_of]  # as many for each radius, though merged for some


def check_support(support: Any) -> None:
    """Raise a DeformError unless this is a support radius, the name of a rule or None."""
    if support is None or (isinstance(support, str) and support in SUPPORT_RULES):
        return
    if not (is_finite(support) and support > 0):
        raise DeformError("the support radius must be a positive length, None or one of "
                          f"{', '.join(SUPPORT_RULES)}, got {shown_value(support)}.")
