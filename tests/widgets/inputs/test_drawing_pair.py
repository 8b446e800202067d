"""Two drawings that become a pair, without a browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.io import write_volume
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.volume import Volume
from deformnb.warping.points import warp_points
from deformnb.widgets import DrawingPair, GridDrawing


def a_leaf(width: int) -> Volume:
    values = np.zeros((1, 40, 80), np.uint8)
    values[0, 10:30, 10 : 10 + width] = 200
    return Volume.from_array(values)


def test_a_drawing_that_is_opened_makes_the_pair_and_its_map_leads_from_grid_to_grid(tmp_path: Path) -> None:
    pair = DrawingPair(project(a_leaf(30), "+z"), rows=3, columns=4)
    with pytest.raises(DeformError, match="no second drawing"):
        pair.map()
    write_volume(a_leaf(60), tmp_path / "older.png")
    pair.take(tmp_path / "older.png", lambda share: None)
    assert pair.second is not None
    assert pair.second.nodes.shape == (3, 4, 2)
    laid = pair.map("length")
    np.testing.assert_allclose(laid.source_nodes, pair.first.nodes, atol=1e-9)
    np.testing.assert_allclose(np.ptp(laid.target_nodes[..., 0]), np.ptp(pair.first.nodes[..., 0]), rtol=1e-6)
    assert np.ptp(laid.target_nodes[..., 1]) == pytest.approx(np.ptp(pair.first.nodes[..., 1]) / 2, rel=0.05)
    moved, _ = warp_points(laid.source_nodes, fit_rbf(laid.points))
    np.testing.assert_allclose(moved, laid.target_nodes, atol=1e-3)
    pair.close()


def test_both_grids_get_new_lines_together() -> None:
    picture = project(a_leaf(30), "+z")
    pair = DrawingPair(picture, picture)
    assert pair.second is not None
    rows, columns = pair.line_counts
    rows.value, columns.value = 4, 9
    assert pair.first.nodes.shape == pair.second.nodes.shape == (4, 9, 2)
    pair.close()


def test_drawings_whose_grids_were_placed_before_become_a_pair() -> None:
    first, second = (GridDrawing(project(a_leaf(width), "+z"), rows=3, columns=4) for width in (30, 60))
    second.nodes = second.nodes + np.array([1.0, 2.0])
    placed = second.nodes.copy()
    pair = DrawingPair(first, second)
    assert (pair.first, pair.second) == (first, second)
    assert [number.value for number in pair.line_counts] == [3, 4]
    np.testing.assert_array_equal(second.nodes, placed)
    assert len(pair.map().points) == 12
    pair.close()


def test_a_picture_beside_a_drawing_gets_as_many_lines() -> None:
    picture = project(a_leaf(30), "+z")
    for first, second in ((GridDrawing(picture, 3, 4), picture), (picture, GridDrawing(picture, 3, 4))):
        pair = DrawingPair(first, second)
        assert pair.second is not None
        assert pair.first.nodes.shape == pair.second.nodes.shape == (3, 4, 2)
        pair.close()


def test_drawings_with_other_lines_or_of_another_kind_are_refused() -> None:
    picture = project(a_leaf(30), "+z")
    with pytest.raises(DeformError, match=r"one has 5 rows of 6 nodes, not 3 of 4: call set_lines"):
        DrawingPair(GridDrawing(picture, 3, 4), GridDrawing(picture, 5, 6))
    with pytest.raises(DeformError, match=r"one has 3 rows of 4 nodes, not 4 of 4"):
        DrawingPair(GridDrawing(picture, 3, 4), rows=4)
    with pytest.raises(DeformError, match=r"second drawing is a Picture or a GridDrawing, got 'carp\.png'"):
        DrawingPair(picture, "carp.png")  # type: ignore[arg-type]


def test_a_file_that_is_no_picture_is_said_below(tmp_path: Path) -> None:
    pair = DrawingPair(project(a_leaf(30), "+z"))
    (tmp_path / "no.png").write_bytes(b"no")
    with pytest.raises(DeformError):
        pair.take(tmp_path / "no.png", lambda share: None)
    pair.close()
