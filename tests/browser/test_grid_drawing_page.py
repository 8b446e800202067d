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
def drawing_page(browser: Any) -> Iterator[OnDrawing]:
    opened = OnDrawing(browser)
    yield opened
    opened.close()


def test_nodes_that_nobody_placed_follow_the_thin_plate_spline_of_those_that_were(drawing_page: OnDrawing) -> None:
    before, scale = drawing_page.drawing.nodes, drawing_page.scale()
    drawing_page.drag(0, -20, -30)
    drawing_page.drag(7, 10, 15)
    moved = drawing_page.drawing.nodes
    np.testing.assert_allclose(moved[0, 0], before[0, 0] + np.array([-20, -30]) / scale, atol=0.02)
    regular = np.stack(np.meshgrid(np.linspace(0, 1, COLUMNS), np.linspace(0, 1, ROWS)), axis=-1)
    placed = [0, 4, 15, 19, 7]
    knots, places = regular.reshape(-1, 2)[placed], moved.reshape(-1, 2)[placed]
    spline = fit_rbf(ControlPoints.from_arrays(places, knots), kernel="thin_plate", support=1.0)
    wanted = regular.reshape(-1, 2) + spline.displacement(regular.reshape(-1, 2))
    np.testing.assert_allclose(moved.reshape(-1, 2), wanted, atol=1e-6)
    assert drawing_page.drawing.shown["placed"] == [0, 7]


def test_drags_are_taken_back_and_inner_nodes_spread_again(drawing_page: OnDrawing) -> None:
    drawing_page.drag(4, 15, -10)
    corner = drawing_page.drawing.nodes
    drawing_page.drag(7, 10, 15)
    drawing_page.press("Control+z")
    np.testing.assert_allclose(drawing_page.drawing.nodes, corner)
    drawing_page.drag(12, 10, 15)
    before = drawing_page.drawing.nodes
    drawing_page.page.get_by_role("button", name="Spread evenly").click()
    drawing_page.wait_until(lambda: drawing_page.drawing.nodes is not before)
    np.testing.assert_allclose(drawing_page.drawing.nodes, corner, atol=1e-9)


def test_keys_alone_walk_and_move(drawing_page: OnDrawing) -> None:
    start, focused = drawing_page.drawing.nodes, "document.activeElement.getAttribute('aria-label')"
    drawing_page.page.keyboard.press("Tab")
    assert drawing_page.page.evaluate(focused).startswith("node r0 c0")
    drawing_page.page.keyboard.press("Alt+ArrowRight")
    drawing_page.page.keyboard.press("Alt+ArrowDown")
    assert drawing_page.page.evaluate(focused).startswith("node r1 c1")
    drawing_page.press("ArrowRight")
    drawing_page.press("Shift+ArrowUp")
    way = drawing_page.drawing.nodes[1, 1] - start[1, 1]
    np.testing.assert_allclose(way, [120 / 200, -5 * 120 / 200], atol=1e-9)


def test_escape_gives_up_a_drag(drawing_page: OnDrawing) -> None:
    before, (x, y) = drawing_page.drawing.nodes, drawing_page.node(0)
    drawing_page.page.mouse.move(x, y)
    drawing_page.page.mouse.down()
    drawing_page.page.mouse.move(x + 30, y + 30, steps=3)
    drawing_page.page.keyboard.press("Escape")
    drawing_page.page.mouse.up()
    drawing_page.wait_until(lambda: np.allclose(drawing_page.node(0), (x, y), atol=1))
    assert drawing_page.drawing.nodes is before


def test_lines_that_change_in_python_are_drawn(drawing_page: OnDrawing) -> None:
    drawing_page.drawing.set_lines(3, 3)
    drawing_page.wait("document.querySelectorAll('.dnb-grid-drawing .dnb-cv-node').length === 9")
    drawing_page.drag(4, 5, 5)
    assert drawing_page.drawing.shown["placed"] == [4]
