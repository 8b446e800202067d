"""Voxels of files: exact byte counts, whole slices at a time.

Voxels are written slab by slab: compressed or plain, with progress, never with a second copy of the volume.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.errors import VolumeFileError
from deformnb.io.files.atomic import atomic_write, check_target, flush_folder, sweep
from deformnb.io.files.detached import detached_name, is_detached_name
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.streams import (
    CHUNK,
    ENCODINGS,
    Pieces,
    Stream,
    checksum,
    compress,
    file_chunks,
    from_text,
    packed_bytes,
    take,
    write_all,
)
from deformnb.io.volumes.headers import Layout, VoxelBlocks
from deformnb.volume.volume import Volume

# Blocks of about a mebibyte stay in the processor's cache between reading, scaling and storing.
BLOCK_BYTES = 2**20

# Deflate cannot pack more than 1032 bytes into one; a header that claims more is lying or the file is cut short.
_DEFLATE_MOST = 1032


@dataclass(frozen=True)
class Source:
    """Source of the bytes of the voxels.

    Parameters
    ----------
    path : the file.
    offset : where in it the (packed) bytes begin.
    encoding : a key of :data:`ENCODINGS`, or "text".
    skip : bytes to drop after unpacking.
    dtype : of numbers that are text.
    """

    path: Path
    offset: int = 0
    encoding: str = "raw"
    skip: int = 0
    dtype: np.dtype[Any] | None = None

    def open(self) -> Stream:
        """The unpacked bytes."""
        file = self.path.open("rb")
        file.seek(self.offset)
        if self.dtype is not None:
            return Pieces(from_text(file_chunks(file), self.dtype), file.close)
        stream = ENCODINGS[self.encoding](file)
        try:
            left = self.skip
            while left:
                dropped = len(stream.read(min(left, BLOCK_BYTES)))
                if not dropped:
                    raise EOFError("the data end before the first voxel")
                left -= dropped
        except BaseException:
            stream.close()
            raise
        return stream

    def blocks(self, shape: tuple[int, int, int], dtype: np.dtype[Any]) -> Callable[[], Iterator[NDArray[Any]]]:
        """The function that yields the voxels, after a check that the file can hold exactly them.

        Raises
        ------
        VolumeFileError
            With both numbers, if the file has too few or too many bytes.
        """
        expected = math.prod(shape) * dtype.itemsize
        present = self.path.stat().st_size - self.offset - (self.skip if self.encoding == "raw" else 0)
        if self.encoding == "raw" and present != expected:
            counts = " x ".join(map(str, shape[::-1]))
            raise fail(
                self.path,
                f"the header needs {expected} bytes of voxels ({counts} of {dtype.name}) but "
                f"the file has {max(0, present)}: it is cut short or damaged.",
            )
        if self.encoding == "gzip" and expected > _DEFLATE_MOST * max(0, present) + CHUNK:
            raise fail(
                self.path,
                f"the header needs {expected} bytes of voxels, more than the {max(0, present)} "
                "compressed bytes of the file can hold: it is cut short or damaged.",
            )
        return lambda: stream_blocks(self.path, self.open, shape, dtype)


@dataclass(frozen=True)
class SeveralSources:
    """The bytes of the voxels in several files, one after the other, with as many in each.

    Parameters
    ----------
    path : of the header that names them.
    parts : of the files.
    """

    path: Path
    parts: tuple[Source, ...]

    def blocks(self, shape: tuple[int, int, int], dtype: np.dtype[Any]) -> Callable[[], Iterator[NDArray[Any]]]:
        """Same as :meth:`Source.blocks`; every file must hold its share of the voxels and no more."""
        share, rest = divmod(math.prod(shape), len(self.parts))
        if rest:
            raise fail(
                self.path,
                f"its {math.prod(shape)} voxels cannot fill {len(self.parts)} files of equal size; "
                "the sizes or the list of files in its header are wrong.",
            )
        for part in self.parts:
            part.blocks((1, 1, share), dtype)
        size = share * dtype.itemsize
        return lambda: stream_blocks(self.path, lambda: Pieces(self._join(size), lambda: None), shape, dtype)

    def _join(self, size: int) -> Iterator[bytes]:
        for part in self.parts:
            with closing(part.open()) as stream:
                left = size
                while left:
                    data = stream.read(min(left, BLOCK_BYTES))
                    if not data:
                        raise fail(
                            part.path,
                            f"its share of the voxels is {size} bytes but it has {size - left}: "
                            "it is cut short or damaged.",
                        )
                    left -= len(data)
                    yield data
                if stream.read(1):
                    raise fail(part.path, f"its share of the voxels is {size} bytes but it has more.")


def layout_blocks(
    source: Source | SeveralSources,
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    layout: Layout,
    check: Callable[[Any, tuple[int, int, int]], VoxelBlocks] | None = None,
) -> VoxelBlocks:
    """The blocks of a file of channels and moments in its own order, with the checks of :meth:`Source.blocks`.

    Parameters
    ----------
    check : makes the blocks of a source and a shape, instead of :meth:`Source.blocks`.
    """
    nz, ny, nx = shape
    inner = layout.channels if layout.interleaved else 1
    whole = (layout.frames * (layout.channels // inner) * nz, ny, nx * inner)
    blocks = source.blocks(whole, dtype) if check is None else check(source, whole)
    if not layout.interleaved:
        return blocks
    return lambda: (block.reshape(len(block), ny, nx, inner) for block in blocks())


def stream_blocks(
    path: Path, open_stream: Callable[[], Stream], shape: tuple[int, int, int], dtype: np.dtype[Any]
) -> Iterator[NDArray[Any]]:
    """Yield the voxels of a stream as arrays [some z, y, x]; there must be exactly as many bytes as voxels need."""
    nz, ny, nx = shape
    slice_bytes = ny * nx * dtype.itemsize
    rows = max(1, BLOCK_BYTES // slice_bytes)
    with closing(open_stream()) as stream:
        for start in range(0, nz, rows):
            count = min(rows, nz - start)
            data = take(stream, count * slice_bytes)
            if len(data) < count * slice_bytes:
                got = start * slice_bytes + len(data)
                raise fail(
                    path,
                    f"the header needs {nz * slice_bytes} bytes of voxels but the file holds {got}: "
                    "it is cut short or damaged.",
                )
            yield np.frombuffer(data, dtype).reshape(count, ny, nx)
        if stream.read(1):  # also reads the check sum at the very end
            raise fail(
                path,
                f"the header needs {nz * slice_bytes} bytes of voxels but the file holds more: "
                "the sizes in its header are wrong.",
            )


def check_bytes(blocks: VoxelBlocks, crc32: object, error: Callable[[int], Exception]) -> VoxelBlocks:
    """The same blocks; at their end their CRC-32 must be this, or the error made of the one found is raised."""

    def checked() -> Iterator[NDArray[Any]]:
        crc = 0
        for block in blocks():
            crc = zlib.crc32(block.reshape(-1).view(np.uint8).data, crc)
            yield block
        if crc != crc32:
            raise error(crc)

    return checked


def check_blocks(
    source: Source | SeveralSources, shape: tuple[int, int, int], dtype: np.dtype[Any], crc32: int | None, header: Path
) -> VoxelBlocks:
    """The blocks of a detached data file, which must have the checksum in its header, if there is one."""
    blocks = source.blocks(shape, dtype)
    if crc32 is None:
        return blocks
    return check_bytes(
        blocks,
        crc32,
        lambda crc: fail(
            source.path,
            f"its voxels are not those that the header {printable(header.name)} was written for (CRC {crc:08x}, "
            f"expected {crc32:08x}): one of the two was changed or copied without the other. Take both from "
            f"one copy, or remove 'deformnb data crc32 {crc32:08x}' from the header to read it regardless.",
        ),
    )


_SLAB = 2**22


def stored_dtype(volume: Volume) -> np.dtype[Any]:
    """Type in files that know no bool: little-endian, bool as uint8."""
    return np.dtype(np.uint8) if volume.dtype == np.bool_ else volume.dtype.newbyteorder("<")


def slabs_of_bytes(
    values: NDArray[Any], dtype: np.dtype[Any], progress: Progress | None = None
) -> Iterator[memoryview]:
    """The voxels in order as little-endian bytes, some slices at a time; progress is reported after each."""
    nz = values.shape[0]
    rows = max(1, _SLAB // max(1, values[0].size * dtype.itemsize))
    for start in range(0, nz, rows):
        slab = np.ascontiguousarray(values[start : start + rows], dtype=dtype)
        yield slab.reshape(-1).view(np.uint8).data
        if progress is not None:
            progress(min(1.0, (start + rows) / nz))


def required_bytes(volume: Volume, encoding: str) -> int:
    """Free space that is required before a file is begun."""
    size = volume.grid.size * stored_dtype(volume).itemsize
    return size if encoding == "raw" else packed_bytes(size)


def write_packed(
    volume: Volume,
    path: Path,
    header: bytes,
    encoding: str,
    overwrite: bool,
    progress: Progress | None,
    *,
    header_outside: bool = False,
) -> None:
    """A header and the voxels in one file; ``header_outside`` leaves the header itself uncompressed."""
    with atomic_write(path, overwrite=overwrite, needed=required_bytes(volume, encoding)) as file:
        pieces = slabs_of_bytes(volume.values, stored_dtype(volume), progress)
        if header_outside:
            file.write(header)
            write_all(file, compress(pieces, encoding))
        else:
            write_all(file, compress(_prepend_header(header, pieces), encoding))


def write_pair(
    volume: Volume,
    path: Path,
    header: Callable[[str, int], bytes],
    named: Callable[[Path], str | None],
    overwrite: bool,
    progress: Progress | None,
) -> None:
    """A header and a detached file of plain voxels, whose name has the check sum of its bytes in it.

    So new voxels never take the place of old ones: they are on the disk before the header, whose own rename is the
    moment in which the pair is another. The old data file is removed after that.

    Parameters
    ----------
    header : the text of a header, of the name of its data file and the CRC-32 of its bytes.
    named : the name of the data file that a header on the disk has.
    """
    check_target(path, overwrite=overwrite)
    crc = checksum(slabs_of_bytes(volume.values, stored_dtype(volume)))
    data = path.with_name(detached_name(path, crc))
    before = _data_file_name(path, named)
    was_there = data.exists()

    @contextmanager
    def with_header(_target: Path) -> Iterator[None]:
        yield  # the data take their place, and are locked until the header names them
        try:
            flush_folder(data.parent)
            with atomic_write(path, overwrite=overwrite) as file:
                file.write(header(data.name, crc))
        except BaseException:
            if not was_there:
                data.unlink(missing_ok=True)
            raise

    with atomic_write(data, needed=required_bytes(volume, "raw"), replacing=with_header) as voxels:
        write_all(voxels, slabs_of_bytes(volume.values, stored_dtype(volume), progress))
    _remove_unused(path, before, named)


def _data_file_name(header: Path, named: Callable[[Path], str | None]) -> str | None:
    with suppress(OSError, VolumeFileError):
        return named(header)
    return None


def _remove_unused(header: Path, before: str | None, named: Callable[[Path], str | None]) -> None:
    """Remove the data files of earlier versions, also those whose writer was killed before it wrote the header.

    Files that this package has not named are not removed, nor those that another process is just writing. The header is
    read when the lock of a data file is ours: by then the writer of that file has written its header too.
    """
    with suppress(OSError):
        for file in list(header.parent.iterdir()):
            if is_detached_name(header, file.name) or file.name == before == f"{header.name}.raw":  # up to 1.4
                sweep(file, unless=lambda name=file.name: _data_file_name(header, named) in (name, None))  # type: ignore[misc]


def _prepend_header(header: bytes, pieces: Iterator[memoryview]) -> Iterator[memoryview]:
    yield memoryview(header)
    yield from pieces
