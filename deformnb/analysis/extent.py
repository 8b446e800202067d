"""Field of view: the size of the box that the deformed foreground needs, and the sides on which it leaves its box.

The volume's box is where the foreground was, not where it moves: voxels that are dragged out of it are cut off, unless
the result gets a larger grid. The extent is found in both directions. Forwards, the corners of small boxes around all
foreground at the surface are followed through the map, which is exact. Backwards, the nodes of a lattice around that
extent are sampled in the foreground: they find the second copy of the tissue that a fold shows, and the corners
are followed from there too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import determinant, one_plus
from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.newton import map_of, newton
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import find_foreground_voxels, leaving_voxels, side_names
from deformnb.warping.points import warp_points

MOST = 8.0
"""A box is made as large as this many times the voxels of the volume, and no larger."""

# Boxes along the longest axis: enough that their corners are close to the foreground, few enough to be followed at
# once.
_BLOCKS = 16

# Newton's method may end at this share of a voxel, and a box may cut off as much.
_EXACT = 0.02
_SLACK = 0.05

# Voxels more on a side that grows: a bent face may stick out between two corners, and the voxels around foreground
# fade.
_RIM = 1

# Nodes along each axis of the lattice that is sampled backwards, its margin beyond the places found, and how often
# it is rebuilt because foreground is on its edge.
_NODES = 24
_AROUND = 0.15
_ROUNDS = 8

# Newton steps of each corner from each outermost place.
_STEPS = 20

# Foreground that a fold shows apart from the rest is searched for as far away from the volume as these shares of its
# edges.
_SCALES = (0.2, 0.6, 1.8)


@dataclass(frozen=True, eq=False)
class Foreground:
    """Foreground of a volume, as small boxes of whole voxels; make it by :func:`find_foreground`.

    Parameters
    ----------
    grid : the volume's.
    block : voxels along the edge of a part of the volume; each part has at most one box, around all that is in it.
    table : [z, y, x] of the parts, the number of a part's box, or -1.
    low, high : (n, 3) corners of the boxes as indices along x, y, z, half a voxel around the voxels' centres.
    """

    grid: Grid
    block: int
    table: NDArray[np.intp]
    low: Floats
    high: Floats

    @cached_property
    def corners(self) -> Floats:
        """The corners (n, 3) of all boxes at the surface, in space: boxes among others cannot stick out."""
        there = np.pad(self.table >= 0, 1)
        inner = (slice(1, -1),) * 3
        hidden = there[inner].copy()
        for axis in range(3):
            for way in (-1, 1):
                hidden &= np.roll(there, way, axis=axis)[inner]
        rows = self.table[(self.table >= 0) & ~hidden]
        low, high = self.low[rows], self.high[rows]
        bits = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
        every = np.where(bits[None] == 1, high[:, None], low[:, None]).reshape(-1, 3)
        return self.grid.index_to_point(np.unique(every, axis=0))

    def __contains__(self, point: ArrayLike) -> bool:
        return bool(self.contains(np.asarray(point, dtype=np.float64)[None])[0])

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Test whether points (n, 3) in space are in one of the boxes."""
        at = self.grid.point_to_index(points)
        part = np.floor((np.where(np.isfinite(at), at, -1e9) + 0.5) / self.block).astype(np.int64)
        inside = ((part >= 0) & (part < np.array(self.table.shape[::-1]))).all(axis=1)
        found = np.zeros(len(at), dtype=bool)
        x, y, z = part[inside].T
        rows = self.table[z, y, x]
        near = at[inside]
        found[inside] = (rows >= 0) & (near >= self.low[rows]).all(axis=1) & (near <= self.high[rows]).all(axis=1)
        return found


def find_foreground(volume: Volume) -> Foreground:
    """Find the foreground of a volume: voxels brighter than the edge between air and tissue, or with a label.

    Examples
    --------
    >>> values = np.zeros((8, 8, 8), np.uint8)
    >>> values[2:5, 3:4, 1:7] = 200
    >>> foreground = find_foreground(Volume.from_array(values))
    >>> foreground.low.min(axis=0).tolist(), foreground.high.max(axis=0).tolist()
    ([0.5, 2.5, 1.5], [6.5, 3.5, 4.5])
    """
    there = find_foreground_voxels(volume)
    if not there.any():  # of one value throughout: all of it
        there = np.ones_like(there)
    block = max(1, -(-max(volume.shape) // _BLOCKS))
    starts = [np.arange(0, n, block) for n in volume.shape]
    low, high = (np.empty((*map(len, starts), 3)) for _ in range(2))
    occupied = np.zeros(low.shape[:3], dtype=bool)
    for axis in range(3):
        lines = there
        for other in (a for a in (2, 1, 0) if a != axis):
            lines = np.logical_or.reduceat(lines, starts[other], axis=other)
        places = np.arange(volume.shape[axis]).reshape([-1 if a == axis else 1 for a in range(3)])
        first = np.minimum.reduceat(np.where(lines, places, volume.shape[axis]), starts[axis], axis=axis)
        last = np.maximum.reduceat(np.where(lines, places, -1), starts[axis], axis=axis)
        low[..., 2 - axis], high[..., 2 - axis] = first - 0.5, last + 0.5
        occupied |= last >= 0
    table = np.full(occupied.shape, -1, dtype=np.intp)
    table[occupied] = np.arange(np.count_nonzero(occupied))
    return Foreground(volume.grid, block, table, low[occupied], high[occupied])


def reached_places(foreground: Foreground, field: AbstractField | None) -> Floats:
    """Places (n, 3) in space that deformed foreground reaches, the outermost among them.

    Parameters
    ----------
    field : backward displacements in space; None for none.

    Raises
    ------
    DeformError
        If the field is not one in space.
    """
    corners = foreground.corners
    if field is None or isinstance(field, Identity):
        return corners
    if field.dim != 3:
        raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
    moved, found = warp_points(corners, field, tolerance=_EXACT * min(foreground.grid.spacing))
    places = np.concatenate([moved[found], *_far(foreground, field)])
    for _ in range(_ROUNDS):
        before = _box(foreground, places)
        hits, at_edge = _find_foreground_nodes(
            foreground, field, *before, np.maximum(_AROUND * (before[1] - before[0]), 1.0)
        )
        places = np.concatenate([places, hits])
        if not at_edge and bool(np.all(np.abs(np.subtract(_box(foreground, places), before)) < 1.0)):
            break
    followed = np.concatenate([moved[found], _other_sheets(foreground, field, places)])
    places = np.concatenate([places, followed])
    return np.concatenate([places, _node_neighbourhood(foreground, followed, places)])


def _other_sheets(foreground: Foreground, field: AbstractField, places: Floats) -> Floats:
    """Places (n, 3) of the corners on all sheets of a map that folds, followed from the outermost places on each side.

    A corner has a place on every sheet, and following it finds one; between the nodes of a lattice the tip of another
    sheet is not seen.
    """
    if field.has_cuts or not _has_fold(field, places):  # a map that jumps has no derivative across its cuts
        return np.empty((0, 3))
    corners, tolerance, found = foreground.corners, _EXACT * min(foreground.grid.spacing), [np.empty((0, 3))]
    numbers = np.arange(len(corners))
    for _ in range(_ROUNDS):
        before, at = _box(foreground, places), foreground.grid.point_to_index(places)
        outer = places[np.unique(np.concatenate([at.argmin(axis=0), at.argmax(axis=0)]))]
        for start in outer:
            y, error = newton(np.tile(start, (len(corners), 1)), corners, numbers, map_of(field), tolerance, _STEPS)
            found.append(y[error <= tolerance])
        places = np.concatenate([places, *found[-len(outer) :]])
        if bool(np.all(np.abs(np.subtract(_box(foreground, places), before)) < 1.0)):
            break
    return np.concatenate(found)


def _has_fold(field: AbstractField, places: Floats) -> bool:
    """Check whether det J of the map has both signs at the places (n, 3)."""
    det = determinant(one_plus(np.moveaxis(field.jacobian(places), 0, -1)))
    return bool((det < 0).any() and (det > 0).any())


def _node_neighbourhood(foreground: Foreground, followed: Floats, places: Floats) -> Floats:
    """Two corners of the box of places, a cell of the lattice farther where only its nodes have found foreground."""
    (first, last), (low, high) = _box(foreground, followed), _box(foreground, places)
    cell = (high - low) * (1 + 2 * _AROUND) / (_NODES - 1)
    low, high = np.where(low < first - 1, low - cell, low), np.where(high > last + 1, high + cell, high)
    return foreground.grid.index_to_point(np.stack([low, high]))


def _far(foreground: Foreground, field: AbstractField) -> Iterator[Floats]:
    """Coarse places of tissue seen around the volume, at several scales: a fold shows it in separate places."""
    counts = np.array(foreground.grid.shape[::-1], dtype=np.float64)
    for share in _SCALES:
        yield _find_foreground_nodes(foreground, field, np.full(3, -0.5), counts - 0.5, share * counts)[0]


def _box(foreground: Foreground, places: Floats) -> tuple[Floats, Floats]:
    at = foreground.grid.point_to_index(places if len(places) else foreground.corners)
    return at.min(axis=0), at.max(axis=0)


def _lattice(foreground: Foreground, low: Floats, high: Floats) -> Floats:
    lines = [np.linspace(a, b, _NODES) for a, b in zip(low, high, strict=True)]
    return foreground.grid.index_to_point(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3))


def _find_foreground_nodes(
    foreground: Foreground, field: AbstractField, low: Floats, high: Floats, around: Floats
) -> tuple[Floats, bool]:
    """The nodes of a lattice around a box at which foreground is seen, and whether it is seen on the lattice's edge."""
    nodes = _lattice(foreground, low - around, high + around)
    seen = foreground.contains(nodes + field.displacement(nodes)).reshape((_NODES,) * 3)
    at_edge = any(bool(np.take(seen, (0, -1), axis=axis).any()) for axis in range(3))
    return nodes[seen.ravel()], at_edge


@dataclass(frozen=True)
class FieldOfView:
    """The box that deformed foreground needs.

    Parameters
    ----------
    grid : the volume's own lattice of voxels, with as many more on each side as it takes.
    is_limited : whether it takes more than may be, so that some foreground is cut off still.
    """

    grid: Grid
    is_limited: bool = False


def field_of_view(volume: Volume | Foreground, field: AbstractField | None, *, most: float = MOST) -> FieldOfView:
    """The volume's grid, made as much larger as deformed foreground needs, by whole voxels; it is never made smaller.

    Parameters
    ----------
    volume : or its :func:`find_foreground`, which takes the longest for a large volume and stays the same.
    field : backward displacements in space.
    most : how many times the voxels of the volume it may have; larger boxes are reduced equally on all sides.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.document.deformation import Deformation
    >>> volume = Volume.from_array(np.full((8, 8, 8), 200, np.uint8))
    >>> shifted = Deformation.from_picture_points(volume, "+y", ControlPoints.from_arrays([[0, 0]], [[3, 0]]),
    ...                                  trend="translation")
    >>> seen = field_of_view(volume, shifted.field(volume.grid))
    >>> seen.grid.shape, seen.grid.origin, seen.is_limited
    ((8, 8, 12), (0.0, 0.0, 0.0), False)
    """
    if not (np.isfinite(most) and most >= 1):
        raise DeformError(f"a field of view has at least as many voxels as the volume, got {most!r} times as many.")
    foreground = volume if isinstance(volume, Foreground) else find_foreground(volume)
    at = foreground.grid.point_to_index(reached_places(foreground, field))
    last = np.array(foreground.grid.shape[::-1]) - 1
    # Far beyond what may be is as good as infinity, and no whole number.
    bound = 1e3 * most * (last + 1)
    low, high = np.clip(at.min(axis=0), -bound, 0), np.clip(at.max(axis=0), last, bound)
    before = np.maximum(0, -np.floor(low + 0.5 + _SLACK)).astype(np.int64)
    after = np.maximum(0, np.ceil(high - 0.5 - _SLACK) - last).astype(np.int64)
    before, after = (more + _RIM * (more > 0) for more in (before, after))
    share = _share(foreground.grid.shape, before, after, most)
    before, after = (np.floor(share * more).astype(np.int64) for more in (before, after))
    return FieldOfView(_padded(foreground.grid, before, after), share < 1)


def _share(shape: tuple[int, int, int], before: Any, after: Any, most: float) -> float:
    """The largest share of the growth that leaves no more than ``most`` times the voxels; 1 if all of it does."""
    counts = np.array(shape[::-1], dtype=np.float64)

    def fits(share: float) -> bool:
        return bool((counts + np.floor(share * before) + np.floor(share * after)).prod() <= most * counts.prod())

    low, high = 0.0, 1.0
    if fits(high):
        return high
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _padded(grid: Grid, before: Any, after: Any) -> Grid:
    if not (np.any(before) or np.any(after)):
        return grid
    x, y, z = (int(-n) for n in before)
    counts = np.array(grid.shape[::-1]) + before + after
    return grid.crop((z, y, x), (int(counts[2]), int(counts[1]), int(counts[0])))


def padded(grid: Grid, margin: ArrayLike) -> Grid:
    """A grid with a margin on all sides, as whole voxels of its lattice.

    Parameters
    ----------
    margin : a length or (x, y, z), rounded up to whole voxels; negative takes away.

    Examples
    --------
    >>> padded(Grid((4, 4, 4), (1, 1, 2)), 1.5).shape
    (6, 8, 8)
    """
    lengths = np.asarray(margin, dtype=np.float64)
    if lengths.shape not in ((), (3,)) or not np.isfinite(lengths).all():
        raise DeformError(f"a margin is one length or three (x y z), got {margin!r:.60}.")
    voxels = np.ceil(np.round(lengths / np.asarray(grid.spacing), 6)).astype(np.int64)
    if (np.array(grid.shape[::-1]) + 2 * voxels < 1).any():
        raise DeformError(f"a margin of {margin!r:.60} leaves nothing of a box of {grid.lengths}.")
    return _padded(grid, voxels, voxels)


def exceeded_sides(places: Floats, box: Grid) -> tuple[str, ...]:
    """The sides of a box where the foreground leaves it, in words; none if all of it stays inside.

    Parameters
    ----------
    places : what :func:`reached_places` found.
    box : what can be seen.

    Examples
    --------
    >>> exceeded_sides(np.array([[2.0, 2.0, 2.0], [9.5, 2.0, 2.0]]), Grid((4, 4, 4)))
    ('left side (L)',)
    """
    at, counts, most = box.point_to_index(places), np.array(box.shape[::-1]), leaving_voxels(box)
    over = np.stack([-0.5 - at.min(axis=0) > most, at.max(axis=0) - (counts - 0.5) > most], axis=1)
    return tuple(name for name, leaves in zip(side_names(box), over.ravel(), strict=True) if leaves)
