"""The grid of a result: the document's own, the volume's with a margin, or the one that fits; at any resolution."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.document.deformation import Deformation
from deformnb.document.output_grid import output_grid
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume

VOLUME = Volume(np.full((6, 7, 8), 200, np.uint8), Grid((6, 7, 8), (1.0, 2.0, 1.5), (3.0, 4.0, 5.0)))
BOX = VOLUME.grid.crop((0, 0, -2), (6, 7, 12))


def shift(length: float) -> Deformation:
    points = ControlPoints.from_arrays([[0, 0]], [[length, 0]])
    return Deformation.from_picture_points(VOLUME, "+y", points, trend="translation")


def lies_on(grid: Grid, other: Grid) -> bool:
    """Check that the voxels of one are voxels of the other's lattice."""
    at = other.point_to_index(grid.origin)
    return bool(np.allclose(at, np.round(at), atol=1e-9)) and grid.spacing == other.spacing


@pytest.mark.parametrize("output", [None, BOX])
def test_nothing_asked_for_is_the_documents_own(output: Grid | None) -> None:
    assert output_grid(Deformation(output=output), VOLUME).grid == (output or VOLUME.grid)
    finer = output_grid(Deformation(output=output), VOLUME, spacing=0.5).grid
    np.testing.assert_allclose(finer.lengths, (output or VOLUME.grid).lengths)
    assert finer.spacing == (0.5, 0.5, 0.5)


@pytest.mark.parametrize("margin", [0, 3, (0, 4, -1.5), 0.1])
def test_a_margin_is_added_to_the_volumes_box_in_whole_voxels(margin: Any) -> None:
    grid = output_grid(Deformation(output=BOX), VOLUME, margin=margin).grid
    assert lies_on(grid, VOLUME.grid)
    more = (np.asarray(grid.lengths) - VOLUME.grid.lengths) / 2 - np.broadcast_to(margin, 3)
    assert ((more >= -1e-9) & (more < np.asarray(VOLUME.grid.spacing))).all()
    np.testing.assert_allclose(grid.center, VOLUME.grid.center)


def test_with_another_resolution_a_margin_is_exact() -> None:
    grid = output_grid(Deformation(), VOLUME, spacing=0.5, margin=1).grid
    np.testing.assert_allclose(grid.lengths, np.add(VOLUME.grid.lengths, 2))


def test_the_box_that_fits_holds_what_is_dragged_and_no_more() -> None:
    found = output_grid(shift(5.0), VOLUME, margin="fit")
    assert lies_on(found.grid, VOLUME.grid)
    x = found.grid.corners()[:, 0]
    assert x.min() == VOLUME.grid.corners()[:, 0].min()
    assert 5 <= x.max() - VOLUME.grid.corners()[:, 0].max() <= 8
    assert not found.is_limited
    assert output_grid(shift(500.0), VOLUME, margin="fit", spacing=1).is_limited


@pytest.mark.parametrize(
    "wrong",
    [
        {"margin": "wide"},
        {"margin": -50},
        {"margin": (1, 2)},
        {"margin": np.inf},
        {"spacing": 0},
        {"spacing": (1, 2)},
        {"spacing": 1, "margin": -50},
    ],
)
def test_what_is_no_box_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(DeformError, match=r"margin|spacing"):
        output_grid(Deformation(), VOLUME, **wrong)
