"""The panel of two grids in a studio in JupyterLab: a node is dragged, seen in all pictures, undone, and printed."""

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
from deformnb.widgets import Studio
z, y, x = np.indices((60, 40, 60))
ball = (x - 29.5) ** 2 + (y - 19.5) ** 2 + (z - 29.5) ** 2 < 20 ** 2
studio = Studio(Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((60, 40, 60)), name="ball"), side="+y", height=300)
studio.editor.density = 6
report = Label().add_class("report")
def tell(change=None):
    points = studio.session.editing.points
    report.value = json.dumps([list(points.names), points.source.tolist(), points.target.tolist()])
studio.observe(tell, "deformation")
tell()
studio
"""
VIEWS = "[...document.querySelectorAll('.dnb-editor')].map((e) => e.deformnb.parts)"


def points_of_kernel(page: Any, count: int) -> Any:
    """Names, sources and targets of the kernel's points, once there are so many."""
    return read_report(page, lambda found: len(found[0]) == count)


def test_a_node_is_dragged_seen_everywhere_undone_and_printed(lab: Lab, tab: Any) -> None:
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.set_viewport_size({"width": 1280, "height": 1000})
    lab.open_notebook(tab, [SETUP, "report"])
    tab.wait_for_selector(".report", timeout=120_000)
    tab.wait_for_function(f"{VIEWS}[0]?.picture.painter.source", timeout=120_000)
    assert tab.evaluate(f"() => {VIEWS}.length") == 1
    choose(tab, "Thompson's grids and your own")
    tab.wait_for_function(f"{VIEWS}.length === 3 && {VIEWS}[2].layers.nodes.nodes.length === 49", timeout=60_000)
    node = tab.locator(".dnb-th-after [data-node='16']")
    node.scroll_into_view_if_needed()
    box = box_at_rest(node)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 20, y - 12, steps=5)
    tab.wait_for_function(
        f"{VIEWS}[0].points.list.length === 5 && {VIEWS}[2].points.list.length === 5"
    )  # while the mouse moves
    tab.mouse.up()
    names, source, target = points_of_kernel(tab, 5)
    k = tab.evaluate(f"() => {VIEWS}[2].viewport.view.k")
    assert names[-1] == "grid 2,2"
    assert source[-1] == pytest.approx([-0.5 + 20, -0.5 + 20])
    assert target[-1] == pytest.approx([19.5 + 20 / k, 19.5 - 12 / k])
    tab.wait_for_function(f"{VIEWS}.every((v) => v.points.list.at(-1).name === 'grid 2,2')")
    for kind in ("SVG", "PDF", "PNG"):
        tab.get_by_role("button", name=kind, exact=True).click()
        tab.wait_for_function(f"document.body.innerText.includes('Wrote ball_grids.{kind.lower()}')", timeout=120_000)
    assert {p.suffix for p in lab.folder.rglob("ball_grids.*")} >= {".svg", ".pdf", ".png"}
    tab.locator(".dnb-th-after [data-id='4']").focus()
    tab.keyboard.press("Control+z")
    assert len(points_of_kernel(tab, 4)[0]) == 4
    assert errors == []
