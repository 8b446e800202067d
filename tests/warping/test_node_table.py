"""Compositions read from nodes, against the composition itself at every voxel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from voxelwise import at_voxels, chain_at_voxels

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import AbstractField, Blended, DisplacementField, Identity, compose
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.warping.node_table import ERROR, NodeTable, smoothness_of

GRID = Grid((30, 33, 41), (1.0, 1.25, 0.8), (100.0, -40.0, 7.0))
# float32 adds a rounding of displacements of a few voxels.
ROUNDING = 2e-6
FINER = Grid((60, 66, 82), (0.5, 0.625, 0.4), GRID.origin)
BLOCK = (slice(0, GRID.shape[0]), slice(0, GRID.shape[1]))


def points(dim: int, seed: int, centre: np.ndarray, size: float, drag: float) -> ControlPoints:
    rng = np.random.default_rng(seed)
    target = centre[:dim] + size * rng.uniform(-1, 1, (9, dim))
    wave = np.sin((target - centre[:dim]) @ rng.normal(size=(dim, dim)) / 20 + rng.uniform(0, 6, dim))
    return ControlPoints.from_arrays(target + drag * wave, target)


def on_plane(view: str, seed: int, drag: float = 2.0, **options: object) -> Step:
    plane = Plane.along(GRID, view)
    return Step((points(2, seed, plane.to_plane(np.array(GRID.center)), 12.0, drag),), plane, support=60.0,
                **options)  # type: ignore[arg-type]


def in_space(seed: int, drag: float = 2.0, **options: object) -> Step:
    return Step((points(3, seed, np.array(GRID.center), 12.0, drag),), support=60.0, **options)  # type: ignore[arg-type]


def middle(view: str) -> np.ndarray:
    return Plane.along(GRID, view).to_plane(np.array(GRID.center))[:2]


def part(view: str) -> RigidPart:
    a, b = middle(view)
    return RigidPart(HalfSpace((a - 19.0, b), (1.0, 0.3)))


def cut(view: str) -> Cut:
    a, b = middle(view)
    return Cut(Line(((a, b - 15), (a + 1.5, b), (a - 1, b + 15))))


SOLID = RigidPart(HalfSpace(tuple(np.array(GRID.center) - 19.0), (1.0, 0.3, 0.2)))
PULSE = (0.0,) * 60 + (1.0,) + (0.0,) * 60

CHAINS: dict[str, Callable[[int], tuple[Step, ...]]] = {
    "two planes": lambda seed: (on_plane("+z", seed), on_plane("+y", seed + 1)),
    "a plane, then space": lambda seed: (on_plane("-x", seed), in_space(seed + 1)),
    "stages": lambda seed: (in_space(seed, stages=5),),
    "a kernel with a kink": lambda seed: (in_space(seed, 0.2, kernel="wendland_c0"), on_plane("+y", seed, 0.5)),
    "thin plates": lambda seed: (on_plane("+z", seed, 1.0, kernel="thin_plate"), on_plane("+x", seed, 1.0)),
    "modulated": lambda seed: (on_plane("+z", seed, extrusion="modulate", curve="sin(pi*z)"), on_plane("+y", seed)),
    "modulated by a pulse": lambda seed: (on_plane("+z", seed, extrusion="modulate", curve=PULSE), in_space(seed)),
    "modulated by a ramp": lambda seed: (on_plane("+z", seed, extrusion="modulate", curve=(0, 0, 1.0, 1, 1)),
                                         on_plane("-y", seed)),
    "beside a rigid part": lambda seed: (on_plane("+z", seed, 0.5, parts=(part("+z"),)), on_plane("+y", seed, 0.5)),
    "beside a cut": lambda seed: (on_plane("+z", seed, cuts=(cut("+z"),)), on_plane("+y", seed)),
    "a rigid part in space": lambda seed: (in_space(seed, 0.5, parts=(SOLID,)), on_plane("+y", seed)),
    "cut by Eq. 8": lambda seed: (on_plane("+z", seed), on_plane("+x", seed, cuts=(cut("+x"),), cut_rule="paper")),
}


def voxel_centres() -> np.ndarray:
    z, y, x = np.meshgrid(*map(np.arange, GRID.shape), indexing="ij")
    return GRID.index_to_point(np.stack([x, y, z], axis=-1))


def table_of(field: AbstractField, asked: list[int] | None = None, grid: Grid = GRID) -> NodeTable:
    def exactly(places: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if asked is not None:
            asked.append(len(np.unique(places, axis=1).T))
        d, opacity = field.seen(places.T.astype(np.float64) + origin)
        return d.T, opacity

    return NodeTable(field, exactly, grid)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", CHAINS)
def test_the_error_stays_below_its_bound(name: str, seed: int) -> None:
    field = Deformation(CHAINS[name](seed)).field(GRID)
    table = table_of(field)
    found = table.block(BLOCK)
    if found is None:  # so bent that every voxel is evaluated: the bound holds by itself
        return
    d, opacity = at_voxels(found, table, BLOCK, GRID)
    wanted, share = field.seen(voxel_centres())
    error = np.linalg.norm(np.moveaxis(d, 0, -1) - wanted, axis=-1)
    # Places in float32 fall to the other side of a cut where they lie on it.
    beside = np.zeros(GRID.shape, dtype=bool) if opacity is None else error > 0.1
    assert beside.mean() < 1e-4
    assert error[~beside].max() <= ERROR * min(GRID.spacing) + ROUNDING
    if opacity is not None:
        assert np.abs(opacity - share)[~beside].max() <= 1e-4
    else:
        assert share.min() == 1.0


@pytest.mark.parametrize("name", ["two planes", "stages", "beside a cut", "modulated"])
def test_most_voxels_are_interpolated(name: str) -> None:
    asked: list[int] = []
    block = (slice(0, FINER.shape[0]), slice(0, FINER.shape[1]))
    table = table_of(Deformation(CHAINS[name](0)).field(FINER), asked, FINER)
    found = table.block(block)
    assert found is not None
    at_voxels(found, table, block, FINER)
    assert sum(asked) < 0.4 * FINER.size


@pytest.mark.parametrize(("drag", "spacing"), [(6.0, 4), (4.0, 6), (1.0, 8)])
def test_nodes_are_as_far_apart_as_the_field_is_smooth(drag: float, spacing: int) -> None:
    field = Deformation((in_space(0, drag), on_plane("+y", 1, drag))).field(FINER)
    found = table_of(field, grid=FINER).block(BLOCK)
    assert found is not None
    assert found.nodes is not None
    (below, _), _ = found.nodes
    assert set(np.diff(np.flatnonzero(np.diff(below)))) == {spacing}


def test_blocks_read_the_same_nodes() -> None:
    field = Deformation((on_plane("+z", 1, 0.3), on_plane("+y", 2, 0.3))).field(GRID)
    block = (slice(7, 15), slice(17, 33))  # between nodes
    tables = table_of(field), table_of(field)
    whole, part = tables[0].block(BLOCK), tables[1].block(block)
    assert whole is not None
    assert part is not None
    wanted, _ = at_voxels(whole, tables[0], BLOCK, GRID)
    found, _ = at_voxels(part, tables[1], block, GRID)
    assert np.abs(found - wanted[:, 7:15, 17:]).max() <= ROUNDING


def test_a_bump_narrower_than_the_nodes_is_not_lost() -> None:
    centre = np.array(GRID.center)
    bump = Step((ControlPoints.from_arrays([centre], [centre + 0.7]),), support=2.0, trend="none")
    field = Deformation((bump, on_plane("+z", 0))).field(GRID)
    assert table_of(field).block(BLOCK) is None


def test_fields_of_unknown_smoothness_are_evaluated_at_every_voxel() -> None:
    sampled = DisplacementField(np.zeros((*GRID.shape, 3)), GRID)
    assert smoothness_of(compose(Identity(3), sampled)) is None
    assert smoothness_of(Blended((Identity(3), Identity(3)))) is None
    noisy = DisplacementField(np.random.default_rng(0).normal(size=(*GRID.shape, 3)), GRID)
    field = compose(on_plane("+z", 0).field(GRID), noisy)
    d, _ = chain_at_voxels(field, GRID)
    wanted = field.displacement(voxel_centres())
    assert np.abs(np.moveaxis(d, 0, -1) - wanted).max() < 1e-4
