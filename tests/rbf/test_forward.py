"""Fits forward: the targets as a function of the sources, and a certified inverse as backward map."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.optimize import root

from deformnb.errors import DeformError
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_forward, fit_points
from deformnb.rbf.forward import DIRECTIONS, ForwardFit, orient_points
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.partition import LocalFits
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.stages import Staged
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid
from deformnb.warping.points import warp_points

Array = NDArray[np.float64]


def bent(dim: int = 2, noise: float = 0.5) -> ControlPoints:
    """A grid of points that is bent."""
    rng = np.random.default_rng(dim)
    lines = [np.linspace(0, 20.0 * n, n) for n in (6, 5, 3)[:dim]]
    source = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, dim)
    return ControlPoints.from_arrays(
        source, source + 5 * np.sin(np.roll(source, 1, axis=1) / 30) + rng.normal(0, noise, source.shape)
    )


def folded() -> tuple[ControlPoints, Array, NDArray[np.bool_]]:
    """Points of the map x + x^2 / 50 along the first axis, places of the result, and which have a source where
    it rises: it is -12.5 at least.
    """
    source = np.stack(np.meshgrid([0.0, 10, 20, 30], [0.0, 10, 20], indexing="ij"), axis=-1).reshape(-1, 2)
    target = source + np.column_stack([source[:, 0] ** 2 / 50, np.zeros(12)])
    places = np.column_stack([np.linspace(-41, 100, 57), np.linspace(-5, 25, 57)])
    return ControlPoints.from_arrays(source, target), places, places[:, 0] > -12.5


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", list(KERNELS))
def test_control_points_and_all_that_they_bring_along_are_met(kernel: str, dim: int) -> None:
    points = bent(dim)
    fit = fit_forward(points, kernel=kernel, trend="quadratic" if KERNELS[kernel].order > 2 else "affine", support=60.0)
    size = np.ptp(points.source, axis=0).max()
    missed = np.linalg.norm(fit.displacement(points.target) - points.displacement, axis=1).max()
    assert missed < 1e-9 * size
    assert missed <= fit.bound() < 1e-3
    rng = np.random.default_rng(0)
    x = rng.uniform(0.1, 0.9, (50, dim)) * np.ptp(points.source, axis=0)
    y, found = warp_points(x, fit)
    assert np.abs(y - (x + fit.forward.displacement(x))).max() == 0
    assert np.abs(y + fit.displacement(y) - x)[found].max() < 1e-8 * size
    assert found.mean() > 0.9  # some kernels fold here and there


def test_the_map_is_the_inverse_of_the_thin_plate_of_scipy() -> None:
    points = bent()
    plate = RBFInterpolator(points.source, points.target, kernel="thin_plate_spline", degree=1)
    fit = fit_forward(points, kernel="thin_plate")
    rng = np.random.default_rng(1)
    for y in rng.uniform([10, 10], [110, 90], (12, 2)):
        x = root(lambda x, y=y: plate(x[None])[0] - y, y, tol=1e-12).x
        assert np.abs(y + fit.displacement(y) - x).max() < 1e-7


@pytest.mark.parametrize("dim", [2, 3])
def test_derivatives_are_those_of_the_inverse(dim: int) -> None:
    fit = fit_forward(bent(dim), kernel="thin_plate" if dim == 2 else "cubic")
    y = np.random.default_rng(2).uniform(5, 80, (40, dim)) * ([1, 1, 0.5][:dim])
    step = 1e-5 * np.eye(dim)
    along = [(fit.displacement(y + e) - fit.displacement(y - e)) / 2e-5 for e in step]
    assert np.abs(fit.jacobian(y) - np.stack(along, axis=-1)).max() < 1e-6
    with jax.enable_x64(True):
        at = jnp.asarray(y)
        assert np.abs(fit(at) - fit.displacement(y)).max() < 1e-9
        traced = np.asarray(jax.jit(lambda f, p: jax.vmap(jax.jacfwd(f))(p))(fit, at))
        back = np.asarray(jax.grad(lambda p: jnp.sum(fit(p)[:, 0]))(at))
    assert np.abs(traced - fit.jacobian(y)).max() < 1e-8
    assert np.abs(back - fit.jacobian(y)[:, 0]).max() < 1e-8


def test_places_without_a_source_are_said_to_have_none() -> None:
    points, places, expected = folded()
    fit = fit_forward(points, kernel="cubic", trend="quadratic")
    assert 0 < expected.mean() < 1
    assert (fit.found(places) == expected).all()
    dets = np.linalg.det(np.eye(2) + fit.jacobian(places))
    assert ((dets == 0) == ~expected).all()
    d = fit.displacement(places)
    assert np.isfinite(d).all()
    y = places[expected]
    assert np.abs(y + d[expected] - np.column_stack([25 * (np.sqrt(1 + 0.08 * y[:, 0]) - 1), y[:, 1]])).max() < 1e-9
    x = np.column_stack([np.linspace(-60, 60, 61), np.full(61, 7.0)])
    moved, found = warp_points(x, fit)
    assert (found == (x[:, 0] > -25)).all()  # where the map falls another place is shown
    assert np.abs(moved[found, 0] - x[found, 0] - x[found, 0] ** 2 / 50).max() < 1e-9


def test_a_map_that_mirrors_has_an_inverse() -> None:
    points = bent()
    mirrored = ControlPoints.from_arrays(points.source, points.target * [-1, 1])
    fit = fit_forward(mirrored, kernel="thin_plate")
    assert fit.found(mirrored.target).all()
    assert np.abs(fit.displacement(mirrored.target) - mirrored.displacement).max() < 1e-9


@pytest.mark.parametrize("dim", [2, 3])
def test_lattices_have_the_values_of_their_places(dim: int) -> None:
    fit = fit_forward(bent(dim), kernel="cubic")
    lattice: Any = Raster((21, 37), (3.0, 2.5), (-8.0, -5.0)) if dim == 2 else Grid((4, 5, 37), (3.0, 20.0, 12.0))
    if dim == 2:
        found, places = np.moveaxis(fit.sample_on_raster(lattice), 0, -1), lattice.points()
    else:
        found = fit.sample_on_grid(lattice)
        places = lattice.index_to_point(np.stack(np.indices(lattice.shape)[::-1], axis=-1))
    assert np.abs(found - fit.displacement(places)).max() < 1e-4 * min(lattice.spacing)


def test_every_sort_of_fit_has_a_direction() -> None:
    points = bent()
    one = fit_points(points, direction="forward", kernel="thin_plate")
    assert isinstance(one, ForwardFit)
    staged = fit_points(points, direction="forward", stages=3)
    assert isinstance(staged, Staged)
    assert all(isinstance(f, ForwardFit) for f in staged.fits)
    assert np.abs(staged.displacement(points.target) - points.displacement).max() < 1e-9
    smooth = FitSettings(direction="forward", smoothing=0.5, kernel="thin_plate").fit(points)
    assert np.abs(smooth.displacement(points.target) - points.displacement).max() > 1e-3
    half = FitSettings(direction="forward", strength=0.5).fit(points)
    scaled = points.scaled(0.5)
    assert np.abs(half.displacement(scaled.target) - scaled.displacement).max() < 1e-9


def test_many_points_are_fitted_locally() -> None:
    rng = np.random.default_rng(5)
    source = rng.uniform(0, 400, (2100, 2))
    points = ControlPoints.from_arrays(source, source + 8 * np.sin(source[:, ::-1] / 60))
    fit = fit_forward(points, kernel="thin_plate")
    assert isinstance(fit.forward, LocalFits)
    y = rng.uniform(50, 350, (30, 2))
    x = y + fit.displacement(y)
    assert fit.found(y).all()
    assert np.abs(x + fit.forward.displacement(x) - y).max() < 1e-7


def test_what_does_not_go_together_is_refused() -> None:
    part = RigidPart(HalfSpace((0.0, 0.0), (1.0, 0.0)), name="bone")
    with pytest.raises(DeformError, match=r"bone.*with a fit forward"):
        fit_points(bent(), [part], direction="forward")
    with pytest.raises(DeformError, match="unknown direction 'sideways'"):
        FitSettings(direction="sideways")
    with pytest.raises(DeformError, match="same place"):
        fit_forward(ControlPoints.from_arrays([[0, 0], [0, 0], [9, 9]], [[1, 0], [0, 1], [9, 9]]))


def test_directions_exchange_sources_and_targets() -> None:
    points = bent()
    assert orient_points(points, DIRECTIONS[0]) is points
    assert np.array_equal(orient_points(points, "forward").displacement, -points.displacement)


@pytest.mark.parametrize("points", [ControlPoints.empty(), bent().reset()])
def test_what_moves_nothing_is_the_identity(points: ControlPoints) -> None:
    fit = fit_forward(points, support=20.0)
    y = np.array([[3.0, 4.0], [50.0, -9.0]])
    assert fit.is_identity
    assert fit.found(y).all()
    assert not fit.displacement(y).any()
    assert not fit.jacobian(y).any()
    assert fit.bound() >= 0
    moved, found = warp_points(y, fit)
    assert found.all()
    assert (moved == y).all()
