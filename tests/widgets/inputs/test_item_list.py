"""The list of rows: messages that it takes from a front end, and those it drops."""

from __future__ import annotations

from typing import Any

import pytest
from front_end import deliver

from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.messages.inputs import LONGEST_ROW_NAME


def a_list() -> tuple[ItemList, list[tuple[str, int, Any]]]:
    made, heard = ItemList(), []
    made.show([{"title": "one"}, {"name": "two", "on": False, "facts": ["a", "b"]}], 1)
    made.on_act(lambda *act: heard.append(act))
    return made, heard


def says(made: ItemList, **content: Any) -> None:
    deliver(made, {"type": "act", "index": 0, "value": None, "version": made.version, **content})


def test_what_is_asked_for_reaches_the_callback() -> None:
    made, heard = a_list()
    says(made, what="choose", index=1)
    says(made, what="switch", value=False)
    says(made, what="rename", value="neck")
    for what in ("up", "down", "double", "remove"):
        says(made, what=what, value="no matter")
    assert heard == [
        ("choose", 1, None),
        ("switch", 0, False),
        ("rename", 0, "neck"),
        ("up", 0, None),
        ("down", 0, None),
        ("double", 0, None),
        ("remove", 0, None),
    ]


@pytest.mark.parametrize(
    "wrong",
    [
        {"what": "explode"},
        {"what": ["up"]},
        {"what": "choose", "index": 2},
        {"what": "choose", "index": -1},
        {"what": "choose", "index": True},
        {"what": "choose", "index": 1.0},
        {"what": "switch", "value": 1},
        {"what": "switch", "value": None},
        {"what": "rename", "value": 5},
        {"what": "rename", "value": "x" * (LONGEST_ROW_NAME + 1)},
        {"what": "choose", "version": "1"},
        {"what": "choose", "version": None},
        {"what": "choose", "type": "do"},
    ],
)
def test_what_is_wrong_is_dropped_and_answered(wrong: dict[str, Any], caplog: pytest.LogCaptureFixture) -> None:
    made, heard = a_list()
    sent: list[Any] = []
    made.send = lambda content, buffers=None: sent.append(content)  # type: ignore[method-assign]
    says(made, **wrong)
    assert heard == []
    assert sent == [{"type": "done"}]  # or the page would wait for ever
    assert "dropped" in caplog.text


def test_what_was_meant_for_other_rows_is_dropped() -> None:
    made, heard = a_list()
    before = made.version
    made.show([{"name": "two"}, {"title": "one"}], 0)
    assert made.version == before + 1
    says(made, what="remove", version=before)
    assert heard == []
    made.show([{"name": "two", "facts": ["moved"], "on": False}, {"title": "one"}], 1)  # the same rows
    says(made, what="remove", version=before + 1)
    assert heard == [("remove", 0, None)]


def test_commands_without_a_button_are_not_taken() -> None:
    made, heard = a_list()
    made.commands = ["remove"]
    says(made, what="up", index=1)
    says(made, what="remove")
    assert heard == [("remove", 0, None)]


def test_a_page_owns_no_trait_and_a_failing_callback_ends_nothing(caplog: pytest.LogCaptureFixture) -> None:
    made, heard = a_list()
    made.set_state({"rows": [], "chosen": 5})
    assert len(made.rows) == 2
    made.on_act(lambda *act: 1 / 0)
    says(made, what="choose")
    assert heard == [("choose", 0, None)]
    assert "ZeroDivisionError" in caplog.text
