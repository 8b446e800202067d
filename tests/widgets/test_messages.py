"""The table of messages: what the sources send is in it, and nothing else; the documentation is written from it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from deformnb.errors import DeformError
from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.edit_messages import RefusedMessage, choice_from_page, message_from_page, shapes_from_page
from deformnb.widgets.messages import MESSAGES, TO_FRONT_END, TO_PYTHON, MessageKind, as_markdown

PACKAGE = Path(__file__).parents[2] / "deformnb"
# A page without Python sends what Python would; the application's own procedures are no messages of widgets.
NOT_FRONT_ENDS = ("standalone.ts", "app")


def named(way: str) -> set[str]:
    return {kind.name for kind in MESSAGES if kind.way == way}


def test_front_ends_send_what_the_table_holds() -> None:
    sent = set()
    for path in SOURCES.rglob("*.ts"):
        if path.relative_to(SOURCES).parts[0] not in NOT_FRONT_ENDS:
            text = path.read_text(encoding="utf-8")
            sent |= set(re.findall(r'(?:send|post)\((?:"\w+", )?\{[^}]*?\btype: "(\w+)"', text))
    assert sent | {"size"} == named(TO_PYTHON)  # "size" is sent by a variable


def test_python_sends_what_the_table_holds() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (PACKAGE / "widgets").rglob("*.py"))
    sent = set(re.findall(r'(\w+)\(\s*type="\w+"', text)) | set(re.findall(r'message: (\w+) = \{\s*"type": "', text))
    assert sent == {kind.shape.__name__ for kind in MESSAGES if kind.way == TO_FRONT_END}
    assert not re.findall(r"(?:send\(|_post\()\{", text)  # a message without a type


def test_no_kind_is_there_twice() -> None:
    keys = [(kind.name, kind.way, kind.widgets) for kind in MESSAGES]
    assert len(set(keys)) == len(keys)


def test_the_page_of_the_documentation_is_written_from_the_table() -> None:
    page = PACKAGE.parent / "docs" / "messages.md"
    assert page.read_text(encoding="utf-8") == as_markdown(), "run: python -m deformnb.widgets.messages > docs/..."


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: f"{kind.shape.__name__} {kind.widgets}")
def test_every_field_of_a_message_has_a_type_in_words(kind: MessageKind) -> None:
    assert all(name and words for name, words, _ in kind.fields())
    assert (
        {"sender", "seq"} <= {name for name, _, _ in kind.fields()}
        or kind.widgets not in ("Editor", "Editor, SpaceEditor")
        or kind.way == TO_FRONT_END
    )


@pytest.mark.parametrize(
    "kind",
    [kind for kind in MESSAGES if kind.widgets.startswith("Editor") and kind.way == TO_PYTHON],
    ids=lambda kind: kind.name,
)
def test_editors_read_what_the_type_says(kind: MessageKind) -> None:
    """Each message is taken with all fields of its type; those that may not be missing are asked for."""
    point = {
        "id": 0,
        "name": "",
        "source": [1.0, 2.0],
        "target": [2.0, 2.0],
        "active": True,
        "weight": 1.0,
        "locked": False,
        "radius": None,
    }
    values = {
        "sender": "a",
        "seq": 3,
        "phase": "end",
        "kind": "add",
        "joins": False,
        "next_id": 1,
        "points": [point],
        "drawn": {"hz": 60.0},
        "what": "cuts",
        "shapes": [],
        "index": 0,
        "shape": {},
        "way": "undo",
        "part": {"index": 0, "motion": None},
    }
    names = [name for name, _, _ in kind.fields()]
    full = {"type": kind.name, **{name.rstrip("?"): values[name.rstrip("?")] for name in names}}
    read = {"shapes": shapes_from_page, "choose": choice_from_page}.get(kind.name, lambda it: message_from_page(it, 0))
    made = read(full)
    assert made is not None
    assert not isinstance(made, RefusedMessage)
    for name in names:
        if name in ("what", "kind") or name.endswith("?"):
            continue
        try:
            less = read({key: value for key, value in full.items() if key != name})
        except DeformError:
            continue
        assert less is None or isinstance(less, RefusedMessage), name
