"""A displacement field as a graphics card reads it: maps over a plane, weighted along its normal, or samples in space.

What an extrusion says is sent as it is, K small maps; anything else is sampled coarsely in space. Of a composition the
last step is kept apart if it is an extrusion, since that is the one being edited.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeGuard

import jax
import numpy as np
from numpy.typing import NDArray

from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField, Composed, Identity
from deformnb.plane import Raster
from deformnb.volume import Grid
from deformnb.widgets.shown_volume import ShownVolume

# Weights at equal steps of depth: as many as a curve has knots, so that it is kept exactly; a hat function with knots
# in between errs by less than a thousandth.
_DEPTHS = 1025

# The card holds at most 256 layers at once by the standard, and a sample adds up those whose weight is not zero.
MOST_MAPS = 64


@dataclass(frozen=True, eq=False)
class CardMaps:
    """A message: what it says, and its buffers."""

    content: dict[str, Any]
    buffers: list[bytes]

    @property
    def size(self) -> int:
        """Bytes of the buffers."""
        return sum(map(len, self.buffers))


def card_maps(field: AbstractField | None, shown: ShownVolume, output: Grid | None, map_size: int,
              space_size: int) -> CardMaps:
    """The maps of a field on the box of ``output``.

    Parameters
    ----------
    map_size : samples of a map along its longer side.
    space_size : samples in space along the longest side.
    """
    grid = output or shown.original
    content: dict[str, Any] = {"box": shown.box(grid), "planar": None, "space": None}
    planar, rest = _parts(field)
    buffers: list[bytes] = []
    if planar is not None:
        content["planar"], buffers = _planar(planar, shown, grid, map_size)
    if rest is not None:
        reach = _reach(planar, grid, map_size)
        content["space"], samples = _space(rest, shown, grid, space_size, reach)
        buffers = [*buffers, samples]
    return CardMaps(content, buffers)


def count_maps(field: AbstractField | None) -> int | None:
    """How many maps the extrusion that was done last has; None if it was no extrusion."""
    planar, _ = _parts(field)
    return None if planar is None else len(planar.maps)


def _parts(field: AbstractField | None) -> tuple[Extrusion | None, AbstractField | None]:
    """The extrusion that was done last, and all that was done before it."""
    if field is None or isinstance(field, Identity):
        return None, None
    if _is_planar(field):
        return field, None
    if isinstance(field, Composed) and _is_planar(field.then):
        return field.then, None if isinstance(field.first, Identity) else field.first
    return None, field


def _is_planar(field: AbstractField) -> TypeGuard[Extrusion]:
    return isinstance(field, Extrusion) and len(field.maps) <= MOST_MAPS


def map_raster(field: Extrusion, grid: Grid, map_size: int) -> Raster:
    """Nodes over all of the picture's plane that the box of ``grid`` covers, the outermost on its edges."""
    at = field.plane.to_plane(grid.corners())[:, :2]
    low, size = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    counts = np.maximum(8, np.ceil(map_size * size / size.max())).astype(int)
    return Raster((int(counts[1]), int(counts[0])), tuple(size / (counts - 1)), tuple(low))


def _planar(field: Extrusion, shown: ShownVolume, grid: Grid, map_size: int) -> tuple[dict[str, Any], list[bytes]]:
    raster = map_raster(field, grid, map_size)
    maps = np.stack([np.moveaxis(m.on_raster(raster), 0, -1) for m in field.maps])
    depths = np.linspace(0.0, 1.0, 2 if field.is_replication else _DEPTHS)
    weights = np.stack([np.interp(depths, field.knots, w) for w in np.asarray(field.weights)])
    plane, turn = field.plane, shown.frame
    same = field.is_replication and bool((weights[:, 0] == 1).all()) and len(maps) == 1
    about = {
        "shape": list(maps.shape[:3]), "origin": list(raster.origin), "spacing": list(raster.spacing),
        "depth": list(field.depth), "isReplicated": same,
        "plane": {"origin": shown.to_frame(np.asarray(plane.origin)).tolist(),
                  **{name: (turn @ np.asarray(vector)).tolist()
                     for name, vector in (("u", plane.u), ("v", plane.v), ("n", plane.normal))}},
    }
    return about, [np.ascontiguousarray(maps, "<f4").tobytes(), np.ascontiguousarray(weights, "<f4").tobytes()]


def _reach(planar: Extrusion | None, grid: Grid, map_size: int) -> float:
    """How far the last step looks beyond the box, where the steps before it must be known too."""
    if planar is None:
        return 0.0
    raster = map_raster(planar, grid, min(map_size, 64))
    largest = np.abs(np.asarray(planar.weights)).max(axis=1)
    return float(sum(w * np.linalg.norm(m.on_raster(raster), axis=0).max()
                     for w, m in zip(largest, planar.maps, strict=True)))


def _space(field: AbstractField, shown: ShownVolume, grid: Grid, space_size: int,
           reach: float) -> tuple[dict[str, Any], bytes]:
    box = shown.box(grid)
    low, high = np.asarray(box["low"]) - reach, np.asarray(box["high"]) + reach
    size = np.maximum(high - low, 1e-9)
    counts = np.maximum(4, np.ceil(space_size * size / size.max())).astype(int)
    spacing = size / (counts - 1)
    own = shown.volume.grid
    first = own.index_to_point(low / np.asarray(own.spacing))
    lattice = Grid((int(counts[2]), int(counts[1]), int(counts[0])), tuple(spacing), tuple(first), own.direction)
    samples: NDArray[Any] = np.einsum("mk,kzyx->zyxm", shown.frame, field.on_grid(lattice))
    about = {"shape": counts.tolist(), "origin": low.tolist(), "spacing": spacing.tolist()}
    return about, np.ascontiguousarray(samples, "<f4").tobytes()


def differ_only_in(index: int, old: AbstractField | None, new: AbstractField | None) -> bool:
    """Whether two extrusions are the same but for one map, so that a page which knows that map needs no other."""
    if not (isinstance(old, Extrusion) and isinstance(new, Extrusion)) or len(old.maps) != len(new.maps):
        return False
    same = old.plane == new.plane and old.depth == new.depth and all(
        np.array_equal(a, b) for a, b in ((old.knots, new.knots), (old.weights, new.weights)))
    return same and all(k == index or _equal(a, b) for k, (a, b) in enumerate(zip(old.maps, new.maps, strict=True)))


def _equal(a: AbstractField, b: AbstractField) -> bool:
    (leaves, form), (others, other_form) = jax.tree_util.tree_flatten(a), jax.tree_util.tree_flatten(b)
    same_form = form == other_form  # type: ignore[operator]  # jax's stub of it says nothing of equality
    return a is b or bool(same_form and all(map(np.array_equal, leaves, others)))
