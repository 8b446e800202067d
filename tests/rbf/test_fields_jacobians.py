"""The derivative of every kind of field against differences of its values and against automatic differentiation."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rbf.test_cuts import CUTS, MIDDLE, SUPPORT, fitted, scattered
from rbf.test_fields import FIELDS, GRIDS, OBLIQUE, RASTER, field, grid_of, places
from rbf.test_rigid_parts import BOX, DISC, TURN, WALL, points, within
from warping.test_warper import Wave

from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.extrusion import Extrusion, extrude, interpolate, modulate, replicate
from deformnb.rbf.fields import AbstractField, Blended, Composed, DisplacementField, Identity
from deformnb.rbf.fitting import fit_rbf, fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import WEIGHTS, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid

H = 1e-5
ROUNDING = 1e-12


def differences(f: AbstractField, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Central differences: exact but for H^2 / 6 of the third derivative and 1e-16 / H of the values."""
    steps = [f.displacement(x + H * e) - f.displacement(x - H * e) for e in np.eye(f.dim)]
    return np.stack(steps, axis=-1) / (2 * H)


def assert_right(f: AbstractField, x: NDArray[np.float64], atol: float = 1e-6) -> None:
    """Against differences, against automatic differentiation, and on a lattice in float32."""
    found = f.jacobian(x)
    assert found.shape == (*x.shape, f.dim)
    assert found.dtype == np.float64
    oracle.assert_close(found, AbstractField.jacobian(f, x), atol=ROUNDING * max(1.0, np.abs(found).max()))
    oracle.assert_close(found, differences(f, x), atol=atol)
    flat = x.reshape(-1, f.dim)
    on_lattice = f.lattice_jacobians(flat[:4].T, np.zeros((f.dim, 1)))
    assert on_lattice.shape == (f.dim, f.dim, 4, 1)
    assert on_lattice.dtype == np.float32
    oracle.assert_close(on_lattice[..., 0], np.moveaxis(f.jacobian(flat[:4]), 0, -1), atol=2e-5)


def away_from(edges: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The places whose distance to an edge (n) is more than the differences' reach."""
    return x[np.abs(edges) > 10 * H]


# ---- every field -----------------------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("dim", "name"), FIELDS)
def test_every_field_differentiates_right(dim: int, name: str) -> None:
    assert_right(field(dim, name), places(dim))


@pytest.mark.parametrize("dim", [2, 3])
def test_an_outer_sum_is_that_of_its_points(dim: int) -> None:
    rng = np.random.default_rng(5)
    rows, columns = rng.uniform(0, 20, (dim, 5)), rng.uniform(0, 5, (dim, 3))
    at = np.moveaxis(rows[:, :, None] + columns[:, None, :], 0, -1)
    for d, name in FIELDS:
        if d == dim:
            got = field(dim, name).lattice_jacobians(rows, columns)
            oracle.assert_close(got, np.moveaxis(field(dim, name).jacobian(at), (-2, -1), (0, 1)), atol=2e-5)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kernel", ["wendland_c2", "wendland_c4", "gaussian"])
def test_at_the_control_points(kernel: str) -> None:
    given = points()
    assert_right(fit_rbf(given, kernel=kernel, support=SUPPORT), given.target)


def test_of_the_identity_and_of_no_points() -> None:
    assert (Identity(3).jacobian(np.ones((4, 5, 3))) == 0).all()
    for dim, name in FIELDS:
        assert field(dim, name).jacobian(np.zeros((0, dim))).shape == (0, dim, dim)
        assert field(dim, name).jacobian(np.zeros(dim)).shape == (dim, dim)


def test_a_sum_has_the_sum_of_derivatives() -> None:
    a, b = field(3, "extruded"), field(3, "rbf")
    oracle.assert_close(Blended((a, b)).jacobian(places(3)), a.jacobian(places(3)) + b.jacobian(places(3)), atol=1e-15)
    assert_right(Blended((a, b)), places(3))


def test_the_chain_rule_for_linear_maps_is_the_product() -> None:
    """(1 + J) of a composition is the product of those of its parts, the one done first on the left."""
    rng = np.random.default_rng(8)

    def linear(m: NDArray[np.float64]) -> AbstractField:
        target = np.array([[0.0, 0], [10, 0], [0, 10]])
        return fit_rbf(ControlPoints.from_arrays(target @ m.T, target))

    a, b = (np.eye(2) + rng.normal(0, 0.2, (2, 2)) for _ in range(2))
    got = Composed(linear(a), linear(b)).jacobian(np.array([[3.0, 4.0], [90.0, -5.0]]))
    oracle.assert_close(got, np.broadcast_to(a @ b - np.eye(2), (2, 2, 2)), atol=1e-12)


# ---- samples ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lattice", [RASTER, *GRIDS.values()], ids=["raster", *GRIDS])
def test_samples_of_a_linear_field_have_its_derivative(lattice: Any) -> None:
    dim = len(lattice.shape)
    m = np.random.default_rng(3).normal(size=(dim, dim))
    nodes = lattice.points() if dim == 2 else np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1)
    nodes = nodes if dim == 2 else lattice.index_to_point(nodes)
    stored = DisplacementField(nodes @ m.T, lattice)
    axes = np.asarray(lattice.spacing) * np.eye(2) if dim == 2 else lattice.matrix
    known = axes * (np.array(lattice.shape[::-1]) > 1)  # an axis of one sample has no slope
    wanted = m @ known @ np.linalg.inv(axes)
    found = stored.jacobian(nodes)  # at the nodes too
    # A node whose index is rounded beyond the last one is outside, where nothing changes.
    inside = nodes[(slice(0, -1),) * dim].reshape(-1, dim) if min(lattice.shape) > 1 else nodes.reshape(-1, dim)
    inside = 0.999 * inside + 0.001 * nodes.reshape(-1, dim).mean(axis=0)
    oracle.assert_close(stored.jacobian(inside), np.broadcast_to(wanted, (len(inside), dim, dim)), atol=1e-12)
    assert found.shape == (*lattice.shape, dim, dim)
    outside = nodes[(0,) * dim] + 9 * (nodes[(0,) * dim] - nodes[(-1,) * dim]) - 100 * axes.sum(axis=1)
    assert (stored.jacobian(outside) == 0).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.floats(0.01, 0.99), min_size=3, max_size=3), st.integers(0, 2))
def test_in_a_cell_differences_along_an_axis_are_exact(seed: int, place: list[float], axis: int) -> None:
    """Interpolation is linear along each axis of a cell, so no step is too large."""
    grid = grid_of(OBLIQUE)
    stored = DisplacementField(np.random.default_rng(seed).normal(size=(*grid.shape, 3)), grid)
    index = np.array(place) + np.random.default_rng(seed).integers(0, np.array(grid.shape[::-1]) - 1)
    ends = np.repeat(index[None], 2, axis=0)
    ends[:, axis] = np.array([1e-9, 1 - 1e-9]) + np.floor(index[axis])
    ends = grid.index_to_point(ends)
    step = np.diff(stored.displacement(ends), axis=0)[0]
    oracle.assert_close(stored.jacobian(grid.index_to_point(index)) @ (ends[1] - ends[0]), step, atol=1e-11)


def test_at_a_node_the_cell_of_growing_index_counts_and_at_the_last_node_the_last() -> None:
    bend = DisplacementField(
        np.array([[[0.0, 0], [1, 0], [5, 0]], [[0, 0], [1, 0], [5, 0]]]), Raster((2, 3), (1.0, 1.0), (0.0, 0.0))
    )
    found = bend.jacobian([[-0.5, 0], [0, 0], [0.5, 0], [1, 0], [1.5, 0], [2, 0], [2.5, 0]])[:, 0, 0]
    assert found.tolist() == [0, 1, 1, 4, 4, 4, 0]


# ---- extrusions ------------------------------------------------------------------------------------------------------

RULES = {
    "replicate": replicate(),
    "modulate": modulate("sin(pi * z)"),
    "samples": modulate([0.0, 1.0, 0.5]),
    "interpolate": interpolate([0.1, 0.5, 0.8]),
}


@pytest.mark.parametrize("view", ["oblique", "+x", "-y", "+z"])
@pytest.mark.parametrize("rule", RULES)
def test_extrusions_by_every_rule_and_view(rule: str, view: str) -> None:
    grid = grid_of(shape=(8, 9, 10))
    plane = Plane.from_normal(grid.center, (1, 2, -0.5)) if view == "oblique" else Plane.from_view(grid, view)
    maps = [fit_rbf(points(n=k), support=SUPPORT) for k in (6, 5, 4)][: len(RULES[rule][1])]
    f = extrude(plane, grid, maps, RULES[rule])
    x = np.random.default_rng(2).uniform(*grid.corners()[[0, -1]] * 1.2, (60, 3))
    z = f.zeta(plane.to_plane(x)[:, 2])
    knots = np.concatenate([[0.0, 1.0], f.knots])
    inside = (z > 0) & (z < 1)
    clear = (np.abs(z[:, None] - knots).min(axis=1) > 1e-5) | ~inside
    assert_right(f, x[clear])


def test_the_derivative_along_the_depth_is_that_of_the_weight() -> None:
    """D = z / 10 (1, 0) on 0 <= depth <= 10: dD_x/dz = 1/10 within, 0 beyond, the side of growing depth at the ends."""
    shift = fit_rbf(ControlPoints.from_arrays([[1, 0]], [[0, 0]]), trend="translation")
    f = Extrusion(Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), (0.0, 10.0), (shift,), *modulate("z"))
    found = f.jacobian([[3.0, 4.0, z] for z in (-1, 0, 5, 10, 11)])
    oracle.assert_close(found[:, 0, 2], [0, 0.1, 0.1, 0.1, 0], atol=1e-12)
    found[:, 0, 2] = 0
    oracle.assert_close(found, np.zeros((5, 3, 3)), atol=1e-12)
    flat = Extrusion(f.plane, (2.0, 2.0), (shift,), *modulate("z"))
    assert (flat.jacobian([[1.0, 2.0, 2.0]]) == 0).all()  # a volume of one slice


# ---- cuts and parts --------------------------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", CUTS)
def test_beside_cuts_that_of_the_region_seen(name: str, rule: str) -> None:
    f = fitted(scattered(2.0), CUTS[name], rule)
    x = np.random.default_rng(1).uniform(0, 100, (400, 2))
    jump = np.abs([f.displacement(x + s * H * e) - f.displacement(x) for e in np.eye(2) for s in (-1, 1)]).max((0, 2))
    assert_right(f, x[jump < 100 * H])  # no cut within the reach of differences
    assert np.mean(jump < 100 * H) > 0.98


def test_cuts_in_space() -> None:
    grid = Grid((5, 100, 100))
    plane = Plane.from_view(grid, "+z")
    flat = fitted(scattered(2.0), (MIDDLE,))
    f = Decoupled(
        tuple(extrude(plane, grid, [m], modulate("1 - z")) for m in flat.fields), flat.sides, flat.regions, plane
    )
    x = np.random.default_rng(1).uniform((5, 5, 0.1), (40, 95, 3.9), (100, 3))
    assert_right(f, x)


PARTS = {
    "fixed": [RigidPart(BOX)],
    "turned": [RigidPart(BOX, TURN)],
    "mask": [RigidPart(DISC)],
    "all": [RigidPart(BOX, TURN), RigidPart(WALL), RigidPart(DISC)],
    "reach": [RigidPart(WALL, reach=20.0)],
}


@pytest.mark.sampled(5)
@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("name", PARTS)
def test_beside_rigid_parts(name: str, weight: str) -> None:
    parts = [RigidPart(p.region, p.motion, weight, p.reach) for p in PARTS[name]]
    f = fit_rigid(points(), parts, support=100.0)
    x = np.random.default_rng(3).uniform(-80, 160, (500, 2))
    bends = np.abs(differences(f, x + 3 * H) - differences(f, x - 3 * H)).max((1, 2))
    smooth = bends < 1e-3  # distances have edges: half way between two sides, and the cells of a mask
    assert smooth.mean() > 0.95
    assert_right(f, x[smooth], atol=1e-5)


def test_within_a_part_the_derivative_is_that_of_its_motion() -> None:
    f = fit_rigid(points(), [RigidPart(BOX, TURN), RigidPart(WALL)], support=100.0)
    turned = TURN(within(BOX))
    wanted = np.asarray(TURN.inverse.matrix) - np.eye(2)
    oracle.assert_close(f.jacobian(turned), np.broadcast_to(wanted, (len(turned), 2, 2)), atol=1e-12)
    assert (f.jacobian([[-5.0, 4.0]]) == 0).all()


def test_in_space_beside_a_part() -> None:
    from deformnb.rbf.regions import HalfSpace

    assert_right(
        fit_rigid(points(3), [RigidPart(HalfSpace((0, 0, -30), (0.3, 0, 1)))], support=100.0),
        np.random.default_rng(3).uniform(-40, 120, (100, 3)),
    )


def test_a_field_without_a_derivative_of_its_own_has_that_of_jax() -> None:
    f = Wave(1.5, 0.3)
    oracle.assert_close(f.jacobian(places(3)), differences(f, places(3)), atol=1e-6)
