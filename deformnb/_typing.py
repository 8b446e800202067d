"""Type aliases that several packages share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Progress: TypeAlias = Callable[[float], None]
"""Called with the finished share of some work, 0 to 1; it may raise to cancel the work."""

Image: TypeAlias = NDArray[np.uint8]
"""A picture (height, width, 3) in red, green and blue."""

Floats: TypeAlias = NDArray[np.float64]
"""Numbers of double precision, such as points (N, dim) or displacements on a grid."""

PictureBox: TypeAlias = tuple[float, float, float, float]
"""Limits (a_min, a_max, b_min, b_max) in picture coordinates."""

Float3: TypeAlias = tuple[float, float, float]
"""Three coordinates (x, y, z), or a length along each of three axes."""

Spacing: TypeAlias = Sequence[float] | NDArray[Any] | float
"""Distances of neighbouring voxels (x, y, z), or one number for all axes."""

VoxelSlices: TypeAlias = tuple[slice, slice, slice]
"""A box of a volume as slices along z, y and x."""

Stage: TypeAlias = Callable[[str], Progress]
"""Announces a piece of work by name and returns the function that receives its progress, from 0 to 1."""

RecoveryCommand: TypeAlias = Literal["restore", "skip", "delete"]
"""Action on a lost session."""
