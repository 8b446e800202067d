"""Brushes of the editor, with the real mouse: what they hold moves, the rest stays, and they leave ordinary points."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_text
from numpy.typing import NDArray

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.warping.points import warp_points
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

MIDDLE = np.array([60.0, 30.0])


def brush(page: EditorOnPage, key: str) -> float:
    """Takes a brush by its key; its radius in units of the picture."""
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press(key)
    return float(page.js(f"{PAGE}.tools.brush.radius"))


def offset_middle(da: float) -> NDArray[np.float64]:
    return np.array([MIDDLE[0] + da, MIDDLE[1]])


def stroke(page: EditorOnPage, *way: Any, steps: int = 8) -> None:
    """Through these places of the picture with the mouse."""
    mouse = page.page.mouse
    mouse.move(*page.to_screen(way[0]))
    mouse.down()
    for place in way[1:]:
        mouse.move(*page.to_screen(place), steps=steps)
    mouse.up()
    page.wait_settled()


def around(middle: Any, radius: float, count: int = 48) -> NDArray[np.float64]:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.asarray(middle) + radius * np.c_[np.cos(angles), np.sin(angles)]


def moved(editor: Editor, places: Any) -> NDArray[np.float64]:
    """Displacements of these places of the original."""
    return warp_points(np.atleast_2d(places), editor.fit())[0] - places


def inside(picture: Picture, places: NDArray[np.float64]) -> NDArray[np.float64]:
    a0, a1, b0, b1 = picture.raster.box
    return places[(places[:, 0] > a0) & (places[:, 0] < a1) & (places[:, 1] > b0) & (places[:, 1] < b1)]


def nearest(points: ControlPoints) -> float:
    gaps = np.linalg.norm(points.target[:, None] - points.target[None], axis=-1)
    return float(gaps[~np.eye(len(points), dtype=bool)].min())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("way", [(0.55, 0.0), (-0.3, 0.4), (0.0, -0.5)])
@pytest.mark.parametrize("has_points", [True, False])
def test_a_moving_brush_takes_along_what_lies_under_it_and_nothing_beyond(
    open_editor: Any, picture: Picture, points: ControlPoints, way: tuple[float, float], has_points: bool
) -> None:
    page = open_editor(Editor(picture, points.remove(4) if has_points else None))
    radius = brush(page, "s")
    by = radius * np.array(way)
    stroke(page, MIDDLE, MIDDLE + by)
    assert page.points.next_id > max(page.points.ids)  # ids of points that were left out are not given again
    length = np.linalg.norm(by)
    assert np.linalg.norm(moved(page.editor, MIDDLE)[0] - by) < 0.04 * radius
    rings = [around(MIDDLE + t * by, q * radius) for t in (0, 1) for q in (1.4, 2, 3, 4)]
    outside = inside(picture, np.concatenate(rings))
    along = np.clip((outside - MIDDLE) @ by / length**2, 0, 1)[:, None] * by
    outside = outside[np.linalg.norm(outside - MIDDLE - along, axis=1) > 1.35 * radius]
    missed = 0.5 * min(picture.raster.spacing)  # by the points that are left out
    assert np.linalg.norm(moved(page.editor, outside), axis=1).max() < 0.16 * length + missed
    names = [name for name in page.points.names if name and name != "top right"]
    assert set(names) == {"move 1"}
    still = np.linalg.norm(page.points.displacement, axis=1) < 0.1 * length
    ring = np.linalg.norm(page.points.target - MIDDLE, axis=1) > 1.6 * radius
    assert still[ring].all()
    assert ring.sum() > 8


def test_a_stroke_is_one_step_and_the_picture_follows_while_it_goes_on(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, seen = Editor(picture, points, show_grid=False), []
    editor.on_edit(lambda edit: seen.append((edit.phase, edit.kind)), details=True)
    page = open_editor(editor)
    radius, before = brush(page, "s"), page.canvas()
    mouse = page.page.mouse
    mouse.move(*page.to_screen(MIDDLE))
    mouse.down()
    mouse.move(*page.to_screen(offset_middle(0.5 * radius)), steps=6)
    page.wait_settled()
    assert np.abs(page.canvas() - before).max() > 20
    assert editor.points == points
    mouse.up()
    assert len(page.points) > len(points)
    assert {phase for phase, _ in seen[:-1]} <= {"move"}
    assert seen[-1] == ("end", "brush")
    page.page.keyboard.press("Control+z")
    assert page.points.ids == points.ids
    assert np.array_equal(page.points.target, points.target)
    page.page.keyboard.press("Control+y")
    assert "move 1" in page.points.names


@pytest.mark.nightly
def test_strokes_over_one_place_do_not_pile_up_points(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    radius, counts = brush(page, "s"), []
    for k in range(6):
        at = MIDDLE + 0.2 * radius * np.array([np.cos(k), np.sin(k)])
        stroke(page, at, at + 0.3 * radius * np.array([np.sin(2 * k), np.cos(2 * k)]))
        counts.append(len(page.points))
    assert counts[-1] - counts[0] <= 8
    assert nearest(page.points) > 0.2 * radius
    assert page.page.locator(".dnb-messages").get_attribute("data-kind") != "error"
    assert page.js(f"{PAGE}.map.folds.least") > 0
    page.page.keyboard.press("Escape")  # and they are points as all others
    last = page.points.ids[-1]
    page.page.locator(f"[data-id='{last}']").focus()
    page.page.keyboard.press("Delete")
    assert last not in page.points.ids


@pytest.mark.nightly
def test_a_long_stroke_leaves_moved_points_on_its_way_and_does_not_fold(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture))
    radius = brush(page, "s")
    start, end = np.array([35.0, 10.0]), np.array([35.0 + 4 * radius, 10.0])
    stroke(page, start, end, steps=40)
    way = page.points.target - page.points.source
    on_it = (np.abs(page.points.target[:, 1] - 10) < 0.5 * radius) & (np.abs(way[:, 0]) > 0.15 * radius)
    assert on_it.sum() >= 4
    assert np.ptp(page.points.target[on_it, 0]) > 2 * radius
    assert (way[on_it, 0] > 0).all()
    assert page.js(f"{PAGE}.map.folds.least") > 0


@pytest.mark.nightly
def test_wild_strokes_end_before_the_picture_folds(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    radius = brush(page, "s")
    for k in range(4):
        turn = np.array([np.cos(2.5 * k), np.sin(2.5 * k)])
        stroke(page, MIDDLE + 0.4 * radius * turn, MIDDLE - 1.4 * radius * turn, steps=12)
    assert page.js(f"{PAGE}.map.folds.least") > 0
    assert len(page.points) > len(points)


@pytest.mark.parametrize(("pixels", "name"), [(50, "grow 1"), (-60, "shrink 1")])
def test_the_other_brush_grows_to_the_right_and_shrinks_to_the_left(
    open_editor: Any, picture: Picture, points: ControlPoints, pixels: int, name: str
) -> None:
    page = open_editor(Editor(picture, points.remove(4)))
    radius = brush(page, "e")
    x, y = page.to_screen(MIDDLE)
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + pixels, y, steps=6)
    mouse.up()
    assert {n for n in page.points.names if n} == {"top right", name}
    scale = 1 / np.sqrt(np.linalg.det(np.eye(2) + page.editor.fit().jacobian(MIDDLE)))
    assert scale == pytest.approx(np.exp(pixels / 120), rel=0.15)
    assert np.linalg.norm(moved(page.editor, MIDDLE)) < 0.02 * radius
    outside = inside(picture, np.concatenate([around(MIDDLE, q * radius) for q in (1.3, 2, 3)]))
    assert np.linalg.norm(moved(page.editor, outside), axis=1).max() < 0.1 * radius
    inner = moved(page.editor, around(MIDDLE, 0.4 * radius)) * np.sign(pixels)
    assert ((around(MIDDLE, 0.4 * radius) - MIDDLE) * inner).sum(axis=1).min() > 0


def test_the_radius_follows_keys_the_wheel_and_the_slider(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    radius = brush(page, "s")
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.mouse.move(*page.to_screen(MIDDLE))
    page.page.keyboard.press("]")
    page.wait_settled()
    circle = page.page.locator(".dnb-ed-circle-line")
    assert float(circle.get_attribute("r")) == pytest.approx(1.1 * radius * k, abs=0.1)
    assert (float(circle.get_attribute("cx")), float(circle.get_attribute("cy"))) == pytest.approx(
        (k * MIDDLE[0] + page.js(f"{PAGE}.viewport.view.x"), k * MIDDLE[1] + page.js(f"{PAGE}.viewport.view.y")), abs=1
    )
    page.page.mouse.wheel(0, 120)
    page.wait(f"{PAGE}.tools.brush.radius < {1.05 * radius}")
    assert page.js(f"{PAGE}.viewport.view.k") == k
    slider = page.page.get_by_role("slider", name="radius of the brush")
    slider.focus()
    page.page.keyboard.press("End")
    page.wait(f"Math.abs(models.editor.get('brush_radius') - 400 / {k}) < 1e-6")
    page.wait(f"models.editor.saved.some((s) => Math.abs(s.brush_radius - 400 / {k}) < 1e-6)")
    page.wait_settled()
    assert page.editor.brush_radius == pytest.approx(400 / k)
    page.page.get_by_role("button", name="Done").click()
    assert page.js(f"{PAGE}.tools.brush.isOn") is False
    page.wait_settled()
    assert circle.is_hidden()


def test_keys_alone_make_a_stroke(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points.remove(4)))
    radius, k = brush(page, "s"), page.js(f"{PAGE}.viewport.view.k")
    for _ in range(3):
        page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("Enter")
    for _ in range(2):
        page.page.keyboard.press("ArrowDown")
    page.page.keyboard.press("Enter")
    a0, a1, b0, b1 = picture.raster.box
    start = np.array([(a0 + a1) / 2 - 30 / k, (b0 + b1) / 2])
    assert len(page.points) > len(points)
    assert moved(page.editor, start)[0] == pytest.approx([0, 20 / k], abs=0.05 * radius)
    page.page.keyboard.press("Escape")
    assert page.js(f"{PAGE}.tools.brush.isOn") is False


def test_escape_gives_a_stroke_up_and_a_click_leaves_nothing(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    radius = brush(page, "s")
    mouse = page.page.mouse
    mouse.move(*page.to_screen(MIDDLE))
    mouse.down()
    mouse.move(*page.to_screen(offset_middle(0.4 * radius)), steps=4)
    page.page.keyboard.press("Escape")
    mouse.up()
    assert page.points == points
    assert page.js(f"{PAGE}.points.list.length") == len(points)
    page.page.mouse.click(*page.to_screen(MIDDLE))
    assert page.points == points
    assert page.js("models.editor.sent.filter((m) => m.phase === 'end').length") == 0


def test_a_locked_point_stays_under_a_brush(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points.edit(4, locked=True)))
    radius = brush(page, "s")
    stroke(page, points.target[4], points.target[4] + [0.4 * radius, 0])
    assert page.points == points.edit(4, locked=True)
    assert "is locked" in message_text(page.page)
    stroke(page, points.target[4] + [0.8 * radius, 0], points.target[4] + [0.4 * radius, 0])
    assert len(page.points) > 5
    assert page.points.target[4].tolist() == points.target[4].tolist()


def test_a_finger_strokes_and_two_zoom(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points.remove(4)))
    radius, k = brush(page, "s"), page.js(f"{PAGE}.viewport.view.k")
    fingers = page.page.context.new_cdp_session(page.page)

    def touch(kind: str, *places: Any) -> None:
        fingers.send(
            "Input.dispatchTouchEvent",
            {"type": kind, "touchPoints": [{"x": float(x), "y": float(y), "id": n} for n, (x, y) in enumerate(places)]},
        )

    touch("touchStart", page.to_screen(MIDDLE))
    for share in (0.1, 0.25, 0.4):
        touch("touchMove", page.to_screen(offset_middle(share * radius)))
    touch("touchEnd")
    assert len(page.points) > len(points)
    assert moved(page.editor, MIDDLE)[0] == pytest.approx([0.4 * radius, 0], abs=0.06 * radius)
    after = page.points
    x, y = page.to_screen([70, 40])
    touch("touchStart", (x - 40, y))
    touch("touchStart", (x - 40, y), (x + 40, y))
    touch("touchMove", (x - 60, y), (x + 60, y))
    touch("touchMove", (x - 80, y), (x + 80, y))
    touch("touchEnd")
    page.wait_settled()
    assert page.points == after
    assert page.js(f"{PAGE}.viewport.view.k") > 1.5 * k


def test_names_are_shown_where_a_point_is_selected(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    brush(page, "s")
    stroke(page, MIDDLE, offset_middle(5.0))
    stroke(page, [30.0, 60.0], [34.0, 60.0])
    assert {name for name in page.points.names if re.match("move", name)} == {"move 1", "move 2"}
    names = (
        "() => [...document.querySelectorAll('.dnb-ed-name')].filter((t) => getComputedStyle(t).visibility === "
        "'visible').map((t) => t.textContent)"
    )
    page.page.mouse.move(0, 0)  # a name is shown under the pointer too
    page.page.wait_for_function(f"({names})().length === 0")
    chosen = page.points.ids[page.points.names.index("middle")]
    page.js(f"{PAGE}.points.select([{chosen}])")
    page.page.wait_for_function(f"({names})().join() === 'middle'")
