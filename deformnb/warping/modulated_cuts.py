"""Warping with cuts whose displacement changes with depth, on a grid along the picture's plane.

The visible region is decided at every voxel anew, since a modulated cut opens differently on every slice. All that
does not depend on depth is made once: every region's maps on one slice of voxels, and their distances to the cuts.

Both rules show the region of a place x itself, and all of it, where that moves x to a place well within itself. So only
pixels that their own region moves across a cut, or near one, are computed, on the slices where it may do so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.warping.compositions import Replacement
from deformnb.warping.node_walk import STEEPEST
from deformnb.warping.planning import Extruded, check_finite, shared_axis, to_voxels

# Groups of slices of similar weights in which pixels are sought that their own region moves across a cut, and pixels
# that are computed together.
_GROUPS, _TOGETHER = 32, 4096


@dataclass(frozen=True, eq=False)
class CutPlan:
    """A displacement that jumps along cuts, in two halves; made by :func:`plan_cut`.

    Parameters
    ----------
    apart : the displacement as if no tissue could come from another region: right wherever a cut is far.
    pixels : (2, P) rows and columns of the pixels, in the order of the two array axes across the normal, so near a cut
        that it may open or close there.
    maps : every region's maps (R, K, P, 2) there. places : (P, 2) of these pixels in the picture.
    leaves : slices along the normal, and numbers of the pixels where the cut may open or close there.
    field : whose plan this is.
    """

    apart: Extruded
    pixels: NDArray[np.intp]
    maps: NDArray[np.float32]
    places: NDArray[np.float64]
    leaves: list[tuple[slice, NDArray[np.intp]]]
    field: Decoupled

    def parts(self) -> list[tuple[slice, NDArray[np.intp]]]:
        """Slices along the normal and numbers of pixels that are computed together."""
        return [
            (depth, some[first : first + _TOGETHER])
            for depth, some in self.leaves
            for first in range(0, len(some), _TOGETHER)
        ]

    @property
    def matrix(self) -> NDArray[Any]:
        """3 x 3, from displacements (u, v, 0) to input voxels (z, y, x), of which none moves along the normal."""
        matrix = np.zeros((3, 3), self.apart.matrix.dtype)
        matrix[:, :2] = self.apart.matrix
        matrix[self.apart.normal] = 0
        return matrix

    def replacement(self, depth: slice, some: NDArray[np.intp]) -> Replacement:
        """The voxels of one of the parts, their displacements along u and v, and their opacity."""
        assert self.apart.weights is not None
        moves = _weigh(self.apart.weights[:, depth], self.maps.take(some, axis=2))
        choice, opacity = self.field.choose_in_plane(np.broadcast_to(self.places[some], moves.shape[1:]), list(moves))
        d = np.zeros((3, choice.size), np.float32)
        for k, move in enumerate(moves):
            np.copyto(d[:2], move.reshape(-1, 2).T, where=choice.ravel() == k)
        row, column = self.pixels[:, some].astype(np.int32)
        voxels = [row, column]
        voxels.insert(self.apart.normal, np.arange(depth.start, depth.stop, dtype=np.int32)[:, None])
        z, y, x = (index.ravel() for index in np.broadcast_arrays(*voxels))
        return Replacement((z, y, x), d, opacity.ravel().astype(np.float32))


def plan_cut(field: AbstractField, source: Grid, output: Grid, compute: str) -> CutPlan | None:
    """The plan of a cut field, or None where only the slow way is right: an oblique plane, no extrusion."""
    fields = _extrusions(field)
    if not fields or not isinstance(field, Decoupled):
        return None
    plane = fields[0].plane
    normal = shared_axis(plane, source, output)
    if normal is None:
        return None
    index = np.zeros((output.shape[normal], 3))
    index[:, 2 - normal] = np.arange(len(index))
    weights = check_finite(fields[0].weights_at(plane.to_plane(output.index_to_point(index))[:, 2]))
    rows, columns = _slice_coordinates(plane, output, normal)
    maps = check_finite(
        np.stack([[m.lattice_values(rows, columns, min(output.spacing)) for m in f.maps] for f in fields])
    )
    at = _outer_sum(rows, columns)
    here = np.stack([r.signed_distance(at) for r in field.regions])
    own = np.zeros(maps.shape[1:], np.float32)  # moving pixels follow the map of their own region
    for side, regional in zip(field.sides, maps, strict=True):
        is_own = np.all([(d < 0) == inside for d, inside in zip(here, side, strict=True)], axis=0)
        np.copyto(own, regional, where=is_own)
    apart = Extruded(normal, own, weights, to_voxels(plane, source, compute))
    largest = np.abs(weights).max(axis=1)
    least = field.softness / 2  # in its own region a place as deep as this is opaque
    some = np.flatnonzero(np.abs(here).min(axis=0) < STEEPEST * _reach(own, largest) + least)
    places = at.reshape(-1, 2)
    groups, leaves = _leaving(field, _take(own, some), weights, _take(here, some) < 0, places[some], least)
    kept = leaves.any(axis=0)
    numbers = [(group, np.flatnonzero(far)) for group, far in zip(groups, leaves[:, kept], strict=True)]
    some = some[kept]
    pixels = np.stack(np.unravel_index(some, at.shape[:2]))
    return CutPlan(apart, pixels, np.moveaxis(_take(maps, some), 2, 3).copy(), places[some], numbers, field)


def _take(values: NDArray[Any], some: NDArray[np.intp]) -> Any:
    """Values (..., A, B) at some of the pixels, (..., P)."""
    return values.reshape(*values.shape[:-2], -1)[..., some]


def _reach(maps: NDArray[np.float32], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """The farthest (...) that K maps (K, 2, ...) lead with weights (K,)."""
    return np.asarray(np.tensordot(weights, np.hypot(maps[:, 0], maps[:, 1]), 1))


def _extrusions(field: AbstractField) -> list[Extrusion]:
    """The fields of all regions, if they are extruded equally from the plane of the cuts; else none."""
    if not isinstance(field, Decoupled):
        return []
    found = [f for f in field.fields if isinstance(f, Extrusion) and f.plane == field.plane]
    same = all(
        np.array_equal(f.weights, found[0].weights)
        and np.array_equal(f.knots, found[0].knots)
        and f.depth == found[0].depth
        for f in found
    )
    return found if same and len(found) == len(field.fields) else []


def _slice_coordinates(plane: Plane, output: Grid, normal: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Picture coordinates of the voxels of one slice: rows (2, A) plus columns (2, B) of the two other array axes."""
    lines = []
    for axis in range(3):
        index = np.zeros((output.shape[axis], 3))
        index[:, 2 - axis] = np.arange(len(index))
        if axis != normal:
            lines.append(plane.to_plane(output.index_to_point(index))[:, :2].T)
    return lines[0], lines[1] - lines[0][:, :1]


def _outer_sum(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The places (A, B, 2) of rows (2, A) plus columns (2, B)."""
    return np.moveaxis(rows[:, :, None] + columns[:, None, :], 0, -1)


def _leaving(
    field: Decoupled,
    own: NDArray[np.float32],
    weights: NDArray[np.float32],
    inside: NDArray[np.bool_],
    places: NDArray[np.float64],
    least: float,
) -> tuple[list[slice], NDArray[np.bool_]]:
    """Groups of slices, and which of the pixels at places (P, 2) their own maps (K, 2, P), by weights (K, slices), may
    lead there to where they are less than ``least`` deep in their own region: (groups, P).

    inside : (C, P) own sides of the cuts.
    """
    count = weights.shape[1]
    size = -(-count // _GROUPS)
    groups = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    length, sides = np.hypot(own[:, 0], own[:, 1]), np.where(inside, -1.0, 1.0)
    low, high = (np.stack([end(weights[:, group], axis=1) for group in groups], axis=1) for end in (np.min, np.max))
    (led,) = _weigh((low + high) / 2, np.moveaxis(own, 1, 2)[None])
    within = least + STEEPEST * np.tensordot((high - low) / 2, length, (0, 0))
    there = [r.signed_distance(places + led) for r in field.regions]
    return groups, (sides[:, None] * there).min(axis=0) < within


def _weigh(weights: NDArray[np.float32], maps: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums (R, slices, P, 2) of maps (R, K, P, 2) by weights (K, slices)."""
    total = weights[0][:, None, None] * maps[:, 0, None]
    for k, w in enumerate(weights[1:], 1):
        total += w[:, None, None] * maps[:, k, None]
    return total
