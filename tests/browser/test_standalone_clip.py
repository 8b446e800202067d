"""A page without a kernel that is cut open: as Python left it, and by its own sliders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.standalone import write_standalone
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

VIEW = "document.querySelector('.dnb-view').deformnb"


@pytest.mark.nightly
def test_a_page_without_a_kernel_is_cut_open(browser: Any, tmp_path: Path) -> None:
    grid = Grid((20, 24, 28))
    k, j, i = (np.abs(2 * a / n - 1) for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    volume = Volume((np.clip(8 * (0.8 - np.sqrt(k * k + j * j + i * i)), 0, 1) * 200).astype(np.uint8), grid, "ball")
    points = ControlPoints.from_arrays([[2.0, 2.0], [20.0, 2.0], [10.0, 15.0]])
    view = LiveView(volume, transfer="surface", settle_ms=60000)
    view.set_clip(y=(0.5, 1))
    path = tmp_path / "page.html"
    write_standalone(path, Editor(project(volume, Plane.from_view(grid, "+y")), points), view)
    page = browser.new_page(viewport={"width": 1000, "height": 760})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(path.as_uri())
    page.wait_for_function(f"() => document.querySelector('.dnb-view') && {VIEW}.caster?.isReady", timeout=60000)
    assert page.locator("details.dnb-page-clip").get_attribute("open") is not None  # it is cut already
    picture = f"(() => {{ {VIEW}.loop.drawNow(1); return {VIEW}.elements.canvas.toDataURL(); }})()"
    cut = page.evaluate(picture)
    page.get_by_role("button", name="Show all").click()
    assert page.evaluate(f"{VIEW}.model.get('clip')") == [[0, 1], [0, 1], [0, 1]]
    assert page.evaluate(picture) != cut
    page.get_by_role("button", name="Reset", exact=True).click()
    assert page.evaluate(f"{VIEW}.model.get('clip')") == [[0, 1], [0.5, 1], [0, 1]]
    assert page.evaluate(picture) == cut
    assert errors == []
    page.close()
