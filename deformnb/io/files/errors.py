"""Errors that name the file: exceptions of its parsers in one sentence, and external text fit for a message."""

from __future__ import annotations

import csv
import lzma
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deformnb.errors import Cancelled, DeformError, VolumeFileError


def printable(text: object, limit: int = 120) -> str:
    r"""Text from outside made fit for a message: no control characters, no end of line, not too long.

    Examples
    --------
    >>> print(printable("a\x1b[31m b"))
    a\x1b[31m b
    """
    try:
        plain = str(text)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        plain = "a number of thousands of digits"
    if len(plain) > limit:
        plain = plain[:limit] + "..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "replace").decode() for c in plain)


def fail(path: Path, why: str) -> VolumeFileError:
    """The error with the file and the reason."""
    return VolumeFileError(f"{printable(path.name or path)}: {why}")


# Exceptions of damaged files and failing disks below this level; any other is an unforeseen case.
_DAMAGE = (
    OSError,
    EOFError,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    csv.Error,
    MemoryError,
    OverflowError,
    ValueError,
    RecursionError,
)


UNFORESEEN = "for a reason that deformnb does not know"
"""Words of a message about an error that no reader has foreseen."""


class Damage:
    """Translate exceptions of the parsers of a file into the one error that names the file.

    Parameters
    ----------
    path : the file.
    advice : cure where there is not enough memory for it.
    """

    def __init__(self, path: Path, advice: str) -> None:
        self._path, self._advice = path, advice

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, MemoryError):
            raise fail(self._path, f"there is not enough memory for it; {self._advice}.") from error
        if isinstance(error, _DAMAGE) and not isinstance(error, DeformError):
            why = (
                "its text is not UTF-8"
                if isinstance(error, UnicodeError)
                else printable(error).rstrip(".") or type(error).__name__
            )
            raise fail(self._path, f"it cannot be read: {why}.") from error
        if isinstance(error, DeformError) and not isinstance(error, (VolumeFileError, ImportError)):
            raise fail(self._path, str(error)) from error
        if isinstance(error, Exception) and not isinstance(error, (DeformError, Cancelled, Warning)):
            raise fail(
                self._path,
                f"it cannot be read, {UNFORESEEN} ({type(error).__name__}: {printable(error)}); please "
                "report it with the file.",
            ) from error


@contextmanager
def unpacking(path: Path) -> Iterator[None]:
    """Translate exceptions of packed data, any of them where these are damaged, into an error that names the file."""
    try:
        yield
    except (MemoryError, DeformError):
        raise
    except Exception as error:
        raise fail(path, f"it cannot be read: {printable(error) or type(error).__name__}.") from error


def human_bytes(count: int) -> str:
    """A number of bytes for people.

    Examples
    --------
    >>> human_bytes(3 * 2**30)
    '3.0 GiB'
    """
    size = float(count)
    for unit in ("bytes", "KiB", "MiB", "GiB", "TiB", "PiB"):
        if size < 1024:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1024
    return f"{size:.0f} EiB"
