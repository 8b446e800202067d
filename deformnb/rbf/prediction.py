"""The fit that predicts best: kernel, trend, support, smoothing and direction, judged by points that were left out.

Each candidate is fitted without some of the points, and the distance is measured from where the sources of these then
come to in the result to their targets. Points are left out one by one, and in blocks of neighbours, an eighth and a
quarter of them at a time: next to a point that is left out alone there always is another one, and a map has to hold
where no point is near. The score is the geometric mean of the three root mean squares; the width of a block is found
from the points, which are halved again and again across their longest axis, so that neither the axes nor the order of
the points count.

The plain candidates come first, and one with more to be chosen has to be better by more: few points give little. Of the
best spline the smoothest that is not worse by more than 5 % is taken. Maps that fold between their points are taken
only if all do. Nothing that is measured here has been seen by the fit that it judges; how well the choice itself
predicts is another question; leaving out before choosing answers it (nested validation: S. Varma, R. Simon, BMC
Bioinformatics 7:91, 2006), and docs/prediction.md does.

Of a linear system [Phi + lambda/w, P; P^T, 0] with the inverse C no fit has to be made twice: without the points B its
coefficients change by ``-C_:B C_BB^-1 alpha_B`` (as S. Rippa, Adv. Comput. Math. 11, 1999, for one point).
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats, Progress
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import PreparedPoints, prepare
from deformnb.rbf.cross_validation import parameters_of
from deformnb.rbf.evaluation import profile_of
from deformnb.rbf.factors import kernel_values
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.forward import DIRECTIONS, ForwardFit, orient_points
from deformnb.rbf.kernels import KernelName, as_kernel
from deformnb.rbf.newton import lengths_of, map_of, search
from deformnb.rbf.points import ControlPoints, as_control_points
from deformnb.rbf.trends import TrendName, find_trend, products

PointBlocks = list[NDArray[np.intp]]

MOST_JUDGED = 150
"""Points of a set by which fits are judged: evenly taken from larger sets, for leaving out costs N^3."""

HALVINGS = (3, 2)
"""Numbers of halvings of the points for the blocks that are left out."""

# By how much a candidate has to predict better than the plain thin plates: 5 % where a smoother or rougher spline, a
# quadratic trend or a smoothing is chosen too, and 25 % with a support radius. Of 51 pairs of drawn grids without a
# margin a third was chosen by the noise of the drawings.
PLAIN, OTHER, COMPACT = 1.0, 1.05, 1.25

SMOOTHINGS = (0.0, 1e-4, 1e-3)
"""Smoothings that are tried, for kernels with a support as long as the points: of the order of the squared error of
places that are read by eye, relative to the displacements."""

SUPPORT_FACTORS = (0.5, 1.0, 2.0)
"""Supports of compact kernels that are tried, relative to the size of the points."""

_NEAR = 1.05  # scores up to so many times the best are equivalent, as far as smoothing goes
_ROUNDING = 1e-9  # of the size of the points, to which places are sought
_NONE = 1e-7  # of the size of the points: smaller errors are none
_ALIKE = 6  # decimals of the logarithm of a score; what differs by less is as good
_TURNS = 12  # of Newton's method
_FARTHEST = 0.5  # of the size of the points in one step
_MOST_REFITTED = 24  # points that are left out one by one where every fit has to be made


@dataclass(frozen=True)
class Candidate:
    """One fit that is tried.

    Parameters
    ----------
    settings : of the fit; a ``support`` is relative to the size of the points that are fitted, 1 by default.
    margin : the factor by which its error counts more.

    Examples
    --------
    >>> Candidate(FitSettings(kernel="thin_plate")).settings.direction
    'backward'
    """

    settings: FitSettings
    margin: float = OTHER


def usual_candidates(dim: int) -> tuple[Candidate, ...]:
    """The candidates that :func:`choose_fit` tries: splines of three degrees with affine and quadratic trends, three
    smoothings, and a compact kernel of three supports, in both directions.

    Parameters
    ----------
    dim : 2 or 3; the thin plate of space is the linear kernel.

    Examples
    --------
    >>> len(usual_candidates(2))
    36
    """
    splines: list[tuple[KernelName, TrendName]] = [
        ("thin_plate", "affine"),
        ("linear", "affine"),
        ("cubic", "affine"),
        ("thin_plate", "quadratic"),
        ("cubic", "quadratic"),
    ]
    plate = ("thin_plate" if dim == 2 else "linear", "affine")
    splines.sort(key=lambda spline: spline != plate)
    found = [
        Candidate(
            FitSettings(kernel=kernel, trend=trend, smoothing=smoothing, support=1.0, direction=direction),
            PLAIN if (kernel, trend) == plate and not smoothing else OTHER,
        )
        for kernel, trend in splines
        for smoothing in SMOOTHINGS
        for direction in DIRECTIONS
    ]
    compact = [
        Candidate(FitSettings(support=share, direction=direction), COMPACT)
        for share in SUPPORT_FACTORS
        for direction in DIRECTIONS
    ]
    return (*found, *compact)


@dataclass(frozen=True)
class TriedFit:
    """Result of one candidate.

    Parameters
    ----------
    settings : of the fit, with its support in physical units.
    leave_one_out, eighths, quarters : root mean square distances in the result, as a length; infinite where it failed.
    margin : the factor by which they count more.
    folds : whether the fit to all points folds between them.
    why : why it could not be judged, or nothing.
    """

    settings: FitSettings
    leave_one_out: float = np.inf
    eighths: float = np.inf
    quarters: float = np.inf
    margin: float = OTHER
    folds: bool = False
    why: str = ""

    @property
    def error(self) -> float:
        """The geometric mean of the three errors, a length."""
        return float(np.exp(np.mean(np.log([self.leave_one_out, self.eighths, self.quarters]))))

    @property
    def score(self) -> float:
        """The error times the margin; the least is chosen."""
        return self.error * self.margin


@dataclass(frozen=True, eq=False, repr=False)
class ChosenFit:
    """The fit that predicts best, and all that were tried.

    Parameters
    ----------
    settings : of the fit, as :class:`~deformnb.document.deformation.Step` takes them.
    fit : to all of the (first) points; a backward displacement field.
    tried : the candidates, first the one that is chosen, then by their scores; those that fold, and those that could
        not be judged, at the end.
    notes : remarks for a status line.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9], [4, 4]],
    ...                                    [[0, 0], [9, 0], [0, 9], [9, 9], [5, 5]])
    >>> choose_fit(points).tried
    ()
    """

    settings: FitSettings
    fit: AbstractField
    tried: tuple[TriedFit, ...] = field(default=())
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        lines = [f"<ChosenFit: {describe_settings(self.settings)}>"]
        lines += [
            f"  {describe_settings(row.settings):<58} {' '.join(f'{v:>9}' for v in _cells(row))}" for row in self.tried
        ]
        if self.tried:
            lines.insert(1, f"  {'fit':<58} {' '.join(f'{title:>9}' for title in _TITLES)}")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{title}</th>" for title in ("fit", *_TITLES))
        rows = "".join(
            "<tr>"
            + "".join(f"<td>{html.escape(text)}</td>" for text in (describe_settings(row.settings), *_cells(row)))
            + "</tr>"
            for row in self.tried
        )
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return f"<p>{html.escape(describe_settings(self.settings))}</p><table><tr>{head}</tr>{rows}</table>{notes}"


_TITLES = ("one", "eighths", "quarters", "score", "")


def _cells(row: TriedFit) -> tuple[str, ...]:
    """The columns of a row of the table."""
    if row.why:
        return "", "", "", "", row.why
    numbers = (row.leave_one_out, row.eighths, row.quarters, row.score)
    return (*(f"{value:.4g}" for value in numbers), "folds" if row.folds else "")


def describe_settings(settings: FitSettings) -> str:
    """Settings of a fit in a few words.

    Examples
    --------
    >>> describe_settings(FitSettings(kernel="thin_plate", smoothing=0.001, direction="forward"))
    'forward, thin_plate, affine trend, smoothing 0.001'
    """
    kind = as_kernel(settings.kernel)
    support = f", support {settings.support:.4g}" if kind.compact and isinstance(settings.support, float) else ""
    smoothing = f", smoothing {settings.smoothing:g}" if settings.smoothing else ""
    return f"{settings.direction}, {settings.kernel}, {settings.trend} trend{support}{smoothing}"


def choose_fit(
    points: ControlPoints | Sequence[ControlPoints],
    *,
    candidates: Sequence[Candidate] | None = None,
    progress: Progress | None = None,
) -> ChosenFit:
    """Choose the fit that predicts left-out control points best.

    Parameters
    ----------
    points : control points of dimension 2 or 3, or several sets, fitted equally but separately, such as those of
        the regions between cuts; inactive ones are left out.
    candidates : fits to try; default is :func:`usual_candidates`. Among equals the first is taken.
    progress : called with the finished share, 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    ChosenFit, with the settings, the fit and the table of all that was tried. Where there are too few points to leave
    some out it is the default fit, with a note.

    Raises
    ------
    DeformError
        If there is no active point, or none of the candidates can be fitted.

    Examples
    --------
    >>> import numpy as np
    >>> source = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 10
    >>> grown = ControlPoints.from_arrays(source, source + source**2 / 100)
    >>> choose_fit(grown).settings.trend
    'quadratic'
    """
    given = [points] if isinstance(points, ControlPoints) else list(points)
    sets = [s.subset(np.flatnonzero(s.active)) for s in map(as_control_points, given)]
    sets = [s for s in sets if len(s)]
    if not sets:
        raise DeformError("there is no active control point, so there is nothing to predict; add or switch on some.")
    notes: tuple[str, ...] = ()
    few = [s for s in map(_distinct, sets) if len(s) >= s.dim + 4 and s.displacement.any()]
    if not few:
        return ChosenFit(
            FitSettings(),
            FitSettings().fit(given[0]),
            notes=(
                f"{max(map(len, sets))} control points are too few to leave some of them out; this is the default fit",
            ),
        )
    judged = [_evenly(s) for s in few]
    if any(len(a) < len(b) for a, b in zip(judged, few, strict=True)):
        notes = (f"the fits are judged by {sum(map(len, judged))} of {sum(map(len, few))} control points",)
    tried, every = [], usual_candidates(sets[0].dim) if candidates is None else tuple(candidates)
    if not every or not all(isinstance(one, Candidate) for one in every):
        raise DeformError(f"candidates are a list of Candidate(FitSettings(...)), got {short_value(candidates)}.")
    for k, candidate in enumerate(every):
        tried.append(_try_candidate(candidate, few, judged))
        if progress is not None:
            progress((k + 1) / len(every))
    return _best(tried, given[0], notes)


def _best(tried: list[TriedFit], points: ControlPoints, notes: tuple[str, ...]) -> ChosenFit:
    """The first of the least score, of those that do not fold as long as there are some."""
    ranked = sorted(tried, key=lambda row: (bool(row.why), row.folds, np.round(np.log(row.score), _ALIKE)))
    if ranked[0].why:
        raise DeformError(
            f"none of the {len(tried)} candidates can be fitted to these control points: {ranked[0].why}."
        )
    if ranked[0].folds:
        notes += ("every fit that was tried folds between the control points",)
    first = _smoothest(ranked, _size(points.target))
    ranked.sort(key=lambda row: row is not first)
    settings = ranked[0].settings
    return ChosenFit(settings, settings.fit(points), tuple(ranked), notes)


def _smoothest(ranked: Sequence[TriedFit], size: float) -> TriedFit:
    """The best fit, or the same with the most smoothing of equivalent ones (the "one standard error rule")."""
    best = ranked[0]
    if best.error <= 10 * _NONE * size:  # nothing is to be smoothed
        return best
    alike = [
        row
        for row in ranked
        if row.folds == best.folds
        and row.score <= _NEAR * best.score
        and replace(row.settings, smoothing=best.settings.smoothing) == best.settings
    ]
    return max(alike, key=lambda row: row.settings.smoothing)


def _distinct(points: ControlPoints) -> ControlPoints:
    """One point of those that share a source or a target: left out, its twin would give it away."""
    tiny = _ROUNDING * max(_size(points.source), _size(points.target))
    keep = np.ones(len(points), dtype=bool)
    for places in (points.source, points.target):
        for k in range(len(points)):
            near = np.linalg.norm(places[:k] - places[k], axis=1) <= tiny
            keep[k] &= not (near & keep[:k]).any()
    return points.subset(np.flatnonzero(keep))


def _size(places: Floats) -> float:
    """The diagonal of a box that points fill evenly, by their distances from their middle: invariant under rotation."""
    return float(np.sqrt(12 * ((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _evenly(points: ControlPoints) -> ControlPoints:
    """At most :data:`MOST_JUDGED` points, evenly taken from neighbourhoods."""
    if len(points) <= MOST_JUDGED:
        return points
    depth = int(np.ceil(np.log2(len(points))))
    order = np.concatenate(blocks_of(points.source, depth))
    return points.subset(np.sort(order[np.linspace(0, len(order) - 1, MOST_JUDGED).astype(int)]))


def blocks_of(places: Floats, halvings: int) -> PointBlocks:
    """Blocks of neighbours: places (n, dim) halved again and again across their longest axis.

    Which side of a half the middle of an odd number goes to is decided by the third moment along the axis, and between
    places at one height by the next axis.

    Examples
    --------
    >>> [block.tolist() for block in blocks_of(np.array([[0.0, 0], [9, 1], [1, 0], [8, 0]]), 1)]
    [[0, 2], [1, 3]]
    """

    def halve(index: NDArray[np.intp], left: int) -> PointBlocks:
        if not left or len(index) < 2:
            return [index]
        centred = places[index] - places[index].mean(axis=0)
        axes = np.linalg.svd(centred, full_matrices=False)[2]
        heights = centred @ axes.T
        skew = (heights**3).sum(axis=0)
        scale = float(np.abs(heights).max()) or 1.0
        heights *= np.where(skew < -_ROUNDING * scale**3, -1.0, 1.0)
        order = np.lexsort(np.round(heights.T[::-1] / (_ROUNDING * scale)))
        half = len(index) // 2
        return [*halve(index[order[:half]], left - 1), *halve(index[order[half:]], left - 1)]

    return [np.sort(block) for block in halve(np.arange(len(places)), halvings)]


def _try_candidate(candidate: Candidate, sets: Sequence[ControlPoints], judged: Sequence[ControlPoints]) -> TriedFit:
    """One candidate, judged: by the errors of all sets together."""
    direction = candidate.settings.direction
    size = max(_size(orient_points(s, direction).target) for s in sets)
    relative = candidate.settings.support
    share = float(relative) if isinstance(relative, int | float) else 1.0
    settings = FitSettings(**candidate.settings.as_dict() | {"support": share * size})
    reach = max(_size(s.target) for s in judged)
    try:
        errors = [_errors(s, settings) for s in judged]
        folds = any(_folds(settings.fit(s)) for s in sets)
    except (DeformError, np.linalg.LinAlgError) as error:
        return TriedFit(settings, margin=candidate.margin, why=str(error) or "its system is singular")
    squares = [np.concatenate(parts) for parts in zip(*errors, strict=True)]
    if not all(np.isfinite(part).all() for part in squares):
        return TriedFit(settings, margin=candidate.margin, why="it is not determined without some of the points")
    one, eighths, quarters = (float(np.sqrt(part.mean() + (_NONE * reach) ** 2)) for part in squares)
    return TriedFit(settings, one, eighths, quarters, candidate.margin, folds)


def _folds(fit: Any) -> bool:
    return bool(fit.folds_between_points())


def _schemes(points: ControlPoints) -> tuple[PointBlocks, ...]:
    """Sets of points that are left out together: single points, eighths, quarters."""
    one = [np.array([k]) for k in range(len(points))]
    return (one, *(blocks_of(points.source, halvings) for halvings in HALVINGS))


def _errors(points: ControlPoints, settings: FitSettings) -> list[Floats]:
    """Squared distances (n) in the result between targets and where left-out sources come to, for each scheme."""
    turned, schemes = orient_points(points, settings.direction), _schemes(points)
    kind, trend = as_kernel(settings.kernel), find_trend(settings.trend)
    most = max(len(block) for blocks in schemes for block in blocks)
    if len(points) - most <= parameters_of(settings.trend, points.dim):
        raise DeformError("too few points to leave some out")
    assert isinstance(settings.support, float)
    ready = prepare(turned, kind, settings.support, trend, settings.smoothing)
    if not _is_plain(ready, settings):
        return [_refit_errors(points, settings, blocks) for blocks in schemes]
    system = _LinearSystem(ready, turned.source, settings)
    found = []
    for blocks in schemes:
        misses = system.ends_without(blocks, points) if settings.direction == "backward" else system.misses(blocks)
        found.append((misses**2).sum(axis=1))
    return found


def _is_plain(ready: PreparedPoints, settings: FitSettings) -> bool:
    """Check whether the fit is one linear system: no trend that shrinks, nothing merged, no separate radii."""
    span, is_bent = ready.span, settings.trend == "quadratic"
    is_shrunk = bool(np.any(span.ridge)) or (is_bent and span.bend is not None and bool(np.any(span.bend)))
    return (
        ready.trend == settings.trend
        and settings.trend in ("affine", "affine_exact", "quadratic")
        and not is_shrunk
        and ready.count == len(ready.active)
        and not ready.active.has_own_radii
    )


class _LinearSystem:
    """The whole system of a fit, whose inverse determines all that leave some points out.

    Parameters
    ----------
    ready : points, with the places at which the map is known as targets.
    values : (n, dim) that it has there.
    """

    def __init__(self, ready: PreparedPoints, values: Floats, settings: FitSettings) -> None:
        self._origin, self._support = ready.origin, ready.support
        self._kernel, self._is_bent = as_kernel(settings.kernel), settings.trend == "quadratic"
        self._x, n = ready.relative, ready.count
        self._scale = float(np.sqrt((self._x**2).sum(axis=1).mean()))
        phi = kernel_values(self._x, self._x, self._kernel)
        phi.flat[:: n + 1] += settings.smoothing / ready.weights
        p = self._polynomials(self._x)
        whole = np.block([[phi, p], [p.T, np.zeros((p.shape[1],) * 2)]])
        if not np.linalg.cond(whole) < 1 / np.finfo(float).eps / 100:
            raise np.linalg.LinAlgError("its system is singular to working precision")
        self._inverse, self._n, self._places = np.linalg.inv(whole), n, ready.targets
        self._solution = self._inverse[:, :n] @ values

    def _polynomials(self, x: Floats) -> Floats:
        x = x / self._scale
        bent = [products(x)] if self._is_bent else []
        return np.concatenate([np.ones((len(x), 1)), x, *bent], axis=1)

    def _change(self, block: NDArray[np.intp]) -> Floats:
        """``C_BB^-1 alpha_B``: the errors at the block of the fit without it."""
        own = self._inverse[np.ix_(block, block)]
        if not np.linalg.cond(own) < 1e12:
            raise np.linalg.LinAlgError("it is not determined without some of the points")
        return np.asarray(np.linalg.solve(own, self._solution[block]))

    def misses(self, blocks: PointBlocks) -> Floats:
        """Values less predictions (n, dim) at the places, each without its block."""
        found = np.empty((self._n, self._solution.shape[1]))
        for block in blocks:
            found[block] = self._change(block)
        return found

    def ends_without(self, blocks: PointBlocks, points: ControlPoints) -> Floats:
        """Targets less the places (n, dim) at which the map without its block has the source of each point.

        By damped Newton steps from the targets; where none is found, the residual at the source counts twice.
        """
        solutions = np.empty((self._n, *self._solution.shape))
        for block in blocks:
            without = self._solution - self._inverse[:, block] @ self._change(block)
            without[block] = 0.0
            solutions[block] = without
        size = _size(points.target)
        y, left = _newton(lambda y: self._values(y, solutions), points.source, points.target, size)
        miss = points.target - y
        lost = left > 1e-4 * size
        worst = 2 * np.maximum(lengths_of(miss), lengths_of(self.misses(blocks)))
        return np.where(lost[:, None], worst[:, None] / np.sqrt(points.dim), miss)

    def _values(self, y: Floats, solutions: Floats) -> Floats:
        """The map of each point's own solution at its own place, (n, dim)."""
        x = (y - self._origin) / self._support
        square = ((x[:, None] - self._x[None]) ** 2).sum(axis=-1)
        phi = profile_of(square.ravel(), self._kernel).reshape(square.shape)
        return np.asarray(np.einsum("ij,ijk->ik", np.concatenate([phi, self._polynomials(x)], axis=1), solutions))


def _newton(values: Callable[[Floats], Floats], goal: Floats, start: Floats, size: float) -> tuple[Floats, Floats]:
    """Places y (n, dim) where each map has its goal, and the lengths of the residuals."""
    y, h = start.copy(), 1e-5 * size
    r = goal - values(y)
    left = lengths_of(r)
    for _ in range(_TURNS):
        slopes = [(values(y + h * e) - values(y - h * e)) / (2 * h) for e in np.eye(y.shape[1])]
        step = _solve(np.stack(slopes, axis=-1), r)
        step *= np.minimum(1.0, _FARTHEST * size / np.maximum(lengths_of(step), 1e-300))[:, None]
        for share in (1.0, 0.5, 0.25, 0.125, 0.03):
            trial = y + share * step
            r_trial = goal - values(trial)
            better = lengths_of(r_trial) < left
            y[better], r[better] = trial[better], r_trial[better]
            left = lengths_of(r)
            if better.all() or left.max() <= _ROUNDING * size:
                break
        if left.max() <= _ROUNDING * size:
            break
    return y, left


def _solve(a: Floats, r: Floats) -> Floats:
    """a^-1 r of each row; nothing where a is singular."""
    is_flat = ~(np.abs(np.linalg.det(a)) > 1e-12 * np.prod(np.linalg.norm(a, axis=1), axis=-1))
    a = np.where(is_flat[:, None, None], np.eye(a.shape[-1]), a)
    return np.where(is_flat[:, None], 0.0, np.linalg.solve(a, r[..., None])[..., 0])


def _refit_errors(points: ControlPoints, settings: FitSettings, blocks: PointBlocks) -> Floats:
    """The same by a fit for each block; of points that are left out one by one some are taken."""
    if len(blocks) > _MOST_REFITTED:
        blocks = [blocks[k] for k in np.linspace(0, len(blocks) - 1, _MOST_REFITTED).astype(int)]
    return np.concatenate([*_squares_of(points, settings, blocks)])


def _squares_of(points: ControlPoints, settings: FitSettings, blocks: PointBlocks) -> Iterator[Floats]:
    size = _size(points.target)
    for block in blocks:
        fit = settings.fit(points.subset(np.setdiff1d(np.arange(len(points)), block)))
        source, target = points.source[block], points.target[block]
        if isinstance(fit, ForwardFit):
            y = source + fit.forward.displacement(source)
        else:
            y, left = search(source, map_of(fit), _ROUNDING * size, 50, target)
            y = np.where((left > 1e-4 * size)[:, None], target + 2 * lengths_of(y - target)[:, None], y)
        yield ((y - target) ** 2).sum(axis=1)
