"""The loops of ``loops.c``, compiled for this machine by its own compiler."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume.plane import Raster

_FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fopenmp", "-shared", "-fPIC", "-lm")
# Voxel types with their names in C, those of the option --dtype.
_TYPES = {"uint8": "uint8_t", "int16": "int16_t", "float32": "float"}


def why_absent() -> str:
    """The reason why there are no loops in C here; empty where there are."""
    library = _library("uint8")
    return "" if isinstance(library, ctypes.CDLL) else f"No loops in C: {library}."


@cache
def _library(dtype: str) -> ctypes.CDLL | str:
    names = (*(sysconfig.get_config_var("CC") or "").split()[:1], "cc", "gcc", "clang")
    compiler = next((found for found in map(shutil.which, names) if found), None)
    if compiler is None:
        return "this machine has no C compiler (cc, gcc or clang on PATH)"
    target = Path(tempfile.mkdtemp(prefix="deformnb-loops-")) / "loops.so"
    half = "0" if dtype == "float32" else "0.5f"
    done = subprocess.run(
        [
            compiler,
            *_FLAGS,
            f"-DVOXEL={_TYPES[dtype]}",
            f"-DHALF={half}",
            str(Path(__file__).with_name("loops.c")),
            "-o",
            str(target),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return f"{compiler} does not compile them: {(done.stderr.splitlines() or ['no message'])[0]}"
    library = ctypes.CDLL(str(target))
    shutil.rmtree(target.parent)  # it stays loaded
    return library


def _call(function: str, values: NDArray[Any], fields: list[NDArray[Any]], fill: float) -> Callable[[], NDArray[Any]]:
    call = getattr(_library(values.dtype.name), function)
    inputs = [np.ascontiguousarray(a, np.float32) for a in fields]

    def run() -> NDArray[Any]:
        out = np.empty_like(values)
        call(
            *(ctypes.c_void_p(a.ctypes.data) for a in (values, *inputs, out)),
            *map(ctypes.c_int, values.shape),
            ctypes.c_float(fill),
        )
        return out

    return run


def rows(
    values: NDArray[Any], row: NDArray[Any], column: NDArray[Any], fill: float, axis: int
) -> Callable[[], NDArray[Any]]:
    """A replicated map; the volume was laid out with the axis of replication last before."""
    run = _call("rows", np.ascontiguousarray(np.moveaxis(values, axis, 2)), [row, column], fill)
    return lambda: np.moveaxis(run(), 2, axis)


def modulated(
    values: NDArray[Any], row: NDArray[Any], column: NDArray[Any], weights: NDArray[Any], fill: float
) -> Callable[[], NDArray[Any]]:
    """A map of displacements (y, x) times weights (z)."""
    return _call("modulated", values, [row, column, weights], fill)


def general(values: NDArray[Any], displacement: NDArray[Any], fill: float) -> Callable[[], NDArray[Any]]:
    """Any field (z, y, x, 3)."""
    return _call("general", values, [displacement], fill)


def sums(fit: RBFInterpolant, raster: Raster) -> Callable[[], NDArray[Any]]:
    """The displacement (2, rows, columns) of a solved fit of Wendland's C2 kernel on a raster."""
    n, call = int(fit.count), _library("uint8").sums  # type: ignore[union-attr]
    trend = np.concatenate([np.asarray(fit.polynomial.constant)[:, None], np.asarray(fit.polynomial.linear)], axis=1)
    lines = [(line - o) / fit.support for line, o in zip((raster.rows, raster.columns), fit.origin[::-1], strict=True)]
    given = (np.asarray(fit.centers)[:n], np.asarray(fit.coefficients)[:n], trend, *lines)
    inputs = [np.ascontiguousarray(a, np.float32) for a in given]

    def run() -> NDArray[Any]:
        out = np.empty((2, *raster.shape), np.float32)
        call(*(ctypes.c_void_p(a.ctypes.data) for a in (*inputs, out)), *map(ctypes.c_int, (n, *raster.shape)))
        return out

    return run
