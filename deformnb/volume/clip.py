"""Clipping of a volume along its axes, so that its inside can be seen."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import check_fields, real_array, short_value
from deformnb.errors import DeformError
from deformnb.volume.volume import Grid, Volume

Clip: TypeAlias = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""Of the box along the index axes x, y, z: the lowest and the highest share that is seen, from 0 to 1."""

WHOLE: Clip = ((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))
"""Nothing is cut away."""


def check_clip(value: Any) -> Clip:
    """Three pairs of shares as plain numbers.

    Raises
    ------
    DeformError
        If they are not three pairs, or one is not within 0 and 1, or does not rise.

    Examples
    --------
    >>> check_clip([(0, 1), (0.25, 1), (0, 0.5)])
    ((0.0, 1.0), (0.25, 1.0), (0.0, 0.5))
    """
    try:
        pairs = np.asarray([list(pair) for pair in value] if isinstance(value, Iterable) else None, dtype=np.float64)
    except (TypeError, ValueError):
        pairs = np.empty(0)
    if pairs.shape != (3, 2):
        raise DeformError(f"a clip is three pairs (low, high) along x, y and z, got {value!r}.")
    if not all(0 <= low < high <= 1 for low, high in pairs.tolist()):
        raise DeformError(
            f"the shares of a clip rise within 0 and 1, such as (0, 0.5) for the lower half, got {pairs.tolist()}."
        )
    (a, b), (c, d), (e, f) = (pairs + 0.0).tolist()  # no -0.0
    return (a, b), (c, d), (e, f)


def framed_box(own: Grid, shown: Grid | None, frame: Clip) -> Grid:
    """The box that a view's camera frames: a part of a volume's own, and what the shown box has beyond that.

    Parameters
    ----------
    own : grid of the volume.
    shown : grid whose box is seen; None for the volume's own.
    frame : shares (low, high) of the own box along x, y and z.

    Examples
    --------
    >>> framed_box(Grid((4, 4, 8)), None, ((0.25, 0.75), (0, 1), (0, 1))).lengths
    (4.0, 4.0, 4.0)
    """
    if frame == WHOLE:
        return own if shown is None else shown
    scale, last = np.asarray(own.spacing), np.asarray(own.shape[::-1]) - 0.5
    low, high = (-0.5 + np.asarray(frame).T * (last + 0.5)) * scale
    if shown is not None:
        corners = own.point_to_index(shown.corners()) * scale
        least, most = corners.min(axis=0), corners.max(axis=0)
        slack = 1e-6 * scale
        low = np.where(least < -0.5 * scale - slack, np.minimum(low, least), low)
        high = np.where(most > last * scale + slack, np.maximum(high, most), high)
    middle = own.index_to_point((low + high) / 2 / scale)
    return Grid((1, 1, 1), tuple(high - low), tuple(middle), own.direction, own.unit)


@dataclass(frozen=True)
class ClipBox:
    """A box along the index axes of a grid, open where nothing is cut away.

    Parameters
    ----------
    grid : whose axes it follows.
    low, high : its sides as (i, j, k) indices of the grid; -inf and inf where it is open.
    """

    grid: Grid
    low: tuple[float, ...]
    high: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self, "grid")
        for name in ("low", "high"):
            sides = real_array(getattr(self, name))
            if sides is None or sides.shape != (3,) or np.isnan(sides).any():
                raise DeformError(
                    f"the {name} sides of a part are three indices (i, j, k), -inf or inf, got "
                    f"{short_value(getattr(self, name))}."
                )
            object.__setattr__(self, name, tuple(sides.tolist()))

    @classmethod
    def of(cls, grid: Grid, clip: Clip, box: Grid | None = None) -> ClipBox | None:
        """The part of a box that a clip leaves, or None for all of it.

        Parameters
        ----------
        grid : whose axes the shares follow.
        box : of which they are shares; default is the grid's own.

        Examples
        --------
        >>> ClipBox.of(Grid((2, 2, 10)), ((0.5, 1), (0, 1), (0, 1))).low
        (4.5, -inf, -inf)
        """
        if clip == WHOLE:
            return None
        corners = grid.point_to_index((box or grid).corners())
        start, end = corners.min(axis=0), corners.max(axis=0)
        shares = np.asarray(clip)
        low = np.where(shares[:, 0] > 0, start + shares[:, 0] * (end - start), -np.inf)
        high = np.where(shares[:, 1] < 1, start + shares[:, 1] * (end - start), np.inf)
        return cls(grid, tuple(low.tolist()), tuple(high.tolist()))

    @classmethod
    def whole(cls, grid: Grid) -> ClipBox:
        """The box of a grid itself, with its six sides."""
        return cls(grid, (-0.5,) * 3, tuple(n - 0.5 for n in grid.shape[::-1]))

    def contains(self, lattice: Grid) -> NDArray[np.bool_]:
        """Mask [z, y, x] of the voxels of another grid whose centres are in it."""
        to_index = self.grid.inverse
        steps, first = to_index @ lattice.matrix, self.grid.point_to_index(lattice.origin)
        nz, ny, nx = (np.arange(n, dtype=np.float32) for n in lattice.shape)
        held = np.ones(lattice.shape, bool)
        for axis, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            if np.isinf(low) and np.isinf(high):
                continue
            di, dj, dk = (np.float32(c) for c in steps[axis])
            at = np.float32(first[axis]) + dk * nz[:, None, None] + (dj * ny[:, None] + di * nx)
            held &= (at >= low) & (at < high)
        return held

    def sides(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A place (6, 3) on each side and the direction (6, 3) inwards; an open side is far away."""
        far = 1e6 * max(self.grid.shape)
        ends = np.clip([self.low, self.high], -far, far)
        index = np.array([np.where(np.arange(3) == axis, end, 0.0) for end in ends for axis in range(3)])
        axes = np.asarray(self.grid.direction).T
        return self.grid.index_to_point(index), np.concatenate([axes, -axes])

    def mask_outside(self, volume: Volume) -> Volume:
        """The volume with background in all voxels outside."""
        values = np.where(self.contains(volume.grid), volume.finite_values, volume.dtype.type(volume.background))
        return replace(volume, values=values)
