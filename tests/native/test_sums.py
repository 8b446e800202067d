"""Compiled sums over centres against their definition in NumPy, for every kernel; derivatives by the slopes of JAX."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb._jax import float64, jnp
from deformnb.native import jobs, library, sums
from deformnb.rbf.kernels import BUILT_IN, KERNELS

pytestmark = pytest.mark.skipif(library.loops() is None, reason=f"no compiled loops: {library.why_absent()}")


@pytest.fixture(params=library.levels(), autouse=True)
def level(request: pytest.FixtureRequest) -> Any:
    before = library.use_level(request.param)
    yield request.param
    library.use_level(before)


def test_every_kernel_of_the_package_has_its_loop() -> None:
    assert set(jobs.RADIAL_FUNCTIONS) == set(BUILT_IN)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", jobs.RADIAL_FUNCTIONS)
def test_sums_and_their_derivatives_follow_the_definition(kernel: str, dim: int, dtype: Any) -> None:
    rng, kind = np.random.default_rng([jobs.RADIAL_FUNCTIONS.index(kernel), dim]), KERNELS[kernel]
    for count in (0, 1, 2, 40):
        for along_one_axis in (True, False):
            rows, columns = rng.uniform(0, 1, (dim, 37)), rng.uniform(-0.2, 0.2, (dim, 150))
            columns[1:] *= not along_one_axis
            x, a = rng.uniform(0, 1, (count, dim)), rng.normal(size=(count, dim))
            linear, constant = rng.normal(size=(dim, dim)), rng.normal(size=dim)
            bent = rng.normal(size=(dim, dim, dim)) if count != 2 else None
            bent = None if bent is None else bent + bent.transpose(0, 2, 1)
            scales = rng.uniform(0.5, 3, count) if count > 2 else None
            squares = np.ones(count) if scales is None else scales**2
            p = rows[:, :, None] + columns[:, None, :]
            away = p - x[:, :, None, None]
            s = (away**2).sum(axis=1) * squares[:, None, None]
            wanted = np.einsum("mk,krc->mrc", linear, p) + constant[:, None, None]
            wanted += np.einsum("nm,nrc->mrc", a, np.asarray(kind.profile(s)))
            with float64():
                slopes = 2 * np.asarray(kind.slope(jnp.asarray(s))) * squares[:, None, None]
            derivatives = linear[:, :, None, None] + np.einsum("nm,nrc,nkrc->mkrc", a, slopes, away)
            if bent is not None:
                wanted += np.einsum("mkj,krc,jrc->mrc", bent, p, p)
                derivatives = derivatives + 2 * np.einsum("mkj,jrc->mkrc", bent, p)
            for found, right in (
                (_sum(rows, columns, x, a, linear, constant, kind, scales, bent, dtype, False), wanted),
                (_sum(rows, columns, x, a, linear, constant, kind, scales, bent, dtype, True), derivatives),
            ):
                assert found.dtype == dtype
                close = (3e-5 if dtype == np.float32 else 1e-11) * np.abs(right).max()
                np.testing.assert_allclose(found, right, rtol=0, atol=close)


def _sum(
    rows: Any, columns: Any, x: Any, a: Any, linear: Any, constant: Any, kind: Any, scales: Any, bent: Any, dtype: Any,
    derivatives: bool,
) -> Any:  # fmt: skip
    return sums.sum_lattice(
        rows,
        columns,
        x,
        a,
        linear,
        constant,
        kind.name,
        scales=scales,
        quadratic=bent,
        dtype=dtype,
        is_compact=kind.compact,
        derivatives=derivatives,
    )


def test_far_from_the_origin_float32_keeps_its_digits() -> None:
    rng = np.random.default_rng(0)
    rows, columns = rng.uniform(0, 1, (2, 5)), np.stack([np.linspace(0, 1, 200), np.zeros(200)])
    x, a, none = rng.uniform(0, 1, (9, 2)), rng.normal(size=(9, 2)), np.zeros(2)
    near = sums.sum_lattice(rows, columns, x, a, np.zeros((2, 2)), none, "wendland_c2", dtype=np.float32)
    far = sums.sum_lattice(rows + 1e6, columns, x + 1e6, a, np.zeros((2, 2)), none, "wendland_c2", dtype=np.float32)
    np.testing.assert_allclose(near, far, rtol=0, atol=1e-6)


def test_arrays_that_do_not_fit_are_refused() -> None:
    one, none = np.zeros((2, 3)), np.zeros(2)
    good = (one, one, one.T, one.T, np.zeros((2, 2)), none)
    assert sums.sum_lattice(*good, "linear").shape == (2, 3, 3)
    for k, wrong in enumerate((np.zeros((3, 3)), np.zeros((3, 3)), one, one, one, one)):
        with pytest.raises(ValueError, match="no sum over centres"):
            sums.sum_lattice(*good[:k], wrong, *good[k + 1 :], "linear")
    with pytest.raises(ValueError, match="scales"):
        sums.sum_lattice(*good, "linear", scales=np.ones(2))
    with pytest.raises(ValueError, match="float32 or float64"):
        sums.sum_lattice(*good, "linear", dtype=np.float16)
