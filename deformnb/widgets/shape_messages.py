"""Cuts and rigid parts of a picture as plain data: what an editor's traits hold and what its page says of them.

Messages by the page:

- ``{"type": "shapes", "sender": id, "seq": n, "what": "cuts" | "parts", "kind": "add cut", "shapes": [...]}`` with all
  the shapes of that sort, as :mod:`deformnb.document_regions` writes them, and ``points`` where the same edit has
  changed those too.
- ``{"type": "choose", "sender": id, "seq": n, "what": "parts", "index": 1, "shape": {...}}`` when one is chosen there,
  with the shape but for the pixels of a mask: its place may be another one by now. ``what`` is null for none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Any

import traitlets

from deformnb.control_points import ControlPoints
from deformnb.cuts import MOST_CUTS, Cut
from deformnb.document_regions import cut_from_data, cut_to_data, part_from_data, part_to_data
from deformnb.errors import DeformError
from deformnb.rigid_parts import RigidPart
from deformnb.widgets.point_messages import LONGEST_EDIT, Message, check_size, header, points_from_json

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
    """What the page says of an edit of shapes.

    Attributes
    ----------
    what : "cuts" or "parts".
    kind : what was done, in words: "add cut", "move part", "undo".
    shapes : all the shapes of that sort after the edit, as plain data.
    points : all control points after the edit, where it has changed them too; else None.
    """

    what: str
    kind: str
    shapes: list[dict[str, Any]]
    points: ControlPoints | None = None


@dataclass(frozen=True)
class ChooseMessage(Message):
    """What the page says of the shape that is chosen there.

    Attributes
    ----------
    what : "cuts" or "parts"; empty for none.
    index : its place in the page's list.
    shape : as much of it as tells it from others.
    """

    what: str
    index: int = 0
    shape: dict[str, Any] = field(default_factory=dict)


def choice_from_page(content: dict[str, Any]) -> ChooseMessage:
    """What a message says of the chosen shape; DeformError for anything wrong in it."""
    sender, seq = header(content)
    check_size(content, LONGEST_EDIT)
    what, index, shape = content.get("what"), content.get("index", 0), content.get("shape")
    if what is None:
        return ChooseMessage(sender, seq, "")
    if what not in _SORTS or not isinstance(index, int) or not isinstance(shape, dict):
        raise DeformError("a choice needs the sort of the shape, its place and the shape.")
    return ChooseMessage(sender, seq, what, index, shape)


def place_of(choice: ChooseMessage, shapes: Sequence[dict[str, Any]]) -> int | None:
    """Where the shape that the page has chosen lies in the list of now; None if it is there no more."""
    places = [k for k, shape in enumerate(shapes) if _fits(shape, choice.shape)]
    return min(places, key=lambda k: abs(k - choice.index), default=None)


def _fits(shape: Any, told: Any) -> bool:
    """Whether a shape has all that was told of it."""
    if isinstance(told, dict) and isinstance(shape, dict):
        return bool(told) and all(name in shape and _fits(shape[name], value) for name, value in told.items())
    return bool(shape == told)


def followed(before: Sequence[Any], after: Sequence[Any], index: int) -> int | None:
    """Where the shape at a place of a list is after an edit of the list; None if it is gone.

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


def checked_shapes(what: str, given: Any) -> list[dict[str, Any]]:
    """Cuts or rigid parts, plain or not, as plain data of shapes that exist.

    Raises
    ------
    DeformError
        Naming the shape that is none, lies in space, or crosses itself.

    Examples
    --------
    >>> checked_shapes("cuts", [{"region": {"kind": "line", "vertices": [[0, 1], [9, 1]]}}])
    [{'name': '', 'enabled': True, 'region': {'kind': 'line', 'vertices': [[0.0, 1.0], [9.0, 1.0]]}}]
    """
    kind, _, write, most = _SORTS[what]
    if not isinstance(given, list | tuple) or len(given) > most:
        raise DeformError(f"the {what} must be a list of at most {most}.")
    return [write(shape if isinstance(shape, kind) else _read(what, k, shape)) for k, shape in enumerate(given)]


def shapes_of(what: str, data: list[dict[str, Any]]) -> tuple[Any, ...]:
    """The shapes of plain data."""
    return tuple(_SORTS[what][1](shape, f"{what}[{k}]") for k, shape in enumerate(data))


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


class ShapesTrait(traitlets.List[dict[str, Any]]):
    """Cuts or rigid parts as plain data; takes :class:`~deformnb.cuts.Cut` and the like as well."""

    def __init__(self, what: str) -> None:
        super().__init__(help=f"{what} of the picture as plain data")
        self._what = what
        self.tag(sync=True)

    def validate(self, obj: Any, value: Any) -> Any:
        return checked_shapes(self._what, value)


def shapes_from_page(content: dict[str, Any], next_id: int = 0) -> ShapesMessage:
    """What a message says of shapes, and of points if it has some; DeformError for anything wrong in it."""
    sender, seq = header(content)
    check_size(content, LONGEST_EDIT)
    what, kind = content.get("what"), content.get("kind")
    if what not in _SORTS or not isinstance(kind, str) or not 1 <= len(kind) <= _LONGEST_KIND:
        raise DeformError("an edit of shapes needs its sort and its kind.")
    points = points_from_json(content["points"], next_id) if "points" in content else None
    return ShapesMessage(sender, seq, what, kind, checked_shapes(what, content.get("shapes")), points)
