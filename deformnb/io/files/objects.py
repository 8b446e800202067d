"""Open files and bytes in memory in place of paths: written to a temporary file to be read, and read from one."""

from __future__ import annotations

import io
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeGuard

from deformnb.checks import short_value
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.files.room import free_share
from deformnb.io.files.streams import CHUNK


def is_open_file(given: object) -> TypeGuard[BinaryIO]:
    """Check whether an object is an open file, such as ``open(path, "rb")`` or ``io.BytesIO()``.

    Examples
    --------
    >>> import io
    >>> is_open_file(io.BytesIO()), is_open_file("carp.nrrd"), is_open_file(io.BytesIO)
    (True, False, False)
    """
    return not isinstance(given, type) and (hasattr(given, "read") or hasattr(given, "write"))


def name_for(file: Any, suffix: str | None) -> str:
    """The name of a file that states its format: by ``suffix``, else its own.

    Raises
    ------
    DeformError
        If it has none and no suffix is given.
    """
    if suffix is not None:
        if not isinstance(suffix, str) or not suffix.strip(". ") or "/" in suffix or "\\" in suffix:
            raise DeformError(f'suffix is the ending of a name, such as ".nii.gz", got {short_value(suffix)}.')
        return f"file.{suffix.lstrip('.')}"
    own = getattr(file, "name", None)
    if isinstance(own, str) and Path(own).suffix:
        return Path(own).name
    raise DeformError('an open file without a name needs its format, such as suffix=".nii.gz".')


def check_open(file: Any, mode: Literal["rb", "wb"]) -> None:
    """Refuse a file that is closed, of text, or open for the other direction, before any work.

    Raises
    ------
    VolumeFileError
        With the mode in which to open it.
    """
    act, asked = ("read", "readable") if mode == "rb" else ("write", "writable")
    if isinstance(file, io.TextIOBase):
        raise VolumeFileError(f"an open file must hold bytes, and this is one of text (str): open it as {mode!r}.")
    if getattr(file, "closed", False) is True:
        raise VolumeFileError("this file is closed; keep it open (in its with block), or name its path.")
    can = getattr(file, asked, None)
    if not hasattr(file, act) or (callable(can) and not can()):
        raise VolumeFileError(f"this file is not open to {act}: open it as {mode!r}.")


@contextmanager
def copied_to_disk(file: BinaryIO, name: str) -> Iterator[Path]:
    """Copy the rest of an open file into a temporary one, which is removed afterwards.

    Raises
    ------
    VolumeFileError
        If it is none of bytes to read, gives none, takes more than half of the free disk, or should be a folder (Zarr).
    """
    if name.lower().endswith(".zarr"):
        raise VolumeFileError("a folder of Zarr is not one file, and an open file is one: name its path or address.")
    check_open(file, "rb")
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        path, room = Path(folder) / name, free_share(Path(folder))
        with path.open("wb") as target:
            while chunk := file.read(CHUNK):
                if not isinstance(chunk, bytes | bytearray | memoryview):
                    raise VolumeFileError(f"an open file must give bytes, got {type(chunk).__name__}: open it as 'rb'.")
                room -= len(chunk)
                if room < 0:
                    raise VolumeFileError("an open file takes more than half of the free disk.")
                target.write(chunk)
            if not target.tell():
                raise VolumeFileError(
                    "an open file gives no bytes from where it stands; file.seek(0) goes back to its beginning."
                )
        yield path


@contextmanager
def copied_from_disk(file: BinaryIO, name: str) -> Iterator[Path]:
    """A path to write to, whose content then goes to an open file as a whole; nothing does after an error.

    Raises
    ------
    VolumeFileError
        If it is none of bytes to write, or several files, or a folder, were written: an open file holds one.
    """
    check_open(file, "wb")
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        path = Path(folder) / name
        yield path
        if not path.is_file() or len(list(Path(folder).iterdir())) != 1:
            raise VolumeFileError(f"{path.suffix} is not one file but several; an open file holds one, so name a path.")
        with path.open("rb") as source:
            shutil.copyfileobj(source, file)
