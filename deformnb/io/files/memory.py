"""Memory checks: the free memory of the machine and the size of a volume, compared before allocation."""

from __future__ import annotations

import os
import re
from importlib import import_module
from pathlib import Path, PurePosixPath

from deformnb.errors import DeformError
from deformnb.io.files.errors import human_bytes
from deformnb.volume.volume import Grid, Volume

# A warp holds its input and its output and some maps; a reader that took all of the free memory would leave no room.
SHARE = 0.6

# If the system does not report it: the free memory of a small laptop.
_UNKNOWN = 4 * 2**30

# By the type of file system of Linux control groups (version 2 and version 1): the files of a group that hold its limit
# and its present use, and the field of its memory.stat that holds the pages of files already read.
_CGROUP_FILES = {
    "cgroup2": ("memory.max", "memory.current", "inactive_file"),
    "cgroup": ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


def available_memory() -> int:
    """Bytes that can still be allocated here; inside a container, within its limit and those around it.

    Examples
    --------
    >>> available_memory() > 0
    True
    """
    rooms = (_cgroup_room(folder, kind) for folder, kind in _cgroups(Path("/")))
    return min([_system_memory(), *(room for room in rooms if room is not None)])


def check_room(volume: Volume, output: Grid | None) -> None:
    """Refuse a result that there is no memory for: else the system would end the process, and all work with it.

    Parameters
    ----------
    output : its grid; None is the volume's own.

    Raises
    ------
    DeformError
        With the required and the free bytes.
    """
    grid = output or volume.grid
    needed, free = grid.size * volume.dtype.itemsize, available_memory()
    if needed > free:
        remedy = (
            "choose a smaller result box or a coarser resolution"
            if grid.size > volume.grid.size
            else "read the volume with a stride"
        )
        raise DeformError(
            f"the deformed volume of {' x '.join(map(str, grid.shape[::-1]))} voxels takes "
            f"{human_bytes(needed)} and {human_bytes(free)} are free; close something else, or {remedy}."
        )


def default_limit() -> int:
    """Bytes a volume may take by default: a share of :func:`available_memory`."""
    return int(SHARE * available_memory())


def _system_memory() -> int:
    try:
        for line in Path("/proc/meminfo").read_text(encoding="utf-8").splitlines():
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


def _cgroups(root: Path) -> list[tuple[Path, str]]:
    """The control group of this process and those around it, each with its kind: the limits of all of them hold.

    Parameters
    ----------
    root : of the file system that reports them.
    """
    try:
        groups = (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines()
        mounts = (root / "proc/self/mountinfo").read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return []
    found: list[tuple[Path, str]] = []
    for line in mounts:
        where, _, what = line.partition(" - ")
        fields, (kind, *_, options) = where.split(), what.split(" ")
        if kind not in _CGROUP_FILES or (kind == "cgroup" and "memory" not in options.split(",")):
            continue
        group = next(
            (
                path
                for number, controllers, path in (entry.split(":", 2) for entry in groups)
                if (number == "0" if kind == "cgroup2" else "memory" in controllers.split(","))
            ),
            None,
        )
        if group is None:
            continue
        # A container may see a part of the tree only: then the path begins with that part's own, or leads out of it.
        shown, mount = PurePosixPath(fields[3]), root / _unescape(fields[4]).lstrip("/")
        path = PurePosixPath(group)
        inner = path.relative_to(shown) if path.is_relative_to(shown) and ".." not in path.parts else PurePosixPath()
        found += [(mount / part, kind) for part in (inner, *inner.parents)]
    return found


def _unescape(path: str) -> str:
    """A path of mountinfo, where blanks are written as octal numbers."""
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), path)


def _cgroup_room(folder: Path, kind: str) -> int | None:
    limit_file, usage_file, cache_field = _CGROUP_FILES[kind]
    try:
        limit = int((folder / limit_file).read_text(encoding="utf-8"))  # the word "max" where there is no limit
        usage = int((folder / usage_file).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    try:  # pages of files already read count as used but are released when needed
        fields = dict(line.split() for line in (folder / "memory.stat").read_text(encoding="utf-8").splitlines())
        usage -= int(fields[cache_field])
    except (OSError, ValueError, KeyError):
        pass
    return max(0, limit - usage)
