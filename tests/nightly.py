"""A plugin for pytest: long tests, and cases of tables like those that run, are left to the nightly run."""

from __future__ import annotations

import os

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Of each table of cases a sample is run at once: so many that each value of each argument occurs.

    The values of a case are the parts of its name. So each row of a registry is tested at each change, and so is each
    case that is unlike the others; the nightly run has their combinations. Of a table that is marked
    ``sampled(n)``, whose cases take long, every n-th is run.
    """
    tables: dict[str, list[pytest.Item]] = {}
    for item in items:
        tables.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in tables.values():
        marker = cases[0].get_closest_marker("sampled")
        kept = set(cases[:: marker.args[0]] if marker else cover_values(cases))
        for item in cases:
            if item not in kept:
                item.add_marker(pytest.mark.nightly)
    if runs_all(config):
        return
    left = [item for item in items if item.get_closest_marker("nightly") is not None]
    if left:  # not skipped: they are 14 000 of 23 000, and each would be set up and reported
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if item.get_closest_marker("nightly") is None]


def cover_values(cases: list[pytest.Item]) -> list[pytest.Item]:
    """Cases with all values that occur; the next is always the first of those with the most new ones."""
    values = [set(item.nodeid.removesuffix("]").partition("[")[2].split("-")) for item in cases]
    kept: list[pytest.Item] = []
    seen: set[str] = set()
    while True:
        gains = [len(own - seen) for own in values]
        best = gains.index(max(gains))
        if not gains[best]:
            return kept
        kept.append(cases[best])
        seen |= values[best]


def runs_all(config: pytest.Config) -> bool:
    """True at night, and where a test is requested by its name or all of them by their mark."""
    return (
        os.environ.get("HYPOTHESIS_PROFILE") == "nightly"
        or "nightly" in config.getoption("markexpr", "")
        or any("::" in argument for argument in config.args)
    )


def pytest_report_header(config: pytest.Config) -> str | None:
    if runs_all(config):
        return None
    return "left to the nightly run: long tests, and cases like those of this run (HYPOTHESIS_PROFILE=nightly runs all)"
