"""The volume view in a real browser: Python's pictures on the page, turned by hand, in the right place."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_text
from PIL import Image

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.volume_view import VolumeView

pytestmark = [pytest.mark.needs_browser, pytest.mark.needs_gl]

GRID = Grid((20, 24, 16), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0))
SIZE = (240, 180)
PAGE = "document.querySelector('.dnb-view').deformnb"


@pytest.fixture
def page(browser: Any) -> Iterator[LivePage]:
    opened = LivePage(browser)
    yield opened
    for widget in opened.widgets.values():
        widget.close()
    opened.close()


def ball() -> Volume:
    k = np.indices(GRID.shape)[::-1] - np.array([5.0, 8.0, 9.0]).reshape(3, 1, 1, 1)
    return Volume(np.clip(60 * (5.5 - np.sqrt((k**2).sum(axis=0))), 0, 200).astype(np.uint8), GRID, "ball")


def open_view(page: LivePage, **options: Any) -> VolumeView:
    view = VolumeView(
        ball(),
        **{
            "transfer": "surface",
            "width": SIZE[0],
            "height": SIZE[1],
            "settle_ms": 30.0,
            "background": "dark",
            **options,
        },
    )
    page.add(view)
    drawn(page)
    return view


def drawn(page: LivePage, after: int = 0) -> None:
    """Until a full picture is on the screen, later than ``after`` of them."""
    page.wait(f"{PAGE}.isFull && {PAGE}.count > {after}", 60)


def changed(page: LivePage, change: Any) -> None:
    count = page.page.evaluate(f"{PAGE}.count")
    change()
    drawn(page, count)


def pixels(page: LivePage) -> np.ndarray:
    page.flush()
    data = page.page.evaluate(f"{PAGE}.elements.canvas.toDataURL('image/png').split(',')[1]")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)


def middle(image: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(image.max(axis=2) > 64)
    return np.array([columns.mean(), rows.mean()])


def test_the_page_shows_what_python_draws_and_what_moves_it(page: LivePage) -> None:
    view = open_view(page)
    assert np.abs(pixels(page) - view.still(SIZE)).mean() < 3  # JPEG
    assert page.page.is_hidden(".dnb-waiting")
    changed(page, lambda: view.set_camera((0, 1, 0)))
    before = middle(pixels(page))
    plane = Plane.from_view(GRID, "+y")
    away = ControlPoints.from_arrays([[10.0, 10.0]], [[14.0, 13.0]])
    changed(
        page, lambda: view.show_deformation(Deformation.from_picture_points(GRID, plane, away, trend="translation"))
    )
    right, down = middle(pixels(page)) - before
    assert right > 8  # four lengths of more than three pixels each
    assert down > 6
    assert page.errors == []


def test_hands_and_keys_turn_the_picture(page: LivePage) -> None:
    view = open_view(page)
    changed(page, lambda: view.set_camera((0, 1, 0)))
    before = middle(pixels(page))
    mouse = page.page.mouse

    def drag() -> None:
        mouse.move(120, 90)
        mouse.down()
        mouse.move(160, 90, steps=4)
        page.wait(f"{PAGE}.answered > 0", 60)  # pictures come while the button is down
        mouse.up()
        page.wait("models.view.saved.length > 0")

    changed(page, drag)
    assert view.camera["direction"][0] > 0.3
    assert abs(middle(pixels(page)) - before).max() > 3
    page.page.focus(".dnb-canvas")
    page.page.keyboard.press("+")
    page.wait("models.view.saved.length > 1")
    assert view.camera["zoom"] > 1.05
    page.page.evaluate("document.querySelector('[aria-label=\"view from above\"]').click()")
    page.wait("models.view.saved.length > 2")
    np.testing.assert_allclose(view.camera["direction"], [0, 0, -1], atol=1e-6)
    assert page.page.text_content(".dnb-right") == "R"
    assert page.page.evaluate("document.querySelector('.dnb-canvas').dataset.lmSuppressShortcuts") == "true"
    assert page.errors == []


def test_both_pictures_side_by_side_and_in_turn(page: LivePage) -> None:
    view = open_view(page)
    plane = Plane.from_view(GRID, "+y")
    away = ControlPoints.from_arrays([[10.0, 10.0]], [[14.0, 13.0]])
    view.show_deformation(Deformation.from_picture_points(GRID, plane, away, trend="translation"))
    changed(page, lambda: setattr(view, "shows", "side_by_side"))
    both = pixels(page)
    left, right = both[:, : SIZE[0] // 2], both[:, SIZE[0] // 2 :]
    assert (middle(right) - middle(left))[1] > 2
    assert page.page.text_content(".dnb-frame:nth-of-type(2) .dnb-caption, .dnb-frame .dnb-caption") == "original"
    changed(page, lambda: setattr(view, "shows", "flicker"))
    page.wait(f"{PAGE}.layers.length === 2", 60)
    page.wait(f"{PAGE}.elements.flicker.layer === 1", 60, passing=True)
    one = middle(pixels(page))
    page.wait(f"{PAGE}.elements.flicker.layer === 0", 60, passing=True)
    assert np.abs(middle(pixels(page)) - one).max() > 2
    changed(page, lambda: setattr(view, "shows", "wipe"))
    page.page.locator(".dnb-wipe").press("End")  # all of it is the original
    one = middle(pixels(page))
    page.page.locator(".dnb-wipe").press("Home")
    assert np.abs(middle(pixels(page)) - one).max() > 2
    assert page.errors == []


def test_sizes_follow_the_element_and_the_theme_the_page(page: LivePage) -> None:
    view = open_view(page, background="auto")
    page.page.emulate_media(color_scheme="dark")
    page.wait(f"{PAGE}.elements.theme.name === 'dark'")
    changed(page, lambda: page.page.evaluate("document.getElementById('root').style.width = '160px'"))
    page.wait(f"{PAGE}.elements.canvas.width === 160")
    page.wait(f"{PAGE}.layers[0].width === 160", 60)
    assert view.stats()["width"] == 160
    assert pixels(page)[0, 0].max() < 60
    page.page.emulate_media(color_scheme="light")
    page.wait(f"{PAGE}.elements.theme.name === 'light'")
    page.wait("document.querySelector('.dnb-view').dataset.background === 'light'")
    page.wait_until(lambda: pixels(page)[0, 0].min() > 220)
    assert page.errors == []


def test_a_notice_is_shown_and_a_page_that_goes_gives_the_window_back(page: LivePage) -> None:
    view = open_view(page)
    view.pictures.show_notice("something is wrong")
    page.flush()
    assert message_text(page.page) == "something is wrong"
    page.page.evaluate("() => models.view.cleanups.splice(0).forEach((f) => f())")
    page.wait("models.view.sent.at(-1).type === 'bye'")
    page.wait_until(lambda: view.scene.loop is None)
    page.outbox.clear()
    page.draw()
    drawn(page)
    assert message_text(page.page) == "something is wrong"
    assert page.page.evaluate("document.querySelectorAll('canvas').length") == 1
    assert page.errors == []


def test_a_fold_is_red_and_a_badge_says_what_that_means(page: LivePage) -> None:
    view = open_view(page, projection="composite", transfer="bone")
    plane = Plane.from_view(GRID, "-z")
    changed(page, lambda: view.show(Volume(np.full(GRID.shape, 200, np.uint8), GRID, "block")))
    changed(page, lambda: view.set_camera(plane.normal, [-c for c in plane.v]))
    corners = plane.to_plane(GRID.corners())[:, :2]
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    at = low + size * np.array([[0.05, 0.05], [0.95, 0.05], [0.05, 0.95], [0.95, 0.95], [0.3, 0.5], [0.6, 0.5]])
    far = ControlPoints.from_arrays(at, at + np.eye(6)[:, 4:5] * [0.5 * size[0], 0.0])
    changed(page, lambda: view.show_deformation(Deformation.from_picture_points(GRID, plane, far)))
    r, g, b = np.moveaxis(pixels(page), -1, 0)
    painted = (r > g + 30) & (r > b + 30)
    rows, columns = np.nonzero(painted)
    assert painted.sum() > 300
    assert columns.mean() > SIZE[0] / 2 + 5  # ahead of the point, on its way to the right
    assert abs(rows.mean() - SIZE[1] / 2) < 15
    assert message_text(page.page) == "the map folds: tissue there is red"
    changed(page, lambda: setattr(view, "show_folds", False))
    r, g, _ = np.moveaxis(pixels(page), -1, 0)
    assert not (r > g + 30).any()
    assert message_text(page.page) == ""
