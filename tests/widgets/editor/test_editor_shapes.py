"""Cuts and rigid parts of an editor in Python: traits, messages of the front end, and their effect in the core."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from hypothesis import given
from hypothesis import strategies as st
from scripts import run_script

from deformnb.document.json_regions import cut_to_data, part_to_data
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import Cut, Decoupled
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import LARGEST_SHAPE, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidInterpolant, RigidMotion, RigidPart
from deformnb.volume.plane import Picture, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp_picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import ShapesEdit
from deformnb.widgets.messages.shapes import MOST_PARTS, track_index

LINE = {"kind": "line", "vertices": [[20.0, 0.0], [22.0, 30.0]]}
SQUARE = {"kind": "polygon", "vertices": [[3.0, 3.0], [6.0, 3.0], [6.0, 9.0], [3.0, 9.0]]}


@pytest.fixture
def points() -> ControlPoints:
    source = np.array([[10.0, 4.0], [12, 20], [5, 25], [30, 4], [28, 20], [35, 26]])
    return ControlPoints.from_arrays(source, source + np.array([[-2, 0], [-3, 1], [0, 0], [2, 0], [3, -1], [0, 0]]))


def picture() -> Picture:
    rng = np.random.default_rng(0)
    return project(Volume(rng.integers(0, 255, (6, 30, 40)).astype(np.uint8), Grid((6, 30, 40))))


def answers_to_edit(editor: Editor, **changes: Any) -> list[Any]:
    """Answers of the editor to a message of the front end."""
    answers: list[Any] = []
    editor.send = lambda content, buffers=None: answers.append(content)  # type: ignore[method-assign]
    message = {
        "type": "shapes",
        "sender": "page",
        "seq": 1,
        "what": "cuts",
        "kind": "add cut",
        "shapes": [{"region": LINE}],
        **changes,
    }
    deliver(editor, message)
    return answers


# ---- traits ---------------------------------------------------------------------------------------------------------


def test_traits_hold_shapes_and_the_page_gets_plain_data(points: ControlPoints) -> None:
    mask = Mask(np.eye(5, dtype=bool), Raster((5, 5), (1.0, 1.0), (0.0, 0.0)))
    cut, part = Cut(Line(LINE["vertices"]), "mouth"), RigidPart(mask, RigidMotion.turn(30, (2, 2)), reach=4.0)
    editor = Editor(None, points, cuts=[cut], parts=(part, {"region": SQUARE}), cut_rule="paper")
    square = RigidPart(Polygon(SQUARE["vertices"]))
    assert (editor.cuts, editor.parts) == ((cut,), (part, square))
    assert editor.get_state(["cuts", "parts", "cut_rule"]) == {
        "cuts": [cut_to_data(cut)],
        "parts": [part_to_data(part), part_to_data(square)],
        "cut_rule": "paper",
    }


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("cuts", [{"region": LINE}] * 9, "at most 8"),
        ("cuts", "line", "must be a list"),
        ("parts", [3], "parts"),
        ("cuts", [{"region": {"kind": "half_space", "point": [0, 0, 0], "normal": [0, 0, 1]}}], "is in space"),
        ("parts", [{"region": LINE}], "no inside"),
        ("cuts", [{"region": {"kind": "blob"}}], "blob"),
        ("cuts", [{"region": {"kind": "polygon", "vertices": [[0, 0], [9, 9], [9, 0], [0, 9]]}}], "crosses itself"),
        ("parts", [{"region": SQUARE, "name": "x" * 201}], "200"),
    ],
)
def test_what_is_no_shape_is_refused(points: ControlPoints, name: str, value: Any, words: str) -> None:
    editor = Editor(None, points)
    with pytest.raises(DeformError, match=words):
        setattr(editor, name, value)
    assert getattr(editor, name) == ()


# ---- what the core makes of them ------------------------------------------------------------------------------------


def test_the_fit_is_that_of_the_step(points: ControlPoints) -> None:
    shown = picture()
    cut, part = Cut(Line(LINE["vertices"])), RigidPart(Polygon(SQUARE["vertices"]))
    at = np.random.default_rng(1).uniform(0, 30, (200, 2))
    in_space = shown.plane.from_plane(np.concatenate([at, np.zeros((200, 1))], axis=1))
    for cuts, parts, kind in (
        ([], [], RBFInterpolant),
        ([], [part], RigidInterpolant),
        ([cut], [], Decoupled),
        ([cut], [part], Decoupled),
        ([Cut(cut.region, enabled=False)], [], RBFInterpolant),
    ):
        editor = Editor(shown, points, cuts=cuts, parts=parts, strength=0.7)
        assert type(editor.fit()) is kind
        step = editor.step()
        assert (list(step.cuts), list(step.parts), step.cut_rule) == (cuts, parts, "source")
        field = step.field(Grid((6, 30, 40)))
        frame = shown.plane.frame[:2]
        assert field.displacement(in_space) @ frame.T == pytest.approx(editor.fit().displacement(at), abs=1e-9)
        assert field.opacity(in_space) == pytest.approx(editor.fit().opacity(at), abs=1e-9)


def test_a_still_shows_the_gap(points: ControlPoints) -> None:
    editor = Editor(picture(), points, cuts=[Cut(Line(LINE["vertices"]))])
    field, raster = editor.fit(), editor.picture.raster  # type: ignore[union-attr]
    assert (field.opacity(raster.points()) == 0).sum() > 20
    assert warp_picture(editor.picture.values, raster, field).shape == raster.shape  # type: ignore[union-attr]
    assert editor.preview_png().startswith(b"\x89PNG")


# ---- messages -------------------------------------------------------------------------------------------------------


def test_shapes_of_the_page_are_taken_and_told(points: ControlPoints) -> None:
    editor = Editor(None, points)
    heard: list[ShapesEdit] = []
    seen: list[Any] = []
    editor.on_shapes(heard.append)
    editor.observe(lambda change: seen.append(editor.edit_under_way), "cuts")
    assert answers_to_edit(editor) == [{"type": "done", "sender": "page", "seq": 1}]
    assert editor.cuts == (Cut(Line(LINE["vertices"])),)
    assert [(m.what, m.kind, m.shapes) for m in heard] == [("cuts", "add cut", editor.cuts)]
    assert (seen, editor.edit_under_way) == (heard, None)
    assert editor.seen == {"page": 1}
    answers_to_edit(editor, shapes=[])  # the same number again: it has been taken in
    assert len(editor.cuts) == 1
    editor.on_shapes(heard.append, remove=True)
    answers_to_edit(editor, seq=2, what="parts", shapes=[{"region": SQUARE}], kind="add rigid part")
    assert (len(heard), len(editor.parts), editor.seen) == (1, 1, {"page": 2})


@pytest.mark.parametrize(
    "changes",
    [
        {"what": "points"},
        {"joins": "yes"},
        {"kind": 3},
        {"kind": ""},
        {"kind": "x" * 81},
        {"shapes": None},
        {"shapes": [{"region": LINE}] * 9},
        {"what": "parts", "shapes": [{"region": SQUARE}] * (MOST_PARTS + 1)},
        {"shapes": [{"region": {"kind": "line"}}]},
        {"shapes": [{"region": {**LINE, "vertices": [[0, float("nan")], [1, 1]]}}]},
        {"shapes": [{"region": {**LINE, "vertices": [[0, 10**400], [1, 1]]}}]},
        {"shapes": [{"region": {**LINE, "vertices": [[k, k * k] for k in range(LARGEST_SHAPE + 1)]}}]},
        {"shapes": [{"region": LINE, "name": "x" * 2**21}]},
        {"what": "parts", "shapes": [{"region": LINE}]},
        {"what": "parts", "shapes": [{"region": SQUARE, "motion": {"matrix": [[2, 0], [0, 1]], "shift": [0, 0]}}]},
        {"what": "parts", "shapes": [{"region": SQUARE, "pivot": [1, 2, 3]}]},
        {
            "shapes": [
                {
                    "region": {
                        "kind": "mask",
                        "shape": [2**13, 2**12],
                        "spacing": [1, 1],
                        "origin": [0, 0],
                        "bits": base64.b64encode(zlib.compress(bytes(2**22))).decode(),
                    }
                }
            ]
        },
    ],
)
def test_what_is_wrong_in_a_message_of_shapes_is_said_and_changes_nothing(points: ControlPoints, changes: Any) -> None:
    editor = Editor(None, points, cuts=[Cut(HalfSpace((5, 5), (1, 0)))])
    before = editor.cuts
    error, done = answers_to_edit(editor, **changes)
    assert error["message"].startswith("Python did not take this edit: ")
    assert done["type"] == "done"
    assert (editor.cuts, editor.parts, editor.seen) == (before, (), {"page": 1})


@pytest.mark.parametrize("content", [{"sender": ""}, {"sender": 3}, {"seq": -1}, {"seq": "1"}])
def test_a_message_of_nobody_is_dropped(points: ControlPoints, content: Any, caplog: Any) -> None:
    editor = Editor(None, points)
    assert answers_to_edit(editor, **content) == []
    assert "was dropped" in caplog.text
    assert editor.cuts == ()


def test_shapes_that_an_observer_refuses_are_put_back(points: ControlPoints) -> None:
    editor = Editor(None, points)

    def refuse(change: Any) -> None:
        if change["new"]:
            raise DeformError("not here.")

    editor.observe(refuse, "cuts")
    error, _ = answers_to_edit(editor)
    assert error["message"] == "Python did not take these cuts: not here."
    assert (editor.cuts, editor.seen, editor.edit_under_way) == ((), {"page": 1}, None)


def test_a_callback_that_fails_is_said(points: ControlPoints, caplog: Any) -> None:
    editor = Editor(None, points)

    def fail(edit: ShapesEdit) -> None:
        raise RuntimeError("broken")

    editor.on_shapes(fail)
    error, _ = answers_to_edit(editor)
    assert error["message"] == "RuntimeError in a callback: broken"
    assert len(editor.cuts) == 1


@given(st.lists(st.integers(0, 3), min_size=1, max_size=6), st.lists(st.integers(0, 3), max_size=6), st.integers(0, 5))
def test_a_shape_is_followed_to_where_it_is(before: list[int], after: list[int], index: int) -> None:
    place = track_index(before, after, index)
    if index >= len(before):
        assert place is None
    elif before[index] in after:
        assert place is not None
        assert after[place] == before[index]
        assert all(abs(k - index) >= abs(place - index) for k, shape in enumerate(after) if shape == before[index])
    else:
        others = len(after) == len(before) and all(
            a == b for k, (a, b) in enumerate(zip(before, after, strict=True)) if k != index
        )
        assert place == (index if others else None)


def test_the_page_follows_a_shape_as_python_does() -> None:
    rng = np.random.default_rng(3)
    cases = [
        (*(rng.integers(0, 4, rng.integers(0, 6)).tolist() for _ in range(2)), int(rng.integers(0, 6)))
        for _ in range(500)
    ]
    found = run_script(("maths/shapes.ts",), "(cases) => cases.map((given) => trackShape(...given))", cases)
    assert found == [track_index(*case) for case in cases]
    assert {type(place) for place in found} == {int, type(None)}


@pytest.mark.parametrize("wrong", [{"what": "points"}, {"index": "0"}, {"shape": None}])
def test_a_choice_that_is_none_is_refused(points: ControlPoints, wrong: dict[str, Any]) -> None:
    editor = Editor(None, points, parts=[RigidPart(HalfSpace((0, 0), (0, -1)), name="ground")])
    editor.choose("parts", 0)
    content = {"type": "choose", "sender": "page", "seq": 1, "what": "parts", "index": 0, "shape": {"name": "ground"}}
    sent: list[Any] = []
    editor.send = lambda message, buffers=None: sent.append(message)  # type: ignore[method-assign]
    deliver(editor, {**content, **wrong})
    assert [message["type"] for message in sent] == ["error", "done"]
    assert editor.chosen_shape == {"what": "parts", "index": 0}
    with pytest.raises(DeformError, match="chosen shape"):
        editor.choose("cuts", 0)
