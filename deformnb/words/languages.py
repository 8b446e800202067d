"""The languages that there are, their tables, and the one that new studios and lessons have.

It is English unless it is chosen, by :func:`set_language` or the environment variable ``DEFORMNB_LANGUAGE``. The locale
of the process is no choice of the reader: a kernel on a server has the server's, and a notebook that is sent to
somebody else would show other words than those its text speaks of.
"""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

from deformnb.errors import DeformError, translate_messages
from deformnb.words.translator import Translator

VARIABLE = "DEFORMNB_LANGUAGE"
"""The environment variable with the language."""

_FOLDER = Path(__file__).parent
_FIRST = "en"

_added: list[Path] = []  # folders of other packages
_chosen = ""


@cache
def word_table(code: str) -> dict[str, str]:
    """The words of a language by the English ones, those of :func:`add_tables` included; empty for English.

    Parameters
    ----------
    code : of :data:`LANGUAGES`.

    Examples
    --------
    >>> word_table("de")["Undo"]
    'R\u00fcckg\u00e4ngig'
    """
    if code == _FIRST:
        return {}
    files = [folder / f"{code}.json" for folder in (*_added, _FOLDER)]  # of a key of two, the value here counts
    tables = [json.loads(file.read_text(encoding="utf-8")) for file in files if file.is_file()]
    return {key: value for table in tables for key, value in table.items()}


LANGUAGES: dict[str, str] = {
    _FIRST: "English",
    **{path.stem: word_table(path.stem)["English"] for path in sorted(_FOLDER.glob("*.json"))},
}
"""Languages by their codes, each named in its own words."""


def add_tables(folder: Path) -> None:
    """Add the words of another package; an existing key has priority.

    Parameters
    ----------
    folder : of the package, with a table ``CODE.json`` for each of :data:`LANGUAGES` that it has words in.

    Examples
    --------
    >>> add_tables(Path("folder of a package") / "words")
    >>> translate("Undo", "de")
    'R\u00fcckg\u00e4ngig'
    """
    if folder not in _added:
        _added.append(folder)
        word_table.cache_clear()
        _translator.cache_clear()


def set_language(code: str | None) -> None:
    """Set the language of studios, widgets, pages and answers of lessons that are made from now on.

    Parameters
    ----------
    code : of :data:`LANGUAGES`: "en" or "de"; None for the one of ``DEFORMNB_LANGUAGE``, or else English.

    Raises
    ------
    DeformError
        If there is no such language.

    Examples
    --------
    >>> set_language("de")
    >>> translate("Undo")
    'R\u00fcckg\u00e4ngig'
    >>> set_language(None)
    """
    global _chosen  # noqa: PLW0603  # a choice of the process, as is its locale
    _chosen = "" if code is None else checked_language(code)


def language(code: str | None = None) -> str:
    """The code of the language that was chosen, or this one if it is given.

    Raises
    ------
    DeformError
        If there is no such language, also in ``DEFORMNB_LANGUAGE``.

    Examples
    --------
    >>> language("de")
    'de'
    """
    if code is not None:
        return checked_language(code)
    return _chosen or checked_language(os.environ.get(VARIABLE) or _FIRST)


def checked_language(code: object) -> str:
    """The code of a language that there is.

    Raises
    ------
    DeformError
        If there is no such language.

    Examples
    --------
    >>> checked_language("de")
    'de'
    """
    if not isinstance(code, str) or code not in LANGUAGES:
        known = ", ".join(f"{known} ({name})" for known, name in LANGUAGES.items())
        raise DeformError(f"unknown language {code!r:.40}; choose one of {known}.")
    return code


def translate(text: str, code: str | None = None) -> str:
    """A text in a language, by default in the one that was chosen.

    Examples
    --------
    >>> translate("Undo: move 3 points", "de")
    'R\u00fcckg\u00e4ngig: 3 Punkte verschieben'
    """
    return _translator(language(code)).translate(text)


@cache
def _translator(code: str) -> Translator:
    return Translator(word_table(code))


translate_messages(translate)
