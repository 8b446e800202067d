"""Fitting in JupyterLab: a target is there, a button is pressed, and the points are where a known deformation has them.

A label in the page says what the kernel knows.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from browser.hosts import Lab, read_report
from browser.studio_layout import choose

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

SETUP = """
import json
import numpy as np
from ipywidgets import Label
import deformnb as dn
from deformnb.datasets import PHANTOMS
from deformnb.widgets import Studio
volume = PHANTOMS["knee"].make((64, 64, 64))
session = dn.Session(volume, view="-x")
points, (du, dv) = session.editing.points, session.pictures.picture().raster.spacing
for k, (u, v) in enumerate([(22, 14), (40, 14), (22, 50), (38, 50), (24, 32), (42, 32)]):
    points = points.add([u * du, v * dv], [(u + (-1) ** k * 2) * du, (v + (k % 3 - 1) * 2) * dv], name=f"mark {k}")
session.editing.edit_points(points)
bent = session.results.volume()
for k in range(4):
    points = points.edit(k, locked=True)
report = Label().add_class("report")
start = dn.Deformation((session.editing.step.with_points(points.reset()),))
studio = Studio(volume, start, side="-x", target=bent, height=300)
def tell(change=None):
    away = (studio.session.editing.points.target - points.target) / [du, dv]
    report.value = json.dumps({"miss": float(np.linalg.norm(away, axis=1).max()),
        "undo": studio.session.editing.history["undo"],
                             "selected": len(studio.editor.selected)})
studio.observe(tell, "deformation")
studio.editor.observe(tell, "selected")
tell()
studio
"""
EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"


@pytest.fixture(scope="module")
def fit_page(browser: Any, lab: Lab) -> Iterator[tuple[Any, Any]]:
    page = browser.new_page(viewport={"width": 1280, "height": 1100})
    lab.open_notebook(page, [SETUP, "report"])
    page.wait_for_selector(".report", timeout=120_000)
    page.wait_for_function(f"{EDITOR}.picture.painter.source", timeout=120_000)
    choose(page, "Match to another picture")
    yield lab, page
    page.close()


def test_fit_all_finds_a_known_deformation_within_a_pixel_and_is_undone_at_once(fit_page: tuple[Any, Any]) -> None:
    _, page = fit_page
    before = read_report(page, lambda state: True)
    assert before["miss"] > 2.5
    image = page.locator(".jupyter-widgets.widget-image:visible")
    image.wait_for()
    first = image.get_attribute("src")
    page.get_by_role("button", name="Fit all points").click()
    state = read_report(page, lambda state: state["undo"] == "fit all points")
    assert state["miss"] < 1
    status = page.locator("[role=status]", has_text="Similarity")
    status.wait_for(timeout=60_000)
    assert "6 points moved" in status.inner_text()
    page.wait_for_function(
        "(first) => [...document.querySelectorAll('img.widget-image')].some("
        "(image) => image.offsetParent && image.src !== first)",
        arg=first,
    )
    shown_to_the_hand = page.evaluate(f"() => {EDITOR}.points.list.filter((p) => p.locked).length")
    assert shown_to_the_hand == 4
    page.locator(".dnb-ed-stage").focus()
    page.keyboard.press("Control+z")
    assert read_report(page, lambda state: state["undo"] == "")["miss"] == pytest.approx(before["miss"])


def test_what_is_selected_snaps(fit_page: tuple[Any, Any]) -> None:
    _, page = fit_page
    button = page.get_by_role("button", name="Snap selected points")
    button.click()
    page.locator("[role=status]", has_text="no point is selected").wait_for(timeout=60_000)
    page.locator(".dnb-ed-stage").focus()
    page.keyboard.press("Control+a")
    read_report(page, lambda state: state["selected"] > 5)
    button.click()
    state = read_report(page, lambda state: state["undo"] == "snap selected points")
    assert state["undo"] == "snap selected points"
    status = page.locator("[role=status]", has_text="of 10 points snapped")
    status.wait_for(timeout=60_000)
    assert "Left because it is locked: 0 (corner), 1 (corner), 2 (corner), 3 (corner)." in status.inner_text()


def test_the_target_is_laid_over_the_picture(fit_page: tuple[Any, Any]) -> None:
    server, page = fit_page
    ghost = page.locator("img.dnb-ed-ghost")
    assert ghost.count() == 1
    assert not ghost.is_visible()
    server.run(
        page, "next(p for p in studio.parts.panels.late if p.title.startswith('Match')).panel.preview.over.value = 0.6"
    )
    ghost.wait_for(timeout=60_000)
    page.wait_for_function("document.querySelector('img.dnb-ed-ghost').naturalWidth === 64")
    found = page.evaluate(f"""() => {{
        const editor = {EDITOR}, {{ k, x, y }} = editor.viewport.view, [a0, a1, b0, b1] = editor.picture.box;
        const at = editor.stage.element.getBoundingClientRect(), ghost = document.querySelector('img.dnb-ed-ghost');
        const is = ghost.getBoundingClientRect();
        return [is.left - at.left - (k * a0 + x), is.top - at.top - (k * b0 + y), is.width - k * (a1 - a0),
                is.height - k * (b1 - b0), Number(ghost.style.opacity)];
    }}""")
    assert found == pytest.approx([0, 0, 0, 0, 0.6], abs=0.6)
    assert found[4] == 0.6
