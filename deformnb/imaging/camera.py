"""Camera of a picture of a volume in space, the same for every renderer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformnb.checks import check_fields, finite_array, short_value
from deformnb.errors import DeformError
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid


@dataclass(frozen=True)
class Camera:
    """Place, direction and extent of a picture's view.

    Parameters
    ----------
    plane : of the picture; its origin is the middle of it, its u points right, its v down and its normal away.
    height : length in space that the picture is high; in perspective, of the scene in the plane.
    distance : of the viewer from the plane in perspective; None for a parallel projection.
    """

    plane: Plane
    height: float
    distance: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if not (self.height > 0 and (self.distance is None or self.distance > 0)):
            raise DeformError(
                f"a camera needs a positive height, and a positive distance or None, got {self.height} "
                f"and {self.distance}."
            )

    def sample_distance(self, grid: Grid, rows: int, per_voxel: int = 2) -> float:
        """Distance of samples along a ray: half a voxel (a whole one makes surfaces grainy), or a pixel if larger."""
        return max(min(grid.spacing) / per_voxel, self.height / rows)


def fitting_height(grid: Grid, plane: Plane, size: tuple[int, int]) -> float:
    """The length in space that a picture of a whole grid is high.

    Parameters
    ----------
    plane : the picture's.
    size : its (width, height) in pixels.
    """
    a, b, _ = np.ptp(plane.to_plane(grid.corners()), axis=0)
    return float(max(b, a * size[1] / size[0]) * 1.02)


def check_color(color: ArrayLike) -> tuple[float, float, float]:
    """Red, green and blue as three finite numbers; DeformError for anything else."""
    red, green, blue = finite_array(color, (3,), "a colour is red, green and blue, three numbers from 0 to 1").tolist()
    return red, green, blue


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """The (width, height) of a picture in pixels; DeformError for anything else."""
    try:
        width, height = (int(n) for n in size)
        is_right = (width, height) == tuple(size) and min(width, height) >= 1
    except (TypeError, ValueError, OverflowError):
        is_right = False
    if not is_right:
        raise DeformError(f"the size of a picture is two whole numbers from 1 on, got {short_value(size)}.")
    return width, height
