"""The radial functions against 30 digits, against one another, and against their claimed properties."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import oracle
import pytest

from deformnb._jax import float64
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.document.script import as_python
from deformnb.errors import DeformError
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import (
    BUILT_IN,
    KERNELS,
    AbstractKernel,
    Gaussian,
    WendlandC2,
    as_kernel,
    register_kernel,
)
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.widgets.parameters import Choice

# As published (Wendland 2004, chapter 8): a new kernel needs its row here.
ORDERS = {
    "wendland_c0": 0,
    "wendland_c2": 0,
    "wendland_c4": 0,
    "gaussian": 0,
    "multiquadric": 1,
    "linear": 1,
    "thin_plate": 2,
    "cubic": 2,
    "inverse_multiquadric": 0,
    "inverse_quadratic": 0,
    "quintic": 3,
}
KINKED = ("wendland_c0", "linear")
PLANE = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))


def test_every_kernel_has_its_published_order() -> None:
    assert {name: kernel.order for name, kernel in KERNELS.items()} == ORDERS


@pytest.mark.parametrize("name", KERNELS)
def test_profile_is_the_published_formula(name: str) -> None:
    support = 37.0
    r = np.array([0.0, 1e-12, 1e-5, 0.01, 0.25, 1 / 3, 0.5, 0.9, 0.999, 1.0, 1.001, 2.0, 9.0]) * support
    with mpmath.workdps(30):
        wanted = [float(oracle.radial(name, mpmath.mpf(v) / support)) for v in r]
    # A few roundings of terms below 16 rho^3 (multiquadric and cubic grow).
    oracle.assert_close(KERNELS[name](support)(r), wanted, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("name", KERNELS)
def test_profile_of_numpy_s_arrays_is_that_of_jax(name: str) -> None:
    s = np.concatenate([[0.0, 1e-30, 1.0], np.geomspace(1e-12, 1e6, 200)])
    # Two units in the last place of each root and logarithm, times the power they are taken to.
    oracle.assert_close(KERNELS[name].profile(s), KERNELS[name](1.0)(np.sqrt(s)), rtol=1e-13, atol=1e-15)


def test_thin_plate_has_the_digits_of_its_logarithm_at_every_scale() -> None:
    rng = np.random.default_rng(0)
    r = np.concatenate(
        [
            10.0 ** rng.uniform(-14, 14, 10000),
            rng.uniform(0.5, 2, 10000),
            1 + rng.uniform(-1e-6, 1e-6, 10000),
            np.sqrt([0.5, np.nextafter(0.5, 0), 2.0, 1.0]),
        ]
    )
    s = (r**2).astype(np.longdouble)
    wanted = 0.5 * s * np.log(s)
    # Two roundings of the logarithm, one of each product.
    oracle.assert_close(KERNELS["thin_plate"](1.0)(r), wanted.astype(float), rtol=5 * 2.0**-53, atol=0)
    single = s.astype(np.float32)
    found = KERNELS["thin_plate"].profile(jnp.asarray(single))
    oracle.assert_close(found, 0.5 * single * np.log(single.astype(float)), rtol=5 * 2.0**-24, atol=0)


def test_wendland_is_the_paper_s_polynomial_and_its_integral() -> None:
    for rho in np.linspace(0, 1.2, 25):
        assert float(WendlandC2(1.0)(rho)) == pytest.approx(oracle.psi31(rho), abs=1e-15)
        assert oracle.psi31(rho) == pytest.approx(oracle.psi31_as_integral(rho), abs=1e-14)
    assert float(WendlandC2(8.0)(2.0)) == pytest.approx(oracle.psi31(0.25), abs=1e-15)  # r / R, not r


@pytest.mark.parametrize("name", KERNELS)
def test_slope_is_the_derivative_in_the_square(name: str) -> None:
    with float64(), mpmath.workdps(40):
        for s in (1e-4, 0.0625, 0.3, 0.81, 0.9999, 1.21, 30.0):
            wanted = float(mpmath.diff(lambda t: oracle.radial(name, mpmath.sqrt(t)), mpmath.mpf(s)))
            assert float(KERNELS[name].slope(jnp.float64(s))) == pytest.approx(wanted, rel=1e-12, abs=1e-13)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_value_and_gradients_are_finite_at_and_next_to_the_point(name: str, dtype: type) -> None:
    kernel = KERNELS[name]

    @jax.jit
    def value(x: jax.Array) -> jax.Array:
        return kernel.of_square(jnp.sum(x * x))

    gradient, second = jax.jit(jax.grad(value)), jax.jit(jax.hessian(value))

    with float64():
        for r in (0.0, 1e-30, 1e-18, 1e-9, 1.0, 1e6):
            x = jnp.array([r, 0.0], dtype=dtype)
            assert np.isfinite(value(x))
            assert np.isfinite(gradient(x)).all()
        assert (np.asarray(gradient(jnp.zeros(2, dtype))) == 0).all()
        if name not in (*KINKED, "thin_plate"):  # these have no second derivative at the point
            curvature = np.asarray(second(jnp.zeros(2, dtype)))
            wanted = {
                "wendland_c2": -20,
                "wendland_c4": -56 / 3,
                "gaussian": -9,
                "multiquadric": -16,
                "cubic": 0,
                "inverse_multiquadric": -16,
                "inverse_quadratic": -32,
                "quintic": 0,
            }
            oracle.assert_close(curvature, wanted[name] * np.eye(2), rtol=1e-6)
        assert np.isfinite(second(jnp.array([0.3, 0.4], dtype))).all()


@pytest.mark.parametrize("name", KERNELS)
def test_compact_support_ends_at_the_support_radius(name: str) -> None:
    kernel = KERNELS[name](5.0)
    beyond = kernel(np.array([5.0, 5.1, 1e3, 1e9]))
    assert kernel.compact == bool((beyond == 0).all())
    assert abs(float(kernel(4.0))) > 0  # and not before


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", KERNELS)
def test_conditionally_positive_definite_of_its_order(name: str, dim: int) -> None:
    rng = np.random.default_rng(1)
    for n in (12, 25) if ORDERS[name] == 3 else (6, 25):
        x = rng.uniform(0, 1, (n, dim))
        phi = KERNELS[name](0.7)(np.linalg.norm(x[:, None] - x[None], axis=-1))
        squares = np.stack([x[:, a] * x[:, b] for a in range(dim) for b in range(a + 1)], axis=1)
        polynomials = [np.zeros((n, 0)), np.ones((n, 1)), np.c_[np.ones(n), x], np.c_[np.ones(n), x, squares]][
            ORDERS[name]
        ]
        u, _, _ = np.linalg.svd(polynomials) if ORDERS[name] else (np.eye(n), None, None)
        complement = u[:, polynomials.shape[1] :]
        lowest = np.linalg.eigvalsh(complement.T @ phi @ complement)[0]
        # Rounding is 1e-15; the smallest seen are 2.6e-4, and 2.1e-6 of the quintic.
        assert lowest > (1e-7 if ORDERS[name] == 3 else 1e-5) * np.abs(phi).max()


@pytest.mark.parametrize("name", [n for n, order in ORDERS.items() if order])
def test_an_order_above_zero_is_needed(name: str) -> None:
    x = np.random.default_rng(2).uniform(0, 1, (10, 2))
    phi = KERNELS[name](0.7)(np.linalg.norm(x[:, None] - x[None], axis=-1))
    assert np.linalg.eigvalsh(phi)[0] < -1e-3


@pytest.mark.parametrize("support", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_a_support_that_is_no_length_is_refused(support: float) -> None:
    for kernel in KERNELS.values():
        with pytest.raises(DeformError, match="support radius must be a positive length"):
            kernel(support)


def test_unknown_names_list_the_known_ones() -> None:
    with pytest.raises(DeformError, match=r"unknown kernel 'tps'; choose one of wendland_c2, .*linear"):
        as_kernel("tps")


@pytest.mark.parametrize("name", KERNELS)
def test_metadata_for_menus(name: str) -> None:
    kernel = KERNELS[name]
    assert kernel.name == name
    assert kernel.title
    assert kernel.title != name
    assert len({k.title for k in KERNELS.values()}) == len(KERNELS)
    assert kernel(2.0) == kernel(2.0)
    assert kernel(2.0) != kernel(3.0)


# ---- kernels of one's own --------------------------------------------------------------------------------------------


@pytest.fixture
def _registry() -> Iterator[None]:
    """Remove the kernels that a test registers."""
    yield
    for name in set(KERNELS) - BUILT_IN:
        del KERNELS[name]


def matern(rho: Any) -> Any:
    """Matern 5/2 with a third of the support as its length."""
    a = 3 * 5**0.5 * rho
    return (1 + a + a**2 / 3) * jnp.exp(-a)


def some_points() -> ControlPoints:
    rng = np.random.default_rng(3)
    source = rng.uniform(0, 100, (9, 2))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 3, source.shape))


@pytest.mark.usefixtures("_registry")
def test_a_gaussian_of_ones_own_is_the_gaussian() -> None:
    register_kernel(lambda rho: jnp.exp(-((3 * rho) ** 2) / 2), name="bell", shares=Gaussian.shares, gaps=Gaussian.gaps)
    own, built_in = (fit_rbf(some_points(), kernel=name) for name in ("bell", "gaussian"))
    x = np.random.default_rng(4).uniform(-20, 120, (300, 2))
    x[0] = some_points().target[0]
    assert own.support == built_in.support
    # Roundings of values below 10, times the condition of the system (1e3).
    oracle.assert_close(own.displacement(x), built_in.displacement(x), atol=1e-11)
    oracle.assert_close(own.jacobian(x), built_in.jacobian(x), atol=1e-11)
    raster = Raster((20, 20), (5.0, 5.0), (0.0, 0.0))
    oracle.assert_close(own.sample_on_raster(raster), built_in.sample_on_raster(raster), atol=1e-4)


@pytest.mark.usefixtures("_registry")
def test_a_fit_with_a_new_kernel_is_its_literal_sum() -> None:
    """Matern 5/2 against a system that is set up and solved here, by the literal formula."""
    points, support = some_points(), 40.0
    fit = fit_rbf(points, kernel=matern, support=support, trend="none")
    assert (fit.kernel.name, fit.kernel.title, fit.kernel.order) == ("matern", "Matern", 0)
    x = np.random.default_rng(5).uniform(0, 100, (50, 2))

    def phi(p: np.ndarray, q: np.ndarray) -> np.ndarray:
        a = np.sqrt(5) * np.linalg.norm(p[:, None] - q[None], axis=2) / (support / 3)
        return (1 + a + a**2 / 3) * np.exp(-a)

    alpha = np.linalg.solve(phi(points.target, points.target), points.displacement)
    oracle.assert_close(fit.displacement(x), phi(x, points.target) @ alpha, atol=1e-11)
    h = 1e-5
    slopes = [(fit.displacement(x + h * e) - fit.displacement(x - h * e)) / (2 * h) for e in np.eye(2)]
    oracle.assert_close(fit.jacobian(x), np.stack(slopes, axis=-1), atol=1e-8)
    assert np.isfinite(fit.jacobian(points.target)).all()


@pytest.mark.usefixtures("_registry")
def test_a_class_without_a_slope_gets_it_from_jax() -> None:
    class Bump(AbstractKernel):
        name, title, compact = "bump", "Bump", True

        @staticmethod
        def profile(s: Any) -> Any:
            return WendlandC2.profile(s)

    register_kernel(Bump)
    s = np.linspace(0.01, 1.5, 50)
    with float64():
        oracle.assert_close(
            np.asarray(Bump.slope(jnp.asarray(s))), np.asarray(WendlandC2.slope(jnp.asarray(s))), atol=1e-12
        )
        assert np.isfinite(float(Bump.slope(jnp.float64(0.0))))
    assert as_kernel(Bump(3.0)) is as_kernel("bump") is Bump
    step = Step((some_points(),), PLANE, kernel=Bump(30.0))
    assert (step.kernel, step.support) == ("bump", 30.0)


@pytest.mark.usefixtures("_registry")
def test_steps_editors_and_edits_take_a_function_and_keep_its_name() -> None:
    step = Step((some_points(),), PLANE, kernel=matern)
    assert step.kernel == "matern"
    assert replace(step, kernel=matern) == step
    assert as_kernel(matern) is KERNELS["matern"]  # which is not registered twice
    assert FitSettings(kernel=matern).fit(some_points()).kernel is KERNELS["matern"]
    assert Choice("", registry=KERNELS).options[-1] == ("matern", "Matern")
    document = Deformation((step,))
    assert from_json(to_json(document)) == document
    assert "dn.rbf.register_kernel" in as_python(document, Grid((4, 4, 4)))
    del KERNELS["matern"]
    with pytest.raises(DeformError, match=r"made with the kernel 'matern', .*register_kernel under this.*steps\[0\]"):
        from_json(to_json(document))


REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "sign": (lambda r: -jnp.exp(-r), {}, "its negative is of order 0"),
    "order": (lambda r: -jnp.sqrt(1 + r * r), {}, "of order 0 .*; it is of order 1"),
    "order 2": (lambda r: r**3, {"order": 1}, "it is of order 2: register that"),
    "never": (lambda r: jnp.cos(3 * r), {}, "choose another function"),
    "polynomial": (lambda r: r * r, {"order": 2}, "choose another function"),
    "only in one dimension": (lambda r: 1 - r, {"compact": True}, "choose another function"),
    "no end": (lambda r: jnp.exp(-r), {"compact": True}, "0.3679 at rho = 1, where a compact kernel ends at 0"),
    "not finite": (jnp.exp, {}, "not finite at rho = "),
    "singular": (jnp.log, {"order": 1}, "jumps next to its point"),
    "NumPy": (lambda r: np.exp(-r), {}, "cannot be compiled: .* jnp.exp for math.exp"),
    "a branch": (lambda r: 1.0 if r < 1 else 0.0, {}, "jnp.where for if"),
    "one number": (jnp.sum, {}, "a number for each, element by element"),
    "derivative": (lambda r: jnp.exp(-r * r), {"derivative": lambda r: -r * jnp.exp(-r * r)}, "leave it out, and JAX"),
    "built in": (matern, {"name": "gaussian"}, "is a kernel of deformnb"),
    "name": (matern, {"name": "A b"}, "up to 40 lower-case letters"),
    "no name": (lambda r: r, {"name": None}, "a kernel needs a name"),
    "fourth order": (matern, {"order": 4}, "is 0, 1, 2 or 3"),
    "title": (matern, {"title": "Gaussian"}, "a text that no other kernel has"),
    "no function": (5, {}, "a kernel is a function"),
}


@pytest.mark.allow_nan
@pytest.mark.usefixtures("_registry")
@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_kernel_is_refused_with_the_reason(case: str) -> None:
    function, options, reason = REFUSED[case]
    with pytest.raises(DeformError, match=reason):
        register_kernel(function, **{"name": "own", **options})
    assert set(KERNELS) == BUILT_IN


@pytest.mark.usefixtures("_registry")
def test_a_trend_below_the_order_is_refused_for_a_kernel_of_ones_own_too() -> None:
    register_kernel(lambda rho: rho**2 * jnp.log(rho), name="plate", order=2)
    with pytest.raises(DeformError, match="the plate kernel is not positive definite and needs a trend of"):
        fit_rbf(some_points(), kernel="plate", trend="rigid")
