"""One word for one thing: every visible text and its German agree with the glossary."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

import pytest
from words.sources import LESSONS, PACKAGE, own_table

from deformnb.words.glossary import Term, glossary
from deformnb_lessons.lesson import LESSONS as ALL_LESSONS
from deformnb_lessons.translation import LessonWords

NEVER = {
    r"Karopapier": "kariertes Papier",
    r"Wertung": "Punktestand",
    r"[Ww]ie viele Male": "Wievielmal",
    r"\bPanel\b|Paneel": "Leiste",
    r"\bKeyframe": "Schlüsselbild",
    r"\bRückweg": "Rückwärtsverschiebung, Rückwärtsabbildung",
}
"""German words that are written nowhere, and what is written instead."""

OTHER_SENSE = {"translation": "in English"}
"""Texts in which an English word has another sense, by term."""

_CODE = re.compile(r"```.*?```|`[^`\n]*`|\$\$.*?\$\$|\$[^$\n]+\$", re.DOTALL)


def _pairs() -> Iterator[tuple[str, str, str]]:
    """Place, English text and German text of all that is translated."""
    for package in (PACKAGE, LESSONS):
        for english, german in own_table(package, "de").items():
            yield package.name, re.sub(r"\{\w+\}", "{}", english), german
    folder = LESSONS / "notebooks"
    for lesson in ALL_LESSONS.values():
        cells = json.loads((folder / lesson.notebook).read_text("utf-8"))["cells"]
        words = LessonWords.read(folder / "de" / lesson.notebook.replace(".ipynb", ".md"))
        for cell in cells:
            if cell["cell_type"] == "markdown":
                english = "".join(cell["source"])
                yield f"{lesson.notebook} {cell['id']}", _CODE.sub("", english), _CODE.sub("", words.cells[cell["id"]])
        for english, german in words.words.items():
            yield lesson.notebook, english, german


PAIRS = list(_pairs())


@pytest.mark.parametrize("term", glossary(), ids=lambda term: term.english)
def test_german_texts_have_the_word_of_the_glossary_wherever_the_english_term_occurs(term: Term) -> None:
    other = re.compile(OTHER_SENSE.get(term.english, r"(?!)"))
    faults = [
        f"{place}: {fault}: {english[:160]!r} => {german[:160]!r}"
        for place, english, german in PAIRS
        if not other.search(english) and (fault := term.fault(english, german))
    ]
    assert faults == []


def test_forbidden_german_words_occur_nowhere() -> None:
    for pattern, instead in NEVER.items():
        assert [(place, german) for place, _, german in PAIRS if re.search(pattern, german)] == [], instead


def test_a_map_folds_itself_in_german() -> None:
    """ "Die Abbildung faltet sich": the verb is reflexive, in each clause."""
    bare = [
        (place, clause)
        for place, _, german in PAIRS
        for clause in re.split(r"[.:;,?!\n]", german)
        if re.search(r"\b(faltet|falten)\b", clause) and not re.search(r"\bsich\b", clause)
    ]
    assert bare == []


def test_numbers_in_german_prose_have_decimal_commas() -> None:
    points = [
        (place, german)
        for place, english, german in PAIRS
        if re.search(r"(?<![\w.])\d+\.\d+(?![\w.])", re.sub(r"`[^`]*`|Analyze 7\.5", "", german))
    ]
    assert points == []


def test_terms_are_unique_and_in_the_order_of_the_alphabet() -> None:
    names = [term.english for term in glossary()]
    assert names == sorted(names)
    assert len(set(names)) == len(names) > 30
    for term in glossary():
        assert re.search(rf"^(?:{term.finds})$", term.english, re.IGNORECASE) or term.english in term.finds
        assert re.search(term.written, term.german), term.german
        assert term.meaning.endswith((".", ".)")), term.english
        assert term.bedeutung.endswith((".", ".)")), term.english
