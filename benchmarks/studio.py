"""The whole studio under a hand: ``python -m benchmarks studio [--against CHECKOUT-OR-REVISION]``.

Each case is a studio in a real JupyterLab (or the application) of 1280 x 800 pixels and a real, headless Chromium
without a GPU. Events of a real mouse, 60 a second, drag a point along the path of a hand, and do not wait for the page.
Counted are pictures and views a second, the gaps between the page's frames, the share of the pane's pixels that a view
has while it moves, and the time from the drop to the volume in full. A second, traced drag splits the main thread's own
processor time for a movement. With another checkout, or a revision that is checked out and bundled, both take turns in
one run. ``--busy 2`` lets two loops run beside it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.latency import chromium_path, hosts
from benchmarks.studio_cases import CASES

_ROOT = Path(__file__).resolve().parents[1]
_RATES = {
    "pictures a second": ("pictures", 1),
    "views a second": ("views", 1),
    "pause, median ms": ("median", 0),
    "99 % ms": ("most", 0),
    "longest ms": ("longest", 0),
    "settled ms": ("settled", 0),
    "pixels across": ("across", 2),
    "pixels down": ("down", 2),
}
_WORK = ("script", "style", "layout", "paint", "collection", "other", "gpu")


def main(arguments: list[str]) -> int:
    """Print a table of medians of all rounds."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks studio", description=__doc__.split("\n\n")[0])
    parser.add_argument("--cases", nargs="+", help="only cases whose name contains one of these")
    parser.add_argument("--against", help="another checkout, bundled, or a revision of git: takes turns with this one")
    parser.add_argument("--size", type=int, default=256, help="edge of the volume in voxels (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="drags of each (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each drag (default %(default)s)")
    parser.add_argument("--busy", type=int, default=0, help="loops that run beside it (default none)")
    parser.add_argument("--application", action="store_true", help="in the application instead of JupyterLab")
    parser.add_argument("--no-trace", action="store_true", help="leave out the split of the main thread's time")
    parser.add_argument("--json", type=Path, help="file for all single figures")
    options = parser.parse_args(arguments)
    from benchmarks.run import machine

    where = "the application" if options.application else "JupyterLab"
    print(
        f"{machine()}\n\nThe studio in {where}, 1280 x 800, {options.size}^3 voxels of uint8; medians of "
        f"{options.rounds} drags of {options.seconds:g} s, {options.busy} busy loops beside them. Work is milliseconds "
        "of the main thread for one movement, and of the GPU's thread.\n"
    )
    columns = [*_RATES, *([] if options.no_trace else [*(f"{kind} ms" for kind in _WORK), "heap MiB"]), "load"]
    print(f"| case | | {' | '.join(columns)} |\n|---|---{'|---' * len(columns)}|", flush=True)
    found: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder, _trees(options.against, Path(folder)) as trees:
        for case in CASES:
            if options.cases and not any(part in case for part in options.cases):
                continue
            found[case] = measure(case, trees, options, Path(folder))
            for name, figures in found[case].items():
                print(f"| {case} | {name} | {' | '.join(_row(figures, options))} |", flush=True)
            if len(trees) == 2:
                print(f"| {case} | ratio | {' | '.join(_ratios(found[case], options))} |", flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


def _row(figures: dict[str, Any], options: argparse.Namespace) -> list[str]:
    cells = [f"{_median(figures, key):.{digits}f}" for key, digits in _RATES.values()]
    if not options.no_trace:
        cells += [f"{figures['trace'][kind]:.1f}" for kind in [*_WORK, "heap"]]
    return [*cells, f"{statistics.median(figures['load']):.1f}"]


def _ratios(found: dict[str, Any], options: argparse.Namespace) -> list[str]:
    """Figures of now by those of before."""
    before, now = found.values()
    cells = [_ratio(_median(now, key), _median(before, key)) for key, _ in _RATES.values()]
    if not options.no_trace:
        cells += [_ratio(now["trace"][kind], before["trace"][kind]) for kind in [*_WORK, "heap"]]
    return [*cells, ""]


def _ratio(now: float, before: float) -> str:
    return f"x {now / before:.2f}" if before else ""


def _median(figures: dict[str, Any], key: str) -> float:
    return statistics.median(one[key] for one in figures["rounds"])


@contextlib.contextmanager
def _trees(against: str | None, folder: Path) -> Iterator[dict[str, Path]]:
    """The checkouts to compare, by their names; a revision is checked out, bundled and removed again."""
    if not against:
        yield {"now": _ROOT}
        return
    if Path(against).is_dir():
        yield {"before": Path(against).resolve(), "now": _ROOT}
        return
    tree = folder / "before"
    subprocess.run(["git", "worktree", "add", "--detach", str(tree), against], cwd=_ROOT, check=True)
    try:
        modules = (_ROOT / "frontend" / "node_modules").resolve()
        (tree / "frontend" / "node_modules").symlink_to(modules, target_is_directory=True)
        lock = tree / "frontend" / "package-lock.json"
        os.utime(lock, (0, 0))  # older than what it has installed
        for script in (["node_tasks.py", "bundle"], ["native_build.py"]):
            subprocess.run([sys.executable, *script], cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, check=True)
        yield {"before": tree, "now": _ROOT}
    finally:
        subprocess.run(["git", "worktree", "remove", "--force", str(tree)], cwd=_ROOT, check=True)


@contextlib.contextmanager
def _busy(count: int) -> Iterator[None]:
    """Loops that occupy processors meanwhile."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def measure(case: str, trees: dict[str, Path], options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Figures of each tree, whose drags take turns."""
    from playwright.sync_api import sync_playwright

    from benchmarks.studio_page import StudioTab

    make_lab, browser_arguments = hosts()
    found: dict[str, Any] = {name: {"rounds": [], "load": []} for name in trees}
    own = folder / "".join(c for c in case if c.isalnum())
    own.mkdir()
    lab = None if options.application else make_lab(own)
    tabs: dict[str, StudioTab] = {}
    with sync_playwright() as p:
        port = free_port()
        browser = p.chromium.launch(
            executable_path=chromium_path(),
            headless=True,
            args=[*browser_arguments, f"--remote-debugging-port={port}"],
        )
        try:
            if lab:
                lab.started()
            for name, checkout in trees.items():
                print(f"  {case}: {name}, open", file=sys.stderr, flush=True)
                tabs[name] = StudioTab(browser, port, lab, case, name, checkout, options.size, own)
            for tab in tabs.values():
                tab.drag(1.0)  # what comes first is cold
            with _busy(options.busy):
                for k in range(options.rounds):
                    for name, tab in tabs.items():
                        print(f"  {case}: {name}, round {k + 1}", file=sys.stderr, flush=True)
                        found[name]["rounds"].append(tab.drag(options.seconds))
                        found[name]["load"].append(os.getloadavg()[0])
                if not options.no_trace:
                    for name, tab in tabs.items():
                        found[name]["trace"] = tab.trace(browser, min(2.0, options.seconds))
        finally:
            for tab in tabs.values():
                tab.close()
            browser.close()
            if lab:
                lab.close()
    return found


def free_port() -> int:
    """A port for the browser's protocol."""
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
