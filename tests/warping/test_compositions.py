"""Compositions with cuts, read from nodes, against the fields themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from oracle import assert_close
from voxelwise import chain_at_voxels

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import CUT_RULES, Cut
from deformnb.rbf.fields import DisplacementField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.compositions import ERROR, ComposedEvaluator
from deformnb.warping.warper import apply_opacity, warp

GRID = Grid((20, 24, 28), (1.0, 0.5, 1.5), (100.0, -40.0, 7.0))


def step(view: str, *, rule: str | None = None, stops: tuple[bool, bool] = (False, False), **options: object) -> Step:
    plane = Plane.from_view(GRID, view)
    a, b = plane.to_plane(np.array(GRID.center))[:2]
    apart = ControlPoints.from_arrays(
        [[a - 3, b], [a - 5, b + 2], [a + 3, b], [a + 5, b - 2]],
        [[a - 5, b], [a - 6, b + 2], [a + 4, b + 1], [a + 7, b - 2]],
    )
    line = Line(((a, b - 9), (a + 0.5, b), (a - 1, b + (2 if stops[1] else 9))), stops)
    cuts = () if rule is None else (Cut(line),)
    return Step((apart,), plane, cuts=cuts, cut_rule=rule or "source", **options)  # type: ignore[arg-type]


CHAINS: dict[str, Callable[[str], tuple[Step, ...]]] = {
    "cut, then bent": lambda rule: (step("+z", rule=rule), step("+y")),
    "bent, then cut": lambda rule: (step("-x"), step("+z", rule=rule)),
    "cut twice": lambda rule: (step("+x", rule=rule), step("-y", rule=rule, extrusion="modulate", curve="z")),
    "cut between": lambda rule: (step("+z"), step("-y", rule=rule, extrusion="modulate", curve="1-z"), step("+x")),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", CHAINS)
def test_a_chain_is_its_composition(name: str, rule: str) -> None:
    field = Deformation(CHAINS[name](rule)).field(GRID)
    assert not ComposedEvaluator(field, GRID).is_single
    d, opacity = chain_at_voxels(field, GRID)
    nz, ny, nx = GRID.shape
    index = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), np.arange(nz), indexing="ij"), axis=-1)
    points = GRID.index_to_point(index).transpose(2, 1, 0, 3)
    wanted, share = field.displacement_and_opacity(points)
    # Next to a border a place that is a rounding to one side of it shows the other region: there D jumps.
    same = np.linalg.norm(np.moveaxis(d, 0, -1) - wanted, axis=-1) <= ERROR * min(GRID.spacing) + 1e-5
    assert same.mean() > 0.995
    assert opacity is not None
    assert np.quantile(np.abs(opacity - share), 0.995) <= 1e-4
    assert opacity.min() < 0.1  # there is something to be seen of the cut at all


def test_a_chain_beside_a_cut_that_stops_is_its_composition() -> None:
    field = Deformation((step("+z", rule="source", stops=(False, True)), step("+y"))).field(GRID)
    d, opacity = chain_at_voxels(field, GRID)
    index = np.stack(np.meshgrid(*map(np.arange, GRID.shape), indexing="ij"), axis=-1)
    wanted, share = field.displacement_and_opacity(GRID.index_to_point(index[..., ::-1]))
    same = np.linalg.norm(np.moveaxis(d, 0, -1) - wanted, axis=-1) <= ERROR * min(GRID.spacing) + 1e-5
    assert same.mean() > 0.995
    assert opacity is not None
    assert np.quantile(np.abs(opacity - share)[same], 0.995) <= 1e-4


def test_a_cut_that_begins_and_ends_far_away_is_chosen_beside_as_exactly() -> None:
    grid = Grid((48, 56, 64), (0.5, 0.6, 0.5), (100.0, -40.0, 7.0))
    front, middle = Plane.from_view(grid, "+z"), np.array(Plane.from_view(grid, "+z").to_plane(grid.center))[:2]
    source = middle + np.array([[-3.0, 0], [-5, 4], [3, 0], [5, -4]])
    points = ControlPoints.from_arrays(source, source + np.array([[-2.0, 0], [-1, 0.5], [1, 1], [2, 0]]))
    found = []
    for reach in (1e2, 1e7):
        cut = Cut(Line(tuple(map(tuple, middle + reach * np.array([[-0.08, -1.0], [0.08, 1.0]])))))
        chain = Step((points,), front, cuts=(cut,)), Step((points,), Plane.from_view(grid, "+y"))
        found.append(chain_at_voxels(Deformation(chain).field(grid), grid)[0])
    apart = np.linalg.norm(found[0] - found[1], axis=0) > 2 * ERROR * min(grid.spacing)
    assert not apart.any()


def test_without_cuts_a_chain_is_within_the_error_of_its_nodes() -> None:
    field = Deformation((step("+z"), step("+y"))).field(GRID)
    d, opacity = chain_at_voxels(field, GRID)
    assert opacity is None
    points = GRID.index_to_point([[3.0, 4.0, 5.0], [20.0, 11.0, 9.0]])
    found = np.array([[part[5, 4, 3], part[9, 11, 20]] for part in d]).T
    assert_close(found, field.displacement(points), atol=ERROR * min(GRID.spacing))


@pytest.mark.parametrize("method", ["linear", "nearest"])
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", CHAINS)
def test_a_warp_beside_composed_cuts_is_that_of_every_voxel(name: str, rule: str, method: str) -> None:
    grid = Grid((40, 44, 52), (0.5, 0.3, 0.7), (100.0, -40.0, 7.0))
    field = Deformation(CHAINS[name](rule)).field(grid)
    index = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), axis=-1)
    d, opacity = field.displacement_and_opacity(grid.index_to_point(index[..., ::-1]))
    volume = Volume.from_array((50 + index.sum(axis=-1)).astype(np.float32), spacing=grid.spacing, origin=grid.origin)
    found = warp(volume, field, fill=-20.0, method=method).values
    every = warp(volume, DisplacementField(d, grid), fill=-20.0, method=method).values
    wanted = apply_opacity(every.copy(), opacity.astype(np.float32), np.float32(-20), discrete=method == "nearest")
    # Voxels are one grey level apart along each axis; distances to a border within a rounding decide otherwise.
    apart = np.abs(found - wanted) > (3 * ERROR + 0.02 if method == "linear" else 1e-4)
    assert apart.mean() < (2e-3 if method == "linear" else 2e-2)
    assert (opacity == 0).any()
