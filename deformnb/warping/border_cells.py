"""Displacements in the cells between nodes that the border of a cut may cross.

Each region's map is smooth across the border, and only the choice among them jumps. So the nodes around such cells hold
the displacements of every region, before the cut and after it, each interpolated as elsewhere
(:mod:`deformnb.warping.compositions`). A place p before the cut and the places ``p + D_k(p)`` that the regions would
show are then known within the error of interpolation, and so are the distances to the cut by which the region is chosen
(:func:`~deformnb.rbf.cuts.decide`). Voxels where that error may decide are evaluated one by one: those about as near a
border as half the softness of the cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field as member
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import float64, jax, jit, jnp, lax, pytree
from deformnb._typing import Floats
from deformnb.rbf.cuts import Decoupled, SideChoice, is_doubtful
from deformnb.rbf.fields import AbstractField, links_of
from deformnb.volume.volume import Grid
from deformnb.warping.node_walk import Walk, depth_in, lagrange, reach_of

# Cells that a compiled loop takes at a time, and the most of them in one call.
_GROUP, _GROUPS = 32, 64

MOST_CELLS = _GROUP * _GROUPS

# Of a distance to a cut in float32, as a share of the coordinates: 16 units in the last place.
_ROUNDING = 2.0**-20

MOST_TABLES = 24
"""Displacements that a node holds at most: without a limit those of 256 regions could follow one another."""


@pytree(data_fields=[], meta_fields=["table"])
@dataclass(frozen=True)
class _Shown:
    """The end of a way: the number of the table of displacements; None where nothing moves."""

    table: int | None


@pytree(data_fields=["cuts", "then"], meta_fields=["before", "after"])
@dataclass(frozen=True, eq=False)
class _Branch:
    """The choice among regions at cuts, at one stage of a composition.

    Parameters
    ----------
    cuts : the choice among regions that may be seen.
    then : the next stage for each region, and last for places in none of them.
    before : the number of the table of displacements before the cut, None where nothing has moved yet.
    after : for each region the table of displacements that include its own.
    """

    cuts: SideChoice
    then: tuple[Any, ...]
    before: int | None
    after: tuple[int, ...]


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
        sides, after, then = [], [], []
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
            after.append(self._stored_index(moved - x))
            then.append(self.path(rest, x, moved - x, after[-1]))
            np.maximum(largest, self.walk.error, out=largest)
        self.walk.error[...] = error
        is_complete = len(set(cut.sides)) == 2 ** len(cut.regions)
        then.append(_Shown(before) if is_complete else self.path(rest, x, d, before))
        np.maximum(largest, self.walk.error, out=self.walk.error)
        return _Branch(cut.choice(sides, np.float32), tuple(then), before, tuple(after))


def choose(
    way: _Shown | _Branch,
    nodes: NDArray[np.float32],
    cells: NDArray[np.intp],
    first: Floats,
    grid: Grid,
    spacing: int,
    error: float,
) -> tuple[Any, ...]:
    """Displacements at the voxels of cells, interpolated between nodes and chosen among the regions.

    Parameters
    ----------
    way : through the tables of ``nodes``, which are (z, y, x, 3 tables).
    cells : (n, 3) at most :data:`MOST_CELLS`, the first node that each reads.
    first : (3, n) the place of the first voxel of each.
    spacing : of the nodes in voxels of the grid.
    error : of the interpolated places. To it comes the rounding of the distances, which are measured in float32.

    Returns
    -------
    displacements along x, y, z, opacity, and whether that may be wrong: each (groups, voxels of a cell, cells of a
    group), in the order of :func:`group_cells`.
    """
    count = -(-len(cells) // _GROUP)
    corners = np.asarray(np.ravel_multi_index(tuple(group_cells(cells.T)), nodes.shape[:3]))  # (groups, cells)
    stencil = np.asarray(np.ravel_multi_index(tuple(np.indices((4,) * 3).reshape(3, -1)), nodes.shape[:3]))
    values = np.empty((_GROUPS, 64, _GROUP, nodes.shape[3]), np.float32)
    values[:count] = nodes.reshape(-1, nodes.shape[3]).take(corners[:, None] + stencil[:, None], 0, mode="clip")
    starts = np.zeros((_GROUPS, 3, _GROUP))
    starts[:count] = np.moveaxis(group_cells(first), 0, 1)
    apart = grid.matrix @ np.indices((spacing,) * 3)[::-1].reshape(3, -1)
    weights = np.stack(lagrange(np.arange(spacing) / spacing)).astype(np.float32)
    error += _ROUNDING * _farthest(way, first)
    with float64():
        found = _evaluate(way, values, starts, apart, weights, error, np.int32(count))
    return tuple(np.asarray(part)[:count] for part in found)


def _farthest(way: _Shown | _Branch, places: Floats) -> float:
    """The largest coordinate of places (3, n), and of the regions, from the origin of any cut of the composition."""
    if isinstance(way, _Shown):
        return 0.0
    own = float(np.linalg.norm(np.abs(places - way.cuts.origin[:, None]).max(axis=1)))
    of_regions = [np.abs(leaf)[np.isfinite(leaf)].max(initial=0.0) for leaf in jax.tree.leaves(way.cuts.regions)]
    return max(own, *map(float, of_regions), *(_farthest(then, places) for then in way.then))


def group_cells(values: NDArray[Any]) -> NDArray[Any]:
    """Values (k, n) of cells as (k, groups, cells of a group), the last one repeated."""
    n = values.shape[1]
    count = -(-n // _GROUP) * _GROUP
    return values[:, np.minimum(np.arange(count), n - 1)].reshape(len(values), -1, _GROUP)


def _choose(way: Any, values: Any, starts: Any, apart: Any, weights: Any, error: Any, count: Any) -> tuple[Any, ...]:
    shape = (weights.shape[1] ** 3, values.shape[2])

    def group(k: Any) -> tuple[Any, ...]:
        some = lax.dynamic_index_in_dim(values, k, keepdims=False)
        between = _interpolate(some.reshape(4, 4, 4, -1), weights).reshape(*shape, -1)
        between = lax.optimization_barrier(jnp.moveaxis(between, -1, 0))
        x = [
            s[None, :] + a[:, None]
            for s, a in zip(lax.dynamic_index_in_dim(starts, k, keepdims=False), apart, strict=True)
        ]
        d, opacity, doubt = _decide(way, between, x, error)
        return *(part.astype(jnp.float32) for part in (*d, opacity)), doubt

    def add(k: Any, out: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(
            lax.dynamic_update_index_in_dim(whole, part, k, 0) for whole, part in zip(out, group(k), strict=True)
        )

    kinds = (jnp.float32,) * 4 + (bool,)
    out = tuple(jnp.zeros((values.shape[0], *shape), kind) for kind in kinds)
    return lax.fori_loop(0, count, add, out)


def _interpolate(nodes: Any, weights: Any) -> Any:
    """Values (4, 4, 4, n) of nodes at the voxels (s, s, s, n) of a cell, along one axis after the other."""
    for axis in range(3):
        nodes = lax.optimization_barrier(
            jnp.stack(
                [sum(w[k] * lax.index_in_dim(nodes, k, axis, keepdims=False) for k in range(4)) for w in weights.T],
                axis,
            )
        )
    return nodes


_evaluate = jit(_choose, on_one_thread=True)


def _decide(way: Any, tables: Any, x: list[Any], error: Any) -> tuple[list[Any], Any, Any]:
    """Displacements, opacity and doubt at voxels x, from tables (3 tables, ...) there."""

    def displacement(table: int | None) -> list[Any]:
        return [jnp.zeros(x[0].shape, tables.dtype)] * 3 if table is None else list(tables[3 * table : 3 * table + 3])

    if isinstance(way, _Shown):
        return displacement(way.table), jnp.ones(x[0].shape, tables.dtype), jnp.zeros(x[0].shape, bool)

    cuts = way.cuts
    here, there = cuts.distances(
        [[p + d for p, d in zip(x, displacement(table), strict=True)] for table in (way.before, *way.after)]
    )
    choice, opacity = cuts.decide(here, there)
    doubt = is_doubtful(here, there, cuts.sides, cuts.softness, error, jnp)
    *known, (d, seen, unclear) = [_decide(then, tables, x, error) for then in way.then]
    for k, (own, share, is_unclear) in enumerate(known):
        d = [jnp.where(choice == k, a, b) for a, b in zip(own, d, strict=True)]
        seen, unclear = jnp.where(choice == k, share, seen), jnp.where(choice == k, is_unclear, unclear)
    return d, opacity * seen, doubt | unclear
