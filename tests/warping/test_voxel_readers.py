"""Compiled loops and JAX read the same voxels: random warps of every voxel type by every method, at every level."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.volume.sampling import METHODS
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.voxel_readers import CompiledReader, JaxReader, VoxelInput, make_reader

pytestmark = pytest.mark.skipif(not library.levels(), reason=f"no compiled loops: {library.why_absent()}")

DTYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
SOURCE, OUTPUT = (5, 11, 37), (7, 9, 300)  # a row of the output is longer than what the loops read at a time


@pytest.fixture(autouse=True)
def _use_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEFORMNB_NATIVE", raising=False)


WARPS = 4  # of each case; by night there are as many cases as in the table


def random_input(rng: np.random.Generator, dtype: str, method: str, *, exact: bool, source: Any = SOURCE) -> VoxelInput:
    """Random voxels, seen by a rotated and scaled output.

    exact : turned by right angles, with steps that are powers of two, so that no sum of places is rounded.
    """
    kind = np.dtype(dtype)
    if kind.kind in "iu":
        limits = np.iinfo(kind)
        values = rng.integers(limits.min, limits.max, source, endpoint=True, dtype=kind)
    else:
        values = rng.normal(size=source).astype(kind)
    if exact:
        turn = np.eye(3)[rng.permutation(3)] * rng.choice([-1, 1], 3)[:, None]
        spacing = tuple(0.5 ** rng.integers(0, 4, 3))
        origin = rng.integers(-8, 80, 3) / 4
    else:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        spacing = tuple(rng.uniform(0.1, 2, 3))
        origin = rng.normal(0, 5, 3)
    inner = Grid(source, (1.0, 0.5, 2.0))
    outer = Grid(OUTPUT, spacing, tuple(origin.tolist()), tuple(map(tuple, turn.tolist())))
    compute = VoxelInput(values, None, method, None).compute  # type: ignore[arg-type]
    return VoxelInput(values, planning.places(inner, outer, compute), method, kind.type(7))


def random_moves(rng: np.random.Generator, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], ...]:
    """Displacements x, y, z in steps of 2^-7, some far beyond the volume."""
    d = rng.integers(-1000, 1000, (3, *shape)) / 128
    d[:, rng.random(shape) < 0.02] *= 1000
    return tuple(d.astype(np.float32))


def read_everything(reader: Any, d: tuple[NDArray[Any], ...], rng: np.random.Generator) -> list[NDArray[Any]]:
    """A block, a block between nodes, and single voxels."""
    block = (slice(1, 6), slice(2, 9))
    out = np.zeros((5, 7, OUTPUT[2]), reader.dtype)
    inner = tuple(np.ascontiguousarray(component[block]) for component in d)
    whole = reader.read_block(out.copy(), block, inner, None)
    nodes = (
        (np.array([0, 0, 1, 1, 2], np.int32), rng.integers(0, 8, (2, 5)).astype(np.float32) / 8),
        (np.array([0, 0, 0, 1, 1, 2, 2], np.int32), rng.integers(0, 8, (4, 7)).astype(np.float32) / 8),
        (np.arange(OUTPUT[2], dtype=np.int32) // 3, rng.integers(0, 8, (2, OUTPUT[2])).astype(np.float32) / 8),
    )
    between = reader.read_block(out.copy(), block, tuple(component[:4, :6] for component in d), nodes)
    voxels = tuple(rng.integers(0, n, 400).astype(np.int32) for n in OUTPUT)
    return [whole, between, reader.read_voxels(voxels, [component[voxels] for component in d])]


class _Reader:
    """A reader with the type of its voxels."""

    def __init__(self, make: Callable[[VoxelInput], Any], source: VoxelInput) -> None:
        self._reader, self.dtype = make(source), source.values.dtype

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)


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
                read_everything(_Reader(make, source), d, np.random.default_rng(seed))
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
            results.append(read_everything(_Reader(CompiledReader, source), d, np.random.default_rng(0)))
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
    shape = (70, 21, 67) if normal == 0 else (21, 70, 67)
    values = random_input(rng, dtype, method, exact=True, source=shape).values
    source, output = Grid(shape), Grid((shape[0] - 2, shape[1] - 2, shape[2] - 2), origin=(1.0, 1.0, 1.0))
    across = [n for axis, n in enumerate(output.shape) if axis != normal]
    maps = (rng.integers(-1000, 1000, (2, 2, *across)) / 128).astype(np.float32)
    weights = rng.integers(-4, 4, (2, output.shape[normal])).astype(np.float32) / 4
    plan = planning.Extruded(
        normal,
        maps if modulated else maps[:1],
        weights if modulated else None,
        np.insert([[0.0, 1.0], [1.0, 0.0]], normal, 0, axis=0).astype(np.float32),
    )
    compute = VoxelInput(values, None, method, None).compute  # type: ignore[arg-type]
    given = VoxelInput(values, planning.places(source, output, compute), method, values.dtype.type(3))
    results = []
    for make in (CompiledReader, JaxReader):
        reader: Any = make(given)
        if prepared:
            reader.prepare(normal)
        results.append(reader.read_extruded(plan, lambda parts, work: [work(part) for part in parts]))
    assert compare(*results, method) <= ROUNDED_OTHERWISE.get(dtype, 0)


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
                read_everything(_Reader(make, source), d, np.random.default_rng(0))
                for make in (CompiledReader, JaxReader)
            )
            for own, other in zip(found, wanted, strict=True):
                compare(own, other, method)


def test_without_loops_jax_reads() -> None:
    source = random_input(np.random.default_rng(0), "uint8", "linear", exact=False)
    assert isinstance(make_reader(source), CompiledReader)
    before = library.use_level("off")
    try:
        assert isinstance(make_reader(source), JaxReader)
    finally:
        library.use_level(before)
