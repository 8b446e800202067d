"""Points move with the tissue they mark: the inverse of the backward map, with cuts and rigid parts too."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
import oracle
import pytest
from rbf.test_cuts import MIDDLE, fitted, pushed, scattered
from rbf.test_rigid_parts import BOX, SUPPORT, TURN, points, within
from warping.test_warper import OBLIQUE, STRAIGHT, Wave, centres, extruded

from deformnb.errors import DeformError
from deformnb.rbf import evaluation
from deformnb.rbf.cuts import CUT_RULES, Decoupled, sides_of
from deformnb.rbf.extrusion import extrude, interpolate, modulate, replicate
from deformnb.rbf.fields import AbstractField, DisplacementField, Identity, compose
from deformnb.rbf.fitting import fit_rbf, fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.rbf.stages import Staged
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import as_landmarks, warp_points
from deformnb.warping.warper import warp


@pytest.mark.parametrize(
    "field",
    [Wave(1.5, 0.3), Wave(1.5, 0.3, dim=2), Identity(3), extruded(Plane.from_view(OBLIQUE, "+y"), OBLIQUE, "modulate")],
)
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
        """Everything is sampled at the origin: the backward map has no other value."""

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


def test_many_points_of_every_shape_of_array() -> None:
    field = Wave(1.5, 0.3, dim=2)
    at = np.random.default_rng(8).uniform(-20, 20, (2, 10_000, 2))  # more than one block
    moved, converged = warp_points(at, field, tolerance=1e-9)
    assert converged.all()
    assert np.abs(moved + field.displacement(moved) - at).max() <= 1e-9
    one, found = warp_points(at[1, 77], field, tolerance=1e-9)
    assert one.shape == (2,)
    assert found.shape == ()
    oracle.assert_close(one, moved[1, 77], atol=1e-8)


def test_no_function_is_compiled_for_each_number_of_points() -> None:
    """A hundred numbers of points make few shapes: blocks are filled up."""
    fit, shapes = fit_rbf(points(), support=SUPPORT), set()
    at = np.random.default_rng(8).uniform(0, 100, (100_000, 2))

    whole = evaluation.evaluate_blocks

    def counted(p: Any, *rest: Any, **options: Any) -> Any:
        shapes.add(p.shape)
        return whole(p, *rest, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "evaluate_blocks", counted)
        for n in np.geomspace(1, len(at), 40).astype(int):
            warp_points(at[:n], fit)
    assert len(shapes) <= 5


def test_a_point_far_away_is_not_asked_for_more_digits_than_there_are() -> None:
    pull = fit_rbf(ControlPoints.from_arrays([[0.0, 0.0]], [[1e-9, 0.0]]), support=1e6, trend="none")
    moved, converged = warp_points([[123456.789, 98765.4321]], pull)
    assert converged.all()
    oracle.assert_close(moved, [[123456.789, 98765.4321]], atol=2e-9)


def test_places_that_the_usual_starts_do_not_lead_to_are_found() -> None:
    """A map that swings to and fro: y + 8 sin(y / 2) = x has many solutions, and Newton is caught between them."""
    field = Wave(8.0, 0.5, dim=2)
    at = np.random.default_rng(8).uniform(-20, 20, (400, 2))
    moved, converged = warp_points(at, field)
    assert np.abs(moved + field.displacement(moved) - at)[converged].max() < 1e-4
    assert converged.mean() > 0.97


def test_stages_and_compositions_are_followed_one_by_one() -> None:
    """Each stage is near the identity; the whole turns by 170 degrees, where x - D(x) is on the wrong side."""
    ring = np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], axis=-1) * 30 + 50
    turn = RigidMotion.turn(17, (50, 50))
    fits = []
    for k in range(10):
        given = RigidMotion.turn(17 * k, (50, 50))(ring)
        fits.append(fit_rbf(ControlPoints.from_arrays(given, turn(given)), support=40.0, trend="none"))
    at = np.random.default_rng(8).uniform(20, 80, (500, 2))
    for field in (Staged(tuple(fits)), compose(*fits)):
        moved, converged = warp_points(at, field, tolerance=1e-9)
        assert converged.all()
        assert np.abs(moved + field.displacement(moved) - at).max() < 1e-8
        oracle.assert_close(warp_points(ring, field)[0], RigidMotion.turn(170, (50, 50))(ring), atol=1e-3)


@pytest.mark.parametrize("rule", [replicate(), modulate("sin(pi * z)"), interpolate([0.2, 0.7])])
@pytest.mark.parametrize("view", ["oblique", "rounded"])
def test_extrusions_are_solved_in_their_plane(rule: Any, view: str) -> None:
    grid = Grid((40, 50, 60))
    plane = Plane.from_normal(grid.center, (1, 2, -0.5))
    if view == "rounded":  # a plane from a file of few digits is not orthonormal to the last one
        plane = Plane(plane.origin, *(tuple(np.round(w, 7).tolist()) for w in (plane.u, plane.v)))
    field = extrude(plane, grid, [fit_rbf(points(), support=SUPPORT)] * len(rule[1]), rule)
    at = np.random.default_rng(8).uniform(0, 50, (300, 3))
    moved, converged = warp_points(at, field, tolerance=1e-9)
    assert converged.all()
    assert np.linalg.norm(moved + field.displacement(moved) - at, axis=1).max() <= 1.01e-9
    oracle.assert_close((moved - at) @ np.array(plane.normal), 0, atol=1e-9)  # nothing leaves its depth


def test_no_points() -> None:
    moved, converged = warp_points(np.zeros((0, 3)), Wave())
    assert moved.shape == (0, 3)
    assert converged.shape == (0,)


@pytest.mark.parametrize(
    ("given", "field", "message"),
    [
        ([[1.0, 2.0]], Wave(), "3 coordinates"),
        (3.0, Wave(), "3 coordinates"),
        ([[1.0, 2.0, 3.0], [1.0, np.nan, 3.0]], Wave(), "point 1"),
    ],
)
def test_what_are_no_points_is_refused(given: Any, field: AbstractField, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        warp_points(given, field)


# ---- with rigid parts and cuts -------------------------------------------------------------------------------------


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
    plane = Plane.from_view(grid, "+z")
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


def test_places_on_the_turned_over_sheet_of_a_fold_are_not_found() -> None:
    """One point dragged too far, without a trend: the middle one of three places that show one source is mirrored."""
    field = fit_rbf(ControlPoints.from_arrays([[50.0, 50.0]], [[80.0, 50.0]]), support=40.0, trend="none")
    places = np.stack(np.meshgrid(np.linspace(20, 110, 61), np.linspace(30, 70, 21)), axis=-1).reshape(-1, 2)
    det = np.linalg.det(np.eye(2) + field.jacobian(places))
    assert (det < 0).sum() > 20
    sources = places + field.displacement(places)
    moved, found = warp_points(sources, field)
    at = np.linalg.det(np.eye(2) + field.jacobian(moved))
    assert (at[found] > 0).all()
    assert np.abs(moved + field.displacement(moved) - sources)[found].max() < 1e-3
    assert found[det > 0].mean() > 0.99


def test_a_map_that_mirrors_as_a_whole_is_followed() -> None:
    source = np.array([[0.0, 0], [100, 0], [0, 80], [100, 80], [30, 50]])
    field = fit_rbf(ControlPoints.from_arrays(source, source * [-1, 1]))
    moved, found = warp_points([[40.0, 40.0], [70.0, 20.0]], field)
    assert found.all()
    assert np.abs(moved - [[-40, 40], [-70, 20]]).max() < 1e-6


@pytest.mark.parametrize("dim", [2, 3])
def test_an_array_of_places_is_landmarks_without_goals_and_a_single_place_is_none(dim: int) -> None:
    places = np.arange(4.0 * dim).reshape(4, dim)
    landmarks = as_landmarks(places)
    np.testing.assert_array_equal(landmarks.points, places)
    assert landmarks.fixed is None
    with pytest.raises(DeformError, match="Landmarks are needed"):
        as_landmarks(places[0])
