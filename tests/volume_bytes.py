"""Bytes of small NIfTI and NRRD files, field by field, for tests of readers in two languages."""

from __future__ import annotations

import gzip
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CODES = {"u1": 2, "i2": 4, "i4": 8, "f4": 16, "f8": 64, "i1": 256, "u2": 512, "u4": 768, "i8": 1024, "u8": 1280}


def nifti(
    values: NDArray[Any],
    *,
    order: str = "<",
    version: int = 1,
    spacing: tuple[float, ...] = (1.5, 2.0, 2.5),
    sform: Any = None,
    qform: tuple[float, ...] | None = None,
    flip: float = 1.0,
    slope: float = 1.0,
    intercept: float = 0.0,
    intent: int = 0,
    dim: tuple[int, ...] | None = None,
    packed: bool = False,
    datatype: int | None = None,
) -> bytes:
    """A NIfTI file of values [z, y, x].

    Parameters
    ----------
    sform : its three rows of four numbers.
    qform : b, c, d and the offsets of x, y, z.
    dim, datatype : in place of those of the values.
    """
    kind = values.dtype.str[1:]
    sizes = dim or (3, *values.shape[::-1], 1, 1, 1, 1)
    code = _CODES[kind] if datatype is None else datatype
    affine = np.zeros(12) if sform is None else np.asarray(sform, dtype=np.float64).ravel()
    quaternion, codes = qform or (0.0,) * 6, (qform is not None, sform is not None)
    pixdim = (flip, *spacing, 0, 0, 0, 0)
    if version == 1:
        header = bytearray(352)
        fields: list[tuple[str, int, tuple[float, ...]]] = [
            ("i", 0, (348,)),
            ("8h", 40, sizes),
            ("3h", 68, (intent, code, 8 * values.itemsize)),
            ("8f", 76, pixdim),
            ("3f", 108, (352, slope, intercept)),
            ("2h", 252, codes),
            ("6f", 256, quaternion),
            ("12f", 280, tuple(affine)),
        ]
        header[344:348] = b"n+1\0"
    else:
        header = bytearray(544)
        fields = [
            ("i", 0, (540,)),
            ("2h", 12, (code, 8 * values.itemsize)),
            ("8q", 16, sizes),
            ("8d", 104, pixdim),
            ("q", 168, (544,)),
            ("2d", 176, (slope, intercept)),
            ("2i", 344, codes),
            ("6d", 352, quaternion),
            ("12d", 400, tuple(affine)),
            ("i", 504, (intent,)),
        ]
        header[4:12] = b"n+2\0\r\n\x1a\n"
    for form, offset, numbers in fields:
        struct.pack_into(order + form, header, offset, *numbers)
    data = bytes(header) + values.astype(values.dtype.newbyteorder(order)).tobytes()
    return gzip.compress(data, mtime=0) if packed else data


def nrrd(values: NDArray[Any], *lines: str, order: str = "<", packed: bool = False, kind: str = "") -> bytes:
    """A NRRD file of values [z, y, x] with more lines in its header."""
    names = {"f4": "float", "f8": "double"}
    head = [
        "NRRD0004",
        f"type: {kind or names.get(values.dtype.str[1:], values.dtype.name)}",
        f"dimension: {values.ndim}",
        "sizes: " + " ".join(map(str, values.shape[::-1])),
        f"encoding: {'gzip' if packed else 'raw'}",
        f"endian: {'little' if order == '<' else 'big'}",
        *lines,
    ]
    data = values.astype(values.dtype.newbyteorder(order)).tobytes()
    return ("\n".join(head) + "\n\n").encode() + (gzip.compress(data, mtime=0) if packed else data)
