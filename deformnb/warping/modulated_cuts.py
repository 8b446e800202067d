"""Warping with cuts whose displacement changes with depth, on a grid along the picture's plane.

The visible region is decided at every voxel anew, since a modulated cut opens differently on every slice. All that
does not depend on depth is made once: every region's maps on one slice of voxels, and the distances to the cuts on a
raster somewhat larger than the cuts' surroundings, read linearly where a displacement leads. Along straight cuts that
is exact, at a corner off by less than a fifth of a pixel.

Both rules show the region of a place x itself, and all of it, where that moves x to a place well within itself. So only
the pixels that their own region moves across a cut on some slice, or near one, are computed exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import each, jit, jnp, lax
from deformnb.rbf.cuts import Decoupled, decide
from deformnb.rbf.evaluation import few_sizes
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, raster_lines
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.warping.compositions import Replacement
from deformnb.warping.planning import Extruded, check_finite, parts, shared_axis, to_voxels

# Pixels that are computed together, and slices at most: few pixels are filled up for nothing, many cost fewer calls.
_TOGETHER, _SLICES = 1024, 256

# Groups of slices of similar weights in which pixels are sought that their own region moves across a cut, and pixels
# that are read at a time.
_GROUPS, _READ_TOGETHER = 32, 4096

# Displacements that lead farther than this share of the picture see the distances of the raster's edge, whose sign is
# right for all but closed cuts out there.
_MARGIN = 0.5

# The sides of the raster of distances are a multiple of these pixels.
_RASTER_MULTIPLE = 64

# The picture of a small part of a volume is taken to be as large as this, in pixels.
_LEAST_PIXELS = 1024


@dataclass(frozen=True, eq=False)
class CutPlan:
    """A displacement that jumps along cuts, in two halves; made by :func:`plan_cut`.

    Parameters
    ----------
    apart : the displacement as if no tissue could come from another region: right wherever a cut is far.
    pixels : (2, P) rows and columns of the pixels, in the order of the two array axes across the normal, so near a cut
        that it may open or close there.
    maps : every region's maps (R, K, 2, P) there.
    here : (C, P) distances to the cuts, read off the raster.
    places : (2, P) index of these pixels in the raster of distances, columns first.
    distances : (C, rows, columns) on that raster; scale : (2,) its pixels per length.
    field : whose plan this is.
    """

    apart: Extruded
    pixels: NDArray[np.intp]
    maps: NDArray[np.float32]
    here: NDArray[np.float32]
    places: NDArray[np.float32]
    distances: NDArray[np.float32]
    scale: NDArray[np.float32]
    field: Decoupled

    def parts(self) -> list[tuple[slice, NDArray[np.intp]]]:
        """Slices along the normal and numbers of pixels that are computed together; the last one may be repeated."""
        weights, last = self.apart.weights, self.pixels.shape[1] - 1
        assert weights is not None
        return [
            (depth, np.minimum(np.arange(first, first + _TOGETHER), last))
            for depth in parts(weights.shape[1], _SLICES)
            for first in range(0, last + 1, _TOGETHER)
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
        d, opacity = self._evaluate(depth, some)
        row, column = self.pixels[:, some].astype(np.int32)
        voxels = [row, column]
        voxels.insert(self.apart.normal, np.arange(depth.start, depth.stop, dtype=np.int32)[:, None])
        index = np.broadcast_arrays(*voxels)
        moves = np.moveaxis(np.asarray(d), self.apart.normal + 1, 1)[:, :, 0]
        u, v = moves.reshape(2, -1)
        share = np.moveaxis(opacity, self.apart.normal, 0)[:, 0]
        z, y, x = (i.ravel() for i in index)
        return Replacement((z, y, x), (u, v, np.zeros_like(u)), share.ravel())

    def _evaluate(self, depth: slice, some: NDArray[np.intp]) -> tuple[Any, NDArray[np.float32]]:
        """Displacements along u and v (2, z, y, x) and opacity [z, y, x] of one of the parts.

        Of the two axes across the normal the first has extent 1, and the second is that of the pixels.
        """
        normal, weights = self.apart.normal, self.apart.weights
        assert weights is not None
        maps, here, places = (a[..., None, some] for a in (self.maps, self.here, self.places))
        d, opacity = _displace(
            maps,
            weights[:, depth],
            here,
            places,
            self.distances,
            self.scale,
            np.float32(self.field.softness),
            sides=self.field.sides,
            rule=self.field.rule,
            normal=normal,
        )
        return d, np.asarray(opacity)


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
    least = field.softness / 2  # in its own region a place that is read to be as deep as this is opaque
    farthest = _reach(own, largest) + max(output.spacing)  # linear reading errs by less than a voxel
    some = np.flatnonzero(np.abs(here).min(axis=0) < farthest + least)
    near, maps, own, here = (_take(a, some) for a in (np.moveaxis(at, -1, 0), maps, own, here))
    reach = max(float(_reach(regional, largest).max(initial=0.0)) for regional in maps)
    raster = _surrounding_raster(
        near, reach, float((np.ptp(rows, axis=1) + np.ptp(columns, axis=1)).max()), output, normal
    )
    centres = _outer_sum(*raster_lines(raster))
    distances = np.stack([r.signed_distance(centres) for r in field.regions]).astype(np.float32)
    scale = (1 / np.asarray(raster.spacing)).astype(np.float32)
    places = ((near - np.asarray(raster.origin)[:, None]) * scale[:, None]).astype(np.float32)
    # Read as the places are where a displacement leads, so that what does not move is opaque at corners too.
    read, leaves = _read(own, weights, here < 0, places, distances, scale, least)
    on_cut = (np.abs(read) < 1e-3 * min(raster.spacing)) & ((read < 0) != (here < 0))  # there rounding decides no side
    read = np.where(on_cut, np.where(here < 0, -1e-9, 0.0), read).astype(np.float32)
    pixels = np.stack(np.unravel_index(some[leaves], at.shape[:2]))
    return CutPlan(apart, pixels, maps[..., leaves], read[:, leaves], places[:, leaves], distances, scale, field)


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


def _surrounding_raster(at: NDArray[np.float64], reach: float, size: float, output: Grid, normal: int) -> Raster:
    """A raster of the places up to ``reach`` from some (2, n), on a picture as large as ``size``."""
    step = min(s for k, s in enumerate(output.spacing) if k != 2 - normal)
    margin = min(reach, _MARGIN * max(size, _LEAST_PIXELS * step)) + 2 * max(output.spacing)
    low, high = (end(at, axis=1) if at.size else np.zeros(2) for end in (np.min, np.max))
    # Every shape is compiled for anew, and every drag leads elsewhere.
    columns, rows = (
        _RASTER_MULTIPLE * few_sizes(int(n / (_RASTER_MULTIPLE * step)) + 1) for n in high - low + 2 * margin + step
    )
    return Raster((rows, columns), (step, step), tuple((low - margin).tolist()))


def _read(
    moved: NDArray[np.float32],
    weights: NDArray[np.float32],
    inside: NDArray[np.bool_],
    places: NDArray[np.float32],
    distances: NDArray[np.float32],
    scale: NDArray[np.float32],
    least: float,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """The distances (C, n) read at places (2, n), and which of these may be led, on some slice, to where they are less
    than ``least`` deep in their own region.

    moved : the maps of their own regions (K, 2, n), with weights (K, slices).
    inside : (C, n) own sides of the cuts.
    """
    groups = [weights[:, part] for part in parts(weights.shape[1], -(-weights.shape[1] // _GROUPS))]
    low, high = (np.stack([end(group, axis=1) for group in groups]) for end in (np.min, np.max))
    count = places.shape[1]
    read, leaves = np.zeros(inside.shape, np.float32), np.zeros(count, bool)
    for first in range(0, count, _READ_TOGETHER):
        at = np.minimum(np.arange(first, first + _READ_TOGETHER), count - 1)
        found = _read_some(
            moved[..., at],
            (low + high) / 2,
            (high - low) / 2,
            inside[:, at],
            places[:, at],
            distances,
            scale,
            np.float32(least),
        )
        here = slice(first, first + _READ_TOGETHER)
        read[:, here], leaves[here] = (np.asarray(a)[..., : count - first] for a in found)
    return read, leaves


@partial(jit, on_one_thread=True)
def _read_some(
    moved: Any, weights: Any, spreads: Any, inside: Any, places: Any, distances: Any, scale: Any, least: Any
) -> tuple[Any, Any]:
    sides = jnp.where(inside, -1.0, 1.0)
    length = jnp.sqrt(moved[:, 0] ** 2 + moved[:, 1] ** 2)

    def one_group(leaves: Any, group: tuple[Any, Any]) -> tuple[Any, None]:
        w, spread = group
        d = sum(w[k] * m for k, m in enumerate(moved))
        x, y = places[0] + scale[0] * d[0], places[1] + scale[1] * d[1]
        # Linear interpolation between distances changes by the square root of 2 per length at most.
        within = least + 2**0.5 * sum(spread[k] * a for k, a in enumerate(length))
        for side, table in zip(sides, distances, strict=True):
            leaves = leaves | (side * _look_up(table, x, y) < within)
        return leaves, None

    leaves, _ = lax.scan(one_group, jnp.zeros(places.shape[1], bool), (weights, spreads))
    return jnp.stack([_look_up(table, places[0], places[1]) for table in distances]), leaves


def _look_up(table: Any, x: Any, y: Any) -> Any:
    """A raster read linearly at columns x and rows y, constant beyond its edges."""
    rows, columns = table.shape
    flat, length = table.reshape(-1), (rows - 1) * columns - 1
    (i, s), (j, t) = _cell(x, columns), _cell(y, rows)
    # Each neighbour in a separate part of the raster, all of one length: the index is then tested once for all four.
    a, b, c, d = (
        lax.slice_in_dim(flat, n, n + length)
        .at[j * columns + i]
        .get(mode="promise_in_bounds", wrap_negative_indices=False)
        for n in (0, 1, columns, columns + 1)
    )
    return (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + d * s) * t


def _cell(place: Any, count: int) -> tuple[Any, Any]:
    """The node before a place on an axis of ``count`` nodes, and the distance from there."""
    place = jnp.clip(place, 0.0, count - 1.001)
    node = jnp.minimum(jnp.floor(place), count - 2)
    # Read off the bits of node + 2^23: XLA's own conversion tests one place at a time, and takes twice as long. A place
    # that is not a number must lead to some node, too.
    number = lax.bitcast_convert_type(node + np.float32(2**23), jnp.int32) - np.int32(0x4B000000)
    return jnp.clip(number, 0, count - 2), place - node


@partial(jit, on_one_thread=True, static_argnames=("sides", "rule", "normal"))
def _displace(
    maps: Any,
    weights: Any,
    here: Any,
    places: Any,
    distances: Any,
    scale: Any,
    softness: Any,
    *,
    sides: Any,
    rule: str,
    normal: int,
) -> tuple[Any, Any]:
    def one_slice(w: Any) -> tuple[Any, Any]:  # its arrays stay in the cache; all slices at once took 5 times as long
        moves = [sum(w[k] * regional[k] for k in range(len(w))) for regional in maps]
        at = [(places[0] + scale[0] * d[0], places[1] + scale[1] * d[1]) for d in moves]
        # The barrier prevents XLA from sampling everything again for each use.
        there = lax.optimization_barrier([[_look_up(table, x, y) for table in distances] for x, y in at])
        choice, opacity = decide(list(here), there, sides, rule, softness, jnp)
        total = jnp.zeros_like(moves[0])
        for r, d in enumerate(moves):
            total = jnp.where(choice == r, d, total)
        return total, opacity

    total, opacity = each(one_slice, weights.T)
    return jnp.moveaxis(total, 0, normal + 1), jnp.moveaxis(opacity, 0, normal)
