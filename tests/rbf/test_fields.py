"""All methods that evaluate a field agree, for every kind of field, lattice and view."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from scipy.spatial.transform import Rotation

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.extrusion import Extrusion, interpolate, modulate
from deformnb.rbf.fields import AbstractField, Composed, DisplacementField, Identity, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import IDENTITY, Grid

OBLIQUE = tuple(map(tuple, Rotation.from_rotvec([0.5, -0.3, 0.8]).as_matrix().tolist()))
FLIPPED = ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0))
RASTER = Raster((7, 9), (1.5, 2.0), (-3.0, 4.0))
# The largest displacement below is about 20: float32 has seven digits of it, evaluation in float32 loses one more.
SINGLE = 2e-5


def grid_of(direction: Any = IDENTITY, shape: tuple[int, int, int] = (4, 5, 6)) -> Grid:
    return Grid(shape, (3.0, 2.0, 5.0), (-4.0, 30.0, 7.0), direction)


def fitted(dim: int, seed: int = 0, trend: str = "affine") -> AbstractField:
    rng = np.random.default_rng(seed)
    source = rng.uniform(-5, 25, (6, dim))
    points = ControlPoints.from_arrays(source, source + rng.normal(0, 3, source.shape))
    return fit_rbf(points, support=25.0, trend=trend)


@cache
def planar() -> dict[str, AbstractField]:
    fit, stored = fitted(2), DisplacementField.sample(fitted(2, 1), RASTER)
    spline = BSplineField(
        np.random.default_rng(4).normal(0, 3, (6, 5, 2)), (-30.0, -40.0), ((19.0, 4.0), (-4.0, 19.0)), 2
    )
    return {
        "rbf": fit,
        "sampled": stored,
        "b-spline": spline,
        "identity": Identity(2),
        "composed": Composed(fit, fitted(2, 2, "rigid")),
        "composed of samples": compose(fit, stored, fit),
    }


@cache
def spatial() -> dict[str, AbstractField]:
    fit, grid = fitted(3), grid_of(OBLIQUE)
    oblique = Plane.from_normal((3.0, 1.0, 2.0), (1.0, 2.0, -0.5))
    extruded = Extrusion(oblique, (-10.0, 30.0), (fitted(2),), *modulate("1 - z^2"))
    keyed = Extrusion(
        Plane.from_view(grid_of(), "-y"),
        (0.0, 8.0),
        (Identity(2), fitted(2), planar()["sampled"]),
        *interpolate([0.0, 0.4, 1.0]),
    )
    axes = ((18.0, 3.0, 0.0), (-3.0, 18.0, 0.0), (0.0, 1.0, 17.0))
    spline = BSplineField(np.random.default_rng(5).normal(0, 3, (7, 6, 5, 3)), (-35.0, -40.0, -42.0), axes)
    return {
        "rbf": fit,
        "sampled": DisplacementField.sample(fitted(3, 1), grid),
        "b-spline": spline,
        "identity": Identity(3),
        "extruded": extruded,
        "keyed": keyed,
        "composed": Composed(extruded, fit),
        "three": compose(fit, DisplacementField.sample(fit, grid), keyed),
    }


def places(dim: int) -> np.ndarray:
    return np.random.default_rng(6).uniform(-10, 45, (3, 4, dim))


FIELDS: list[tuple[int, str]] = [
    (2, n) for n in ("rbf", "sampled", "b-spline", "identity", "composed", "composed of samples")
] + [(3, n) for n in ("rbf", "sampled", "b-spline", "identity", "extruded", "keyed", "composed", "three")]


def field(dim: int, name: str) -> AbstractField:
    return (planar() if dim == 2 else spatial())[name]


# ---- agreement -------------------------------------------------------------------------------------------------------


def test_every_field_is_in_the_table() -> None:
    assert [(2, n) for n in planar()] + [(3, n) for n in spatial()] == FIELDS


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("dim", "name"), FIELDS)
def test_jax_and_numpy_agree_on_points_of_any_shape(dim: int, name: str) -> None:
    f, x = field(dim, name), places(dim)
    wanted = f.displacement(x)
    assert f.dim == dim
    assert wanted.shape == x.shape
    assert wanted.dtype == np.float64
    with float64():
        oracle.assert_close(np.asarray(f(jnp.asarray(x))), wanted, atol=1e-11)
        oracle.assert_close(np.asarray(jax.vmap(jax.vmap(f))(x)), wanted, atol=1e-11)
    np.testing.assert_array_equal(f(x.tolist()), wanted)
    single = x.astype(np.float32)
    followed = jax.jit(f)(single)
    assert followed.dtype == np.float32  # the caller's own type, computed in 64 bits within
    oracle.assert_close(np.asarray(followed, dtype=float), f.displacement(single), atol=2e-6, rtol=1e-6)
    np.testing.assert_array_equal(f.displacement(x[0, 0].tolist()), f.displacement(x[0, 0]))


@pytest.mark.parametrize("name", spatial())
def test_a_field_that_users_compile_in_32_bits_stays_exact(name: str) -> None:
    planar.cache_clear()  # nothing has been computed from these arrays
    spatial.cache_clear()
    f, x = field(3, name), places(3)
    jax.jit(f)(x)
    wanted = np.stack([f.displacement(row) for row in x])
    planar.cache_clear()
    spatial.cache_clear()
    np.testing.assert_allclose(wanted, field(3, name).displacement(x), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("dim", "name"), FIELDS)
def test_products_are_in_full_precision_on_a_gpu_too(dim: int, name: str) -> None:
    program = jax.jit(lambda f, x: f(x)).lower(field(dim, name), places(dim)).as_text()
    products = program.count("stablehlo.dot_general")
    assert products or name == "identity" or "sampled" in name
    assert program.count("precision = [HIGHEST, HIGHEST]") == products


@pytest.mark.parametrize("name", planar())
def test_values_on_a_raster_are_those_at_its_points(name: str) -> None:
    f = field(2, name)
    for raster in (RASTER, Raster((1, 1), (1.0, 1.0), (5.0, 6.0)), Raster((3, 70), (0.3, 9.0), (100.0, -80.0))):
        got = f.sample_on_raster(raster)
        assert got.shape == (2, *raster.shape)
        assert got.dtype == np.float32
        wanted = np.moveaxis(f.displacement(raster.points()), -1, 0)
        oracle.assert_close(got, wanted, atol=SINGLE, rtol=1e-6)


GRIDS = {
    "straight": grid_of(),
    "oblique": grid_of(OBLIQUE),
    "flipped": grid_of(FLIPPED),
    "one slice": grid_of(shape=(1, 5, 6)),
    "one row": grid_of(OBLIQUE, (1, 1, 6)),
    "one voxel": grid_of(shape=(1, 1, 1)),
}


def points_of(grid: Grid) -> np.ndarray:
    z, y, x = np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij")
    return grid.index_to_point(np.stack([x, y, z], axis=-1))


@pytest.mark.parametrize("which", GRIDS)
@pytest.mark.parametrize("name", spatial())
def test_values_on_a_grid_are_those_at_its_points(name: str, which: str) -> None:
    f, grid = field(3, name), GRIDS[which]
    got = f.sample_on_grid(grid)
    assert got.shape == (*grid.shape, 3)
    assert got.dtype == np.float32
    oracle.assert_close(got, f.displacement(points_of(grid)), atol=SINGLE, rtol=1e-6)


@pytest.mark.parametrize(("dim", "name"), FIELDS)
def test_an_outer_sum_is_that_of_its_points(dim: int, name: str) -> None:
    rng = np.random.default_rng(2)
    rows, columns = rng.uniform(0, 20, (dim, 5)), rng.uniform(0, 5, (dim, 3))
    got = field(dim, name).lattice_values(rows, columns, 1.0)
    wanted = field(dim, name).displacement((rows[:, :, None] + columns[:, None, :]).transpose(1, 2, 0))
    assert got.shape == (dim, 5, 3)
    oracle.assert_close(got, wanted.transpose(2, 0, 1), atol=SINGLE, rtol=1e-6)


@pytest.mark.parametrize(("dim", "name"), [f for f in FIELDS if "sampl" not in f[1] and f[1] not in ("three", "keyed")])
def test_jacobian_is_that_of_differences(dim: int, name: str) -> None:
    f, x, h = field(dim, name), places(dim)[0], 1e-5
    steps = [f.displacement(x + h * e) - f.displacement(x - h * e) for e in np.eye(dim)]
    # The pages of an extrusion have an edge where zeta is cut off; none of the places is that near to it.
    oracle.assert_close(f.jacobian(x), np.stack(steps, axis=-1) / (2 * h), atol=1e-6)
    assert f.jacobian(places(dim)).shape == (3, 4, dim, dim)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("dim", "name"), FIELDS)
def test_fields_are_pytrees_that_pass_through_jax(dim: int, name: str) -> None:
    f, x = field(dim, name), places(dim)
    leaves, shape = jax.tree_util.tree_flatten(f)
    again = jax.tree_util.tree_unflatten(shape, leaves)
    np.testing.assert_array_equal(again.displacement(x), f.displacement(x))
    copied = jax.tree_util.tree_map(lambda leaf: leaf, f)
    assert type(copied) is type(f)
    hash(shape)
    with float64():
        through = jax.jit(lambda g, p: g(p))(f, x)
        returned = jax.jit(lambda g: g)(f)
        oracle.assert_close(np.asarray(through), f.displacement(x), atol=1e-11)
        oracle.assert_close(np.asarray(returned(x)), f.displacement(x), atol=1e-11)


def test_a_field_is_refused_where_it_has_no_values() -> None:
    for name, f in planar().items():
        with pytest.raises(DeformError, match="over a plane"):
            f.sample_on_grid(grid_of())
        del name
    for f in spatial().values():
        with pytest.raises(DeformError, match="in space"):
            f.sample_on_raster(RASTER)
    with pytest.raises(DeformError, match="do not compose"):
        compose(Identity(2), Identity(3))


# ---- composition -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_composed_is_the_composition_of_the_maps(dim: int) -> None:
    """First a, then b: output(x) = after_a(x + D_b(x)) and after_a(y) = input(y + D_a(y))."""
    a, b, c = fitted(dim), fitted(dim, 1), fitted(dim, 2)
    x = places(dim)

    def apply(f: AbstractField) -> Callable[[np.ndarray], np.ndarray]:
        return lambda p: p + f.displacement(p)

    wanted = apply(a)(apply(b)(apply(c)(x))) - x
    oracle.assert_close(compose(a, b, c).displacement(x), wanted, atol=1e-12)
    oracle.assert_close(Composed(a, Composed(b, c)).displacement(x), wanted, atol=1e-12)
    oracle.assert_close(Composed(a, Identity(dim)).displacement(x), a.displacement(x), atol=1e-12)
    oracle.assert_close(Composed(Identity(dim), a).displacement(x), a.displacement(x), atol=1e-12)
    assert not Composed(a, Identity(dim)).is_identity
    assert not Composed(Identity(dim), a).is_identity
    assert Composed(Identity(dim), Identity(dim)).is_identity
    assert compose(a) is a
    assert np.abs(compose(a, b).displacement(x) - compose(b, a).displacement(x)).max() > 0.1  # the order matters


def test_composing_translations_adds_them_and_a_map_with_its_inverse_is_nothing() -> None:
    x = places(2)

    def moved(source: Any) -> AbstractField:
        target = np.array([[0.0, 0], [10, 0], [0, 10]])
        return fit_rbf(ControlPoints.from_arrays(source(target), target))

    a, b = moved(lambda p: p + np.array([3, 1])), moved(lambda p: p - 1)
    oracle.assert_close(compose(a, b).displacement(x), np.broadcast_to([2.0, 0.0], x.shape), atol=1e-12)
    m = np.array([[0.0, -2], [2, 1]])
    back = compose(moved(lambda p: p @ m.T), moved(lambda p: p @ np.linalg.inv(m).T))
    oracle.assert_close(back.displacement(x), 0, atol=1e-12)


def test_composing_nothing_is_the_identity_in_space() -> None:
    assert compose() == Identity(3)
    assert (compose().displacement(places(3)) == 0).all()
    assert (compose().sample_on_grid(grid_of()) == 0).all()


# ---- samples ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lattice", [RASTER, *GRIDS.values()], ids=["raster", *GRIDS])
def test_samples_reproduce_linear_fields_inside_and_go_on_as_a_constant(lattice: Any) -> None:
    dim = len(lattice.shape)
    rng = np.random.default_rng(3)
    m, shift = rng.normal(size=(dim, dim)), rng.normal(size=dim)
    corners = lattice.points() if dim == 2 else points_of(lattice)
    stored = DisplacementField(corners @ m.T + shift, lattice)
    inside = corners.reshape(-1, dim)
    mixed = rng.dirichlet(np.ones(len(inside)), 20) @ inside  # anywhere within the hull
    oracle.assert_close(stored.displacement(mixed), mixed @ m.T + shift, atol=1e-12)
    oracle.assert_close(stored.displacement(corners), corners @ m.T + shift, atol=1e-12)
    # far beyond one end of each axis, one after the other
    first = inside[0]
    away = corners[(0,) * dim] - corners[(-1,) * dim]
    oracle.assert_close(stored.displacement(first + 7 * away), first @ m.T + shift, atol=1e-11)


def test_sampling_again_on_the_same_lattice_changes_nothing() -> None:
    once = DisplacementField.sample(fitted(3), grid_of(OBLIQUE))
    twice = DisplacementField.sample(once, grid_of(OBLIQUE))
    oracle.assert_close(twice.values, once.values, atol=SINGLE)
    np.testing.assert_array_equal(
        DisplacementField.sample(planar()["rbf"], RASTER).values,
        np.moveaxis(planar()["rbf"].sample_on_raster(RASTER), 0, -1),
    )


def test_the_error_of_sampling_falls_with_the_square_of_the_step() -> None:
    f, x = fitted(2), np.random.default_rng(0).uniform(0, 20, (200, 2))
    errors = []
    for h in (2.0, 1.0, 0.5):
        n = int(20 / h) + 1
        stored = DisplacementField.sample(f, Raster((n, n), (h, h), (0.0, 0.0)))
        errors.append(np.abs(stored.displacement(x) - f.displacement(x)).max())
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.35)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.35)


@pytest.mark.parametrize("shape", [(7, 9), (7, 9, 3), (9, 7, 2), (7, 9, 2, 1)])
def test_samples_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(DeformError, match="samples of shape"):
        DisplacementField(np.zeros(shape), RASTER)
