"""Displacement fields as textures of the GPU: maps over a plane, weighted along its normal, or samples in space.

An extrusion is sent as it is, K small maps, those of every region if it is cut; anything else is sampled
coarsely in space. Of a composition the last step is separate if it is an extrusion, since that is the one being
edited. All moments of an animation are sent as maps over one plane, one behind the other.

At cuts every region has its own maps, with its distance to each cut. A map is never interpolated across a cut. The GPU
decides at every sample which region is visible there, by the rule of :mod:`deformnb.rbf.cuts`; regions without
control points are sent as such, with no displacement.

A composition in which one step has cuts is sent as samples in space, each region separately. The field next to a cut is
smooth in every region, beyond its edge too, so it may be sampled coarsely and interpolated: the displacement of all
steps together, the depth within the region of the place that it leads to, and the depth of the sample itself. The GPU
chooses by them at every place, as :mod:`deformnb.rbf.cuts` does.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from deformnb._jax import jax
from deformnb.document.json_regions import region_to_data
from deformnb.rbf.cuts import Decoupled, Sides, sides_of
from deformnb.rbf.extrusion import Extrusion, replicate
from deformnb.rbf.fields import AbstractField, Composed, Identity
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.widgets.messages.views import FieldContent, PlanarData, PlaneCutData, SpaceCutData, SpaceData
from deformnb.widgets.packed_volume import PackedVolume

MAP_SIZE = 192
"""Samples of a displacement map along its longer side."""

MOST_REGIONS = 32
"""Places that the shaders have for regions."""

# Distances along the longer side. Straight lines are exact at any number; a corner of a polygon is rounded by less than
# half of such a step, a quarter of a millimetre on a body.
CUT_STEPS = 512

# Places of origin beyond the box are needed too, where the last samples would be constant.
CUT_MARGIN = 0.125

# Nodes at which regions are searched: small ones without a point must be found as well.
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
        """An extrusion with all that they have in common: plane, depth and weights."""
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
    """Check whether two extrusions have plane, depths and weights in common."""
    same = a.plane == b.plane and a.depth == b.depth and len(a.maps) == len(b.maps)
    return same and np.array_equal(a.knots, b.knots) and np.array_equal(a.weights, b.weights)


def with_still_regions(plane: CutPlane, grid: Grid, most: int) -> CutPlane | None:
    """With the regions that have no points, as far as they are in the picture; None if those are too many."""
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


def cut_raster(field: Extrusion, grid: Grid, other: Grid, steps: int = CUT_STEPS) -> Raster:
    """Nodes over the picture's plane around the boxes of both grids."""
    at = field.plane.to_plane(np.concatenate([grid.corners(), other.corners()]))[:, :2]
    size = np.maximum(np.ptp(at, axis=0), 1e-9 * grid.diagonal)
    low, size = at.min(axis=0) - CUT_MARGIN * size.max(), size + 2 * CUT_MARGIN * size.max()
    counts = np.maximum(8, np.ceil(steps * size / size.max())).astype(int)
    return Raster((int(counts[1]), int(counts[0])), tuple(size / (counts - 1)), tuple(low))


def distances(field: Decoupled, raster: Raster) -> NDArray[np.float32]:
    """Signed distances to every cut at the nodes of a raster: (cuts, rows, columns)."""
    b, a = np.meshgrid(raster.rows, raster.columns, indexing="ij")
    at = np.stack([a, b], axis=-1)
    return np.stack([r.signed_distance(at) for r in field.regions]).astype("<f4")


def softness_of(plane: CutPlane, grid: Grid) -> float:
    """The width of the ramp at a cut, also at one that a front end will draw: a voxel as it is seen on the plane."""
    if plane.cut is not None:
        return plane.cut.softness
    along = np.abs(plane.first.plane.frame[:2] @ np.asarray(grid.direction)) ** 2
    return float((along @ np.asarray(grid.spacing)).mean())


def describe_cut(plane: CutPlane, raster: Raster) -> PlaneCutData:
    """Entries of a message about the cuts without their distances. ``id`` names the distances, which seldom change."""
    assert plane.cut is not None
    data = [region_to_data(r) for r in plane.cut.regions]
    name = hashlib.sha256(repr((data, raster)).encode()).hexdigest()[:16]
    return {
        "shape": [len(data), *raster.shape],
        "origin": list(raster.origin),
        "spacing": list(raster.spacing),
        "sides": [list(sides) for sides in plane.sides],
        "rule": plane.cut.rule,
        "regions": data,
        "id": name,
    }


@dataclass(frozen=True, eq=False)
class CutChain:
    """A composition around the one of its steps that keeps its cuts.

    Parameters
    ----------
    later : the steps after it, the last one first; they are undone first.
    cut : the step.
    earlier : the steps before it, in the same order.
    """

    later: tuple[AbstractField, ...]
    cut: Decoupled
    earlier: tuple[AbstractField, ...]

    @property
    def is_exact(self) -> bool:
        """True if no other step has cuts, which would be smeared between samples."""
        return not any(f.has_cuts for f in (*self.later, *self.earlier))


def cut_chain(field: AbstractField) -> CutChain | None:
    """The chain of a composition, around the last of its steps that has cuts; None if there is none."""
    steps = _steps(field)
    for k, step in enumerate(steps):
        if isinstance(step, Decoupled):
            return CutChain(tuple(steps[:k]), step, tuple(steps[k + 1 :]))
    return None


def chain_is_exact(field: AbstractField) -> bool:
    """Check whether a composition has cuts in one of its steps only."""
    chain = cut_chain(field)
    return chain is not None and chain.is_exact


def _steps(field: AbstractField) -> list[AbstractField]:
    """In the order in which they are undone, the last one first."""
    return [*_steps(field.then), *_steps(field.first)] if isinstance(field, Composed) else [field]


@dataclass(frozen=True, eq=False)
class SpaceLayers:
    """Data of every sample.

    Parameters
    ----------
    moves : (regions, ..., 4), the displacement, and the depth within the region of where it leads to.
    depths : (regions, ..., 2), the depth of the sample itself, and the share of it that other steps leave.
    """

    moves: NDArray[np.float64]
    depths: NDArray[np.float64]


def space_layers(chain: CutChain, points: NDArray[np.float64]) -> SpaceLayers | None:
    """The samples of every region at points (..., 3); None if there are too many regions."""
    cut = chain.cut
    before, kept = _trace_sources(chain.later, points)
    here = _distances(cut, before)
    sides = _all_sides(cut, here)
    if len(sides) > MOST_REGIONS:
        return None
    fields = dict(zip(cut.sides, cut.fields, strict=True))
    moves = np.empty((len(sides), *points.shape[:-1], 4))
    depths = np.empty((*moves.shape[:-1], 2))
    for r, side in enumerate(sides):
        place = before + fields.get(side, Identity(3)).displacement(before)
        end, left = _trace_sources(chain.earlier, place)
        moves[r, ..., :3], moves[r, ..., 3] = end - points, _depth(_distances(cut, place), side)
        depths[r, ..., 0], depths[r, ..., 1] = _depth(here, side), kept * left
    return SpaceLayers(moves, depths)


def _trace_sources(steps: tuple[AbstractField, ...], points: NDArray[np.float64]) -> tuple[NDArray[np.float64], Any]:
    """Sources of points, and the share of them that is seen."""
    at, kept = points, np.ones(points.shape[:-1])
    for step in steps:
        d, opacity = step.displacement_and_opacity(at)
        at, kept = at + d, kept * opacity
    return at, kept


def _distances(cut: Decoupled, points: NDArray[np.float64]) -> NDArray[np.float64]:
    at = points if cut.plane is None else cut.plane.to_plane(points)[..., :2]
    return np.stack([region.signed_distance(at) for region in cut.regions], axis=-1)


def _depth(distances: NDArray[np.float64], side: Sides) -> NDArray[np.float64]:
    return np.asarray((distances * np.where(side, -1.0, 1.0)).min(axis=-1))


def _all_sides(cut: Decoupled, here: NDArray[np.float64]) -> list[Sides]:
    """The regions that have a field, and those that are there without one."""
    found = np.unique((here < 0).reshape(-1, len(cut.regions)), axis=0)
    return sorted({*cut.sides, *map(tuple, found.tolist())})


# Weights at equal steps of depth: as many as a curve has knots, so that it is exact; a hat function with knots
# in between errs by less than a thousandth.
_DEPTHS = 1025

# The GPU holds at most 256 layers of a texture by the standard, and a sample adds up those whose weight is not zero.
MOST_MAPS = 64


@dataclass(frozen=True, eq=False)
class FieldTextures:
    """Textures of a deformation field for a GPU: a message, whose buffers are named in ``content.buffers``.

    ``content.coarse`` is true where cuts of several earlier steps are smeared between samples in space.
    """

    content: FieldContent
    buffers: list[bytes]

    @property
    def size(self) -> int:
        """Bytes of the buffers."""
        return sum(map(len, self.buffers))

    def buffer(self, name: str) -> bytes:
        """One of them by its name."""
        return self.buffers[self.content.buffers.index(name)]

    def without(self, name: str) -> FieldTextures:
        """The same message without one of them, for a front end that has it."""
        kept = [(n, b) for n, b in zip(self.content.buffers, self.buffers, strict=True) if n != name]
        return FieldTextures(structs.replace(self.content, buffers=[n for n, _ in kept]), [b for _, b in kept])

    def fields(self) -> dict[str, Any]:
        """The content by name, for a message that has more."""
        return structs.asdict(self.content)


def field_textures(
    field: AbstractField | None, shown: PackedVolume, output: Grid | None, map_size: int, space_size: int
) -> FieldTextures:
    """The maps of a field on the box of ``output``.

    Parameters
    ----------
    map_size : samples of a map along its longer side.
    space_size : samples in space along the longest side.
    """
    grid = output or shown.original
    planar, rest = _parts(field, grid)
    buffers: dict[str, bytes] = {}
    maps: PlanarData | None = None
    space: SpaceData | None = None
    if planar is not None:
        maps, buffers = _planar(planar, shown, grid, map_size)
    if rest is not None:
        space, more = _space(rest, shown, grid, space_size, _reach(planar, grid, map_size))
        buffers |= more
    is_coarse = rest is not None and rest.has_cuts and ("cut" not in (space or {}) or not chain_is_exact(rest))
    content = FieldContent(box=shown.box(grid), planar=maps, space=space, coarse=is_coarse, buffers=list(buffers))
    return FieldTextures(content, list(buffers.values()))


def count_maps(field: AbstractField | None) -> int | None:
    """Count the maps of the last extrusion, in each region; None if the last step is no extrusion."""
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


def _planar(planar: CutPlane, shown: PackedVolume, grid: Grid, map_size: int) -> tuple[PlanarData, dict[str, bytes]]:
    field = planar.first
    raster = map_raster(field, grid, map_size)
    maps = np.stack([np.moveaxis(m.sample_on_raster(raster), 0, -1) for region in planar.regions for m in region.maps])
    depths = np.linspace(0.0, 1.0, 2 if field.is_replication else _DEPTHS)
    weights = np.stack([np.interp(depths, field.knots, w) for w in np.asarray(field.weights)])
    plane, turn = field.plane, shown.frame
    same = field.is_replication and bool((weights[:, 0] == 1).all()) and planar.count == 1
    about: PlanarData = {
        "shape": list(maps.shape[:3]),
        "origin": list(raster.origin),
        "spacing": list(raster.spacing),
        "depth": list(field.depth),
        "isReplicated": same,
        "cut": None,
        "softness": softness_of(planar, shown.original),
        "plane": {
            "origin": shown.to_frame(np.asarray(plane.origin)).tolist(),
            "u": (turn @ np.asarray(plane.u)).tolist(),
            "v": (turn @ np.asarray(plane.v)).tolist(),
            "n": (turn @ np.asarray(plane.normal)).tolist(),
        },
    }
    buffers = {
        "maps": np.ascontiguousarray(maps, "<f4").tobytes(),
        "weights": np.ascontiguousarray(weights, "<f4").tobytes(),
    }
    if planar.cut is not None:
        around = cut_raster(field, grid, shown.original)
        about["cut"] = describe_cut(planar, around)
        buffers["distances"] = distances(planar.cut, around).tobytes()
    return about, buffers


def _reach(planar: CutPlane | None, grid: Grid, map_size: int) -> float:
    """Distance by which the last step samples beyond the box, where the steps before it must be known too."""
    if planar is None:
        return 0.0
    raster = map_raster(planar.first, grid, min(map_size, 64))
    largest = np.abs(np.asarray(planar.first.weights)).max(axis=1)
    return float(
        max(
            sum(
                w * np.linalg.norm(m.sample_on_raster(raster), axis=0).max()
                for w, m in zip(largest, region.maps, strict=True)
            )
            for region in planar.regions
        )
    )


def nodes_along(size: NDArray[np.float64], most: int) -> NDArray[np.int64]:
    """Numbers of nodes along the axes of a box of this size, at most ``most``."""
    return np.maximum(4, np.ceil(most * size / size.max())).astype(int)


def _space(
    field: AbstractField, shown: PackedVolume, grid: Grid, space_size: int, reach: float
) -> tuple[SpaceData, dict[str, bytes]]:
    box = shown.box(grid)
    low, high = np.asarray(box["low"]) - reach, np.asarray(box["high"]) + reach
    size = np.maximum(high - low, 1e-9)
    counts = nodes_along(size, space_size)
    spacing = size / (counts - 1)
    own = shown.volume.grid
    first = own.index_to_point(low / np.asarray(own.spacing))
    lattice = replace(
        own, shape=(int(counts[2]), int(counts[1]), int(counts[0])), spacing=tuple(spacing), origin=tuple(first)
    )
    about: SpaceData = {"shape": counts.tolist(), "origin": low.tolist(), "spacing": spacing.tolist()}
    chain = cut_chain(field)
    if chain is not None:
        said, buffers = _cut_space(chain, shown.frame, lattice)
        if said is not None:
            return {**about, "cut": said}, buffers
    samples: NDArray[Any] = np.einsum("mk,zyxk->zyxm", shown.frame, field.sample_on_grid(lattice))
    return about, {"space": np.ascontiguousarray(samples, "<f4").tobytes()}


def _cut_space(
    chain: CutChain, frame: NDArray[np.float64], lattice: Grid
) -> tuple[SpaceCutData | None, dict[str, bytes]]:
    """In half precision: small where it counts, which is near the cut, and half as much to send."""
    points = lattice.index_to_point(np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1))
    layers = space_layers(chain, points)
    if layers is None:
        return None, {}
    moves = layers.moves.copy()
    moves[..., :3] = layers.moves[..., :3] @ frame.T
    slope = max(
        np.sqrt(
            sum(
                (np.diff(m, axis=axis) ** 2).sum(axis=-1).max() / step**2
                for axis, step in enumerate(lattice.spacing[::-1])
            )
        )
        for m in moves[..., :3]
    )
    about: SpaceCutData = {
        "regions": len(moves),
        "rule": chain.cut.rule,
        "softness": chain.cut.softness,
        "slope": float(slope),
    }
    return about, {
        name: np.ascontiguousarray(np.clip(values, -6e4, 6e4), "<f2").tobytes()
        for name, values in (("space", moves), ("depths", layers.depths))
    }


def differ_in_one_map(index: int, old: AbstractField | None, new: AbstractField | None) -> bool:
    """Check whether two extrusions are the same but for one map, so that a front end with that map needs no other.

    A front end that follows an editor divides that map by the editor's cuts itself, if there is no other.
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
    """Check whether two fields or regions hold the same numbers."""
    (leaves, form), (others, other_form) = jax.tree_util.tree_flatten(a), jax.tree_util.tree_flatten(b)
    same_form = form == other_form  # type: ignore[operator]  # jax's stub of it lacks equality
    return a is b or bool(same_form and all(map(np.array_equal, leaves, others)))
