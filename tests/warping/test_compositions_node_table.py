"""Compositions read from nodes, against the composition itself at every voxel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from voxelwise import chain_at_voxels, values_at_voxels

from deformnb import devices
from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut
from deformnb.rbf.exactness import SHARES
from deformnb.rbf.fields import Blended, DisplacementField, Identity, compose, links_of
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.warping.compositions import ERROR, ComposedEvaluator, NodeTable
from deformnb.warping.exact_places import ExactPlaces
from deformnb.warping.node_walk import smoothness_of

GRID = Grid((30, 33, 41), (1.0, 1.25, 0.8), (100.0, -40.0, 7.0))
# float32 adds a rounding of displacements of a few voxels.
ROUNDING = 2e-6
FINER = Grid((60, 66, 82), (0.5, 0.625, 0.4), GRID.origin)


def points(dim: int, seed: int, centre: np.ndarray, size: float, drag: float) -> ControlPoints:
    rng = np.random.default_rng(seed)
    target = centre[:dim] + size * rng.uniform(-1, 1, (9, dim))
    wave = np.sin((target - centre[:dim]) @ rng.normal(size=(dim, dim)) / 20 + rng.uniform(0, 6, dim))
    return ControlPoints.from_arrays(target + drag * wave, target)


def plane_step(view: str, seed: int, drag: float = 2.0, **options: object) -> Step:
    plane = Plane.from_view(GRID, view)
    return Step((points(2, seed, plane.to_plane(np.array(GRID.center)), 12.0, drag),), plane, support=60.0, **options)  # type: ignore[arg-type]


def space_step(seed: int, drag: float = 2.0, **options: object) -> Step:
    return Step((points(3, seed, np.array(GRID.center), 12.0, drag),), support=60.0, **options)  # type: ignore[arg-type]


def middle(view: str) -> np.ndarray:
    return Plane.from_view(GRID, view).to_plane(np.array(GRID.center))[:2]


def part(view: str) -> RigidPart:
    a, b = middle(view)
    return RigidPart(HalfSpace((a - 19.0, b), (1.0, 0.3)))


def cut(view: str, stops: tuple[bool, bool] = (False, False)) -> Cut:
    a, b = middle(view)
    return Cut(Line(((a, b - 15), (a + 1.5, b), (a - 1, b + (6 if stops[1] else 15))), stops))


def across(view: str) -> Cut:
    a, b = middle(view)
    return Cut(Line(((a - 15, b + 2), (a + 15, b - 1))))


SOLID = RigidPart(HalfSpace(tuple(np.array(GRID.center) - 19.0), (1.0, 0.3, 0.2)))
PULSE = (0.0,) * 60 + (1.0,) + (0.0,) * 60

CHAINS: dict[str, Callable[[int], tuple[Step, ...]]] = {
    "two planes": lambda seed: (plane_step("+z", seed), plane_step("+y", seed + 1)),
    "a plane, then space": lambda seed: (plane_step("-x", seed), space_step(seed + 1)),
    "stages": lambda seed: (space_step(seed, stages=5),),
    "a kernel with a kink": lambda seed: (space_step(seed, 0.2, kernel="wendland_c0"), plane_step("+y", seed, 0.5)),
    "thin plates": lambda seed: (plane_step("+z", seed, 1.0, kernel="thin_plate"), plane_step("+x", seed, 1.0)),
    "modulated": lambda seed: (plane_step("+z", seed, extrusion="modulate", curve="sin(pi*z)"), plane_step("+y", seed)),
    "modulated by a pulse": lambda seed: (plane_step("+z", seed, extrusion="modulate", curve=PULSE), space_step(seed)),
    "modulated by a ramp": lambda seed: (
        plane_step("+z", seed, extrusion="modulate", curve=(0, 0, 1.0, 1, 1)),
        plane_step("-y", seed),
    ),
    "with a rigid part": lambda seed: (plane_step("+z", seed, 0.5, parts=(part("+z"),)), plane_step("+y", seed, 0.5)),
    "with a cut": lambda seed: (plane_step("+z", seed, cuts=(cut("+z"),)), plane_step("+y", seed)),
    "with two cuts": lambda seed: (plane_step("+z", seed, cuts=(cut("+z"), across("+z"))), plane_step("+y", seed)),
    "cut twice": lambda seed: (plane_step("+z", seed, cuts=(cut("+z"),)), plane_step("-y", seed, cuts=(cut("-y"),))),
    "with a cut that stops": lambda seed: (
        plane_step("+z", seed, cuts=(cut("+z", (False, True)),)),
        plane_step("+y", seed),
    ),
    "with a modulated cut": lambda seed: (
        plane_step("+y", seed),
        plane_step("+z", seed, cuts=(cut("+z"),), extrusion="modulate", curve="z*z"),
    ),
    "a rigid part in space": lambda seed: (space_step(seed, 0.5, parts=(SOLID,)), plane_step("+y", seed)),
    "cut by Eq. 8": lambda seed: (plane_step("+z", seed), plane_step("+x", seed, cuts=(cut("+x"),), cut_rule="paper")),
}


def voxel_centres(grid: Grid = GRID) -> np.ndarray:
    z, y, x = np.meshgrid(*map(np.arange, grid.shape), indexing="ij")
    return grid.index_to_point(np.stack([x, y, z], axis=-1))


def all_of(grid: Grid) -> tuple[slice, slice]:
    return slice(0, grid.shape[0]), slice(0, grid.shape[1])


@pytest.mark.sampled(11)
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", CHAINS)
def test_the_error_stays_below_its_bound(name: str, seed: int) -> None:
    grid = FINER if "modulated" in name else GRID  # where the weights change too much from voxel to voxel
    field, block = Deformation(CHAINS[name](seed)).field(grid), all_of(grid)
    table = NodeTable(field, grid)
    found = table.block(block)
    assert found is not None
    d, opacity = values_at_voxels(found, table, block, grid)
    wanted, share = field.displacement_and_opacity(voxel_centres(grid))
    error = np.linalg.norm(np.moveaxis(d, 0, -1) - wanted, axis=-1)
    # Places in float32 fall to the other side of a cut where they are on it.
    beside = np.zeros(grid.shape, dtype=bool) if opacity is None else error > 0.1
    assert beside.mean() < 1e-4
    assert error[~beside].max() <= ERROR * min(grid.spacing) + ROUNDING
    if opacity is not None:
        assert np.abs(opacity - share)[~beside].max() <= 1e-4
    else:
        assert share.min() == 1.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["two planes", "stages", "with a cut", "with two cuts", "modulated"])
def test_most_voxels_are_interpolated(name: str) -> None:
    field, block = Deformation(CHAINS[name](0)).field(FINER), all_of(FINER)
    exactly, asked = ExactPlaces(links_of(field), FINER), set[tuple[float, ...]]()

    def counted(places: np.ndarray) -> Any:
        asked.update(map(tuple, places.T.tolist()))
        return exactly(places)

    table = NodeTable(field, FINER, exactly=counted)
    found = table.block(block)
    assert found is not None
    values_at_voxels(found, table, block, FINER)
    assert len(asked) < 0.4 * FINER.size


@pytest.mark.parametrize(("drag", "spacing"), [(6.0, 4), (4.0, 6), (1.0, 8)])
def test_nodes_are_as_far_apart_as_the_field_is_smooth(drag: float, spacing: int) -> None:
    field = Deformation((space_step(0, drag), plane_step("+y", 1, drag))).field(FINER)
    found = NodeTable(field, FINER).block(all_of(GRID))
    assert found is not None
    assert found.nodes is not None
    below, _ = found.nodes[0]
    assert set(np.diff(np.flatnonzero(np.diff(below)))) == {spacing}


def test_blocks_read_the_same_nodes() -> None:
    field = Deformation((plane_step("+z", 1, 0.3), plane_step("+y", 2, 0.3))).field(GRID)
    block = (slice(7, 15), slice(17, 33))  # between nodes
    tables = NodeTable(field, GRID), NodeTable(field, GRID)
    whole, part = tables[0].block(all_of(GRID)), tables[1].block(block)
    assert whole is not None
    assert part is not None
    wanted, _ = values_at_voxels(whole, tables[0], all_of(GRID), GRID)
    found, _ = values_at_voxels(part, tables[1], block, GRID)
    assert np.abs(found - wanted[:, 7:15, 17:]).max() <= ROUNDING


@pytest.mark.parametrize("name", ["with a rigid part", "with a cut", "cut twice", "cut by Eq. 8"])
def test_blocks_replace_what_lies_in_them(name: str) -> None:
    field = Deformation(CHAINS[name](1)).field(GRID)
    block = (slice(7, 18), slice(9, 26))  # between nodes
    tables = NodeTable(field, GRID), NodeTable(field, GRID)
    whole, part = tables[0].block(all_of(GRID)), tables[1].block(block)
    assert whole is not None
    assert part is not None
    wanted, seen = values_at_voxels(whole, tables[0], all_of(GRID), GRID)
    found, share = values_at_voxels(part, tables[1], block, GRID)
    assert np.linalg.norm(found - wanted[:, 7:18, 9:26], axis=0).max() <= 2 * ERROR * min(GRID.spacing)
    if seen is not None and share is not None:
        assert np.abs(share - seen[7:18, 9:26]).max() <= 1e-4


def test_a_bump_narrower_than_the_nodes_is_not_lost() -> None:
    centre = np.array(GRID.center)
    bump = Step((ControlPoints.from_arrays([centre], [centre + 0.7]),), support=2.0, trend="none")
    field = Deformation((bump, plane_step("+z", 0))).field(GRID)
    assert NodeTable(field, GRID).block(all_of(GRID)) is None


def test_fields_of_unknown_smoothness_are_evaluated_at_every_voxel() -> None:
    sampled = DisplacementField(np.zeros((*GRID.shape, 3)), GRID)
    assert smoothness_of(compose(Identity(3), sampled)) is None
    assert smoothness_of(Blended((Identity(3), Identity(3)))) is None
    noisy = DisplacementField(np.random.default_rng(0).normal(size=(*GRID.shape, 3)), GRID)
    field = compose(plane_step("+z", 0).field(GRID), noisy)
    d, _ = chain_at_voxels(field, GRID)
    wanted = field.displacement(voxel_centres())
    assert np.abs(np.moveaxis(d, 0, -1) - wanted).max() < 1e-4


@pytest.mark.skipif(not devices.is_host(), reason="a GPU evaluates all voxels")
@pytest.mark.parametrize("kernel", ["wendland_c2", "gaussian", "thin_plate"])
def test_a_fit_of_many_points_is_read_from_nodes_to_a_thousandth_of_a_voxel(kernel: str) -> None:
    grid = Grid((96, 104, 110), (1.0, 1.25, 0.8), (100.0, -40.0, 7.0))
    rng = np.random.default_rng(3)
    target = np.array(grid.center) + 40 * rng.uniform(-1, 1, (40, 3))
    dragged = ControlPoints.from_arrays(target + rng.normal(size=(40, 3)), target)
    field = Step((dragged,), kernel=kernel, support=150.0).field(grid)
    chain = ComposedEvaluator(field, grid)
    assert not chain.is_single
    block = slice(30, 60), slice(20, 70)
    chain.prepare()
    d, opacity = values_at_voxels(chain.block(block), chain, block, grid)
    assert opacity is None
    error = np.linalg.norm(np.moveaxis(d, 0, -1) - field.displacement(voxel_centres(grid)[block]), axis=-1)
    assert 0 < error.max() <= SHARES["lattice"] * min(grid.spacing)


def test_a_fit_that_reaches_few_voxels_is_summed_at_every_voxel() -> None:
    grid = Grid((104, 104, 104))
    field = fit_rbf(points(3, 1, np.array(grid.center), 12.0, 1.0), support=20.0)
    assert ComposedEvaluator(field, grid).is_single
    assert ComposedEvaluator(space_step(0).field(GRID), GRID).is_single
