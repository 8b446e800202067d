"""A document on another volume: aligned by "box", shares of the old box become equal shares of the new."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from deformnb.document.deformation import Deformation, Keyframe, Step, VolumeReference
from deformnb.document.json_format import from_json, to_json
from deformnb.document.transplant import ALIGNMENTS, transplant
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

OLD = Grid((12, 10, 8), (1.0, 1.5, 2.0), (5.0, -3.0, 7.0))
TURNED: Any = tuple(map(tuple, Rotation.from_euler("xyz", [20, -30, 10], degrees=True).as_matrix()))
NEW = Grid((18, 11, 8), (2.0, 1.0, 1.0), (-40.0, 3.0, 0.0), TURNED)
LARGER = Grid(OLD.shape, tuple(2.5 * s for s in OLD.spacing), (1.0, 2.0, 3.0), TURNED)
POINTS = ControlPoints.from_arrays([[1, 1], [9, 2], [4, 8]], [[1, 2], [10, 2], [4, 6]], radius=[None, 4, None])


def document_on(grid: Grid, *steps: Step, **options: Any) -> Deformation:
    return Deformation(
        steps, volume=VolumeReference("v", grid.shape, grid.spacing, "0" * 64, grid.origin, grid.direction), **options
    )


def share(grid: Grid, points: Any) -> np.ndarray:
    """Places of points in the box of a grid, 0 to 1 along each of its axes."""
    return (grid.point_to_index(points) + 0.5) / np.array(grid.shape[::-1])


def places_of_step(step: Step, places: Any) -> np.ndarray:
    assert step.plane is not None
    return step.plane.from_plane(places)


@pytest.mark.parametrize("view", VIEWS)
def test_points_keep_their_share_of_the_box(view: str) -> None:
    step = Step((POINTS,), Plane.from_view(OLD, view))
    moved = transplant(document_on(OLD, step), NEW, "box").steps[0]
    for name in ("source", "target"):
        before, after = (places_of_step(s, getattr(s.points, name)) for s in (step, moved))
        np.testing.assert_allclose(share(NEW, after), share(OLD, before), atol=1e-9)
    # The side of the one is the side of the other.
    np.testing.assert_allclose(
        np.abs(np.asarray(NEW.direction).T @ moved.plane.frame.T),
        np.abs(np.asarray(OLD.direction).T @ step.plane.frame.T),
        atol=1e-9,
    )


def test_points_in_space_keep_their_share_too() -> None:
    points = ControlPoints.from_arrays([[5, -3, 7], [12, 4, 9]], [[6, -3, 7], [12, 5, 9]])
    moved = transplant(document_on(OLD, Step((points,))), NEW, "box").steps[0].points
    np.testing.assert_allclose(share(NEW, moved.target), share(OLD, points.target), atol=1e-9)


@pytest.mark.nightly
def test_the_result_of_a_larger_copy_is_the_larger_result() -> None:
    """A volume twice and a half as large, turned and laid elsewhere, deforms to the same voxels."""
    values = np.random.default_rng(0).integers(0, 255, OLD.shape, dtype=np.uint8)
    shapes = (Cut(Line(((5.0, -9.0), (5.5, 40.0)))), Cut(Polygon(((1, 1), (3, 1), (2, 4))), enabled=False))
    parts = (
        RigidPart(HalfSpace((0.0, 13.0), (0.0, -1.0)), name="ground"),
        RigidPart(
            Mask(np.eye(3, 5, dtype=bool), Raster((3, 5), (0.5, 0.5), (8.0, 3.0))),
            RigidMotion.turn(20, (8, 3)),
            reach=2.0,
        ),
    )
    document = document_on(
        OLD,
        Step((POINTS,), Plane.from_view(OLD, "+y"), support=9.0, cuts=shapes[:1]),
        Step(
            (POINTS.edit(1, radius=np.nan),),
            Plane.from_view(OLD, "-z"),
            parts=parts,
            trend="similarity",
            cuts=shapes[1:],
        ),
        keyframes=(Keyframe(1.0, (Step((POINTS,), Plane.from_view(OLD, "+y")),)),),
    )
    moved = transplant(document, LARGER, "box")
    one, other = (d.apply(Volume(values, grid)).values for d, grid in ((document, OLD), (moved, LARGER)))
    assert (one != values).mean() > 0.2
    assert np.abs(one.astype(int) - other.astype(int)).max() <= 1  # rounding to whole grey levels
    np.testing.assert_allclose(moved.keyframes[0].steps[0].points.source, 2.5 * POINTS.source, atol=1e-9)


def test_lengths_grow_with_the_box() -> None:
    part = RigidPart(HalfSpace((0.0, 13.0), (0.0, -1.0)), reach=2.0, pivot=(4.0, 13.0))
    step = Step((POINTS.edit(1, radius=np.nan),), Plane.from_view(OLD, "+y"), support=9.0, parts=(part,))
    moved = transplant(document_on(OLD, step), LARGER, "box").steps[0]
    assert (moved.support, moved.parts[0].reach) == pytest.approx((22.5, 5.0))
    assert moved.parts[0].region.signed_distance([moved.parts[0].pivot]) == pytest.approx([0.0], abs=1e-9)


def test_what_was_laid_on_a_box_is_not_laid_there_again() -> None:
    moved = transplant(document_on(OLD, Step((POINTS,), Plane.from_view(OLD, "+y"))), LARGER, "box")
    with pytest.raises(DeformError, match="has no place of the volume"):
        transplant(moved, LARGER, "box")


def test_on_its_own_volume_and_as_it_is_nothing_changes() -> None:
    document = document_on(OLD, Step((POINTS,), Plane.from_view(OLD, "+y")))
    assert transplant(document, OLD, "box") is document
    assert transplant(document, NEW) is document
    assert next(iter(ALIGNMENTS)) == "none"


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (Step((POINTS,), Plane.from_normal((5, 0, 7), (1, 1, 0.3))), "oblique picture would be sheared"),
        (
            Step(
                (POINTS,),
                Plane.from_view(OLD, "+y"),
                parts=(RigidPart(HalfSpace((0, 50), (0, -1)), RigidMotion.turn(9, (0, 0)), name="thigh"),),
            ),
            r'"thigh" turns',
        ),
    ],
)
def test_what_unequal_scales_would_bend_is_refused(step: Step, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        transplant(document_on(OLD, step), NEW, "box")


def test_a_mirrored_box_is_refused() -> None:
    mirrored = replace(NEW, direction=((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    with pytest.raises(DeformError, match="mirror image"):
        transplant(document_on(OLD, Step((POINTS,), Plane.from_view(OLD, "+y"))), mirrored, "box")


def test_a_document_that_does_not_know_its_box_is_refused_with_what_to_do() -> None:
    document = Deformation.from_picture_points(OLD, "+y", POINTS)
    with pytest.raises(DeformError, match="save it again"):
        transplant(document, NEW, "box")
    with pytest.raises(DeformError, match="choose one of none, box"):
        transplant(document, NEW, "somewhere")


def test_the_box_is_kept_in_documents() -> None:
    volume = Volume(np.zeros(OLD.shape, np.uint8), NEW if NEW.shape == OLD.shape else OLD)
    document = Deformation(volume=VolumeReference.of(volume))
    again = from_json(to_json(document))
    assert again == document
    assert again.volume is not None
    assert again.volume.grid == volume.grid


def test_the_box_of_the_result_is_laid_on_the_other_volume_as_well() -> None:
    small, large = Grid((8, 8, 8)), Grid((8, 16, 16), (2.0, 1.0, 0.5), (10.0, 0.0, 0.0))
    step = Step((ControlPoints.from_arrays([[2, 4]], [[3, 4]]),), Plane.from_view(small, "+z"))
    document = replace(document_on(small, step), output=small.crop((0, -1, 0), (8, 9, 12)))
    assert transplant(document, large, "box").output == large.crop((0, -2, 0), (8, 18, 24))
    assert transplant(document, large).output == document.output


def test_a_body_twenty_times_larger_is_said_with_both_sizes() -> None:
    small = Grid((8, 8, 8), unit="mm")
    made = VolumeReference("mouse", small.shape, small.spacing, "0" * 64, small.origin, small.direction, "mm")
    document = Deformation(volume=made)
    told = document.difference(Grid((16, 16, 16), (10.0, 10.0, 10.0), unit="mm"))
    assert "Its volume measures 8 x 8 x 8 mm, this one 160 x 160 x 160 mm: it is 20 times larger" in told
    assert "--align box" in told
    assert "8 times smaller" in document.difference(Grid((2, 2, 2), (0.5, 0.5, 0.5), unit="mm"))
    assert "measures" not in document.difference(Grid((10, 10, 10), unit="mm"))
    assert "it is 20 times" in document.difference(Grid((16, 16, 16), (1e4, 1e4, 1e4), unit="\u00b5m"))
