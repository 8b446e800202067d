"""Which files may be replaced without being asked: those that hold what was opened or written here.

The rule of all that a session writes, and of documents: a file is never replaced unless the session itself has opened
or written what is in it, or it is said that it may be (``overwrite=True``, or an answer in the page).
"""

from __future__ import annotations

import hashlib
import os
import threading
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
    """Files by what was in them when they were last read or written here; times do not count.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "fish.json"
    >>> files = KnownFiles()
    >>> files.check(path)  # there is none
    >>> _ = path.write_bytes(b"mine")
    >>> files.remember(path)
    >>> files.check(path)
    >>> _ = path.write_bytes(b"yours")
    >>> files.check(path)
    Traceback (most recent call last):
        ...
    deformnb.errors.FileChangedError: fish.json has been changed by someone else since ...
    """

    def __init__(self) -> None:
        self._digests: dict[Path, bytes] = {}
        self._lock = threading.Lock()

    def remember(self, path: str | PathLike[str], content: bytes | None = None) -> None:
        """Take the file for one's own, with this content or as it is now; what is no file is none."""
        with suppress(OSError):
            digest = _digest(path) if content is None else hashlib.sha256(content).digest()
            with self._lock:
                place = _real(path)
                self._digests.pop(place, None)
                self._digests[place] = digest
                while len(self._digests) > _MOST:
                    del self._digests[next(iter(self._digests))]

    def has(self, path: str | PathLike[str]) -> bool:
        """Whether a file was opened or written here, whatever it holds now."""
        return _real(path) in self._digests

    def check(self, path: str | PathLike[str]) -> None:
        """Refuse to write over what was neither opened nor written here.

        Raises
        ------
        FileChangedError
            If the file is there and holds something else.
        """
        place = _real(path)
        known = self._digests.get(place)
        if not place.exists() or place.is_dir():  # of a folder whoever writes says more
            return
        with suppress(OSError):  # what cannot be read may hold anything
            if known is not None and _digest(place) == known:
                return
        what = ("was there before, and was neither opened nor saved here" if known is None else
                "has been changed by someone else since it was opened or saved here")
        raise FileChangedError(f"{shown(Path(path).name)} {what}. Save under another name, or with overwrite=True to "
                               "replace it.")

    @contextmanager
    def writing(self, path: str | PathLike[str], *, overwrite: bool = False) -> Iterator[None]:
        """The work that makes a file: checked before it begins, and one's own afterwards."""
        if not overwrite:
            self.check(path)
        yield
        self.remember(path)

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


def _digest(path: str | PathLike[str]) -> bytes:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _real(path: str | PathLike[str]) -> Path:
    return Path(path).expanduser().resolve()
