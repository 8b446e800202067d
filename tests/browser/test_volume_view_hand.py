"""The volume view in JupyterLab while a hand is at work: a slider, an editor's point; never black, never late."""

from __future__ import annotations

import json
from typing import Any

import pytest
from browser.hosts import Lab, box_at_rest

pytestmark = [pytest.mark.needs_browser, pytest.mark.needs_gl]

BALL = """
import ipywidgets, json
import numpy as np
from deformnb import ControlPoints, Deformation, Grid, Plane, Volume, project
from deformnb.widgets import Editor, VolumeView
k = np.indices((40, 40, 40)) - 19.5
volume = Volume(np.clip(300 - 20 * np.sqrt((k ** 2).sum(axis=0)), 0, 255).astype(np.uint8), Grid((40, 40, 40)))
plane = Plane.from_view(volume.grid, "+y")
points = ControlPoints.from_arrays([[19.5, 19.5], [2.0, 2.0]], [[19.5, 19.5], [2.0, 2.0]])
view = VolumeView(volume, transfer="surface", width=320, height=240, settle_ms=100)
view.set_camera((0, 1, 0))
"""
SLIDER = """
slider = ipywidgets.FloatSlider(value=0.0, min=0.0, max=10.0, step=0.5)
def slide(change):
    away = ControlPoints.from_arrays([[20.0, 20.0]], [[20.0 + change["new"], 20.0]])
    view.show_deformation(Deformation.from_picture_points(volume.grid, plane, away, trend="translation"))
slider.observe(slide, "value")
ipywidgets.VBox([slider, view])
"""
EDITOR = """
editor = Editor(project(volume, plane, "mip"), points, height=300)
view.follow(editor, Deformation((editor.step(),)).field(volume.grid))
ipywidgets.HBox([editor, view])
"""
VIEW = "document.querySelector('.dnb-volume')?.deformnb"
# Where the body is, as a share of the width, and how much of the picture it is: skin is redder than what is behind.
BODY = """() => {
  const { canvas } = document.querySelector(".dnb-volume").deformnb.elements, { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  let sum = 0, n = 0;
  for (let i = 0; i < width * height; i++) if (data[4 * i] - data[4 * i + 2] > 24) { sum += i % width; n += 1; }
  return [sum / n / width, n / (width * height)];
}"""
STILL = """
image = view.still((320, 240)).astype(int)
columns = np.nonzero(image[..., 0] - image[..., 2] > 24)[1]
print(json.dumps([columns.mean() / 320, len(columns) / (320 * 240)]))
"""


def open_cell(lab: Lab, tab: Any, cell: str, name: str) -> None:
    lab.open_notebook(tab, [BALL, cell], name)
    tab.wait_for_function(f"{VIEW}?.isFull", timeout=120_000)


@pytest.mark.nightly
def test_a_slider_moves_the_picture_which_is_never_black(lab: Lab, tab: Any) -> None:
    """Callbacks of sliders come from several threads, of which OpenGL bears one."""
    open_cell(lab, tab, SLIDER, "slider.ipynb")
    places = [tab.evaluate(BODY)]
    assert places[0][1] > 0.05
    handle = tab.locator(".noUi-handle").first
    box = box_at_rest(handle)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    for k in range(1, 6):
        tab.mouse.move(x + 16 * k, y)
        tab.wait_for_function(
            f"(before) => {VIEW}.isFull && ({BODY})()[0] > before + 0.005",
            arg=places[-1][0],
            polling=200,
            timeout=90_000,
        )
        places.append(tab.evaluate(BODY))
        assert places[-1][0] > places[-2][0] + 0.005
        assert places[-1][1] > 0.7 * places[0][1]
    tab.mouse.up()
    assert json.loads(lab.run(tab, STILL)) == pytest.approx(tab.evaluate(BODY), abs=0.01)


@pytest.mark.nightly
def test_the_picture_follows_a_point_and_ends_where_the_hand_does(lab: Lab, tab: Any) -> None:
    open_cell(lab, tab, EDITOR, "editor.ipynb")
    before = tab.evaluate(BODY)
    tab.wait_for_selector(".dnb-ed-disc")
    box = box_at_rest(tab.locator(".dnb-editor [data-id='0'] .dnb-ed-disc"))
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    for k in range(1, 31):
        tab.mouse.move(x + 1.5 * k, y)
    tab.wait_for_function(f"(before) => ({BODY})()[0] > before + 0.03", arg=before[0], polling=200, timeout=90_000)
    for k in range(30):
        tab.mouse.move(x + 45 - 2.5 * k, y)  # quickly to the other side
    tab.mouse.up()
    tab.wait_for_function("document.querySelector('.dnb-editor').deformnb.sender.isBehind() === false", timeout=60_000)
    lab.run(tab, "import asyncio; await view.screenshot(60)")  # until all of it is drawn
    last = json.loads(lab.run(tab, STILL))
    assert last[0] < before[0] - 0.01
    tab.wait_for_function(
        f"""() => {{
        const [at] = ({BODY})();
        return {VIEW}.isFull && Math.abs(at - {last[0]}) < 0.01;
    }}""",
        timeout=60_000,
    )
