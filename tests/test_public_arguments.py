"""What the functions of a notebook take: a deformation or a field, a volume for its grid, landmarks for points.

All else is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from deformnb.analysis.folds import folds_of, jacobian_determinant
from deformnb.analysis.strain import stretches
from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.rbf.fields import AbstractField, DisplacementField, Identity, as_field, blend, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import fit_rigid
from deformnb.rbf.stages import fit_points
from deformnb.session.session import Session
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.inverse import invert, round_trip
from deformnb.warping.mesh import Mesh, isosurface, signed_distance, warp_mesh
from deformnb.warping.points import Landmarks, warp_landmarks, warp_points
from deformnb.warping.warper import Warper, warp, warp_picture

GRID = Grid((5, 8, 9), (1.0, 1.0, 2.0))
VOLUME = Volume(np.random.default_rng(1).integers(0, 255, GRID.shape).astype(np.uint8), GRID, "a box")
DRAGS = ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1.5], [3.5, 6]])
DEFORMATION = Deformation.on_picture(VOLUME, "+z", DRAGS)
FIELD = DEFORMATION.field(GRID)
POINTS = np.array([[2.0, 2.0, 2.0], [4.0, 3.0, 5.0]])
LANDMARKS = Landmarks(POINTS, ("a", "b"))
MESH = Mesh(np.eye(3) * 3, [[0, 1, 2]])
RASTER = Raster((4, 4), (1.0, 1.0), (0.0, 0.0))


def values(found: Any) -> Any:
    """The numbers of any result."""
    if isinstance(found, tuple):
        return [values(part) for part in found]
    if isinstance(found, AbstractField):
        return found.displacement(POINTS)
    return next((getattr(found, name) for name in ("values", "points", "error", "principal", "least", "worst")
                 if hasattr(found, name)), found)


@pytest.mark.parametrize("call", [
    lambda d: warp(VOLUME, d),
    Warper(VOLUME),
    lambda d: warp_points(POINTS, d, grid=VOLUME),
    lambda d: warp_landmarks(LANDMARKS, d, grid=GRID),
    lambda d: warp_mesh(MESH, d, grid=VOLUME),
    lambda d: invert(d, VOLUME),
    lambda d: round_trip(d, LANDMARKS, grid=VOLUME),
    lambda d: jacobian_determinant(d, VOLUME),
    lambda d: jacobian_determinant(d, POINTS, grid=VOLUME),
    lambda d: folds_of(d, VOLUME),
    lambda d: stretches(d, POINTS, grid=VOLUME),
    lambda d: compose(d, Identity(), grid=VOLUME),
    lambda d: blend(d, Identity(), grid=VOLUME),
    lambda d: DisplacementField.sample(d, VOLUME),
])
def test_a_deformation_counts_as_its_field(call: Callable[[Any], Any]) -> None:
    wanted = values(call(FIELD))
    for same in (DEFORMATION, DEFORMATION.steps[0]):
        found = values(call(same))
        for one, other in zip(found, wanted, strict=True) if isinstance(found, list) else [(found, wanted)]:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("call", [
    lambda: warp_points(POINTS, DEFORMATION), lambda: warp_landmarks(LANDMARKS, DEFORMATION),
    lambda: warp_mesh(MESH, DEFORMATION), lambda: compose(DEFORMATION), lambda: round_trip(DEFORMATION, POINTS),
    lambda: jacobian_determinant(DEFORMATION, POINTS), lambda: stretches(DEFORMATION, POINTS),
    lambda: folds_of(DEFORMATION, RASTER), lambda: warp_picture(np.zeros((4, 4)), RASTER, DEFORMATION),
])
def test_a_deformation_asks_for_the_grid(call: Callable[[], Any]) -> None:
    with pytest.raises(DeformError, match="grid=volume"):
        call()


def test_what_has_fields_for_other_than_grids_is_refused_by_name() -> None:
    moving = Animation(Deformation(keyframes=(Keyframe(0, DEFORMATION.steps), Keyframe(1, DEFORMATION.steps))))
    for other in (moving, Session(VOLUME)):
        with pytest.raises(DeformError, match="a field or a Deformation is needed"):
            warp_points(POINTS, other, grid=VOLUME)  # type: ignore[arg-type]


def test_an_inverse_counts_as_its_field() -> None:
    inverse = DEFORMATION.inverse(VOLUME)
    np.testing.assert_array_equal(warp(VOLUME, inverse).values, warp(VOLUME, inverse.field).values)


def test_a_deformation_is_warped_onto_its_own_output() -> None:
    finer = GRID.resampled(spacing=1.0)
    made = Deformation(DEFORMATION.steps, output=finer)
    assert warp(VOLUME, made).grid == finer
    assert warp(VOLUME, made, output=VOLUME).grid == GRID


def test_points_go_the_same_way_by_function_and_method() -> None:
    moved, found = DEFORMATION.warp_points(LANDMARKS, VOLUME)
    assert found.all()
    np.testing.assert_array_equal(moved, warp_points(POINTS, FIELD)[0])


def test_a_volume_counts_as_its_grid() -> None:
    assert Plane.along(VOLUME, "+z") == Plane.along(GRID, "+z")
    assert Plane.along(GRID, "+z").depth_range(VOLUME) == Plane.along(GRID, "+z").depth_range(GRID)
    np.testing.assert_array_equal(FIELD.on_grid(VOLUME), FIELD.on_grid(GRID))


@pytest.mark.parametrize("wrong", [None, 3, "+z", np.zeros((2, 3, 4)), object(), ControlPoints, Deformation, [FIELD]],
                         ids=lambda wrong: type(wrong).__name__)
@pytest.mark.parametrize("call", [
    lambda w: warp(w, FIELD), lambda w: warp(w, DEFORMATION), lambda w: warp(VOLUME, w), Warper(VOLUME),
    Warper, lambda w: Plane.along(w, "+z"), FIELD.on_grid, DEFORMATION.field,
    DEFORMATION.inverse, lambda w: DEFORMATION.warp_points(POINTS, w), DEFORMATION.apply,
    lambda w: Deformation.on_picture(w, "+z", DRAGS), DEFORMATION.then, lambda w: compose(FIELD, w),
    blend, lambda w: invert(w, GRID), lambda w: invert(FIELD, w), lambda w: folds_of(w, GRID),
    lambda w: folds_of(FIELD, w), lambda w: jacobian_determinant(w, GRID), lambda w: warp_mesh(w, FIELD),
    lambda w: warp_mesh(MESH, w), lambda w: warp_landmarks(w, FIELD), lambda w: warp_points(POINTS, w),
    lambda w: warp_points(w, FIELD), lambda w: round_trip(w, POINTS), lambda w: stretches(w, POINTS),
    lambda w: project(w, "+z"), isosurface, lambda w: warp_picture(np.zeros((4, 4)), w, Identity(2)),
    lambda w: warp_picture(np.zeros((4, 4)), RASTER, w), lambda w: as_field(w, GRID),
    lambda w: signed_distance(MESH, w if w is not None else "none"), signed_distance,
])
def test_anything_else_is_refused_by_name(call: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(DeformError):
        call(wrong)


@pytest.mark.parametrize("wrong", [None, 3, "tail", POINTS, FIELD, LANDMARKS, Landmarks],
                         ids=lambda wrong: type(wrong).__name__)
@pytest.mark.parametrize("call", [
    fit_rbf, fit_points, lambda w: fit_rigid(w, ()), Deformation.in_space,
    lambda w: Deformation.on_picture(GRID, "+z", w),
])
def test_no_control_points_are_refused_by_name(call: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(DeformError, match=r"control points|ControlPoints"):
        call(wrong)


def test_pairs_of_landmarks_count_as_control_points() -> None:
    pairs = Landmarks(POINTS, fixed=POINTS + 1)
    wanted = fit_rbf(pairs.control_points())
    np.testing.assert_array_equal(fit_rbf(pairs).displacement(POINTS), wanted.displacement(POINTS))


def test_what_can_follow_a_deformation() -> None:
    assert len(DEFORMATION.then(DEFORMATION).then(Step((DRAGS,), Plane.along(GRID, "+z"))).steps) == 3
    with pytest.raises(DeformError, match=r"of type Step, got .*compose"):
        DEFORMATION.then(FIELD)  # type: ignore[arg-type]
