"""Cuts and rigid parts as messages and traits of editors have them: the plain data of documents."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec
import traitlets
from msgspec import UNSET, Meta, Struct, UnsetType

from deformnb.document.json_regions import cut_from_data, cut_to_data, motion_from_data, part_from_data, part_to_data
from deformnb.errors import DeformError
from deformnb.rbf.cuts import MOST_CUTS, Cut
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.widgets.messages.record import LONGEST_NAME, OBJECTS, Finite, Place2, convert, stand_in

MOST_PARTS = 32
"""Rigid parts of an editor at most."""

MOST_PIXELS = 2**24
"""Pixels of a mask that is given as plain data at most."""

MOST_VOXELS = 2**27
"""The same of a mask in space."""

ShapeKind: TypeAlias = Literal["cuts", "parts"]

_Name = Annotated[str, Meta(max_length=LONGEST_NAME)]


_FLAT = {"typescript": "[number, number]"}

Place: TypeAlias = Annotated[list[Finite], Meta(min_length=2, max_length=3, extra=_FLAT)]
"""A place on a picture, or of shapes in space one with a third coordinate, which the front end reads by itself."""


class PolygonData(Struct, frozen=True, kw_only=True, tag_field="kind", tag="polygon"):
    """The region within a closed outline."""

    vertices: list[Place2]


class LineData(Struct, frozen=True, kw_only=True, tag_field="kind", tag="line"):
    """The region on the left of an open line, which continues without end."""

    vertices: list[Place2]
    stops: Annotated[
        Annotated[list[bool], Meta(min_length=2, max_length=2)] | UnsetType,
        Meta(description="whether a cut along it stops at its first and at its last vertex; left out for neither"),
    ] = UNSET


class HalfSpaceData(Struct, frozen=True, kw_only=True, tag_field="kind", tag="half_space"):
    """A half plane, or a half of space; the normal points out of it."""

    point: Place
    normal: Place


class MaskData(Struct, frozen=True, kw_only=True, tag_field="kind", tag="mask"):
    """The pixels or voxels of a region."""

    shape: Annotated[
        list[int],
        Meta(min_length=2, max_length=3, description="rows and columns", extra=_FLAT),
    ]
    spacing: Annotated[list[Finite], Meta(extra=_FLAT)]
    origin: Annotated[list[Finite], Meta(extra=_FLAT)]
    direction: list[Finite] | UnsetType = UNSET
    bits: Annotated[str, Meta(description="base64 of zlib of eight pixels to a byte, the first in the highest bit")]


RegionData: TypeAlias = PolygonData | LineData | HalfSpaceData | MaskData


class MotionData(Struct, frozen=True, kw_only=True):
    """A forward motion y = matrix x + shift."""

    matrix: Annotated[
        list[Place],
        Meta(
            min_length=2,
            max_length=3,
            description="two rows, in space three",
            extra={"typescript": "[[number, number], [number, number]]"},
        ),
    ]
    shift: Place


class AbstractShapeData(Struct, frozen=True, kw_only=True):
    """A region with a name."""

    name: _Name = ""
    enabled: bool = True
    region: RegionData


class CutData(AbstractShapeData, frozen=True, kw_only=True):
    """A cut: the region is deformed by its own points alone."""


class PartData(AbstractShapeData, frozen=True, kw_only=True):
    """A rigid part."""

    weight: Annotated[str, Meta(max_length=LONGEST_NAME, description="name of the weight")] = "saturated"
    reach: Annotated[Finite | None, Meta(description="of its motion into its surroundings; null is automatic")] = None
    motion: Annotated[MotionData | None, Meta(description="null is at rest")] = None
    pivot: Annotated[
        Place | UnsetType | None,
        Meta(description="place about which it is turned, before its motion; null is the middle of its region"),
    ] = UNSET


class Shapes(tuple[Any, ...]):
    """Cuts or rigid parts of a message: plain data, which :func:`checked_shapes` makes objects of."""

    __slots__ = ()


# A cut is read as a part with the fields of a cut.
_SHAPES: Any = Annotated[list[PartData], Meta(extra={"typescript": "(CutData | PartData)[]"})]
OBJECTS.update({Shapes: (_SHAPES, lambda data: Shapes(convert(data, _SHAPES)))})

if TYPE_CHECKING:
    Motion: TypeAlias = RigidMotion
else:
    Motion = stand_in(RigidMotion, MotionData, motion_from_data)


_SORTS: dict[str, tuple[Any, Any, Any, Any, int]] = {
    "cuts": (Cut, CutData, cut_from_data, cut_to_data, MOST_CUTS),
    "parts": (RigidPart, PartData, part_from_data, part_to_data, MOST_PARTS),
}


def place_of(index: int, shape: dict[str, Any], data: Sequence[dict[str, Any]]) -> int | None:
    """Index in the current list of the shape that the front end has chosen; None if it is there no more.

    Parameters
    ----------
    index : in the front end's list.
    shape : as much of it as identifies it.
    data : the current shapes.

    Examples
    --------
    >>> place_of(0, {"name": "b"}, [{"name": "a"}, {"name": "b"}])
    1
    """
    places = [k for k, other in enumerate(data) if _fits(other, shape)]
    return min(places, key=lambda k: abs(k - index), default=None)


def _fits(shape: Any, described: Any) -> bool:
    """Check whether a shape has all the given properties."""
    if isinstance(described, dict) and isinstance(shape, dict):
        return bool(described) and all(name in shape and _fits(shape[name], value) for name, value in described.items())
    return bool(shape == described)


def track_index(before: Sequence[Any], after: Sequence[Any], index: int) -> int | None:
    """Index of a shape after an edit of the list, from that before; None if it is gone.

    A shape is the same if it is equal, or the only one that was changed. shapes.js follows by the same rule.

    Examples
    --------
    >>> [track_index("abc", after, k) for after, k in (("ac", 2), ("cab", 2), ("aXc", 1), ("ac", 1))]
    [1, 0, 1, None]
    """
    if not 0 <= index < len(before):
        return None
    places = [k for k, shape in enumerate(after) if shape == before[index]]
    if places:
        return min(places, key=lambda k: abs(k - index))
    changed = [k for k, (old, new) in enumerate(zip(before, after, strict=False)) if old != new]
    return index if len(before) == len(after) and changed == [index] else None


def checked_shapes(what: str, given: Any, dim: int | None = None) -> tuple[Any, ...]:
    """Cuts or rigid parts, as they are or as plain data of the front end or a document.

    Parameters
    ----------
    dim : which they must have, 2 on a picture or 3 in space; None for either.

    Raises
    ------
    DeformError
        Naming the shape that is none, has another dimension, or crosses itself.

    Examples
    --------
    >>> checked_shapes("cuts", [{"region": {"kind": "line", "vertices": [[0, 1], [9, 1]]}}])
    (Cut(region=Line(vertices=((0.0, 1.0), (9.0, 1.0)), stops=(False, False)), name='', enabled=True),)
    """
    kind, _, _, _, most = _SORTS[what]
    if not isinstance(given, list | tuple) or len(given) > most:
        raise DeformError(f"the {what} must be a list of at most {most}.")
    made = tuple(shape if isinstance(shape, kind) else _read(what, k, shape) for k, shape in enumerate(given))
    for k, shape in enumerate(made):
        if dim is not None and shape.region.dim != dim:
            raise DeformError(
                f"{what}[{k}] is in space; on a picture take the silhouette(plane) of its mask."
                if dim == 2
                else f"{what}[{k}] is on a picture; a step in space needs a mask of voxels or a half space."
            )
    return made


def shapes_to_json(what: str, shapes: Sequence[Any]) -> list[dict[str, Any]]:
    """Cuts or rigid parts as the front end gets them."""
    return [_SORTS[what][3](shape) for shape in shapes]


def _read(what: str, k: int, data: Any) -> Any:
    if isinstance(data, PartData):
        data = {name: v for name, v in msgspec.to_builtins(data).items() if name in _SORTS[what][1].__struct_fields__}
    _check_mask(data, f"{what}[{k}]")
    made = _SORTS[what][2](data, f"{what}[{k}]")
    if what == "parts" and made.region.kind == "line":
        raise DeformError(f"{what}[{k}] is a line, which has no inside to stay rigid; use a polygon or a half space.")
    if len(made.name) > LONGEST_NAME:
        raise DeformError(f"the name of {what}[{k}] has more than {LONGEST_NAME} characters.")
    return made


def _check_mask(data: Any, where: str) -> None:
    """Refuse a mask that a few bytes would blow up to more pixels than a picture or a volume has."""
    region = data.get("region") if isinstance(data, dict) else None
    sizes = region.get("shape") if isinstance(region, dict) else None
    if not isinstance(sizes, list) or not all(isinstance(n, int) for n in sizes):
        return
    most, what = (MOST_PIXELS, "pixels; a picture") if len(sizes) < 3 else (MOST_VOXELS, "voxels; a step in space")
    if prod(sizes) > most:
        raise DeformError(f"{where} is a mask of {prod(sizes)} {what} takes {most} at most.")


class ShapesTrait(traitlets.TraitType[tuple[Any, ...], Any]):
    """Cuts or rigid parts, a tuple of :class:`~deformnb.rbf.cuts.Cut` or :class:`~deformnb.rbf.rigid.RigidPart`.

    Plain data is taken as well. They have the dimension ``dim``.
    """

    def __init__(self, what: str, dim: int) -> None:
        super().__init__((), help=f"{what} of the picture" if dim == 2 else f"{what} in space")
        self._what, self._dim = what, dim
        self.tag(sync=True, to_json=lambda value, widget: shapes_to_json(what, value))

    def validate(self, obj: Any, value: Any) -> tuple[Any, ...]:
        return checked_shapes(self._what, value, self._dim)
