"""The curve editor without a browser: curves and nodes, messages of the front end, and its scripts against the core."""

from __future__ import annotations

import json
import logging
import shutil
from typing import Any

import numpy as np
import oracle
import pytest
from front_end import deliver
from hypothesis import given
from hypothesis import strategies as st
from scripts import run_script

from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.widgets import CurveEditor
from deformnb.widgets.inputs.curve_editor import Nodes, exact_nodes, few_nodes, fewest_values, values_of
from deformnb.widgets.messages.record import LONGEST_MESSAGE

TENT = [[0.0, 0.0], [0.25, 1.0], [1.0, -0.5]]
Z = np.linspace(0, 1, 129)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    messages: list[Any] = []
    monkeypatch.setattr(CurveEditor, "send", lambda self, content, buffers=None: messages.append(content))
    return messages


def receive(editor: CurveEditor, value: Any, *, seq: Any = 1, phase: Any = "end", view: Any = "v") -> None:
    content = {"type": "edit", "seq": seq, "view": view, "phase": phase, "value": value}
    deliver(editor, json.loads(json.dumps(content)))


def nodes(rows: Any, smooth: bool = False) -> dict[str, Any]:
    return {"nodes": rows, "smooth": smooth}


@st.composite
def drawn_nodes(draw: st.DrawFn) -> Nodes:
    """Nodes as the page makes them: on the grid of 1/128, from 0 to 1."""
    inner = draw(st.lists(st.integers(1, 127), unique=True, max_size=12))
    heights = st.floats(-1, 1.5).map(lambda y: round(y, 3))
    return tuple((k / 128, draw(heights)) for k in (0, *sorted(inner), 128))


# ---- curves ----------------------------------------------------------------------------------------------------------


def test_a_formula_is_kept_and_sampled() -> None:
    editor = CurveEditor(" sin(pi*z) ")
    assert editor.curve == "sin(pi*z)"
    oracle.assert_close(editor.values(5), [0, 0.5**0.5, 1, 0.5**0.5, 0], atol=2e-6)
    assert editor.shown["formula"] == "sin(pi*z)"
    oracle.assert_close(editor.shown["samples"], np.sin(np.pi * np.linspace(0, 1, 257)), atol=2e-6)
    assert repr(editor) == "CurveEditor('sin(pi*z)')"


def test_nodes_give_as_few_values_as_hold_them() -> None:
    editor = CurveEditor()
    editor.set_nodes(TENT)
    assert editor.curve == (0.0, 1.0, 0.5, 0.0, -0.5)
    assert editor.nodes == ((0.0, 0.0), (0.25, 1.0), (1.0, -0.5))
    assert editor.shown["formula"] == ""
    assert editor.shown["samples"] == []
    assert repr(editor) == "CurveEditor(3 nodes)"


@given(given_nodes=drawn_nodes())
def test_the_curve_of_nodes_is_what_is_seen_and_gives_the_nodes_back(given_nodes: Nodes) -> None:
    editor = CurveEditor()
    editor.set_nodes(given_nodes)
    x, y = np.array(given_nodes).T
    assert isinstance(editor.curve, tuple)
    fine = np.interp(np.linspace(0, 1, 1025), np.linspace(0, 1, len(editor.curve)), editor.curve)
    oracle.assert_close(fine, np.interp(np.linspace(0, 1, 1025), x, y), atol=1e-12)
    read = CurveEditor(editor.curve)
    oracle.assert_close(read.values(), editor.values(), atol=1e-12)
    assert set(read.nodes) <= {(float(a), float(b)) for a, b in given_nodes} | set(read.nodes[:1] + read.nodes[-1:])


def test_the_curve_fits_a_step() -> None:
    editor = CurveEditor()
    editor.set_nodes(TENT, smooth=True)
    points = ControlPoints.from_arrays([[0, 0], [1, 0], [0, 1]])
    plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    knots, weights = Step((points,), plane, extrusion="modulate", curve=editor.curve).weights()
    oracle.assert_close(weights[0], values_of(tuple(map(tuple, TENT)), knots, True), atol=1e-12)  # type: ignore[arg-type]


def test_a_smooth_curve_goes_through_its_nodes_and_never_beyond() -> None:
    y = values_of(((0, 0), (0.25, 1), (0.5, 1), (1, -0.5)), Z, smooth=True)
    oracle.assert_close(y[[0, 32, 64, 128]], [0, 1, 1, -0.5], atol=1e-12)
    assert y.min() >= -0.5
    assert y.max() <= 1
    assert (np.diff(y[:32]) > 0).all()


def test_values_are_drawn_by_their_bends() -> None:
    editor = CurveEditor((0, 0.5, 1, 1, 1))
    assert editor.nodes == ((0.0, 0.0), (0.5, 1.0), (1.0, 1.0))
    assert exact_nodes((2.0, 2.0, 2.0)) == ((0.0, 2.0), (1.0, 2.0))
    assert fewest_values(((0, 0), (1 / 3, 1), (1, 1))) == 129


def test_values_with_too_many_bends_are_shown_as_they_are() -> None:
    wild = tuple(np.sin(40 * Z).tolist())
    editor = CurveEditor(wild)
    assert editor.curve == wild
    assert len(editor.shown["samples"]) == 257
    assert len(editor.shown["nodes"]) == 9
    assert repr(editor) == "CurveEditor('129 values')"


@pytest.mark.parametrize(
    ("formula", "count", "error"),
    [
        ("z", 2, 1e-9),
        ("1", 2, 1e-9),
        ("abs(z-0.5)", 3, 1e-9),
        ("sin(pi*z)", 9, 0.02),
        ("z*z*(3-2*z)", 9, 0.015),
        ("min(1,3*z)", 9, 0.008),
        ("sin(6*pi*z)", 9, 1.2),
    ],
)
def test_a_formula_becomes_few_nodes(formula: str, count: int, error: float) -> None:
    values = CurveEditor(formula).values(257)
    found = few_nodes(values)
    assert len(found) <= count
    assert (found[0][0], found[-1][0]) == (0.0, 1.0)
    assert all(x * 128 == round(x * 128) for x, _ in found)
    oracle.assert_close(values_of(found, np.linspace(0, 1, 257)), values, atol=error)


def test_rounding_the_lines_changes_the_curve_and_back() -> None:
    editor = CurveEditor()
    editor.set_nodes(TENT)
    straight = editor.curve
    editor.smooth = True
    assert len(editor.curve) == 129
    assert editor.nodes == ((0.0, 0.0), (0.25, 1.0), (1.0, -0.5))
    editor.smooth = False
    assert editor.curve == straight


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        ("sin(", "not a formula"),
        ("1/(z-0.5)", "not finite at z = 0.5"),
        ("__import__('os')", "may only use"),
        ("", "empty"),
        ((1.0,), "at least two"),
        ([1, float("nan")], "finite"),
        (lambda z: z, "no nodes"),
        ({"a": 1}, "array of numbers"),
    ],
)
def test_a_wrong_curve_is_refused_and_the_old_one_stays(curve: Any, words: str) -> None:
    editor = CurveEditor("1-z")
    shown = editor.shown
    with pytest.raises(DeformError, match=words):
        editor.curve = curve
    assert (editor.curve, editor.shown) == ("1-z", shown)


@pytest.mark.parametrize(
    "rows",
    [
        3,
        [(0, 0)],
        [(0, 0), (0.5, 1)],
        [(0, 0), (0.6, 1), (0.4, 1), (1, 0)],
        [(0, 0, 0), (1, 1)],
        [(0, 0), (0.5, 1), (0.5, 0), (1, 1)],
        [(0, 0), (1, float("nan"))],
        [("a", 0), (1, 1)],
    ],
)
def test_wrong_nodes_are_refused(rows: Any) -> None:
    editor = CurveEditor("1-z")
    with pytest.raises(DeformError):
        editor.set_nodes(rows)
    assert editor.curve == "1-z"


def test_a_range_rises() -> None:
    with pytest.raises(DeformError, match="rise"):
        CurveEditor(range=(1.0, 1.0))


def test_the_state_for_the_page_is_plain_json() -> None:
    state = CurveEditor("z").get_state()
    json.dumps({k: v for k, v in state.items() if k != "layout"})
    assert state["range"] == (-1.0, 1.5)
    assert state["presets"]["smoothstep"] == "z*z*(3-2*z)"


# ---- messages --------------------------------------------------------------------------------------------------------


def test_a_drag_is_heard_on_its_way_and_ends_in_the_trait(sent: list[Any]) -> None:
    editor = CurveEditor("z")
    heard: list[Any] = []
    seen: list[Any] = []
    editor.on_edit(lambda curve, phase: heard.append((curve, phase)))
    editor.observe(lambda change: seen.append(change["new"]), "curve")
    assert editor.live
    receive(editor, nodes([[0, 0], [0.5, 1], [1, 1]]), seq=4, phase="move")
    assert editor.curve == "z"
    assert editor.shown["formula"] == "z"
    receive(editor, nodes([[0, 0], [0.5, 0.5], [1, 0]]), seq=5)
    assert heard == [((0.0, 1.0, 1.0), "move"), ((0.0, 0.5, 0.0), "end")]
    assert seen == [(0.0, 0.5, 0.0)]
    assert editor.shown["nodes"] == [[0.0, 0.0], [0.5, 0.5], [1.0, 0.0]]
    assert editor.shown["seen"] == {"v": 5}
    assert sent == [{"type": "done", "seq": 4, "view": "v"}, {"type": "done", "seq": 5, "view": "v"}]


def test_a_node_on_the_line_stays_though_the_curve_is_the_same(sent: list[Any]) -> None:
    editor = CurveEditor((0, 1))
    receive(editor, nodes([[0, 0], [0.5, 0.5], [1, 1]]))
    assert editor.nodes == ((0.0, 0.0), (0.5, 0.5), (1.0, 1.0))
    assert len(editor.shown["nodes"]) == 3
    receive(editor, nodes([[0, 0], [0.5, 0.5], [1, 1]], True))
    assert (editor.smooth, len(editor.curve)) == (True, 129)


def test_a_formula_by_the_page_is_checked_here(sent: list[Any], caplog: pytest.LogCaptureFixture) -> None:
    editor = CurveEditor("z")
    receive(editor, {"formula": " 4*z*(1-z) "}, seq=1)
    assert editor.curve == "4*z*(1-z)"
    sent.clear()
    with caplog.at_level(logging.WARNING):
        receive(editor, {"formula": "sin(q)"}, seq=2)
    assert editor.curve == "4*z*(1-z)"
    assert [m["type"] for m in sent] == ["error", "done"]
    assert sent[0]["view"] == "v"
    assert "'q' is something else" in sent[0]["message"]
    assert editor.shown["seen"] == {"v": 2}  # refused is an answer as well
    assert "refused" in caplog.text


def test_a_failing_callback_is_said_in_the_page_and_the_edit_stays(
    sent: list[Any], caplog: pytest.LogCaptureFixture
) -> None:
    editor = CurveEditor("z")
    editor.on_edit(lambda curve, phase: 1 / 0)  # type: ignore[arg-type, return-value]
    receive(editor, {"formula": "1"})
    assert editor.curve == "1"
    assert sent[0] == {"type": "error", "view": "v", "message": "ZeroDivisionError in a callback: division by zero"}
    assert sent[1]["type"] == "done"
    assert "ZeroDivisionError" in caplog.text


def test_a_callback_can_be_taken_away() -> None:
    editor, heard = CurveEditor(), []
    callback = lambda curve, phase: heard.append(curve)  # noqa: E731
    editor.on_edit(callback)
    editor.on_edit(callback, remove=True)
    receive(editor, {"formula": "1"})
    assert (heard, editor.live) == ([], False)


@pytest.mark.parametrize(
    "value",
    [
        None,
        [],
        {},
        {"nodes": None},
        {"nodes": [[0, 0], [1, 1]]},
        nodes([[0, 0]]),
        nodes([[0, 0], [1, "1"]]),
        nodes([[0, 0], [1, True]]),
        nodes([[0.1, 0], [1, 1]]),
        nodes([[0, 0], [0.9, 1]]),
        nodes([[0, 0], [1, 1]], 1),  # type: ignore[arg-type]
        nodes([[0, 0], [0.5, 1], [0.5, 0], [1, 1]]),
        nodes([[0, 0], [1, 1e301]]),
        nodes([[k / 70, 0] for k in range(71)]),
        {"formula": 3},
        {"formula": ""},
        {"formula": "z" * 201},
        {"formula": "9^9^9^9"},
        {"formula": "1/z"},
    ],
)
def test_what_is_no_curve_is_refused_and_answered(
    value: Any, sent: list[Any], caplog: pytest.LogCaptureFixture
) -> None:
    editor = CurveEditor("1-z")
    receive(editor, value, seq=7)
    assert editor.curve == "1-z"
    assert [m["type"] for m in sent] == ["error", "done"]
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize(
    "changes",
    [
        {"seq": "1"},
        {"seq": True},
        {"seq": None},
        {"seq": 2**60},
        {"phase": "over"},
        {"phase": None},
        {"view": 3},
        {"view": "v" * 41},
        {"type": "run"},
        {"value": "x" * (LONGEST_MESSAGE + 1)},
    ],
)
def test_what_is_no_edit_is_dropped(changes: Any, sent: list[Any], caplog: pytest.LogCaptureFixture) -> None:
    editor = CurveEditor("1-z")
    good = {"type": "edit", "seq": 1, "view": "v", "phase": "end", "value": {"formula": "1"}}
    for content in ({**good, **changes}, [good], None, "edit"):
        deliver(editor, content)
    assert (editor.curve, sent) == ("1-z", [])
    assert "was dropped" in caplog.text


def test_the_page_writes_no_traits(caplog: pytest.LogCaptureFixture) -> None:
    editor = CurveEditor("1-z")
    before = editor.shown
    for state in ({"shown": {}}, {"range": [0, 1]}, {"theme": "dark", "_view_count": 1}, {"_view_count": "2"}, [1]):
        editor.set_state(state)
    assert (editor.shown, editor.range, editor.theme) == (before, (-1.0, 1.5), "auto")
    assert caplog.text.count("were dropped") == 5
    editor.set_state({"_view_count": 1})
    assert editor.trait_values()["_view_count"] == 1


def test_pages_that_are_long_closed_are_forgotten(sent: list[Any]) -> None:
    editor = CurveEditor()
    for k in range(40):
        receive(editor, {"formula": "z"}, view=f"page {k}")
    assert list(editor.shown["seen"]) == [f"page {k}" for k in range(24, 40)]


# ---- scripts ---------------------------------------------------------------------------------------------------------


@given(given_nodes=drawn_nodes())
@pytest.mark.skipif(shutil.which("node") is None, reason="a browser for every example would take minutes")
def test_the_page_draws_the_curve_that_python_computes(given_nodes: Nodes) -> None:
    main = "({ nodes, z }) => [false, true].map((s) => z.map(curveThrough(nodes, s)))"
    straight, smooth = run_script(("maths/curves.ts",), main, {"nodes": given_nodes, "z": Z.tolist()})
    oracle.assert_close(straight, values_of(given_nodes, Z), atol=1e-12)
    oracle.assert_close(smooth, values_of(given_nodes, Z, True), atol=1e-9)
