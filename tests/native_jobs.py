"""Jobs of the compiled loops, recorded with all that these read and write, to be run again by another processor."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np

from deformnb.native import jobs

SIGNATURES: dict[str, tuple[Any, ...]] = {
    "general": (jobs.Source, jobs.Field, jobs.Target),
    "listed": (jobs.Source, jobs.VoxelList),
    "slices": (jobs.Source, jobs.PlaneField, jobs.Target),
    "rows": (jobs.Source, jobs.PlaneField, jobs.Target),
    "sum_lattice": (jobs.LatticeSum,),
    "edge_distances": (jobs.EdgeDistances,),
}
RESULTS = ("values", "out")


@dataclass(frozen=True)
class Job:
    """A call, and what the loops of this process made of it."""

    text: bytes
    code: int
    results: tuple[bytes, ...]


@dataclass
class JobRecorder:
    """A table of loops that notes each call.

    Parameters
    ----------
    loops : the table that does the work.
    """

    loops: Any
    recorded: list[Job] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        kinds = SIGNATURES[name]

        def call(*given: Any) -> int:
            structures = [
                kind.from_address(ctypes.cast(p, ctypes.c_void_p).value or 0)
                for kind, p in zip(kinds, given, strict=True)
            ]
            arrays = [(k, *array) for k, of in enumerate(structures) for array in _arrays(of, structures)]
            text = [struct.pack("<3q", list(SIGNATURES).index(name), len(structures), len(arrays))]
            text += [struct.pack("<q", ctypes.sizeof(one)) + bytes(one) for one in structures]
            for k, offset, address, size, is_result in arrays:
                text += [struct.pack("<4q", k, offset, is_result, size), ctypes.string_at(address, size)]
            code = getattr(self.loops, name)(*given)
            results = tuple(ctypes.string_at(address, size) for *_, address, size, is_result in arrays if is_result)
            self.recorded.append(Job(b"".join(text), code, results))
            return int(code)

        return call


def split_answers(text: bytes, recorded: list[Job]) -> Iterator[tuple[int, tuple[bytes, ...]]]:
    """Codes and results that the program wrote for all jobs."""
    at = 0
    for job in recorded:
        (code,) = struct.unpack_from("<q", text, at)
        at += 8
        results = []
        for result in job.results:
            results.append(text[at : at + len(result)])
            at += len(result)
        yield code, tuple(results)
    assert at == len(text)


def _arrays(of: ctypes.Structure, structures: list[Any]) -> Iterator[tuple[int, int, int, bool]]:
    """Offset of the pointer, address and bytes of all arrays of a structure, and whether it is written."""
    sizes = _sizes(of, structures)
    for name, kind in of._fields_:  # type: ignore[misc]
        count = ctypes.sizeof(kind) // 8
        if kind not in (ctypes.c_void_p, ctypes.c_void_p * 2, ctypes.c_void_p * 3):
            continue
        value = getattr(of, name)
        addresses = [value] if kind is ctypes.c_void_p else list(value)
        for k, (address, size) in enumerate(zip(addresses, sizes[name] * (count // len(sizes[name])), strict=True)):
            if address is not None:
                yield getattr(type(of), name).offset + 8 * k, address, size, name in RESULTS


def _sizes(of: Any, structures: list[Any]) -> dict[str, list[int]]:
    """Bytes of the arrays of each field; a field that is not known here is an error."""
    voxel, samples = _voxel_sizes(structures[0]) if isinstance(structures[0], jobs.Source) else (0, 0)
    if isinstance(of, jobs.Source):
        tables = [24 * n for n in of.count]
        return {"samples": [prod(of.shape) * samples], "fill": [voxel], "whole": tables, "part": tables}
    if isinstance(of, jobs.Target):
        return {"values": [_extent(_box(of), (*of.stride, 1)) * voxel]}
    if isinstance(of, jobs.Field):
        box = _box(structures[2])
        nodes = tuple(_greatest(first, n) + taps for first, taps, n in zip(of.first, of.taps, box, strict=True))
        shape = nodes if of.nodes[0] else box
        tables = [4 * n for n in box]
        return {
            "d": [_extent(shape, tuple(of.stride)) * 4],
            "first": tables,
            "weights": [size * taps for size, taps in zip(tables, of.taps, strict=True)],
        }
    if isinstance(of, jobs.PlaneField):
        return {
            "maps": [8 * of.terms * prod(of.shape)],
            "weights": [4 * of.terms * structures[0].count[of.normal]],
        }
    if isinstance(of, jobs.VoxelList):
        return {"voxels": [12 * of.count], "d": [12 * of.count], "values": [voxel * of.count]}
    if isinstance(of, jobs.EdgeDistances):
        return {"edge": [96 * of.edges], "places": [16 * of.count], "out": [8 * of.count]}
    dim, parts = of.dim, of.dim ** (2 if of.derivatives else 1)
    return {
        "row": [8 * dim * of.rows],
        "column": [8 * dim * of.columns],
        "center": [8 * dim * of.count],
        "coefficient": [8 * dim * of.count],
        "scale": [8 * of.count],
        "linear": [8 * dim**2],
        "constant": [8 * dim],
        "quadratic": [8 * dim**3],
        "out": [(8 if of.is_double else 4) * parts * of.rows * of.columns],
    }


def _voxel_sizes(source: Any) -> tuple[int, int]:
    name = jobs.VOXEL_TYPES[source.voxel_type]
    size = np.dtype(name).itemsize
    if jobs.INTERPOLATIONS[source.method] != "cubic":
        return size, size
    return size, 8 if name in ("int32", "float64") else 4


def _box(target: Any) -> tuple[int, ...]:
    return tuple(stop - start for start, stop in zip(target.start, target.stop, strict=True))


def _extent(shape: tuple[int, ...], strides: tuple[int, ...]) -> int:
    """Elements from the first to the last one."""
    return 1 + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))


def _greatest(address: int | None, count: int) -> int:
    return 0 if address is None else max((ctypes.c_int32 * count).from_address(address))
