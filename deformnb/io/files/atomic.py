"""Atomic writing of files, locks held by a process, and the rule for replacing files.

A write either finishes or leaves no trace.

A lock is a file that belongs to a process for as long as that runs: the system releases it when its holder ends. A
process id in a file's name is a weaker sign: it is given to another process one day, and means nothing on another
machine.

The rule of replacing, for everything that writes: a function named ``write_...`` or ``draw_...`` replaces
an existing file, atomically, as writers of NumPy, nibabel and SimpleITK do; ``overwrite=False`` has it refuse.
Everything else that writes (a session's documents and exports, ``replay``, ``warp_series``, ``deformnb.chunked``, the
commands) refuses unless permission is given: ``overwrite=True``, ``--force``, or an answer in the front end. A session
replaces a document that it has itself opened or written, as long as no other program has changed it.
"""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import secrets
import shutil
import stat
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

from deformnb.errors import FileChangedError, VolumeFileError
from deformnb.io.files.errors import fail, human_bytes, printable
from deformnb.io.files.paths import as_path


def try_lock(descriptor: int) -> bool | None:
    """Lock an open file, without waiting: True if this process has it now, False if another has it, None if that cannot
    be determined.

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


def create_locked(path: Path) -> int | None:
    """Create a locked file; returns its descriptor, whose closing releases the lock.

    None if another process removed it as abandoned between the two; make another one.

    Raises
    ------
    FileExistsError
        If there is one already.
    OSError
        If it cannot be made.
    """
    descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
    return lock_open_file(path, descriptor)


def lock_open_file(path: Path, descriptor: int) -> int | None:
    """Lock a file that was just made and is open, as :func:`create_locked`; closes it where it was removed."""
    if try_lock(descriptor) is not False and _is_at(path, descriptor):
        return descriptor
    os.close(descriptor)
    return None


def lock_folder(path: Path) -> int | None:
    """Lock a folder; returns its descriptor, None where the system has no such locks."""
    try:
        return lock_open_file(path, os.open(path, os.O_RDONLY))
    except OSError:  # Windows opens no folders
        return None


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def is_abandoned(path: Path) -> bool:
    """Check whether no process holds the lock of this file. A missing file is abandoned.

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
    """Remove a file or a folder that no process holds; returns whether it was removed.

    On POSIX it is removed while the lock is ours, so its maker cannot take it for its own meanwhile.

    Parameters
    ----------
    unless : called once no other process can hold it; the file is not removed if it returns True.
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


_SUFFIX = ".deformnb.tmp"
# A lock may not exclude a process on another machine that shares the folder: only our own leftovers are removed.
_HERE = hashlib.sha256(platform.node().encode()).hexdigest()[:8]


# Of the work of one thread; see writing_held_by.
_last_doubts: ContextVar[Callable[[], AbstractContextManager[Any]]] = ContextVar("last_doubts", default=nullcontext)


@contextmanager
def guard_writes(doubts: Callable[[], AbstractContextManager[Any]]) -> Iterator[None]:
    """Enter a context for each renaming of a file into place within this block, in this thread.

    Parameters
    ----------
    doubts : makes the context, when all is written; an exception on entering preserves the old file.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "note.txt"
    >>> @contextmanager
    ... def never():
    ...     raise KeyError("not needed any more")
    ...     yield
    >>> with suppress(KeyError), guard_writes(never), atomic_write(target) as file:
    ...     _ = file.write(b"whole")
    >>> list(target.parent.iterdir())
    []
    """
    token = _last_doubts.set(doubts)
    try:
        yield
    finally:
        _last_doubts.reset(token)


def check_target(
    path: str | os.PathLike[str], *, overwrite: bool = True, needed: int = 0, folder_marks: Sequence[str] = ()
) -> Path:
    """The real path to write to, checked before any work: folder, permissions, free space.

    Parameters
    ----------
    path : the file to write; a symbolic link is followed.
    overwrite : whether an existing file may be replaced.
    needed : bytes the file may take.
    folder_marks : for a format that is a folder: names of files of which each such folder has one. Only such a folder
        is ever replaced.

    Raises
    ------
    VolumeFileError
        One sentence with the reason.
    """
    try:
        target = as_path(path).resolve()
        exists = target.exists()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name too long, a loop of links
        raise VolumeFileError(
            f"{printable(path)!r} cannot be written: it is not a usable path ({printable(error)})."
        ) from (error)
    folder = target.parent
    if not folder.is_dir():
        raise fail(target, f"cannot be written: there is no folder {printable(folder)}. Create it first.")
    if target.is_dir() and not folder_marks:
        raise fail(target, "cannot be written: this is a folder. Name a file in it.")
    if target.is_dir() and not any((target / name).is_file() for name in folder_marks):
        raise fail(target, "cannot be written: this is a folder of something else. Choose another name.")
    if exists and not target.is_dir() and (folder_marks or not target.is_file()):
        if target.is_file():
            raise fail(target, "cannot be written: this is a file, and the format is a folder. Choose another name.")
        raise fail(target, "cannot be written: this is a device or pipe, not a file.")
    if exists and not overwrite:
        raise _changed_error(target)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise fail(target, f"cannot be written: the folder {printable(folder)} is read-only for you.")
    if exists and not os.access(target, os.W_OK):
        raise fail(target, "cannot be written: the file is read-only. Choose another name or lift its protection.")
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise fail(target, f"needs {human_bytes(needed)} but the disk has only {human_bytes(free)} free.")
    return target


@contextmanager
def atomic_write(
    path: str | os.PathLike[str],
    *,
    overwrite: bool = True,
    needed: int = 0,
    replacing: Callable[[Path], AbstractContextManager[Any]] = nullcontext,
) -> Iterator[BinaryIO]:
    """A binary file that atomically replaces ``path`` at the end of the block.

    It is written next to its target, so that the final rename is on one disk, and flushed to the disk before: after
    a crash there is the old file or the new one. An exception (a full disk, :class:`~deformnb.errors.Cancelled`)
    leaves the old file and no temporary ones; those of a killed process are removed by the next that writes into the
    folder. The permissions of an existing file are preserved.

    Parameters
    ----------
    path, overwrite, needed : see :func:`check_target`.
    replacing : makes the context, from the real path, in which the old file is replaced when all is written; its
        exceptions preserve the old file.

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
                _rename_into_place(temporary, target, overwrite=overwrite)
        finally:
            if lock is not None:
                os.close(lock)
    except OSError as error:
        if isinstance(error, ValueError):  # a DeformError that is also an ImportError or the like: not ours
            raise
        raise write_error(target, error, "an older file of this name is untouched") from error
    finally:
        if temporary != target.parent:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
    flush_folder(target.parent)


@contextmanager
def atomic_folder(
    path: str | os.PathLike[str], *, overwrite: bool = True, folder_marks: Sequence[str]
) -> Iterator[Path]:
    """A new folder that atomically replaces ``path`` at the end of the block.

    As :func:`atomic_write`. Where an older folder is replaced, the two are renamed one after the other.

    Parameters
    ----------
    path, overwrite, folder_marks : see :func:`check_target`.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "volume.zarr"
    >>> with atomic_folder(target, folder_marks=["zarr.json"]) as folder:
    ...     _ = (folder / "zarr.json").write_text("{}")
    >>> [entry.name for entry in target.iterdir()]
    ['zarr.json']
    """
    target = check_target(path, overwrite=overwrite, folder_marks=folder_marks)
    sweep_folder(target.parent)
    temporary = target.with_name(temporary_name())
    lock = None
    try:
        temporary.mkdir()
        lock = lock_folder(temporary)
        yield temporary
        with _last_doubts.get()():
            publish_folder(temporary, target, overwrite=overwrite)
    except OSError as error:
        if isinstance(error, ValueError):
            raise
        raise write_error(target, error, "an older one of this name is untouched") from error
    finally:
        if lock is not None:
            os.close(lock)
        shutil.rmtree(temporary, ignore_errors=True)


def write_error(target: Path, error: OSError, rest: str) -> VolumeFileError:
    """The error that states why the system did not write a file or folder, and which file remains.

    Examples
    --------
    >>> str(write_error(Path("a.zarr"), OSError(errno.ENOSPC, "no space"), "an older one is untouched"))
    'a.zarr: was not written, the disk (or your share of it) is full; an older one is untouched.'
    """
    # NumPy's tofile, which tifffile uses, counts the bytes written and gives no number of an error.
    is_short = error.errno is None and "requested and" in str(error)
    full = is_short or error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    why = (
        "the disk (or your share of it) is full"
        if full
        else f"the system reports: {error.strerror or printable(error)}"
    )
    return fail(target, f"was not written, {why}; {rest}.")


def publish_folder(temporary: Path, target: Path, *, overwrite: bool) -> None:
    """Rename a finished folder into place; an older one is removed afterwards."""
    old = target.with_name(temporary_name())
    with _last_doubts.get()():
        if target.exists():
            if not overwrite:
                raise _changed_error(target)
            target.rename(old)
        try:
            temporary.rename(target)
        except OSError:
            if old.exists():
                old.rename(target)
            raise
        flush_folder(target.parent)
    shutil.rmtree(old, ignore_errors=True)


def _rename_into_place(temporary: Path, target: Path, *, overwrite: bool) -> None:
    """Rename a file into place; where it must be new, a file of a concurrent process is not replaced."""
    if overwrite:
        temporary.replace(target)
        return
    try:
        target.hardlink_to(temporary)  # in one operation, as no rename can
    except FileExistsError:
        raise _changed_error(target) from None
    except (OSError, NotImplementedError):  # a file system without links
        if target.exists():
            raise _changed_error(target) from None
        temporary.replace(target)


def _changed_error(target: Path) -> FileChangedError:
    return FileChangedError(f"{printable(target.name)}: exists already and overwrite is False. Choose another name.")


def temporary_name() -> str:
    """A name for an unfinished file, of at most 255 bytes, the limit of common file systems."""
    return f".{_HERE}-{secrets.token_hex(8)}{_SUFFIX}"


def _open_temporary(target: Path) -> tuple[Path, BinaryIO, int | None]:
    """A new file next to the target, and a lock on it that outlives the file's closing."""
    while True:
        temporary = target.with_name(temporary_name())
        file = temporary.open("xb")
        if os.name == "nt":  # an open file can be neither renamed nor removed there
            return temporary, file, None
        lock = lock_open_file(temporary, os.dup(file.fileno()))
        if lock is not None:
            return temporary, file, lock
        file.close()


def sweep_folder(folder: Path) -> None:
    """Remove the unfinished files of killed processes of this machine."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(_SUFFIX) and entry.name.startswith(f".{_HERE}-"):
                sweep(Path(entry.path))


def flush_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, where the system can."""
    # The rename is data of the folder. Windows cannot open folders, network drives may refuse: the file is whole.
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


_MOST = 1000  # files of one session
_PATIENCE = 2.0  # seconds for another writer's rename; a lock that never comes must not stop the work


class KnownFiles:
    """Checksums of files when they were last read or written here; times do not count.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "fish.json"
    >>> files = KnownFiles()
    >>> files.check(path)  # there is none
    >>> _ = path.write_bytes(b"mine")
    >>> files.remember(path)
    >>> files.check(path)
    >>> _ = path.write_bytes(b"yours")
    >>> files.check(path)
    Traceback (most recent call last):
        ...
    deformnb.errors.FileChangedError: fish.json has been changed by someone else since ...
    """

    def __init__(self) -> None:
        self._digests: dict[Path, bytes] = {}
        self._lock = threading.Lock()

    def remember(self, path: str | PathLike[str], content: bytes | None = None) -> None:
        """Record the file as known, with this content or the present one; ignored if there is no file."""
        with suppress(OSError):
            digest = _digest(path) if content is None else hashlib.sha256(content).digest()
            with self._lock:
                place = _real(path)
                self._digests.pop(place, None)
                self._digests[place] = digest
                while len(self._digests) > _MOST:
                    del self._digests[next(iter(self._digests))]

    def has(self, path: str | PathLike[str]) -> bool:
        """Check whether a file was opened or written here, with any present content."""
        return _real(path) in self._digests

    def check(self, path: str | PathLike[str]) -> None:
        """Refuse to overwrite a file that was neither opened nor written here.

        Raises
        ------
        FileChangedError
            If the file is there and holds something else.
        """
        place = _real(path)
        known = self._digests.get(place)
        if not place.exists() or place.is_dir():  # of a folder the writer reports more
            return
        with suppress(OSError):  # an unreadable file may hold anything
            if known is not None and _digest(place) == known:
                return
        what = (
            "was there before, and was neither opened nor saved here"
            if known is None
            else "has been changed by someone else since it was opened or saved here"
        )
        raise FileChangedError(
            f"{printable(Path(path).name)} {what}. Save under another name, or with overwrite=True to replace it."
        )

    @contextmanager
    def writing(self, path: str | PathLike[str], *, overwrite: bool = False) -> Iterator[None]:
        """Context of writing a file: checked before it begins, and known afterwards."""
        if not overwrite:
            self.check(path)
        yield
        self.remember(path)

    @contextmanager
    def replacing(self, path: Path) -> Iterator[None]:
        """The moment in which a file is replaced: checked once more, and no other session's writer comes between."""
        descriptor = None
        with suppress(OSError):
            descriptor = os.open(path, os.O_RDWR)
        try:
            if descriptor is not None and os.name != "nt":  # an open file cannot be replaced there
                end = time.monotonic() + _PATIENCE
                while try_lock(descriptor) is False and time.monotonic() < end:
                    time.sleep(0.002)
            self.check(path)
            if descriptor is not None and os.name == "nt":
                os.close(descriptor)
                descriptor = None
            yield
        finally:
            if descriptor is not None:
                os.close(descriptor)


def _digest(path: str | PathLike[str]) -> bytes:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _real(path: str | PathLike[str]) -> Path:
    return as_path(path).resolve()
