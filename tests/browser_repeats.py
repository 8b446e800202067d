"""A plugin for pytest: a test that drives a browser gets a second attempt, and every repeat is printed as a defect.

What a browser does depends on how busy the machine is, and one lost race in thousands of tests fails a whole run. Only
tests marked ``needs_browser`` are repeated, once, with new fixtures; all other failures are final.
"""

from __future__ import annotations

from typing import Any

import pytest

_shared: dict[pytest.FixtureDef[Any], pytest.FixtureRequest] = {}
"""Fixtures of a module that are set up now, in the order in which that happened."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("usepdb"):  # the debugger stops at the first failure, and pytest-rerunfailures refuses both
        return
    for item in items:
        if item.get_closest_marker("needs_browser") is not None:
            item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.hookimpl(tryfirst=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest) -> None:
    if fixturedef.scope not in ("function", "session"):
        _shared[fixturedef] = request


def pytest_fixture_post_finalizer(fixturedef: pytest.FixtureDef[Any]) -> None:
    _shared.pop(fixturedef, None)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A second attempt starts with a new browser, page and notebook: the first may have left them broken."""
    if getattr(item, "execution_count", 1) < 2:
        return
    for fixturedef, request in reversed(list(_shared.items())):
        try:
            fixturedef.finish(request)
        except Exception as error:  # of a page that was broken before; the failure that did it is reported
            item.add_report_section("setup", "before the repeat", f"closing {fixturedef.argname}: {error!r}")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    stats = terminalreporter.stats
    repeats = stats.get("rerun", [])
    if not repeats:
        return
    failed = {report.nodeid for kind in ("failed", "error") for report in stats.get(kind, [])}
    terminalreporter.section("repeated tests: each is a defect to mend", yellow=True, bold=True)
    for report in repeats:
        outcome = "failed again" if report.nodeid in failed else "passed when repeated"
        terminalreporter.line(f"{report.nodeid} ({outcome})")
        for line in _error_summary(report.longreprtext):
            terminalreporter.line(f"    {line}")


def _error_summary(text: str) -> list[str]:
    """The first line of the error in the text of a failure, and the last line, which states where it was raised."""
    lines = [line for line in text.splitlines() if line.strip()]
    errors = [line[1:].strip() for line in lines[:-1] if line.startswith("E ")]
    return [*errors[:1], *lines[-1:]]
