"""The smaller widgets of the application: what is done in them is an edit, and they show what the session holds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE

from deformnb.app.bridge import PageComm
from deformnb.app.desk import Desk
from deformnb.app.parts import WIDGETS
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.json_format import to_json
from deformnb.session.session import Session
from deformnb.volume.transfer import preset

TENT = [[0.0, 1.0], [0.5, 1.0], [1.0, 0.0]]


@pytest.fixture
def desk() -> Iterator[Desk]:
    made = Desk(Session(PHANTOMS["bar"].make((12, 16, 20)), view="+y"))
    for widget in made.widgets.values():
        widget.comm = PageComm(lambda data, buffers: None)
    yield made
    made.close()


def edit(desk: Desk, name: str, value: Any, *, phase: str = "end", seq: int = 1) -> None:
    """As a page whose hand has changed the value of a small widget."""
    content = {"type": "edit", "seq": seq, "view": "page", "phase": phase, "value": value}
    desk.receive(name, {"method": "custom", "content": content})


def act(desk: Desk, what: str, ids: list[int], picture: int | None = None, **more: Any) -> None:
    """As a page whose user does something in the table."""
    content = {"type": "act", "view": "page", "seq": 1, "what": what, "ids": ids, **more}
    desk.receive("points", {"method": "custom", "content": content}, picture)


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)


def test_the_page_can_draw_all_of_them(desk: Desk) -> None:
    assert list(desk.widgets) == list(WIDGETS)
    for name, widget in desk.widgets.items():
        assert isinstance(widget, WIDGETS[name])


def test_a_curve_is_one_edit_and_the_volume_moves_before_it(desk: Desk) -> None:
    session = desk.session
    session.edit_points(session.points.move(0, session.points.target[0] + 2.0))
    desk.set("extrusion", "modulate")
    assert desk.parts.widgets["curve"].curve == "z"
    document, places = session.deformation, session.volume.grid.corners() * 0.4
    before = desk.live._field.displacement(places)
    edit(desk, "curve", {"nodes": TENT, "smooth": False}, phase="move")
    until(lambda: np.abs(desk.live._field.displacement(places) - before).max() > 0.1)
    assert session.deformation is document
    moved = desk.live._field.displacement(places)
    edit(desk, "curve", {"nodes": TENT, "smooth": False}, seq=2)
    assert session.step.curve == (1.0, 1.0, 0.0)
    assert desk.state()["undo"] == "change curve"
    np.testing.assert_allclose(desk.live._field.displacement(places), moved, atol=1e-6)
    desk.act("undo")
    assert desk.parts.widgets["curve"].curve == "z"
    np.testing.assert_allclose(desk.live._field.displacement(places), before, atol=1e-6)


def test_a_formula_that_is_wrong_is_said_where_it_was_written_and_nothing_changes(desk: Desk) -> None:
    desk.set("extrusion", "modulate")
    said: list[Any] = []
    desk.widgets["curve"].comm = PageComm(lambda data, buffers: said.append(data.get("content")))
    document = desk.session.deformation
    edit(desk, "curve", {"formula": "import os"})
    assert [m["type"] for m in said if m] == ["error", "done"]
    assert desk.session.deformation is document
    edit(desk, "curve", {"formula": "z*z"}, seq=2)
    assert desk.session.step.curve == "z*z"


def test_keys_are_chosen_moved_and_added(desk: Desk) -> None:
    desk.set("extrusion", "interpolate")
    keys = desk.widgets["keys"]
    assert keys.knots == (0.0, 0.5, 1.0)
    edit(desk, "keys", {"kind": "select", "index": 2, "knots": [0, 0.5, 1], "selected": 2})
    assert (desk.session.key, desk.live.editor_map) == (2, 2)
    desk.editor.points = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    first, _, last = desk.session.step.maps
    assert not first.displacement.any()
    np.testing.assert_allclose(last.displacement[0], [-2.0, -2.0])
    edit(desk, "keys", {"kind": "add", "index": 1, "knots": [0, 0.25, 0.5, 1], "selected": 1}, seq=2)
    assert (desk.session.step.knots, keys.knots, keys.selected) == ((0.0, 0.25, 0.5, 1.0),) * 2 + (1,)
    edit(desk, "keys", {"kind": "move", "index": 1, "knots": [0, 0.3, 0.5, 1], "selected": 1}, seq=3)
    assert desk.state()["undo"] == "move a key"
    desk.act("undo")
    assert keys.knots == (0.0, 0.25, 0.5, 1.0)


def test_colours_follow_the_hand_and_stay_where_it_ends(desk: Desk) -> None:
    bone, before = preset("bone", desk.session.volume), desk.live.table
    edit(desk, "colours", {"preset": "bone"}, phase="move")
    assert desk.live.table != before
    assert desk.session.transfer == "specimen"
    edit(desk, "colours", {"preset": "bone"}, seq=2)
    assert desk.session.transfer_function == bone
    assert "bone" in repr(desk.widgets["colours"])


def test_a_session_that_is_opened_brings_its_colours(desk: Desk) -> None:
    other, before = Session(desk.session.volume, view="+y", transfer="xray"), desk.live.table
    desk.open(to_json(other.document()))
    assert desk.session.transfer == "xray"
    assert desk.live.table != before
    assert "xray" in repr(desk.widgets["colours"])


def test_names_and_coordinates_are_written_into_the_table(desk: Desk) -> None:
    act(desk, "cell", [1], field="name", axis=0, value="nose")
    assert desk.editor.points.names[1] == "nose"
    act(desk, "cell", [1], field="target", axis=0, value="1.5")
    assert desk.editor.points.target[1, 0] == 1.5
    assert desk.state()["facts"].startswith("4 points, 1 moved")
    act(desk, "lock", [1])
    assert desk.session.points.locked[1]
    act(desk, "cell", [1], field="target", axis=0, value="2.5")
    assert "is locked" in desk.error
    assert desk.editor.points.target[1, 0] == 1.5
    desk.editor.selected = [3]
    assert desk.widgets["points"].selected == [3]


def test_the_table_shows_the_points_while_somebody_sees_it(desk: Desk) -> None:
    table = desk.widgets["points"]
    assert table.ids == []
    act(desk, "seen", [], value=True)
    assert table.ids == [0, 1, 2, 3]
    desk.editor.points = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    numbers = np.frombuffer(table.numbers, "<f8").reshape(4, 7)
    np.testing.assert_allclose(numbers[0, 2:4] - numbers[0, :2], 2.0)


def test_what_was_written_for_the_points_of_another_side_is_refused(desk: Desk) -> None:
    late = desk.pictures
    desk.set("view", "-x")
    points = desk.session.points
    act(desk, "cell", [1], late, field="name", axis=0, value="nose")
    assert "was being replaced" in desk.error
    assert desk.session.points == points
    act(desk, "cell", [1], desk.pictures, field="name", axis=0, value="nose")
    assert desk.session.points.names[1] == "nose"


def test_what_is_cut_away_is_cut_in_pages_pictures_and_files(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.test_volumes import Scene, ask

    scene = Scene([])
    monkeypatch.setattr("deformnb.app.volumes.make_scene", lambda *given, **looks: (scene, ""))
    desk.volumes.serve(desk.fail, lambda data, about: None)
    half, whole = ((0.0, 1.0), (0.0, 0.5), (0.0, 1.0)), ((0.0, 1.0),) * 3
    desk.receive("live", {"method": "update", "state": {"clip": half}, "buffer_paths": []})
    assert desk.volumes.seen().clip == half
    ask(desk)
    until(lambda: scene.looks.get("clip") == half)
    desk.receive("live", {"method": "update", "state": {"clip": whole}, "buffer_paths": []})
    until(lambda: scene.looks["clip"] == whole)


def test_what_is_opened_towards_the_viewer_is_seen_in_the_pictures(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.test_volumes import Scene, ask

    monkeypatch.setattr("deformnb.app.volumes.make_scene", lambda *given, **looks: (Scene([]), ""))
    remote = desk.volumes.serve(desk.fail, lambda data, about: None)
    ask(desk)
    before = dict(desk.live.camera)
    at = {"w": 64, "h": 48, "y": 10}
    remote.on_event({"type": "LeftButtonPress", "x": 10, **at})
    remote.on_event({"type": "MouseMove", "x": 40, **at})
    assert desk.live.camera == before  # pages that draw by themselves are not shaken by every movement
    remote.on_event({"type": "LeftButtonRelease", "x": 40, **at})
    until(lambda: desk.live.camera == remote.camera)
    assert desk.live.camera != before
    desk.volumes.look("home")
    until(lambda: desk.live.camera["direction"] == remote.camera["direction"])


def step_act(desk: Desk, what: str, index: int, value: Any = None) -> None:
    """As a page whose user does something in the list of steps."""
    content = {"type": "act", "what": what, "index": index, "value": value, "version": desk.widgets["steps"].version}
    desk.receive("steps", {"method": "custom", "content": content})


def test_steps_are_added_named_switched_and_gone_back_to(desk: Desk) -> None:
    desk.editor.points = first = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    desk.act("add_step")
    assert (desk.session.index, desk.state()["several"]) == (1, True)
    assert not desk.editor.points.displacement.any()
    step_act(desk, "rename", 0, "bend")
    step_act(desk, "switch", 0, False)
    assert [(s.name, s.enabled) for s in desk.session.deformation.steps] == [("bend", False), ("", True)]
    assert [row["name"] for row in desk.widgets["steps"].rows] == ["bend", ""]
    step_act(desk, "choose", 0)
    assert desk.editor.points == first
    desk.set("mode", "blend")
    assert (desk.session.deformation.mode, desk.state()["mode"]) == ("blend", "blend")
    step_act(desk, "remove", 1)
    assert not desk.state()["several"]


def test_points_in_space_are_left_to_a_studio(desk: Desk) -> None:
    desk.session.add_step(in_space=True)
    desk.session.edit_step(0)
    desk.act("front")
    step_act(desk, "choose", 1)
    assert desk.session.index == 0
    assert desk.session.step.plane is not None
    assert "in a studio" in desk.state()["notice"]
    assert desk.error == ""
    other = Session(desk.session.volume, view="+y")
    other.add_step(in_space=True)
    desk.open(to_json(other.document()))
    assert desk.session.step.plane is not None
    assert len(desk.session.deformation.steps) == 2


def test_what_the_hand_of_a_page_was_doing_goes_with_the_page(desk: Desk) -> None:
    session, places = desk.session, desk.session.volume.grid.corners() * 0.4
    session.edit_points(session.points.move(0, session.points.target[0] + 2.0))
    desk.set("extrusion", "modulate")
    field, table = desk.live._field.displacement(places), desk.live.table
    edit(desk, "curve", {"nodes": TENT, "smooth": False}, phase="move")
    edit(desk, "colours", {"preset": "bone"}, phase="move")
    until(lambda: np.abs(desk.live._field.displacement(places) - field).max() > 0.1)
    assert desk.live.table != table
    desk.give_up()
    np.testing.assert_allclose(desk.live._field.displacement(places), field, atol=1e-6)
    assert desk.live.table == table


def test_the_volume_turns_with_the_picture_however_that_was_chosen(desk: Desk) -> None:
    desk.editor.points = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    desk.set("view", "-x")
    desk.editor.points = desk.editor.points.move(1, desk.editor.points.target[1] - 1.0)
    directions = {"+y": (0, 1, 0), "-x": (-1, 0, 0)}
    for go, side in ((lambda: step_act(desk, "choose", 0), "+y"), (lambda: step_act(desk, "choose", 1), "-x"),
                     (lambda: (desk.act("undo"), desk.act("undo")), "+y"), (lambda: desk.act("redo"), "-x")):
        go()
        assert desk.state()["view"] == side
        np.testing.assert_allclose(desk.live.camera["direction"], directions[side], atol=1e-12)
    desk.live.set_camera([0.6, 0.0, 0.8])
    step_act(desk, "choose", 0)
    np.testing.assert_allclose(desk.live.camera["direction"], [0.6, 0.0, 0.8], atol=1e-12)  # somebody has turned it
