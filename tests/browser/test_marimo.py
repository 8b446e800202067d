"""The studio in marimo, which shows anywidgets and no other widgets: picture and volume follow a real mouse."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.hosts import Host, start_host
from browser.test_hosts import OVERLAYS
from numpy.typing import NDArray
from PIL import Image

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

APP = """
import marimo

app = marimo.App(width="full")


@app.cell
def _():
    import marimo as mo
    import numpy as np
    from deformnb import ControlPoints, Deformation, Grid, Studio, Volume

    z, y, x = np.indices((60, 40, 60))
    ball = (x - 29.5) ** 2 + (y - 19.5) ** 2 + (z - 29.5) ** 2 < 8 ** 2
    volume = Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((60, 40, 60)), name="ball")
    corners = [[2, 2], [57, 2], [57, 57], [2, 57]]
    points = ControlPoints.from_arrays([*corners, [29.5, 29.5]])
    start = Deformation.from_picture_points(volume.grid, "+y", points)
    studio = Studio(volume, start, side="+y", transfer="surface", height=300)
    studio.editor.density = 0
    studio.view.background = "dark"
    studio.view.set_camera((0, 1, 0), zoom=0.6)  # all of the ball stays in the picture
    studio
    return mo, studio


@app.cell
def _(mo, studio):
    ask = mo.ui.button(label="What does Python know?")
    ask
    return (ask,)


@app.cell
def _(ask, mo, studio):
    ask.value
    mo.md(f"target {studio.deformation.steps[0].points.target[4].round(2).tolist()}")
    return


if __name__ == "__main__":
    app.run()
"""


class Marimo(Host):
    """A notebook of marimo, run as an app."""

    name, module = "marimo", "marimo"
    alone = ("run", "--headless", "--port={port}")
    options = ("--host=127.0.0.1", "--token", "--token-password={token}", "{folder}/app.py")
    ready = "/health"

    def prepare(self) -> None:
        (self.folder / "app.py").write_text(APP, encoding="utf-8")


@pytest.fixture
def marimo_page(browser: Any, tmp_path: Path) -> Iterator[Any]:
    with start_host(Marimo, tmp_path) as host:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"http://127.0.0.1:{host.port}/?access_token={host.token}")
        page.locator(".dnb-view canvas").wait_for(timeout=120_000)
        yield page
        assert errors == []
        page.close()


def middle(page: Any, part: str, level: int) -> NDArray[np.float64]:
    """Place of the ball on an element, in CSS pixels."""
    png = page.locator(part).first.screenshot(animations="disabled", style=OVERLAYS)
    bright = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[16:-16, 16:-16].min(axis=2) > level
    return np.argwhere(bright).mean(axis=0)[::-1] if bright.any() else np.array([np.nan, np.nan])


def moved(page: Any, part: str, level: int, before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement of the ball, once it rests elsewhere, or after half a minute."""
    last = before
    for _ in range(60):
        page.wait_for_timeout(500)
        now = middle(page, part, level)
        if np.linalg.norm(now - before) > 8 and np.linalg.norm(now - last) < 0.5:
            break
        last = now
    return now - before


def test_a_drag_moves_picture_and_volume_and_python_knows(marimo_page: Any) -> None:
    canvas, volume = ".dnb-ed-canvas", ".dnb-view canvas"
    start = [np.array([np.nan, np.nan])] * 2
    for _ in range(60):  # until both are drawn and nothing changes any more
        now = [middle(marimo_page, canvas, 190), middle(marimo_page, volume, 110)]
        if np.allclose(now, start, atol=0.3):
            break
        start = now
        marimo_page.wait_for_timeout(500)
    x, y, width, height = (
        marimo_page.locator(".dnb-editor [data-id='4'] .dnb-ed-disc").bounding_box()[k]
        for k in ("x", "y", "width", "height")
    )
    marimo_page.mouse.move(x + width / 2, y + height / 2)
    marimo_page.mouse.down()
    marimo_page.mouse.move(x + width / 2 + 45, y + height / 2 - 30, steps=6)
    marimo_page.mouse.up()
    on_picture, in_volume = moved(marimo_page, canvas, 190, start[0]), moved(marimo_page, volume, 110, start[1])
    assert on_picture == pytest.approx([45, -30], abs=8)  # the ball is a little smaller than the reach of its point
    assert in_volume[0] > 10
    assert in_volume[0] / in_volume[1] == pytest.approx(-45 / 30, rel=0.2)
    for _ in range(60):
        marimo_page.get_by_role("button", name="What does Python know?").click()
        marimo_page.wait_for_timeout(1000)
        if re.search(r"target \[3\d\.\d+, 2\d\.\d+\]", said := marimo_page.locator("body").inner_text()):
            break
    else:
        raise AssertionError(f"Python does not know of the drag: {said}")
