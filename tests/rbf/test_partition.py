"""Fits of more points than a dense system takes: a sparse one for compact kernels, local fits for the others."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from scipy.spatial import Delaunay

from deformnb.analysis.quality import fit_quality
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.errors import DeformError
from deformnb.rbf import evaluation, interpolant, partition
from deformnb.rbf.conditioning import prepare
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.partition import LocalFits, fit_locally
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import choose_support, usual_support
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Plane, Raster

SIZE = 100.0


def smooth(x: np.ndarray) -> np.ndarray:
    return 2 * np.stack([np.sin(x[:, 0] / 15 + k) * np.cos(x[:, -1] / 20) for k in range(x.shape[1])], axis=1)


@cache
def many(n: int, dim: int, own: bool = False) -> ControlPoints:
    rng = np.random.default_rng(0)
    x = rng.uniform(0, SIZE, (n, dim))
    return ControlPoints.from_arrays(x + smooth(x), x, radius=rng.uniform(10, 16, n) if own else None)


def elsewhere(dim: int, n: int = 200) -> np.ndarray:
    return np.random.default_rng(1).uniform(-10, SIZE + 10, (n, dim))


@pytest.mark.parametrize(
    ("dim", "own", "smoothing", "trend"),
    [
        (2, False, 0.0, "affine"),
        (2, True, 0.0, "quadratic"),
        *(
            pytest.param(dim, own, smoothing, trend, marks=pytest.mark.nightly)
            for trend in TRENDS
            for dim, own, smoothing in ((2, False, 0.0), (2, True, 0.0), (3, False, 0.2))
        ),
    ],
)
def test_the_sparse_system_is_the_dense_one(
    trend: str, dim: int, own: bool, smoothing: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = many(120, dim, own)
    settings: dict[str, Any] = {"support": 14.0, "trend": trend, "smoothing": smoothing}
    dense = fit_rbf(points, **settings)
    monkeypatch.setattr(interpolant, "DENSE", 10)
    sparse = fit_rbf(points, **settings)
    oracle.assert_close(sparse.displacement(elsewhere(dim)), dense.displacement(elsewhere(dim)), atol=1e-9)
    assert sparse.notes == dense.notes


@pytest.mark.parametrize(
    ("dim", "own", "trend"),
    [
        (2, False, "affine"),
        *(pytest.param(dim, own, "quadratic", marks=pytest.mark.nightly) for dim, own in ((2, True), (3, False))),
    ],
)
def test_lists_of_centres_leave_every_sum_as_it_is(
    dim: int, own: bool, trend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = fit_rbf(many(120, dim, own), support=14.0, trend=trend)
    x = elsewhere(dim)
    lines = np.linspace(-5, 105, 70)
    rows, columns = (np.zeros((dim, 70)) for _ in range(2))
    rows[1], columns[0] = lines, lines
    whole = [
        fit.displacement(x),
        fit.jacobian(x),
        fit.lattice_values(rows, columns, 1.0),
        fit.lattice_jacobians(rows, columns),
    ]
    monkeypatch.setattr(evaluation, "CULLED", 8)
    listed = [
        fit.displacement(x),
        fit.jacobian(x),
        fit.lattice_values(rows, columns, 1.0),
        fit.lattice_jacobians(rows, columns),
    ]
    for one, other, close in zip(whole, listed, (1e-11, 1e-11, 1e-3, 1e-3), strict=True):
        oracle.assert_close(other, one, atol=close)


@pytest.mark.nightly
def test_ten_thousand_points_with_a_compact_kernel_are_interpolated_and_drawn() -> None:
    points = many(10000, 2)
    fit = fit_rbf(points)
    assert isinstance(fit, LocalFits)
    oracle.assert_close(fit.displacement(points.target), points.displacement, atol=1e-9)
    raster = Raster((40, 50), (2.5, 2.0), (0.0, 0.0))
    shown = np.moveaxis(fit.sample_on_raster(raster), 0, -1)
    oracle.assert_close(shown, fit.displacement(raster.points()), atol=2e-3)  # a thousandth of a pixel
    plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    again = from_json(to_json(Deformation((Step((points,), plane),)))).steps[0]
    assert len(again.maps[0]) == 10000
    assert choose_support([points]) == usual_support(points, KERNELS["wendland_c2"]) >= fit.support


@pytest.mark.nightly
@pytest.mark.parametrize(("kernel", "dim"), [("thin_plate", 2), ("linear", 3)])
def test_local_fits_interpolate_and_are_near_the_fit_of_all(kernel: str, dim: int) -> None:
    points = many(700, dim)
    ready = prepare(points, KERNELS[kernel], 50.0, TRENDS["affine"], 0.0)
    local = fit_locally(ready, KERNELS[kernel], 0.0)
    assert len(local.fits) > 4
    oracle.assert_close(local.displacement(points.target), points.displacement, atol=1e-10)
    inside = np.random.default_rng(2).uniform(0, SIZE, (400, dim))
    whole = fit_rbf(points, kernel=kernel, support=50.0)
    off = np.abs(local.displacement(inside) - whole.displacement(inside)).max()
    assert off < 0.5 * np.abs(whole.displacement(inside) - smooth(inside)).max()  # of an estimate anyway
    assert "fitted locally to 700 control points" in local.notes[-1]
    x, h = inside[:40], 1e-4
    slopes = [(local.displacement(x + h * e) - local.displacement(x - h * e)) / (2 * h) for e in np.eye(dim)]
    oracle.assert_close(local.jacobian(x), np.stack(slopes, axis=-1), atol=1e-5)
    oracle.assert_close(np.asarray(local(jnp.asarray(x))), local.displacement(x), atol=1e-4)


@pytest.mark.parametrize(
    ("kernel", "seed"),
    [
        ("linear", 0),
        *(
            pytest.param(kernel, seed, marks=pytest.mark.nightly)
            for kernel in ("linear", "thin_plate")
            for seed in (1, 2, 3)
        ),
    ],
)
def test_local_fits_are_as_near_to_the_fit_of_all_as_their_note_says(kernel: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, SIZE, (450, 2))
    points = ControlPoints.from_arrays(x + (rng.normal(0, 1, x.shape) if seed else smooth(x)), x)
    ready = prepare(points, KERNELS[kernel], 50.0, TRENDS["affine"], 0.0)
    local = fit_locally(ready, KERNELS[kernel], 0.0)
    stated = float(re.search(r"deviate by up to (\S+) from the fit of all", local.notes[-1])[1])  # type: ignore[index]
    places = rng.uniform(0, SIZE, (2000, 2))
    places = places[Delaunay(x).find_simplex(places) >= 0]
    whole = fit_rbf(points, kernel=kernel, support=50.0)
    off = np.linalg.norm(local.displacement(places) - whole.displacement(places), axis=1).max()
    assert off <= stated
    assert stated < 20 * off  # and it is not trivial


@pytest.mark.nightly
def test_the_blend_has_no_jump_where_a_box_begins_or_ends() -> None:
    points = many(700, 2)
    local = fit_locally(prepare(points, KERNELS["linear"], 50.0, TRENDS["affine"], 0.0), KERNELS["linear"], 0.0)
    for k in range(len(local.fits)):
        corner = local.low[k] - local.margin[k]
        for axis in np.flatnonzero(np.isfinite(corner)):
            at = np.tile([37.3, 61.1], (2, 1))
            at[:, axis] = corner[axis] + np.array([-1e-7, 1e-7])
            assert np.abs(np.diff(local.displacement(at), axis=0)).max() < 1e-6


@pytest.mark.nightly
def test_kernels_without_an_end_are_fitted_locally_from_two_thousand_points_on(monkeypatch: pytest.MonkeyPatch) -> None:
    points = many(2001, 2)
    monkeypatch.setattr(partition, "_PROBES", 2)
    fit = fit_rbf(points, kernel="thin_plate")
    assert isinstance(fit, LocalFits)
    oracle.assert_close(fit.displacement(points.target[::50]), points.displacement[::50], atol=1e-9)
    assert fit.count == len(fit.ids) == 2001
    with pytest.raises(DeformError, match="2001 control points are more than the 2000 whose whole system"):
        fit_quality(points)


def test_a_support_that_reaches_too_many_of_many_points_is_refused_before_the_memory_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("deformnb.rbf.factors._LARGEST_FACTOR", 10**4)
    with pytest.raises(DeformError, match="neighbours of each of these 1200 control points"):
        fit_rbf(many(1200, 2), support=60.0)
