"""Voxels that the compiled loops read, and the calls of these loops with arrays of NumPy.

Shapes, types and strides are checked here, once for each call; the loops themselves lead any place, also one that is
no number, to some voxel or outside.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.native import jobs
from deformnb.native.jobs import Loops

_WIDE = ("int32", "float64")  # interpolated in float64, since float32 would change them

NodeTables = tuple[tuple[NDArray[np.int32], NDArray[np.float32]], ...]
"""Along z, y, x the first node that each voxel reads (n,), and the weights (taps, n) of the nodes from there."""

PlaceTables = Sequence[NDArray[Any]]
"""For each output axis its part of the place along the three input axes (3, n)."""


class NotFiniteError(ValueError):
    """A displacement is not finite."""


class VoxelSource:
    """Voxels that are read at places of an output, with loops of one level.

    Parameters
    ----------
    samples : [z, y, x] the voxels, or for "cubic" the coefficients of the spline in float32 or float64.
    dtype : of the voxels; bool as uint8.
    method : a name of :data:`~deformnb.native.jobs.INTERPOLATIONS`.
    fill : the voxel of places outside.
    whole, part : the place of output voxel (k, j, i) along input axis a is ``sum over o of whole[o][a, index o] +
        part[o][a, index o]``; whole numbers and the rest.
    matrix : 3 x 3, from displacements (x, y, z) to input voxels (z, y, x).
    is_near : places and the input are so small that float32 tells neighbouring voxels apart.
    is_straight : each input axis depends on the output axis and the component of its own name only.
    """

    def __init__(
        self,
        loops: Loops,
        samples: NDArray[Any],
        dtype: np.dtype[Any],
        method: str,
        fill: Any,
        whole: PlaceTables,
        part: PlaceTables,
        matrix: NDArray[Any],
        *,
        is_near: bool,
        is_straight: bool,
    ) -> None:
        wide = dtype.name in _WIDE
        kind = dtype if method != "cubic" else np.dtype(np.float64 if wide else np.float32)
        if samples.dtype != kind or samples.ndim != 3 or not samples.size:
            given = f"{samples.dtype}{samples.shape}"
            raise ValueError(f"{method} of {dtype} needs samples [z, y, x] of {kind}, not {given}.")
        self.dtype = dtype
        self.shape = samples.shape
        self._loops = loops
        self._samples = np.require(samples, requirements=("C", "A"))
        self._fill = np.full(1, fill, dtype)
        tables = [[np.require(t, np.float64, ("C", "A")) for t in given] for given in (whole, part)]
        self.output = tuple(t.shape[1] for t in tables[0])
        if any(t.shape != (3, n) for given in tables for t, n in zip(given, self.output, strict=True)):
            raise ValueError("the tables of places are (3, n) for each axis of the output.")
        self._tables = tables
        self._job = jobs.Source(
            samples=self._samples.ctypes.data,
            shape=samples.shape,
            fill=self._fill.ctypes.data,
            voxel_type=jobs.VOXEL_TYPES.index(dtype.name),
            method=jobs.INTERPOLATIONS.index(method),
            is_far=not is_near,
            is_straight=is_straight,
            whole=tuple(t.ctypes.data for t in tables[0]),
            part=tuple(t.ctypes.data for t in tables[1]),
            count=self.output,
            matrix=_numbers(matrix),
        )

    def read_box(
        self,
        out: NDArray[Any],
        start: tuple[int, int, int],
        d: Sequence[NDArray[np.float32]],
        nodes: NodeTables | None = None,
    ) -> None:
        """Fill a box of the output under displacements in space.

        Parameters
        ----------
        out : the box [z, y, x] within an array whose columns are contiguous.
        start : the first voxel of the box.
        d : displacements along x, y, z, at all voxels of the box, or at nodes.
        nodes : the nodes that planes, rows and columns of the box read.
        """
        target = self._target(out, start)
        field = jobs.Field()
        moves = _match_layouts(d, has_rows=nodes is not None)
        shape, strides = moves[0].shape, moves[0].strides
        field.d[:] = [component.ctypes.data for component in moves]
        kept: list[NDArray[Any]] = []  # as long as the loops read them
        if nodes is None:
            if shape != out.shape:
                raise ValueError(f"displacements {shape} are not those of a box {out.shape}.")
        else:
            if len(nodes) != 3:
                raise ValueError("nodes have tables along z, y and x.")
            field.nodes[:] = shape[:2]
            for axis, tables in enumerate(nodes):
                n = out.shape[axis]
                first, weights = (
                    np.require(t, kind, ("C",)) for t, kind in zip(tables, (np.int32, np.float32), strict=True)
                )
                kept += first, weights
                if first.shape != (n,) or weights.shape[1:] != (n,) or not 1 <= len(weights) <= shape[axis]:
                    raise ValueError(f"the box has {n} voxels along axis {axis}, and the tables of nodes have others.")
                if first.min() < 0 or first.max() + len(weights) > shape[axis]:
                    raise ValueError(f"nodes beyond the {shape[axis]} along axis {axis} would be read.")
                field.first[axis], field.weights[axis] = first.ctypes.data, weights.ctypes.data
                field.taps[axis] = len(weights)
        field.stride[:] = [stride // 4 for stride in strides]
        self._run("general", field, target)

    def read_voxels(
        self, voxels: Sequence[NDArray[np.int32]], d: Sequence[NDArray[np.float32]], matrix: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """Single voxels (n,) of the output, at indices z, y, x, under displacements (3, n) that ``matrix`` leads to
        input voxels (z, y, x); default is that of the source.
        """
        index = np.ascontiguousarray(np.stack(voxels), dtype=np.int32)
        moves = np.ascontiguousarray(np.stack(d), dtype=np.float32)
        if index.shape != moves.shape or index.ndim != 2:
            raise ValueError(f"{index.shape[1:]} voxels have displacements {moves.shape[1:]}.")
        if index.size and ((index < 0) | (index >= np.array(self.output)[:, None])).any():
            raise ValueError("there are no such voxels in the output.")
        values = np.empty(index.shape[1], self.dtype)
        own = self._job
        if matrix is not None:
            own = jobs.Source.from_buffer_copy(self._job)
            own.matrix, own.is_straight = _numbers(matrix), False
        job = jobs.VoxelList(index.ctypes.data, moves.ctypes.data, values.ctypes.data, values.size)
        self._run("listed", job, own=own)
        return values

    def read_slices(
        self,
        out: NDArray[Any],
        start: tuple[int, int, int],
        maps: NDArray[np.float32],
        weights: NDArray[np.float32] | None,
        normal: int,
        first: int,
        matrix: NDArray[Any],
    ) -> None:
        """Fill a box of the output under displacements within slices.

        Parameters
        ----------
        out, start : as for :meth:`read_box`.
        maps : (K, 2, rows, columns) displacements along u and v of the whole output.
        weights : (K, n) along the normal of the whole output; None where one map holds on every slice.
        normal : the array axis across the slices.
        first : the input's slice that is the output's first.
        matrix : 2 x 2, from (u, v) to input voxels along rows and columns.
        """
        target = self._target(out, start)
        maps = np.require(maps, np.float32, ("C", "A"))
        across = tuple(n for axis, n in enumerate(self.output) if axis != normal)
        if maps.shape[1:] != (2, *across):
            raise ValueError(f"maps {maps.shape} are not those of slices {across}.")
        if not 0 <= first <= self.shape[normal] - self.output[normal]:
            raise ValueError(f"the input has no {self.output[normal]} slices from {first} on.")
        is_row = weights is None and self._job.method != jobs.INTERPOLATIONS.index("cubic")
        if weights is None:
            if len(maps) != 1:
                raise ValueError(f"{len(maps)} maps need weights.")
            weights = None if is_row else np.ones((1, self.output[normal]), np.float32)
        else:
            weights = np.require(weights, np.float32, ("C", "A"))
            if weights.shape != (len(maps), self.output[normal]):
                raise ValueError(f"weights {weights.shape} are not those of {len(maps)} maps and the slices.")
        field = jobs.PlaneField(
            maps=maps.ctypes.data,
            weights=None if weights is None else weights.ctypes.data,
            terms=len(maps),
            shape=across,
            normal=normal,
            first=first,
            matrix=_numbers(matrix),
        )
        self._run("rows" if is_row else "slices", field, target)

    def _target(self, out: NDArray[Any], start: tuple[int, int, int]) -> jobs.Target:
        if out.ndim != 3:
            raise ValueError("a box has three axes.")
        z, y, x = out.strides
        is_row = x == out.itemsize or out.shape[2] == 1
        if out.dtype != self.dtype or not out.flags.writeable or not is_row:
            raise ValueError(f"the result is an array [z, y, x] of {self.dtype} with contiguous columns.")
        stop = tuple(a + n for a, n in zip(start, out.shape, strict=True))
        if min(start) < 0 or any(end > n for end, n in zip(stop, self.output, strict=True)):
            raise ValueError(f"a box from {start} to {stop} is not within an output {self.output}.")
        return jobs.Target(out.ctypes.data, (z // out.itemsize, y // out.itemsize), start, stop)

    def _run(self, name: str, *job: ctypes.Structure, own: jobs.Source | None = None) -> None:
        result = getattr(self._loops, name)(*map(ctypes.byref, (own or self._job, *job)))
        if result == 1:
            raise MemoryError
        if result:
            raise NotFiniteError


def _match_layouts(d: Sequence[NDArray[Any]], *, has_rows: bool) -> list[NDArray[np.float32]]:
    """Three arrays (z, y, x) with the same steps in memory, and those of rows next to each other if asked for."""
    moves = [np.require(component, np.float32, ("A",)) for component in d]
    if len(moves) != 3 or moves[0].ndim != 3 or any(component.shape != moves[0].shape for component in moves):
        raise ValueError("displacements are three arrays [z, y, x] of one shape.")
    steps = moves[0].strides
    is_usable = all(component.strides == steps for component in moves) and not any(s % 4 or s < 0 for s in steps)
    if not is_usable or (has_rows and steps[2] != 4):
        return [np.ascontiguousarray(component) for component in moves]
    return moves


def _numbers(matrix: NDArray[Any]) -> tuple[float, ...]:
    return tuple(np.asarray(matrix, np.float64).ravel().tolist())
