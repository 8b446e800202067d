"""Labels of edits and rows of the history list, for the studio and the application, without widgets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from deformnb.rbf.points import ControlPoints
from deformnb.session.autosave import Recovery
from deformnb.session.autosave_store import SavedSession, count_text
from deformnb.session.history import HistoryNode
from deformnb.session.session import Session

JOINING = ("nudge", "turn", "scale")
"""Kinds of edits that keys do: held down they are one step of the history."""

_STROKE = re.compile(r"(move|grow|shrink|smudge|expand) \d+")


def edit_label(before: ControlPoints, after: ControlPoints, kind: str = "") -> str:
    """Label of an edit of a set of points; ``kind`` is the front end's name of it, where it was one.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [4, 0]], names=["tail", ""])
    >>> edit_label(points, points.move(0, [1, 0])), edit_label(points, points.remove(1))
    ('move "tail"', 'remove point 2')
    >>> edit_label(points, points.edit(1, locked=True))
    'lock point 2'
    >>> edit_label(points, points.move(0, [0, 3]).move(1, [4, 1]), "turn")
    'turn 2 points'
    >>> edit_label(points, points.add([9, 9], name="move 4"), "brush")
    'move 4'
    """
    if kind == "open":
        return "pull open a cut"
    if kind == "apart":
        return "move apart rigidly"
    if kind == "straighten":
        return "straighten along a line"
    if kind in ("turn", "scale", "brush"):
        return _tool(before, after, kind)
    old, new = (dict(zip(p.ids, range(len(p)), strict=True)) for p in (before, after))
    added = [k for i, k in new.items() if i not in old]
    removed = [k for i, k in old.items() if i not in new]
    if added and removed:
        return "replace points"
    if added:
        return f"add {_who(after, added)}"
    if removed:
        return f"remove {_who(before, removed)}"
    both = [(k, old[i]) for i, k in new.items()]
    for what, name in (
        ("move", "target"),
        ("move the source of", "source"),
        ("switch", "active"),
        ("weigh", "weight"),
        ("lock", "locked"),
        ("change the radius of", "radius"),
    ):
        new_values, old_values = getattr(after, name), getattr(before, name)
        changed = [k for k, j in both if not np.array_equal(new_values[k], old_values[j], equal_nan=True)]
        if changed and name == "locked" and not after.locked[changed].any():
            return f"unlock {_who(after, changed)}"
        if changed:
            return f"{what} {_who(after, changed)}"
    renamed = [k for k, j in both if after.names[k] != before.names[j]]
    return f"rename {_who(after, renamed)}" if renamed else "change points"


def _tool(before: ControlPoints, after: ControlPoints, kind: str) -> str:
    old = dict(zip(before.ids, before.target, strict=True))
    changed = [k for k, i in enumerate(after.ids) if i not in old or not np.array_equal(after.target[k], old[i])]
    strokes = {after.names[k] for k in changed if after.ids[k] not in old and _STROKE.fullmatch(after.names[k])}
    if kind == "brush" and strokes:
        return min(strokes)
    return f"{kind} {_who(after, changed)}" if changed else "change points"


def _who(points: ControlPoints, positions: list[int]) -> str:
    if len(positions) > 1:
        return f"{len(positions)} points"
    k = positions[0]
    return f'"{points.names[k]}"' if points.names[k] else points.label(k)


_DEEPEST = 8  # a branch of a branch of ...: deeper ones are not moved in further


def go_to(session: Session, state: int, *, recovery: Recovery | None = None) -> None:
    """Go to a state of a session's history or to an earlier session, and report that in its notice.

    Raises
    ------
    DeformError
        If there is no such state any more.
    """
    if state < 0 and recovery is not None:
        recovery.resume(-1 - state)
        session.editing.notice = "As an earlier session has left it; undo reverts this."
        return
    label = session.editing.go_to(state)
    session.editing.notice = f"As it was after: {label}" if label else "As it was in the beginning."


def history_rows(
    nodes: Sequence[HistoryNode], earlier: Sequence[SavedSession] = ()
) -> tuple[list[dict[str, Any]], int]:
    """Rows of a list of these states and of earlier sessions, and the index among them of the current state.

    Earlier sessions come last; their ids are -1, -2 and so on.
    """
    rows, done = tree_rows(nodes), _applied_states(nodes)
    return (
        [history_row(node, depth, node.id in done) for node, depth in rows]
        + [_earlier_row(k, entry) for k, entry in enumerate(earlier)],
        next(k for k, (node, _) in enumerate(rows) if node.is_current),
    )


def _earlier_row(k: int, entry: SavedSession) -> dict[str, Any]:
    words = f"an earlier session, not saved: {count_text(entry.points, 'point')}, {count_text(entry.steps, 'step')}"
    return {
        "title": words,
        "id": -1 - k,
        "on": False,
        "indent": 0,
        "time": entry.edited.timestamp(),
        "mark": "\u25cb",
        "tip": f"{words}: continue with it; can be undone",
    }


def tree_rows(nodes: Sequence[HistoryNode]) -> list[tuple[HistoryNode, int]]:
    """The states from top to bottom, and the indentation of each.

    The successor of a state by undo and redo is below it as far left; the branches that leave it come in between.

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


def _applied_states(nodes: Sequence[HistoryNode]) -> set[int]:
    """The states that made the current one: itself and those before it."""
    parents = {node.id: node.parent for node in nodes}
    at, done = next((node.id for node in nodes if node.is_current), None), set[int]()
    while at is not None:
        done.add(at)
        at = parents[at]
    return done


def history_row(node: HistoryNode, depth: int, is_done: bool) -> dict[str, Any]:
    """Row of a list for a step of the history."""
    words = node.label or "the beginning"
    if node.parent is None and node.label:
        words = f"{node.label} (earlier states are no longer stored)"
    where = "the current state" if node.is_current else "go back to it" if is_done else "undone; go there again"
    return {
        "title": words,
        "id": node.id,
        "on": is_done,
        "indent": depth,
        "time": node.time,
        "mark": "\u25cf" if node.is_current else "\u25cb",
        "tip": f"{words}: {where}",
    }
