"""All moments of an animation in one array whose third axis is time (section 5 of the paper, Fig. 5).

A displacement in space for every time step would be expensive. Each comes from one over a plane by replication, so the
maps of all time steps are stored one behind the other, as ONE map of three dimensions, and time is looked up in it as a
depth would be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.extrusion import Extrusion, Weights
from deformnb.fields import DisplacementField
from deformnb.plane import Plane, Raster
from deformnb.volume import Grid


@dataclass(frozen=True, eq=False)
class TimeMaps:
    """Backward displacements over a plane at equal steps of time.

    Parameters
    ----------
    values : (T, nv, nu, 2) float32, components a, b, physical units; the first at time 0, the last at ``duration``.
    raster : of the samples on the plane.
    plane : the plane of the picture.
    depth : depths of the first and the last slice along the plane's normal, as in
        :class:`~deformnb.extrusion.Extrusion`.
    weights : knots and weights along the normal; of replication, or of a curve that does not change with time.
    duration : seconds.

    Notes
    -----
    Frame k is the moment k duration / (T - 1). Between two frames the maps are blended linearly; before the first and
    after the last nothing changes. As a texture, frame k lies at the coordinate (k + 1/2) / T, in the middle of its
    texel, and a card that clamps to the edge and blends linearly makes exactly the same.

    Examples
    --------
    >>> from deformnb.extrusion import replicate
    >>> plane, raster = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), Raster((8, 8), (1.0, 1.0), (0.0, 0.0))
    >>> maps = TimeMaps(np.zeros((5, 8, 8, 2), np.float32), raster, plane, (0.0, 9.0), replicate(), 2.0)
    >>> maps.coordinate(0.0), maps.coordinate(1.0), maps.coordinate(2.0)
    (0.1, 0.5, 0.9)
    """

    values: NDArray[np.float32]
    raster: Raster
    plane: Plane
    depth: tuple[float, float]
    weights: Weights
    duration: float

    def __post_init__(self) -> None:
        if self.values.ndim != 4 or not len(self.values) or self.values.shape[1:] != (*self.raster.shape, 2):
            raise DeformError(f"maps over time have the shape (T, {self.raster.shape[0]}, {self.raster.shape[1]}, 2), "
                              f"got {self.values.shape}.")
        if not (np.isfinite(self.duration) and self.duration >= 0):
            raise DeformError(f"the duration must be seconds from 0 on, got {self.duration}.")

    def __len__(self) -> int:
        return len(self.values)

    @property
    def times(self) -> NDArray[np.float64]:
        """The moment of every frame in seconds."""
        return np.linspace(0.0, self.duration, len(self))

    @property
    def nbytes(self) -> int:
        """Size of the array."""
        return int(self.values.nbytes)

    def full_bytes(self, grid: Grid) -> int:
        """What the same frames would take as displacements of every voxel of a grid, in float32."""
        return len(self) * 3 * 4 * int(np.prod(grid.shape))

    def position(self, time: float) -> float:
        """Time as a fractional number of frames, clamped to the first and the last."""
        last = len(self) - 1
        return float(np.clip(time / self.duration * last, 0, last)) if self.duration > 0 else 0.0

    def coordinate(self, time: float) -> float:
        """Time as a texture coordinate from 0 to 1: frame k lies at (k + 1/2) / T."""
        return (self.position(time) + 0.5) / len(self)

    def at(self, time: float) -> DisplacementField:
        """The map over the plane at a moment, blended from the two frames beside it."""
        p = self.position(time)
        k = min(int(p), len(self) - 2) if len(self) > 1 else 0
        share = np.float32(p - k)
        if share == 0:
            return DisplacementField(self.values[k], self.raster)
        return DisplacementField((1 - share) * self.values[k] + share * self.values[k + 1], self.raster)

    def field(self, time: float) -> Extrusion:
        """The displacement in space at a moment."""
        return Extrusion(self.plane, self.depth, (self.at(time),), *self.weights)


def covering_raster(plane: Plane, grid: Grid, size: int | None = None) -> Raster:
    """Nodes over all of a plane that the box of a grid covers, the outermost on its edges.

    Parameters
    ----------
    size : nodes along the longer side; default is one for every voxel.
    """
    at = plane.to_plane(grid.corners())[:, :2]
    low, extent = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    pitch = min(grid.spacing) if size is None else float(extent.max()) / max(1, size - 1)
    nu, nv = (max(2, int(np.ceil(round(float(e) / pitch, 6))) + 1) for e in extent)
    return Raster((nv, nu), (float(extent[0]) / (nu - 1), float(extent[1]) / (nv - 1)), (float(low[0]), float(low[1])))
