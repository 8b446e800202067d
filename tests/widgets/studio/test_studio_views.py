"""Any view as the picture: the camera of a studio's view makes the plane of a step, which is shown in the view."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from studio_driver import a_drag, a_volume, controls, drag, get_notice, wait_for

from deformnb.volume.plane import Plane
from deformnb.widgets import LiveView, Studio
from deformnb.widgets.camera import checked_camera

CAMERA = checked_camera({"direction": (0.7, 1.0, -0.45), "up": (0.0, 0.1, 1.0), "zoom": 1.4, "pan": (1.0, 2.0)})


@pytest.fixture
def studio() -> Iterator[Studio]:
    made = Studio(a_volume(), side="+y")
    made.wait()
    yield made
    made.close()


def edit_view(studio: Studio, camera: dict[str, Any]) -> None:
    """The button of a front end, which has written its camera before."""
    studio.view.camera = camera
    deliver(studio.view, {"type": "edit_view", "view": "v", "camera": camera})
    studio.wait()


def side_menu(studio: Studio) -> Any:
    return controls(studio)["Side"]


def test_the_button_makes_the_picture_of_the_camera_and_moves_nothing(studio: Studio) -> None:
    before = dict(studio.view.camera)
    assert (studio.view.picture_plane["name"], studio.view.picture_plane["side"]) == ("from the front", True)
    edit_view(studio, {**CAMERA, "perspective": True})
    plane = studio.session.editing.plane
    assert_allclose(plane.normal, np.divide(CAMERA["direction"], np.linalg.norm(CAMERA["direction"])), atol=1e-12)
    assert studio.editor.picture.plane == plane
    assert studio.session.steps.titles() == ["view 1"]
    assert not studio.view.camera.get("perspective")  # picture and volume coincide
    assert {name: studio.view.camera[name] for name in ("direction", "up", "pan", "zoom")} == {
        name: CAMERA[name] for name in ("direction", "up", "pan", "zoom")
    }
    shown = studio.view.picture_plane
    assert (shown["name"], shown["named"], shown["side"], shown["editable"]) == ("view 1", False, False, True)
    assert_allclose(shown["direction"], plane.normal)
    corners = plane.to_plane(shown["corners"])
    assert_allclose(corners[:, 2], 0, atol=1e-9)
    flat = plane.to_plane(studio.volume.grid.corners())[:, :2]
    assert_allclose(corners[[0, 2], :2], [flat.min(axis=0), flat.max(axis=0)])
    assert side_menu(studio).label == "view 1"
    studio.session.set_back()
    studio.wait()
    assert studio.session.steps.view == "+y"
    assert not np.allclose(studio.view.camera["direction"], CAMERA["direction"])
    assert_allclose(studio.view.camera["direction"], before["direction"])


def test_the_menu_of_sides_leads_back_to_each_view(studio: Studio) -> None:
    edit_view(studio, CAMERA)
    drag(studio, a_drag(studio))
    first = studio.session.editing.plane
    studio.edit_view((0.1, 0.4, 1.0))
    studio.wait()
    assert get_notice(studio).count("Step 2 begins, view 2.") == 1
    drag(studio, a_drag(studio))
    menu = side_menu(studio)
    assert [label for label, _ in menu.options[-2:]] == ["view 1", "view 2"]
    menu.value = next(value for label, value in menu.options if label == "view 1")
    studio.wait()
    assert (studio.session.editing.index, studio.editor.picture.plane) == (0, first)
    assert_allclose(studio.view.camera["direction"], first.normal)  # straight: they coincide
    studio.session.steps.rename(0, "jaw")
    assert (studio.view.picture_plane["name"], studio.view.picture_plane["named"]) == ("jaw", True)
    studio.session.steps.add(in_space=True)
    wait_for(lambda: studio.view.picture_plane["name"] == "in space")
    assert studio.view.picture_plane["corners"] == []
    assert menu.label == "in space"


def test_the_frame_is_at_the_slice_that_the_picture_shows(studio: Studio) -> None:
    edit_view(studio, CAMERA)
    studio.session.pictures.method = "slice"
    studio.wait()
    slices = studio.session.pictures.slices
    studio.editor.slice = 3
    studio.wait()
    plane = studio.session.editing.plane
    assert_allclose(plane.to_plane(studio.view.picture_plane["corners"])[:, 2], slices.depth(3))


def test_the_panel_turns_by_degrees_sets_back_and_hides_the_frame(studio: Studio) -> None:
    panel = next(
        section.panel.panel for section in studio.parts.panels.groups["View"] if section.panel.title == "View plane"
    )
    front = studio.session.editing.plane
    panel.angles["right"].value, panel.angles["up"].value = 30.0, 10.0
    panel.turn.click()
    studio.wait()
    direction, up = front.turned_directions(up=10.0, right=30.0)
    expected = Plane.from_normal(studio.volume.grid.center, direction, up)
    assert studio.session.editing.plane.has_same_directions(expected)
    assert [widget.value for widget in panel.angles.values()] == [0.0, 0.0, 0.0]
    frame = controls(studio)["Frame"]
    panel.refresh()
    assert frame.value is True
    frame.value = False
    assert studio.view.plane_frame is False
    panel.back.click()
    studio.wait()
    assert studio.session.steps.view == "+y"


def test_a_page_without_python_has_the_frame_and_no_button(studio: Studio, tmp_path: Path) -> None:
    from deformnb.widgets.studio.studio import last_step

    edit_view(studio, CAMERA)
    drag(studio, a_drag(studio))
    editor, view = last_step(studio.session, studio.parts.editors.plane, studio.view)
    assert editor.picture.plane == studio.session.editing.plane
    assert (view.picture_plane["name"], view.picture_plane["editable"]) == ("view 1", False)
    editor.close()
    view.close()
    studio.export_html(tmp_path / "page.html", limit=20_000)
    assert '"view 1"' in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.needs_gl
def test_views_by_vtk_take_the_wish_too() -> None:
    studio = Studio(a_volume(), side="+y", view="vtk")
    edit_view(studio, CAMERA)
    assert studio.session.steps.titles() == ["view 1"]
    studio.close()


def test_a_view_alone_answers_nothing() -> None:
    view = LiveView(a_volume())
    deliver(view, {"type": "edit_view", "view": "v", "camera": CAMERA})
    assert view.picture_plane == {}
    seen: list[Any] = []

    def take(camera: Any, part: Any) -> None:
        seen.append((camera, part))

    view.on_edit_view(take)
    deliver(view, {"type": "drawn", "view": "v", "say": {"type": "edit_view", "view": "v", "camera": CAMERA}})
    deliver(view, {"type": "edit_view", "view": "v", "camera": CAMERA, "middle": [1.0, 2.0, 3.0], "scale": 2.5})
    assert seen == [(CAMERA, None), (CAMERA, ((1.0, 2.0, 3.0), 2.5))]
    view.on_edit_view(take, remove=True)
    deliver(view, {"type": "edit_view", "view": "v", "camera": CAMERA})
    assert len(seen) == 2


def test_the_picture_shows_the_part_that_the_view_shows(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []
    monkeypatch.setattr(studio.editor, "post", lambda message, buffers=(): sent.append(message.content()))
    place = studio.volume.grid.index_to_point([20.0, 3.0, 9.0])
    studio.view.camera = CAMERA
    wish = {"type": "edit_view", "view": "v", "camera": CAMERA, "middle": place.tolist(), "scale": 9.0}
    for _ in range(2):  # the second time it is the picture already
        sent.clear()
        deliver(studio.view, wish)
        studio.wait()
        assert_seen_part(studio, sent, place)
    studio.session.set_back()
    studio.wait()
    assert [message for message in sent if message["type"] == "see"][-1]["middle"] is None  # all of it


def assert_seen_part(studio: Studio, sent: list[Any], place: NDArray[np.float64]) -> None:
    """The last message on the part that is seen: its middle is this place."""
    last = [message for message in sent if message["type"] == "see"][-1]
    assert last["middle"] is not None
    assert_allclose(last["middle"], studio.session.editing.plane.to_plane(place)[:2])
    assert last["scale"] == 9.0


def test_a_picture_that_is_made_at_once_shows_the_part_too(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []
    monkeypatch.setattr(studio.editor, "post", lambda message, buffers=(): sent.append(message.content()))
    picture, worker = studio.parts.picture, studio.parts.worker
    turn = picture.turn

    def turn_late() -> None:
        if not worker.is_current_thread:  # the thread that makes the picture is quicker than that of the wish
            studio.wait()
        turn()

    monkeypatch.setattr(picture, "turn", turn_late)
    place = studio.volume.grid.index_to_point([20.0, 3.0, 9.0])
    studio.view.camera = CAMERA
    deliver(studio.view, {"type": "edit_view", "view": "v", "camera": CAMERA, "middle": place.tolist(), "scale": 9.0})
    studio.wait()
    assert_seen_part(studio, sent, place)


def test_the_part_of_one_picture_is_not_shown_of_another(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []
    monkeypatch.setattr(studio.editor, "post", lambda message, buffers=(): sent.append(message.content()))
    is_made = threading.Event()
    studio.parts.worker.call(is_made.wait)
    place = studio.volume.grid.index_to_point([20.0, 3.0, 9.0])
    studio.view.camera = CAMERA
    deliver(studio.view, {"type": "edit_view", "view": "v", "camera": CAMERA, "middle": place.tolist(), "scale": 9.0})
    side_menu(studio).value = "+z"
    is_made.set()
    studio.wait()
    assert [message["middle"] for message in sent if message["type"] == "see"] == [None]


def test_the_editor_shows_the_deformed_volume_where_depth_matters(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    studio.wait()
    assert studio.editor.deformed_picture is None  # the picture itself, deformed
    studio.session.editing.change(extrusion="modulate", curve="1-z")
    studio.wait()
    first = studio.editor.deformed_picture
    assert first is not None
    assert_array_equal(first.values, studio.session.pictures.deformed_picture().values)
    drag(studio, a_drag(studio, 4.0))
    studio.wait()
    second = studio.editor.deformed_picture
    assert not np.array_equal(second.values, first.values)
    assert studio.editor.deformed["points"] == studio.editor.get_state("points")["points"]
    studio.session.pictures.window = (0.0, 100.0)
    studio.wait()
    assert studio.editor.deformed_picture.window == (0.0, 100.0)
    edit_view(studio, CAMERA)  # another step, on which nothing is dragged
    assert studio.editor.deformed_picture is None


@pytest.mark.parametrize("in_space", [False, True])
def test_a_studio_opens_with_a_step_on_an_oblique_view_and_in_space(studio: Studio, in_space: bool) -> None:
    edit_view(studio, CAMERA)
    drag(studio, a_drag(studio))
    if in_space:
        studio.session.steps.add(in_space=True)
    again = Studio(a_volume(), studio.deformation)
    again.wait()
    assert side_menu(again).label == ("in space" if in_space else "view 1")
    assert again.session.steps.titles() == studio.session.steps.titles()
    again.close()
