"""The volume of the application while a hand drags: what pages cannot do by themselves is done here, newest first."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, edit_of

from deformnb.app.application import Application
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.session.session import Session
from deformnb.widgets.protocol import points_to_json
from deformnb.widgets.synced import LocalComm
from deformnb.widgets.vtk.folds import Folding

SIZE = {"w": 64, "h": 48, "p": 1}


class Scene:
    """Notes the displacement that it is to show."""

    def __init__(self, fields: list[Any]) -> None:
        self.fields, self.looks, self.folding = fields, {}, Folding()

    def set_field(self, field: Any, output: Any = None) -> None:
        self.fields.append(field)

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("set_"):
            raise AttributeError(name)
        return lambda value: self.looks.update({name[4:]: value})

    def render(self, **options: Any) -> Any:
        return np.zeros((8, 8, 3), np.uint8)

    def close(self) -> None:
        pass


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)


@pytest.fixture
def app() -> Iterator[Application]:
    made = Application(Session(PHANTOMS["bar"].make((12, 16, 20)), view="+y"))
    made.editor.comm = LocalComm(lambda data, buffers: None)
    yield made
    made.close()


@pytest.fixture
def scene(app: Application, monkeypatch: pytest.MonkeyPatch) -> Scene:
    """What is drawn here, for an application that can be asked for pictures."""
    made = Scene([])
    monkeypatch.setattr("deformnb.app.volumes.make_scene", lambda *given, **looks: (made, "VTK cannot draw here."))
    app.volumes.serve(app.fail, lambda data, about: None)
    return made


def ask(app: Application) -> None:
    """As a page that gets pictures."""
    assert app.volumes.remote is not None
    app.volumes.remote.update_size(SIZE)
    app.volumes.wake()


def moved(app: Application, by: float, *, seq: int, phase: str = "move", point: int = 0) -> list[float]:
    """The hand has moved a point so far to the right; returns where it is."""
    points = points_to_json(app.session.points)
    points[point]["target"] = [points[point]["source"][0] + by, points[point]["source"][1]]
    app.receive("editor", {"method": "custom", "content": edit_of(points, seq, phase)})
    target: list[float] = points[point]["target"]
    return target


def way_at(app: Application, field: Any, target: list[float]) -> float:
    """How far matter at a place of the picture has come from the left."""
    place = app.session.plane.from_plane(target)
    back = np.asarray(field.displacement(place[None]))[0]
    return float(-back @ np.asarray(app.session.plane.u))


def test_pictures_follow_a_hand_before_it_lets_go(app: Application, scene: Scene) -> None:
    assert not app.editor.live  # pages that render hear of the hand by themselves
    ask(app)
    until(lambda: scene.fields)
    assert app.editor.live
    for seq, by in enumerate((1.0, 2.0, 3.0), 1):
        target = moved(app, by, seq=seq)
        until(lambda by=by, target=target: way_at(app, scene.fields[-1], target) == pytest.approx(by, abs=1e-3))
    assert not app.session.points.displacement.any()
    target = moved(app, 3.5, seq=4, phase="end")
    until(lambda: way_at(app, scene.fields[-1], target) == pytest.approx(3.5, abs=1e-3))
    assert app.session.points.displacement[0, 0] == -3.5
    app.act("undo")
    until(lambda: abs(way_at(app, scene.fields[-1], target)) < 1e-6)


def test_an_edit_that_is_refused_leaves_the_pictures_as_they_were(app: Application, scene: Scene) -> None:
    ask(app)
    target = moved(app, 2.0, seq=1, phase="end")
    until(lambda: scene.fields and way_at(app, scene.fields[-1], target) == pytest.approx(2.0, abs=1e-3))
    points = points_to_json(app.session.points)
    points[1]["target"] = points[0]["target"]  # two features asked to be in one place
    app.receive("editor", {"method": "custom", "content": edit_of(points, 2, "end")})
    assert "at the same place" in app.error
    assert app.volumes.remote is not None
    app.volumes.remote._loop.do(lambda scene: None).result(PATIENCE)
    assert way_at(app, scene.fields[-1], target) == pytest.approx(2.0, abs=1e-3)


def _two_pictures(app: Application) -> None:
    app.session.edit_points(app.session.points.move(0, app.session.points.target[0] + 1.0))
    app.set("view", "-x")
    app.session.edit_points(app.session.points.move(1, app.session.points.target[1] + 1.0))
    app.set("view", "+y")
    assert (app.session.index, len(app.session.deformation.steps)) == (0, 2)


def test_a_drag_in_an_earlier_picture_is_seen_while_the_hand_moves(app: Application) -> None:
    _two_pictures(app)
    assert app.live.editor is None  # a page cannot do it by itself
    before, held = app.session.deformation, app.live._field
    moved(app, 3.0, seq=1, point=2)
    until(lambda: app.link.previews == 1)
    assert app.live._field is not held
    assert app.session.deformation == before
    places = app.session.volume.grid.corners() * 0.4
    change = app.live._field.displacement(places) - held.displacement(places)
    moved(app, 3.0, seq=2, phase="end", point=2)
    np.testing.assert_allclose(app.session.field().displacement(places) - held.displacement(places), change, atol=1e-6)
    assert np.abs(change).max() > 0.1


def test_the_same_drag_is_seen_in_pictures(app: Application, scene: Scene) -> None:
    _two_pictures(app)
    ask(app)
    until(lambda: scene.fields)
    before = scene.fields[-1]
    places = app.session.volume.grid.corners() * 0.4
    moved(app, 3.0, seq=1, point=2)
    until(lambda: np.abs(scene.fields[-1].displacement(places) - before.displacement(places)).max() > 0.1)


def test_what_is_drawn_here_looks_as_the_desk_says_and_tells_why_it_is_slow(app: Application, scene: Scene) -> None:
    ask(app)
    until(lambda: scene.fields)
    app.set("projection", "mip")
    app.volumes.set_transfer("bone")
    app.set("shows", "side_by_side")
    app.set("show_folds", False)
    until(lambda: scene.looks.get("shows") == "side_by_side" and not scene.folding.show)
    assert {name: scene.looks[name] for name in ("projection", "transfer")} == {"projection": "mip", "transfer": "bone"}
    app.thread.call(lambda: None).result(PATIENCE)
    assert app.state()["notice"] == "VTK cannot draw here."


def test_a_desk_that_closes_hears_no_hand(app: Application, scene: Scene) -> None:
    ask(app)
    assert app.editor.live
    app.close()
    assert not app.editor.live


def test_a_drag_on_a_picture_that_is_being_replaced_is_no_edit_of_the_next_one(app: Application, scene: Scene) -> None:
    ask(app)
    told: list[Any] = []
    app.editor.comm = LocalComm(lambda data, buffers: told.append(data))
    before = app.pictures
    points = points_to_json(app.session.points)
    points[0]["target"] = [points[0]["target"][0] + 3.0, points[0]["target"][1]]
    app.set("view", "-x")  # asked for first; the hand was already dragging
    waits = [data["state"]["waiting"] for data in told if "waiting" in data.get("state", {})]
    assert waits == ["The picture is being made", ""]
    kept = app.session.deformation
    for seq, phase in ((1, "move"), (2, "end")):
        app.receive("editor", {"method": "custom", "content": edit_of(points, seq, phase)}, before)
    assert app.session.deformation == kept
    assert "drag it again" in app.error
    assert app.editor.points == app.session.points
    answers = [data["content"]["seq"] for data in told if data.get("content", {}).get("type") == "done"]
    assert answers == [1, 2]  # or the page would wait
    assert app.editor.seen == {"window": 2}
    assert app.volumes.remote is not None
    app.volumes.remote._loop.do(lambda scene: None).result(PATIENCE)
    places = app.session.volume.grid.corners() * 0.4
    np.testing.assert_allclose(scene.fields[-1].displacement(places), 0, atol=1e-9)
    moved(app, 2.0, seq=3, phase="end")  # on the new one
    assert app.error == ""
    assert app.session.points.displacement[0, 0] == -2.0


def test_the_page_waits_only_where_another_picture_is_made(app: Application) -> None:
    shown: list[str] = []
    app.editor.observe(lambda change: shown.append(change["new"]), "waiting")
    app.set("kernel", "gaussian")
    moved(app, 2.0, seq=1, phase="end")
    assert shown == []  # edits of points need no other picture
    count = app.pictures
    app.set("method", "mean")
    assert shown == ["The picture is being made", ""]
    assert app.pictures == count  # the same points on it
    app.set("extrusion", "interpolate")
    app.session.edit_step(0, 2)
    app.act("front")
    assert app.pictures > count
