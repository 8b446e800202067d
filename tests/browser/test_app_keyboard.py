"""The application by keys alone: a face is widened on both sides, and cut and pulled open."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, wait_until
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS

pytestmark = pytest.mark.needs_browser

MOST_STOPS = 60  # of Tab from the top of the page to the picture
READY = """() => document.querySelector('.dnb-editor')?.deformnb?.parts.picture.painter.source
  && document.querySelector('.dnb-view')?.deformnb?.field"""
FOCUSED = "() => document.activeElement.getAttribute('aria-label') ?? ''"
ON_STAGE = "() => document.activeElement.matches('.dnb-pane-picture .dnb-ed-stage')"


@pytest.fixture(scope="module")
def face_app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    made = Application(PHANTOMS["head"].make((48, 48, 48)), side="-y", folder=tmp_path_factory.mktemp("face"))
    with RunningApp(made) as serving:
        yield serving


@pytest.fixture
def page(browser: Any, face_app: RunningApp) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened = context.new_page()
    opened.goto(face_app.server.url)
    opened.wait_for_function(READY, timeout=PATIENCE)
    for _ in range(MOST_STOPS):
        if opened.evaluate(ON_STAGE):
            break
        opened.keyboard.press("Tab")
    assert opened.evaluate(ON_STAGE)
    yield opened
    context.close()


def press(page: Any, key: str, times: int = 1) -> None:
    for _ in range(times):
        page.keyboard.press(key)


def test_a_face_is_widened_on_both_sides(page: Any, face_app: RunningApp) -> None:
    editing = face_app.session.editing
    before = editing.points
    press(page, "Enter")  # a point in the middle
    page.wait_for_function(f"() => ({FOCUSED})().startsWith('Point {len(before) + 1}')")
    press(page, "Alt+Shift+ArrowLeft", 2)  # the point itself goes to the cheek
    wait_until(lambda: len(editing.points) == len(before) + 1)
    press(page, "m")
    press(page, "ArrowLeft", 3)  # and outwards, as does its partner
    wait_until(lambda: len(editing.points) == len(before) + 2)

    def are_mirrored() -> bool:  # once the last of the keys has come
        one, other = (editing.points.target - editing.points.source)[-2:]
        return abs(one[0]) > 0 and one == pytest.approx(other * [-1, 1], abs=1e-6)

    wait_until(are_mirrored)
    sources = editing.points.source[-2:]
    assert sources[0, 1] == pytest.approx(sources[1, 1], abs=1e-6)
    apart, apart_before = (np.ptp(places[-2:, 0]) for places in (editing.points.target, editing.points.source))
    assert apart > apart_before  # wider
    press(page, "m")
    press(page, "Control+z")
    wait_until(lambda: len(editing.points) == len(before) + 1)
    while editing.points != before:
        face_app.application.thread.call(editing.undo).result(30)


def test_a_face_is_cut(page: Any, face_app: RunningApp) -> None:
    editing = face_app.session.editing
    press(page, "x")
    press(page, "Shift+ArrowLeft", 5)
    press(page, "Enter")
    press(page, "Shift+ArrowRight", 10)
    press(page, "Enter", 2)  # the second on the same place: done
    wait_until(lambda: len(editing.step.cuts) == 1)
    assert page.evaluate(FOCUSED) == "Cut 1, open line with 2 corners"
    pull = page.get_by_role("button", name="Pull open")
    for _ in range(MOST_STOPS):
        if pull.evaluate("(button) => button === document.activeElement"):
            break
        press(page, "Tab")
    press(page, "Enter")
    wait_until(lambda: np.abs(editing.points.target - editing.points.source).max() > 0)
