"""The history as a list: every state that can be gone to, branches moved in, the one that is shown marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ipywidgets as ipw

from deformnb.history import HistoryNode
from deformnb.session import Session
from deformnb.widgets.cell_widgets import weakly
from deformnb.widgets.controls import Guard, Panel
from deformnb.widgets.item_list import ItemList

_DEEPEST = 8  # a branch of a branch of ...: deeper ones are not moved in further
_HINT = "Click on a state to go there. An edit after an undo begins a branch; what was undone stays, moved in."


class HistoryPanel(Panel):
    """All states of the document that can be gone to.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> panel = HistoryPanel(session, lambda action: action() or True)
    >>> session.change(trend="none")
    >>> panel.refresh()
    >>> [row["title"] for row in panel.items.rows]
    ['the beginning', 'change trend']
    >>> panel.close()
    """

    title = "History"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        self._shown: tuple[HistoryNode, ...] = ()
        self._order: list[int] = []
        self.items = ItemList(label="History", commands=[], switches=False, columns=["What was done", "When"])
        self.items.on_act(self._act)
        self.box = ipw.VBox([self.items, ipw.Label(_HINT)])
        # Going between equal documents changes nothing else, and refreshes no panel.
        self._heard = weakly(self, HistoryPanel._history_changed, lambda panel: True)
        session.observe(self._heard, "history")
        self.refresh()

    def _history_changed(self, _change: Any) -> None:
        self.refresh()

    def _act(self, what: str, index: int, _value: Any) -> None:
        if what == "choose":
            state = self._order[index]
            self.guard(lambda: _go(self.session, state))
            self.refresh()

    def arrange(self) -> None:
        nodes = self.session.history_tree()
        if nodes == self._shown:
            return
        self._shown = nodes
        rows = tree_rows(nodes)
        self._order = [node.id for node, _ in rows]
        done = _done(nodes)
        self.items.show([_row(node, depth, node.id in done) for node, depth in rows],
                        next(k for k, (node, _) in enumerate(rows) if node.is_current))

    def close(self) -> None:
        self.session.unobserve(self._heard, "history")


def _go(session: Session, state: int) -> None:
    label = session.go_to(state)
    session.notice = f"As it was after: {label}" if label else "As it was in the beginning."


def tree_rows(nodes: Sequence[HistoryNode]) -> list[tuple[HistoryNode, int]]:
    """The states as they stand below each other, and how far each is moved in.

    What follows a state by undo and redo stands below it as far left; the branches that leave it come in between.

    Examples
    --------
    >>> nodes = [HistoryNode(0, None, "", 0.0, False, True), HistoryNode(1, 0, "bend", 1.0, False, False),
    ...          HistoryNode(2, 0, "twist", 2.0, True, True)]
    >>> [(node.label, depth) for node, depth in tree_rows(nodes)]
    [('', 0), ('bend', 1), ('twist', 0)]
    """
    children: dict[int | None, list[HistoryNode]] = {}
    for node in nodes:
        children.setdefault(node.parent, []).append(node)
    rows, waiting = list[tuple[HistoryNode, int]](), [(children[None][0], 0)]
    while waiting:  # no recursion: a history is two hundred states deep
        node, depth = waiting.pop()
        rows.append((node, depth))
        after = children.get(node.id, [])
        straight = next((child for child in after if child.is_on_way), after[-1] if after else None)
        waiting += [(straight, depth)] if straight is not None else []
        waiting += [(child, min(depth + 1, _DEEPEST)) for child in reversed(after) if child is not straight]
    return rows


def _done(nodes: Sequence[HistoryNode]) -> set[int]:
    """What the state that is shown was made by: itself and those before it."""
    parents = {node.id: node.parent for node in nodes}
    at, done = next((node.id for node in nodes if node.is_current), None), set[int]()
    while at is not None:
        done.add(at)
        at = parents[at]
    return done


def _row(node: HistoryNode, depth: int, is_done: bool) -> dict[str, Any]:
    words = node.label or "the beginning"
    if node.parent is None and node.label:
        words = f"{node.label} (what was before is no longer kept)"
    where = "this is what is shown" if node.is_current else "go back to it" if is_done else "undone; go there again"
    return {"title": words, "id": node.id, "on": is_done, "indent": depth, "time": node.time,
            "mark": "\u25cf" if node.is_current else "\u25cb", "tip": f"{words}: {where}"}
