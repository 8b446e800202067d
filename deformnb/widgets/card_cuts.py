"""Cuts as a graphics card reads them: for every region between cuts its own maps, and how far it is to each cut.

A map is never interpolated across a cut. The card decides at every sample anew which region is seen there, by the rule
of :mod:`deformnb.cuts`; regions without control points are sent as such, with no displacement.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.cuts import Decoupled, Sides, sides_of
from deformnb.document_regions import region_to_data
from deformnb.extrusion import Extrusion, replicate
from deformnb.fields import AbstractField, Identity
from deformnb.plane import Plane, Raster
from deformnb.volume import Grid

MOST_REGIONS = 32
"""Places that the shaders have for regions."""

# Distances along the longer side. Straight lines are exact at any number; a corner of a polygon is rounded by less than
# half of such a step, a quarter of a millimetre on a body.
_STEPS = 512

# Places of origin beyond the box are asked for too, where the last samples would go on as they are.
_MARGIN = 0.125

# Nodes at which is looked which regions there are: small ones that nobody has put a point into must be found as well.
_COARSE = 256


@dataclass(frozen=True, eq=False)
class CutPlane:
    """The last step over a plane: one extrusion for each region that can be seen.

    Parameters
    ----------
    regions : extrusions over the same plane with the same weights; one alone where nothing is cut.
    sides : which region each belongs to; nothing where nothing is cut.
    cut : the field they are of, if it is cut.
    """

    regions: tuple[Extrusion, ...]
    sides: tuple[Sides, ...] = ()
    cut: Decoupled | None = None

    @property
    def first(self) -> Extrusion:
        """An extrusion that says what all have in common: plane, depth and weights."""
        return self.regions[0]

    @property
    def count(self) -> int:
        """Maps of each region."""
        return len(self.first.maps)


def cut_plane(field: AbstractField, most: int) -> CutPlane | None:
    """A field as regions over one plane, or None if it is something else or has more than ``most`` maps.

    Regions without points are not in it yet; see :func:`with_still_regions`.
    """
    if isinstance(field, Extrusion):
        return CutPlane((field,)) if len(field.maps) <= most else None
    if not isinstance(field, Decoupled) or field.plane is None:
        return None
    if not field.fields:  # cuts on a picture without points: nothing moves, at any depth
        return CutPlane((_still(field.plane),), ((False,) * len(field.regions),), field)
    first = field.fields[0]
    regions = [f for f in field.fields if isinstance(f, Extrusion)]
    if not isinstance(first, Extrusion) or len(regions) < len(field.fields) or first.plane != field.plane:
        return None
    if not all(same_rule(first, other) for other in regions) or len(regions) * len(first.maps) > most:
        return None
    return CutPlane(tuple(regions), field.sides, field)


def _still(plane: Plane) -> Extrusion:
    return Extrusion(plane, (0.0, 1.0), (Identity(2),), *replicate())


def same_rule(a: Extrusion, b: Extrusion) -> bool:
    """Whether two extrusions have plane, depths and weights in common."""
    same = a.plane == b.plane and a.depth == b.depth and len(a.maps) == len(b.maps)
    return same and np.array_equal(a.knots, b.knots) and np.array_equal(a.weights, b.weights)


def with_still_regions(plane: CutPlane, grid: Grid, most: int) -> CutPlane | None:
    """With the regions that have no points, as far as they lie in the picture; None if those are too many."""
    if plane.cut is None:
        return plane
    around = cut_raster(plane.first, grid, grid, _COARSE)
    b, a = np.meshgrid(around.rows, around.columns, indexing="ij")
    found = np.unique(sides_of(plane.cut.regions, np.stack([a.ravel(), b.ravel()], axis=-1)), axis=0)
    still = [sides for sides in map(tuple, found.tolist()) if sides not in plane.sides]
    count = len(plane.regions) + len(still)
    if count * plane.count > most or count > MOST_REGIONS:
        return None
    nothing = replace(plane.first, maps=(Identity(2),) * plane.count)
    moved = dict(zip(plane.sides, plane.regions, strict=True))
    sides = tuple(sorted([*plane.sides, *still]))  # in the same order whichever has points
    return replace(plane, regions=tuple(moved.get(side, nothing) for side in sides), sides=sides)


def cut_raster(field: Extrusion, grid: Grid, other: Grid, steps: int = _STEPS) -> Raster:
    """Nodes over the picture's plane around the boxes of both grids."""
    at = field.plane.to_plane(np.concatenate([grid.corners(), other.corners()]))[:, :2]
    size = np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    low, size = at.min(axis=0) - _MARGIN * size.max(), size + 2 * _MARGIN * size.max()
    counts = np.maximum(8, np.ceil(steps * size / size.max())).astype(int)
    return Raster((int(counts[1]), int(counts[0])), tuple(size / (counts - 1)), tuple(low))


def distances(field: Decoupled, raster: Raster) -> NDArray[np.float32]:
    """Signed distances to every cut at the nodes of a raster: (cuts, rows, columns)."""
    b, a = np.meshgrid(raster.rows, raster.columns, indexing="ij")
    at = np.stack([a, b], axis=-1)
    return np.stack([r.signed_distance(at) for r in field.regions]).astype("<f4")


def softness_of(plane: CutPlane, grid: Grid) -> float:
    """The width of the ramp at a cut, also at one that a page will draw: a voxel as it is seen on the plane."""
    if plane.cut is not None:
        return plane.cut.softness
    along = np.abs(plane.first.plane.frame[:2] @ np.asarray(grid.direction)) ** 2
    return float((along @ np.asarray(grid.spacing)).mean())


def about_cut(plane: CutPlane, raster: Raster) -> dict[str, Any]:
    """What a message says of the cuts beside their distances. ``id`` names the distances, which seldom change."""
    assert plane.cut is not None
    data = [region_to_data(r) for r in plane.cut.regions]
    name = hashlib.sha256(repr((data, raster)).encode()).hexdigest()[:16]
    return {"shape": [len(data), *raster.shape], "origin": list(raster.origin), "spacing": list(raster.spacing),
            "sides": [list(sides) for sides in plane.sides], "rule": plane.cut.rule,
            "regions": data, "id": name}
