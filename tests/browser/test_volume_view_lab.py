"""The volume view in JupyterLab: pictures that leave the kernel by another thread arrive, also after the third edit."""

from __future__ import annotations

from typing import Any

import pytest
from browser.hosts import Lab

pytestmark = [pytest.mark.needs_browser, pytest.mark.needs_gl, pytest.mark.nightly]

SHOW = """
import numpy as np
from deformnb import ControlPoints, Deformation, Grid, Volume
from deformnb.widgets import VolumeView
k = np.indices((40, 40, 40)) - 19.5
volume = Volume(np.clip(300 - 20 * np.sqrt((k ** 2).sum(axis=0)), 0, 255).astype(np.uint8), Grid((40, 40, 40)))
view = VolumeView(volume, transfer="surface", width=320, height=240, settle_ms=50)
view.set_camera((0, 1, 0))
view
"""
DEFORM = """
points = ControlPoints.from_arrays([[20.0, 20.0]], [[20.0 + 2 * {k}, 20.0]])
view.show_deformation(Deformation.from_picture_points(volume.grid, "+y", points, trend="translation"))
"""
VIEW = "document.querySelector('.dnb-view')?.deformnb"
MIDDLE = """() => {
  const { canvas } = document.querySelector(".dnb-view").deformnb, { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const at = (i) => data[4 * i] - data[4 * i + 2];  // skin is redder than either background
  let sum = 0, n = 0;
  for (let i = 0; i < width * height; i++) if (at(i) > 24) { sum += i % width; n += 1; }
  return [sum / n / width, n / (width * height)];
}"""


def test_every_edit_moves_the_picture_in_jupyterlab(lab: Lab, tab: Any) -> None:
    lab.open_notebook(tab, [SHOW])
    tab.wait_for_function(f"{VIEW}?.isFull", timeout=90_000)
    middle, share = tab.evaluate(MIDDLE)
    assert middle == pytest.approx(0.5, abs=0.02)
    for k in range(1, 5):
        assert lab.run(tab, DEFORM.replace("{k}", str(k))) == ""
        tab.wait_for_function(
            f"(before) => {VIEW}.isFull && ({MIDDLE})()[0] > before + 0.02", arg=middle, polling=200, timeout=60_000
        )
        now, still_share = tab.evaluate(MIDDLE)
        assert now > middle + 0.02  # two lengths of some 4 pixels each
        assert still_share > 0.5 * share
        middle = now
