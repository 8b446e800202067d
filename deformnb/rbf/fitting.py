"""The fit of the displacement of control points: Eqs. 3-4 and 9 of the paper."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from deformnb.checks import is_finite, shown_value
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import LARGEST_SET, prepare
from deformnb.rbf.interpolant import RBFInterpolant, TooFlatError, solve_prepared
from deformnb.rbf.kernels import AbstractKernel, Phi, as_kernel
from deformnb.rbf.partition import SMALL_LEAF, LocalFits, fit_locally, is_wide
from deformnb.rbf.points import ControlPoints, as_control_points
from deformnb.rbf.support import choose_support
from deformnb.rbf.trends import TRENDS, Trend, find_trend


def fit_rbf(
    points: ControlPoints,
    *,
    kernel: str | type[AbstractKernel] | AbstractKernel | Phi = "wendland_c2",
    support: float | None = None,
    trend: str = "affine",
    smoothing: float = 0.0,
    previous: RBFInterpolant | LocalFits | None = None,
) -> RBFInterpolant | LocalFits:
    """Fit the displacement of control points.

    Solves ``[Phi + lambda diag(1/w), P; P^T, 0] [alpha; gamma] = [d; 0]`` (Eqs. 3-4 of the paper; 9 in space) for all
    components at once, or its counterpart of least energy for the similarity and rigid trends (Eq. 5, corrected).

    Parameters
    ----------
    points : control points of dimension 2 or 3; inactive ones are left out.
    kernel : a name of :data:`deformnb.rbf.kernels.KERNELS`, a kernel class, a kernel with its support, or a function
        of the relative distance; see :func:`~deformnb.rbf.kernels.register_kernel`.
    support : support radius R in physical units; default is that of ``previous``, if its kernel and its points are the
        same, or else what :func:`~deformnb.rbf.support.choose_support` finds.
    trend : a name of :data:`deformnb.rbf.trends.TRENDS`.
    smoothing : lambda >= 0; 0 interpolates, larger trades exactness for smoothness (dimensionless, 0 to 10 is usual).
    previous : the fit before this one, while points are dragged: its support is kept, and its trend where the points
        leave an angle open.

    Returns
    -------
    RBFInterpolant, with remarks in ``notes`` where the points did not suffice for the trend. More than 2000 points with
    a kernel that has no end, or whose support holds too many of them for one system, are fitted locally
    (:class:`~deformnb.rbf.partition.LocalFits`), with a note; so are fewer whose system is singular, such as those of a
    smooth kernel of which two nearly coincide. A fit that misses its points by more than
    :mod:`~deformnb.rbf.exactness` states says by how much in a note.

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
            f"control points have support radii of their own, and the {kind.name} kernel, which has no "
            "end, knows none; choose a Wendland kernel or the Gaussian, or clear their radii."
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
    kernel: str | type[AbstractKernel] | AbstractKernel | Phi = "wendland_c2",
    support: float | None = None,
    trend: str = "affine",
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
        raise DeformError(f"smoothing must be 0 or a positive number, got {shown_value(smoothing)}.")
    if trend.order < kernel.order:
        able = ", ".join(t.name for t in TRENDS.values() if t.order >= kernel.order)
        raise DeformError(
            f"the {kernel.name} kernel is not positive definite on its own and needs a trend of {able}; "
            f"choose that, or a Wendland kernel for the trend {trend.name!r}."
        )
