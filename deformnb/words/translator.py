"""Translation of texts by a table of English words and those of another language.

``frontend/src/ui/words.ts`` does the same in the front ends, and a test compares the two.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

_NAME = re.compile(r"\{(\w+)\}")
_WORD = re.compile(r"[^\W\d_]{2}")  # a single letter is the name of a key or an axis
_NUMBER = r"([^\sA-Za-z\u00c0-\u024f]*\d[^\sA-Za-z\u00c0-\u024f]*(?:e[-+]?\d+)?)"
_SYMBOL = r"([^\s\d]*)"
_FILE = re.compile(r"\S+\.\w+")
_AS_GIVEN, _ANY = re.compile(r"(name|file)\d*|symbol"), re.compile(r"(text|unit)\d*")
_PARTED = re.compile(r" \u00b7 | \| |\n+")  # between facts of a line
_BREAKS = tuple(map(re.compile, ("; ", r"(?<=[.!?\u2026]) ", ": ", ", ")))  # the strongest first
_MOST_KNOWN = 4000  # cached translations of texts
_ASIDE = re.compile(r"(.+?) \((.+)\)(\.?)", re.DOTALL)


@dataclass(frozen=True)
class _Pattern:
    """A key with values: its pattern, and the translation."""

    regex: re.Pattern[str]
    names: tuple[str, ...]
    value: str
    rank: tuple[int, int]


class Translator:
    """Translates texts by a table.

    Parameters
    ----------
    table : by the English text; in both, a name in braces is a value: one letter for a number; "name" and
        "file", with digits behind where there are several, for unchanged text, "symbol" for a word of it; "text" and
        "unit" for text that is translated if the table contains it; any other for words that the table must have. A
        text may be of several sentences, clauses or facts that are keys.

    Examples
    --------
    >>> german = Translator({"{n} points": "{n} Punkte", "Undo": "R\u00fcckg\u00e4ngig",
    ...                      "move {what}": "{what} bewegen", 'rename "{name}"': '"{name}" umbenennen'})
    >>> german.translate("Undo: move 3 points")
    'R\u00fcckg\u00e4ngig: 3 Punkte bewegen'
    >>> german.translate("Undo (Ctrl+Z)"), german.translate('rename "Undo"'), german.translate("Redo")
    ('R\u00fcckg\u00e4ngig (Ctrl+Z)', '"Undo" umbenennen', 'Redo')
    """

    def __init__(self, table: Mapping[str, str]) -> None:
        self._table = dict(table)
        patterns = [_pattern(key, value) for key, value in table.items() if "{" in key]
        self._patterns = sorted(patterns, key=lambda pattern: pattern.rank)
        self._known: dict[str, str | None] = {}

    def translate(self, text: str) -> str:
        """A text in the language; itself where the table has nothing for it."""
        core = text.strip()
        if len(self._known) > _MOST_KNOWN:
            self._known.clear()
        found = self._find(core.replace("\u00a0", " "))  # ipywidgets' menus have such spaces
        return text if found is None else text.replace(core, found, 1)

    def knows(self, text: str) -> bool:
        """Check whether all words of a text are in the table.

        Examples
        --------
        >>> Translator({"Undo": "R\u00fcckg\u00e4ngig"}).knows("Undo (3)")
        True
        """
        core = text.strip().replace("\u00a0", " ")
        return not _WORD.search(core) or self._find(core) is not None

    def _find(self, core: str) -> str | None:
        if not _WORD.search(core):
            return None
        if core in self._table:
            return self._table[core]
        if core not in self._known:
            found = self._split_at(_PARTED, core)
            for way in (self._match_pattern, self._translate_pieces, self._without_period):
                found = way(core) if found is None else found
            self._known[core] = found
        return self._known[core]

    def _match_pattern(self, core: str) -> str | None:
        for pattern in self._patterns:
            match = pattern.regex.fullmatch(core)
            if match:
                values = {
                    name: self._value(name, given) for name, given in zip(pattern.names, match.groups(), strict=True)
                }
                if None not in values.values():
                    return pattern.value.format_map(values)
        return None

    def _value(self, name: str, given: str) -> str | None:
        """Text in the place of a value; None if it is of words that the table does not have."""
        if len(name) == 1 or _AS_GIVEN.fullmatch(name):
            return given
        found = self._piece(given)
        return given if found is None and _ANY.fullmatch(name) else found

    def _piece(self, given: str) -> str | None:
        """A part of a text, translated; None if it is of words that the table does not have."""
        if not _WORD.search(given) or _FILE.fullmatch(given):
            return given
        core = given.strip()
        found = self._find(core)
        return None if found is None else given.replace(core, found, 1)

    def _split_at(self, at: re.Pattern[str], core: str) -> str | None:
        """Translate what is before and after the first break between two pieces; a piece may have breaks within."""
        for found in at.finditer(core):
            first = self._piece(core[: found.start()])
            rest = None if first is None else self._piece(core[found.end() :])
            if rest is not None:
                return f"{first}{found[0]}{rest}"
        return None

    def _without_period(self, core: str) -> str | None:
        found = self._find(core[:-1]) if core.endswith(".") else None
        return None if found is None else f"{found}."

    def _translate_pieces(self, core: str) -> str | None:
        """Translate the pieces of a text; None unless the table has all that are words."""
        for at in _BREAKS:
            made = self._split_at(at, core)
            if made is not None:
                return made
        aside = _ASIDE.fullmatch(core)
        main = self._find(aside[1]) if aside else None
        return None if aside is None or main is None else f"{main} ({self.translate(aside[2])}){aside[3]}"


def _pattern(key: str, value: str) -> _Pattern:
    pieces = _NAME.split(key)
    names, plain = tuple(pieces[1::2]), pieces[::2]
    parts = [_NUMBER if len(name) == 1 else _SYMBOL if name == "symbol" else "(.*?)" for name in names]
    source = "".join(re.escape(text) + part for text, part in zip(plain, [*parts, ""], strict=True))
    rank = -len("".join(plain)), sum(len(name) > 1 for name in names)  # the most specific comes first
    return _Pattern(re.compile(source, re.DOTALL), names, value, rank)
