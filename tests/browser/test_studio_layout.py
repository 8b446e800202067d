"""The whole studio at 1280 x 800 in JupyterLab and Voila, light and dark: no control is clipped or covered.

With a folder in DEFORMNB_SCREENSHOTS, each tab is left there as a picture, to be looked at.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser.hosts import Lab, Voila, start_host
from browser.studio_layout import GROUPS, choose, has_fault, lasting_faults, section_titles, tab_titles

pytestmark = pytest.mark.needs_browser

CELL = """
import numpy as np
from deformnb.datasets import PHANTOMS
from deformnb.widgets import Studio
volume = PHANTOMS["fish"].make((24, 32, 48))
bones = (volume.values > 0.6 * volume.values.max()).astype(np.uint8)
studio = Studio(volume, labels=bones, label_names={1: "bones"}, target=np.roll(volume.values, 2, axis=2))
points = studio.editor.points.add(studio.editor.points.target.mean(axis=0))
studio.editor.points = points.move(points.ids[-1], points.target[-1] + [8.0, 5.0])
studio
"""
READY = (
    "document.querySelector('.dnb-editor')?.deformnb?.parts.picture.painter.source && "
    "document.querySelector('.dnb-view canvas')"
)
NARROW = "(width) => { document.querySelector('.dnb-studio').style.maxWidth = width ? `${width}px` : ''; }"
PAPER = """getComputedStyle(document.querySelector('.dnb-studio')).backgroundColor.match(/[0-9.]+/g).slice(0, 3).reduce(
  (sum, part) => sum + Number(part), 0) / 3 < 110"""


@pytest.fixture(scope="module")
def window(browser: Any) -> Iterator[Any]:
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    yield opened
    opened.close()


def look(page: Any, name: str, may_scroll: str = "") -> None:
    """Go through all groups and sections; each is as its user needs it."""
    assert tab_titles(page) == list(GROUPS)
    found = {}
    titles = [title for group, sections in GROUPS.items() for title in (group, *sections)]
    for number, title in enumerate(titles):
        choose(page, title)
        if title in GROUPS:
            assert section_titles(page) == GROUPS[title]
        page.evaluate("() => document.querySelector('.dnb-studio').scrollIntoView({ block: 'end' })")
        found[title] = lasting_faults(page, may_scroll)
        if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
            page.screenshot(path=str(Path(folder) / f"{name}-{number:02d}.png"))
    assert {title: wrong for title, wrong in found.items() if wrong} == {}


@pytest.fixture(scope="module")
def studio_lab(window: Any, lab: Lab) -> Any:
    lab.open_notebook(window, [CELL])
    window.wait_for_function(READY, timeout=120_000)
    return lab


@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("width", [0, 620], ids=["wide", "narrow"])
def test_all_tabs_can_be_used_in_lab(studio_lab: Lab, window: Any, theme: str, width: int) -> None:
    studio_lab.dark(window, theme == "dark")
    window.evaluate(NARROW, width)
    # Twelve columns of numbers are wider than the panel; the table has a bar of its own.
    look(window, f"lab-{theme}-{width or 'wide'}", ".dnb-pt-scroller")


SPOIL = """([part, style]) => {
  const label = [...document.querySelectorAll(".dnb-studio label")].find((e) => e.textContent === "Trend");
  const spoilt = part === "label" ? label : label.parentElement, before = spoilt.style.cssText;
  spoilt.style.cssText += `; ${style}`;
  window.repair = () => { spoilt.style.cssText = before; };
}"""


@pytest.mark.parametrize(
    ("part", "style", "said"),
    [
        ("control", "margin-top: -30px !important", "covers"),
        ("control", "position: relative; left: 3000px", "leaves its box"),
        ("label", "flex: none !important; width: 10px !important; overflow: hidden", "is cut"),
    ],
)
def test_what_is_wrong_is_found(studio_lab: Lab, window: Any, part: str, style: str, said: str) -> None:
    window.evaluate(NARROW, 0)
    choose(window, "Interpolation")
    assert lasting_faults(window, ".dnb-pt-scroller") == []
    window.evaluate(SPOIL, [part, style])
    assert has_fault(window, said)
    window.evaluate("() => repair()")
    assert lasting_faults(window, ".dnb-pt-scroller") == []


def test_ctrl_s_saves_the_session_wherever_the_focus_is(studio_lab: Lab, window: Any) -> None:
    window.evaluate(NARROW, 0)
    button = window.locator(".dnb-save")
    window.locator(".dnb-ed-stage:visible").first.focus()  # there JupyterLab's own Ctrl+S does nothing
    assert "unsaved" in button.get_attribute("title")
    window.keyboard.press("Control+s")
    window.wait_for_function("document.querySelector('.dnb-studio').innerText.includes('Saved carp_phantom.json.')")
    window.wait_for_function("!document.querySelector('.dnb-save').title.includes('unsaved')")
    assert (studio_lab.folder / studio_lab.place / "carp_phantom.json").stat().st_size > 0
    window.locator("body").press("Control+s")  # elsewhere it is the notebook's alone
    assert window.evaluate("document.querySelectorAll('.dnb-studio').length") == 1


PANES = """() => [".dnb-studio-panes", ".dnb-pane-picture", ".dnb-pane-volume", ".dnb-studio-panel"].map(
  (part) => { const { left, right, top, bottom } = document.querySelector(part).getBoundingClientRect();
    return { left, right, top, bottom }; })"""


def test_the_panel_stands_beside_the_pictures_and_below_them_where_the_page_is_narrow(
    studio_lab: Lab, window: Any
) -> None:
    window.evaluate(NARROW, 0)
    window.wait_for_function("document.querySelector('.dnb-panes-stacked')")  # a fish is longer than it is high
    panes, picture, volume, panel = window.evaluate(PANES)
    assert panel["left"] >= panes["right"] - 1
    assert panel["bottom"] == pytest.approx(panes["bottom"], abs=1)
    assert volume["top"] >= picture["bottom"]
    window.evaluate(NARROW, 620)
    panes, picture, volume, panel = window.evaluate(PANES)
    assert panel["top"] >= panes["bottom"] - 1
    assert panel["left"] == pytest.approx(panes["left"], abs=1)
    window.evaluate(NARROW, 0)


def test_a_menu_opens_under_its_button_and_closes_by_escape_and_by_a_press_beside_it(
    studio_lab: Lab, window: Any
) -> None:
    window.evaluate(NARROW, 0)
    for name, words in (("History", "the beginning"), ("Examples", "Bend it"), ("Export", "Write")):
        button = window.locator(".dnb-head").get_by_role("button", name=name, exact=True)
        button.click()
        menu = window.locator(f".dnb-menu-{name.lower()}")
        menu.get_by_text(words).first.wait_for()
        assert button.get_attribute("aria-expanded") == "true"
        window.keyboard.press("Escape")
        menu.wait_for(state="hidden")
    button.click()
    menu.wait_for()
    window.locator(".dnb-pane .dnb-ed-stage").click(position={"x": 4, "y": 4})
    menu.wait_for(state="hidden")
    assert button.get_attribute("aria-expanded") == "false"


def test_an_example_is_applied_and_undone_at_once(studio_lab: Lab, window: Any) -> None:
    editor = "document.querySelector('.dnb-studio-panes .dnb-editor').deformnb.parts"
    before = window.evaluate(f"() => JSON.stringify({editor}.points.list)")
    window.locator(".dnb-head").get_by_role("button", name="Examples", exact=True).click()
    window.locator(".dnb-menu-examples").get_by_role("button", name="Thompson's fish").click()
    window.locator(".dnb-menu-examples").wait_for(state="hidden")  # the pictures are not covered by it
    window.wait_for_function(f"{editor}.points.list.length === 56")
    window.locator(".dnb-head button[title^='Undo: example']").click()
    window.wait_for_function(f"(before) => JSON.stringify({editor}.points.list) === before", arg=before)


@pytest.fixture(scope="module")
def voila(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Voila]:
    with start_host(Voila, tmp_path_factory.mktemp("voila")) as server:
        server.write_notebook([CELL], "studio.ipynb")
        yield server


@pytest.mark.nightly
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_all_tabs_can_be_used_in_voila(voila: Voila, window: Any, theme: str) -> None:
    window.goto(f"{voila.url('/voila/render/studio.ipynb')}&theme={theme}", timeout=90_000)
    window.wait_for_function(READY, timeout=120_000)
    window.wait_for_function(f"({PAPER}) === {str(theme == 'dark').lower()}")  # its colours come after the widgets
    look(window, f"voila-{theme}", ".dnb-pt-scroller")
