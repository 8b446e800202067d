"""The examples of docs/pipelines.md, run unchanged."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "pipelines.md"
SECTIONS = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)


def _code(section: str) -> str:
    return "\n".join(re.findall(r"```python\n(.*?)```", section, re.DOTALL))


@pytest.fixture(scope="module")
def shared() -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(_code(SECTIONS[0]), str(PAGE), "exec"), names)
    return names


@pytest.mark.parametrize("section", SECTIONS[1:], ids=lambda text: str(text).partition("\n")[0])
def test_the_example_of_each_package_runs(section: str, shared: dict[str, Any]) -> None:
    code = _code(section)
    assert code.count("assert") >= 1
    assert len([line for line in code.splitlines() if line.strip()]) <= 13
    exec(compile(code, str(PAGE), "exec"), dict(shared))
