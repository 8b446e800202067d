"""Mirror symmetry in the editor, with the real mouse: what is done on one side is done on the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from numpy.typing import NDArray

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

MIDDLE = 70.0  # of the picture along a; along b it is 23.75


@pytest.fixture
def points() -> ControlPoints:
    """Two pairs and one on the upright middle line."""
    return ControlPoints.from_arrays([[40.0, -10], [100.0, -10], [70.0, 0], [30, 50], [110, 50]])


def mirrored(places: Any, axis: int = 0, at: float = MIDDLE) -> NDArray[np.float64]:
    out = np.array(places, dtype=float)
    out[..., axis] = 2 * at - out[..., axis]
    return out


def assert_symmetric(points: ControlPoints, axis: int = 0, at: float = MIDDLE) -> None:
    """The set of pairs (source, target) is its own mirror image."""
    rows = np.concatenate([points.source, points.target], axis=1)
    image = np.concatenate([mirrored(points.source, axis, at), mirrored(points.target, axis, at)], axis=1)
    gaps = np.abs(rows[:, None] - image[None]).max(axis=-1)
    assert gaps.min(axis=1) == pytest.approx(np.zeros(len(rows)), abs=1e-9)


def with_mirror(open_editor: Any, picture: Picture, points: ControlPoints | None, **settings: Any) -> EditorOnPage:
    page = open_editor(Editor(picture, points, **settings))
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("m")
    page.wait_settled()
    return page


def shows_axis(page: EditorOnPage) -> bool:
    return bool(page.js("getComputedStyle(document.querySelector('.dnb-ed-axis-line')).visibility") == "visible")


def test_a_drag_moves_the_partner_too_and_the_axis_is_drawn(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = with_mirror(open_editor, picture, points)
    assert page.editor.mirror == {"on": True, "axis": "a", "at": MIDDLE}
    line, (x, _) = page.page.locator(".dnb-ed-axis-line"), page.to_screen([MIDDLE, 0])
    box = line.bounding_box()
    assert box["x"] + box["width"] / 2 == pytest.approx(x, abs=1)
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag(points.target[0], (-25, 31))
    assert page.points.target[0] == pytest.approx(points.target[0] + np.array([-25, 31]) / k, abs=1e-9)
    assert page.points.target[1] == pytest.approx(points.target[1] + np.array([25, 31]) / k, abs=1e-9)
    assert_symmetric(page.points)
    page.drag(points.target[4], (11, -9))
    page.page.keyboard.press("ArrowRight")
    assert_symmetric(page.points)
    assert np.array_equal(page.points.source, points.source)
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Control+z")
    assert page.points == points  # one step for both
    page.page.keyboard.press("m")
    page.drag(points.target[0], (-25, 31))
    assert np.array_equal(page.points.target[1:], points.target[1:])
    assert not shows_axis(page)


def test_new_points_come_in_pairs_and_those_on_the_axis_stay_there(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = with_mirror(open_editor, picture, points)
    page.page.mouse.dblclick(*page.to_screen([52, 20]))
    assert len(page.points) == 7
    assert_symmetric(page.points)
    page.drag(page.points.target[5], (13, 24))
    page.page.mouse.dblclick(*page.to_screen([MIDDLE + 0.7, 65]))
    assert len(page.points) == 8
    assert page.points.target[7, 0] == MIDDLE
    page.drag(points.target[2], (40, 22))
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[2] == pytest.approx([MIDDLE, 22 / k], abs=1e-9)
    assert_symmetric(page.points)


def test_deleting_takes_both_and_putting_back_too(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = with_mirror(open_editor, picture, points)
    page.drag(points.target[0], (-25, 31))
    page.page.keyboard.press("Home")
    assert np.array_equal(page.points.target, points.target)
    page.page.keyboard.press("o")
    assert page.points.active.tolist() == [False, False, True, True, True]
    page.page.locator("[data-id='4']").focus()
    page.page.keyboard.press("Delete")
    assert page.points.ids == (0, 1, 2)
    page.page.locator("[data-id='2']").focus()
    page.page.keyboard.press("Delete")
    assert page.points.ids == (0, 1)


def test_a_point_without_partner_gets_one_and_a_near_one_is_taken(open_editor: Any, picture: Picture) -> None:
    page = with_mirror(
        open_editor, picture, ControlPoints.from_arrays([[40.0, -10], [30, 50], [110.8, 50.5], [90, 10]])
    )
    page.drag([40, -10], (0, -30))
    assert len(page.points) == 5
    assert page.points.source[4] == pytest.approx([100, -10], abs=1e-9)
    assert page.points.target[4] == pytest.approx(mirrored(page.points.target[0]), abs=1e-9)
    page.drag([30, 50], (12, 12))
    assert len(page.points) == 5
    assert page.points.source[2].tolist() == [110.8, 50.5]  # holds what it held
    assert page.points.target[2] == pytest.approx(mirrored(page.points.target[1]), abs=1e-9)


def test_both_of_a_pair_in_the_hand_keep_the_symmetry_and_none_crosses_the_axis(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = with_mirror(open_editor, picture, points)
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Control+a")
    page.drag(points.target[0], (-18, 12))
    assert_symmetric(page.points)
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[0] == pytest.approx(points.target[0] + np.array([-18, 12]) / k, abs=1e-9)
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Escape")
    page.drag(points.target[3], (400, 0), steps=10)
    assert_symmetric(page.points)
    assert page.points.target[3, 0] < MIDDLE < page.points.target[4, 0]


def test_the_axis_can_lie_level_and_be_dragged(open_editor: Any, picture: Picture) -> None:
    page = with_mirror(open_editor, picture, None)
    page.page.keyboard.press("Shift+M")
    page.wait_settled()
    assert page.editor.mirror == {"on": True, "axis": "b", "at": 23.75}
    grip = page.page.locator("[data-mark='axis'] rect").bounding_box()
    x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x, y - 30, steps=3)
    mouse.up()
    at = 23.75 - 30 / page.js(f"{PAGE}.viewport.view.k")
    page.wait(f"Math.abs(models.editor.get('mirror').at - {at}) < 1e-6")
    assert page.editor.mirror["at"] == pytest.approx(at, abs=1e-9)
    page.page.mouse.dblclick(*page.to_screen([40, 0]))
    page.page.mouse.dblclick(*page.to_screen([110, 50]))
    assert len(page.points) == 4
    page.drag(page.points.target[0], (20, -10))
    assert_symmetric(page.points, 1, page.editor.mirror["at"])
    page.page.keyboard.press("Escape")
    page.page.locator("[data-mark='axis']").focus()
    page.page.keyboard.press("ArrowDown")
    page.wait(f"Math.abs(models.editor.get('mirror').at - {at + 2.5}) < 1e-6")


@pytest.mark.parametrize(("key", "way"), [("s", (0.45, 0.2)), ("e", (0.6, 0.0))])
def test_brushes_and_turns_work_on_both_sides(
    open_editor: Any, picture: Picture, points: ControlPoints, key: str, way: tuple[float, float]
) -> None:
    page = with_mirror(open_editor, picture, points)
    page.page.keyboard.press(key)
    radius, k = page.js(f"{PAGE}.tools.brush.radius"), page.js(f"{PAGE}.viewport.view.k")
    start = np.array([48.0, 20])
    x, y = page.to_screen(start)
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + way[0] * radius * k, y + way[1] * radius * k, steps=6)
    mouse.up()
    assert len(page.points) > 20
    assert_symmetric(page.points)
    assert page.js(f"{PAGE}.map.folds.least") > 0
    page.page.keyboard.press("Escape")
    page.page.locator("[data-id='3'] .dnb-ed-hit").click()
    page.page.keyboard.press("Shift+.")
    assert page.points.names.count("point 3 rim") == 6
    assert_symmetric(page.points)
    gaps = np.linalg.norm(page.points.target[:, None] - page.points.target[None], axis=-1)
    assert gaps[~np.eye(len(page.points), dtype=bool)].min() > 1


def test_the_mirror_outlives_the_view_and_a_locked_partner_stays(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points.edit(1, locked=True))
    editor.mirror = {"on": True, "axis": "a", "at": 70.0}
    page = open_editor(editor)
    assert shows_axis(page)
    page.drag(points.target[0], (-25, 31))
    assert page.points.target[1].tolist() == points.target[1].tolist()
    assert page.points.target[0].tolist() != points.target[0].tolist()
    page.js("{ models.editor.cleanups[0](); }")
    page.draw("editor")
    page.wait_settled()
    assert shows_axis(page)
    assert page.page.locator("[data-command=mirror]").get_attribute("aria-checked") == "true"


def test_a_new_pair_moves_nothing_where_the_sides_are_bent_in_different_ways(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    bent = points.move(0, [49.0, 5]).move(4, [104, 38])
    page = with_mirror(open_editor, picture, bent, show_grid=False)
    before, fit = page.canvas(), page.editor.fit()
    page.page.mouse.dblclick(*page.to_screen([52, 24]))
    added = page.points
    assert len(added) == 7
    # The same matter of both sides, each where it is seen.
    assert added.source[6] == pytest.approx(mirrored(added.source[5]), abs=1e-9)
    for k in (5, 6):
        assert added.target[k] + fit.displacement(added.target[k]) == pytest.approx(added.source[k], abs=1e-4)
    assert np.abs(added.target[6] - mirrored(added.target[5])).max() > 3
    assert np.quantile(np.abs(page.canvas() - before), 0.999) <= 1
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag(added.target[5], (14, 10))  # from here on both sides do the same
    assert page.points.target[5] == pytest.approx(added.target[5] + np.array([14, 10]) / k, abs=1e-9)
    assert page.points.target[6] == pytest.approx(mirrored(page.points.target[5]), abs=1e-9)
