"""Pages that are read from right to left, and pages enlarged four times: hands meet what they point at."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.hosts import box_at_rest

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("size", "direction"), [((900, 700), "rtl"), ((320, 260), "ltr"), ((320, 260), "rtl")])
def test_a_drag_goes_where_the_hand_goes_from_right_to_left_and_enlarged(
    browser: Any, picture: Picture, points: ControlPoints, size: tuple[int, int], direction: str
) -> None:
    page = EditorOnPage(browser, Editor(picture, points), size)  # 1280 x 1040 at 400 % has room for 320 x 260
    page.page.evaluate("(direction) => { document.documentElement.dir = direction; }", direction)
    page.page.locator(".dnb-ed-stage").scroll_into_view_if_needed()
    box_at_rest(page.page.locator(".dnb-ed-stage"))
    page.wait_settled()
    here, there = page.to_screen(points.target[4]), page.to_screen(points.target[4] + [3.0, -2.0])
    page.page.mouse.move(*here)
    page.page.mouse.down()
    page.page.mouse.move(*there, steps=4)
    page.page.mouse.up()
    moved = page.points.target[4] - points.target[4]
    step = 1 / page.js(f"{PAGE}.viewport.view.k")
    assert np.abs(moved - [3.0, -2.0]).max() <= 1.5 * step
    assert page.js("document.documentElement.scrollWidth <= window.innerWidth")  # nothing to scroll to sideways
    assert page.errors == []
    page.close()
