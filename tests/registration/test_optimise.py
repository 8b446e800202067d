"""Targets found by the pictures: known deformations are found again, nothing folds, failures are reported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from deformed_pictures import lattice_points, picture, texture, warp_by_scipy
from scipy import ndimage

import deformnb as dn
from deformnb.errors import Cancelled, DeformError
from deformnb.imaging.projection import project
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.registration.optimise import fit_targets, snap_to_match
from deformnb.volume.plane import Picture
from deformnb.volume.volume import Grid, Volume

SIZE = 96
MOVING = picture(texture((SIZE, SIZE)))
TRUE = lattice_points(SIZE, 3, 3.0)
FIXED = warp_by_scipy(MOVING, fit_rbf(TRUE))
START = TRUE.reset()


def _misses(points: ControlPoints, true: ControlPoints = TRUE) -> Any:
    return np.linalg.norm(points.target - true.target, axis=1)


# -- all targets -------------------------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("measure", ["ncc", "ssd", "mi"])
def test_a_known_deformation_is_found_again(measure: str) -> None:
    """The targets were moved by 3.7 pixels on average; half a pixel is the worst that is left."""
    fitted = fit_targets(START, MOVING, FIXED, measure=measure)
    assert _misses(START).mean() > 3.5
    assert _misses(fitted.points).max() < 0.5
    assert fitted.score_after > fitted.score_before
    assert fitted.least > 0.3
    assert fitted.history[-1] == (1, pytest.approx(fitted.score_after, abs=1e-3))


@pytest.mark.nightly
def test_grey_values_in_reverse_are_matched_by_mutual_information() -> None:
    negative = replace(FIXED, values=1 - 0.6 * FIXED.values)
    assert _misses(fit_targets(START, MOVING, negative, measure="mi").points).max() < 0.6


def test_correlation_is_indifferent_to_brightness_and_contrast() -> None:
    paler = replace(FIXED, values=0.3 + 0.4 * FIXED.values)
    assert _misses(fit_targets(START, MOVING, paler, energy=0.0).points).max() < 0.5


@pytest.mark.nightly
def test_only_what_is_free_moves() -> None:
    points = START.edit(4, locked=True).edit(0, active=False)
    found = fit_targets(points, MOVING, FIXED).points
    moved = (found.target != points.target).any(axis=1)
    assert moved.tolist() == [k not in (0, 4) for k in range(9)]
    assert found == replace(points, target=found.target)


@pytest.mark.nightly
def test_an_angle_is_found_with_two_points() -> None:
    turn = np.array([[np.cos(0.12), -np.sin(0.12)], [np.sin(0.12), np.cos(0.12)]])
    points = ControlPoints.from_arrays([[24.0, 48.0], [72.0, 48.0]])
    true = replace(points, target=(points.source - 48) @ turn.T * 1.05 + 48)
    found = fit_targets(points, MOVING, warp_by_scipy(MOVING, fit_rbf(true)))
    assert _misses(found.points, true).max() < 0.1


def test_pictures_of_different_pixels_are_compared_where_they_lie() -> None:
    """The fixed picture has pixels of 0.5 and begins elsewhere; its coordinates are those of the moving one."""
    line = np.arange(10, 86, 0.5)
    a, b = np.meshgrid(line, line)
    fine = ndimage.map_coordinates(FIXED.values, [b, a], order=1)
    found = fit_targets(START, MOVING, picture(fine, 0.5, (10.0, 10.0)))
    assert _misses(found.points).max() < 0.8


def test_alike_already_nothing_is_moved() -> None:
    fitted = fit_targets(START, MOVING, MOVING)
    assert _misses(fitted.points, START).max() < 1e-3
    assert fitted.score_before == pytest.approx(1)
    assert fitted.least == pytest.approx(1, abs=1e-3)


@pytest.mark.nightly
def test_stages_are_fitted_as_they_are_done() -> None:
    """Three parts of the displacement, one after the other: the picture is warped three times."""
    ends = [TRUE.source + j / 3 * (TRUE.target - TRUE.source) for j in range(4)]
    fixed = MOVING
    for before, after in pairwise(ends):
        fixed = warp_by_scipy(fixed, fit_rbf(ControlPoints.from_arrays(before, after), support=90.0))
    found = fit_targets(START, MOVING, fixed, stages=3, support=90.0, levels=(2, 1))
    assert _misses(found.points).max() < 0.5


def test_a_map_never_folds_though_the_similarity_would_rise() -> None:
    """Two stripes that change places: each point would have to go through the other."""
    a = np.arange(64.0)
    left, right = (np.exp(-(((a - c) / 4) ** 2)) for c in (24.0, 40.0))
    moving, fixed = (picture(np.tile(row, (64, 1))) for row in (left + 0.5 * right, right + 0.5 * left))
    points = ControlPoints.from_arrays([[24.0, 32.0], [40.0, 32.0], [4, 4], [60, 4], [4, 60], [60, 60]])
    fitted = fit_targets(points, moving, fixed, energy=0.0)
    assert fitted.least >= 0.05
    jacobian = np.eye(2) + fit_rbf(fitted.points, support=fitted.support).jacobian(moving.raster.points())
    assert np.linalg.det(jacobian).min() > 0


@pytest.mark.nightly
def test_points_in_space_are_fitted_to_volumes() -> None:
    values = texture((32, 32, 32), scales=(2.0, 4.0))
    grid = Grid((32, 32, 32), (1.5, 1.0, 1.0))
    line = [0.25, 0.75]
    source = np.stack(np.meshgrid(*[line] * 3), axis=-1).reshape(-1, 3) * [46.5, 31, 31]
    true = ControlPoints.from_arrays(source, source + np.random.default_rng(0).normal(0, 1.2, source.shape))
    fixed = dn.warp(Volume(values, grid), fit_rbf(true, support=35.0))
    fitted = fit_targets(true.reset(), Volume(values, grid), fixed, support=35.0, levels=(2, 1))
    assert _misses(fitted.points, true).max() < 0.4 < 1.5 < _misses(true.reset(), true).mean()


def test_progress_rises_to_one_and_can_stop_at_any_iteration() -> None:
    told: list[float] = []
    before = START.target.copy()
    fit_targets(START, MOVING, FIXED, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1
    assert len(told) > 10

    def stop(share: float) -> None:
        if share > 0.4:
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        fit_targets(START, MOVING, FIXED, progress=stop)
    assert (START.target == before).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p: replace(p, locked=np.ones(9, bool)), "no control point may move"),
        (lambda p: ControlPoints.empty(), "no control point may move"),
        (lambda p: p.add(p.source[2]), "is at the place of another one"),
        (lambda p: ControlPoints.from_arrays([[1.0, 2.0, 3.0]]), "matched on volumes, got a Picture"),
    ],
)
def test_what_cannot_be_fitted_is_said(change: Callable[[ControlPoints], ControlPoints], words: str) -> None:
    with pytest.raises(DeformError, match=words):
        fit_targets(change(START), MOVING, FIXED)


def test_a_row_of_points_is_not_fitted_with_a_trend_that_it_leaves_open() -> None:
    with pytest.raises(DeformError, match="on one line"):
        fit_targets(START.take([0, 1, 2]), MOVING, FIXED, kernel="thin_plate")


def test_pictures_that_share_nothing_are_refused() -> None:
    with pytest.raises(DeformError, match="do not overlap"):
        fit_targets(START, MOVING, picture(FIXED.values, 1.0, (500.0, 0.0)))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"levels": (4, 0)}, "levels must be whole numbers"),
        ({"levels": (np.nan,)}, "levels must be whole numbers"),
        ({"levels": np.zeros(0, int)}, "levels must be whole numbers"),
        ({"measure": "dice"}, "unknown measure"),
        ({"iterations": 0}, "iterations of a fit .* from 1 on, got 0"),
        ({"iterations": 2.5}, "iterations of a fit"),
        ({"energy": np.nan}, "energy of a fit"),
        ({"energy": -1.0}, "energy of a fit"),
        ({"least": np.nan}, "determinant"),
        ({"stages": 0}, "stages of a step must be a whole number from 1 to 64, got 0"),
        ({"stages": 2.5}, "stages"),
    ],
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(DeformError, match=words):
        fit_targets(START, MOVING, FIXED, **options)


def _knees(real_data: Callable[[str], Path]) -> tuple[Picture, Picture]:
    straight, bent = (dn.read_volume(real_data(f"knee_mr_{name}.nrrd")) for name in ("straight", "bent"))
    seen = project(straight, "-x", "slice")
    return seen, project(bent, seen.plane, "slice")


@pytest.mark.nightly
def test_a_real_knee_bends_towards_its_bent_picture(real_data: Callable[[str], Path]) -> None:
    straight, bent = _knees(real_data)
    (nv, nu), (du, dv) = straight.raster.shape, straight.raster.spacing
    source = np.stack(np.meshgrid(np.linspace(0.1, 0.9, 4) * nu * du, np.linspace(0.1, 0.9, 5) * nv * dv), -1)
    points = ControlPoints.from_arrays(source.reshape(-1, 2))
    fitted = fit_targets(points, straight, bent, levels=(4, 2), iterations=20)
    assert fitted.score_after > fitted.score_before + 0.1
    assert fitted.least >= 0.05


# -- single points -----------------------------------------------------------------------------------------------------


def test_a_shifted_picture_is_met_to_an_eighth_of_a_pixel() -> None:
    shift = np.array([3.3, -2.6])
    moved = warp_by_scipy(MOVING, fit_rbf(ControlPoints.from_arrays([[0.0, 0.0]], [shift])))
    found = snap_to_match(START, None, MOVING, moved, radius=9, search=8)
    assert not found.left
    assert np.abs(found.shift - shift).max() < 0.125
    assert (found.score > 0.97).all()
    assert np.allclose(found.points.target, START.target + found.shift)


def test_what_is_at_the_target_now_is_looked_for() -> None:
    """The points are at their true targets: the deformed neighbourhood is already at its place."""
    found = snap_to_match(TRUE, [0, 4, 8], MOVING, FIXED)
    assert found.ids == (0, 4, 8)
    assert np.abs(found.shift).max() < 0.25
    assert (found.score > 0.99).all()


def test_a_point_snaps_towards_its_place_in_a_deformed_picture() -> None:
    found = snap_to_match(START, [4], MOVING, FIXED, radius=14, search=10)
    assert _misses(found.points)[4] < 0.4 * _misses(START)[4]
    others = [k for k in range(9) if k != 4]
    assert (found.points.target[others] == START.target[others]).all()


def test_locked_and_switched_off_points_are_left() -> None:
    found = snap_to_match(START.edit(1, locked=True).edit(2, active=False), [1, 2], MOVING, FIXED)
    assert found.left == {1: "it is locked", 2: "it is switched off"}
    assert np.isnan(found.score).all()
    assert not found.shift.any()


def test_doubtful_places_are_left_and_named() -> None:
    a, b = np.meshgrid(np.arange(96.0), np.arange(96.0))
    stripes = picture(0.5 + 0.5 * np.sin(a / 3))
    spot = picture(np.exp(-((a - 40) ** 2 + (b - 40) ** 2) / 30))
    gone = picture(np.exp(-((a - 51) ** 2 + (b - 40) ** 2) / 30))
    noise = picture(np.random.default_rng(3).random((96, 96)))
    one = ControlPoints.from_arrays([[40.0, 40.0], [80.0, 80.0]])
    keep = {"radius": 8.0, "search": 10.0}
    assert snap_to_match(one, [0], stripes, stripes, **keep).left == {0: "several places look like it"}
    assert snap_to_match(one, [0], spot, gone, **keep).left == {0: "the best place is at the rim of the search"}
    assert snap_to_match(one, [1], spot, gone, **keep).left == {1: "its surroundings are even"}
    assert snap_to_match(one, [0], spot, noise, **keep).left == {0: "nothing within 10 looks like it"}
    untouched = snap_to_match(one, None, spot, noise, **keep)
    assert untouched.points is one


def test_even_places_look_like_nothing() -> None:
    a, b = np.meshgrid(np.arange(96.0), np.arange(96.0))
    here, there = (picture(np.clip(1 - ((a - i) ** 2 + (b - j) ** 2) / 16, 0, 1)) for i, j in ((40, 40), (43, 41)))
    found = snap_to_match(ControlPoints.from_arrays([[40.0, 40.0]]), None, here, there, radius=5.0, search=14.0)
    assert np.allclose(found.shift, [[3.0, 1.0]], atol=0.05)


def test_the_correlation_is_that_of_the_disc() -> None:
    """Against NumPy at one shift: the pixels of the disc, and no others."""
    found = snap_to_match(ControlPoints.from_arrays([[48.0, 48.0]]), None, MOVING, FIXED, radius=7.0, search=2.0)
    a, b = np.meshgrid(np.arange(-7, 8), np.arange(-7, 8))
    disc = a**2 + b**2 <= 49
    pattern = MOVING.values[48 + b, 48 + a][disc]
    best = max(
        np.corrcoef(pattern, FIXED.values[48 + b + j, 48 + a + i][disc])[0, 1]
        for i in range(-2, 3)
        for j in range(-2, 3)
        if i * i + j * j <= 4
    )
    assert found.score[0] == pytest.approx(best, abs=1e-6)


def test_a_point_in_space_snaps_in_a_volume() -> None:
    values = texture((30, 30, 30), scales=(2.0, 4.0))
    grid = Grid((30, 30, 30))
    moved = Volume(ndimage.shift(values, (1, 2, -2), order=1), grid)
    found = snap_to_match(
        ControlPoints.from_arrays([[15.0, 15.0, 15.0]]), None, Volume(values, grid), moved, radius=6, search=5
    )
    assert np.abs(found.shift[0] - [-2, 2, 1]).max() < 0.15


def test_snapping_tells_progress_and_refuses_wrong_lengths() -> None:
    told: list[float] = []
    snap_to_match(START, [0, 1], MOVING, FIXED, progress=told.append)
    assert told == [0, 0.5, 1]
    with pytest.raises(DeformError, match="radius must be a positive length"):
        snap_to_match(START, None, MOVING, FIXED, radius=-1)
    with pytest.raises(DeformError, match="no control point 77"):
        snap_to_match(START, [77], MOVING, FIXED)
