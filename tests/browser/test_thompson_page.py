"""The grid of an editor dragged by its nodes with the real mouse, beside the grid on the original."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import EditorOnPage
from browser.pane_messages import message_script, message_text

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

# The views in the order in which they were drawn: an editor, the original, the grid.
SIDES = """[...document.querySelectorAll('.dnb-editor')].forEach((e, k) => {
  if (k) e.parentElement.className += k === 1 ? ' dnb-th-before' : ' dnb-th-after';
  e.deformnb.layout(); })"""
VIEWS = "[...document.querySelectorAll('.dnb-editor')].map((e) => e.deformnb.parts)"
NODE = "[data-node='{}']"
CELLS = 6  # of 120 x 110: 6 across, 6 down


@pytest.fixture
def three(open_editor: Any, picture: Picture, points: ControlPoints) -> EditorOnPage:
    """The main editor above, the original and the grid below."""
    page = open_editor(Editor(picture, points, density=CELLS, height=240), size=(900, 900), draws=3)
    page.js(SIDES)
    page.wait(f"{VIEWS}.every((view) => !view.frames.isMoving && !view.frames.request)")
    return page


def node_of(picture: Picture, i: int, j: int) -> np.ndarray:
    a0, a1, b0, b1 = picture.raster.box
    return np.array([a0 + (a1 - a0) * i / 6, b0 + (b1 - b0) * j / 6])


def middle(page: EditorOnPage, n: int, view: int) -> tuple[float, float]:
    box = page.page.locator(".dnb-editor").nth(view).locator(NODE.format(n)).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag_node(page: EditorOnPage, n: int, by: tuple[float, float], view: int = 0, *, drop: bool = True) -> None:
    x, y = middle(page, n, view)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + by[0], y + by[1], steps=5)
    if drop:
        page.page.mouse.up()
        page.wait_answered()


def scale(page: EditorOnPage, view: int = 0) -> float:
    return float(page.js(f"{VIEWS}[{view}].viewport.view.k"))


def test_nodes_are_there_only_where_they_can_be_dragged(three: EditorOnPage) -> None:
    assert three.js(f"{VIEWS}.map((v) => v.layers.nodes.side)") == ["", "before", "after"]
    assert three.js(f"{VIEWS}.map((v) => v.layers.nodes.nodes.length)") == [0, 0, 49]
    three.editor.drag_grid = True
    three.wait(f"{VIEWS}[0].layers.nodes.nodes.length === 49")
    assert three.js(f"{VIEWS}[1].layers.nodes.nodes.length") == 0
    three.editor.show_grid = False
    three.wait(f"{VIEWS}[2].layers.nodes.nodes.length === 0")


def test_a_dragged_node_becomes_a_point_from_its_place_to_where_it_was_dropped(
    three: EditorOnPage, picture: Picture
) -> None:
    drag_node(three, 3 + 2 * 7, (26, -14), 2)
    points = three.points
    assert points.names[-1] == "grid 3,2"
    assert points.source[-1] == pytest.approx(node_of(picture, 3, 2), abs=1e-9)
    assert points.target[-1] == pytest.approx(node_of(picture, 3, 2) + np.array([26, -14]) / scale(three, 2), abs=1e-9)
    ends = three.js("models.editor.sent.filter((m) => m.phase === 'end').map((m) => m.points.length)")
    assert ends == [6]  # one edit, and so one step of undo
    shown = three.js(f"{VIEWS}.map((v) => v.points.list.at(-1).name)")
    assert shown == ["grid 3,2"] * 3
    gone = three.page.locator(".dnb-th-after " + NODE.format(17)).get_attribute("class")
    assert "dnb-ed-node-gone" in gone  # the point stands for it
    assert three.page.locator(".dnb-th-after [data-id='5']").is_visible()


def test_pictures_and_grids_follow_while_the_mouse_moves_but_for_the_original(three: EditorOnPage) -> None:
    looks = "[...document.querySelectorAll('.dnb-ed-canvas:not(.dnb-ed-overlay)')].map((c) => c.toDataURL())"
    before = three.js(looks)
    drag_node(three, 17, (30, 10), 2, drop=False)
    three.wait(f"!{VIEWS}.some((v) => v.frames.isMoving || v.frames.request)")
    during = three.js(looks)
    assert [a != b for a, b in zip(before, during, strict=True)] == [True, False, True]
    assert three.js("models.editor.sent.filter((m) => m.phase === 'end').length") == 0
    at = three.js(f"{VIEWS}.map((v) => v.points.list.length)")
    assert at[0] == at[2] == 6
    three.page.keyboard.press("Escape")
    three.page.mouse.up()
    three.wait(f"!{VIEWS}.some((v) => v.frames.isMoving || v.frames.request)")
    assert three.js(f"{VIEWS}.map((v) => v.points.list.length)") == [5, 5, 5]
    assert three.js("models.editor.sent.filter((m) => m.phase === 'end').length") == 0
    assert len(three.points) == 5


def test_undo_takes_the_node_back(three: EditorOnPage, points: ControlPoints) -> None:
    drag_node(three, 17, (30, 10), 2)
    assert len(three.points) == 6
    three.page.keyboard.press("Control+z")
    assert three.points.ids == points.ids
    assert np.array_equal(three.points.target, points.target)
    assert "dnb-ed-node-gone" not in three.page.locator(".dnb-th-after " + NODE.format(17)).get_attribute("class")


def test_delete_gives_a_node_back_to_the_grid(three: EditorOnPage, points: ControlPoints) -> None:
    drag_node(three, 17, (30, 10), 2)
    three.page.keyboard.press("Delete")  # the point has the focus
    assert three.points.ids == points.ids
    x, y = middle(three, 17, 2)
    drag_node(three, 17, (-12, 5), 2)
    assert three.points.names[-1] == "grid 3,2"
    assert (x, y) == pytest.approx(middle(three, 17, 2), abs=200)


def test_the_node_that_was_dropped_is_dragged_on_as_a_point(three: EditorOnPage, picture: Picture) -> None:
    drag_node(three, 17, (30, 10), 2)
    box = three.page.locator(".dnb-th-after [data-id='5'] .dnb-ed-disc").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    three.page.mouse.move(x, y)
    three.page.mouse.down()
    three.page.mouse.move(x - 15, y + 8, steps=4)
    three.page.mouse.up()
    assert len(three.points) == 6
    expected = node_of(picture, 3, 2) + np.array([15, 18]) / scale(three, 2)
    assert three.points.target[-1] == pytest.approx(expected, abs=1e-9)


def test_with_the_keyboard_a_node_is_found_held_and_moved(three: EditorOnPage, picture: Picture) -> None:
    page = three.page
    page.locator(".dnb-th-after [data-node][tabindex='0']").focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "ArrowDown", "ArrowRight"):
        page.keyboard.press(key)
    assert page.evaluate("() => document.activeElement.dataset.node") == str(3 + 2 * 7)
    page.keyboard.press("Enter")
    assert three.points.names[-1] == "grid 3,2"
    assert three.points.target[-1] == pytest.approx(node_of(picture, 3, 2), abs=1e-6)
    page.keyboard.press("ArrowRight")
    assert three.points.target[-1] == pytest.approx(node_of(picture, 3, 2) + np.array([2.0, 0.0]), abs=1e-6)  # a pixel


def test_a_finger_drags_a_node(three: EditorOnPage, picture: Picture) -> None:
    x, y = middle(three, 17, 2)
    three.js(f"""(() => {{ const node = {VIEWS}[2].layers.nodes.nodes[17].root, group = node.parentElement;
      group.setPointerCapture = group.releasePointerCapture = () => {{}};
      const say = (type, dx, dy) => node.dispatchEvent(new PointerEvent(type, {{ bubbles: true, pointerId: 7,
        pointerType: "touch", button: 0, clientX: {x} + dx, clientY: {y} + dy }}));
      say("pointerdown", 0, 0); say("pointermove", 3, 0); say("pointermove", 20, 12);
      say("pointerup", 20, 12); }})()""")
    wanted = node_of(picture, 3, 2) + np.array([20, 12]) / scale(three, 2)
    assert three.points.target[-1] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("strength", [2.0, 0.5, -1.0])
def test_magnified_a_node_stays_under_the_mouse(three: EditorOnPage, picture: Picture, strength: float) -> None:
    three.editor.strength = strength
    three.wait_settled()
    drag_node(three, 17, (24, -10), 2)
    wanted = node_of(picture, 3, 2) + np.array([24, -10]) / scale(three, 2)
    source, target = three.points.source[-1], three.points.target[-1]
    assert source + strength * (target - source) == pytest.approx(wanted, abs=1e-9)
    box = three.page.locator(".dnb-th-after [data-id='5'] .dnb-ed-disc").bounding_box()
    stage = three.page.locator(".dnb-th-after .dnb-ed-stage").bounding_box()
    v = three.js(f"{VIEWS}[2].viewport.view")
    on_screen = [stage["x"] + v["k"] * wanted[0] + v["x"], stage["y"] + v["k"] * wanted[1] + v["y"]]
    assert [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2] == pytest.approx(on_screen, abs=1.0)


def test_magnified_zero_times_nothing_is_dragged_and_it_is_said_why(three: EditorOnPage) -> None:
    three.editor.strength = 0.0
    three.wait_settled()
    drag_node(three, 17, (24, -10), 2)
    assert len(three.points) == 5
    assert "magnified 0 times" in message_text(three.page, ".dnb-th-after")


def test_extrapolation_that_folds_is_warned_of(three: EditorOnPage) -> None:
    drag_node(three, 17, (45, 0), 2)
    three.page.keyboard.press("Escape")
    three.editor.strength = 3.0
    three.wait(f"{VIEWS}[2].map.folds && {VIEWS}[2].map.folds.least <= 0")
    three.wait_settled()
    three.js(f"{VIEWS}[2].points.select([])")
    three.wait(f"{message_script('.dnb-th-after')} === 'Magnified 3 times the map folds: magnify less'")
    assert "folds" in three.page.locator(".dnb-th-after .dnb-ed-folds").inner_text()


def test_nothing_can_be_dragged_on_the_original(three: EditorOnPage, points: ControlPoints) -> None:
    stage = three.page.locator(".dnb-th-before .dnb-ed-stage").bounding_box()
    v = three.js(f"{VIEWS}[1].viewport.view")
    x, y = stage["x"] + v["k"] * 70 + v["x"], stage["y"] + v["k"] * 25 + v["y"]
    three.page.mouse.move(x, y)
    three.page.mouse.down()
    three.page.mouse.move(x + 30, y + 5, steps=3)
    three.page.mouse.up()
    three.page.mouse.dblclick(x + 20, y + 30)
    three.page.keyboard.press("Delete")
    assert three.points == points


@pytest.mark.nightly
def test_areas_and_strains_have_the_right_colours(open_editor: Any, picture: Picture) -> None:
    a0, a1, b0, b1 = picture.raster.box
    corners, centre = np.array([[a0, b0], [a1, b0], [a0, b1], [a1, b1]]), np.array([(a0 + a1) / 2, (b0 + b1) / 2])
    colour = """(() => { const c = document.querySelector('.dnb-ed-overlay'), g = c.getContext('2d');
      return Array.from(g.getImageData(0, 0, c.width, c.height).data); })()"""
    for factor, wanted in (((1.6, 1.6), "green"), ((0.7, 0.7), "purple")):
        points = ControlPoints.from_arrays(corners, centre + (corners - centre) * factor)
        page = open_editor(Editor(picture, points, overlay="area", show_grid=False, height=240), size=(500, 400))
        rgba = np.array(page.js(colour)).reshape(-1, 4)
        red, green, blue = rgba[rgba[:, 3] > 60][:, :3].mean(axis=0)
        assert (green > max(red, blue) + 30) == (wanted == "green")
        assert (min(red, blue) > green + 30) == (wanted == "purple")
    points = ControlPoints.from_arrays(corners, centre + (corners - centre) * [1.3, 0.8])
    page = open_editor(Editor(picture, points, overlay="strain", density=CELLS, height=240), size=(500, 400))
    legend = page.page.locator(".dnb-ed-key").inner_text()
    assert legend.startswith("principal strains")
    assert "stretched by" in legend
    rgba = np.array(page.js(colour)).reshape(-1, 4)
    seen = rgba[rgba[:, 3] > 250][:, :3]
    inks = [126, 224, 138], [219, 166, 240]
    stretched, pressed = (int((np.abs(seen - ink).sum(axis=1) < 12).sum()) for ink in inks)
    assert stretched > 1.3 * pressed > 100  # longer by 0.3 to 0.2, and the dashes have gaps
