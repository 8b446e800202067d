"""Arguments of the functions of a notebook: a deformation or a field, a volume for its grid, landmarks for points.

All else is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.analysis.folds import find_folds, jacobian_determinant
from deformnb.analysis.strain import stretches
from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError
from deformnb.imaging.drawing import draw_pictures
from deformnb.imaging.movie_frames import animation_frames, deformation_frames, write_movie
from deformnb.imaging.projection import project
from deformnb.imaging.render import image_places, render_pair, render_volume
from deformnb.imaging.thompson import draw_grids
from deformnb.rbf.fields import AbstractField, DisplacementField, Identity, as_field, blend, compose
from deformnb.rbf.fitting import fit_points, fit_rbf, fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.transfer import preset
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.inverse import invert, round_trip
from deformnb.warping.mesh import Mesh, isosurface, signed_distance, warp_mesh
from deformnb.warping.points import Landmarks, warp_landmarks, warp_points
from deformnb.warping.warper import Warper, warp, warp_picture

GRID = Grid((5, 8, 9), (1.0, 1.0, 2.0))
VOLUME = Volume(np.random.default_rng(1).integers(0, 255, GRID.shape).astype(np.uint8), GRID, "a box")
DRAGS = ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1.5], [3.5, 6]])
DEFORMATION = Deformation.from_picture_points(VOLUME, "+z", DRAGS)
FIELD = DEFORMATION.field(GRID)
POINTS = np.array([[2.0, 2.0, 2.0], [4.0, 3.0, 5.0]])
LANDMARKS = Landmarks(POINTS, ("a", "b"))
MESH = Mesh(np.eye(3) * 3, [[0, 1, 2]])
RASTER = Raster((4, 4), (1.0, 1.0), (0.0, 0.0))
PICTURE = project(VOLUME, "+z")
MOVING = Deformation(keyframes=(Keyframe(0, DEFORMATION.steps), Keyframe(1, DEFORMATION.steps)))
SMALL: dict[str, Any] = {"size": (16, 12), "backend": "core"}
BLACK = np.zeros((8, 8, 3), np.uint8)


def values(found: Any) -> Any:
    """The numbers of any result."""
    if isinstance(found, tuple):
        return [values(part) for part in found]
    if isinstance(found, AbstractField):
        return found.displacement(POINTS)
    return next(
        (
            getattr(found, name)
            for name in ("values", "points", "error", "principal", "least", "worst")
            if hasattr(found, name)
        ),
        found,
    )


@pytest.mark.parametrize(
    "call",
    [
        lambda d: warp(VOLUME, d),
        Warper(VOLUME),
        lambda d: warp_points(POINTS, d, grid=VOLUME),
        lambda d: warp_landmarks(LANDMARKS, d, grid=GRID),
        lambda d: warp_mesh(MESH, d, grid=VOLUME),
        lambda d: invert(d, VOLUME),
        lambda d: round_trip(d, LANDMARKS, grid=VOLUME),
        lambda d: jacobian_determinant(d, VOLUME),
        lambda d: jacobian_determinant(d, POINTS, grid=VOLUME),
        lambda d: find_folds(d, VOLUME),
        lambda d: stretches(d, POINTS, grid=VOLUME),
        lambda d: compose(d, Identity(), grid=VOLUME),
        lambda d: blend(d, Identity(), grid=VOLUME),
        lambda d: DisplacementField.sample(d, VOLUME),
    ],
)
def test_a_deformation_counts_as_its_field(call: Callable[[Any], Any]) -> None:
    wanted = values(call(FIELD))
    for same in (DEFORMATION, DEFORMATION.steps[0]):
        found = values(call(same))
        for one, other in zip(found, wanted, strict=True) if isinstance(found, list) else [(found, wanted)]:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "call",
    [
        lambda: warp_points(POINTS, DEFORMATION),
        lambda: warp_landmarks(LANDMARKS, DEFORMATION),
        lambda: warp_mesh(MESH, DEFORMATION),
        lambda: compose(DEFORMATION),
        lambda: round_trip(DEFORMATION, POINTS),
        lambda: jacobian_determinant(DEFORMATION, POINTS),
        lambda: stretches(DEFORMATION, POINTS),
        lambda: find_folds(DEFORMATION, RASTER),
        lambda: warp_picture(np.zeros((4, 4)), RASTER, DEFORMATION),
    ],
)
def test_a_deformation_asks_for_the_grid(call: Callable[[], Any]) -> None:
    with pytest.raises(DeformError, match="grid=volume"):
        call()


def test_what_has_fields_for_other_than_grids_is_refused_by_name() -> None:
    for other in (Animation(MOVING), Session(VOLUME)):
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
    assert Plane.from_view(VOLUME, "+z") == Plane.from_view(GRID, "+z")
    assert Plane.from_view(GRID, "+z").depth_range(VOLUME) == Plane.from_view(GRID, "+z").depth_range(GRID)
    np.testing.assert_array_equal(FIELD.sample_on_grid(VOLUME), FIELD.sample_on_grid(GRID))


@pytest.mark.parametrize(
    ("call", "same"),
    [
        (lambda g: image_places(POINTS, g), (GRID, VOLUME)),
        (lambda p: image_places(p, GRID), (POINTS, LANDMARKS)),
        (lambda t: render_volume(VOLUME, transfer=t, **SMALL), (preset("bone", VOLUME), "bone")),
        (lambda t: project(VOLUME, "+y", "shaded", transfer=t), (preset("bone", VOLUME), "bone")),
        (lambda d: list(deformation_frames(VOLUME, d, strengths=2, **SMALL)), (DEFORMATION, DEFORMATION.steps[0])),
        (lambda g: list(deformation_frames(VOLUME, DEFORMATION, strengths=2, output=g, **SMALL)), (GRID, VOLUME)),
        (lambda a: list(animation_frames(VOLUME, a, fps=2, **SMALL)), (Animation(MOVING), MOVING)),
        (lambda g: draw_grids(DEFORMATION, PICTURE, grid=g).grids.nodes, (GRID, VOLUME)),
        (lambda p: draw_pictures(p).get_size_inches(), ([PICTURE], PICTURE)),
    ],
)
def test_pictures_take_what_can_be_meant_without_doubt(call: Callable[[Any], Any], same: tuple[Any, Any]) -> None:
    wanted, found = (values(call(given)) for given in same)
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    "wrong",
    [None, 3, "#", np.zeros((2, 3, 4, 5)), float("nan"), -1, {}, object(), ControlPoints, [FIELD]],
    ids=lambda wrong: repr(wrong)[:20].split(" at ")[0],
)
@pytest.mark.parametrize(
    ("call", "right"),
    [
        (lambda w: render_volume(w, **SMALL), ()),
        (lambda w: render_volume(VOLUME, transfer=w, **SMALL), (None,)),
        (lambda w: render_volume(VOLUME, direction=w, **SMALL), ()),
        (lambda w: render_volume(VOLUME, up=w, **SMALL), (None,)),
        (lambda w: render_volume(VOLUME, height=w, **SMALL), (None, 3)),
        (lambda w: render_volume(VOLUME, size=w, backend="core"), ()),
        (lambda w: render_volume(VOLUME, background=w, **SMALL), ()),
        (lambda w: render_volume(VOLUME, backend=w), ()),
        (lambda w: render_pair(w, VOLUME, **SMALL), ()),
        (lambda w: render_pair(VOLUME, w, **SMALL), ()),
        (lambda w: render_pair(VOLUME, VOLUME, captions=w, **SMALL), ()),
        (lambda w: render_pair(VOLUME, VOLUME, background=w, **SMALL), ()),
        (lambda w: render_pair(VOLUME, VOLUME, path=w, **SMALL), (None, "#")),
        (lambda w: image_places(w, GRID), ()),
        (lambda w: image_places(POINTS, w), ()),
        (lambda w: image_places(POINTS, GRID, height=w), (None, 3)),
        (lambda w: image_places(POINTS, GRID, size=w), ()),
        (lambda w: project(VOLUME, w), ()),
        (lambda w: project(VOLUME, "+z", w), ()),
        (lambda w: project(VOLUME, "+z", "shaded", transfer=w), (None,)),
        (lambda w: project(VOLUME, "+z", "slice", depth=w), (None, 3, -1)),
        (lambda w: project(VOLUME, "+z", spacing=w), (None, 3)),
        (lambda w: project(VOLUME, "+z", part=w), (None,)),
        (lambda w: project(VOLUME, "+z", eye=w), (None,)),
        (draw_pictures, ()),
        (lambda w: draw_pictures([w]), ()),
        (lambda w: draw_pictures([PICTURE], style=w), ()),
        (lambda w: draw_pictures([PICTURE], titles=w), (None,)),
        (lambda w: draw_pictures([PICTURE], points=w), (None,)),
        (lambda w: draw_pictures([PICTURE], grids=w), (None,)),
        (lambda w: draw_pictures([PICTURE], path=w), (None,)),
        (lambda w: draw_grids(w, PICTURE), ()),
        (lambda w: draw_grids(DEFORMATION, w), ()),
        (lambda w: draw_grids(DEFORMATION, PICTURE, lines=w), (3,)),
        (lambda w: draw_grids(DEFORMATION, PICTURE, overlay=w), ()),
        (lambda w: draw_grids(DEFORMATION, PICTURE, magnify=w), (3, -1)),
        (lambda w: draw_grids(DEFORMATION, PICTURE, grid=w), (None,)),
        (lambda w: draw_grids(DEFORMATION, PICTURE, key=w), (3,)),
        (lambda w: draw_grids(DEFORMATION, PICTURE, title=w), (None, "#")),
        (lambda w: draw_grids(DEFORMATION, PICTURE, unit=w), (None, "#")),
        (lambda w: draw_grids(DEFORMATION, PICTURE, style=w), ()),
        (lambda w: draw_grids(DEFORMATION, PICTURE, width=w), (3,)),
        (lambda w: draw_grids(DEFORMATION, PICTURE, path=w), (None,)),
        (lambda w: deformation_frames(w, DEFORMATION), ()),
        (lambda w: deformation_frames(VOLUME, w), ()),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, strengths=w), (3,)),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, directions=w), ()),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, transfer=w), (None,)),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, shows=w), ()),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, output=w), (None,)),
        (lambda w: deformation_frames(VOLUME, DEFORMATION, background=w), ()),
        (lambda w: animation_frames(w, Animation(MOVING)), ()),
        (lambda w: animation_frames(VOLUME, w), ()),
        (lambda w: animation_frames(VOLUME, MOVING, fps=w), (3,)),
        (lambda w: animation_frames(VOLUME, MOVING, times=w), (None,)),
        (lambda w: write_movie(w, [BLACK]), ("#",)),
        (lambda w: write_movie("a.gif", w), ()),
        (lambda w: write_movie("a.gif", [BLACK], w), (3,)),
    ],
)
def test_pictures_refuse_all_else_by_name(
    call: Callable[[Any], Any], right: tuple[Any, ...], wrong: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if any(wrong is one or (isinstance(wrong, int | str) and wrong == one) for one in right):
        call(wrong)
    else:
        with pytest.raises(DeformError):
            call(wrong)


@pytest.mark.parametrize(
    "wrong",
    [None, 3, "+z", np.zeros((2, 3, 4, 5)), object(), ControlPoints, Deformation, [FIELD]],
    ids=lambda wrong: type(wrong).__name__,
)
@pytest.mark.parametrize(
    "call",
    [
        lambda w: warp(w, FIELD),
        lambda w: warp(w, DEFORMATION),
        lambda w: warp(VOLUME, w),
        Warper(VOLUME),
        Warper,
        lambda w: Plane.from_view(w, "+z"),
        FIELD.sample_on_grid,
        DEFORMATION.field,
        DEFORMATION.inverse,
        lambda w: DEFORMATION.warp_points(POINTS, w),
        DEFORMATION.apply,
        lambda w: Deformation.from_picture_points(w, "+z", DRAGS),
        DEFORMATION.then,
        lambda w: compose(FIELD, w),
        blend,
        lambda w: invert(w, GRID),
        lambda w: invert(FIELD, w),
        lambda w: find_folds(w, GRID),
        lambda w: find_folds(FIELD, w),
        lambda w: jacobian_determinant(w, GRID),
        lambda w: warp_mesh(w, FIELD),
        lambda w: warp_mesh(MESH, w),
        lambda w: warp_landmarks(w, FIELD),
        lambda w: warp_points(POINTS, w),
        lambda w: warp_points(w, FIELD),
        lambda w: round_trip(w, POINTS),
        lambda w: stretches(w, POINTS),
        lambda w: project(w, "+z"),
        isosurface,
        lambda w: warp_picture(np.zeros((4, 4)), w, Identity(2)),
        lambda w: warp_picture(np.zeros((4, 4)), RASTER, w),
        lambda w: as_field(w, GRID),
        lambda w: signed_distance(MESH, w if w is not None else "none"),
        signed_distance,
    ],
)
def test_anything_else_is_refused_by_name(call: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(DeformError):
        call(wrong)


@pytest.mark.parametrize(
    "wrong", [None, 3, "tail", POINTS, FIELD, LANDMARKS, Landmarks], ids=lambda wrong: type(wrong).__name__
)
@pytest.mark.parametrize(
    "call",
    [
        fit_rbf,
        fit_points,
        lambda w: fit_rigid(w, ()),
        Deformation.from_space_points,
        lambda w: Deformation.from_picture_points(GRID, "+z", w),
    ],
)
def test_no_control_points_are_refused_by_name(call: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(DeformError, match=r"control points|ControlPoints"):
        call(wrong)


def test_pairs_of_landmarks_count_as_control_points() -> None:
    pairs = Landmarks(POINTS, fixed=POINTS + 1)
    wanted = fit_rbf(pairs.control_points())
    np.testing.assert_array_equal(fit_rbf(pairs).displacement(POINTS), wanted.displacement(POINTS))


def test_what_can_follow_a_deformation() -> None:
    assert len(DEFORMATION.then(DEFORMATION).then(Step((DRAGS,), Plane.from_view(GRID, "+z"))).steps) == 3
    with pytest.raises(DeformError, match=r"of type Step, got .*compose"):
        DEFORMATION.then(FIELD)  # type: ignore[arg-type]
