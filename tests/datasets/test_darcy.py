"""Thompson's grids: the numbers of the file, and the rules by which a pair is placed on a picture."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb.datasets import custom_grid, thompson_grid, thompson_grids, thompson_map, thompson_pairs
from deformnb.datasets.darcy import CELLS, SCALES
from deformnb.errors import DeformError
from deformnb.io import write_landmarks
from deformnb.warping.points import Landmarks

BOX = (10.0, 522.0, 22.0, 176.0)
PAIRS = thompson_pairs()


def cells(nodes):
    """Signed area of each cell (b downwards, rows downwards: positive means not turned over)."""
    p, q, r, s = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
    d1, d2 = r - p, s - q
    return (d1[..., 0] * d2[..., 1] - d1[..., 1] * d2[..., 0]) / 2


def test_the_nodes_are_those_that_were_read(real_data):
    read = json.loads((real_data("darcy") / "grid_nodes.json").read_text(encoding="utf-8"))
    assert len(read["figures"]) == len(thompson_grids()) == 8
    for key, figure in read["figures"].items():
        np.testing.assert_array_equal(thompson_grids()[int(key[:3])].nodes, figure["nodes"])
    assert [[a.split("_", 1)[1].replace("_", " ") for a in pair] for pair in read["pairs"]] == [list(p) for p in PAIRS]


@pytest.mark.parametrize("figure", sorted(thompson_grids()))
def test_no_cell_of_a_net_is_turned_over(figure):
    grid = thompson_grids()[figure]
    assert cells(grid.nodes).min() > 0
    assert grid.modern
    assert len(grid.polylines()) == sum(grid.nodes.shape[:2])
    assert not grid.nodes.flags.writeable


def test_doubtful_nodes_are_said_to_be():
    assert "5 px" in thompson_grid("Antigonia").quality
    assert thompson_grid(377).quality == ""


@pytest.mark.parametrize("name", ["", "Poly pron", "P", 12])
def test_unknown_or_ambiguous_names_list_the_known(name):
    with pytest.raises(DeformError, match="Antigonia capros"):
        thompson_grid(name)


@pytest.mark.parametrize("head", ["left", "right"])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("scale", sorted(SCALES))
def test_a_species_mapped_to_itself_moves_nothing(scale, cell, head):
    laid = thompson_map(
        "Polyprion", "Polyprion", box=BOX, scale=scale, cells=cell, head=head, frame=(-500.0, 1000.0, -500.0, 700.0)
    )
    np.testing.assert_allclose(laid.points.displacement, 0, atol=1e-9)


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_source_net_fills_the_box_and_target_stays_in_the_frame(source, target):
    frame = (0.0, 560.0, 0.0, 200.0)
    laid = thompson_map(source, target, box=BOX, frame=frame)
    low, high = laid.source_nodes.reshape(-1, 2).min(axis=0), laid.source_nodes.reshape(-1, 2).max(axis=0)
    np.testing.assert_allclose([low[0], high[0], low[1], high[1]], BOX, atol=1e-9)
    t = laid.target_nodes.reshape(-1, 2)
    assert (t >= np.array([frame[0], frame[2]]) - 1e-9).all()
    assert (t <= np.array([frame[1], frame[3]]) + 1e-9).all()
    assert cells(laid.target_nodes).min() > 0


@pytest.mark.parametrize(("source", "target"), PAIRS)
def test_area_and_length_are_kept(source, target):
    by_area = thompson_map(source, target, box=BOX, scale="area")
    assert cells(by_area.target_nodes).sum() == pytest.approx(cells(by_area.source_nodes).sum(), rel=1e-9)
    np.testing.assert_allclose(
        by_area.target_nodes.mean(axis=(0, 1)), by_area.source_nodes.mean(axis=(0, 1)), atol=1e-9
    )
    # Lengths are compared before the stretch, so the grid has the proportions of the drawing here.
    by_length = thompson_map(source, target, box=BOX, scale="length", cells="square")
    lengths = [
        np.linalg.norm(n[:, -1] - n[:, 0], axis=-1).mean() for n in (by_length.source_nodes, by_length.target_nodes)
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)


def test_square_cells_keep_the_drawing_and_the_length_of_the_box():
    nodes = thompson_map(box=BOX, cells="square").source_nodes
    drawn = thompson_grid("Polyprion").nodes
    factor = (nodes[-1, -1] - nodes[0, 0]) / (drawn[-1, -1] - drawn[0, 0])
    assert factor[0] == pytest.approx(factor[1], rel=1e-9)
    assert np.ptp(nodes[..., 0]) == pytest.approx(512.0)
    assert (nodes[..., 1].min() + nodes[..., 1].max()) / 2 == pytest.approx((22 + 176) / 2)


@given(st.sampled_from(PAIRS), st.floats(-50, 50), st.floats(0, 80))
def test_a_head_on_the_right_is_the_mirror_image(pair, shift, room):
    frame = (BOX[0] - room, BOX[1] + room, BOX[2] - room, BOX[3] + room)
    left = thompson_map(*pair, box=BOX, frame=frame)
    right = thompson_map(*pair, box=BOX, frame=frame, head="right")
    for a, b in ((left.source_nodes, right.source_nodes), (left.target_nodes, right.target_nodes)):
        np.testing.assert_allclose(b[..., 0], BOX[0] + BOX[1] - a[..., 0], atol=1e-9)
        np.testing.assert_allclose(b[..., 1], a[..., 1], atol=1e-9)
    moved = thompson_map(
        *pair, box=(BOX[0] + shift, BOX[1] + shift, *BOX[2:]), frame=(frame[0] + shift, frame[1] + shift, *frame[2:])
    )
    np.testing.assert_allclose(moved.target_nodes[..., 0], left.target_nodes[..., 0] + shift, atol=1e-9)


def test_points_are_the_nodes_row_by_row():
    laid = thompson_map(box=BOX)
    points = laid.points
    k = points.names.index("r2 c5")
    np.testing.assert_array_equal(points.source[k], laid.source_nodes[2, 5])
    np.testing.assert_array_equal(points.target[k], laid.target_nodes[2, 5])
    source_lines, target_lines = laid.polylines()
    np.testing.assert_array_equal(source_lines[7 + 5], laid.source_nodes[:, 5])
    assert len(source_lines) == len(target_lines) == 15


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"box": (0, 0, 0, 1)}, "a_min < a_max"),
        ({"box": (0, 1, 0)}, "a_min"),
        ({"box": (0, 1, 0, float("nan"))}, "a_min"),
        ({"frame": (3, 2, 0, 1)}, "a_min"),
        ({"scale": "big"}, "inside, area, length"),
        ({"cells": "x"}, "fill, square"),
        ({"head": "up"}, "left, right"),
        ({"target": "Diodon"}, "do not correspond"),
    ],
)
def test_bad_arguments_say_what_is_possible(arguments, words):
    with pytest.raises(DeformError, match=words):
        thompson_map(**{"box": BOX, **arguments})


def test_grids_of_arrays_are_laid_as_those_of_the_book():
    wanted = thompson_map("Polyprion", "Antigonia", box=BOX)
    a, b = (thompson_grid(name).nodes for name in ("Polyprion", "Antigonia"))
    for pair in ((a, b), (a.tolist(), b.tolist()), ("Polyprion", b), (custom_grid(a, "mine"), 380)):
        laid = thompson_map(*pair, box=BOX)
        np.testing.assert_array_equal(laid.source_nodes, wanted.source_nodes)
        np.testing.assert_array_equal(laid.target_nodes, wanted.target_nodes)
    assert thompson_map(custom_grid(a, "mine"), b).source.species == "mine"


SQUARE = np.array([[[0.0, 0.0], [9.0, 0.0]], [[0.0, 9.0], [9.0, 9.0]]])


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        (None, "shape \\(rows, columns, 2\\)"),
        ([], "shape"),
        (SQUARE[0], "at least 2 rows"),
        (SQUARE[:1], "at least 2 rows"),
        (SQUARE[..., :1], "shape \\(2, 2, 1\\)"),
        ([["a", "b"]], "must be an array"),
        (np.where(SQUARE == 9, np.nan, SQUARE), "r0 c1 .* is no place"),
        (SQUARE[::-1], "turned over"),
        (SQUARE[:, ::-1], "turned over"),
        (SQUARE * (1, 0), "flat"),
        (SQUARE.transpose(1, 0, 2), "turned over"),
    ],
)
def test_what_is_no_grid_is_refused_in_plain_words(nodes, words):
    with pytest.raises(DeformError, match=words):
        thompson_map(nodes, SQUARE)
    with pytest.raises(DeformError, match=words):
        thompson_map(SQUARE, nodes)


def test_two_grids_of_different_size_do_not_correspond():
    with pytest.raises(DeformError, match="do not correspond"):
        thompson_map(SQUARE, "Antigonia")


# ---- landmarks and their files ---------------------------------------------------------------------------------------


def as_landmarks(nodes, *, order=None, depth=False):
    rows, columns = nodes.shape[:2]
    places, names = nodes.reshape(-1, 2), [f"r{i} c{j}" for i in range(rows) for j in range(columns)]
    if depth:
        places = np.column_stack([places, np.full(len(places), 7.0)])
    order = np.arange(len(places)) if order is None else order
    return Landmarks(places[order], tuple(names[k] for k in order))


def test_landmarks_and_files_are_laid_as_arrays_whatever_their_order(tmp_path):
    nodes = thompson_grid("Antigonia").nodes
    shuffled = np.random.default_rng(3).permutation(nodes.size // 2)
    file = tmp_path / "antigonia.csv"
    write_landmarks(as_landmarks(nodes, order=shuffled), file)
    wanted = thompson_map("Polyprion", "Antigonia", box=BOX)
    for target in (as_landmarks(nodes, order=shuffled), as_landmarks(nodes, depth=True), file, str(file)):
        np.testing.assert_allclose(
            thompson_map("Polyprion", target, box=BOX).target_nodes, wanted.target_nodes, rtol=0, atol=1e-4
        )  # the table has six digits
    assert thompson_map("Polyprion", file, box=BOX).target.species == "antigonia"
    row_by_row = custom_grid(Landmarks(nodes.reshape(-1, 2)), "mine", rows=7)
    np.testing.assert_array_equal(row_by_row.nodes, nodes)


@pytest.mark.parametrize(
    ("marks", "rows", "words"),
    [
        (Landmarks(SQUARE.reshape(-1, 2)), None, "state their number of rows"),
        (Landmarks(SQUARE.reshape(-1, 2)), 3, "state their number of rows"),
        (Landmarks(SQUARE.reshape(-1, 2)[:3], ("r0 c0", "r0 c1", "r1 c0")), None, "r1 c1 is missing"),
        (Landmarks(SQUARE.reshape(-1, 2), ("r0 c0", "r0 c1", "r1 c0", "r1 c0")), None, "r1 c1 is missing"),
        (
            Landmarks([[0, 0, 1], [9, 0, 2], [0, 9, 1], [9, 9, 1]], ("r0 c0", "r0 c1", "r1 c0", "r1 c1")),
            None,
            "in space",
        ),
    ],
)
def test_landmarks_that_fill_no_grid_are_refused(marks, rows, words):
    with pytest.raises(DeformError, match=words):
        custom_grid(marks, "mine", rows)
