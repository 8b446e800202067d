"""Landmarks: named places that follow a deformation, and the pairs of them that make one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.control_points import ControlPoints
from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.forward import warp_points


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Places in space, or on a picture, with names.

    Parameters
    ----------
    points : (N, 3) physical, LPS; or (N, 2).
    names : N texts; default none.
    fixed : the places that the points correspond to in another volume, as in BigWarp's files; NaN where there is none.
    active : (N,) bool, False for a landmark that is switched off.
    notes : remarks for a status line.

    Examples
    --------
    >>> marks = Landmarks([[0, 0, 0], [10, 0, 0]], ("tail", "head"), fixed=[[0, 0, 0], [12, 1, 0]])
    >>> marks.control_points().displacement.tolist()
    [[0.0, 0.0, 0.0], [-2.0, -1.0, 0.0]]
    """

    points: NDArray[np.float64]
    names: tuple[str, ...] = ()
    fixed: NDArray[np.float64] | None = None
    active: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        points = _places(self.points, "landmarks")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise DeformError(f"landmark {bad[0]} is not finite ({points[bad[0]].tolist()}); correct it.")
        fixed = None if self.fixed is None else _places(self.fixed, "fixed places of landmarks")
        names = tuple(map(str, self.names)) or ("",) * len(points)
        active = np.ones(len(points), dtype=bool) if self.active is None else np.array(self.active, dtype=bool)
        if len(names) != len(points) or active.shape != (len(points),) or (
                fixed is not None and fixed.shape != points.shape):
            raise DeformError(f"{len(points)} landmarks need as many names, switches and fixed places.")
        for name, value in (("points", points), ("names", names), ("fixed", fixed), ("active", active)):
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.points)

    def control_points(self) -> ControlPoints:
        """Pairs as control points: each place is dragged to its fixed one. What has none is left out."""
        if self.fixed is None:
            raise DeformError("these landmarks are single places, not pairs; control points need where each shall go.")
        whole = np.flatnonzero(np.isfinite(self.fixed).all(axis=1))
        assert self.active is not None
        return ControlPoints.from_arrays(
            self.points[whole], self.fixed[whole], active=self.active[whole],
            names=[self.names[k] for k in whole])


def _places(given: Any, what: str) -> NDArray[np.float64]:
    try:
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise DeformError(f"{what} must be numbers of shape (N, 3) or (N, 2).") from None
    if array.size == 0:
        array = array.reshape(0, array.shape[-1] if array.shape[-1:] in ((2,), (3,)) else 3)
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise DeformError(f"{what} must have shape (N, 3) or (N, 2), got {array.shape}.")
    return array


def warp_landmarks(landmarks: Landmarks, field: AbstractField) -> Landmarks:
    """The landmarks in the deformed volume; a note names those without a place in it, which stay where they were.

    Parameters
    ----------
    landmarks : in the space of the volume that the field deforms; their fixed places belong to another and stay.
    field : backward displacements, of the landmarks' dimension.

    Examples
    --------
    >>> from deformnb.fields import Identity
    >>> warp_landmarks(Landmarks([[1, 2, 3]]), Identity()).points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    moved, found = warp_points(landmarks.points, field)
    notes = landmarks.notes
    if not found.all():
        lost = [landmarks.names[k] or str(k) for k in np.flatnonzero(~found)]
        more = f" and {len(lost) - 5} more" if len(lost) > 5 else ""
        notes += (f"these landmarks have no place in the result and stay where they were: {', '.join(lost[:5])}{more}",)
    return replace(landmarks, points=np.where(found[:, None], moved, landmarks.points), notes=notes)
