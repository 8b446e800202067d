"""The trends: exact optima of the least-energy problem, proper rotations, and angles that nobody gave."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
import oracle
import pytest
from scipy.spatial.transform import Rotation

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import THIN, TRENDS, are_wide, complete, find_trend, nearest_rotation, ridge_of, spreads_of

SUPPORT = 80.0


def phi(r: float) -> float:
    return oracle.psi31(r / SUPPORT)


def random_set(seed: int, dim: int = 2, n: int = 7) -> ControlPoints:
    rng = np.random.default_rng(seed)
    x = rng.permutation(np.stack(np.meshgrid(*[np.arange(3) * 40.0] * dim), axis=-1).reshape(-1, dim))[:n]
    return ControlPoints.from_arrays(x + rng.uniform(-12, 12, x.shape), x + rng.normal(0, 15, x.shape))


def linear_part(fit: RBFInterpolant) -> np.ndarray:
    return np.eye(fit.dim) + fit.polynomial.linear / fit.support


def planar_turn(degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def energy(points: ControlPoints, m: np.ndarray) -> float:
    """tr (Y - X M^T)^T W (Y - X M^T), W the inverse of Phi with the mean removed, written out."""
    w = np.linalg.inv(oracle.matrix_phi(points.target, phi))
    one = np.ones((len(w), 1))
    w = w - w @ one @ one.T @ w / (one.T @ w @ one)
    left = points.source - points.target @ m.T
    return float(np.trace(left.T @ w @ left))


# ---- against the paper's problem -------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_similarity_is_equation_5_with_its_missing_columns(seed: int) -> None:
    points = random_set(seed)
    fit = fit_rbf(points, support=SUPPORT, trend="similarity")
    alpha, gamma = oracle.equation_5(points.target, points.displacement, phi)
    c, a, b = oracle.equation_5_complex(points.target, points.displacement, phi)
    oracle.assert_close(c, alpha[:, 0] + 1j * alpha[:, 1], atol=1e-10)  # the oracles agree with one another
    for x in np.random.default_rng(9).uniform(-20, 120, (10, 2)):
        wanted = oracle.equation_2(x, points.target, alpha, gamma, phi)
        oracle.assert_close(fit.displacement(x), wanted, atol=1e-9)
        oracle.assert_close(oracle.complex_map(x, points.target, c, a, b, phi), wanted, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_rigid_is_the_best_of_all_angles(seed: int) -> None:
    points = random_set(seed)
    fit = fit_rbf(points, support=SUPPORT, trend="rigid")
    c, a, b = oracle.rigid_by_search(points.target, points.displacement, phi)
    assert abs(1 + a) == pytest.approx(1, abs=1e-14)
    oracle.assert_close(linear_part(fit) @ [1, 0], [1 + a.real, a.imag], atol=1e-8)
    for x in np.random.default_rng(9).uniform(-20, 120, (10, 2)):
        wanted = oracle.complex_map(x, points.target, c, a, b, phi)
        oracle.assert_close(fit.displacement(x), wanted, atol=1e-6)  # 1e-8 of the extent


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_no_neighbouring_trend_has_less_energy(seed: int, dim: int) -> None:
    """Also in space, where no closed system exists to compare with: Umeyama's solution is a minimum of the group."""
    points, rng = random_set(seed, dim), np.random.default_rng(seed)
    best = {t: linear_part(fit_rbf(points, support=SUPPORT, trend=t)) for t in TRENDS}
    for _ in range(40):
        vector = rng.normal(0, 0.05, 3)
        small = planar_turn(60 * vector[0]) if dim == 2 else Rotation.from_rotvec(vector).as_matrix()
        tolerance = 1e-9 * energy(points, best["none"])  # rounding of the energy itself
        assert energy(points, small @ best["rigid"]) >= energy(points, best["rigid"]) - tolerance
        scaled = rng.uniform(0.95, 1.05) * small @ best["similarity"]
        assert energy(points, scaled) >= energy(points, best["similarity"]) - tolerance
        sheared = (np.eye(dim) + rng.normal(0, 0.05, (dim, dim))) @ best["affine"]
        assert energy(points, sheared) >= energy(points, best["affine"]) - tolerance
    if dim == 3:  # far away too: the optimum is a global one
        for turn in Rotation.random(200, rng=np.random.default_rng(seed)).as_matrix():
            assert energy(points, turn) >= energy(points, best["rigid"])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_rigid_is_a_proper_rotation_and_similarity_one_times_a_scale(seed: int, dim: int) -> None:
    points = random_set(seed, dim)
    if seed >= 3:  # mirrored: the trend must not mirror with them
        mirror = np.diag([-1.0, *[1.0] * (dim - 1)])
        points = ControlPoints.from_arrays(points.source @ mirror, points.target)
    m = linear_part(fit_rbf(points, support=SUPPORT, trend="rigid"))
    oracle.assert_close(m @ m.T, np.eye(dim), atol=1e-12)
    assert np.linalg.det(m) == pytest.approx(1, abs=1e-12)
    s = linear_part(fit_rbf(points, support=SUPPORT, trend="similarity"))
    oracle.assert_close(s @ s.T, np.eye(dim) * np.trace(s @ s.T) / dim, atol=1e-12)
    assert np.linalg.det(s) >= 0


def test_scaling_is_left_to_the_kernels_in_rigid_and_taken_in_similarity() -> None:
    x = random_set(0).target
    points = ControlPoints.from_arrays(2 * x @ planar_turn(25).T, x)
    rigid, similar = (fit_rbf(points, support=SUPPORT, trend=t) for t in ("rigid", "similarity"))
    oracle.assert_close(linear_part(rigid), planar_turn(25), atol=1e-12)
    oracle.assert_close(linear_part(similar), 2 * planar_turn(25), atol=1e-12)
    oracle.assert_close(rigid.displacement(x), points.displacement, atol=1e-9)


@pytest.mark.parametrize(
    ("trend", "is_linear"),
    [("none", True), ("translation", True), ("affine", True), ("similarity", True), ("rigid", False)],
)
def test_all_trends_but_the_rigid_one_superpose_in_the_plane(trend: str, is_linear: bool) -> None:
    x = random_set(1).target
    d, e = (np.random.default_rng(k).normal(0, 20, x.shape) for k in (1, 2))
    at = np.array([[10.0, 90.0], [70.0, -5.0]])
    a, b, both = (fit_rbf(ControlPoints.from_arrays(x + v, x), support=SUPPORT, trend=trend) for v in (d, e, d + e))
    gap = np.abs(both.displacement(at) - a.displacement(at) - b.displacement(at)).max()
    assert (gap < 1e-9) == is_linear


# ---- angles that nobody gave -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("trend", ["rigid", "similarity", "affine"])
@pytest.mark.parametrize("shared", [0.0, 33.3])
@pytest.mark.parametrize("dim", [2, 3])
def test_handles_that_share_one_source_keep_the_angle_and_say_so(trend: str, shared: float, dim: int) -> None:
    x = random_set(2, dim).target
    m = planar_turn(140) if dim == 2 else Rotation.from_rotvec([0.5, -1.8, 1.1]).as_matrix()
    before = fit_rbf(ControlPoints.from_arrays(x @ m.T, x), support=SUPPORT, trend="rigid")
    collapse = ControlPoints.from_arrays(np.full_like(x, shared), x)
    fit = fit_rbf(collapse, support=SUPPORT, trend=trend, previous=before)
    oracle.assert_close(linear_part(fit), m if trend == "rigid" else 0, atol=1e-6)
    oracle.assert_close(fit.displacement(x), shared - x, atol=1e-9)
    assert any("sources nearly coincide" in note for note in fit.notes)
    if trend == "rigid":
        oracle.assert_close(linear_part(fit_rbf(collapse, support=SUPPORT, trend=trend)), np.eye(dim), atol=1e-6)


def test_a_previous_fit_of_another_dimension_is_ignored() -> None:
    x = random_set(2, 3).target
    flat = fit_rbf(random_set(0), support=SUPPORT, trend="rigid")
    fit = fit_rbf(ControlPoints.from_arrays(np.zeros_like(x), x), support=SUPPORT, trend="rigid", previous=flat)
    oracle.assert_close(linear_part(fit), np.eye(3), atol=1e-6)


def test_a_needle_of_points_in_space_turns_exactly_about_itself_too() -> None:
    """The turn about a row of points is open, but points a thousandth off the row settle it."""
    rng = np.random.default_rng(0)
    x = np.c_[np.linspace(0, 100, 8), rng.normal(0, 0.5, (8, 2))]
    m = Rotation.from_rotvec([2.0, 0.3, -0.4]).as_matrix()
    fit = fit_rbf(ControlPoints.from_arrays(x @ m.T, x), trend="rigid")
    oracle.assert_close(linear_part(fit), m, atol=1e-9)


@pytest.mark.parametrize(
    "h",
    [
        np.diag([1.0, 1.0, 1.0]),
        np.diag([3.0, 2.0, -1.0]),
        np.diag([1.0, 1.0, -1.0 + 1e-3]),
        np.zeros((3, 3)),
        np.diag([1.0, 0, 0]),
        np.diag([5.0, 2.0, 0]),
        np.ones((3, 3)),
        np.zeros((2, 2)),
        np.diag([1.0, -1.0]),
        np.eye(2),
    ],
)
def test_the_nearest_rotation_and_its_derivative_are_always_finite(h: np.ndarray) -> None:
    n = len(h)
    with float64():
        r = np.asarray(nearest_rotation(h, 1.0, np.eye(n)))
        oracle.assert_close(r @ r.T, np.eye(n), atol=1e-12)
        assert np.linalg.det(r) == pytest.approx(1)
        slope = np.asarray(jax.jacobian(lambda a: nearest_rotation(a, 1.0, np.eye(n)))(h))
        assert np.isfinite(slope).all()


def test_the_derivative_of_the_nearest_rotation_is_that_of_differences() -> None:
    rng = np.random.default_rng(3)
    h = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    with float64():
        for sign in (1, -1):  # with and without a mirror in H
            a = h * np.array([1, 1, sign])
            step = rng.normal(size=(3, 3))
            _, got = jax.jvp(lambda a: nearest_rotation(a, 3.0, np.eye(3)), (a,), (step,))
            wanted = (
                nearest_rotation(a + 1e-6 * step, 3.0, np.eye(3)) - nearest_rotation(a - 1e-6 * step, 3.0, np.eye(3))
            ) / 2e-6
            oracle.assert_close(got, wanted, atol=1e-7)


# ---- across the points -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dim", "rank"), [(2, 0), (2, 1), (2, 2), (3, 0), (3, 1), (3, 2), (3, 3)])
def test_completing_a_similarity_of_the_points_gives_that_of_space(dim: int, rank: int) -> None:
    rng = np.random.default_rng(7)
    basis = np.linalg.qr(rng.normal(size=(dim, dim)))[0][:, :rank]
    m = planar_turn(70) if dim == 2 else Rotation.from_rotvec([0.3, 0.9, -0.2]).as_matrix()
    with float64():
        full = np.asarray(complete(1.8 * m @ basis, basis))
    oracle.assert_close(full @ basis, 1.8 * m @ basis, atol=1e-12)
    scale = 1.8 if rank else 1.0
    oracle.assert_close(full @ full.T, scale**2 * np.eye(dim), atol=1e-12)
    assert np.linalg.det(full) == pytest.approx(scale**dim)


@pytest.mark.parametrize(
    "image",
    [
        [1.0, 0, 0],
        [-1.0, 0, 0],
        [-1.0, 1e-12, 0],
        [-1.0, 1e-7, 0],
        [-1.0, 4e-5, 0],
        [-1.0, 5e-5, 0],
        [-2.0, 1e-3, 0],
        [0, 0, 2.0],
        [0, 0, 0],
    ],
)
def test_the_smallest_turn_of_a_row_has_no_gap_at_half_a_turn(image: Any) -> None:
    with float64():
        m = np.asarray(complete(np.array([image]).T, np.array([[1.0, 0, 0]]).T))
    length = np.linalg.norm(image)
    oracle.assert_close(m @ [1, 0, 0], image, atol=1e-11)
    oracle.assert_close(m @ m.T, length**2 * np.eye(3), atol=1e-11)
    assert np.linalg.det(m) == pytest.approx(length**3, abs=1e-11)


@pytest.mark.parametrize(
    ("spread", "penalty"), [(1.0, 0.0), (0.25, 0.0), (0.125, 2.0), (0.05, 32.0), (0.0, 2 * 2499.0**2)]
)
def test_the_penalty_across_a_thin_direction_is_that_of_its_formula(spread: float, penalty: float) -> None:
    """((1/4 - s) / s)^2 / (1/2) below a quarter, literally; no spread counts as 1e-4."""
    turn = planar_turn(30)
    expected = penalty * np.outer(turn[:, 1], turn[:, 1])
    oracle.assert_close(ridge_of(turn, np.array([1.0, spread])), expected, atol=1e-9 * (1 + penalty))


def test_unknown_trends_are_refused_with_a_list() -> None:
    with pytest.raises(DeformError, match="unknown trend 'afine'; choose one of affine, similarity, rigid"):
        find_trend("afine")
    assert len({t.title for t in TRENDS.values()}) == len(TRENDS)


@pytest.mark.parametrize("dim", [2, 3])
def test_sets_that_are_wide_by_themselves_have_no_thin_direction(dim: int) -> None:
    rng = np.random.default_rng(dim)
    found = []
    for _ in range(300):
        targets = rng.normal(size=(12, dim)) * 10.0 ** rng.uniform(-0.8, 0, dim)
        sources = targets @ rng.normal(size=(dim, dim)) + 0.1 * rng.normal(size=targets.shape)
        centred = targets - targets.mean(axis=0)
        found.append(are_wide(centred, sources - targets))
        assert not found[-1] or spreads_of(targets, sources)[1].min() >= THIN
    assert 20 < sum(found) < 280  # both results occur
