"""How often an editor's picture was drawn in a drag: measured in the page, told with the edit that ends the drag."""

from __future__ import annotations

from typing import Any

import pytest
from scripts import run_script

from deformnb.rbf.points import ControlPoints
from deformnb.widgets.editor.editor import Editor

POINTS = ControlPoints.from_arrays([[0.0, 0.0], [40.0, 0.0]], [[0.0, 0.0], [50.0, 0.0]])


def measured(events: list[list[Any]]) -> Any:
    main = "(events) => { const r = new DrawRate(); for (const [what, at] of events) r[what](at); return r.taken(); }"
    return run_script(("editor/drawing.js",), main, events)


def test_pictures_of_movements_are_counted_and_those_of_anything_else_are_not() -> None:
    events = [event for k in range(11) for event in (["moved", 20 * k], ["moved", 20 * k + 3], ["drew", 20 * k + 8],
                                                     ["drew", 20 * k + 9])]
    assert measured(events) == {"hz": 50, "ms": 8}


def test_a_rest_of_the_hand_is_no_slow_picture() -> None:
    times = [0, 20, 40, 5000, 5020, 5040]
    assert measured([event for t in times for event in (["moved", t], ["drew", t + 5])]) == {"hz": 50, "ms": 5}


def test_a_short_drag_says_nothing_and_the_next_begins_anew() -> None:
    assert measured([["moved", 0], ["drew", 5], ["moved", 20], ["drew", 25], ["moved", 40], ["drew", 45]]) is None
    again = """() => { const r = new DrawRate();
        for (let t = 0; t < 200; t += 20) { r.moved(t); r.drew(t + 5); }
        return [r.taken(), r.taken()]; }"""
    assert run_script(("editor/drawing.js",), again, None) == [{"hz": 50, "ms": 5}, None]


def test_it_goes_with_the_next_end_of_an_edit_and_only_with_that() -> None:
    main = """() => { const sent = [], values = { points: [], cuts: [], parts: [], next_id: 0, seen: {}, history: {} };
        const model = { get: (name) => values[name], on() {}, off() {}, send: (message) => sent.push(message) };
        const sender = new Sender({ now: () => 0, later: () => 1, cancel() {} });
        sender.attach(model);
        const at = (x) => [{ id: 0, name: "", source: [0, 0], target: [x, 0], active: true, weight: 1, locked: false,
          radius: null }];
        sender.move(at(1));
        sender.drawn = { hz: 40, ms: 9 };
        sender.edit(at(2), "move");
        sender.edit(at(3), "move");
        return sent.map((m) => [m.phase, m.drawn ?? null]); }"""
    files = ("maths/rbf.js", "maths/points.js", "maths/regions.js", "maths/shapes.js", "sync/edits.js")
    assert run_script(files, main, None) == [["move", None], ["end", {"hz": 40, "ms": 9}], ["end", None]]


def told(editor: Editor, drawn: Any, seq: int) -> None:
    points = [{"id": k, "source": [0.0, 0.0], "target": [float(seq), float(k)]} for k in range(2)]
    content = {"type": "edit", "phase": "end", "kind": "move", "sender": "s", "seq": seq, "points": points}
    editor._received(editor, content | ({"drawn": drawn} if drawn is not None else {}), [])


def test_an_editor_says_what_its_page_measured_last() -> None:
    editor = Editor(None, POINTS)
    assert editor.stats() == {"drag_hz": 0.0, "picture_ms": 0.0}
    told(editor, {"hz": 41.5, "ms": 9}, 1)
    assert editor.stats() == {"drag_hz": 41.5, "picture_ms": 9.0}
    told(editor, None, 2)  # an arrow key measures nothing
    assert editor.stats() == {"drag_hz": 41.5, "picture_ms": 9.0}


@pytest.mark.parametrize("drawn", [7, "fast", [], {"hz": "9"}, {"hz": True}, {"hz": -1, "ms": 1e300}, {"hz": None}])
def test_what_is_measured_oddly_costs_no_edit(drawn: Any) -> None:
    editor = Editor(None, POINTS)
    told(editor, drawn, 1)
    assert editor.points.target.tolist() == [[1.0, 0.0], [1.0, 1.0]]
    assert editor.stats() == {"drag_hz": 0.0, "picture_ms": 0.0}
