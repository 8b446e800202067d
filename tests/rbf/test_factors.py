"""Matrices that are cached while points are dragged: the same fits as from new ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.rbf.factors import kernel_values
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import TRENDS

FAR = 64.0
"""Points that are all shifted so far have no factor; what a shift by a power of two rounds is less than 1e-13."""

FACTOR = 1e-8
"""By how much a factor that follows drags may be off in addition: 1e-10 of the extent, which is invisible."""


def scattered(n: int, dim: int, seed: int) -> ControlPoints:
    rng = np.random.default_rng(seed)
    target = rng.uniform(0, 100, (n, dim))
    return ControlPoints.from_arrays(target + rng.normal(0, 2, (n, dim)), target, weight=rng.uniform(0.5, 2, n))


def anew(points: ControlPoints, at: NDArray[np.float64], **settings: Any) -> NDArray[np.float64]:
    shifted = replace(points, source=points.source + FAR, target=points.target + FAR)
    return fit_rbf(shifted, **settings).displacement(at + FAR)


def rounding_of(fit: RBFInterpolant) -> float:
    """By how much a fit may miss its points by rounding: ``n eps`` times the largest sum of its terms without signs.

    Elimination solves a system that differs from the given one by so much in each entry, on any processor
    (Higham, Accuracy and Stability of Numerical Algorithms, theorem 9.5, without its growth factor, which is below ten
    in practice; the largest seen is a fortieth of this).
    """
    n = int(fit.count)
    x, w = np.asarray(fit.centers)[:n], np.abs(np.asarray(fit.coefficients)[:n])
    kernel = np.abs(np.asarray(fit.kernel.profile(((x[:, None] - x) ** 2).sum(axis=-1))))
    terms = (
        kernel @ w
        + np.abs(x) @ np.abs(np.asarray(fit.polynomial.linear)).T
        + np.abs(np.asarray(fit.polynomial.constant))
    )
    return float(n * np.finfo(float).eps * terms.max())


@pytest.mark.parametrize(
    ("kernel", "trend"),
    [
        (kernel.name, trend.name)
        for kernel in KERNELS.values()
        for trend in TRENDS.values()
        if kernel.order <= min(trend.order, 2)
    ],
)
@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_a_drag_of_some_of_many_points_gives_the_fit_of_all_of_them(kernel: str, trend: str, smoothing: float) -> None:
    points, at = scattered(220, 2, seed=3), np.random.default_rng(0).uniform(-10, 110, (300, 2))
    support = 100 * KERNELS[kernel].shares[0]
    settings: dict[str, Any] = {"kernel": kernel, "trend": trend, "smoothing": smoothing, "support": support}
    fit_rbf(points, **settings)
    for moved in ([7], [7, 100], range(0, 80, 10)):  # each of them from where the last one ended
        target = np.array(points.target)
        target[list(moved)] += [3.0, -2.0]
        points = replace(points, target=target)
        dragged = fit_rbf(points, **settings)
        rounding = FACTOR + rounding_of(dragged)
        np.testing.assert_allclose(dragged.displacement(at), anew(points, at, **settings), rtol=0, atol=2 * rounding)
        if not smoothing:
            np.testing.assert_allclose(dragged.displacement(target), points.displacement, rtol=0, atol=rounding)


def test_a_drag_beside_a_band_of_many_points_gives_the_fit_of_all_of_them() -> None:
    points, at = scattered(1100, 3, seed=5), np.random.default_rng(1).uniform(0, 100, (300, 3))
    fit_rbf(points, support=20.0)
    target = np.array(points.target)
    target[500:503] += 4.0
    points = replace(points, target=target)
    np.testing.assert_allclose(
        fit_rbf(points, support=20.0).displacement(at), anew(points, at, support=20.0), atol=1e-8
    )


def test_drags_without_moved_targets_and_other_settings_do_not_take_another_fit() -> None:
    points, at = scattered(220, 2, seed=8), np.random.default_rng(2).uniform(0, 100, (50, 2))
    fit_rbf(points, support=40.0)
    pulled = replace(points, source=points.source + np.random.default_rng(4).normal(0, 1, points.source.shape))
    heavy = replace(points, weight=points.weight * 3)
    for some, settings in (
        (pulled, {"support": 40.0}),
        (points, {"support": 50.0}),
        (points, {"support": 40.0, "kernel": "wendland_c4"}),
        (points, {"support": 40.0, "smoothing": 1.0}),
        (heavy, {"support": 40.0, "smoothing": 1.0}),
    ):
        np.testing.assert_allclose(fit_rbf(some, **settings).displacement(at), anew(some, at, **settings), atol=1e-8)


@pytest.mark.parametrize("kernel", ["wendland_c2", "multiquadric", "thin_plate"])
def test_between_drags_of_one_point_the_sources_of_others_and_the_trend_may_change(
    kernel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deformnb.rbf.interpolant.factor_matrix", None)  # for lack of exactness: never called
    points, at = scattered(220, 2, seed=12), np.random.default_rng(3).uniform(0, 100, (50, 2))
    settings: dict[str, Any] = {"kernel": kernel, "support": 40.0}
    fit_rbf(points, **settings)
    trends = ["affine", "affine", "affine_exact" if kernel == "thin_plate" else "rigid", "affine"]
    for step, trend in enumerate(trends * 2):
        target, source = np.array(points.target), np.array(points.source)
        target[7] += [2.0, -1.0]
        source[100] += [1.5, 0.5] if step % 3 == 2 else [0.0, 0.0]
        points = replace(points, target=target, source=source)
        dragged = fit_rbf(points, trend=trend, **settings)
        # Two solutions of one system, each off by its rounding, between points too.
        np.testing.assert_allclose(
            dragged.displacement(at), anew(points, at, trend=trend, **settings), rtol=0, atol=2 * rounding_of(dragged)
        )


def test_a_point_dragged_next_to_another_one_is_still_interpolated() -> None:
    points = scattered(220, 2, seed=9)
    fit_rbf(points, support=40.0)
    target, source = np.array(points.target), np.array(points.source)
    target[4] = target[90] + [1e-3, 0.0]
    source[4] = source[90] + [1e-3, 1e-4]
    near = replace(points, target=target, source=source)
    np.testing.assert_allclose(fit_rbf(near, support=40.0).displacement(target), near.displacement, atol=1e-8)


def test_a_set_of_points_in_space_beside_polynomials_is_dragged_too() -> None:
    points, at = scattered(240, 3, seed=6), np.random.default_rng(1).uniform(0, 100, (100, 3))
    fit_rbf(points, kernel="cubic")
    target = np.array(points.target)
    target[[3, 200]] += 4.0
    points = replace(points, target=target)
    np.testing.assert_allclose(
        fit_rbf(points, kernel="cubic").displacement(at), anew(points, at, kernel="cubic"), atol=1e-8
    )


@pytest.mark.parametrize("kernel", ["thin_plate", "cubic", "multiquadric"])
def test_points_too_near_for_a_factor_are_interpolated_by_elimination(kernel: str) -> None:
    points = scattered(40, 2, seed=2)
    target, source = np.array(points.target), np.array(points.source)
    target[4] = target[9] + [4e-4, 0.0]
    source[4] = source[9] + [4e-4, 0.0]
    near = replace(points, target=target, source=source)
    fit = fit_rbf(near, kernel=kernel)
    np.testing.assert_allclose(fit.displacement(target), near.displacement, rtol=0, atol=rounding_of(fit))


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_matrix_of_a_kernel_is_that_of_its_formula(kernel: str, dim: int) -> None:
    rng = np.random.default_rng(dim)
    x, y = 1e3 + rng.uniform(0, 2, (90, dim)), 1e3 + rng.uniform(0, 2, (110, dim))
    y[0] = x[0]
    square = ((x[:, None] - y[None]) ** 2).sum(axis=-1)
    with np.errstate(all="ignore"):
        exact = KERNELS[kernel].profile(square)
    found = kernel_values(x, y, KERNELS[kernel])
    assert found.flags.writeable
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
