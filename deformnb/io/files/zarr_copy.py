"""Folders of Zarr at addresses (URLs): metadata are copied when they are opened, each chunk when it is first read.

So a level that fits is read of a pyramid of any size. A copy lies in the cache of the user, under the state of the
metadata at the address: where these are written anew the whole comes anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote, urlsplit, urlunsplit

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import human_bytes, printable
from deformnb.io.files.folders import addresses_home
from deformnb.io.files.paths import format_address
from deformnb.io.files.room import free_share

MARKS = ("zarr.json", ".zgroup", ".zarray")
"""Files of metadata of which each folder of Zarr has one."""

_METADATA = (*MARKS, ".zattrs")
_MOST_METADATA = 2**20  # bytes of one such file, as of other headers
_SECONDS = 30  # in which a server has to answer
_CHUNK = 2**16  # bytes of a reply that are read at a time
_ADDRESS_FILE = "address.json"  # beside the copy


@dataclass(frozen=True)
class ZarrCopy:
    """The part of a folder of Zarr at an address that has been copied.

    Parameters
    ----------
    address : of the folder.
    folder : where its files are copied to, in the cache.
    """

    address: str
    folder: Path

    @classmethod
    def open(cls, address: str, name: str) -> ZarrCopy | None:
        """Copy the metadata of a folder; None where there are none of Zarr.

        Parameters
        ----------
        name : of the folder that holds the copies.

        Raises
        ------
        VolumeFileError
            If there is no network, or the server does not answer.
        """
        found = {file: answer for file in _METADATA if (answer := _request(address, file, _MOST_METADATA)) is not None}
        if not found.keys() & set(MARKS):
            return None
        state = hashlib.sha256(address.encode("utf-8", "surrogatepass"))
        for file, (content, tag) in sorted(found.items()):
            state.update(f"\n{file} {tag} ".encode() + content)
        copy = cls(address, addresses_home() / state.hexdigest()[:32] / name)
        for file, (content, _) in found.items():
            copy._store(file, content)
        _write(copy.folder.parent / _ADDRESS_FILE, json.dumps({"address": address}).encode())
        if _is_image_set(found):  # bioformats2raw: the images are the folders 0, 1 and so on
            for file in (f"{image}/{one}" for image in (0, 1) for one in _METADATA):
                copy.fetch(file)
        return copy

    @classmethod
    def containing(cls, path: Path) -> tuple[ZarrCopy, str] | None:
        """The copy to which a folder in the cache belongs, and its place in that; None for any other folder.

        Examples
        --------
        >>> ZarrCopy.containing(Path("carp.zarr")) is None
        True
        """
        home = addresses_home()
        if not path.is_relative_to(home) or len(inner := path.relative_to(home).parts) < 2:
            return None
        text = _stated_address(home / inner[0] / _ADDRESS_FILE)
        return None if text is None else (cls(text, home / inner[0] / inner[1]), "/".join(inner[2:]))

    def fetch(self, key: str) -> None:
        """Copy a file if it is not there yet; one that is absent at the address stays absent, as empty chunks do.

        Raises
        ------
        VolumeFileError
            If the server refuses it, there is no network, or it has more bytes than half of the free disk.
        """
        if (self.folder / key).exists():
            return
        is_metadata = key.rpartition("/")[2] in _METADATA
        answer = _request(self.address, key, _MOST_METADATA if is_metadata else free_share(self.folder))
        if answer is not None:
            self._store(key, answer[0])

    def _store(self, key: str, content: bytes) -> None:
        _write(self.folder / key, content)


@cache
def _stated_address(file: Path) -> str | None:
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError):
        return str(json.loads(file.read_bytes())["address"])
    return None


def _is_image_set(found: dict[str, tuple[bytes, str]]) -> bool:
    for file in ("zarr.json", ".zattrs"):
        if file in found:
            with contextlib.suppress(ValueError, AttributeError):
                about = json.loads(found[file][0])
                about = about.get("attributes", about)
                if "bioformats2raw.layout" in about.get("ome", about):
                    return True
    return False


def _write(path: Path, content: bytes) -> None:
    """Write a file whole: threads and processes that read the same chunk see all of it or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".part-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _request(address: str, key: str, most: int) -> tuple[bytes, str] | None:
    """The bytes and the state of a file in the folder at an address; None if it is not there."""
    scheme = address.partition(":")[0]
    return (_request_from_web if scheme in ("http", "https") else _request_from_fsspec)(address, key, most)


def _too_large(address: str, key: str, most: int) -> VolumeFileError:
    return VolumeFileError(
        f"{format_address(address)}/{printable(key)} has more than {human_bytes(most)}: it is not copied."
    )


def _request_from_web(address: str, key: str, most: int) -> tuple[bytes, str] | None:
    import requests

    parts = urlsplit(address)
    whole = urlunsplit(parts._replace(path=f"{parts.path.rstrip('/')}/{quote(key)}"))
    is_probe = key.rpartition("/")[2] in _METADATA
    try:
        with _session().get(whole, timeout=_SECONDS, stream=True) as answer:
            # Stores that may not be listed answer 403 for what is absent; of a chunk that would be an empty one.
            if answer.status_code in (404, 410) or (is_probe and answer.status_code == 403):
                return None
            answer.raise_for_status()
            content = bytearray()
            for part in answer.iter_content(_CHUNK):
                content += part
                if len(content) > most:
                    raise _too_large(address, key, most)
            tag = "|".join(answer.headers.get(name, "") for name in ("ETag", "Last-Modified"))
            return bytes(content), tag
    except requests.RequestException as error:
        said = printable(error).replace(address, format_address(address)).rstrip(".")
        reason = type(error).__name__ if len(said) > 120 or not said else said
        raise VolumeFileError(
            f"{format_address(address)}/{printable(key)} could not be downloaded from {parts.hostname} ({reason})."
        ) from error


@cache
def _session() -> Any:
    """One for all, so that its connections serve many chunks."""
    import requests
    from requests.adapters import HTTPAdapter

    session = requests.Session()
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(pool_maxsize=32))
    return session


def _request_from_fsspec(address: str, key: str, most: int) -> tuple[bytes, str] | None:
    from fsspec.core import url_to_fs

    system, inner = url_to_fs(address)
    name = f"{inner.rstrip('/')}/{key}"
    try:
        if (system.size(name) or 0) > most:
            raise _too_large(address, key, most)
        return system.cat_file(name), str(system.ukey(name))
    except FileNotFoundError:
        return None
    except VolumeFileError:
        raise
    except Exception as error:  # the errors of some fifty kinds of servers
        raise VolumeFileError(
            f"{format_address(address)}/{printable(key)} cannot be read ({type(error).__name__}: {printable(error)})."
        ) from error


def is_named_zarr(address: str) -> bool:
    """Check whether an address names a folder of Zarr: one of its parts ends with ``.zarr``.

    Examples
    --------
    >>> is_named_zarr("https://host/scans/carp.zarr/0"), is_named_zarr("https://host/carp.zarr.zip")
    (True, False)
    """
    return any(unquote(part).lower().endswith(".zarr") for part in urlsplit(address).path.split("/"))
