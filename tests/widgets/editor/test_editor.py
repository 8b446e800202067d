"""The editor without a browser: its traits, messages, refusals, and still picture."""

from __future__ import annotations

import base64
import io
import json
import logging
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from PIL import Image

from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.fields import Identity
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import Editor
from deformnb.widgets.editor.editor import picture_png
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.messages.points import points_from_json, points_to_json


@pytest.fixture
def volume() -> Volume:
    values = np.zeros((20, 30, 40), np.uint8)
    values[5:15, 8:22, 10:30] = np.arange(20, dtype=np.uint8) * 10 + 30
    return Volume(values, Grid((20, 30, 40), spacing=(2.0, 1.0, 1.5), unit="mm"))


@pytest.fixture
def picture(volume: Volume) -> Picture:
    return project(volume, "+z")


@pytest.fixture
def points() -> ControlPoints:
    source = np.array([[10, 5], [60, 6], [30, 25], [50, 20]])
    return ControlPoints.from_arrays(
        source, source + np.array([[1, 2], [-3, 0], [0, 4], [2, -2]]), names=["nose", "", "\u00fcber", ""]
    )


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    messages: list[Any] = []
    monkeypatch.setattr(Editor, "send", lambda self, content, buffers=None: messages.append(content))
    return messages


def receive(editor: Editor, content: Any) -> None:
    """A custom message by the page."""
    deliver(editor, content)


def test_a_page_that_opens_is_answered_and_changes_nothing(sent: list[Any]) -> None:
    editor = Editor(None, ControlPoints.empty())
    before = editor.get_state()
    receive(editor, {"type": "greet", "sender": "a", "seq": 0})
    assert sent == [{"type": "done", "sender": "a", "seq": 0}]
    assert editor.get_state() == before


def edit(points: Any, seq: int = 1, phase: str = "end", **more: Any) -> dict[str, Any]:
    return {"type": "edit", "sender": "w1", "seq": seq, "phase": phase, "kind": "move", "points": points, **more}


def step(way: str, seq: int = 1) -> dict[str, Any]:
    return {"type": "history", "sender": "w1", "seq": seq, "way": way}


def done(seq: int) -> dict[str, Any]:
    return {"type": "done", "sender": "w1", "seq": seq}


# ---- points ----------------------------------------------------------------------------------------------------------


def test_points_come_back_from_the_page_as_they_went(points: ControlPoints) -> None:
    points = points.edit(1, active=False, weight=2.5).remove(2)
    page = json.loads(json.dumps(points_to_json(points)))
    assert replace(points_from_json(page), next_id=points.next_id) == points


def test_the_state_for_the_page_is_plain_json(picture: Picture, points: ControlPoints) -> None:
    state = Editor(picture, points).get_state()
    assert state["points"] == points_to_json(points)
    assert state["next_id"] == 4
    assert state["raster"] == {
        "shape": [30, 40],
        "spacing": [2.0, 1.0],
        "origin": [0.0, 0.0],
        "channels": 1,
        "range": [0, 255],
        "window": list(picture.window),
        "unit": "",
        "lengths": "mm",
    }
    assert state["uid"]
    json.dumps({k: v for k, v in state.items() if not isinstance(v, bytes) and k != "layout"})


def test_two_editors_have_different_names_in_the_page() -> None:
    assert Editor().uid != Editor().uid


def test_a_picture_of_one_value_is_black_in_its_window(picture: Picture) -> None:
    flat = replace(picture, values=np.full(picture.values.shape, 5.0, np.float32), window=(5.0, 6.0))
    png, facts = picture_png(flat)
    assert facts["range"] == [5.0, 6.0]
    assert np.asarray(Image.open(io.BytesIO(png))).max() == 0


def test_what_the_page_sends_becomes_the_points_and_is_observed(picture: Picture, points: ControlPoints) -> None:
    editor, seen = Editor(picture, points), []
    editor.observe(lambda change: seen.append(change["new"]), "points")
    moved = points.move(2, [33, 30])
    receive(editor, edit(points_to_json(moved)))
    editor.set_state({"selected": [2]})
    assert editor.points == moved
    assert seen == [moved]
    assert editor.selected == [2]


def test_an_id_that_was_given_never_comes_back(picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    receive(editor, edit(points_to_json(points.add([1, 1])), 1))
    receive(editor, edit(points_to_json(points), 2))
    assert editor.points.add([2, 2]).ids[-1] == 5
    receive(editor, edit(points_to_json(points), 3, next_id=9))  # added and removed before Python received either
    assert editor.points.add([2, 2]).ids[-1] == 9
    assert editor.next_id == 9


def test_points_in_space_and_other_things_are_refused(picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    with pytest.raises(DeformError, match="are in space"):
        editor.points = ControlPoints.empty(3)
    with pytest.raises(DeformError, match="must be ControlPoints"):
        editor.points = [[1, 2]]
    assert editor.points == points


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("kernel", "spline", "unknown kernel"),
        ("trend", "septic", "unknown trend"),
        ("support", 0.0, "positive"),
        ("support", float("nan"), "positive"),
        ("smoothing", -1.0, "smoothing"),
        ("strength", float("inf"), "strength"),
        ("lone_support", -1.0, "positive length"),
    ],
)
def test_settings_that_make_no_sense_are_refused(picture: Picture, name: str, value: Any, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        Editor(picture, **{name: value})
    editor = Editor(picture)
    before, settings = getattr(editor, name), editor.settings
    with pytest.raises(DeformError, match=words):
        setattr(editor, name, value)
    assert (getattr(editor, name), editor.settings) == (before, settings)


def test_the_view_goes_to_a_point_that_is_there(
    picture: Picture, points: ControlPoints, monkeypatch: pytest.MonkeyPatch
) -> None:
    editor = Editor(picture, points)
    sent: list[Any] = []
    monkeypatch.setattr(editor, "send", sent.append)
    with pytest.raises(DeformError, match="99"):
        editor.look_at(99)
    editor.look_at(points.ids[1])
    assert sent == [{"type": "look", "id": points.ids[1]}]


def test_settings_are_changed_together_and_told_once(picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points, kernel="gaussian")
    seen: list[Any] = []
    editor.observe(lambda change: seen.append(change["new"]), "settings")
    editor.change(strength=0.5, stages=3)
    assert [(s.kernel, s.strength, s.stages) for s in seen] == [("gaussian", 0.5, 3)]
    editor.strength = 2.0
    assert (editor.settings.strength, editor.get_state("settings")["settings"]["strength"]) == (2.0, 2.0)
    with pytest.raises(DeformError, match="no setting 'colour'"):
        editor.change(colour="red")
    with pytest.raises(DeformError, match=r"change\(strength"):
        editor.settings = {"strength": 2.0}


@pytest.mark.parametrize("view", ["+x", "+y", "-z"])
def test_a_lone_point_reaches_as_far_as_in_its_own_step(view: str) -> None:
    volume = PHANTOMS["bar"].make((48, 48, 48))
    picture = project(volume, view)
    a0, a1, b0, b1 = picture.raster.box
    middle = np.array([(a0 + a1) / 2, (b0 + b1) / 2])
    points = ControlPoints.from_arrays([middle], [middle + np.array([6.0, 0.0])])
    editor = Editor(picture, points, trend="none")
    x = middle + np.random.default_rng(0).uniform(-20, 20, (50, 2))
    field = editor.step().field(volume.grid)
    in_space = picture.plane.from_plane(x)
    np.testing.assert_allclose(
        editor.fit().displacement(x), field.displacement(in_space) @ picture.plane.frame[:2].T, atol=1e-12
    )


# ---- messages --------------------------------------------------------------------------------------------------------


def test_the_end_of_an_edit_sets_the_points_and_is_answered(
    picture: Picture, points: ControlPoints, sent: list[Any]
) -> None:
    editor = Editor(picture, points)
    receive(editor, edit(points_to_json(points.move(0, [12, 9])), 7))
    assert editor.points == points.move(0, [12, 9])
    assert sent == [done(7)]


def test_a_movement_reaches_callbacks_and_leaves_the_points(
    picture: Picture, points: ControlPoints, sent: list[Any]
) -> None:
    editor, seen = Editor(picture, points), []
    assert not editor.live

    def note(p: ControlPoints, phase: str) -> None:
        seen.append((p, phase, editor.points == p))

    editor.on_edit(note)
    assert editor.live
    moved = points.move(0, [12, 9])
    receive(editor, edit(points_to_json(moved), 1, "move"))
    receive(editor, edit(points_to_json(moved), 2, "end"))
    assert seen == [(moved, "move", False), (moved, "end", True)]
    assert [m["seq"] for m in sent] == [1, 2]
    editor.on_edit(note, remove=True)
    assert not editor.live


def test_an_exception_of_a_callback_is_told_the_page(
    picture: Picture, points: ControlPoints, sent: list[Any], caplog: pytest.LogCaptureFixture
) -> None:
    editor = Editor(picture, points)

    def fail(_points: ControlPoints, _phase: str) -> None:
        raise RuntimeError("no room")

    editor.on_edit(fail)
    receive(editor, edit(points_to_json(points), 3, "move"))
    assert sent == [{"type": "error", "message": "RuntimeError in a callback: no room"}, done(3)]
    assert "a callback of an editor failed" in caplog.text
    editor.observe(fail, "points")
    receive(editor, edit(points_to_json(points.move(0, [1, 1])), 4))
    assert (editor.points, editor.seen) == (points.move(0, [1, 1]), {"w1": 4})  # a page waits for no answer in vain


def test_a_callback_may_ask_for_details(picture: Picture, points: ControlPoints, sent: list[Any]) -> None:
    editor, seen = Editor(picture, points), []

    def note(edit: PointsEdit) -> None:
        seen.append((edit.phase, edit.kind, edit.joins, edit.points))

    editor.on_edit(note, details=True)
    editor.on_edit(lambda p, phase: seen.append(phase))
    nudged = points.move(0, [2, 2])
    receive(editor, edit(points_to_json(nudged), 1, kind="nudge", joins=True))
    assert seen == [("end", "nudge", True, nudged), "end"]
    editor.on_edit(note, remove=True)
    receive(editor, edit(points_to_json(points), 2, kind="undo"))
    assert seen[2:] == ["end"]


def test_an_observer_can_tell_the_page_from_code(picture: Picture, points: ControlPoints, sent: list[Any]) -> None:
    editor, seen = Editor(picture, points), []

    def note(_change: Any) -> None:
        made = editor.edit_under_way
        seen.append(made and (made.kind, made.joins))

    editor.observe(note, "points")
    receive(editor, edit(points_to_json(points.move(0, [2, 2])), 1, kind="nudge", joins=True))
    editor.points = points
    assert seen == [("nudge", True), None]


def test_the_page_learns_what_python_has_taken_in_after_it_has_the_points(
    picture: Picture, points: ControlPoints, sent: list[Any]
) -> None:
    editor, told = Editor(picture, points), []
    editor.observe(lambda change: told.append(change["name"]), ["points", "seen"])
    receive(editor, edit(points_to_json(points.move(0, [2, 2])), 5))
    assert told == ["points", "seen"]
    receive(editor, edit(points_to_json(points), 6, "move"))  # leaves the points, so it omits them
    assert editor.seen == {"w1": 5}
    receive(editor, edit(points_to_json(points), 5))  # came twice
    assert editor.points == points.move(0, [2, 2])
    for k in range(9):
        receive(editor, edit(points_to_json(points), 1, sender=f"x{k}"))
        receive(editor, edit(points_to_json(points), 10 + k))
    assert list(editor.seen.items()) == [*((f"x{k}", 1) for k in range(2, 9)), ("w1", 18)]  # the latest eight windows


def test_a_history_in_python_is_asked_by_the_page(picture: Picture, points: ControlPoints, sent: list[Any]) -> None:
    editor, ways = Editor(picture, points), []

    def go(way: str) -> None:
        ways.append((way, dict(editor.seen)))
        editor.points = points.move(0, [3, 3])

    editor.on_history(go)
    editor.history = {"undo": "move nose", "redo": ""}
    receive(editor, step("undo", 4))
    assert ways == [("undo", {})]  # the page takes no points before the step is done
    assert (editor.seen, sent) == ({"w1": 4}, [done(4)])
    editor.on_history(go, remove=True)
    receive(editor, step("redo", 5))
    assert len(ways) == 1
    editor.on_history(lambda way: 1 // 0)
    receive(editor, step("redo", 6))
    assert "ZeroDivisionError in a callback" in sent[-2]["message"]
    assert editor.seen == {"w1": 6}
    receive(editor, step("sideways", 7))
    assert "sideways" in sent[-2]["message"]
    for wrong in ({"undo": "x"}, {"undo": 1, "redo": ""}, {"undo": "", "redo": "", "more": ""}):
        with pytest.raises(DeformError, match="history"):
            editor.history = wrong
    assert editor.history == {"undo": "move nose", "redo": ""}


GOOD = {"id": 0, "name": "", "source": [1.0, 2.0], "target": [1.0, 2.0], "active": True, "weight": 1.0}
BAD_POINTS = {
    "no list": {"0": GOOD},
    "none": None,
    "a text": "points",
    "a number for a point": [3],
    "no id": [{k: v for k, v in GOOD.items() if k != "id"}],
    "an id twice": [GOOD, GOOD],
    "a negative id": [{**GOOD, "id": -1}],
    "true as id": [{**GOOD, "id": True}],
    "half an id": [{**GOOD, "id": 0.5}],
    "an id beyond all": [{**GOOD, "id": 2**60}],
    "not a number": [{**GOOD, "target": [float("nan"), 0]}],
    "endless": [{**GOOD, "source": [float("inf"), 0]}],
    "huge": [{**GOOD, "source": [1e200, 0]}],
    "a whole number beyond floats": [{**GOOD, "source": [10**400, 0]}],
    "three coordinates": [{**GOOD, "target": [1, 2, 3]}],
    "one coordinate": [{**GOOD, "target": [1]}],
    "texts as coordinates": [{**GOOD, "target": ["1", "2"]}],
    "true as a coordinate": [{**GOOD, "target": [True, 2]}],
    "no target": [{**GOOD, "target": None}],
    "a number as name": [{**GOOD, "name": 5}],
    "an endless name": [{**GOOD, "name": "x" * 1000}],
    "a number as switch": [{**GOOD, "active": 1}],
    "no weight": [{**GOOD, "weight": 0.0}],
    "a text as weight": [{**GOOD, "weight": "1"}],
    "too many": [{**GOOD, "id": k} for k in range(3000)],
    "lists in lists": [[[[[]]]]],
}


@pytest.mark.parametrize("name", list(BAD_POINTS))
def test_points_that_are_wrong_are_refused_and_logged(
    name: str, picture: Picture, points: ControlPoints, sent: list[Any], caplog: pytest.LogCaptureFixture
) -> None:
    editor = Editor(picture, points)
    receive(editor, edit(BAD_POINTS[name], 3))
    editor.set_state({"points": BAD_POINTS[name]})
    assert editor.points == points
    assert [m["type"] for m in sent] == ["error", "done"]
    assert sent[0]["message"].startswith("Python did not take this edit: ")
    assert editor.seen == {"w1": 3}  # else the page would wait for its points and show no others
    assert [r.levelno for r in caplog.records] == [logging.WARNING] * 2
    with pytest.raises(DeformError):
        points_from_json(BAD_POINTS[name])


@pytest.mark.parametrize(
    "content",
    [
        None,
        3,
        "edit",
        [],
        {},
        {"type": "edit"},
        edit([GOOD], type="run"),
        edit([GOOD], type=["edit"]),
        edit([GOOD], seq="1"),
        edit([GOOD], seq=True),
        edit([GOOD], seq=-1),
        edit([GOOD], seq=None),  # type: ignore[arg-type]
        edit([GOOD], sender=""),
        edit([GOOD], sender=5),
        edit([GOOD], sender="x" * 1000),
        edit([GOOD], sender=["w1"]),
    ],
)
def test_messages_that_are_no_edits_are_dropped_and_logged(
    content: Any, picture: Picture, sent: list[Any], caplog: pytest.LogCaptureFixture
) -> None:
    editor = Editor(picture)
    receive(editor, content)
    assert len(editor.points) == 0
    assert (sent, editor.seen) == ([], {})
    assert "dropped" in caplog.text


@pytest.mark.parametrize(
    "content",
    [
        edit([GOOD], phase="begin"),
        edit([GOOD], phase=["end"]),
        edit([GOOD], kind="run"),
        edit([GOOD], kind=None),  # type: ignore[arg-type]
        edit([GOOD], kind=["move"]),
        edit([GOOD], joins=1),
        edit([GOOD], next_id=-1),
        edit([GOOD], next_id=2.5),
        edit([GOOD], next_id="9"),
        step(["undo"]),  # type: ignore[arg-type]
        edit([{**GOOD, "id": k, "name": "\u4e2d" * 200} for k in range(1900)]),
    ],
)
def test_edits_with_something_wrong_are_refused_and_the_page_hears_it(
    content: Any, picture: Picture, sent: list[Any]
) -> None:
    editor = Editor(picture)
    receive(editor, content)
    assert len(editor.points) == 0
    assert [m["type"] for m in sent] == ["error", "done"]
    assert editor.seen == {"w1": 1}


def test_as_many_points_as_a_fit_takes_come_in_one_edit(picture: Picture, sent: list[Any]) -> None:
    editor = Editor(picture)
    receive(editor, edit([{**GOOD, "id": k, "name": f"landmark {k}"} for k in range(LARGEST_SET)]))
    assert len(editor.points) == LARGEST_SET


def test_the_page_changes_only_what_is_its_own(
    picture: Picture, points: ControlPoints, caplog: pytest.LogCaptureFixture
) -> None:
    editor = Editor(picture, points)
    editor.set_state(
        {
            "settings": {"kernel": "gaussian"},
            "raster": {},
            "image": "",
            "uid": "other",
            "live": True,
            "next_id": 2,
            "selected": ["all"],
            "show_grid": 1,
            "_esm": "took_over()",
            "show_radius": True,
            "points": [GOOD],
            "seen": {"w1": 99},
            "history": {"undo": "all", "redo": ""},
            "waiting": "x",
        }
    )
    assert editor.waiting == ""
    assert (editor.kernel, editor.uid != "other", editor.live, editor.next_id) == ("wendland_c2", True, False, 4)
    assert editor.raster["shape"] == [30, 40]
    assert (editor.selected, editor.show_grid, editor.show_radius) == ([], True, True)
    assert "took_over" not in editor.get_state("_esm")["_esm"]
    assert (editor.points, editor.seen, editor.history) == (points, {}, {})
    editor.set_state("nonsense")
    assert len(caplog.records) == 14


# ---- fit and picture -------------------------------------------------------------------------------------------------


def test_the_fit_is_that_of_the_step(volume: Volume, picture: Picture, points: ControlPoints) -> None:
    settings: dict[str, Any] = {"kernel": "wendland_c4", "trend": "similarity", "smoothing": 0.1, "strength": 1.5}
    editor = Editor(picture, points, **settings)
    (expected,) = editor.step().fits(volume.grid)
    at = picture.raster.points()
    assert np.array_equal(editor.fit().displacement(at), expected.displacement(at))
    assert editor.step(extrusion="modulate", curve="z").extrusion == "modulate"
    assert Deformation((editor.step(),)).apply(volume).shape == volume.shape


def test_an_editor_without_picture_has_no_plane(points: ControlPoints) -> None:
    with pytest.raises(DeformError, match="no plane"):
        Editor(None, points).step()


def test_a_lone_point_without_trend_is_a_bump(picture: Picture) -> None:
    editor = Editor(picture, ControlPoints.from_arrays([[20, 15]], [[25, 15]]), trend="none")
    assert editor.fit().support == pytest.approx(picture.grid.diagonal / 4)  # type: ignore[union-attr]


def test_the_fit_that_cannot_be_is_refused_as_by_the_core(picture: Picture) -> None:
    editor = Editor(picture, ControlPoints.from_arrays([[0, 0], [9, 9]], [[5, 5], [5, 5]]))
    with pytest.raises(DeformError, match="same place"):
        editor.fit()


def test_an_empty_sheet_holds_its_points(points: ControlPoints) -> None:
    raster = Editor(None, points).raster
    (nv, nu), (du, dv), (a, b) = raster["shape"], raster["spacing"], raster["origin"]
    for places in (points.source, points.target):
        assert (places > [a, b]).all()
        assert (places < [a + nu * du, b + nv * dv]).all()
    assert Editor(raster=Raster((5, 6), (1.0, 1.0), (0.0, 0.0))).raster["shape"] == [5, 6]


def test_the_image_is_the_picture(picture: Picture) -> None:
    pixels = np.asarray(Image.open(io.BytesIO(Editor(picture).image)))
    assert np.array_equal(pixels, picture.values)  # the front end applies the window


def test_values_beyond_bytes_come_in_two_of_them(volume: Volume) -> None:
    picture = project(replace(volume, values=volume.values.astype(np.float32) * 7.3 - 900), "+z")
    editor = Editor(picture)
    (low, high), pixels = editor.raster["range"], np.asarray(Image.open(io.BytesIO(editor.image))).astype(int)
    assert editor.raster["channels"] == 2
    values = low + (high - low) * (256 * pixels[..., 0] + pixels[..., 1]) / 65535
    assert np.abs(values - picture.values).max() <= (high - low) / 65535
    assert editor.raster["window"] == list(picture.window)


def test_a_value_far_off_leaves_the_window_enough_steps(volume: Volume) -> None:
    values = volume.values.astype(np.float64)
    values[0, 0, 0] = 1e12
    editor = Editor(project(replace(volume, values=values), "+z"))
    (low, high), (black, white) = editor.raster["range"], editor.raster["window"]
    assert (white - black) / (high - low) * 65535 > 1900


def test_a_window_set_by_hand_is_that_of_the_picture(picture: Picture) -> None:
    editor = Editor(picture, window=[10, 20])
    assert editor.picture is not None
    assert editor.picture.window == (10, 20)
    editor.set_state({"window": [30.0, 25.0]})
    editor.set_state({"window": [1.0]})
    editor.set_state({"slice": -1})
    assert editor.window == [10, 20]
    editor.set_state({"window": []})
    assert editor.picture is picture
    with pytest.raises(DeformError, match="rising"):
        editor.window = [3, 3]


def test_a_coloured_picture_keeps_its_colours(volume: Volume) -> None:
    picture = project(volume, "+z", "composite")
    editor = Editor(picture)
    assert editor.raster["channels"] == 3
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(editor.image))), picture.rgb8())


def test_another_picture_brings_its_raster_and_keeps_the_points(volume: Volume, points: ControlPoints) -> None:
    editor = Editor(project(volume, "+z"), points)
    editor.picture = project(volume, "+x")
    assert editor.raster["shape"] == [20, 30]
    assert editor.lone_support == volume.grid.diagonal / 4
    assert editor.points == points


# ---- display ---------------------------------------------------------------------------------------------------------


def still(editor: Editor) -> np.ndarray:
    bundle = editor._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert "application/vnd.jupyter.widget-view+json" in data
    png = data["image/png"]
    png = base64.b64decode(png) if isinstance(png, str) else png
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_the_still_shows_the_deformed_picture_with_grid_and_points(picture: Picture, points: ControlPoints) -> None:
    plain, marked = still(Editor(picture, density=0)), still(Editor(picture, points.reset(), density=0))
    gridded, moved = still(Editor(picture, points.reset())), still(Editor(picture, points))
    assert max(plain.shape) == 560 + 2 * 6  # seven inches of picture and the frame around, at 80 dots an inch
    vermilion = (np.abs(marked - [0xD5, 0x5E, 0x00]).max(axis=-1) < 12).sum()
    assert vermilion >= 4 * 6  # four discs of 4 points across
    assert (np.abs(gridded - marked).max(axis=-1) > 40).mean() > 0.02
    assert moved.shape != gridded.shape or (np.abs(moved - gridded).max(axis=-1) > 40).mean() > 0.01


def test_a_still_that_cannot_be_drawn_does_not_hide_the_widget(
    picture: Picture, caplog: pytest.LogCaptureFixture
) -> None:
    editor = Editor(picture, ControlPoints.from_arrays([[0, 0], [9, 9]], [[5, 5], [5, 5]]))
    bundle = editor._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert "application/vnd.jupyter.widget-view+json" in data
    assert "image/png" not in data
    assert "preview" in caplog.text


def test_the_name_says_what_it_is(picture: Picture, points: ControlPoints) -> None:
    assert repr(Editor(picture, points)) == "Editor(4 points, picture of 40 x 30)"
    assert repr(Editor()) == "Editor(0 points, no picture)"


def test_an_editor_at_rest_is_the_identity(picture: Picture, points: ControlPoints) -> None:
    at = picture.raster.points()
    assert np.array_equal(Editor(picture, points.reset()).fit().displacement(at), Identity(2).displacement(at))
