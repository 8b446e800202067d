"""The general warp by compiled loops as an operation of XLA, for functions that JAX compiles."""

from __future__ import annotations

import ctypes
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import jax
from deformnb.native import library
from deformnb.native.jobs import INTERPOLATIONS
from deformnb.native.source import PlaceTables

_NAME = "deformnb_general"


def can_call() -> bool:
    """Check whether XLA can call the loops in use on a processor."""
    loops, compiled = library.loops(), library.shared_library()
    version = None if loops is None else read_version()
    if loops is None or compiled is None or version is None:
        return False
    compiled.deformnb_xla_use(ctypes.byref(loops), *version)
    return _register()


def general(
    samples: Any,
    d: Any,
    method: str,
    fill: float,
    whole: PlaceTables,
    part: PlaceTables,
    matrix: NDArray[Any],
    *,
    is_straight: bool,
) -> Any:
    """Voxels of an output under displacements, as an array of JAX; within ``jax.jit`` on one thread.

    Parameters
    ----------
    samples : (z, y, x) near voxels of a type that float32 does not change; may be traced.
    d : (3, z, y, x) float32, displacements of the output's voxels along x, y, z; may be traced.
    method : "nearest" or "linear".
    fill, whole, part, matrix, is_straight : as for :class:`~deformnb.native.source.VoxelSource`.
    """
    settings = np.array([INTERPOLATIONS.index(method), False, is_straight], np.int32)
    shape = tuple(table.shape[1] for table in whole)
    call = jax.ffi.ffi_call(_NAME, jax.ShapeDtypeStruct(shape, samples.dtype), vmap_method="sequential")
    tables = [_words(table) for table in (*whole, *part, np.ravel(matrix))]
    return call(samples, d, *tables, np.full(1, fill, samples.dtype), settings)


def _words(values: NDArray[Any]) -> NDArray[np.uint32]:
    """Doubles as pairs of words: JAX would make floats of them."""
    return np.ascontiguousarray(values, np.float64).view(np.uint32)


@cache
def _register() -> bool:
    try:
        function = jax.ffi.pycapsule(library.shared_library().deformnb_xla_general)  # type: ignore[union-attr]
        jax.ffi.register_ffi_target(_NAME, function, platform="cpu")
    except (AttributeError, jax.errors.JaxRuntimeError):  # a library or a jaxlib of another time
        return False
    return True


@cache
def read_version() -> tuple[int, int] | None:
    """The version (major, minor) of XLA's structures, from the header of jaxlib; None where it has none."""
    try:
        header = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text(encoding="utf-8")
    except OSError:
        return None
    found = [re.search(rf"#define XLA_FFI_API_{name} (\d+)", header) for name in ("MAJOR", "MINOR")]
    return (int(found[0][1]), int(found[1][1])) if found[0] and found[1] else None
