"""Control points of which two nearly coincide: solved as well as digits allow, with a note or an error that names them.

The loss is the size of the coefficients times the rounding: two points at distance r of n that are h apart, and
whose displacements differ by any amount, take coefficients of (h / r)^2 and more of a smooth kernel. SciPy's solver,
which refuses nothing, shows what others reach.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pytest
from scipy.interpolate import RBFInterpolator

from deformnb.errors import DeformError
from deformnb.rbf.exactness import EXACT, EXACT_PLACE, MOST_MISSED
from deformnb.rbf.fitting import fit_one_system, fit_rbf
from deformnb.rbf.kernels import BUILT_IN, KERNELS
from deformnb.rbf.partition import LocalFits
from deformnb.rbf.points import ControlPoints

BOX = 100.0
PEERS = {"thin_plate": "thin_plate_spline", "cubic": "cubic", "quintic": "quintic", "linear": "linear"}
SHARES = [1e-12, 1e-9, 1e-6, 1e-4, 1e-3]  # of the gap between points


def near_pair(count: int, dim: int, share: float, kind: str, seed: int = 3) -> ControlPoints:
    """Random points in a box, the second a share of their gap next to the first; dragged by a smooth field or noise."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, BOX, (count, dim))
    way = rng.normal(size=dim)
    x[1] = x[0] + share * BOX / count ** (1 / dim) * way / np.linalg.norm(way)
    smooth = 3 * np.sin(x / (BOX / 5))[:, ::-1]
    return ControlPoints.from_arrays(x + (smooth if kind == "smooth" else rng.normal(0, 1.0, x.shape)), x)


def settings(kernel: str) -> dict[str, Any]:
    return {"kernel": kernel, "trend": "quadratic" if KERNELS[kernel].order > 2 else "affine"}


def misses(points: ControlPoints, kernel: str) -> tuple[Any, float, float]:
    """The fit, its largest miss and that of SciPy (infinite for kernels that it has not)."""
    fit, d = fit_rbf(points, **settings(kernel)), points.displacement
    theirs = np.inf
    if kernel in PEERS:
        peer = RBFInterpolator(points.target, d, kernel=PEERS[kernel], degree=2 if kernel == "quintic" else 1)
        theirs = float(np.linalg.norm(peer(points.target) - d, axis=1).max())
    return fit, float(np.linalg.norm(fit(points.target) - d, axis=1).max()), theirs


def promised(points: ControlPoints) -> float:
    largest, extent = (
        np.linalg.norm(a, axis=1).max() for a in (points.displacement, points.target - points.target.mean(axis=0))
    )
    return float(EXACT * largest + EXACT_PLACE * extent)


def notes_of(fit: Any) -> str:
    return "; ".join(fit.remarks if isinstance(fit, LocalFits) else fit.of_points.texts)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_points_of_a_smooth_field_are_met_however_near(kernel: str, dim: int, share: float) -> None:
    points = near_pair(100, dim, share, "smooth")
    fit, miss, theirs = misses(points, kernel)
    apart = float(np.linalg.norm(points.displacement[0] - points.displacement[1]))
    assert miss <= fit.bound()
    assert miss <= max(theirs, promised(points) + apart * ("count as one" in notes_of(fit)))
    if fit.bound() > 1.001 * promised(points) + 2 * apart:
        assert "misses its targets by up to" in notes_of(fit)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_points_that_contradict_each_other_are_met_or_named(kernel: str, dim: int, share: float) -> None:
    points = near_pair(100, dim, share, "noise")
    try:
        fit, miss, theirs = misses(points, kernel)
    except DeformError as error:
        refusal = str(error)
    else:
        refusal = ""
    if refusal:
        assert share < 1e-3  # SciPy's own residual of the smooth kernels is a share of all displacements there
        assert "point 1 and point 2" in refusal
        return
    largest = np.linalg.norm(points.displacement, axis=1).max()
    assert miss <= fit.bound() <= promised(points) + 10 * MOST_MISSED * largest
    assert miss <= max(theirs, promised(points))
    if miss > promised(points):
        assert "misses its targets by up to" in notes_of(fit)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["smooth", "noise"])
@pytest.mark.parametrize("share", [1e-3, 1e-6])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_so_are_two_of_two_thousand(kernel: str, dim: int, share: float, kind: str) -> None:
    points = near_pair(2000, dim, share, kind)
    if kind == "noise" and share < 1e-3:
        with pytest.raises(DeformError, match="point 1 and point 2"):
            fit_rbf(points, **settings(kernel))
        return
    fit, miss, theirs = misses(points, kernel)
    assert miss <= fit.bound()
    assert miss <= max(theirs, 1.1 * promised(points))


@pytest.mark.parametrize("share", [1e-2, 1e-3])
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_between_them_it_is_the_system_in_fifty_digits(kernel: str, share: float) -> None:
    """The residual at the points is enlarged elsewhere by up to a few gaps over the distance of the two."""
    points = near_pair(14, 2, share, "noise")
    fit = fit_rbf(points, support=BOX / 2, **settings(kernel))
    at = np.array([[20.0, 30.0], [55.0, 80.0], [91.0, 12.0]])
    wanted = oracle.fifty_digits(points.target, points.displacement, kernel, BOX / 2, settings(kernel)["trend"], at)
    np.testing.assert_allclose(fit(at), wanted, rtol=0, atol=fit.bound() * 4 / share)


@pytest.mark.nightly
def test_a_singular_system_is_fitted_locally_with_a_note() -> None:
    points = near_pair(300, 2, 1e-3, "noise")
    fit, miss, theirs = misses(points, "quintic")
    assert isinstance(fit, LocalFits)
    assert miss < theirs / 100
    assert "the quintic kernel is fitted locally to 300 control points" in notes_of(fit)
    with pytest.raises(DeformError, match="the system of all 300 control points is singular"):
        fit_one_system(points, **settings("quintic"))


@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_one_place_with_two_displacements_is_refused_by_name(kernel: str) -> None:
    points = near_pair(40, 2, 0.0, "noise")
    with pytest.raises(DeformError, match="point 1 and point 2 are at the same place"):
        fit_rbf(points, **settings(kernel))


def test_points_at_nearly_one_place_that_move_alike_count_as_one_and_say_how_far_they_are() -> None:
    points = near_pair(40, 2, 1e-6, "smooth")
    fit = fit_rbf(points, kernel="cubic")
    apart = np.linalg.norm(points.displacement[0] - points.displacement[1])
    assert apart > 0
    assert fit.of_points.texts == ("point 1, point 2 are at one place and count as one",)
    assert promised(points) < fit.bound() <= promised(points) + 1.01 * apart
