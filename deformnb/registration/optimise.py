"""Optimisation of targets from pictures: one by one by correlation, or all together by a multiscale fit.

Both take two pictures, a moving one that the points deform and a fixed one that it should match, in the same
coordinates; or two volumes, for points in space. The result is ordinary control points. Pictures and volumes are
compared as grey values that can be sampled anywhere.

The multiscale fit maximises a measure of similarity, coarse to fine: at each level it makes an objective of the two
pictures and stores the best targets so far.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage, scipy
from deformnb._jax import HAS_JAX, float64, jax
from deformnb._typing import Progress
from deformnb.errors import DeformError, raise_missing_jax
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import check_stages, fit_one_system
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import KernelName
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import Span, TrendName, quadric_span, ridge_of, spreads_of
from deformnb.registration.similarity import (
    LOCAL_PLACES,
    Fitting,
    Measure,
    MeasureName,
    Objective,
    SampledImage,
    Value,
    find_measure,
    least_det,
    value_and_gradient,
)
from deformnb.volume.plane import Picture
from deformnb.volume.volume import VolumeLike, as_volume

Pictured: TypeAlias = Picture | VolumeLike


@dataclass(frozen=True, eq=False)
class GreyImage:
    """Grey values in [0, 1] and their places: ``index = matrix @ point + offset``, in the order of the array's axes.

    Parameters
    ----------
    values : (nv, nu) or (nz, ny, nx) float64; 0 is background.
    matrix, offset : from picture coordinates (a, b), or (x, y, z), to indices.
    """

    values: NDArray[np.float64]
    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]

    @classmethod
    def of(cls, given: Pictured) -> GreyImage:
        """The grey values of a picture, or of a volume between its background and its largest value."""
        if isinstance(given, Picture):
            (du, dv), (a, b) = given.raster.spacing, given.raster.origin
            matrix = np.array([[0.0, 1 / dv], [1 / du, 0.0]])
            return cls(given.grey().astype(np.float64), matrix, -matrix @ np.array([a, b]))
        volume = as_volume(given)
        low, high = volume.background, volume.value_range[1]
        values = np.clip((volume.finite_values.astype(np.float64) - low) / ((high - low) or 1.0), 0, 1)
        matrix = np.asarray(volume.grid.inverse[::-1], np.float64)
        return cls(values, matrix, -matrix @ np.asarray(volume.grid.origin))

    @property
    def dim(self) -> int:
        """2 for a picture, 3 for a volume."""
        return self.values.ndim

    @property
    def pixel(self) -> float:
        """The smallest distance of neighbouring pixels."""
        return float(1 / np.linalg.norm(self.matrix, axis=1).max())

    @property
    def diagonal(self) -> float:
        """Length from the first pixel to the last."""
        return float(np.linalg.norm(np.linalg.solve(self.matrix, np.array(self.values.shape) - 1.0)))

    def points(self, *indices: Any) -> NDArray[np.float64]:
        """The points (..., dim) of all combinations of indices along the axes."""
        index = np.stack(np.meshgrid(*indices, indexing="ij"), axis=-1)
        return np.asarray(np.linalg.solve(self.matrix, (index - self.offset)[..., None])[..., 0])

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at points (..., dim), linearly; background outside the outer edges of the pixels."""
        index = np.moveaxis(points @ self.matrix.T + self.offset, -1, 0)
        values = ndimage.map_coordinates(self.values, index, order=1, mode="nearest")
        return np.asarray(np.where(self.covers(points), values, 0.0))

    def covers(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """True for the points in it."""
        index = points @ self.matrix.T + self.offset
        return np.asarray(((index >= -0.5) & (index <= np.array(self.values.shape) - 0.5)).all(axis=-1))

    def smoothed(self, length: float) -> GreyImage:
        """Smoothed by a Gaussian of this standard deviation."""
        if length == 0:
            return self
        sigma = length * np.linalg.norm(self.matrix, axis=1)
        return replace(self, values=ndimage.gaussian_filter(self.values, sigma, mode="constant"))


def grey_pair(points: ControlPoints, moving: Pictured, fixed: Pictured) -> tuple[GreyImage, GreyImage]:
    """The grey values of both, refused where they do not go with the points or with one another."""
    pair = GreyImage.of(moving), GreyImage.of(fixed)
    for image, given in zip(pair, (moving, fixed), strict=True):
        if image.dim != points.dim:
            need = "pictures" if points.dim == 2 else "volumes"
            raise DeformError(
                f"control points of {points.dim} dimensions are matched on {need}, got a "
                f"{type(given).__name__}; project the volume, or take points in space."
            )
    return pair


# Nodes along each axis where folds are penalised (one block), and where they are checked after each level.
_LATTICE, _CHECKED = {2: 64, 3: 16}, {2: 128, 3: 32}
# A target moves at most this share of the diagonal at each level, and the two pictures share at least this much.
_REACH, _LEAST_SHARED = 0.25, 0.01
# Replaces a loss that is no number: two targets on one place.
_IMPOSSIBLE = 1e10
# An iteration that gains less similarity than this is the last of its level.
_ENOUGH = 1e-7


@dataclass
class MultiscaleFit:
    """Coarse-to-fine fit of the targets of points to two pictures.

    Parameters
    ----------
    first : targets, sources and settings; without pictures.
    origin, support : what its lengths are relative to.
    moving, fixed : the two pictures.
    iterations : of each level, at most.
    least : the lower bound of det J.
    progress : receives the finished share.

    Attributes
    ----------
    history : (level, similarity) of every iteration.
    """

    first: Objective
    origin: NDArray[np.float64]
    support: float
    moving: GreyImage
    fixed: GreyImage
    iterations: int
    least: float
    progress: Progress
    history: list[tuple[int, float]] = field(default_factory=list)
    _alike: float = 0.0

    def run(self, levels: Sequence[int]) -> tuple[NDArray[np.float64], float, float, float]:
        """The best relative targets, the similarity before and after, and the smallest det J."""
        checked = self._lattice(_CHECKED)
        finest = self.level(levels[-1])
        start = self.first.x
        before = _value_at(start, finest)
        floor = min(self.least, least_det(start, self.first.fitting, checked))
        x, found = start, [(before, start)]
        for k, factor in enumerate(levels):
            objective = replace(finest if factor == levels[-1] else self.level(factor), x=x)
            x = self._limit_folds(
                x, self._maximise(objective, factor, k / len(levels), 1 / len(levels)), checked, floor
            )
            found.append((_value_at(x, finest), x))
        after, x = min((f for f in found if f[0].alike >= before.alike), key=lambda f: f[0].loss)
        least = least_det(x, self.first.fitting, checked)
        self.progress(1.0)
        return x, before.alike, after.alike, least

    # -- objectives ----------------------------------------------------------------------------------------------------

    def level(self, factor: int) -> Objective:
        """Both pictures smoothed, and compared at every ``factor``-th pixel of the moving one.

        Coarse levels are stiffer by the same factor: targets that slide along something smooth there (a bone was seen
        to take one along by 17 pixels) do not find back at the finer ones.
        """
        pixel = self.moving.pixel
        moving, fixed = (
            image.smoothed(factor * pixel / 2 if factor > 1 else 0.0) for image in (self.moving, self.fixed)
        )
        indices = [np.arange((n - 1) % factor // 2, n, factor, dtype=np.float64) for n in moving.values.shape]
        places = moving.points(*indices).reshape(-1, moving.dim)
        weights = fixed.covers(places).astype(np.float64)
        if weights.mean() < _LEAST_SHARED:
            raise DeformError("the two pictures do not overlap: they must have the same coordinates.")
        blocks = self._blocks(places)
        pad = (0, blocks.shape[0] * LOCAL_PLACES - len(places))
        sampled = SampledImage(
            np.pad(moving.values, 1), moving.matrix * self.support, moving.matrix @ self.origin + moving.offset + 1
        )
        sampled, read, weights = _to_device([sampled, np.pad(fixed.at(places), pad), np.pad(weights, pad)])
        return replace(
            self.first,
            moving=sampled,
            places=_to_device(blocks),
            fixed=read,
            weights=weights,
            lattice=self._lattice(_LATTICE),
            energy=self.first.energy * factor,
            unit=factor * pixel / self.support,
        )

    def _blocks(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Relative places in whole blocks, filled up with the first of them."""
        relative = (places - self.origin) / self.support
        full = np.concatenate([relative, np.repeat(relative[:1], -len(relative) % LOCAL_PLACES, axis=0)])
        return full.reshape(-1, LOCAL_PLACES, relative.shape[1])

    def _lattice(self, counts: Mapping[int, int]) -> list[Any]:
        lines = [np.linspace(-0.5, n - 0.5, counts[self.moving.dim]) for n in self.moving.values.shape]
        return _to_device(self._blocks(self.moving.points(*lines).reshape(-1, self.moving.dim)))

    # -- one level -----------------------------------------------------------------------------------------------------

    def _maximise(self, objective: Objective, factor: int, done: float, share: float) -> NDArray[np.float64]:
        """The best targets that one level finds."""
        movable = objective.free[:, 0] > 0
        shape, most = objective.x.shape, 2 * self.iterations
        best, at, calls = np.inf, np.zeros(shape), 0

        def descend(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            nonlocal calls, best, at
            self.progress(done + share * min(calls / most, 1.0))
            calls += 1
            moves = np.zeros(shape)
            moves[movable] = flat.reshape(-1, shape[1])
            value = value_and_gradient(moves, objective)
            if not (np.isfinite(value.loss) and np.isfinite(value.slope).all()):
                return _IMPOSSIBLE, np.zeros_like(flat)
            if value.loss < best and value.least > 0:
                best, at = value.loss, moves
                self._alike = value.alike
            return value.loss, value.slope[movable].ravel()

        reach = _REACH * self.moving.diagonal / self.support / objective.unit
        size = int(movable.sum()) * shape[1]
        scipy.optimize.minimize(
            descend,
            np.zeros(size),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-reach, reach)] * size,
            callback=lambda _: self.history.append((factor, self._alike)),
            options={"maxiter": self.iterations, "maxfun": most, "ftol": _ENOUGH},
        )
        return objective.x + at * objective.unit

    def _limit_folds(
        self, before: NDArray[np.float64], after: NDArray[np.float64], checked: list[Any], floor: float
    ) -> NDArray[np.float64]:
        """As far from one towards the other as nothing folds."""
        for share in (1.0, 0.75, 0.5, 0.25, 0.1):
            x = before + share * (after - before)
            if least_det(x, self.first.fitting, checked) >= floor:
                return x
        return before


def _value_at(x: NDArray[np.float64], objective: Objective) -> Value:
    return value_and_gradient(np.zeros(x.shape), replace(objective, x=x))


def _to_device(parts: Any) -> list[Any]:
    """Each of the parts where JAX computes, in 64 bits."""
    with float64():
        return list(jax.device_put(list(parts)))


# Places that are compared at most: a picture of 512^2. Larger ones are compared at every second or third pixel.
_MOST_PLACES = 2**18
# Neighbourhood and search of a single point: a share of the picture's diagonal (15 pixels of 256 x 256), or pixels.
_SHARE, _PIXELS = 1 / 24, 10
# Below this correlation two neighbourhoods are not the same thing; noise alone was seen to reach 0.35.
_LEAST_CORRELATION = 0.6
# A place half a neighbourhood away that is as similar as this is ambiguous.
_AMBIGUOUS = 0.02
# A standard deviation of the grey values in [0, 1] below this is an even area with noise.
_EVEN = 0.01
# Lattice points from the middle of a search to its rim, at most.
_MOST_STEPS = {2: 200, 3: 24}


@dataclass(frozen=True, eq=False)
class Fitted:
    """Result of :func:`fit_targets`.

    Parameters
    ----------
    points : with the targets that were found; the ones given, if nothing better was found.
    score_before, score_after : similarity of the pictures at the finest level, larger is better.
    history : (level, similarity) of every iteration.
    least : the smallest det J of the map on a lattice over the picture; above 0 nothing is folded.
    support : the support radius of the map in physical units; points that have moved would be given another one.
    """

    points: ControlPoints
    score_before: float
    score_after: float
    history: tuple[tuple[int, float], ...]
    least: float
    support: float


def fit_targets(
    points: ControlPoints,
    moving: Pictured,
    fixed: Pictured,
    *,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
    stages: int = 1,
    measure: MeasureName = "ncc",
    energy: float = 0.005,
    levels: Sequence[int] = (4, 2, 1),
    iterations: int = 40,
    least: float = 0.05,
    progress: Progress | None = None,
) -> Fitted:
    """Move all targets so that the deformed moving picture matches the fixed one.

    The similarity is differentiated through the fit and maximised by L-BFGS-B, coarse to fine. The energy of the fit
    regularises it where the pictures are even, and a barrier where det J nears zero, so that the map does not fold.

    Parameters
    ----------
    points : control points; those that are locked or switched off stay where they are.
    moving, fixed : two pictures in one plane, or two volumes for points in space. A fixed volume, and points, in
        another unit of length are converted to that of the moving one, in which the result is.
    kernel, support, trend, smoothing, stages : of the fit, as in :class:`~deformnb.document.deformation.Step`.
    measure : a name of :data:`~deformnb.registration.similarity.MEASURES`.
    energy : how much the energy of the fit counts against the similarity, n times at level n; 0 not at all.
    levels : each level compares every n-th pixel of pictures smoothed accordingly, coarse to fine.
    iterations : of each level, at most.
    least : lower bound of det J everywhere (or its present minimum, if that is less).
    progress : called in every iteration with the finished share; raises :class:`~deformnb.errors.Cancelled` to stop.

    Raises
    ------
    DeformError
        If no point may move, the pictures share nothing, or the points cannot be fitted as they are; where JAX is not
        installed.

    Examples
    --------
    >>> from deformnb.volume.plane import Picture
    >>> from deformnb.volume.plane import Plane, Raster
    >>> raster = Raster((48, 48), (1.0, 1.0), (0.0, 0.0))
    >>> def spot(a, b):
    ...     values = np.exp(-((raster.points() - [a, b]) ** 2).sum(axis=-1) / 60)
    ...     return Picture(values, Plane((0, 0, 0), (1, 0, 0), (0, 0, -1)), raster, "slice", (0.0, 1.0))
    >>> points = ControlPoints.from_arrays([[22.0, 22.0]])
    >>> fitted = fit_targets(points, spot(22, 22), spot(26, 20), trend="translation")
    >>> fitted.points.target.round(1).tolist(), round(fitted.score_after, 2)
    ([[26.0, 20.0]], 1.0)
    """
    if not HAS_JAX:
        raise_missing_jax("a registration, which follows the derivatives of the similarity,")
    alike = find_measure(measure)
    check_stages(stages, ())
    _check_options(energy, iterations, least)
    points, fixed = _to_unit_of(moving, points, fixed)
    pair = grey_pair(points, moving, fixed)
    start = fit_one_system(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
    objective = initial_objective(points, start, smoothing, energy, alike, stages)
    search = MultiscaleFit(
        objective,
        np.asarray(start.origin),
        float(start.support),
        *pair,
        iterations,
        least,
        progress or (lambda share: None),
    )
    x, before, after, smallest = search.run(_check_levels(levels, pair[0].values.size, points.dim))
    if x is not objective.x:
        at = _positions(points, start)
        free = ~points.locked[at]
        target = points.target.copy()
        target[at[free]] = (start.origin + start.support * x[: len(at)])[free]
        points = replace(points, target=target)
    return Fitted(points, before, after, tuple(search.history), smallest, float(start.support))


def _to_unit_of(moving: Pictured, points: ControlPoints, fixed: Pictured) -> tuple[ControlPoints, Pictured]:
    """Points and the fixed image in the unit of the moving one, where both are known."""
    moving, fixed = (image if isinstance(image, Picture) else as_volume(image) for image in (moving, fixed))
    own, other = ("" if image.grid is None else image.grid.unit for image in (moving, fixed))
    if not isinstance(fixed, Picture):
        fixed = fixed.to_unit(own)
    elif own and other and own != other:
        raise DeformError(
            f"the moving picture is of a volume in {own} and the fixed one of a volume in {other}; bring "
            f'them to one unit before they are projected: volume.to_unit("{own}").'
        )
    return points.to_unit(own), fixed


def _check_options(energy: float, iterations: int, least: float) -> None:
    if not (isinstance(iterations, int | np.integer) and iterations >= 1):
        raise DeformError(f"the iterations of a fit must be a whole number from 1 on, got {iterations!r}.")
    if not (np.isfinite(energy) and energy >= 0):
        raise DeformError(f"the energy of a fit must be 0 or a positive number, got {energy}.")
    if not np.isfinite(least):
        raise DeformError(f"the least determinant of a fit must be a finite number, got {least}.")


def _check_levels(levels: Sequence[int], size: int, dim: int) -> list[int]:
    """Falling factors, none finer than the pictures can be compared at."""
    if not len(levels) or not all(isinstance(n, int | np.integer) and n >= 1 for n in levels):
        raise DeformError(f"levels must be whole numbers such as (4, 2, 1), got {levels!r:.60}.")
    finest = int(np.ceil((size / _MOST_PLACES) ** (1 / dim)))
    return sorted({max(int(n), finest) for n in levels}, reverse=True)


def _positions(points: ControlPoints, start: RBFInterpolant) -> NDArray[np.int64]:
    """Positions of the points behind the centres of a fit; refused where a fit of others would be another one."""
    at = np.array([points.index(i) for i in start.ids], dtype=np.int64)
    if len(at) < int(points.active.sum()):
        merged = [points.label(int(k)) for k in np.flatnonzero(points.active) if k not in at]
        raise DeformError(
            f"{merged[0]} is at the place of another one; move or delete it before the targets are fitted."
        )
    if points.locked[at].all():
        raise DeformError("no control point may move: all are locked or switched off, or there are none. Add some.")
    return at


def initial_objective(
    points: ControlPoints, start: RBFInterpolant, smoothing: float, energy: float, alike: Measure, stages: int
) -> Objective:
    """Targets, sources and settings of a fit, relative to its origin and support; without pictures."""
    at = _positions(points, start)
    n, size = len(at), len(start.centers)
    x, source = np.zeros((2, size, points.dim))
    free, nugget = np.zeros((size, 1)), np.ones(size)
    x[:n], source[:n] = ((a[at] - start.origin) / start.support for a in (points.target, points.source))
    free[:n, 0] = ~points.locked[at]
    nugget[:n] = smoothing / points.weight[at]
    fitting = Fitting(
        source,
        np.arange(size) < n,
        nugget,
        start.scales,
        _span(x[:n], source[:n], start),
        np.eye(points.dim),
        start.kernel,
        start.trend,
        stages,
    )
    return Objective(x, free, fitting, (), float(energy), alike)


def _span(x: NDArray[np.float64], source: NDArray[np.float64], start: RBFInterpolant) -> Span:
    """The span of the initial points: it does not change while they are fitted."""
    dim = x.shape[1]
    nothing = np.zeros((dim, dim))
    bent = quadric_span(x - x.mean(axis=0), np.eye(dim)) if start.trend == "quadratic" else (None, None)
    if start.trend in ("affine", "quadratic") and start.kernel.order < 2:
        return Span(np.eye(dim), ridge_of(*spreads_of(x, source)) if len(x) > 1 else nothing, *bent)
    sigma = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if (len(x) > dim and sigma[-1] >= 1e-6 * sigma[0]) or start.trend not in ("affine", "affine_exact", "quadratic"):
        return Span(np.eye(dim), nothing, *bent)
    if len(x) == 1:
        return Span(np.zeros((dim, 0)), nothing)
    raise DeformError(
        "the control points lie on one line or in one plane, where this affine trend is undetermined; add one "
        "off it, or take a Wendland kernel and the trend affine."
    )


@dataclass(frozen=True, eq=False)
class Snapped:
    """Result of :func:`snap_to_match`.

    Parameters
    ----------
    points : with the targets that were found.
    ids : of the points that were requested.
    score : the best correlation of each, NaN where none was searched for.
    shift : (n, dim) how each target was moved; 0 where it was left.
    left : the reason why a point was left, by its id.
    """

    points: ControlPoints
    ids: tuple[int, ...]
    score: NDArray[np.float64]
    shift: NDArray[np.float64]
    left: dict[int, str]


def snap_to_match(
    points: ControlPoints,
    ids: Sequence[int] | None,
    moving: Pictured,
    fixed: Pictured,
    *,
    radius: float | None = None,
    search: float | None = None,
    map_now: AbstractField | None = None,
    progress: Progress | None = None,
    **fit: Any,
) -> Snapped:
    """Move the target of each point to the fixed picture's best match of the patch that is at the target now.

    That patch is the neighbourhood of the source in the moving picture, deformed as it is now. The
    similarity is the normalised cross-correlation over a disc (a ball in space), at all shifts within the search
    by FFT, with a quadratic through the best and its neighbours. Every point is found separately, from the map
    as it is now. A point is left where its neighbourhood is even, where nothing matches it (correlation below
    0.6), where the best place is at the rim of the search, and where another place matches nearly as well.

    Parameters
    ----------
    points : control points.
    ids : which of them; None for all. Those that are locked or switched off are left.
    moving, fixed : two pictures in one plane, or two volumes for points in space.
    radius : of the neighbourhood, a physical length; default 1/24 of the picture's diagonal, or 10 pixels.
    search : how far a target may go; default is the radius.
    map_now : the backward displacement now; default is the fit of the points.
    progress : called for every point with the finished share.
    fit : kernel, support, trend and smoothing of :func:`~deformnb.rbf.fitting.fit_rbf`.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> from deformnb.imaging.projection import project
    >>> picture = project(PHANTOMS["fish"].make((16, 32, 16)), "-x", "mip")
    >>> points = ControlPoints.from_arrays([[250.0, 100.0]])
    >>> snapped = snap_to_match(points, None, picture, picture)
    >>> bool(np.linalg.norm(snapped.points.target - points.target) < 20)
    True
    """
    pair = grey_pair(points, moving, fixed)
    chosen = tuple(points.ids if ids is None else dict.fromkeys(int(i) for i in ids))
    near = _length(radius, max(_SHARE * pair[0].diagonal, _PIXELS * pair[0].pixel), "radius")
    window = _Window(*pair, map_now or fit_one_system(points, **fit), near, _length(search, near, "search"))
    score, shift = np.full(len(chosen), np.nan), np.zeros((len(chosen), points.dim))
    target, left = points.target.copy(), {}
    for n, point in enumerate(chosen):
        if progress is not None:
            progress(n / len(chosen))
        k = points.index(point)
        if points.locked[k] or not points.active[k]:
            left[point] = "it is locked" if points.locked[k] else "it is switched off"
            continue
        score[n], found, why = window.best(points.target[k])
        if why:
            left[point] = why
        else:
            shift[n] = found
            target[k] += found
    if progress is not None:
        progress(1.0)
    return Snapped(replace(points, target=target) if shift.any() else points, chosen, score, shift, left)


def _length(given: float | None, default: float, what: str) -> float:
    value = default if given is None else float(given)
    if not (np.isfinite(value) and value > 0):
        raise DeformError(f"the {what} must be a positive length, got {given}.")
    return value


class _Window:
    """Lattices of shifts around a point, and the similarity of the pictures at each."""

    def __init__(
        self, moving: GreyImage, fixed: GreyImage, map_now: AbstractField, radius: float, search: float
    ) -> None:
        self._moving, self._fixed, self._map, self._search = moving, fixed, map_now, search
        self._radius = max(radius, 2 * moving.pixel)
        self._step = max(min(moving.pixel, fixed.pixel), (self._radius + search) / _MOST_STEPS[moving.dim])
        near, far = (int(np.ceil(length / self._step)) for length in (self._radius, search))
        self._disc = self._offsets(near)
        self._mask = (np.linalg.norm(self._disc, axis=-1) <= self._radius).astype(np.float64)
        self._shifts, self._all = self._offsets(far), self._offsets(near + far)
        self._inside = np.linalg.norm(self._shifts, axis=-1) <= search

    def _offsets(self, count: int) -> NDArray[np.float64]:
        line = self._step * np.arange(-count, count + 1)
        return np.stack(np.meshgrid(*[line] * self._moving.dim, indexing="ij"), axis=-1)

    def best(self, target: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], str]:
        """The best correlation, the shift there, and why it is unreliable ("" if it is reliable)."""
        places = target + self._disc
        pattern = self._moving.at(places + self._map.displacement(places))
        nothing = np.zeros(len(target))
        pattern = self._mask * (pattern - (self._mask * pattern).sum() / self._mask.sum())
        if np.sqrt((pattern**2).sum() / self._mask.sum()) < _EVEN:
            return np.nan, nothing, "its surroundings are even"
        alike = self._correlation(pattern, self._fixed.at(target + self._all))
        here = np.unravel_index(int(np.where(self._inside, alike, -2.0).argmax()), alike.shape)
        score, found = float(alike[here]), self._shifts[here]
        if score < _LEAST_CORRELATION:
            return score, nothing, f"nothing within {self._search:.3g} looks like it"
        around = tuple(slice(max(i - 1, 0), i + 2) for i in here)
        if self._inside[around].size < 3 ** len(here) or not self._inside[around].all():
            return score, nothing, "the best place is at the rim of the search"
        away = self._inside & (np.linalg.norm(self._shifts - found, axis=-1) >= self._radius / 2)
        if (alike[away] > score - _AMBIGUOUS).any():
            return score, nothing, "several places look like it"
        return score, found + self._step * _peak(alike[around]), ""

    def _correlation(self, pattern: NDArray[np.float64], image: NDArray[np.float64]) -> NDArray[np.float64]:
        def sums(values: NDArray[np.float64], weights: NDArray[np.float64]) -> Any:
            return scipy.signal.correlate(values, weights, mode="valid", method="fft")

        count = self._mask.sum()
        spread = sums(image**2, self._mask) - sums(image, self._mask) ** 2 / count
        some = spread > _EVEN**2 * count
        size = np.sqrt(np.where(some, spread, 1.0) * (pattern**2).sum())
        return np.where(some, sums(image, pattern) / size, 0.0)


def _peak(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Maximum of the least-squares quadratic through 3 x 3 (x 3) values, from the middle; at most 1 away.

    >>> a, b = np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij")
    >>> _peak(1 - (a - 0.2) ** 2 - 2 * (b + 0.3) ** 2).round(6).tolist()
    [0.2, -0.3]
    """
    dim = values.ndim
    at = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    upper = np.triu_indices(dim)
    terms = np.concatenate([np.ones((len(at), 1)), at, at[:, upper[0]] * at[:, upper[1]]], axis=1)
    found = np.linalg.lstsq(terms, values.ravel(), rcond=None)[0]
    curve = np.zeros((dim, dim))
    curve[upper] = found[1 + dim :]
    curve = curve + curve.T
    if np.linalg.eigvalsh(curve).max() >= 0:
        return np.zeros(dim)
    return np.clip(np.linalg.solve(curve, -found[1 : 1 + dim]), -1, 1)
