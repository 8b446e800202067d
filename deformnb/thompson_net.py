"""The nets of a Thompson figure as numbers: the regular one, where its lines and nodes go, and magnified drags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from deformnb.control_points import ControlPoints
from deformnb.cuts import Decoupled
from deformnb.deformation import MODES, Deformation, Step
from deformnb.errors import DeformError
from deformnb.fields import AbstractField, Identity
from deformnb.figures import Lines, moved_lines, net_lines, picture_field
from deformnb.forward import warp_points
from deformnb.plane import Picture, Raster
from deformnb.strain import Stretches, stretches
from deformnb.volume import Grid

MOST_LINES = 64
"""Cells of a net along its longer side at most."""

_FINE = 300  # places along the longer side where areas are asked for

@dataclass(frozen=True, eq=False)
class Grids:
    """What :func:`deformnb.thompson.draw_grids` draws, in picture coordinates.

    Parameters
    ----------
    field : backward displacement of the picture.
    before, after : the net on the picture and on the deformed one; lines broken at cuts and folds have several pieces.
    nodes : (rows, columns, 2) of the regular net.
    moved : where the nodes are in the result; found : (rows, columns) whether they are anywhere.
    cell : the side of a cell.
    """

    field: AbstractField
    before: Lines
    after: Lines
    nodes: NDArray[np.float64]
    moved: NDArray[np.float64]
    found: NDArray[np.bool_]
    cell: float

    def strain(self) -> Stretches:
        """Stretches of the matter at the nodes of the net, in the result."""
        return stretches(self.field, self.moved)


def steps_of(what: Any, picture: Picture, magnify: float) -> tuple[Step, ...]:
    """The steps to be drawn, magnified; none for a field."""
    if isinstance(what, AbstractField):
        if what.dim != 2:
            raise DeformError("grids are drawn of a field on a picture, of dimension 2; this one is in space.")
        return ()
    if not isinstance(what, Step | Deformation):
        raise DeformError(f"grids are drawn of a Step, a Deformation or a field, got {type(what).__name__}.")
    given = (what,) if isinstance(what, Step) else tuple(step for step in what.steps if step.enabled)
    for number, step in enumerate(given, 1):
        if step.plane != picture.plane:
            where = "in space" if step.plane is None else "on another plane"
            raise DeformError(f"step {number} has its control points {where}, and deforms no picture like this one; "
                              "give a step on the picture's plane, with a picture of the volume before it.")
    return tuple(replace(step, strength=step.strength * magnify) for step in given)


def field_of(what: Any, steps: tuple[Step, ...], picture: Picture, magnify: float, grid: Grid | None,
             key: int) -> AbstractField:
    """The displacement of the picture by these steps, or by the field that was given instead."""
    if isinstance(what, AbstractField):
        return magnified(what, magnify)
    fields = [picture_field(step, grid or _flat_grid(picture), min(key, len(step.maps) - 1)) for step in steps]
    if not fields:
        return Identity(2)
    return MODES[what.mode if isinstance(what, Deformation) else "compose"](*fields)


def magnified(field: AbstractField, factor: float) -> AbstractField:
    """A field of the plane with displacements ``factor`` times as long.

    Examples
    --------
    >>> from deformnb.fields import DisplacementField
    >>> raster = Raster((2, 2), (1.0, 1.0), (0.0, 0.0))
    >>> field = DisplacementField(np.ones((2, 2, 2)), raster)
    >>> magnified(field, -2.0).displacement([0.5, 0.5]).tolist()
    [-2.0, -2.0]
    """
    if factor == 1:
        return field
    if isinstance(field, Decoupled):
        return replace(field, fields=tuple(magnified(one, factor) for one in field.fields))
    return _Magnified(field, factor)


@partial(jax.tree_util.register_dataclass, data_fields=["field"], meta_fields=["factor"])
@dataclass(frozen=True, eq=False)
class _Magnified(AbstractField):
    field: AbstractField
    factor: float

    @property
    def dim(self) -> int:
        return self.field.dim

    def __call__(self, points: Any) -> Any:
        return self.factor * self.field(points)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.factor * self.field.displacement(points)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.factor * self.field.jacobian(points)


def _flat_grid(picture: Picture) -> Grid:
    """A volume one voxel thick where the picture lies: its size is all that a fit asks for."""
    (nv, nu), (du, dv) = picture.raster.shape, picture.raster.spacing
    return Grid((1, nv, nu), (du, dv, min(du, dv)))


def make_grids(field: AbstractField, picture: Picture, lines: int = 12) -> Grids:
    """The nets of a picture and of what a field of dimension 2 makes of it; see :class:`Grids`."""
    if not (isinstance(lines, int | np.integer) and 1 <= lines <= MOST_LINES):
        raise DeformError(f"a net has 1 to {MOST_LINES} cells along its longer side, got {lines!r}.")
    a0, a1, b0, b1 = box = picture.raster.box
    cell = max(a1 - a0, b1 - b0) / lines
    across, down = max(1, round((a1 - a0) / cell)), max(1, round((b1 - b0) / cell))
    before = net_lines(box, across, down)
    nodes = np.stack(np.meshgrid(np.linspace(a0, a1, across + 1), np.linspace(b0, b1, down + 1)), axis=-1)
    moved, found = warp_points(nodes, field)
    return Grids(field, before, moved_lines(before, field), nodes, moved, found, cell)


def landmarks_of(steps: tuple[Step, ...], key: int) -> ControlPoints | None:
    """The control points of a single step, where they are dragged to; of several steps they are places in between."""
    if len(steps) != 1:
        return None
    points = steps[0].maps[min(key, len(steps[0].maps) - 1)]
    return points.take(np.flatnonzero(points.active)).blended(steps[0].strength)


def area_map(field: AbstractField, raster: Raster) -> NDArray[np.float64]:
    """How much matter has grown at the pixels of a raster: 2 is twice as large, NaN where the map folds.

    Examples
    --------
    >>> from deformnb.fields import Identity
    >>> float(area_map(Identity(2), Raster((30, 40), (1.0, 1.0), (0.0, 0.0))).max())
    1.0
    """
    step = max(1, max(raster.shape) // _FINE)
    rows, columns = (np.unique(np.append(np.arange(0, n, step), n - 1)) for n in raster.shape)
    at = raster.points()[np.ix_(rows, columns)]
    shrunk = np.linalg.det(np.eye(2) + field.jacobian(at))  # it has a value where the map folds, its inverse has none
    if step > 1:
        v, u = (np.interp(np.arange(n), lines, np.arange(len(lines)))
                for n, lines in zip(raster.shape, (rows, columns), strict=True))
        shrunk = ndimage.map_coordinates(shrunk, np.meshgrid(v, u, indexing="ij"), order=1)
    return np.asarray(np.where(shrunk > 0, 1 / np.where(shrunk > 0, shrunk, 1.0), np.nan))
