"""Memory of results that is used again once nobody holds the last result in it.

Each edit of a volume has a result of the same size. Fresh memory comes from the system page by page, cleared, when it
is first written: of a replicated warp of 512^3 voxels that takes a fifth of the time, more where pages are small.
"""

from __future__ import annotations

import ctypes
import weakref
from math import prod
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.volume.sampling import aligned_empty

# Smaller arrays are kept by the allocator anyway; memory of larger ones is missed by other programs.
_SMALLEST, _LARGEST = 2**20, 2**28


class ResultMemory:
    """Memory for one result after the other.

    At most one block is kept that no array uses. Arrays may outlive this object.

    Examples
    --------
    >>> memory = ResultMemory()
    >>> first = memory.empty((128, 128, 128), np.dtype(np.uint8))
    >>> place = first.ctypes.data
    >>> del first
    >>> memory.empty((64, 128, 128), np.dtype(np.int16)).ctypes.data == place
    True
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._free: NDArray[np.uint8] | None = None

    def empty(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """An array [z, y, x] with arbitrary values, C-contiguous and aligned to 64 bytes."""
        size = prod(shape) * dtype.itemsize
        if not _SMALLEST <= size <= _LARGEST:
            return np.empty(shape, dtype)
        with self._lock:
            block, self._free = self._free, None
        if block is None or block.size != size:
            block = aligned_empty((size,), np.dtype(np.uint8))
        user: Any = (ctypes.c_char * size).from_buffer(block.data)  # every view of the array refers to this
        weakref.finalize(user, self._release, block).atexit = False
        return np.ndarray(shape, dtype, buffer=user)

    def _release(self, block: NDArray[np.uint8]) -> None:
        self._free = block  # without the lock: a collection of garbage may call this while it is held
