"""The grid on a drawing without a browser: its start, messages of a front end, and their effect."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from front_end import deliver

from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.volume.plane import Picture
from deformnb.volume.volume import Volume
from deformnb.widgets import GridDrawing


def a_leaf(*, on_paper: bool = False) -> Picture:
    values = np.full((1, 40, 60), 255 if on_paper else 0, np.uint8)
    values[0, 10:30, 15:50] = 20 if on_paper else 200
    return project(Volume.from_array(values), "+z")


def receive(drawing: GridDrawing, nodes: Any, placed: Any, *, phase: str = "end") -> None:
    value = {"nodes": nodes, "placed": placed}
    deliver(drawing, json.loads(json.dumps({"type": "edit", "seq": 1, "view": "v", "phase": phase, "value": value})))


@pytest.mark.parametrize("on_paper", [False, True], ids=["bright on dark", "ink on paper"])
def test_it_begins_around_what_is_drawn(on_paper: bool) -> None:
    nodes = GridDrawing(a_leaf(on_paper=on_paper), 3, 4).nodes
    assert nodes.shape == (3, 4, 2)
    np.testing.assert_allclose([*nodes[0, 0], *nodes[-1, -1]], [15, 10, 49, 29], atol=1.5)


def test_on_a_blank_sheet_it_begins_in_the_middle() -> None:
    nodes = GridDrawing(project(Volume.from_array(np.zeros((1, 40, 60), np.uint8)), "+z"), 3, 4).nodes
    np.testing.assert_allclose(nodes.mean(axis=(0, 1)), [29.5, 19.5])


def test_a_drag_of_the_page_is_the_new_grid_and_is_heard() -> None:
    drawing, heard = GridDrawing(a_leaf(), 2, 3), []
    drawing.on_edit(lambda value, phase: heard.append((phase, value.shape)))
    moved = drawing.nodes.copy()
    moved[1, 2] += (3.0, 1.0)
    before = drawing.nodes
    receive(drawing, moved.tolist(), [5], phase="move")
    assert drawing.nodes is before, "a drag under way changes nothing"
    receive(drawing, moved.tolist(), [5])
    np.testing.assert_array_equal(drawing.nodes, moved)
    assert drawing.shown["placed"] == [5]
    assert heard == [("move", (2, 3, 2)), ("end", (2, 3, 2))]


@pytest.mark.parametrize(
    ("nodes", "placed"),
    [
        ([[[0, 0]] * 3], []),
        ([[[0, 0]] * 2] * 2, []),
        ([[[0, "x"]] * 3] * 2, []),
        ([[[0, 1e400]] * 3] * 2, []),
        (7, []),
        (None, None),
        ([[[0, 0]] * 3] * 2, [6]),
        ([[[0, 0]] * 3] * 2, [1, 1]),
        ([[[0, 0]] * 3] * 2, [True]),
    ],
)
def test_a_page_that_says_nonsense_changes_nothing(nodes: Any, placed: Any) -> None:
    drawing = GridDrawing(a_leaf(), 2, 3)
    before = drawing.nodes
    receive(drawing, nodes, placed)
    assert drawing.nodes is before


def test_more_lines_lie_on_the_bent_grid_that_is_there() -> None:
    bent = np.stack(np.meshgrid([0.0, 4, 20], [0.0, 10]), axis=-1)
    bent[:, 1, 1] += 3
    drawing = GridDrawing(a_leaf(), nodes=bent)
    drawing.set_lines(3, 5)
    np.testing.assert_allclose(drawing.nodes[::2, ::2], bent)
    np.testing.assert_allclose(drawing.nodes[1, 1], [2, 6.5])  # the middle of the cell's four corners


@pytest.mark.parametrize("lines", [{"rows": 1}, {"rows": 17}, {"columns": 2.5}, {"nodes": [[[0, 0], [1, 1]]]}])
def test_what_is_no_grid_is_refused(lines: dict[str, Any]) -> None:
    with pytest.raises(DeformError, match=r"2 to 16|rows"):
        GridDrawing(a_leaf(), **lines)


def test_a_grid_that_is_turned_over_is_refused_when_it_is_used() -> None:
    drawing = GridDrawing(a_leaf(), 2, 2)
    receive(drawing, drawing.nodes[::-1].tolist(), [0, 1, 2, 3])
    with pytest.raises(DeformError, match="turned over"):
        drawing.grid("leaf")
