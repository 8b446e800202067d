"""Plain English in all texts that a user reads: the words of the field, as its books have them."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from words.sources import LESSONS, PACKAGE, ROOT, own_table

BANNED = {
    r"\bshall\b": "should, must, or the present tense",
    r"\bnets?\b(?!/)": "grid",
    r"\b(on|of) the way\b(?! (to|from|out))|\b(short|long)(er)? ways?\b|\b(its|their|his) way\b": (
        "displacement, distance, change, or difference"
    ),
    r"\bthe (other|opposite) way\b(?! round)": "in the other (opposite) direction",
    r"\btak\w+ hold of\b": "drag, press",
    r"\bg(ive|ives|ave|iven|iving) up\b": "cancel, fail, end",
    r"\bhangs? together\b": "is connected",
    r"\bfelt\b": "has an effect",
    r"\bovertaken\b": "discarded",
    r"\ball alike\b": "equal, of one size",
    r"\bnoticed\b": "what has happened",
    r"\b(upright|level) line\b": "vertical, horizontal line",
    r"\blast time\b": "the last session",
    r"\bin turn\b": "one after the other, alternating",
    r"\bdoes not come\b|\bhas come yet\b": "does not arrive, has arrived",
    r"\bgoes on by itself\b": "continues automatically",
    r"\bwhoever\b": "the user",
}
"""Patterns that no visible text matches, and what is written instead."""

RAISED = {pattern for pattern in BANNED if "shall" in pattern or "nets" in pattern or "hold of" in pattern}
"""Those that no docstring, error or message of Python matches either."""


def _tables() -> Iterator[tuple[str, str]]:
    """The words of studio, application, pages and lessons."""
    for package in (PACKAGE, LESSONS):
        for key in own_table(package, "de"):
            yield f"{package.name}/words", key


def _pages() -> Iterator[tuple[str, str]]:
    """Prose of the documentation, of the notebooks and of the lessons, without code."""
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "howto").glob("*.md")):
        yield from _prose(path, path.read_text("utf-8"))
    for folder in (ROOT / "notebooks", LESSONS / "notebooks"):
        for path in folder.glob("*.ipynb"):
            for cell in json.loads(path.read_text("utf-8"))["cells"]:
                if cell["cell_type"] == "markdown":
                    yield from _prose(path, "".join(cell["source"]))


def _prose(path: Path, text: str) -> Iterator[tuple[str, str]]:
    text = re.sub(r"```.*?```|`[^`\n]+`|https?://\S+|\]\([^)\s]+\)", " ", text, flags=re.DOTALL)
    for paragraph in re.split(r"\n\s*\n", text):
        yield path.name, " ".join(paragraph.split())


def _strings() -> Iterator[tuple[str, str]]:
    """Strings of the modules: docstrings, errors, help of commands."""
    for package in (PACKAGE, LESSONS):
        for path in sorted(package.rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield f"{path.name}:{node.lineno}", node.value


def _found(texts: Iterator[tuple[str, str]], patterns: Iterator[str]) -> list[str]:
    all_texts = list(texts)
    assert len(all_texts) > 200
    return [
        f"{place}: {text[max(0, found.start() - 40) : found.end() + 40]!r}: {BANNED[pattern]}"
        for pattern in patterns
        for place, text in all_texts
        if (found := re.search(pattern, text, re.IGNORECASE))
    ]


@pytest.mark.parametrize("texts", [_tables, _pages])
def test_visible_texts_are_plain_sentences_of_the_field(texts) -> None:  # type: ignore[no-untyped-def]
    assert _found(texts(), iter(BANNED)) == []


def test_docstrings_and_errors_have_none_of_the_worst() -> None:
    assert _found(_strings(), iter(RAISED)) == []


def test_the_patterns_find_what_they_are_for() -> None:
    for text in (
        "drag it where it shall be",
        "the node on the net",
        "65 % of the way; 3 pixels",
        "a shorter way",
        "Mirror the other way",
        "nothing to take hold of",
    ):
        assert any(re.search(pattern, text) for pattern in BANNED), text
    for text in ("Divide the other way round.", "a shoulder of the network", "points in the way"):
        assert not any(re.search(pattern, text) for pattern in BANNED), text
