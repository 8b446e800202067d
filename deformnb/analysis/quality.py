"""Goodness of fit: residuals, leave-one-out errors, possible outliers, and bending energy.

The leave-one-out error of a control point is the distance between its displacement and the prediction of the others.
No fit is made for that. With C of :mod:`deformnb.analysis.gaussian_process`, leaving point i out of the system changes
C by ``C_i C_i^T / C_ii``, and the others' prediction misses its displacement by

    e_i = [C (d - X A_i^T)]_i / C_ii

with A_i the linear part of the trend of the others. It comes from the same rule as the fit's own, of the matrices
``X^T C X`` and ``d^T C X`` less what point i gives to them, so this holds for the rigid trend too, which is not linear.
The support is held at its value: it is chosen by a person, or from the box of all points.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb._jax import float64, jax, jit
from deformnb._typing import Floats
from deformnb.analysis.gaussian_process import FitSystem, fit_system, process_scale
from deformnb.rbf.conditioning import SAME_PLACE, diameter_of, same_place
from deformnb.rbf.evaluation import capacity
from deformnb.rbf.fitting import fit_one_system
from deformnb.rbf.kernels import KernelName
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import (
    THIN_BEND,
    TRENDS,
    Span,
    TrendName,
    products,
    regularize_moments,
    ridge_of,
    thin_directions,
)

# Points whose leverage comes this near to 1 carry a dimension of the span alone: without them the trend is another.
_ALONE = 1e-9

STRAIN = 0.5
"""Leave-one-out errors of this share of the distance to the nearest point require a strain that is near to a fold."""

# An error must stand out from those of the other points, or all of them disagree and none is to blame. Measured in
# standard deviations of the others' prediction: errors at the edge of a set are large without a mistake. Of
# 640 sets with two landmarks swapped this named both in 96 to 100 of 100, against 86 to 99 by plain lengths.
_STANDS_OUT = 2.0
_MOST_SUSPECTS = 16


@dataclass(frozen=True, eq=False)
class FitQuality:
    """Goodness of fit of control points. Arrays have one row for each active point.

    Parameters
    ----------
    ids : of the active points, in order.
    residual : (N, dim) D(target) - (source - target), of smoothing; zero but for rounding without it.
    leave_one_out : (N, dim) source - target less the displacement of the target in the fit of all other points.
    disagreement : (N,) length of that over the distance to the nearest target at another place: the strain that this
        point alone requires. Zero for a single point.
    suspects : ids of points that disagree with their neighbours; see :func:`fit_quality`.
    energy : alpha^T Phi alpha of all components, in squared lengths: the squared norm of the bending part in the
        kernel's own space. Comparable between fits of one kernel and support. NaN with individual radii.
    sigma : scale of the Gaussian process with the same kernel, physical; NaN where the trend takes all there is.
    affine_share : share from 0 to 1 of the squared drags that one affine map of the sources explains; 1 without drags.
    non_affine : (N, dim) target less that affine map of the source.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9]], [[0, 0], [9, 0], [0, 9], [11, 9]])
    >>> round(fit_quality(points, trend="translation").root_mean_square, 3)
    1.151
    """

    ids: tuple[int, ...]
    residual: Floats
    leave_one_out: Floats
    disagreement: Floats
    suspects: tuple[int, ...]
    energy: float
    sigma: float
    affine_share: float
    non_affine: Floats

    @property
    def root_mean_square(self) -> float:
        """Root of the mean squared length of the leave-one-out errors; 0 without points."""
        return float(np.sqrt((self.leave_one_out**2).sum() / max(1, len(self.ids))))


def fit_quality(
    points: ControlPoints,
    *,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
) -> FitQuality:
    """Assess the fit that :func:`~deformnb.rbf.fitting.fit_rbf` makes of these points.

    A point is suspect if the others' prediction misses it by at least half of the distance to the nearest other point,
    and, in units of the others' uncertainty there, by twice the median of all points at least. The one whose
    leaving-out eases the fit most is named and left out, then the rest are checked again, so that the neighbours of a
    wrong point are not marked for it. No point is marked where fewer than two points are dragged, or with fewer than
    dim + 4 points: a long drag among four corners that hold the picture is no mistake. Nor is a point blamed that is
    not dragged and is on the convex hull of all: it fixes the rim, where the others only extrapolate.

    Parameters
    ----------
    points, kernel, support, trend, smoothing : as for the fit.

    Raises
    ------
    DeformError
        Where the fit does, and if no point is active.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> square = [[0, 0], [10, 0], [0, 10], [10, 10], [5, 5]]
    >>> moved = [[0, 0], [10, 0], [0, 10], [10, 10], [9, 5]]
    >>> fit_quality(ControlPoints.from_arrays(square, moved)).root_mean_square > 1
    True
    """
    options: dict[str, Any] = {"kernel": kernel, "trend": trend, "smoothing": smoothing}
    active = points.take(np.flatnonzero(points.active))
    if len(active) and not active.displacement.any():
        fit_one_system(points, support=support, **options)  # raises the error of another set
        zero = np.zeros(active.target.shape)
        return FitQuality(active.ids, zero, zero, np.zeros(len(active)), (), 0.0, 0.0, 1.0, zero)
    system = fit_system(points, support=support, **options)
    unit = system.ready.support
    row, alone = _rows_of(system, active), _alone(system)
    errors = unit * _leave_one_out(system, alone)[row]
    for k in np.flatnonzero((row < 0) | alone[row]).tolist():
        rest = fit_one_system(active.remove(active.ids[k]), support=unit, **options)
        errors[k] = active.displacement[k] - rest.displacement(active.target[k])
    share, non_affine = affine_split(active)
    nearest = scipy.spatial.cKDTree(system.x).query((active.target - system.ready.origin) / unit)[1]
    gaps = unit * _gaps(system.x)[nearest]  # to another place: points that share one would be infinitely close
    return FitQuality(
        active.ids,
        _residual(system, active),
        errors,
        _lengths(errors) / gaps,
        _suspects(system, active),
        _energy(system),
        process_scale(system),
        share,
        non_affine,
    )


def affine_split(points: ControlPoints) -> tuple[float, Floats]:
    """The share of the squared drags that one affine map of the sources explains, and the rest (N, dim) of each."""
    p = np.concatenate([np.ones((len(points), 1)), points.source - points.source.mean(axis=0)], axis=1)
    drags = points.target - points.source
    rest = drags - p @ np.linalg.lstsq(p, drags, rcond=None)[0]
    total = float((drags**2).sum())
    return (float(np.clip(1 - (rest**2).sum() / total, 0.0, 1.0)) if total else 1.0), rest


def bending_energy(points: ControlPoints) -> float:
    """Bending of the thin-plate spline that takes the sources of the active points to their targets (Bookstein).

    It is the integral of all squared second derivatives of that map, for any kernel of the fit: zero
    for affine maps, without a unit in the plane and a length in space; infinite where one source has two targets.
    F. L. Bookstein, IEEE PAMI 11 (1989) 567-585. With U = r^2 log r in the plane and U = -r in space, whose iterated
    Laplacians are 8 pi times a unit mass, it is 8 pi tr(Y^T C Y).

    Examples
    --------
    >>> square = [[0, 0], [1, 0], [0, 1], [1, 1]]
    >>> bending_energy(ControlPoints.from_arrays(square, [[0, 0], [2, 0], [0, 1], [2, 1]])) < 1e-12
    True
    >>> round(bending_energy(ControlPoints.from_arrays(square, [[0, 0], [1, 0], [0, 1], [1.1, 1]])), 4)
    0.0906
    """
    active = points.take(np.flatnonzero(points.active))
    if len(active) <= points.dim + 1:
        return 0.0
    size = diameter_of(active.source) or 1.0
    x, first = np.unique(np.round(active.source / (SAME_PLACE * size)), axis=0, return_index=True)
    y = active.target[first]
    if len(x) < len(active) and not _same_targets(active, size):
        return float("inf")
    x = (active.source[first] - active.source.mean(axis=0)) / size
    r2 = ((x[:, None] - x[None]) ** 2).sum(axis=-1)
    u = 0.5 * r2 * np.log(np.where(r2 > 0, r2, 1.0)) if points.dim == 2 else -np.sqrt(r2)
    # C on the complement of the affine maps, where U is definite: Z (Z^T U Z)^-1 Z^T
    p = np.concatenate([np.ones((len(x), 1)), x], axis=1)
    left, sigma, _ = np.linalg.svd(p)
    z = left[:, int((sigma > 1e-7 * sigma[0]).sum()) :]
    inner = z.T @ ((y - y.mean(axis=0)) / size)
    return float(8 * np.pi * (inner * np.linalg.solve(z.T @ u @ z, inner)).sum() * size ** (points.dim - 2))


def _same_targets(points: ControlPoints, size: float) -> bool:
    pairs = scipy.spatial.cKDTree(points.source).query_pairs(SAME_PLACE * size, output_type="ndarray")
    return bool((_lengths(points.target[pairs[:, 0]] - points.target[pairs[:, 1]]) <= SAME_PLACE * size).all())


# ---- leave-one-out ---------------------------------------------------------------------------------------------------


def _rows_of(system: FitSystem, active: ControlPoints) -> NDArray[np.int64]:
    """The row of the system that is a point's own; -1 for points that share a place, one of which may go."""
    place = {i: k for k, i in enumerate(system.ready.ids)}
    row = np.array([place.get(i, -1) for i in active.ids])
    if len(active) > system.count:
        near = scipy.spatial.cKDTree(active.target).query_pairs(
            same_place(active, system.ready.support), output_type="ndarray"
        )
        row[np.unique(near)] = -1
    return row


def _alone(system: FitSystem) -> NDArray[np.bool_]:
    """The rows without which the fit would be of another kind (the rest span less, or have one radius), and no rows."""
    kept, n = system.kept, int(system.kept.sum())
    alone = ~kept if n > 1 else np.ones(len(kept), dtype=bool)
    if n > 1 and system.ready.trend not in ("none", "translation"):
        on_span = system.x @ system.ready.span.basis * kept[:, None]
        q = np.linalg.qr((on_span - on_span.sum(axis=0) / n) * kept[:, None])[0]
        alone |= (q**2).sum(axis=1) + 1 / n > 1 - _ALONE
    if n > 1 and system.ready.trend == "quadratic":
        alone |= kept & _essential_rows(system)
    if system.has_own_radii:
        different = kept & (np.asarray(system.fit.scales)[: len(kept)] != 1)
        alone |= different if different.sum() == 1 else False
    return np.asarray(alone)


def _essential_rows(system: FitSystem) -> NDArray[np.bool_]:
    """The rows without which the others do not determine all of the quadratic trend, whose open part shrinks."""
    if system.has_own_radii:
        return np.ones(system.count, dtype=bool)
    kept = system.kept[:, None]
    p = np.linalg.qr(np.concatenate([np.ones((system.count, 1)), system.x], axis=1) * kept)[0]
    rest = products(system.x) * kept
    rest = rest - p @ (p.T @ rest)
    share = np.maximum(1 - (p**2).sum(axis=1), _ALONE)
    grams = rest.T @ rest - rest[:, :, None] * rest[:, None, :] / share[:, None, None]
    values = np.linalg.eigvalsh(grams)
    is_open = values[:, 0] < (1 + _ALONE) * THIN_BEND**2 * values[:, -1]
    if system.fit.kernel.order < 2:
        is_open |= ridge_of(*thin_directions(*_leave_one_out_moments(system))).any(axis=(1, 2))
    return np.asarray(is_open)


def _leave_one_out(system: FitSystem, alone: NDArray[np.bool_]) -> Floats:
    """The leave-one-out errors (n, dim) in units of the support, all together; zero for the points left ``alone``."""
    c = system.energy
    diagonal = np.where(alone, 1.0, c.diagonal())[:, None]
    cd = c @ system.d
    if system.has_own_radii:
        errors = _least_squares_errors(system, alone, cd) / diagonal
    elif system.has_second_step:
        errors = (cd - np.einsum("imk,ik->im", _linear_parts(system, alone), c @ system.x)) / diagonal
    else:
        errors = cd / diagonal
    return np.where(alone[:, None], 0.0, errors)


def _least_squares_errors(system: FitSystem, alone: NDArray[np.bool_], cd: Floats) -> Floats:
    """C_ii e_i with individual radii: the trend of the others is plain least squares and has no C."""
    if system.ready.trend == "none":
        return cd
    x, d = (a * system.kept[:, None] for a in (system.x, system.d))
    linear = _linear_parts(system, alone) if system.has_second_step else np.zeros((len(x), system.dim, system.dim))
    others = [(a.sum(axis=0) - a) / max(1, int(system.kept.sum()) - 1) for a in (d, x)]
    constant = others[0] - np.einsum("imk,ik->im", linear, others[1])
    cx, c1 = system.energy @ x, system.energy.sum(axis=1, keepdims=True)
    return np.asarray(cd - np.einsum("imk,ik->im", linear, cx) - c1 * constant)


def _linear_parts(system: FitSystem, alone: NDArray[np.bool_]) -> Floats:
    """The linear parts A_i (n, dim, dim) of the trends of all points but the i-th."""
    n, dim, x, d = system.count, system.dim, system.x, system.d
    g = system.gram
    gx, gd, weight = g @ x, g @ d, np.where(alone, 1.0, g.diagonal())[:, None, None]
    s = x.T @ gx - gx[:, :, None] * gx[:, None, :] / weight
    h = s + d.T @ gx - gd[:, :, None] * gx[:, None, :] / weight
    ridge = np.zeros((n, dim, dim))
    if system.ready.trend == "affine":  # shrunk across the directions in which the others are thin
        xx, yy, yx = _leave_one_out_moments(system)
        xx, yy, yx = (np.where(alone[:, None, None], np.eye(dim), m) for m in (xx, yy, yx))
        ridge = ridge_of(*thin_directions(xx, yy, yx))
        if not system.has_own_radii:
            with float64():
                s, h = (np.asarray(m) for m in regularize_moments((s, h), (xx, yx), ridge))
    both = np.broadcast_to(np.eye(dim), (3, capacity(n), dim, dim)).copy()  # padded, so that few sizes are compiled
    both[:, :n] = np.where(alone[None, :, None, None], both[:, :n], np.stack([s, h, ridge]))
    both[2, n:] = 0.0
    with float64():
        found = _rules(*both, system.ready.span.basis, trend=system.ready.trend)
    return np.asarray(found)[:n] - np.eye(dim)


def _leave_one_out_moments(system: FitSystem) -> tuple[Floats, Floats, Floats]:
    """Second moments (n, dim, dim) of targets, of sources, and of both, of all points but the i-th."""
    n = int(system.kept.sum())
    x, y = (
        np.where(system.kept[:, None], a - a[system.kept].mean(axis=0), 0.0) for a in (system.x, system.x + system.d)
    )
    share = n / max(1, n - 1)
    left = [p.T @ q - share * p[:, :, None] * q[:, None, :] for p, q in ((x, x), (y, y), (y, x))]
    return left[0], left[1], left[2]


def _all_rules(s: Any, h: Any, ridge: Any, basis: Any, *, trend: str) -> Any:
    rule, turn = TRENDS[trend].linear, jax.numpy.eye(s.shape[-1], dtype=s.dtype)
    assert rule is not None
    return jax.vmap(lambda one, other, held: rule(one, other, Span(basis, held), turn))(s, h, ridge)


_rules = jit(_all_rules, static_argnames="trend")


def _suspects(system: FitSystem, active: ControlPoints) -> tuple[int, ...]:
    """Ids of the points that disagree with the rest; of several at one place the first represents all."""
    if np.count_nonzero(active.displacement.any(axis=1)) < 2:
        return ()
    found: set[int] = set()
    ids, gaps, holds = np.array(system.ready.ids), _gaps(system.x), _rim_mask(system)
    while system.kept.sum() >= system.dim + 4 and len(found) < _MOST_SUSPECTS:
        lengths = _lengths(_leave_one_out(system, _alone(system)))
        eased = np.sqrt(np.abs(system.energy.diagonal())) * lengths  # its square is the fall of the energy without it
        marked = ~holds & (lengths >= STRAIN * gaps) & (eased >= _STANDS_OUT * np.median(eased[system.kept]))
        if not marked.any():
            break
        k = int(np.where(marked, eased, -1.0).argmax())
        found.add(int(ids[k]))
        system = system.leave_out(k)
    return tuple(i for i in active.ids if i in found)


def _rim_mask(system: FitSystem) -> NDArray[np.bool_]:
    """Mask of the places that are not dragged and on the convex hull of all."""
    holds = np.zeros(system.count, dtype=bool)
    with contextlib.suppress(scipy.spatial.QhullError):  # all on one line, or in one plane of space
        holds[scipy.spatial.ConvexHull(system.x).vertices] = True
    return holds & ~system.d.any(axis=1)


# ---- the rest --------------------------------------------------------------------------------------------------------


def _residual(system: FitSystem, active: ControlPoints) -> Floats:
    if system.count < len(active):
        return np.asarray(system.fit.displacement(active.target) - active.displacement)
    fit, n = system.fit, system.count
    at_points = (
        system.phi @ np.asarray(fit.coefficients)[:n]
        + system.x @ np.asarray(fit.polynomial.linear).T
        + fit.polynomial.constant
    )
    if fit.polynomial.quadratic is not None:
        at_points = at_points + np.einsum("nk,mkj,nj->nm", system.x, fit.polynomial.quadratic, system.x)
    return np.asarray(at_points - active.displacement)


def _energy(system: FitSystem) -> float:
    if system.has_own_radii:
        return float("nan")
    alpha = np.asarray(system.fit.coefficients)[: system.count]
    return max(0.0, float((alpha * (system.phi @ alpha)).sum()))


def _gaps(x: Floats) -> Floats:
    """Distance of every place to the nearest other one; infinite if there is none."""
    if len(x) < 2:
        return np.full(len(x), np.inf)
    distance, _ = scipy.spatial.cKDTree(x).query(x, k=2)
    return np.maximum(np.asarray(distance)[:, 1], np.finfo(float).tiny)


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt((vectors**2).sum(axis=-1)))
