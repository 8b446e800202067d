"""The panel "Diagnostics" in JupyterLab with a real mouse: a drag that folds is seen, and unfolded."""

from __future__ import annotations

from typing import Any

import pytest
from browser.hosts import Lab, box_at_rest, read_report
from browser.studio_layout import choose

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

SETUP = """
import json
import numpy as np
from ipywidgets import Label
from deformnb import Grid, Volume
from deformnb.document.step_checks import step_folds
from deformnb.widgets import Studio
z, y, x = np.indices((60, 40, 60))
ball = (x - 29.5) ** 2 + (y - 19.5) ** 2 + (z - 29.5) ** 2 < 22 ** 2
volume = Volume(np.where(ball, 120 + 8 * (x % 12), 0).astype(np.uint8), Grid((60, 40, 60)), name="ball")
report = Label().add_class("report")
studio = Studio(volume, side="+y", height=300)
def tell(change=None):
    step = studio.session.editing.step
    least = step_folds(step, volume.grid).least
    report.value = json.dumps({"least": least, "stages": step.stages, "overlay": studio.editor.overlay,
                             "uncertainty": len(studio.editor.uncertainty), "target": step.points.target[-1].tolist()})
studio.observe(tell, "deformation")
studio.editor.observe(tell, ["overlay", "uncertainty"])
tell()
studio
"""
EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"


def test_a_drag_that_folds_is_told_and_unfolded(lab: Lab, tab: Any) -> None:
    tab.set_viewport_size({"width": 1280, "height": 1000})
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    lab.open_notebook(tab, [SETUP, "report"])
    tab.wait_for_selector(".report", timeout=120_000)
    tab.wait_for_function(f"{EDITOR}.picture.painter.source", timeout=120_000)
    _unfold_in(tab)
    assert errors == []


def _unfold_in(page: Any) -> None:
    def at(a: float, b: float) -> tuple[float, float]:
        page.locator(".dnb-ed-stage").scroll_into_view_if_needed()
        box = box_at_rest(page.locator(".dnb-ed-stage"))
        x, y, k = page.evaluate(f"() => [{EDITOR}.viewport.view.x, {EDITOR}.viewport.view.y, {EDITOR}.viewport.view.k]")
        return box["x"] + x + k * a, box["y"] + y + k * b

    page.mouse.dblclick(*at(18, 30))
    page.wait_for_function(f"{EDITOR}.points.list.length === 5")
    page.mouse.move(*at(18, 30))
    page.mouse.down()
    page.mouse.move(*at(57, 47), steps=8)
    page.mouse.up()
    folded = read_report(page, lambda state: state["least"] < 0)
    assert folded["least"] < 0
    choose(page, "Check")
    facts = page.locator("table.dnb-diagnostics")
    facts.locator("tr", has_text="% folded").wait_for(timeout=60_000)
    page.get_by_role("button", name="Unfold by stages").click()
    state = read_report(page, lambda state: state["stages"] > 1)
    assert state["least"] > 0
    assert state["target"] == folded["target"]  # every point is where it was dropped
    facts.locator("tr", has_text="none; smallest det J").wait_for(timeout=60_000)
    page.wait_for_function(f"{EDITOR}.model.get('settings').stages === {state['stages']}")
    page.get_by_label("Overlay", exact=True).filter(visible=True).select_option(label="Uncertainty")
    assert read_report(page, lambda state: state["uncertainty"] > 0)["overlay"] == "uncertainty"
    page.locator(".dnb-ed-key", has_text="voxels").wait_for(timeout=60_000)
