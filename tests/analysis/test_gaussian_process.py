"""Uncertainty of the map against dense kriging, where it is zero and where it grows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from deformnb.analysis.gaussian_process import fit_system, process_scale, uncertainty
from deformnb.errors import DeformError
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import TRENDS

PAIRS = [(k.name, t.name) for k in KERNELS.values() for t in TRENDS.values() if t.order >= k.order]
SUPPORT = 80.0


def some_points(dim: int, seed: int = 0, n: int = 8) -> ControlPoints:
    rng = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(*[np.arange(3)] * dim), axis=-1).reshape(-1, dim)
    source = 30.0 * rng.permutation(cells)[:n] + rng.uniform(-8, 8, (n, dim))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 3, (n, dim)), weight=rng.uniform(0.5, 2, n))


def tangent(trend: str, linear: np.ndarray) -> list[Any]:
    """Vector functions by which the trend can change: shifts first, then what can happen to the linear part."""
    dim = len(linear)
    shifts = [lambda x, m=m: np.tile(np.eye(dim)[m], (len(x), 1)) for m in range(dim)]
    entries = np.eye(dim * dim).reshape(-1, dim, dim)
    turns = [(e - e.T) @ linear for e in entries.reshape(dim, dim, dim, dim)[np.triu_indices(dim, 1)]]
    more = {
        "none": None,
        "translation": [],
        "affine": list(entries),
        "affine_exact": list(entries),
        "rigid": turns,
        "similarity": [*turns, linear],
        "quadratic": list(entries),
    }
    chosen = more[trend]
    bent = [
        lambda x, m=m, a=a, b=b: (x[:, a] * x[:, b])[:, None] * np.eye(dim)[m] / SUPPORT
        for m in range(dim)
        for a in range(dim)
        for b in range(a + 1)
        if trend == "quadratic"
    ]
    return [] if chosen is None else [*shifts, *(lambda x, m=m: x @ m.T for m in chosen), *bent]


def dense(points: ControlPoints, places: np.ndarray, kernel: str, trend: str, smoothing: float) -> tuple[Any, Any]:
    """Variance in units of sigma^2, and sigma: universal kriging of all components at once, nothing eliminated."""
    dim, n, k = points.dim, len(points), KERNELS[kernel](SUPPORT)
    x = points.target
    fit = fit_rbf(points, kernel=kernel, trend=trend, support=SUPPORT, smoothing=smoothing)
    functions = tangent(trend, np.eye(dim) + np.asarray(fit.polynomial.linear) / SUPPORT)
    distance = np.linalg.norm(x[:, None] - x[None], axis=-1)
    big = np.kron(k(distance) + np.diag(smoothing / points.weight), np.eye(dim))
    b = np.stack([f(x).ravel() for f in functions], axis=1) if functions else np.zeros((n * dim, 0))
    bordered = np.block([[big, b], [b.T, np.zeros((b.shape[1],) * 2)]])
    out = []
    for place in places:
        to = np.kron(k(np.linalg.norm(place - x, axis=-1))[:, None], np.eye(dim))
        at = np.stack([f(place[None])[0] for f in functions]) if functions else np.zeros((0, dim))
        right = np.concatenate([to, at])
        out.append(np.trace(k(0.0) * np.eye(dim) - right.T @ np.linalg.solve(bordered, right)) / dim)
    alpha = np.asarray(fit.coefficients)[:n] / SUPPORT
    rest = points.displacement - (x - fit.origin) @ np.asarray(fit.polynomial.linear).T / SUPPORT
    sigma = np.sqrt((SUPPORT * alpha * rest).sum() / (n * dim - len(functions)))
    return np.array(out), sigma


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_the_deviation_is_that_of_dense_kriging(kernel: str, trend: str, dim: int) -> None:
    points = some_points(dim, n=14 if dim == 3 and trend == "quadratic" else 8)
    rng = np.random.default_rng(1)
    places = rng.uniform(-40, 120, (12, dim))
    for smoothing in (0.0, 0.2):
        known = uncertainty(points, kernel=kernel, trend=trend, support=SUPPORT, smoothing=smoothing)
        variance, sigma = dense(points, places, kernel, trend, smoothing)
        assert known.sigma == pytest.approx(sigma, rel=1e-6)
        assert_allclose(known.at(places), sigma * np.sqrt(variance), rtol=1e-6)


@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_it_is_zero_at_the_points_and_grows_away_from_them(kernel: str, trend: str) -> None:
    points = some_points(2)
    known = uncertainty(points, kernel=kernel, trend=trend)
    assert known.at(points.target).max() < 1e-5 * known.at([[300.0, 300.0]])[0]
    away = known.at(points.target.mean(axis=0) + np.array([[60.0, 0], [90, 0], [150, 0]]))
    assert away[0] < away[1] <= away[2] * (1 + 1e-9)
    smoothed = uncertainty(points, kernel=kernel, trend=trend, smoothing=0.5, sigma=1.0)
    assert (smoothed.at(points.target) > 0.01).all()


def test_a_lattice_is_the_points_of_it() -> None:
    known = uncertainty(some_points(2))
    rows, columns = np.array([[0, 0, 0], [5, 20, 50.0]]), np.array([[0, 30.0], [0, 0]])
    expected = known.at(np.moveaxis(rows[:, :, None] + columns[:, None, :], 0, -1))
    assert_allclose(known.lattice_values(rows, columns), expected, rtol=1e-6)
    assert known.at(np.zeros((0, 2))).shape == (0,)
    with pytest.raises(DeformError, match="shape"):
        known.at([[1.0, 2.0, 3.0]])


def test_what_says_nothing() -> None:
    few = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10]], [[0, 0], [12, 0], [0, 11]])
    with pytest.raises(DeformError, match="have at least 4"):
        uncertainty(few)
    for sigma in (-1.0, np.nan, np.inf):
        with pytest.raises(DeformError, match="sigma must be 0 or a positive length"):
            uncertainty(few, sigma=sigma)
    assert uncertainty(few, sigma=2.0).at([[5.0, 5.0]])[0] > 0
    still = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10], [10, 10]])
    assert uncertainty(still).at([[5.0, 5.0]])[0] == 0.0
    with pytest.raises(DeformError, match="no active control point"):
        uncertainty(ControlPoints.empty(2))


def test_points_on_one_line_leave_the_deviation_across_to_the_kernel() -> None:
    line = ControlPoints.from_arrays([[0, 0], [10, 0], [20, 1], [30, 0], [40, 2.0]], [[10.0 * k, 0] for k in range(5)])
    for trend in ("affine", "similarity", "rigid"):
        known = uncertainty(line, trend=trend, support=40.0)
        assert known.at([[20.0, 0.0]])[0] < 1e-6 < known.at([[20.0, 5.0]])[0] < known.at([[20.0, 25.0]])[0]


def test_single_radii_are_left_aside() -> None:
    points = some_points(2)
    own = ControlPoints.from_arrays(points.source, points.target, weight=points.weight, radius=[40.0, *[np.nan] * 7])
    known, same = uncertainty(own, support=SUPPORT), uncertainty(points, support=SUPPORT)
    assert_allclose(known.at([[5.0, 9.0]]), same.at([[5.0, 9.0]]))
    assert np.isnan(process_scale(fit_system(own, support=SUPPORT)))


@pytest.mark.nightly
def test_the_scale_is_the_one_that_makes_the_data_likeliest() -> None:
    # Draws from the process itself: the estimate scatters about the truth by 1 / sqrt(2 x 2 x 47),
    # the mean of eight by 0.026.
    rng = np.random.default_rng(3)
    x = np.stack(np.meshgrid(*[np.arange(7) * 20.0] * 2), axis=-1).reshape(-1, 2)
    phi = KERNELS["wendland_c2"](SUPPORT)(np.linalg.norm(x[:, None] - x[None], axis=-1))
    found = [
        process_scale(fit_system(ControlPoints.from_arrays(x + d, x), support=SUPPORT, trend="translation"))
        for d in 1.7 * np.linalg.cholesky(phi) @ rng.normal(size=(8, 49, 2))
    ]
    assert np.mean(found) == pytest.approx(1.7, rel=0.08)
