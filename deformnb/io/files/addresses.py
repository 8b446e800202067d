"""Files at addresses (URLs), copied into the cache of the user before they are read.

A file at ``http`` or ``https`` is downloaded by pooch and kept, under the date and size that its server states, so that
it comes once and a changed one comes again. A file or a folder at any other address (``s3``, ``zip``, ``memory``) is
copied by the package fsspec. Both are refused where they would take more than half of the free disk. Of a folder of
Zarr only what is read is copied (:mod:`deformnb.io.files.zarr_copy`).
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from deformnb._typing import Progress
from deformnb.errors import MissingPackageError, VolumeFileError
from deformnb.io.files.address_copies import (
    SECONDS,
    address_of_copy,
    ask_about,
    describe_failure,
    describe_refusal,
    folder_for,
    is_web,
    neighbour,
    note_address,
    request_bytes,
    write_whole,
)
from deformnb.io.files.errors import human_bytes, printable
from deformnb.io.files.paths import address_of, as_path, format_address, local_file, split_address
from deformnb.io.files.room import free_share
from deformnb.io.files.zarr_copy import MARKS, ZarrCopy, is_named_zarr

CHUNK_BYTES = 1 << 14
"""Bytes of a download read at a time: about two hundred steps of the bar for the smallest data set."""


class Meter:
    """Progress of a download by pooch: passes it on to a bar or a function, and stops when too many bytes come.

    pooch reports every chunk as a full one, and at the end calls ``reset`` and ``update`` with the length that the
    server announced; so counts here may run one chunk ahead of the file.

    Parameters
    ----------
    name : of the file, beside the bar.
    most : bytes that may come.
    whose : begins what is said of more bytes.
    progress : True for a bar, False for none, a function called with 0..1; None is a bar on a terminal.
    size : bytes that are expected; 0 is what the server announces.
    """

    def __init__(self, name: str, most: int, whose: str, progress: bool | Progress | None, size: int = 0) -> None:
        self.total = 0  # set by pooch
        self._most, self._name, self._whose, self._size = most, name, whose, size
        self._seen = 0
        self._tell = progress if callable(progress) else None
        self._bar: Any = None
        self._shown = sys.stderr.isatty() if progress is None else progress is True

    def update(self, count: int) -> None:
        """Count bytes that have come."""
        self._seen += count
        size = self._size or self.total
        if self._seen >= self._most + CHUNK_BYTES:
            raise OSError(f"{self._whose} {self._most:,} bytes")
        if self._shown:
            if self._bar is None:  # at the first bytes: without a network there is none
                from tqdm.auto import tqdm

                self._bar = tqdm(total=size or None, desc=self._name, unit="B", unit_scale=True, leave=False)
            self._bar.update(count)
        if self._tell is not None and size:
            self._tell(min(1.0, self._seen / size))

    def reset(self) -> None:
        """Begin again, as pooch does once the file is whole."""
        self._seen = 0
        if self._bar is not None:
            self._bar.reset()

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def download(address: str, path: Path, meter: Meter, known_hash: str | None = None) -> None:
    """Download through pooch: into a temporary file next to the target, checked, then renamed; removed on any failure.

    Raises
    ------
    OSError
        If there is no network, room or permission, or, for a ``known_hash``, another file comes.
    """
    import pooch

    # pooch reports each new file on a logger that prints by default; the caller has the bar, or the path.
    pooch.get_logger().setLevel("ERROR")
    opened: list[Any] = []
    downloader = pooch.HTTPDownloader(
        progressbar=meter,
        chunk_size=CHUNK_BYTES,
        timeout=SECONDS,
        hooks={"response": lambda response, **_: opened.append(response)},
    )
    try:
        pooch.retrieve(address, known_hash=known_hash, fname=path.name, path=path.parent, downloader=downloader)
    except OSError:  # that of an invalid address is a ValueError, too
        raise
    except ValueError as error:  # raised by pooch where the checksum differs
        raise OSError("what came is not the published file, its checksum differs") from error
    finally:
        meter.close()
        for response in opened:  # pooch leaves the connection open when anything goes wrong
            response.close()


def input_path(path: str | os.PathLike[str] | Any, progress: Progress | None = None) -> Path:
    """The path of a file to read, with ``~`` expanded; a file at an address is copied to this machine first.

    Parameters
    ----------
    path : of a file or a folder; or an address, whose scheme is file, http, https, or one that fsspec knows.
    progress : receives the share that has come, 0 to 1; may raise Cancelled. Default is a bar on a terminal.

    Raises
    ------
    VolumeFileError
        If the scheme is unknown, the file is not there or too large, or there is no network; the address is named.
    MissingPackageError
        If the scheme needs a package that is not installed.

    Examples
    --------
    >>> input_path("carp.nrrd").name, input_path("file:///scans/the%20carp.nrrd").name
    ('carp.nrrd', 'the carp.nrrd')
    """
    address = address_of(path)
    if not address:
        return as_path(path)
    split_address(address)
    if address.startswith("file://"):
        return local_file(address)
    return (_from_web if is_web(address) else _from_fsspec)(address, progress)


def copy_neighbour(path: Path, name: str, most: int | None = None) -> None:
    """Copy a file that lies beside another one, such as the data file of a header, if that is a copy of an address.

    Parameters
    ----------
    path : of the copy, or of any other file, for which nothing is done.
    name : of the file beside it.
    most : bytes of a file that may be absent, and is not looked for in vain; by default it must be there.

    Raises
    ------
    VolumeFileError
        If it cannot be copied.
    """
    found = address_of_copy(path)
    if found is None or found[1] != path:
        return
    address, target = neighbour(found[0], name), path.parent.joinpath(*name.split("/"))
    if most is not None:
        answer = request_bytes(address, most, is_optional=True)
        if answer is None:
            target.unlink(missing_ok=True)
        else:
            write_whole(target, answer[0])
        return
    source = input_path(address)
    if target.exists() and target.samefile(source):
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    try:
        os.link(source, target)
    except (AttributeError, OSError):  # a disk, or a Python, without links
        shutil.copyfile(source, target)


def split_progress(path: object, progress: Progress | None) -> tuple[Progress | None, Progress | None]:
    """Receivers of progress for the copy of a file at an address and its reading, each half; all is reading else."""
    if progress is None or not address_of(path):
        return None, progress
    whole = progress
    return lambda share: whole(share / 2), lambda share: whole(0.5 + share / 2)


def _from_web(address: str, progress: Progress | None) -> Path:
    shown, parts = format_address(address), urlsplit(address)
    name = _name(parts.path)
    if is_named_zarr(address):
        copy = ZarrCopy.open(address.rstrip("/"), name)
        if copy is None:
            raise VolumeFileError(f"{shown}: there is no folder of Zarr at this address (no {', '.join(MARKS)}).")
        return copy.folder
    try:
        state, given = ask_about(address)
        if "." not in name and "." in _name(given):  # https://server/download?file=3
            name = _name(given)
        path = folder_for(address, state) / name
        if state and path.is_file():
            return path
        room = free_share(path.parent)
        meter = Meter(name, room, "the server sends more than half of the free disk,", progress)
        path.unlink(missing_ok=True)
        download(address, path, meter)
        _refuse_page(path, shown)
        note_address(path, address)
    except VolumeFileError:
        raise
    except OSError as error:  # requests' errors are OSErrors
        raise describe_failure(address, error) from error
    return path


def _refuse_page(path: Path, shown: str) -> None:
    """Refuse, and remove, a page of the web that came in place of a file."""
    with path.open("rb") as file:
        is_page = file.read(1024).lstrip().lower().startswith((b"<!doctype html", b"<html"))
    if is_page and path.suffix.lower() not in (".html", ".htm"):
        path.unlink()
        raise VolumeFileError(
            f"{shown}: a page of the web is there and not a file; take the address of the file itself, as that of a "
            "button to download it is. One that needs a login in a browser is saved there first."
        )


def _from_fsspec(address: str, progress: Progress | None) -> Path:
    shown, scheme = format_address(address), address.partition(":")[0]
    try:
        import fsspec
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise MissingPackageError(
            f"{shown}: addresses of {scheme} are read by the package fsspec, which is not installed: pip install fsspec"
        ) from error
    if scheme not in fsspec.available_protocols():
        raise VolumeFileError(
            f"{shown}: {scheme} is no kind of address that is read; known are file, http, https and those of the "
            "package fsspec, such as s3, zip and memory."
        )
    if scheme in ("zip", "tar") and "::" not in address:
        raise VolumeFileError(
            f"{shown} names a file in an archive but no archive; add its path or address: "
            f"{scheme}://carp.nrrd::scans.{scheme}"
        )
    try:
        system, inner = url_to_fs(_with_local_archive(address, progress))
        if not system.exists(inner):
            raise VolumeFileError(f"{shown}: there is nothing at this address.")
        is_folder = system.isdir(inner)
        if is_folder and any(system.exists(f"{inner.rstrip('/')}/{mark}") for mark in MARKS):
            copy = ZarrCopy.open(address.rstrip("/"), _name(inner))
            if copy is not None:
                return copy.folder
        path = folder_for(address, "" if is_folder else str(system.ukey(inner))) / _name(inner)
        if not is_folder and path.is_file():
            return path
        size, room = system.du(inner) if is_folder else system.size(inner) or 0, free_share(path.parent)
        if size > room:
            raise VolumeFileError(f"{shown} has {human_bytes(size)}, more than half of the free disk.")
        _copy(system, inner, path, is_folder, fsspec.callbacks.Callback(hooks={"share": _teller(progress)}))
        note_address(path, address)
    except ImportError as error:
        wanted = re.search(r"[Ii]nstall (\w+)", str(error))
        remedy = f": pip install {wanted[1]}" if wanted else ""
        raise MissingPackageError(f"{shown}: {printable(error)}{remedy}") from error
    except VolumeFileError:
        raise
    except Exception as error:  # the errors of some fifty kinds of servers
        raise describe_refusal(address, error) from error
    return path


def _with_local_archive(address: str, progress: Progress | None) -> str:
    """The same address with the copy of an archive on a server that gives files as a whole only."""
    from fsspec.core import url_to_fs

    inner, _, archive = address.rpartition("::")
    if not inner or not is_web(archive):
        return address
    try:
        url_to_fs(address)
    except ValueError:  # of aiohttp: no parts ("range requests") are served
        return f"{inner}::{_from_web(archive, progress)}"
    return address


def _copy(system: Any, inner: str, path: Path, is_folder: bool, callback: Any) -> None:
    """Copy a file or a folder into a new folder beside its place, then rename it."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        part = Path(folder) / path.name
        if is_folder:
            system.get(inner, str(part), recursive=True)
            shutil.rmtree(path, ignore_errors=True)
        else:
            system.get_file(inner, str(part), callback=callback)
        part.replace(path)


def _teller(progress: Progress | None) -> Any:
    return lambda size, value, **_: progress(min(1.0, value / size)) if progress is not None and size else None


def _name(path: str) -> str:
    name = re.sub(r"[/\\\0]", "_", unquote(path.rstrip("/").rpartition("/")[2]))
    return name if name.strip(".") else "file"
