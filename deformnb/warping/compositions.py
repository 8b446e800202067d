"""Compositions of deformations at all voxels of a block: a table of nodes, read by cubic interpolation.

``D = D_last(x) + D_before(x + D_last(x)) + ...`` is interpolated between nodes where it is smooth. Elsewhere only the
last deformation is evaluated on a lattice, the others at the places to which the ones after them lead
(:mod:`deformnb.warping.exact_places`). A GPU evaluates all of them at every voxel.

Every deformation of a composition is evaluated at the places to which those after it lead, so that n of them cost n
sums over control points at every voxel. Nodes a few voxels apart need a sixty-fourth of that. Between nodes at distance
h cubic interpolation along one axis misses a smooth D by ``3/128 |h^4 D''''|``, which the fourth differences of the
nodes measure themselves (de Boor, A Practical Guide to Splines, 2001, chapter II); where a derivative jumps the factor
is larger: 0.049 for the third one (Wendland's C2 kernel at its centre), 0.064 for the second (thin plates), 0.375 for
the first (the distance to a rigid part). Along the three axes the errors add up to

    c (|d_x| + 5/4 |d_y| + 25/16 |d_z|)

with d the fourth differences and 5/4 the most that cubic interpolation enlarges an error. Cells where that exceeds
:data:`ERROR` are not interpolated, nor are those near the border of a rigid part, or where a curve of modulation bends
sharply: there the composition is evaluated at every voxel. Near the border of a cut the displacements of every region
are interpolated, and the voxels choose among them (:mod:`deformnb.warping.border_cells`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._typing import Floats, Progress
from deformnb.rbf.exactness import SHARES
from deformnb.rbf.fields import AbstractField, Identity, grid_lines, links_of
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.rigid import RigidInterpolant
from deformnb.volume.volume import Grid
from deformnb.warping import border_cells, planning
from deformnb.warping.border_cells import Regional
from deformnb.warping.exact_places import ExactPlaces
from deformnb.warping.node_walk import (
    BENT,
    JUMPS,
    NARROWEST,
    NEAR_CUT,
    STEEPEST,
    FitSums,
    Walk,
    lagrange,
    smoothness_of,
)

ERROR = SHARES["nodes"]
"""Largest error of an interpolated displacement of a composition, in the smallest side of a voxel. Where neighbouring
voxels differ by 100 grey levels, it changes the result by one at most, and by a third of one as a rule."""

NODE_SPACINGS = (8, 6, 4, 3, 2)
"""Distances of nodes in voxels; the one of least work is taken, of nodes and of the voxels that are evaluated one by
one."""

FIT_ERROR = 0.75 * SHARES["lattice"]
"""Largest error of an interpolated displacement of a single fit, likewise. The rest of what a fit may miss at voxels is
for the rounding of its sums."""

# Voxels, and centres that reach a voxel, from which on nodes of a single fit take less time than sums at every voxel.
_MANY_VOXELS, _MANY_CENTERS = 2**20, 24

# Nodes of a single fit that are denser take as long as sums at every voxel.
_FIT_SPACINGS = NODE_SPACINGS[:-1]

# The one next to borders, and where a coarse lattice does not decide.
_USUAL = 4

# A coarse lattice, of a thirtieth of the nodes 5 voxels apart, estimates the errors of those of all distances.
_FIRST_SPACING = 16

# Errors fall with this power of the distance of nodes: by 4 where smooth, 3 around the centres of kernels. Shares
# of bad cells that it foretold of 12 compositions (8 to 100 points, five kernels) were at most twice too large or small
# where they exceeded 2 %; smaller ones, and those of thin plates, were up to 15 times too small. Blocks judge anew.
_ORDER = 3.5

_EVERY = (slice(None), slice(None))

# What a voxel that is listed and evaluated by itself costs, in nodes or in voxels of a block that is evaluated whole.
_LISTED = 1.5

# Voxels that are replaced at a time.
_TOGETHER = 2**15

# Nodes that are evaluated at a time, and planes of them at least: one more plane is evaluated with each of these parts.
_NODES_TOGETHER, _LEAST_PLANES = 2**16, 8

# The number of no table of displacements, for cells that are evaluated voxel by voxel.
_NO_TABLE = -3

# Interpolation reads a node before a cell and one behind it, their fourth differences one more on either side.
_HALO = 2

Voxels: TypeAlias = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]
"""Indices z, y, x, each (n,); some voxels may come more than once."""


class Replacement(NamedTuple):
    """Voxels of the grid with their displacements along x, y, z, each (n,), and their opacity (n,) with cuts."""

    voxels: Voxels
    d: Any
    opacity: NDArray[np.float32] | None


class Patch(NamedTuple):
    """Voxels of a box that read other nodes than the block around them.

    Attributes
    ----------
    box : the voxels of the grid. is_own : [z, y, x] those of the box that read these nodes.
    d, nodes : as those of :class:`Displacements`.
    is_hidden : nothing of them is seen.
    """

    box: tuple[slice, slice, slice]
    d: tuple[Any, ...]
    nodes: planning.Tables
    is_own: NDArray[np.bool_]
    is_hidden: bool


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements of a block of voxels, as the warp's kernel reads them.

    Parameters
    ----------
    d : components x, y, z, each [z, y, x] at nodes or at every voxel.
    nodes : along z, y, x the first node that each voxel reads (n,) and the weights (T, n) of nodes from there; None
        where every voxel has its own.
    opacity : [z, y, x] of displacements at every voxel; None where all is 1.
    patches : voxels that read other nodes.
    exact : replacements of these displacements, computed on demand.
    """

    d: tuple[Any, ...]
    nodes: planning.Tables | None = None
    opacity: NDArray[np.float32] | None = None
    patches: Sequence[Patch] = ()
    exact: Iterable[Replacement] = ()


class NodeTable:
    """Displacements of a field in space at the voxels of a grid, from nodes that are as far apart as the error allows.

    Nodes at one of :data:`NODE_SPACINGS` are evaluated once for the whole grid. Blocks where these leave too much to be
    evaluated voxel by voxel get separate, denser ones. Near the borders of cuts the nodes of each block hold the
    displacements of every region (:mod:`deformnb.warping.border_cells`), if the fields of the regions have no cuts of
    their own and at most :data:`~deformnb.warping.border_cells.MOST_TABLES` displacements are needed there; else each
    voxel is evaluated there.

    Parameters
    ----------
    field : any whose smoothness is known (:func:`~deformnb.warping.node_walk.smoothness_of`).
    grid : the voxels.
    progress : called with the finished share of the nodes.
    exactly : displacements (3, n) and opacity (n) of the field at places (3, n); made of the field if None.
    error : the largest of a displacement, in the smallest side of a voxel.
    spacings : of the nodes, of which the best is taken.
    """

    def __init__(
        self,
        field: AbstractField,
        grid: Grid,
        progress: Progress | None = None,
        exactly: Callable[..., tuple[Any, Any]] | None = None,
        error: float = ERROR,
        spacings: tuple[int, ...] = NODE_SPACINGS,
    ) -> None:
        self._error, self._spacings = error * min(grid.spacing), (*spacings, 1)
        self._field, self._grid, self._exact = field, grid, exactly or ExactPlaces(links_of(field), grid)
        self._left: list[NDArray[np.intp]] = []
        estimate = _Lattice(field, grid, _FIRST_SPACING, self._error).cells
        best = 1 if estimate.has_borders else estimate.best_spacing(_EVERY, self._spacings)
        self._whole = _Lattice(field, grid, best if best > 1 else _USUAL, self._error, progress)

    def block(self, block: tuple[slice, slice]) -> Displacements | None:
        """Displacements in planes and rows of the grid.

        Other voxels that are to be evaluated there are added to :meth:`left`, or come along if the block has nodes of
        its own. None where the field bends so much that it is to be evaluated at every voxel of the block.
        """
        cells = (self._whole.cells.of(block[0]), self._whole.cells.of(block[1]))
        spacing = self._whole.cells.best_spacing(cells, self._spacings)
        start = np.array([block[0].start, block[1].start, 0])
        stop = np.minimum([block[0].stop, block[1].stop, self._grid.shape[2]], self._grid.shape)
        if spacing == self._whole.spacing:
            self._left.append(self._whole.cells.bad(cells))
            patches, near = self._read_cuts(self._whole, cells, np.zeros(3, int), start, stop)
            return self._read(self._whole, block, patches, near)
        if spacing > 1:
            grid = planning.lattice(self._grid, block, 1)
            lattice = _Lattice(self._field, grid, spacing, self._error)
            if lattice.cells.best_spacing(_EVERY, (spacing, 1)) == spacing:
                own = (slice(0, grid.shape[0]), slice(0, grid.shape[1]))
                patches, near = self._read_cuts(lattice, _EVERY, start, start, stop)
                bad = self._all(lattice.cells.bad(_EVERY), spacing, start, stop)
                return self._read(lattice, own, patches, chain(near, bad))
        return None

    def replacements(self) -> list[Callable[[], Replacement]]:
        """Replacements due in all blocks so far except :attr:`Displacements.exact`, each computed when called."""
        if not self._left:
            return []
        pieces = _pieces(np.concatenate(self._left), self._whole.spacing, np.zeros(3, int), np.array(self._grid.shape))
        return [partial(self._exactly, voxels) for voxels in pieces]

    def _all(
        self, cells: NDArray[np.intp], spacing: int, corner: NDArray[np.intp], stop: NDArray[np.intp]
    ) -> Iterator[Replacement]:
        return (self._exactly(voxels) for voxels in _pieces(cells, spacing, corner, stop))

    def _exactly(self, voxels: Callable[[], Voxels]) -> Replacement:
        """Voxels with the displacements of the field itself."""
        index = voxels()
        return Replacement(index, *self._evaluate(np.stack(index)))

    def _evaluate(self, index: NDArray[np.integer[Any]]) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Displacements (3, n) and opacity (n,) of the field at voxels z, y, x (3, n)."""
        d, opacity = self._exact(self._grid.matrix @ index[::-1] + np.asarray(self._grid.origin)[:, None])
        return d, opacity if self._field.has_cuts else None

    def _read_cuts(
        self,
        lattice: _Lattice,
        cells: tuple[slice, slice],
        corner: NDArray[np.intp],
        start: NDArray[np.intp],
        stop: NDArray[np.intp],
    ) -> tuple[list[Patch], Iterator[Replacement]]:
        """The voxels of a block in cells that the border of a cut may cross, or whose nodes are on both sides of one.

        corner : the first voxel of the lattice; start, stop : the first voxel and the end of the block.
        """
        border = lattice.cells.cut_cells(cells)
        if not len(border):
            return [], iter(())
        box, spacing = lattice.enclosing_box(border), lattice.spacing
        if box is None:
            return [], self._all(border, spacing, corner, stop)
        at = tuple((border - box.first).T)
        bad, shown = box.is_bad[at], box.shown[at]
        is_near = ~bad & (shown == border_cells.UNCLEAR)
        near, side = border[is_near], border_cells.part_side(spacing)
        parts = np.repeat(np.where(bad, _NO_TABLE, shown)[None], (spacing // side) ** 3, axis=0)
        parts[:, is_near] = self._find_parts(box, near, spacing, corner)
        patches = self._patches(box, border, parts, spacing, corner, start, stop)
        return patches, chain(
            self._all(border[bad], spacing, corner, stop),
            self._choose(box, near, parts[:, is_near] == border_cells.UNCLEAR, spacing, corner, start, stop),
        )

    def _find_parts(
        self, box: RegionBox, cells: NDArray[np.intp], spacing: int, corner: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """The tables that the parts of cells (n, 3) show, (parts, n)."""
        return border_cells.find_tables_of_parts(
            box.way, box.nodes, cells - box.first, self._first_places(cells, spacing, corner), self._grid, spacing,
            STEEPEST * self._error,
        )  # fmt: skip

    def _first_places(self, cells: NDArray[np.intp], spacing: int, corner: NDArray[np.intp]) -> Floats:
        """Places (3, n) of the first voxels of cells (n, 3)."""
        return self._grid.index_to_point((spacing * cells + corner)[:, ::-1]).T

    def _patches(
        self,
        box: RegionBox,
        cells: NDArray[np.intp],
        parts: NDArray[np.intp],
        spacing: int,
        corner: NDArray[np.intp],
        start: NDArray[np.intp],
        stop: NDArray[np.intp],
    ) -> list[Patch]:
        """The voxels of cells (n, 3) whose parts (parts, n) show one table of displacements each."""
        side = border_cells.part_side(spacing)
        each, low = spacing // side, cells.min(axis=0)
        numbers = np.full(each * (cells.max(axis=0) + 1 - low), _NO_TABLE)
        offsets = np.indices((each,) * 3).reshape(3, -1, 1)
        numbers[tuple(each * (cells - low).T[:, None] + offsets)] = parts
        patches = []
        for number in np.unique(numbers[numbers >= border_cells.STILL]).tolist():
            is_own, is_hidden = numbers == number, number >= border_cells.HIDDEN + border_cells.STILL
            table = number - border_cells.HIDDEN * is_hidden
            tables, some, among, voxels = [], [], [], []
            for axis in range(3):
                own = np.flatnonzero(is_own.any(axis=tuple(k for k in range(3) if k != axis)))
                first, last = spacing * low[axis] + side * own[0], spacing * low[axis] + side * (own[-1] + 1)
                first, last = max(first, start[axis] - corner[axis]), min(last, stop[axis] - corner[axis])
                n = np.arange(first, last)
                begin, end = int(first // spacing - box.first[axis]), int((last - 1) // spacing - box.first[axis])
                some.append(slice(begin, end + 4))
                among.append(slice(int(first - spacing * low[axis]), int(last - spacing * low[axis])))
                tables.append(((n // spacing - first // spacing).astype(np.int32), _cubic_weights(n, spacing)))
                voxels.append(slice(int(first + corner[axis]), int(last + corner[axis])))
            if all(part.stop > part.start for part in among):
                nodes = box.nodes[:3] * 0 if table == border_cells.STILL else box.nodes[3 * table : 3 * table + 3]
                z, y, x = voxels
                for axis, part in enumerate(among):
                    around = slice(part.start // side, -(-part.stop // side))
                    start_at = part.start - side * around.start
                    own_part = is_own.take(np.arange(around.start, around.stop), axis).repeat(side, axis)
                    is_own = own_part.take(np.arange(start_at, start_at + part.stop - part.start), axis)
                patches.append(Patch((z, y, x), tuple(nodes[:, *some]), tuple(tables), is_own, is_hidden))
        return patches

    def _choose(
        self,
        box: RegionBox,
        cells: NDArray[np.intp],
        parts: NDArray[np.bool_],
        spacing: int,
        corner: NDArray[np.intp],
        start: NDArray[np.intp],
        stop: NDArray[np.intp],
    ) -> Iterator[Replacement]:
        """The voxels of some parts (parts, n) of cells (n, 3) that the border of a cut may cross, a few at a time."""
        side = border_cells.part_side(spacing)
        each = spacing // side
        of_part = np.ravel_multi_index(tuple(np.indices((spacing,) * 3).reshape(3, -1) // side), (each,) * 3)
        offsets = np.indices((spacing,) * 3).reshape(3, -1)
        has_some = parts.any(axis=0)
        cells, parts = cells[has_some], parts[:, has_some]
        for k in range(0, len(cells), border_cells.MOST_CELLS):
            some = cells[k : k + border_cells.MOST_CELLS]
            voxel, cell = np.nonzero(parts[:, k : k + border_cells.MOST_CELLS][of_part])
            index = ((spacing * some.T + corner[:, None])[:, cell] + offsets[:, voxel]).astype(np.int32)
            within = ((index >= start[:, None]) & (index < stop[:, None])).all(axis=0)
            if not within.all():
                index, voxel, cell = index[:, within], voxel[within], cell[within]
            d, opacity, doubt = border_cells.choose(
                box.way, box.nodes, some - box.first, self._first_places(some, spacing, corner), self._grid, spacing,
                STEEPEST * self._error, voxel * len(some) + cell,
            )  # fmt: skip
            exact = np.flatnonzero(doubt)
            if len(exact):
                d[:, exact], opacity[exact] = self._evaluate(index[:, exact])
            yield Replacement((index[0], index[1], index[2]), d, opacity)

    def _read(
        self, lattice: _Lattice, block: tuple[slice, slice], patches: Sequence[Patch], exact: Iterable[Replacement]
    ) -> Displacements:
        """Displacements in a block of the voxels of a lattice; blocks of one shape have equally many nodes."""
        h, tables, some = lattice.spacing, [], []
        for part, present in zip((*block, slice(0, self._grid.shape[2])), lattice.nodes.shape[1:], strict=True):
            n = np.arange(part.start, part.stop)
            count = min(present, (len(n) + h - 2) // h + 4)
            first = min(part.start // h, present - count)
            tables.append(((n // h - first).astype(np.int32), _cubic_weights(n, h)))
            some.append(slice(first, first + count))
        d = tuple(lattice.nodes[:, *some])
        return Displacements(d, tuple(tables), patches=patches, exact=exact)


def _cubic_weights(voxels: NDArray[np.intp], spacing: int) -> NDArray[np.float32]:
    """Weights (4, n) of the nodes around voxels."""
    return np.stack(lagrange(voxels % spacing / spacing)).astype(np.float32)


def _pieces(
    cells: NDArray[np.intp], side: int, start: NDArray[np.intp], stop: NDArray[np.intp]
) -> Iterator[Callable[[], Voxels]]:
    """All voxels in cells (n, 3), a few at a time: the indices of all would take more memory than the result.

    start : the first voxel of the first cell; stop : the end of the voxels.
    """
    most = max(1, _TOGETHER // side**3)
    for first in range(0, len(cells), most):
        yield partial(_voxels, cells[first : first + most], side, start, stop)


def _voxels(cells: NDArray[np.intp], side: int, start: NDArray[np.intp], stop: NDArray[np.intp]) -> Voxels:
    index = (side * cells.T[:, :, None] + np.indices((side,) * 3).reshape(3, 1, -1)).reshape(3, -1) + start[:, None]
    z, y, x = np.minimum(index, stop[:, None] - 1).astype(np.int32)
    return z, y, x


class RegionBox(NamedTuple):
    """The displacements of all regions at the nodes around some cells.

    Attributes
    ----------
    way : through these displacements.
    nodes : (3 tables, z, y, x), the first ones a node before the first cell.
    first : index of the first cell.
    shown : for each cell (z, y, x) the number of its table, as :func:`~deformnb.warping.border_cells.find_tables`
        finds it. is_bad : the cells that bend too much to be interpolated.
    """

    way: Any
    nodes: NDArray[np.float32]
    first: NDArray[np.intp]
    shown: NDArray[np.intp]
    is_bad: NDArray[np.bool_]


class _Cells:
    """Cells between the nodes of a lattice: how much the field bends in each, and which are near borders.

    Parameters
    ----------
    shape : of the cells (z, y, x).
    spacing : of the nodes, in voxels.
    allowed : error of interpolation, physical.

    Attributes
    ----------
    bounds : of the errors of interpolation; of no meaning at ``cuts``.
    borders : cells that are evaluated voxel by voxel; cuts : those where the regions of both sides are interpolated.
    widths : of cells in each plane, as :attr:`Walk.widths`.
    """

    def __init__(self, shape: tuple[int, ...], spacing: int, allowed: float) -> None:
        self._spacing, self.allowed = spacing, allowed
        self.bounds, self.borders = np.empty(shape, np.float32), np.empty(shape, dtype=bool)
        self.cuts, self.widths = np.zeros(shape, dtype=bool), np.zeros(shape[0], np.float32)

    @property
    def has_borders(self) -> bool:
        """True if the border of a cut or a part, or a sharp bend of a curve of modulation is near anywhere."""
        return bool(self.borders.any() or self.cuts.any())

    def of(self, part: slice) -> slice:
        """The cells that hold the voxels of a part of an axis."""
        return slice(part.start // self._spacing, -(-part.stop // self._spacing))

    def best_spacing(self, cells: tuple[slice, slice], among: Sequence[int]) -> int:
        """The spacing of least work for these cells, among some: this one, denser ones, 1 for every voxel itself."""
        return min((h for h in among if h <= self._spacing), key=lambda h: self._work(cells, h))

    def _work(self, cells: tuple[slice, slice], h: int) -> float:
        counts = [self._spacing * n for n in self.bounds[cells].shape]
        voxels = float(np.prod(counts))
        if h == 1:
            return voxels
        nodes = 0.0 if h == self._spacing else float(np.prod([n / h + 1 + 2 * _HALO for n in counts]))
        return nodes + _LISTED * voxels * float(np.mean(self._bends(cells, h) | self.borders[cells]))

    def _bends(self, cells: tuple[slice, slice], h: int) -> NDArray[np.bool_]:
        """Check which cells bend too much for nodes at a spacing, about if it is not this one."""
        ratio = h / self._spacing
        is_narrow = NARROWEST * ratio * self.widths[cells[0]] > 1
        return is_narrow[:, None, None] | ~(ratio**_ORDER * self.bounds[cells] <= self.allowed)

    def bad(self, cells: tuple[slice, slice]) -> NDArray[np.intp]:
        """Indices (n, 3) of the cells among these that are evaluated voxel by voxel."""
        return _indices(self.borders[cells] | self._bends(cells, self._spacing), cells)

    def cut_cells(self, cells: tuple[slice, slice]) -> NDArray[np.intp]:
        """Indices (n, 3) of the cells among these where the displacements of all regions are interpolated."""
        return _indices(self.cuts[cells] & ~self._bends(cells, self._spacing), cells)


class _Lattice:
    """Nodes of a field around all voxels of a grid.

    Attributes
    ----------
    spacing : of the nodes, in voxels.
    nodes : (3, z, y, x), the first ones a node before the first voxel.
    cells : estimates of the errors between them.
    """

    def __init__(
        self, field: AbstractField, grid: Grid, spacing: int, error: float, progress: Progress | None = None
    ) -> None:
        self._field, self._grid, self.spacing = field, grid, spacing
        # What is left of the error that a sum may have on a lattice, where that is smaller than this one.
        self._sums = FitSums(min(grid.spacing) * abs(1 - error / SHARES["lattice"]))
        smoothness = smoothness_of(field)
        assert smoothness is not None
        self._factor = JUMPS[smoothness]
        self.cells = _Cells(tuple(-(-n // spacing) for n in grid.shape), spacing, error)
        shape = tuple(n + 1 + 2 * _HALO for n in self.cells.bounds.shape)
        values, walk = np.empty((3, *shape), np.float32), self._walk(shape)
        most = max(_LEAST_PLANES, _NODES_TOGETHER // (shape[1] * shape[2]))
        beyond: dict[int, tuple[NDArray[np.uint8], np.float32]] = {}
        planning.run_parts(planning.parts(shape[0], most), partial(self._evaluate, values, walk, beyond), progress)
        for plane, (marks, width) in beyond.items():
            walk.marks[plane] |= marks
            walk.widths[plane] = max(walk.widths[plane], width)
        self.cells.widths = _reduce_cells(walk.widths[1:-1], 4, np.maximum)
        can_choose = border_cells.can_choose(field)
        slabs = planning.parts(self.cells.widths.size, most)
        planning.run_parts(slabs, partial(self._judge, values, walk, can_choose), None)
        self.nodes = values[:, 1:-1, 1:-1, 1:-1]

    def enclosing_box(self, cells: NDArray[np.intp]) -> RegionBox | None:
        """The displacements of all regions at the nodes of the smallest box around cells; None if they are many."""
        first = cells.min(axis=0)
        shape = tuple(np.ptp(cells, axis=0) + 2 + 2 * _HALO)
        places, walk = self._places(first, shape), self._walk(shape)
        regional = Regional(walk)
        way = regional.path(links_of(self._field), places, None, None)
        if len(regional.tables) > border_cells.MOST_TABLES:
            return None
        tables = [np.broadcast_to(d, places.shape).astype(np.float32) for d in regional.tables]
        error = np.max([self._bend(d, walk.error) for d in tables], axis=0)
        is_bad = ~(_reduce_cells(error, 2, np.maximum) <= self.cells.allowed)
        is_bad |= _reduce_cells(walk.marks[1:-1, 1:-1, 1:-1], 4, np.bitwise_or) & BENT > 0
        is_bad |= (NARROWEST * _reduce_cells(walk.widths[1:-1], 4, np.maximum) > 1)[:, None, None]
        nodes = np.ascontiguousarray(np.concatenate(tables)[:, 1:-1, 1:-1, 1:-1])
        inner = slice(_HALO, -_HALO - 1)
        middles = places[:, inner, inner, inner] + self._grid.matrix.sum(axis=1).reshape(3, 1, 1, 1) * (
            (self.spacing - 1) / 2
        )
        shown = border_cells.find_tables(way, nodes, middles, self.spacing, STEEPEST * self.cells.allowed)
        return RegionBox(way, nodes, first, shown, is_bad)

    def _places(self, first: Any, shape: Any) -> Floats:
        """Places (3, z, y, x) of nodes, the first of them two before the first voxel of a cell."""
        z, y, x = self._lines(first, shape)
        return (z[:, :, None, None] + y[:, None, :, None]) + x[:, None, None, :]

    def _lines(self, first: Any, shape: Any) -> list[Floats]:
        """Places along z, y, x, (3, n) each, to be added."""
        z, y, x = (
            self._grid.matrix[:, [2 - axis]] * (self.spacing * (start + np.arange(n) - float(_HALO)))
            for axis, (start, n) in enumerate(zip(first, shape, strict=True))
        )
        return [z + np.asarray(self._grid.origin)[:, None], y, x]

    def _walk(self, shape: Any) -> Walk:
        return Walk(
            self._sums,
            np.zeros(shape, np.uint8),
            np.zeros(shape, np.float32),
            np.zeros(shape, np.int32),
            np.zeros(shape[0], np.float32),
        )

    def _evaluate(
        self,
        values: NDArray[np.float32],
        whole: Walk,
        beyond: dict[int, tuple[NDArray[np.uint8], np.float32]],
        slab: slice,
    ) -> None:
        """The nodes of some planes, and one more, for the cells between this slab and the next one."""
        shape = (min(slab.stop + 1, values.shape[1]) - slab.start, *values.shape[2:])
        places, walk = self._places((slab.start, 0, 0), shape), self._walk(shape)
        z, y, x = self._lines((slab.start, 0, 0), shape)
        walk = replace(walk, lattice=(places, (z[:, :, None] + y[:, None, :]).reshape(3, -1), x))
        d = walk.displacements(self._field, places)
        planes = slice(0, slab.stop - slab.start)
        values[:, slab] = np.broadcast_to(d, places.shape)[:, planes]
        for name in ("marks", "error", "regions", "widths"):
            getattr(whole, name)[slab] = getattr(walk, name)[planes]
        if shape[0] > planes.stop:
            beyond[slab.stop] = walk.marks[-1], walk.widths[-1]

    def _judge(self, values: NDArray[np.float32], walk: Walk, can_choose: bool, part: slice) -> None:
        """Bound the errors in some planes of cells, and find those near borders."""
        inner, one = slice(_HALO, -_HALO), slice(1, -1)
        own = slice(part.start, part.stop + 1 + 2 * _HALO)
        marks, error, cells = walk.marks[own], walk.error[own], self.cells
        # Marks of kinks count at the four nodes that a cell reads along each axis, errors and cuts at its own two.
        # The six from which its error is found must be in one region.
        cells.borders[part] = _reduce_cells(marks[one, one, one], 4, np.bitwise_or) & BENT > 0
        cells.borders[part] |= _reduce_cells(error[inner, inner, inner], 2, np.maximum) > cells.allowed
        cells.bounds[part] = _reduce_cells(self._bend(values[:, own], error), 2, np.maximum)
        if self._field.has_cuts:
            regions = walk.regions[own]
            is_cut = _reduce_cells(marks[inner, inner, inner], 2, np.bitwise_or) & NEAR_CUT > 0
            is_cut |= _reduce_cells(regions, 6, np.maximum) != _reduce_cells(regions, 6, np.minimum)
            cells.bounds[part][is_cut] = 0  # of no meaning there
            if can_choose:
                cells.cuts[part] = is_cut & ~cells.borders[part]
            else:
                cells.borders[part] |= is_cut

    def _bend(self, d: NDArray[np.float32], error: NDArray[np.float32]) -> NDArray[np.float32]:
        """The errors of interpolation at all nodes but the two outermost on each side; ``error`` is added to them."""
        inner = slice(_HALO, -_HALO)
        error = error[inner, inner, inner]
        for axis, gain in ((0, 25 / 16), (1, 5 / 4), (2, 1.0)):  # the one done first is enlarged most
            some = (slice(None), *(slice(None) if k == axis else inner for k in range(3)))
            bend = np.sqrt(np.square(np.diff(d[some], 4, axis=axis + 1)).sum(axis=0))
            error = error + np.float32(self._factor * gain) * bend
        return error


def _indices(chosen: NDArray[np.bool_], cells: tuple[slice, slice]) -> NDArray[np.intp]:
    """Indices (n, 3) of those chosen among cells."""
    found = np.argwhere(chosen)
    found[:, :2] += [part.start or 0 for part in cells]
    return found


def _reduce_cells(values: NDArray[Any], count: int, joined: np.ufunc) -> NDArray[Any]:
    """``count`` neighbours along each axis, joined by a function such as the maximum."""
    for axis in range(values.ndim):
        n = values.shape[axis] - count + 1
        values = joined.reduce([values.take(np.arange(k, k + n), axis) for k in range(count)])
    return values


class ComposedEvaluator:
    """The steps of a composition, made ready for one output grid.

    Parameters
    ----------
    field : any field in space; one that is no composition has one step.
    grid : the output's grid.
    """

    def __init__(self, field: AbstractField, grid: Grid) -> None:
        self._field, self._grid = field, grid
        self._links = links = [link for link in links_of(field) if not isinstance(link, Identity)] or [Identity(3)]
        self.has_cuts = field.has_cuts
        # Fields with cuts are slow on a lattice too; others are exact and fast there.
        start = 0 if links[0].has_cuts else 1
        self._first, self._rest = links[0] if start else None, links[start:]
        is_long = bool(self._rest) or len(field.steps) > 1
        self._error = ERROR if is_long else FIT_ERROR
        self._spacings = NODE_SPACINGS if is_long else _FIT_SPACINGS
        self._is_known = (is_long or _has_many_terms(field, grid)) and smoothness_of(field) is not None
        self._nodes: NodeTable | None = None

    @property
    def is_single(self) -> bool:
        """True if there is nothing that a lattice would not do."""
        return not self._rest and not self._is_known

    def prepare(self, progress: Progress | None = None) -> None:
        """Evaluate the nodes between which the composition is interpolated.

        Parameters
        ----------
        progress : called with the finished share.
        """
        if self._is_known and not self._exact_field.is_on_gpu:
            self._nodes = NodeTable(self._field, self._grid, progress, error=self._error, spacings=self._spacings)

    def block(self, block: tuple[slice, slice]) -> Displacements:
        """Displacements in a block of planes and rows, one of :func:`~deformnb.warping.planning.square_blocks`."""
        found = None if self._nodes is None else self._nodes.block(block)
        if found is not None:
            return found
        lattice = planning.lattice(self._grid, block, 1)
        if self._first is not None and not self._rest:
            return Displacements(planning.displacements(self._first, lattice))
        if not self._exact_field.is_on_gpu:
            return self._evaluate_all(lattice)
        d, opacity = self._exact_field.evaluate_on_gpu(lattice)
        return Displacements(d, opacity=opacity)

    def replacements(self) -> list[Callable[[], Replacement]]:
        """Replacements due in the blocks so far, see :meth:`NodeTable.replacements`."""
        return [] if self._nodes is None else self._nodes.replacements()

    @cached_property
    def _exact_field(self) -> ExactPlaces:
        return ExactPlaces(self._links, self._grid)

    @cached_property
    def _exact_rest(self) -> ExactPlaces:
        return ExactPlaces(self._rest, self._grid)

    def _evaluate_all(self, lattice: Grid) -> Displacements:
        rows, columns = grid_lines(lattice)
        places = (rows[:, :, None] + columns[:, None, :]).reshape(3, -1)
        d = np.zeros_like(places)
        if self._first is not None:
            first = planning.displacements_and_opacity(self._first, lattice)[0]
            d += np.stack([np.asarray(part).ravel() for part in _as_parts(first)])
        more, opacity = self._exact_rest(places + d)
        shape = lattice.shape
        return Displacements(
            tuple(part.reshape(shape) for part in (d + more).astype(np.float32)),
            opacity=opacity.reshape(shape) if self.has_cuts else None,
        )


def _has_many_terms(field: AbstractField, grid: Grid) -> bool:
    """Check for a fit that nodes evaluate in less time than voxels; a GPU evaluates all voxels."""
    field = field.base if isinstance(field, RigidInterpolant) else field
    if not isinstance(field, RBFInterpolant) or grid.size < _MANY_VOXELS or not devices.is_host():
        return False
    ball = 4 / 3 * np.pi * float(field.support) ** 3 / (grid.size * float(np.prod(grid.spacing)))
    return int(field.count) * (min(1.0, ball) if field.kernel.compact else 1.0) >= _MANY_CENTERS


def _as_parts(d: Any) -> list[Any]:
    return list(d) if isinstance(d, tuple) else list(np.moveaxis(np.asarray(d), -1, 0))
