"""The smaller widgets of the application: what is done in them is an edit, and they show what the session holds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE

from deformnb.app.application import Application
from deformnb.app.panel_widgets import WIDGETS
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.json_format import to_json
from deformnb.session.session import Session
from deformnb.volume.transfer import preset
from deformnb.widgets.synced import LocalComm

TENT = [[0.0, 1.0], [0.5, 1.0], [1.0, 0.0]]


@pytest.fixture
def app() -> Iterator[Application]:
    made = Application(Session(PHANTOMS["bar"].make((12, 16, 20)), view="+y"))
    for widget in made.widgets.values():
        widget.comm = LocalComm(lambda data, buffers: None)
    yield made
    made.close()


def edit(app: Application, name: str, value: Any, *, phase: str = "end", seq: int = 1) -> None:
    """As a page whose hand has changed the value of a small widget."""
    content = {"type": "edit", "seq": seq, "view": "page", "phase": phase, "value": value}
    app.receive(name, {"method": "custom", "content": content})


def act(app: Application, what: str, ids: list[int], picture: int | None = None, **more: Any) -> None:
    """As a page whose user does something in the table."""
    content = {"type": "act", "view": "page", "seq": 1, "what": what, "ids": ids, **more}
    app.receive("points", {"method": "custom", "content": content}, picture)


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)


def test_the_page_can_draw_all_of_them(app: Application) -> None:
    assert list(app.widgets) == list(WIDGETS)
    for name, widget in app.widgets.items():
        assert isinstance(widget, WIDGETS[name])


def test_a_curve_is_one_edit_and_the_volume_moves_before_it(app: Application) -> None:
    session = app.session
    session.edit_points(session.points.move(0, session.points.target[0] + 2.0))
    app.set("extrusion", "modulate")
    assert app.parts.widgets["curve"].curve == "z"
    document, places = session.deformation, session.volume.grid.corners() * 0.4
    before = app.live._field.displacement(places)
    edit(app, "curve", {"nodes": TENT, "smooth": False}, phase="move")
    until(lambda: np.abs(app.live._field.displacement(places) - before).max() > 0.1)
    assert session.deformation is document
    moved = app.live._field.displacement(places)
    edit(app, "curve", {"nodes": TENT, "smooth": False}, seq=2)
    assert session.step.curve == (1.0, 1.0, 0.0)
    assert app.state()["undo"] == "change curve"
    np.testing.assert_allclose(app.live._field.displacement(places), moved, atol=1e-6)
    app.act("undo")
    assert app.parts.widgets["curve"].curve == "z"
    np.testing.assert_allclose(app.live._field.displacement(places), before, atol=1e-6)


def test_a_formula_that_is_wrong_is_said_where_it_was_written_and_nothing_changes(app: Application) -> None:
    app.set("extrusion", "modulate")
    said: list[Any] = []
    app.widgets["curve"].comm = LocalComm(lambda data, buffers: said.append(data.get("content")))
    document = app.session.deformation
    edit(app, "curve", {"formula": "import os"})
    assert [m["type"] for m in said if m] == ["error", "done"]
    assert app.session.deformation is document
    edit(app, "curve", {"formula": "z*z"}, seq=2)
    assert app.session.step.curve == "z*z"


def test_keys_are_chosen_moved_and_added(app: Application) -> None:
    app.set("extrusion", "interpolate")
    keys = app.widgets["keys"]
    assert keys.knots == (0.0, 0.5, 1.0)
    edit(app, "keys", {"kind": "select", "index": 2, "knots": [0, 0.5, 1], "selected": 2})
    assert (app.session.key, app.live.editor_map) == (2, 2)
    app.editor.points = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    first, _, last = app.session.step.maps
    assert not first.displacement.any()
    np.testing.assert_allclose(last.displacement[0], [-2.0, -2.0])
    edit(app, "keys", {"kind": "add", "index": 1, "knots": [0, 0.25, 0.5, 1], "selected": 1}, seq=2)
    assert (app.session.step.knots, keys.knots, keys.selected) == ((0.0, 0.25, 0.5, 1.0),) * 2 + (1,)
    edit(app, "keys", {"kind": "move", "index": 1, "knots": [0, 0.3, 0.5, 1], "selected": 1}, seq=3)
    assert app.state()["undo"] == "move a key"
    app.act("undo")
    assert keys.knots == (0.0, 0.25, 0.5, 1.0)


def test_colours_follow_the_hand_and_stay_where_it_ends(app: Application) -> None:
    bone, before = preset("bone", app.session.volume), app.live.table
    edit(app, "colours", {"preset": "bone"}, phase="move")
    assert app.live.table != before
    assert app.session.transfer == "specimen"
    edit(app, "colours", {"preset": "bone"}, seq=2)
    assert app.session.transfer_function == bone
    assert "bone" in repr(app.widgets["colours"])


def test_a_session_that_is_opened_brings_its_colours(app: Application) -> None:
    other, before = Session(app.session.volume, view="+y", transfer="xray"), app.live.table
    app.open(to_json(other.document()))
    assert app.session.transfer == "xray"
    assert app.live.table != before
    assert "xray" in repr(app.widgets["colours"])


def test_names_and_coordinates_are_written_into_the_table(app: Application) -> None:
    act(app, "cell", [1], field="name", axis=0, value="nose")
    assert app.editor.points.names[1] == "nose"
    act(app, "cell", [1], field="target", axis=0, value="1.5")
    assert app.editor.points.target[1, 0] == 1.5
    assert app.state()["facts"].startswith("4 points, 1 moved")
    act(app, "lock", [1])
    assert app.session.points.locked[1]
    act(app, "cell", [1], field="target", axis=0, value="2.5")
    assert "is locked" in app.error
    assert app.editor.points.target[1, 0] == 1.5
    app.editor.selected = [3]
    assert app.widgets["points"].selected == [3]


def test_the_table_shows_the_points_while_somebody_sees_it(app: Application) -> None:
    table = app.widgets["points"]
    assert table.ids == []
    act(app, "seen", [], value=True)
    assert table.ids == [0, 1, 2, 3]
    app.editor.points = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    numbers = np.frombuffer(table.numbers, "<f8").reshape(4, 7)
    np.testing.assert_allclose(numbers[0, 2:4] - numbers[0, :2], 2.0)


def test_what_was_written_for_the_points_of_another_side_is_refused(app: Application) -> None:
    late = app.pictures
    app.set("view", "-x")
    points = app.session.points
    act(app, "cell", [1], late, field="name", axis=0, value="nose")
    assert "was being replaced" in app.error
    assert app.session.points == points
    act(app, "cell", [1], app.pictures, field="name", axis=0, value="nose")
    assert app.session.points.names[1] == "nose"


def test_what_is_cut_away_is_cut_in_pages_pictures_and_files(app: Application, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.test_volumes import Scene, ask

    scene = Scene([])
    monkeypatch.setattr("deformnb.app.volumes.make_scene", lambda *given, **looks: (scene, ""))
    app.volumes.serve(app.fail, lambda data, about: None)
    half, whole = ((0.0, 1.0), (0.0, 0.5), (0.0, 1.0)), ((0.0, 1.0),) * 3
    app.receive("live", {"method": "update", "state": {"clip": half}, "buffer_paths": []})
    assert app.volumes.seen().clip == half
    ask(app)
    until(lambda: scene.looks.get("clip") == half)
    app.receive("live", {"method": "update", "state": {"clip": whole}, "buffer_paths": []})
    until(lambda: scene.looks["clip"] == whole)


def test_what_is_opened_towards_the_viewer_is_seen_in_the_pictures(app: Application,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    from app.test_volumes import Scene, ask

    monkeypatch.setattr("deformnb.app.volumes.make_scene", lambda *given, **looks: (Scene([]), ""))
    remote = app.volumes.serve(app.fail, lambda data, about: None)
    ask(app)
    before = dict(app.live.camera)
    at = {"w": 64, "h": 48, "y": 10}
    remote.on_event({"type": "LeftButtonPress", "x": 10, **at})
    remote.on_event({"type": "MouseMove", "x": 40, **at})
    assert app.live.camera == before  # pages that draw by themselves are not shaken by every movement
    remote.on_event({"type": "LeftButtonRelease", "x": 40, **at})
    until(lambda: app.live.camera == remote.camera)
    assert app.live.camera != before
    app.volumes.look("home")
    until(lambda: app.live.camera["direction"] == remote.camera["direction"])


def step_act(app: Application, what: str, index: int, value: Any = None) -> None:
    """As a page whose user does something in the list of steps."""
    content = {"type": "act", "what": what, "index": index, "value": value, "version": app.widgets["steps"].version}
    app.receive("steps", {"method": "custom", "content": content})


def test_steps_are_added_named_switched_and_gone_back_to(app: Application) -> None:
    app.editor.points = first = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    app.act("add_step")
    assert (app.session.index, app.state()["several"]) == (1, True)
    assert not app.editor.points.displacement.any()
    step_act(app, "rename", 0, "bend")
    step_act(app, "switch", 0, False)
    assert [(s.name, s.enabled) for s in app.session.deformation.steps] == [("bend", False), ("", True)]
    assert [row["name"] for row in app.widgets["steps"].rows] == ["bend", ""]
    step_act(app, "choose", 0)
    assert app.editor.points == first
    app.set("mode", "blend")
    assert (app.session.deformation.mode, app.state()["mode"]) == ("blend", "blend")
    step_act(app, "remove", 1)
    assert not app.state()["several"]


def test_points_in_space_are_left_to_a_studio(app: Application) -> None:
    app.session.add_step(in_space=True)
    app.session.edit_step(0)
    app.act("front")
    step_act(app, "choose", 1)
    assert app.session.index == 0
    assert app.session.step.plane is not None
    assert "in a studio" in app.state()["notice"]
    assert app.error == ""
    other = Session(app.session.volume, view="+y")
    other.add_step(in_space=True)
    app.open(to_json(other.document()))
    assert app.session.step.plane is not None
    assert len(app.session.deformation.steps) == 2


def test_what_the_hand_of_a_page_was_doing_goes_with_the_page(app: Application) -> None:
    session, places = app.session, app.session.volume.grid.corners() * 0.4
    session.edit_points(session.points.move(0, session.points.target[0] + 2.0))
    app.set("extrusion", "modulate")
    field, table = app.live._field.displacement(places), app.live.table
    edit(app, "curve", {"nodes": TENT, "smooth": False}, phase="move")
    edit(app, "colours", {"preset": "bone"}, phase="move")
    until(lambda: np.abs(app.live._field.displacement(places) - field).max() > 0.1)
    assert app.live.table != table
    app.give_up()
    np.testing.assert_allclose(app.live._field.displacement(places), field, atol=1e-6)
    assert app.live.table == table


def test_the_volume_turns_with_the_picture_however_that_was_chosen(app: Application) -> None:
    app.editor.points = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    app.set("view", "-x")
    app.editor.points = app.editor.points.move(1, app.editor.points.target[1] - 1.0)
    directions = {"+y": (0, 1, 0), "-x": (-1, 0, 0)}
    for go, side in ((lambda: step_act(app, "choose", 0), "+y"), (lambda: step_act(app, "choose", 1), "-x"),
                     (lambda: (app.act("undo"), app.act("undo")), "+y"), (lambda: app.act("redo"), "-x")):
        go()
        assert app.state()["view"] == side
        np.testing.assert_allclose(app.live.camera["direction"], directions[side], atol=1e-12)
    app.live.set_camera([0.6, 0.0, 0.8])
    step_act(app, "choose", 0)
    np.testing.assert_allclose(app.live.camera["direction"], [0.6, 0.0, 0.8], atol=1e-12)  # somebody has turned it
