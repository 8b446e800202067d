"""Displacements in the cells between nodes that the border of a cut may cross.

Each region's map is smooth across the border, and only the choice among them jumps. So the nodes around such cells hold
the displacements of every region, before the cut and after it, each interpolated as elsewhere
(:mod:`deformnb.warping.compositions`). A place p before the cut and the places ``p + D_k(p)`` that the regions would
show are then known within the error of interpolation, and so are the distances to the cut by which the region is chosen
(:func:`~deformnb.rbf.cuts.decide`).

First the choice is made in the middle of each cell, then in parts of two voxels a side: where all distances are so
large that no place around can differ, all voxels show one region. Only the others choose one by one, and of these the
ones for which the error may decide are evaluated: those about as near a border as half the softness of the cut.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from dataclasses import field as member
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats
from deformnb.rbf.cuts import Decoupled, Sides, decide, is_doubtful
from deformnb.rbf.fields import AbstractField, links_of
from deformnb.volume.volume import Grid
from deformnb.warping.node_walk import Walk, cut_distances, depth_in, farthest_of, lagrange, reach_of

MOST_CELLS = 512
"""Cells whose voxels are chosen together: their arrays stay in the cache."""

UNCLEAR, STILL = -2, -1
"""Instead of the number of a table: the voxels of a cell may show several regions; or nothing moves."""

HIDDEN = 1000
"""Is added to the number of a table where its tissue is hidden."""

MOST_TABLES = 24
"""Displacements that a node holds at most: without a limit those of 256 regions could follow one another."""


@dataclass(frozen=True)
class _Shown:
    """The end of a way: the number of the table of displacements; None where nothing moves."""

    table: int | None


@dataclass(frozen=True, eq=False)
class _Branch:
    """The choice among regions at cuts, at one stage of a composition.

    Parameters
    ----------
    cut : the field that chooses; sides : of its regions that may be seen.
    then : the next stage for each region, and last for places in none of them.
    before : the number of the table of displacements before the cut, None where nothing has moved yet.
    after : for each region the table of displacements that include its own.
    reach : how far a place in a cell may be from its middle, before the cut and for each region after it, where places
        count by their distances to the cut.
    """

    cut: Decoupled
    sides: tuple[Sides, ...]
    then: tuple[Any, ...]
    before: int | None
    after: tuple[int, ...]
    reach: tuple[float, ...]

    def distances(self, x: Floats, moves: Sequence[Floats]) -> list[Floats]:
        """Signed distances (cuts, n) of places (3, n) moved by each of some displacements."""
        return [cut_distances(self.cut, x + d) for d in moves]


def can_choose(field: AbstractField) -> bool:
    """Check whether the cuts of a field are such that nodes can hold the displacements of every region."""
    return field.has_cuts and not any(
        link.has_cuts and not (isinstance(link, Decoupled) and not any(part.has_cuts for part in link.fields))
        for link in links_of(field)
    )


@dataclass(eq=False)
class Regional:
    """The displacements of all regions at nodes (z, y, x), which a walk goes through.

    Attributes
    ----------
    tables : displacements (3, z, y, x); their places in the list are their numbers.
    """

    walk: Walk
    tables: list[Floats] = member(default_factory=list)

    def path(self, links: Sequence[AbstractField], x: Floats, d: Floats | None, known: int | None) -> _Shown | _Branch:
        """The path of nodes x through the rest of a composition, moved so far by ``d``, table ``known`` if any."""
        for k, link in enumerate(links):
            at = x if d is None else x + d
            if isinstance(link, Decoupled):
                if d is not None and known is None:
                    known = self._stored_index(d)
                return self._choice(link, links[k + 1 :], x, d, known)
            if not link.is_identity:
                d, known = at - x + self.walk.displacements(link, at), None
        return _Shown(self._stored_index(d) if d is not None and known is None else known)

    def _stored_index(self, d: Floats) -> int:
        self.tables.append(d)
        return len(self.tables) - 1

    def _choice(
        self, cut: Decoupled, rest: Sequence[AbstractField], x: Floats, d: Floats | None, before: int | None
    ) -> _Branch:
        at = x if d is None else x + d
        must_look = len(cut.fields) > 2  # one cut is near by itself
        here, needed = (self.walk.distances(cut, at), reach_of(cut, at)) if must_look else (None, 0.0)
        sides, after, then, reach = [], [], [], [farthest_of(cut, at)]
        error = self.walk.error.copy()
        largest = error.copy()
        for f, side in zip(cut.fields, cut.sides, strict=True):
            self.walk.error[...] = error
            moved = at + self.walk.displacements(f, at)
            if (
                here is not None
                and depth_in(side, here).max() < -needed
                and depth_in(side, self.walk.distances(cut, moved)).max() < -reach_of(cut, moved)
            ):
                continue  # nothing of this region can be seen near these nodes
            sides.append(side)
            reach.append(farthest_of(cut, moved))
            after.append(self._stored_index(moved - x))
            then.append(self.path(rest, x, moved - x, after[-1]))
            np.maximum(largest, self.walk.error, out=largest)
        self.walk.error[...] = error
        is_complete = len(set(cut.sides)) == 2 ** len(cut.regions)
        then.append(_Shown(before) if is_complete else self.path(rest, x, d, before))
        np.maximum(largest, self.walk.error, out=self.walk.error)
        return _Branch(cut, tuple(sides), tuple(then), before, tuple(after), tuple(reach))


def find_tables(
    way: _Shown | _Branch, nodes: NDArray[np.float32], middles: Floats, spacing: int, error: float
) -> NDArray[np.intp]:
    """The number of the table of displacements that all voxels of a cell show, for each cell (z, y, x) between nodes.

    :data:`STILL` where nothing moves, :data:`HIDDEN` more where all is hidden, :data:`UNCLEAR` where the border of a
    cut may be in the cell.

    Parameters
    ----------
    way : through the tables of ``nodes``, which are (3 tables, z, y, x).
    middles : (3, z, y, x) of the voxels of the cells.
    spacing : of the nodes in voxels. error : of the interpolated displacements.
    """
    weights = [np.float32(w) for w in lagrange((spacing - 1) / (2 * spacing))]
    for axis in (1, 2, 3):
        cells = nodes.shape[axis] - 3
        rows = np.moveaxis(nodes, axis, 0)
        nodes = np.moveaxis(_weigh(weights, [rows[k : k + cells] for k in range(4)]), 0, axis)
    share = (spacing - 1) / spacing
    found = _find_tables(way, nodes.reshape(len(nodes), -1), middles.reshape(3, -1), share, error)
    return found.reshape(middles.shape[1:])


def _find_tables(way: Any, tables: NDArray[np.float32], x: Floats, share: float, error: float) -> NDArray[np.intp]:
    if isinstance(way, _Shown):
        return np.full(x.shape[1], STILL if way.table is None else way.table)
    cut = way.cut
    here, *there = way.distances(x, [_displacement(tables, x, table) for table in (way.before, *way.after)])
    before, *after = (share * reach + error for reach in way.reach)
    choice, opacity = decide(here, there, way.sides, cut.rule, cut.softness)
    is_clear = ~is_doubtful(here, there, way.sides, cut.softness, before, after)
    found = np.full(x.shape[1], UNCLEAR)
    for k, then in enumerate(way.then):
        own = is_clear & (choice == k)
        if own.any():
            found[own] = _find_tables(then, tables[:, own], x[:, own], share, error)
    found[(opacity == 0) & (found != UNCLEAR) & (found < HIDDEN + STILL)] += HIDDEN
    return found


def find_tables_of_parts(
    way: _Shown | _Branch,
    nodes: NDArray[np.float32],
    cells: NDArray[np.intp],
    first: Floats,
    grid: Grid,
    spacing: int,
    error: float,
) -> NDArray[np.intp]:
    """:func:`find_tables` for the parts (:func:`part_side`) of cells, (parts, n); parameters as of :func:`choose`."""
    side = part_side(spacing)
    middles = side * np.arange(spacing // side) + (side - 1) / 2
    apart = _steps_in_cell(grid, middles)
    x = (first[:, None, :] + apart[:, :, None]).reshape(3, -1)
    tables = _interpolate(nodes, cells, middles / spacing).reshape(len(nodes), -1)
    return _find_tables(way, tables, x, (side - 1) / spacing, error).reshape(len(middles) ** 3, len(cells))


def part_side(spacing: int) -> int:
    """Voxels along each side of the parts in which cells are judged."""
    return 2 if spacing % 2 == 0 else spacing


def choose(
    way: _Shown | _Branch,
    nodes: NDArray[np.float32],
    cells: NDArray[np.intp],
    first: Floats,
    grid: Grid,
    spacing: int,
    error: float,
    chosen: NDArray[np.intp],
) -> tuple[Any, ...]:
    """Displacements at voxels of cells, interpolated between nodes and chosen among the regions.

    Parameters
    ----------
    way : through the tables of ``nodes``, which are (3 tables, z, y, x).
    cells : (n, 3) at most :data:`MOST_CELLS`, the first node that each reads.
    first : (3, n) the place of the first voxel of each.
    spacing : of the nodes in voxels of the grid.
    error : of the interpolated places.
    chosen : (m,) the voxels that are computed, as flat indices of (voxels of a cell, n).

    Returns
    -------
    displacements (3, m), opacity (m) and whether that may be wrong (m).
    """
    apart = _steps_in_cell(grid, np.arange(spacing))
    x = (first[:, None, :] + apart[:, :, None]).reshape(3, -1).take(chosen, axis=1)
    tables = _interpolate(nodes, cells, np.arange(spacing) / spacing).reshape(len(nodes), -1).take(chosen, axis=1)
    return _decide(way, tables, x, error)


def _steps_in_cell(grid: Grid, steps: NDArray[Any]) -> Floats:
    """Places (3, n^3) in a cell, of steps (n,) along each of the axes z, y, x."""
    z, y, x = np.meshgrid(steps, steps, steps, indexing="ij")
    return np.asarray(grid.matrix @ np.stack([x, y, z]).reshape(3, -1))


def _interpolate(nodes: NDArray[np.float32], cells: NDArray[np.intp], t: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values (tables, places in a cell, n) in cells (n, 3) at shares t of the way to the next node, along each axis."""
    shape = nodes.shape[1:]
    corners = np.ravel_multi_index(tuple(cells.T), shape)
    stencil = np.ravel_multi_index(tuple(np.indices((4,) * 3).reshape(3, -1)), shape)
    values = nodes.reshape(len(nodes), -1).take(np.add.outer(stencil, corners), axis=1)
    # Products of so few numbers are computed by one thread of BLAS, at four times the speed of sums of arrays.
    weights = np.stack(lagrange(t), axis=1).astype(np.float32)
    for k in range(3):
        values = weights @ values.reshape(len(nodes) * len(t) ** k, 4, -1)
    return values.reshape(len(nodes), len(t) ** 3, -1)


def _weigh(weights: Sequence[Any], values: Iterable[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Sum of arrays times their weights."""
    first, *others = values
    total, term = weights[0] * first, np.empty_like(first)
    for w, part in zip(weights[1:], others, strict=True):
        np.multiply(part, w, out=term)
        total += term
    return total


def _displacement(tables: NDArray[np.float32], x: Floats, table: int | None) -> NDArray[Any]:
    return np.zeros_like(x) if table is None else tables[3 * table : 3 * table + 3]


def _decide(
    way: Any, tables: NDArray[np.float32], x: Floats, error: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """Displacements (3, n), opacity and doubt (n) at voxels x (3, n), from tables (3 tables, n) there."""
    if isinstance(way, _Shown):
        d = np.asarray(_displacement(tables, x, way.table), np.float32)
        return d, np.ones(x.shape[1], np.float32), np.zeros(x.shape[1], dtype=bool)
    cut = way.cut
    here, *there = way.distances(x, [_displacement(tables, x, table) for table in (way.before, *way.after)])
    choice, opacity = decide(here, there, way.sides, cut.rule, cut.softness)
    doubt = np.asarray(is_doubtful(here, there, way.sides, cut.softness, error, [error] * len(there)))
    *known, (d, seen, unclear) = [_decide(then, tables, x, error) for then in way.then]
    for k, (own, share, is_unclear) in enumerate(known):
        is_chosen = choice == k
        d, seen = np.where(is_chosen, own, d), np.where(is_chosen, share, seen)
        unclear = np.where(is_chosen, is_unclear, unclear)
    return d, np.asarray(opacity * seen, np.float32), doubt | unclear
