"""Picture tools, diagnostics and history in the application, with a real mouse: all reach the session."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, eventually
from running_app import RunningApp

from deformnb.document.deformation import Deformation

pytestmark = pytest.mark.needs_browser

EDITOR = "document.querySelector('.dnb-editor').deformnb"


@pytest.fixture
def tab(browser: Any, app: RunningApp) -> Iterator[Tab]:
    def begin() -> None:
        session, editor = app.application.session, app.application.editor
        session.deformation = Deformation()
        session._history = type(session._history)()
        for name in ("mirror", "snap", "stop_at_folds", "brush_radius", "show_grid", "show_radius", "overlay"):
            setattr(editor, name, editor.traits()[name].default())
        app.application.act("front")

    app.application.thread.call(begin).result(30)
    opened = Tab(browser, app, size=(1000, 640))
    opened.page.locator(".dnb-ed-stage").focus()
    yield opened
    opened.close()


def stroke(tab: Tab, dx: float, dy: float, at: tuple[float, float] = (0.5, 0.5)) -> None:
    """With the mouse from a place of the picture, given as shares of it."""
    x, y = tab.page.evaluate(f"""([s, t]) => {{ const page = {EDITOR}, [a0, a1, b0, b1] = page.box;
      const stage = document.querySelector('.dnb-ed-stage').getBoundingClientRect(), {{ x, y, k }} = page.view;
      return [stage.left + x + k * (a0 + s * (a1 - a0)), stage.top + y + k * (b0 + t * (b1 - b0))]; }}""", list(at))
    mouse = tab.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + dx, y + dy, steps=6)
    mouse.up()


def test_keys_are_listed_within_the_picture(tab: Tab) -> None:
    tab.page.keyboard.press("?")
    listed = tab.page.locator(".dnb-ed-help")
    listed.wait_for()
    box, half = listed.bounding_box(), tab.page.locator(".dnb-app-half").first.bounding_box()
    assert box["x"] >= half["x"] and box["x"] + box["width"] <= half["x"] + half["width"]  # noqa: PT018
    assert box["y"] + box["height"] <= half["y"] + half["height"]
    assert "mirror" in listed.inner_text()
    tab.page.keyboard.press("Escape")
    listed.wait_for(state="hidden")


def test_helpers_of_the_toolbar_reach_python_and_the_drawer(tab: Tab) -> None:
    editor = tab.app.application.editor
    tab.page.locator("[data-command=more]").click()
    tab.page.get_by_role("menuitemcheckbox", name="Mirror", exact=True).click()
    eventually(lambda: editor.mirror["on"])
    tab.page.locator(".dnb-ed-stage").focus()
    for key, trait in (("Shift+N", "snap"), ("t", "stop_at_folds"), ("r", "show_radius")):
        tab.page.keyboard.press(key)
        eventually(lambda trait=trait: getattr(editor, trait))
    circles = tab.page.get_by_label("Radii", exact=True)
    eventually(circles.is_checked)
    tab.page.locator("[data-command=grid]").click()
    eventually(lambda: not tab.page.get_by_label("Grid", exact=True).is_checked())
    assert not editor.show_grid
    tab.page.locator(".dnb-ed-menu").select_option("area")
    eventually(lambda: editor.overlay == "area")
    tab.page.get_by_role("tab", name="Diagnostics").click()
    tab.says("Area (green grows", ".dnb-app-part")
    tab.page.reload()  # another page of the same session shows the same
    tab.drawn()
    assert tab.page.evaluate(f"['overlay', 'stop_at_folds', 'show_grid'].map((n) => {EDITOR}.model.get(n))") == [
        "area", True, False]
    assert tab.page.evaluate(f"{EDITOR}.pointTools.mirror.on")


def test_a_brush_pushes_and_a_locked_point_stays(tab: Tab) -> None:
    session = tab.app.application.session
    tab.page.keyboard.press("s")
    radius = tab.page.evaluate(f"{EDITOR}.brush.radius")
    tab.page.keyboard.press("]")
    eventually(lambda: tab.app.application.editor.brush_radius > radius)
    stroke(tab, 24, 0)
    eventually(lambda: "smudge 1" in session.points.names)
    assert (session.points.target - session.points.source)[4:, 0].max() > 0
    assert session.history["undo"]
    tab.page.keyboard.press("Escape")
    tab.page.keyboard.press("Control+z")
    tab.says("4 points, 0 moved")
    tab.page.wait_for_function(f"{EDITOR}.points.length === 4")  # drawn anew, a point loses the focus
    tab.page.locator("[data-id='1']").focus()
    tab.page.keyboard.press("Enter")
    tab.page.keyboard.press("l")
    eventually(lambda: session.points.locked.tolist() == [False, True, False, False])
    before = session.points
    tab.drag(1, 30, 10)
    tab.page.wait_for_function("document.querySelector('.dnb-ed-hint').innerText.includes('is locked')")
    tab.app.settled()
    assert session.points == before


def test_a_node_of_the_grid_becomes_a_point_where_it_is_dragged(tab: Tab) -> None:
    tab.page.get_by_label("Drag grid").check()
    tab.page.wait_for_function(f"{EDITOR}.gridNodes.isOn && {EDITOR}.gridNodes.made")
    stroke(tab, 30, 12)  # in the middle of 16 cells is a node
    tab.says("5 points, 1 moved")
    way = (tab.app.application.session.points.target - tab.app.application.session.points.source)[4]
    assert way == pytest.approx(np.array([30, 12]) / tab.page.evaluate(f"{EDITOR}.view.k"), rel=0.05)
    tab.page.get_by_label("Drag grid").uncheck()
    tab.page.wait_for_function(f"!{EDITOR}.gridNodes.isOn")


@pytest.mark.nightly
def test_a_drag_that_folds_is_told_unfolded_and_gone_back_behind(tab: Tab) -> None:
    session, page = tab.app.application.session, tab.page
    support = page.evaluate(f"0.4 * ({EDITOR}.box[1] - {EDITOR}.box[0])")
    tab.app.application.thread.call(lambda: tab.app.application.set("support", round(support, 1))).result(30)
    tab.add_in_the_middle()
    tab.drag(4, 90, 20)
    tab.says("folds ")
    page.locator(".dnb-app-folded").wait_for(timeout=PATIENCE)
    page.get_by_role("tab", name="Diagnostics").click()
    tab.says("% folded; smallest det J", ".dnb-app-facts")
    far = session.points.target.tolist()
    page.get_by_role("button", name="Unfold by stages").click()
    tab.says("none; smallest det J", ".dnb-app-facts")
    eventually(lambda: page.evaluate(f"{EDITOR}.model.get('settings').stages") == session.step.stages > 1)
    assert session.points.target.tolist() == far
    page.locator(".dnb-ed-menu").select_option("uncertainty")
    page.wait_for_function(f"{EDITOR}.model.get('uncertainty').byteLength > 0", timeout=PATIENCE)
    page.wait_for_function(f"{EDITOR}.overlay.key.innerText.includes('±')", timeout=PATIENCE)
    page.get_by_role("tab", name="History").click()
    tab.says("unfold by stages", ".dnb-app-state[aria-current=true]")
    page.locator(".dnb-app-state", has_text="add point").click()
    tab.says("add point", ".dnb-app-state[aria-current=true]")
    tab.says("5 points, 0 moved")
    assert session.step.stages == 1
    assert session.history["redo"].startswith("move point")
