"""Boxes in which a pupil answers a question, without code."""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any

import ipywidgets as ipw

from deformnb.errors import DeformError
from deformnb.widgets.cell_widgets import runs_for_later_readers
from deformnb.words import translate
from deformnb_lessons.exercises import AbstractExercise, Choice, Numbers, Result

_SMALL = "150px"


class Question(ipw.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """An answer in boxes, and a button that judges it; the language is the one that was chosen.

    Parameters
    ----------
    exercise : one whose answer is numbers or words.

    Attributes
    ----------
    boxes : for each number its text, for each word its check box.
    button : judges what is in them.
    result : of the last judgement; None before.

    Raises
    ------
    DeformError
        If the exercise is done in the studio.

    Examples
    --------
    >>> question = Question(Numbers("2 + 3 = ?", "Yes.", 5, 0.01, "Count again."))
    >>> question.boxes[0].value = "5,0"
    >>> question.button.click()
    >>> question.result
    Right. Yes.
    """

    result: Result | None

    def __init__(self, exercise: AbstractExercise) -> None:
        if isinstance(exercise, Numbers):
            boxes = [_number_box(label) for label in exercise.labels]
        elif isinstance(exercise, Choice):
            boxes = [_word_box(word) for word in exercise.among]
        else:
            raise DeformError("this exercise is done in the studio; lesson.follow(name, studio) judges it.")
        self.exercise, self.boxes, self.result = exercise, boxes, None
        self.button = ipw.Button(description=translate("Check"), layout={"width": "auto"})
        self.button.on_click(lambda _button: self._judge())
        self._verdict = ipw.HTML()
        super().__init__([ipw.HBox([*boxes, self.button], layout={"flex_flow": "row wrap"}), self._verdict])
        self.add_class("dnb-question")

    def _judge(self) -> None:
        assert isinstance(self.exercise, Numbers | Choice)
        read: Callable[[Any, Any], Any] = _read_numbers if isinstance(self.exercise, Numbers) else _read_words
        answer = read(self.exercise, self.boxes)
        self.result = answer if isinstance(answer, Result) else self.exercise.judge(answer)
        self._verdict.value = self.result.words_html()

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = super()._repr_mimebundle_(**options)
        data = bundle[0] if isinstance(bundle, tuple) else bundle
        if data is not None:  # where a page shows no widgets
            if runs_for_later_readers():
                data.pop("application/vnd.jupyter.widget-view+json", None)
            data["text/html"] = f"<p><em>{html.escape(translate('Your answer goes here in the notebook.'))}</em></p>"
        return bundle


def _number_box(label: str) -> ipw.Text:
    layout = {"width": _SMALL}
    return ipw.Text(description=translate(label), placeholder="?", layout=layout, style={"description_width": "auto"})


def _word_box(word: str) -> ipw.Checkbox:
    return ipw.Checkbox(description=translate(word), indent=False, layout={"width": "auto", "margin": "0 12px 0 0"})


def _read_numbers(exercise: Numbers, boxes: list[ipw.Text]) -> float | list[float] | Result:
    texts = [box.value.strip() for box in boxes]
    if not all(texts):
        return Result(False, "There is no answer yet: write a number in each box.", is_open=True)
    numbers = []
    for text in texts:
        try:
            numbers.append(_number(text))
        except (ValueError, ZeroDivisionError):
            return Result(False, f"{text} is no number. Write one such as -0.5 or 3/4.")
    return numbers if isinstance(exercise.answer, tuple) else numbers[0]


def _number(text: str) -> float:
    """A number as people write it: with a decimal comma, a printed minus sign, or as a fraction."""
    top, *bottom = text.replace("\u2212", "-").replace(",", ".").replace(" ", "").split("/", 1)
    return float(top) / float(bottom[0]) if bottom else float(top)


def _read_words(exercise: Choice, boxes: list[ipw.Checkbox]) -> list[str] | Result:
    chosen = [word for word, box in zip(exercise.among, boxes, strict=True) if box.value]
    return chosen or Result(False, "There is no answer yet: choose one or more.", is_open=True)
