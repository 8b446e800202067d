"""The states of a history in the words of a list, for the studio's panel and for the application. No widgets here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from deformnb.history import HistoryNode
from deformnb.recovery import Recovery
from deformnb.session import Session
from deformnb.session_store import SavedSession, counted

_DEEPEST = 8  # a branch of a branch of ...: deeper ones are not moved in further


def go_to(session: Session, state: int, *, recovery: Recovery | None = None) -> None:
    """Go to a state of a session's history or to an earlier session, and say so in its notice.

    Raises
    ------
    DeformError
        If there is no such state any more.
    """
    if state < 0 and recovery is not None:
        recovery.go_back(-1 - state)
        session.notice = "As an earlier session has left it; undo leads back."
        return
    label = session.go_to(state)
    session.notice = f"As it was after: {label}" if label else "As it was in the beginning."


def history_rows(nodes: Sequence[HistoryNode],
                 earlier: Sequence[SavedSession] = ()) -> tuple[list[dict[str, Any]], int]:
    """What a list of these states and of earlier sessions shows, and the place in it of the state that is shown.

    Earlier sessions come last; their ids are -1, -2 and so on.
    """
    rows, done = tree_rows(nodes), _done(nodes)
    return ([_row(node, depth, node.id in done) for node, depth in rows]
            + [_earlier_row(k, entry) for k, entry in enumerate(earlier)],
            next(k for k, (node, _) in enumerate(rows) if node.is_current))


def _earlier_row(k: int, entry: SavedSession) -> dict[str, Any]:
    words = f"an earlier session, not saved: {counted(entry.points, 'point')}, {counted(entry.steps, 'step')}"
    return {"title": words, "id": -1 - k, "on": False, "indent": 0, "time": entry.edited.timestamp(), "mark": "\u25cb",
            "tip": f"{words}: go on with it; can be undone"}


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
