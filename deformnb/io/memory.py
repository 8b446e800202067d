"""How much memory there is, and how much a volume needs, before it is asked for."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

# A warp holds its input and its output and some maps; a reader that took all of the free memory would leave no room.
SHARE = 0.6

# If the system does not tell: what a small laptop has free.
_UNKNOWN = 4 * 2**30

# Version 2 and version 1 of Linux control groups: limit and present use of a container.
_CGROUPS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current", "/sys/fs/cgroup/memory.stat", "inactive_file"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes",
     "/sys/fs/cgroup/memory/memory.stat", "total_inactive_file"),
)


def required_bytes(shape: tuple[int, int, int], dtype: DTypeLike, *, output_shape: tuple[int, int, int] | None = None,
                   maps: int = 0, texture: bool = False) -> int:
    """Bytes that deforming a volume takes: input, output, maps and a texture of the display.

    Parameters
    ----------
    shape : (nz, ny, nx) of the volume.
    dtype : its voxel type.
    output_shape : of the deformed volume, if one is made.
    maps : how many 2-D displacement maps of the volume's own rows and columns (two float32 each) are kept.
    texture : whether a copy for a graphics card is made (of the output, or else of the input).

    Examples
    --------
    >>> required_bytes((256, 256, 256), "uint8", output_shape=(256, 256, 256), maps=1) / 2**20
    32.5
    """
    def size(shape: tuple[int, int, int]) -> int:
        return int(shape[0]) * int(shape[1]) * int(shape[2]) * np.dtype(dtype).itemsize

    total = size(shape) + maps * int(shape[1]) * int(shape[2]) * 8
    total += size(output_shape) if output_shape is not None else 0
    return total + (size(output_shape or shape) if texture else 0)


def available_memory() -> int:
    """Bytes that can still be allocated here; inside a container, within its limit."""
    return min([_system_memory(), *(room for files in _CGROUPS if (room := _cgroup_room(*files)) is not None)])


def default_limit() -> int:
    """Bytes a volume may take unless the caller says otherwise: a share of :func:`available_memory`."""
    return int(SHARE * available_memory())


def _system_memory() -> int:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    try:
        return int(import_module("psutil").virtual_memory().available)
    except (ImportError, OSError):
        pass
    try:  # macOS: all of the memory; half of it is taken as free
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN


def _cgroup_room(limit_file: str, usage_file: str, stat_file: str, cache_field: str) -> int | None:
    try:
        limit = int(Path(limit_file).read_text())  # the word "max" where there is no limit
        usage = int(Path(usage_file).read_text())
    except (OSError, ValueError):
        return None
    try:  # pages of files already read count as used but are given up when needed
        fields = dict(line.split() for line in Path(stat_file).read_text().splitlines())
        usage -= int(fields[cache_field])
    except (OSError, ValueError, KeyError):
        pass
    return max(0, limit - usage)
