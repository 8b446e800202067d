"""The first minute: ``python -m benchmarks start [--against CHECKOUT]``.

A cell of a fresh kernel in a real JupyterLab makes a studio of a volume; hooks in the page, a headless Chromium without
a GPU, report when the first pixels of the picture and of the live volume are there, from the moment in which the
cell is run. With ``--against`` another checkout takes turns with this one. The first edit is one in Python, after the
studio has warmed up; processor time and memory are those of the kernel at its end (memory as in ``... classroom``).
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.classroom import pss
from benchmarks.latency import chromium_path, hosts

_CELL = """import sys
sys.path.insert(0, {checkout!r})
import deformnb as dn
studio = dn.Studio({volume})
studio"""

_WARM = """import json, os, time
studio.wait()
started = time.perf_counter()
studio.editor.points = studio.editor.points.add([10.0, 10.0], [10.0, 13.0])
studio.wait()
print(json.dumps({"edit_ms": 1e3 * (time.perf_counter() - started), "process": os.getpid(),
                  "cpu_s": time.process_time()}))"""

# Resolves with the milliseconds from the run of the cell to pixels of the picture and of the live volume.
_FIRST = """() => new Promise((done) => {
  const started = performance.now(), found = {};
  const small = Object.assign(document.createElement("canvas"), { width: 32, height: 32 }).getContext("2d");
  const hasInk = (canvas) => {
    if (!canvas || canvas.width < 2) return false;
    small.clearRect(0, 0, 32, 32);
    small.drawImage(canvas, 0, 0, 32, 32);
    const { data } = small.getImageData(0, 0, 32, 32);
    const greys = data.filter((_, k) => k % 4 === 1);
    return Math.max(...greys) - Math.min(...greys) > 60;
  };
  const look = () => {
    const now = performance.now() - started;
    if (!found.picture && hasInk(document.querySelector(".dnb-editor .dnb-ed-canvas"))) found.picture = now;
    const loop = document.querySelector(".dnb-view")?.deformnb?.loop;
    if (!found.volume && loop && Object.keys(loop.screen.drawn).length) found.volume = now;
    if ((found.picture && found.volume) || now > 180e3) done(found); else requestAnimationFrame(look);
  };
  jupyterapp.commands.execute("notebook:run-cell");
  requestAnimationFrame(look);
})"""


def main(arguments: list[str]) -> int:
    """Print a table of medians."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks start", description=__doc__.split("\n\n")[0])
    parser.add_argument("--volume", help="a file (default: the carp that is made up, 128 x 256 x 128)")
    parser.add_argument("--against", type=Path, help="another checkout, bundled, that takes turns with this one")
    parser.add_argument("--rounds", type=int, default=3, help="fresh kernels of each (default %(default)s)")
    options = parser.parse_args(arguments)
    here = Path(__file__).resolve().parents[1]
    checkouts = {**({"before": options.against.resolve()} if options.against else {}), "now": here}
    volume = (
        f"dn.read_volume({str(Path(options.volume).resolve())!r})"
        if options.volume
        else 'dn.datasets.PHANTOMS["fish"].make()'
    )
    found = measure(checkouts, volume, options.rounds)
    print("| | picture s | live volume s | first edit ms | processor s | memory MB |\n|---|---|---|---|---|---|")
    for name, rows in found.items():
        middle = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
        print(
            f"| {name} | {middle['picture']:.2f} | {middle['volume']:.2f} | {middle['edit_ms']:.0f} | "
            f"{middle['cpu_s']:.2f} | {middle['memory']:.0f} |"
        )
    return 0


def measure(checkouts: dict[str, Path], volume: str, rounds: int) -> dict[str, list[dict[str, float]]]:
    """Times of each checkout, interleaved, each in a separate kernel."""
    from playwright.sync_api import sync_playwright

    # Kernels have the modules as bytecode, as where the package was installed: to compile them takes 0.4 s.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    make_lab, browser_arguments = hosts()
    found: dict[str, list[dict[str, float]]] = {name: [] for name in checkouts}
    with tempfile.TemporaryDirectory() as folder:
        lab = make_lab(Path(folder))
        try:
            lab.started()
            with sync_playwright() as p:
                browser = p.chromium.launch(executable_path=chromium_path(), headless=True, args=browser_arguments)
                for number in range(rounds):
                    for name, checkout in checkouts.items():
                        cell = _CELL.format(checkout=str(checkout), volume=volume)
                        found[name].append(_one(lab, browser, cell, f"{name}{number}.ipynb"))
                browser.close()
        finally:
            lab.close()
    return found


def _one(lab: Any, browser: Any, cell: str, name: str) -> dict[str, float]:
    page = browser.new_page(viewport={"width": 1600, "height": 1000})
    try:
        lab.write_notebook([cell], name)
        page.goto(lab.url(lab.address.format(name=name, workspace=name.partition(".")[0])), timeout=90_000)
        lab.wait_until_open(page)
        first = page.evaluate(_FIRST)
        told = json.loads(lab.run(page, _WARM).splitlines()[-1])
        return {
            "picture": first["picture"] / 1e3,
            "volume": first["volume"] / 1e3,
            "edit_ms": told["edit_ms"],
            "cpu_s": told["cpu_s"],
            "memory": pss(told["process"]),
        }
    finally:
        lab.end_kernels()
        page.close()
