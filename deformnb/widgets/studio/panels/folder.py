"""The folder of a studio: names of its volume files for menus, and names that a front end may give."""

from __future__ import annotations

import os
from os import PathLike
from pathlib import Path

from deformnb.errors import DeformError
from deformnb.io.volumes.formats import FORMATS

_MOST_FILES = 200  # of a menu
_VOLUME_SUFFIXES = tuple(suffix for entry in FORMATS.values() for suffix in entry.suffixes)


def plain_name(text: str) -> str:
    """A file name without folders, as a front end may give it.

    Raises
    ------
    DeformError
        If it is empty, hidden, or leads anywhere else.

    Examples
    --------
    >>> plain_name(" fish.json ")
    'fish.json'
    """
    name = text.strip()
    if not name or name.startswith(".") or any(c in '/\\:*?"<>|' or ord(c) < 32 for c in name) or len(name) > 200:
        raise DeformError(f"{name[:60]!r} is no plain file name; write one such as fish.json, without a folder.")
    return name


class FolderFiles:
    """Names of the volume files in a folder, for menus; it is read again when it has changed.

    Parameters
    ----------
    folder : is looked into, without folders in it.
    more : suffixes of other files that are listed too.
    """

    def __init__(self, folder: str | PathLike[str], *more: str) -> None:
        self.folder = Path(folder)
        self._suffixes = (*_VOLUME_SUFFIXES, *more)
        self._seen: tuple[float, list[str]] | None = None

    def names(self) -> list[str]:
        """The names in the order of the alphabet; none where the folder cannot be read."""
        try:
            changed = self.folder.stat().st_mtime
            if self._seen is None or self._seen[0] != changed:
                with os.scandir(self.folder) as found:
                    names = sorted(
                        f.name
                        for f in found
                        if f.name.lower().endswith(self._suffixes) and not f.name.startswith(".") and f.is_file()
                    )
                self._seen = (changed, names[:_MOST_FILES])
            return self._seen[1]
        except OSError:
            return []


def is_volume_name(name: str) -> bool:
    """Check whether a name ends as those of volume files do."""
    return name.lower().endswith(_VOLUME_SUFFIXES)
