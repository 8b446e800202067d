"""Answers in boxes: they are judged as those in code are, in both languages, and say what is missing."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import deformnb as dn
from deformnb.errors import DeformError
from deformnb_lessons import LESSONS, Choice, FishTask, Numbers, Question, StudioTask

CODELESS = ("coordinates", "fish")


@pytest.fixture
def german() -> Iterator[None]:
    dn.set_language("de")
    yield
    dn.set_language(None)


def _answer(question: Question, *values: object) -> str:
    for box, value in zip(question.boxes, values, strict=True):
        box.value = value
    question.button.click()
    assert question.result is not None
    return repr(question.result)


def _verdict(question: Question) -> str:
    return str(question.children[-1].value)


@pytest.mark.parametrize("lesson", CODELESS)
def test_every_answer_of_numbers_or_words_has_its_box_and_the_right_one_is_right(lesson: str) -> None:
    for name, exercise in LESSONS[lesson].exercises.items():
        if isinstance(exercise, Numbers):
            right = exercise.answer if isinstance(exercise.answer, tuple) else (exercise.answer,)
            assert _answer(LESSONS[lesson].ask(name), *map(str, right)).startswith("Right."), name
        elif isinstance(exercise, Choice):
            marks = [word in exercise.right for word in exercise.among]
            assert _answer(LESSONS[lesson].ask(name), *marks).startswith("Right."), name


def test_numbers_are_read_as_people_write_them() -> None:
    for text in ("-0.345", "\u22120,345", " -93/261,5 ", "- 0.345"):
        assert "Right." in _answer(LESSONS["coordinates"].ask("shear"), text), text


def test_what_is_missing_or_no_number_is_named() -> None:
    ask = LESSONS["coordinates"].ask
    assert "write a number in each box" in _answer(ask("place"), "150", "")
    assert "sixty is no number" in _answer(ask("place"), "150", "sixty")
    assert "1/0 is no number" in _answer(ask("cells"), "1/0")
    assert "choose one or more" in _answer(ask("pairs"), *[False] * 5)
    assert "b grows downwards" in _answer(ask("place"), "150", "100")
    assert "Look at the table" in _answer(ask("pairs"), True, False, True, False, False)


@pytest.mark.usefixtures("german")
def test_boxes_hints_and_button_are_german() -> None:
    question = LESSONS["coordinates"].ask("eye")
    assert [box.description for box in question.boxes] == ["Zeile", "Spalte"]
    assert question.button.description == "Prüfen"
    _answer(question, "2", "x<y")
    assert "x&lt;y ist keine Zahl" in _verdict(question)
    assert [box.description for box in LESSONS["fish"].ask("grown").boxes] == ["Kopf", "Mitte", "Schwanz"]


def test_a_page_without_widgets_says_where_the_answer_goes() -> None:
    bundle = LESSONS["fish"].ask("grown")._repr_mimebundle_()
    assert "Your answer goes here" in bundle["text/html"]


def test_an_exercise_in_the_studio_has_no_boxes() -> None:
    for lesson in LESSONS.values():
        for name, exercise in lesson.exercises.items():
            if isinstance(exercise, StudioTask | FishTask):
                with pytest.raises(DeformError, match=r"lesson\.follow"):
                    lesson.ask(name)
