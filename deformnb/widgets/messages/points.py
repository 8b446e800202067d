"""Control points as messages have them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from msgspec import Meta, Struct

from deformnb.errors import DeformError
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.messages.record import LONGEST_NAME, Finite, Whole, convert, stand_in

_Place = Annotated[list[Finite], Meta(min_length=2, max_length=3)]


class PointData(Struct, frozen=True, kw_only=True):
    """A control point, with two coordinates on a picture and three in space."""

    id: Whole
    name: Annotated[str, Meta(max_length=LONGEST_NAME)] = ""
    source: _Place
    target: _Place
    active: Annotated[bool, Meta(description="whether it takes part in the fit")] = True
    weight: Annotated[Finite, Meta(description="how much it counts where the fit smooths")] = 1.0
    locked: Annotated[bool, Meta(description="whether tools leave it where it is")] = False
    radius: Annotated[Finite | None, Meta(description="support radius; null is the one of all points")] = None


_POINTS: Any = Annotated[list[PointData], Meta(max_length=LARGEST_SET)]


def points_to_json(points: ControlPoints) -> list[dict[str, Any]]:
    """The list that the front end gets: each a :class:`PointData`."""
    columns = zip(
        points.ids,
        points.names,
        points.source.tolist(),
        points.target.tolist(),
        points.active.tolist(),
        points.weight.tolist(),
        points.locked.tolist(),
        [None if r != r else r for r in points.radius.tolist()],  # NaN is unlike itself
        strict=True,
    )
    return [dict(zip(PointData.__struct_fields__, row, strict=True)) for row in columns]


def points_from_json(data: Any) -> ControlPoints:
    """Control points from the front end's list.

    Raises
    ------
    DeformError
        If it is not such a list: another type anywhere, a number that is not finite, an id twice, too many points.

    Examples
    --------
    >>> points_from_json([{"id": 3, "source": [0, 0], "target": [2, 1]}]).displacement.tolist()
    [[-2.0, -1.0]]
    """
    rows = convert(data, _POINTS)
    if not rows:
        return ControlPoints.empty(2)
    dims = {len(place) for r in rows for place in (r.source, r.target)}
    if len(dims) > 1:
        raise DeformError("the places of control points must have two numbers on a picture, and three in space.")
    return ControlPoints(
        np.array([r.source for r in rows], dtype=np.float64),
        np.array([r.target for r in rows], dtype=np.float64),
        tuple(r.id for r in rows),
        tuple(r.name for r in rows),
        np.array([r.active for r in rows], dtype=bool),
        np.array([r.weight for r in rows], dtype=np.float64),
        0,
        np.array([r.locked for r in rows], dtype=bool),
        np.array([np.nan if r.radius is None else r.radius for r in rows], dtype=np.float64),
    )


if TYPE_CHECKING:
    Points: TypeAlias = ControlPoints
else:
    Points = stand_in(ControlPoints, _POINTS, points_from_json)
