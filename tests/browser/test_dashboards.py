"""A studio in applications of Panel and Solara: the code of the page about hosts, a real server and a real mouse.

Both fetch scripts of their own from a network; here they are those of this environment.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from browser.hosts import ROOT, Host, box_at_rest, start_host

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

# In front of the code of the page: a volume that is quickly there, and what Python knows of a drag.
SMALL = """
import numpy as np
import deformnb as dn
from deformnb.widgets import Studio

z, y, x = np.indices((40, 24, 40))
ball = (x - 19.5) ** 2 + (y - 11.5) ** 2 + (z - 19.5) ** 2 < 9 ** 2
small = dn.Volume(np.where(ball, 250, 0).astype(np.uint8), dn.Grid((40, 24, 40)), name="ball")

def make_small_studio(volume):
    studio = Studio(small, side="+y", height=400)
    studio.observe(lambda change: print("POINT", studio.editor.points.target[-1].tolist(), flush=True), "deformation")
    return studio

dn.Studio = make_small_studio
"""
FIND = """(name) => {
  const all = (root) => [...root.querySelectorAll("*")].flatMap((e) => [e, ...(e.shadowRoot ? all(e.shadowRoot) : [])]);
  return all(document).find((e) => e.classList.contains(name)) ?? null;
}"""


class Dashboard(Host):
    """A server with one application."""

    def prepare(self) -> None:
        """The application that the page about hosts has for this server."""
        blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "hosts.md").read_text("utf-8"), re.DOTALL)
        (app,) = (block for block in blocks if f"import {self.module}" in block)
        (self.folder / "app.py").write_text(SMALL + app, encoding="utf-8")

    @classmethod
    def missing(cls) -> str:
        return super().missing() and f"{cls.name} is not installed: pip install {' '.join((cls.module, *cls.requires))}"


class Panel(Dashboard):
    """Panel's server."""

    name, module, requires = "Panel", "panel", ("ipywidgets_bokeh",)
    alone = ("serve", "--port={port}", "--address=127.0.0.1")
    options = ("{folder}/app.py",)
    ready = "/app"


class Solara(Dashboard):
    """Solara's server."""

    name, module = "Solara", "solara"
    alone = ("run", "{folder}/app.py", "--port={port}", "--host=127.0.0.1", "--no-open", "--production")
    ready = "/"


def _anywidget() -> str:
    import anywidget

    return (Path(anywidget.__file__).parent / "nbextension" / "index.js").read_text("utf-8")


@pytest.mark.parametrize("host", [Panel, Solara], ids=lambda host: host.__name__)
def test_a_drag_reaches_python(host: type[Dashboard], tmp_path: Path, tab: Any) -> None:
    with start_host(host, tmp_path) as server:
        body, absent = _anywidget(), list[str]()
        tab.route(
            lambda address: "127.0.0.1" not in address and "anywidget" in address,
            lambda route: route.fulfill(body=body, content_type="text/javascript"),
        )
        tab.on("response", lambda one: absent.append(one.url) if "cdn" in one.url and one.status == 404 else None)
        tab.goto(f"http://127.0.0.1:{server.port}{host.ready}", timeout=120_000)  # the application runs first
        if any(address.endswith(".js") for address in absent):
            pytest.skip("Solara's own page is not in this environment: pip install solara-assets 'ipyvuetify<2'")
        tab.wait_for_function(f"({FIND})('dnb-view')?.deformnb?.caster?.isReady", timeout=90_000)
        tab.wait_for_function(f"({FIND})('dnb-editor').deformnb.parts.picture.painter.source", timeout=60_000)
        box = box_at_rest(tab.locator(".dnb-editor [data-id] .dnb-ed-disc").last)  # also in shadow trees
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
        # The words of the panel are of one size, whatever the size of the page's own words.
        sizes = {
            tab.evaluate(f"() => getComputedStyle(({FIND})('{name}')).fontSize")
            for name in ("dnb-section-head", "dnb-tab", "widget-label")
        }
        assert sizes == {"13px"}
