"""Local fits blended as a partition of unity: many control points with a kernel that has no end, or a wide support.

A dense system of N points costs N^3. Space is divided in boxes of few points each, halved at the median along their
longest side, and every box has a separate fit of the points within it and around it. The boxes are along the
principal axes of the points and of their displacements, so that they turn with the data. The displacement is

    ``D(x) = sum_k w_k(x) D_k(x) / sum_k w_k(x)``

with w_k a product of smooth steps across the faces of box k, from 0 a margin outside to 1 a margin inside. Every fit
whose w_k is not zero at a control point interpolates it, so the blend does; steps with two continuous derivatives make
it as smooth as the kernel, where taking the nearest points of each place would jump (H. Wendland, Scattered Data
Approximation (2004), chapter 15).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._jax import jax, jnp, lax, pytree
from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import SAME_DISTANCE, PreparedPoints, diameter_of
from deformnb.rbf.fields import AbstractInterpolant
from deformnb.rbf.interpolant import RBFInterpolant, TooFlatError, solve_prepared
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.trends import Span, quadric_span, ridge_of, spread_of, spreads_of

LEAF = 150
"""Points of a box at most; with those around it a fit has a few hundred, which takes milliseconds."""

SMALL_LEAF = 40
"""Points of a box at most where the system of all is singular: terms of a smooth kernel grow with the fifth power of
the number of gaps across a fit, and their differences are lost in rounding."""

_MARGIN = 0.35  # width of the steps across the faces, in sides of the box
_AROUND = 1.6  # how far around a box its fit takes points, in margins: its rim is a guess without them
_LEAST = 60  # points of a fit at least, or all: the nearest ones are added to those of a box
_PROBES = 9  # places where the deviation is measured
_MISSED = 4.0  # times the deviation found is stated: larger ones occur between the probes
_WIDER = 4  # times as many neighbours as a local fit has, in the fit that it is compared with
_WIDEST = 1500  # and so many at most: in space that many solves of N^3 would take longer than all local fits
_MOST_WORK = 3e10  # operations of a whole system; 3100 points of which each reaches all others
_LONGEST = 4.0  # diameters of the points of a fit that a compact kernel's support is at most
_SHORTEST = 0.05  # and at least


@pytree(data_fields=["fits", "low", "high", "margin", "frame", "missed"], meta_fields=["remarks", "ids", "unit"])
@dataclass(frozen=True, eq=False, repr=False)
class LocalFits(AbstractInterpolant):
    """Fits of the points in and around boxes that tile space, blended across the faces of these.

    Parameters
    ----------
    fits : one for each box, of one kernel; the support of a compact one is shorter where few points are near.
    low, high : (n, dim) corners of the boxes, along the frame; infinite at the rim.
    margin : (n, dim) half of the width of the steps across their faces.
    frame : (dim, dim) axes of the boxes, in rows.
    remarks : notes; ids : of the control points behind the fits; unit : of these.
    missed : distance of points that count as one from the place that they share, physical.
    """

    fits: tuple[RBFInterpolant, ...]
    low: Any
    high: Any
    margin: Any
    frame: Any
    remarks: tuple[str, ...] = ()
    ids: tuple[int, ...] = ()
    missed: float = 0.0
    unit: str = ""

    @property
    def dim(self) -> int:
        return int(self.fits[0].dim)

    @property
    def kernel(self) -> type[AbstractKernel]:
        """The kernel of the fits."""
        return self.fits[0].kernel

    @cached_property
    def support(self) -> float:
        """The longest support of the fits."""
        return max(float(fit.support) for fit in self.fits)

    @property
    def targets(self) -> Floats:
        return np.concatenate([fit.targets for fit in self.fits])

    @property
    def trend(self) -> str:
        """The trend of the fits."""
        return str(self.fits[0].trend)

    @cached_property
    def count(self) -> int:
        """Number of control points."""
        return len(self.ids)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for a status line."""
        return self.remarks

    def bound(self, pixel: float = 0.0) -> float:
        """As :meth:`~deformnb.rbf.interpolant.RBFInterpolant.bound`, of all fits."""
        return max(fit.bound(pixel) for fit in self.fits) + float(self.missed)

    def jax_displacement(self, points: Any) -> Any:
        x = jnp.asarray(points)
        along = x @ jnp.asarray(self.frame, dtype=x.dtype).T

        def add(total: tuple[Any, Any], box: tuple[Any, ...]) -> tuple[tuple[Any, Any], None]:
            fit, low, high, margin = box
            w = jnp.prod(_steps(along, low, high, margin, jnp), axis=-1, keepdims=True)
            return (total[0] + w * fit.jax_displacement(x), total[1] + w), None

        start = jnp.zeros_like(x), jnp.zeros_like(x[..., :1])
        boxes = tuple(jnp.asarray(a, dtype=x.dtype) for a in (self.low, self.high, self.margin))
        (total, weight), _ = lax.scan(add, start, (_stack_fits(self.fits, x.dtype), *boxes))
        return total / weight

    def displacement(self, points: ArrayLike) -> Floats:
        x, shape = self._places(points)
        total, weight, along = np.zeros(x.shape), np.zeros(len(x)), x @ self.frame.T
        for k, near in self._window_factor(along):
            w = np.prod(_steps(along[near], self.low[k], self.high[k], self.margin[k], np), axis=1)
            total[near] += w[:, None] * self.fits[k].displacement(x[near])
            weight[near] += w
        return (total / weight[:, None]).reshape(shape)

    def jacobian(self, points: ArrayLike) -> Floats:
        """dD/dx by the quotient rule: ``(sum_k w_k J_k + (D_k - D) dw_k^T) / sum_k w_k``."""
        x, shape = self._places(points)
        n, dim = x.shape
        blended, along = self.displacement(x), x @ self.frame.T
        total, weight = np.zeros((n, dim, dim)), np.zeros(n)
        for k, near in self._window_factor(along):
            p, m = along[near], self.margin[k]
            down, up = (p - self.low[k]) / m, (self.high[k] - p) / m
            rise = (_step_slope(down) * _step(up, np) - _step(down, np) * _step_slope(up)) / m
            steps = _steps(p, self.low[k], self.high[k], m, np)
            w = np.prod(steps, axis=1)
            slope = np.stack([rise[:, a] * np.prod(np.delete(steps, a, axis=1), axis=1) for a in range(dim)], axis=1)
            slope = slope @ self.frame
            beside = self.fits[k].displacement(x[near]) - blended[near]
            total[near] += w[:, None, None] * self.fits[k].jacobian(x[near]) + beside[:, :, None] * slope[:, None, :]
            weight[near] += w
        return (total / weight[:, None, None]).reshape(*shape, dim)

    def folds_between_points(self) -> bool:
        """Check whether one of the fits folds between its points."""
        return any(fit.folds_between_points() for fit in self.fits)

    def _places(self, points: ArrayLike) -> tuple[Floats, tuple[int, ...]]:
        x = np.asarray(points, dtype=np.float64)
        if x.shape[-1:] != (self.dim,):
            raise DeformError(f"points must have shape (..., {self.dim}), got {x.shape}.")
        return x.reshape(-1, self.dim), x.shape

    def _window_factor(self, along: Floats) -> Any:
        for k in range(len(self.fits)):
            low, high = self.low[k] - self.margin[k], self.high[k] + self.margin[k]
            near = np.flatnonzero(((along > low) & (along < high)).all(axis=1))
            if len(near):
                yield k, near


def _stack_fits(fits: tuple[RBFInterpolant, ...], dtype: Any) -> RBFInterpolant:
    """The fits as one whose arrays have the fits on their first axis, for a loop of JAX."""
    size, own = max(len(fit.centers) for fit in fits), any(fit.scales is not None for fit in fits)

    def plain(fit: RBFInterpolant) -> RBFInterpolant:
        rest = size - len(fit.centers)
        scales = np.pad(np.ones(len(fit.centers)) if fit.scales is None else fit.scales, (0, rest)) if own else None
        centers, coefficients = (np.pad(a, ((0, rest), (0, 0))) for a in (fit.centers, fit.coefficients))
        return RBFInterpolant(
            centers,
            coefficients,
            fit.polynomial,
            fit.origin,
            fit.support,
            fit.count,
            fit.kernel,
            fit.trend,
            scales=scales,
        )

    found: RBFInterpolant = jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves), dtype=dtype), *map(plain, fits))
    return found


def _steps(x: Any, low: Any, high: Any, margin: Any, xp: Any) -> Any:
    """The two steps along each axis across the faces of a box, multiplied: (..., dim)."""
    return _step((x - low) / margin, xp) * _step((high - x) / margin, xp)


def _step(t: Any, xp: Any) -> Any:
    """A step from 0 at -1 to 1 at 1 with two continuous derivatives."""
    s = xp.clip((t + 1) / 2, 0.0, 1.0)
    return s * s * s * (s * (6 * s - 15) + 10)


def _step_slope(t: Floats) -> Floats:
    s = np.clip((t + 1) / 2, 0.0, 1.0)
    return 15 * np.square(s * (1 - s))


def is_wide(ready: PreparedPoints) -> bool:
    """Check whether one system of all points with this support would take longer than about a second.

    It takes N m^2 operations, with m the points within the support of each, on the average. Points with radii of their
    own have a system that is solved whole.
    """
    if ready.count**3 <= _MOST_WORK or (ready.radii != ready.support).any():  # fewer, each of which reaches all
        return False
    tree = scipy.spatial.cKDTree(ready.targets)
    return float(tree.count_neighbors(tree, ready.support)) ** 2 / ready.count > _MOST_WORK


def fit_locally(ready: PreparedPoints, kernel: type[AbstractKernel], smoothing: float, leaf: int = LEAF) -> LocalFits:
    """Local fits of prepared points, with a note of how far they deviate from wider ones.

    Parameters
    ----------
    leaf : points of a box at most.

    Raises
    ------
    DeformError
        Where a fit is refused; it names its own points.
    """
    x, frame = ready.targets, frame_of(ready.targets, ready.displacements)
    along = x @ frame.T
    low, high, members = _boxes(along, leaf)
    sides = np.where(np.isfinite(high - low), high - low, np.inf)
    inner = np.array([np.ptp(along[m], axis=0) for m in members])
    margin = _MARGIN * np.minimum(sides, np.maximum(inner, inner.max(axis=1, keepdims=True) * 1e-3))
    tree = scipy.spatial.cKDTree(x)
    fits = []
    for k in range(len(members)):
        wide = _AROUND * margin[k] * (1 + SAME_DISTANCE)
        near = ((along >= low[k] - wide) & (along <= high[k] + wide)).all(axis=1)
        fits.append(_fit_part(_subset(ready, _fill_neighbours(near, x, tree)), kernel, smoothing))
    worst = max(fits, key=lambda fit: float(fit.missed))
    counts = [int(fit.count) for fit in fits]
    field = LocalFits(tuple(fits), low, high, margin, frame, (), ready.ids, ready.missed)
    deviation = _deviation(field, ready, kernel, smoothing, tree)
    note = (
        f"the {kernel.name} kernel is fitted locally to {len(x)} control points: {len(fits)} fits of {min(counts)} "
        f"to {max(counts)} points, blended; between points they deviate by up to {_round_up(deviation):.2g} from "
        "the fit of all"
    )
    return replace(field, remarks=(*ready.notes, note, *worst.of_points.texts))


def frame_of(x: Floats, d: Floats) -> Floats:
    """Axes (dim, dim), in rows, that turn and mirror with places x (n, dim) and their displacements d (n, dim).

    They are the principal axes of the places, each by as much as it is displaced: those of a square lattice alone
    would be open. They point to where the third moments are positive. Places and displacements that are symmetrical
    both leave them open, to rounding.
    """
    c = x - x.mean(axis=0)
    c = c / (spread_of(c) or 1.0)
    squares = (d**2).sum(axis=1)
    w = 1 + squares / (squares.mean() or 1.0)
    axes = np.linalg.eigh((c * w[:, None]).T @ c)[1][:, ::-1].T
    along = c @ axes.T
    skew = (w[:, None] * along**3).sum(axis=0) + ((w - 1)[:, None] * along).sum(axis=0)
    return np.asarray(axes * np.where(skew < 0, -1.0, 1.0)[:, None])


def _fit_part(part: PreparedPoints, kernel: type[AbstractKernel], smoothing: float) -> RBFInterpolant:
    """The fit of a part of the points; of a compact kernel with a support that its few points allow.

    Beyond some times their extent it changes the map no more, and next to points that nearly meet its digits are lost:
    it is halved until the part solves.
    """
    if not kernel.compact:
        return solve_prepared(part, kernel, smoothing, None)
    radius = min(part.support, _LONGEST * (diameter_of(part.targets) or part.support))
    while True:
        own = replace(part, support=radius, radii=np.full(part.count, radius))
        is_last = radius < 2 * _SHORTEST * diameter_of(part.targets)
        try:
            fit = solve_prepared(own, kernel, smoothing, None)
            if is_last or fit.missed <= part.missed:
                return fit
        except TooFlatError:
            if is_last:
                raise
        radius /= 2


def _round_up(value: float) -> float:
    """A number with two digits that is not below this one."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1) if value > 0 else 1.0
    return float(np.ceil(value / unit) * unit)


def _fill_neighbours(near: NDArray[np.bool_], x: Floats, tree: Any) -> NDArray[np.int64]:
    """Positions of points near a box, and of the nearest others where these are few."""
    at = np.flatnonzero(near)
    if len(at) < min(_LEAST, len(x)):
        middle = x[at].mean(axis=0)
        reach = float(np.max(tree.query(middle, k=min(_LEAST, len(x)))[0])) * (1 + SAME_DISTANCE)
        at = np.union1d(at, np.asarray(tree.query_ball_point(middle, reach)))
    return at.astype(np.int64)


def _boxes(x: Floats, leaf: int) -> tuple[Floats, Floats, list[NDArray[np.int64]]]:
    """Boxes that tile space, each with at most ``leaf`` points: corners (n, dim) and the points of each."""
    waiting = [(np.full(x.shape[1], -np.inf), np.full(x.shape[1], np.inf), np.arange(len(x)))]
    low, high, members = [], [], []
    while waiting:
        bottom, top, own = waiting.pop()
        sides = np.ptp(x[own], axis=0)
        axis = int((sides >= sides.max() * (1 - SAME_DISTANCE)).argmax())  # the first of sides that are equal
        middle = float(np.median(x[own, axis]))
        below = x[own, axis] < middle - SAME_DISTANCE * sides[axis] / len(own)
        if len(own) <= leaf or not below.any():
            low.append(bottom)
            high.append(top)
            members.append(own)
            continue
        inner_top, inner_bottom = top.copy(), bottom.copy()
        inner_top[axis] = inner_bottom[axis] = middle
        waiting += [(bottom, inner_top, own[below]), (inner_bottom, top, own[~below])]
    return np.array(low), np.array(high), members


def _subset(ready: PreparedPoints, at: NDArray[np.int64]) -> PreparedPoints:
    """Some of the prepared points, with the span that they have themselves."""
    x, d = ready.targets[at], ready.displacements[at]
    origin = x.mean(axis=0)
    bent = quadric_span(x - origin, np.eye(x.shape[1])) if ready.trend == "quadratic" else ()
    span = Span(np.eye(x.shape[1]), ridge_of(*spreads_of(x, x + d)), *bent)
    return replace(
        ready,
        targets=x,
        displacements=d,
        weights=ready.weights[at],
        radii=ready.radii[at],
        origin=origin,
        span=span,
        ids=tuple(ready.ids[k] for k in at.tolist()),
        notes=(),
        missed=0.0,
    )


def _deviation(
    field: LocalFits, ready: PreparedPoints, kernel: type[AbstractKernel], smoothing: float, tree: Any
) -> float:
    """Four times the largest difference to fits of more points found, in gaps between points all over their hull.

    Every wide fit is compared in the middle of its points, where it is nearly the fit of all. The largest difference
    next to the places that are examined is missed: of nine random sets, dragged smoothly and at random, it was 0.9 to
    3.9 times the one found.
    """
    x, worst = ready.targets, 0.0
    outwards = np.argsort(np.linalg.norm(x - x.mean(axis=0), axis=1))
    count = min(_WIDER * int(np.mean([int(fit.count) for fit in field.fits])), len(x), _WIDEST)
    for k in outwards[np.linspace(0, len(x) - 1, _PROBES).astype(int)].tolist():
        near = np.asarray(tree.query(x[k], k=count)[1])
        places = _gaps(x[near[: max(_LEAST, count // _WIDER)]])
        wide = _widest(ready, near, kernel, smoothing).displacement(places)
        worst = max(worst, float(np.linalg.norm(wide - field.displacement(places), axis=1).max()))
    return _MISSED * worst


def _widest(
    ready: PreparedPoints, near: NDArray[Any], kernel: type[AbstractKernel], smoothing: float
) -> RBFInterpolant:
    """The fit of these nearest points, or of half as many where their system is singular."""
    try:
        return _fit_part(_subset(ready, np.sort(near)), kernel, smoothing)
    except TooFlatError:
        if len(near) <= _LEAST:
            raise
        return _widest(ready, near[: len(near) // 2], kernel, smoothing)


def _gaps(x: Floats) -> Floats:
    """Places between points (n, dim): the middles of their triangles; on a line, between neighbours."""
    try:
        return np.asarray(x[scipy.spatial.Delaunay(x).simplices].mean(axis=1))
    except scipy.spatial.QhullError:
        ordered = x[np.argsort((x - x.mean(axis=0)) @ np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2][0])]
        return np.asarray((ordered[1:] + ordered[:-1]) / 2)
