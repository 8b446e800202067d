"""From the pointer to the pixels: ``python -m benchmarks latency``.

Each view is a notebook in a real JupyterLab and a real, headless Chromium; a mouse drags a control point, or for
pyvista a slider, and hooks in the page report when pixels changed. All views of a size are open at once and edited in
turns, so other load of the machine affects all of them. A view that is missing or fails is reported as such. The
last lines are the targets; if one is missed the exit status is 1.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.latency_cells import CASES, HEIGHT, POINTS, WIDTH
from benchmarks.latency_page import Seat
from benchmarks.latency_report import TARGETS, Results, table, verdicts

_SHORT = 2.0  # seconds of a drag that shows how far behind a view is before any lag can have grown

_FEWER = 3  # cases without a target (a smaller volume, another package) get this many times fewer edits


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks latency", description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--sizes",
        type=int,
        nargs="+",
        default=[256, 128],
        help="edges of the volumes in voxels; the targets are those of the largest",
    )
    parser.add_argument("--views", nargs="+", help="only views whose name contains one of these")
    parser.add_argument("--edits", type=int, default=18, help="timed edits of each view (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="turns in which they are done (default %(default)s)")
    parser.add_argument("--drag", type=float, default=10.0, help="seconds of the long drag (default %(default)s)")
    parser.add_argument("--memory-edits", type=int, default=500, help="edits after which memory is measured again")
    parser.add_argument("--minutes", type=float, default=9.0, help="after which no other size is begun")
    parser.add_argument("--json", type=Path, help="file for all single figures")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # server and browser must not outlive this
    _introduce()
    report = _measure_all(options)
    print(f"Load of the machine before and after: {report['load_before'][0]:.1f}, {report['load_after'][0]:.1f}")
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    largest = max(options.sizes)
    judged = verdicts(report["sizes"].get(largest, {}))
    print(f"\nTargets at {largest} x {largest} x {largest}:\n", *judged, sep="\n")
    return 0 if judged and all(verdict.is_met for verdict in judged) and not _failures(report) else 1


def _failures(report: dict[str, Any]) -> list[str]:
    return [name for results in report["sizes"].values() for name, result in results.items() if "failed" in result]


def _measure_all(options: argparse.Namespace) -> dict[str, Any]:
    """All figures by size and view; what takes too long is left out."""
    chosen = [n for n in CASES if not options.views or any(part in n for part in options.views)]
    report: dict[str, Any] = {"load_before": os.getloadavg(), "sizes": {}}
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for size in sorted(options.sizes, reverse=True):
            if time.monotonic() - start > 60 * options.minutes:
                print(f"{size} x {size} x {size} is left out: {options.minutes:g} minutes are over.\n")
                continue
            report["sizes"][size] = results = {name: {} for name in chosen}
            try:
                _measure_size(size, results, options, Path(folder))
            finally:  # also figures from before an interrupt
                print(table(size, results), flush=True)
    return {**report, "load_after": os.getloadavg()}


def _introduce() -> None:
    from benchmarks.run import machine

    print(
        f"{machine()}\n\n{POINTS} points, uint8, views of {WIDTH} x {HEIGHT} pixels; JupyterLab and Chromium without "
        "a GPU.\n"
    )


def hosts() -> tuple[Any, list[str]]:
    """JupyterLab as the tests start it, and how they start Chromium."""
    tests = str(Path(__file__).resolve().parents[1] / "tests")
    if tests not in sys.path:
        sys.path.insert(0, tests)
    from browser.hosts import Lab
    from browser.live_page import ARGUMENTS

    return Lab, ARGUMENTS


def _measure_size(size: int, results: Results, options: argparse.Namespace, folder: Path) -> None:
    from playwright.sync_api import sync_playwright

    make_lab, browser_arguments = hosts()
    own = folder / str(size)
    own.mkdir()
    lab = make_lab(own)
    try:
        lab.started()
        with sync_playwright() as p:
            browser = p.chromium.launch(executable_path=chromium_path(), headless=True, args=browser_arguments)
            try:
                _measure(browser, lab, size, results, options)
            finally:
                browser.close()
    finally:
        lab.close()


def chromium_path() -> str | None:
    """The browser of the tests; None for Playwright's own."""
    from scripts import chromium  # of the tests, as hosts

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
    is_target = size == max(options.sizes)
    each("does it change", _prove)
    for k in range(options.rounds):
        each(f"round {k + 1}", lambda seat, result: _round(seat, result, _edits(seat, is_target, options)))
    each("whole edits", lambda seat, result: _whole_edits(seat, result, 4 if seat.name in TARGETS else 1))
    each("short drag", lambda seat, result: _drag(seat, result, "short_drag", _SHORT))
    for name in [name for name in seats if name not in TARGETS or not is_target]:
        seats.pop(name).close()
    each("long drag", lambda seat, result: _drag(seat, result, "long_drag", options.drag))
    if options.memory_edits:
        each("memory", lambda seat, result: _memory(seat, result, options.memory_edits))


def _edits(seat: Seat, is_target: bool, options: argparse.Namespace) -> int:
    """Number of edits of a view that are timed in one round."""
    whole = options.edits if is_target and seat.name in TARGETS else options.edits // _FEWER
    return max(1, -(-whole // options.rounds))


def _prove(seat: Seat, result: dict[str, Any]) -> None:
    if not seat.changes(1.5):
        raise RuntimeError("an edit did not change the picture on the screen")


def _round(seat: Seat, result: dict[str, Any], edits: int) -> None:
    seat.pointer.release()
    seat.edit(0.0)  # the first after others had their turn is cold
    for k in range(edits):
        view, picture = seat.edit(k + 1.0)
        result.setdefault("edit_ms", []).append(view)
        if picture is not None:
            result.setdefault("picture_ms", []).append(picture)
    seat.pointer.release()
    seat.rest(800)


def _whole_edits(seat: Seat, result: dict[str, Any], edits: int) -> None:
    result["whole_ms"] = []

    def work() -> None:
        for k in range(edits):
            result["whole_ms"].append(seat.whole_edit(k + 1.0))

    for way, count in seat.measure_bytes(work).items():
        result[f"bytes_{way}"] = count / edits


def _drag(seat: Seat, result: dict[str, Any], name: str, seconds: float) -> None:
    result[name] = seat.drag(seconds)


def _memory(seat: Seat, result: dict[str, Any], edits: int) -> None:
    seat.many(edits // 5)  # caches are filled
    kernel, page = seat.memory()
    seat.many(edits)
    kernel_after, page_after = seat.memory()
    result["memory_mib"] = {
        "kernel": kernel,
        "kernel_growth": kernel_after - kernel,
        "page": page,
        "page_growth": page_after - page,
    }


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
