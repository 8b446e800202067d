"""Displacement fields: maps from points to backward displacements.

``output(x) = input(x + D(x))``: D is sampled at the place in the result and points to the source of the value.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from inspect import signature
from itertools import product
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import ndimage
from deformnb._entrances import AbstractCellOutput
from deformnb._jax import (
    blockwise,
    double_precision,
    float64,
    full_precision,
    is_traced,
    jax,
    jnp,
    pytree,
    value_and_slopes,
)
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.kernels import AbstractKernel
from deformnb.volume.plane import Raster
from deformnb.volume.sampling import aligned_empty
from deformnb.volume.units import ratio
from deformnb.volume.volume import Grid, VolumeLike, as_grid

BLOCK = 2**16
"""Points at a time in loops over many: little memory, and few enough calls."""


class AbstractField(ABC):
    """A backward displacement field in the plane (dim 2) or in space (dim 3).

    Subclasses are frozen dataclasses registered as JAX pytrees. They must define :meth:`displacement` and
    :meth:`jax_displacement`, the same map in NumPy and in JAX; the rest has slow but right defaults.

    Examples
    --------
    >>> Identity(2).displacement([[3.0, 4.0]]).tolist()
    [[0.0, 0.0]]
    """

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: displacements {'over a plane' if self.dim == 2 else 'in space'}>"

    @property
    @abstractmethod
    def dim(self) -> int:
        """2 for a field over a picture's plane, 3 for a field in space."""

    def __call__(self, points: Any) -> Any:
        """Displacements (..., dim) at points (..., dim): :meth:`displacement`, or JAX's within jit, grad and vmap.

        There they have the type of the points and are computed in 64 bits within, for any ``jax_enable_x64``, so
        that both meet the bound of :mod:`deformnb.rbf.exactness`, but for the rounding of the points. Where the field
        itself is an argument of a compiled function, JAX has rounded its numbers to its own type before, which in 32
        bits costs a steep map its digits: leave it out of the arguments, or set ``jax_enable_x64``.

        Examples
        --------
        >>> field = Affine(2 * np.eye(2), np.zeros(2))
        >>> field([[3.0, 4.0]]).tolist(), jax.jacfwd(field)(jnp.zeros(2)).tolist()
        ([[3.0, 4.0]], [[1.0, 0.0], [0.0, 1.0]])
        """
        if not is_traced(points, self):
            return self.displacement(points)
        x = jnp.asarray(points)
        x = x if jnp.issubdtype(x.dtype, jnp.floating) else x.astype(float)
        if x.dtype == np.float64 or is_traced(self):
            return self.jax_displacement(x)
        # Copies: JAX stores in 32 bits the constants that a user's function captured in 32 bits.
        own = jax.tree.map(lambda leaf: leaf.copy() if isinstance(leaf, np.ndarray) else leaf, self)
        return double_precision(own.jax_displacement)(x)

    @abstractmethod
    def jax_displacement(self, points: Any) -> Any:
        """Displacements (..., dim) at points (..., dim) in pure JAX, in the precision that JAX computes in."""

    @abstractmethod
    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        """Displacements (..., dim) at points (..., dim), in float64 NumPy; the path of scripts and tests."""

    @property
    def unit(self) -> str:
        """The unit of places and displacements, a symbol of :data:`~deformnb.volume.units.UNITS`; "" if not known."""
        return ""

    def rescaled(self, factor: float, unit: str) -> AbstractField:
        """The same map in numbers of another unit, each length a factor times as large a number."""
        return Rescaled(self, factor, unit)

    @property
    def has_cuts(self) -> bool:
        """True if the field jumps and hides tissue along cuts; see :mod:`deformnb.rbf.cuts`."""
        return False

    @property
    def is_identity(self) -> bool:
        """True if the field is known to move nothing, without any computation; False may still move nothing."""
        return False

    @property
    def steps(self) -> tuple[AbstractField, ...]:
        """The deformations that this one does one after the other, first to last; most fields are a single one."""
        return (self,)

    def opacity(self, points: ArrayLike) -> NDArray[np.float64]:
        """The paper's transparency map A (...) at points (..., dim): 1 shows the voxel moved there, 0 hides it."""
        return np.ones(np.shape(points)[:-1])

    def displacement_and_opacity(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacements (..., dim) and opacity (...) at points (..., dim)."""
        return self.displacement(points), self.opacity(points)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """dD/dx at points (..., dim): shape (..., dim, dim); row m holds the gradient of component m.

        Fields with edges, where the derivative jumps, give that of one of the sides there. The map ``x + D(x)`` has the
        derivative ``1 + dD/dx``; where the determinant of that is 0 or less, the map folds.
        """
        x = np.asarray(points, dtype=np.float64)
        flat = x.reshape(-1, self.dim)
        if any(leaf is self for leaf in jax.tree.leaves(self)):  # no pytree, for which nothing can be compiled
            with float64():
                found = np.asarray(value_and_slopes(self.jax_displacement, flat)[1])
        else:
            found = np.moveaxis(_jacobians(self, flat.T), -1, 0)
        return found.reshape(*x.shape, self.dim)

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        """:meth:`jacobian` at all points ``rows[:, r] + columns[:, c]``: dD_m/dx_k at [m, k] of (dim, dim, R, C)."""
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        out = np.empty((self.dim, self.dim, r.shape[1], c.shape[1]), dtype=np.float32)
        step = max(1, BLOCK // max(1, c.shape[1]))
        for start in range(0, r.shape[1], step):
            points = r[:, start : start + step, None] + c[:, None, :]
            part = self.jacobian(np.moveaxis(points, 0, -1))
            out[:, :, start : start + step] = np.moveaxis(part, (-2, -1), (0, 1))
        return out

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        """Displacements at all points ``rows[:, r] + columns[:, c]``: any regular lattice in two blocks of lines.

        Parameters
        ----------
        rows : (dim, R) and columns : (dim, C), physical coordinates to be added.
        resolution : the pixel or voxel size that the result is meant for; an error far below it is negligible.

        Returns
        -------
        (dim, R, C) float32, components first.
        """
        points = np.asarray(rows, dtype=np.float64)[:, :, None] + np.asarray(columns, dtype=np.float64)[:, None, :]
        return np.asarray(np.moveaxis(self.displacement(np.moveaxis(points, 0, -1)), -1, 0), dtype=np.float32)

    def lattice_values_and_opacity(
        self, rows: ArrayLike, columns: ArrayLike, resolution: float
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """:meth:`lattice_values` together with the opacity (R, C); None if nothing is hidden anywhere."""
        if not self.has_cuts:
            return self.lattice_values(rows, columns, resolution), None
        points = np.asarray(rows, dtype=np.float64)[:, :, None] + np.asarray(columns, dtype=np.float64)[:, None, :]
        d, opacity = self.displacement_and_opacity(np.moveaxis(points, 0, -1))
        return np.asarray(np.moveaxis(d, -1, 0), dtype=np.float32), np.asarray(opacity, dtype=np.float32)

    def sample_on_raster(self, raster: Raster) -> NDArray[np.float32]:
        """Displacements at the pixel centres of a raster (dim 2): shape (2, nv, nu), components a, b first."""
        if self.dim != 2:
            raise DeformError("a field in space has no values on the raster of a picture; sample it on a grid.")
        return self.lattice_values(*raster_lines(raster), min(raster.spacing))

    def sample_on_grid(self, grid: Grid | VolumeLike) -> NDArray[np.float32]:
        """Displacements at the voxel centres of a grid (dim 3): float32 [z, y, x, 3]."""
        return np.ascontiguousarray(np.moveaxis(self.components_on_grid(as_grid(grid)), 0, -1))

    def components_on_grid(self, grid: Grid) -> NDArray[np.float32]:
        """:meth:`sample_on_grid` in the order that the kernels read: (3, nz, ny, nx), components x, y, z first."""
        if self.dim != 3:
            raise DeformError("a field over a plane has no values on a grid in space; extrude it first.")
        return self.lattice_values(*grid_lines(grid), min(grid.spacing)).reshape(3, *grid.shape)


class AbstractFit(AbstractField, AbstractCellOutput):
    """A field fitted to control points."""

    @property
    @abstractmethod
    def ids(self) -> tuple[int, ...]:
        """Ids of the control points that were fitted."""

    @property
    @abstractmethod
    def trend(self) -> str:
        """Name of the trend, one of :data:`~deformnb.rbf.trends.TRENDS`."""

    @property
    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Remarks for a status line, each once."""


class AbstractInterpolant(AbstractFit):
    """A fit by one kernel in one stage, without rigid parts.

    Attributes
    ----------
    support : largest support radius, physical.
    count : number of control points.
    """

    support: Any
    count: Any

    @property
    @abstractmethod
    def kernel(self) -> type[AbstractKernel]:
        """The kernel class."""

    @property
    @abstractmethod
    def targets(self) -> NDArray[np.float64]:
        """Targets (n, dim) of the control points that were fitted, physical."""

    @abstractmethod
    def bound(self, pixel: float = 0.0) -> float:
        """The largest ``|D(target) - (source - target)|`` of the control points by any evaluation, physical."""

    @abstractmethod
    def folds_between_points(self) -> bool:
        """Check for ``det(1 + dD/dx) <= 0`` at a control point, next to it or between them."""


class HasField(Protocol):
    """An object with a field: :class:`~deformnb.document.deformation.Deformation` for each grid, an inverse its own."""

    @property
    def field(self) -> Any:
        """The backward displacements, or the method that finds them for a volume on a grid."""


def as_field(given: AbstractField | HasField, grid: Grid | VolumeLike | None = None) -> AbstractField:
    """The field itself, or that of a deformation; in the unit of the grid, where both units are known.

    Parameters
    ----------
    given : a field, a Deformation, one of its steps, or the inverse that :func:`deformnb.invert` finds.
    grid : of the volume that is deformed, which a deformation needs: support radii and depths depend on it.

    Raises
    ------
    DeformError
        For anything else, and for a deformation without a grid.

    Examples
    --------
    >>> as_field(Identity(2))
    Identity(dim=2)
    """
    own = given if isinstance(given, AbstractField) else getattr(given, "field", None)
    if isinstance(own, AbstractField):
        return own if grid is None else to_unit(own, as_grid(grid).unit)
    if isinstance(given, type) or not callable(own) or "grid" not in list(signature(own).parameters)[:1]:
        raise DeformError(
            f"a field or a Deformation is needed, got {short_value(given)}; fit_rbf(points) and "
            "Deformation.from_picture_points(volume, view, points) make one of control points."
        )
    if grid is None:
        raise DeformError(f"a {type(given).__name__} has a field for each grid; give one: grid=volume (or its Grid).")
    lattice = as_grid(grid)
    translated = getattr(given, "own_grid", as_grid)(lattice)
    if translated != lattice:
        raise DeformError(
            "this deformation was made when the volume had another spacing, so that its field has "
            "other coordinates; use deformation.apply(volume), which converts them."
        )
    return own(lattice)


def as_transform_field(given: AbstractField | HasField, grid: Grid | VolumeLike) -> AbstractField:
    """The field of :func:`as_field`, if it is one that the transforms of other programs can hold.

    Raises
    ------
    DeformError
        If it is over a plane, or hides tissue along cuts; else as :func:`as_field` does.

    Examples
    --------
    >>> as_transform_field(Identity(3), Grid((2, 2, 2)))
    Identity(dim=3)
    """
    field = as_field(given, grid)
    if field.dim != 3:
        raise DeformError("a transform is a map of space, and this field is over a plane; extrude it first.")
    if field.has_cuts:
        raise DeformError(
            "this deformation has cuts, which hide tissue and where displacements jump; a transform can "
            "hold neither. Switch the cuts off, or deform volumes here: dn.warp, deformnb warp."
        )
    return field


def raster_lines(raster: Raster) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The pixel centres of a raster as rows (2, nv) plus columns (2, nu)."""
    rows, columns = (np.zeros((2, count)) for count in raster.shape)
    rows[1], columns[0] = raster.rows, raster.columns
    return rows, columns


def grid_lines(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The voxel centres of a grid as rows (3, nz ny) plus columns (3, nx)."""
    (nz, ny, nx), m = grid.shape, grid.matrix
    z, y, x = (m[:, [k]] * np.arange(n) for k, n in ((2, nz), (1, ny), (0, nx)))
    rows = np.asarray(grid.origin)[:, None, None] + z[:, :, None] + y[:, None, :]
    return rows.reshape(3, -1), x


@pytree(data_fields=["values"], meta_fields=["lattice"])
@dataclass(frozen=True, eq=False, repr=False)
class DisplacementField(AbstractField):
    """A field stored as samples and interpolated linearly; beyond the outermost samples it is constant.

    Parameters
    ----------
    values : (nz, ny, nx, 3) on a grid, components x, y, z; or (nv, nu, 2) on a raster, components a, b. Backward
        displacements in physical units. A warp reads them fastest where each component is contiguous in memory, as
        those of :meth:`sample` are.
    lattice : the Grid or Raster of the samples.

    Examples
    --------
    >>> from deformnb.volume.volume import Grid
    >>> lattice = Grid((2, 2, 2), (10.0, 10.0, 10.0))
    >>> moved = DisplacementField(np.full((2, 2, 2, 3), [0.0, 0.0, -4.0]), lattice)
    >>> moved.displacement([[5.0, 5.0, 5.0]]).tolist()
    [[0.0, 0.0, -4.0]]
    """

    values: Any
    lattice: Grid | Raster

    def __post_init__(self) -> None:
        shape = getattr(self.values, "shape", None)
        if shape is not None and shape != (*self.lattice.shape, len(self.lattice.shape)):
            raise DeformError(f"samples of shape {shape} do not fit a lattice of {self.lattice.shape}, components last")

    def __repr__(self) -> str:
        counts = " x ".join(map(str, reversed(self.lattice.shape)))
        return f"<DisplacementField: {counts} samples {'over a plane' if self.dim == 2 else 'in space'}>"

    @classmethod
    def sample(cls, field: AbstractField | HasField, lattice: Grid | Raster | VolumeLike) -> DisplacementField:
        """Samples of another field, or of a deformation of a volume on this grid."""
        if isinstance(lattice, Raster):
            found = as_field(field).sample_on_raster(lattice)
            return cls(np.ascontiguousarray(np.moveaxis(found, 0, -1)), lattice)
        grid = as_grid(lattice)
        parts = aligned_empty((3, *grid.shape), np.dtype(np.float32))  # which the loops read fastest
        np.copyto(parts, as_field(field, grid).components_on_grid(grid))
        return cls(np.moveaxis(parts, 0, -1), grid)

    @property
    def dim(self) -> int:
        return len(self.lattice.shape)

    @property
    def unit(self) -> str:
        return self.lattice.unit if isinstance(self.lattice, Grid) else ""

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        index = _index(self.lattice, jnp.asarray(points))
        at = [index[..., k] for k in reversed(range(self.dim))]
        order1 = partial(jax.scipy.ndimage.map_coordinates, coordinates=at, order=1, mode="nearest")
        values = jnp.asarray(self.values)
        values = values.astype(jnp.result_type(values, index))  # map_coordinates rounds to the type of the samples
        return jnp.stack([order1(values[..., m]) for m in range(self.dim)], axis=-1)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        index = np.asarray(_index(self.lattice, x.reshape(-1, self.dim))).T[::-1]
        out = np.empty((self.dim, index.shape[1]))
        for m, part in enumerate(np.moveaxis(np.asarray(self.values), -1, 0)):
            ndimage.map_coordinates(part, index, output=out[m], order=1, mode="nearest")
        return np.moveaxis(out, 0, -1).reshape(x.shape)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """Exact for the interpolant: the slopes of the cell that contains a point.

        At a node that is the cell of growing index, at the last node the last cell; beyond the samples nothing changes.
        """
        x = np.asarray(points, dtype=np.float64)
        index = np.asarray(_index(self.lattice, x.reshape(-1, self.dim)))
        counts = np.array(self.lattice.shape[::-1])
        low = np.clip(np.floor(index), 0, np.maximum(counts - 2, 0)).astype(np.intp)
        t = np.clip(index - low, 0.0, 1.0)
        within = (index >= 0) & (index <= counts - 1) & (counts > 1)
        out = np.zeros((len(index), self.dim, self.dim))
        for corner in product((0, 1), repeat=self.dim):
            at = np.minimum(low + corner, counts - 1)
            values = np.asarray(self.values)[tuple(at.T[::-1])]
            shares = np.where(corner, t, 1.0 - t)
            for k, upper in enumerate(corner):
                slope = within[:, k] * np.delete(shares, k, axis=1).prod(axis=1)
                out[:, :, k] += (slope if upper else -slope)[:, None] * values
        raster = isinstance(self.lattice, Raster)
        matrix = np.diag(self.lattice.spacing) if raster else self.lattice.matrix  # type: ignore[union-attr]
        return (out @ np.linalg.inv(matrix)).reshape(*x.shape, self.dim)


# Op by op the first call took 1.1 s, compiled 0.13 s.
_jacobians = blockwise(lambda field, places: jnp.moveaxis(value_and_slopes(field.jax_displacement, places.T)[1], 0, -1))


def _index(lattice: Grid | Raster, points: Any) -> Any:
    """Fractional index (x, y, z) or (column, row) of points; for NumPy and JAX arrays."""
    if isinstance(lattice, Raster):
        return (points - np.asarray(lattice.origin)) / np.asarray(lattice.spacing)
    return (points - np.asarray(lattice.origin)) @ lattice.inverse.T


@pytree(data_fields=[], meta_fields=["dim"])
@dataclass(frozen=True)
class Identity(AbstractField):
    """No displacement at all."""

    dim: int = 3

    @property
    def is_identity(self) -> bool:
        return True

    def jax_displacement(self, points: Any) -> Any:
        return jnp.zeros_like(points)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.zeros_like(np.asarray(points, dtype=np.float64))

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.zeros((*np.shape(points), self.dim))


@pytree(data_fields=["matrix", "offset"], meta_fields=["unit"])
@dataclass(frozen=True, eq=False, repr=False)
class Affine(AbstractField):
    """The affine map ``x -> A x + t`` of space or a plane as displacements.

    Parameters
    ----------
    matrix : A, (dim, dim).
    offset : t, (dim,), in physical units.
    unit : of these; "" where it is not known.

    Examples
    --------
    >>> Affine(2 * np.eye(3), np.zeros(3)).displacement([1.0, 2.0, 3.0]).tolist()
    [1.0, 2.0, 3.0]
    """

    matrix: Any
    offset: Any
    unit: str = ""

    @property
    def dim(self) -> int:
        return len(self.offset)

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        x = jnp.asarray(points)
        return x @ jnp.asarray(self.matrix, x.dtype).T + jnp.asarray(self.offset, x.dtype) - x

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        return x @ (np.asarray(self.matrix, dtype=np.float64).T - np.eye(self.dim)) + np.asarray(self.offset)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.broadcast_to(np.asarray(self.matrix) - np.eye(self.dim), (*np.shape(points), self.dim)).copy()


@pytree(data_fields=["first", "then"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class Composed(AbstractField):
    """First one deformation, then another one of its result: D = D_then + D_first o (id + D_then), exactly.

    Backward maps compose in reverse order: ``then`` is sampled first, at the place in the result.
    """

    first: AbstractField
    then: AbstractField

    @property
    def dim(self) -> int:
        return self.then.dim

    @property
    def unit(self) -> str:
        return self.then.unit or self.first.unit

    def jax_displacement(self, points: Any) -> Any:
        d = self.then.jax_displacement(points)
        return d + self.first.jax_displacement(points + d)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        d = self.then.displacement(x)
        return d + self.first.displacement(x + d)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """The chain rule: ``J = J_then + J_first(x + D_then) (1 + J_then)``."""
        x = np.asarray(points, dtype=np.float64)
        then = self.then.jacobian(x)
        return then + self.first.jacobian(x + self.then.displacement(x)) @ (np.eye(self.dim) + then)

    @property
    def is_identity(self) -> bool:
        return self.first.is_identity and self.then.is_identity

    @property
    def steps(self) -> tuple[AbstractField, ...]:
        return (*self.first.steps, *self.then.steps)

    @property
    def has_cuts(self) -> bool:
        return self.first.has_cuts or self.then.has_cuts

    def opacity(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.displacement_and_opacity(points)[1]

    def displacement_and_opacity(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        x = np.asarray(points, dtype=np.float64)
        d, opacity = self.then.displacement_and_opacity(x)
        before, opacity_before = self.first.displacement_and_opacity(x + d)
        return d + before, opacity * opacity_before


@pytree(data_fields=["fields"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class Blended(AbstractField):
    """The sum of displacements, each sampled at the same place: the paper's blending of planes.

    It is not one deformation after the other, which is :class:`Composed`; the two agree to first order in the
    displacements. What one of the fields hides is hidden.
    """

    fields: tuple[AbstractField, ...]

    @property
    def dim(self) -> int:
        return self.fields[0].dim

    @property
    def unit(self) -> str:
        return next((field.unit for field in self.fields if field.unit), "")

    @property
    def has_cuts(self) -> bool:
        return any(f.has_cuts for f in self.fields)

    def jax_displacement(self, points: Any) -> Any:
        return sum(f.jax_displacement(points) for f in self.fields)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(sum(f.displacement(points) for f in self.fields))

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(sum(f.jacobian(points) for f in self.fields))

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        return np.asarray(sum(f.lattice_jacobians(rows, columns) for f in self.fields))

    def opacity(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.displacement_and_opacity(points)[1]

    def displacement_and_opacity(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        parts = [f.displacement_and_opacity(points) for f in self.fields]
        return np.asarray(sum(d for d, _ in parts)), np.asarray(np.prod([a for _, a in parts], axis=0))

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        return np.asarray(sum(f.lattice_values(rows, columns, resolution) for f in self.fields))


@pytree(data_fields=["field"], meta_fields=["factor", "unit"])
@dataclass(frozen=True, eq=False, repr=False)
class Rescaled(AbstractField):
    """A field in numbers of another unit of length: ``D(x) = factor D_field(x / factor)``; see :func:`to_unit`.

    Parameters
    ----------
    field : in its own unit.
    factor : how many of the new unit one of the field's own is.
    unit : the new one.
    """

    field: AbstractField
    factor: float
    unit: str = ""

    @property
    def dim(self) -> int:
        return self.field.dim

    @property
    def has_cuts(self) -> bool:
        return self.field.has_cuts

    @property
    def is_identity(self) -> bool:
        return self.field.is_identity

    def jax_displacement(self, points: Any) -> Any:
        return self.factor * self.field.jax_displacement(points / self.factor)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.factor * self.field.displacement(np.asarray(points, dtype=np.float64) / self.factor)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.field.jacobian(np.asarray(points, dtype=np.float64) / self.factor)

    def opacity(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.field.opacity(np.asarray(points, dtype=np.float64) / self.factor)

    def displacement_and_opacity(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        moves, opacity = self.field.displacement_and_opacity(np.asarray(points, dtype=np.float64) / self.factor)
        return self.factor * moves, opacity


def to_unit(field: AbstractField, unit: str) -> AbstractField:
    """The same map in numbers of another unit of length; itself where its own or the other one is not known.

    Examples
    --------
    >>> there = Affine(np.eye(3), np.array([0.0, 0.0, 2.0]), "mm")
    >>> to_unit(there, "µm").displacement([0.0, 0.0, 0.0]).tolist()
    [0.0, 0.0, 2000.0]
    """
    return convert_unit(field, field.unit, unit)


def convert_unit(field: AbstractField, own: str, to: str) -> AbstractField:
    """The same map in numbers of another unit, of a field that may lack one itself.

    Examples
    --------
    >>> convert_unit(Affine(np.eye(3), np.array([0.0, 0.0, 2.0])), "m", "mm").displacement([0.0, 0.0, 0.0]).tolist()
    [0.0, 0.0, 2000.0]
    """
    if own == to or not (own and to):
        return field
    factor = ratio(own, to)
    if isinstance(field, DisplacementField) and isinstance(field.lattice, Grid):
        return DisplacementField(np.asarray(field.values) * factor, replace(field.lattice, unit=own).to_unit(to))
    if isinstance(field, Affine):
        return Affine(field.matrix, np.asarray(field.offset) * factor, to)
    if isinstance(field, Composed):
        return Composed(convert_unit(field.first, own, to), convert_unit(field.then, own, to))
    return field.rescaled(factor, to)


def with_unit(field: AbstractField, unit: str) -> AbstractField:
    """The same numbers as lengths in a unit, of a field without one: the content of a file, in millimetres.

    Examples
    --------
    >>> with_unit(Affine(np.eye(3), np.zeros(3)), "mm").unit
    'mm'
    """
    if field.unit or not unit:
        return field
    if isinstance(field, Composed):
        return Composed(with_unit(field.first, unit), with_unit(field.then, unit))
    names = {given.name for given in fields(field)} if is_dataclass(field) else set[str]()
    if "unit" in names:
        return replace(field, unit=unit)  # type: ignore[type-var]
    lattice = getattr(field, "lattice", None)
    if "lattice" in names and isinstance(lattice, Grid):
        return replace(field, lattice=replace(lattice, unit=unit))  # type: ignore[type-var]
    return field


def links_of(field: AbstractField) -> list[AbstractField]:
    """The fields of a composition, from the one done last to the one done first."""
    return [*links_of(field.then), *links_of(field.first)] if isinstance(field, Composed) else [field]


def compose(*fields: AbstractField | HasField, grid: Grid | VolumeLike | None = None) -> AbstractField:
    """One field that does the given deformations one after the other, first to last; the identity in space if none.

    Parameters
    ----------
    fields : fields of one dimension, or deformations.
    grid : of the volume that is deformed; needed for deformations.

    Examples
    --------
    >>> from deformnb.volume.volume import Grid
    >>> part = DisplacementField(np.full((1, 1, 1, 3), 2.0), Grid((1, 1, 1), (1.0, 1.0, 1.0)))
    >>> compose(part, part, part).displacement([[0.0, 0.0, 0.0]]).tolist()
    [[6.0, 6.0, 6.0]]
    """
    if not fields:
        return Identity(3)
    known = _check_dimensions(fields, grid, "compose")
    total = known[0]
    for f in known[1:]:
        total = Composed(total, f)
    return total


def blend(*fields: AbstractField | HasField, grid: Grid | VolumeLike | None = None) -> AbstractField:
    """One field that is the sum of the given ones; the identity in space if none. Parameters as of :func:`compose`.

    Examples
    --------
    >>> blend().dim
    3
    >>> from deformnb.volume.volume import Grid
    >>> part = DisplacementField(np.full((1, 1, 1, 3), 2.0), Grid((1, 1, 1), (1.0, 1.0, 1.0)))
    >>> blend(part, part).displacement([[0.0, 0.0, 0.0]]).tolist()
    [[4.0, 4.0, 4.0]]
    """
    known = _check_dimensions(fields, grid, "blend")
    return Identity(3) if not known else known[0] if len(known) == 1 else Blended(known)


def _check_dimensions(
    fields: Sequence[AbstractField | HasField], grid: Grid | VolumeLike | None, verb: str
) -> tuple[AbstractField, ...]:
    known = tuple(as_field(f, grid) for f in fields)
    unit = next((f.unit for f in known if f.unit), "")
    known = tuple(to_unit(f, unit) for f in known)
    if len({f.dim for f in known}) > 1:
        raise DeformError(f"fields over a plane and in space do not {verb}; extrude the plane's first.")
    return known
