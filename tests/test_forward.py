"""Points move with the matter they mark: the inverse of the backward map, beside cuts and rigid parts too."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
import oracle
import pytest
from test_cuts import MIDDLE, fitted, pushed, scattered
from test_rigid_parts import BOX, SUPPORT, TURN, points, within
from test_warp import OBLIQUE, STRAIGHT, Wave, centres, extruded

from deformnb.cuts import CUT_RULES, Decoupled, sides_of
from deformnb.errors import DeformError
from deformnb.extrusion import extrude, replicate
from deformnb.fields import AbstractField, DisplacementField, Identity, compose
from deformnb.forward import warp_points
from deformnb.plane import Plane
from deformnb.regions import HalfSpace
from deformnb.rigid_parts import RigidPart, fit_rigid
from deformnb.volume import Grid, Volume
from deformnb.warp import warp


@pytest.mark.parametrize("field", [Wave(1.5, 0.3), Wave(1.5, 0.3, dim=2), Identity(3),
                                   extruded(Plane.along(OBLIQUE, "+y"), OBLIQUE, "modulate")])
def test_points_land_where_the_field_brings_them(field: AbstractField) -> None:
    points = np.random.default_rng(6).uniform(-20, 20, (40, 5, field.dim))
    moved, converged = warp_points(points, field)
    assert moved.shape == points.shape
    assert converged.shape == (40, 5)
    assert converged.all()
    assert np.abs(moved + field.displacement(moved) - points).max() <= 1e-6 * 45  # the default tolerance


def test_points_move_against_the_displacement() -> None:
    field = DisplacementField(np.broadcast_to([2.0, 0.0, -1.0], (*STRAIGHT.shape, 3)).copy(), STRAIGHT)
    moved, converged = warp_points([[3.0, 4.0, 5.0]], field)
    assert converged.all()
    assert moved[0] == pytest.approx([1.0, 4.0, 6.0], abs=1e-5)


def test_a_bright_voxel_is_found_where_its_point_went() -> None:
    grid = Grid((30, 32, 34), (1.0, 0.8, 1.2))
    at = np.array([[15.0, 14.0, 16.0]])
    field = Wave(2.0, 0.2)
    points = centres(grid)
    blob = Volume(np.exp(-((points - at[0]) ** 2).sum(-1) / 8), grid)
    deformed = warp(blob, field).values
    k, j, i = np.unravel_index(deformed.argmax(), grid.shape)
    moved, _ = warp_points(at, field)
    assert np.abs(moved[0] - grid.index_to_point([i, j, k])).max() < max(grid.spacing)


def test_what_no_place_maps_to_is_flagged_and_finite() -> None:
    @partial(jax.tree_util.register_dataclass, data_fields=[], meta_fields=["amplitude", "frequency", "dim"])
    @dataclass(frozen=True)
    class Collapse(Wave):
        """Everything is looked up at the origin: the backward map has no other value."""

        def _at(self, x: Any, xp: Any) -> Any:
            return -x

    moved, converged = warp_points([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]], Collapse())
    assert converged.tolist() == [True, False]
    assert np.isfinite(moved).all()


def test_folds_do_not_stop_the_search() -> None:
    field = Wave(4.0, 0.6)  # slope 2.4: folds
    points = np.random.default_rng(7).uniform(-20, 20, (300, 3))
    moved, converged = warp_points(points, field)
    assert np.isfinite(moved).all()
    assert np.abs(moved + field.displacement(moved) - points)[converged].max() < 1e-4
    assert converged.mean() > 0.9  # a continuous map this close to the identity is onto: nearly all are found


def test_no_points() -> None:
    moved, converged = warp_points(np.zeros((0, 3)), Wave())
    assert moved.shape == (0, 3)
    assert converged.shape == (0,)


@pytest.mark.parametrize(("given", "field", "message"), [
    ([[1.0, 2.0]], Wave(), "3 coordinates"), (3.0, Wave(), "3 coordinates"),
    ([[1.0, 2.0, 3.0], [1.0, np.nan, 3.0]], Wave(), "point 1"),
])
def test_what_are_no_points_is_refused(given: Any, field: AbstractField, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        warp_points(given, field)


# ---- beside rigid parts and cuts -------------------------------------------------------------------------------------


def test_points_in_a_rigid_part_move_with_it() -> None:
    fit = fit_rigid(points(), [RigidPart(BOX, TURN)], support=SUPPORT)
    at = within(BOX)
    moved, converged = warp_points(at, fit)
    assert converged.all()
    oracle.assert_close(moved, TURN(at), atol=1e-3)
    landmarks, converged = warp_points(points().source, fit)
    assert converged.all()
    oracle.assert_close(landmarks, points().target, atol=1e-3)


@pytest.mark.parametrize("rule", CUT_RULES)
def test_each_point_moves_with_the_region_it_lies_in(rule: str) -> None:
    """y + D_k(y) = x with the field k of the region of x; control points on both sides land on their targets."""
    given, regions = scattered(2.0), (MIDDLE, HalfSpace((0, 40), (0, 1)))
    field = fitted(given, regions, rule)
    moved, converged = warp_points(given.source, field)
    stays = (sides_of(regions, given.source) == sides_of(regions, given.target)).all(axis=1)
    assert (converged == (stays | (rule == "source"))).all()
    oracle.assert_close(moved, given.target, atol=1e-3)
    at = np.random.default_rng(0).uniform(5, 95, (50, 2))
    moved, converged = warp_points(at, field)
    own = sides_of(regions, at)
    for x, y, side, found in zip(at, moved, own, converged, strict=True):
        k = field.sides.index(tuple(side.tolist()))
        oracle.assert_close(y + field.fields[k].displacement(y), x, atol=1e-3)
        assert found == (rule == "source" or (sides_of(regions, y) == side).all())


def test_matter_on_either_side_of_an_opened_cut_goes_its_own_way() -> None:
    moved, converged = warp_points([[49.99, 20], [50.0, 20], [50.01, 70]], pushed(-4.0, 3.0))
    assert converged.all()
    oracle.assert_close(moved, [[45.99, 20], [53.0, 20], [53.01, 70]], atol=1e-4)


def test_a_region_without_points_stays_where_it_is() -> None:
    one = pushed(-4.0, 3.0)
    field = Decoupled(one.fields[:1], one.sides[:1], one.regions)
    at = np.array([[20.0, 30.0], [80.0, 30.0]])
    moved, converged = warp_points(at, field)
    assert converged.all()
    still = 0 if one.sides[0] == (False,) else 1
    assert (moved[still] == at[still]).all()


def test_after_a_cut_come_further_steps() -> None:
    grid = Grid((5, 100, 100))
    plane = Plane.along(grid, "+z")
    flat = pushed(-4.0, 3.0)
    cut = Decoupled(tuple(extrude(plane, grid, [f], replicate()) for f in flat.fields), flat.sides, flat.regions, plane)
    wave = Wave(1.0, 0.05)
    at = np.array([[48.0, 20, 2], [52.0, 70, 3]])
    between = at + np.array([[-4.0, 0, 0], [3.0, 0, 0]])
    moved, converged = warp_points(at, compose(cut, wave), tolerance=1e-9)
    assert converged.all()
    oracle.assert_close(moved + wave.displacement(moved), between, atol=1e-6)
    moved, converged = warp_points(at, compose(wave, cut), tolerance=1e-9)
    first, _ = warp_points(at, wave, tolerance=1e-9)
    oracle.assert_close(moved, first + np.where(first[:, :1] < 50, [-4.0, 0, 0], [3.0, 0, 0]), atol=1e-6)
