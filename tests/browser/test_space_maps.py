"""Folds and the bent grid on the slices of the editor in space, with the real mouse and keys in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.test_space_editor_page import PAGE, Opened, waves
from browser.test_space_hand import AXIAL, MIDDLE, press
from numpy.typing import NDArray

from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.volume import Volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES, Pane, tissue_mask

pytestmark = pytest.mark.needs_browser

RED = "r > 90 && r > 2 * g"
GREY = "a > 40 && a < 90 && Math.abs(r - b) < 20"
GRID = "a > 40"


@pytest.fixture
def open_editor(page: LivePage, caged: ControlPoints) -> Iterator[Callable[..., Opened]]:
    spaces: list[Opened] = []

    def make(**settings: Any) -> Opened:
        options = {"support": 25.0, "stop_at_folds": False, "show_grid": False, **settings}
        spaces.append(Opened(page, SpaceEditor(waves(), caged, cursor=[MIDDLE, 38, 24], **options)))
        return spaces[-1]

    yield make
    for space in spaces:
        space.editor.close()
    assert page.errors == []


@pytest.fixture
def caged() -> ControlPoints:
    """The corners of the volume and a point between them, on the slices."""
    low, high = np.array([-20.0, 10.0, 5.0]), np.array([35.0, 66.4, 63.5])
    corners = [np.where(np.array([k & 1, k & 2, k & 4]) > 0, high, low) for k in range(8)]
    return ControlPoints.from_arrays([*corners, [MIDDLE, 38.0, 24.0]])


def drawn(space: Opened, pane: int, test: str) -> NDArray[np.bool_]:
    """The pixels of the layer over a slice that pass a test of their red, green, blue and alpha."""
    space.page.wait(f"!{PAGE}.frames.isMoving && !{PAGE}.frames.request")
    width, bits = space.js(
        f"(() => {{ const {{ canvas }} = {PAGE}.parts.row.panes[{pane}].map, read = document.createElement('canvas');"
        "Object.assign(read, { width: canvas.width, height: canvas.height });"
        "const c = read.getContext('2d', { willReadFrequently: true }); c.drawImage(canvas, 0, 0);"
        "const { data } = c.getImageData(0, 0, read.width, read.height), out = [];"
        "for (let n = 0; n < data.length; n += 4) {"
        f" const [r, g, b, a] = data.subarray(n, n + 4); out.push({test}); }}"
        "return [canvas.width, out]; })()"
    )
    return np.array(bits).reshape(-1, width)


def dets(space: Opened, pane: int, field: AbstractField) -> NDArray[np.float64]:
    """det J at the pixels of the layer over a slice; 1 beyond the slice."""
    v = space.js(f"{PAGE}.parts.row.panes[{pane}].viewport.view")
    plane = Pane.of(waves().grid, list(PANES)[pane]).plane
    rows, columns = np.mgrid[: round(v["height"] * v["ratio"]), : round(v["width"] * v["ratio"])] + 0.5
    a, b = (columns / v["ratio"] - v["x"]) / v["k"], (rows / v["ratio"] - v["y"]) / v["k"]
    depth = plane.to_plane(space.editor.cursor)[2]
    at = plane.from_plane(np.stack([a, b, np.full_like(a, depth)], axis=-1).reshape(-1, 3))
    found = np.linalg.det(np.eye(3) + np.asarray(field.jacobian(at))).reshape(a.shape)
    a0, a1, b0, b1, *_ = Pane.of(waves().grid, list(PANES)[pane]).box
    return np.where((a > a0) & (a < a1) & (b > b0) & (b < b1), found, 1.0)


def test_folds_are_red_on_all_slices_while_the_drag_lasts_and_after(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor()
    space.editor.tissue = {}  # everywhere
    space.wait_settled()
    x, y = space.to_screen(AXIAL, caged.target[8])
    by = np.array([22.0, 6.0]) * space.scale(AXIAL)
    assert not drawn(space, AXIAL, RED).any()
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(x + by[0], y + by[1], steps=6)
    space.page.wait(f"{PAGE}.parts.row.panes[{AXIAL}].map.folds === 'tissue'")
    assert space.editor.points == caged  # the button is down: no edit has been made
    space.mouse.up()
    space.wait_settled()
    for pane in range(3):
        det, red = dets(space, pane, FitSettings(support=25.0).fit(space.editor.points)), drawn(space, pane, RED)
        assert det.shape == red.shape
        assert not red[det > 0.15].any()
        assert (det <= 0).sum() == 0 or red[det < -0.15].mean() > 0.5  # the lines over it are light
    assert drawn(space, AXIAL, RED).any()
    press(space, "Control+z")
    assert not drawn(space, AXIAL, RED).any()


def test_the_menu_and_a_key_switch_the_folds(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor()
    space.editor.tissue = {}  # everywhere
    space.drag(AXIAL, caged.target[8], tuple(np.array([22.0, 6.0]) * space.scale(AXIAL)))
    assert drawn(space, AXIAL, RED).any()
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "v")
    assert space.editor.overlay == "none"
    assert not drawn(space, AXIAL, RED).any()
    menu = space.page.page.locator(".dnb-ed-bar .dnb-ed-menu")
    assert menu.input_value() == "none"
    menu.select_option("folds")
    space.wait_settled()
    assert space.editor.overlay == "folds"
    assert drawn(space, AXIAL, RED).any()
    press(space, "c")  # before: there is no map to show
    assert not drawn(space, AXIAL, RED).any()


def test_folds_of_air_alone_are_grey(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor()
    space.editor.tissue = tissue_mask(Volume.from_array(np.zeros((8, 8, 8), np.uint8)))
    space.drag(AXIAL, caged.target[8], tuple(np.array([22.0, 6.0]) * space.scale(AXIAL)))
    assert not drawn(space, AXIAL, RED).any()
    assert drawn(space, AXIAL, GREY).any()


def test_the_grid_bends_from_the_first_edit_on(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor(show_grid=True, overlay="none")
    assert not drawn(space, AXIAL, GRID).any()
    space.drag(AXIAL, caged.target[8], (20, -12))
    lines = drawn(space, AXIAL, GRID)
    assert lines.mean() > 0.02
    space.page.page.locator(".dnb-sp-stage").first.focus()
    button = space.page.page.locator("[data-command=grid]")
    assert button.get_attribute("aria-pressed") == "true"
    press(space, "n")
    assert not space.editor.show_grid
    assert button.get_attribute("aria-pressed") == "false"
    assert not drawn(space, AXIAL, GRID).any()
    button.click()
    space.wait_settled()
    assert (drawn(space, AXIAL, GRID) == lines).all()


def test_the_grid_of_a_map_of_more_than_the_points_is_not_drawn(open_editor: Any, caged: ControlPoints) -> None:
    part = RigidPart(HalfSpace((-100.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    space = open_editor(options={"parts": (part,)}, show_grid=True, overlay="none")
    space.drag(AXIAL, caged.target[8], tuple(np.array([22.0, 6.0]) * space.scale(AXIAL)))
    assert not drawn(space, AXIAL, GRID).any()


def test_its_folds_are_those_that_python_finds(open_editor: Any, caged: ControlPoints) -> None:
    part = RigidPart(HalfSpace((-12.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    space = open_editor(options={"parts": (part,)})
    x, y = space.to_screen(AXIAL, caged.target[8])
    by = np.array([22.0, 6.0]) * space.scale(AXIAL)
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(x + by[0], y + by[1], steps=6)
    space.page.wait(f"{PAGE}.parts.row.panes[{AXIAL}].map.folds === 'tissue'")
    space.mouse.up()
    space.wait_settled()
    space.page.wait(f"Math.max(...{PAGE}.parts.row.panes[{AXIAL}].map.sampled?.raster.shape ?? []) > 48")  # at rest
    for pane in range(3):
        det, red = dets(space, pane, space.editor.fit()), drawn(space, pane, RED)
        assert not red[det > 0.4].any()
        assert (det <= 0).sum() == 0 or red[det < -0.2].mean() > 0.5
    assert drawn(space, AXIAL, RED).any()
    press(space, "v")
    assert not drawn(space, AXIAL, RED).any()
    press(space, "v", "Control+z")
    assert not drawn(space, AXIAL, RED).any()
