"""The warp within compiled functions: equal to the warp outside, and differentiated by JAX."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.rbf.fields import DisplacementField
from deformnb.volume.volume import Grid, Volume
from deformnb.warping import xla_call
from deformnb.warping.array_warp import warp_array
from deformnb.warping.warper import warp

GRID = Grid((9, 11, 13), (0.8, 1.0, 1.5), (3.0, -2.0, 1.0))
TURNED = Grid((7, 8, 6), (1.5, 1.2, 1.1), (4.0, -1.0, 2.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
LEVELS = ("off", *library.levels())


@pytest.fixture(params=LEVELS)
def level(request: pytest.FixtureRequest) -> Iterator[str]:
    before = library.use_level(request.param)
    yield request.param
    library.use_level(before)


def case(dtype: str, output: Grid) -> tuple[NDArray[Any], NDArray[np.float32]]:
    rng = np.random.default_rng(3)
    values = rng.integers(0, 100, GRID.shape).astype(dtype)
    return values, rng.normal(0, 1.5, (3, *output.shape)).astype(np.float32)


@pytest.mark.parametrize("output", [GRID, TURNED], ids=["straight", "turned"])
@pytest.mark.parametrize("method", ["linear", "nearest"])
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_within_jit_voxels_are_those_of_a_warp(level: str, dtype: str, method: str, output: Grid) -> None:
    values, d = case(dtype, output)
    assert xla_call.can_call() == (level != "off")
    found = jax.jit(lambda v, d: warp_array(v, d, GRID, output=output, fill=7, method=method))(values, d)
    field = DisplacementField(np.moveaxis(d, 0, -1), output)
    wanted = warp(Volume(values, GRID), field, output=output, fill=7, method=method).values
    assert found.dtype == values.dtype
    if dtype == "float32":
        np.testing.assert_allclose(found, wanted, atol=1e-4)
    else:
        assert np.abs(np.asarray(found).astype(int) - wanted).max() <= 1
        assert (np.asarray(found) != wanted).mean() < 1e-2


def test_the_custom_call_is_compiled_in_where_there_are_loops(level: str) -> None:
    values, d = case("uint8", GRID)
    text = jax.jit(lambda v, d: warp_array(v, d, GRID)).lower(values, d).as_text()
    assert ("deformnb_general" in text) == (level != "off")


def test_derivatives_are_those_of_linear_interpolation(level: str) -> None:
    values, rng = case("float32", GRID)[0], np.random.default_rng(5)
    weight = rng.normal(size=GRID.shape).astype(np.float32)
    sides = np.reshape(GRID.spacing, (3, 1, 1, 1))
    # A tenth of a voxel at least from where the cell changes, or a place leaves the volume.
    cells = rng.integers(-2, 3, (3, *GRID.shape)) + rng.uniform(0.1, 0.4, (3, *GRID.shape))
    d = (cells * sides).astype(np.float32)
    along = (rng.uniform(-1, 1, d.shape) * sides).astype(np.float32)

    def loss(v: Any, d: Any) -> Any:
        return (weight * warp_array(v, d, GRID)).sum()

    slope = float((jax.grad(loss, 1)(values, d) * along).sum())
    np.testing.assert_allclose(
        float((jax.grad(loss, 0)(values, d) * values).sum()), float(loss(values, d) - loss(0 * values, d)), rtol=1e-4
    )
    h = 0.02
    numeric = (loss(values, d + h * along) - loss(values, d - h * along)) / (2 * h)
    assert abs(slope) > 100
    assert abs(slope - float(numeric)) < 1e-3 * abs(slope)


def test_integers_have_no_slope() -> None:
    values, d = case("uint8", GRID)
    _, slope = jax.jvp(lambda d: warp_array(values, d, GRID).astype(jnp.float32), (d,), (np.ones_like(d),))
    assert not np.asarray(slope).any()


def test_a_batch_is_warped_one_by_one(level: str) -> None:
    values, d = case("float32", GRID)
    scales = jnp.array([0.0, 0.5, 1.0])
    batch = jax.jit(jax.vmap(lambda s: warp_array(values, s * d, GRID)))(scales)
    for s, found in zip(scales, batch, strict=True):
        np.testing.assert_allclose(found, warp_array(values, s * d, GRID), atol=1e-5)


def test_a_displacement_that_is_not_finite_leads_outside(level: str) -> None:
    values, d = case("uint8", GRID)
    d[0, 2, 3, 4], d[1, 2, 3, 5], d[2, 2, 3, 6] = np.nan, np.inf, -np.inf
    with jax.debug_nans(False):
        assert np.asarray(warp_array(values, d, GRID, fill=200))[2, 3, 5:7].tolist() == [200, 200]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.zeros((2, 2, 2), np.uint8)}, "do not fit"),
        ({"displacements": np.zeros((*GRID.shape, 3))}, "do not fit"),
        ({"values": np.zeros(GRID.shape, np.int32)}, "type int32"),
        ({"method": "cubic"}, "method must be"),
        ({"fill": 300}, "fill"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    values, d = case("uint8", GRID)
    given: dict[str, Any] = {"values": values, "displacements": d, "grid": GRID} | change
    with pytest.raises(DeformError, match=message):
        warp_array(**given)


@pytest.mark.skipif(library.level() == "off", reason="no compiled loops are in use")
@pytest.mark.parametrize("wrong", range(11))
def test_operands_that_do_not_fit_are_refused_by_the_custom_call(wrong: int) -> None:
    assert xla_call.can_call()
    n = (2, 3, 4)
    operands: list[Any] = [
        np.zeros(n, np.uint8),
        np.zeros((3, *n), np.float32),
        *[np.zeros((3, 2 * k), np.uint32) for k in n],
        *[np.zeros((3, 2 * k), np.uint32) for k in n],
        np.zeros(18, np.uint32),
        np.zeros(1, np.uint8),
        np.array([1, 0, 0], np.int32),
    ]
    call = jax.ffi.ffi_call("deformnb_general", jax.ShapeDtypeStruct(n, np.uint8))
    np.testing.assert_array_equal(call(*operands), np.zeros(n))
    operands[wrong] = operands[wrong][..., :-1].copy() if wrong else np.zeros(n, np.uint32)
    with pytest.raises(jax.errors.JaxRuntimeError, match="do not fit"):
        call(*operands).block_until_ready()


@pytest.mark.parametrize("header", [None, "", "#define XLA_FFI_API_MAJOR 0"])
def test_a_jaxlib_without_a_version_of_its_structures_is_not_called(
    header: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if header is not None:
        (tmp_path / "xla/ffi/api").mkdir(parents=True)
        (tmp_path / "xla/ffi/api/c_api.h").write_text(header, encoding="utf-8")
    monkeypatch.setattr(jax.ffi, "include_dir", lambda: str(tmp_path))
    xla_call.read_version.cache_clear()
    try:
        assert not xla_call.can_call()
        values, d = case("uint8", GRID)
        assert warp_array(values, d, GRID).shape == GRID.shape
    finally:
        xla_call.read_version.cache_clear()
