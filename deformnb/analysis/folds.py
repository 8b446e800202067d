"""Folds of a map: the determinant of its derivative, and the largest share of a drag that stays free of them.

``output(x) = input(x + D(x))``. With ``J = 1 + dD/dx`` a small piece at x shows ``det J`` times its own size of the
input: 1 preserves areas (volumes in space), 2 shows tissue shrunk to a half, 1/2 tissue grown to twice its size. Where
``det J <= 0`` the map folds: tissue is seen twice, and mirrored. The forward map has the determinant ``1 / det J``, see
:mod:`deformnb.analysis.strain`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import determinant, one_plus
from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion, unchanging_axes
from deformnb.rbf.fields import AbstractField, HasField, as_field, grid_lines, raster_lines
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, VolumeLike, as_grid, has_grid
from deformnb.warping.foreground import IsTissue
from deformnb.warping.points import POINTS_AT_A_TIME, Landmarks, check_points

NEARLY_FOLDED = 0.05
"""The smallest determinant that counts as safe: tissue is shown at most twenty times its size."""

# Nodes of a grid at a time: nine derivatives of each fill 36 bytes.
_NODES_AT_A_TIME = 2**18

# The first walk from rest to the whole drag takes this many steps; then the last safe one is split this often.
_STEPS = 8
_HALVINGS = 7


@dataclass(frozen=True)
class Folds:
    """The folds of a map on a lattice.

    Parameters
    ----------
    least : the smallest determinant of ``1 + dD/dx`` at a node; 0 or less is a fold.
    place : the node where that is, physical: (a, b) on a plane, (x, y, z) in space.
    share : the part of the nodes in folds, from 0 to 1.
    air : the part of the nodes in folds where there is no tissue; they count in neither of the above.

    Examples
    --------
    >>> Folds(-0.2, (10.0, 4.0), 0.03).share
    0.03
    """

    least: float
    place: tuple[float, ...]
    share: float
    air: float = 0.0


def jacobian_determinant(
    field: AbstractField | HasField,
    where: Grid | VolumeLike | Raster | Landmarks | ArrayLike,
    *,
    grid: Grid | VolumeLike | None = None,
) -> NDArray[Any]:
    """The determinant of ``1 + dD/dx``: 1 where areas are preserved, 0 or less where the map folds.

    Parameters
    ----------
    field : backward displacements, or a Deformation.
    where : a Raster for a field over a plane, a Grid or a Volume for one in space, or points (..., dim) of the result.
    grid : of the volume that a Deformation deforms, if that is not ``where``.

    Returns
    -------
    float32 of the lattice's shape, as quick as the field's own values; or float64 (...) at points. At a cut it is
    that of the region seen, without the gap.

    Raises
    ------
    DeformError
        If the field has not the dimension of the lattice or of the points.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> grown = fit_rbf(ControlPoints.from_arrays([[0, 0], [1, 0], [0, 1]], [[0, 0], [2, 0], [0, 2]]))  # twice as large
    >>> jacobian_determinant(grown, [[5.0, 7.0]]).round(9).tolist()
    [0.25]
    """
    if has_grid(where):
        where = as_grid(where)
        grid = where if grid is None else grid
    field = as_field(field, grid)
    if not isinstance(where, Grid | Raster):
        x = check_points(cast("ArrayLike | Landmarks", where), field, grid)
        flat, out = x.reshape(-1, field.dim), np.empty(x.shape[:-1])
        for start in range(0, len(flat), POINTS_AT_A_TIME):
            own = slice(start, start + POINTS_AT_A_TIME)
            out.reshape(-1)[own] = _determinant(np.moveaxis(field.jacobian(flat[own]), 0, -1))
        return out
    lattice_out = np.empty(where.shape, dtype=np.float32)
    for part, values in _blocks(field, where):
        lattice_out[part] = values
    return lattice_out


def find_folds(
    field: AbstractField | HasField,
    lattice: Grid | VolumeLike | Raster,
    progress: Progress | None = None,
    *,
    grid: Grid | VolumeLike | None = None,
    is_tissue: IsTissue | None = None,
) -> Folds:
    """The smallest determinant on a lattice, its place, and the share of the nodes in folds.

    Parameters
    ----------
    field : backward displacements of the lattice's dimension, or a Deformation.
    lattice : a Raster, a Grid or a Volume; what happens between its nodes is not seen.
    grid : of the volume that a Deformation deforms, if that is not the lattice.
    is_tissue : where determinants up to :data:`NEARLY_FOLDED` count; folds elsewhere are ``air``. Default everywhere.
    progress : called with the finished share from 0 to 1 after every block; may raise
        :class:`~deformnb.errors.Cancelled`, which is passed on.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> drag = fit_rbf(ControlPoints.from_arrays([[20, 20]], [[32, 20]]), support=20.0, trend="none")  # too far
    >>> folds = find_folds(drag, Raster((41, 61), (1.0, 1.0), (0.0, 0.0)))
    >>> round(folds.least, 2), folds.place, round(folds.share, 3)
    (-0.27, (27.0, 20.0), 0.013)
    """
    if not isinstance(lattice, Raster):
        lattice = as_grid(lattice)
        grid = lattice if grid is None else grid
    field = as_field(field, grid)
    least, place, folded, in_air, seen = np.inf, (0,) * len(lattice.shape), 0.0, 0.0, 0
    for part, found in _blocks(field, lattice):
        count = int(np.prod([len(range(*p.indices(n))) for p, n in zip(part, lattice.shape, strict=True)]))
        is_air = air_nodes(field, _points_of(lattice, part, found.shape), found, is_tissue)
        in_air += count / found.size * np.count_nonzero(is_air & ~(found > 0))
        values = np.where(is_air, np.float32(np.inf), found)
        folded += count / found.size * np.count_nonzero(~(values > 0))  # NaN is no good either
        at = np.unravel_index(int(np.argmin(values)), values.shape)
        if not values[at] >= least:
            least = float(values[at])
            place = tuple(int(k) + (p.start or 0) for k, p in zip(at, part, strict=True))
        seen += count
        if progress is not None:
            progress(seen / int(np.prod(lattice.shape)))
    nodes = int(np.prod(lattice.shape))
    least = 1.0 if least == np.inf else least
    return Folds(least, _place(lattice, place), float(folded / nodes), float(in_air / nodes))


def air_nodes(
    field: AbstractField,
    points: Callable[[NDArray[np.bool_]], NDArray[np.float64]],
    values: NDArray[Any],
    is_tissue: IsTissue | None,
) -> NDArray[np.bool_]:
    """Nodes with a determinant up to :data:`NEARLY_FOLDED` at which no tissue is seen: no fold of theirs counts.

    Parameters
    ----------
    points : the nodes of a mask, (n, dim).
    values : determinants at all nodes.
    """
    low = ~(values > NEARLY_FOLDED)
    if is_tissue is None or not low.any():
        return np.zeros_like(low)
    x = points(low)
    air = np.zeros_like(low)
    air[low] = ~is_tissue(x + field.displacement(x))
    return air


def largest_safe_share(is_fold_free: Callable[[float], bool]) -> float:
    """The largest safe share from 0 to 1: in eighths as far as all is well, then by halves; 0 if nothing is."""
    if not is_fold_free(0.0):
        return 0.0
    low, high = 0.0, 0.0
    for k in range(1, _STEPS + 1):
        high = k / _STEPS
        if not is_fold_free(high):
            break
        low = high
    else:
        return 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_fold_free(middle) else (low, middle)
    return low


# ---- blocks ----------------------------------------------------------------------------------------------------------


def _determinant(derivative: NDArray[Any]) -> NDArray[Any]:
    return determinant(one_plus(derivative))


def _place(lattice: Grid | Raster, index: tuple[int, ...]) -> tuple[float, ...]:
    at = np.asarray(index[::-1], dtype=np.float64)
    if isinstance(lattice, Raster):
        return tuple((np.asarray(lattice.origin) + at * np.asarray(lattice.spacing)).tolist())
    return tuple(lattice.index_to_point(at).tolist())


def _points_of(
    lattice: Grid | Raster, part: tuple[slice, ...], shape: tuple[int, ...]
) -> Callable[[NDArray[np.bool_]], NDArray[np.float64]]:
    """The nodes of a part of the lattice's array where a mask of this shape is true."""
    first = np.array([p.start or 0 for p in part])

    def points(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        index = (np.argwhere(mask.reshape(shape)) + first)[:, ::-1].astype(np.float64)
        if isinstance(lattice, Raster):
            return np.asarray(lattice.origin) + index * np.asarray(lattice.spacing)
        return lattice.index_to_point(index)

    return points


def _blocks(field: AbstractField, lattice: Grid | Raster) -> Iterator[tuple[tuple[slice, ...], NDArray[np.float32]]]:
    """Parts of the lattice's array and the determinants there; an axis of length 1 represents all along it."""
    if field.dim != len(lattice.shape):
        raise DeformError(
            f"a field of dimension {field.dim} has no determinants on a lattice of "
            f"{len(lattice.shape)} axes; extrude a field of the plane first."
        )
    if isinstance(lattice, Raster):
        everywhere = (slice(None), slice(None))
        yield everywhere, _determinant(field.lattice_jacobians(*raster_lines(lattice)))
        return
    same = unchanging_axes(field, lattice)
    if isinstance(field, Extrusion) and field.axis_of(lattice) is not None:
        yield from _slices(field, lattice)
    elif same:
        flat = _one_slice(lattice, min(same))
        found = _determinant(field.lattice_jacobians(*grid_lines(flat))).reshape(flat.shape)
        yield (slice(None),) * 3, found
    else:
        nz, ny, nx = lattice.shape
        step = max(1, _NODES_AT_A_TIME // (ny * nx))
        for z in range(0, nz, step):
            block = lattice.crop((z, 0, 0), (min(step, nz - z), ny, nx))
            found = _determinant(field.lattice_jacobians(*grid_lines(block))).reshape(block.shape)
            yield (slice(z, z + step), slice(None), slice(None)), found


def _one_slice(grid: Grid, axis: int) -> Grid:
    return grid.crop((0, 0, 0), tuple(1 if k == axis else n for k, n in enumerate(grid.shape)))  # type: ignore[arg-type]


def _slices(field: Extrusion, grid: Grid) -> Iterator[tuple[tuple[slice, ...], NDArray[np.float32]]]:
    """Slices across the normal. Nothing leaves its depth, so the determinant is that of the map of the slice alone."""
    axis = field.axis_of(grid)
    assert axis is not None
    flat = _one_slice(grid, axis)
    rows, columns = field.lines(*grid_lines(flat))
    maps = [m.lattice_jacobians(rows[:2], columns[:2]) for m in field.maps]
    index = np.zeros((grid.shape[axis], 3))
    index[:, 2 - axis] = np.arange(grid.shape[axis])
    weights = field.weights_at(field.plane.to_plane(grid.index_to_point(index))[:, 2]).astype(np.float32)
    for k in range(1 if field.is_replication else grid.shape[axis]):
        own = [(w, m) for w, m in zip(weights[:, k], maps, strict=True) if w]
        found = np.ones(flat.shape, dtype=np.float32)
        if own:
            found = _determinant(sum(w * m for w, m in own)).reshape(flat.shape)
        here = slice(None) if field.is_replication else slice(k, k + 1)
        yield tuple(here if a == axis else slice(None) for a in range(3)), found
