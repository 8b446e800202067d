"""Drags of one point: ``python -m benchmarks drags [--against CHECKOUT]``.

Each case is a notebook in a real JupyterLab and a real, headless Chromium, an editor next to its live view. A point is
dragged in a circle by 60 events a second, and dropped; then the view is turned by a drag on it. Rest is the time from
the end of such a drag until the picture in full is on the screen. With another checkout, bundled, both are interleaved
in one run, so other load of the machine affects both; the fastest round of each counts.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.latency import chromium_path, hosts
from benchmarks.latency_cells import HEIGHT, WIDTH
from benchmarks.latency_page import Seat
from benchmarks.studio_cases import CUT, PART, PLANE_POINTS, SPACE_POINTS

_EDITOR = f"""{PLANE_POINTS}
editor = Editor(picture, points, height=450, {{extra}})
follows = view.follow, editor, dn.Deformation((editor.step(),)).field(volume.grid)
"""

# Three slices through the middle of the volume, and a point there to be dragged.
_SPACE = f"""{SPACE_POINTS}
editor = SpaceEditor(volume, points, height=450)
follows = view.edit_points, editor
"""

CASES: dict[str, tuple[tuple[int, int, int], int, str]] = {
    "16 points": ((256, 256, 256), 16, ""),
    "64 points": ((256, 256, 256), 64, ""),
    "200 points": ((256, 256, 256), 200, ""),
    "200 points, cut": ((256, 256, 256), 200, CUT),
    "200 points, part": ((256, 256, 256), 200, PART),
    "16 points, space": ((256, 256, 256), 15, _SPACE),
    "512 x 512 x 200, 200 points": ((512, 512, 200), 200, ""),
}
"""Columns, rows and slices of the volume, number of points, and further arguments of the editor, or another editor."""

_CELL = f"""
import sys
sys.path.insert(0, {{checkout!r}})
import numpy as np
import deformnb as dn
from deformnb.widgets import Editor, LiveView, SpaceEditor
from ipywidgets import HBox
from benchmarks import problem
assert dn.__file__.startswith({{checkout!r}}), dn.__file__
nx, ny, nz = {{size}}
if {{file!r}}:
    volume = dn.read_volume({{file!r}})
    nx, ny, nz = volume.grid.shape[::-1]
else:
    values = problem.volume(nx, "uint8").values[:nz]
    volume = dn.Volume(np.ascontiguousarray(values), dn.Grid((nz, ny, nx)))
view = LiveView(volume, width={WIDTH}, height={HEIGHT})
{{editor}}
follow, *given = follows
follow(*given)
times = []
"""

# Tasks of more than 50 ms on the main thread, which is what a browser calls long.
_WATCH = """() => {
  const watch = (window.deformnbTasks = { tasks: [] });
  watch.observer = new PerformanceObserver((list) => watch.tasks.push(...list.getEntries().map((e) => e.duration)));
  watch.observer.observe({ type: "longtask" });
}"""
# Times of the epoch at which a view was given pictures to show, with their names.
_SHOWS = """() => {
  const { caster } = document.querySelector(".dnb-view").deformnb, { present } = Object.getPrototypeOf(caster);
  window.deformnbShown = [];
  caster.present = (name, ...rest) => {
    window.deformnbShown.push([performance.timeOrigin + performance.now(), name]);
    present.call(caster, name, ...rest);
  };
}"""
_SHOWN = "() => window.deformnbShown"
_WATCHED = """() => { const { observer, tasks } = window.deformnbTasks; observer.disconnect(); return tasks; }"""


_BINS = (50.0, 75.0, 100.0, 150.0)
"""Lower ends of the histogram of long tasks, in ms."""


def cells(case: str, checkout: Path, volume: Path | None = None) -> list[str]:
    """The notebook of a case, with the package of a checkout, of the case's volume or that of a file."""
    size, count, extra = CASES[case]
    editor = (_SPACE if extra == _SPACE else _EDITOR).format(count=count, extra=extra)
    file = str(volume.resolve()) if volume else ""
    return [_CELL.format(checkout=str(checkout), size=size, file=file, editor=editor), "HBox([editor, view])"]


def drag(seat: Seat, seconds: float) -> dict[str, Any]:
    """Pictures and grids a second, the long tasks of the main thread, and its own time for a picture, in ms."""
    seat.pointer.move(0.0)
    seat.rest(600)
    seat.fresh()
    session = seat.page.context.new_cdp_session(seat.page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})  # without the time of other processes
    worked = _processor_seconds(session)
    seat.page.evaluate(_WATCH)
    seat.pointer.drag(seconds, 60.0)
    tasks = seat.page.evaluate(_WATCHED)
    worked = _processor_seconds(session) - worked
    session.detach()
    seat.collect()
    inputs, span = seat.seen.inputs, (max(seat.seen.inputs) - seat.seen.inputs[0]) / 1e3
    rates = {
        kind: sum(inputs[0] < t <= max(inputs) for t in getattr(seat.seen, kind)) / span
        for kind in ("picture", "grid", "view")
    }
    work = 1e3 * worked / max(1, len(seat.seen.picture))
    return {
        **rates,
        "tasks": tasks,
        "pause": max([50.0, *tasks]),
        "work": work,
        "rest": _rest(seat, seat.pointer.release),
        "turned": _rest(seat, lambda: _turn(seat)),
    }


def _turn(seat: Seat) -> None:
    """Turn the view by a drag on it."""
    box = seat.page.locator(".dnb-view canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    seat.page.mouse.move(x, y)
    seat.page.mouse.down()
    for k in range(1, 9):
        seat.page.mouse.move(x + 6 * k, y + 2 * k)
    seat.page.mouse.up()


def _rest(seat: Seat, end: Callable[[], None]) -> float:
    """Milliseconds from the end of a drag until the final picture in full is on the screen."""
    seat.fresh()
    seat.page.evaluate(_SHOWS)
    end()
    seat.rest(2500)
    shown = seat.page.evaluate(_SHOWN)
    up = max(seat.seen.inputs)
    last = next(t for k, (t, name) in enumerate(shown) if all(n.startswith("full") for _, n in shown[k:]))
    return min(t for t in seat.seen.view if t > last) - up


def _processor_seconds(session: Any) -> float:
    """Seconds for which the main thread has run."""
    return float({m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}["TaskDuration"])


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks drags", description=__doc__.split("\n\n")[0])
    parser.add_argument("--cases", nargs="+", help="only cases whose name contains one of these")
    parser.add_argument("--against", type=Path, help="another checkout, bundled, interleaved with this one")
    parser.add_argument("--volume", type=Path, help="a file with the volume of all cases")
    parser.add_argument("--rounds", type=int, default=3, help="turns (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each drag (default %(default)s)")
    parser.add_argument("--json", type=Path, help="file for all single figures")
    options = parser.parse_args(arguments)
    from benchmarks.run import machine

    here = Path(__file__).resolve().parents[1]
    checkouts = {**({"before": options.against.resolve()} if options.against else {}), "now": here}
    print(
        f"{machine()}\n\nFastest of {options.rounds} drags; 50 ms is the shortest visible pause, and work is "
        "the main thread's own processor time for one picture. Long tasks are counted from "
        f"{', '.join(f'{low:.0f}' for low in _BINS)} ms on, in the drag that has fewest.\n"
    )
    measured = "picture Hz", "grid Hz", "view Hz", "pause ms", "work ms", "rest ms", "turned ms", "long tasks"
    columns = [f"{what}, {name}" for name in checkouts for what in measured]
    print(f"| case | {' | '.join(columns)} |\n|---{'|---' * len(columns)}|")
    found: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for case in CASES:
        if not options.cases or any(part in case for part in options.cases):
            found[case] = _measure(case, checkouts, options)
            print(f"| {case} | {' | '.join(_row(found[case][name]) for name in checkouts)} |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(f"\nLoad of the machine after: {os.getloadavg()[0]:.1f}")
    return 0


def _row(rounds: list[dict[str, Any]]) -> str:
    best = [f"{max(r[kind] for r in rounds):.0f}" for kind in ("picture", "grid", "view")]
    least = [f"{min(r[kind] for r in rounds):.0f}" for kind in ("pause", "work", "rest", "turned")]
    fewest = min((_histogram(r["tasks"]) for r in rounds), key=sum)
    return " | ".join([*best, *least, " ".join(map(str, fewest))])


def _histogram(tasks: list[float]) -> list[int]:
    """Number of tasks in each bin; the last has all that are longer."""
    ends = [*_BINS[1:], math.inf]
    return [sum(low <= task < high for task in tasks) for low, high in zip(_BINS, ends, strict=True)]


def _measure(case: str, checkouts: dict[str, Path], options: argparse.Namespace) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    make_lab, browser_arguments = hosts()
    rounds: dict[str, list[dict[str, Any]]] = {name: [] for name in checkouts}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as p:
        lab = make_lab(Path(folder))
        browser = p.chromium.launch(executable_path=chromium_path(), headless=True, args=browser_arguments)
        try:
            lab.started()
            seats = {
                name: Seat(browser, lab, f"drags {name}", 0, cells=cells(case, checkout, options.volume))
                for name, checkout in checkouts.items()
            }
            for k in range(options.rounds):
                for name, seat in seats.items():
                    print(f"  {case}: {name}, round {k + 1}", file=sys.stderr, flush=True)
                    seat.page.bring_to_front()
                    rounds[name].append(drag(seat, options.seconds))
        finally:
            browser.close()
            lab.close()
    return rounds
