"""Cuts and rigid parts of a picture as plain data: what an editor's traits hold and what its page says of them.

A message of the page: ``{"type": "shapes", "sender": id, "seq": n, "what": "cuts" | "parts", "kind": "add cut",
"shapes": [...]}`` with all the shapes of that sort, as :mod:`deformnb.document_regions` writes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any

import traitlets

from deformnb.cuts import MOST_CUTS, Cut
from deformnb.document_regions import cut_from_data, cut_to_data, part_from_data, part_to_data
from deformnb.errors import DeformError
from deformnb.rigid_parts import RigidPart
from deformnb.widgets.point_messages import LONGEST_EDIT, Message, check_size, header

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
    """

    what: str
    kind: str
    shapes: list[dict[str, Any]]


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


def shapes_from_page(content: dict[str, Any]) -> ShapesMessage:
    """What a message says of shapes; DeformError for anything wrong in it."""
    sender, seq = header(content)
    check_size(content, LONGEST_EDIT)
    what, kind = content.get("what"), content.get("kind")
    if what not in _SORTS or not isinstance(kind, str) or not 1 <= len(kind) <= _LONGEST_KIND:
        raise DeformError("an edit of shapes needs its sort and its kind.")
    return ShapesMessage(sender, seq, what, kind, checked_shapes(what, content.get("shapes")))
