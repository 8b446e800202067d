"""Memory of a page of JupyterLab: a cell that runs again leaves nothing of the studio that it showed before.

Counted are living objects after forced collection, and no bytes: these are the same on each machine.
"""

from __future__ import annotations

from typing import Any

import pytest
from browser.hosts import AT_REST, Lab

pytestmark = pytest.mark.needs_browser

SETUP = """
import numpy as np
from deformnb import Grid, Volume
from deformnb.widgets import Studio
z, y, x = np.indices((40, 24, 40))
ball = (x - 19.5) ** 2 + (y - 11.5) ** 2 + (z - 19.5) ** 2 < 9 ** 2
studio = Studio(Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((40, 24, 40)), name="ball"), side="+y", height=260)
studio
"""
SHOWN = """[...document.querySelectorAll('.dnb-editor, .dnb-view')].map((element) => element.deformnb)"""
# A studio that is drawn in full, and no other one.
READY = f"""() => document.querySelectorAll('.dnb-editor').length === 1
  && !document.querySelector('.dnb-editor').deformnb?.isCounted
  && {SHOWN}.every((shown) => shown) && ({AT_REST})()"""
# Editors and views of each run, which the page itself does not hold.
REMEMBER = f"""() => {{
  document.querySelector('.dnb-editor').deformnb.isCounted = true;
  (window.runs ??= []).push({SHOWN}.map((shown) => new WeakRef(shown)));
}}"""
LIVING = "() => runs.map((shown) => shown.filter((reference) => reference.deref()).length)"

COUNTED = {
    "contexts": "WebGL2RenderingContext.prototype",
    "canvases": "HTMLCanvasElement.prototype",
    "sizes observed": "ResizeObserver.prototype",
    "workers": "Worker.prototype",
}


class Heap:
    """The objects of a page, after all garbage was collected."""

    def __init__(self, page: Any) -> None:
        self._tools = page.context.new_cdp_session(page)

    def collect(self) -> None:
        for _ in range(3):  # an object with a finalizer goes with the second
            self._tools.send("HeapProfiler.collectGarbage")

    def count(self, prototype: str) -> int:
        """Number of living objects of a class."""
        of_class = self._tools.send("Runtime.evaluate", {"expression": prototype})["result"]["objectId"]
        found = self._tools.send("Runtime.queryObjects", {"prototypeObjectId": of_class})["objects"]["objectId"]
        asked = {"objectId": found, "functionDeclaration": "function () { return this.length; }", "returnByValue": True}
        number: int = self._tools.send("Runtime.callFunctionOn", asked)["result"]["value"]
        for held in (found, of_class):
            self._tools.send("Runtime.releaseObject", {"objectId": held})
        return number


def test_a_cell_that_runs_again_leaves_no_editor_view_or_context(lab: Lab, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    heap = Heap(page)
    lab.open_notebook(page, [SETUP])
    counts = []
    for run in range(4):
        if run:
            lab.run_all(page)
        page.wait_for_function(READY, timeout=120_000)
        page.evaluate(REMEMBER)
        lab.run(page, "")  # the closing of the one before has been heard
        heap.collect()
        counts.append({name: heap.count(prototype) for name, prototype in COUNTED.items()})
    living = page.evaluate(LIVING)
    assert living[-1] >= 2
    assert living[:-1] == [0, 0, 0]
    assert counts[3] == counts[1]
    page.close()
