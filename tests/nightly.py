"""A plugin for pytest: what takes long and is alike to what is run is left to the nightly run, where CI asks for it."""

from __future__ import annotations

import os
from collections import Counter

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a table of cases that is marked ``sampled(n)`` each n-th and each with a word of its own is run at once.

    The words of a case are the parts of its name: the values of its arguments. So each row of a registry, and each case
    that is unlike the others, is tested at each change, and what is left to the nightly run are their combinations.
    """
    cases: Counter[str] = Counter()
    words: dict[str, set[str]] = {}
    for item in items:
        marker = item.get_closest_marker("sampled")
        if marker is None:
            continue
        name, _, case = item.nodeid.removesuffix("]").partition("[")
        seen, own = words.setdefault(name, set()), set(case.split("-"))
        if cases[name] % marker.args[0] and own <= seen:
            item.add_marker(pytest.mark.nightly)
        else:
            seen |= own
        cases[name] += 1


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    is_left = os.environ.get("CI") and os.environ.get("HYPOTHESIS_PROFILE") != "nightly"
    if is_left and item.get_closest_marker("nightly") is not None:
        pytest.skip("it takes long: HYPOTHESIS_PROFILE=nightly runs all")
