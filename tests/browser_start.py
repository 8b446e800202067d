"""A plugin for pytest: where no browser can be driven the tests that drive one are skipped, and one line reports why.

Each of them would fail separately otherwise, and be repeated. Whether one can be driven is tried once for a run.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from scripts import chromium

_REASON = "DEFORMNB_TEST_NO_BROWSER"  # the processes of pytest-xdist have it from the first one
_CURE = '"sh run test" installs what is missing on Debian; elsewhere install Chromium and pip install playwright'
_TRIAL = """
import sys
from playwright.sync_api import sync_playwright
with sync_playwright() as p:
    p.chromium.launch(executable_path=sys.argv[1], args=["--no-sandbox", "--disable-gpu"]).close()
"""


def why_no_browser() -> str:
    """The reason for which no browser can be driven, and what to do, in a sentence; empty where one can."""
    if _REASON not in os.environ:
        found = _try_browser()
        os.environ[_REASON] = f"the tests in a browser are skipped, since {found}; {_CURE}" if found else ""
    return os.environ[_REASON]


def _try_browser() -> str:
    path = chromium()
    if path is None:
        return "there is no Chromium, or no Playwright to drive it"
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRIAL, path],
            capture_output=True,
            text=True,
            timeout=120,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"{path} has not started within two minutes"
    return "" if done.returncode == 0 else _shorten_errors(done.stderr)


def _shorten_errors(errors: str) -> str:
    """The reason for which the driver or the browser has not started, in a few words."""
    library = re.search(r"(?:(\S+): )?error while loading shared libraries: ([^\s:]+)", errors)
    if library is not None:
        return f"{library[1] or 'a program'} needs the shared library {library[2]}, which is missing"
    lines = [line.strip() for line in errors.splitlines() if re.match(r"\S*Error: ", line)]
    return f"it does not start ({lines[-1] if lines else errors.strip()[-200:]})"


def pytest_report_header(config: pytest.Config) -> str | None:
    """Report for a run in several processes, which begin after this; else the collected tests are known first."""
    return why_no_browser() or None if config.getoption("numprocesses", None) else None


def pytest_report_collectionfinish(config: pytest.Config, items: list[pytest.Item]) -> str | None:
    if config.getoption("numprocesses", None) or not any(map(_drives_a_browser, items)):
        return None
    return why_no_browser() or None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if _drives_a_browser(item) and why_no_browser():
        pytest.skip(why_no_browser())


def _drives_a_browser(item: pytest.Item) -> bool:
    return item.get_closest_marker("needs_browser") is not None
