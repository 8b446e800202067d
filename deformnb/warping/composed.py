"""Composition of several deformations, evaluated at all voxels of a block.

``D = D_last(x) + D_before(x + D_last(x)) + ...``: only the last one is evaluated on a lattice, the others at the places
to which the ones after them lead. Where the smoothness of all is known the composition is interpolated between nodes
instead (:mod:`deformnb.warping.node_table`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.border_cells import links_of
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
        links = [link for link in links_of(field) if not isinstance(link, Identity)] or [Identity(3)]
        self._first, *self._rest = links
        is_long = field.has_cuts or len(links) > 1 or len(field.steps) > 1
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
        if self._is_known:
            self._nodes = NodeTable(self._field, self._grid, progress)

    def block(self, block: tuple[slice, slice]) -> Displacements:
        """Displacements in a block of planes and rows, one of :func:`~deformnb.warping.planning.square_blocks`."""
        found = None if self._nodes is None else self._nodes.block(block)
        return self._at_all(planning.lattice(self._grid, block, 1)) if found is None else found

    def left(self) -> list[Callable[[], Replacement]]:
        """What is to be replaced in the blocks so far, see :meth:`NodeTable.left`."""
        return [] if self._nodes is None else self._nodes.left()

    def _at_all(self, lattice: Grid) -> Displacements:
        (nz, ny, nx), m = lattice.shape, lattice.matrix
        z, y, x = (m[:, [k]] * np.arange(n) for k, n in ((2, nz), (1, ny), (0, nx)))
        places = (z[:, :, None, None] + y[:, None, :, None] + x[:, None, None, :]).reshape(3, -1)
        places += np.asarray(lattice.origin)[:, None]
        d, opacity = planning.seen(self._first, lattice)
        d = np.stack([np.asarray(part) for part in _as_parts(d)]).reshape(3, -1)
        shown = np.ones(d.shape[1], np.float32) if opacity is None else opacity.ravel()
        for link in self._rest:
            more, share = link.seen((places + d).T)
            d, shown = d + more.T.astype(np.float32), shown * share.astype(np.float32)
        parts = tuple(part.reshape(lattice.shape) for part in d)
        return Displacements(parts, opacity=shown.reshape(lattice.shape) if self._field.has_cuts else None)


def _as_parts(d: Any) -> list[NDArray[np.float32]]:
    return list(d) if isinstance(d, tuple) else list(np.moveaxis(np.asarray(d), -1, 0))
