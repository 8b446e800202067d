"""A plugin for pytest-xdist: not all processes drive browsers at a time, so that one computes while others wait.

A test in a browser waits for much of its time, and browsers that are many wait for one another. With files handed out
in their order all processes did the one first and then the other, and of two processors 1.25 were busy.
"""

from __future__ import annotations

import os
from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling

BROWSER = "tests/browser/"
# Files with pages of JupyterLab, by the ends of their names: one process starts it for all of them.
OF_LAB = ("_lab.py", "/test_hosts.py", "/test_studio_layout.py", "/test_volume_view_hand.py")
# Each of its tests runs a notebook in a separate kernel, for minutes: they are assigned one by one and first.
ONE_BY_ONE = "tests/test_notebooks.py"


class BrowsersApart(LoadFileScheduling):
    """Assigns files in their order, but those of browsers to ``limit`` processes at a time, those of Lab to one.

    Parameters
    ----------
    config, log : arguments of the scheduler of pytest-xdist.
    limit : how many processes may drive browsers while there is other work.
    """

    def __init__(self, config: pytest.Config, log: Any = None, *, limit: int) -> None:
        super().__init__(config, log)
        self.limit = limit

    def _assign_work_unit(self, node: Any) -> None:
        files = self.workqueue
        others = sum(
            any(file.startswith(BROWSER) and not all(tests.values()) for file, tests in work.items())
            for owner, work in self.assigned_work.items()
            if owner is not node
        )
        wants_browser = others < self.limit
        fitting = [file for file in files if file.startswith(BROWSER) == wants_browser]
        if fitting:
            files.move_to_end(min(fitting, key=lambda file: not file.startswith(ONE_BY_ONE)), last=False)
        super()._assign_work_unit(node)

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.startswith(ONE_BY_ONE):
            return nodeid
        file = super()._split_scope(nodeid)
        return f"{BROWSER}lab" if file.startswith(BROWSER) and file.endswith(OF_LAB) else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    if config.getoption("dist") != "loadfile":
        return None
    processes = len(config.getoption("tx"))
    return BrowsersApart(config, log, limit=max(1, min(os.cpu_count() or 1, processes - 1)))
