"""Draw rate of an editor's picture in a drag, as its front end reports with the edit that ends the drag."""

from __future__ import annotations

from typing import Any

import pytest
from front_end import deliver

from deformnb.rbf.points import ControlPoints
from deformnb.widgets.editor.editor import Editor

POINTS = ControlPoints.from_arrays([[0.0, 0.0], [40.0, 0.0]], [[0.0, 0.0], [50.0, 0.0]])


def send_edit(editor: Editor, drawn: Any, seq: int) -> None:
    points = [{"id": k, "source": [0.0, 0.0], "target": [float(seq), float(k)]} for k in range(2)]
    content = {"type": "edit", "phase": "end", "kind": "move", "sender": "s", "seq": seq, "points": points}
    deliver(editor, content | ({"drawn": drawn} if drawn is not None else {}))


def test_an_editor_says_what_its_page_measured_last() -> None:
    editor = Editor(None, POINTS)
    assert editor.stats() == {"drag_hz": 0.0, "picture_ms": 0.0}
    send_edit(editor, {"hz": 41.5, "ms": 9}, 1)
    assert editor.stats() == {"drag_hz": 41.5, "picture_ms": 9.0}
    send_edit(editor, None, 2)  # an arrow key measures nothing
    assert editor.stats() == {"drag_hz": 41.5, "picture_ms": 9.0}


@pytest.mark.parametrize("drawn", [7, "fast", [], {"hz": "9"}, {"hz": True}, {"hz": -1, "ms": 1e300}, {"hz": None}])
def test_what_is_measured_oddly_costs_no_edit(drawn: Any) -> None:
    editor = Editor(None, POINTS)
    send_edit(editor, drawn, 1)
    assert editor.points.target.tolist() == [[1.0, 0.0], [1.0, 1.0]]
    assert editor.stats() == {"drag_hz": 0.0, "picture_ms": 0.0}
