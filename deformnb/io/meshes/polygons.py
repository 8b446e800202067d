"""Polygons as the readers of surfaces return them, and the check of their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.io.files.errors import fail

Polygons = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]
"""Corners (N, 3), how many corners each face has, and their numbers one face after the other."""

CUT_SHORT = "it is cut short or damaged"
"""Reason of an error about a file that ends too early."""


def whole_numbers(path: Path, numbers: NDArray[Any]) -> NDArray[np.int64]:
    """Numbers of corners as integers; VolumeFileError if one is not a whole number."""
    if numbers.dtype.kind in "iu" and numbers.dtype.itemsize < 8:
        return numbers.astype(np.int64)
    if not (np.abs(numbers.astype(np.float64)) < 2**53).all() or (numbers != np.floor(numbers)).any():
        raise fail(path, f"the number of a corner is not a whole number: {CUT_SHORT}.")
    return numbers.astype(np.int64)
