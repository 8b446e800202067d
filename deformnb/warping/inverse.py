"""Inverse of a whole map at all nodes of a lattice, with a certificate at each of them.

A backward field D gives for each place y of the result the source of its value, ``x = y + D(y)``. Its inverse F gives
for each place x of the input the destination of its tissue, ``y = x + F(x)``. Every node is solved on its own by
Newton's method (:mod:`deformnb.warping.points`) to a residual ``|y + D(y) - x|`` that is measured at the very value
returned.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Floats, Progress
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import unchanging_axes
from deformnb.rbf.fields import AbstractField, DisplacementField, HasField, as_field
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, VolumeLike, as_grid
from deformnb.warping.points import (
    POINTS_AT_A_TIME,
    Landmarks,
    check_points,
    default_tolerance,
    deform_places,
    warp_points,
)

# A thousandth of the smallest step of the lattice: far less than what linear interpolation between nodes errs by.
_NODE_TOLERANCE = 1e-3

# Values are stored in float32 unless the tolerance is a smaller share of the step than its digits can hold.
_SINGLE = 1e-4


@dataclass(frozen=True, eq=False)
class Inverse:
    """The inverse of a backward field on a lattice.

    Parameters
    ----------
    field : forward displacements F, ``(*shape, dim)``, at the nodes x, ``y = x + F(x)``, read linearly in between.
        Warping by it undoes what warping by the field does.
    error : ``(*shape)`` float32, the residual ``|y + D(y) - x|`` at each node, a length.
    reached : ``(*shape)`` bool; False where the residual is beyond the tolerance: no place of the result shows this
        tissue, or none was found. F is there the best place known, and no promise.
    tolerance : the largest residual of a node that counts as reached.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.volume.plane import Raster
    >>> invert(Identity(2), Raster((4, 4), (1.0, 1.0), (0.0, 0.0))).share
    1.0
    """

    field: DisplacementField
    error: NDArray[np.float32]
    reached: NDArray[np.bool_]
    tolerance: float

    def __repr__(self) -> str:
        return f"<Inverse: {self.field}, {100 * self.share:.4g} % of the nodes reached within {self.tolerance:.3g}>"

    @property
    def share(self) -> float:
        """The part of the nodes that was reached, from 0 to 1."""
        return float(np.mean(self.reached))


@dataclass(frozen=True)
class RoundTrip:
    """Round-trip error: the distance of points from their own place after mapping forward and back.

    Parameters
    ----------
    worst, mean : lengths, of the points that have a place in the result; 0 without any.
    reached : the part of the points that have, from 0 to 1.

    Examples
    --------
    >>> RoundTrip(0.02, 0.001, 1.0).worst
    0.02
    """

    worst: float
    mean: float
    reached: float


def invert(
    field: AbstractField | HasField,
    lattice: Grid | Raster | VolumeLike,
    *,
    grid: Grid | VolumeLike | None = None,
    tolerance: float | None = None,
    progress: Progress | None = None,
) -> Inverse:
    """Forward displacements at all nodes of a lattice: F with ``y = x + F(x)`` and ``y + D(y) = x``.

    A field that is the same on every slice of the grid is inverted on one of them. Where a map folds, one of several
    places is found. At a cut tissue moves with its region; tissue hidden behind other tissue, or by the
    paper's rule, is not reached.

    Parameters
    ----------
    field : backward displacements of any kind, of the lattice's dimension; or a Deformation.
    lattice : a Grid or a Volume in space, or a Raster for a field over a plane.
    grid : of the volume that a Deformation deforms, if that is not the lattice.
    tolerance : largest residual, a length; default is a thousandth of the lattice's smallest step.
    progress : called with the finished share from 0 to 1 after every block; may raise
        :class:`~deformnb.errors.Cancelled`, which is passed on.

    Returns
    -------
    Inverse, with the residual of every node and a mask of those that were reached.

    Raises
    ------
    DeformError
        If the field has not the lattice's dimension or the tolerance is not positive.

    Notes
    -----
    Between nodes F is interpolated, which adds ``h^2 / 8`` times its second derivative; the certificate is for nodes.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> grown = fit_rbf(ControlPoints.from_arrays([[0, 0], [1, 0], [0, 1]], [[0, 0], [2, 0], [0, 2]]))  # twice as large
    >>> inverse = invert(grown, Raster((3, 3), (1.0, 1.0), (0.0, 0.0)))
    >>> inverse.field.displacement([[1.0, 0.0], [2.0, 1.5]]).round(5).tolist(), inverse.share
    ([[1.0, 0.0], [2.0, 1.5]], 1.0)
    """
    if not isinstance(lattice, Raster):
        lattice = as_grid(lattice)
        grid = lattice if grid is None else grid
    field = as_field(field, grid)
    step = float(min(lattice.spacing))
    tolerance = _NODE_TOLERANCE * step if tolerance is None else float(tolerance)
    if field.dim != len(lattice.shape):
        raise DeformError(f"a field of dimension {field.dim} has no inverse on a lattice of {len(lattice.shape)} axes.")
    if not tolerance > 0:  # NaN as well
        raise DeformError(f"the tolerance of an inverse must be a positive length, got {tolerance}.")
    dtype = np.float32 if tolerance >= _SINGLE * step else np.float64
    # Rotated by less than this, a slice far away is off by a millionth of its distance times that.
    same = unchanging_axes(field, lattice, 1e-10) if isinstance(lattice, Grid) else ()
    if isinstance(lattice, Raster) or not same:
        return _invert(field, lattice, tolerance, dtype, progress)
    axis = min(same)
    shape = tuple(1 if k == axis else n for k, n in enumerate(lattice.shape))
    one = _invert(field, replace(lattice, shape=shape), tolerance, dtype, progress)  # type: ignore[arg-type]
    count = lattice.shape[axis]
    values = DisplacementField(np.repeat(one.field.values, count, axis=axis), lattice)
    return Inverse(values, np.repeat(one.error, count, axis=axis), np.repeat(one.reached, count, axis=axis), tolerance)


def round_trip(
    field: AbstractField | HasField, points: ArrayLike | Landmarks, *, grid: Grid | VolumeLike | None = None
) -> RoundTrip:
    """Points forward by the inverse of the map and back by the map itself: the bound of the result, measured.

    Parameters
    ----------
    field : backward displacements, or a Deformation.
    points : (..., dim), physical, in the input; or landmarks.
    grid : of the volume that is deformed; needed for a Deformation.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> round_trip(Identity(2), [[3.0, 4.0]])
    RoundTrip(worst=0.0, mean=0.0, reached=1.0)
    """
    field = as_field(field, grid)
    x = check_points(points, field, grid).reshape(-1, field.dim)
    if not len(x):
        return RoundTrip(0.0, 0.0, 1.0)
    tolerance = default_tolerance(x, field)
    y, found = warp_points(x, field, tolerance=tolerance)
    error = np.linalg.norm(y + field.displacement(y) - x, axis=1)
    found &= error <= 2 * tolerance  # tissue behind other tissue at a cut is not visible at y
    if not found.any():
        return RoundTrip(0.0, 0.0, 0.0)
    return RoundTrip(float(error[found].max()), float(error[found].mean()), float(found.mean()))


def _invert(
    field: AbstractField, lattice: Grid | Raster, tolerance: float, dtype: Any, progress: Progress | None
) -> Inverse:
    """Node by node, in blocks."""
    count, dim = int(np.prod(lattice.shape)), field.dim
    values = np.empty((count, dim), dtype)
    error, reached = np.empty(count, np.float32), np.empty(count, bool)
    for part, x in _nodes(lattice):
        y, found = deform_places(x, field, tolerance / 2)  # half is left for the rounding of the stored values
        values[part] = y - x
        y = x + values[part]  # as it is returned, rounded
        left = np.linalg.norm(y + field.displacement(y) - x, axis=1)
        error[part], reached[part] = left, found & (left <= tolerance)
        if progress is not None:
            progress(min(1.0, part.stop / count))
    shape = lattice.shape
    return Inverse(
        DisplacementField(values.reshape(*shape, dim), lattice), error.reshape(shape), reached.reshape(shape), tolerance
    )


def _nodes(lattice: Grid | Raster) -> Iterator[tuple[slice, Floats]]:
    """The nodes (n, dim) of a lattice, block by block in the order of its array."""
    count = int(np.prod(lattice.shape))
    for first in range(0, count, POINTS_AT_A_TIME):
        part = slice(first, min(count, first + POINTS_AT_A_TIME))
        index = np.stack(np.unravel_index(np.arange(part.start, part.stop), lattice.shape)[::-1], axis=-1)
        if isinstance(lattice, Raster):
            yield part, np.asarray(lattice.origin) + index * np.asarray(lattice.spacing)
        else:
            yield part, lattice.index_to_point(index)
