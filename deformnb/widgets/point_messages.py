"""Control points as the plain JSON that the page holds, and back, with everything checked.

``[{"id": 0, "name": "nose", "source": [a, b], "target": [a, b], "active": true, "weight": 1.0, "locked": false,
"radius": null}, ...]``

Points in space have three coordinates each. A radius of null is the one that all points have.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deformnb.control_points import ControlPoints
from deformnb.degenerate import LARGEST_SET
from deformnb.errors import DeformError

LONGEST_MESSAGE = 65536
"""Bytes of a trait that the page sets at most."""

LONGEST_EDIT = 2**20
"""Bytes of an edit at most: all the points that a fit takes."""

KINDS = ("move", "nudge", "add", "remove", "rename", "switch", "reset", "undo", "redo", "several", "lock", "turn",
         "scale", "brush")
"""What an edit did; "several" is more than one of them, which a busy kernel gets as one."""

OVERLAYS = ("none", "folds", "area", "strain", "uncertainty")
"""What an editor can lay over its picture."""

_LOG = logging.getLogger(__name__)

# JavaScript counts exactly up to here; the page gives ids by adding one.
_LARGEST_ID = 2**53 - 1
_LONGEST_NAME = 200
_LONGEST_SENDER = 40
_COUNTS = {2: "two", 3: "three"}


def points_to_json(points: ControlPoints) -> list[dict[str, Any]]:
    """The list that the page gets."""
    return [
        {"id": points.ids[k], "name": points.names[k], "source": points.source[k].tolist(),
         "target": points.target[k].tolist(), "active": bool(points.active[k]), "weight": float(points.weight[k]),
         "locked": bool(points.locked[k]), "radius": None if np.isnan(r := points.radius[k]) else float(r)}
        for k in range(len(points))
    ]


def points_from_json(data: Any, next_id: int = 0, dim: int = 2) -> ControlPoints:
    """Control points of so many coordinates from the page's list; ids below ``next_id`` are not given again.

    Raises
    ------
    DeformError
        If it is not such a list: another type anywhere, a number that is not finite, an id twice, too many points.
    """
    if not isinstance(data, list) or len(data) > LARGEST_SET:
        raise DeformError(f"control points must be a list of at most {LARGEST_SET} points.")
    rows = [_row(item, dim) for item in data]
    places = np.array([[r["source"], r["target"]] for r in rows], dtype=np.float64).reshape(-1, 2, dim)
    return ControlPoints(
        places[:, 0].copy(), places[:, 1].copy(), tuple(r["id"] for r in rows), tuple(r["name"] for r in rows),
        np.array([r["active"] for r in rows], dtype=bool), np.array([r["weight"] for r in rows], dtype=np.float64),
        next_id, np.array([r["locked"] for r in rows], dtype=bool),
        np.array([np.nan if r["radius"] is None else r["radius"] for r in rows], dtype=np.float64),
    )


def _row(item: Any, dim: int) -> dict[str, Any]:
    if not isinstance(item, dict):
        raise DeformError(f"a control point must be an object, got {type(item).__name__}.")
    row = {"name": "", "active": True, "weight": 1.0, "locked": False, "radius": None, **item}
    number, name = row.get("id"), row["name"]
    if not _is_id(number):
        raise DeformError("the id of a control point must be a whole number from 0.")
    if not isinstance(name, str) or len(name) > _LONGEST_NAME:
        raise DeformError(f"control point {number} needs a text as name.")
    if not isinstance(row["active"], bool) or not isinstance(row["locked"], bool):
        raise DeformError(f"control point {number} needs true or false as switch and as lock.")
    for what in ("source", "target"):
        place = row.get(what)
        if not isinstance(place, list) or len(place) != dim or not all(_is_number(v) for v in place):
            raise DeformError(f"the {what} of control point {number} must be {_COUNTS[dim]} numbers.")
    if not _is_number(row["weight"]):
        raise DeformError(f"the weight of control point {number} must be a number.")
    if row["radius"] is not None and not _is_number(row["radius"]):
        raise DeformError(f"the radius of control point {number} must be a number, or null.")
    return row


def _is_number(value: Any) -> bool:
    # A whole number beyond 64 bits would overflow on its way into an array.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


@dataclass(frozen=True)
class Message:
    """Any message by a page: ``seq`` counts those of a sender, which is one window that shows the editor."""

    sender: str
    seq: int


@dataclass(frozen=True)
class EditMessage(Message):
    """What the page says of an edit.

    Attributes
    ----------
    phase : "move" while points are dragged, "end" when the edit is done.
    kind : what was done, one of :data:`KINDS`.
    joins : True if it goes on with the edit before it, as arrow keys in quick succession do: one step of an undo.
    points : all points after the edit.
    drawn : what the page has measured in a drag that ends with it: ``hz`` (pictures a second) and ``ms`` (from a
        movement to its picture); else empty.
    """

    phase: str
    kind: str
    joins: bool
    points: ControlPoints
    drawn: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class HistoryMessage(Message):
    """The page asks for "undo" or "redo"; only where Python owns the history."""

    way: str


@dataclass(frozen=True)
class RefusedMessage(Message):
    """An edit with something wrong in it: the page must hear that it will not be taken."""

    reason: str
    what: str = "points"


def message_from_page(content: Any, next_id: int, dim: int = 2) -> Message | None:
    """What a custom message says to an editor of such points.

    None, and a line in the log, where it does not even say who sent it.
    """
    try:
        sender, seq = header(content)
    except DeformError as error:
        _LOG.warning("a message to an editor was dropped: %s", error)
        return None
    try:
        if content["type"] == "greet":
            return Message(sender, seq)
        if content["type"] == "history":
            if content.get("way") not in ("undo", "redo"):
                raise DeformError("a step of the history goes by undo or redo.")
            return HistoryMessage(sender, seq, content["way"])
        return _edit(content, sender, seq, next_id, dim)
    except DeformError as error:
        _LOG.warning("an edit was refused: %s", error)
        return RefusedMessage(sender, seq, str(error))


def header(content: Any) -> tuple[str, int]:
    """Who sent a message, and its number; DeformError if it does not say."""
    if not isinstance(content, dict) or content.get("type") not in ("greet", "edit", "history", "shapes", "choose"):
        raise DeformError("it is no edit.")
    sender, seq = content.get("sender"), content.get("seq")
    if not isinstance(sender, str) or not 1 <= len(sender) <= _LONGEST_SENDER or seq is None or not _is_id(seq):
        raise DeformError("an edit needs a sender and a number.")
    return sender, seq


def _edit(content: dict[str, Any], sender: str, seq: int, next_id: int, dim: int) -> EditMessage:
    check_size(content, LONGEST_EDIT)
    phase, kind, joins = content.get("phase"), content.get("kind"), content.get("joins", False)
    if phase not in ("move", "end") or kind not in KINDS or not isinstance(joins, bool):
        raise DeformError("an edit needs a phase and a kind.")
    least = content.get("next_id", 0)
    if not _is_id(least):
        raise DeformError("the next id of an edit must be a whole number from 0.")
    points = points_from_json(content.get("points"), max(least, next_id), dim)
    return EditMessage(sender, seq, phase, kind, joins, points, _drawn(content.get("drawn")))


def _drawn(said: Any) -> dict[str, float]:
    """What a page measured; nothing if it is odd, for no edit is refused for that."""
    given = said if isinstance(said, dict) else {}
    return {name: float(given[name]) for name in ("hz", "ms") if _is_number(given.get(name)) and 0 <= given[name] < 1e6}


def checked_state(state: Any, own: Mapping[str, Callable[[Any], None]]) -> dict[str, Any]:
    """The part of a state update by the page that is right; the rest is logged and dropped.

    Parameters
    ----------
    state : traits and their values.
    own : what checks the traits of this kind of editor, besides those that all have.
    """
    if not isinstance(state, dict):
        _LOG.warning("a state update of an editor was dropped: it is no object.")
        return {}
    kept = {}
    for name, value in state.items():
        try:
            check_size(value, LONGEST_MESSAGE)
            _check_trait(name, value, own)
            kept[name] = value
        except DeformError as error:
            _LOG.warning("the trait %.40r from the page was dropped: %s", name, error)
    return kept


def _check_trait(name: Any, value: Any, own: Mapping[str, Callable[[Any], None]]) -> None:
    if name == "selected":
        if not isinstance(value, list) or not all(_is_id(v) for v in value):
            raise DeformError("a selection is a list of ids.")
    elif name in ("show_net", "show_radius"):
        if not isinstance(value, bool):
            raise DeformError("it must be true or false.")
    elif name == "overlay":
        if value not in OVERLAYS:
            raise DeformError(f"there is no such overlay; choose one of {', '.join(OVERLAYS)}.")
    elif name in own:
        own[name](value)
    elif name != "_view_count" or not (value is None or _is_id(value)):  # ipywidgets counts views, if asked to
        raise DeformError("the page does not own it.")


def _is_id(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _LARGEST_ID


def check_size(content: Any, most: int) -> None:
    """Refuse what has more bytes as JSON."""
    try:
        size = len(json.dumps(content))
    except (TypeError, ValueError, RecursionError):
        raise DeformError("it is no JSON.") from None
    if size > most:
        raise DeformError(f"it has {size} bytes, more than {most}.")
