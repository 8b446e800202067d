"""Kernels that are registered in Python, in the page: their tables, and the fits that are made by them."""

from __future__ import annotations

from collections.abc import Iterator

import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scripts import run_script

from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import BUILT_IN, KERNELS, AbstractKernel, register_kernel
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster
from deformnb.widgets.kernel_table import kernel_table, table_for_client
from deformnb.widgets.messages.points import points_to_json

FILES = ("maths/rbf.ts", "maths/kernel_table.ts")
PLACES = [[33.0, 44.0], [-300.0, 900.0], [210.0, 230.0]]
RASTER = Raster((9, 11), (50.0, 55.0), (-30.0, 12.0))

MAIN = """({ points, settings, raster, places }) => {
    const fit = rbfFit(points, settings);
    return { map: Array.from(rbfOnRaster(fit, raster)), at: places.map(([a, b]) => rbfAt(fit, a, b)),
        jacobian: places.map(([a, b]) => rbfJacobianAt(fit, a, b)) }; }"""


def scattered(own_radii: bool) -> ControlPoints:
    rng = np.random.default_rng(1)
    source = np.stack(np.meshgrid(np.linspace(40, 460, 4), np.linspace(40, 400, 3)), axis=-1).reshape(-1, 2)
    source += rng.uniform(-30, 30, source.shape)
    return ControlPoints.from_arrays(
        source,
        source + rng.normal(0, 14, source.shape),
        radius=rng.uniform(60, 240, len(source)) if own_radii else None,
    )


@pytest.fixture(autouse=True, scope="module")
def _registered() -> Iterator[None]:
    register_kernel(lambda rho: jnp.exp(-4.5 * rho**2), name="bell", shares=KERNELS["gaussian"].shares, gaps=2.0)
    register_kernel(lambda rho: (1 - rho) ** 4 * (4 * rho + 1), name="own_wendland", compact=True, gaps=16.0)
    register_kernel(lambda rho: rho**2 * jnp.log(rho), name="own_plate", order=2)
    register_kernel(lambda rho: (1 + 6 * rho + 12 * rho**2) * jnp.exp(-6 * rho), name="matern")
    yield
    for name in set(KERNELS) - BUILT_IN:
        del KERNELS[name]


def test_a_table_is_as_near_to_its_function_as_it_says() -> None:
    """Beside mpmath's own values, from next to the point to beyond the last piece."""
    formulas = {
        "bell": lambda r: mpmath.exp(-4.5 * r**2),
        "own_plate": lambda r: r**2 * mpmath.log(r),
        "own_wendland": lambda r: (1 - r) ** 4 * (4 * r + 1) if r < 1 else mpmath.mpf(0),
    }
    rho = np.concatenate([[1e-9, 1e-7], np.geomspace(1e-6, 1e6, 400), np.linspace(0.3, 1.3, 300)])
    main = """([tables, s]) => tables.map((table) => { const { profile, slope } = kernelOfTable(table);
        return [profile(0), s.map(profile), s.map(slope)]; })"""
    found = run_script(FILES, main, [[table_for_client(name) for name in formulas], (rho**2).tolist()])
    with mpmath.workdps(30):
        for (name, formula), (at0, phi, slope) in zip(formulas.items(), found, strict=True):
            table = kernel_table(KERNELS[name])
            assert max(table.error, table.slope_error) < 1e-12
            wanted = np.array([float(formula(mpmath.mpf(r))) for r in rho])
            rise = np.array([float(mpmath.diff(formula, mpmath.mpf(r))) for r in rho])
            assert at0 == pytest.approx(float(formula(mpmath.mpf("1e-15"))), abs=1e-15)
            size, steep = np.maximum(1, np.abs(wanted)), np.maximum(1, np.abs(rise))
            # Twice, for between the places where the error was looked for; 1e-11 nearer than the first piece.
            assert (np.abs(np.array(phi) - wanted) <= np.where(rho < 2**-20, 1e-10, 2e-12) * size).all()
            assert (np.abs(2 * rho * np.array(slope) - rise) <= np.where(rho < 2**-20, 1e-4, 2e-12) * steep).all()


def test_a_kink_is_found_and_its_error_stated() -> None:
    class Kinked(AbstractKernel):
        name, title, compact = "kinked", "Kinked", True

        @staticmethod
        def profile(s):
            return jnp.where(s < 0.3, 2.0 - s, jnp.maximum(0.0, 1 - s) * 1.7 / 0.7)

    table = kernel_table(Kinked)
    assert table.error < 1e-8
    assert table.slope_error > 0.1  # beside the kink it is that of the other side


@pytest.mark.parametrize(
    ("name", "trend", "built_in"),
    [
        ("own_wendland", "similarity", "wendland_c2"),
        ("own_plate", "affine", "thin_plate"),
        pytest.param("bell", "affine", "gaussian", marks=pytest.mark.nightly),
        pytest.param("matern", "rigid", None, marks=pytest.mark.nightly),
    ],
)
def test_a_page_fits_with_a_registered_kernel_as_python_does(name: str, trend: str, built_in: str | None) -> None:
    points = scattered(own_radii=name == "own_wendland")
    settings = {"trend": trend, "support": 260.0, "kernel": name}
    raster = {"shape": RASTER.shape, "spacing": RASTER.spacing, "origin": RASTER.origin}
    answer = run_script(
        FILES,
        MAIN,
        {
            "points": points_to_json(points),
            "raster": raster,
            "places": PLACES,
            "settings": {**settings, "kernel_table": table_for_client(name)},
        },
    )
    fit = fit_rbf(points, kernel=built_in or name, trend=trend, support=260.0)
    # The table's error times the condition of the system.
    assert np.abs(np.array(answer["at"]) - fit.displacement(PLACES)).max() < 1e-9
    assert np.abs(np.array(answer["jacobian"]) - fit.jacobian(np.array(PLACES))).max() < 1e-9
    oracle = fit.displacement(RASTER.points())
    assert np.abs(np.array(answer["map"]).reshape(oracle.shape) - oracle).max() < 1e-5  # of float32


def test_a_kernel_that_is_registered_again_takes_the_place_of_the_first() -> None:
    first = table_for_client("matern")
    register_kernel(lambda rho: jnp.exp(-3 * rho), name="matern")
    tables = [first, table_for_client("matern")]
    main = """(tables) => tables.map((kernel_table) => {
        rbfKernelOf({ kernel: kernel_table.name, kernel_table });
        return RBF_KERNELS[kernel_table.name].profile(0.25); })"""
    assert run_script(FILES, main, tables) == pytest.approx([7 * np.exp(-3), np.exp(-1.5)], abs=1e-12)
