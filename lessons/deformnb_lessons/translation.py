"""Notebooks of lessons in other languages: the same code, with the Markdown and the words in the code translated.

There is one notebook of each lesson, in English. ``notebooks/de/NAME.md`` has its German: of each Markdown cell
its text, under the cell's id, and at the end the words in the code::

    <!-- cell: title -->
    # Lektion 1: Koordinaten und Gitter
    <!-- words -->
    - my carp => mein Karpfen
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deformnb.errors import DeformError

_MARK = re.compile(r"^<!-- (?:cell: ([\w-]+)|(words)) -->\n", re.MULTILINE)
_PACKAGE = "from deformnb_lessons import"


@dataclass(frozen=True)
class LessonWords:
    """The translation of a lesson's notebook.

    Parameters
    ----------
    cells : Markdown by the ids of cells.
    words : strings of the code, by the English.
    """

    cells: Mapping[str, str]
    words: Mapping[str, str]

    @classmethod
    def read(cls, path: Path) -> LessonWords:
        """Read a file of the form described above.

        Raises
        ------
        DeformError
            If there is no such file.
        """
        if not path.is_file():
            raise DeformError(f"this lesson has no translation {path.parent.name}/{path.name}; open it in English.")
        _, *parts = _MARK.split(path.read_text(encoding="utf-8"))
        cells, words = dict[str, str](), dict[str, str]()
        for name, is_words, text in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
            if is_words:
                words = dict(line.removeprefix("- ").split(" => ") for line in text.strip().splitlines())
            else:
                cells[name] = text.strip()
        return cls(cells, words)

    def translate_code(self, source: str) -> str:
        """Translate the strings of code; what it does is unchanged."""
        for english, own in self.words.items():
            source = source.replace(english, own)
        return source


def translate_notebook(notebook: Mapping[str, Any], words: LessonWords, code: str) -> dict[str, Any]:
    r"""Translate a lesson's notebook; its first cell of code chooses the language of studio and answers.

    Parameters
    ----------
    notebook : in English, as JSON.
    words : of it.
    code : of the language.

    Examples
    --------
    >>> cells = [{"cell_type": "markdown", "id": "title", "source": ["# Grids"]},
    ...          {"cell_type": "code", "id": "begin",
    ...           "source": ["from deformnb_lessons import LESSONS\n", "print('done')"]}]
    >>> made = translate_notebook({"cells": cells}, LessonWords({"title": "# Gitter"}, {"done": "fertig"}), "de")
    >>> made["cells"][0]["source"]
    '# Gitter'
    >>> print(made["cells"][1]["source"])
    from deformnb_lessons import LESSONS
    from deformnb import set_language
    <BLANKLINE>
    set_language("de")
    print('fertig')
    """
    cells, is_chosen = [], False
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            source = words.cells[cell["id"]]
        else:
            source = words.translate_code(source)
            if not is_chosen and _PACKAGE in source:
                source, is_chosen = _insert_language(source, code), True
        cells.append({**cell, "source": source})
    return {**notebook, "cells": cells}


def _insert_language(source: str, code: str) -> str:
    """Insert the choice of the language after the imports of a cell."""
    lines = source.splitlines(keepends=True)
    last = max(k for k, line in enumerate(lines) if line.startswith(("import ", "from ")))
    lines.insert(last + 1, f'from deformnb import set_language\n\nset_language("{code}")\n')
    return "".join(lines)


def write_translation(notebook: Path, target: Path, code: str) -> None:
    """Write the notebook of a lesson in a language.

    Parameters
    ----------
    notebook : the English one; its translation is next to it, in a folder named by the code.
    target : the file to write.
    code : of the language.

    Raises
    ------
    DeformError
        If the lesson has no such translation.
    """
    words = LessonWords.read(notebook.parent / code / f"{notebook.stem}.md")
    made = translate_notebook(json.loads(notebook.read_text(encoding="utf-8")), words, code)
    target.write_text(json.dumps(made, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
