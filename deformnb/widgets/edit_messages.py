"""Messages about points and shapes between editors and their front ends: plain JSON, with everything checked.

The types of the messages are in :mod:`deformnb.widgets.messages`; shapes are plain data as
:mod:`deformnb.document.json_format` writes them.

For views there are checks of single values of a message: each returns its argument, or raises ValueError.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import prod
from typing import Any

import numpy as np
import traitlets

from deformnb.document.json_format import cut_from_data, cut_to_data, motion_from_data, part_from_data, part_to_data
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.cuts import MOST_CUTS, Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.widgets.messages import PointData

LONGEST_MESSAGE = 65536
"""Bytes of a trait that the front end sets at most."""

LONGEST_EDIT = 2**20
"""Bytes of an edit at most: all the points that a fit takes."""

KINDS = (
    "move",
    "nudge",
    "add",
    "remove",
    "rename",
    "switch",
    "reset",
    "undo",
    "redo",
    "several",
    "lock",
    "turn",
    "scale",
    "brush",
    "open",
)
"""Kinds of edits; "several" is more than one of them, which a busy kernel gets as one."""

OVERLAYS = ("none", "folds", "area", "strain", "uncertainty")
"""Overlays of an editor's picture."""

_LOG = logging.getLogger(__name__)

# JavaScript counts exactly up to here; the front end gives ids by adding one.
_LARGEST_ID = 2**53 - 1
_LONGEST_NAME = 200
_LONGEST_SENDER = 40
_COUNTS = {2: "two", 3: "three"}


def points_to_json(points: ControlPoints) -> list[PointData]:
    """The list that the front end gets."""
    return [
        {
            "id": points.ids[k],
            "name": points.names[k],
            "source": points.source[k].tolist(),
            "target": points.target[k].tolist(),
            "active": bool(points.active[k]),
            "weight": float(points.weight[k]),
            "locked": bool(points.locked[k]),
            "radius": None if np.isnan(r := points.radius[k]) else float(r),
        }
        for k in range(len(points))
    ]


def points_from_json(data: Any, next_id: int = 0, dim: int = 2) -> ControlPoints:
    """Control points of so many coordinates from the front end's list; ids below ``next_id`` are not given again.

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
        places[:, 0].copy(),
        places[:, 1].copy(),
        tuple(r["id"] for r in rows),
        tuple(r["name"] for r in rows),
        np.array([r["active"] for r in rows], dtype=bool),
        np.array([r["weight"] for r in rows], dtype=np.float64),
        next_id,
        np.array([r["locked"] for r in rows], dtype=bool),
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
    """Any message by a front end: ``seq`` counts those of a sender, which is one window that shows the editor."""

    sender: str
    seq: int


@dataclass(frozen=True)
class EditMessage(Message):
    """Message of the front end about an edit.

    Attributes
    ----------
    phase : "move" while points are dragged, "end" when the edit is done.
    kind : what was done, one of :data:`KINDS`.
    joins : True if it goes on with the edit before it, as arrow keys in quick succession do: one step of an undo.
    points : all points after the edit.
    drawn : what the front end has measured in a drag that ends with it: ``hz`` (pictures a second) and ``ms`` (from a
        movement to its picture); else empty.
    part : the rigid part that is being dragged, as its place among the parts and its motion; None for none.
    """

    phase: str
    kind: str
    joins: bool
    points: ControlPoints
    drawn: dict[str, float] = field(default_factory=dict)
    part: tuple[int, RigidMotion | None] | None = None

    def with_part(self, parts: tuple[RigidPart, ...]) -> tuple[RigidPart, ...]:
        """The rigid parts, that which is being dragged with its motion of now."""
        if self.part is None or self.part[0] >= len(parts):
            return parts
        index, motion = self.part
        return (*parts[:index], replace(parts[index], motion=motion), *parts[index + 1 :])


@dataclass(frozen=True)
class HistoryMessage(Message):
    """The front end requests "undo" or "redo"; only where Python owns the history."""

    way: str


@dataclass(frozen=True)
class RefusedMessage(Message):
    """An edit with something wrong in it: the front end must receive the refusal."""

    reason: str
    what: str = "points"


def message_from_page(content: Any, next_id: int, dim: int = 2) -> Message | None:
    """Parse a custom message to an editor of such points.

    None, and a line in the log, where it does not even name its sender.
    """

    def read(sender: str, seq: int) -> Message:
        if content["type"] == "greet":
            return Message(sender, seq)
        if content["type"] == "history":
            if content.get("way") not in ("undo", "redo"):
                raise DeformError("a step of the history goes by undo or redo.")
            return HistoryMessage(sender, seq, content["way"])
        return _edit(content, sender, seq, next_id, dim)

    return read_or_refuse(content, read)


def read_or_refuse(content: Any, read: Callable[[str, int], Message], what: str = "points") -> Message | None:
    """Read a message by its sender and number: refused where it is wrong, None where it names no sender."""
    try:
        sender, seq = header(content)
    except DeformError as error:
        _LOG.warning("a message to an editor was dropped: %s", error)
        return None
    try:
        return read(sender, seq)
    except DeformError as error:
        _LOG.warning("an edit of %s was refused: %s", what, error)
        return RefusedMessage(sender, seq, str(error), what)


def header(content: Any) -> tuple[str, int]:
    """Sender and number of a message; DeformError if it has none."""
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
    return EditMessage(
        sender, seq, phase, kind, joins, points, _drawn(content.get("drawn")), _moved_part(content.get("part"))
    )


def _moved_part(told: Any) -> tuple[int, RigidMotion | None] | None:
    if told is None:
        return None
    if not isinstance(told, dict) or not _is_id(told.get("index")):
        raise DeformError("a part that is dragged needs its place among the parts.")
    motion = None if told.get("motion") is None else motion_from_data(told["motion"])
    if motion is not None and len(motion.shift) != 2:
        raise DeformError("a part on a picture moves in the picture.")
    return told["index"], motion


def _drawn(said: Any) -> dict[str, float]:
    """Measurements of a front end; nothing if they are odd, for no edit is refused for that."""
    given = said if isinstance(said, dict) else {}
    return {name: float(given[name]) for name in ("hz", "ms") if _is_number(given.get(name)) and 0 <= given[name] < 1e6}


def checked_state(state: Any, own: Mapping[str, Callable[[Any], None]]) -> dict[str, Any]:
    """The part of a state update by the front end that is right; the rest is logged and dropped.

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
    elif name in ("show_grid", "show_radius"):
        if not isinstance(value, bool):
            raise DeformError("it must be true or false.")
    elif name == "overlay":
        if value not in OVERLAYS:
            raise DeformError(f"there is no such overlay; choose one of {', '.join(OVERLAYS)}.")
    elif name in own:
        own[name](value)
    elif name != "_view_count" or not (value is None or _is_id(value)):  # ipywidgets counts views, on request
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


MOST_PARTS = 32
"""Rigid parts of an editor at most."""

MOST_PIXELS = 2**24
"""Pixels of a mask that is given as plain data at most."""

_LONGEST_NAME = 200
_LONGEST_KIND = 80

_SORTS: dict[str, tuple[Any, Callable[..., Any], Callable[[Any], dict[str, Any]], int]] = {
    "cuts": (Cut, cut_from_data, cut_to_data, MOST_CUTS),
    "parts": (RigidPart, part_from_data, part_to_data, MOST_PARTS),
}


@dataclass(frozen=True)
class ShapesMessage(Message):
    """Message of the front end about an edit of shapes.

    Attributes
    ----------
    what : "cuts" or "parts".
    kind : what was done, in words: "add cut", "move part", "undo".
    shapes : all the shapes of that sort after the edit.
    points : all control points after the edit, where it has changed them too; else None.
    joins : True if such edits in quick succession are one step of an undo, as those of arrow keys are.
    """

    what: str
    kind: str
    shapes: tuple[Any, ...]
    points: ControlPoints | None = None
    joins: bool = False


@dataclass(frozen=True)
class ChooseMessage(Message):
    """Message of the front end about the shape that is chosen there.

    Attributes
    ----------
    what : "cuts" or "parts"; empty for none.
    index : its place in the front end's list.
    shape : as much of it as identifies it.
    """

    what: str
    index: int = 0
    shape: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class WandMessage:
    """Message of the front end about the wand; the attributes are those of
    :class:`~deformnb.widgets.messages.WandRequest`.
    """

    what: str
    place: tuple[float, float]
    tolerance: float
    rule: str
    through: bool


def wand_from_page(content: dict[str, Any]) -> WandMessage:
    """Parse a message about the wand; DeformError for anything wrong in it."""
    check_size(content, LONGEST_MESSAGE)
    what, place, rule = content.get("what"), content.get("place"), content.get("rule")
    tolerance, through = content.get("tolerance"), content.get("through")
    if what not in ("preview", "part", "cut", "stop") or rule not in ("near", "brighter", "darker"):
        raise DeformError("the wand selects, makes a part or a cut, or stops.")
    if not isinstance(place, list) or len(place) != 2 or not all(_is_number(v) for v in place):
        raise DeformError("the wand needs a place of two numbers.")
    if not isinstance(tolerance, int | float) or not _is_number(tolerance) or tolerance < 0:
        raise DeformError("the wand needs a tolerance from 0.")
    if not isinstance(through, bool):
        raise DeformError("the wand needs to know whether it goes through the depth.")
    return WandMessage(what, (float(place[0]), float(place[1])), float(tolerance), rule, through)


def choice_from_page(content: dict[str, Any]) -> ChooseMessage:
    """Parse a message about the chosen shape; DeformError for anything wrong in it."""
    sender, seq = header(content)
    check_size(content, LONGEST_EDIT)
    what, index, shape = content.get("what"), content.get("index", 0), content.get("shape")
    if what is None:
        return ChooseMessage(sender, seq, "")
    if what not in _SORTS or not isinstance(index, int) or not isinstance(shape, dict):
        raise DeformError("a choice needs the sort of the shape, its place and the shape.")
    return ChooseMessage(sender, seq, what, index, shape)


def place_of(choice: ChooseMessage, shapes: Sequence[Any]) -> int | None:
    """Index in the current list of the shape that the front end has chosen; None if it is there no more."""
    data = [] if choice.what is None else shapes_to_json(choice.what, shapes)
    places = [k for k, shape in enumerate(data) if _fits(shape, choice.shape)]
    return min(places, key=lambda k: abs(k - choice.index), default=None)


def _fits(shape: Any, told: Any) -> bool:
    """Check whether a shape has all the given properties."""
    if isinstance(told, dict) and isinstance(shape, dict):
        return bool(told) and all(name in shape and _fits(shape[name], value) for name, value in told.items())
    return bool(shape == told)


def followed(before: Sequence[Any], after: Sequence[Any], index: int) -> int | None:
    """Index of a shape after an edit of the list, from that before; None if it is gone.

    A shape is the same if it is equal, or the only one that was changed. shapes.js follows by the same rule.

    Examples
    --------
    >>> followed("abc", "ac", 2), followed("abc", "cab", 2), followed("abc", "aXc", 1), followed("abc", "ac", 1)
    (1, 0, 1, None)
    """
    if not 0 <= index < len(before):
        return None
    places = [k for k, shape in enumerate(after) if shape == before[index]]
    if places:
        return min(places, key=lambda k: abs(k - index))
    changed = [k for k, (old, new) in enumerate(zip(before, after, strict=False)) if old != new]
    return index if len(before) == len(after) and changed == [index] else None


def checked_shapes(what: str, given: Any) -> tuple[Any, ...]:
    """Cuts or rigid parts, as they are or as plain data of the front end or a document.

    Raises
    ------
    DeformError
        Naming the shape that is none, lies in space, or crosses itself.

    Examples
    --------
    >>> checked_shapes("cuts", [{"region": {"kind": "line", "vertices": [[0, 1], [9, 1]]}}])
    (Cut(region=Line(vertices=((0.0, 1.0), (9.0, 1.0)), stops=(False, False)), name='', enabled=True),)
    """
    kind, _, _, most = _SORTS[what]
    if not isinstance(given, list | tuple) or len(given) > most:
        raise DeformError(f"the {what} must be a list of at most {most}.")
    return tuple(shape if isinstance(shape, kind) else _read(what, k, shape) for k, shape in enumerate(given))


def shapes_to_json(what: str, shapes: Sequence[Any]) -> list[dict[str, Any]]:
    """Cuts or rigid parts as the front end gets them."""
    return [_SORTS[what][2](shape) for shape in shapes]


def _read(what: str, k: int, data: Any) -> Any:
    _check_mask(data, f"{what}[{k}]")
    made = _SORTS[what][1](data, f"{what}[{k}]")
    if made.region.dim != 2:
        raise DeformError(f"{what}[{k}] lies in space; on a picture take the silhouette(plane) of its mask.")
    if what == "parts" and made.region.kind == "line":
        raise DeformError(f"{what}[{k}] is a line, which has no inside to stay rigid; use a polygon or a half space.")
    if len(made.name) > _LONGEST_NAME:
        raise DeformError(f"the name of {what}[{k}] has more than {_LONGEST_NAME} characters.")
    return made


def _check_mask(data: Any, where: str) -> None:
    """Refuse a mask that a few bytes would blow up to more pixels than a picture has."""
    region = data.get("region") if isinstance(data, dict) else None
    sizes = region.get("shape") if isinstance(region, dict) else None
    if isinstance(sizes, list) and all(isinstance(n, int) for n in sizes) and prod(sizes) > MOST_PIXELS:
        raise DeformError(f"{where} is a mask of {prod(sizes)} pixels; a picture takes {MOST_PIXELS} at most.")


class ShapesTrait(traitlets.TraitType[tuple[Any, ...], Any]):
    """Cuts or rigid parts, a tuple of :class:`~deformnb.rbf.cuts.Cut` or :class:`~deformnb.rbf.rigid.RigidPart`.

    Plain data is taken as well.
    """

    def __init__(self, what: str) -> None:
        super().__init__((), help=f"{what} of the picture")
        self._what = what
        self.tag(sync=True, to_json=lambda value, widget: shapes_to_json(what, value))

    def validate(self, obj: Any, value: Any) -> tuple[Any, ...]:
        return checked_shapes(self._what, value)


def shapes_from_page(content: dict[str, Any], next_id: int = 0) -> ShapesMessage:
    """Parse a message about shapes, and points if it has some; DeformError for anything wrong in it."""
    sender, seq = header(content)
    check_size(content, LONGEST_EDIT)
    what, kind, joins = content.get("what"), content.get("kind"), content.get("joins", False)
    if what not in _SORTS or not isinstance(kind, str) or not 1 <= len(kind) <= _LONGEST_KIND:
        raise DeformError("an edit of shapes needs its sort and its kind.")
    if not isinstance(joins, bool):
        raise DeformError("whether an edit of shapes joins the one before must be true or false.")
    points = points_from_json(content["points"], next_id) if "points" in content else None
    return ShapesMessage(sender, seq, what, kind, checked_shapes(what, content.get("shapes")), points, joins)


_LOG = logging.getLogger(__name__)

# A message of the front end is small; only a screenshot is larger: 4096 x 4096 pixels of a noisy picture as PNG.
LONGEST_TEXT = 200
_LARGEST_PICTURE = 2**26

MEASURED = ("drag_ms", "full_ms", "passes", "frames", "scale", "width", "height", "received", "edits", "edit_ms")
"""Measurements that a front end sends."""


def text(value: Any) -> str:
    """The name of a front end's view."""
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError("a view without a name")
    return value


def whole(value: Any, low: int, high: int) -> int:
    """A whole number within limits."""
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"a number that is not whole and between {low} and {high}")
    return value


def picture(buffers: list[Any]) -> bytes:
    """The one PNG of a message."""
    png = bytes(buffers[0]) if len(buffers) == 1 and memoryview(buffers[0]).nbytes <= _LARGEST_PICTURE else b""
    if not png.startswith(b"\x89PNG\r\n\x1a\n"):
        raise ValueError("a picture that is no PNG or too large")
    return png


def measured(content: dict[str, Any]) -> dict[str, float]:
    """The finite numbers among :data:`MEASURED`."""
    numbers = {name: float(content[name]) for name in MEASURED if isinstance(content.get(name), int | float)}
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


@contextmanager
def dropping(what: str) -> Iterator[None]:
    """Take a message of a front end: a mistake is logged and dropped, never raised into the front end's channel."""
    try:
        yield
    except (traitlets.TraitError, ValueError, TypeError, KeyError) as error:
        _LOG.warning("%s of the page was dropped: %s", what, error)


def take_traits(said: Any, of_page: Collection[str], put: Callable[[dict[str, Any]], Any]) -> None:
    """Put the trait values that a front end sends, one by one: a wrong one is logged, dropped, and costs no other.

    Parameters
    ----------
    said : values by name; of_page : the names a front end may decide on.
    """
    for name, value in dict(said).items():
        with dropping("a trait"):
            if name not in of_page:
                raise ValueError(f"the page does not decide on {str(name)[:LONGEST_TEXT]!r}")
            put({name: value})
