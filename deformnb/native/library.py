"""The compiled library, and the level of instructions that is used.

The library holds the same loops several times, compiled for processors of different years; the newest ones that the
processor has are used. ``DEFORMNB_NATIVE=off`` uses none, ``DEFORMNB_NATIVE=v2`` those of a level.
``DEFORMNB_NATIVE_FOLDER`` names a folder with another library, such as one with checks by sanitizers.
"""

from __future__ import annotations

import ctypes
import os
import sys
from functools import cache
from pathlib import Path

from deformnb.native.jobs import STRUCTURES, Loops

FOLDER_VARIABLE = "DEFORMNB_NATIVE_FOLDER"
"""The environment variable that names another folder of the library."""

FOLDER = Path(os.environ.get(FOLDER_VARIABLE) or Path(__file__).parent / "lib")
"""The folder of the library; ``native_build.py`` of a checkout fills it."""

LEVELS = ("base", "v2", "v3", "v4")
"""Levels of instructions, those of x86-64 by the names of its psABI; other processors have "base" alone."""

_VARIABLE = "DEFORMNB_NATIVE"

_chosen: str | None = None


def use_level(name: str | None) -> str | None:
    """Use a level from now on; None uses the best one, and "off" none.

    Returns
    -------
    the choice before, to go back to.

    Raises
    ------
    ValueError
        If there is no such level on this machine; the choice before stays.

    Examples
    --------
    >>> before = use_level("off")
    >>> level(), loops()
    ('off', None)
    >>> use_level(before)
    'off'
    """
    global _chosen
    if name not in (None, "off", *levels()):
        raise ValueError(f"there are no loops of level {name!r} here; choose one of {', '.join(('off', *levels()))}.")
    before, _chosen = _chosen, name
    return before


@cache
def levels() -> tuple[str, ...]:
    """The levels that this processor can run, the best one last; none without the library."""
    library = shared_library()
    if library is None:
        return ()
    best: int = library.deformnb_best_level()
    return tuple(name for name in LEVELS[: best + 1] if _has_level(library, name))


def level() -> str:
    """The level in use, or "off"."""
    found = levels()
    wanted = _chosen or os.environ.get(_VARIABLE, "").strip().lower() or None
    if not found or wanted == "off":
        return "off"
    return wanted if wanted in found else found[-1]


def loops() -> Loops | None:
    """The functions of the level in use; None where there are none."""
    name = level()
    return None if name == "off" else _loops(name)


def why_absent() -> str:
    """The reason why no loops are used; empty where some are."""
    if level() != "off":
        return ""
    if not _path().exists():
        return f"{_path().name} is not there (python native_build.py in a checkout builds it)"
    return (
        f"{_VARIABLE}=off"
        if levels()
        else f"{_path().name} does not load or is of other sources (python native_build.py builds it)"
    )


@cache
def _loops(name: str) -> Loops:
    library = shared_library()
    assert library is not None
    return Loops.in_dll(library, f"deformnb_loops_{name}")


def _has_level(library: ctypes.CDLL, name: str) -> bool:
    try:
        Loops.in_dll(library, f"deformnb_loops_{name}")
    except ValueError:
        return False
    return True


def _path() -> Path:
    ending = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    return FOLDER / f"deformnb_loops{ending}"


@cache
def shared_library() -> ctypes.CDLL | None:
    """The library itself; None where it is missing, does not load, or was built from other sources."""
    sizes = [ctypes.sizeof(structure) for structure in STRUCTURES]
    try:
        library = ctypes.CDLL(str(_path()))
        found = (ctypes.c_uint32 * len(sizes)).in_dll(library, "deformnb_sizes")
    except (OSError, ValueError):
        return None
    return library if list(found) == sizes else None
