"""Drags of a finger as fast as hands make them: what is grabbed is dragged in each direction, and the page stays."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, app_of_a_cube
from browser.test_editor_touch import Fingers
from browser.test_file_page import FilePage
from browser.test_standalone_page import EDITOR, MODELS, Opened, bar_with_a_ball, pair
from PIL import Image
from running_app import RunningApp

from deformnb.io import write_volume
from deformnb.widgets.file_pages import write_file_page
from deformnb.widgets.standalone import write_standalone
from deformnb_lessons.pages import write_lesson_page

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


class Phone(Protocol):
    """A page on a phone, of a file or of a server."""

    page: Any

    def js(self, expression: str) -> Any: ...

    def wait_settled(self) -> None: ...


class AppOnPhone(Tab):
    """The application on a phone."""

    def js(self, expression: str) -> Any:
        return self.page.evaluate(f"() => {expression}")

    def wait_settled(self) -> None:
        moving = f"!{EDITOR}.frames.isMoving && !{EDITOR}.frames.request"
        self.page.wait_for_function(f"() => {moving}", timeout=PATIENCE)


def watched(page: Any) -> Any:
    """The page with something to scroll in both directions, which counts cancelled pointers."""
    page.js("{ document.body.style.padding = '600px 0'; scrollTo(0, 600); }")
    page.js("{ window.cancelled = 0; addEventListener('pointercancel', () => { cancelled += 1; }, true); }")
    return page


def exported_page(browser: Any, folder: Path) -> Opened:
    write_standalone(folder / "page.html", *pair())
    return Opened(browser, folder / "page.html", PHONE, "", has_touch=True, is_mobile=True)


def lesson_page(browser: Any, folder: Path) -> Opened:
    write_lesson_page("affine", folder / "lesson.html")
    return Opened(browser, folder / "lesson.html", PHONE, "", has_touch=True, is_mobile=True)


def file_page(browser: Any, folder: Path, file: Path) -> Opened:
    write_file_page(folder / "file.html")
    page = FilePage(browser, folder / "file.html", PHONE, "", has_touch=True, is_mobile=True)
    page.open(file)
    page.wait_settled()
    # Two points in the picture, besides those in its corners.
    a0, a1, b0, b1 = page.js(f"({EDITOR}.picture.box)")
    for n, share in ((10, 0.4), (11, 0.6)):
        place = [a0 + share * (a1 - a0), b0 + 0.5 * (b1 - b0)]
        point = {"id": n, "name": "", "source": place, "target": place, "active": True, "weight": 1}
        page.js(f"{MODELS}.editor.update({{ points: [...{MODELS}.editor.get('points'), {json.dumps(point)}] }})")
    return page


def page_of_a_volume(browser: Any, folder: Path) -> Opened:
    write_volume(bar_with_a_ball(), folder / "ball.nii.gz")
    return file_page(browser, folder, folder / "ball.nii.gz")


def page_of_a_picture(browser: Any, folder: Path) -> Opened:
    rows, columns = np.mgrid[:90, :120]
    body = ((columns - 60) / 40) ** 2 + ((rows - 45) / 25) ** 2 < 1
    Image.fromarray(np.where(body, 200, 10).astype(np.uint8)).save(folder / "photo.png")
    return file_page(browser, folder, folder / "photo.png")


PAGES: dict[str, Callable[[Any, Path], Opened]] = {
    "exported": exported_page,
    "lesson": lesson_page,
    "file with a volume": page_of_a_volume,
    "file with a picture": page_of_a_picture,
}


@pytest.fixture
def phone(browser: Any, tmp_path: Path) -> Any:
    page = exported_page(browser, tmp_path)
    page.wait_settled()
    yield watched(page)
    page.context.close()
    assert page.errors == []


@contextmanager
def opened(kind: str, browser: Any, folder: Path) -> Iterator[Any]:
    """A page of that kind on a phone, or the application."""
    if kind == "application":
        with RunningApp(app_of_a_cube(folder)) as serving:
            tab = AppOnPhone(browser, serving, size=PHONE, has_touch=True, is_mobile=True)
            tab.wait_settled()
            yield watched(tab)
            tab.close()
        return
    page = PAGES[kind](browser, folder)
    page.wait_settled()
    yield watched(page)
    page.context.close()
    assert page.errors == []


def middle_of(page: Phone, number: int) -> tuple[float, float]:
    box = page.page.locator(f".dnb-editor .dnb-ed-target[data-id='{number}'] .dnb-ed-hit").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def target_of(page: Phone, number: int) -> list[float]:
    found: list[float] = page.js(f"{EDITOR}.points.list.find((p) => p.id === {number}).target")
    return found


def drag_three_times(phone: Phone, direction: str, durations: Sequence[float]) -> None:
    """Three drags in a row, each of which moves its point, and scrolls nothing."""
    number = phone.js(f"{EDITOR}.points.list.at(-1).id")
    fingers, scrolled = Fingers(phone.page), phone.js("scrollY")
    axis = 0 if direction in ("left", "right") else 1
    for seconds in durations:
        before = target_of(phone, number)
        drag_quickly(fingers, middle_of(phone, number), DIRECTIONS[direction], seconds)
        phone.wait_settled()
        by = target_of(phone, number)[axis] - before[axis]
        assert by * DIRECTIONS[direction][axis] > 0
        assert abs(by) > 0.5 * 20 / phone.js(f"{EDITOR}.viewport.view.k")
    assert phone.js("scrollY") == scrolled
    assert phone.js("cancelled") == 0


@pytest.mark.parametrize("seconds", [0.1, 0.16, 0.4])
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_each_of_three_drags_in_a_row_moves_its_point_and_scrolls_nothing(
    phone: Opened, direction: str, seconds: float
) -> None:
    drag_three_times(phone, direction, [seconds] * 3)


@pytest.mark.parametrize("kind", [*list(PAGES)[1:], "application"])
def test_on_each_page_drags_in_all_directions_move_points_and_two_fingers_zoom(
    kind: str, browser: Any, tmp_path: Path
) -> None:
    with opened(kind, browser, tmp_path) as phone:
        phone.js(f"{EDITOR}.model.set('stop_at_folds', false)")
        for direction in DIRECTIONS:
            drag_three_times(phone, direction, (0.1, 0.16, 0.4))
        zoom_with_two_fingers(phone)


def test_a_swipe_beside_the_points_scrolls_the_page_also_where_the_editor_is_in_use(phone: Opened) -> None:
    number = phone.js(f"{EDITOR}.points.list.at(-1).id")
    fingers, scrolled = Fingers(phone.page), phone.js("scrollY")
    drag_quickly(fingers, middle_of(phone, number), (0, -20))
    phone.wait("document.activeElement.closest('.dnb-editor')")
    x, y = middle_of(phone, number)
    fingers.swipe((x + 60, y), (0, -150))
    phone.wait(f"scrollY > {scrolled + 50}")


def zoom_with_two_fingers(phone: Phone) -> None:
    """Two fingers on the picture zoom it, and not the page."""
    fingers, box = Fingers(phone.page), phone.page.locator(".dnb-editor .dnb-ed-stage").bounding_box()
    x, y = box["x"] + 0.55 * box["width"], box["y"] + 0.6 * box["height"]
    before = phone.js(f"{EDITOR}.viewport.view.k")
    fingers.touch("touchStart", (x, y))
    fingers.touch("touchStart", (x, y), (x, y + 30))
    for step in range(1, 11):
        time.sleep(FRAME)
        fingers.touch("touchMove", (x, y - 3 * step), (x, y + 30 + 3 * step))
    fingers.touch("touchEnd")
    phone.wait_settled()
    assert phone.js(f"{EDITOR}.viewport.view.k") > 1.5 * before
    assert phone.js("visualViewport.scale") == 1
    assert phone.js("cancelled") == 0


def test_two_fingers_zoom_the_picture_and_not_the_page(phone: Opened) -> None:
    zoom_with_two_fingers(phone)
