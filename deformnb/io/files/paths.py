"""Paths of files: expanded names, addresses told apart from them, and plain files only.

Every function that is given the path of a file passes it through :func:`as_path`, which refuses an address by name.
Those that read an address take :func:`deformnb.io.files.addresses.input_path` in its place.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import fail, printable

# A scheme has two letters at least: one is a drive of Windows. A Path has lost one of the two slashes.
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):[/\\]{1,2}(?=[^/\\])|(file):[/\\]+", re.IGNORECASE)


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
    found = _ADDRESS.match(text) if isinstance(text, str) else None
    if found is None:
        return ""
    rest = text[found.end() :]
    scheme = (found[1] or found[2]).lower()
    return f"{scheme}://{'/' if scheme == 'file' else ''}{rest if isinstance(path, str) else rest.replace(os.sep, '/')}"


def format_address(address: str) -> str:
    """An address for a message, without a user's name and password."""
    scheme, _, rest = address.partition("://")
    host, slash, path = rest.partition("/")
    return printable(f"{scheme}://{host.rpartition('@')[2]}{slash}{path}")


def named_path(path: str | os.PathLike[str]) -> Path:
    """The name of a file, of which only the ending is asked for; of an address its last part."""
    address = address_of(path)
    return Path(urlsplit(address.partition("::")[0]).path) if address else as_path(path)


def as_path(path: str | os.PathLike[str] | Any) -> Path:
    """The path of a name, with ``~`` expanded; VolumeFileError if it names no file, or is an address."""
    if address := address_of(path):
        raise VolumeFileError(
            f"{format_address(address)} is an address ({address.partition(':')[0]}), and the path of a file on this "
            "machine is needed here; read_volume and the other readers of dn.io take addresses."
        )
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
