"""Score of a deformation against Thompson's nodes: its ends, its unit, where it is worst, and its errors."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.datasets import thompson_map, thompson_score
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.rbf.fields import Identity
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid

GRID = Grid((10, 60, 90), (4.0, 4.0, 4.0))
LAID = thompson_map(box=(20.0, 340.0, 30.0, 200.0))


def test_the_way_is_none_at_the_start_and_whole_at_his_nodes() -> None:
    none, half, whole = (thompson_score((1 - t) * LAID.source_nodes + t * LAID.target_nodes, LAID) for t in (0, 0.5, 1))
    assert none.percent == pytest.approx(0, abs=1e-9)
    assert thompson_score(Identity(2), LAID).percent == pytest.approx(0, abs=1e-6)
    assert half.percent == pytest.approx(50)
    assert (whole.percent, whole.mean) == (pytest.approx(100), pytest.approx(0, abs=1e-9))
    away = thompson_score(2 * LAID.source_nodes - LAID.target_nodes, LAID)
    assert away.percent == pytest.approx(-100)


def test_distances_are_pixels_of_the_drawing_of_the_first_animal() -> None:
    drawn = LAID.source.nodes.reshape(-1, 2)
    wide, high = np.ptp(drawn, axis=0)
    moved = LAID.target_nodes.copy()
    moved[2, 5] += (3 * 320 / wide, 4 * 170 / high)  # 3 pixels to the right and 4 down, on a picture of another shape
    score = thompson_score(moved, LAID)
    assert score.worst == (2, 5)
    assert score.distances[2, 5] == pytest.approx(5)
    assert score.mean == pytest.approx(5 / 56)
    np.testing.assert_allclose(score.missing[2, 5], LAID.target_nodes[2, 5] - moved[2, 5])
    assert "5.0 at worst, at node r2 c5" in str(score)


def test_a_field_a_step_and_a_deformation_are_one_score() -> None:
    deformation = Deformation.from_picture_points(GRID, "-x", LAID.points)
    wanted = thompson_score(fit_rbf(LAID.points), LAID)
    assert wanted.percent == pytest.approx(100, abs=1e-3)
    for what in (deformation, deformation.steps[0]):
        np.testing.assert_allclose(thompson_score(what, LAID, grid=GRID).reached, wanted.reached, atol=1e-3)
    kept = np.where(np.arange(56)[:, None] % 2, LAID.points.source, LAID.points.target)  # every other node stays
    some = ControlPoints.from_arrays(LAID.points.source, kept)
    assert 5 < thompson_score(Deformation.from_picture_points(GRID, "-x", some), LAID, grid=GRID).percent < 90
    assert thompson_score(Deformation(()), LAID).percent == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (None, "can be scored"),
        ([], "can be scored"),
        ("fish", "can be scored"),
        (LAID.source_nodes[:3], "can be scored"),
        (np.full((7, 8, 2), np.nan), "can be scored"),
        (Identity(3), "dimension 2"),
    ],
)
def test_what_is_no_deformation_of_a_picture_is_refused(what: object, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        thompson_score(what, LAID)  # type: ignore[arg-type]


def test_steps_of_two_sides_and_a_pair_that_moves_nothing_are_refused() -> None:
    points = ControlPoints.from_arrays([[50, 50]], [[60, 60]])
    steps = [Deformation.from_picture_points(GRID, view, points).steps[0] for view in ("-x", "+y")]
    with pytest.raises(DeformError, match="another side"):
        thompson_score(Deformation(tuple(steps)), LAID)
    with pytest.raises(DeformError, match="moves no node"):
        thompson_score(LAID.source_nodes, thompson_map("Diodon", "Diodon"))
