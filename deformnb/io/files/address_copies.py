"""Copies of files at addresses (URLs) in the cache of the user: where they are, of which address, and small files.

The copies of one state of one file are in a folder of their own, in which a note names the address.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from email.message import Message
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit, urlunsplit

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import human_bytes, printable
from deformnb.io.files.folders import data_home
from deformnb.io.files.paths import format_address

SECONDS = 30
"""Time in which a server has to answer."""

_NOTE = "address.json"
_ABSENT = (404, 410)
_REPLY_PART = 2**16  # bytes of a reply that are read at a time


def addresses_home() -> Path:
    """Folder of all copies."""
    return data_home() / "addresses"


def folder_for(address: str, state: str) -> Path:
    """The folder for the copy of an address in one state, which is made."""
    key = hashlib.sha256(f"{address}\n{state}".encode("utf-8", "surrogatepass")).hexdigest()[:32]
    folder = addresses_home() / key
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def note_address(copy: Path, address: str) -> None:
    """Note of which address a copy is, once it is whole."""
    _noted_address.cache_clear()
    write_whole(copy.parent / _NOTE, json.dumps({"address": address}).encode())


def address_of_copy(path: Path) -> tuple[str, Path] | None:
    """The address of which a path in the cache is a copy, or lies in a folder that is one, and the path of that copy.

    Examples
    --------
    >>> address_of_copy(Path("carp.nrrd")) is None
    True
    """
    home = addresses_home()
    if not path.is_relative_to(home) or len(inner := path.relative_to(home).parts) < 2:
        return None
    address = _noted_address(home / inner[0] / _NOTE)
    return None if address is None else (address, home / inner[0] / inner[1])


@cache
def _noted_address(note: Path) -> str | None:
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        return str(json.loads(note.read_bytes())["address"])
    return None


def list_copies() -> list[tuple[str, int]]:
    """The addresses of which there are copies, with the bytes of each on disk, the largest first."""
    found = []
    for note in addresses_home().glob(f"*/{_NOTE}"):
        sizes = [file.stat().st_size for file in note.parent.rglob("*") if file.is_file() and file != note]
        found.append((_noted_address(note) or note.parent.name, sum(sizes)))
    return sorted(found, key=lambda row: -row[1])


def remove_copies() -> None:
    """Remove all copies; what is read again comes again.

    Raises
    ------
    VolumeFileError
        If one cannot be removed, such as one from which a program still reads.
    """
    _noted_address.cache_clear()
    home = addresses_home()
    try:
        if home.is_dir():
            shutil.rmtree(home)
    except OSError as error:
        raise VolumeFileError(f"{printable(home)}: the copies cannot all be removed ({printable(error)}).") from error


def neighbour(address: str, name: str) -> str:
    """The address of a file in the folder of another.

    Examples
    --------
    >>> neighbour("https://host/scans/carp.nhdr?key=1", "the carp.raw")
    'https://host/scans/the%20carp.raw?key=1'
    >>> neighbour("zip://scans/carp.nhdr::/data/all.zip", "carp.raw")
    'zip://scans/carp.raw::/data/all.zip'
    """
    return _with_path(address, lambda path: path.rpartition("/")[0], name)


def inside(address: str, name: str) -> str:
    """The address of a file in the folder that another is.

    Examples
    --------
    >>> inside("s3://scans/carp.zarr/", "0/.zarray")
    's3://scans/carp.zarr/0/.zarray'
    """
    return _with_path(address, lambda path: path.rstrip("/"), name)


def _with_path(address: str, folder: Callable[[str], str], name: str) -> str:
    first, chain, rest = address.partition("::")
    if is_web(address):
        parts = urlsplit(first)
        first = urlunsplit(parts._replace(path=f"{folder(parts.path)}/{quote(name)}"))
    else:
        scheme, _, path = first.partition("://")
        first = f"{scheme}://{folder(path)}/{name}".replace(":///", "://")
    return first + chain + rest


def is_web(address: str) -> bool:
    """Check for an address at http or https, which needs no other package."""
    return address.partition(":")[0] in ("http", "https")


def request_bytes(address: str, most: int, *, is_optional: bool = False) -> tuple[bytes, str] | None:
    """The bytes of a file at an address and its state there; None if it is absent.

    Parameters
    ----------
    most : bytes that it may have.
    is_optional : of a file that is looked for: servers that do not list what they have answer the same (403) for one
        that is absent as for one that may not be read.

    Raises
    ------
    VolumeFileError
        If it has more bytes, the server refuses it, or there is no network.
    """
    return _from_web(address, most, is_optional) if is_web(address) else _from_fsspec(address, most)


def state_at(address: str) -> str | None:
    """The state of a file at an address, as of :func:`request_bytes`; empty if unknown, and None without a file."""
    if not is_web(address):
        return _state_by_fsspec(address)
    answer = _head(address)
    if answer is None:
        return ""
    return None if answer.status_code in _ABSENT else _state_of(answer) if answer.ok else ""


def ask_about(address: str) -> tuple[str, str]:
    """The state of a file at http or https by its headers, and the name that the server gives it; both may be empty."""
    answer = _head(address)
    return (_state_of(answer), _name_given(answer)) if answer is not None and answer.ok else ("", "")


def _head(address: str) -> Any:
    """The headers of a file on a server; None where it does not answer, of which the download says what is wrong."""
    import requests

    with (
        contextlib.suppress(requests.RequestException, ValueError),
        _session().head(address, timeout=SECONDS, allow_redirects=True) as answer,
    ):
        return answer
    return None


def _state_of(answer: Any) -> str:
    """The tag, date and size of a file by its headers; empty without tag and date, as a changed one may be as long."""
    tag, date, size = (answer.headers.get(name, "") for name in ("ETag", "Last-Modified", "Content-Length"))
    return f"{tag}|{date}|{size}" if tag or date else ""


def _name_given(answer: Any) -> str:
    about = Message()
    about["Content-Disposition"] = answer.headers.get("Content-Disposition", "")
    return about.get_filename() or urlsplit(answer.url).path


def _state_by_fsspec(address: str) -> str | None:
    from fsspec.core import url_to_fs

    try:
        system, inner = url_to_fs(address)
        return str(system.ukey(inner))
    except FileNotFoundError:
        return None
    except Exception:  # of some fifty kinds of servers; the file that is asked for says what is wrong
        return ""


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole: threads and processes that read the same copy see all of it or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".part-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def describe_failure(address: str, error: Exception) -> VolumeFileError:
    """The error of a download that failed: why, and what to do; it names no password."""
    host = urlsplit(address).hostname
    return VolumeFileError(f"{format_address(address)} could not be downloaded from {host} ({explain(error)}).")


def explain(error: Exception) -> str:
    """Reason why a download failed and what to do, without the parts of other packages' messages that help nobody."""
    from requests import exceptions

    if isinstance(error, exceptions.HTTPError) and error.response is not None:
        return f"{error.response.status_code}: {_explain_status(error.response.status_code)}"
    for kind, text in (
        (exceptions.Timeout, f"there was no answer within {SECONDS} s; try again later"),
        (exceptions.SSLError, "its certificate is not trusted, or it does not speak https"),
        (exceptions.ProxyError, "the proxy that the environment names does not answer"),
        (exceptions.ConnectionError, "there is no connection to it; check the name of the server, and the network"),
        (exceptions.TooManyRedirects, "it leads in a circle"),
        (exceptions.ChunkedEncodingError, "the connection broke off; try again"),
        (exceptions.InvalidURL, "this is no address"),
    ):
        if isinstance(error, kind):
            return text
    said = printable(error).rstrip(".")
    return type(error).__name__ if len(said) > 120 or not said else said


def _explain_status(status: int) -> str:
    if status in _ABSENT:
        return "there is no such file on the server; check the address"
    if status in (401, 407):
        return "it asks for a user and a password, as in https://user:password@server/file"
    if status == 403:
        return "the server does not give it to everyone; ask its owner"
    return "the server has an error; try again later" if status >= 500 else "the server refuses it"


def describe_refusal(address: str, error: Exception) -> VolumeFileError:
    """The error of a file that the package fsspec could not read."""
    return VolumeFileError(f"{format_address(address)} cannot be read ({type(error).__name__}: {printable(error)}).")


def _too_large(address: str, most: int) -> VolumeFileError:
    return VolumeFileError(f"{format_address(address)} has more than {human_bytes(most)}: it is not copied.")


def _from_web(address: str, most: int, is_optional: bool) -> tuple[bytes, str] | None:
    import requests

    try:
        with _session().get(address, timeout=SECONDS, stream=True) as answer:
            if answer.status_code in _ABSENT or (is_optional and answer.status_code == 403):
                return None
            answer.raise_for_status()
            content = bytearray()
            for part in answer.iter_content(_REPLY_PART):
                content += part
                if len(content) > most:
                    raise _too_large(address, most)
            return bytes(content), _state_of(answer)
    except requests.RequestException as error:
        raise describe_failure(address, error) from error


@cache
def _session() -> Any:
    """One session for all, so that its connections serve many chunks."""
    import requests
    from requests.adapters import HTTPAdapter

    session = requests.Session()
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(pool_maxsize=32))
    return session


def _from_fsspec(address: str, most: int) -> tuple[bytes, str] | None:
    from fsspec.core import url_to_fs

    try:
        system, inner = url_to_fs(address)
        if (system.size(inner) or 0) > most:
            raise _too_large(address, most)
        return system.cat_file(inner), str(system.ukey(inner))
    except FileNotFoundError:
        return None
    except VolumeFileError:
        raise
    except Exception as error:  # the errors of some fifty kinds of servers
        raise describe_refusal(address, error) from error
