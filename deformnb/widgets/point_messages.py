"""Control points as the plain JSON that the page holds, and back, with everything checked.

``[{"id": 0, "name": "nose", "source": [a, b], "target": [a, b], "active": true, "weight": 1.0}, ...]``
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from typing import Any

import numpy as np

from deformnb.control_points import ControlPoints
from deformnb.degenerate import LARGEST_SET
from deformnb.errors import DeformError

LONGEST_MESSAGE = 65536
"""Bytes of a message by the page at most: 400 points. A browser never says more at a time."""

_LOG = logging.getLogger(__name__)

# JavaScript counts exactly up to here; the page gives ids by adding one.
_LARGEST_ID = 2**53 - 1
_LONGEST_NAME = 200


def points_to_json(points: ControlPoints) -> list[dict[str, Any]]:
    """The list that the page gets."""
    return [
        {"id": points.ids[k], "name": points.names[k], "source": points.source[k].tolist(),
         "target": points.target[k].tolist(), "active": bool(points.active[k]), "weight": float(points.weight[k])}
        for k in range(len(points))
    ]


def points_from_json(data: Any, next_id: int = 0) -> ControlPoints:
    """Control points on a picture from the page's list; ids below ``next_id`` are not given again.

    Raises
    ------
    DeformError
        If it is not such a list: another type anywhere, a number that is not finite, an id twice, too many points.
    """
    if not isinstance(data, list) or len(data) > LARGEST_SET:
        raise DeformError(f"control points must be a list of at most {LARGEST_SET} points.")
    rows = [_row(item) for item in data]
    places = np.array([[r["source"], r["target"]] for r in rows], dtype=np.float64).reshape(-1, 2, 2)
    return ControlPoints(
        places[:, 0].copy(), places[:, 1].copy(), tuple(r["id"] for r in rows), tuple(r["name"] for r in rows),
        np.array([r["active"] for r in rows], dtype=bool), np.array([r["weight"] for r in rows], dtype=np.float64),
        next_id,
    )


def _row(item: Any) -> dict[str, Any]:
    if not isinstance(item, dict):
        raise DeformError(f"a control point must be an object, got {type(item).__name__}.")
    row = {"name": "", "active": True, "weight": 1.0, **item}
    number, name = row.get("id"), row["name"]
    if not _is_id(number):
        raise DeformError("the id of a control point must be a whole number from 0.")
    if not isinstance(name, str) or len(name) > _LONGEST_NAME or not isinstance(row["active"], bool):
        raise DeformError(f"control point {number} needs a text as name and true or false as switch.")
    for what in ("source", "target"):
        place = row.get(what)
        if not isinstance(place, list) or len(place) != 2 or not all(_is_number(v) for v in place):
            raise DeformError(f"the {what} of control point {number} must be two numbers.")
    if not _is_number(row["weight"]):
        raise DeformError(f"the weight of control point {number} must be a number.")
    return row


def _is_number(value: Any) -> bool:
    # A whole number beyond 64 bits would overflow on its way into an array.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


@dataclass(frozen=True)
class EditMessage:
    """What the page says of an edit."""

    seq: int
    phase: str
    points: ControlPoints


def edit_from_message(content: Any, next_id: int) -> EditMessage | None:
    """An edit by the page; None, and a line in the log, if that is not what it is."""
    try:
        if not isinstance(content, dict) or content.get("type") != "edit":
            raise DeformError("it is no edit.")
        _check_size(content)
        seq, phase = content.get("seq"), content.get("phase")
        if isinstance(seq, bool) or not isinstance(seq, int) or phase not in ("move", "end"):
            raise DeformError("an edit needs a number and a phase.")
        return EditMessage(seq, phase, points_from_json(content.get("points"), next_id))
    except DeformError as error:
        _LOG.warning("a message to an editor was dropped: %s", error)
        return None


def checked_state(state: Any, next_id: int) -> dict[str, Any]:
    """The part of a state update by the page that is right; the rest is logged and dropped."""
    if not isinstance(state, dict):
        _LOG.warning("a state update of an editor was dropped: it is no object.")
        return {}
    kept = {}
    for name, value in state.items():
        try:
            _check_size(value)
            _check_trait(name, value, next_id)
            kept[name] = value
        except DeformError as error:
            _LOG.warning("the trait %.40r from the page was dropped: %s", name, error)
    return kept


def _check_trait(name: Any, value: Any, next_id: int) -> None:
    if name == "points":
        points_from_json(value, next_id)
    elif name == "next_id":
        if not _is_id(value) or value < next_id:
            raise DeformError("the next id is a whole number that only grows.")
    elif name == "selected":
        if not isinstance(value, list) or not all(_is_id(v) for v in value):
            raise DeformError("a selection is a list of ids.")
    elif name in ("show_net", "show_radius"):
        if not isinstance(value, bool):
            raise DeformError("it must be true or false.")
    elif name != "_view_count" or not (value is None or _is_id(value)):  # ipywidgets counts views, if asked to
        raise DeformError("the page does not own it.")


def _is_id(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _LARGEST_ID


def _check_size(content: Any) -> None:
    try:
        size = len(json.dumps(content))
    except (TypeError, ValueError, RecursionError):
        raise DeformError("it is no JSON.") from None
    if size > LONGEST_MESSAGE:
        raise DeformError(f"it has {size} bytes, more than {LONGEST_MESSAGE}.")
