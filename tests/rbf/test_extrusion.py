"""The three rules of extrusion against their formulas, their identities, and grids in any position."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import CURVE_KNOTS, EXTRUSIONS, Extrusion, extrude, interpolate, modulate, replicate
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid

GRID = Grid((6, 5, 7), (3.0, 2.0, 5.0), (-4.0, 30.0, 7.0))
AXIAL = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
SINGLE = 2e-5  # float32 of displacements of about 20, and one digit for its sums


@cache
def flat(seed: int = 0) -> AbstractField:
    rng = np.random.default_rng(seed)
    source = rng.uniform(-5, 45, (6, 2))
    return fit_rbf(ControlPoints.from_arrays(source, source + rng.normal(0, 4, source.shape)), support=40.0)


def places(n: int = 60) -> np.ndarray:
    return np.random.default_rng(6).uniform([-10, -10, -15], [50, 50, 45], (n, 3))


def on(a: float, b: float, seed: int = 0) -> np.ndarray:
    return flat(seed).displacement([a, b])


# ---- the paper's formulas --------------------------------------------------------------------------------------------


def test_replication_is_the_paper_s() -> None:
    field = Extrusion(AXIAL, (3.0, 20.0), (flat(),), *replicate())
    wanted = [oracle.replication(x, on) for x in places()]
    oracle.assert_close(field.displacement(places()), wanted, atol=1e-12)
    assert field.is_replication


@pytest.mark.parametrize(
    ("curve", "f"),
    [
        ("z", lambda z: z),
        ("4*z*(1-z)", lambda z: 4 * z * (1 - z)),
        (lambda z: np.cos(3 * z), lambda z: np.cos(3 * z)),
        ([0.0, 2.0], lambda z: 2 * z),
        ([1.0, 0.0, 1.0], lambda z: abs(2 * z - 1)),
        ("1", lambda z: 1.0),
        (lambda z: 0.5, lambda z: 0.5),
    ],
)
def test_modulation_is_the_paper_s(curve: Any, f: Callable[[float], float]) -> None:
    field = Extrusion(AXIAL, (3.0, 20.0), (flat(),), *modulate(curve))
    wanted = [oracle.modulation(x, on, f, 3.0, 20.0) for x in places()]
    # between two knots a curve errs by f''/8 (1/1024)^2, here at most 9.5e-7 of a displacement below 30
    oracle.assert_close(field.displacement(places()), wanted, atol=3e-5)


@pytest.mark.parametrize("knots", [[0.0, 1.0], [0.2, 0.5, 0.9], [0.0, 0.3, 0.31, 1.0], [0.4]])
def test_interpolation_is_the_paper_s(knots: list[float]) -> None:
    field = Extrusion(AXIAL, (3.0, 20.0), tuple(flat(k) for k in range(len(knots))), *interpolate(knots))
    functions = [lambda a, b, k=k: on(a, b, k) for k in range(len(knots))]
    wanted = [oracle.interpolation(x, functions, knots, 3.0, 20.0) for x in places()]
    oracle.assert_close(field.displacement(places()), wanted, atol=1e-11)
    for k, knot in enumerate(knots):  # exact at the knots themselves
        at = np.c_[places()[:, :2], np.full(60, 3.0 + 17.0 * knot)]
        oracle.assert_close(field.displacement(at)[:, :2], flat(k).displacement(at[:, :2]), atol=1e-11)


@pytest.mark.parametrize("seed", range(3))
def test_the_frame_of_the_plane_carries_displacements_into_space(seed: int) -> None:
    """D3 = f(zeta) [u D_u(a, b) + v D_v(a, b)]: nothing moves along the normal."""
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    plane = Plane((3.0, -2.0, 8.0), tuple(turn[0]), tuple(turn[1]))
    field = Extrusion(plane, (-5.0, 9.0), (flat(),), *modulate("z"))
    for x in places(15):
        a, b, c = ((x - plane.origin) @ w for w in (plane.u, plane.v, plane.normal))
        d = oracle.relative_depth(c, -5.0, 9.0) * on(a, b)
        wanted = d[0] * np.array(plane.u) + d[1] * np.array(plane.v)
        oracle.assert_close(field.displacement(x), wanted, atol=1e-11)
        assert abs(field.displacement(x) @ plane.normal) < 1e-12


# ---- identities ------------------------------------------------------------------------------------------------------


def field_of(weights: Any, *maps: AbstractField, plane: Plane = AXIAL) -> Extrusion:
    return extrude(plane, GRID, maps, weights)


def test_a_curve_of_one_and_equal_maps_are_replication() -> None:
    wanted = field_of(replicate(), flat())
    for other in (
        field_of(modulate("1"), flat()),
        field_of(modulate([1.0, 1.0]), flat()),
        field_of(interpolate([0.0, 1.0]), flat(), flat()),
        field_of(interpolate([0.5]), flat()),
        field_of(interpolate([0.1, 0.4, 0.8]), flat(), flat(), flat()),
    ):
        oracle.assert_close(other.displacement(places()), wanted.displacement(places()), atol=1e-12)
        oracle.assert_close(other.sample_on_grid(GRID), wanted.sample_on_grid(GRID), atol=SINGLE)


def test_at_a_knot_the_slope_of_growing_depth_counts() -> None:
    field = Extrusion(AXIAL, (10.0, 20.0), (Identity(2),), np.array([0.0, 0.5, 1.0]), np.array([[0.0, 1.0, -1.0]]))
    depths = np.array([9.0, 10.0, 12.0, 15.0, 17.0, 20.0, 21.0])
    oracle.assert_close(field.slopes_at(depths), [[0.0, 0.2, 0.2, -0.4, -0.4, -0.4, 0.0]], atol=1e-15)


def test_from_nothing_to_a_map_is_the_modulation_by_z() -> None:
    a, b = field_of(interpolate([0.0, 1.0]), Identity(2), flat()), field_of(modulate("z"), flat())
    oracle.assert_close(a.displacement(places()), b.displacement(places()), atol=1e-12)
    c = field_of(modulate([0.0, 1.0]), flat())
    oracle.assert_close(c.displacement(places()), b.displacement(places()), atol=1e-12)


def test_zeta_runs_from_the_first_slice_to_the_last_and_stays_there() -> None:
    """Slice k of nz is at zeta = k / (nz - 1)."""
    for view in VIEWS:
        plane = Plane.from_view(GRID, view)
        field = extrude(plane, GRID, (Identity(2),), modulate("z"))
        axis = {"x": 0, "y": 1, "z": 2}[view[1]]
        n = GRID.shape[2 - axis]
        index = np.zeros((n, 3))
        index[:, axis] = np.arange(n)[:: 1 if view[0] == "+" else -1]
        c = plane.to_plane(GRID.index_to_point(index))[:, 2]
        oracle.assert_close(field.weights_at(c)[0], np.arange(n) / (n - 1), atol=1e-12)
        oracle.assert_close(field.weights_at(np.array([c[0] - 9, c[-1] + 9]))[0], [0, 1], atol=1e-12)


@pytest.mark.parametrize("view", VIEWS)
def test_one_slice_takes_the_value_at_zero(view: str) -> None:
    grid = Grid(tuple(1 if "zyx"[k] == view[1] else 4 for k in range(3)))
    field = extrude(Plane.from_view(grid, view), grid, (flat(), flat(1)), interpolate([0.0, 1.0]))
    assert np.isfinite(field.sample_on_grid(grid)).all()
    first = extrude(Plane.from_view(grid, view), grid, (flat(),), replicate())
    oracle.assert_close(field.sample_on_grid(grid), first.sample_on_grid(grid), atol=SINGLE)
    with float64():
        x = jnp.asarray(grid.corners())
        oracle.assert_close(field(x), first.displacement(grid.corners()), atol=1e-11)


def test_replication_at_the_depth_of_the_plane_is_the_map_itself() -> None:
    plane = Plane.from_normal((3.0, 4.0, 5.0), (1.0, 2.0, 2.0))
    field = Extrusion(plane, (0.0, 1.0), (flat(),), *replicate())
    ab = places()[:, :2]
    moved = plane.to_plane(plane.from_plane(ab) + field.displacement(plane.from_plane(ab)))
    oracle.assert_close(moved, np.c_[ab + flat().displacement(ab), np.zeros(60)], atol=1e-11)


# ---- grids -----------------------------------------------------------------------------------------------------------

TURNED = Grid(
    (4, 5, 6),
    (3.0, 2.0, 5.0),
    (1.0, 2.0, 3.0),
    tuple(map(tuple, Rotation.from_rotvec([0.5, -0.3, 0.8]).as_matrix().tolist())),
)
PRINTED = Grid(
    (4, 5, 6),
    (3.0, 2.0, 5.0),
    (1.0, 2.0, 3.0),
    tuple(map(tuple, Rotation.from_rotvec([0.5, -0.3, 0.8]).as_matrix().round(4).tolist())),
)


def points_of(grid: Grid) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij")
    return grid.index_to_point(np.stack([x, y, z], axis=-1))


@pytest.mark.parametrize("view", [*VIEWS, "oblique", "tilted"])
@pytest.mark.parametrize("grid", [GRID, TURNED, PRINTED], ids=["straight", "turned", "printed"])
def test_the_fast_way_through_a_grid_gives_the_values_at_its_points(grid: Grid, view: str) -> None:
    """Planes along the grid are evaluated on one slice; a grid with printed cosines is off right angles by 1e-4."""
    if view == "oblique":
        plane = Plane.from_normal((3.0, 4.0, 5.0), (1.0, 2.0, 2.0))
    elif view == "tilted":  # by 1e-4: to take this for aligned would be wrong by 1e-4 of the depth
        tilt = Rotation.from_rotvec([1e-4, 0, 0]).as_matrix()
        base = Plane.from_view(grid, "+z")
        plane = Plane(base.origin, tuple(tilt @ base.u), tuple(tilt @ base.v))
    else:
        plane = Plane.from_view(grid, view)
    for weights, maps in (
        (replicate(), (flat(),)),
        (modulate("1 - z^2"), (flat(),)),
        (interpolate([0.0, 0.3, 1.0]), (flat(), Identity(2), flat(1))),
    ):
        field = extrude(plane, grid, maps, weights)
        got = field.sample_on_grid(grid)
        assert got.dtype == np.float32
        assert got.shape == (*grid.shape, 3)
        oracle.assert_close(got, field.displacement(points_of(grid)), atol=SINGLE)


@pytest.mark.parametrize("view", VIEWS)
def test_the_axis_of_extrusion_is_found(view: str) -> None:
    assert extrude(Plane.from_view(GRID, view), GRID, (flat(),), replicate()).axis_of(GRID) == "zyx".index(view[1])
    aligned = extrude(Plane.from_view(TURNED, view), TURNED, (flat(),), replicate())
    assert aligned.axis_of(TURNED) is not None
    assert aligned.axis_of(GRID) is None


def test_a_plane_turned_within_itself_is_still_along_the_grid() -> None:
    c, s = np.cos(0.4), np.sin(0.4)
    plane = Plane((0.0, 0.0, 0.0), (c, s, 0.0), (-s, c, 0.0))
    field = extrude(plane, GRID, (flat(),), modulate("z"))
    assert field.axis_of(GRID) == 0
    oracle.assert_close(field.sample_on_grid(GRID), field.displacement(points_of(GRID)), atol=SINGLE)


# ---- JAX -------------------------------------------------------------------------------------------------------------


def test_jacobian_is_f_grad_d_and_f_prime_d() -> None:
    """J of D3 = [f dD/da, f dD/db, f' D] in the frame of the plane."""
    field = Extrusion(AXIAL, (0.0, 40.0), (flat(),), *modulate("z"))
    x = places(8) * [1, 1, 0] + [0, 0, 13.0]
    j = np.zeros((8, 3, 3))
    j[:, :2, :2] = 13 / 40 * flat().jacobian(x[:, :2])
    j[:, :2, 2] = flat().displacement(x[:, :2]) / 40
    oracle.assert_close(field.jacobian(x), j, atol=1e-9)


def test_an_extrusion_passes_through_jax() -> None:
    field = field_of(interpolate([0.0, 0.3, 1.0]), flat(), Identity(2), flat(1))
    doubled = jax.tree_util.tree_map(lambda leaf: leaf, field)
    assert isinstance(doubled, Extrusion)
    with float64():
        got = jax.jit(lambda f, x: f(x))(field, places())
        oracle.assert_close(got, field.displacement(places()), atol=1e-11)


# ---- errors -------------------------------------------------------------------------------------------------


def raises(z: np.ndarray) -> np.ndarray:
    raise KeyError("no")


@pytest.mark.parametrize(
    "curve",
    [
        [1.0],
        [],
        [[1.0, 2.0]],
        [0.0, np.nan],
        [0.0, np.inf],
        3.0,
        None,
        "",
        "z +",
        "1/z",
        {"z": 1},
        ["a", "b"],
        raises,
        lambda z: z[:5],
        lambda z: np.full_like(z, np.nan),
        lambda z: np.ones((2, len(z))),
        lambda z: "text",
        lambda z: None,
        lambda z, y: z,
        lambda z: 1j * z,
        lambda z: [z, z],
    ],
    ids=lambda curve: getattr(curve, "__name__", None) or str(curve),
)
def test_curves_that_are_none_are_refused(curve: Any) -> None:
    with pytest.raises(DeformError, match="curve"):
        modulate(curve)


def test_a_slow_curve_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(z: np.ndarray) -> np.ndarray:
        begun = time.thread_time()
        while time.thread_time() < begun + 0.06:
            pass
        return z

    modulate(slow)
    monkeypatch.setattr("deformnb.rbf.extrusion._SLOWEST_CURVE", 0.05)
    with pytest.raises(DeformError, match=r"took longer than 0\.05 s"):
        modulate(slow)


@pytest.mark.parametrize(
    "knots", [[], [[0.0, 1.0]], [0.5, 0.5], [0.7, 0.2], [-0.1, 0.5], [0.0, 1.1], [np.nan], [0, np.inf]]
)
def test_knots_that_do_not_rise_from_0_to_1_are_refused(knots: Any) -> None:
    with pytest.raises(DeformError, match="knots must"):
        interpolate(knots)


def test_maps_and_weights_that_do_not_fit_are_refused() -> None:
    with pytest.raises(DeformError, match="do not fit"):
        field_of(interpolate([0.0, 1.0]), flat())
    with pytest.raises(DeformError, match="do not fit"):
        field_of(replicate(), flat(), flat())
    with pytest.raises(DeformError, match="over a plane"):
        field_of(replicate(), Identity(3))


# ---- weights ---------------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(0, 1), min_size=1, max_size=6, unique=True), st.lists(st.floats(-0.5, 1.5), max_size=6))
def test_hat_functions_share_one_everywhere(knots: list[float], at: list[float]) -> None:
    """A partition of unity: equal maps give replication, and no weight is negative."""
    knots = sorted(knots)
    if min(np.diff(knots), default=1.0) < 1e-9:
        return
    field = Extrusion(AXIAL, (0.0, 1.0), (Identity(2),) * len(knots), *interpolate(knots))
    weights = field.weights_at(np.array([*at, *knots]))
    oracle.assert_close(weights.sum(axis=0), np.ones(len(at) + len(knots)), atol=1e-9)
    assert (weights >= 0).all()
    if len(knots) > 1:
        oracle.assert_close(weights[:, len(at) :], np.eye(len(knots)), atol=0)


def test_every_rule_is_registered_and_weights_have_their_shape() -> None:
    assert list(EXTRUSIONS) == ["replicate", "modulate", "interpolate"]
    assert modulate("z")[0].shape == (CURVE_KNOTS,)
    for knots, weights in (replicate(), modulate("z"), interpolate([0.0, 0.2])):
        assert knots[0] >= 0
        assert knots[-1] <= 1
        assert weights.shape[1] == len(knots)


@pytest.mark.parametrize("depth", [(2.0, 1.0), (np.nan, 1.0)])
def test_a_depth_from_back_to_front_is_refused(depth: tuple[float, float]) -> None:
    knots, weights = replicate()
    with pytest.raises(DeformError, match="front to back"):
        Extrusion(Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), depth, (Identity(2),), knots, weights)
