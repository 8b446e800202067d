"""A bent subject unbent along a centre line that is drawn over it.

The line is smoothed and divided into stations of equal distance. Places on it and at offsets on both sides go to a
straight line of the same arc length, through the middle of the line in the direction from its first end to its last:
lengths along the line and widths across it stay. On the inner side of a bend the offset ends before the centre of
curvature, where the offset curves would cross. The front end does the same in ``frontend/src/maths/centre_line.ts``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformnb._typing import Floats
from deformnb.checks import check_arguments
from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints

# Places of the smoothed line, and the width of the Gaussian in distances of them: a twentieth of the line.
_FINE, _JITTER, _TAPS = 65, 2.0, 6

STATIONS = 9
"""Stations along a centre line, from end to end."""

INNER = 0.8
"""Of the radius of curvature: the largest offset on the inner side of a bend."""

_CHORD = 0.2  # of the length: with ends nearer to each other, the direction in the middle of the line counts

_WIDTH = 0.125  # of the length of the line: the usual half width


def resample_line(line: Floats, count: int) -> Floats:
    """Places (count, 2) at equal distances along a polyline (n, 2), with both ends."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0, along[-1], count)
    return np.stack([np.interp(at, along, line[:, axis]) for axis in range(2)], axis=1)


def smooth_line(line: Floats) -> Floats:
    """A drawn polyline (n, 2) without its jitter: 65 places at equal distances; its ends stay."""
    fine = resample_line(line, _FINE)
    head, tail = 2 * fine[0] - fine[_TAPS:0:-1], 2 * fine[-1] - fine[-2 : -2 - _TAPS : -1]
    padded = np.concatenate([head, fine, tail])
    weights = np.exp(-0.5 * (np.arange(-_TAPS, _TAPS + 1) / _JITTER) ** 2)
    weights /= weights.sum()
    smooth = np.stack([np.convolve(padded[:, axis], weights, mode="valid") for axis in range(2)], axis=1)
    return resample_line(smooth, _FINE)


def straightened_places(centre_line: ArrayLike, half_width: float) -> tuple[Floats, Floats]:
    """Places (n, 2) along a centre line and beside it, and where each goes when the line is straightened.

    Parameters
    ----------
    centre_line : vertices (m, 2) of a polyline on the plane of a picture.
    half_width : largest distance of the places from the line, in the same unit.

    Examples
    --------
    >>> angle = np.linspace(0, np.pi / 2, 50)
    >>> places, targets = straightened_places(100 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1), 10.0)
    >>> ends = targets[1::3][[0, -1]]
    >>> round(float(np.linalg.norm(ends[1] - ends[0])) / (100 * np.pi / 2), 2)
    1.0
    """
    line = smooth_line(np.asarray(centre_line, dtype=np.float64))
    steps = np.diff(line, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    angles = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
    bend = np.gradient(angles, length / (_FINE - 1))
    middle, chord = _FINE // 2, line[-1] - line[0]
    span = float(np.linalg.norm(chord))
    along = chord / span if span > _CHORD * length else tangents[middle]
    across = np.array([-along[1], along[0]])
    places, targets = [], []
    for k in np.linspace(0, _FINE - 1, STATIONS).round().astype(int):
        normal = np.array([-tangents[k, 1], tangents[k, 0]])
        away = length * (k / (_FINE - 1) - 0.5)
        for side in (-1.0, 0.0, 1.0):
            is_inner = side * bend[k] > 0
            offset = side * (min(half_width, INNER / abs(bend[k])) if is_inner else half_width)
            places.append(line[k] + offset * normal)
            targets.append(line[middle] + away * along + offset * across)
    return np.array(places), np.array(targets)


@check_arguments
def straighten(step: Step, centre_line: ArrayLike, half_width: float | None = None) -> Step:
    """The step with its subject unbent along a centre line that is drawn over its picture as it is seen.

    Parameters
    ----------
    step : on a picture, with one set of control points.
    centre_line : vertices (n, 2) of a polyline along the bent subject, in the coordinates of the picture.
    half_width : distance from the line to the outline of the subject, in the unit of the volume; default is an eighth
        of the length of the line.

    Returns
    -------
    The step with points along the line, named "line 1" and so on. Points that were within twice the half width of the
    line, or of where it goes, go, unless they are locked; others stay.

    Raises
    ------
    DeformError
        For a step in space or with several key pictures, for a line of fewer than two places or without length, and
        where there is a cut, on the two sides of which the same line means two maps.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.volume.plane import Plane
    >>> step = Step((ControlPoints.empty(2),), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    >>> angle = np.linspace(0, 1, 20)
    >>> bent = 80 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    >>> straight = straighten(step, bent, 8.0)
    >>> len(straight.points), bool(straight.points.displacement.any())
    (27, True)
    """
    line = np.asarray(centre_line, dtype=np.float64)
    if step.plane is None or len(step.maps) != 1 or step.cut_regions:
        raise DeformError("a step is straightened on a picture, with one set of control points and without cuts.")
    if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2 or not np.isfinite(line).all():
        raise DeformError(f"a centre line needs two or more places (a, b), got an array of shape {line.shape}.")
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    if not length > 0:
        raise DeformError("the places of the centre line are all the same; draw it along the subject.")
    width = _WIDTH * length if half_width is None else float(half_width)
    if not (np.isfinite(width) and width > 0):
        raise DeformError(f"the half width of a subject must be a positive length, got {half_width!r}.")
    places, targets = straightened_places(line, width)
    sources = places + _displacement(step, places)
    old = step.points
    near = np.concatenate([resample_line(line, _FINE), resample_line(targets[1::3], _FINE)])
    away = np.linalg.norm(old.target[:, None] - near[None], axis=2).min(axis=1, initial=np.inf)
    points = old.take(np.flatnonzero(old.locked | (away > 2 * width)))
    for k, (source, target) in enumerate(zip(sources, targets, strict=True)):
        points = points.add(source, target, name=f"line {k + 1}")
    return step.with_points(points)


def _displacement(step: Step, places: Floats) -> Floats:
    points: ControlPoints = step.points
    if not (points.displacement.any() or any(part.motion is not None for part in step.parts)):
        return np.zeros_like(places)
    return np.asarray(step.settings.fit(points, step.parts).displacement(places))
