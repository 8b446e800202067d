"""The smaller widgets of the application with a real mouse: curve, colours, what is cut open, the table of points."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, eventually
from running_app import RunningApp

from deformnb.document.deformation import Deformation

pytestmark = pytest.mark.needs_browser


@pytest.fixture
def tab(browser: Any, app: RunningApp) -> Iterator[Tab]:
    def begin() -> None:
        app.application.session.deformation, app.application.session.transfer = Deformation(), "bone"
        app.application.act("front")

    app.application.thread.call(begin).result(30)
    opened = Tab(browser, app, size=(1000, 760))
    yield opened
    opened.close()


def go_to(tab: Tab, name: str) -> None:
    tab.page.get_by_role("tab", name=name).click()
    tab.page.wait_for_function("""(name) => { const parts = [...document.querySelectorAll('.dnb-app-inline')];
      return document.querySelector('.dnb-app-tabs [aria-selected=true]').innerText === name
        && parts.length > 0 && parts.every((part) => part.children.length); }""", arg=name, timeout=PATIENCE)


def middle(tab: Tab, selector: str) -> tuple[float, float]:
    box = tab.page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def hold(tab: Tab, selector: str, dx: float, dy: float) -> None:
    """Drag something and keep the button down."""
    x, y = middle(tab, selector)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + dx, y + dy, steps=6)


def changes(tab: Tab, before: Any, least: int = 150) -> Any:
    """The volume, once it looks otherwise."""
    end = time.monotonic() + PATIENCE / 1000
    while (np.abs((now := tab.volume()) - before) > 25).sum() < least:
        assert time.monotonic() < end, "the volume looks as before"
    return now


def test_the_volume_follows_the_curve_and_the_edit_comes_at_the_end(tab: Tab) -> None:
    session = tab.app.application.session

    def bend() -> None:
        session.edit_points(session.points.move(0, session.points.target[0] + [6.0, 4.0]))
        session.change(extrusion="modulate", curve="1")
        tab.app.application.act("beside")

    tab.app.application.thread.call(bend).result(30)
    tab.page.locator(".dnb-curve-editor [data-node='0']").wait_for()
    document, before = session.deformation, tab.volume()
    hold(tab, ".dnb-curve-editor [data-node='0'] .dnb-cv-dot", 0, 40)
    changes(tab, before, 60)
    assert session.deformation is document
    tab.page.mouse.up()
    tab.page.get_by_role("button", name="Undo: change curve").wait_for()
    tab.app.settled()
    assert session.step.curve[0] < 0.7
    assert session.step.curve[-1] == 1.0


def test_opacities_are_dragged_and_the_volume_shows_it_at_once(tab: Tab) -> None:
    session = tab.app.application.session
    before = tab.volume()
    go_to(tab, "Display")
    hold(tab, ".dnb-transfer-editor [data-node='2'] .dnb-cv-dot", 0, 300)
    changes(tab, before)
    assert session.transfer == "bone"
    tab.page.mouse.up()
    eventually(lambda: session.transfer_function.opacities[2][1] == 0)


def test_a_drag_whose_page_is_loaded_again_leaves_nothing_behind(tab: Tab) -> None:
    before = tab.volume()
    go_to(tab, "Display")
    hold(tab, ".dnb-transfer-editor [data-node='2'] .dnb-cv-dot", 0, 300)
    changes(tab, before)
    eventually(lambda: tab.app.application.volumes._transfer != tab.app.application.session.transfer_function)
    tab.page.reload()
    tab.drawn()
    eventually(lambda: tab.app.application.volumes._transfer == tab.app.application.session.transfer_function)
    eventually(lambda: (np.abs(tab.volume() - before) > 25).sum() < 20)


def test_a_cut_opens_the_volume_and_comes_back(tab: Tab) -> None:
    before = tab.volume()
    go_to(tab, "Display")
    tab.page.get_by_role("button", name="Open towards me").click()
    changes(tab, before)
    eventually(lambda: 0.5 in np.ptp(tab.app.application.live.clip, axis=1))
    tab.page.get_by_role("button", name="Show all", exact=True).click()
    eventually(lambda: tab.app.application.live.clip == ((0.0, 1.0),) * 3)
    assert (np.abs(tab.volume() - before) > 25).sum() < 20


def test_a_point_is_named_and_moved_in_the_table(tab: Tab) -> None:
    go_to(tab, "Points")
    cell = tab.page.locator('.dnb-pt-row[data-id="1"] [data-key="name"]')
    cell.dblclick()
    tab.page.keyboard.type("nose")
    tab.page.keyboard.press("Enter")
    eventually(lambda: tab.app.application.session.points.names[1] == "nose")
    tab.says("nose", ".dnb-editor")
    x, y = tab.point(2)
    tab.page.mouse.click(x, y)
    tab.page.locator('.dnb-pt-row[data-id="2"][aria-selected="true"]').wait_for()
    assert tab.page.locator(".dnb-pt-row[data-id]").count() == 4


@pytest.mark.nightly
def test_a_step_is_added_and_left_for_the_first_one(tab: Tab) -> None:
    session = tab.app.application.session
    go_to(tab, "Points")
    tab.page.get_by_role("button", name="Add step").click()
    tab.says("step 2 of 2")
    rows = tab.page.locator(".dnb-app-inline .dnb-il-row")
    assert rows.count() == 2
    assert rows.first.locator(".dnb-il-button").last.is_visible()
    rows.first.locator(".dnb-il-choose").click()
    tab.says("step 1 of 2")
    rows.first.locator(".dnb-il-switch").click()
    eventually(lambda: not session.deformation.steps[0].enabled)
    assert session.index == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_they_fit_the_drawer_and_its_colours(browser: Any, app: RunningApp, scheme: str) -> None:
    tab = Tab(browser, app, scheme=scheme, size=(1280, 800))
    for name in ("Display", "Points"):
        go_to(tab, name)
        wide = tab.page.evaluate("""() => ['.dnb-app-part', '.dnb-app-tabs', '.dnb-app-panel'].filter((name) =>
          [...document.querySelectorAll(name)].some((part) => part.scrollWidth > part.clientWidth + 1
            || part.scrollHeight > part.clientHeight + 1))""")
        assert wide == [], name
        papers = tab.page.evaluate("""() => ['curves', 'points-table', 'item-list'].flatMap((name) =>
          [...document.querySelectorAll(`.dnb-app-inline > .dnb-${name}`)]).map((part) =>
          getComputedStyle(part).backgroundColor)""")
        shades = [np.mean([float(n) for n in paper.strip("rgba()").split(",")[:3]]) for paper in papers]
        assert shades, name
        assert all(shade > 200 if scheme == "light" else shade < 60 for shade in shades), name
    tab.page.get_by_role("button", name="Light or dark").click()
    dark = scheme == "light"
    tab.page.wait_for_function(f"document.querySelector('.dnb-points-table').classList.contains('dnb-dark') === "
                               f"{str(dark).lower()}")
    tab.close()
