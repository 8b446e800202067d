"""Cuts and fixed sides at the large slice of a step in space, in the application and with the real mouse."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, wait_until
from browser.test_space_editor_page import PAGE
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.points import ControlPoints

pytestmark = pytest.mark.needs_browser

READY = f"""() => document.querySelector('.dnb-space') && {PAGE}.parts.row.panes.every((pane) => pane.image.picture)
  && document.querySelector('.dnb-panel-fold')"""
YELLOW = """() => { const pane = %s.parts.row.panes[%d], { canvas } = pane.image, c = canvas.getContext('2d');
  const { data } = c.getImageData(0, 0, canvas.width, canvas.height);
  let found = 0;
  for (let n = 0; n < data.length; n += 4) found += data[n] > 150 && data[n + 1] > 120 && data[n + 2] < 80;
  return found; }"""


@pytest.fixture
def running() -> Iterator[RunningApp]:
    volume = PHANTOMS["head"].make((40, 40, 40))
    middle, side = np.asarray(volume.grid.center), np.asarray(volume.grid.spacing) * 10
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = ControlPoints.from_arrays(middle + side * signs)
    with RunningApp(Application(volume, Deformation((Step((points,), None, trend="none"),)))) as found:
        yield found


def test_the_wheel_and_a_button_cut_the_volume_along_the_slice(browser: Any, running: RunningApp) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(running.server.url)
    page.wait_for_function(READY, timeout=PATIENCE)
    session, space = running.session, running.application.studio.editor
    large = space.large_slice
    before = np.asarray(space.cursor)
    stage = page.locator(".dnb-sp-stage").nth(large)
    stage.click(position={"x": 200, "y": 60})
    for _ in range(4):
        page.mouse.wheel(0, 100)
    wait_until(lambda: np.abs(np.asarray(space.cursor) - before)[0] > 3 * session.volume.grid.spacing[0])
    page.get_by_text("Rigid parts and cuts", exact=True).click()
    page.get_by_role("button", name="Cut at the slice").click()
    wait_until(lambda: len(session.editing.step.cuts) == 1)
    region = session.editing.step.cuts[0].region
    np.testing.assert_allclose(region.point, space.cursor, atol=1e-6)
    assert np.abs(region.normal).tolist() == [1.0, 0.0, 0.0]  # of the sagittal slice
    for pane in {0, 1, 2} - {large}:
        page.wait_for_function(YELLOW % (PAGE, pane), timeout=PATIENCE)
    page.get_by_role("button", name="Undo", exact=False).first.click()
    wait_until(lambda: not session.editing.step.cuts)
    page.get_by_role("button", name="Fixed side").click()
    wait_until(lambda: len(session.editing.step.parts) == 1)
    assert session.editing.step.parts[0].region == region
    page.close()
