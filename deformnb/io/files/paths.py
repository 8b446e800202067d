"""Paths of files to read: expanded names, and plain files only."""

from __future__ import annotations

import os
from pathlib import Path

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import fail, printable


def as_path(path: str | os.PathLike[str]) -> Path:
    """The path of a name, with ``~`` expanded; VolumeFileError if it names no file."""
    try:
        return Path(path).expanduser()
    except (TypeError, RuntimeError) as error:
        raise VolumeFileError(f"{printable(path)}: this is not the path of a file ({printable(error)}).") from error


def regular_file(path: Path) -> Path:
    """The path if it is a plain file; a pipe would block for ever and a device has no end."""
    try:
        if path.is_file():
            return path
        exists = path.exists()
    except (OSError, ValueError) as error:
        raise VolumeFileError(f"{printable(path)!r} is not a usable path ({printable(error)}).") from error
    raise fail(
        path,
        "this is not a plain file." if exists else f"there is no such file in {printable(path.absolute().parent)}.",
    )
