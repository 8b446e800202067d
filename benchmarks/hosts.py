"""First picture and a drag in each host: ``python -m benchmarks hosts``.

JupyterLab, the same behind a proxy with 100 ms a round trip, and the emulations of VS Code and Colab of the tests,
which have 100 ms as well. A cell of a fresh kernel makes a studio of the procedural carp; a real mouse drags a point
for 400 ms, in steps of 16 ms.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.latency import chromium_path, hosts

RATES = Path(__file__).with_name("studio_hooks.js")

CELL = """import time
import deformnb as dn
studio = dn.Studio(dn.datasets.PHANTOMS["fish"].make())
seen = []
studio.observe(lambda change: seen.append((1e3 * time.time(), studio.editor.points.target[-1].tolist())), "deformation")
studio"""
_LAST = "import json; print(json.dumps(seen[-1] if seen else None))"

# Times of the epoch, which all frames of a page and the kernel share.
_FIRST = """(() => {
  const now = () => performance.timeOrigin + performance.now(), first = (window.deformnbFirst = {});
  addEventListener("pointerup", () => { first.up = now(); }, true);
  const small = Object.assign(document.createElement("canvas"), { width: 32, height: 32 }).getContext("2d");
  const hasInk = (canvas) => {
    if (!canvas || canvas.width < 2) return false;
    small.clearRect(0, 0, 32, 32);
    small.drawImage(canvas, 0, 0, 32, 32);
    const greys = small.getImageData(0, 0, 32, 32).data.filter((_, k) => k % 4 === 1);
    return Math.max(...greys) - Math.min(...greys) > 60;
  };
  const look = () => {
    if (!first.picture && hasInk(document.querySelector(".dnb-editor .dnb-ed-canvas"))) first.picture = now();
    const loop = document.querySelector(".dnb-view")?.deformnb?.loop;
    if (!first.volume && loop && Object.keys(loop.screen.drawn).length) first.volume = now();
    if (!first.picture || !first.volume) requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
})();"""
_NOW = "() => performance.timeOrigin + performance.now()"
_MOVED = (
    """() => document.querySelector(".dnb-view").deformnb.caster.fields.planar?.maps.some((v) => v !== 0) ?? false"""
)


@contextmanager
def _emulated(name: str, folder: Path, page: Any) -> Iterator[tuple[float, Any, Callable[[str], str]]]:
    from browser.emulated_notebook import COLAB, VS_CODE, emulate

    with emulate({"VS Code": VS_CODE, "Colab": COLAB}[name], folder) as notebook:
        notebook.open(page)
        started = page.evaluate(_NOW)
        notebook.run(page, CELL)
        yield started, notebook.frame(page), lambda code: notebook.ask(page, code)


@contextmanager
def _lab(name: str, folder: Path, page: Any) -> Iterator[tuple[float, Any, Callable[[str], str]]]:
    from browser.test_lab_conditions import ProxiedLab, Proxy

    kind = hosts()[0] if name == "JupyterLab" else ProxiedLab
    lab = kind(folder)
    proxy = None
    try:
        lab.started()
        if name != "JupyterLab":
            lab.proxy = proxy = Proxy(lab.port)
        lab.run_all = lambda page: None
        lab.open_notebook(page, [CELL])
        lab.run(page, "")  # the kernel answers
        started = page.evaluate(_NOW)
        page.evaluate("() => { jupyterapp.commands.execute('notebook:run-all-cells'); }")
        yield started, page.main_frame, lambda code: lab.run(page, code)
    finally:
        if proxy is not None:
            proxy.close()
        lab.close()


HOSTS: dict[str, Any] = {"JupyterLab": _lab, "JupyterLab, proxy": _lab, "VS Code": _emulated, "Colab": _emulated}
"""The hosts by their names in the report."""


def measure(name: str, browser: Any, folder: Path) -> dict[str, float]:
    """Milliseconds to picture and volume; pictures and views of a drag, and milliseconds until Python has the point."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.add_init_script(_FIRST)
    page.add_init_script(path=RATES)
    with HOSTS[name](name, folder, page) as (started, frame, ask):
        first = _wait(
            page, lambda: frame.evaluate("deformnbFirst"), lambda found: "picture" in found and "volume" in found
        )
        page.wait_for_timeout(4000)  # what is compiled in the background is there
        disc = frame.locator(".dnb-editor [data-id] .dnb-ed-disc").last
        disc.scroll_into_view_if_needed()
        box = disc.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        frame.evaluate("deformnbRates.begin()")
        page.mouse.down()
        for k in range(1, 26):
            page.mouse.move(x - 3 * k, y - k)
            page.wait_for_timeout(16)
        rates = frame.evaluate("deformnbRates.end()")
        page.mouse.up()
        up = _wait(page, lambda: frame.evaluate("deformnbFirst"), lambda found: "up" in found)["up"]
        last = _wait(page, lambda: json.loads(ask(_LAST)), lambda found: found is not None)
        while last != (last := json.loads(ask(_LAST))):
            page.wait_for_timeout(300)
        _wait(page, lambda: frame.evaluate(_MOVED), bool)
    page.close()
    return {
        "picture": first["picture"] - started,
        "volume": first["volume"] - started,
        "pictures": len(rates["pictures"]),
        "views": len(rates["views"]),
        "python": last[0] - up,
    }


def _wait(page: Any, read: Callable[[], Any], reached: Callable[[Any], bool]) -> Any:
    for _ in range(3000):
        if reached(found := read()):
            return found
        page.wait_for_timeout(20)
    raise TimeoutError(f"nothing happened in a minute: {found}")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks hosts", description=__doc__.split("\n\n")[0])
    parser.add_argument("--hosts", nargs="+", choices=HOSTS, default=[*HOSTS])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args(arguments)
    from playwright.sync_api import sync_playwright

    browser_arguments = hosts()[1]
    results: dict[str, list[dict[str, float]]] = {name: [] for name in options.hosts}
    with sync_playwright() as p, tempfile.TemporaryDirectory() as folder:
        browser = p.chromium.launch(executable_path=chromium_path(), headless=True, args=browser_arguments)
        for k in range(options.rounds):
            for name, found in results.items():
                own = Path(folder) / f"{len(name)}-{k}"
                own.mkdir()
                found.append(measure(name, browser, own))
        browser.close()
    print("| host | picture, ms | volume, ms | pictures of the drag | views of the drag | Python has the point, ms |")
    print("|---|---|---|---|---|---|")
    for name, found in results.items():
        columns = ("picture", "volume", "pictures", "views", "python")
        print(f"| {name} | {' | '.join(f'{statistics.median(one[c] for one in found):.0f}' for c in columns)} |")
    return 0
