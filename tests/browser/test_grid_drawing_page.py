"""A grid that is put on a drawing, in a page, with a real mouse and real keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.imaging.projection import project
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Volume
from deformnb.widgets import GridDrawing

pytestmark = pytest.mark.needs_browser

ROWS, COLUMNS = 4, 5


class OnDrawing(LivePage):
    def __init__(self, browser: Any) -> None:
        super().__init__(browser, (500, 500))
        values = np.full((1, 80, 120), 255, np.uint8)
        values[0, 20:60, 30:100] = 30
        self.drawing = GridDrawing(project(Volume.from_array(values), "+z"), ROWS, COLUMNS)
        self.add(self.drawing, "grid")
        self.wait("document.querySelectorAll('.dnb-grid-drawing .dnb-cv-node').length === 20")

    def node(self, index: int) -> tuple[float, float]:
        box = self.page.locator(".dnb-grid-drawing .dnb-cv-dot").nth(index).bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def scale(self) -> float:
        return float(self.page.evaluate("document.querySelector('.dnb-gd-svg').getScreenCTM().a"))

    def drag(self, index: int, dx: float, dy: float) -> None:
        (x, y), before, mouse = self.node(index), self.drawing.nodes, self.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + dx / 2, y + dy / 2, steps=3)
        mouse.move(x + dx, y + dy, steps=3)
        mouse.up()
        self.wait_until(lambda: self.drawing.nodes is not before)

    def press(self, key: str) -> None:
        before = self.drawing.nodes
        self.page.keyboard.press(key)
        self.wait_until(lambda: self.drawing.nodes is not before)


@pytest.fixture
def on_drawing(browser: Any) -> Iterator[OnDrawing]:
    opened = OnDrawing(browser)
    yield opened
    opened.close()


def test_nodes_that_nobody_placed_follow_the_thin_plate_spline_of_those_that_were(on_drawing: OnDrawing) -> None:
    before, scale = on_drawing.drawing.nodes, on_drawing.scale()
    on_drawing.drag(0, -20, -30)
    on_drawing.drag(7, 10, 15)
    moved = on_drawing.drawing.nodes
    np.testing.assert_allclose(moved[0, 0], before[0, 0] + np.array([-20, -30]) / scale, atol=0.02)
    regular = np.stack(np.meshgrid(np.linspace(0, 1, COLUMNS), np.linspace(0, 1, ROWS)), axis=-1)
    placed = [0, 4, 15, 19, 7]
    knots, places = regular.reshape(-1, 2)[placed], moved.reshape(-1, 2)[placed]
    spline = fit_rbf(ControlPoints.from_arrays(places, knots), kernel="thin_plate", support=1.0)
    wanted = regular.reshape(-1, 2) + spline.displacement(regular.reshape(-1, 2))
    np.testing.assert_allclose(moved.reshape(-1, 2), wanted, atol=1e-6)
    assert on_drawing.drawing.shown["placed"] == [0, 7]


def test_drags_are_taken_back_and_inner_nodes_spread_again(on_drawing: OnDrawing) -> None:
    on_drawing.drag(4, 15, -10)
    corner = on_drawing.drawing.nodes
    on_drawing.drag(7, 10, 15)
    on_drawing.press("Control+z")
    np.testing.assert_allclose(on_drawing.drawing.nodes, corner)
    on_drawing.drag(12, 10, 15)
    before = on_drawing.drawing.nodes
    on_drawing.page.get_by_role("button", name="Spread evenly").click()
    on_drawing.wait_until(lambda: on_drawing.drawing.nodes is not before)
    np.testing.assert_allclose(on_drawing.drawing.nodes, corner, atol=1e-9)


def test_keys_alone_walk_and_move(on_drawing: OnDrawing) -> None:
    start, focused = on_drawing.drawing.nodes, "document.activeElement.getAttribute('aria-label')"
    on_drawing.page.keyboard.press("Tab")
    assert on_drawing.page.evaluate(focused).startswith("node r0 c0")
    on_drawing.page.keyboard.press("Alt+ArrowRight")
    on_drawing.page.keyboard.press("Alt+ArrowDown")
    assert on_drawing.page.evaluate(focused).startswith("node r1 c1")
    on_drawing.press("ArrowRight")
    on_drawing.press("Shift+ArrowUp")
    way = on_drawing.drawing.nodes[1, 1] - start[1, 1]
    np.testing.assert_allclose(way, [120 / 200, -5 * 120 / 200], atol=1e-9)


def test_escape_gives_up_a_drag(on_drawing: OnDrawing) -> None:
    before, (x, y) = on_drawing.drawing.nodes, on_drawing.node(0)
    on_drawing.page.mouse.move(x, y)
    on_drawing.page.mouse.down()
    on_drawing.page.mouse.move(x + 30, y + 30, steps=3)
    on_drawing.page.keyboard.press("Escape")
    on_drawing.page.mouse.up()
    on_drawing.wait_until(lambda: np.allclose(on_drawing.node(0), (x, y), atol=1))
    assert on_drawing.drawing.nodes is before


def test_lines_that_change_in_python_are_drawn(on_drawing: OnDrawing) -> None:
    on_drawing.drawing.set_lines(3, 3)
    on_drawing.wait("document.querySelectorAll('.dnb-grid-drawing .dnb-cv-node').length === 9")
    on_drawing.drag(4, 5, 5)
    assert on_drawing.drawing.shown["placed"] == [4]
