"""Fits of control points, alone (Eqs. 3-4 and 9 of the paper), forward, with rigid parts (Eq. 6), and in stages."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import is_finite, short_value
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import LARGEST_SET, prepare
from deformnb.rbf.fields import AbstractFit, AbstractInterpolant
from deformnb.rbf.forward import FitDirection, ForwardFit, check_direction, orient_points
from deformnb.rbf.interpolant import RBFInterpolant, TooFlatError, solve_prepared
from deformnb.rbf.kernels import AbstractKernel, KernelName, Phi, as_kernel
from deformnb.rbf.partition import SMALL_LEAF, LocalFits, fit_locally, is_wide
from deformnb.rbf.points import ControlPoints, as_control_points
from deformnb.rbf.rigid import SAME_MOTION, RigidInterpolant, RigidPart, drift_and_weight, size_of
from deformnb.rbf.stages import MOST_STAGES, Staged
from deformnb.rbf.support import choose_support
from deformnb.rbf.trends import TRENDS, Trend, TrendName, find_trend


def fit_rbf(
    points: ControlPoints,
    *,
    kernel: KernelName | str | type[AbstractKernel] | AbstractKernel | Phi = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
    previous: AbstractInterpolant | None = None,
) -> RBFInterpolant | LocalFits:
    """Fit the displacement of control points.

    Solves ``[Phi + lambda diag(1/w), P; P^T, 0] [alpha; gamma] = [d; 0]`` (Eqs. 3-4 of the paper; 9 in space) for all
    components together, or its counterpart of least energy for the similarity and rigid trends (Eq. 5, corrected).

    Parameters
    ----------
    points : control points of dimension 2 or 3; inactive ones are left out.
    kernel : a name of :data:`deformnb.rbf.kernels.KERNELS`, a kernel class, a kernel with its support, or a function
        of the relative distance; see :func:`~deformnb.rbf.kernels.register_kernel`.
    support : support radius R in physical units; default is that of ``previous``, if its kernel and its points are the
        same, or else what :func:`~deformnb.rbf.support.choose_support` finds.
    trend : a name of :data:`deformnb.rbf.trends.TRENDS`.
    smoothing : lambda >= 0; 0 interpolates, larger trades exactness for smoothness (dimensionless, 0 to 10 is usual).
    previous : the fit before this one, while points are dragged: its support is reused, and its trend where the points
        leave an angle open.

    Returns
    -------
    RBFInterpolant, with remarks in ``notes`` where the points did not suffice for the trend. More than 2000 points with
    a kernel that has no end, or whose support holds too many of them for one system, are fitted locally
    (:class:`~deformnb.rbf.partition.LocalFits`), with a note; so are fewer whose system is singular, such as those of a
    smooth kernel of which two nearly coincide. A fit that misses its points by more than
    :mod:`~deformnb.rbf.exactness` allows has a note of the amount.

    Raises
    ------
    DeformError
        Naming the points: same place but different displacements, coordinates that are not finite, too many points, a
        kernel that needs a richer trend, a system too ill-conditioned to interpolate.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10]], [[0, 0], [12, 1], [0, 10]])
    >>> fit = fit_rbf(points)
    >>> bool(abs(fit.displacement([12.0, 1.0]) - [-2.0, -1.0]).max() < 1e-12)
    True
    """
    points = as_control_points(points)
    kind, radius = _resolve_kernel(kernel, support)
    chosen = find_trend(trend)
    _check_pairing(kind, chosen, smoothing)
    if points.has_own_radii and kind.order > 0:
        raise DeformError(
            f"control points have individual support radii, and the {kind.name} kernel, which has no "
            "end, has none; choose a Wendland kernel or the Gaussian, or clear their radii."
        )
    if radius is None and previous is not None and previous.kernel is kind:
        same = set(previous.ids) <= set(points.ids) and int(previous.count) == len(previous.ids)
        radius = float(previous.support) if same and len(previous.ids) == int(points.active.sum()) else None
    if radius is None:
        radius = choose_support([points], kernel=kind, trend=trend, smoothing=smoothing)
    ready = prepare(points, kind, radius, chosen, smoothing)
    if len(ready.targets) > LARGEST_SET and (not kind.compact or is_wide(ready)):
        return replace(fit_locally(ready, kind, smoothing), unit=points.unit)
    try:
        solved = solve_prepared(ready, kind, smoothing, previous if isinstance(previous, RBFInterpolant) else None)
        return replace(solved, unit=points.unit) if points.unit else solved
    except TooFlatError as refusal:
        if kind.compact or points.has_own_radii or len(ready.targets) < 2 * SMALL_LEAF:
            raise
        with suppress(TooFlatError):
            return replace(fit_locally(ready, kind, smoothing, leaf=SMALL_LEAF), unit=points.unit)
        raise refusal from None


def fit_one_system(
    points: ControlPoints,
    *,
    kernel: KernelName | str | type[AbstractKernel] | AbstractKernel | Phi = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
) -> RBFInterpolant:
    """:func:`fit_rbf` for what needs the whole system of a fit, which has at most 2000 points.

    Raises
    ------
    DeformError
        As that function does, and if there are more points.
    """
    count = int(as_control_points(points).active.sum())
    if count <= LARGEST_SET:
        fit = fit_rbf(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
        if isinstance(fit, RBFInterpolant):
            return fit
        raise DeformError(
            f"the system of all {count} control points is singular, and the fit is one of "
            f"{len(fit.fits)} local ones; use a smaller support, a Wendland kernel, or a little "
            "smoothing."
        )
    raise DeformError(
        f"{count} control points are more than the {LARGEST_SET} whose whole system can be looked at; "
        "switch some off or thin them out."
    )


def fit_forward(points: ControlPoints, *, previous: ForwardFit | None = None, **settings: Any) -> ForwardFit:
    """Fit control points in the forward direction: the targets as a function of the sources.

    Parameters
    ----------
    points : control points of dimension 2 or 3, as for :func:`~deformnb.rbf.fitting.fit_rbf`.
    previous : the fit before this one, while points are dragged.
    settings : kernel, support, trend and smoothing, as of that function; the support is measured in the input.

    Returns
    -------
    ForwardFit, a backward field like any other.

    Raises
    ------
    DeformError
        As that function does; points at one source with different targets have no fit forward.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9]], [[0, 0], [9, 0], [0, 9], [14, 12]])
    >>> fit_forward(points, kernel="thin_plate")
    <ForwardFit: inverse of <RBFInterpolant: 4 points in the plane, thin_plate, trend affine>>
    """
    turned = orient_points(as_control_points(points), "forward")
    return ForwardFit(fit_rbf(turned, previous=None if previous is None else previous.forward, **settings))


def fit_rigid(
    points: ControlPoints,
    parts: Sequence[RigidPart],
    *,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
) -> RBFInterpolant | LocalFits | RigidInterpolant:
    """Fit control points with rigid parts (Eq. 6).

    Parameters
    ----------
    points : as for :func:`fit_rbf`. A point within a part that requires the motion of the part is left
        out.
    parts : those that are switched on count; without any this is :func:`~deformnb.rbf.fitting.fit_rbf`.
    kernel, support, trend, smoothing : of the fit. The trend is weighted like the rest and moves no part; with the
        weight "distance", which has no end, there is none.

    Returns
    -------
    RigidInterpolant.

    Raises
    ------
    DeformError
        If a point within a part requires something else than the part does; names both.

    Examples
    --------
    >>> from deformnb.rbf.regions import HalfSpace
    >>> ground = RigidPart(HalfSpace((0, 0), (0, -1)), name="ground")  # all below b = 0, with b upwards
    >>> points = ControlPoints.from_arrays([[0, -8]], [[3, -8]])
    >>> fit = fit_rigid(points, [ground], trend="none", support=10.0)
    >>> fit.displacement([[3.0, -8.0], [3.0, 1.0]]).round(9).tolist()
    [[-3.0, 0.0], [0.0, 0.0]]
    """
    points = as_control_points(points)
    chosen = [part for part in parts if part.enabled]
    if not chosen:
        return fit_rbf(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
    raw = _check_weights(chosen, points.dim, kernel)
    back = [np.eye(points.dim) if p.motion is None else np.asarray(p.motion.inverse.matrix) for p in chosen]
    shifts = [np.zeros(points.dim) if p.motion is None else np.asarray(p.motion.inverse.shift) for p in chosen]
    x = points.target
    moved = [x @ m.T + t for m, t in zip(back, shifts, strict=True)]
    distances = np.stack([p.region.signed_distance(y) for p, y in zip(chosen, moved, strict=True)])
    free, notes = _free_points(points, chosen, moved, distances)
    if support is None:
        support = choose_support([points], kernel=kernel, trend=trend, smoothing=smoothing)
    scales = np.array([_scale(p, d[free]) for p, d in zip(chosen, distances, strict=True)])
    weights = tuple(p.weight for p in chosen)
    drift, weight = drift_and_weight(
        x[free], [y[free] for y in moved], [d[free] for d in distances], scales, weights, np
    )
    rest = points.subset(np.flatnonzero(free))
    required = (rest.displacement - drift) / weight[:, None]
    base = fit_rbf(
        replace(rest, source=rest.target + required, weight=rest.weight * weight**2),
        kernel=kernel,
        support=support,
        trend="none" if raw else trend,
        smoothing=smoothing,
    )
    return RigidInterpolant(
        base,
        tuple(p.region for p in chosen),
        np.stack(back),
        np.stack(shifts),
        scales,
        weights,
        (*notes, *base.remarks),
    )


def fit_points(
    points: ControlPoints,
    parts: Sequence[RigidPart] = (),
    *,
    stages: int = 1,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
    direction: FitDirection = "backward",
    previous: AbstractFit | None = None,
) -> AbstractFit:
    """Fit control points, with rigid parts if there are some, in one go or in stages.

    Parameters
    ----------
    points, kernel, support, trend, smoothing : as for :func:`fit_rbf`; every stage has the same support.
    parts : as for :func:`~deformnb.rbf.fitting.fit_rigid`; in several stages none of them may move.
    stages : from 1 to :data:`MOST_STAGES`.
    direction : a name of :data:`~deformnb.rbf.forward.DIRECTIONS`; forward none of the parts may be switched on.
    previous : the fit before this one; where the points leave an angle open, its trend is reused.

    Raises
    ------
    DeformError
        As those functions do; if a part moves in several stages, or occurs with a fit forward; if points meet on
        their way.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9], [4, 4]],
    ...                                    [[0, 0], [9, 0], [0, 9], [9, 9], [9, 5]])
    >>> fit = fit_points(points, stages=8)
    >>> fit.displacement([9.0, 5.0]).round(9).tolist()
    [-5.0, -1.0]
    """
    points = as_control_points(points)
    check_stages(stages, parts)
    check_parts_of_direction(direction, parts)
    settings: dict[str, Any] = {"kernel": kernel, "trend": trend, "smoothing": smoothing}
    if stages == 1:
        if direction == "forward":
            return fit_forward(
                points, support=support, previous=previous if isinstance(previous, ForwardFit) else None, **settings
            )
        if any(part.enabled for part in parts):
            return fit_rigid(points, parts, support=support, **settings)
        last = previous if isinstance(previous, AbstractInterpolant) else None
        return fit_rbf(points, support=support, previous=last, **settings)
    settings["support"] = support or choose_support([orient_points(points, direction)], **settings)
    return Staged(
        tuple(
            _fit_stage(_partial_drag(points, j, stages), parts, direction, settings, j, stages)
            for j in range(1, stages + 1)
        )
    )


def check_stages(stages: Any, parts: Sequence[RigidPart]) -> None:
    """Refuse a number of stages that is impossible, naming the part that prevents it."""
    if isinstance(stages, bool) or not isinstance(stages, int | np.integer) or not 1 <= stages <= MOST_STAGES:
        raise DeformError(
            f"the stages of a step must be a whole number from 1 to {MOST_STAGES}, got {short_value(stages)}."
        )
    moving = next((p for p in parts if p.enabled and p.motion is not None), None)
    if stages > 1 and moving is not None:
        raise DeformError(
            f"{moving.label} has its own motion, which is not done in stages; hold it still, switch "
            "it off, or set the stages of the step back to 1."
        )


def check_parts_of_direction(direction: str, parts: Sequence[RigidPart]) -> None:
    """Refuse an unknown direction, and a rigid part with a fit forward, which has no weight that vanishes at it."""
    check_direction(direction)
    part = next((p for p in parts if p.enabled), None)
    if direction == "forward" and part is not None:
        raise DeformError(
            f"{part.label} cannot be held with a fit forward; set the direction of the step to "
            "backward, or switch the part off."
        )


def _resolve_kernel(
    kernel: str | type[AbstractKernel] | AbstractKernel | Phi, support: float | None
) -> tuple[type[AbstractKernel], float | None]:
    kind = as_kernel(kernel)
    if isinstance(kernel, AbstractKernel):
        return kind, kernel.support if support is None else support
    if support is not None:
        kind(support)  # checks it
    return kind, support


def _check_pairing(kernel: type[AbstractKernel], trend: Trend, smoothing: float) -> None:
    if not (is_finite(smoothing) and smoothing >= 0):
        raise DeformError(f"smoothing must be 0 or a positive number, got {short_value(smoothing)}.")
    if trend.order < kernel.order:
        able = ", ".join(t.name for t in TRENDS.values() if t.order >= kernel.order)
        raise DeformError(
            f"the {kernel.name} kernel is not positive definite and needs a trend of {able}; "
            f"choose that, or a Wendland kernel for the trend {trend.name!r}."
        )


def _check_weights(parts: Sequence[RigidPart], dim: int, kernel: str) -> bool:
    """Check whether one of the weights is the distance itself, which excludes a trend."""
    for part in parts:
        if part.region.dim != dim:
            raise DeformError(f"{part.label} has {part.region.dim} dimensions, the control points in {dim}.")
    raw = any(part.weight == "distance" for part in parts)
    if raw and as_kernel(kernel).order > 0:
        raise DeformError(
            f"with a rigid part of the weight 'distance' there is no trend, and the {kernel} kernel "
            "needs one; take the weight 'saturated' or a Wendland kernel."
        )
    return raw


def _free_points(
    points: ControlPoints,
    parts: Sequence[RigidPart],
    moved: Sequence[NDArray[np.float64]],
    distances: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], list[str]]:
    """Mask of active points outside all parts; refuses one that a part holds and that requires another displacement."""
    free, notes = points.active.copy(), []
    size = size_of(points)
    within = [part.region.signed_distance(points.source) < 0 for part in parts]  # of all points together: a drag waits
    for k in np.flatnonzero(points.active).tolist():
        holders = np.flatnonzero(distances[:, k] <= 0).tolist()
        for h in holders:
            required, done = points.source[k], moved[h][k]
            if np.linalg.norm(required - done) > SAME_MOTION * size:
                held = "is fixed" if parts[h].motion is None else "has its own motion"
                raise DeformError(
                    f"{points.label(k)} is in {parts[h].label}, which {held}; move or remove the "
                    "point, or change the part."
                )
        if len(holders):
            free[k] = False
            if points.displacement[k].any():
                notes.append(f"{points.label(k)} is in {parts[holders[0]].label}, which holds it already")
            continue
        torn = next((p for p, is_within in zip(parts, within, strict=True) if is_within[k]), None)
        if torn is not None:
            notes.append(
                f"{points.label(k)} is dragged in {torn.label}, which does not follow: its tissue is seen twice"
            )
    return free, notes


def _scale(part: RigidPart, distances: NDArray[np.float64]) -> float:
    """The distance at which a part's weight is 1: at the nearest control point at the latest.

    The paper's distance has no such place: it is only scaled to the size of 1, which changes nothing (w -> c w).
    """
    nearest = float(distances.min(initial=np.inf))
    if part.weight == "distance":
        return float(distances.max(initial=0.0)) or 1.0
    return min(part.reach or np.inf, nearest) if np.isfinite(nearest) or part.reach else 1.0


def _partial_drag(points: ControlPoints, j: int, stages: int) -> ControlPoints:
    way = points.target - points.source
    last = points.target if j == stages else points.source + j / stages * way
    return replace(points, source=points.source + (j - 1) / stages * way, target=last.copy())


def _fit_stage(
    points: ControlPoints, parts: Sequence[RigidPart], direction: str, settings: dict[str, Any], j: int, stages: int
) -> AbstractFit:
    try:
        if direction == "forward":
            return fit_forward(points, **settings)
        return fit_rigid(points, parts, **settings)
    except DeformError as error:
        raise DeformError(f"in stage {j} of {stages}, on the straight paths of the points: {error}") from None
