"""Memory while a studio is edited: ``python -m benchmarks memory [--minutes 10]``.

A real mouse drags points of a studio in JupyterLab and turns its volume, with an undo after every third drag. Measured
after each minute, at rest, are the script objects of the page after a forced collection, and the resident memory of the
processes of page and kernel (Linux only). Then the cell is run again.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.latency import chromium_path, hosts
from benchmarks.studio import free_port
from benchmarks.studio_cases import CASES
from benchmarks.studio_page import StudioTab

_ROOT = Path(__file__).resolve().parents[1]
_COLUMNS = ("script objects", "page", "kernel")


def main(arguments: list[str]) -> int:
    """Print a table with a row for each minute, and the ratio of the last to the first."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks memory", description=__doc__.split("\n\n")[0])
    parser.add_argument("--case", choices=CASES, default="16 points", help="of the studio (default %(default)s)")
    parser.add_argument("--minutes", type=int, default=10, help="of editing (default %(default)s)")
    parser.add_argument("--size", type=int, default=128, help="edge of the volume in voxels (default %(default)s)")
    options = parser.parse_args(arguments)
    from playwright.sync_api import sync_playwright

    from benchmarks.run import machine

    print(f"{machine()}\n\nThe studio in JupyterLab, {options.case}, {options.size}^3 voxels of uint8, in MB.\n")
    print(f"| after | edits | {' | '.join(_COLUMNS)} |\n|---|---{'|---' * len(_COLUMNS)}|", flush=True)
    make_lab, browser_arguments = hosts()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as p:
        port = free_port()
        browser = p.chromium.launch(
            executable_path=chromium_path(),
            headless=True,
            args=[*browser_arguments, f"--remote-debugging-port={port}"],
        )
        lab = make_lab(Path(folder))
        try:
            lab.started()
            tab = StudioTab(browser, port, lab, options.case, "now", _ROOT, options.size, Path(folder))
            rows = [_row(f"minute {k + 1}", _edit(tab, 60.0), browser, lab, tab) for k in range(options.minutes)]
            lab.run_all(tab.page)
            tab.page.wait_for_timeout(500)
            tab.wait_until_ready()
            tab.rest()
            again = _row("another run", 0, browser, lab, tab)
            for name, row in (("the last minute", rows[-1]), ("another run", again)):
                ratios = [f"{now / first:.2f}" for first, now in zip(rows[0], row, strict=True)]
                print(f"| {name}, by the first minute | | {' | '.join(ratios)} |")
            if tab.errors:
                print(f"errors of the page: {tab.errors[:3]}", file=sys.stderr)
            tab.close()
        finally:
            browser.close()
            lab.close()
    return 0


def _edit(tab: StudioTab, seconds: float) -> int:
    """Edit for some seconds; returns the number of drags."""
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        tab.drag_point(2.0)
        tab.turn()
        count += 1
        if count % 3 == 0:
            tab.undo()
    tab.rest()
    return count


def _row(name: str, edits: int, browser: Any, lab: Any, tab: StudioTab) -> list[float]:
    """Print and return the megabytes of script objects, of the page's process and of the kernel."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    pages = [_resident(process["id"]) for process in processes if process["type"] == "renderer"]
    figures = [tab.script_bytes() / 1e6, max(pages), _resident(int(lab.run(tab.page, "import os; print(os.getpid())")))]
    print(f"| {name} | {edits or ''} | {' | '.join(f'{figure:.1f}' for figure in figures)} |", flush=True)
    return figures


def _resident(process: int) -> float:
    """Megabytes of resident memory of a process."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) * 1024 / 1e6


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
