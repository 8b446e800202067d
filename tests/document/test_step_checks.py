"""Reliability of a step: the search for folds, stages, safe drags, quality with cuts and parts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from deformnb.analysis.folds import find_folds, jacobian_determinant
from deformnb.analysis.gaussian_process import uncertainty
from deformnb.analysis.quality import fit_quality
from deformnb.document.deformation import Deformation, Step
from deformnb.document.step_checks import (
    document_folds,
    fold_lattice,
    is_fold_free,
    picture_raster,
    required_stages,
    safe_parts,
    safe_points,
    safe_strength,
    step_folds,
    step_quality,
    step_uncertainty,
)
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fitting import fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart, carry_points
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid

GRID = Grid((16, 64, 64))
PLANE = Plane.from_view(GRID, "+z")
CORNERS = [[5.0, 5.0], [58.0, 5.0], [5.0, 58.0], [58.0, 58.0]]


def a_step(*drags: Any, **options: Any) -> Step:
    """Four corners that hold, and drags given as (source, target)."""
    points = ControlPoints.from_arrays(CORNERS)
    for source, target in drags:
        points = points.add(source, target)
    return Step((points,), PLANE, **{"support": 40.0, "trend": "none", **options})


FAR = ([20.0, 30.0], [48.0, 32.0])
NEAR = ([20.0, 30.0], [25.0, 30.0])


# -- where folds are looked for ----------------------------------------------------------------------------------------


def test_the_lattice_covers_the_picture_from_edge_to_edge() -> None:
    grid = Grid((10, 30, 50), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    step = Step((ControlPoints.from_arrays([[1, 1]]),), Plane.from_view(grid, "+y"))
    lattice = fold_lattice(step, grid)
    assert lattice.shape[0] == 1
    assert max(lattice.shape) == 97
    corners = step.plane.to_plane(lattice.corners(centres=True))[:, :2]
    expected = step.plane.to_plane(grid.corners(centres=True))[:, :2]
    assert_allclose([corners.min(axis=0), corners.max(axis=0)], [expected.min(axis=0), expected.max(axis=0)], atol=1e-9)
    assert lattice.spacing[0] == pytest.approx(lattice.spacing[1], rel=0.1)


def test_slices_that_differ_are_looked_at_one_by_one_and_points_in_space_everywhere() -> None:
    step = a_step(NEAR, extrusion="modulate", curve="sin(pi*z)")
    lattice = fold_lattice(step, GRID)
    assert lattice.shape == (9, 97, 97)
    depths = PLANE.to_plane(lattice.corners(centres=True))[:, 2]
    assert_allclose([depths.min(), depths.max()], PLANE.depth_range(GRID), atol=1e-9)
    space = fold_lattice(Step((ControlPoints.from_arrays([[1, 2, 3]]),)), Grid((9, 5, 33), (1.0, 4.0, 2.0)))
    assert space.shape == (17, 17, 33)
    assert_allclose(space.corners(centres=True)[-1], [32.0, 16.0, 16.0])


def test_a_volume_of_one_slice_has_a_lattice() -> None:
    flat = Grid((1, 20, 20))
    assert fold_lattice(Step((ControlPoints.from_arrays([[1, 1]]),), Plane.from_view(flat, "+y")), flat).shape[2] == 97
    assert fold_lattice(Step((ControlPoints.empty(3),)), flat).shape == (1, 33, 33)


# -- folds and what to do about them -----------------------------------------------------------------------------------


def test_what_is_safe() -> None:
    assert is_fold_free(a_step(NEAR), GRID)
    assert not is_fold_free(a_step(FAR), GRID)
    assert not is_fold_free(a_step(NEAR), GRID, 0.99)
    assert not is_fold_free(a_step(([1, 1], [30, 30]), ([2, 9], [30, 30])), GRID)  # cannot even be fitted
    with pytest.raises(DeformError, match="less than 1"):
        is_fold_free(a_step(NEAR), GRID, 1.5)
    with pytest.raises(DeformError, match="less than 1"):
        is_fold_free(a_step(NEAR), GRID, np.nan)


@pytest.mark.parametrize("options", [{}, {"trend": "affine"}, {"kernel": "gaussian", "trend": "rigid"}])
def test_as_many_stages_as_are_needed_leave_no_fold(options: dict[str, Any]) -> None:
    step = a_step(FAR, **options)
    raster = Raster((200, 200), (0.315, 0.315), (0.0, 0.0))
    assert find_folds(step.fits(GRID)[0], raster).least < 0
    count = required_stages(step, GRID)
    assert count in (2, 4, 8, 16)
    unfolded = replace(step, stages=count)
    assert find_folds(unfolded.fits(GRID)[0], raster).least > 0
    fit = unfolded.fits(GRID)[0]
    assert_allclose(fit.displacement([FAR[1]]), [np.subtract(*FAR)], atol=1e-9)
    if count > 2:
        assert not is_fold_free(replace(step, stages=count // 2), GRID)
    assert required_stages(a_step(NEAR), GRID) == 1


def test_stages_in_space_and_beside_cuts() -> None:
    corners = np.stack(np.meshgrid(*[[4.0, 28.0]] * 3), axis=-1).reshape(-1, 3)
    points = ControlPoints.from_arrays([*corners, [10, 16, 16]], [*corners, [23, 16, 16]])
    grid = Grid((33, 33, 33))
    step = Step((points,), support=20.0, trend="none")
    count = required_stages(step, grid)
    assert count > 1
    assert find_folds(replace(step, stages=count).field(grid), grid).least > 0
    cut = a_step(FAR, cuts=(Cut(Line([(32.0, 0.0), (32.0, 63.0)])),))
    count = required_stages(cut, GRID)
    for fit in replace(cut, stages=count).fits(GRID):
        assert jacobian_determinant(fit, np.array([[10.0, 30.0], [40.0, 32.0]])).min() > 0


def test_points_that_are_swapped_fold_in_any_number_of_stages() -> None:
    swapped = a_step(([20, 32], [40, 32]), ([40, 32], [20, 32]))
    with pytest.raises(DeformError, match="through one another"):
        required_stages(swapped, GRID, most=8)
    with pytest.raises(DeformError, match="point 5 and point 6 are at the same place"):  # no fold
        required_stages(a_step(NEAR, ([24.0, 30.0], NEAR[1])), GRID)
    part = RigidPart(Polygon([(40, 50), (50, 50), (50, 60)]), RigidMotion.turn(0.3, (45, 55)))
    with pytest.raises(DeformError, match="more stages do not help"):
        required_stages(a_step(FAR, parts=(part,)), GRID)


def test_the_safe_strength_is_the_largest() -> None:
    step = a_step(FAR, strength=1.5)
    safe = safe_strength(step, GRID)
    assert 0.2 < safe < 1.0
    assert is_fold_free(replace(step, strength=safe), GRID)
    assert not is_fold_free(replace(step, strength=safe * 1.01), GRID)
    assert safe_strength(a_step(NEAR, strength=0.7), GRID) == 0.7
    assert safe_strength(a_step(FAR, strength=-1.0), GRID) > -1.0


def test_a_curve_that_weakens_the_map_can_fold_where_the_whole_does_not() -> None:
    turned = [[32 + 10 * np.cos(q), 32 + 10 * np.sin(q)] for q in np.arange(6) * np.pi / 3]
    half = [(p, [64 - p[0], 64 - p[1]]) for p in turned]  # half a turn is safe, a part of the path to it is not
    whole = Step((ControlPoints.from_arrays(*map(list, zip(*half, strict=True))),), PLANE, trend="rigid")
    assert is_fold_free(whole, GRID)
    assert not is_fold_free(replace(whole, extrusion="modulate", curve="z"), GRID)


def test_an_edit_goes_as_far_as_is_safe() -> None:
    step = a_step(NEAR)
    before = step.points
    after = before.move(4, FAR[1])
    made = safe_points(step, before, after, GRID)
    assert is_fold_free(step.with_points(made), GRID)
    way = np.subtract(made.target[4], NEAR[1]) / np.subtract(FAR[1], NEAR[1])
    assert way[0] == pytest.approx(way[1])
    assert 0 < way[0] < 1
    assert_array_equal(made.target[:4], after.target[:4])
    near = before.move(4, [26.0, 30.0])
    assert safe_points(step, before, near, GRID) is near
    new = before.add([40.0, 40.0], [15.0, 40.0])
    stopped = safe_points(step, before, new, GRID)
    assert stopped.ids == new.ids
    assert 15.0 < stopped.target[-1, 0] < 40.0
    with pytest.raises(DeformError, match="folds before this edit"):
        safe_points(step, after, after.move(4, [50.0, 40.0]), GRID)


def test_a_part_goes_as_far_as_is_safe_and_takes_its_points_along() -> None:
    grid = Grid((24, 24, 24))
    bone = RigidPart(Mask.drawn("box", (11.5, 11.5, 11.5), (4, 4, 4), np.eye(3)), name="bone")
    around = ControlPoints.from_arrays([[x, y, z] for x in (2, 21) for y in (2, 21) for z in (2, 21)])
    step = Step((around.add([12.0, 12.0, 12.0], [12.0, 12.0, 12.0]),), None, trend="none", parts=(bone,))
    near, far = (replace(bone, motion=RigidMotion.turn(0, (0, 0, 0), (x, 0, 0), (0, 0, 1))) for x in (0.5, 9.0))
    after = (near,)
    assert safe_parts(step, after, grid) is after
    (stopped,) = safe_parts(step, (far,), grid)
    assert stopped.motion is not None
    assert 0.5 < stopped.motion.shift[0] < 9.0
    assert stopped.motion.shift[1:] == (0.0, 0.0)
    moved = carry_points(step.points, step.parts, (stopped,))
    assert_allclose(moved.target[-1], [12 + stopped.motion.shift[0], 12, 12])
    assert is_fold_free(replace(step, parts=(stopped,), maps=(moved,)), grid)
    with pytest.raises(DeformError, match="folds before this edit"):
        safe_parts(replace(step, parts=(far,), maps=(carry_points(step.points, (bone,), (far,)),)), after, grid)


# -- quality -----------------------------------------------------------------------------------------------------------


def six(rng: np.random.Generator, low: Any, high: Any) -> np.ndarray:
    cells = np.stack(np.meshgrid([0.15, 0.5, 0.85], [0.25, 0.75]), axis=-1).reshape(-1, 2)
    return np.asarray(low) + (cells + rng.uniform(-0.08, 0.08, cells.shape)) * np.subtract(high, low)


def test_the_quality_of_a_plain_step_is_that_of_its_fit() -> None:
    step = a_step(FAR, ([40, 20], [42, 25]), trend="affine", smoothing=0.2, strength=0.5)
    expected = fit_quality(step.points.scaled(0.5), support=40.0, smoothing=0.2)
    found = step_quality(step, GRID)
    assert_array_equal(found.leave_one_out, expected.leave_one_out)
    assert_array_equal(found.residual, expected.residual)
    assert np.abs(found.residual).max() > 1e-3
    assert_array_equal(step_quality(replace(step, stages=4), GRID).leave_one_out, expected.leave_one_out)
    with pytest.raises(DeformError, match="no set of control points 1"):
        step_quality(step, GRID, 1)
    with pytest.raises(DeformError, match="no active control point"):
        step_quality(Step((ControlPoints.empty(2),), PLANE), GRID)


def test_regions_between_cuts_are_judged_on_their_own() -> None:
    rng = np.random.default_rng(0)
    left, right = six(rng, [0, 0], [30, 60]), six(rng, [34, 0], [64, 60])
    source = np.stack([left, right], axis=1).reshape(-1, 2)  # one here, one there
    points = ControlPoints.from_arrays(source, source + rng.normal(0, 1, source.shape), ids=range(30, 42))
    step = Step((points,), PLANE, support=50.0, cuts=(Cut(Line([(32.0, 0.0), (32.0, 63.0)])),))
    found = step_quality(step, GRID)
    assert found.ids == points.ids
    for start in (0, 1):
        own = fit_quality(points.take(range(start, 12, 2)), support=50.0)
        assert_allclose(found.leave_one_out[start::2], own.leave_one_out, atol=1e-12)
        assert_allclose(found.disagreement[start::2], own.disagreement, atol=1e-12)
    energies = [fit_quality(points.take(range(k, 12, 2)), support=50.0).energy for k in (0, 1)]
    assert found.energy == pytest.approx(sum(energies))


@pytest.mark.parametrize("trend", ["affine", "rigid", "none"])
def test_beside_a_rigid_part_the_errors_are_those_of_the_whole_map(trend: str) -> None:
    rng = np.random.default_rng(1)
    source = np.concatenate([six(rng, [0, 10], [60, 50]), [[30.0, 4.0]]])
    points = ControlPoints.from_arrays(source, source + rng.normal(0, 1, source.shape), ids=range(20, 27))
    ground = RigidPart(HalfSpace((0, 5), (0, 1)), reach=6.0)  # short, so that no point decides how far it is felt
    step = Step((points.reset().edit(26, target=[30.0, 4.0]).take([6]),), PLANE, parts=(ground,))
    with pytest.raises(DeformError, match="moves freely"):
        step_quality(step, GRID)
    held = replace(points, target=np.concatenate([points.target[:6], source[6:]]))
    step = Step((held,), PLANE, support=45.0, trend=trend, parts=(ground,))
    found = step_quality(step, GRID)
    assert found.ids == tuple(range(20, 26))
    for k in range(6):
        others = fit_rigid(held.remove(20 + k), [ground], support=45.0, trend=trend)
        expected = held.displacement[k] - others.displacement(held.target[k])
        assert_allclose(found.leave_one_out[k], expected, atol=1e-9)


# -- uncertainty -------------------------------------------------------------------------------------------------------


def test_the_uncertainty_of_a_plain_step_is_that_of_its_fit() -> None:
    step = a_step(FAR, ([40, 20], [42, 25]))
    known, expected = step_uncertainty(step, GRID), uncertainty(step.points, support=40.0, trend="none")
    places = np.random.default_rng(0).uniform(0, 63, (4, 5, 2))
    assert_allclose(known.at(places), expected.at(places))
    rows, columns = np.array([[0, 0], [3.0, 9.0]]), np.array([[1.0, 5.0, 9.0], [0, 0, 0]])
    assert_allclose(known.lattice_values(rows, columns)[1, 2], expected.at([9.0, 9.0]), rtol=1e-6)
    with pytest.raises(DeformError, match="shape"):
        known.at([1.0, 2.0, 3.0])


def test_beside_cuts_a_point_vouches_for_its_own_side_only() -> None:
    rng = np.random.default_rng(2)
    left = six(rng, [0, 0], [30, 60])
    points = ControlPoints.from_arrays(left, left + rng.normal(0, 1, left.shape)).add([50.0, 30.0], [52.0, 30.0])
    step = Step((points,), PLANE, support=30.0, cuts=(Cut(Line([(32.0, 0.0), (32.0, 63.0)])),))
    known = step_uncertainty(step, GRID)
    left_alone = uncertainty(points.take(range(6)), support=30.0)
    assert known.at([20.0, 30.0]) == pytest.approx(left_alone.at([20.0, 30.0]))
    right_alone = uncertainty(points.take([6]), support=30.0, sigma=left_alone.sigma)  # its scale is the other side's
    assert known.at([45.0, 30.0]) == pytest.approx(right_alone.at([45.0, 30.0]))
    assert known.at([52.0, 30.0]) == pytest.approx(0.0, abs=1e-6)


def test_a_rigid_part_is_certain() -> None:
    step = a_step(NEAR, ([40, 20], [42, 25]), parts=(RigidPart(HalfSpace((0, 50), (0, -1))),))
    step = step.with_points(step.points.remove(2, 3))
    known = step_uncertainty(step, GRID)
    assert known.at([[30.0, 55.0], [10.0, 60.0]]).max() == 0.0
    assert known.at([30.0, 45.0]) > 0


def test_a_picture_has_its_raster() -> None:
    raster = picture_raster(PLANE, GRID, 64)
    assert raster.shape == (64, 64)
    assert_allclose(raster.points()[-1, -1], PLANE.to_plane(GRID.corners(centres=True))[:, :2].max(axis=0))


def test_the_smallest_determinant_is_followed_between_the_nodes() -> None:
    """A narrow drag between two nodes of the lattice: its least det J is 1 - 135/64 |d|/R in closed form (maths)."""
    grid = Grid((4, 401, 401))
    points = ControlPoints.from_arrays([[201.3, 199.1]], [[203.3, 199.1]], radius=[6.0])
    step = Step((points,), Plane.from_view(grid, "+z"), trend="none", support=6.0)
    found = step_folds(step, grid)
    expected = 1 - 135 / 64 * 2 / 6
    assert find_folds(step.field(grid), fold_lattice(step, grid)).least > expected + 0.02  # the nodes alone miss it
    assert found.least == pytest.approx(expected, abs=2e-3)
    assert document_folds(Deformation((step,)), grid) == found


def test_the_folds_of_several_steps_are_those_of_the_whole() -> None:
    grid = Grid((9, 33, 33))
    points = ControlPoints.from_arrays([[16.0, 16.0]], [[18.0, 16.0]])
    step = Step((points,), Plane.from_view(grid, "+z"), trend="none", support=12.0)
    twice = Deformation((step, step))
    assert document_folds(twice, grid).least < step_folds(step, grid).least
    assert document_folds(Deformation((step, replace(step, enabled=False))), grid) == step_folds(step, grid)
