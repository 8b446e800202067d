"""Tests of the front end's modules that need no page, ``frontend/tests/*.test.js``, as items of pytest."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import node_tasks


class NodeTests(pytest.Item):
    """The tests in a file of JavaScript, which node runs with the modules that it imports in one bundle."""

    def runtest(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            node_tasks.bundle_modules([self.path], Path(folder))
            bundled = Path(folder) / f"{self.path.stem}.mjs"
            command = [node_tasks.find_node()[0], "--test", "--test-reporter=spec", str(bundled)]
            done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=300, check=False)
        if done.returncode != 0:
            raise NodeTestError(done.stdout + done.stderr)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        return str(excinfo.value) if isinstance(excinfo.value, NodeTestError) else super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, self.name


class NodeTestError(Exception):
    """The output of node where a test has failed."""


class NodeFile(pytest.File):
    """A file of tests in JavaScript."""

    def collect(self) -> Iterator[NodeTests]:
        yield NodeTests.from_parent(self, name="node")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> NodeFile | None:
    return NodeFile.from_parent(parent, path=file_path) if file_path.name.endswith(".test.js") else None
