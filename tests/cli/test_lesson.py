"""The command "deformnb lesson" where the lessons are not installed; tests/lessons has those of the lessons."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from command_line import error_sentence, run


@pytest.mark.parametrize("arguments", ["", "coordinates", "coordinates mine --copy", "--page kernels", "--help"])
def test_it_reports_in_a_sentence_how_to_get_the_lessons(
    arguments: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "deformnb_lessons", None)
    code = run(tmp_path, f"lesson {arguments}", monkeypatch)
    assert error_sentence(capsys.readouterr(), code).endswith("in a clone of deformnb: pip install ./lessons")
    assert list(tmp_path.iterdir()) == []


def test_the_other_commands_need_no_lessons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "deformnb_lessons", None)
    assert run(tmp_path, "datasets", monkeypatch) == 0
    assert "carp" in capsys.readouterr().out
    assert run(tmp_path, "--help", monkeypatch) == 0
    assert "needs deformnb-lessons" in " ".join(capsys.readouterr().out.split())
