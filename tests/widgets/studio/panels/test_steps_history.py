"""The panel of the history: its rows, their order, and the state after a click."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from studio_driver import act

from deformnb.errors import DeformError
from deformnb.session.history import HistoryNode
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.studio.history_labels import tree_rows
from deformnb.widgets.studio.panels.steps import HistoryPanel


class Guarded:
    """A guard that records messages."""

    def __init__(self) -> None:
        self.errors: list[str] = []

    def __call__(self, action: Any) -> bool:
        try:
            action()
        except DeformError as error:
            self.errors.append(str(error))
            return False
        return True


@pytest.fixture
def session() -> Session:
    return Session(Volume(np.zeros((8, 8, 8), np.uint8), Grid((8, 8, 8))))


def titles(panel: HistoryPanel) -> list[tuple[str, int, bool]]:
    return [(row["title"], row["indent"], row["on"]) for row in panel.items.rows]


def test_branches_stand_between_a_state_and_what_follows_it(session: Session) -> None:
    guard = Guarded()
    panel = HistoryPanel(session, guard)
    session.editing.change(trend="none")
    session.editing.change(kernel="gaussian")
    session.editing.undo()
    session.editing.change(strength=2.0)
    session.editing.undo()
    session.editing.undo()
    panel.refresh()
    assert titles(panel) == [
        ("the beginning", 0, True),
        ("change trend", 0, False),
        ("change kernel", 1, False),
        ("change strength", 0, False),
    ]
    assert panel.items.chosen == 0
    assert [row["mark"] for row in panel.items.rows] == ["\u25cf", "\u25cb", "\u25cb", "\u25cb"]
    assert all(abs(row["time"] - time.time()) < 60 for row in panel.items.rows)
    act(panel.items, "choose", 2)
    assert session.editing.step.kernel == "gaussian"
    assert titles(panel) == [
        ("the beginning", 0, True),
        ("change trend", 0, True),
        ("change strength", 1, False),
        ("change kernel", 0, True),
    ]
    assert panel.items.chosen == 3
    assert session.editing.notice == "As it was after: change kernel"
    act(panel.items, "choose", 0)
    assert session.editing.notice == "As it was in the beginning."
    panel.close()


def test_an_undo_elsewhere_is_shown_without_a_refresh(session: Session) -> None:
    panel = HistoryPanel(session, Guarded())
    session.editing.change(trend="none")
    session.editing.change(trend="affine")
    session.editing.go_to(0)  # the same document as at the end
    assert panel.items.chosen == 0
    session.editing.redo()
    assert panel.items.chosen == 1
    panel.close()
    session.editing.redo()
    assert panel.items.chosen == 1


def test_a_click_on_a_row_that_has_gone_does_nothing(session: Session) -> None:
    guard = Guarded()
    panel = HistoryPanel(session, guard)
    session.editing.change(trend="none")
    before = panel.items.version
    session.editing.change(strength=2.0)
    message = {"type": "act", "what": "choose", "index": 0, "value": None, "version": before}
    deliver(panel.items, message)
    assert session.editing.step.strength == 2.0
    assert guard.errors == []


def test_two_hundred_states_in_a_row_are_not_moved_in() -> None:
    nodes = [HistoryNode(k, k - 1 if k else None, "edit", float(k), k == 199, True) for k in range(200)]
    assert [(node.id, depth) for node, depth in tree_rows(nodes)] == [(k, 0) for k in range(200)]


def test_branches_of_branches_end_somewhere_and_none_is_lost() -> None:
    nodes = [HistoryNode(0, None, "", 0.0, True, True)]
    for k in range(1, 60, 2):  # each has one more next to it
        nodes += [
            HistoryNode(k, max(0, k - 2), "a", 0.0, False, False),
            HistoryNode(k + 1, max(0, k - 2), "b", 0.0, False, False),
        ]
    rows = tree_rows(nodes)
    assert sorted(node.id for node, _ in rows) == list(range(61))
    assert max(depth for _, depth in rows) <= 8
    above = {node.id: k for k, (node, _) in enumerate(rows)}
    assert all(above[node.parent] < above[node.id] for node in nodes if node.parent is not None)


def test_the_oldest_state_tells_that_there_was_more() -> None:
    from deformnb.widgets.studio.history_labels import history_row

    assert "no longer stored" in history_row(HistoryNode(5, None, "bend", 0.0, False, True), 0, True)["title"]


def test_a_tab_that_is_not_seen_sends_no_rows_and_catches_up(session: Session) -> None:
    panel = HistoryPanel(session, Guarded())
    panel.handle_visibility(False)
    session.editing.change(trend="none")
    assert [title for title, _, _ in titles(panel)] == ["the beginning"]
    panel.handle_visibility(True)
    assert [title for title, _, _ in titles(panel)] == ["the beginning", "change trend"]
    panel.close()
