"""Drags of a finger as fast as hands make them: what is grabbed is dragged in each direction, and the page stays."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from browser.test_editor_touch import Fingers
from browser.test_standalone_page import EDITOR, Opened, pair

from deformnb.widgets.standalone import write_standalone

pytestmark = pytest.mark.needs_browser

PHONE = (390, 844)
FRAME = 0.016
"""Seconds from one movement of a finger to the next."""

DIRECTIONS = {"up": (0, -20), "down": (0, 20), "left": (-20, 0), "right": (20, 0)}


def drag_quickly(fingers: Fingers, start: Any, by: Any, seconds: float = 0.16) -> None:
    """A drag at the speed of a hand, which does not wait for the page."""
    (x, y), steps = start, round(seconds / FRAME)
    fingers.touch("touchStart", (x, y))
    for step in range(1, steps + 1):
        time.sleep(FRAME)
        fingers.touch("touchMove", (x + by[0] * step / steps, y + by[1] * step / steps))
    fingers.touch("touchEnd")


@pytest.fixture
def phone(browser: Any, tmp_path: Path) -> Any:
    write_standalone(tmp_path / "page.html", *pair())
    page = Opened(browser, tmp_path / "page.html", PHONE, "", has_touch=True, is_mobile=True)
    page.wait_settled()
    # There is something to scroll in both directions.
    page.js("{ document.body.style.padding = '600px 0'; scrollTo(0, 600); }")
    page.js("{ window.cancelled = 0; addEventListener('pointercancel', () => { cancelled += 1; }, true); }")
    yield page
    page.context.close()
    assert page.errors == []


def middle_of(page: Opened, number: int) -> tuple[float, float]:
    box = page.page.locator(f".dnb-ed-target[data-id='{number}'] .dnb-ed-hit").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def target_of(page: Opened, number: int) -> list[float]:
    found: list[float] = page.js(f"{EDITOR}.points.list.find((p) => p.id === {number}).target")
    return found


@pytest.mark.parametrize("seconds", [0.1, 0.16, 0.4])
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_each_of_three_drags_in_a_row_moves_its_point_and_scrolls_nothing(
    phone: Opened, direction: str, seconds: float
) -> None:
    number = phone.js(f"{EDITOR}.points.list.at(-1).id")
    fingers, scrolled = Fingers(phone.page), phone.js("scrollY")
    axis = 0 if direction in ("left", "right") else 1
    for _ in range(3):
        before = target_of(phone, number)
        drag_quickly(fingers, middle_of(phone, number), DIRECTIONS[direction], seconds)
        phone.wait_settled()
        by = target_of(phone, number)[axis] - before[axis]
        assert by * DIRECTIONS[direction][axis] > 0
        assert abs(by) > 0.5 * 20 / phone.js(f"{EDITOR}.viewport.view.k")
    assert phone.js("scrollY") == scrolled
    assert phone.js("cancelled") == 0


def test_a_swipe_beside_the_points_scrolls_the_page_also_where_the_editor_is_in_use(phone: Opened) -> None:
    number = phone.js(f"{EDITOR}.points.list.at(-1).id")
    fingers, scrolled = Fingers(phone.page), phone.js("scrollY")
    drag_quickly(fingers, middle_of(phone, number), (0, -20))
    phone.wait("document.activeElement.closest('.dnb-editor')")
    x, y = middle_of(phone, number)
    fingers.swipe((x + 60, y), (0, -150))
    phone.wait(f"scrollY > {scrolled + 50}")


def test_two_fingers_zoom_the_picture_and_not_the_page(phone: Opened) -> None:
    number = phone.js(f"{EDITOR}.points.list.at(-1).id")
    fingers, (x, y) = Fingers(phone.page), middle_of(phone, number)
    before = phone.js(f"({{...{EDITOR}.viewport.view}})")
    fingers.touch("touchStart", (x + 40, y + 30))
    fingers.touch("touchStart", (x + 40, y + 30), (x + 40, y + 60))
    for step in range(1, 11):
        time.sleep(FRAME)
        fingers.touch("touchMove", (x + 40, y + 30 - 3 * step), (x + 40, y + 60 + 3 * step))
    fingers.touch("touchEnd")
    phone.wait_settled()
    assert phone.js(f"{EDITOR}.viewport.view.k") > 1.5 * before["k"]
    assert phone.js("visualViewport.scale") == 1
    assert phone.js("cancelled") == 0
