"""Any view as the picture, by a real mouse: picture and volume coincide, and an object is opened along that view."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

pytestmark = pytest.mark.needs_browser

STUDIO_SIZE = (1200, 720)
TURN = (-70, 45)  # CSS pixels of the drag that turns the volume


def nut() -> Volume:
    """A shell around a bright kernel, aslant in its box."""
    z, y, x = np.indices((40, 44, 48)).astype(float)
    a, b, c = x - 22, y - 22, z - 20
    u, v = (a + b) / np.sqrt(2), (a - b) / np.sqrt(2)
    away = np.sqrt((u / 17) ** 2 + (v / 11) ** 2 + (c / 12) ** 2)
    values = 95.0 * ((away < 1) & (away > 0.72)) + 235.0 * (away < 0.6)
    return Volume(values.astype(np.uint8), Grid((40, 44, 48), (1.0, 1.0, 1.25)), "nut")


@pytest.fixture
def tab(browser: Any, tmp_path: Path) -> Iterator[Tab]:
    with RunningApp(Application(nut(), side="+y", folder=tmp_path)) as app:
        opened = Tab(browser, app, size=STUDIO_SIZE)
        yield opened
        opened.close()


def turn(tab: Tab, by: tuple[int, int] = TURN) -> None:
    box = tab.page.locator(".dnb-live .dnb-canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + by[0], y + by[1], steps=8)
    tab.page.mouse.up()


def edit_view(tab: Tab, name: str) -> None:
    """Press the button, and wait for the picture."""
    tab.page.locator(".dnb-edit-view").click()
    wait_for_view(tab, name)


def wait_for_view(tab: Tab, name: str) -> None:
    tab.page.wait_for_function(
        """(name) => { const label = document.querySelector('.dnb-plane-label');
          return !label.hidden && label.querySelector('.dnb-plane-name').textContent === name; }""",
        arg=name,
        timeout=PATIENCE,
    )
    tab.app.wait_idle()
    tab.page.wait_for_function(
        """() => { const { frames, parts } = document.querySelector('.dnb-editor').deformnb;
          return !parts.model.get('waiting') && !frames.isMoving && !frames.request; }""",
        timeout=PATIENCE,
    )


def centre_of(image: NDArray[np.float64], middle: tuple[float, float]) -> NDArray[np.float64]:
    """The centre of the bright ball, in pixels from the middle of the pane."""
    rows, columns = np.nonzero(image > 0.6 * image.max())
    return np.array([columns.mean() - middle[0], rows.mean() - middle[1]])


def test_picture_and_volume_coincide_to_the_pixel(tab: Tab) -> None:
    """A ball in the MIP of the picture and in the MIP of the volume, at its place on the pane."""
    values = np.zeros((40, 44, 48), np.uint8)
    z, y, x = np.indices(values.shape)
    values[(x - 39) ** 2 + (y - 12) ** 2 + (z - 31) ** 2 < 10] = 255
    tab.app.application.thread.call(
        lambda: tab.app.studio.open_volume(Volume(values, Grid(values.shape), "ball"))
    ).result(60)
    tab.wait_drawn()
    session, view = tab.app.studio.session, tab.app.studio.view
    tab.app.application.thread.call(lambda: setattr(view, "projection", "mip")).result(30)
    turn(tab)
    edit_view(tab, "view 1")
    assert session.steps.titles() == ["view 1"]
    camera = tab.page.evaluate(
        "() => { const c = document.querySelector('.dnb-live').deformnb.camera; return [c.direction, c.up]; }"
    )
    assert_allclose(session.editing.plane.normal, camera[0], atol=1e-9)
    assert_allclose(np.negative(session.editing.plane.v), camera[1], atol=1e-9)
    ball = session.volume.grid.index_to_point([39.0, 12.0, 31.0])
    scale = tab.page.evaluate("() => document.querySelector('.dnb-editor').deformnb.parts.viewport.view")
    a, b, _ = session.editing.plane.to_plane(ball)
    drawn = [scale["k"] * a + scale["x"] - scale["width"] / 2, scale["k"] * b + scale["y"] - scale["height"] / 2]
    seen = tab.page.evaluate(
        """(place) => { const { spacePoints: { camera } } = document.querySelector('.dnb-live').deformnb;
          const [x, y] = camera.see(place).at;
          return [x - camera.box.left - camera.box.width / 2, y - camera.box.top - camera.box.height / 2]; }""",
        list(map(float, ball)),
    )
    assert_allclose(drawn, seen, atol=0.01)
    volume = tab.volume()
    ratio = volume.shape[0] / tab.page.locator(".dnb-live .dnb-canvas").bounding_box()["height"]
    found = centre_of(volume, (volume.shape[1] / 2, volume.shape[0] / 2)) / ratio
    assert_allclose(found, seen, atol=0.5 * scale["k"])  # half a voxel: the disc is some voxels


def test_an_object_is_opened_along_an_oblique_view_in_three_gestures(tab: Tab) -> None:
    page, pictures = tab.page, tab.app.session.pictures
    # A dark shell that hides the white kernel.
    transfer = TransferFunction(((60, 0.1, 0.1, 0.3), (130, 0.1, 0.1, 0.3), (200, 1, 1, 1)), ((40, 0), (80, 1)), 1.0)
    tab.app.application.thread.call(lambda: pictures.set_trait("transfer", transfer)).result(30)
    tab.app.wait_idle()
    turn(tab)  # the first
    edit_view(tab, "view 1")  # the second
    before = (tab.volume() > 170).sum()
    page.get_by_text("Cut it open", exact=True).first.click()  # the third
    page.wait_for_function("() => document.querySelector('.dnb-editor').deformnb.parts.points.shapes.cuts.length === 1")
    tab.app.wait_idle()
    assert tab.app.session.steps.titles() == ["view 1"]
    after = (tab.volume() > 170).sum()
    assert after > before + 400  # the kernel
    # The frame follows the camera, and E on the volume comes back to the next view.
    outline = "document.querySelector('.dnb-plane path').getAttribute('d')"
    frame = page.evaluate(outline)
    turn(tab, (60, 10))
    page.wait_for_function(f"(d) => {outline} !== d", arg=frame)
    page.keyboard.press("e")
    wait_for_view(tab, "view 2")
    assert [step.name for step in tab.app.session.editing.deformation.steps] == ["view 1", "view 2"]
    page.locator(".dnb-pane-picture select").first.select_option(label="view 1")
    wait_for_view(tab, "view 1")
    assert tab.app.session.editing.index == 0
    plane = tab.app.session.editing.plane
    assert_allclose(tab.camera["direction"], plane.normal, atol=1e-6)  # the camera has come back with the picture


def test_the_panes_are_arranged_for_the_side_of_the_picture_at_once(browser: Any, tmp_path: Path) -> None:
    """A rod from its side: picture and volume above each other; from its end: side by side."""
    values = np.zeros((24, 24, 120), np.uint8)
    values[6:18, 6:18, 6:114] = 200
    with RunningApp(Application(Volume(values, Grid(values.shape), "rod"), side="+y", folder=tmp_path)) as app:
        tab = Tab(browser, app, size=STUDIO_SIZE)
        stacked = tab.page.locator(".dnb-panes-stacked")
        stacked.wait_for(timeout=PATIENCE)
        sides = tab.page.locator(".dnb-pane-picture select").first
        sides.select_option(label="from the right (+x)")
        stacked.wait_for(state="detached", timeout=PATIENCE)
        sides.select_option(label="from the front (+y)")
        stacked.wait_for(timeout=PATIENCE)
        tab.close()
