"""The table of messages: what the sources send is in it, and nothing else; the documentation is written from it."""

from __future__ import annotations

import re
from pathlib import Path

from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.messages import MESSAGES, TO_FRONT_END, TO_PYTHON, as_markdown

PACKAGE = Path(__file__).parents[2] / "deformnb"
# A page without Python sends what Python would; the application's own procedures are no messages of widgets.
NOT_FRONT_ENDS = ("standalone.js", "app")
SENT_BY_VARIABLE = {"trame", "notice", "badge"}


def named(way: str) -> set[str]:
    return {kind.name for kind in MESSAGES if kind.way == way}


def test_front_ends_send_what_the_table_holds() -> None:
    sent = set()
    for path in SOURCES.rglob("*.js"):
        if path.relative_to(SOURCES).parts[0] not in NOT_FRONT_ENDS:
            text = path.read_text(encoding="utf-8")
            sent |= set(re.findall(r'(?:send|post)\((?:"\w+", )?\{[^}]*?\btype: "(\w+)"', text))
    assert sent | {"size"} == named(TO_PYTHON)  # "size" is sent by a variable


def test_python_sends_what_the_table_holds() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (PACKAGE / "widgets").rglob("*.py"))
    sent = set(re.findall(r'(?:send\(|_post\(|return )\{"type": "(\w+)"', text))
    assert sent | SENT_BY_VARIABLE == named(TO_FRONT_END)


def test_no_kind_is_there_twice() -> None:
    keys = [(kind.name, kind.way, kind.widgets) for kind in MESSAGES]
    assert len(set(keys)) == len(keys)


def test_the_page_of_the_documentation_is_written_from_the_table() -> None:
    page = PACKAGE.parent / "docs" / "messages.md"
    assert page.read_text(encoding="utf-8") == as_markdown(), "run: python -m deformnb.widgets.messages > docs/..."
