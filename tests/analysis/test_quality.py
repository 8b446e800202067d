"""Quality of a fit: leave-one-out against a loop of fits, who is blamed, energies against integrals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from deformnb.analysis.quality import bending_energy, fit_quality
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import choose_support
from deformnb.rbf.trends import TRENDS

PAIRS = [(k.name, t.name) for k in KERNELS.values() for t in TRENDS.values() if t.order >= k.order]
DEFINITE = [(k, t) for k, t in PAIRS if KERNELS[k].order == 0]
CORNERS = [[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [100.0, 100.0]]


def some_points(n: int, dim: int, seed: int = 0, **more: Any) -> ControlPoints:
    """Points at a minimum distance, dragged by a few units."""
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(*[np.arange(4)] * dim), axis=-1).reshape(-1, dim)
    source = 25.0 * rng.permutation(cells)[:n] + rng.uniform(-8, 8, (n, dim))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 4, (n, dim)), **more)


def slow(points: ControlPoints, support: float, **options: Any) -> np.ndarray:
    """Leave-one-out as it is defined: a fit for every point."""
    active = points.take(np.flatnonzero(points.active))
    return np.array(
        [
            active.displacement[k]
            - fit_rbf(active.remove(i), support=support, **options).displacement(active.target[k])
            for k, i in enumerate(active.ids)
        ]
    )


def check(points: ControlPoints, support: float = 90.0, **options: Any) -> None:
    fast = fit_quality(points, support=support, **options)
    expected = slow(points, support, **options)
    assert_allclose(fast.leave_one_out, expected, atol=1e-8 * np.abs(expected).max())


# -- leave-one-out -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_leaving_one_out_at_once_is_what_a_loop_of_fits_finds(kernel: str, trend: str, dim: int) -> None:
    points = some_points(9, dim, weight=np.linspace(0.5, 2, 9), active=np.arange(9) != 4)
    for smoothing in (0.0, 0.3):
        check(points, kernel=kernel, trend=trend, smoothing=smoothing)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("kernel", "trend"), DEFINITE)
def test_points_with_radii_of_their_own_are_left_out_as_well(kernel: str, trend: str, dim: int) -> None:
    points = some_points(8, dim, radius=[60.0, np.nan, 45.0, np.nan, np.nan, 70.0, np.nan, np.nan])
    for smoothing in (0.0, 0.3):
        check(points, 70.0, kernel=kernel, trend=trend, smoothing=smoothing)


def test_without_the_only_radius_of_its_own_the_trend_is_that_of_least_energy_again() -> None:
    check(some_points(8, 2, radius=[60.0, *[np.nan] * 7]), 70.0)


@pytest.mark.parametrize(("kernel", "trend"), [("wendland_c2", t) for t in TRENDS] + [("thin_plate", "affine")])
@pytest.mark.parametrize("dim", [2, 3])
def test_flat_sets_and_points_that_alone_span_a_dimension(kernel: str, trend: str, dim: int) -> None:
    along = np.linspace(0, 100, 7)
    line = np.zeros((7, dim)) + 3.0
    line[:, 0], line[:, 1] = along, 0.5 * along
    bent = line + np.random.default_rng(2).normal(0, 2, line.shape)
    on_line = ControlPoints.from_arrays(bent, line)
    aside = on_line.add(np.full(dim, 60.0) * [1.0, -0.5, 0.2][:dim], np.full(dim, 66.0) * [1.0, -0.4, 0.2][:dim])
    for points in (on_line, aside):
        check(points, kernel=kernel, trend=trend)


@pytest.mark.parametrize("trend", list(TRENDS))
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_points(trend: str, count: int) -> None:
    check(some_points(count, 2), trend=trend)


def test_points_at_one_place_vouch_for_each_other() -> None:
    points = some_points(8, 2).add([1.0, 1.0])
    twice = points.add(points.source[2], points.target[2])
    check(twice)
    quality = fit_quality(twice, support=90.0)
    assert np.abs(quality.leave_one_out[[2, -1]]).max() < 1e-6
    assert np.abs(quality.residual).max() < 1e-9
    check(twice.move(twice.ids[-1], points.target[2]), smoothing=0.4)


def test_the_support_is_held_at_that_of_all_points() -> None:
    points = some_points(7, 2)
    chosen = choose_support([points])
    assert chosen is not None
    assert_allclose(fit_quality(points).leave_one_out, slow(points, chosen), rtol=1e-9)


def test_residuals_are_what_smoothing_leaves() -> None:
    points = some_points(9, 2)
    assert np.abs(fit_quality(points).residual).max() < 1e-10
    for trend in TRENDS:
        fit = fit_rbf(points, smoothing=0.5, trend=trend)
        expected = fit.displacement(points.target) - points.displacement
        assert_allclose(fit_quality(points, smoothing=0.5, trend=trend).residual, expected, atol=1e-10)
        assert np.abs(expected).max() > 0.1


def test_residuals_of_many_points_one_of_which_was_dragged_far_are_none() -> None:
    places = np.random.default_rng(5).uniform(0, 100, (220, 2))
    points = ControlPoints.from_arrays(places + 1.0, places)
    fit_quality(points, support=40.0)
    dragged = points.move(9, [900.0, 500.0])
    assert np.abs(fit_quality(dragged, support=40.0).residual).max() < 1e-9


def test_no_points_is_said() -> None:
    with pytest.raises(DeformError, match="no active control point"):
        fit_quality(ControlPoints.empty(2))


# -- who is blamed -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trend", list(TRENDS))
@pytest.mark.parametrize("by", [10.0, 30.0, 45.0])
def test_one_drag_among_corners_is_no_mistake(trend: str, by: float) -> None:
    points = ControlPoints.from_arrays([*CORNERS, [50.0, 50.0]], [*CORNERS, [50.0 + by, 50.0]])
    assert fit_quality(points, trend=trend).suspects == ()
    held = points.add([20, 30]).add([80, 20]).add([30, 80]).add([10, 60])  # and others that hold
    assert fit_quality(held, trend=trend).suspects == ()


def landmarks(dim: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Twelve landmarks of a subject and of another one: rotated, larger, bent a little, and read off with an error."""
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(*[np.arange(4)] * dim), axis=-1).reshape(-1, dim)
    source = 30.0 * rng.permutation(cells)[:12] + rng.uniform(-6, 6, (12, dim))
    turn = np.eye(dim)
    turn[:2, :2] = [[np.cos(0.25), -np.sin(0.25)], [np.sin(0.25), np.cos(0.25)]]
    return source, 1.1 * source @ turn.T + 4 * np.sin(source / 30) + rng.normal(0, 1, source.shape)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("trend", ["affine", "similarity", "rigid"])
@pytest.mark.parametrize("dim", [2, 3])
def test_two_landmarks_in_the_wrong_order_are_named_and_nobody_else(trend: str, dim: int) -> None:
    for seed in range(6):
        source, target = landmarks(dim, seed)
        ids = list(range(100, 112))
        assert fit_quality(ControlPoints.from_arrays(source, target, ids=ids), trend=trend).suspects == ()
        others = np.argsort(np.linalg.norm(source - source[3], axis=1))
        # The neighbour, which is mixed up most easily, and another one, to which an affine map may bend.
        for other in others[[1]] if trend == "affine" else others[[1, 6]]:
            swapped = target.copy()
            swapped[[3, other]] = target[[other, 3]]
            wrong = fit_quality(ControlPoints.from_arrays(source, swapped, ids=ids), trend=trend).suspects
            assert wrong == tuple(sorted((103, 100 + int(other))))


def test_one_landmark_far_off_does_not_drag_its_neighbours_along() -> None:
    source, target = landmarks(2, 4)
    target[5] += [35.0, -20.0]
    assert fit_quality(ControlPoints.from_arrays(source, target)).suspects == (5,)
    assert fit_quality(ControlPoints.from_arrays(source, target, radius=[50.0, 60.0, *[np.nan] * 10])).suspects == (5,)


def test_disagreement_is_the_error_over_the_way_to_the_nearest_point() -> None:
    points = ControlPoints.from_arrays([*CORNERS, [50, 50]], [*CORNERS, [50, 58]])
    quality = fit_quality(points)
    assert_allclose(quality.leave_one_out[-1], [0.0, -8.0], atol=1e-10)
    assert quality.disagreement[-1] == pytest.approx(8 / np.hypot(50, 42))
    assert quality.root_mean_square == pytest.approx(np.sqrt((quality.leave_one_out**2).sum() / 5))
    assert_array_equal(fit_quality(ControlPoints.from_arrays([[1, 2]], [[3, 4]])).disagreement, [0.0])


# -- energies ----------------------------------------------------------------------------------------------------------


def test_energy_and_scale_of_a_single_bump() -> None:
    # One point without trend: D = d phi, so the energy is |d|^2 and the variance |d|^2 / 2.
    quality = fit_quality(ControlPoints.from_arrays([[0, 0]], [[3, 4]]), trend="none", support=10.0)
    assert quality.energy == pytest.approx(25.0)
    assert quality.sigma == pytest.approx(np.sqrt(25 / 2))


@pytest.mark.parametrize("kernel", ["wendland_c2", "multiquadric", "thin_plate"])
def test_the_energy_is_a_square_of_lengths_and_blind_to_affine_maps(kernel: str) -> None:
    points = some_points(9, 2)
    larger = replace(points, source=points.source * 3, target=points.target * 3)
    one, three = (fit_quality(p, kernel=kernel) for p in (points, larger))
    assert three.energy == pytest.approx(9 * one.energy)
    assert three.sigma == pytest.approx(3 * one.sigma)
    sheared = ControlPoints.from_arrays(points.target @ [[1.2, 0.1], [0.3, 0.9]] + 7, points.target)
    assert fit_quality(sheared, kernel=kernel).energy < 1e-12 * one.energy


def test_what_is_affine_and_what_is_not() -> None:
    points = some_points(8, 3)
    affine = replace(points, target=points.source @ np.diag([1.1, 0.9, 1.0]) + 3)
    assert fit_quality(affine).affine_share == pytest.approx(1.0)
    assert np.abs(fit_quality(affine).non_affine).max() < 1e-12
    quality = fit_quality(points)
    p = np.column_stack([np.ones(8), points.source])
    expected = points.target - p @ np.linalg.pinv(p) @ points.target
    assert_allclose(quality.non_affine, expected, atol=1e-10)
    assert quality.affine_share == pytest.approx(1 - (expected**2).sum() / (points.displacement**2).sum())
    assert fit_quality(points.reset()).affine_share == 1.0


def second_derivatives(points: ControlPoints, places: np.ndarray) -> np.ndarray:
    """Squared second derivatives, summed over all, of the spline that SciPy makes of sources and targets."""
    from scipy.interpolate import RBFInterpolator

    kernel = "thin_plate_spline" if points.dim == 2 else "linear"
    spline = RBFInterpolator(points.source, points.target, kernel=kernel, degree=1)
    h, total = 1e-3, np.zeros(len(places))
    steps = h * np.eye(points.dim)
    for a in steps:
        for b in steps:
            mixed = spline(places + a + b) - spline(places + a - b) - spline(places - a + b) + spline(places - a - b)
            total += ((mixed / (4 * h * h)) ** 2).sum(axis=1)
    return total


def test_bending_energy_is_the_integral_of_squared_second_derivatives_in_the_plane() -> None:
    points = ControlPoints.from_arrays(
        [[0, 0], [1, 0], [0, 1], [1, 1], [0.4, 0.6]], [[0, 0], [1.1, 0], [0, 1], [1, 1.2], [0.5, 0.5]]
    )
    # Polar about the middle, out to 200 with radii in equal ratios; beyond that little is left (r^-6 at least).
    integral = _integral(points, np.array([0.5, 0.5]))
    assert bending_energy(points) == pytest.approx(integral, rel=0.02)


def _integral(points: ControlPoints, middle: np.ndarray) -> float:
    rng = np.random.default_rng(5)
    near, far, cells = 2.0, 200.0, 500
    side = (np.arange(cells) + 0.5) / cells * 2 * near - near
    square = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    inner = second_derivatives(points, square + middle).sum() * (2 * near / cells) ** 2
    # Outside the square: rays from its edge, the integral over t of f(middle + t q) t dt dq along the edge.
    edge = (np.arange(200) + 0.5) / 200 * 2 * near - near
    q = np.concatenate(
        [np.stack([np.full(200, s * near), edge], axis=-1) for s in (-1, 1)]
        + [np.stack([edge, np.full(200, s * near)], axis=-1) for s in (-1, 1)]
    )
    log_t = (np.arange(120) + rng.uniform(0.4, 0.6)) / 120 * np.log(far / near)
    t = np.exp(log_t)
    f = second_derivatives(points, (middle + t[:, None, None] * q).reshape(-1, 2)).reshape(len(t), -1)
    weight = near * (2 * near / 200) * (np.log(far / near) / 120)
    return float(inner + (f * t[:, None] ** 2).sum() * weight)


@pytest.mark.nightly
def test_bending_energy_in_space_is_that_of_the_biharmonic_spline() -> None:
    # Five points: C has rank one, so the energy is a square that grows with the sideways drag alone; the factor comes
    # from the integral along rays, since outside the sources' ball the derivatives fall like r^-4 and faster.
    points = ControlPoints.from_arrays(
        [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0]],
        [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0.3, 0, 0]],
    )
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    edges = np.geomspace(0.02, 60, 90)
    r = np.sqrt(edges[1:] * edges[:-1])

    # About each source the squared derivatives grow like 1/r^2: the parts near to any of the others are added there.
    def shell(middle: np.ndarray, mask: Any) -> float:
        places = middle + r[:, None, None] * directions
        f = second_derivatives(points, places.reshape(-1, 3)).reshape(len(r), -1) * mask(places)
        return float((4 * np.pi * f.mean(axis=1) * (edges[1:] ** 3 - edges[:-1] ** 3) / 3).sum())

    def nearest(places: np.ndarray, k: int) -> np.ndarray:
        return np.linalg.norm(places[..., None, :] - points.source, axis=-1).argmin(axis=-1) == k

    integral = sum(shell(points.source[k], lambda places, k=k: nearest(places, k)) for k in range(5))
    assert bending_energy(points) == pytest.approx(integral, rel=0.04)


def test_bending_energy_of_special_sets() -> None:
    assert bending_energy(some_points(3, 2)) == 0.0
    assert bending_energy(ControlPoints.empty(3)) == 0.0
    points = some_points(9, 2)
    tenfold = replace(points, source=10 * points.source, target=10 * points.target)
    assert bending_energy(tenfold) == pytest.approx(bending_energy(points))
    space = some_points(9, 3)
    tenfold = replace(space, source=10 * space.source, target=10 * space.target)
    assert bending_energy(tenfold) == pytest.approx(10 * bending_energy(space))
    twice = points.add(points.source[0], points.target[0])
    assert bending_energy(twice) == pytest.approx(bending_energy(points))
    assert bending_energy(twice.move(twice.ids[-1], [1.0, 2.0])) == float("inf")
    assert bending_energy(twice.edit(twice.ids[-1], target=[1.0, 2.0], active=False)) < float("inf")


def test_points_that_hold_the_rim_are_not_blamed_for_a_drag_beside_them() -> None:
    rim = [[0, 0], [200, 0], [0, 100], [200, 100]]
    inside = [[30, 50], [60, 30], [60, 70], [100, 25], [100, 75], [140, 50], [180, 85]]
    drags = [[4, 4], [3, -5], [0, 2], [2, -6], [1, 3], [-2, 0], [-16, 9]]
    points = ControlPoints.from_arrays(rim + inside, rim + (np.array(inside) + drags).tolist())
    quality = fit_quality(points, support=box_diagonal(points))
    corner = 3  # next to the longest drag; the others would carry it along by more than half of the distance to that
    assert quality.disagreement[corner] > 0.5
    assert corner not in quality.suspects


def test_a_point_within_that_was_forgotten_is_still_named() -> None:
    a, b = np.meshgrid(np.linspace(0, 200, 5), np.linspace(0, 100, 5))
    source = np.column_stack([a.ravel(), b.ravel()])
    target = source + 20 * np.column_stack([np.sin(source[:, 1] / 40), np.cos(source[:, 0] / 60)])
    target[12] = source[12]
    assert fit_quality(ControlPoints.from_arrays(source, target)).suspects == (12,)


def test_points_at_one_place_are_compared_with_the_next_place() -> None:
    square = [[0, 0], [9, 0], [0, 9], [9, 9], [4, 4]]
    once = ControlPoints.from_arrays(square, [*square[:4], [5, 4]])
    twice = once.add([4, 4], [5, 4])
    found = fit_quality(twice)
    assert found.disagreement[:4] == pytest.approx(fit_quality(once).disagreement[:4], rel=1e-9)
    assert found.disagreement[4:] == pytest.approx([0, 0], abs=1e-9)  # both state the same


@pytest.mark.parametrize("dim", [2, 3])
def test_leave_one_out_of_a_thin_set_is_that_of_the_fits_of_all_others(dim: int) -> None:
    """Without one of the points the others are thin in another way, and the trend is shrunk in another way."""
    rng = np.random.default_rng(4)
    x = rng.uniform(-50, 50, (9, dim)) * ([1.0] * (dim - 1) + [0.1])
    points = ControlPoints.from_arrays(x + rng.normal(0, 3, x.shape), x)
    found = fit_quality(points, support=60.0).leave_one_out
    for k in range(len(points)):
        rest = fit_rbf(points.remove(k), support=60.0)
        assert np.abs(found[k] - (points.displacement[k] - rest.displacement(points.target[k]))).max() < 1e-7
