"""Memory of a page of JupyterLab: a cell that runs again leaves nothing of the studio that it showed before.

Counted are living objects after forced collection, and scripts, but no bytes: these are the same on each machine.
"""

from __future__ import annotations

from typing import Any

import pytest
from browser.hosts import AT_REST, SMALL_STUDIO, Lab

pytestmark = pytest.mark.needs_browser

SHOWN = """[...document.querySelectorAll('.dnb-editor, .dnb-view')].map((element) => element.deformnb)"""
# A studio that is drawn in full, and no other one.
READY = f"""() => document.querySelectorAll('.dnb-editor').length === 1
  && !document.querySelector('.dnb-editor').deformnb?.isCounted
  && {SHOWN}.every((shown) => shown) && ({AT_REST})()"""
# Editors, views, controls and the models of widgets of each run, which the page itself does not hold.
REMEMBER = f"""async () => {{
  const editor = document.querySelector('.dnb-editor').deformnb;
  editor.isCounted = true;
  const models = await Promise.all(Object.values(editor.model.widget_manager._models));
  const own = models.filter((model) => model.get("layout")); // others are shared
  const controls = document.querySelectorAll(".dnb-studio select, .dnb-studio input");
  (window.runs ??= []).push([...{SHOWN}, ...own, ...controls].map((shown) => new WeakRef(shown)));
}}"""
LIVING = "() => runs.map((shown) => shown.filter((reference) => reference.deref()).length)"

LONGEST_LOADER = 2000  # characters of the script that is imported for each widget

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
        self.modules: list[int] = []  # lengths of the texts that were imported
        self._tools.on("Debugger.scriptParsed", self._parsed)
        self._tools.send("Debugger.enable")

    def _parsed(self, script: Any) -> None:
        if script["url"].startswith("blob:") and script["isModule"]:
            self.modules.append(script["length"])

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


def test_a_cell_that_runs_again_leaves_no_view_model_control_or_context(lab: Lab, browser: Any) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    heap = Heap(page)
    lab.open_notebook(page, [SMALL_STUDIO])
    counts = []
    for run in range(4):
        if run:
            heap.modules.clear()
            lab.run_all(page)
        page.wait_for_function(READY, timeout=120_000)
        page.evaluate(REMEMBER)
        lab.run(page, "")  # the closing of the one before has been heard
        heap.collect()
        if not run:
            assert max(heap.modules) > 100 * LONGEST_LOADER
        counts.append({name: heap.count(prototype) for name, prototype in COUNTED.items()})
    living = page.evaluate(LIVING)
    assert living[-1] >= 40
    assert living[:-1] == [0, 0, 0]
    assert counts[3] == counts[1]
    assert len(heap.modules) >= 5  # one for each widget
    assert max(heap.modules) < LONGEST_LOADER
    page.close()
