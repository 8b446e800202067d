"""The live view in JupyterLab: one session from the first cell to a screenshot."""

from __future__ import annotations

from typing import Any

import pytest
from browser.hosts import Lab

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

SHOW = """
import numpy as np
from deformnb import ControlPoints, Deformation, Grid, Volume
from deformnb.widgets import LiveView
k = np.indices((40, 40, 40)) - 19.5
volume = Volume(np.clip(300 - 20 * np.sqrt((k ** 2).sum(axis=0)), 0, 255).astype(np.uint8), Grid((40, 40, 40)))
view = LiveView(volume, transfer="surface", width=320, height=240, settle_ms=50, background="dark")
view
"""
DEFORM = """
points = ControlPoints.from_arrays([[20.0, 20.0]], [[28.0, 20.0]])
moved = Deformation.from_picture_points(volume.grid, "+y", points, trend="translation")
view.set_camera((0, 1, 0))
view.show_deformation(moved)
"""
LOOK = """
image = await view.screenshot(timeout=20)
still = view.still()
middle = [float(np.nonzero(p.max(axis=2) > 64)[1].mean()) for p in (image, still)]
print(image.shape, middle[1] > 175, abs(middle[0] - middle[1]) < 3, bool((image != still).any()),
      view.stats()["received"] > 0)
"""
VIEW = "document.querySelector('.dnb-view')?.deformnb"


def test_a_session_in_jupyterlab(lab: Lab, tab: Any) -> None:
    lab.open_notebook(tab, [SHOW])
    tab.wait_for_function(f"{VIEW}?.caster?.isReady", timeout=90_000)
    assert lab.run(tab, DEFORM) == ""
    tab.wait_for_function(f"{VIEW}.caster.fields.planar && {VIEW}.stats", timeout=60_000)
    # What the page shows came by the kernel's messages, and its picture went back by them.
    assert lab.run(tab, LOOK).strip() == "(240, 320, 3) True True True True"
