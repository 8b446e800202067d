"""Paths of files: expanded names, addresses told apart from them, and plain files only.

Every function that is given the path of a file passes it through :func:`as_path`, which refuses an address by name.
Those that read an address take :func:`deformnb.io.files.addresses.input_path` in its place.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit
from urllib.request import url2pathname

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import fail, printable

# A scheme has two letters at least: one is a drive of Windows. A Path has lost one of the two slashes.
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):[/\\]+")
_CHAIN = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+::(?=.*:[/\\])")  # of fsspec: simplecache::https://host/carp.nrrd
_LONGEST_NAME = 255  # bytes of a file's, on every usual disk
_THIS_MACHINE = re.compile(r"file://localhost(?=/)")


def address_of(path: object) -> str:
    """The address (URL) that a text or a path is; empty for the name of a file.

    Examples
    --------
    >>> address_of("s3://scans/carp.nrrd"), address_of(Path("https://host/carp.nrrd")), address_of("C:/carp.nrrd")
    ('s3://scans/carp.nrrd', 'https://host/carp.nrrd', '')
    """
    if not isinstance(path, str | os.PathLike):
        return ""
    text = os.fspath(path)
    if not isinstance(text, str):
        return ""
    found = _ADDRESS.match(text)
    if found is None:
        return text if _CHAIN.match(text) else ""
    scheme, rest = found[1].lower(), text[found.end() :]
    if isinstance(path, str) and text.startswith("://", len(scheme)):
        return _THIS_MACHINE.sub("file://", scheme + text[len(scheme) :])
    return f"{scheme}://{'/' if scheme == 'file' else ''}{rest.replace(os.sep, '/')}"


def format_address(address: str) -> str:
    """An address for a message, without a user's name and password."""
    return printable(re.sub(r"://[^/]*@", "://", address))


def split_address(address: str) -> SplitResult:
    """The parts of an address; of a chain, those of its first one.

    Raises
    ------
    VolumeFileError
        If it is damaged, or names no server where one is needed.

    Examples
    --------
    >>> split_address("https://host/carp.nrrd?raw=1").path
    '/carp.nrrd'
    """
    try:
        parts = urlsplit(address.partition("::")[0])
        _ = parts.port  # which is checked when it is asked for
    except ValueError as error:
        raise VolumeFileError(f"{format_address(address)} is no address ({printable(error)}).") from error
    if parts.scheme in ("http", "https") and not parts.hostname:
        raise VolumeFileError(f"{format_address(address)} names no server; an address is https://server/folder/file.")
    return parts


def local_file(address: str) -> Path:
    """The path of a file at an address whose scheme is file.

    Raises
    ------
    VolumeFileError
        If it is on another machine.

    Examples
    --------
    >>> local_file("file:///scans/the%20carp.nrrd").as_posix()
    '/scans/the carp.nrrd'
    """
    machine, _, rest = address.removeprefix("file://").partition("/")
    if machine and os.name != "nt":  # where it may be a shared folder
        raise VolumeFileError(
            f"{format_address(address)} is a file of the machine {printable(machine)!r}; one of this machine has three "
            f"slashes and its full path: file:///folder/{printable(rest.rpartition('/')[2])}."
        )
    return Path(url2pathname(address.removeprefix("file:" if machine else "file://")))


def named_path(path: str | os.PathLike[str]) -> Path:
    """The name of a file, of which only the ending is asked for; of an address its last part."""
    address = address_of(path)
    return Path(split_address(address).path) if address else as_path(path)


def as_path(path: str | os.PathLike[str] | Any) -> Path:
    """The path of a name, with ``~`` expanded; VolumeFileError if it names no file, or is an address elsewhere."""
    address = address_of(path)
    if address.startswith("file://"):
        return local_file(address)
    if address:
        raise VolumeFileError(
            f"{format_address(address)} is an address ({address.partition(':')[0]}), and the path of a file on this "
            "machine is needed here; read_volume and the other readers of dn.io take addresses, and the writers open "
            'files: with fsspec.open(address, "wb") as file.'
        )
    if isinstance(path, str | bytes) and not path:
        raise VolumeFileError("an empty text names no file.")
    if hasattr(path, "read") or hasattr(path, "write"):
        raise VolumeFileError(f"{printable(path)} is an open file, and the path of one is needed here.")
    try:
        found = Path(os.fsdecode(path)).expanduser()
    except (TypeError, RuntimeError) as error:
        raise VolumeFileError(f"{printable(path)}: this is not the path of a file ({printable(error)}).") from error
    if "\0" in str(found) or max((len(os.fsencode(part)) for part in found.parts), default=0) > _LONGEST_NAME:
        raise VolumeFileError(
            f"{printable(found)} names no file: a name has at most {_LONGEST_NAME} bytes, and none of them is 0."
        )
    return found


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
