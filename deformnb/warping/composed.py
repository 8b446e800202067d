"""Composition of several deformations, evaluated at all voxels of a block.

``D = D_last(x) + D_before(x + D_last(x)) + ...``: where the composition is smooth it is interpolated between nodes
(:mod:`deformnb.warping.node_table`). Elsewhere only the last one is evaluated on a lattice, the others at the places to
which the ones after them lead (:mod:`deformnb.warping.exact_places`). A GPU evaluates all of them at every voxel.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.rbf.fields import AbstractField, Identity, grid_lines, links_of
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.exact_places import ExactPlaces
from deformnb.warping.node_table import Displacements, NodeTable, Replacement
from deformnb.warping.node_walk import smoothness_of


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
        self._is_known = is_long and smoothness_of(field) is not None
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
        if self._is_known and not self._at_voxels.is_on_gpu:
            self._nodes = NodeTable(self._field, self._grid, progress)

    def block(self, block: tuple[slice, slice]) -> Displacements:
        """Displacements in a block of planes and rows, one of :func:`~deformnb.warping.planning.square_blocks`."""
        found = None if self._nodes is None else self._nodes.block(block)
        if found is not None:
            return found
        lattice = planning.lattice(self._grid, block, 1)
        if not self._at_voxels.is_on_gpu:
            return self._at_all(lattice)
        d, opacity = self._at_voxels.on_gpu(lattice)
        return Displacements(d, opacity=opacity)

    def left(self) -> list[Callable[[], Replacement]]:
        """Replacements due in the blocks so far, see :meth:`NodeTable.left`."""
        return [] if self._nodes is None else self._nodes.left()

    @cached_property
    def _at_voxels(self) -> ExactPlaces:
        return ExactPlaces(self._links, self._grid)

    @cached_property
    def _at_places(self) -> ExactPlaces:
        return ExactPlaces(self._rest, self._grid)

    def _at_all(self, lattice: Grid) -> Displacements:
        rows, columns = grid_lines(lattice)
        places = (rows[:, :, None] + columns[:, None, :]).reshape(3, -1)
        d = np.zeros_like(places)
        if self._first is not None:
            first = planning.seen(self._first, lattice)[0]
            d += np.stack([np.asarray(part).ravel() for part in _as_parts(first)])
        more, opacity = self._at_places(places + d)
        shape = lattice.shape
        return Displacements(
            tuple(part.reshape(shape) for part in (d + more).astype(np.float32)),
            opacity=opacity.reshape(shape) if self.has_cuts else None,
        )


def _as_parts(d: Any) -> list[Any]:
    return list(d) if isinstance(d, tuple) else list(np.moveaxis(np.asarray(d), -1, 0))
