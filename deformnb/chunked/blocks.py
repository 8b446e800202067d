"""Blocks of a result: the part of the source that each one needs, and its voxels.

All blocks have one shape, and so have the parts of the source that they are computed from, so that one compilation
serves all: the last block along an axis begins earlier, and a smaller part fills an array as large as the largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import jax
from deformnb._typing import Progress, VoxelSlices
from deformnb.chunked.sources import ChunkCache, LargeVolume
from deformnb.errors import DeformError
from deformnb.io.files.errors import human_bytes
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.volume.sampling import METHODS, SamplingName, aligned_empty
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.planning import shared_axis
from deformnb.warping.reach import DisplacementBounds, source_part
from deformnb.warping.warper import Warper

Shape = tuple[int, int, int]

# Bytes for each voxel of a block besides its own: displacements along x, y, z in float32, twice while they are passed
# on, and as much again for the temporary arrays of the fit.
_WORKING_BYTES = 48

# Blocks are not made smaller than this to save memory: each one costs some milliseconds.
_FEWEST_VOXELS = 2**12


@dataclass(frozen=True)
class Blocks:
    """A grid divided into blocks of one shape; the last ones along an axis may be smaller."""

    shape: Shape
    block: Shape

    @property
    def counts(self) -> Shape:
        """Blocks along z, y, x."""
        nz, ny, nx = (-(-n // b) for n, b in zip(self.shape, self.block, strict=True))
        return nz, ny, nx

    def __len__(self) -> int:
        return math.prod(self.counts)

    def part(self, number: int) -> VoxelSlices:
        """The voxels of a block."""
        at = np.unravel_index(number, self.counts)
        z, y, x = (
            slice(int(k) * b, min(n, (int(k) + 1) * b)) for k, b, n in zip(at, self.block, self.shape, strict=True)
        )
        return z, y, x


def part_shape(part: VoxelSlices) -> Shape:
    """Voxels of a part along z, y, x."""
    z, y, x = (s.stop - s.start for s in part)
    return z, y, x


@dataclass(frozen=True, eq=False)
class BlockWarp:
    """The warp of a large volume, block by block; :func:`plan_blocks` makes it. It can be sent to other processes.

    Parameters
    ----------
    source, field, output, method, fill : as of :func:`deformnb.warp`.
    background : what NaN and infinity count as.
    blocks : of the result.
    parts : of the source that each block needs, None where it shows nothing of it.
    window : the shape of the largest of them along each axis.
    cache : of chunks of the source.
    """

    source: LargeVolume
    field: AbstractField
    output: Grid
    method: SamplingName
    fill: float
    background: float
    blocks: Blocks
    parts: tuple[VoxelSlices | None, ...]
    window: Shape
    cache: ChunkCache

    def __call__(self, number: int) -> NDArray[Any]:
        """The voxels of one block of the result."""
        wanted, part = self.blocks.part(number), self.parts[number]
        if part is None:
            return np.full(part_shape(wanted), self.fill, self.source.dtype)
        start = [min(s.start, n - b) for s, n, b in zip(wanted, self.output.shape, self.blocks.block, strict=True)]
        grid = self.output.crop((start[0], start[1], start[2]), self.blocks.block)
        warper = Warper(self.window_volume(part), output=grid, fill=self.fill, method=self.method)
        if isinstance(self.field, Extrusion) and self.field.is_replication:
            axis = shared_axis(self.field.plane, warper.volume.grid, grid)
            if axis is not None:  # two copies in another order, and still half the time
                warper.prepare(axis)
        inner = tuple(slice(s.start - first, s.stop - first) for s, first in zip(wanted, start, strict=True))
        return np.ascontiguousarray(warper(self.field).values[inner])

    def window_volume(self, part: VoxelSlices) -> Volume:
        """A part of the source in an array as large as all have; it touches the source's border where that does."""
        z, y, x = (min(s.start, n - w) for s, n, w in zip(part, self.source.shape, self.window, strict=True))
        values = aligned_empty(self.window, self.source.dtype)
        inner = tuple(slice(s.start - first, s.stop - first) for s, first in zip(part, (z, y, x), strict=True))
        if part_shape(part) != self.window:
            values[...] = 0  # never sampled
        self.cache.read_into(part, values[inner])
        if values.dtype.kind == "f":
            np.copyto(values, self.background, where=~np.isfinite(values))
        return Volume(values, self.source.grid.crop((z, y, x), self.window), is_labels=self.source.is_labels)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that it holds: a source in memory, the samples of a field."""
        leaves = [getattr(self.source.reader, "array", None), *jax.tree_util.tree_leaves(self.field)]
        return sum(leaf.nbytes for leaf in leaves if isinstance(leaf, np.ndarray | jax.Array))

    @property
    def bytes_each(self) -> int:
        """About the most memory that one block takes while it is computed."""
        return _bytes(self.source, self.method, self.blocks.block, self.window)


def _bytes(source: LargeVolume, method: SamplingName, block: Shape, window: Shape) -> int:
    item = source.dtype.itemsize
    spline = 3 * max(4, item) if METHODS[method].is_spline else 0
    return math.prod(window) * (3 * item + spline) + math.prod(block) * (2 * item + _WORKING_BYTES)


def plan_blocks(
    source: LargeVolume,
    field: AbstractField,
    output: Grid,
    *,
    method: SamplingName,
    fill: float,
    background: float,
    block: Shape,
    memory: int,
    workers: int,
    processes: int = 1,
    progress: Progress | None = None,
) -> tuple[BlockWarp, int]:
    """The blocks of a warp, and how many may be computed concurrently within the memory.

    Parameters
    ----------
    block : the largest shape of a block; halved until one at a time fits.
    memory : bytes that all concurrent blocks may take; the rest is for chunks of the source that are
        read again for other blocks.
    workers : maximum number of concurrent blocks.
    processes : that share the work and the memory.

    Raises
    ------
    DeformError
        If not even small blocks fit, because the displacements of neighbours lead far apart.
    """
    bounds = DisplacementBounds(field, min(output.spacing))
    nz, ny, nx = (min(b, n) for b, n in zip(block, output.shape, strict=True))
    block = nz, ny, nx
    while True:
        blocks = Blocks(output.shape, block)
        found = _parts(blocks, lambda grid: source_part(bounds, field, grid, source.grid, method), output, progress)
        sizes = np.array([part_shape(part) for part in found if part is not None] or [(1, 1, 1)])
        window: Shape = tuple(int(n) for n in sizes.max(axis=0))  # type: ignore[assignment]
        needed = _bytes(source, method, block, window)
        if needed <= memory:
            at_once = max(1, min(workers, memory // needed))
            cache = ChunkCache(source, (memory - at_once * needed) // processes)
            return BlockWarp(
                source, field, output, method, fill, background, blocks, tuple(found), window, cache
            ), at_once
        if math.prod(block) <= _FEWEST_VOXELS:
            raise DeformError(
                f"a block of {' x '.join(map(str, block[::-1]))} voxels needs {human_bytes(needed)}, as "
                f"its displacements lead far apart, and memory allows {human_bytes(memory)}; allow more."
            )
        axis = int(np.argmax(block))
        block = tuple(-(-b // 2) if k == axis else b for k, b in enumerate(block))  # type: ignore[assignment]


def _parts(
    blocks: Blocks, find: Callable[[Grid], VoxelSlices | None], output: Grid, progress: Progress | None
) -> list[VoxelSlices | None]:
    found = []
    for number in range(len(blocks)):
        part = blocks.part(number)
        first = [min(s.start, n - b) for s, n, b in zip(part, blocks.shape, blocks.block, strict=True)]
        # All computed voxels count, also those that the last block shares with the one before.
        found.append(find(output.crop((first[0], first[1], first[2]), blocks.block)))
        if progress is not None and number % 64 == 0:
            progress(0.0)
    return found
