"""Cuts whose displacement changes with depth, on a grid that lies along the picture's plane.

Which region is seen is decided at every voxel anew, since a modulated cut opens differently on every slice. All that
does not depend on depth is made once: every region's maps on one slice of voxels, and the distances to the cuts on a
raster somewhat larger than the picture, read linearly where a displacement leads. Along straight cuts that is exact, at
a corner off by less than a fifth of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from deformnb.compilation import compiled
from deformnb.cuts import Decoupled, decide
from deformnb.extrusion import Extrusion
from deformnb.fields import raster_lines
from deformnb.plane import Plane, Raster
from deformnb.volume import Grid

# Displacements that lead farther than this share of the picture see the distances of the raster's edge, whose sign is
# right for all but closed cuts out there.
_MARGIN = 0.5


@dataclass(frozen=True, eq=False)
class CutPlan:
    """What :meth:`block` needs of a field and an output grid; made by :func:`plan_cut`."""

    normal: int
    maps: NDArray[np.float32]  # (R, K, 2, A, B) over the two other array axes
    weights: NDArray[np.float32]  # (K, n) along the normal
    here: NDArray[np.float32]  # (C, A, B) distances to the cuts
    places: NDArray[np.float32]  # (2, A, B) index of every voxel in the raster of distances, columns first
    distances: NDArray[np.float32]  # (C, rows, columns)
    scale: NDArray[np.float32]  # (2,) pixels of that raster per length
    axes: NDArray[np.float32]  # (2, 3) the plane's u and v
    field: Decoupled

    def block(self, part: tuple[slice, slice], shape: tuple[int, int, int]) -> tuple[Any, Any]:
        """Displacements x, y, z and opacity, each [z, y, x], of a part of the output along z and y.

        Parts may end beyond the last voxel, as :func:`deformnb.warp_plan.blocks` makes them.
        """
        every = (*part, slice(0, shape[2]))
        across = [_indices(every[axis], shape[axis]) for axis in range(3) if axis != self.normal]
        along = _indices(every[self.normal], shape[self.normal])
        a, b = np.ix_(*across)
        d, opacity = _evaluate(self.maps[..., a, b], self.weights[:, along], self.here[:, a, b], self.places[:, a, b],
                               self.distances, self.scale, self.axes, np.float32(self.field.softness),
                               sides=self.field.sides, rule=self.field.rule, normal=self.normal)
        return d, np.asarray(opacity)


def _indices(part: slice, count: int) -> NDArray[np.intp]:
    return np.minimum(np.arange(part.start, part.stop), count - 1)


def plan_cut(field: Any, output: Grid) -> CutPlan | None:
    """The plan of a cut field, or None where only the slow way is right: an oblique plane, no extrusion."""
    if not isinstance(field, Decoupled) or field.plane is None or not field.fields:
        return None
    if not all(isinstance(f, Extrusion) and f.plane == field.plane for f in field.fields):
        return None
    fields: list[Extrusion] = list(field.fields)  # type: ignore[arg-type]
    normal = fields[0].axis_of(output)
    same = all(np.array_equal(f.weights, fields[0].weights) and np.array_equal(f.knots, fields[0].knots)
               and f.depth == fields[0].depth for f in fields)
    if normal is None or not same:
        return None
    index = np.zeros((output.shape[normal], 3))
    index[:, 2 - normal] = np.arange(len(index))
    weights = fields[0].weights_at(field.plane.to_plane(output.index_to_point(index))[:, 2])
    at = _on_slice(field.plane, output, normal)  # (A, B, 2)
    rows, columns = np.moveaxis(at[:, :1] - at[0, 0], -1, 0)[..., 0] + at[0, 0][:, None], np.moveaxis(
        at[0] - at[0, 0], -1, 0)
    resolution = min(output.spacing)
    maps = np.stack([[m.on_outer_sum(rows, columns, resolution) for m in f.maps] for f in fields])
    raster = _around(at, np.abs(maps).max(initial=0.0), output, normal)
    lines = raster_lines(raster)
    centres = np.moveaxis(lines[0][:, :, None] + lines[1][:, None, :], 0, -1)
    scale = 1 / np.asarray(raster.spacing)
    return CutPlan(
        normal, maps.astype(np.float32), weights.astype(np.float32),
        np.stack([r.signed_distance(at) for r in field.regions]).astype(np.float32),
        np.moveaxis((at - raster.origin) * scale, -1, 0).astype(np.float32),
        np.stack([r.signed_distance(centres) for r in field.regions]).astype(np.float32), scale.astype(np.float32),
        field.plane.frame[:2].astype(np.float32), field,
    )


def _on_slice(plane: Plane, output: Grid, normal: int) -> NDArray[np.float64]:
    """Picture coordinates of the voxels of one slice: (A, B, 2) over the two other array axes."""
    axes = [axis for axis in range(3) if axis != normal]
    index = np.zeros((output.shape[axes[0]], output.shape[axes[1]], 3))
    index[..., 2 - axes[0]] = np.arange(output.shape[axes[0]])[:, None]
    index[..., 2 - axes[1]] = np.arange(output.shape[axes[1]])
    return plane.to_plane(output.index_to_point(index))[..., :2]


def _around(at: NDArray[np.float64], largest: float, output: Grid, normal: int) -> Raster:
    low, high = at.min(axis=(0, 1)), at.max(axis=(0, 1))
    margin = min(largest, _MARGIN * float((high - low).max())) + 2 * max(output.spacing)
    step = min(s for k, s in enumerate(output.spacing) if k != 2 - normal)
    counts = np.ceil((high - low + 2 * margin) / step).astype(int) + 1
    return Raster((int(counts[1]), int(counts[0])), (step, step), tuple((low - margin).tolist()))


def _look_up(table: Any, x: Any, y: Any) -> Any:
    """A raster read linearly at columns x and rows y, constant beyond its edges."""
    rows, columns = table.shape
    x, y = jnp.clip(x, 0.0, columns - 1.001), jnp.clip(y, 0.0, rows - 1.001)
    i, j = x.astype(jnp.int32), y.astype(jnp.int32)
    s, t = x - i, y - j
    flat, k = table.reshape(-1), j * columns + i
    upper = flat[k] * (1 - s) + flat[k + 1] * s
    return upper * (1 - t) + (flat[k + columns] * (1 - s) + flat[k + columns + 1] * s) * t


@partial(compiled, static_argnames=("sides", "rule", "normal"))
def _evaluate(maps: Any, weights: Any, here: Any, places: Any, distances: Any, scale: Any, axes: Any, softness: Any, *,
              sides: Any, rule: str, normal: int) -> tuple[tuple[Any, ...], Any]:
    count = maps.shape[0]
    moves = [sum(weights[k][None, :, None, None] * maps[r, k][:, None] for k in range(maps.shape[1]))
             for r in range(count)]  # each (2, n, A, B)
    at = [(places[0] + scale[0] * d[0], places[1] + scale[1] * d[1]) for d in moves]
    there = [[_look_up(table, x, y) for table in distances] for x, y in at]
    shape = moves[0].shape[1:]
    choice, opacity = decide([jnp.broadcast_to(d, shape) for d in here], there, sides, rule, softness, jnp)
    total = jnp.zeros_like(moves[0])
    for r, d in enumerate(moves):
        total = jnp.where(choice == r, d, total)
    d = tuple(jnp.moveaxis(axes[0, m] * total[0] + axes[1, m] * total[1], 0, normal) for m in range(3))
    return d, jnp.moveaxis(opacity, 0, normal)
