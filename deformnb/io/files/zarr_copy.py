"""Folders of Zarr at addresses (URLs): metadata are copied when they are opened, each chunk when it is first read.

So a level that fits is read of a pyramid of any size. A copy lies in the cache of the user, under the state of the
metadata at the address: where these are written anew the whole comes anew.
"""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from deformnb.io.files.address_copies import (
    address_of_copy,
    folder_for,
    inside,
    note_address,
    request_bytes,
    write_whole,
)
from deformnb.io.files.room import free_share

MARKS = ("zarr.json", ".zgroup", ".zarray")
"""Files of metadata of which each folder of Zarr has one."""

_METADATA = (*MARKS, ".zattrs")
_MOST_METADATA = 2**20  # bytes of one such file


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
        asked = ((file, request_bytes(inside(address, file), _MOST_METADATA, is_optional=True)) for file in _METADATA)
        found = {file: answer for file, answer in asked if answer is not None}
        if not found.keys() & set(MARKS):
            return None
        state = "\n".join(f"{file} {tag} {content!r}" for file, (content, tag) in sorted(found.items()))
        copy = cls(address, folder_for(address, state) / name)
        for file, (content, _) in found.items():
            write_whole(copy.folder / file, content)
        note_address(copy.folder, address)
        if _is_image_set(found):  # bioformats2raw: the images are the folders 0, 1 and so on
            for file in (f"{image}/{one}" for image in (0, 1) for one in _METADATA):
                copy.fetch(file)
        return copy

    @classmethod
    def containing(cls, path: Path) -> ZarrCopy | None:
        """The copy to which a folder in the cache belongs; None for any other folder.

        Examples
        --------
        >>> ZarrCopy.containing(Path("carp.zarr")) is None
        True
        """
        found = address_of_copy(path)
        return None if found is None else cls(*found)

    def fetch(self, key: str) -> None:
        """Copy a file if it is not there yet; one that is absent at the address stays absent, as empty chunks do.

        Parameters
        ----------
        key : its path in the folder.

        Raises
        ------
        VolumeFileError
            If the server refuses it, there is no network, or it has more bytes than half of the free disk.
        """
        path = self.folder / key
        if path.exists():
            return
        is_metadata = path.name in _METADATA
        most = _MOST_METADATA if is_metadata else free_share(self.folder)
        answer = request_bytes(inside(self.address, key), most, is_optional=is_metadata)
        if answer is not None:
            write_whole(path, answer[0])


def _is_image_set(found: dict[str, tuple[bytes, str]]) -> bool:
    for file in ("zarr.json", ".zattrs"):
        if file in found:
            with contextlib.suppress(ValueError, AttributeError):
                about = json.loads(found[file][0])
                about = about.get("attributes", about)
                if "bioformats2raw.layout" in about.get("ome", about):
                    return True
    return False


def is_named_zarr(address: str) -> bool:
    """Check whether an address names a folder of Zarr: one of its parts ends with ``.zarr``.

    Examples
    --------
    >>> is_named_zarr("https://host/scans/carp.zarr/0"), is_named_zarr("https://host/carp.zarr.zip")
    (True, False)
    """
    return any(unquote(part).lower().endswith(".zarr") for part in urlsplit(address).path.split("/"))
