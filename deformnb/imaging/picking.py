"""First visible surface along a ray through a volume: the place that a click on a picture of the volume points at.

The volume is seen as a renderer shows it: deformed, clipped, and by the opacities of a transfer function or as largest
values. ``frontend/src/view/body.ts`` is the same for a live view, which has the voxels in the browser.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.checks import real_array, short_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.volume.clip import WHOLE, Clip, check_clip
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer, typical_range
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volume
from deformnb.warping.warper import Warper

FAINT_VALUE = 0.02
"""Share of the window up to which a largest value is black to the eye: nothing is seen there."""

_HALF = 0.5  # of the light: a surface is where as much is stopped
_MOST_OPAQUE = 0.9999  # of one thickness, as in the renderers: a ray is never stopped by nothing
_LITTLE = 1e-9  # of a direction, along an axis: the ray runs parallel to these sides of the box


def surface_point(
    volume: VolumeLike,
    ray: tuple[ArrayLike, ArrayLike],
    transfer: TransferFunction | PresetName | None = None,
    *,
    field: AbstractField | None = None,
    method: Literal["composite", "shaded", "mip"] = "composite",
    clip: Clip = WHOLE,
    output: Grid | None = None,
) -> NDArray[np.float64] | None:
    """The first visible surface along a ray, where the accumulated opacity reaches one half.

    Parameters
    ----------
    volume : that is seen.
    ray : a place (x, y, z) that it starts at or passes through, and its direction away from the viewer; places behind
        the first one count as well, so that a parallel ray may start anywhere.
    transfer : opacities, or the name of a preset.
    field : backward displacement in space: the deformed volume is seen.
    method : "mip" for the place of the largest value; "composite" and "shaded" for opacities.
    clip : the part of the box that is seen, shares along the index axes.
    output : the grid of the result, whose box is seen; default is that of the volume.

    Returns
    -------
    The place (x, y, z). Where the opacity never reaches one half: the place that contributes most of it; for "mip" the
    first place of the largest value. None where nothing is seen.

    Raises
    ------
    DeformError
        If the ray has no direction, or the method is unknown.

    Notes
    -----
    The ray is sampled at steps of the smallest voxel side, each sample in the middle of its step. Within a step the
    light falls exponentially, so that the place is exact for what the samples say, and not only to a step.

    Examples
    --------
    >>> values = np.zeros((9, 9, 9), np.uint8)
    >>> values[3:6] = 200
    >>> opaque = TransferFunction(((0, 0, 0, 0), (200, 1, 1, 1)), ((100, 0), (100, 1)))
    >>> surface_point(values, ([4, 4, 0], [0, 0, 1]), opaque).round(1).tolist()
    [4.0, 4.0, 2.6]
    """
    if method not in ("composite", "shaded", "mip"):
        raise DeformError(f"unknown method {method!r}; choose composite, shaded or mip.")
    volume = as_volume(volume)
    start, direction = _checked_ray(ray)
    near, far = _reach(volume.grid if output is None else output, check_clip(clip), start, direction)
    step = float(min(volume.grid.spacing))
    count = int(np.ceil((far - near) / step - 1e-9))
    if count < 1:
        return None
    values = _samples(volume, field, start + (near + step / 2) * direction, direction, (count, step))
    if method == "mip":
        away = _maximum_depth(values, volume)
    else:
        away = _surface_depth(
            as_transfer(transfer, volume).channels(values)[3], step / as_transfer(transfer, volume).unit
        )
    return None if away is None else start + (near + step * away) * direction


def _checked_ray(ray: tuple[ArrayLike, ArrayLike]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    given = real_array(ray)
    if given is None or given.shape != (2, 3) or not np.isfinite(given).all() or not given[1].any():
        raise DeformError(f"a ray is a place and a direction (x, y, z), got {short_value(ray)}.")
    return given[0], given[1] / np.linalg.norm(given[1])


def _reach(grid: Grid, clip: Clip, start: NDArray[np.float64], direction: NDArray[np.float64]) -> tuple[float, float]:
    """The lengths along a ray between which it is in the visible box; the second is smaller where it misses it."""
    count = np.asarray(grid.shape[::-1], float)
    shares = np.asarray(clip)
    low, high = shares[:, 0] * count - 0.5, shares[:, 1] * count - 0.5
    first, slope = grid.point_to_index(start), grid.inverse @ direction
    slope = np.where(np.abs(slope) < _LITTLE, _LITTLE, slope)
    ends = np.stack([(low - first) / slope, (high - first) / slope])
    return float(ends.min(axis=0).max()), float(ends.max(axis=0).min())


def _samples(
    volume: Volume,
    field: AbstractField | None,
    first: NDArray[np.float64],
    direction: NDArray[np.float64],
    steps: tuple[int, float],
) -> NDArray[np.generic]:
    """The values of the deformed volume along a ray."""
    aside = np.cross(direction, np.eye(3)[int(np.abs(direction).argmin())])
    aside /= np.linalg.norm(aside)
    axes = np.stack([direction, aside, np.cross(direction, aside)], axis=1)
    count, step = steps
    line = Grid(
        (1, 1, count),
        (step,) * 3,
        tuple(first),
        tuple(map(tuple, axes)),  # type: ignore[arg-type]  # mypy counts no axes
        volume.grid.unit,
    )
    return Warper(volume, output=line)(Identity(3) if field is None else field).values[0, 0]


def _surface_depth(alphas: NDArray[np.float64], thickness: float) -> float | None:
    """Steps to the place where half of the light is stopped, else to the middle of the step that stops most."""
    lost = -thickness * np.log1p(-np.minimum(alphas, _MOST_OPAQUE))  # logarithm of the light that each step stops
    total = np.cumsum(lost)
    first = int(np.searchsorted(total, -np.log(1 - _HALF)))
    if first < len(total):
        return float(first + (-np.log(1 - _HALF) - (total[first] - lost[first])) / lost[first])
    stopped = np.exp(-(total - lost)) - np.exp(-total)
    most = int(stopped.argmax())
    return most + 0.5 if stopped[most] > 0 else None


def _maximum_depth(values: NDArray[np.generic], volume: Volume) -> float | None:
    """Steps to the first of the largest values; None where it is black.

    Values that differ by less than a grey level are alike: in an even body the first one is its surface, where rounding
    would choose any.
    """
    low, high = typical_range(volume)
    numbers = np.nan_to_num(values.astype(np.float64), nan=low)
    most = float(numbers.max())
    if most <= low + FAINT_VALUE * (high - low):
        return None
    return float((numbers >= most - (high - low) / 255).argmax()) + 0.5
