"""Warping with cuts whose displacement changes with depth, on a grid that lies along the picture's plane.

The visible region is decided at every voxel anew, since a modulated cut opens differently on every slice. All that
does not depend on depth is made once: every region's maps on one slice of voxels, and the distances to the cuts on a
raster somewhat larger than the picture, read linearly where a displacement leads. Along straight cuts that is exact, at
a corner off by less than a fifth of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import compiled, jnp, lax
from deformnb.rbf.cuts import Decoupled, decide
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, raster_lines
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.warping.planning import BLOCK_VOXELS, Extruded, checked, parts, shared_axis, to_voxels

# Pixels along the side of a square that is looked at closely: small ones leave out more, large ones cost fewer calls.
_TILE = 32

# Displacements that lead farther than this share of the picture see the distances of the raster's edge, whose sign is
# right for all but closed cuts out there.
_MARGIN = 0.5

# The picture of a small part of a volume is taken to be as large as this, in pixels.
_LEAST_PIXELS = 1024


@dataclass(frozen=True, eq=False)
class CutPlan:
    """A displacement that jumps along cuts, in two halves; made by :func:`plan_cut`.

    Parameters
    ----------
    apart : the displacement as if no tissue could come from another region: right wherever a cut is far.
    tiles : parts of the output (slices along z, y, x) with voxels so near a cut that it may open or close there; they
        may end beyond the last voxel.
    maps : every region's maps (R, K, 2, A, B) over the two array axes across the normal.
    here : (C, A, B) distances to the cuts, read off the raster.
    places : (2, A, B) index of every voxel in the raster of distances, columns first.
    distances : (C, rows, columns) on that raster; scale : (2,) its pixels per length.
    field : whose plan this is.
    """

    apart: Extruded
    tiles: list[tuple[slice, slice, slice]]
    maps: NDArray[np.float32]
    here: NDArray[np.float32]
    places: NDArray[np.float32]
    distances: NDArray[np.float32]
    scale: NDArray[np.float32]
    field: Decoupled

    def tile(self, part: tuple[slice, slice, slice]) -> tuple[Any, NDArray[np.float32]]:
        """Displacements along u and v (2, z, y, x) and opacity [z, y, x] of one of the tiles."""
        normal, weights = self.apart.normal, self.apart.weights
        assert weights is not None
        across = [_indices(s, n) for s, n in zip(np.delete(np.array(part), normal), self.here.shape[1:], strict=True)]
        a, b = np.ix_(*across)
        d, opacity = _evaluate(self.maps[..., a, b], weights[:, part[normal]], self.here[:, a, b], self.places[:, a, b],
                               self.distances, self.scale, np.float32(self.field.softness), sides=self.field.sides,
                               rule=self.field.rule, normal=normal)
        return d, np.asarray(opacity)


def _indices(part: slice, count: int) -> NDArray[np.intp]:
    return np.minimum(np.arange(part.start, part.stop), count - 1)


def plan_cut(field: AbstractField, source: Grid, output: Grid, compute: str) -> CutPlan | None:
    """The plan of a cut field, or None where only the slow way is right: an oblique plane, no extrusion."""
    fields = _extrusions(field)
    if not fields or not isinstance(field, Decoupled):
        return None
    plane, softness = fields[0].plane, field.softness
    normal = shared_axis(plane, source, output)
    if normal is None:
        return None
    index = np.zeros((output.shape[normal], 3))
    index[:, 2 - normal] = np.arange(len(index))
    weights = fields[0].weights_at(plane.to_plane(output.index_to_point(index))[:, 2])
    at = _on_slice(plane, output, normal)  # (A, B, 2)
    rows, columns = at[:, 0].T, (at[0] - at[0, 0]).T
    maps = checked(np.stack([[m.on_outer_sum(rows, columns, min(output.spacing)) for m in f.maps] for f in fields]))
    here = np.stack([r.signed_distance(at) for r in field.regions])
    own = [np.all([(d < 0) == inside for d, inside in zip(here, side, strict=True)], axis=0) for side in field.sides]
    # From here the way to a cut is farther than any displacement: what is seen is the region's own, and all of it.
    farthest = (np.abs(weights).max(axis=1)[:, None, None] * np.linalg.norm(maps, axis=2)).sum(axis=1).max(axis=0)
    is_near = np.abs(here).min(axis=0) < farthest + softness + 2 * max(output.spacing)
    apart = Extruded(normal, np.einsum("rab,rkmab->kmab", np.asarray(own, np.float32), maps), checked(weights),
                     to_voxels(plane, source, compute))
    raster = _around(at, float(farthest.max()), output, normal)
    lines = raster_lines(raster)
    centres = np.moveaxis(lines[0][:, :, None] + lines[1][:, None, :], 0, -1)
    scale = (1 / np.asarray(raster.spacing)).astype(np.float32)
    places = np.moveaxis((at - raster.origin) * scale, -1, 0).astype(np.float32)
    distances = np.stack([r.signed_distance(centres) for r in field.regions]).astype(np.float32)
    # Read as the places are where a displacement leads, so that what does not move is opaque at corners too.
    read = np.stack([np.asarray(look_up(jnp.asarray(table), *places)) for table in distances])
    on_cut = (np.abs(read) < 1e-3 * min(raster.spacing)) & ((read < 0) != (here < 0))  # there rounding decides no side
    read = np.where(on_cut, np.where(here < 0, -1e-9, 0.0), read).astype(np.float32)
    return CutPlan(apart, _tiles(is_near, normal, output), maps, read, places, distances, scale, field)


def _extrusions(field: AbstractField) -> list[Extrusion]:
    """The fields of all regions, if they are extruded alike from the plane of the cuts; else none."""
    if not isinstance(field, Decoupled):
        return []
    found = [f for f in field.fields if isinstance(f, Extrusion) and f.plane == field.plane]
    same = all(np.array_equal(f.weights, found[0].weights) and np.array_equal(f.knots, found[0].knots)
               and f.depth == found[0].depth for f in found)
    return found if same and len(found) == len(field.fields) else []


def _tiles(is_near: NDArray[np.bool_], normal: int, output: Grid) -> list[tuple[slice, slice, slice]]:
    """The squares of the picture that hold such pixels, with all slices behind them, some slices at a time."""
    n = output.shape[normal]
    squares = [(slice(a, a + _TILE), slice(b, b + _TILE)) for a in range(0, is_near.shape[0], _TILE)
               for b in range(0, is_near.shape[1], _TILE) if is_near[a : a + _TILE, b : b + _TILE].any()]
    made = []
    for depth in parts(n, BLOCK_VOXELS // _TILE**2):
        for square in squares:
            slices = list(square)
            slices.insert(normal, depth)
            made.append((slices[0], slices[1], slices[2]))
    return made


def _on_slice(plane: Plane, output: Grid, normal: int) -> NDArray[np.float64]:
    """Picture coordinates of the voxels of one slice: (A, B, 2) over the two other array axes."""
    axes = [axis for axis in range(3) if axis != normal]
    index = np.zeros((output.shape[axes[0]], output.shape[axes[1]], 3))
    index[..., 2 - axes[0]] = np.arange(output.shape[axes[0]])[:, None]
    index[..., 2 - axes[1]] = np.arange(output.shape[axes[1]])
    return plane.to_plane(output.index_to_point(index))[..., :2]


def _around(at: NDArray[np.float64], largest: float, output: Grid, normal: int) -> Raster:
    low, high = at.min(axis=(0, 1)), at.max(axis=(0, 1))
    step = min(s for k, s in enumerate(output.spacing) if k != 2 - normal)
    size = max(float((high - low).max()), _LEAST_PIXELS * step)
    margin = min(largest, _MARGIN * size) + 2 * max(output.spacing)
    counts = np.ceil((high - low + 2 * margin) / step).astype(int) + 1
    return Raster((int(counts[1]), int(counts[0])), (step, step), tuple((low - margin).tolist()))


def look_up(table: Any, x: Any, y: Any) -> Any:
    """A raster read linearly at columns x and rows y, constant beyond its edges."""
    rows, columns = table.shape
    x, y = jnp.clip(x, 0.0, columns - 1.001), jnp.clip(y, 0.0, rows - 1.001)
    i, j = jnp.minimum(x.astype(jnp.int32), columns - 2), jnp.minimum(y.astype(jnp.int32), rows - 2)
    s, t = x - i, y - j
    flat, k = table.reshape(-1), j * columns + i
    a, b, c, d = (flat.at[k + n].get(mode="promise_in_bounds") for n in (0, 1, columns, columns + 1))
    return (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + d * s) * t


@partial(compiled, on_one_thread=True, static_argnames=("sides", "rule", "normal"))
def _evaluate(maps: Any, weights: Any, here: Any, places: Any, distances: Any, scale: Any, softness: Any, *,
              sides: Any, rule: str, normal: int) -> tuple[Any, Any]:
    def one_slice(w: Any) -> tuple[Any, Any]:  # its arrays stay in the cache; all slices at once took 5 times as long
        moves = [sum(w[k] * regional[k] for k in range(len(w))) for regional in maps]
        at = [(places[0] + scale[0] * d[0], places[1] + scale[1] * d[1]) for d in moves]
        # The barrier keeps XLA from looking everything up again for each use.
        there = lax.optimization_barrier([[look_up(table, x, y) for table in distances] for x, y in at])
        choice, opacity = decide(list(here), there, sides, rule, softness, jnp)
        total = jnp.zeros_like(moves[0])
        for r, d in enumerate(moves):
            total = jnp.where(choice == r, d, total)
        return total, opacity

    total, opacity = lax.map(one_slice, weights.T)
    return jnp.moveaxis(total, 0, normal + 1), jnp.moveaxis(opacity, 0, normal)
