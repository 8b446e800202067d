"""Type aliases that several packages share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Progress: TypeAlias = Callable[[float], None]
"""Called with the finished share of some work, 0 to 1; it may raise to cancel the work."""

Image: TypeAlias = NDArray[np.uint8]
"""A picture (height, width, 3) in red, green and blue."""

Float3: TypeAlias = tuple[float, float, float]
"""Three coordinates (x, y, z), or a length along each of three axes."""

Spacing: TypeAlias = Sequence[float] | NDArray[Any] | float
"""Distances of neighbouring voxels (x, y, z), or one number for all axes."""
