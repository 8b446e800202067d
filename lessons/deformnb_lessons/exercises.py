"""Exercises as data: the right answer, the tolerance, and the hint for each usual mistake.

An exercise never passes on an empty answer, on nothing, or on an answer of another kind.
"""

from __future__ import annotations

import html
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from deformnb.checks import real_array, short_value
from deformnb.words import translate

_IN_BRACKETS = re.compile(r"([\[(][^\])]*[\])])")
_POINT = re.compile(r"(?<=\d)\.(?=\d)")
_COLOURS = {True: "#1a7f37", False: "#9a6700"}  # contrast over 4.5 on white; the words state it too
_OPEN_COLOUR = "#0969da"


def localized(text: str) -> str:
    """A text in the language that was chosen, with its decimal sign outside of brackets, which may hold code.

    Examples
    --------
    >>> localized("2.5 is not [2.5]")
    '2.5 is not [2.5]'
    """
    sign = translate("decimal sign: .")[-1]
    parts = _IN_BRACKETS.split(translate(text))
    return "".join(part if k % 2 else _POINT.sub(sign, part) for k, part in enumerate(parts))


@dataclass(frozen=True)
class Result:
    """Verdict on an answer, with its reason; a notebook shows it in the language that was chosen.

    Parameters
    ----------
    right : whether it is.
    text : the reason, or a hint.
    drawing : an SVG to be shown below, or nothing.
    is_open : whether nothing has been answered yet, so that there is nothing to judge.

    Examples
    --------
    >>> Result(False, "Look at the sign.")
    Not yet. Look at the sign.
    >>> Result(False, "Give a number.", is_open=True)
    Your turn. Give a number.
    >>> bool(Result(True, "5 is the number of columns."))
    True
    """

    right: bool
    text: str
    drawing: str = field(default="", repr=False)
    is_open: bool = False

    def __bool__(self) -> bool:
        return self.right

    def __repr__(self) -> str:
        return f"{self._word} {localized(self.text)}"

    @property
    def _word(self) -> str:
        return translate("Right." if self.right else "Your turn." if self.is_open else "Not yet.")

    def _repr_html_(self) -> str:
        """HTML for a notebook: the words, and the drawing below them."""
        return self.words_html() + self.drawing

    def words_html(self) -> str:
        """The words without the drawing."""
        colour = _OPEN_COLOUR if self.is_open else _COLOURS[self.right]
        return (
            f'<div role="status" style="border-left: 4px solid {colour}; padding: 6px 12px; max-width: 46em; '
            f'line-height: 1.4"><b style="color: {colour}; background: #fff; padding: 0 4px">{self._word}</b> '
            f"{html.escape(localized(self.text))}</div>"
        )


@dataclass(frozen=True)
class AbstractExercise(ABC):
    """A question with a way to judge its answer.

    Parameters
    ----------
    question : in one or two sentences.
    praise : text for a right answer, with the reason why it is right.
    """

    question: str
    praise: str

    @abstractmethod
    def judge(self, answer: object) -> Result:
        """Judge an answer: right or not yet, with a hint that depends on the mistake."""

    def _no(self, hint: str) -> Result:
        return Result(False, hint)

    def _open(self, hint: str) -> Result:
        return Result(False, hint, is_open=True)

    def _yes(self) -> Result:
        return Result(True, self.praise)


@dataclass(frozen=True)
class Numbers(AbstractExercise):
    """A question whose answer is a number, or a list of numbers in an order.

    Parameters
    ----------
    question, praise : see :class:`AbstractExercise`.
    answer : a number, or a tuple of numbers.
    tolerance : how far each number may be off.
    hint : text for any other wrong answer.
    mistakes : wrong answers and the text for each, within the same tolerance.
    at_most : whether every positive number up to the answer is right too.
    labels : of the numbers, where each has its own box.

    Examples
    --------
    >>> sum_of_two = Numbers("2 + 3 = ?", "Yes.", 5, 0.01, "Count again.", ((6, "That is the product."),))
    >>> sum_of_two.judge(6)
    Not yet. That is the product.
    >>> sum_of_two.judge(None)
    Your turn. There is no answer yet: give a number.
    """

    answer: float | tuple[float, ...]
    tolerance: float
    hint: str
    mistakes: tuple[tuple[float | tuple[float, ...], str], ...] = ()
    at_most: bool = False
    labels: tuple[str, ...] = ("answer",)

    def judge(self, answer: object) -> Result:
        wanted = np.asarray(self.answer, dtype=np.float64)
        form = "a number" if wanted.ndim == 0 else f"{wanted.size} numbers in square brackets, with commas between"
        if answer is None or (isinstance(answer, str | list | tuple | dict | set) and not answer):
            return self._open(f"There is no answer yet: give {form}.")
        if isinstance(answer, str):
            return self._no(f"Give {form}, without quotation marks.")
        numbers = real_array(answer)
        if numbers is None or np.asarray(answer).dtype.kind == "b":
            return self._no(f"Give {form}; {short_value(answer)} is something else.")
        if numbers.shape != wanted.shape:
            return self._no(f"Give {form}, instead of {short_value(answer)}.")
        if not np.isfinite(numbers).all():
            return self._no(f"Give {form}; a number is missing in {short_value(answer)}.")
        if self._is_close(numbers, wanted) or (self.at_most and (numbers > 0).all() and (numbers <= wanted).all()):
            return self._yes()
        return self._no(next((hint for wrong, hint in self.mistakes if self._is_close(numbers, wrong)), self.hint))

    def _is_close(self, numbers: np.ndarray, wanted: object) -> bool:
        other = np.asarray(wanted, dtype=np.float64)
        return other.shape == numbers.shape and bool((np.abs(numbers - other) <= self.tolerance + 1e-12).all())


@dataclass(frozen=True)
class Choice(AbstractExercise):
    """A question whose answer is one or several of some words.

    Parameters
    ----------
    question, praise : see :class:`AbstractExercise`.
    among : all words; an answer may have them in the language that was chosen, too.
    right : those that belong to the answer, all of them.
    mistakes : the text for each of the others.

    Examples
    --------
    >>> even = Choice("Which are even?", "Yes.", ("two", "three", "four"), ("two", "four"), {"three": "3 = 2 + 1."})
    >>> even.judge(["two", "three"])
    Not yet. 3 = 2 + 1.
    >>> even.judge("two")
    Not yet. What you chose belongs to the answer, and 1 more does.
    """

    among: tuple[str, ...]
    right: tuple[str, ...]
    mistakes: Mapping[str, str]

    def judge(self, answer: object) -> Result:
        form = "one word in quotation marks" if len(self.right) == 1 else "words in quotation marks, in square brackets"
        form = f"{form}, of {', '.join(map(translate, self.among))}"
        given = [answer] if isinstance(answer, str) else [] if answer is None else answer
        if not isinstance(given, list | tuple | set | frozenset):
            return self._no(f"Give {form}.")
        known = {**{translate(word).lower(): word for word in self.among}, **{word: word for word in self.among}}
        words = [known.get(word.strip().lower()) if isinstance(word, str) else None for word in given]
        if not words or [word.strip() if isinstance(word, str) else word for word in given] == [""]:
            return self._open(f"There is no answer yet: give {form}.")
        if None in words:
            return self._no(f"Give {form}; {short_value(answer)} has something else.")
        wrong = next((word for word in self.among if word in words and word not in self.right), None)
        if wrong is not None:
            return self._no(self.mistakes[wrong])
        missing = len(set(self.right) - set(words))
        if missing:
            belong = "does" if missing == 1 else "do"
            return self._no(f"What you chose belongs to the answer, and {missing} more {belong}.")
        return self._yes()
