"""The radial functions against 30 digits, against one another, and against what is claimed of them."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import oracle
import pytest

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.kernels import KERNELS, WendlandC2, kernel_named

# As published (Wendland 2004, chapter 8): a new kernel needs its row here.
ORDERS = {"wendland_c0": 0, "wendland_c2": 0, "wendland_c4": 0, "gaussian": 0, "multiquadric": 1, "linear": 1,
          "thin_plate": 2, "cubic": 2, "inverse_multiquadric": 0, "inverse_quadratic": 0, "quintic": 3}
KINKED = ("wendland_c0", "linear")


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
            wanted = {"wendland_c2": -20, "wendland_c4": -56 / 3, "gaussian": -9, "multiquadric": -16, "cubic": 0,
                      "inverse_multiquadric": -16, "inverse_quadratic": -32, "quintic": 0}
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
            ORDERS[name]]
        u, _, _ = np.linalg.svd(polynomials) if ORDERS[name] else (np.eye(n), None, None)
        complement = u[:, polynomials.shape[1]:]
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
        kernel_named("tps")


@pytest.mark.parametrize("name", KERNELS)
def test_metadata_for_menus(name: str) -> None:
    kernel = KERNELS[name]
    assert kernel.name == name
    assert kernel.title
    assert kernel.title != name
    assert len({k.title for k in KERNELS.values()}) == len(KERNELS)
    assert kernel(2.0) == kernel(2.0)
    assert kernel(2.0) != kernel(3.0)
