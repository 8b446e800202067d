"""The brush in the slices of the editor in space and in the volume, with the real mouse and keys in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_script
from browser.test_space_editor_page import PAGE, Opened, waves
from browser.test_space_hand import AXIAL, CORONAL, MIDDLE, mirrored, press
from browser.test_space_points_page import POINTS, ball

from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import slice_folds
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

CENTER = np.array([MIDDLE, 38.0, 24.0])
RADIUS = 8.0


@pytest.fixture
def open_editor(page: LivePage) -> Iterator[Callable[..., Opened]]:
    spaces: list[Opened] = []

    def make(points: ControlPoints | None = None, **settings: Any) -> Opened:
        options = {"support": 40.0, "brush_radius": RADIUS, "show_grid": False, **settings}
        spaces.append(Opened(page, SpaceEditor(waves(), points, cursor=CENTER.tolist(), **options)))
        return spaces[-1]

    yield make
    for space in spaces:
        space.editor.close()
    assert page.errors == []


def start(space: Opened, tool: str) -> None:
    space.page.page.locator(f"[data-command={tool}]").click()
    space.page.wait(f"{PAGE}.parts.brush.tool === '{tool}' && !{PAGE}.frames.request")


def stroke(space: Opened, pane: int, place: Any, by: tuple[float, float], *, release: bool = True) -> None:
    x, y = space.to_screen(pane, place)
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(x + by[0], y + by[1], steps=6)
    if release:
        space.mouse.up()
        space.wait_settled()


def test_a_stroke_moves_the_tissue_under_it_as_one_edit(open_editor: Any) -> None:
    space = open_editor()
    kinds: list[str] = []
    space.editor.on_edit(lambda points, phase: kinds.append(phase))
    start(space, "move")
    k = space.scale(AXIAL)
    stroke(space, AXIAL, CENTER, (4 * k, -3 * k), release=False)
    circle = space.page.page.locator(".dnb-sp-pane0 .dnb-ed-circle-line").bounding_box()
    assert circle["width"] == pytest.approx(2 * RADIUS * k, abs=2)
    assert space.page.page.locator(".dnb-sp-pane1 .dnb-ed-circle").get_attribute("visibility") == "hidden"
    assert len(space.editor.points) == 0  # the button is down: no edit has been made
    space.mouse.up()
    space.wait_settled()
    points = space.editor.points
    assert kinds.count("end") == 1
    assert set(points.names) == {"move 1"}
    field = fit_rbf(points, support=40.0)
    at = CENTER + np.array([4.0, -3.0, 0.0])
    np.testing.assert_allclose(at + field.displacement(at), CENTER, atol=1.5 / k)
    depth = np.array([0.0, 0.0, 0.6 * RADIUS])
    assert np.linalg.norm(field.displacement(at + depth)) > 0.8  # a ball: the slices beside it move as well
    assert slice_folds(field, waves().grid).least > 0.1
    press(space, "Control+z")
    assert len(space.editor.points) == 0
    press(space, "Escape")
    assert space.js(f"{PAGE}.parts.brush.tool") is None


def test_a_second_stroke_on_another_slice_has_the_next_name(open_editor: Any) -> None:
    space = open_editor()
    start(space, "move")
    stroke(space, AXIAL, CENTER, (15, 0))
    before = space.editor.points
    stroke(space, CORONAL, CENTER + np.array([0.0, 0.0, 16.0]), (0, -12))
    points = space.editor.points
    assert set(points.names) == {"move 1", "move 2"}
    moved = points.target[: len(before)] - before.target
    assert np.abs(moved[:, 1]).max() < 1e-9  # in the plane of the coronal slice
    start(space, "grow")
    stroke(space, AXIAL, CENTER + np.array([-14.0, -12.0, 0.0]), (-40, 0))
    assert "shrink 3" in space.editor.points.names


def test_grow_swells_the_ball_in_all_three_directions(open_editor: Any) -> None:
    space = open_editor()
    start(space, "grow")
    stroke(space, AXIAL, CENTER, (50, 0))
    assert set(space.editor.points.names) == {"grow 1"}
    field = fit_rbf(space.editor.points, support=40.0)
    for axis in np.eye(3):
        for sign in (1, -1):
            inward = field.displacement(CENTER + sign * 0.6 * RADIUS * axis) @ (sign * axis)
            assert -2.5 < inward < -0.4


def test_keys_and_wheel_set_the_radius_and_make_strokes(open_editor: Any) -> None:
    space = open_editor()
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "s", "]", "]")
    space.page.wait(f"Math.abs({PAGE}.parts.brush.radius - {RADIUS * 1.21}) < 1e-6")
    x, y = space.to_screen(AXIAL, CENTER)
    space.mouse.move(x, y)
    depth = space.editor.cursor[2]
    space.mouse.wheel(0, 60)
    space.page.wait(f"Math.abs({PAGE}.parts.brush.radius - {RADIUS * 1.1}) < 1e-6")
    assert space.editor.cursor[2] == depth
    press(space, "Enter", *["ArrowRight"] * 3)
    assert len(space.editor.points) == 0
    press(space, "Enter")
    points = space.editor.points
    held = np.linalg.norm(points.source - CENTER, axis=1).argmin()
    np.testing.assert_allclose((points.target - points.source)[held], [30 / space.scale(AXIAL), 0, 0], atol=0.6)
    space.page.wait(f"{PAGE}.model.get('brush_radius') > 0")
    press(space, "Escape")


def test_the_mirror_strokes_on_both_sides(open_editor: Any) -> None:
    space = open_editor(mirror={"on": True, "axis": "x", "at": MIDDLE})
    start(space, "move")
    stroke(space, AXIAL, CENTER + np.array([-15.0, 0.0, 0.0]), (0, 18))
    points = space.editor.points
    moved = points.target[np.linalg.norm(points.displacement, axis=1) > 0.5]
    assert len(moved) >= 2
    for place in mirrored(moved):
        assert np.linalg.norm(moved - place, axis=1).min() < 0.01


def test_a_stroke_stops_before_tissue_folds(open_editor: Any) -> None:
    wall = ControlPoints.from_arrays(CENTER + np.array([[5.0, dy, dz] for dy in (-4, 0, 4) for dz in (-4, 0, 4)]))
    for point in wall.ids:
        wall = wall.edit(point, locked=True)
    space = open_editor(wall)
    space.editor.tissue = {}  # everywhere
    space.wait_settled()
    start(space, "move")
    x, y = space.to_screen(AXIAL, CENTER)
    space.mouse.move(x, y)
    space.mouse.down()
    for k in range(1, 30):
        space.mouse.move(x + 0.8 * k * space.scale(AXIAL), y)
    space.page.wait(f"{message_script()}.startsWith('The brush stops before')")
    space.mouse.up()
    space.wait_settled()
    assert slice_folds(fit_rbf(space.editor.points, support=40.0), waves().grid).least > 0


def test_a_brush_works_on_the_surface_of_the_volume(page: LivePage) -> None:
    volume = ball()
    editor = SpaceEditor(volume, support=40.0, brush_radius=6.0)
    page.add(editor, "editor")
    page.wait(f"{PAGE}.parts.requests.shownCount > 0")
    view = LiveView(volume, transfer="surface", width=360, height=300, background="dark")
    view.set_camera((0, 1, 0))
    page.add(view)
    view.edit_points(editor)
    page.wait_loaded()
    page.wait(f"{POINTS}.points.isFollowing && {POINTS}.camera")
    page.page.locator("[data-command=move]").click()
    front = np.array([30.0, 10.0, 40.0])  # of the ball
    x, y = page.page.evaluate(f"(p) => {POINTS}.camera.see(p).at", front.tolist())
    scale = page.page.evaluate(f"(p) => {POINTS}.camera.see(p).scale", front.tolist())
    box = page.page.locator(".dnb-canvas").first.bounding_box()
    camera = page.page.evaluate("JSON.stringify(document.querySelector('.dnb-view').deformnb.camera.trait)")
    mouse = page.page.mouse
    mouse.move(box["x"] + x, box["y"] + y)
    ring = page.page.locator(".dnb-view .dnb-sp-brush")
    assert float(ring.get_attribute("r")) == pytest.approx(6.0 / scale, rel=0.1)
    mouse.down()
    mouse.move(box["x"] + x + 4 / scale, box["y"] + y, steps=5)
    mouse.up()
    page.wait(f"!{PAGE}.sender.isBehind()")
    page.flush()
    points = editor.points
    assert set(points.names) == {"move 1"}
    held = np.linalg.norm(points.source - front, axis=1).argmin()
    np.testing.assert_allclose(points.source[held][[0, 2]], front[[0, 2]], atol=2 * scale)
    moved = (points.target - points.source)[held]
    assert np.linalg.norm(moved) == pytest.approx(4.0, abs=0.5)
    assert abs(moved[1]) < 0.2  # in the plane of the view
    assert page.page.evaluate("JSON.stringify(document.querySelector('.dnb-view').deformnb.camera.trait)") == camera
    assert page.errors == []
    editor.close()
    view.close()
