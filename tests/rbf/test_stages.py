"""Stages: every source comes to its target, nothing folds that would in one go, and the chain rule holds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fitting import fit_points, fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.rbf.stages import MOST_STAGES, Staged
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.warping.points import warp_points

CORNERS = [[0.0, 0.0], [90.0, 0.0], [0.0, 90.0], [90.0, 90.0]]
FAR = ControlPoints.from_arrays([*CORNERS, [40.0, 40.0]], [*CORNERS, [90.0, 50.0]])
RASTER = Raster((46, 46), (2.0, 2.0), (0.0, 0.0))
GRID = Grid((8, 91, 91))


def least_det(field: Any) -> float:
    """The smallest det(1 + dD/dx) over a raster."""
    v, u = np.meshgrid(RASTER.rows, RASTER.columns, indexing="ij")
    return float(np.linalg.det(np.eye(2) + field.jacobian(np.stack([u, v], axis=-1))).min())


def pairs_of(kernels: Any = KERNELS) -> list[tuple[str, str]]:
    return [(k, t) for k in kernels for t in TRENDS if TRENDS[t].order >= KERNELS[k].order]


def points_of(dim: int, seed: int = 0) -> ControlPoints:
    rng = np.random.default_rng(seed)
    source = rng.uniform(0, 100, (9, dim))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 6, source.shape))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("kernel", "trend"), pairs_of(("wendland_c2", "gaussian", "linear", "thin_plate")))
def test_every_source_comes_to_its_target(kernel: str, trend: str, dim: int) -> None:
    points = points_of(dim)
    fit = fit_points(points, stages=3, kernel=kernel, trend=trend)
    np.testing.assert_allclose(fit.displacement(points.target), points.displacement, atol=1e-7)
    assert fit.ids == points.ids


def test_one_stage_is_the_plain_fit() -> None:
    assert np.array_equal(fit_points(FAR).displacement(CORNERS), fit_rbf(FAR).displacement(CORNERS))
    assert not isinstance(fit_points(FAR, stages=1), Staged)


def test_a_drag_that_folds_in_one_go_does_not_in_stages() -> None:
    # One point dragged by 51 folds: its reach of 60 lets it go 64/135 of that, 28 (maths of the kernel).
    assert least_det(fit_points(FAR, support=60.0)) < -0.2
    assert least_det(fit_points(FAR, support=60.0, stages=8)) > 0.02


@given(st.integers(2, 12), st.floats(-30, 30), st.floats(-30, 30))
def test_a_composition_of_maps_without_folds_has_none(stages: int, a: float, b: float) -> None:
    points = FAR.move(4, [40 + a, 40 + b])
    fit = fit_points(points, stages=stages, support=120.0)
    assert isinstance(fit, Staged)
    if min(least_det(stage) for stage in fit.fits) > 0.2:  # well free everywhere, so free between the nodes too
        assert least_det(fit) > 0


def test_a_shift_in_stages_is_the_shift() -> None:
    shift = replace(FAR, target=FAR.source + np.array([7.0, -3.0]))
    fit = fit_points(shift, stages=5)
    np.testing.assert_allclose(fit.displacement([[3.0, 80.0], [55.0, 21.0]]), [[-7.0, 3.0]] * 2, atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_jacobian_is_that_of_differences_and_of_jax(dim: int) -> None:
    fit = fit_points(points_of(dim), stages=4)
    x, h = np.random.default_rng(1).uniform(0, 100, (30, dim)), 1e-5
    differences = np.stack(
        [(fit.displacement(x + h * e) - fit.displacement(x - h * e)) / (2 * h) for e in np.eye(dim)], axis=-1
    )
    np.testing.assert_allclose(fit.jacobian(x), differences, atol=1e-7)
    np.testing.assert_allclose(np.asarray(jax.jit(lambda f, p: f(p))(fit, x)), fit.displacement(x), atol=1e-3)


def test_what_a_stage_is_fitted_to() -> None:
    fit = fit_points(FAR, stages=4)
    assert isinstance(fit, Staged)
    for j, stage in enumerate(fit.fits):
        before, after = (FAR.source + share * (FAR.target - FAR.source) for share in (j / 4, (j + 1) / 4))
        np.testing.assert_allclose(stage.displacement(after), before - after, atol=1e-9)


def test_matter_goes_forward_where_its_points_go() -> None:
    moved, reached = warp_points(FAR.source, fit_points(FAR, stages=8))
    assert reached.all()
    np.testing.assert_allclose(moved, FAR.target, atol=1e-3)


def test_a_held_part_stays_in_every_stage() -> None:
    ground = RigidPart(HalfSpace((0.0, 20.0), (0.0, 1.0)), name="ground")  # all above b = 20
    points = ControlPoints.from_arrays([[40.0, 60.0], [80.0, 60.0]], [[60.0, 60.0], [80.0, 60.0]])
    fit = fit_points(points, [ground], stages=4, trend="none", support=60.0)
    np.testing.assert_array_equal(fit.displacement([[5.0, 19.0], [60.0, 3.0]]), 0.0)
    np.testing.assert_allclose(fit.displacement([60.0, 60.0]), [-20.0, 0.0], atol=1e-9)


def test_a_part_with_a_motion_refuses_stages_by_name() -> None:
    bone = RigidPart(HalfSpace((0.0, 20.0), (0.0, 1.0)), RigidMotion.turn(20, (0, 0)), name="bone")
    with pytest.raises(DeformError, match=r"bone.*own motion.*stages of the step back to 1"):
        Step((FAR,), Plane.from_view(GRID, "+z"), parts=(bone,), stages=2)
    Step((FAR,), Plane.from_view(GRID, "+z"), parts=(replace(bone, enabled=False),), stages=2)


@pytest.mark.parametrize("stages", [0, -1, MOST_STAGES + 1, 2.0, True, "4"])
def test_other_numbers_of_stages_are_refused(stages: Any) -> None:
    with pytest.raises(DeformError, match="whole number from 1 to 64"):
        Step((FAR,), Plane.from_view(GRID, "+z"), stages=stages)


def test_points_that_pass_through_one_another_are_named() -> None:
    swap = ControlPoints.from_arrays([[10, 10], [30, 10], [20, 40]], [[30, 10], [10, 10], [20, 40]])
    with pytest.raises(DeformError, match=r"in stage 1 of 2, on the straight paths.*point 1 and point 2"):
        fit_points(swap, stages=2)


def test_a_cut_has_stages_on_either_side() -> None:
    points = ControlPoints.from_arrays([[20, 45], [70, 45]], [[5, 45], [85, 45]])
    cut = Cut(Line(((45.0, -5.0), (45.0, 100.0))))
    step = Step((points,), Plane.from_view(GRID, "+z"), cuts=(cut,), trend="translation", stages=3)
    field = step.field(GRID)
    sides = [extrusion.maps[0] for extrusion in field.fields]
    assert [type(side) for side in sides] == [Staged, Staged]
    assert field.opacity(np.array([45.0, 45.0, 4.0])) == 0  # between the halves, which have gone 15 to either side


def test_a_step_in_stages_is_extruded_as_one_map() -> None:
    deformation = Deformation.from_picture_points(GRID, "+z", FAR, stages=6)
    field = deformation.field(GRID)
    flat = fit_points(FAR, stages=6, support=deformation.steps[0].support_for(FAR))
    v, u = RASTER.rows[::9], RASTER.columns[::9]
    a, b = np.meshgrid(u, v)
    plane = deformation.steps[0].plane
    assert plane is not None
    at = np.asarray(plane.origin) + a[..., None] * np.asarray(plane.u) + b[..., None] * np.asarray(plane.v)
    d = flat.displacement(np.stack([a, b], axis=-1))
    expected = d[..., :1] * np.asarray(plane.u) + d[..., 1:] * np.asarray(plane.v)
    np.testing.assert_allclose(field.displacement(at), expected, atol=1e-9)
