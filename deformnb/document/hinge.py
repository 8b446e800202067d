"""A hinge: two rigid parts of a subject on either side of a pivot, one of which turns about it.

The parts keep away from the pivot in the shape of a V, so that they do not meet when one turns; between them the fit is
smooth. The front end does the same in ``frontend/src/maths/hinge.ts``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from deformnb._typing import Floats
from deformnb.checks import check_arguments
from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart, carry_points, without_conflicts

JOINT = 0.25
"""Of the half width: distance of each part from the pivot, on the axis."""

OPENING = 1.2
"""Of the half width: how much farther a part begins at its edges; so they turn by a right angle without meeting."""

_LARGEST = 90.0  # degrees


def hinge_outlines(pivot: ArrayLike, end: ArrayLike, half_width: float) -> tuple[Floats, Floats]:
    """Corners (5, 2) of the part that turns, from a pivot towards an end, and of the part that stays, as long.

    Examples
    --------
    >>> turning, staying = hinge_outlines((0, 0), (10, 0), 2.0)
    >>> turning.round(2).tolist()
    [[0.5, 0.0], [2.9, 2.0], [10.0, 2.0], [10.0, -2.0], [2.9, -2.0]]
    """
    middle, far = np.asarray(pivot, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(far - middle))
    along = (far - middle) / length
    across = np.array([-along[1], along[0]])
    near = JOINT * half_width
    edge = near + OPENING * half_width
    far_end = max(length, edge + 0.5 * half_width)
    corners = np.array(
        [(near, 0), (edge, half_width), (far_end, half_width), (far_end, -half_width), (edge, -half_width)]
    )
    return (
        middle + corners[:, :1] * along + corners[:, 1:] * across,
        middle - corners[:, :1] * along + corners[:, 1:] * across,
    )


@check_arguments
def hinge(step: Step, pivot: ArrayLike, end: ArrayLike, angle: float, half_width: float) -> Step:
    """The step with a limb turned about a pivot: two rigid parts, and a smooth joint between them.

    Parameters
    ----------
    step : on a picture.
    pivot : place (a, b) of the joint, in the coordinates of the picture.
    end : place (a, b) at the end of the side that turns.
    angle : degrees, from the a-axis to the b-axis: clockwise in the picture.
    half_width : of the limb, in the unit of the volume.

    Returns
    -------
    The step with the parts "turns" and "stays". Control points in them go with them.

    Raises
    ------
    DeformError
        For a step in space, a pivot at the end, an angle beyond a right one, or parts that others overlap.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.volume.plane import Plane
    >>> step = Step((ControlPoints.empty(2),), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)))
    >>> step = hinge(step, (0, 0), (50, 0), 30.0, 8.0)
    >>> [part.name for part in step.parts]
    ['turns', 'stays']
    """
    if step.plane is None:
        raise DeformError("a hinge is set on a picture, and this step has its points in space.")
    if not abs(angle) <= _LARGEST:
        raise DeformError(
            f"a hinge turns by {_LARGEST:g} degrees at most, got {angle:g}; turn further by another step."
        )
    if not (np.isfinite(half_width) and half_width > 0):
        raise DeformError(f"the half width of a limb must be a positive length, got {half_width!r}.")
    at = np.asarray(pivot, dtype=np.float64)
    if at.shape != (2,) or np.shape(end) != (2,) or np.array_equal(at, end):
        raise DeformError("a hinge needs a pivot (a, b), and an end (a, b) at another place.")
    turning, staying = (Polygon(tuple(map(tuple, corners.tolist()))) for corners in hinge_outlines(at, end, half_width))
    place = (float(at[0]), float(at[1]))
    motion = RigidMotion.turn(angle, about=place) if angle else None
    parts = (
        *step.parts,
        RigidPart(turning, motion, name="turns", pivot=place),
        RigidPart(staying, name="stays"),
    )
    before = (*parts[:-2], replace(parts[-2], motion=None), parts[-1])
    maps = tuple(without_conflicts(carry_points(points, before, parts), parts, "carry") for points in step.maps)
    return replace(step, maps=maps, parts=parts)
