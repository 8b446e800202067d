"""Eq. 6: rigid parts in a fit, against the literal equation and the laws of rigid motions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from numpy.typing import NDArray

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.fitting import fit_rbf, fit_rigid
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import WEIGHTS, RigidInterpolant, RigidMotion, RigidPart, smoothstep
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Raster

SUPPORT = 100.0
WALL = HalfSpace((0, 0), (1, 0))  # a < 0 is fixed
BOX = Polygon([(60, 60), (90, 55), (95, 85), (62, 88)])
DISC = Mask(np.hypot(*np.meshgrid(np.arange(30) - 15, np.arange(30) - 14)) < 8, Raster((30, 30), (1.5, 2.0), (-60, 30)))
TURN = RigidMotion.turn(25, (75, 70), (6, -4))
FREE_TREND = [k for k in KERNELS if k.startswith(("wendland", "inverse")) or k == "gaussian"]


def points(dim: int = 2, n: int = 6) -> ControlPoints:
    rng = np.random.default_rng(2)
    source = np.array([[30, 10, 4], [45, 60, -20], [12, 80, 33], [40, 110, 8], [110, 20, -7], [130, 70, 25.0]])
    source = source[:n, :dim]
    return ControlPoints.from_arrays(source, source + rng.normal(0, 6, source.shape))


def places(dim: int = 2, n: int = 60) -> NDArray[np.float64]:
    return np.random.default_rng(3).uniform(-80, 160, (n, dim))


def within(region: AbstractRegion, motion: RigidMotion | None = None) -> NDArray[np.float64]:
    """Places that a part covers in the result."""
    at = np.random.default_rng(4).uniform(-100, 160, (4000, region.dim))
    inside = at[region.signed_distance(at) < -0.5][:80]
    return inside if motion is None else motion(inside)


def as_displacement(motion: RigidMotion, at: NDArray[np.float64]) -> NDArray[np.float64]:
    return motion.inverse(at) - at


# ---- the equation ----------------------------------------------------------------------------------------------------


def test_the_kernels_that_need_no_trend_are_known() -> None:
    for name in KERNELS:
        if name in FREE_TREND:
            fit_rbf(points(), kernel=name, trend="none", support=SUPPORT)
        else:
            with pytest.raises(DeformError, match="needs a trend"):
                fit_rbf(points(), kernel=name, trend="none", support=SUPPORT)


@pytest.mark.parametrize("kernel", FREE_TREND)
@pytest.mark.parametrize("dim", [2, 3])
def test_equation_6(kernel: str, dim: int) -> None:
    region = HalfSpace((0,) * dim, (1,) + (0.5,) * (dim - 1))
    given = points(dim)
    fit = fit_rigid(given, [RigidPart(region, weight="distance")], kernel=kernel, support=SUPPORT)
    wanted = oracle.equation_6(
        given.target,
        given.displacement,
        lambda r: float(oracle.radial(kernel, r / SUPPORT)),
        lambda x: max(float(region.signed_distance(x)), 0.0),
    )
    for x in places(dim, 20):
        oracle.assert_close(fit.displacement(x), wanted(x), atol=1e-9)


@pytest.mark.parametrize("kernel", FREE_TREND)
def test_equation_6_with_the_smooth_step(kernel: str) -> None:
    given = points()
    scale = min(given.target[:, 0])
    fit = fit_rigid(given, [RigidPart(WALL)], kernel=kernel, trend="none", support=SUPPORT)
    wanted = oracle.equation_6(
        given.target,
        given.displacement,
        lambda r: float(oracle.radial(kernel, r / SUPPORT)),
        lambda x: float(smoothstep(max(x[0], 0.0) / scale)),
    )
    for x in places(2, 20):
        oracle.assert_close(fit.displacement(x), wanted(x), atol=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 7.0])
def test_the_unit_of_the_distance_does_not_matter(factor: float) -> None:
    """w -> c w, and all lengths scaled together."""
    part = RigidPart(BOX, weight="distance")
    fit = fit_rigid(points(), [part], support=SUPPORT)
    assert isinstance(fit, RigidInterpolant)
    given = points()
    scaled = ControlPoints.from_arrays(factor * given.source, factor * given.target)
    box = Polygon((factor * np.array(BOX.vertices)).tolist())
    other = fit_rigid(scaled, [RigidPart(box, weight="distance")], support=factor * SUPPORT)
    oracle.assert_close(other.displacement(factor * places()), factor * fit.displacement(places()), atol=1e-9 * factor)


# ---- fixed parts, moving parts, points -------------------------------------------------------------------------

PARTS: dict[str, list[RigidPart]] = {
    "fixed": [RigidPart(BOX)],
    "turned": [RigidPart(BOX, TURN)],
    "mask": [RigidPart(DISC)],
    "two": [RigidPart(WALL), RigidPart(BOX, TURN)],
    "with a reach": [RigidPart(BOX, TURN, reach=3.0), RigidPart(DISC)],
    "distance": [RigidPart(WALL, weight="distance"), RigidPart(BOX, TURN, weight="distance")],
    "mixed": [RigidPart(WALL, weight="distance"), RigidPart(BOX, TURN)],
}


@pytest.mark.parametrize("name", PARTS)
def test_parts_move_as_they_must_and_points_are_reached(name: str) -> None:
    fit = fit_rigid(points(), PARTS[name], support=SUPPORT)
    for part in PARTS[name]:
        at = within(part.region, part.motion)
        wanted = np.zeros_like(at) if part.motion is None else as_displacement(part.motion, at)
        assert len(at) > 10
        if part.motion is None and len(PARTS[name]) == 1:
            assert (fit.displacement(at) == 0).all()
        oracle.assert_close(fit.displacement(at), wanted, atol=1e-12)
    oracle.assert_close(fit.displacement(points().target), points().displacement, atol=1e-9)
    assert fit.ids == points().ids


@pytest.mark.parametrize(
    ("kernel", "trend"),
    [*(("wendland_c2", trend) for trend in TRENDS), ("thin_plate", "affine"), ("multiquadric", "rigid")],
)
def test_no_trend_moves_a_part(kernel: str, trend: str) -> None:
    fit = fit_rigid(points(), [RigidPart(WALL)], kernel=kernel, trend=trend, support=SUPPORT)
    assert (fit.displacement(within(WALL)) == 0).all()
    oracle.assert_close(fit.displacement(points().target), points().displacement, atol=1e-8)
    assert fit.trend == trend


def test_parts_in_space() -> None:
    axis = (1.0, 2.0, -1.0)
    motion = RigidMotion.turn(40, (0, 0, 50), (3, 3, 3), axis)
    above, below = HalfSpace((0, 0, 160), (0, 0, -1)), HalfSpace((0, 0, -60), (0, 0, 1))
    fit = fit_rigid(points(3), [RigidPart(below), RigidPart(above, motion)], support=SUPPORT)
    at = np.random.default_rng(5).uniform(-20, 20, (40, 3))
    oracle.assert_close(fit.displacement(at - np.array([0, 0, 90])), np.zeros((40, 3)), atol=1e-12)
    moved = motion(at + np.array([0, 0, 300]))
    oracle.assert_close(fit.displacement(moved), as_displacement(motion, moved), atol=1e-10)
    oracle.assert_close(fit.displacement(points(3).target), points(3).displacement, atol=1e-9)


def test_only_parts_blend_by_the_inverse_square_of_their_distances() -> None:
    a, b = HalfSpace((0, 0), (1, 0)), HalfSpace((100, 0), (-1, 0))
    shift = RigidMotion.turn(0, (0, 0), (0, 10))
    fit = fit_rigid(ControlPoints.empty(2), [RigidPart(a), RigidPart(b, shift)], support=SUPPORT)
    for x in (10.0, 50.0, 80.0):
        v, w = 1 / x**2, 1 / (100 - x) ** 2
        oracle.assert_close(fit.displacement([x, 7.0]), [0, -10 * w / (v + w)], atol=1e-12)


def test_overlapping_parts_with_one_motion_are_one() -> None:
    fit = fit_rigid(points(), [RigidPart(BOX, TURN), RigidPart(BOX, TURN)], support=SUPPORT)
    at = within(BOX, TURN)
    oracle.assert_close(fit.displacement(at), as_displacement(TURN, at), atol=1e-12)


# ---- how smooth it is ------------------------------------------------------------------------------------------------

# maths.md: the largest displacement of a drag by 1 at this distance from the part, with the paper's distance as weight.
OVERSHOOT = {50.0: 1.10, 20.0: 1.48, 10.0: 2.23, 5.0: 3.80, 2.0: 8.57}


@pytest.mark.parametrize("distance", OVERSHOOT)
def test_the_smooth_step_does_not_overshoot_and_the_paper_s_distance_does(distance: float) -> None:
    drag = ControlPoints.from_arrays([[distance, 1.0]], [[distance, 0.0]])
    at = np.stack([np.linspace(0, 120, 24001), np.zeros(24001)], axis=-1)
    largest = {
        weight: np.abs(
            fit_rigid(drag, [RigidPart(WALL, weight=weight)], trend="none", support=SUPPORT).displacement(at)
        ).max()
        for weight in WEIGHTS
    }
    assert largest["saturated"] == pytest.approx(1.0, abs=1e-6)
    assert largest["distance"] == pytest.approx(OVERSHOOT[distance], abs=0.005)


def test_second_derivatives_are_continuous_across_the_surface_of_a_part() -> None:
    fit = fit_rigid(points(), [RigidPart(WALL)], support=SUPPORT)
    scale = float(points().target[:, 0].min())

    def jumps(h: float) -> float:
        a = np.concatenate([np.arange(-5, 5), np.arange(-5, 5) + round(scale / h)]) * h
        d = fit.displacement(np.stack([a, np.full(20, 33.0)], axis=-1))
        second = np.diff(d.reshape(2, 10, 2), 2, axis=1) / h**2
        return float(np.abs(np.diff(second, axis=1)).max())

    assert jumps(0.01) < 0.2 * jumps(0.1) < 0.04 * jumps(1.0) * 2  # they vanish with the step: no jump is left


@pytest.mark.parametrize("weight", WEIGHTS)
def test_turning_and_moving_everything_does_so_to_the_result(weight: str) -> None:
    g = RigidMotion.turn(-67, (11, 4), (300, -90))
    fit = fit_rigid(points(), [RigidPart(BOX, TURN, weight), RigidPart(WALL, None, weight)], support=SUPPORT)
    m, inverse = np.asarray(g.matrix), g.inverse
    turned = np.asarray(g.matrix) @ np.asarray(TURN.matrix) @ m.T
    shift = g(TURN(inverse(np.zeros(2))))
    motion = RigidMotion(tuple(map(tuple, turned.tolist())), tuple(shift.tolist()))
    wall = HalfSpace(tuple(g((0, 0))), tuple(m @ [1, 0]))
    given = ControlPoints.from_arrays(g(points().source), g(points().target))
    box = Polygon(g(BOX.vertices).tolist())
    other = fit_rigid(given, [RigidPart(box, motion, weight), RigidPart(wall, None, weight)], support=SUPPORT)
    oracle.assert_close(other.displacement(g(places())), fit.displacement(places()) @ m.T, atol=1e-9)


# ---- points in parts -------------------------------------------------------------------------------------------------


def test_points_in_a_part_that_ask_for_what_it_does_are_left_out() -> None:
    inside = np.array([[75.0, 70.0], [80.0, 75.0]])
    both = points()
    for k, x in enumerate(inside):
        both = both.add(x, TURN(x), name=f"pin {k}")
    fit, plain = (fit_rigid(p, [RigidPart(BOX, TURN, name="tibia")], support=SUPPORT) for p in (both, points()))
    assert fit.ids == points().ids
    oracle.assert_close(fit.displacement(places()), plain.displacement(places()), atol=1e-9)
    assert len([note for note in fit.notes if "tibia" in note]) == 2
    pinned = points().add([-5.0, 10.0])  # a pin that does not move, in a part that does not move
    assert fit_rigid(pinned, [RigidPart(WALL)], support=SUPPORT).notes == ()
    alone = fit_rigid(ControlPoints.from_arrays([[-5, 10]]), [RigidPart(WALL)])
    assert (alone.displacement(places()) == 0).all()


def test_points_in_a_part_that_ask_for_something_else_are_refused_by_name() -> None:
    pulled = points().add([75.0, 70.0], [77.0, 70.0], name="knee")
    with pytest.raises(DeformError, match=r'knee.* is in the rigid part "femur", which is fixed; move or remove'):
        fit_rigid(pulled, [RigidPart(BOX, name="femur")], support=SUPPORT)
    with pytest.raises(DeformError, match="is in a rigid part, which has its own motion"):
        fit_rigid(points().add([75.0, 70.0], TURN([75.0, 70.0]) + 1), [RigidPart(BOX, TURN)], support=SUPPORT)
    off = pulled.edit(pulled.ids[-1], active=False)
    assert fit_rigid(off, [RigidPart(BOX)], support=SUPPORT).ids == points().ids


def test_a_point_is_held_where_the_part_has_gone() -> None:
    """A point dropped where the part was, and is no more, is free."""
    shift = RigidMotion.turn(0, (0, 0), (200, 0))
    free = points().add([300.0, 300.0], [75.0, 70.0])
    fit = fit_rigid(free, [RigidPart(BOX, shift)], support=SUPPORT)
    oracle.assert_close(fit.displacement([75.0, 70.0]), [225.0, 230.0], atol=1e-9)


# ---- smoothing, switches, other methods -----------------------------------------------------------------------


def test_without_parts_it_is_the_plain_fit_and_switched_off_parts_are_none() -> None:
    wanted = fit_rbf(points(), support=SUPPORT).displacement(places())
    for parts in ([], [RigidPart(BOX, enabled=False)]):
        assert (fit_rigid(points(), parts, support=SUPPORT).displacement(places()) == wanted).all()


def test_smoothing_misses_the_points_and_never_the_parts() -> None:
    smooth = fit_rigid(points(), [RigidPart(BOX, TURN), RigidPart(WALL)], support=SUPPORT, smoothing=1.0)
    at = within(BOX, TURN)
    oracle.assert_close(smooth.displacement(at), as_displacement(TURN, at), atol=1e-12)
    assert np.abs(smooth.displacement(points().target) - points().displacement).max() > 0.5
    heavy = points().edit(0, weight=1e9)
    d = fit_rigid(heavy, [RigidPart(WALL)], support=SUPPORT, smoothing=1.0).displacement(heavy.target)
    oracle.assert_close(d[0], heavy.displacement[0], atol=1e-5)


@pytest.mark.parametrize("name", ["two", "mask"])
def test_jax_and_lattices_say_what_points_say(name: str) -> None:
    fit = fit_rigid(points(), PARTS[name], support=SUPPORT)
    with float64():
        found = np.asarray(jax.jit(lambda f, x: f(x))(fit, jnp.asarray(places())))
    oracle.assert_close(found, fit.displacement(places()), atol=1e-9)
    raster = Raster((23, 31), (7.0, 9.0), (-60.0, -50.0))
    for _ in range(2):  # the second time with the distances of the first
        oracle.assert_close(
            np.moveaxis(fit.sample_on_raster(raster), 0, -1), fit.displacement(raster.points()), atol=2e-4
        )
    moved = fit_rigid(points(), [replace(p, motion=RigidMotion.turn(3, (0, 0))) for p in PARTS[name]], support=SUPPORT)
    oracle.assert_close(
        np.moveaxis(moved.sample_on_raster(raster), 0, -1), moved.displacement(raster.points()), atol=2e-4
    )
    slope = fit.jacobian(places(2, 5))
    h = 1e-5
    for k in range(2):
        step = h * np.eye(2)[k]
        by_hand = (fit.displacement(places(2, 5) + step) - fit.displacement(places(2, 5) - step)) / (2 * h)
        oracle.assert_close(slope[..., k], by_hand, atol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RigidPart("box"), "needs a region, got str"),
        (lambda: RigidPart(BOX, weight="soft"), "unknown weight 'soft'"),
        (lambda: RigidPart(BOX, reach=0.0), "reach"),
        (lambda: RigidPart(BOX, reach=np.nan), "reach"),
        (lambda: RigidPart(BOX, RigidMotion.turn(1, (0, 0, 0), axis=(1, 0, 0))), "motion of 3 dimensions"),
        (lambda: fit_rigid(points(3), [RigidPart(BOX)]), "has 2 dimensions, the control points in 3"),
        (lambda: fit_rigid(points(), [RigidPart(Line([(0, 0), (1, 1)]))]), "no inside"),
        (lambda: fit_rigid(points(), [RigidPart(WALL, weight="distance")], kernel="thin_plate"), "distance"),
    ],
)
def test_what_is_no_rigid_part_is_refused(make: Any, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        make()


def test_a_part_is_moved_as_far_as_its_strength() -> None:
    part = RigidPart(BOX, TURN)
    assert part.scaled(1.0) is part
    assert RigidPart(BOX).scaled(0.3) == RigidPart(BOX)
    half = part.scaled(0.5).motion
    assert half is not None
    oracle.assert_close(half(half(places())), TURN(places()), atol=1e-10)


def test_a_point_that_tears_matter_out_of_a_part_is_told() -> None:
    bone = RigidPart(HalfSpace((0.0, 0.0), (1.0, 0.0)), name="bone")  # all left of 0
    fit = fit_rigid(ControlPoints.from_arrays([[-3, 0], [8, 5]], [[6, 0], [9, 5]]), [bone], support=20.0)
    assert fit.notes[0] == (
        'point 1 is dragged in the rigid part "bone", which does not follow: its tissue is seen twice'
    )
    assert not any("point 2" in note for note in fit.notes)
