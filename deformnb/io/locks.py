"""Files that belong to a process for as long as it lives: the system lets go of a lock when its holder dies.

A process id in a file's name says less: it is given to another process one day, and nothing on another machine.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path


def try_lock(descriptor: int) -> bool | None:
    """Lock an open file, without waiting: True if it is ours now, False if it is another's, None if nobody can tell.

    It ends when the last copy of the descriptor is closed, at the latest with the process.
    """
    try:
        try:
            import fcntl
        except ImportError:  # Windows
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]  # not on this system
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a network drive without locks
        return None
    return True


def hold(path: Path) -> int | None:
    """Make a file and keep it locked; returns its descriptor, which lets go when it is closed.

    None if it was swept away as a dead process's in the moment between the two; make another one.

    Raises
    ------
    FileExistsError
        If there is one already.
    OSError
        If it cannot be made.
    """
    descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
    return held(path, descriptor)


def held(path: Path, descriptor: int) -> int | None:
    """Lock a file that was just made and is open, as :func:`hold`; closes it where it is gone."""
    if try_lock(descriptor) is not False and _is_at(path, descriptor):
        return descriptor
    os.close(descriptor)
    return None


def hold_folder(path: Path) -> int | None:
    """Lock a folder; returns its descriptor, None where the system has no such locks."""
    try:
        return held(path, os.open(path, os.O_RDONLY))
    except OSError:  # Windows opens no folders
        return None


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def is_abandoned(path: Path) -> bool:
    """True if nobody holds this file: whoever made it has died or let go. A file that is gone is abandoned.

    Where locks do not work nothing counts as abandoned.
    """
    descriptor = None
    try:
        descriptor = os.open(path, os.O_RDWR)
        return try_lock(descriptor) is True
    except FileNotFoundError:
        return True
    except OSError:
        return False
    finally:
        if descriptor is not None:
            os.close(descriptor)


def sweep(path: Path, unless: Callable[[], bool] = bool) -> bool:
    """Remove a file or a folder that nobody holds; returns whether it is gone.

    On POSIX it is removed while the lock is ours, so its maker cannot take it for its own meanwhile.

    Parameters
    ----------
    unless : asked once nobody else can hold it; it stays if the answer is yes.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    try:
        if try_lock(descriptor) is not True or unless():
            return False
        if os.name != "nt":
            _remove(path)
    finally:
        os.close(descriptor)
    if os.name == "nt":  # no open file can be removed there
        _remove(path)
    return not path.exists()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)
