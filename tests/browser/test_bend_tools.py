"""Straightening, hinges and halves that move apart, with the real mouse in a real browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage, smooth_picture

from deformnb.document.centre_line import straightened_places
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

CORNERS = ControlPoints.from_arrays([[11, -30], [129, -30], [129, 77], [11, 77]])


@pytest.fixture
def page(open_editor: Any) -> EditorOnPage:
    return open_editor(Editor(smooth_picture(), CORNERS))


def stroke(page: EditorOnPage, places: Any) -> None:
    mouse = page.page.mouse
    at = [page.to_screen(place) for place in places]
    mouse.move(*at[0])
    mouse.down()
    for place in at[1:]:
        mouse.move(*place, steps=2)
    mouse.up()
    page.wait_answered()


def use(page: EditorOnPage, tool: str) -> None:
    page.page.locator(f"[data-command={tool}]").click()
    page.page.locator(f"[data-command={tool}][aria-pressed=true]").wait_for()


def test_a_stroke_along_what_is_bent_straightens_it_in_two_gestures(page: EditorOnPage) -> None:
    angle = np.linspace(-0.6, 0.6, 25)
    line = np.array([70.0, 5.0]) + 60 * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    use(page, "straighten")
    stroke(page, line)
    made = page.points
    own = [k for k, name in enumerate(made.names) if name.startswith("line")]
    assert len(own) == 27
    centre = made.target[own][1::3]
    assert np.ptp(centre[:, 1]) < 2  # level, as the line is in its middle
    assert np.ptp(centre[:, 0]) == pytest.approx(60 * 1.2, rel=0.03)
    expected = straightened_places(line, 9.0)[1][1::3]
    assert np.abs(centre - expected).max() < 2
    assert page.js(f"{PAGE}.map.folds.least") > 0
    assert not page.js(f"{PAGE}.tools.pen.isOn")
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Control+z")
    assert page.points.ids == CORNERS.ids


def test_an_s_is_straightened_between_its_ends_and_points_in_its_way_go(open_editor: Any) -> None:
    in_the_way, away = CORNERS.add([31, 24], [31, 24], name="in the way"), [70, 60]
    page = open_editor(Editor(smooth_picture(), in_the_way.add(away, away, name="away")))
    at = np.linspace(0, 1, 25)
    use(page, "straighten")
    stroke(page, np.stack([40 + 60 * at, 24 + 7 * np.sin(2 * np.pi * at)], axis=1))
    made = page.points
    assert "away" in made.names
    assert "in the way" not in made.names
    centre = made.target[[k for k, name in enumerate(made.names) if name.startswith("line")]][1::3]
    assert np.ptp(centre[:, 1]) < 2
    assert page.js(f"{PAGE}.map.folds.least") > 0


def test_clicks_and_enter_draw_a_centre_line_by_keys_too(page: EditorOnPage) -> None:
    use(page, "straighten")
    for place in ([40, 20], [70, 10], [100, 20]):
        page.page.mouse.click(*page.to_screen(place))
    page.page.keyboard.press("Enter")
    page.wait_answered()
    assert any(name.startswith("line") for name in page.points.names)


def test_a_hinge_takes_three_gestures_and_turns_rigidly(page: EditorOnPage) -> None:
    use(page, "hinge")
    stroke(page, [[70, 24], [105, 24]])
    turning, staying = page.editor.parts
    assert (turning.name, staying.name) == ("turns", "stays")
    assert turning.pivot == pytest.approx((70, 24), abs=0.5)
    assert turning.motion is None
    at = page.to_screen([98, 24])
    page.drag([98, 24], tuple(np.array(page.to_screen([95, 36])) - at), steps=6)
    page.wait_answered()
    turning, staying = page.editor.parts
    angle = np.degrees(np.arctan2(turning.motion.matrix[1][0], turning.motion.matrix[0][0]))
    assert 15 < angle < 30
    assert turning.motion(np.array([turning.pivot]))[0] == pytest.approx(turning.pivot, abs=1e-6)
    assert staying.motion is None
    assert page.js(f"{PAGE}.map.folds.least") > 0


def test_a_turn_that_the_corners_stop_goes_on_without_them(open_editor: Any) -> None:
    corners = ControlPoints.from_arrays(CORNERS.source, names=["corner"] * 4)
    page = open_editor(Editor(smooth_picture(), corners))
    use(page, "hinge")
    stroke(page, [[70, 24], [122, 24]])
    at = page.to_screen([100, 24])
    page.drag([100, 24], tuple(np.array(page.to_screen([84, 56])) - at), steps=12)
    page.wait(f"!{PAGE}.tools.foldOffers.isTrying && {PAGE}.tools.foldOffers.isShown")

    def angle() -> float:
        (a, _), (b, _) = page.editor.parts[0].motion.matrix
        return float(np.degrees(np.arctan2(b, a)))

    stopped = angle()
    page.page.locator("[data-action=corners]").click()
    page.wait_answered()
    assert angle() > stopped + 5
    assert not len(page.points)
    assert page.js(f"{PAGE}.map.folds.least") > 0
    page.page.keyboard.press("Control+z")
    page.wait_answered()
    assert angle() == pytest.approx(stopped, abs=1e-6)
    assert page.points.ids == corners.ids


def test_the_halves_of_a_cut_move_apart_without_bending(page: EditorOnPage) -> None:
    use(page, "cut")
    stroke(page, [[70, -20], [70, 60]])
    page.page.get_by_role("button", name="Move apart rigidly").click()
    page.wait_answered()
    moved = page.points
    way = moved.displacement
    left = moved.source[:, 0] < 70
    assert left.sum() > 4
    assert (~left).sum() > 4
    for side in (left, ~left):
        assert np.ptp(way[side], axis=0) == pytest.approx(0, abs=1e-9)  # one shift for all: nothing bends
    assert np.abs(way[left] + way[~left][0]).max() < 1e-6
    assert np.abs(way[left][0, 0]) > 5
    page.page.keyboard.press("Control+z")
    assert page.points.ids == CORNERS.ids


def test_the_flaps_of_a_cut_that_stops_stay_between_points_that_hold(page: EditorOnPage) -> None:
    use(page, "cut")
    stroke(page, [[70, 0], [70, 45]])
    page.page.get_by_label("Stop at the ends").check()
    page.wait_answered()
    page.page.get_by_role("button", name="Move apart rigidly").click()
    page.wait_answered()
    way = np.linalg.norm(page.points.displacement, axis=1)
    assert (way > 1).sum() >= 6
    assert (way == 0).sum() >= 6
    assert page.js(f"{PAGE}.map.folds.least") > 0


def test_a_drag_of_one_side_of_a_cut_can_go_on_as_a_half(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, CORNERS.add([35, 5], [35, 5]).add([35, 35], [35, 35]), support=70.0))
    use(page, "cut")
    stroke(page, [[70, -20], [70, 60]])
    page.page.keyboard.press("Escape")
    page.page.mouse.dblclick(*page.to_screen([60, 20]))
    page.wait(f"{PAGE}.points.list.length === 7")
    page.wait_answered()
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag([60, 20], (-45 * k, 0), steps=6)
    page.wait(f"!{PAGE}.tools.foldOffers.isTrying && {PAGE}.tools.foldOffers.isShown")
    page.page.locator("[data-action=rigid]").click()
    page.wait_answered()
    way = page.points.displacement[page.points.source[:, 0] < 70]
    assert way == pytest.approx(np.array([[45.0, 0.0]] * len(way)), abs=0.6)  # backward
