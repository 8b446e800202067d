"""A plugin for pytest: long tests, and cases of tables like those that run, are left to the nightly run."""

from __future__ import annotations

import os

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
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
        kept = cases[:: marker.args[0]] if marker else cover_values(cases)
        for item in cases:
            if item not in kept:
                item.add_marker(pytest.mark.nightly)


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


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("nightly") is None or os.environ.get("HYPOTHESIS_PROFILE") == "nightly":
        return
    if not any("::" in argument for argument in item.config.args):  # a test that is requested by its name is run
        pytest.skip("it takes long: HYPOTHESIS_PROFILE=nightly runs all")
