"""Outlines of the foreground of a picture, and points that slide along them: semi-landmarks.

On a smooth outline nothing determines which place of one is which of another. Points are put along both by arc
length to begin with, and then slide along the target's outline to where the thin-plate spline of all points bends
least (F. L. Bookstein, Medical Image Analysis 1 (1997) 225-243). The sources stay, so that the bending energy is a
quadratic form of the targets: the best shifts along the tangents come from one linear system. They are walked along the
outline itself, not along the tangent, and no further than the energy falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._typing import Floats, Progress
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture

# An outline around less than this share of the picture is a speck.
_SPECK = 1e-3
# Places compared to match the starts of two outlines.
_COMPARED = 512
# A target within this share of an outline's extent is on it: far above rounding, far below a pixel.
_ON_IT = 1e-6
# A point slides at most this share of the gap to its neighbour in one iteration, so that none overtakes another, and
# comes no nearer to it than this share of an even spacing: two dissimilar outlines would pile points on one place.
_STRIDE, _NEAREST = 0.45, 0.15
# Less than this share of the energy is no progress; at its smallest the share is of rounding only.
_ENOUGH, _NO_ENERGY = 1e-9, 1e-20


def outline(picture: Picture, level: float | None = None) -> list[Floats]:
    """The closed outlines of the subject of a picture, by marching squares.

    Parameters
    ----------
    picture : its grey values between black and white of its window are taken.
    level : grey value in [0, 1] of the outline; default parts dark from bright best (:func:`dark_and_bright`).

    Returns
    -------
    Polylines (n, 2) in picture coordinates, the first point not repeated, the one around the largest area first. Those
    around something bright have a positive area (a to the right, b down: clockwise to the eye), holes a negative one.
    Specks below 1/1000 of the picture are left out.

    Examples
    --------
    >>> from deformnb.volume.plane import Plane, Raster
    >>> raster = Raster((40, 40), (1.0, 1.0), (0.0, 0.0))
    >>> disc = np.clip(12.5 - np.hypot(*(raster.points() - 20).transpose(2, 0, 1)), 0, 1)
    >>> [line] = outline(Picture(disc, Plane((0, 0, 0), (1, 0, 0), (0, 0, -1)), raster, "slice", (0.0, 1.0)), 0.5)
    >>> round(area(line) / (np.pi * 12**2), 2)
    1.0
    """
    from contourpy import contour_generator

    grey = picture.grey().astype(np.float64)
    value = dark_and_bright(grey) if level is None else float(level)
    if not 0 < value < 1:
        raise DeformError(f"the level of an outline must be between 0 (black) and 1 (white), got {level}.")
    raster = picture.raster
    rim = np.pad(grey, 1)  # outlines that leave the picture are closed along its edge
    lines = contour_generator(z=rim).lines(value)
    least = _SPECK * grey.size * raster.spacing[0] * raster.spacing[1]
    found = []
    for line in lines:
        points = np.asarray(line, dtype=np.float64)[:-1] - 1  # back from the rim, without the repeated end
        points = np.clip(points, -0.5, np.array(grey.shape[::-1]) - 0.5) * raster.spacing + raster.origin
        points = points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > 0]
        if len(points) >= 3 and abs(area(points)) >= least:
            found.append(points)
    found.sort(key=lambda line: -abs(area(line)))
    return _bright_inside(found)


def _bright_inside(lines: list[Floats]) -> list[Floats]:
    """All reversed if the largest is negative: with the rim dark, the largest is around something bright."""
    return [line[::-1].copy() for line in lines] if lines and area(lines[0]) < 0 else lines


def dark_and_bright(grey: NDArray[Any]) -> float:
    """The grey value that parts dark from bright: the variance between the two is largest (N. Otsu, 1979).

    >>> dark_and_bright(np.array([0.1] * 50 + [0.12] * 50 + [0.8] * 30))
    0.4541
    """
    count, edges = np.histogram(grey, bins=256, range=(0.0, 1.0))
    middle = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(count)
    above = below[-1] - below
    sums = np.cumsum(count * middle)
    parted = (below > 0) & (above > 0)
    if not parted.any():
        raise DeformError("the picture has one grey value only; there is no outline in it.")
    low, high = sums[parted] / below[parted], (sums[-1] - sums[parted]) / above[parted]
    between = below[parted] * above[parted] * (high - low) ** 2
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    return round(float((low[best[0]] + high[best[0]]) / 2), 4)


def area(line: ArrayLike) -> float:
    """The area inside a closed polyline (n, 2); negative if it runs the other way."""
    a, b = np.asarray(line, dtype=np.float64).T
    return float((a * np.roll(b, -1) - np.roll(a, -1) * b).sum() / 2)


class ClosedCurve:
    """A polyline (n, 2), closed by default, parameterised by arc length."""

    def __init__(self, line: ArrayLike, closed: bool = True) -> None:
        try:
            points = np.asarray(line, dtype=np.float64)
        except (TypeError, ValueError):
            raise DeformError(f"an outline must be finite points of shape (n, 2), got {line!r:.60}.") from None
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2 or not np.isfinite(points).all():
            raise DeformError(f"an outline must be finite points of shape (n, 2), got {points.shape}.")
        self.closed = closed
        ring = np.concatenate([points, points[:1]]) if closed else points
        step = np.linalg.norm(np.diff(ring, axis=0), axis=1)
        keep = np.concatenate([[True], step > 0])
        self.ring, self.at_vertex = ring[keep], np.concatenate([[0.0], np.cumsum(step[step > 0])])
        if self.length == 0:
            raise DeformError("all points of an outline are at one place.")

    @property
    def length(self) -> float:
        """Once along it."""
        return float(self.at_vertex[-1])

    def wrap(self, s: Floats) -> Floats:
        """Arc lengths wrapped to [0, length]."""
        return np.asarray(s % self.length if self.closed else np.clip(s, 0, self.length))

    def at(self, s: ArrayLike) -> Floats:
        """Points (..., 2) at arc lengths."""
        s = self.wrap(np.asarray(s, dtype=np.float64))
        k = np.clip(np.searchsorted(self.at_vertex, s, side="right") - 1, 0, len(self.ring) - 2)
        first, last = self.ring[k], self.ring[k + 1]
        t = (s - self.at_vertex[k]) / (self.at_vertex[k + 1] - self.at_vertex[k])
        return np.asarray(first + t[..., None] * (last - first))

    def tangent(self, s: Floats) -> Floats:
        """Directions (..., 2) along it: chords as long as two of its segments, so that they turn gradually."""
        reach = self.length / (len(self.ring) - 1)
        chord = self.at(s + reach) - self.at(s - reach)
        size = np.linalg.norm(chord, axis=-1, keepdims=True)
        return np.asarray(chord / np.where(size > 0, size, 1.0))

    def nearest(self, point: Floats) -> tuple[float, float]:
        """Arc length of the nearest place, and its distance."""
        first, way = self.ring[:-1], np.diff(self.ring, axis=0)
        t = np.clip(((point - first) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
        gap = np.linalg.norm(first + t[:, None] * way - point, axis=1)
        k = int(gap.argmin())
        return float(self.at_vertex[k] + t[k] * np.linalg.norm(way[k])), float(gap[k])


@dataclass(frozen=True, eq=False)
class Slid:
    """Points that slid along outlines.

    Parameters
    ----------
    points : with their new targets; ids : those that slid.
    energy : of bending, before the first step and after each; it never rises.
    """

    points: ControlPoints
    ids: tuple[int, ...]
    energy: tuple[float, ...]


def fit_outline(
    points: ControlPoints,
    source_outline: ArrayLike,
    target_outline: ArrayLike,
    *,
    count: int = 24,
    iterations: int = 30,
    progress: Progress | None = None,
) -> Slid:
    """Add points along one outline that go to another one.

    They are spread evenly by arc length on both; where the second begins is chosen so that the two, with equal
    middles and sizes, are closest. Then they :func:`slide` along the target's outline.

    Parameters
    ----------
    points : existing ones; they stay and take part in the energy.
    source_outline, target_outline : closed polylines (n, 2), such as :func:`outline` gives.
    count : how many points are added.
    iterations : of the sliding; 0 leaves them as the arc length has them.
    progress : receives the finished share.

    Examples
    --------
    >>> square = np.array([[0, 0], [40, 0], [40, 40], [0, 40]], float)
    >>> found = fit_outline(ControlPoints.from_arrays([[20.0, 20.0]]), square, square * (1.5, 1), count=8)
    >>> len(found.points)
    9
    """
    if not (isinstance(count, int | np.integer) and 3 <= count <= 500):
        raise DeformError(f"an outline takes 3 to 500 points, got {count!r}.")
    if points.dim != 2:
        raise DeformError("outlines are curves on a picture; points in space have none.")
    source, target = (
        ClosedCurve(line if area(ClosedCurve(line).ring) > 0 else np.asarray(line)[::-1])
        for line in (source_outline, target_outline)
    )
    share = np.arange(count) / count
    ends = target.at((share + _begins(source, target)) * target.length)
    added = points
    for k, (start, end) in enumerate(zip(source.at(share * source.length), ends, strict=True)):
        added = added.add(start, end, name=f"outline {k + 1}")
    new = added.ids[len(points) :]
    return slide(added, [target.ring[:-1]], ids=new, iterations=iterations, progress=progress)


OUTLINE_POINT = "outline"
"""Name of the points that :func:`fix_outline` adds."""


def fix_outline(points: ControlPoints, line: ArrayLike, *, count: int = 16) -> ControlPoints:
    """Add points that stay, spread evenly by arc length along an outline: drags bend only the places around them.

    Those of an earlier call that have not been moved make room. None is added within half of the spacing of another
    point, so that the outline itself can be dragged.

    Parameters
    ----------
    points : control points of a picture.
    line : a closed polyline (n, 2), such as :func:`outline` gives.
    count : how many places there are along the outline.

    Examples
    --------
    >>> square = [[0, 0], [40, 0], [40, 40], [0, 40]]
    >>> held = fix_outline(ControlPoints.from_arrays([[40.0, 20.0]], [[60.0, 20.0]]), square, count=8)
    >>> len(held), held.names.count(OUTLINE_POINT)
    (8, 7)
    """
    if points.dim != 2:
        raise DeformError("outlines are curves on a picture; points in space have none.")
    if not (isinstance(count, int | np.integer) and 3 <= count <= 500):
        raise DeformError(f"an outline takes 3 to 500 points, got {count!r}.")
    curve, moved = ClosedCurve(line), np.any(points.displacement != 0, axis=1)
    kept = points.take([k for k, name in enumerate(points.names) if name != OUTLINE_POINT or moved[k]])
    free = curve.length / count / 2
    taken = np.concatenate([kept.source, kept.target])
    for place in curve.at(np.arange(count) * curve.length / count):
        if not (np.linalg.norm(taken - place, axis=1) < free).any():
            kept = kept.add(place, name=OUTLINE_POINT)
    return kept


def _begins(source: ClosedCurve, target: ClosedCurve) -> float:
    """The share of the target's length at which it is closest to the source's beginning, over all of both."""
    share = np.arange(_COMPARED) / _COMPARED
    one, other = (_normalize(curve.at(share * curve.length)) for curve in (source, target))
    alike = np.fft.ifft(np.conj(np.fft.fft(one)) * np.fft.fft(other)).real
    return float(share[int(alike.argmax())])


def _normalize(points: Floats) -> NDArray[np.complex128]:
    z = points[:, 0] + 1j * points[:, 1]
    z = z - z.mean()
    return np.asarray(z / np.sqrt((np.abs(z) ** 2).mean()))


def slide(
    points: ControlPoints,
    curves: Sequence[ArrayLike],
    *,
    fixed_ids: Sequence[int] = (),
    ids: Sequence[int] | None = None,
    iterations: int = 30,
    closed: bool = True,
    progress: Progress | None = None,
) -> Slid:
    """Slide targets along their outlines to where the thin-plate spline of all active points bends least.

    Parameters
    ----------
    points : control points of a picture. Locked ones stay.
    curves : polylines (n, 2).
    fixed_ids : true landmarks, which stay although they are on an outline.
    ids : which points slide; they are put onto the nearest outline first. Default: all whose targets are on one.
    iterations : at most.
    closed : whether the polylines go back to where they begin.
    progress : receives the finished share; raises :class:`~deformnb.errors.Cancelled` to stop.

    Raises
    ------
    DeformError
        If nothing can slide, or sources coincide or are on one line, so that there is no thin-plate spline.

    Examples
    --------
    >>> square = [[0, 0], [40, 0], [40, 40], [0, 40]]
    >>> points = ControlPoints.from_arrays([[0, 0], [40, 0], [40, 40], [0, 40], [20, 0]],
    ...                                    [[0, 0], [40, 0], [40, 40], [0, 40], [30, 0]])
    >>> slid = slide(points, [square], fixed_ids=[0, 1, 2, 3])
    >>> slid.points.target[4].round(1).tolist()
    [20.0, 0.0]
    """
    lines = [ClosedCurve(curve, closed) for curve in curves]
    if points.dim != 2 or not lines:
        raise DeformError("points slide along outlines on a picture: give points of a picture and an outline at least.")
    for point in (*fixed_ids, *(ids or ())):
        points.index(point)
    found = _curve_positions(points, lines, set(fixed_ids), ids)
    if not found:
        raise DeformError("no point can slide: none that is free is on the outline.")
    active = np.flatnonzero(points.active)
    sliding = _Sliding(
        points.source[active],
        points.target[active],
        [(int(np.searchsorted(active, k)), curve, s) for k, curve, s in found],
    )
    energy = [sliding.energy(sliding.s)]
    for n in range(iterations):
        if progress is not None:
            progress(n / iterations)
        step = sliding.step(energy[-1])
        if step is None:
            break
        energy.append(step)
    if progress is not None:
        progress(1.0)
    target = points.target.copy()
    target[active] = sliding.targets(sliding.s)
    return Slid(replace(points, target=target), tuple(points.ids[k] for k, _, _ in found), tuple(energy))


def _curve_positions(
    points: ControlPoints, lines: list[ClosedCurve], fixed: set[int], ids: Sequence[int] | None
) -> list[tuple[int, ClosedCurve, float]]:
    """Position, outline and arc length of every point that slides."""
    found = []
    for k, point in enumerate(points.ids):
        if point in fixed or points.locked[k] or not points.active[k] or (ids is not None and point not in ids):
            continue
        places = [line.nearest(points.target[k]) for line in lines]
        best = int(np.argmin([gap for _, gap in places]))
        if ids is not None or places[best][1] <= _ON_IT * lines[best].length:
            found.append((k, lines[best], places[best][0]))
    return found


class _Sliding:
    """Arc lengths of the points that slide, and the bending energy as a function of them."""

    def __init__(self, source: Floats, target: Floats, found: list[tuple[int, ClosedCurve, float]]) -> None:
        self._bending, self._target = bending_matrix(source), target
        self._at = np.array([k for k, _, _ in found])
        self._curves = [curve for _, curve, _ in found]
        self.s = np.array([s for _, _, s in found])

    def targets(self, s: Floats) -> Floats:
        y = self._target.copy()
        y[self._at] = [curve.at(one) for curve, one in zip(self._curves, s, strict=True)]
        return y

    def energy(self, s: Floats) -> float:
        y = self.targets(s)
        y = y - y.mean(axis=0)  # the energy does not see it, its rounding does
        return max(0.0, float((y * (self._bending @ y)).sum()))

    def step(self, energy: float) -> float | None:
        """One step downhill; the energy after it, or None at the bottom."""
        tangent = np.array([curve.tangent(np.array(s)) for curve, s in zip(self._curves, self.s, strict=True)])
        y = self.targets(self.s)
        pull = (tangent * (self._bending @ (y - y.mean(axis=0)))[self._at]).sum(axis=1)
        stiff = (tangent @ tangent.T) * self._bending[np.ix_(self._at, self._at)]
        way = -np.linalg.lstsq(stiff, pull, rcond=1e-10)[0]
        room = _STRIDE * self._room()
        way = np.clip(way, -room, room)
        for _ in range(12):
            after = self.energy(self.s + way)
            if after < energy * (1 - _ENOUGH) - _NO_ENERGY:
                self.s = self.s + way
                return after
            way = way / 2
        return None

    def _room(self) -> Floats:
        """The distance that each point may move towards its nearer neighbour on the same outline."""
        room = np.array([curve.length for curve in self._curves])
        for curve in {id(c): c for c in self._curves}.values():
            on = np.array([k for k, c in enumerate(self._curves) if c is curve])
            s = curve.wrap(self.s[on])
            order = np.argsort(s)
            if len(on) > 1:
                step = np.diff(s[order], append=s[order[0]] + (curve.length if curve.closed else np.inf))
                least = _NEAREST * curve.length / len(on)
                room[on[order]] = np.maximum(np.minimum(step, np.roll(step, 1)) - least, 0.0)
        return room


def bending_matrix(source: ArrayLike) -> Floats:
    """Bookstein's bending-energy matrix of places (n, 2): y^T B y for values y (n,) of a thin-plate spline there.

    Scaled to the integral of the squared second derivatives, as :func:`deformnb.analysis.quality.bending_energy` is.
    """
    x = np.asarray(source, dtype=np.float64)
    n, size = len(x), float(np.linalg.norm(np.ptp(x, axis=0))) or 1.0
    x = (x - x.mean(axis=0)) / size
    square = ((x[:, None] - x[None]) ** 2).sum(axis=-1)
    kernel = 0.5 * square * np.log(np.where(square > 0, square, 1.0))
    p = np.concatenate([np.ones((n, 1)), x], axis=1)
    # On what no affine map reaches the kernel is definite, so one half of a factor decides whether there is a spline.
    free = scipy.linalg.null_space(p.T)
    inner = free.T @ kernel @ free
    values = np.linalg.eigvalsh(inner) if n > 3 else np.ones(1)
    if n - free.shape[1] < 3 or values.min() < 1e-12 * values.max():
        raise DeformError(
            "the sources lie on one line, or two of them at one place: no thin-plate spline passes through "
            "them. Move or remove one."
        )
    return np.asarray(8 * np.pi / size**2 * free @ np.linalg.solve(inner, free.T))
