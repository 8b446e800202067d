"""Folders of Zarr at addresses (URLs): metadata are copied when they are opened, each chunk when it is first read.

So a level that fits is read of a pyramid of any size. A copy lies in the cache of the user, under the state of the
metadata at the address: where these are written anew the whole comes anew. Of each chunk that is there the server is
asked once after an opening whether it has changed; one that states neither a tag nor a date for it is believed to have
the same. Absent chunks are asked for once after an opening, too.
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
    state_at,
    write_whole,
)
from deformnb.io.files.room import free_share

MARKS = ("zarr.json", ".zgroup", ".zarray")
"""Files of metadata of which each folder of Zarr has one."""

_METADATA = (*MARKS, ".zattrs")
_MOST_METADATA = 2**20  # bytes of one such file
_STATES = "states"  # folder beside the copy, with the state of each chunk when it came

_checked: dict[Path, set[str]] = {}
"""Files of which the server was asked since the last opening, by the folder of the copy."""


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
        _checked[copy.folder] = set()
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
        """Copy a file if it is new or has changed; one that is absent at the address is so here, as empty chunks are.

        Parameters
        ----------
        key : its path in the folder.

        Raises
        ------
        VolumeFileError
            If the server refuses it, there is no network, or it has more bytes than half of the free disk.
        """
        checked = _checked.setdefault(self.folder, set())
        if key in checked:
            return
        path, note = self.folder / key, self.folder.parent / _STATES / key
        address, is_metadata = inside(self.address, key), path.name in _METADATA
        if not path.exists() or (not is_metadata and self._is_changed(address, note)):
            most = _MOST_METADATA if is_metadata else free_share(self.folder)
            answer = request_bytes(address, most, is_optional=is_metadata)
            if answer is None:
                path.unlink(missing_ok=True)
            else:
                write_whole(path, answer[0])
                write_whole(note, answer[1].encode())
        checked.add(key)

    @staticmethod
    def _is_changed(address: str, note: Path) -> bool:
        """Check whether the file at an address has another state than the one in a note."""
        state = state_at(address)
        return state is None or (bool(state) and not (note.is_file() and note.read_bytes() == state.encode()))


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
