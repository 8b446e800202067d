"""The application's warning of matter that leaves the box, in a real browser: below the volume, with a way out."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser.app_tab import PATIENCE, Tab, cube
from running_app import RunningApp

from deformnb.session.session import Session

pytestmark = pytest.mark.needs_browser


@pytest.fixture(scope="module")
def app() -> Iterator[RunningApp]:
    with RunningApp(Session(cube(), view="+y", transfer="bone")) as running:
        yield running


@pytest.mark.nightly
def test_what_leaves_the_box_is_told_and_a_key_makes_it_larger(browser: Any, app: RunningApp) -> None:
    tab = Tab(browser, app, size=(1000, 640))
    session = app.application.session
    line = tab.page.locator(".dnb-app-cut")
    assert line.get_attribute("role") == "status"
    assert not line.is_visible()
    source = session.points.source
    far = 0.5 * float(source[:, 0].max() - source[:, 0].min())
    moved = session.points
    for name in moved.ids:
        moved = moved.move(name, moved.target[moved.index(name)] + [far, 0.0])
    app.application.thread.call(lambda: app.application._try(lambda: session.edit_points(moved, "a drag"))).result(30)
    line.wait_for(state="visible", timeout=PATIENCE)
    assert "Tissue leaves the box at the " in line.inner_text()
    box, half = line.bounding_box(), tab.page.locator(".dnb-app-half").nth(1).bounding_box()
    assert half["x"] <= box["x"]
    assert box["x"] + box["width"] <= half["x"] + half["width"]
    assert half["y"] + half["height"] / 2 < box["y"]
    assert box["y"] + box["height"] <= half["y"] + half["height"]
    if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
        tab.page.screenshot(path=str(Path(folder) / "app-cut-off.png"))
    button = line.get_by_role("button", name="Make the box larger")
    button.focus()
    tab.page.keyboard.press("Enter")
    line.wait_for(state="hidden", timeout=PATIENCE)
    assert session.output is not None
    assert session.exceeded_sides() == ()
    if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
        tab.drawn()
        tab.page.screenshot(path=str(Path(folder) / "app-larger.png"))
    tab.close()
