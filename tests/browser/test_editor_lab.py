"""The editor in a real JupyterLab: the mouse drags, the kernel hears of it, and keys are the editor's own."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import pytest
from browser.hosts import Lab, box_at_rest

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

CELLS = [
    """
import numpy as np
from deformnb import ControlPoints, Grid, Volume, project
from deformnb.widgets import Editor
z, y, x = np.indices((30, 40, 60))
volume = Volume((((x // 6 + y // 6 + z // 6) % 2) * 200).astype(np.uint8), Grid((30, 40, 60)))
points = ControlPoints.from_arrays([[10, 8], [48, 9], [30, 30], [30, 18]])
moves = []
""",
    """
editor = Editor(project(volume, "+z", "slice"), points, height=360)
editor.on_edit(lambda points, phase: moves.append(phase))
editor
""",
]
PAGE = "document.querySelector('.dnb-editor').deformnb.parts"
STATE = "import json; print(json.dumps([editor.points.target.tolist(), list(editor.points.ids), moves.count('end')]))"


def middle(page: Any, point: int) -> tuple[float, float]:
    """Place of a point on the screen, once Lab has come to rest."""
    box = box_at_rest(page.locator(f"[data-id='{point}'] .dnb-ed-disc"))
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def settled(lab: Lab, page: Any, reached: Callable[[Any, list[int], int], bool]) -> tuple[Any, list[int], int]:
    """The kernel's state once it is as wanted, or after a minute: a busy machine delivers edits late."""
    end = time.monotonic() + 60
    while True:
        targets, ids, ends = json.loads(lab.run(page, STATE))
        if reached(targets, ids, ends) or time.monotonic() > end:
            return targets, ids, ends
        time.sleep(0.2)


def test_the_editor_works_in_jupyterlab(lab: Lab, tab: Any) -> None:
    page = tab
    lab.open_notebook(page, CELLS)
    page.wait_for_selector("[data-id='3']", timeout=60_000)
    page.wait_for_function(f"{PAGE}.picture.painter.source")
    page.locator(".dnb-editor").scroll_into_view_if_needed()
    x, y = middle(page, 3)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y + 25, steps=8)
    page.mouse.up()
    k = page.evaluate(f"() => {PAGE}.viewport.view.k")
    targets, _, ends = settled(lab, page, lambda _, ids, ends: ends == 1)
    assert targets[3] == pytest.approx([30 + 40 / k, 18 + 25 / k], abs=1e-6)
    assert ends == 1

    # Lab's own keys would cut the cell (x), delete it (d d), or hide its output (o).
    cells = page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length")
    for key in ("o", "o", "d", "d", "x"):
        page.keyboard.press(key)
    assert page.evaluate(f"() => {PAGE}.tools.pen.draft.tool") == "cut"
    page.keyboard.press("Escape")
    page.locator("[data-id='3']").focus()
    for key in ("ArrowRight", "Delete"):
        page.keyboard.press(key)
    _, ids, _ = settled(lab, page, lambda _, ids, ends: ids == [0, 1, 2])
    assert ids == [0, 1, 2]
    assert page.evaluate("() => jupyterapp.shell.currentWidget.content.widgets.length") == cells

    # Point 2 has the focus now. It goes and comes back, then point 3 does, then its arrow key is undone; all of it
    # while the kernel may still be at the first, and nothing late may overtake anything.
    for key in ("Delete", "Control+z", "Control+z", "Control+z"):
        page.keyboard.press(key)
    undone, ids, _ = settled(lab, page, lambda now, ids, ends: now == targets)
    assert (undone, ids) == (targets, [0, 1, 2, 3])
    page.wait_for_function(f"!{PAGE}.sender.isBehind()")
    assert json.loads(lab.run(page, STATE))[:2] == [targets, [0, 1, 2, 3]]
    assert page.evaluate(f"() => {PAGE}.points.list.map((p) => p.target)") == targets

    lab.run(page, "editor.points = editor.points.move(0, [14, 12])")
    page.wait_for_function(f"{PAGE}.points.list[0].target[0] === 14")
    page.evaluate("() => jupyterapp.commands.execute('notebook:run-all-cells')")
    page.wait_for_function(
        "document.querySelectorAll('.dnb-editor').length === 1 && "
        f"{PAGE}.points.list[0].target[0] === 10 && {PAGE}.picture.painter.source",
        timeout=60_000,
    )
