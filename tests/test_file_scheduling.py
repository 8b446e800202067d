"""Distribution of files of tests over processes: the scheduler with simulated processes."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
from file_scheduling import BrowsersApart, pytest_xdist_make_scheduler

BROWSERS = [f"tests/browser/test_{name}.py::test_{k}" for name in "abcde" for k in range(4)]
OTHERS = [f"tests/test_{name}.py::test_{k}" for name in "fghij" for k in range(4)]


class Process:
    """A simulated process; ``files`` are those assigned to it, in order."""

    def __init__(self, name: str, tests: Sequence[str]) -> None:
        self.gateway, self.shutting_down, self.tests = SimpleNamespace(id=name), False, tests
        self.waiting: list[int] = []

    def send_runtest_some(self, indices: list[int]) -> None:
        self.waiting += indices

    def shutdown(self) -> None:
        self.shutting_down = True

    @property
    def file(self) -> str:
        """Of the test that it runs now."""
        return self.tests[self.waiting[0]].partition("::")[0] if self.waiting else ""


def config(processes: int, dist: str = "loadfile") -> Any:
    options = {"tx": ["popen"] * processes, "dist": dist, "loadscopereorder": False}
    return SimpleNamespace(getvalue=options.get, getoption=options.get, option=SimpleNamespace(**options))


def run(limit: int, processes: int, tests: Sequence[str]) -> list[set[str]]:
    """Files that run at the same time, moment after moment; each test runs once, and each file in one process."""
    scheduler, nodes = scheduled(tests, limit, processes)
    moments, done = [], []
    while any(node.waiting for node in nodes):
        moments.append({node.file for node in nodes if node.waiting})
        assert len(moments[-1]) == sum(bool(node.waiting) for node in nodes), "a file is in two processes"
        for node in nodes:
            if node.waiting:
                done.append(node.waiting.pop(0))
                scheduler.mark_test_complete(node, done[-1])
    assert sorted(done) == list(range(len(tests)))
    return moments


def scheduled(tests: Sequence[str], limit: int, processes: int) -> tuple[BrowsersApart, list[Process]]:
    """A scheduler, and processes that have been handed their first tests."""
    scheduler = BrowsersApart(config(processes), limit=limit)
    nodes = [Process(f"gw{k}", tests) for k in range(processes)]
    for node in nodes:
        scheduler.add_node(node)
        scheduler.add_node_collection(node, tests)
    scheduler.schedule()
    return scheduler, nodes


@pytest.mark.parametrize(("limit", "processes"), [(1, 2), (2, 3), (1, 3)])
def test_one_process_computes_while_others_wait_for_browsers(limit: int, processes: int) -> None:
    moments = run(limit, processes, BROWSERS + OTHERS)
    left = {test.partition("::")[0] for test in OTHERS}
    for files in moments:
        left -= files
        if len(left) > processes:  # the next file of each process is chosen before its last tests are done
            assert sum(file.startswith("tests/browser/") for file in files) == limit
    assert moments[0] == {
        *(f"tests/browser/test_{name}.py" for name in "abc"[:limit]),
        *(f"tests/test_{name}.py" for name in "fgh"[: processes - limit]),
    }


@pytest.mark.parametrize("tests", [BROWSERS, OTHERS, BROWSERS[:4] + OTHERS])
def test_none_is_idle_where_all_are_of_one_kind(tests: list[str]) -> None:
    assert len(run(1, 2, tests)[0]) == 2


def test_one_process_has_all_pages_of_lab() -> None:
    files = ("player_lab", "studio_lab", "hosts")
    lab = [f"tests/browser/test_{name}.py::test_{k}" for name in files for k in range(2)]
    _, nodes = scheduled([*lab, *BROWSERS, *OTHERS], limit=2, processes=3)
    handed = [{node.tests[k] for k in node.waiting} & set(lab) for node in nodes]
    assert sorted(map(len, handed)) == [0, 0, len(lab)]


def test_notebooks_are_shared_out_one_by_one_and_first() -> None:
    notebooks = [f"tests/test_notebooks.py::test_it_runs[{k}]" for k in range(4)]
    _, nodes = scheduled([*BROWSERS, *OTHERS, *notebooks], limit=1, processes=2)
    assert [nodes[0].tests[k] for k in nodes[0].waiting] == BROWSERS[:4]
    assert [nodes[1].tests[k] for k in nodes[1].waiting] == notebooks[:2]  # and the others wait for whoever is free


def test_another_way_to_share_out_is_left_alone() -> None:
    assert pytest_xdist_make_scheduler(config(3, "load"), None) is None
    assert pytest_xdist_make_scheduler(config(2), None).limit == 1
