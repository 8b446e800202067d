"""Documents that were opened or written here, and whether somebody else has changed them since."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

from deformnb.errors import FileChangedError
from deformnb.io.headers import shown
from deformnb.io.locks import try_lock

_MOST = 1000  # files of one session
_PATIENCE = 2.0  # seconds for another writer's rename; a lock that never comes must not stop the work


class KnownFiles:
    """Files by what was in them when they were last read or written here.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "fish.json"
    >>> files = KnownFiles()
    >>> _ = path.write_bytes(b"mine")
    >>> files.remember(path, b"mine")
    >>> files.is_changed(path)
    False
    >>> _ = path.write_bytes(b"yours")
    >>> files.is_changed(path)
    True
    """

    def __init__(self) -> None:
        self._digests: dict[Path, bytes] = {}

    def remember(self, path: str | PathLike[str], content: bytes) -> None:
        """Take this for what is in the file now."""
        place = _real(path)
        self._digests.pop(place, None)
        self._digests[place] = hashlib.sha256(content).digest()
        while len(self._digests) > _MOST:
            del self._digests[next(iter(self._digests))]

    def is_changed(self, path: str | PathLike[str]) -> bool:
        """True if a file that is known has other content now; times do not count. One that is gone is not changed."""
        known = self._digests.get(_real(path))
        if known is None:
            return False
        try:
            with open(path, "rb") as file:
                return hashlib.file_digest(file, "sha256").digest() != known
        except OSError:
            return False

    def check(self, path: str | PathLike[str]) -> None:
        """Refuse to write over what somebody else has written.

        Raises
        ------
        FileChangedError
            If the file is changed.
        """
        if self.is_changed(path):
            raise FileChangedError(f"{shown(Path(path).name)} has been changed by someone else since it was opened or "
                                   "saved here. Save under another name, or with overwrite=True to replace it.")

    @contextmanager
    def replacing(self, path: Path) -> Iterator[None]:
        """The moment in which a file is replaced: checked once more, and no other session's writer comes between."""
        descriptor = None
        with suppress(OSError):
            descriptor = os.open(path, os.O_RDWR)
        try:
            if descriptor is not None and os.name != "nt":  # an open file cannot be replaced there
                end = time.monotonic() + _PATIENCE
                while try_lock(descriptor) is False and time.monotonic() < end:
                    time.sleep(0.002)
            self.check(path)
            if descriptor is not None and os.name == "nt":
                os.close(descriptor)
                descriptor = None
            yield
        finally:
            if descriptor is not None:
                os.close(descriptor)


def _real(path: str | PathLike[str]) -> Path:
    return Path(path).expanduser().resolve()
