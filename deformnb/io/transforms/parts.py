"""The parts of a deformation as transform files hold them: matrices, and displacements sampled on grids."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity
from deformnb.volume.volume import Grid

TransformPart = Identity | Affine | DisplacementField | BSplineField


def sample_parts(
    field: AbstractField, grid: Grid, progress: Progress | None = None, *, exact: tuple[type, ...] = ()
) -> list[TransformPart]:
    """The parts of a field in the order in which a place of the result is looked up in them.

    Each part that is not affine is sampled on the grid, which is enlarged by as much as the parts looked up before it
    reach beyond the grid.

    Parameters
    ----------
    exact : kinds of fields that the file stores exactly, besides affine maps.
    """
    found = list[TransformPart]()
    reach = np.zeros(3)  # along the axes of the grid
    steps = field.steps
    for k, part in enumerate(reversed(steps)):  # the last step is looked up first
        if isinstance(part, Identity):
            found.append(part)
        elif isinstance(part, Affine):
            found.append(part)
            reach = reach + np.abs(part.displacement(grid.corners()) @ np.asarray(grid.direction)).max(axis=0)
        elif isinstance(part, exact) and isinstance(part, BSplineField):
            found.append(part)
            longest = np.abs(np.asarray(part.coefficients).reshape(-1, 3)).max(axis=0)  # no displacement is longer
            reach = reach + longest @ np.abs(np.asarray(grid.direction))
        else:
            lattice = _pad(grid, reach)
            values = part.sample_on_grid(lattice).astype(np.float64)
            found.append(DisplacementField(values, lattice))
            reach = reach + np.abs(values.reshape(-1, 3) @ np.asarray(grid.direction)).max(axis=0)
        if progress is not None:
            progress((k + 1) / (len(steps) + 1))
    return found


def _pad(grid: Grid, reach: NDArray[np.float64]) -> Grid:
    """The grid with as many voxels more on every side as a length along each of its axes needs."""
    more = np.ceil(reach / np.asarray(grid.spacing)).astype(int)
    shape = tuple(int(n + 2 * m) for n, m in zip(grid.shape, more[::-1], strict=True))
    x, y, z = grid.index_to_point(-more).tolist()
    return replace(grid, shape=shape, origin=(x, y, z))  # type: ignore[arg-type]
