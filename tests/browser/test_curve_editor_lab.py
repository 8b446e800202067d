"""The curve editors in a real JupyterLab: drags reach the kernel, formulas are typed, and keys are the widgets' own."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import pytest
from browser.hosts import Lab, box_at_rest

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

CELLS = [
    """
import json
import numpy as np
from ipywidgets import VBox
from deformnb import Volume
from deformnb.widgets import CurveEditor, DepthKeys, TransferEditor
volume = Volume.from_array(np.random.default_rng(1).normal(100, 30, (20, 30, 40)).clip(0, 255).astype(np.uint8))
heard = []
""",
    """
curve, transfer, keys = CurveEditor("sin(pi*z)"), TransferEditor(volume, "xray"), DepthKeys((0, 0.5, 1))
for widget in (curve, transfer, keys):
    widget.on_edit(lambda value, phase: heard.append(phase))
VBox([curve, transfer, keys])
""",
]
STATE = """print(json.dumps({"curve": curve.curve, "nodes": curve.nodes, "alpha": transfer.transfer.opacities[1],
    "colors": transfer.transfer.colors, "window": transfer.transfer.window,
    "knots": keys.knots, "selected": keys.selected, "ends": heard.count("end")}))"""


def settled(lab: Lab, page: Any, reached: Callable[[Any], bool]) -> Any:
    """The kernel's state once it is as wanted, or after a minute: a busy machine delivers edits late."""
    end = time.monotonic() + 60
    while True:
        state = json.loads(lab.run(page, STATE))
        if reached(state) or time.monotonic() > end:
            return state
        time.sleep(0.2)


def drag(page: Any, node: Any, dx: float, dy: float, mark: str = ".dnb-cv-dot") -> None:
    node.locator(mark).scroll_into_view_if_needed()
    box = box_at_rest(node.locator(mark))
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=8)
    page.mouse.up()


def test_the_curve_editors_work_in_jupyterlab(lab: Lab, tab: Any) -> None:
    page = tab
    lab.open_notebook(page, CELLS)
    page.wait_for_selector(".dnb-depth-keys [data-key='2']", timeout=60_000)
    cells = page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length")

    drag(page, page.locator(".dnb-curve-editor [data-node='4']"), 0, 30)
    state = settled(lab, page, lambda s: s["ends"] == 1)
    assert len(state["nodes"]) == 9
    assert 0.1 < state["nodes"][4][1] < 0.9

    page.locator(".dnb-cv-input").fill("")
    page.locator(".dnb-cv-input").press_sequentially("max(0,1-2*z)")  # x is Lab's key to cut a cell
    page.keyboard.press("Enter")
    assert settled(lab, page, lambda s: s["ends"] == 2)["curve"] == "max(0,1-2*z)"

    drag(page, page.locator(".dnb-transfer-editor [data-node='1']"), -30, -25)  # the next is near, on the right
    before = state["alpha"]
    state = settled(lab, page, lambda s: s["ends"] == 3)
    assert state["alpha"][0] < before[0] - 5
    assert state["alpha"][1] > before[1]

    drag(page, page.locator(".dnb-depth-keys [data-key='1']"), 60, 0)
    state = settled(lab, page, lambda s: s["ends"] == 4)
    assert state["selected"] == 1
    assert state["knots"][1] > 0.53
    for key in ("a", "Delete", "d", "d", "x", "ArrowLeft"):
        page.keyboard.press(key)
    state = settled(lab, page, lambda s: s["ends"] == 7)
    assert len(state["knots"]) == 3

    before = state["colors"]
    drag(page, page.locator(".dnb-transfer-editor [data-stop='1']"), -30, 0, ".dnb-cv-pin")
    state = settled(lab, page, lambda s: s["ends"] == 8)
    assert state["colors"][1][0] < before[1][0] - 5
    for key in ("a", "Delete", "d", "d", "x", "0", "0"):  # of Lab's own, 0 twice restarts the kernel
        page.keyboard.press(key)
    state = settled(lab, page, lambda s: s["ends"] == 10)
    assert len(state["colors"]) == len(before)
    page.locator(".dnb-cv-color").fill("#00ff00")
    state = settled(lab, page, lambda s: s["ends"] == 11)
    assert [0, 1, 0] in [row[1:] for row in state["colors"]]
    before = state["window"]
    drag(page, page.locator(".dnb-transfer-editor [data-window='low']"), 60, 0, ".dnb-cv-end")
    state = settled(lab, page, lambda s: s["ends"] == 12)
    assert state["window"][0] > before[0] + 3
    assert state["window"][1] == before[1]
    assert page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length") == cells
    assert page.locator(".dnb-curves .dnb-cv-alert:visible").count() == 0

    lab.run(page, "curve.curve = (1.0, 0.0); keys.knots = (0.2,)")
    page.wait_for_function(
        "document.querySelectorAll('.dnb-curve-editor .dnb-cv-node').length === 2 && "
        "document.querySelectorAll('.dnb-depth-keys .dnb-cv-node').length === 1"
    )
    lab.dark(page)
    page.wait_for_function("document.querySelectorAll('.dnb-curves.dnb-dark').length === 3")
