"""A studio in an app of Panel: a real server and a real mouse, offline.

Panel fetches anywidget's front end from a network; here it is that of this environment.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest
from browser.hosts import Host, box_at_rest, start_host

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

STUDIO = """
import numpy as np
from deformnb import Grid, Studio, Volume

def make():
    z, y, x = np.indices((40, 24, 40))
    ball = (x - 19.5) ** 2 + (y - 11.5) ** 2 + (z - 19.5) ** 2 < 9 ** 2
    volume = Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((40, 24, 40)), name="ball")
    studio = Studio(volume, side="+y", height=400)
    studio.observe(lambda change: print("POINT", studio.editor.points.target[-1].tolist(), flush=True), "deformation")
    return studio
"""
PANEL = """
import panel as pn
pn.extension("ipywidgets")
pn.pane.IPyWidget(make(), sizing_mode="stretch_width").servable()
"""
FIND = """(name) => {
  const all = (root) => [...root.querySelectorAll("*")].flatMap((e) => [e, ...(e.shadowRoot ? all(e.shadowRoot) : [])]);
  return all(document).find((e) => e.classList.contains(name)) ?? null;
}"""


class Panel(Host):
    """Panel's server with one app."""

    name, module, requires = "Panel", "panel", ("ipywidgets_bokeh",)
    alone = ("serve", "--port={port}", "--address=127.0.0.1")
    options = ("{folder}/app.py",)
    ready = "/app"
    app = STUDIO + PANEL

    def prepare(self) -> None:
        (self.folder / "app.py").write_text(self.app, encoding="utf-8")


def _anywidget() -> str:
    import anywidget

    return (Path(anywidget.__file__).parent / "nbextension" / "index.js").read_text("utf-8")


def test_a_drag_reaches_python(tmp_path: Path, tab: Any) -> None:
    if importlib.util.find_spec("panel") is None:
        pytest.skip("Panel is not installed: pip install panel ipywidgets_bokeh")
    with start_host(Panel, tmp_path) as server:
        body = _anywidget()
        tab.route(
            lambda address: "unpkg.com" in address and "anywidget" in address,
            lambda route: route.fulfill(body=body, content_type="text/javascript"),
        )
        tab.goto(f"http://127.0.0.1:{server.port}{Panel.ready}", wait_until="commit")
        tab.wait_for_function(f"({FIND})('dnb-view')?.deformnb?.caster?.isReady", timeout=90_000)
        tab.wait_for_function(f"({FIND})('dnb-editor').deformnb.parts.picture.painter.source", timeout=60_000)
        disc = tab.locator(".dnb-editor [data-id] .dnb-ed-disc").last  # also in shadow trees
        box = box_at_rest(disc)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x - 30, y - 20, steps=8)
        tab.mouse.up()
        tab.wait_for_function(
            f"({FIND})('dnb-view').deformnb.caster.fields.planar.maps.some((value) => value !== 0)", timeout=60_000
        )
        for _ in range(300):
            if "POINT" in server.messages():
                break
            tab.wait_for_timeout(100)
        assert "POINT" in server.messages()
        width = tab.evaluate(f"() => ({FIND})('dnb-studio').getBoundingClientRect().width")
        assert width > 1000
