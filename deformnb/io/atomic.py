"""Writing that either finishes or never happened."""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, BinaryIO

from deformnb.errors import FileChangedError, VolumeFileError
from deformnb.io.headers import fail, human_bytes, shown
from deformnb.io.locks import held, sweep

_SUFFIX = ".deformnb.tmp"
# A lock may say nothing of a process on another machine that shares the folder: only our own leftovers are swept.
_HERE = hashlib.sha256(platform.node().encode()).hexdigest()[:8]


# Of the work of one thread; see writing_held_by.
_last_doubts: ContextVar[Callable[[], AbstractContextManager[Any]]] = ContextVar("last_doubts", default=nullcontext)


@contextmanager
def writing_held_by(doubts: Callable[[], AbstractContextManager[Any]]) -> Iterator[None]:
    """Within this block, in this thread, files take their places only within a context of their own.

    Parameters
    ----------
    doubts : makes the context, when all is written; what it raises on entering keeps the old file.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "note.txt"
    >>> @contextmanager
    ... def never():
    ...     raise KeyError("not wanted any more")
    ...     yield
    >>> with suppress(KeyError), writing_held_by(never), atomic_write(target) as file:
    ...     _ = file.write(b"whole")
    >>> list(target.parent.iterdir())
    []
    """
    token = _last_doubts.set(doubts)
    try:
        yield
    finally:
        _last_doubts.reset(token)


def check_target(path: str | os.PathLike[str], *, overwrite: bool = True, needed: int = 0) -> Path:
    """The real path to write to, checked before any work: folder, permissions, free space.

    Parameters
    ----------
    path : the file to write; a symbolic link is followed.
    overwrite : whether an existing file may be replaced.
    needed : bytes the file may take.

    Raises
    ------
    VolumeFileError
        One sentence that says what stands in the way.
    """
    try:
        target = Path(path).expanduser().resolve()
        exists = target.exists()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name too long, a loop of links
        raise VolumeFileError(f"{shown(path)!r} cannot be written: it is not a usable path ({error}).") from error
    folder = target.parent
    if not folder.is_dir():
        raise fail(target, f"cannot be written: there is no folder {shown(folder)}. Create it first.")
    if target.is_dir():
        raise fail(target, "cannot be written: this is a folder. Name a file in it.")
    if exists and not target.is_file():
        raise fail(target, "cannot be written: this is a device or pipe, not a file.")
    if exists and not overwrite:
        raise _taken(target)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise fail(target, f"cannot be written: the folder {shown(folder)} is read-only for you.")
    if exists and not os.access(target, os.W_OK):
        raise fail(target, "cannot be written: the file is read-only. Choose another name or lift its protection.")
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise fail(target, f"needs {human_bytes(needed)} but the disk has only {human_bytes(free)} free.")
    return target


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, overwrite: bool = True, needed: int = 0,
                 replacing: Callable[[Path], AbstractContextManager[Any]] = nullcontext) -> Iterator[BinaryIO]:
    """A binary file that takes the place of ``path`` at the end of the block, whole, or not at all.

    It is written next to its target, so that the final rename stays on one disk, and flushed to the disk before: after
    a crash there is the old file or the new one. An exception (a full disk, :class:`~deformnb.errors.Cancelled`)
    leaves the old file and no litter; what a killed process has left is swept away by the next that writes into the
    folder. The permissions of an existing file are kept.

    Parameters
    ----------
    path, overwrite, needed : see :func:`check_target`.
    replacing : makes the context, from the real path, in which the old file is replaced when all is written; what it
        raises keeps the old file.

    Raises
    ------
    VolumeFileError
        If the target cannot be written or the disk fills up.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with atomic_write(folder / "note.txt") as file:
    ...     _ = file.write(b"whole")
    >>> (folder / "note.txt").read_bytes()
    b'whole'
    """
    target = check_target(path, overwrite=overwrite, needed=needed)
    sweep_folder(target.parent)
    temporary = target.parent
    try:
        temporary, file, lock = _open_temporary(target)
        try:
            with file:
                if target.exists():
                    with suppress(OSError):  # a file system without permissions
                        temporary.chmod(stat.S_IMODE(target.stat().st_mode))
                yield file
                file.flush()
                os.fsync(file.fileno())
            with _last_doubts.get()(), replacing(target):
                _take_place(temporary, target, overwrite=overwrite)
        finally:
            if lock is not None:
                os.close(lock)
    except OSError as error:
        if isinstance(error, ValueError):  # a DeformError that is also an ImportError or the like: not ours
            raise
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        why = "the disk (or your share of it) is full" if full else f"the system says: {error.strerror or error}"
        raise fail(target, f"was not written, {why}; an older file of this name is untouched.") from error
    finally:
        if temporary != target.parent:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
    flush_folder(target.parent)


def _take_place(temporary: Path, target: Path, *, overwrite: bool) -> None:
    """Give a file its name; where it must be a new one, also another process that does the same is not replaced."""
    if overwrite:
        temporary.replace(target)
        return
    try:
        target.hardlink_to(temporary)  # in one operation, as no rename can
    except FileExistsError:
        raise _taken(target) from None
    except (OSError, NotImplementedError):  # a file system without links
        if target.exists():
            raise _taken(target) from None
        temporary.replace(target)


def _taken(target: Path) -> FileChangedError:
    return FileChangedError(f"{shown(target.name)}: exists already and overwrite is False. Choose another name.")


def temporary_name() -> str:
    """A name for what is not finished, of at most 255 bytes, the limit of common file systems."""
    return f".{_HERE}-{secrets.token_hex(8)}{_SUFFIX}"


def _open_temporary(target: Path) -> tuple[Path, BinaryIO, int | None]:
    """A fresh file beside the target, and a lock on it that outlives the file's closing."""
    while True:
        temporary = target.with_name(temporary_name())
        file = temporary.open("xb")
        if os.name == "nt":  # an open file can be neither renamed nor swept away there
            return temporary, file, None
        lock = held(temporary, os.dup(file.fileno()))
        if lock is not None:
            return temporary, file, lock
        file.close()


def sweep_folder(folder: Path) -> None:
    """Remove what processes of this machine have left half written when they were killed."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(_SUFFIX) and entry.name.startswith(f".{_HERE}-"):
                sweep(Path(entry.path))


def flush_folder(folder: Path) -> None:
    """Have the names in a folder on the disk, where the system can."""
    # The rename itself lives in the folder. Windows cannot open folders, network drives may refuse: the file is whole.
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
