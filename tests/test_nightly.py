"""The cases of a table that are run at each change: those with each value of each argument, or every n-th."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import nightly
import pytest


class Item:
    """The facts of an item that the plugin reads."""

    def __init__(self, nodeid: str, n: int | None = None) -> None:
        self.nodeid = nodeid
        self.marks = {} if n is None else {"sampled": pytest.mark.sampled(n)}

    def get_closest_marker(self, name: str) -> Any:
        return self.marks.get(name)

    def add_marker(self, mark: Any) -> None:
        assert mark.name == "nightly"
        self.marks[mark.name] = mark


def run_of(*arguments: str, markexpr: str = "") -> tuple[Any, list[Any]]:
    """The configuration of a run of these arguments, and the list of the items that it leaves out."""
    left: list[Any] = []

    def leave(items: list[Any]) -> None:
        left.extend(items)

    hook = SimpleNamespace(pytest_deselected=leave)
    return SimpleNamespace(args=arguments, hook=hook, getoption={"markexpr": markexpr}.get), left


def table(*cases: str, n: int | None = None, name: str = "tests/test_table.py::test_it") -> list[Any]:
    """The items of a table of cases."""
    return [Item(f"{name}[{case}]", n) for case in cases]


def select_cases(*cases: str, n: int | None = None) -> list[str]:
    """The cases of a table, by the ends of their names, that are not left to the night."""
    items = table(*cases, n=n)
    kept = list(items)
    config, left = run_of("tests")
    nightly.pytest_collection_modifyitems(config, kept)
    assert sorted(map(id, [*kept, *left])) == sorted(map(id, items))
    return [case for item, case in zip(items, cases, strict=True) if item in kept]


def test_every_nth_case_of_a_table_that_takes_long_is_kept() -> None:
    assert select_cases(*"abcdefg", n=3) == ["a", "d", "g"]
    assert select_cases("a", "b", "c", n=1) == ["a", "b", "c"]


def test_every_value_of_every_argument_is_kept_in_few_cases() -> None:
    kernels, trends, sizes = ("cubic", "linear", "gaussian", "wendland"), ("none", "rigid", "affine", "wave"), "2345"
    found = select_cases(*("-".join(case) for case in product(kernels, trends, sizes)))
    assert len(found) == 4
    assert {word for case in found for word in case.split("-")} == {*kernels, *trends, *sizes}


def test_cases_unlike_the_others_are_kept() -> None:
    assert select_cases("cubic-one", "cubic-two", "all switched off", "merged-one", "merged") == [
        "cubic-one",
        "cubic-two",
        "all switched off",
        "merged-one",
    ]
    assert select_cases("a", "b", "c") == ["a", "b", "c"]


def test_tables_are_counted_one_by_one_and_a_test_that_is_none_is_kept() -> None:
    items = [item for name in ("first", "second") for item in table("a", "b", name=name)]
    items.append(Item("third"))
    config, left = run_of("tests")
    nightly.pytest_collection_modifyitems(config, items)
    assert len(items) == 5
    assert not left


@pytest.mark.parametrize(
    ("profile", "arguments", "markexpr", "runs"),
    [
        (None, ["tests"], "", False),
        ("ci", ["tests/test_table.py"], "not slow", False),
        ("nightly", ["tests"], "", True),
        (None, ["tests"], "nightly", True),
        (None, ["tests/test_table.py::test_it"], "", True),
    ],
)
def test_it_runs_at_night_and_where_it_is_named(
    profile: str | None, arguments: list[str], markexpr: str, runs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if profile is None:
        monkeypatch.delenv("HYPOTHESIS_PROFILE", raising=False)
    else:
        monkeypatch.setenv("HYPOTHESIS_PROFILE", profile)
    config, left = run_of(*arguments, markexpr=markexpr)
    items = table("a-b", "b-a")
    nightly.pytest_collection_modifyitems(config, items)
    assert [item.get_closest_marker("nightly") is None for item in [*items, *left]] == [True, False]
    assert len(left) == (not runs)
    assert bool(nightly.pytest_report_header(config)) is not runs
