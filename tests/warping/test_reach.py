"""Bounds of displacements over boxes: nothing that a block can show is outside, between the nodes included."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from deformnb import ControlPoints, Cut, Deformation, HalfSpace, Line, RigidPart, fit_rbf
from deformnb._jax import float64
from deformnb.rbf import compose
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity
from deformnb.rbf.kernels import BUILT_IN, KERNELS
from deformnb.volume.volume import Grid
from deformnb.warping.reach import DisplacementBounds, source_part

GRID = Grid((24, 26, 28), (1.0, 1.5, 0.8), (3.0, -2.0, 5.0))


def random_points(seed: int, dim: int, count: int = 7) -> ControlPoints:
    rng = np.random.default_rng(seed)
    source = rng.uniform(0, 25, (count, dim))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 2, (count, dim)))


CUT = Cut(Line([(11.3, -30.0), (11.3, 60.0)]))
ON_PICTURE: dict[str, dict[str, Any]] = {
    "replicated": {},
    "modulated": {"extrusion": "modulate", "curve": "sin(pi*z)"},
    "cut": {"cuts": (CUT,)},
    "slit": {"cuts": (Cut(Line([(11.3, 4.0), (11.3, 20.0)], stops=(True, True))),)},
    "rigid": {"parts": (RigidPart(HalfSpace((-8.0, 0.0), (1.0, 0.2))),)},
    "staged": {"stages": 3},
}
QUICK = ["cut", "wendland_c2", "thin_plate", "affine", "samples", "b-spline"]
OTHERS = [*set(ON_PICTURE) - {"cut"}, *set(KERNELS) - {"wendland_c2", "thin_plate"}, "composed"]
NAMES = [*QUICK, *(pytest.param(name, marks=pytest.mark.nightly) for name in sorted(OTHERS))]


@cache
def field_named(name: str) -> AbstractField:
    if name in ON_PICTURE:
        return Deformation.from_picture_points(GRID, "+y", random_points(1, 2), **ON_PICTURE[name]).field(GRID)
    if name in KERNELS:
        quadratic = KERNELS[name].order == 3
        return fit_rbf(
            random_points(2, 3, 14 if quadratic else 7),
            kernel=name,
            support=20.0,
            trend="quadratic" if quadratic else "affine",
        )
    if name == "composed":
        return compose(field_named("replicated"), field_named("wendland_c2"))
    if name == "samples":
        return DisplacementField.sample(field_named("wendland_c2"), GRID.resampled(shape=(5, 6, 7)))
    if name == "b-spline":
        return BSplineField(
            np.random.default_rng(3).normal(0, 2, (7, 6, 8, 3)),
            (-4.0, -12.0, -6.0),
            ((4.0, 1.0, 0.0), (-1.0, 9.0, 0.0), (0.0, 0.0, 6.0)),
        )
    if name == "ripple":
        return Ripple()
    return Affine(np.array([[0.7, 0.3, 0], [-0.2, 1.1, 0.1], [0, 0.4, 0.9]]), np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("kernel", [KERNELS[name] for name in sorted(BUILT_IN)], ids=lambda kernel: kernel.name)
def test_no_slope_and_no_second_derivative_is_above_its_bound(kernel) -> None:
    rng = np.random.default_rng(0)
    near = rng.uniform(0.001, 1.4, 200)
    far = near + rng.exponential(0.3, 200)
    r = np.linspace(near, far, 65)
    with float64():
        first = 2 * r * np.asarray(kernel.slope(jnp.asarray(r**2)))
    second = np.diff(first, axis=0) / np.diff(r, axis=0)  # means of the second derivative
    slope, bend = kernel.curvature(near, far)
    assert (np.abs(first).max(axis=0) <= slope * (1 + 1e-9) + 1e-12).all()
    assert (np.abs(second).max(axis=0) <= bend * (1 + 1e-6) + 1e-9).all()
    assert (np.abs(first / r).max(axis=0) <= bend * (1 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [0, 1])
def test_every_displacement_in_a_box_is_within_the_bounds(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    field, corners = field_named(name), GRID.corners()
    low = rng.uniform(corners.min(axis=0), corners.max(axis=0) - 6)
    high = low + rng.uniform(0, 6, 3)
    bounds = DisplacementBounds(field, 1.0).bounds_in(low, high)
    d = field.displacement(rng.uniform(low, high, (4000, 3)))
    assert (d >= bounds[0] - 1e-9).all()
    assert (d <= bounds[1] + 1e-9).all()


def test_a_bump_between_the_nodes_is_reached() -> None:
    # A bump of radius 1 in the middle of a block of 20: at the nodes of any coarse lattice the field is zero.
    bump = fit_rbf(ControlPoints.from_arrays([[4.0, 10.7, 10.7]], [[10.6, 10.7, 10.7]]), support=1.0, trend="none")
    corners = np.array(list(itertools.product((0.0, 10.0, 20.0), repeat=3)))
    assert not bump.displacement(corners).any()
    low, _ = DisplacementBounds(bump, 1.0).bounds_in(np.zeros(3), np.full(3, 20.0))
    assert low[0] <= -6.6
    source = Grid((40, 40, 40), origin=(-20.0, 0.0, 0.0))
    part = source_part(DisplacementBounds(bump, 1.0), bump, Grid((21, 4, 4), origin=(9.0, 9.0, 0.0)), source, "linear")
    assert part is not None
    assert part[2].start <= 20 + 3


def test_the_quadratic_trend_counts_between_the_nodes() -> None:
    """A parabola that is 0 at both ends of the box, and 25 in its middle."""
    x = np.array([[a, b, c] for a in (0.0, 5.0, 10.0) for b in (0.0, 5.0, 9.0) for c in (0.0, 4.0, 9.0)])
    bow = np.zeros_like(x)
    bow[:, 0] = x[:, 0] * (10 - x[:, 0])
    fit = fit_rbf(ControlPoints.from_arrays(x + bow, x), trend="quadratic", support=5.0)
    _, high = DisplacementBounds(fit, 1e3).bounds_in(np.array([0.0, 2.0, 2.0]), np.array([10.0, 7.0, 7.0]))
    assert high[0] >= 25


def test_beside_a_cut_the_map_of_each_side_counts() -> None:
    points = ControlPoints.from_arrays([[4, 12], [20, 12]], [[-3, 12], [29, 12]])
    cut = Cut(Line([(11.3, -30.0), (11.3, 60.0)]))
    field = Deformation.from_picture_points(Grid((24, 26, 28)), "+z", points, cuts=(cut,), trend="translation").field(
        Grid((24, 26, 28))
    )
    low, high = DisplacementBounds(field, 1.0).bounds_in(np.array([5.0, 5, 5]), np.array([7.0, 7, 7]))
    assert low[0] <= -9  # tissue of the other side, which may be brought here
    assert high[0] >= 7


@dataclass(frozen=True)
class Ripple(AbstractField):
    """A field that has no bounds but its values."""

    dim = 3  # type: ignore[assignment]

    def jax_displacement(self, points):
        return jnp.sin(50 * jnp.asarray(points)) * 5

    def displacement(self, points):
        return np.sin(50 * np.asarray(points, dtype=float)) * 5


@pytest.mark.parametrize("name", ["wendland_c2", "cut", "ripple", "affine"])
@pytest.mark.parametrize("start", [(0, 0, 0), (16, 18, 20)], ids=str)
def test_a_block_needs_no_voxel_outside_its_part(name: str, start: tuple[int, int, int]) -> None:
    field = field_named(name)
    source = GRID.resampled(spacing=0.9)
    block = GRID.crop(start, (8, 8, 8))
    k, j, i = (a.ravel() for a in np.indices(block.shape))
    places = block.index_to_point(np.stack([i, j, k], axis=-1))
    at = source.point_to_index(places + field.displacement(places))[:, ::-1]
    inside = ((at > -0.5) & (at < np.array(source.shape) - 0.5)).all(axis=1)
    part = source_part(DisplacementBounds(field, 1.0), field, block, source, "linear")
    if part is None:
        assert not inside.any()
        return
    clipped = np.clip(at[inside], 0, np.array(source.shape) - 1.0)
    assert (np.floor(clipped) >= [s.start for s in part]).all()
    assert (np.ceil(clipped) < [s.stop for s in part]).all()


def test_a_block_that_does_not_move_reads_itself_alone() -> None:
    part = source_part(
        DisplacementBounds(Identity(3), 1.0), Identity(3), GRID.crop((8, 8, 8), (4, 4, 4)), GRID, "linear"
    )
    assert part == (slice(8, 12),) * 3
    half = GRID.crop((8, 8, 8), (4, 4, 4)).resampled(spacing=GRID.spacing, margin=0)
    moved = Affine(np.eye(3), np.array([0.4, 0.0, 0.0]))
    part = source_part(DisplacementBounds(moved, 1.0), moved, half, GRID, "linear")
    assert part == (slice(8, 12), slice(8, 12), slice(7, 14))
    far = Affine(np.eye(3), np.array([500.0, 0, 0]))
    assert source_part(DisplacementBounds(far, 1.0), far, GRID, GRID, "linear") is None
