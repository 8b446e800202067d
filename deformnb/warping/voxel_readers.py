"""Readers of a volume at displaced places: compiled loops on a processor, JAX on a GPU and where no loops are built.

Where JAX is not installed either, NumPy reads the same voxels by the same operations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._jax import as_numpy
from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.native.jobs import TRANSPOSED_SLICES
from deformnb.native.source import NotFiniteError, VoxelSource
from deformnb.rbf.evaluation import few_sizes
from deformnb.volume import sampling
from deformnb.volume.sampling import METHODS
from deformnb.warping import planning
from deformnb.warping.planning import BlockSlices, Places, Tables
from deformnb.warping.result_memory import ResultMemory

RunParts = Callable[[Any, Callable[[Any], None]], None]
"""Does the work for all parts, on several threads."""


@dataclass(frozen=True, eq=False)
class VoxelInput:
    """The voxels of a volume and the places where an output reads them.

    Parameters
    ----------
    values : finite voxels [z, y, x]; bool as uint8.
    places : of the output's voxels, before any displacement.
    method : a name of :data:`~deformnb.volume.sampling.METHODS`.
    fill : the voxel of places outside.
    memory : of the results.
    """

    values: NDArray[Any]
    places: Places
    method: str
    fill: Any
    memory: ResultMemory = field(default_factory=ResultMemory)

    @cached_property
    def compute(self) -> str:
        """The type of arithmetic."""
        return sampling.compute_type(self.values.dtype)

    @cached_property
    def samples(self) -> NDArray[Any]:
        """The voxels, or the coefficients of the spline through them."""
        if METHODS[self.method].is_spline:
            return sampling.spline_coefficients(self.values, self.compute)
        return self.values


# Single voxels that JAX reads are a multiple of this.
_LISTED = 2**12


class VoxelReader(Protocol):
    """Reading of the voxels of one :class:`VoxelInput`. All may be called from several threads at once."""

    def load(self) -> None:
        """Prepare the samples, before threads share them."""

    def prepare(self, axis: int) -> None:
        """Make replicated edits along an array axis as fast as they can be, at the cost of a copy."""

    def read_block(
        self, out: NDArray[Any], block: Sequence[slice], d: tuple[Any, ...], nodes: Tables | None
    ) -> NDArray[Any]:
        """The voxels of a block whose displacements are known, at all voxels or at nodes; in ``out`` or elsewhere."""

    def read_voxels(self, voxels: Any, d: Any, matrix: NDArray[Any] | None = None) -> NDArray[Any]:
        """Single voxels (n,) at indices z, y, x under displacements (3, n), which ``matrix`` leads to input voxels."""

    def read_extruded(self, plan: planning.Extruded, run: RunParts) -> NDArray[Any]:
        """All voxels under an extruded map."""


def make_reader(source: VoxelInput) -> VoxelReader:
    """The fastest reader on the device in use."""
    loops = library.loops() if devices.is_host() else None
    plane = source.values.shape[1] * source.values.shape[2]
    return JaxReader(source) if loops is None or plane > sampling.LARGEST_INT32 else CompiledReader(source)


class CompiledReader:
    """Reads by compiled loops, in the memory of the volume and of the result."""

    def __init__(self, source: VoxelInput) -> None:
        self._input = source
        self._turned: dict[int, VoxelSource] = {}  # of the prepared axes z and y, with that axis last in memory

    @cached_property
    def _source(self) -> VoxelSource:
        return self._make(self._input.samples, (0, 1, 2))

    def _make(self, samples: NDArray[Any], order: tuple[int, ...]) -> VoxelSource:
        """Samples whose axes come in another order, so that the tables must."""
        source, at, axes = self._input, self._input.places, list(order)
        loops = library.loops()
        assert loops is not None
        return VoxelSource(
            loops,
            samples,
            source.values.dtype,
            source.method,
            source.fill,
            [at.whole[o][axes] for o in order],
            [at.part[o][axes] for o in order],
            at.matrix,
            is_near=at.is_near(source.values.shape) and source.values.size <= sampling.LARGEST_INT32,
            is_straight=at.is_straight,
        )

    def load(self) -> None:
        """Prepare the samples, before threads share them."""
        _ = self._source

    def prepare(self, axis: int) -> None:
        """Copy the voxels with an array axis last in memory."""
        if axis < 2 and axis not in self._turned:
            order = (*(a for a in range(3) if a != axis), axis)
            self._turned[axis] = self._make(np.ascontiguousarray(self._input.samples.transpose(order)), order)

    def read_block(
        self, out: NDArray[Any], block: Sequence[slice], d: tuple[Any, ...], nodes: Tables | None
    ) -> NDArray[Any]:
        """The voxels of a block."""
        nz, ny = out.shape[:2]  # blocks may end beyond the output
        moves = [as_numpy(component) for component in d]
        if nodes is None:
            moves = [component[:nz, :ny] for component in moves]
        else:
            nodes = tuple((first[:n], w[:, :n]) for (first, w), n in zip(nodes, out.shape, strict=True))
        try:
            self._source.read_box(out, (*(part.start for part in block), 0)[:3], moves, nodes)
        except NotFiniteError:
            raise DeformError(planning.NOT_FINITE) from None
        return out

    def read_voxels(self, voxels: Any, d: Any, matrix: NDArray[Any] | None = None) -> NDArray[Any]:
        """Single voxels."""
        return self._source.read_voxels(voxels, [as_numpy(component) for component in d], matrix)

    def read_extruded(self, plan: planning.Extruded, run: RunParts) -> NDArray[Any]:
        """A few slices, or a few planes of whole rows, at a time."""
        normal, shape = plan.normal, self._source.output
        order = (*(a for a in range(3) if a != normal), normal)
        is_turned = plan.weights is None and normal in self._turned
        source = self._turned[normal] if is_turned else self._source
        own_shape = (*(shape[a] for a in order),) if is_turned else shape
        out = self._input.memory.empty(own_shape, self._input.values.dtype)
        first = int(self._input.places.whole[normal][normal, 0])
        matrix = plan.matrix[list(order[:2])]

        is_transposed = plan.weights is None and normal < 2 and not is_turned
        across = normal if is_transposed else 0

        def work(part: slice) -> None:
            box, start = (out[:, part], (0, part.start, 0)) if across else (out[part], (part.start, 0, 0))
            source.read_slices(box, start, plan.maps, plan.weights, 2 if is_turned else normal, first, matrix)

        n = out.shape[across]
        most = max(TRANSPOSED_SLICES * is_transposed, planning.BLOCK_VOXELS * n // out.size)
        run(planning.parts(n, min(most, -(-n // planning.processors()))), work)  # a part for each processor
        return out.transpose(np.argsort(order)) if is_turned else out


class JaxReader:
    """Reads by JAX, from its own memory."""

    def __init__(self, source: VoxelInput) -> None:
        self._input = source
        large = source.values.size > sampling.LARGEST_INT32
        self._settings: dict[str, Any] = {
            "shape": source.values.shape,
            "method": source.method,
            "compute": source.compute,
            "index": "int64" if large else "int32",
        }

    def _arithmetic(self) -> Any:
        return sampling.arithmetic(self._input.values.dtype, self._input.values.size)

    @cached_property
    def _flat(self) -> Any:
        return sampling.to_device(self._input.samples)

    def load(self) -> None:
        """Copy the samples to the device."""
        with self._arithmetic():
            _ = self._flat

    def prepare(self, axis: int) -> None:
        """Nothing: the order of axes hardly matters there."""

    def read_block(
        self, out: NDArray[Any], block: Sequence[slice], d: tuple[Any, ...], nodes: Tables | None
    ) -> NDArray[Any]:
        """The voxels of a block, which may end beyond the output."""
        at = self._input.places
        d = tuple(
            planning.check_finite(component) if isinstance(component, np.ndarray) else component for component in d
        )
        with self._arithmetic():
            result = sampling.general(
                self._flat,
                d,
                at.matrix,
                *at.block(block),
                self._input.fill,
                nodes,
                is_straight=at.is_straight,
                **self._settings,
            )
            return as_numpy(result)[: len(out), : out.shape[1]]

    def read_voxels(self, voxels: Any, d: Any, matrix: NDArray[Any] | None = None) -> NDArray[Any]:
        """Single voxels."""
        at = self._input.places
        matrix = at.matrix if matrix is None else matrix
        n = len(voxels[0])
        filled = np.minimum(np.arange(_LISTED * few_sizes(-(-n // _LISTED))), n - 1)  # so that few sizes compile
        moves, places = (tuple(np.asarray(part)[filled] for part in parts) for parts in (d, voxels))
        with self._arithmetic():
            result = sampling.listed(
                self._flat, moves, places, matrix, at.whole, at.part, self._input.fill, **self._settings
            )
            return as_numpy(result)[:n]

    def read_extruded(self, plan: planning.Extruded, run: RunParts) -> NDArray[Any]:
        """Parts along z and y; the whole at once on a GPU."""
        normal, at, shape = plan.normal, self._input.places, self._input.places.shape
        maps = plan.maps.reshape(*plan.maps.shape[: 2 + normal], 1, *plan.maps.shape[2 + normal :])
        outs = [self._input.memory.empty(shape, self._input.values.dtype)]
        self.load()

        def work(block: BlockSlices) -> None:
            of_map = [slice(None) if axis == normal else part for axis, part in enumerate(block)]
            weights = None if plan.weights is None else plan.weights[:, (*block, slice(None))[normal]]
            with self._arithmetic():
                result = as_numpy(
                    sampling.extruded(
                        self._flat,
                        maps[:, :, *of_map],
                        weights,
                        plan.matrix,
                        *at.block(block),
                        self._input.fill,
                        normal=normal,
                        **self._settings,
                    )
                )
            store(outs, 0, block, result)

        run(planning.blocks(shape, 1), work)
        return outs[0]


def store(outs: list[NDArray[Any]], k: int, block: BlockSlices, result: NDArray[Any], *, is_final: bool = True) -> None:
    """Put a block of the k-th result in its place, unless it was written there.

    One that is the whole result and final, so that it may be read-only, is taken as it is: to copy what comes from a
    GPU would take longer than the warp.
    """
    target = outs[k][block]
    if np.may_share_memory(target, result):
        return
    if is_final and not devices.is_host() and target.shape == outs[k].shape == result.shape:
        outs[k] = result
    else:
        target[...] = result[: target.shape[0], : target.shape[1]]
