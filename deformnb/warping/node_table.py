"""Displacements of a composition as one table of nodes, read by cubic interpolation.

Every deformation of a composition is evaluated at the places to which those after it lead, so that n of them cost n
sums over control points at every voxel. Nodes a few voxels apart need a sixty-fourth of that. Between nodes at distance
h cubic interpolation along one axis misses a smooth D by ``3/128 |h^4 D''''|``, which the fourth differences of the
nodes measure themselves (de Boor, A Practical Guide to Splines, 2001, chapter II); where a derivative jumps the factor
is larger: 0.049 for the third one (Wendland's C2 kernel at its centre), 0.064 for the second (thin plates), 0.375 for
the first (the distance to a rigid part). Along the three axes in turn the errors add up to

    c (|d_x| + 5/4 |d_y| + 25/16 |d_z|)

with d the fourth differences and 5/4 the most that cubic interpolation enlarges an error. Cells where that exceeds
:data:`ERROR` are not interpolated, nor are those near the border of a cut or of a rigid part, or where a curve of
modulation bends sharply: there the composition is evaluated at every voxel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._jax import compiled, jnp
from deformnb._typing import Progress
from deformnb.rbf import kernels
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Affine, Composed, Identity, in_blocks
from deformnb.rbf.interpolant import RBFInterpolant, moved_back
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidInterpolant, drift_and_weight
from deformnb.rbf.stages import Staged
from deformnb.volume.sampling import on_device
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.planning import Tables

Floats = NDArray[np.float64]

ERROR = 1e-2
"""Largest error of an interpolated displacement, in the smallest side of a voxel. Where neighbouring voxels differ by
100 grey levels, it changes the result by one at most, and by a third of one as a rule."""

SPACINGS = (8, 6, 4, 3, 2)
"""Distances of nodes in voxels; the one of least work is taken, of nodes and of the voxels that are evaluated one by
one."""

# The one beside borders, and where a coarse lattice does not tell.
_USUAL = 4

# A coarse lattice, of a thirtieth of the nodes 5 voxels apart, estimates the errors of those of all distances.
_FIRST_SPACING = 16

# Errors fall with this power of the distance of nodes: by 4 of what is smooth, 3 around the centres of kernels. Shares
# of bad cells that it foretold of 12 compositions (8 to 100 points, five kernels) were at most twice too large or small
# where they exceeded 2 %.
_ORDER = 3.5

_EVERY = (slice(None), slice(None))

# What a voxel that is listed and evaluated by itself costs, in nodes or in voxels of a block that is evaluated whole.
_LISTED = 1.5

# Voxels that are evaluated one by one, at a time, many and the rest of them; what is left of these is filled up, so that
# two sizes compile.
_FEW, _TOGETHER = 2**12, 2**15

# Nodes that are evaluated at a time, and planes of them at least: one more plane is evaluated with each of these parts.
_NODES_TOGETHER, _LEAST_PLANES = 2**16, 8

# Interpolation reads a node before a cell and one behind it, their fourth differences one more on either side.
_HALO = 2

_JUMPS = {1: 0.375, 2: 0.065, 3: 0.049}
"""The factors c by the first derivative that jumps."""

_SMOOTHNESS: dict[type[kernels.AbstractKernel], int] = {
    kernels.WendlandC0: 1, kernels.Linear: 1, kernels.ThinPlate: 2, kernels.WendlandC2: 3, kernels.WendlandC4: 3,
    kernels.Gaussian: 3, kernels.Multiquadric: 3, kernels.Cubic: 3,
}

# A bump of so many diagonals of a cell as support shows in the fourth differences wherever it lies.
_NARROWEST = 4

# Distances that are read off a mask's table change by up to this per length, those to lines and polygons by 1.
_STEEPEST = 3**0.5

# How much farther than half a diagonal the nearest node may be in cells that the deformation bends.
_BENT = 1.15

# Places that differ by less than this share of a voxel are the same.
_SAME = 1e-9

# Samples of a curve of modulation between two nodes, at least and at most.
_SAMPLES = 8, 256


def smoothness_of(field: AbstractField) -> int | None:
    """The first derivative of a field that may jump away from the borders of cuts and parts, at most 3; None if that
    is not known.

    Examples
    --------
    >>> smoothness_of(Identity(3))
    3
    """
    match field:
        case Identity() | Affine():
            return 3
        case RBFInterpolant():
            return _SMOOTHNESS.get(field.kernel)
        case RigidInterpolant():  # distances bend where two borders are equally near
            return None if smoothness_of(field.base) is None else 1
        case Composed():
            parts: tuple[AbstractField, ...] = (field.first, field.then)
        case Staged():
            parts = field.fits
        case Extrusion():
            parts = field.maps
        case Decoupled():
            parts = field.fields
        case _:
            return None
    known = [smoothness_of(part) for part in parts]
    return None if None in known else min((k for k in known if k is not None), default=3)


Voxels: TypeAlias = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
"""Indices z, y, x, each (n,); some voxels may come more than once."""

Piece: TypeAlias = Callable[[], Voxels]


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements of a block of voxels, as the warp's kernel reads them.

    Parameters
    ----------
    d : components x, y, z, each (nodes z, nodes y, nx); or [z, y, x] at every voxel.
    nodes : along z and y the first node that each voxel reads (n,) and the weights (T, n) of nodes from there; None
        where every voxel has its own.
    opacity : [z, y, x] of displacements at every voxel; None where all is 1.
    exact : pieces of the voxels that are to be replaced, for :meth:`NodeTable.exactly`, listed when they are called.
    """

    d: tuple[Any, ...]
    nodes: Tables | None = None
    opacity: NDArray[np.float32] | None = None
    exact: tuple[Piece, ...] = ()


class NodeTable:
    """Displacements of a field in space at the voxels of a grid, from nodes that are as far apart as the error allows.

    Nodes at one of :data:`SPACINGS` are evaluated once for the whole grid. Blocks where these leave too much to be
    evaluated voxel by voxel get denser ones of their own.

    Parameters
    ----------
    field : any whose smoothness is known (:func:`smoothness_of`).
    exactly : displacements (3, n) and opacity (n) of the field at places (3, n) relative to an origin, and that origin.
    grid : the voxels.
    progress : called with the finished share of the nodes.
    """

    def __init__(self, field: AbstractField, exactly: Callable[..., tuple[Any, Any]], grid: Grid,
                 progress: Progress | None = None) -> None:
        self._field, self._exactly, self._grid = field, exactly, grid
        self._left: list[NDArray[np.intp]] = []
        estimate = _Lattice(field, grid, _FIRST_SPACING)
        best = 1 if estimate.has_borders else estimate.best_spacing(_EVERY, (*SPACINGS, 1))
        self._whole = _Lattice(field, grid, best if best > 1 else _USUAL, progress)

    def block(self, block: tuple[slice, slice]) -> Displacements | None:
        """Displacements in planes and rows of the grid.

        What is to be replaced there is added to :meth:`left`, or comes along if the block has nodes of its own. None
        where the field bends so much that it is to be evaluated at every voxel of the block.
        """
        cells = (self._whole.cells(block[0]), self._whole.cells(block[1]))
        spacing = self._whole.best_spacing(cells, (*SPACINGS, 1))
        if spacing == self._whole.spacing:
            self._left.append(self._whole.bad_cells(cells))
            return self._read(self._whole, block)
        if spacing > 1:
            grid = planning.lattice(self._grid, block, 1)
            lattice = _Lattice(self._field, grid, spacing)
            if lattice.best_spacing(_EVERY, (spacing, 1)) == spacing:
                start = np.array([block[0].start, block[1].start, 0])
                pieces = _pieces(lattice.bad_cells(_EVERY), spacing, start, start + np.array(grid.shape))
                own = (slice(0, grid.shape[0]), slice(0, grid.shape[1]))
                return replace(self._read(lattice, own), exact=tuple(pieces))
        return None

    def left(self) -> list[Piece]:
        """Pieces of the voxels of all blocks so far that are to be replaced, as :attr:`Displacements.exact`."""
        if not self._left:
            return []
        cells = np.concatenate(self._left)
        return list(_pieces(cells, self._whole.spacing, np.zeros(3, int), np.array(self._grid.shape)))

    def exactly(self, voxels: Voxels) -> tuple[Any, NDArray[np.float32] | None]:
        """Displacements (3, n) of the field itself at voxels, given as indices z, y, x, and their opacity (n,)."""
        first = [int(index[0]) for index in reversed(voxels)]
        apart = np.stack([index - index[0] for index in reversed(voxels)]).astype(np.float64)
        d, opacity = self._exactly((self._grid.matrix @ apart).astype(np.float32), self._grid.index_to_point(first))
        return d, opacity if self._field.has_cuts else None

    def _read(self, lattice: _Lattice, block: tuple[slice, slice]) -> Displacements:
        """Displacements in a block of the voxels of a lattice; blocks of one shape have equally many nodes."""
        h, tables, some = lattice.spacing, [], []
        for part, present in zip(block, lattice.nodes.shape[1:], strict=False):
            n = np.arange(part.start, part.stop)
            count = min(present, (len(n) + h - 2) // h + 4)
            first = min(part.start // h, present - count)
            tables.append(((n // h - first).astype(np.int32), np.stack(_lagrange(n % h / h)).astype(np.float32)))
            some.append(slice(first, first + count))
        nodes = on_device(lattice.nodes[:, *some])
        return Displacements(planning.along_x(nodes, _weights(self._grid.shape[2], h)), tuple(tables))


def _pieces(cells: NDArray[np.intp], side: int, start: NDArray[np.intp], stop: NDArray[np.intp]) -> Iterator[Piece]:
    """All voxels in cells (n, 3), a few at a time: the indices of all would take more memory than the result.

    start : the first voxel of the first cell; stop : the end of the voxels.
    """
    whole = len(cells) - len(cells) % (_TOGETHER // side**3)
    for part, together in ((cells[:whole], _TOGETHER), (cells[whole:], _FEW)):
        most = together // side**3
        for first in range(0, len(part), most):
            yield partial(_voxels, part[first : first + most], side, start, stop, together)


def _voxels(cells: NDArray[np.intp], side: int, start: NDArray[np.intp], stop: NDArray[np.intp], size: int) -> Voxels:
    index = (side * cells.T[:, :, None] + np.indices((side,) * 3).reshape(3, 1, -1)).reshape(3, -1) + start[:, None]
    index = np.minimum(index, stop[:, None] - 1)
    z, y, x = index.take(np.arange(size), 1, mode="clip").astype(np.int32)
    return z, y, x


class _Lattice:
    """Nodes of a field around all voxels of a grid.

    Attributes
    ----------
    spacing : of the nodes, in voxels.
    nodes : (3, z, y, x), the first ones a node before the first voxel.
    """

    def __init__(self, field: AbstractField, grid: Grid, spacing: int, progress: Progress | None = None) -> None:
        self._field, self._grid, self.spacing = field, grid, spacing
        smoothness = smoothness_of(field)
        assert smoothness is not None
        self._factor = _JUMPS[smoothness]
        cells = tuple(-(-n // spacing) for n in grid.shape)
        self._shape = tuple(n + 1 + 2 * _HALO for n in cells)
        self._values, self._near = np.empty((3, *self._shape), np.float32), np.zeros(self._shape, dtype=bool)
        self._error = np.zeros(self._shape, np.float32)
        widths = np.zeros(self._shape[0], np.float32)
        self._types: dict[Any, Any] = {}
        self._bounds, self._borders = np.empty(cells, np.float32), np.empty(cells, dtype=bool)
        self._allowed = ERROR * min(grid.spacing)
        most = max(_LEAST_PLANES, _NODES_TOGETHER // (self._shape[1] * self._shape[2]))
        slabs = planning.parts(self._shape[0], most)
        beyond: dict[int, tuple[NDArray[np.bool_], np.float32]] = {}
        planning.run_parts(slabs, partial(self._evaluate, widths, beyond), progress)
        for plane, (near, width) in beyond.items():
            self._near[plane] |= near
            widths[plane] = max(widths[plane], width)
        self._widths = _within_cells(widths[1:-1], 4)
        planning.run_parts(planning.parts(cells[0], most), self._judge, None)
        self.nodes = self._values[:, 1:-1, 1:-1, 1:-1]

    def cells(self, part: slice) -> slice:
        """The cells that hold the voxels of a part of an axis."""
        return slice(part.start // self.spacing, -(-part.stop // self.spacing))

    @property
    def has_borders(self) -> bool:
        """True if the border of a cut or a part, or a sharp bend of a curve of modulation is near anywhere."""
        return bool(self._borders.any())

    def best_spacing(self, cells: tuple[slice, slice], among: Sequence[int]) -> int:
        """The spacing of least work for these cells, among some: this one, denser ones, 1 for every voxel itself."""
        own = [h for h in among if h <= self.spacing]
        return min(own, key=lambda h: self._work(cells, h))

    def _work(self, cells: tuple[slice, slice], h: int) -> float:
        counts = [self.spacing * n for n in self._bounds[cells].shape]
        voxels = float(np.prod(counts))
        if h == 1:
            return voxels
        nodes = 0.0 if h == self.spacing else float(np.prod([n / h + 1 + 2 * _HALO for n in counts]))
        return nodes + _LISTED * voxels * float(np.mean(self._bends(cells, h) | self._borders[cells]))

    def _bends(self, cells: tuple[slice, slice], h: int) -> NDArray[np.bool_]:
        """Check which cells bend too much for nodes at a spacing, about if it is not this one."""
        ratio = h / self.spacing
        is_narrow = _NARROWEST * ratio * self._widths[cells[0]] > 1
        return is_narrow[:, None, None] | ~(ratio**_ORDER * self._bounds[cells] <= self._allowed)

    def bad_cells(self, cells: tuple[slice, slice]) -> NDArray[np.intp]:
        """Indices (n, 3) of the cells among these that are not interpolated."""
        found = np.argwhere(self._borders[cells] | self._bends(cells, self.spacing))
        found[:, :2] += [part.start or 0 for part in cells]
        return found

    def _evaluate(self, widths: NDArray[np.float32], beyond: dict[int, tuple[NDArray[np.bool_], np.float32]],
                  slab: slice) -> None:
        """The nodes of some planes, and one more, for the cells between this slab and the next one."""
        count = min(slab.stop + 1, self._shape[0]) - slab.start
        z, y, x = (self._grid.matrix[:, [2 - axis]] * (self.spacing * (first + np.arange(n) - float(_HALO)))
                   for axis, (first, n) in enumerate(zip((slab.start, 0, 0), (count, *self._shape[1:]), strict=True)))
        places = (z[:, :, None, None] + y[:, None, :, None]) + x[:, None, None, :]
        places += np.asarray(self._grid.origin)[:, None, None, None]
        near, error = np.zeros(places.shape[1:], dtype=bool), np.zeros(places.shape[1:], np.float32)
        wide = np.zeros(count, np.float32)
        d = _Walk(min(self._grid.spacing), self._types, near, error, wide).through(self._field, places)
        planes = slice(0, slab.stop - slab.start)
        self._values[:, slab] = np.broadcast_to(d, places.shape)[:, planes]
        self._near[slab], self._error[slab], widths[slab] = near[planes], error[planes], wide[planes]
        if count > planes.stop:
            beyond[slab.stop] = near[-1], wide[-1]

    def _judge(self, part: slice) -> None:
        """Bound the errors in some planes of cells, and find those near borders."""
        inner = slice(_HALO, -_HALO)
        own = slice(part.start, part.stop + 1 + 2 * _HALO)
        d, error = self._values[:, own], self._error[own][inner, inner, inner]
        is_sharp = _within_cells(error, 2) > self._allowed
        for axis, gain in ((0, 25 / 16), (1, 5 / 4), (2, 1.0)):  # the one done first is enlarged most
            some = (slice(None), *(slice(None) if k == axis else inner for k in range(3)))
            bend = np.sqrt(np.square(np.diff(d[some], 4, axis=axis + 1)).sum(axis=0))
            error = error + np.float32(self._factor * gain) * bend
        # Borders count at the four nodes that a cell reads along each axis, errors at its own two.
        self._borders[part] = is_sharp | _within_cells(self._near[own][1:-1, 1:-1, 1:-1], 4)
        self._bounds[part] = _within_cells(error, 2)


def _within_cells(values: NDArray[Any], count: int) -> NDArray[Any]:
    """The largest of ``count`` neighbours along each axis."""
    for axis in range(values.ndim):
        n = values.shape[axis] - count + 1
        values = np.maximum.reduce([values.take(np.arange(k, k + n), axis) for k in range(count)])
    return values


@lru_cache(maxsize=32)
def _weights(count: int, spacing: int) -> NDArray[np.float32]:
    """Lagrange's cubic weights (nodes, count) of voxels between nodes, the first node one before the first voxel."""
    at = np.arange(count)
    cell, t = at // spacing, (at % spacing) / spacing
    weights = np.zeros((-(-count // spacing) + 3, count), np.float32)
    for k, w in enumerate(_lagrange(t)):
        weights[cell + k, at] = w
    return weights


def _lagrange(t: Any) -> tuple[Any, ...]:
    """Weights of the values at -1, 0, 1 and 2 for a place t from 0 to 1."""
    return (-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6)


@dataclass(frozen=True)
class _Walk:
    """The way of nodes through a composition: their displacements, and which lie near something that is not smooth.

    Places (dim, z, y, x) are those of a lattice of nodes; along an axis on which they do not change there is one.

    Parameters
    ----------
    resolution : the side of a voxel; errors far below it do not matter.
    types : of numbers by fit and reach, kept from one walk to the next.
    near : (z, y, x) of the lattice, becomes True where a border is so near that a cell around the node may hold it.
    error : (z, y, x), grows by that of the interpolation of curves of modulation there.
    widths : (z,), become the diagonals of cells where fits are evaluated, as shares of their supports: the largest, or
        a bound of it where that is narrow enough.
    """

    resolution: float
    types: dict[Any, Any]
    near: NDArray[np.bool_]
    error: NDArray[np.float32]
    widths: NDArray[np.float32]

    def through(self, field: AbstractField, x: Floats) -> Floats:
        """Displacements of places, which are those of the nodes somewhere on the way."""
        match field:
            case Composed():
                d = self.through(field.then, x)
                return d + self.through(field.first, x + d)
            case Staged():
                return self._stages(field.fits[::-1], x) - x
            case RBFInterpolant():
                return self._fits((field,), x) - x
            case RigidInterpolant():
                return self._beside_parts(field, x)
            case Extrusion():
                return self._extruded(field, x)
            case Decoupled():
                return self._beside_cuts(field, x)
            case _:
                return np.moveaxis(field.displacement(np.moveaxis(x, 0, -1)), -1, 0)

    def _stages(self, fits: Sequence[AbstractField], x: Floats) -> Floats:
        if all(isinstance(fit, RBFInterpolant) for fit in fits):
            return self._fits(fits, x)  # type: ignore[arg-type]
        for fit in fits:
            x = x + self.through(fit, x)
        return x

    def _fits(self, fits: Sequence[RBFInterpolant], x: Floats) -> Floats:
        ends, ways = moved_back(fits, x.reshape(len(x), -1), self.resolution, self.types)
        diagonal = _diagonal(x) if ways else 0.0
        for fit, at in ways:
            # What displacements differ by anywhere bounds what they add to a cell; seldom more has to be looked at.
            scale = _largest_scale(fit) / fit.support
            moved = at * np.float32(fit.support) - ways[0][1] * np.float32(ways[0][0].support)
            width = (diagonal + float(np.linalg.norm(np.ptp(moved, axis=(0, 2))))) * scale
            if _NARROWEST * width > 1:
                lattice = np.moveaxis(at, 0, 1).reshape(len(x), -1)[:, : x[0].size].reshape(x.shape)
                width = _diagonal(lattice) * fit.support * scale
            np.maximum(self.widths, width, out=self.widths)
        return ends.reshape(x.shape)

    def _beside_parts(self, field: RigidInterpolant, x: Floats) -> Floats:
        back = [_turned(np.asarray(m), x) + _column(t) for m, t in zip(field.matrices, field.shifts, strict=True)]
        distances = [_distances([region], y)[0] for region, y in zip(field.regions, back, strict=True)]
        for region, y, distance in zip(field.regions, back, distances, strict=True):
            self.near[...] |= np.abs(distance) <= _change(y, [region])
        outside = [np.maximum(distance, 0.0) for distance in distances]
        last = [np.moveaxis(y, 0, -1) for y in (x, *back)]
        moved, weight = drift_and_weight(last[0], last[1:], outside, field.scales, field.weights, np)
        return np.moveaxis(moved, -1, 0) + weight * self.through(field.base, x)

    def _extruded(self, field: Extrusion, x: Floats) -> Floats:
        abc = _turned(field.plane.frame, x - _column(field.plane.origin))
        ab, depth = self._without_copies(abc[:2]), self._without_copies(abc[2:])[0]
        moves = [self.through(m, ab) for m in field.maps]
        if not field.is_replication:
            errors = _curve_errors(field, depth.ravel(), max(_sides(depth[None])))
            for error, d in zip(errors, moves, strict=True):
                self.error[...] += error.reshape(depth.shape) * np.linalg.norm(d, axis=0)
        weights = field.weights_at(depth[:1, :1, :1] if field.is_replication else depth)
        return _turned(field.plane.frame[:2].T, sum(w * d for w, d in zip(weights, moves, strict=True)))

    def _without_copies(self, places: Floats) -> Floats:
        """Places, one for all along an axis on which they do not change."""
        for axis in (1, 2, 3):
            first = places.take([0], axis)
            ends = places.take([-1], axis)  # which differ as a rule where anything does
            if all(np.abs(some - first).max(initial=0.0) <= _SAME * self.resolution for some in (ends, places)):
                places = first
        return places

    def _beside_cuts(self, field: Decoupled, x: Floats) -> Floats:
        """Where a region shows its own tissue, and both places lie deep in it, nothing jumps nearby."""
        def distances(places: Floats) -> Floats:
            if field.plane is not None:
                places = _turned(field.plane.frame[:2], places - _column(field.plane.origin))
            return _distances(field.regions, self._without_copies(places))

        here, total = distances(x), np.zeros_like(x)
        needed = _change(x, field.regions) + field.softness
        smooth, free = np.zeros(here.shape[1:], dtype=bool), np.abs(here).min(axis=0) > needed
        for f, side in zip(field.fields, field.sides, strict=True):
            d = self.through(f, x)
            sign = _column(np.where(side, -1.0, 1.0))
            depth = (sign * here).min(axis=0)
            there = (sign * distances(x + d)).min(axis=0)
            smooth = smooth | (depth > needed) & (there > _change(x + d, field.regions) + field.softness)
            free = free & (depth <= 0)  # of a region without control points, which stays where it is
            total = np.where(depth > 0, d, total)
        self.near[...] |= ~(smooth | free)
        return total


def _column(values: Any) -> Floats:
    """Numbers (n,) as (n, 1, 1, 1), one for all places of a lattice."""
    return np.asarray(values, dtype=np.float64).reshape(-1, 1, 1, 1)


def _turned(matrix: Floats, places: Floats) -> Floats:
    """Vectors (dim, z, y, x) by a matrix, in products and sums: BLAS would wait for its threads."""
    out = np.empty((len(matrix), *places.shape[1:]))
    for turned, row in zip(out, matrix.tolist(), strict=True):
        turned[...] = sum(part if m == 1 else m * part for m, part in zip(row, places, strict=True) if m)
    return out


def _sides(places: NDArray[Any]) -> list[float]:
    """Bounds of the sides of the cells between places, along each axis of the lattice."""
    return [float(np.linalg.norm([np.abs(np.diff(p, axis=axis)).max(initial=0.0) for p in places]))
            for axis in range(3)]


def _diagonal(places: NDArray[Any]) -> float:
    """A bound of the diagonals of the cells between places."""
    return float(np.linalg.norm(_sides(places)))


def _change(places: Floats, regions: Sequence[AbstractRegion]) -> float:
    """A bound of how distances differ between any place in a cell and its nearest node, for these places."""
    is_exact = all(isinstance(region, HalfSpace | Polygon | Line) for region in regions)
    return (1.0 if is_exact else _STEEPEST) * _BENT * _diagonal(places) / 2


def _largest_scale(fit: RBFInterpolant) -> float:
    return 1.0 if fit.scales is None else float(np.asarray(fit.scales)[: int(fit.count)].max(initial=0.0))


def _distances(regions: Sequence[AbstractRegion], places: Floats) -> Floats:
    """Signed distances (regions, z, y, x) of places to regions of their dimension."""
    found = in_blocks(partial(_measured, tuple(regions)), places.reshape(len(places), -1).T)
    return found.T.reshape(len(regions), *places.shape[1:])


_measured = compiled(lambda regions, points: jnp.stack([region(points) for region in regions], axis=-1),
                     on_one_thread=True)


def _curve_errors(field: Extrusion, depth: Floats, side: float) -> Floats:
    """Errors (K, n) of cubic interpolation of the weights around depths (n), between nodes that are ``side`` apart.

    A curve is known in one dimension, so that it is compared at many places with what nodes anywhere make of it.
    """
    (c0, c1), knots = field.depth, np.asarray(field.knots, dtype=np.float64)
    gap = min((b - a for a, b in pairwise(knots)), default=1.0) * (c1 - c0)
    if not (side > 0 and gap > 0):
        return np.zeros((len(field.maps), len(depth)))
    samples = max(_SAMPLES[0], int(np.ceil(2 * side / gap)))
    if samples > _SAMPLES[1]:
        return np.full((len(field.maps), len(depth)), np.inf)
    step = side / samples
    first = max(float(depth.min()), c0 - side) - 3 * side
    last = min(float(depth.max()), c1 + side) + 3 * side
    c = first + step * np.arange(int(np.ceil(max(last - first, 6 * side) / step)) + 1)
    w = field.weights_at(np.asarray(c, dtype=np.float64))
    count = w.shape[1] - 3 * samples
    error = np.zeros_like(w)
    for j in range(1, samples):  # the place lies j steps behind the second of four nodes
        read = sum(share * w[:, k * samples : k * samples + count] for k, share in enumerate(_lagrange(j / samples)))
        at = slice(samples + j, samples + j + count)
        error[:, at] = np.maximum(error[:, at], np.abs(w[:, at] - read))
    error = ndimage.maximum_filter1d(error, 2 * samples + 1, axis=1, mode="nearest")
    return np.stack([np.interp(depth, c, e) for e in error])
