"""The loops of ``loops.c``, compiled for this machine by GCC and by Clang, where they are."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import Case
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume.plane import Raster

FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fopenmp-simd", "-shared", "-fPIC")
"""For both compilers. Unlike deformnb's loops these may join a multiplication and an addition."""

COMPILERS = ("gcc", "clang")
"""Names in tables and in ``ratios.json``; a clang that comes from the package ziglang is one too."""

# Voxel types with their names and sizes in C, those of the option --dtype.
_TYPES = {"uint8": ("uint8_t", 1), "int16": ("int16_t", 2), "float32": ("float", 4)}
_C_TYPES = {"uint8": ctypes.c_uint8, "int16": ctypes.c_int16, "float32": ctypes.c_float}

# Slices that rows_in_place turns at once: RUN of loops.c.
_RUN = 32

Loops = ctypes.CDLL
Run = Callable[[], NDArray[Any]]


@cache
def commands() -> dict[str, tuple[str, ...]]:
    """The compilers of this machine by their names, those of :data:`COMPILERS` that there are."""
    found = {}
    for name in COMPILERS:
        path = shutil.which(name)
        if path and ("clang" in _version((path,)).lower()) == (name == "clang"):  # macOS calls its clang gcc
            found[name] = (path,)
    if "clang" not in found and importlib.util.find_spec("ziglang"):
        found["clang"] = (sys.executable, "-m", "ziglang", "cc")
    return found


def versions() -> list[str]:
    """The compilers with their versions, for the heading of a report."""
    return [
        f"C compiled by {name} {next(iter(re.findall(r'[0-9]+[.][0-9.]+', _version(command))), '')}"
        for name, command in commands().items()
    ]


def _version(command: tuple[str, ...]) -> str:
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, errors="replace", check=False)
    return (done.stdout.splitlines() or [""])[0]


def why_absent() -> str:
    """The reason why there are no loops in C here; empty where there are."""
    return "" if libraries("uint8") else "No loops in C: this machine has neither gcc nor clang on PATH, nor ziglang."


@cache
def libraries(dtype: str) -> dict[str, Loops]:
    """The loops for a voxel type, by the names of their compilers.

    Raises
    ------
    SystemExit
        If a compiler that is there does not compile them.
    """
    return {name: _compile(command, dtype) for name, command in commands().items()}


def _compile(command: tuple[str, ...], dtype: str) -> Loops:
    with tempfile.TemporaryDirectory(prefix="deformnb-loops-") as folder:
        target = str(Path(folder) / "loops.so")
        voxel, size = _TYPES[dtype]
        source = str(Path(__file__).with_name("loops.c"))
        options = [f"-DVOXEL={voxel}", f"-DBYTES={size}", source, "-o", target, "-lm"]
        done = subprocess.run([*command, *FLAGS, *options], capture_output=True, text=True, check=False)
        if done.returncode:
            message = (done.stderr.splitlines() or ["no message"])[0]
            raise SystemExit(f"{command[0]} does not compile {source}: {message}")
        return ctypes.CDLL(target)  # it stays loaded


def cases(dtype: str, make: Callable[[Loops], Run], error: Any = None, name: str = "C") -> Iterator[Case]:
    """A case for each compiler, of a function that makes calls of its library."""
    for compiler, library in libraries(dtype).items():
        yield Case(f"{name}, {compiler}", make(library), error)


@cache
def _pool() -> ThreadPoolExecutor | None:
    """A thread for each processor that this process may use; None for one."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return ThreadPoolExecutor(count) if count > 1 else None


def _calls(function: Any, arrays: list[NDArray[Any]], numbers: list[Any], total: int, *rest: Any) -> Run:
    """Calls that fill the last array, which is there before and after: no page of it is new to the process.

    Parameters
    ----------
    total : units of the outermost axis; threads take a sixteenth of them at a time.
    rest : arguments after the range.
    """
    given = [*(ctypes.c_void_p(a.ctypes.data) for a in arrays), *numbers]
    share = -(-total // 16)
    parts = [(first, min(first + share, total)) for first in range(0, total, share)]
    pool = _pool()

    def work(part: tuple[int, int]) -> None:
        function(*given, *map(ctypes.c_int, part), *rest)

    def run() -> NDArray[Any]:
        if pool is None:
            work((0, total))
        else:
            list(pool.map(work, parts))
        return arrays[-1]

    return run


def _fill(values: NDArray[Any], fill: float) -> Any:
    return _C_TYPES[values.dtype.name](values.dtype.type(fill).item())


def _sizes(*sizes: int) -> list[ctypes.c_int]:
    return [ctypes.c_int(size) for size in sizes]


def _floats(*arrays: Any) -> list[NDArray[np.float32]]:
    return [np.ascontiguousarray(a, np.float32) for a in arrays]


def rows(
    loops: Loops,
    values: NDArray[Any],
    row: NDArray[Any],
    column: NDArray[Any],
    fill: float,
    axis: int,
    function: str = "rows",
) -> Run:
    """A replicated map; the volume was laid out with the axis of replication last before.

    Parameters
    ----------
    function : "rows", or "rows_of_8_bits" with weights of 8 bits, which is up to two grey levels off.
    """
    laid = np.ascontiguousarray(np.moveaxis(values, axis, 2))
    arrays = [laid, *_floats(row, column), np.empty_like(laid)]
    run = _calls(getattr(loops, function), arrays, [*_sizes(*laid.shape), _fill(values, fill)], laid.shape[0])
    return lambda: np.moveaxis(run(), 2, axis)


def rows_in_place(
    loops: Loops, values: NDArray[Any], row: NDArray[Any], column: NDArray[Any], fill: float, axis: int
) -> Run:
    """A replicated map along z or y, the volume as it lies."""
    values, across = np.ascontiguousarray(values), 1 - axis
    n, apart, pitch = values.shape[axis], *(values.strides[a] // values.itemsize for a in (axis, across))
    arrays = [values, *_floats(row, column), np.empty_like(values)]
    numbers = [*_sizes(values.shape[across], values.shape[2], n), _fill(values, fill)]
    strides = ctypes.c_int64(apart), ctypes.c_int64(pitch)
    return _calls(loops.rows_in_place, arrays, numbers, -(-n // _RUN), *strides)


def modulated(
    loops: Loops, values: NDArray[Any], row: NDArray[Any], column: NDArray[Any], weights: NDArray[Any], fill: float
) -> Run:
    """A map of displacements (y, x) times weights (z)."""
    values = np.ascontiguousarray(values)
    arrays = [values, *_floats(row, column, weights), np.empty_like(values)]
    return _calls(loops.modulated, arrays, [*_sizes(*values.shape[1:]), _fill(values, fill)], len(values))


def general(loops: Loops, values: NDArray[Any], components: list[NDArray[np.float32]], fill: float) -> Run:
    """Any field, of components x, y, z (z, y, x) in memory of their own."""
    values = np.ascontiguousarray(values)
    arrays = [values, *_floats(*components), np.empty_like(values)]
    return _calls(loops.general, arrays, [*_sizes(*values.shape), _fill(values, fill)], len(values))


def components(displacement: NDArray[Any]) -> list[NDArray[np.float32]]:
    """The components of a field (z, y, x, 3), each in memory of its own: the best layout for C."""
    return _floats(*np.moveaxis(displacement, -1, 0))


def sums(loops: Loops, fit: RBFInterpolant, raster: Raster) -> Run:
    """The displacement (2, rows, columns) of a solved fit of Wendland's C2 kernel on a raster."""
    n = int(fit.count)
    trend = np.concatenate([np.asarray(fit.polynomial.constant)[:, None], np.asarray(fit.polynomial.linear)], axis=1)
    lines = [(line - o) / fit.support for line, o in zip((raster.rows, raster.columns), fit.origin[::-1], strict=True)]
    given = _floats(np.asarray(fit.centers)[:n], np.asarray(fit.coefficients)[:n], trend, *lines)
    arrays = [*given, np.empty((2, *raster.shape), np.float32)]
    return _calls(loops.sums, arrays, _sizes(n, *raster.shape), raster.shape[0])
