"""The cases of a table that are run at each change: those with each value of each argument, or every n-th."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import nightly
import pytest


def table(*cases: str, n: int | None = None, name: str = "tests/test_table.py::test_it") -> list[Any]:
    """The items of a table of cases, which take down the marks that they get."""
    marks = {} if n is None else {"sampled": pytest.mark.sampled(n)}
    items: list[Any] = [
        SimpleNamespace(nodeid=f"{name}[{case}]", get_closest_marker=marks.get, left=[]) for case in cases
    ]
    for item in items:
        item.add_marker = item.left.append
    return items


def select_cases(*cases: str, n: int | None = None) -> list[str]:
    """The cases of a table, by the ends of their names, that are not left to the night."""
    items = table(*cases, n=n)
    nightly.pytest_collection_modifyitems(items)
    assert all([mark.name for mark in item.left] in ([], ["nightly"]) for item in items)
    return [case for item, case in zip(items, cases, strict=True) if not item.left]


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
    items += [SimpleNamespace(nodeid="third", get_closest_marker={}.get, left=[])]
    nightly.pytest_collection_modifyitems(items)
    assert not any(item.left for item in items)


@pytest.mark.parametrize(
    ("profile", "arguments", "runs"),
    [
        (None, ["tests"], False),
        ("ci", ["tests/test_table.py"], False),
        ("nightly", ["tests"], True),
        (None, ["tests/test_table.py::test_it"], True),
    ],
)
def test_it_runs_at_night_and_where_it_is_named(
    profile: str | None, arguments: list[str], runs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if profile is None:
        monkeypatch.delenv("HYPOTHESIS_PROFILE", raising=False)
    else:
        monkeypatch.setenv("HYPOTHESIS_PROFILE", profile)
    config = SimpleNamespace(args=arguments)
    item: Any = SimpleNamespace(get_closest_marker={"nightly": pytest.mark.nightly}.get, config=config)
    if runs:
        nightly.pytest_runtest_setup(item)
    else:
        with pytest.raises(pytest.skip.Exception):
            nightly.pytest_runtest_setup(item)
