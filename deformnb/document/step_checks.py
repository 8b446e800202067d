"""Diagnostics of a step of a document: folds, stages, safe drags, quality of its fit, uncertainty.

Folds are searched for at the nodes of a lattice that covers the volume: 97 along the longer side of the picture and the
same step along the other, on one slice where all slices are equal and on 9 of them otherwise; for points in space 33
along the longest side. A fold narrower than a cell of it, a hundredth of the picture, can be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Floats, Progress
from deformnb.analysis.folds import (
    NEARLY_FOLDED,
    Folds,
    air_nodes,
    find_folds,
    jacobian_determinant,
    largest_safe_share,
)
from deformnb.analysis.gaussian_process import Uncertainty, fit_system, process_scale, uncertainty
from deformnb.analysis.quality import STRAIN, FitQuality, affine_split, fit_quality
from deformnb.checks import check_arguments
from deformnb.document.deformation import Deformation, Step
from deformnb.document.motion_paths import PartPaths
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Sides, sides_of
from deformnb.rbf.fields import AbstractField, grid_lines, raster_lines
from deformnb.rbf.fitting import fit_forward, fit_rigid
from deformnb.rbf.forward import ForwardFit, orient_points
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.prediction import ChosenFit, choose_fit, usual_candidates
from deformnb.rbf.regions import AbstractRegion
from deformnb.rbf.rigid import RigidInterpolant, RigidPart, carry_points, scaled_points
from deformnb.rbf.stages import MOST_STAGES, Staged
from deformnb.rbf.support import lone_support
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.warping.foreground import IsTissue

LEAST = NEARLY_FOLDED
"""The smallest determinant that counts as safe."""

_ON_PLANE, _SLICES, _IN_SPACE = 97, 9, 33

# Around the worst node: so many nodes a side, and lattices finer and finer, down to a hundredth of the first step.
_AROUND, _FINER = 7, 4


# ---- where folds are looked for --------------------------------------------------------------------------------------


def fold_lattice(step: Step, grid: Grid) -> Grid:
    """The nodes at which a step's folds are looked for; see the top of this module."""
    if step.plane is None:
        return _coarse_grid(grid, _IN_SPACE)
    raster = picture_raster(step.plane, grid)
    weights = step.weights()[1]
    is_alike = bool((weights == weights[:, :1]).all()) and len(step.maps) == 1
    front, back = step.plane.depth_range(grid)
    slices = 1 if is_alike or not back > front else _SLICES
    gap = (back - front) / (slices - 1) if slices > 1 else max(raster.spacing)
    start = step.plane.from_plane([*raster.origin, front])
    direction = tuple(tuple(row) for row in step.plane.frame.T.tolist())
    return Grid(
        (slices, *raster.shape),
        (*raster.spacing, gap),
        tuple(start.tolist()),
        direction,  # type: ignore[arg-type]
        grid.unit,
    )


def picture_raster(plane: Plane, grid: Grid, most: int = _ON_PLANE) -> Raster:
    """A raster over the picture of a volume on a plane, its corners on the outermost voxels' centres."""
    corners = plane.to_plane(grid.corners(centres=True))[:, :2]
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    step = max(float(size.max()) / (most - 1), 1e-9)
    count = np.maximum(np.ceil(size / step - 1e-9).astype(int) + 1, 2)
    spacing = np.maximum(size / (count - 1), 1e-9)
    (nu, nv), (du, dv), (a, b) = count.tolist(), spacing.tolist(), low.tolist()
    return Raster((nv, nu), (du, dv), (a, b))


def _coarse_grid(grid: Grid, most: int) -> Grid:
    length = np.asarray(grid.spacing) * (np.asarray(grid.shape[::-1]) - 1)
    step = max(float(length.max()) / (most - 1), 1e-9)
    count = np.maximum(np.ceil(length / step - 1e-9).astype(int) + 1, 1)
    spacing = np.where(count > 1, length / np.maximum(count - 1, 1), step)
    shape = (int(count[2]), int(count[1]), int(count[0]))
    return replace(grid, shape=shape, spacing=tuple(spacing.tolist()))


def step_folds(step: Step, grid: Grid, field: AbstractField | None = None, is_tissue: IsTissue | None = None) -> Folds:
    """The folds of a step at the nodes of :func:`fold_lattice`, the smallest determinant followed between them.

    Parameters
    ----------
    field : of the step on this grid, if it is there already.
    is_tissue : of the step's input, see :func:`~deformnb.analysis.folds.find_folds`.
    """
    lattice = fold_lattice(step, grid)
    found = step.field(grid) if field is None else field
    return _refine_worst(found, lattice, find_folds(found, lattice, is_tissue=is_tissue), is_tissue)


def document_folds(deformation: Deformation, grid: Grid) -> Folds:
    """The folds of a whole document: of its step on that step's lattice, or of several in space, 33 nodes a side."""
    deformation = deformation.to_unit(grid.unit)
    steps = [step for step in deformation.steps if step.enabled]
    if len(steps) == 1:
        return step_folds(steps[0], grid)
    field, lattice = deformation.field(grid), _coarse_grid(grid, _IN_SPACE)
    return _refine_worst(field, lattice, find_folds(field, lattice))


def _refine_worst(field: AbstractField, lattice: Grid, folds: Folds, is_tissue: IsTissue | None = None) -> Folds:
    """The smallest determinant near the worst node, on ever finer lattices around it that stay within the first one."""
    axes = lattice.matrix.T
    last = np.array(lattice.shape[::-1]) - 1
    best, least = lattice.point_to_index(folds.place), folds.least
    for turn in range(_FINER):
        sides = [np.linspace(-1, 1, _AROUND) / (_AROUND / 2) ** turn if n else np.zeros(1) for n in last]
        index = np.clip(best + np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3), 0, last)
        x = np.asarray(lattice.origin) + index @ axes
        values = jacobian_determinant(field, x)
        values[air_nodes(field, x.__getitem__, values, is_tissue)] = np.inf
        k = int(np.argmin(values))
        if values[k] < least:
            best, least = index[k], float(values[k])
    place = np.asarray(lattice.origin) + best @ axes
    return replace(folds, least=least, place=tuple(place.tolist()))


def is_fold_free(step: Step, grid: Grid, least: float = LEAST, is_tissue: IsTissue | None = None) -> bool:
    """Check that the determinant of a step is ``least`` or more at every node; False too if it cannot be fitted.

    With ``is_tissue``, as of :func:`step_folds`, nodes in air do not count. With several stages every stage is checked
    by itself, in air as well. The whole then has no folds, however much it compresses
    tissue; only where a curve of depth weakens it must it be looked at too, and have none.
    """
    if not least <= 1:
        raise DeformError(f"no map but a shrinking one has determinants of {least:g} everywhere; give less than 1.")
    try:
        lattice = fold_lattice(step, grid)
        if step.stages == 1:
            return step_folds(step, grid, is_tissue=is_tissue).least >= least
        if not all(_least(fit, within, step, lattice) >= least for fit, within in _stages(step, grid)):
            return False
        return step_folds(step, grid, is_tissue=is_tissue).least > 0
    except DeformError:
        return False


def _stages(step: Step, grid: Grid) -> Iterator[tuple[AbstractField, Sides]]:
    """Every stage of every fit of a step, with the region between cuts whose tissue it moves."""
    for fits in step.fits_of_regions(grid):
        for sides, fit in fits.items():
            for stage in fit.fits if isinstance(fit, Staged) else (fit,):
                yield stage, sides


def _least(stage: AbstractField, sides: Sides, step: Step, lattice: Grid) -> float:
    """The smallest determinant of one fit on the lattice's first slice or in space, where it shows its own region."""
    where: Grid | Raster = lattice
    if step.plane is not None:
        a, b, _ = step.plane.to_plane(np.asarray(lattice.origin)).tolist()
        where = Raster(lattice.shape[1:], lattice.spacing[:2], (a, b))
    values = jacobian_determinant(stage, where)
    if sides:
        rows, columns = raster_lines(where) if isinstance(where, Raster) else grid_lines(where)
        x = (rows[:, :, None] + columns[:, None, :]).reshape(stage.dim, -1).T
        own = (sides_of(step.cut_regions, x + stage.displacement(x)) == np.asarray(sides)).all(axis=-1)
        values = values.ravel()[own]
    return float(values.min(initial=1.0))


# ---- how far one may go ----------------------------------------------------------------------------------------------


@check_arguments
def required_stages(
    step: Step, grid: Grid, least: float = LEAST, most: int = MOST_STAGES, *, is_tissue: IsTissue | None = None
) -> int:
    """The smallest of 1, 2, 4, ... stages in which a step does not fold.

    Parameters
    ----------
    least : the smallest determinant of any stage.
    most : stages that are tried.

    Raises
    ------
    DeformError
        If that many do not do: points that pass through one another on their straight paths, such as two that are
        swapped, fold in any number of stages. If the step cannot be fitted at all.

    Examples
    --------
    >>> grid = Grid((8, 64, 64))
    >>> points = ControlPoints.from_arrays([[5, 5], [58, 5], [5, 58], [58, 58], [20, 32]],
    ...                                    [[5, 5], [58, 5], [5, 58], [58, 58], [50, 32]])
    >>> required_stages(Step((points,), Plane.from_view(grid, "+z"), support=30.0, trend="none"), grid)
    4
    """
    replace(step, stages=1).field(grid)  # no fold but a separate error, which is raised here
    count = 1
    while count <= most:
        try:
            tried = replace(step, stages=count)
        except DeformError as error:
            raise DeformError(f"the map folds, and more stages do not help: {error}") from None
        if is_fold_free(tried, grid, least, is_tissue):
            return count
        count *= 2
    raise DeformError(
        f"the map folds in {most} stages too: points are pulled through one another, or through a rigid "
        "part, on their straight ways. Drag them less far, or one around the other in several steps."
    )


@check_arguments
def safe_strength(step: Step, grid: Grid, least: float = LEAST, *, is_tissue: IsTissue | None = None) -> float:
    """The strength of a step, at most its own, at which it does not fold; its own if it does not.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> step = Step((ControlPoints.from_arrays([[10, 10]], [[18, 10]]),), plane, trend="none", support=10.0)
    >>> safe_strength(step, Grid((1, 20, 30), (1.0, 1.0, 1.0))) < 1
    True
    """
    return step.strength * largest_safe_share(
        lambda t: is_fold_free(replace(step, strength=t * step.strength), grid, least, is_tissue)
    )


@check_arguments
def safe_points(
    step: Step,
    before: ControlPoints,
    after: ControlPoints,
    grid: Grid,
    key: int = 0,
    least: float = LEAST,
    *,
    is_tissue: IsTissue | None = None,
) -> ControlPoints:
    """The control points as far as is safe on the straight path from one state to another.

    Parameters
    ----------
    step : to which the points belong; its own points do not count.
    before, after : points of the same ids move from target to target; those that are new come from their sources.
    key : which set of control points of the step they are.

    Returns
    -------
    ``after`` itself if that is safe.

    Raises
    ------
    DeformError
        If the map folds at the start of the path.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> before = ControlPoints.from_arrays([[10, 10]], [[10, 10]])
    >>> step = Step((before,), plane, trend="none", support=10.0)
    >>> after = before.move(0, [18, 10])
    >>> bool(safe_points(step, before, after, Grid((1, 20, 30), (1.0, 1.0, 1.0))).target[0, 0] < 18)
    True
    """
    start = after.target.copy()
    known = {i: k for k, i in enumerate(before.ids)}
    for k, i in enumerate(after.ids):
        start[k] = before.target[known[i]] if i in known else after.source[k]

    def at(t: float) -> ControlPoints:
        return after if t == 1 else replace(after, target=start + t * (after.target - start))

    return at(_safe_share(lambda t: is_fold_free(step.with_points(at(t), key), grid, least, is_tissue)))


@check_arguments
def safe_parts(
    step: Step, after: tuple[RigidPart, ...], grid: Grid, least: float = LEAST, *, is_tissue: IsTissue | None = None
) -> tuple[RigidPart, ...]:
    """The rigid parts of a step, moved as far as is safe on the way to others; their points go with them.

    Parameters
    ----------
    after : the same parts with other motions, to each of which there is one screw.

    Returns
    -------
    ``after`` itself if that is safe.

    Raises
    ------
    DeformError
        If the map folds at the start of the way.
    """
    way = PartPaths(step.parts, after)

    def at(t: float) -> tuple[RigidPart, ...]:
        return after if t == 1 else way.at(t)

    def is_safe(t: float) -> bool:
        parts = at(t)
        maps = tuple(carry_points(points, step.parts, parts) for points in step.maps)
        return is_fold_free(replace(step, parts=parts, maps=maps), grid, least, is_tissue)

    return at(_safe_share(is_safe))


def _safe_share(is_safe: Callable[[float], bool]) -> float:
    """The largest share of an edit without folds, which must not be there at its start."""
    if not is_safe(0.0):
        raise DeformError(
            "the map folds before this edit already, so no part of it is safe; take the strength back or "
            "unfold it by stages."
        )
    return largest_safe_share(is_safe)


# ---- the quality of a step's fit -------------------------------------------------------------------------------------


@check_arguments
def step_quality(step: Step, grid: Grid, key: int = 0) -> FitQuality:
    """Goodness of fit of a step's control points; see :class:`~deformnb.analysis.quality.FitQuality`.

    With cuts every region counts separately, as it is fitted; with rigid parts with the weight of the parts
    held, and points that a part holds are left out. Several stages count as one. Of a fit forward the errors are those
    of where sources come to, in the result.

    Parameters
    ----------
    key : which set of control points.

    Raises
    ------
    DeformError
        If no point is active, or the fit raises.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9]], [[0, 0], [9, 0], [0, 9], [12, 9]])
    >>> step_quality(Step((points,), plane), Grid((1, 10, 10), (1.0, 1.0, 1.0))).root_mean_square > 0
    True
    """
    points = _dragged_points(step, key)
    found = [_quality_of(some, step, grid) for _, some in _groups(step, points)]
    found = [q for q in found if q.ids]
    if not found:
        raise DeformError("no active control point moves freely, so there is no fit to judge; add or switch on some.")
    if len(found) == 1:
        return found[0]
    ids = [i for q in found for i in q.ids]
    order = np.argsort([points.index(i) for i in ids])
    residual, errors, disagreement = (
        np.concatenate([getattr(q, name) for q in found])[order]
        for name in ("residual", "leave_one_out", "disagreement")
    )
    judged = points.subset([points.index(ids[k]) for k in order])
    share, non_affine = affine_split(judged)
    return FitQuality(
        judged.ids,
        residual,
        errors,
        disagreement,
        tuple(i for q in found for i in q.suspects),
        float(sum(q.energy for q in found)),
        _mean_scale([q.sigma for q in found]),
        share,
        non_affine,
    )


def _dragged_points(step: Step, key: int) -> ControlPoints:
    if not 0 <= key < len(step.maps):
        raise DeformError(f"there is no set of control points {key}; there are {len(step.maps)}.")
    points = step.maps[key]
    points = scaled_points(points, step.parts, step.strength)
    return points.subset(np.flatnonzero(points.active))


def _groups(step: Step, points: ControlPoints) -> list[tuple[Sides, ControlPoints]]:
    """The points of every region between cuts, by their sources."""
    if not step.cut_regions or not len(points):
        return [((), points)]
    own = [tuple(row) for row in sides_of(step.cut_regions, points.source).tolist()]
    return [(sides, points.subset([k for k, s in enumerate(own) if s == sides])) for sides in sorted(set(own))]


def _plain_fit_problem(
    step: Step, points: ControlPoints, settings: dict[str, object]
) -> tuple[ControlPoints, dict[str, object], Floats, RigidInterpolant | None]:
    """The problem left to the plain fit: its points, its settings, the parts' weight at them, and the whole fit."""
    parts = [part.scaled(step.strength) for part in step.parts if part.enabled]
    fit = fit_rigid(points, parts, **settings) if parts else None  # type: ignore[arg-type]
    if not isinstance(fit, RigidInterpolant):
        return points, settings, np.ones(len(points)), None
    drift, weight = fit.parts_at(points.target)
    free = np.flatnonzero(weight > 0)
    rest, drift, weight = points.subset(free), drift[free], weight[free]
    required = (rest.displacement - drift) / weight[:, None]
    plain = replace(rest, source=rest.target + required, weight=rest.weight * weight**2)
    return plain, {**settings, "trend": fit.trend}, weight, fit


def _quality_of(points: ControlPoints, step: Step, grid: Grid) -> FitQuality:
    """Of the points of one region."""
    plain, settings, weight, fit = _plain_fit_problem(step, points, step.settings.arguments(points, lone_support(grid)))
    if not len(plain):
        nothing = np.zeros((0, points.dim))
        return FitQuality((), nothing, nothing, nothing[:, 0], (), 0.0, float("nan"), 1.0, nothing)
    found = fit_quality(orient_points(plain, step.direction), **settings)  # type: ignore[arg-type]
    if fit is None:
        return found
    share, non_affine = affine_split(points.subset([points.index(i) for i in plain.ids]))
    disagreement = found.disagreement * weight
    loud = {i for i, strain in zip(found.ids, disagreement, strict=True) if strain >= STRAIN}
    return replace(
        found,
        residual=found.residual * weight[:, None],
        affine_share=share,
        non_affine=non_affine,
        leave_one_out=found.leave_one_out * weight[:, None],
        disagreement=disagreement,
        suspects=tuple(i for i in found.suspects if i in loud),
    )


def _mean_scale(scales: list[float]) -> float:
    known = np.array([s for s in scales if not np.isnan(s)])
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")


# ---- the prediction of a step ----------------------------------------------------------------------------------------


def best_prediction(step: Step, progress: Progress | None = None) -> ChosenFit:
    """The fit that predicts left-out control points of a step best; see :func:`~deformnb.rbf.prediction.choose_fit`.

    The points of every region between cuts and of every key picture are judged separately; with rigid parts,
    which hold for fits backward only, these alone are tried.

    Parameters
    ----------
    progress : called with the finished share, 0 to 1.

    Raises
    ------
    DeformError
        If no point is active.

    Examples
    --------
    >>> source = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 10
    >>> points = ControlPoints.from_arrays(source, source + source**2 / 100)
    >>> best_prediction(Step((points,), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)))).settings.direction
    'forward'
    """
    sets = [some for points in step.maps for _, some in _groups(step, points.subset(np.flatnonzero(points.active)))]
    every = usual_candidates(step.points.dim)
    if any(part.enabled for part in step.parts):
        every = tuple(one for one in every if one.settings.direction == "backward")
    return choose_fit(sets, candidates=every, progress=progress)


# ---- the uncertainty of a step ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _InResult:
    """The uncertainty of a fit forward, at places of the result.

    An error e of the place that x comes to is one of ``(1 + dF/dx)^-1 e`` of the source: its root mean square over the
    directions of e is ``sigma ||J|| / sqrt(dim)``. Where no source is certain it is as large as the points reach.
    """

    known: Uncertainty
    fit: ForwardFit

    def at(self, points: Floats) -> Floats:
        """Standard deviations (n) of the sources of places (n, dim)."""
        slope = np.eye(self.fit.dim) + self.fit.jacobian(points)
        stretch = np.sqrt((slope**2).sum(axis=(-1, -2)) / self.fit.dim)
        sigma = self.known.at(points + self.fit.displacement(points))
        return np.where(self.fit.found(points), sigma * stretch, self.fit.size)


@dataclass(frozen=True, eq=False)
class StepUncertainty:
    """Standard deviation of the map of a step on its plane, or in space; zero where nothing is estimated.

    Parameters
    ----------
    dim : 2 on a plane, 3 in space.
    regions : of the cuts; groups : for each region with points its sides, its uncertainty, and the fit with rigid
        parts, which scales it by their weight.
    """

    dim: int
    regions: tuple[AbstractRegion, ...]
    groups: tuple[tuple[Sides, Uncertainty | _InResult, RigidInterpolant | None], ...]

    def at(self, points: ArrayLike) -> Floats:
        """Standard deviations (...) at places (..., dim) of the result, in the unit of the volume."""
        x = np.asarray(points, dtype=np.float64)
        if x.shape[-1:] != (self.dim,):
            raise DeformError(f"points must have shape (..., {self.dim}), got {x.shape}.")
        flat = x.reshape(-1, self.dim)
        out = np.zeros(len(flat))
        here = sides_of(self.regions, flat) if self.regions else np.zeros((len(flat), 0), dtype=bool)
        for sides, known, fit in self.groups:
            own = (here == np.asarray(sides, dtype=bool)).all(axis=-1)
            if own.any():
                out[own] = known.at(flat[own]) * (1.0 if fit is None else fit.parts_at(flat[own])[1])
        return out.reshape(x.shape[:-1])

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        """Standard deviations (R, C) at all points ``rows[:, r] + columns[:, c]``."""
        places = np.asarray(rows, dtype=np.float64)[:, :, None] + np.asarray(columns, dtype=np.float64)[:, None, :]
        return self.at(np.moveaxis(places, 0, -1)).astype(np.float32)


@check_arguments
def step_uncertainty(step: Step, grid: Grid, key: int = 0) -> StepUncertainty:
    """Uncertainty of the map of a step: the deviation of :func:`uncertainty` on its plane or in space.

    With cuts each region has its own; one with too few points takes its scale from the others. Near rigid parts the
    deviation is scaled by their weight, so it is zero within them.

    Parameters
    ----------
    key : which set of control points.

    Raises
    ------
    DeformError
        If there are too few points to estimate a scale.

    Examples
    --------
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9]], [[0, 0], [9, 0], [0, 9], [12, 9]])
    >>> spread = step_uncertainty(Step((points,), plane), Grid((1, 10, 10), (1.0, 1.0, 1.0)))
    >>> type(spread).__name__
    'StepUncertainty'
    """
    points = _dragged_points(step, key)
    kept, scales = [], []
    for sides, some in _groups(step, points):
        plain, settings, _, fit = _plain_fit_problem(step, some, step.settings.arguments(some, lone_support(grid)))
        if len(plain):
            clear = orient_points(replace(plain, radius=np.full(len(plain), np.nan)), step.direction)
            kept.append((sides, clear, settings, fit))
            scales.append(process_scale(fit_system(clear, **settings)))  # type: ignore[arg-type]
    if not kept:
        raise DeformError("no active control point moves freely, so nothing is estimated; add or switch on some.")
    mean = _mean_scale(scales)
    known = [None if np.isnan(mean) else mean if np.isnan(s) else s for s in scales]  # None: raises below

    def group_uncertainty(
        plain: ControlPoints, settings: dict[str, Any], sigma: float | None
    ) -> Uncertainty | _InResult:
        found = uncertainty(plain, sigma=sigma, **settings)
        if step.direction == "backward":
            return found
        return _InResult(found, fit_forward(orient_points(plain, step.direction), **settings))

    return StepUncertainty(
        points.dim,
        step.cut_regions,
        tuple(
            (sides, group_uncertainty(plain, settings, s), fit)
            for (sides, plain, settings, fit), s in zip(kept, known, strict=True)
        ),
    )
