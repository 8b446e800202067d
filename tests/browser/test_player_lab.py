"""The studio's animation in JupyterLab: key frames by its buttons, played in the page, heard of by the kernel."""

from __future__ import annotations

import json
import os
from typing import Any

import pytest
from browser.hosts import Lab
from browser.studio_layout import choose

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

CELLS = [
    """
import json
from deformnb import Studio
from deformnb.datasets import PHANTOMS
studio = Studio(PHANTOMS["bar"].make((32, 32, 64)), side="+y", height=300)
session = studio.session
panel = next(p for p in studio.parts.panels.late if p.title == "Animation").panel
studio
""",
]
DRAG = "session.editing.edit_points(session.editing.points.add([50.0, 16.0], [50.0, 26.0]))"
STATE = """print(json.dumps({"times": [k.time for k in session.editing.deformation.keyframes],
    "time": panel.player.time, "playing": panel.player.is_playing, "moments": studio.view.moments is not None,
    "messages": studio.view.stats()["messages"]}))"""
ROWS = 'table[aria-label="Key frames"] .dnb-il-row'
CLOCK = "document.querySelector('.dnb-player')?.deformnb.clock"
VIEW = "document.querySelector('.dnb-view')?.deformnb"


def state(lab: Lab, page: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(lab.run(page, STATE))
    return found


def test_an_animation_in_jupyterlab(lab: Lab, tab: Any) -> None:
    page = tab
    page.set_viewport_size({"width": 1280, "height": 1100})
    lab.open_notebook(page, CELLS)
    page.wait_for_function(f"{VIEW}?.caster?.isReady", timeout=90_000)
    choose(page, "Animate")
    page.get_by_role("button", name="Add key frame").click()
    page.wait_for_selector(ROWS)
    lab.run(page, DRAG)
    page.get_by_role("button", name="Add key frame").click()
    page.wait_for_function(f"document.querySelectorAll('{ROWS}').length === 2")
    page.locator(".dnb-pl-track").focus()
    cells = page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length")
    page.keyboard.press("End")
    page.keyboard.press("Home")
    page.wait_for_function(f"{VIEW}.shownField.times.frames && {VIEW}.shownField.times.bus", timeout=60_000)
    before = None
    while before != (before := state(lab, page)):  # messages may still be on their way
        page.wait_for_timeout(500)
    assert before["times"] == [0.0, 1.0]
    assert before["moments"]
    page.locator(".dnb-pl-track").focus()
    for key in ("x", "d", "d", " "):  # Lab's keys to cut and delete a cell, and to scroll
        page.keyboard.press(key)
    page.wait_for_function(f"{CLOCK}.time > 0.2")
    page.wait_for_function(f"{CLOCK}.time === 1 && !{CLOCK}.isPlaying", timeout=30_000)
    for _ in range(20):
        page.wait_for_timeout(500)
        after = state(lab, page)
        if (after["time"], after["playing"]) == (1.0, False):
            break
    assert (after["time"], after["playing"]) == (1.0, False)
    assert after["messages"] == before["messages"]  # played without a message of the view
    assert page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length") == cells
    if folder := os.environ.get("DEFORMNB_SCREENSHOTS"):
        page.screenshot(path=f"{folder}/animation_light.png")
        lab.dark(page)
        page.wait_for_timeout(1500)
        page.screenshot(path=f"{folder}/animation_dark.png")
