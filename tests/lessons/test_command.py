"""The command "deformnb lesson": it lists the lessons, and copies and opens one without overwriting anything."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import pytest
from command_line import error_sentence, run

from deformnb.datasets import PHANTOMS
from deformnb_lessons import LESSONS
from deformnb_lessons.command import PAGE, lesson_notebook

ROOT = Path(__file__).resolve().parents[2]


def test_without_a_name_the_lessons_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "lesson", monkeypatch) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == [PAGE, *LESSONS]
    assert re.search(r"How one fish becomes another, 5 minutes", lines[0])
    assert re.search(r"Coordinates and grids, 30 minutes", lines[1])
    assert lines[-1] == f"open one with: deformnb lesson {PAGE}"
    assert list(tmp_path.iterdir()) == []


def test_a_lesson_is_copied_once_and_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[tuple[Path, ...]] = []
    monkeypatch.setattr("deformnb_lessons.command.open_lab", lambda *given: opened.append(given))
    monkeypatch.setattr("deformnb_lessons.command.check_lab", lambda *more: None)
    for word in ("new", "unchanged"):
        assert run(tmp_path, "lesson kernels mine --no-browser", monkeypatch) == 0
        assert capsys.readouterr().out.startswith(word)
    copy = Path("mine") / LESSONS["kernels"].notebook
    assert opened == [(copy, "--no-browser")] * 2
    assert (tmp_path / copy).read_bytes() == lesson_notebook("kernels").read_bytes()
    assert [path.name for path in (tmp_path / "mine").iterdir()] == [copy.name]


def test_the_page_about_thompson_is_a_lesson_that_opens_in_the_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert run(tmp_path, "lesson thompson mine --page", monkeypatch) == 0
    assert opened == []
    assert run(tmp_path, "lesson thompson mine --language de", monkeypatch) == 0
    assert opened == [(tmp_path / "mine" / "thompson.html").resolve().as_uri()]
    assert "Wie aus einem Fisch" in (tmp_path / "mine" / "thompson.html").read_text(encoding="utf-8")
    assert "thompson.html" in capsys.readouterr().out


def test_an_unknown_lesson_names_the_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(tmp_path, "lesson kernel", monkeypatch)
    assert "choose one of thompson, coordinates, fish, kernels, affine, folding" in error_sentence(
        capsys.readouterr(), code
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly
def test_voila_shows_a_lesson_without_its_code(tmp_path: Path) -> None:
    pytest.importorskip("voila")
    command = [sys.executable, "-m", "deformnb", "lesson", "coordinates", str(tmp_path), "--voila", "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "lessons")])}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as server:
        try:
            address = next(found[0] for line in server.stdout or () if (found := re.search(r"http://[^\s]+/", line)))
            with urlopen(address, timeout=300) as answer:  # Voila runs the lesson before it answers in full
                page = answer.read().decode()
        finally:
            server.terminate()
    assert "Lesson 1a: coordinates and grids" in page
    assert "lesson.ask(" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL), "the code is hidden"


def test_a_lesson_is_copied_and_not_opened_where_a_server_asks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("deformnb_lessons.command.open_lab", lambda *given: pytest.fail("it was opened"))
    assert run(tmp_path, "lesson affine mine --copy", monkeypatch) == 0
    assert capsys.readouterr().out.startswith("new")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == [LESSONS["affine"].notebook]


def test_the_picture_of_a_lesson_is_written_as_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    carp = PHANTOMS["fish"].make((16, 32, 16))  # of a quarter of the resolution: its still takes a tenth of the time
    monkeypatch.setattr("deformnb_lessons.pages.lesson_carp", lambda: carp)
    assert run(tmp_path, "lesson affine pages --page", monkeypatch) == 0
    assert "wrote pages/affine.html" in capsys.readouterr().out.replace(os.sep, "/")
    text = (tmp_path / "pages" / "affine.html").read_text("utf-8")
    assert "<title>Rigid, similar, affine</title>" in text
    assert "Only its points on head and tail hold this carp." in text


def test_worksheet_and_answers_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "lesson folding sheets --worksheet --language de", monkeypatch) == 0
    assert "wrote sheets/folding.pdf and sheets/answers.pdf" in capsys.readouterr().out.replace(os.sep, "/")
    assert {path.name for path in (tmp_path / "sheets").iterdir()} == {"folding.pdf", "answers.pdf"}
