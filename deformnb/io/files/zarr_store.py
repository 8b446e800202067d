"""A folder of Zarr from which only plain files are read; one that is the copy of an address gets what is read."""

from __future__ import annotations

import asyncio
import stat
from collections.abc import Iterable

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore

from deformnb.io.files.errors import fail
from deformnb.io.files.zarr_copy import ZarrCopy


class PlainFiles(LocalStore):
    """A local store that refuses all but plain files: a pipe in place of a chunk would block for ever.

    Examples
    --------
    >>> PlainFiles("scan.zarr", read_only=True)
    LocalStore('file://scan.zarr')
    """

    async def _prepare(self, *keys: str) -> None:
        """Copy files from the address of which the folder is a copy, and refuse any but plain ones."""
        copy = ZarrCopy.containing(self.root)
        if copy is not None:
            inner = self.root.relative_to(copy.folder)
            await asyncio.gather(*(asyncio.to_thread(copy.fetch, (inner / key).as_posix()) for key in keys))
        for key in keys:
            self._check(key)

    def _check(self, key: str) -> None:
        path = self.root / key
        try:
            mode = path.stat().st_mode
        except (OSError, ValueError):  # missing chunks are the fill value; zarr refuses invalid names
            return
        if not stat.S_ISREG(mode):
            raise fail(self.root, f"its {key} is no plain file but a folder, a pipe or a device; it is not read.")

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Same as of LocalStore."""
        await self._prepare(key)
        return await super().get(key, prototype, byte_range)

    async def get_partial_values(
        self, prototype: BufferPrototype, key_ranges: Iterable[tuple[str, ByteRequest | None]]
    ) -> list[Buffer | None]:
        """Same as of LocalStore."""
        wanted = list(key_ranges)
        await self._prepare(*{key for key, _ in wanted})
        return await super().get_partial_values(prototype, wanted)
