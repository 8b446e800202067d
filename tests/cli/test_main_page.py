"""The command "deformnb page": it writes the page that opens files, and overwrites nothing unasked."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import error_sentence, run


def test_the_page_is_written_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "page", monkeypatch) == 0
    assert capsys.readouterr().out == "deformnb.html\n"
    page = (tmp_path / "deformnb.html").read_text(encoding="utf-8")
    assert "<title>deformnb</title>" in page
    assert "Content-Security-Policy" in page
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "")
    code = run(tmp_path, "page", monkeypatch)
    assert "--force" in error_sentence(capsys.readouterr(), code)
    assert (tmp_path / "deformnb.html").read_text(encoding="utf-8") == page
    assert run(tmp_path, "page --force", monkeypatch) == 0


def test_a_page_is_html(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code = run(tmp_path, "page fish.json", monkeypatch)
    assert "name it fish.html" in error_sentence(capsys.readouterr(), code)
    assert list(tmp_path.iterdir()) == []


def test_the_page_about_thompson_is_written_under_its_name_or_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, "page thompson", monkeypatch) == 0
    assert capsys.readouterr().out == "thompson.html\n"
    page = (tmp_path / "thompson.html").read_text(encoding="utf-8")
    assert "<title>How one fish becomes another</title>" in page
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "")
    assert run(tmp_path, "page thompson fish.html --language de", monkeypatch) == 0
    page = (tmp_path / "fish.html").read_text(encoding="utf-8")
    assert "<title>Wie aus einem Fisch ein anderer wird</title>" in page
    assert capsys.readouterr().out == "fish.html\n"
    code = run(tmp_path, "page thompson", monkeypatch)
    assert "--force" in error_sentence(capsys.readouterr(), code)
    code = run(tmp_path, "page one.html two.html", monkeypatch)
    assert "2 were named: one.html, two.html" in error_sentence(capsys.readouterr(), code)
