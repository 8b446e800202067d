"""Sliders that cut a view open, by hand and by keys, and the bar that tells how long things are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.live_page import FOLLOWED, LivePage

from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.inputs.clip_controls import ClipControls
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

# Index x grows to the top, y to the right side, z to the front.
TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((16, 20, 24), (2.0, 1.0, 1.5), (0.0, 0.0, 0.0), TURNED, "mm")
BAR = "document.querySelector('.dnb-scale')"


def open_view(page: LivePage, **options: Any) -> LiveView:
    values = np.full(GRID.shape, 200, np.uint8)
    values[0, 0, 0] = 0
    view = LiveView(Volume(values, GRID), transfer="surface", width=400, height=300, settle_ms=60000, **options)
    page.add(view)
    page.wait_loaded()
    page.add(ClipControls(view), "clip")
    page.wait("document.querySelectorAll('.dnb-clip-row').length === 3")
    return view


def texts(page: LivePage, selector: str) -> list[str]:
    found: list[str] = page.page.evaluate("s => [...document.querySelectorAll(s)].map((n) => n.textContent)", selector)
    return found


def test_letters_say_where_each_slider_leads(page: LivePage) -> None:
    open_view(page)
    assert texts(page, ".dnb-clip-side") == ["I", "S", "L", "R", "P", "A"]
    labels = [end.get_attribute("aria-label") for end in page.page.locator(".dnb-clip-end").all()]
    assert labels[:4] == [
        "cut away from the bottom",
        "cut away from the top",
        "cut away from the left",
        "cut away from the right",
    ]
    assert texts(page, ".dnb-clip-value") == ["all", "all", "all"]


def test_dragging_an_end_cuts_the_volume_while_the_button_is_down(page: LivePage) -> None:
    view = open_view(page)
    whole = page.pixels()
    box = page.page.locator(".dnb-clip-track").nth(1).bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.page.mouse.move(box["x"] + 7, y)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 7 + 0.25 * (box["width"] - 14), y, steps=4)
    page.page.mouse.move(box["x"] + 7 + 0.5 * (box["width"] - 14), y, steps=4)
    page.wait_answered()
    assert view.clip[1][0] == pytest.approx(0.5, abs=0.03)
    assert view.clip[1][1] == 1.0
    held = page.pixels()
    assert (held != whole).any()
    page.page.mouse.move(box["x"] + box["width"], y, steps=6)  # never past the other end
    page.page.mouse.up()
    page.wait_answered()
    assert view.clip[1][0] == pytest.approx(0.98)
    assert page.errors == []


def test_keys_move_the_ends_and_both_can_be_reached(page: LivePage) -> None:
    view = open_view(page)
    ends = page.page.locator(".dnb-clip-end")
    ends.nth(5).focus()
    for _ in range(10):
        page.page.keyboard.press("ArrowLeft")
    page.wait_answered()
    assert view.clip[2] == (0.0, 0.9)
    page.page.keyboard.press("Shift+Tab")
    page.page.keyboard.press("ArrowRight")
    page.wait_answered()
    assert view.clip[2] == (0.01, 0.9)
    assert ends.nth(4).get_attribute("aria-valuetext") == "seen 1 to 90 percent"
    page.page.keyboard.press("End")
    page.wait_answered()
    assert view.clip[2] == (0.88, 0.9)
    far = page.page.evaluate("document.querySelectorAll('.dnb-clip-track')[2].classList.contains('dnb-clip-far')")
    assert far  # the lower end lies above, else neither could be taken hold of at the far side


def test_one_button_opens_towards_the_viewer_and_one_closes(page: LivePage) -> None:
    view = open_view(page)
    button = page.page.get_by_role("button", name="Open towards me")
    for direction, wanted in (
        ((0, 1, 0), (2, (0.0, 0.5))),
        ((0, -1, 0), (2, (0.5, 1.0))),
        ((0.2, 0.1, 1), (0, (0.5, 1.0))),
        ((0.9, 0.1, 0.1), (1, (0.0, 0.5))),
    ):
        view.set_camera(direction)
        button.click()
        page.wait_answered()
        axis, pair = wanted
        assert view.clip == tuple(pair if k == axis else (0.0, 1.0) for k in range(3)), direction
        # The viewer's half is gone: the middle of the half that stays lies behind the middle of all.
        shares = np.asarray(view.clip).mean(axis=1)
        mid = GRID.index_to_point(shares * GRID.shape[::-1] - 0.5)
        assert (mid - GRID.center) @ np.asarray(direction) > 0
    page.page.get_by_role("button", name="Show all").click()
    page.wait_answered()
    assert view.clip == ((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))
    assert page.page.get_by_role("button", name="Show all").is_disabled()


def test_sliders_follow_a_program_and_another_view(page: LivePage) -> None:
    view = open_view(page)
    view.set_clip(x=(0.1, 0.6))
    assert texts(page, ".dnb-clip-value")[0] == "10\u201360 %"
    controls = page.widgets["clip"]
    controls.view = None
    page.wait("document.querySelectorAll('.dnb-clip-row').length === 0")
    controls.view = view
    page.wait("document.querySelectorAll('.dnb-clip-row').length === 3")
    assert page.errors == []


@pytest.mark.parametrize(("zoom", "least"), [(1.0, 44), (3.0, 44), (20.0, 20)])
def test_the_bar_is_as_long_as_it_says(page: LivePage, zoom: float, least: float) -> None:
    view = open_view(page)
    view.set_camera((0, 1, 0), zoom=zoom)
    page.wait(FOLLOWED)
    words, unit = texts(page, ".dnb-scale-text")[0].split()
    assert unit == "mm"
    assert float(words) / 10 ** np.floor(np.log10(float(words))) in (1, 2, 5)
    width = page.page.evaluate(f"{BAR}.querySelector('.dnb-scale-bar').getBoundingClientRect().width")
    height = page.page.evaluate("document.querySelector('.dnb-view').deformnb.camera.height")
    assert width == pytest.approx(float(words) * 300 / height, abs=0.6)
    assert least * 0.8 < width <= 120.5


def test_a_perspective_has_no_bar_and_says_why(page: LivePage) -> None:
    view = open_view(page)
    view.set_camera(perspective=True)
    page.wait(FOLLOWED)
    assert texts(page, ".dnb-scale-text") == ["perspective"]
    assert "no scale for the whole picture" in page.page.evaluate(f"{BAR}.title")
    assert not page.page.locator(".dnb-scale-bar").is_visible()
    view.set_camera(perspective=False)
    page.wait(FOLLOWED)
    assert page.page.locator(".dnb-scale-bar").is_visible()
