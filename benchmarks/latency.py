"""From the hand to the pixels: ``python -m benchmarks latency``.

Each view is a notebook in a real JupyterLab and a real, headless Chromium; a mouse drags a control point, or for
pyvista a slider, and hooks in the page say when pixels changed. All views of a size are open at once and edited in
turns, so what else the machine does falls on all of them. A view that is missing or fails is reported as such.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.latency_cells import CASES, HEIGHT, POINTS, WIDTH
from benchmarks.latency_page import Seat

RIVAL = "pyvista, trame"
TARGETS = {"Editor + LiveView": 100.0, "Editor + VolumeView": 400.0}
"""Milliseconds from an edit to new pixels that a view shall not exceed, with OpenGL in software."""

_TIMES_FASTER = 3.0
_GRID_HZ = 30.0

Results = dict[str, dict[str, Any]]


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks latency", description=__doc__.split("\n\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[128, 256], help="edges of the volumes in voxels")
    parser.add_argument("--views", nargs="+", help="only views whose name contains one of these")
    parser.add_argument("--edits", type=int, default=20, help="timed edits of each view (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=4, help="turns in which they are done (default %(default)s)")
    parser.add_argument("--drag", type=float, default=10.0, help="seconds of the long drag (default %(default)s)")
    parser.add_argument("--memory-edits", type=int, default=500, help="edits after which memory is looked at again")
    parser.add_argument("--json", type=Path, help="file for all single figures")
    options = parser.parse_args(arguments)
    chosen = [n for n in CASES if not options.views or any(part in n for part in options.views)]
    report: dict[str, Any] = {"load_before": os.getloadavg(), "sizes": {}}
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # server and browser must not outlive this
    _introduce()
    with tempfile.TemporaryDirectory() as folder:
        for size in options.sizes:
            report["sizes"][size] = results = {name: {} for name in chosen}
            try:
                _measure_size(size, results, options, Path(folder))
            finally:  # also what was measured before somebody stopped it
                print(_table(size, results), flush=True)
    report["load_after"] = os.getloadavg()
    print(f"Load of the machine before and after: {report['load_before'][0]:.1f}, {report['load_after'][0]:.1f}")
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    return 0


def _introduce() -> None:
    from benchmarks.run import machine

    print(f"{machine()}\n\n{POINTS} points, uint8, views of {WIDTH} x {HEIGHT} pixels; JupyterLab and Chromium without "
          "a graphics card.\n")


def _hosts() -> tuple[Any, list[str]]:
    """JupyterLab as the tests start it, and how they start Chromium."""
    tests = str(Path(__file__).resolve().parents[1] / "tests")
    if tests not in sys.path:
        sys.path.insert(0, tests)
    from browser.hosts import Lab
    from browser.live_page import ARGUMENTS

    return Lab, ARGUMENTS


def _measure_size(size: int, results: Results, options: argparse.Namespace, folder: Path) -> None:
    from playwright.sync_api import sync_playwright

    make_lab, browser_arguments = _hosts()
    own = folder / str(size)
    own.mkdir()
    lab = make_lab(own)
    try:
        lab.started()
        with sync_playwright() as p:
            browser = p.chromium.launch(executable_path=_chromium(), headless=True, args=browser_arguments)
            try:
                _measure(browser, lab, size, results, options)
            finally:
                browser.close()
    finally:
        lab.close()


def _chromium() -> str | None:
    from scripts import chromium  # of the tests, as _hosts

    return chromium()


def _measure(browser: Any, lab: Any, size: int, results: Results, options: argparse.Namespace) -> None:
    seats: dict[str, Seat] = {}

    def each(what: str, work: Callable[[Seat, dict[str, Any]], None]) -> None:
        """Do something with every view that has not failed."""
        for name in list(seats):
            print(f"  {size}: {name}: {what}", file=sys.stderr, flush=True)
            seats[name].page.bring_to_front()
            try:
                work(seats[name], results[name])
            except Exception as error:
                results[name]["failed"] = f"{what}: {_one_line(error)}"
                seats.pop(name).close()

    for name in results:
        print(f"  {size}: {name}: open", file=sys.stderr, flush=True)
        try:
            seats[name] = Seat(browser, lab, name, size)
        except Exception as error:
            results[name]["failed"] = f"open: {_one_line(error)}"
    each("does it change", _prove)
    for k in range(options.rounds):
        each(f"round {k + 1}", lambda seat, result: _round(seat, result, -(-options.edits // options.rounds)))
    each("whole edits", _whole_edits)
    each("drags", lambda seat, result: _drags(seat, result, options.drag))
    if options.memory_edits:
        each("memory", lambda seat, result: _memory(seat, result, options.memory_edits))


def _prove(seat: Seat, result: dict[str, Any]) -> None:
    if not seat.changes(1.5):
        raise RuntimeError("an edit did not change the picture on the screen")


def _round(seat: Seat, result: dict[str, Any], edits: int) -> None:
    seat.hand.release()
    seat.edit(0.0)  # the first after others had their turn is cold
    for k in range(edits):
        view, editor = seat.edit(k + 1.0)
        result.setdefault("edit_ms", []).append(view)
        if editor is not None:
            result.setdefault("editor_ms", []).append(editor)
    seat.hand.release()
    seat.rest(800)


def _whole_edits(seat: Seat, result: dict[str, Any], edits: int = 5) -> None:
    result["whole_ms"] = []

    def work() -> None:
        for k in range(edits):
            result["whole_ms"].append(seat.whole_edit(k + 1.0))

    up, down = seat.bytes_of(work)
    result["bytes_up"], result["bytes_down"] = up / edits, down / edits


def _drags(seat: Seat, result: dict[str, Any], seconds: float) -> None:
    result["short_drag"], result["long_drag"] = seat.drag(2.0), seat.drag(seconds)


def _memory(seat: Seat, result: dict[str, Any], edits: int) -> None:
    warm = edits // 5
    seat.many(warm)
    kernel, page = seat.memory()
    seat.many(edits - warm)
    kernel_after, page_after = seat.memory()
    result["memory_mib"] = {"kernel": kernel, "kernel_growth": kernel_after - kernel, "page": page,
                            "page_growth": page_after - page}


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


# ---- the report ------------------------------------------------------------------------------------------------------

_COLUMNS: dict[str, Callable[[dict[str, Any], dict[str, Any]], str]] = {
    "edit to pixels, median ms": lambda r, _: f"{statistics.median(r['edit_ms']):.0f}",
    "worst": lambda r, _: f"{max(r['edit_ms']):.0f}",
    "times faster": lambda r, rival: f"{_faster(r, rival):.1f}",
    "full picture, ms": lambda r, _: f"{statistics.median(r['whole_ms']):.0f}",
    "kB per edit, up + down": lambda r, _: f"{r['bytes_up'] / 1e3:.1f} + {r['bytes_down'] / 1e3:.1f}",
    "drag, view Hz": lambda r, _: f"{r['long_drag']['view_hz']:.1f}",
    "picture and grid Hz": lambda r, _: f"{r['long_drag']['editor_hz']:.1f}" if r.get("editor_ms") else "",
    "of inputs Hz": lambda r, _: f"{r['long_drag']['inputs_hz']:.0f}",
    "lag after 2 s, long drag, ms": lambda r, _: " / ".join(
        f"{r[d]['catch_up_ms']:.0f}" for d in ("short_drag", "long_drag")),
    "kernel MiB, growth": lambda r, _: f"{r['memory_mib']['kernel']:.0f}, {r['memory_mib']['kernel_growth']:+.1f}",
    "page MiB, growth": lambda r, _: f"{r['memory_mib']['page']:.0f}, {r['memory_mib']['page_growth']:+.1f}",
}


def _faster(result: dict[str, Any], rival: dict[str, Any]) -> float:
    """How many times sooner than the rival's the pixels come; medians of one run."""
    return statistics.median(rival["edit_ms"]) / statistics.median(result["edit_ms"])


def _table(size: int, results: Results) -> str:
    rival = results.get(RIVAL, {})
    lines = [f"### {size} x {size} x {size}\n", f"| view | {' | '.join(_COLUMNS)} |", f"|---{'|---' * len(_COLUMNS)}|"]
    for name, result in results.items():
        lines.append(f"| {name} | {' | '.join(_cell(make, result, rival) for make in _COLUMNS.values())} |")
    notes = [f"- {name} failed. {result['failed']}" for name, result in results.items() if "failed" in result]
    return "\n".join([*lines, "", *notes, *verdicts(results), ""])


def _cell(make: Callable[[dict[str, Any], dict[str, Any]], str], result: dict[str, Any], rival: dict[str, Any]) -> str:
    try:
        return make(result, rival)
    except (KeyError, statistics.StatisticsError):  # it failed before that was measured
        return ""


def verdicts(results: Results) -> list[str]:
    """Each target and whether it is met, as far as it was measured."""
    lines = []
    for name, limit in TARGETS.items():
        result = results.get(name, {})
        if "edit_ms" not in result:
            continue
        median = statistics.median(result["edit_ms"])
        lines.append(f"- {name}: {median:.0f} ms, wanted at most {limit:.0f}: {_met(median <= limit)}")
        if "edit_ms" in results.get(RIVAL, {}):
            faster = _faster(result, results[RIVAL])
            lines.append(f"- {name}: {faster:.1f} times faster than {RIVAL}, wanted {_TIMES_FASTER:.0f}: "
                         f"{_met(faster >= _TIMES_FASTER)}")
        if "long_drag" in result:
            hz = result["long_drag"]["editor_hz"]
            lines.append(f"- {name}: picture and grid at {hz:.0f} Hz, wanted {_GRID_HZ:.0f}: {_met(hz >= _GRID_HZ)}")
    return lines


def _met(is_met: bool) -> str:
    return "met" if is_met else "MISSED"
