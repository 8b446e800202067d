"""A displacement field as a graphics card reads it: maps over a plane, weighted along its normal, or samples in space.

What an extrusion says is sent as it is, K small maps, those of every region if it is cut; anything else is sampled
coarsely in space. Of a composition the last step is kept apart if it is an extrusion, since that is the one being
edited.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField, Composed, Identity
from deformnb.plane import Raster
from deformnb.volume import Grid
from deformnb.widgets.card_cuts import (
    CutPlane,
    about_cut,
    cut_plane,
    cut_raster,
    distances,
    same_rule,
    softness_of,
    with_still_regions,
)
from deformnb.widgets.shown_volume import ShownVolume
from deformnb.widgets.space_cuts import CutChain, chain_is_exact, cut_chain, space_layers

# Weights at equal steps of depth: as many as a curve has knots, so that it is kept exactly; a hat function with knots
# in between errs by less than a thousandth.
_DEPTHS = 1025

# The card holds at most 256 layers at once by the standard, and a sample adds up those whose weight is not zero.
MOST_MAPS = 64


@dataclass(frozen=True, eq=False)
class CardMaps:
    """A message: what it says, and its buffers, whose names are in ``content["buffers"]``.

    ``content["coarse"]`` is true where cuts of several earlier steps are smeared between samples in space.
    """

    content: dict[str, Any]
    buffers: list[bytes]

    @property
    def size(self) -> int:
        """Bytes of the buffers."""
        return sum(map(len, self.buffers))

    def buffer(self, name: str) -> bytes:
        """One of them by its name."""
        return self.buffers[self.content["buffers"].index(name)]

    def without(self, name: str) -> CardMaps:
        """The same message without one of them, for a page that has it."""
        kept = [(n, b) for n, b in zip(self.content["buffers"], self.buffers, strict=True) if n != name]
        return CardMaps({**self.content, "buffers": [n for n, _ in kept]}, [b for _, b in kept])


def card_maps(field: AbstractField | None, shown: ShownVolume, output: Grid | None, map_size: int,
              space_size: int) -> CardMaps:
    """The maps of a field on the box of ``output``.

    Parameters
    ----------
    map_size : samples of a map along its longer side.
    space_size : samples in space along the longest side.
    """
    grid = output or shown.original
    content: dict[str, Any] = {"box": shown.box(grid), "planar": None, "space": None, "coarse": False}
    planar, rest = _parts(field, grid)
    buffers: dict[str, bytes] = {}
    if planar is not None:
        content["planar"], buffers = _planar(planar, shown, grid, map_size)
    if rest is not None:
        content["space"], more = _space(rest, shown, grid, space_size, _reach(planar, grid, map_size))
        buffers |= more
        content["coarse"] = rest.has_cuts and ("cut" not in content["space"] or not chain_is_exact(rest))
    return CardMaps({**content, "buffers": list(buffers)}, list(buffers.values()))


def count_maps(field: AbstractField | None) -> int | None:
    """How many maps the extrusion that was done last has, in each region; None if it was no extrusion."""
    if isinstance(field, Composed):
        field = field.then
    planar = None if field is None else cut_plane(field, MOST_MAPS)
    return None if planar is None else planar.count


def _parts(field: AbstractField | None, grid: Grid) -> tuple[CutPlane | None, AbstractField | None]:
    """The extrusion that was done last, and all that was done before it."""
    if field is None or isinstance(field, Identity):
        return None, None
    last, before = (field.then, field.first) if isinstance(field, Composed) else (field, None)
    planar = cut_plane(last, MOST_MAPS)
    planar = planar and with_still_regions(planar, grid, MOST_MAPS)
    if planar is None:
        return None, field
    return planar, None if isinstance(before, Identity) else before


def map_raster(field: Extrusion, grid: Grid, map_size: int) -> Raster:
    """Nodes over all of the picture's plane that the box of ``grid`` covers, the outermost on its edges."""
    at = field.plane.to_plane(grid.corners())[:, :2]
    low, size = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    counts = np.maximum(8, np.ceil(map_size * size / size.max())).astype(int)
    return Raster((int(counts[1]), int(counts[0])), tuple(size / (counts - 1)), tuple(low))


def _planar(planar: CutPlane, shown: ShownVolume, grid: Grid, map_size: int) -> tuple[dict[str, Any], dict[str, bytes]]:
    field = planar.first
    raster = map_raster(field, grid, map_size)
    maps = np.stack([np.moveaxis(m.on_raster(raster), 0, -1) for region in planar.regions for m in region.maps])
    depths = np.linspace(0.0, 1.0, 2 if field.is_replication else _DEPTHS)
    weights = np.stack([np.interp(depths, field.knots, w) for w in np.asarray(field.weights)])
    plane, turn = field.plane, shown.frame
    same = field.is_replication and bool((weights[:, 0] == 1).all()) and planar.count == 1
    about: dict[str, Any] = {
        "shape": list(maps.shape[:3]), "origin": list(raster.origin), "spacing": list(raster.spacing),
        "depth": list(field.depth), "isReplicated": same, "cut": None,
        "softness": softness_of(planar, shown.original),
        "plane": {"origin": shown.to_frame(np.asarray(plane.origin)).tolist(),
                  **{name: (turn @ np.asarray(vector)).tolist()
                     for name, vector in (("u", plane.u), ("v", plane.v), ("n", plane.normal))}},
    }
    buffers = {"maps": np.ascontiguousarray(maps, "<f4").tobytes(),
               "weights": np.ascontiguousarray(weights, "<f4").tobytes()}
    if planar.cut is not None:
        around = cut_raster(field, grid, shown.original)
        about["cut"] = about_cut(planar, around)
        buffers["distances"] = distances(planar.cut, around).tobytes()
    return about, buffers


def _reach(planar: CutPlane | None, grid: Grid, map_size: int) -> float:
    """How far the last step looks beyond the box, where the steps before it must be known too."""
    if planar is None:
        return 0.0
    raster = map_raster(planar.first, grid, min(map_size, 64))
    largest = np.abs(np.asarray(planar.first.weights)).max(axis=1)
    return float(max(sum(w * np.linalg.norm(m.on_raster(raster), axis=0).max()
                         for w, m in zip(largest, region.maps, strict=True)) for region in planar.regions))


def _space(field: AbstractField, shown: ShownVolume, grid: Grid, space_size: int,
           reach: float) -> tuple[dict[str, Any], dict[str, bytes]]:
    box = shown.box(grid)
    low, high = np.asarray(box["low"]) - reach, np.asarray(box["high"]) + reach
    size = np.maximum(high - low, 1e-9)
    counts = np.maximum(4, np.ceil(space_size * size / size.max())).astype(int)
    spacing = size / (counts - 1)
    own = shown.volume.grid
    first = own.index_to_point(low / np.asarray(own.spacing))
    lattice = Grid((int(counts[2]), int(counts[1]), int(counts[0])), tuple(spacing), tuple(first), own.direction)
    about = {"shape": counts.tolist(), "origin": low.tolist(), "spacing": spacing.tolist()}
    chain = cut_chain(field)
    if chain is not None:
        said, buffers = _cut_space(chain, shown.frame, lattice)
        if said is not None:
            return {**about, "cut": said}, buffers
    samples: NDArray[Any] = np.einsum("mk,kzyx->zyxm", shown.frame, field.on_grid(lattice))
    return about, {"space": np.ascontiguousarray(samples, "<f4").tobytes()}


def _cut_space(chain: CutChain, frame: NDArray[np.float64],
               lattice: Grid) -> tuple[dict[str, Any] | None, dict[str, bytes]]:
    """In half precision: small where it counts, which is near the cut, and half as much to send."""
    points = lattice.index_to_point(np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1))
    layers = space_layers(chain, points)
    if layers is None:
        return None, {}
    moves = layers.moves.copy()
    moves[..., :3] = layers.moves[..., :3] @ frame.T
    slope = max(np.sqrt(sum((np.diff(m, axis=axis) ** 2).sum(axis=-1).max() / step**2
                            for axis, step in enumerate(lattice.spacing[::-1]))) for m in moves[..., :3])
    about = {"regions": len(moves), "rule": chain.cut.rule, "softness": chain.cut.softness, "slope": float(slope)}
    return about, {name: np.ascontiguousarray(np.clip(values, -6e4, 6e4), "<f2").tobytes()
                   for name, values in (("space", moves), ("depths", layers.depths))}


def differ_only_in(index: int, old: AbstractField | None, new: AbstractField | None) -> bool:
    """Whether two extrusions are the same but for one map, so that a page which knows that map needs no other.

    A page that follows an editor divides that map by the editor's cuts itself, if there is no other.
    """
    if old is None or new is None:
        return False
    before, now = cut_plane(old, MOST_MAPS), cut_plane(new, MOST_MAPS)
    if before is None or now is None or not same_rule(before.first, now.first):
        return False
    if now.count == 1 or (before.cut is None and now.cut is None):
        return now.count == 1 or _same_maps(index, before.first, now.first)
    return False


def _same_maps(index: int, old: Extrusion, new: Extrusion) -> bool:
    maps = zip(old.maps, new.maps, strict=True)
    return all(k == index or equal_fields(a, b) for k, (a, b) in enumerate(maps))


def equal_fields(a: Any, b: Any) -> bool:
    """Whether two fields or regions hold the same numbers."""
    (leaves, form), (others, other_form) = jax.tree_util.tree_flatten(a), jax.tree_util.tree_flatten(b)
    same_form = form == other_form  # type: ignore[operator]  # jax's stub of it says nothing of equality
    return a is b or bool(same_form and all(map(np.array_equal, leaves, others)))
