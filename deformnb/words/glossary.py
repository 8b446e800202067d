"""The terms of the field in English and German: one word for one thing, in studio, pages, lessons and documentation.

The file ``glossary.toml`` has them. :mod:`deformnb.widgets.generate` writes the page docs/glossary.md, and a test
compares every visible text and its translation with them.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FILE = Path(__file__).parent / "glossary.toml"


@dataclass(frozen=True)
class Term:
    """A term in both languages.

    Parameters
    ----------
    english, german : the words.
    finds : pattern of the English text in which the term occurs.
    written : pattern of the German text that has the word, or an inflection of it.
    meaning, bedeutung : a sentence in each language.
    avoid : pattern of German words that are never written for it; none where it is empty.

    Examples
    --------
    >>> next(term.german for term in glossary() if term.english == "support radius")
    'Einflussradius'
    """

    english: str
    german: str
    finds: str
    written: str
    meaning: str
    bedeutung: str
    avoid: str = ""

    def fault(self, english: str, german: str) -> str:
        """Fault of a German text as the translation of an English one; empty if there is none.

        Examples
        --------
        >>> node = next(term for term in glossary() if term.english == "node")
        >>> node.fault("Add a node", "Knoten einfügen"), node.fault("Add a node", "Ecke einfügen")
        ('', 'node is Knoten')
        """
        if not re.search(rf"\b(?:{self.finds})\b", english, re.IGNORECASE):
            return ""
        if not re.search(self.written, german):
            return f"{self.english} is {self.german}"
        found = re.search(self.avoid, german) if self.avoid else None
        return f"{self.english} is {self.german}, not {found[0]}" if found else ""


@cache
def glossary() -> tuple[Term, ...]:
    """All terms, in the order of the alphabet."""
    rows: list[Mapping[str, str]] = tomllib.loads(_FILE.read_text(encoding="utf-8"))["term"]
    return tuple(Term(**row) for row in rows)


def as_markdown() -> str:
    """The page of the documentation.

    Examples
    --------
    >>> as_markdown().splitlines()[0]
    '# Glossary'
    """
    lines = [
        "# Glossary",
        "",
        "One word for one thing, in English and German: in the studio, the lessons and these pages. Written by",
        "`python -m deformnb.widgets.generate` from `deformnb/words/glossary.toml`.",
        "",
        "| term | Deutsch | meaning | Bedeutung |",
        "|---|---|---|---|",
    ]
    lines += [f"| **{term.english}** | **{term.german}** | {term.meaning} | {term.bedeutung} |" for term in glossary()]
    return "\n".join([*lines, ""])
