"""What of a table is run at each change: every n-th case, and the first with each value of an argument."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import nightly
import pytest


def kept(n: int, *cases: str, name: str = "tests/test_table.py::test_it") -> list[str]:
    """The cases of a table, by the ends of their names, that are not left to the night."""
    items: list[Any] = [SimpleNamespace(nodeid=f"{name}[{case}]", left=[]) for case in cases]
    for item in items:
        item.get_closest_marker = {"sampled": pytest.mark.sampled(n)}.get
        item.add_marker = item.left.append
    nightly.pytest_collection_modifyitems(items)
    assert all([mark.name for mark in item.left] in ([], ["nightly"]) for item in items)
    return [case for item, case in zip(items, cases, strict=True) if not item.left]


def test_every_nth_case_is_kept() -> None:
    assert kept(3, *["a"] * 7) == ["a"] * 3
    assert kept(1, "a-b", "a-b", "a-b") == ["a-b"] * 3


@pytest.mark.parametrize("n", [2, 3, 4, 1000])
def test_every_value_of_every_argument_is_kept(n: int) -> None:
    kernels, trends, sizes = ("cubic", "linear", "gaussian", "wendland"), ("none", "rigid", "affine", "wave"), "2345"
    cases = ["-".join(case) for case in product(kernels, trends, sizes)]  # n divides the lengths: a stride alone fails
    found = kept(n, *cases)
    assert len(found) < 0.7 * len(cases)
    assert {word for case in found for word in case.split("-")} == {*kernels, *trends, *sizes}


def test_cases_unlike_the_others_are_kept() -> None:
    assert kept(1000, "cubic-one", "cubic-two", "all switched off", "cubic-one", "merged") == [
        "cubic-one", "cubic-two", "all switched off", "merged"]


def test_tables_are_counted_one_by_one() -> None:
    items: list[Any] = []
    for name in ("first", "second"):
        items += [SimpleNamespace(nodeid=f"{name}[{k}]", get_closest_marker={"sampled": pytest.mark.sampled(2)}.get,
                                  add_marker=lambda mark: pytest.fail(f"{mark} for a value of its own")) for k in "ab"]
    nightly.pytest_collection_modifyitems(items)


@pytest.mark.parametrize(("variables", "runs"), [
    ({}, True), ({"CI": "true"}, False), ({"CI": "true", "HYPOTHESIS_PROFILE": "ci"}, False),
    ({"CI": "true", "HYPOTHESIS_PROFILE": "nightly"}, True),
])
def test_only_ci_leaves_it_to_the_night(variables: dict[str, str], runs: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("CI", "HYPOTHESIS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    item: Any = SimpleNamespace(get_closest_marker={"nightly": pytest.mark.nightly}.get)
    if runs:
        nightly.pytest_runtest_setup(item)
    else:
        with pytest.raises(pytest.skip.Exception):
            nightly.pytest_runtest_setup(item)
