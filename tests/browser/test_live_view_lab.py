"""The live view in JupyterLab: one session from the first cell to a screenshot."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from browser.lab import Lab
from browser.live_page import ARGUMENTS
from scripts import chromium

SHOW = """
import numpy as np
from deformnb import ControlPoints, Deformation, Grid, Volume
from deformnb.widgets import LiveView
k = np.indices((40, 40, 40)) - 19.5
volume = Volume(np.clip(300 - 20 * np.sqrt((k ** 2).sum(axis=0)), 0, 255).astype(np.uint8), Grid((40, 40, 40)))
view = LiveView(volume, transfer="surface", width=320, height=240, settle_ms=50)
view
"""
DEFORM = """
points = ControlPoints.from_arrays([[20.0, 20.0]], [[28.0, 20.0]])
moved = Deformation.on_picture(volume.grid, "+y", points, trend="translation")
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


def test_a_session_in_jupyterlab(tmp_path: Path) -> None:
    path = chromium()
    if path is None:
        pytest.skip("no Chromium with Playwright: apt-get install chromium, pip install playwright")
    for module in ("jupyterlab", "ipykernel", "nbformat"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install deformnb[notebook]")
    from playwright.sync_api import sync_playwright

    lab = Lab(tmp_path)
    try:
        lab.started()
        with sync_playwright() as p:
            browser = p.chromium.launch(executable_path=path, headless=True, args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1100, "height": 900})
            lab.open_notebook(page, [SHOW])
            page.wait_for_function(f"{VIEW}?.caster?.isReady", timeout=90_000)
            assert lab.run(page, DEFORM) == ""
            page.wait_for_function(f"{VIEW}.caster.planar && {VIEW}.stats", timeout=60_000)
            # What the page shows came by the kernel's messages, and its picture went back by them.
            assert lab.run(page, LOOK).strip() == "(240, 320, 3) True True True True"
            browser.close()
    finally:
        lab.close()
