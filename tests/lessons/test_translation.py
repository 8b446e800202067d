"""Lessons in other languages: each Markdown cell has its translation, and the code does the same."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import deformnb as dn
import deformnb_lessons
from deformnb.errors import DeformError
from deformnb.words import LANGUAGES, translate
from deformnb_lessons import LESSONS, Numbers
from deformnb_lessons.translation import LessonWords, translate_notebook, write_translation

FOLDER = Path(deformnb_lessons.__file__).parent / "notebooks"
ALL = [(code, name) for code in LANGUAGES if code != "en" for name in LESSONS]


@pytest.fixture
def german() -> Iterator[None]:
    dn.set_language("de")
    yield
    dn.set_language(None)


def _pair(code: str, name: str) -> tuple[list[dict[str, Any]], LessonWords]:
    notebook = FOLDER / LESSONS[name].notebook
    return json.loads(notebook.read_text("utf-8"))["cells"], LessonWords.read(FOLDER / code / f"{notebook.stem}.md")


def _without_words(source: str) -> str:
    """Code without its strings, and without what notebooks alone understand."""
    tree = ast.parse(re.sub(r"^%.*$", "", source, flags=re.MULTILINE))
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.dump(tree)


@pytest.mark.parametrize(("code", "name"), ALL)
def test_every_markdown_cell_is_translated_and_no_other(code: str, name: str) -> None:
    cells, words = _pair(code, name)
    assert list(words.cells) == [cell["id"] for cell in cells if cell["cell_type"] == "markdown"]
    for cell in cells:
        if cell["cell_type"] == "markdown":
            english, own = "".join(cell["source"]), words.cells[cell["id"]]
            for mark in (r"^#+ ", r"<details><summary>", r"</details>", r"^- ", r"^\d\. ", r"\$\$"):
                count = len(re.findall(mark, english, re.MULTILINE))
                assert len(re.findall(mark, own, re.MULTILINE)) == count, (cell["id"], mark)
            assert (
                re.findall(r"`\[[-\d., ]+\]`", english)
                == re.findall(r"`\[[-\d., ]+\]`", own)[: len(re.findall(r"`\[[-\d., ]+\]`", english))]
            ), cell["id"]


@pytest.mark.parametrize(("code", "name"), ALL)
def test_translated_code_does_the_same_with_other_words(code: str, name: str) -> None:
    cells, words = _pair(code, name)
    code_cells = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    for source in code_cells:
        assert _without_words(words.translate_code(source)) == _without_words(source)
    for english in words.words:
        assert any(english in source for source in code_cells), english
    made = translate_notebook({"cells": cells}, words, code)["cells"]
    assert sum(f'\nset_language("{code}")\n' in cell["source"] for cell in made) == 1


@pytest.mark.parametrize(("code", "name"), ALL)
def test_goals_and_time_are_those_of_the_lesson(code: str, name: str) -> None:
    _cells, words = _pair(code, name)
    text = " ".join(words.cells["title"].split())
    for goal in LESSONS[name].goals:
        assert translate(goal, code) in text
    assert translate(LESSONS[name].time, code) in text
    assert translate(LESSONS[name].title, code).lower() in text.lower()


@pytest.mark.usefixtures("german")
def test_answers_and_hints_are_german_and_words_of_both_languages_are_taken() -> None:
    affine = LESSONS["affine"]
    assert repr(affine.check("distances", "starr")) == (
        "Richtig. Nur starre Abbildungen: Drehungen und Parallelverschiebungen."
    )
    assert affine.check("distances", "rigid").right
    assert not affine.check("distances", ["starr", "Scherung"]).right
    assert LESSONS["folding"].check("sign", "faltet sich").right
    assert "Du bist dran." in affine.check("turn", None)._repr_html_()
    assert "Noch nicht." in affine.check("turn", [0, 0])._repr_html_()
    answer = repr(affine.check("distances", 3))
    assert "Gib ein Wort in Anführungszeichen, von starr, ähnlich, affin, Scherung" in answer
    for lesson in LESSONS.values():
        for exercise in lesson.exercises.values():
            if isinstance(exercise, Numbers):
                for text in (exercise.praise, exercise.hint, *(hint for _, hint in exercise.mistakes)):
                    assert translate(text) != text


def test_a_translation_is_written_and_a_lesson_without_one_is_refused(tmp_path: Path) -> None:
    notebook = FOLDER / LESSONS["affine"].notebook
    write_translation(notebook, tmp_path / "a.ipynb", "de")
    made = json.loads((tmp_path / "a.ipynb").read_text("utf-8"))
    assert made["cells"][0]["source"].startswith("# Lektion 3")
    with pytest.raises(DeformError, match="has no translation fr/3_rigid_similar_affine"):
        write_translation(notebook, tmp_path / "b.ipynb", "fr")
