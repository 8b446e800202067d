"""The whole studio at 1280 x 800 in JupyterLab and Voila, light and dark: no control is clipped or covered.

With a folder in DEFORMNB_SCREENSHOTS, each tab is left there as a picture, to be looked at.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser.hosts import Lab, Voila, running
from browser.studio_layout import choose, faults, lasting_faults, tabs_of

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
TITLES = ["Picture", "Points", "Steps", "Cuts & parts", "Interpolation", "Depth", "Diagnostics", "Fit", "Grids",
          "Animation", "Volume", "History", "Files"]
READY = "document.querySelector('.dnb-editor')?.deformnb?.painter.source && document.querySelector('.dnb-view canvas')"
NARROW = "(width) => { document.querySelector('.dnb-studio').style.maxWidth = width ? `${width}px` : ''; }"
PAPER = """getComputedStyle(document.querySelector('.dnb-editor')).backgroundColor.match(/[0-9.]+/g).slice(0, 3).reduce(
  (sum, part) => sum + Number(part), 0) / 3 < 110"""


@pytest.fixture(scope="module")
def window(browser: Any) -> Iterator[Any]:
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    yield opened
    opened.close()


def look(page: Any, name: str, may_scroll: str = "") -> None:
    """Go through all tabs; each is as its user needs it."""
    page.locator(".dnb-studio .lm-TabBar-tab").nth(len(TITLES) - 1).wait_for()
    assert tabs_of(page) == TITLES
    found = {}
    for number, title in enumerate(TITLES):
        choose(page, title)
        page.evaluate("() => document.querySelector('.dnb-studio').scrollIntoView({ block: 'end' })")
        found[title] = lasting_faults(page, may_scroll)
        if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
            page.screenshot(path=str(Path(folder) / f"{name}-{number:02d}.png"))
    assert {title: wrong for title, wrong in found.items() if wrong} == {}


@pytest.fixture(scope="module")
def in_lab(window: Any, lab: Lab) -> Any:
    lab.open_notebook(window, [CELL])
    window.wait_for_function(READY, timeout=120_000)
    return lab


@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.nightly)])
@pytest.mark.parametrize("width", [0, 620], ids=["wide", "narrow"])
def test_all_tabs_can_be_used_in_lab(in_lab: Lab, window: Any, theme: str, width: int) -> None:
    in_lab.dark(window, theme == "dark")
    window.evaluate(NARROW, width)
    # Twelve columns of numbers are wider than a narrow page; the table has a bar of its own.
    look(window, f"lab-{theme}-{width or 'wide'}", ".dnb-pt-scroller" if width else "")


SPOIL = """([part, style]) => {
  const label = [...document.querySelectorAll(".dnb-studio label")].find((e) => e.textContent === "Trend");
  const spoilt = part === "label" ? label : label.parentElement, before = spoilt.style.cssText;
  spoilt.style.cssText += `; ${style}`;
  window.repair = () => { spoilt.style.cssText = before; };
}"""


@pytest.mark.parametrize(("part", "style", "said"), [
    ("control", "margin-left: -200px", "covers"), ("control", "margin-left: 3000px; flex: none", "leaves its box"),
    ("label", "width: 10px; min-width: 0; overflow: hidden", "is cut"),
])
def test_what_is_wrong_is_found(in_lab: Lab, window: Any, part: str, style: str, said: str) -> None:
    window.evaluate(NARROW, 0)
    choose(window, "Interpolation")
    assert faults(window) == []
    window.evaluate(SPOIL, [part, style])
    assert any(said in fault for fault in faults(window))
    window.evaluate("() => repair()")
    assert faults(window) == []


def test_ctrl_s_saves_the_session_wherever_the_focus_is(in_lab: Lab, window: Any) -> None:
    window.evaluate(NARROW, 0)
    button = window.locator(".dnb-save")
    window.locator(".dnb-ed-stage:visible").first.focus()  # there JupyterLab's own Ctrl+S does nothing
    assert "unsaved" in button.get_attribute("title")
    window.keyboard.press("Control+s")
    window.wait_for_function("document.querySelector('.dnb-studio').innerText.includes('Saved carp_phantom.json.')")
    window.wait_for_function("!document.querySelector('.dnb-save').title.includes('unsaved')")
    assert (in_lab.folder / in_lab.place / "carp_phantom.json").stat().st_size > 0
    assert window.evaluate("document.querySelector('.dnb-save').getBoundingClientRect().height") == pytest.approx(
        window.get_by_role("button", name="Reset", exact=True).first.bounding_box()["height"], abs=1)
    window.locator("body").press("Control+s")  # elsewhere it is the notebook's alone
    assert window.evaluate("document.querySelectorAll('.dnb-studio').length") == 1


PLACES = """() => ['.dnb-cv-stage', '.dnb-clip'].map((s) => [...document.querySelectorAll(
  `.dnb-studio ${s}`)].find((e) => e.offsetWidth)).map((e) => e.getBoundingClientRect()).map(
  ({ left, right, top, bottom }) => ({ left, right, top, bottom }))"""


def test_see_inside_stands_beside_the_colours_where_there_is_room(in_lab: Lab, window: Any) -> None:
    in_lab.dark(window, False)
    window.evaluate(NARROW, 0)
    choose(window, "Volume")
    window.get_by_text("Clipping", exact=True).wait_for()
    window.get_by_role("button", name="Open towards me").wait_for()
    if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
        window.evaluate("() => document.querySelector('.dnb-studio').scrollIntoView({ block: 'end' })")
        window.screenshot(path=str(Path(folder) / "look.png"))
    colours, clip = window.evaluate(PLACES)
    assert clip["left"] >= colours["right"]
    assert clip["top"] < colours["bottom"]
    window.evaluate(NARROW, 620)
    choose(window, "Volume")
    colours, clip = window.evaluate(PLACES)
    assert clip["top"] >= colours["bottom"]
    window.evaluate(NARROW, 0)


@pytest.fixture(scope="module")
def voila(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Voila]:
    with running(Voila, tmp_path_factory.mktemp("voila")) as server:
        server.write_notebook([CELL], "studio.ipynb")
        yield server


@pytest.mark.nightly
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_all_tabs_can_be_used_in_voila(voila: Voila, window: Any, theme: str) -> None:
    window.goto(f"{voila.url('/voila/render/studio.ipynb')}&theme={theme}", timeout=90_000)
    window.wait_for_function(READY, timeout=120_000)
    window.wait_for_function(f"({PAPER}) === {str(theme == 'dark').lower()}")  # its colours come after the widgets
    look(window, f"voila-{theme}")
