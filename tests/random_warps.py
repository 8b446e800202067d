"""Random warps, by which the compiled loops are compared with JAX, one another and those of other processors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.voxel_readers import VoxelInput

DTYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
SOURCE, OUTPUT = (5, 11, 37), (7, 9, 300)  # a row of the output is longer than what the loops read at a time


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


class TypedReader:
    """A reader with the type of its voxels."""

    def __init__(self, make: Callable[[VoxelInput], Any], source: VoxelInput) -> None:
        self._reader, self.dtype = make(source), source.values.dtype

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)


def random_extrusion(
    rng: np.random.Generator, dtype: str, method: str, normal: int, *, modulated: bool
) -> tuple[VoxelInput, planning.Extruded]:
    """Random voxels, and random maps in the slices across an array axis."""
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
    return given, plan


def read_extrusion(
    make: Callable[[VoxelInput], Any], given: VoxelInput, plan: planning.Extruded, *, prepared: bool
) -> NDArray[Any]:
    """The voxels of a random extrusion."""
    reader = make(given)
    if prepared:
        reader.prepare(plan.normal)
    read: NDArray[Any] = reader.read_extruded(plan, lambda parts, work: [work(part) for part in parts])
    return read
