"""Two tabs of the application that show one studio: each sees the pointer of the other, and what it moves."""

from __future__ import annotations

from typing import Any

import pytest
from browser.app_tab import PATIENCE, Tab
from browser.hosts import box_at_rest
from browser.pane_messages import message_script
from running_app import RunningApp

pytestmark = pytest.mark.needs_browser

OTHERS = "document.querySelector('.dnb-editor').deformnb.parts.tools.others.others"
MESSAGE = message_script(".dnb-editor")
POINTS = "document.querySelector('.dnb-editor').deformnb.parts.points.list"


def place(tab: Tab, a: float, b: float) -> tuple[float, float]:
    """Place in the window of a place of the picture."""
    box = box_at_rest(tab.page.locator(".dnb-ed-stage"))
    x, y, k = tab.page.evaluate(
        "(() => { const { x, y, k } = document.querySelector('.dnb-editor').deformnb.parts.viewport.view;"
        " return [x, y, k]; })()"
    )
    return box["x"] + x + k * a, box["y"] + y + k * b


def press(tab: Tab, at: tuple[float, float], to: tuple[float, float]) -> None:
    """Press the mouse at a place of the picture and move it, without letting go."""
    tab.page.mouse.move(*place(tab, *at))
    tab.page.mouse.down()
    tab.page.mouse.move(*place(tab, *to), steps=4)


def test_two_windows_see_each_other_and_lose_no_drag_in_silence(browser: Any, app: RunningApp) -> None:
    one = Tab(browser, app)
    assert one.page.evaluate(f"{OTHERS}.size") == 0  # nobody is there, and nothing is sent
    one.page.mouse.dblclick(*place(one, 12.0, 12.0))
    one.wait_for_points(5, 0)
    two = Tab(browser, app)
    two.wait_for_points(5, 0)
    for tab in (one, two):
        tab.page.wait_for_function(f"{OTHERS}.size === 1", timeout=PATIENCE)

    one.page.mouse.move(*place(one, 20.0, 9.0))
    two.page.wait_for_function(
        f"{OTHERS}.size && [...{OTHERS}.values()].some(({{ at }}) => at && Math.hypot(at[0] - 20, at[1] - 9) < 0.5)",
        timeout=PATIENCE,
    )
    assert two.page.locator(".dnb-ed-other-name").is_visible()
    x, y = place(two, 20.0, 9.0)
    two.page.wait_for_function(
        "([x, y]) => { const box = document.querySelector('.dnb-ed-other').getBoundingClientRect();"
        " return Math.hypot(box.x - x, box.y - y) < 4; }",
        arg=[x, y],
        timeout=PATIENCE,
    )

    # While one drags the point, the other cannot; when it lets go, the other is told.
    press(one, (12.0, 12.0), (16.0, 15.0))
    two.page.wait_for_function(f"[...{OTHERS}.values()][0].drags.length === 1", timeout=PATIENCE)
    press(two, (12.0, 12.0), (8.0, 8.0))
    two.page.wait_for_function(f"{MESSAGE}.endsWith('is being moved in another window')", timeout=PATIENCE)
    two.page.mouse.up()
    one.page.mouse.up()
    two.page.wait_for_function(f"{MESSAGE}.endsWith(' was moved in another window')", timeout=PATIENCE)
    for tab in (one, two):
        tab.wait_for_points(5, 1)
    assert two.page.evaluate(f"{POINTS}[4].target") == pytest.approx([16.0, 15.0], abs=0.6)

    one.close()
    two.page.locator(".dnb-ed-other").wait_for(state="hidden", timeout=PATIENCE)
    x, y = place(two, 16.0, 15.0)
    two.page.mouse.move(x, y)
    two.page.mouse.down()
    two.page.mouse.move(x - 20, y, steps=3)
    two.page.mouse.up()
    two.page.wait_for_function(f"{POINTS}[4].target[0] < 15.5", timeout=PATIENCE)  # nobody holds it any more
    two.close()
