"""Compiled loops and JAX read the same voxels: random warps of every voxel type by every method, at every level."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from random_warps import (
    DTYPES,
    OUTPUT,
    SOURCE,
    TypedReader,
    random_extrusion,
    random_input,
    random_moves,
    read_everything,
    read_extrusion,
)

from deformnb import devices
from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.volume.sampling import METHODS
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.voxel_readers import CompiledReader, JaxReader, VoxelInput, make_reader

pytestmark = pytest.mark.skipif(not library.levels(), reason=f"no compiled loops: {library.why_absent()}")


@pytest.fixture(autouse=True)
def _use_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEFORMNB_NATIVE", raising=False)


WARPS = 4  # of each case
AT_NIGHT = 477  # of each type by each method: ten thousand in all


def compare(found: NDArray[Any], wanted: NDArray[Any], method: str) -> float:
    """The share of voxels that differ; within what rounding explains."""
    assert found.dtype == wanted.dtype
    assert found.shape == wanted.shape
    if not METHODS[method].blends:
        np.testing.assert_array_equal(found, wanted)
        return 0.0
    if found.dtype.kind == "f":
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=scale * (1e-6 if found.dtype == np.float32 else 1e-13))
        return 0.0
    assert np.abs(found.astype(np.int64) - wanted.astype(np.int64)).max() <= 1
    return float((found != wanted).mean())


# The share of voxels whose rounding may differ: what lies within a rounding of float32 of the middle between two whole
# numbers, as many as the range of the values has units of float32.
ROUNDED_OTHERWISE = {"uint8": 1e-4, "int8": 1e-4, "uint16": 3e-2, "int16": 3e-2, "int32": 1e-6}


@pytest.mark.parametrize("level", library.levels())
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_compiled_loops_read_what_jax_reads(dtype: str, method: str, level: str) -> None:
    rng = np.random.default_rng([DTYPES.index(dtype), list(METHODS).index(method)])
    shares, before = [], library.use_level(level)
    try:
        for _ in range(WARPS):
            source = random_input(rng, dtype, method, exact=True)
            d, seed = random_moves(rng, OUTPUT), int(rng.integers(1000))
            results = [
                read_everything(TypedReader(make, source), d, np.random.default_rng(seed))
                for make in (CompiledReader, JaxReader)
            ]
            shares += [compare(found, wanted, method) for found, wanted in zip(*results, strict=True)]
    finally:
        library.use_level(before)
    assert np.mean(shares) <= ROUNDED_OTHERWISE.get(dtype, 0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_all_levels_give_the_same_voxels(dtype: str, method: str) -> None:
    rng = np.random.default_rng(5)
    source, d = random_input(rng, dtype, method, exact=False), random_moves(rng, OUTPUT)
    results = []
    for level in library.levels():
        before = library.use_level(level)
        try:
            results.append(read_everything(TypedReader(CompiledReader, source), d, np.random.default_rng(0)))
        finally:
            library.use_level(before)
    for others in results[1:]:
        for found, wanted in zip(others, results[0], strict=True):
            np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("prepared", [False, True])
@pytest.mark.parametrize("modulated", [False, True])
@pytest.mark.parametrize("method", ["nearest", "linear"])
@pytest.mark.parametrize("normal", [0, 1, 2])
@pytest.mark.parametrize("dtype", DTYPES)
def test_extruded_maps(dtype: str, normal: int, method: str, modulated: bool, prepared: bool) -> None:
    rng = np.random.default_rng([DTYPES.index(dtype), normal])
    given, plan = random_extrusion(rng, dtype, method, normal, modulated=modulated)
    results = [read_extrusion(make, given, plan, prepared=prepared) for make in (CompiledReader, JaxReader)]
    assert compare(*results, method) <= ROUNDED_OTHERWISE.get(dtype, 0)


@pytest.mark.nightly
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_ten_thousand_random_warps(dtype: str, method: str) -> None:
    """All levels give the same voxels, and those of JAX where no sum of places is rounded."""
    seed = np.random.SeedSequence().entropy
    try:
        _compare_random_warps(np.random.default_rng(seed), dtype, method)
    except AssertionError as error:
        error.add_note(f"with the seed {seed}")
        raise


def _compare_random_warps(rng: np.random.Generator, dtype: str, method: str) -> None:
    shares = []
    shapes = [SOURCE, SOURCE, (1, 5, 6), (4, 1, 6), (4, 5, 1)]
    for _ in range(AT_NIGHT):
        exact, in_slices = rng.random(2) < 0.5
        own = int(rng.integers(2**32))
        if in_slices:
            normal, modulated, prepared = int(rng.integers(3)), *(rng.random(2) < 0.5)
            case = random_extrusion(rng, dtype, method, normal, modulated=modulated)
            exact = True

            def read(make: Any) -> list[NDArray[Any]]:
                return [read_extrusion(make, *case, prepared=prepared)]  # noqa: B023
        else:
            source = random_input(rng, dtype, method, exact=exact, source=shapes[rng.integers(len(shapes))])
            d = random_moves(rng, OUTPUT)

            def read(make: Any) -> list[NDArray[Any]]:
                return read_everything(TypedReader(make, source), d, np.random.default_rng(own))  # noqa: B023

        results = []
        for level in library.levels():
            before = library.use_level(level)
            try:
                results.append(read(CompiledReader))
            finally:
                library.use_level(before)
        for others in results[1:]:
            for found, wanted in zip(others, results[0], strict=True):
                np.testing.assert_array_equal(found, wanted)
        if exact:
            shares += [compare(*pair, method) for pair in zip(results[0], read(JaxReader), strict=True)]
    assert np.mean(shares) <= ROUNDED_OTHERWISE.get(dtype, 0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", ["uint8", "float64"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38, -3e38])
def test_places_that_are_no_numbers_are_outside(value: float, dtype: str, method: str) -> None:
    source = random_input(np.random.default_rng(0), dtype, method, exact=False)
    reader, out = CompiledReader(source), np.zeros(OUTPUT, dtype)
    block, d = (slice(0, OUTPUT[0]), slice(0, OUTPUT[1])), (np.full(OUTPUT, value, np.float32),) * 3
    with pytest.raises(DeformError, match="not finite"):
        reader.read_block(out, block, d, None)
    assert (out == 7).all()
    voxels = tuple(np.zeros(3, np.int32) for _ in OUTPUT)
    assert (reader.read_voxels(voxels, [component[voxels] for component in d]) == 7).all()


def test_a_volume_of_one_voxel_along_any_axes() -> None:
    rng = np.random.default_rng(3)
    for shape in ((1, 1, 1), (1, 5, 6), (4, 1, 6), (4, 5, 1), (2, 2, 2), (3, 1, 1)):
        for method in METHODS:
            source = random_input(rng, "float32", method, exact=True, source=shape)
            d = random_moves(rng, OUTPUT)
            found, wanted = (
                read_everything(TypedReader(make, source), d, np.random.default_rng(0))
                for make in (CompiledReader, JaxReader)
            )
            for own, other in zip(found, wanted, strict=True):
                compare(own, other, method)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 6), (4, 1, 6), (4, 5, 1), (3, 4, 5)])
def test_nothing_beside_the_voxels_is_read(shape: tuple[int, int, int]) -> None:
    """A value that is not a number shows even with a weight of zero."""
    rng, size = np.random.default_rng(6), int(np.prod(shape))
    memory = np.full(3 * size, np.nan, np.float32)
    memory[size : 2 * size] = rng.normal(size=size)
    values = memory[size : 2 * size].reshape(shape)
    source = replace(random_input(rng, "float32", "linear", exact=True, source=shape), values=values)
    results = read_everything(TypedReader(CompiledReader, source), random_moves(rng, OUTPUT), rng)
    grid = Grid(shape)
    for normal in range(3):
        maps = rng.uniform(-1, 1, (1, 2, *np.delete(shape, normal))).astype(np.float32)
        matrix = np.insert([[0.0, 1.0], [1.0, 0.0]], normal, 0, axis=0).astype(np.float32)
        given = VoxelInput(values, planning.places(grid, grid, source.compute), "linear", values.dtype.type(3))
        for weights in (None, np.ones((1, shape[normal]), np.float32)):
            plan = planning.Extruded(normal, maps, weights, matrix)
            results += [read_extrusion(CompiledReader, given, plan, prepared=prepared) for prepared in (False, True)]
    assert all(np.isfinite(result).all() for result in results)


def test_without_loops_jax_reads() -> None:
    source = random_input(np.random.default_rng(0), "uint8", "linear", exact=False)
    assert isinstance(make_reader(source), CompiledReader if devices.is_host() else JaxReader)
    before = library.use_level("off")
    try:
        assert isinstance(make_reader(source), JaxReader)
    finally:
        library.use_level(before)
