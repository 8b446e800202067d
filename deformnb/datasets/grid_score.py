"""Score of a deformation against one of Thompson's pairs: distance of the bent grid to the grid that he drew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from deformnb._typing import Floats
from deformnb.checks import finite_array, short_value
from deformnb.datasets.darcy import ThompsonMap
from deformnb.errors import DeformError

if TYPE_CHECKING:  # the grids themselves are read without JAX
    from deformnb.document.deformation import Deformation, Step
    from deformnb.rbf.fields import AbstractField
    from deformnb.volume.volume import Grid, VolumeLike


@dataclass(frozen=True, eq=False)
class GridScore:
    """Score of a bent grid: its nearness to Thompson's.

    Parameters
    ----------
    reached : (rows, columns, 2), where the nodes of the source grid are after the deformation, picture coordinates.
    missing : (rows, columns, 2), the displacements from there to the nodes that Thompson drew.
    distances : (rows, columns), the length of that displacement in pixels of the drawing of the first animal.
    before : (rows, columns), the same without any deformation.

    Examples
    --------
    >>> before = np.full((2, 2), 8.0)
    >>> GridScore(np.zeros((2, 2, 2)), np.zeros((2, 2, 2)), before / 4, before).percent
    75.0
    """

    reached: Floats
    missing: Floats
    distances: Floats
    before: Floats

    @property
    def mean(self) -> float:
        """Mean distance of a node from Thompson's, pixels of his drawing; he is read to about 2."""
        return float(self.distances.mean())

    @property
    def percent(self) -> float:
        """Progress in percent: 100 at Thompson's nodes, 0 without a deformation, negative for one that leads away."""
        return float(100 * (1 - self.distances.mean() / self.before.mean()))

    @property
    def worst(self) -> tuple[int, int]:
        """Row and column of the node that is farthest from Thompson's."""
        row, column = np.unravel_index(int(self.distances.argmax()), self.distances.shape)
        return int(row), int(column)

    def __str__(self) -> str:
        row, column = self.worst
        return (
            f"{self.percent:.0f} % of the change; {self.mean:.1f} pixels from Thompson's nodes on average, "
            f"{self.distances[row, column]:.1f} at worst, at node r{row} c{column}"
        )


def thompson_score(
    what: Deformation | Step | AbstractField | ArrayLike, grids: ThompsonMap, *, grid: Grid | VolumeLike | None = None
) -> GridScore:
    """Compare a deformation with one of Thompson's pairs, node by node.

    Parameters
    ----------
    what : a deformation whose steps are on one plane, one such step, a field of dimension 2, or (rows, columns, 2)
        places that the nodes of the source grid were moved to, in picture coordinates.
    grids : the pair, placed on the same picture with :func:`thompson_map`.
    grid : of the volume, from which the support radius of a step with a single dragged point is derived; default is the
        box of the source grid.

    Returns
    -------
    GridScore
        With ``percent``, ``mean``, ``worst`` and the distance of every node. A node that has no place in the result,
        because the map folds or is cut there, counts as if it had not been moved.

    Raises
    ------
    DeformError
        If the steps are not on one plane, the array has another shape, or the pair moves nothing.

    Examples
    --------
    >>> from deformnb.datasets import thompson_map
    >>> grids = thompson_map("Polyprion", "Antigonia", box=(0.0, 300.0, 0.0, 200.0))
    >>> round(thompson_score(grids.source_nodes, grids).percent)
    0
    >>> halfway = (grids.source_nodes + grids.target_nodes) / 2
    >>> round(thompson_score(halfway, grids).percent)
    50
    """
    from deformnb.rbf.fields import AbstractField
    from deformnb.warping.points import warp_points

    if not hasattr(grids, "source_nodes"):
        raise DeformError(f"a pair of Thompson's grids is needed, got {short_value(grids)}; thompson_map makes one.")
    source, target = grids.source_nodes, grids.target_nodes
    pixel = np.ptp(source.reshape(-1, 2), axis=0) / np.ptp(grids.source.nodes.reshape(-1, 2), axis=0)
    before = np.linalg.norm((target - source) / pixel, axis=-1)
    if before.mean() < 1e-9 * np.ptp(grids.source.nodes):
        raise DeformError(
            f"{grids.source.species} to {grids.target.species} moves no node, so there is nothing to be "
            "scored; choose two different animals."
        )
    if isinstance(what, AbstractField) or hasattr(what, "plane") or hasattr(what, "steps"):
        moved, found = warp_points(source, _field(what, grids, grid))
        reached = np.where(found[..., None], moved, source)
    else:
        reached = finite_array(
            what,
            source.shape,
            f"a Deformation, a Step, a field on a picture or the places of "
            f"{source.shape[0]} x {source.shape[1]} nodes, an array of shape {source.shape} of "
            "finite numbers, can be scored",
        )
    missing = target - reached
    return GridScore(reached, missing, np.linalg.norm(missing / pixel, axis=-1), before)


def _field(what: object, grids: ThompsonMap, grid: Grid | VolumeLike | None) -> AbstractField:
    """The displacement of the picture."""
    from deformnb.document.deformation import MODES, Deformation, Step
    from deformnb.imaging.figures import picture_field
    from deformnb.rbf.fields import AbstractField, Identity
    from deformnb.volume.volume import Grid, as_grid

    if isinstance(what, AbstractField):
        if what.dim != 2:
            raise DeformError("a field on a picture, of dimension 2, can be scored; this one is in space.")
        return what
    if not isinstance(what, Step | Deformation):
        raise DeformError(
            f"a Deformation, a Step, a field or an array of nodes can be scored, got {short_value(what)}."
        )
    steps = (what,) if isinstance(what, Step) else tuple(step for step in what.steps if step.enabled)
    if any(step.plane is None or step.plane != steps[0].plane for step in steps):
        raise DeformError(
            "a step has its points in space or on another side than the first one, and Thompson's grids "
            "are on one picture; switch that step off, or give the steps of one side."
        )
    if grid is None:
        wide, high = np.ptp(grids.source_nodes.reshape(-1, 2), axis=0)
        grid = Grid((1, 100, 100), (wide / 100, high / 100, min(wide, high) / 100))
    fields = [picture_field(step, as_grid(grid)) for step in steps]
    return MODES[what.mode if isinstance(what, Deformation) else "compose"](*fields) if fields else Identity(2)
