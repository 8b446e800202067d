"""Theorems of the fit over every kernel, trend and dimension, and its agreement with oracles and other programs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
import scipy.interpolate
import skimage.transform
from scipy.spatial.transform import Rotation

from deformnb import devices
from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.rbf import evaluation, system
from deformnb.rbf import interpolant as rbf
from deformnb.rbf.exactness import SHARES
from deformnb.rbf.fields import raster_lines
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import KERNELS, WendlandC2
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import TRENDS, Span, quadric_span
from deformnb.volume.plane import Raster

# Published: the order of each kernel (Wendland 2004, chapter 8), and the largest order each trend can serve.
KERNEL_ORDER = {
    "wendland_c0": 0,
    "wendland_c2": 0,
    "wendland_c4": 0,
    "gaussian": 0,
    "multiquadric": 1,
    "linear": 1,
    "thin_plate": 2,
    "cubic": 2,
    "inverse_multiquadric": 0,
    "inverse_quadratic": 0,
    "quintic": 3,
}
TREND_ORDER = {"none": 0, "translation": 1, "similarity": 1, "rigid": 1, "affine": 2, "affine_exact": 2, "quadratic": 3}
PAIRS = [(k, t) for k in KERNELS for t in TRENDS if TREND_ORDER[t] >= KERNEL_ORDER[k]]
REFUSED = [(k, t) for k in KERNELS for t in TRENDS if TREND_ORDER[t] < KERNEL_ORDER[k]]
CASES = [(k, t, dim) for k, t in PAIRS for dim in (2, 3)]
SUPPORT = 80.0
EXTENT = 100.0
# Ten thousand roundings: the condition numbers of these seven points stay below 1e4.
CLOSE = 1e-11 * EXTENT


def sources(dim: int, n: int = 7) -> np.ndarray:
    """Points in a box of 100, none nearer than 15 to another."""
    rng = np.random.default_rng(3)
    kept: list[np.ndarray] = []
    while len(kept) < n:
        p = rng.uniform(0, EXTENT, dim)
        if all(np.linalg.norm(p - q) > 15 for q in kept):
            kept.append(p)
    return np.array(kept)


def drag(dim: int, size: float = 6.0, n: int = 7) -> np.ndarray:
    return np.random.default_rng(4).normal(0, size, (n, dim))


def richest(kernel: str) -> str:
    """The trend "affine", or a quadratic one for a kernel that needs it."""
    return "quadratic" if KERNEL_ORDER[kernel] > 2 else "affine"


def count(trend: str) -> int:
    """Points enough to determine a trend: a quadratic one has 10 parameters in space."""
    return 14 if trend == "quadratic" else 7


@cache
def fitted(kernel: str, trend: str, dim: int) -> tuple[ControlPoints, RBFInterpolant]:
    x = sources(dim, count(trend))
    points = ControlPoints.from_arrays(x, x + drag(dim, n=count(trend)))
    return points, fit_rbf(points, kernel=kernel, support=SUPPORT, trend=trend)


def elsewhere(dim: int, n: int = 20) -> np.ndarray:
    return np.random.default_rng(5).uniform(-30, 130, (n, dim))


def linear_part(fit: RBFInterpolant) -> np.ndarray:
    """M of T(x) = M x + ..., the trend's linear part."""
    return np.eye(fit.dim) + fit.polynomial.linear / fit.support


def turn(dim: int, angle: float = 0.7) -> np.ndarray:
    if dim == 3:
        return Rotation.from_rotvec(angle * np.array([2, -1, 2]) / 3).as_matrix()
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


# ---- theorems --------------------------------------------------------------------------------------------------------


def test_the_order_tables_know_every_kernel_and_trend() -> None:
    assert set(KERNELS) == set(KERNEL_ORDER)
    assert set(TRENDS) == set(TREND_ORDER)


@pytest.mark.parametrize(("kernel", "trend"), REFUSED)
def test_pairings_that_are_not_well_posed_are_refused_with_the_trends_that_are(kernel: str, trend: str) -> None:
    points, _ = fitted("wendland_c2", "affine", 2)
    with pytest.raises(DeformError, match=f"the {kernel} kernel .* needs a trend of") as error:
        fit_rbf(points, kernel=kernel, trend=trend, support=SUPPORT)
    for name, order in TREND_ORDER.items():
        assert (name in str(error.value).split("needs a trend of")[1].split(";")[0]) == (order >= KERNEL_ORDER[kernel])


@pytest.mark.parametrize(("kernel", "trend", "dim"), CASES)
def test_interpolates_at_the_targets(kernel: str, trend: str, dim: int) -> None:
    points, fit = fitted(kernel, trend, dim)
    oracle.assert_close(fit.displacement(points.target), points.source - points.target, atol=CLOSE)
    assert fit.trend == trend
    assert fit.ids == points.ids
    assert not [note for note in fit.remarks if "pulled past" not in note]


def groups(trend: str, dim: int) -> dict[str, tuple[Any, Any]]:
    """Linear maps and shifts that a trend must reproduce."""
    shift = np.arange(1.0, dim + 1) * 7
    sheared = turn(dim) @ (np.eye(dim) + 0.4 * np.eye(dim, k=1)) * 1.3
    kinds = {
        "translation": (np.eye(dim), shift),
        "rigid": (turn(dim), shift),
        "similarity": (1.7 * turn(dim), shift),
        "affine": (sheared, shift),
        "affine_exact": (sheared, shift),
        "quadratic": (sheared, shift),
    }
    own = {
        "none": [],
        "translation": ["translation"],
        "rigid": ["translation", "rigid"],
        "similarity": ["translation", "rigid", "similarity"],
        "affine": list(kinds),
        "affine_exact": list(kinds),
        "quadratic": list(kinds),
    }
    return {name: kinds[name] for name in own[trend]}


@pytest.mark.parametrize(("kernel", "trend", "dim"), [c for c in CASES if c[1] != "none"])
def test_a_trend_reproduces_its_own_group_with_nothing_left_for_the_kernels(kernel: str, trend: str, dim: int) -> None:
    x = sources(dim, count(trend))
    for m, shift in groups(trend, dim).values():
        fit = fit_rbf(ControlPoints.from_arrays(x @ m.T + shift, x), kernel=kernel, support=SUPPORT, trend=trend)
        assert np.abs(fit.coefficients).max() < CLOSE
        far = 10 * elsewhere(dim)
        oracle.assert_close(far + fit.displacement(far), far @ m.T + shift, atol=100 * CLOSE)
        oracle.assert_close(linear_part(fit), m, atol=1e-11)


@pytest.mark.parametrize(("kernel", "trend", "dim"), CASES)
def test_no_drag_is_exactly_the_identity_and_a_tiny_drag_is_tiny(kernel: str, trend: str, dim: int) -> None:
    x = sources(dim, count(trend))
    still = fit_rbf(ControlPoints.from_arrays(x), kernel=kernel, support=SUPPORT, trend=trend)
    assert (still.displacement(elsewhere(dim)) == 0).all()
    assert still.ids == tuple(range(count(trend)))
    moved = x.copy()
    moved[0] += 1e-12
    tiny = fit_rbf(ControlPoints.from_arrays(x, moved), kernel=kernel, support=SUPPORT, trend=trend)
    assert np.abs(tiny.displacement(elsewhere(dim))).max() < 1e-10


@pytest.mark.parametrize(("kernel", "trend", "dim"), CASES)
def test_turning_scaling_and_permuting_everything_does_so_to_the_result(kernel: str, trend: str, dim: int) -> None:
    points, fit = fitted(kernel, trend, dim)
    r, scale, shift = turn(dim, -1.1), 0.031, np.full(dim, -44.0)
    order = [3, 0, 6, 2, 5, 1, 4, *range(7, count(trend))]
    other = ControlPoints.from_arrays(*(scale * p[order] @ r.T + shift for p in (points.source, points.target)))
    again = fit_rbf(other, kernel=kernel, support=scale * SUPPORT, trend=trend)
    x = elsewhere(dim)
    oracle.assert_close(
        again.displacement(scale * x @ r.T + shift), scale * fit.displacement(x) @ r.T, atol=scale * CLOSE
    )


@pytest.mark.parametrize("trend", TRENDS)
def test_inactive_points_count_for_nothing(trend: str) -> None:
    points, _ = fitted("wendland_c2", trend, 2)
    more = points.add([500.0, 500.0], [-900.0, 3.0]).add(points.source[0], points.target[0] + 5)
    more = more.edit(len(points), active=False).edit(len(points) + 1, active=False)
    a, b = (fit_rbf(p, trend=trend) for p in (points, more))  # the default support must not see them either
    assert a.support == b.support
    assert a.ids == b.ids
    assert (a.displacement(elsewhere(2)) == b.displacement(elsewhere(2))).all()


@pytest.mark.parametrize(
    ("kernel", "trend"),
    [("wendland_c2", "rigid"), ("multiquadric", "similarity"), ("thin_plate", "affine"), ("wendland_c2", "none")],
)
def test_padding_never_changes_a_result(kernel: str, trend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    points, fit = fitted(kernel, trend, 2)
    monkeypatch.setattr(evaluation, "CAPACITIES", (16, 32))
    wide = fit_rbf(points, kernel=kernel, support=SUPPORT, trend=trend)
    assert len(wide.centers) == 16
    oracle.assert_close(wide.displacement(elsewhere(2)), fit.displacement(elsewhere(2)), atol=CLOSE)
    far = Raster((3, 4), (9.0, 9.0), (10.0, 10.0))
    oracle.assert_close(wide.sample_on_raster(far), fit.sample_on_raster(far), atol=1e-5)  # float32 of values below 100


@pytest.mark.parametrize("n", [8, 9])
def test_capacities_change_over_without_a_jump(n: int) -> None:
    x = sources(2, n)
    fit = fit_rbf(ControlPoints.from_arrays(x, x + drag(2, n=n)), support=SUPPORT)
    assert len(fit.centers) == evaluation.capacity(n) == (8 if n == 8 else 16)
    oracle.assert_close(fit.displacement(x + drag(2, n=n)), -drag(2, n=n), atol=CLOSE)


# ---- derivatives -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kernel", "dim"), [(k, d) for k in KERNELS for d in (2, 3)])
def test_jacobian_is_that_of_central_differences_also_at_the_points(kernel: str, dim: int) -> None:
    points, fit = fitted(kernel, richest(kernel), dim)
    x = np.concatenate([points.target, elsewhere(dim, 10)])
    h = 1e-4
    steps = [fit.displacement(x + h * e) - fit.displacement(x - h * e) for e in np.eye(dim)]
    wanted = np.stack(steps, axis=-1) / (2 * h)
    # h^2 times the third derivative is 1e-9; C1 at the point itself (thin plates) leaves less than h log h
    oracle.assert_close(fit.jacobian(x), wanted, atol=2e-3 if kernel == "thin_plate" else 1e-6)
    assert fit.jacobian(x[0]).shape == (dim, dim)


def whole_span(x: np.ndarray, trend: str) -> Span:
    """Span of points x that determine every linear map."""
    dim = x.shape[1]
    bent = quadric_span(x - x.mean(axis=0), np.eye(dim)) if trend == "quadratic" else ()
    return Span(np.eye(dim), np.zeros((dim, dim)), *bent)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("trend", "dim"), [(t, d) for t in TRENDS for d in (2, 3)])
def test_the_solve_is_differentiable_in_the_drag_and_in_the_places(trend: str, dim: int) -> None:
    n = count(trend)
    x, d = sources(dim, n) / EXTENT, drag(dim, n=n) / EXTENT
    args = (np.ones(n, dtype=bool), np.zeros(n), whole_span(x, trend), np.eye(dim))

    def total(x: Any, d: Any) -> Any:
        alpha, linear, constant, _, bent = system.solve(x, d, *args, kernel=WendlandC2, trend=trend)
        curved = 0.0 if bent is None else jnp.sum(bent**2)
        return jnp.sum(jnp.sin(alpha)) + jnp.sum(linear**2) + jnp.sum(constant) + curved

    with float64():
        gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(x, d)
        value = jax.jit(total)
        for k, gradient in enumerate(gradients):
            step = np.random.default_rng(6).normal(size=x.shape) * 1e-6
            plus, minus = ((x + s * step, d) if k == 0 else (x, d + s * step) for s in (1, -1))
            wanted = (value(*plus) - value(*minus)) / 2
            assert float(jnp.sum(gradient * step)) == pytest.approx(float(wanted), rel=1e-6)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("trend", TRENDS)
def test_gradients_stay_finite_where_nothing_is_dragged_and_the_points_form_a_ball(trend: str) -> None:
    x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
    args = (np.ones(8, dtype=bool), np.zeros(8), whole_span(x, trend), np.eye(3))

    def total(d: Any) -> Any:
        alpha, linear, *_ = system.solve(x, d, *args, kernel=WendlandC2, trend=trend)
        return jnp.sum(alpha) + jnp.sum(linear * np.arange(9).reshape(3, 3))

    with float64():  # all singular values of H are equal: the derivative of an SVD is not finite there
        assert np.isfinite(np.asarray(jax.jit(jax.grad(total))(np.zeros((8, 3))))).all()


# ---- oracles and other programs --------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_affine_is_the_printed_system(dim: int) -> None:
    points, fit = fitted("wendland_c2", "affine", dim)

    def phi(r: float) -> float:
        return oracle.psi31(r / SUPPORT)

    alpha, gamma = oracle.equations_3_and_4(points.target, points.displacement, phi)
    x = elsewhere(dim)
    wanted = np.array([oracle.equation_2(p, points.target, alpha, gamma, phi) for p in x])
    oracle.assert_close(fit.displacement(x), wanted, atol=CLOSE)
    oracle.assert_close(fit.coefficients[:7], alpha, atol=CLOSE)


SCIPY = {
    "thin_plate": ("thin_plate_spline", 1, 1.0),
    "cubic": ("cubic", 1, 1.0),
    "linear": ("linear", 0, 1.0),
    "multiquadric": ("multiquadric", 0, 4 / SUPPORT),
    "gaussian": ("gaussian", -1, 3 / np.sqrt(2) / SUPPORT),
    "inverse_multiquadric": ("inverse_multiquadric", -1, 4 / SUPPORT),
    "quintic": ("quintic", 2, 1.0),
    "inverse_quadratic": ("inverse_quadratic", -1, 4 / SUPPORT),
}


@pytest.mark.parametrize(("kernel", "dim"), [(k, d) for k in SCIPY for d in (2, 3)])
def test_scipy_gives_the_same_field(kernel: str, dim: int) -> None:
    name, degree, epsilon = SCIPY[kernel]
    trend = {2: "quadratic", 1: "affine", 0: "translation", -1: "none"}[degree]
    points, fit = fitted(kernel, trend, dim)
    theirs = scipy.interpolate.RBFInterpolator(
        points.target, points.displacement, kernel=name, degree=degree, epsilon=epsilon
    )
    oracle.assert_close(fit.displacement(elsewhere(dim)), theirs(elsewhere(dim)), atol=100 * CLOSE)


def test_scikit_image_gives_the_same_thin_plate() -> None:
    points, fit = fitted("thin_plate", "affine", 2)
    theirs = skimage.transform.ThinPlateSplineTransform.from_estimate(points.target, points.source)
    x = elsewhere(2)
    oracle.assert_close(x + fit.displacement(x), theirs(x), atol=1e-5)  # theirs is r^2 log(r^2 + 1e-8)


def test_vtk_gives_the_same_thin_plate() -> None:
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonTransforms import vtkThinPlateSplineTransform

    points, fit = fitted("thin_plate", "affine", 2)
    theirs = vtkThinPlateSplineTransform()
    theirs.SetBasisToR2LogR()
    for put, places in ((theirs.SetSourceLandmarks, points.target), (theirs.SetTargetLandmarks, points.source)):
        cloud = vtkPoints()
        cloud.SetDataTypeToDouble()
        for a, b in places:
            cloud.InsertNextPoint(a, b, 0.0)
        put(cloud)
    x = elsewhere(2)
    moved = np.array([theirs.TransformPoint(a, b, 0.0)[:2] for a, b in x])
    oracle.assert_close(x + fit.displacement(x), moved, atol=1e-9)


@pytest.mark.parametrize("name", ["thin_plate", "cubic", "linear"])
def test_kernels_without_a_scale_do_not_depend_on_the_support(name: str) -> None:
    points, fit = fitted(name, "affine", 2)
    other = fit_rbf(points, kernel=name, support=7.0, trend="affine")
    oracle.assert_close(other.displacement(elsewhere(2)), fit.displacement(elsewhere(2)), atol=10 * CLOSE)


def maps_of_degree_two(x: np.ndarray, seed: int) -> np.ndarray:
    """x with a quadratic polynomial added, of about 5 within the box."""
    rng, t = np.random.default_rng(seed), x / EXTENT - 0.5
    dim = x.shape[1]
    curved = np.einsum("nk,mkj,nj->nm", t, rng.normal(0, 9, (dim,) * 3), t)
    return x + curved + t @ rng.normal(0, 5, (dim, dim)) + rng.normal(0, 5, dim)


@pytest.mark.parametrize(
    ("kernel", "own", "dim"),
    [("wendland_c2", False, 2), ("thin_plate", False, 3), ("quintic", False, 2), ("gaussian", True, 2)],
)
def test_the_quadratic_trend_reproduces_quadratic_maps_beyond_the_points(kernel: str, own: bool, dim: int) -> None:
    x = sources(dim, 14)
    points = ControlPoints.from_arrays(maps_of_degree_two(x, 1), x, radius=[40.0 if own else None, *[None] * 13])
    fit = fit_rbf(points, kernel=kernel, support=SUPPORT, trend="quadratic")
    assert np.abs(fit.coefficients).max() < 1e-9
    far = 3 * elsewhere(dim)
    oracle.assert_close(far + fit.displacement(far), maps_of_degree_two(far, 1), atol=1e-8)


@pytest.mark.parametrize("kernel", ["wendland_c2", "thin_plate", "quintic"])
def test_points_on_a_circle_leave_out_what_it_leaves_open(kernel: str) -> None:
    """x^2 + y^2 is constant there: only x^2 - y^2 and x y are determined, with a note that names the conic."""
    angle = np.arange(9.0) * 0.7
    x = 50 + 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moved = x + drag(2, n=9)
    fit = fit_rbf(ControlPoints.from_arrays(moved, x), kernel=kernel, support=SUPPORT, trend="quadratic")
    oracle.assert_close(fit.displacement(x), moved - x, atol=CLOSE)
    h = np.asarray(fit.polynomial.quadratic)
    assert np.abs(np.trace(h, axis1=1, axis2=2)).max() < 1e-6 * np.abs(h).max()
    assert any("nearly on one conic" in note for note in fit.remarks)


@pytest.mark.parametrize(("n", "dim"), [(1, 2), (5, 2), (9, 3)])
def test_too_few_points_for_a_quadratic_trend_are_met_with_what_they_determine(n: int, dim: int) -> None:
    for kernel in ("wendland_c2", "quintic"):
        x = sources(dim, n)
        points = ControlPoints.from_arrays(x + drag(dim, n=n), x)
        fit = fit_rbf(points, kernel=kernel, support=SUPPORT, trend="quadratic")
        oracle.assert_close(fit.displacement(x), drag(dim, n=n), atol=CLOSE)
        assert any("needs" in note or "one control point" in note for note in fit.remarks)


def test_a_point_that_crosses_a_conic_through_the_others_moves_the_map_continuously() -> None:
    angle = np.arange(8.0) * 0.8
    circle = 50 + 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    maps = []
    for off in (-1e-4, 0.0, 1e-4):
        x = circle + np.outer(np.arange(8) == 0, [off, 0])
        points = ControlPoints.from_arrays(x + drag(2, n=8), x)
        maps.append(fit_rbf(points, support=SUPPORT, trend="quadratic").displacement(elsewhere(2)))
    for found in maps:  # an exact quadratic trend would turn from one side to the other by 6 / 1e-4
        oracle.assert_close(found, maps[1], atol=0.01)
        assert np.abs(found).max() < 60


# ---- smoothing -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kernel", "trend", "dim"), [c for c in CASES if c[0] in ("wendland_c2", "linear", "cubic")])
def test_smoothing_leaves_what_its_theory_says(kernel: str, trend: str, dim: int) -> None:
    n = count(trend)
    weight = np.resize([1.0, 0.2, 3.0, 1.0, 7.0, 0.5, 1.0], n)
    points = ControlPoints.from_arrays(sources(dim, n), sources(dim, n) + drag(dim, n=n), weight=weight)
    fit = fit_rbf(points, kernel=kernel, support=SUPPORT, trend=trend, smoothing=0.3)
    left = points.displacement - fit.displacement(points.target)
    oracle.assert_close(left, 0.3 * fit.coefficients[:n] / weight[:, None], atol=CLOSE)
    assert np.abs(left).max() > 0.1


def test_endless_smoothing_is_the_weighted_least_squares_trend() -> None:
    weight = np.array([1.0, 0.2, 3.0, 1.0, 7.0, 0.5, 1.0])
    points = ControlPoints.from_arrays(sources(2), sources(2) + drag(2), weight=weight)
    p = np.c_[points.target, np.ones(7)] * np.sqrt(weight)[:, None]
    gamma = np.linalg.solve(p.T @ p, p.T @ (points.displacement * np.sqrt(weight)[:, None]))
    wanted = np.c_[elsewhere(2), np.ones(20)] @ gamma
    for kernel in ("wendland_c2", "gaussian"):
        fit = fit_rbf(points, kernel=kernel, support=SUPPORT, smoothing=1e8)
        oracle.assert_close(fit.displacement(elsewhere(2)), wanted, atol=1e-6)  # 1 / smoothing of the extent


@pytest.mark.parametrize("bad", [-1e-9, -1.0, np.nan, np.inf])
def test_smoothing_that_is_none_is_refused(bad: float) -> None:
    with pytest.raises(DeformError, match="smoothing must be 0 or a positive number"):
        fit_rbf(fitted("wendland_c2", "affine", 2)[0], smoothing=bad)


# ---- exactness -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize(
    ("trend", "support", "gap"),
    [
        ("affine", 4.0, 4e-3),
        ("affine", 0.5, 5e-4),
        ("similarity", 4.0, 4e-3),
        ("rigid", 1.0, 1e-3),
        ("translation", 1.0, 1e-3),
        ("none", 4.0, 4e-3),
    ],
)
def test_float64_is_within_a_billionth_of_the_extent(trend: str, support: float, gap: float, offset: float) -> None:
    """The promise of the manual, for pairs as near as 1/1000 of the support and supports up to four extents."""
    x = sources(2, 8)
    x[7] = x[0] + gap * EXTENT / np.sqrt(2)
    d = drag(2, n=8)
    d[7] = d[0] + 0.2 * gap * EXTENT  # a slope of 0.28 between the two
    x, d = x + offset, np.round(d * 2**20) / 2**20
    x = np.round(x * 2**20) / 2**20  # so that sources and targets at the offset are exact
    at = elsewhere(2, 12) + offset
    fit = fit_rbf(ControlPoints.from_arrays(x + d, x), support=support * EXTENT, trend=trend)
    wanted = oracle.fifty_digits(x, d, "wendland_c2", support * EXTENT, trend, at)
    assert np.abs(fit.displacement(at) - wanted).max() < 1e-9 * EXTENT


@pytest.mark.parametrize(("kernel", "support"), [(k, s) for k in KERNELS for s in (5.0, 80.0, 400.0)])
def test_the_display_path_is_within_a_thousandth_of_a_pixel(kernel: str, support: float) -> None:
    """At points on pixels: sample_on_raster against the required displacements, for small and for wide kernels."""
    target = np.array([[3, 5], [90, 8], [40, 50], [12, 93], [95, 95], [44, 54], [70, 30]], dtype=float)
    points = ControlPoints.from_arrays(target + drag(2, 15.0), target)
    for offset in (0.0, 4e6):
        moved = ControlPoints.from_arrays(points.source + offset, points.target + offset)
        fit = fit_rbf(moved, kernel=kernel, support=support, trend=richest(kernel))
        picture = fit.sample_on_raster(Raster((100, 100), (1.0, 1.0), (offset, offset)))
        assert picture.dtype == np.float32
        shown = picture[:, target[:, 1].astype(int), target[:, 0].astype(int)].T
        assert np.abs(shown - (points.source - points.target)).max() < 1e-3


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("count", [40, 140])
def test_centres_that_do_not_reach_a_part_of_a_picture_are_left_out_of_it_and_no_others(count: int, own: bool) -> None:
    rng = np.random.default_rng(7)
    target = rng.uniform(0, 200, (count, 2))
    points = ControlPoints.from_arrays(
        target + rng.normal(0, 3, (count, 2)), target, radius=rng.uniform(10, 60, count) if own else None
    )
    fit = fit_rbf(points, kernel="wendland_c0", support=25.0)
    raster = Raster((90, 205), (1.0, 1.0), (-2.0, 50.0))
    found = np.moveaxis(fit.sample_on_raster(raster), 0, -1)
    np.testing.assert_allclose(found, fit.displacement(raster.points()), atol=1e-3)
    slopes = fit.lattice_jacobians(*raster_lines(raster)).transpose(2, 3, 0, 1)
    np.testing.assert_allclose(slopes, fit.jacobian(raster.points()), atol=1e-3)


def test_a_picture_far_from_its_origin_is_evaluated_as_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """Centred before the cast, float32 is enough for any origin of the picture."""
    used, evaluate = [], rbf.evaluate_lattice
    monkeypatch.setattr(rbf, "evaluate_lattice", lambda *args: used.append(args[-1]) or evaluate(*args))
    for offset in (0.0, 4e6):
        points = ControlPoints.from_arrays(sources(2) + offset, sources(2) + drag(2, 0.2) + offset)
        fit_rbf(points, support=SUPPORT).sample_on_raster(Raster((100, 100), (1.0, 1.0), (offset, offset)))
    assert used == [np.float32, np.float32]


@pytest.mark.skipif(not (library.levels() and devices.is_host()), reason="no compiled loops")
@pytest.mark.parametrize(("noise", "kind"), [(0.2, np.float32), (0.6, np.float64)])
def test_a_sample_of_the_picture_decides_about_float32_where_its_estimate_is_too_large(
    noise: float, kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    used, evaluate = [], rbf.evaluate_lattice
    monkeypatch.setattr(rbf, "evaluate_lattice", lambda *args: used.append(args[-1]) or evaluate(*args))
    rng = np.random.default_rng(7)
    target = rng.uniform(0, 256, (600, 2))
    move = 4 * np.sin(target / 16) + rng.normal(0, noise, target.shape)
    fit = fit_rbf(ControlPoints.from_arrays(target + move, target), support=45.0)
    raster = Raster((128, 128), (2.0, 2.0), (0.0, 0.0))
    assert fit.type_within(3.0, 2.0) is np.float64
    found = np.moveaxis(fit.sample_on_raster(raster), 0, -1)
    assert used[-1] is kind
    np.testing.assert_allclose(found, fit.displacement(raster.points()), atol=SHARES["lattice"] * 2.0)


@pytest.mark.parametrize(
    ("settings", "has_radii"),
    [
        ({"kernel": "quintic", "trend": "quadratic"}, False),
        ({"kernel": "thin_plate", "trend": "quadratic"}, False),
        ({"kernel": "wendland_c2", "trend": "affine"}, True),
        ({"kernel": "wendland_c2", "trend": "quadratic"}, True),
        ({"kernel": "wendland_c2", "trend": "none"}, True),
    ],
)
@pytest.mark.parametrize("dim", [2, 3])
def test_numpy_and_jax_solve_the_same_systems(
    settings: dict[str, Any], has_radii: bool, dim: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = ControlPoints.from_arrays(sources(dim), sources(dim) + drag(dim, 0.1))
    if has_radii:
        points = replace(points, radius=np.linspace(0.8, 1.2, len(points)) * SUPPORT)
    own = fit_rbf(points, support=SUPPORT, **settings)
    monkeypatch.setattr(rbf, "is_host", lambda: False)
    other = fit_rbf(points, support=SUPPORT, **settings)
    places = points.target + 3.0
    np.testing.assert_allclose(own.displacement(places), other.displacement(places), atol=1e-9)
    np.testing.assert_allclose(own.displacement(points.target), points.displacement, atol=1e-9)


def test_results_are_arrays_of_the_right_kind() -> None:
    points, fit = fitted("wendland_c2", "affine", 2)
    assert fit.displacement(points.target).dtype == np.float64
    assert fit.displacement([1.0, 2.0]).shape == (2,)
    assert fit.displacement(np.zeros((0, 2))).shape == (0, 2)
    assert fit.displacement(np.zeros((3, 1, 2))).shape == (3, 1, 2)
    assert fit.dim == 2
    with pytest.raises(DeformError, match=r"points must have shape \(\.\.\., 2\)"):
        fit.displacement(np.zeros((4, 3)))
    for value in (fit.coefficients, fit.centers, fit.polynomial.linear):
        assert value.dtype == np.float64
    oracle.assert_close(
        fit_rbf(points, kernel=WendlandC2(SUPPORT)).displacement(points.source), fit.displacement(points.source), atol=0
    )


# ---- points with individual support radii -------------------------------------------------------------------------

OWN_KERNELS = [k for k in KERNELS if KERNEL_ORDER[k] == 0]
RADII = [30.0, None, 55.0, 20.0, None, 80.0, 40.0]


@cache
def own_radii(kernel: str, trend: str, dim: int) -> tuple[ControlPoints, RBFInterpolant]:
    points = ControlPoints.from_arrays(sources(dim), sources(dim) + drag(dim), radius=RADII)
    return points, fit_rbf(points, kernel=kernel, support=SUPPORT, trend=trend)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("trend", TRENDS)
@pytest.mark.parametrize("kernel", OWN_KERNELS)
def test_points_with_their_own_radii_are_interpolated(kernel: str, trend: str, dim: int) -> None:
    points, fit = own_radii(kernel, trend, dim)
    np.testing.assert_allclose(fit.displacement(points.target), points.displacement, atol=CLOSE * 10)


@pytest.mark.parametrize("dim", [2, 3])
def test_their_fit_is_that_of_the_literal_system(dim: int) -> None:
    """Least squares for the trend, then Phi_ij = phi(|x_i - x_j| / R_j) for what it leaves, by NumPy alone."""
    points, fit = own_radii("wendland_c2", "affine", dim)
    x, d = points.target, points.displacement
    radii = np.array([SUPPORT if r is None else r for r in RADII])
    trend = np.column_stack([x, np.ones(len(x))])
    coefficients = np.linalg.lstsq(trend, d, rcond=None)[0]

    def phi(at: np.ndarray) -> np.ndarray:
        rho = np.linalg.norm(at[:, None] - x[None], axis=2) / radii
        return np.maximum(1 - rho, 0) ** 4 * (4 * rho + 1)

    alpha = np.linalg.solve(phi(x), d - trend @ coefficients)
    at = elsewhere(dim)
    expected = np.column_stack([at, np.ones(len(at))]) @ coefficients + phi(at) @ alpha
    np.testing.assert_allclose(fit.displacement(at), expected, atol=CLOSE * 10)
    np.testing.assert_allclose(np.asarray(fit(at)), expected, atol=1e-3)
    lines = np.zeros((dim, 1))
    np.testing.assert_allclose(fit.lattice_values(at.T, lines, 1.0)[:, :, 0].T, expected, atol=1e-3)


def test_a_radius_that_is_that_of_all_changes_nothing() -> None:
    points, fit = fitted("wendland_c2", "similarity", 2)
    same = fit_rbf(
        ControlPoints.from_arrays(points.source, points.target, radius=[SUPPORT] * 7),
        support=SUPPORT,
        trend="similarity",
    )
    assert same.scales is None
    np.testing.assert_array_equal(same.displacement(elsewhere(2)), fit.displacement(elsewhere(2)))


def test_beyond_its_own_radius_a_point_changes_nothing() -> None:
    near, far = [20.0, 20.0], [70.0, 20.0]
    still, moved = (
        ControlPoints.from_arrays([near, far], [near, [70.0 + step, 20.0]], radius=[10, 15]) for step in (0, 4)
    )
    apart = np.array([[20.0, 20.0], [70.0, 36.0], [55.0, 5.0]])
    fits = [fit_rbf(points, support=SUPPORT, trend="none") for points in (still, moved)]
    np.testing.assert_array_equal(fits[1].displacement(apart), fits[0].displacement(apart))
    np.testing.assert_allclose(fits[1].displacement([74.0, 20.0]), [-4.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("kernel", [k for k in KERNELS if KERNEL_ORDER[k] > 0])
def test_kernels_without_an_end_refuse_radii_of_their_own(kernel: str) -> None:
    points = ControlPoints.from_arrays(sources(2), radius=RADII)
    with pytest.raises(DeformError, match=f"individual support radii, and the {kernel} kernel"):
        fit_rbf(points, kernel=kernel, trend=richest(kernel))
    fit_rbf(ControlPoints.from_arrays(sources(2), radius=[None] * 7), kernel=kernel, trend=richest(kernel))


def test_radii_that_do_not_go_together_are_refused_by_name() -> None:
    # Two points a millimetre apart that reach ten metres: the columns of Phi are equal but for 1e-13.
    points = ControlPoints.from_arrays(
        [[5, 0], [0.001, 3], [60, 0]], [[0, 0], [0.001, 0], [60, 0]], radius=[1e4, 2e4, 20]
    )
    with pytest.raises(DeformError, match=r"incompatible.*closest are"):
        fit_rbf(points, trend="none", support=100.0)


# ---- the derivative in closed form ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kernel", "trend", "dim", "own"),
    [(*case, False) for case in CASES] + [(*case, True) for case in CASES if case[0] in OWN_KERNELS],
)
def test_the_jacobian_is_that_of_central_differences(kernel: str, trend: str, dim: int, own: bool) -> None:
    _, fit = (own_radii if own else fitted)(kernel, trend, dim)
    x, h = elsewhere(dim), 1e-4
    differences = np.stack(
        [(fit.displacement(x + h * e) - fit.displacement(x - h * e)) / (2 * h) for e in np.eye(dim)], axis=-1
    )
    np.testing.assert_allclose(fit.jacobian(x), differences, atol=2e-6)
    lattice = fit.lattice_jacobians(x.T, np.zeros((dim, 1)))
    np.testing.assert_allclose(np.moveaxis(lattice[..., 0], -1, 0), fit.jacobian(x), atol=1e-4)


@pytest.mark.parametrize("kernel", ["wendland_c2", "wendland_c4", "gaussian", "multiquadric", "cubic"])
def test_the_jacobian_of_smooth_kernels_is_finite_and_right_at_a_control_point(kernel: str) -> None:
    points, fit = fitted(kernel, "affine", 2)
    x, h = points.target, 1e-4
    differences = np.stack(
        [(fit.displacement(x + h * e) - fit.displacement(x - h * e)) / (2 * h) for e in np.eye(2)], axis=-1
    )
    np.testing.assert_allclose(fit.jacobian(x), differences, atol=1e-5)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("kernel", ["wendland_c0", "wendland_c2", "linear", "thin_plate"])
@pytest.mark.parametrize("support", [0.25, 2.0])
@pytest.mark.parametrize("count", [64, 512, 1500])
def test_the_error_in_float32_stays_below_its_estimate(kernel: str, support: float, count: int) -> None:
    """Sorted points that move like their neighbours: the partial sums of their terms are largest."""
    rng = np.random.default_rng(count)
    target = rng.uniform(0, EXTENT, (count, 3))
    target = target[target[:, 0].argsort()]
    fit = fit_rbf(
        ControlPoints.from_arrays(target + 4 * np.sin(target / 16), target), kernel=kernel, support=support * EXTENT
    )
    line = np.linspace(0, EXTENT, 40)
    rows = np.stack([np.zeros(40), line, np.full(40, EXTENT / 3)])
    columns = np.stack([line, np.zeros(40), np.zeros(40)])
    lines = (rows - fit.origin[:, None]) / fit.support, columns / fit.support
    found, exact = (
        evaluation.evaluate_lattice(*lines, fit.radial_sum(kind).leaves, fit.kernel, kind)
        for kind in (np.float32, np.float64)
    )
    reach = float(np.sqrt(sum(np.abs(part).max() ** 2 for part in (*lines[0], *lines[1]))))
    assert np.abs(found - exact).max() <= fit.float32_error(reach)
