"""The keys of an interpolation without a browser: depths, the selected one, and messages of the front end."""

from __future__ import annotations

import json
from typing import Any

import pytest
from front_end import deliver

from deformnb.errors import DeformError
from deformnb.widgets import DepthKeys
from deformnb.widgets.inputs.depth_keys import KeyEdit

KNOTS = (0.0, 0.5, 1.0)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    messages: list[Any] = []
    monkeypatch.setattr(DepthKeys, "send", lambda self, content, buffers=None: messages.append(content))
    return messages


def receive(keys: DepthKeys, kind: Any, index: Any, knots: Any, selected: Any, phase: str = "end") -> None:
    value = {"kind": kind, "index": index, "knots": knots, "selected": selected}
    content = {"type": "edit", "seq": 1, "view": "v", "phase": phase, "value": value}
    deliver(keys, json.loads(json.dumps(content)))


def test_fewer_knots_keep_the_selection_inside() -> None:
    keys = DepthKeys(KNOTS, selected=2)
    assert keys.shown == {"knots": [0.0, 0.5, 1.0], "selected": 2, "seen": {}}
    keys.knots = [0.25]
    assert (keys.knots, keys.selected) == ((0.25,), 0)
    assert keys.shown == {"knots": [0.25], "selected": 0, "seen": {}}
    assert repr(keys) == "DepthKeys((0.25), selected=0)"


@pytest.mark.parametrize(
    "knots", [(), (0.5, 0.5), (1.0, 0.0), (-0.1, 1.0), (0.0, 1.1), (0.0, float("nan")), 3, "ab", None]
)
def test_wrong_knots_are_refused(knots: Any) -> None:
    keys = DepthKeys(KNOTS)
    with pytest.raises(DeformError, match="knots"):
        keys.knots = knots
    assert keys.knots == KNOTS


@pytest.mark.parametrize("index", [-1, 3])
def test_there_is_no_other_key_to_select(index: int) -> None:
    with pytest.raises(DeformError, match=r"no key -?\d; there are 3"):
        DepthKeys(KNOTS, selected=index)


@pytest.mark.parametrize(
    ("edit", "phase"),
    [
        (KeyEdit("move", 1, (0.0, 0.25, 1.0), 1), "end"),
        (KeyEdit("move", 1, (0.0, 0.25, 1.0), 1), "move"),
        (KeyEdit("add", 1, (0.0, 0.3, 0.5, 1.0), 1), "end"),
        (KeyEdit("remove", 2, (0.0, 0.5), 1), "end"),
        (KeyEdit("select", 2, KNOTS, 2), "end"),
    ],
)
def test_an_edit_says_what_was_done(edit: KeyEdit, phase: str, sent: list[Any]) -> None:
    keys = DepthKeys(KNOTS)
    heard: list[Any] = []
    together: list[Any] = []
    keys.on_edit(lambda *given: heard.append(given))
    keys.observe(lambda _: together.append((keys.knots, keys.selected)), ["knots", "selected"])
    receive(keys, edit.kind, edit.index, list(edit.knots), edit.selected, phase)
    assert heard == [(edit, phase)]
    after = (edit.knots, edit.selected) if phase == "end" else (KNOTS, 0)
    assert (keys.knots, keys.selected) == after
    assert set(together) <= {after}  # no observer meets the new depths with the old selection
    assert [m["type"] for m in sent] == ["done"]


@pytest.mark.parametrize(
    ("kind", "index", "knots", "selected"),
    [
        ("turn", 0, [0, 0.5, 1], 0),
        ("move", 3, [0, 0.5, 1], 0),
        ("move", 0, [0, 0.5, 1], 3),
        ("move", -1, [0, 0.5, 1], 0),
        ("move", True, [0, 0.5, 1], 0),
        ("move", 0, [0, 0.5, 1], None),
        ("move", 0, [0, 1], 0),
        ("add", 0, [0, 0.5, 1], 0),
        ("remove", 0, [], 0),
        ("move", 0, [0.495, 0.5, 1], 0),
        ("move", 0, [0.6, 0.5, 1], 0),
        ("move", 0, [-0.1, 0.5, 1], 0),
        ("move", 0, "abc", 0),
        ("move", 0, [0, None, 1], 0),
        (None, 0, [0, 0.5, 1], 0),
        ([], 0, [0, 0.5, 1], 0),
    ],
)
def test_what_makes_no_sense_is_refused_and_answered(
    kind: Any, index: Any, knots: Any, selected: Any, sent: list[Any]
) -> None:
    keys = DepthKeys(KNOTS, selected=1)
    receive(keys, kind, index, knots, selected)
    assert (keys.knots, keys.selected) == (KNOTS, 1)
    assert [m["type"] for m in sent] == ["error", "done"]
    assert "callback" not in sent[0]["message"]
    assert keys.shown["seen"] == {"v": 1}


def test_keys_of_a_document_may_be_nearer_than_the_page_allows(sent: list[Any]) -> None:
    keys = DepthKeys((0.5, 0.502, 1.0))
    receive(keys, "move", 2, [0.5, 0.502, 0.9], 2)
    assert keys.knots == (0.5, 0.502, 0.9)
    receive(keys, "move", 0, [0.501, 0.502, 0.9], 2)
    assert keys.knots == (0.5, 0.502, 0.9)
