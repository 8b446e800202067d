"""Without JAX: NumPy computes the same by the same formulas, and what only JAX can do says so in one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import without_jax
from numpy.testing import assert_allclose

from deformnb.native import library

NEED_JAX = {
    "deformnb.rbf.fields.AbstractField.__call__",  # its example differentiates by JAX
    "deformnb.registration.optimise.fit_targets",
    "deformnb.warping.array_warp.warp_array",
}
"""Examples of the documentation that say that they need JAX."""


def run(task: str, path: Path, loops: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", without_jax.__file__, task, path, loops, "jax", "jaxlib"],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@cache
def results_with_jax() -> dict[str, np.ndarray]:
    return without_jax.results()


@pytest.mark.parametrize("loops", ["off", pytest.param("", marks=pytest.mark.nightly)])
def test_results_are_the_same_without_jax(loops: str, tmp_path: Path) -> None:
    run("results", tmp_path / "found.npz", loops)
    wanted, found = results_with_jax(), np.load(tmp_path / "found.npz")
    assert sorted(found) == sorted(wanted)
    for name, array in wanted.items():
        own = found[name]
        assert (own.shape, own.dtype) == (array.shape, array.dtype), name
        if array.dtype.kind in "biu":
            np.testing.assert_array_equal(own, array, err_msg=name)
        else:  # lattices are computed in float32; the quintic kernel loses seven digits of sixteen
            is_rough = array.dtype == np.float32 or name.startswith(("sampled", "in space", "inverse"))
            share = 1e-4 if is_rough else 1e-5 if name.startswith("a registered kernel") else 1e-8
            assert_allclose(own, array, rtol=0, atol=share * np.nanmax(np.abs(array), initial=1e-300), err_msg=name)


@pytest.mark.nightly
def test_results_are_those_of_jax_where_it_computes_all(tmp_path: Path) -> None:
    run("results", tmp_path / "found.npz", "off")
    library.use_level("off")
    try:
        wanted = without_jax.results()
    finally:
        library.use_level(None)
    found = np.load(tmp_path / "found.npz")
    for name, array in wanted.items():
        own = found[name]
        if array.dtype.kind in "biu":
            assert np.mean(own != array) <= 1e-3, name  # float32 sums are rounded in another order
        else:
            assert_allclose(own, array, rtol=0, atol=1e-4 * np.nanmax(np.abs(array), initial=1e-300), err_msg=name)


@pytest.mark.parametrize(
    ("task", "loops", "least"),
    [
        ("examples of mathematics", "", 400),
        pytest.param("examples", "", 1000, marks=pytest.mark.nightly),
        pytest.param("examples", "off", 1000, marks=pytest.mark.nightly),
    ],
)
def test_all_examples_work_without_jax_or_say_that_they_need_it(
    task: str, loops: str, least: int, tmp_path: Path, isolated_folders: Path
) -> None:
    run(task, tmp_path / "found.txt", loops)
    count, *found = (tmp_path / "found.txt").read_text(encoding="utf-8").splitlines()
    assert int(count.split()[0]) >= least
    assert found == [f"needs JAX: {name}" for name in sorted(NEED_JAX)]


@pytest.mark.parametrize(
    "call",
    [
        "dn.warp_array(np.zeros((2, 2, 2)), np.zeros((3, 2, 2, 2)), dn.Grid((2, 2, 2)))",
        "dn.registration.fit_targets(dn.ControlPoints.from_arrays([[0, 0]]), None, None)",
        "devices.use_device('gpu')",
        "dn.rbf.Identity(2).jax_displacement(jax.vjp)",
    ],
)
def test_what_needs_jax_says_so(call: str, tmp_path: Path) -> None:
    code = (
        "import sys; import without_jax; sys.meta_path.insert(0, without_jax.Hidden('jax', 'jaxlib'))\n"
        "import numpy as np, deformnb as dn\n"
        "from deformnb import devices\n"
        "from deformnb._jax import jax\n"
        f"try: {call}\n"
        "except dn.DeformError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    assert done.stdout.endswith("needs JAX, which is not installed: pip install jax\n")


SLOPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "powers": lambda x: x**3 / (1 + x) + np.power(2.0, x) - np.sqrt(x),
    "exponentials": lambda x: np.exp(-x) * np.log1p(x) + np.expm1(x) / np.log(2 + x) - np.log2(x) * np.log10(x),
    "trigonometry": lambda x: np.sin(x) * np.cos(x) - np.tan(x) + np.arctan(x) * np.tanh(x) + np.arctan2(x, 2 - x),
    "hyperbolas": lambda x: np.sinh(x) - np.cosh(x) * np.arcsin(x / 2) + np.arccos(x / 2) + np.hypot(x, 3.0),
    "kinks": lambda x: np.abs(x - 0.5) + np.maximum(x, 0.7) * np.minimum(x, 0.2) + np.clip(x, 0.1, 0.6) * np.sign(x),
    "choices": lambda x: np.where(x > 0.5, x * x, -x) + np.floor(x) + np.reciprocal(1 + x) + np.cbrt(x) + np.exp2(x),
    "sums": lambda x: np.cumsum(x) * np.sum(x) + np.einsum("i,j->i", x, x) + np.dot(x, x) + np.outer(x, x) @ x,
    "shapes": lambda x: np.concatenate([x[:5] ** 2, np.stack([x, x])[0, 5:]]) + np.roll(x, 1) + x.reshape(-1).T,
}


@pytest.mark.parametrize("name", SLOPES)
def test_derivatives_by_dual_numbers_are_those_of_differences(name: str) -> None:
    from deformnb._dual_numbers import jvp

    rng = np.random.default_rng(0)
    x, way, h = rng.uniform(0.05, 0.95, 12), rng.normal(size=12), 1e-6
    function = SLOPES[name]
    value, slope = jvp(function, (x,), (way,))
    np.testing.assert_array_equal(value, function(x))
    assert_allclose(slope, (function(x + h * way) - function(x - h * way)) / (2 * h), rtol=1e-6, atol=1e-7)


def test_a_function_without_a_known_derivative_is_named() -> None:
    from deformnb._dual_numbers import jvp

    with pytest.raises(ImportError, match="the derivative of numpy's interp needs JAX"):
        jvp(lambda x: np.interp(x, [0, 1], [0, 1]), (np.ones(2),), (np.ones(2),))
