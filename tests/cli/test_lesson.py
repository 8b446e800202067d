"""The command "deformnb lesson": it lists the lessons, and copies and opens one without overwriting anything."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from command_line import refused, run

from deformnb.cli import lab
from deformnb.cli.lesson import lesson_notebook
from deformnb.lessons import LESSONS


def test_without_a_name_the_lessons_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "lesson", monkeypatch) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == list(LESSONS)
    assert re.search(r"Coordinates and grids, 30 to 40 minutes", lines[0])
    assert list(tmp_path.iterdir()) == []


def test_a_lesson_is_copied_once_and_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[tuple[Path, ...]] = []
    monkeypatch.setattr(lab, "open_lab", lambda *given: opened.append(given))
    monkeypatch.setattr("deformnb.cli.lesson.check_lab", lambda: None)
    for word in ("new", "kept as it is"):
        assert run(tmp_path, "lesson kernels mine --no-browser", monkeypatch) == 0
        assert capsys.readouterr().out.startswith(word)
    copy = Path("mine") / LESSONS["kernels"].notebook
    assert opened == [(copy, "--no-browser")] * 2
    assert (tmp_path / copy).read_bytes() == lesson_notebook("kernels").read_bytes()
    assert [path.name for path in (tmp_path / "mine").iterdir()] == [copy.name]


def test_an_unknown_lesson_names_the_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(tmp_path, "lesson kernel", monkeypatch)
    assert "choose one of coordinates, kernels, affine, folding" in refused(capsys.readouterr(), code)
    assert list(tmp_path.iterdir()) == []
