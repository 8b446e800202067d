"""Writing voxels slab by slab: packed or plain, with progress, never a second copy of the volume."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import VolumeFileError
from deformnb.io.atomic import atomic_write, check_target, flush_folder
from deformnb.io.headers import detached_name, is_detached_name
from deformnb.io.locks import sweep
from deformnb.volume import Volume

Progress = Callable[[float], None] | None

# Level 1 is three to five times faster than zlib's 6 for files about a tenth larger; nibabel chose the same.
LEVEL = 1

# Compressed voxels seldom take more than this share of their size; noise may take all of it, and then the disk's own
# "full" ends the writing cleanly. Asking for all of it would refuse most files that fit.
_PACKED_SHARE = 0.25

_SLAB = 2**22


def stored_dtype(volume: Volume) -> np.dtype[Any]:
    """Type in files that know no bool: little-endian, bool as uint8."""
    return np.dtype(np.uint8) if volume.dtype == np.bool_ else volume.dtype.newbyteorder("<")


def slabs_of_bytes(values: NDArray[Any], dtype: np.dtype[Any], progress: Progress = None) -> Iterator[memoryview]:
    """The voxels in order as little-endian bytes, some slices at a time; progress is told after each."""
    nz = values.shape[0]
    rows = max(1, _SLAB // max(1, values[0].size * dtype.itemsize))
    for start in range(0, nz, rows):
        slab = np.ascontiguousarray(values[start:start + rows], dtype=dtype)
        yield slab.reshape(-1).view(np.uint8).data
        if progress is not None:
            progress(min(1.0, (start + rows) / nz))


def packed(pieces: Iterator[memoryview], encoding: str) -> Iterator[bytes | memoryview]:
    """The pieces, as they are ("raw") or compressed ("gzip", "zlib")."""
    if encoding == "raw":
        yield from pieces
        return
    # No name and no time in the gzip header: equal volumes give equal files.
    packer = zlib.compressobj(LEVEL, wbits=31 if encoding == "gzip" else 15)
    for piece in pieces:
        yield packer.compress(piece)
    yield packer.flush()


def needed_bytes(volume: Volume, encoding: str) -> int:
    """How much free space a file is asked to have before it is begun."""
    size = volume.grid.size * stored_dtype(volume).itemsize
    return size if encoding == "raw" else int(_PACKED_SHARE * size)


def write_packed(volume: Volume, path: Path, header: bytes, encoding: str, overwrite: bool, progress: Progress,
                 *, header_outside: bool = False) -> None:
    """A header and the voxels in one file; ``header_outside`` leaves the header itself uncompressed."""
    with atomic_write(path, overwrite=overwrite, needed=needed_bytes(volume, encoding)) as file:
        pieces = slabs_of_bytes(volume.values, stored_dtype(volume), progress)
        if header_outside:
            file.write(header)
            write_all(file, packed(pieces, encoding))
        else:
            write_all(file, packed(_with_header(header, pieces), encoding))


def write_pair(volume: Volume, path: Path, header: Callable[[str, int], bytes], named: Callable[[Path], str | None],
               overwrite: bool, progress: Progress) -> None:
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
    before = _named(path, named)
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

    with atomic_write(data, needed=needed_bytes(volume, "raw"), replacing=with_header) as voxels:
        write_all(voxels, slabs_of_bytes(volume.values, stored_dtype(volume), progress))
    _remove_unnamed(path, before, named)


def checksum(pieces: Iterable[memoryview]) -> int:
    """CRC-32 of the bytes of all pieces."""
    crc = 0
    for piece in pieces:
        crc = zlib.crc32(piece, crc)
    return crc


def _named(header: Path, named: Callable[[Path], str | None]) -> str | None:
    with suppress(OSError, VolumeFileError):
        return named(header)
    return None


def _remove_unnamed(header: Path, before: str | None, named: Callable[[Path], str | None]) -> None:
    """Remove the data files of earlier versions, also those whose writer was killed before it wrote the header.

    What this package has not named is not removed, nor what another process is just writing. The header is read when
    the lock of a data file is ours: by then whoever wrote that file has written its header too.
    """
    with suppress(OSError):
        for file in list(header.parent.iterdir()):
            if is_detached_name(header, file.name) or file.name == before == f"{header.name}.raw":  # up to 1.4
                sweep(file, unless=lambda name=file.name: _named(header, named) in (name, None))  # type: ignore[misc]


def write_all(file: BinaryIO, pieces: Iterator[Any]) -> None:
    """Write piece after piece."""
    for piece in pieces:
        file.write(piece)


def _with_header(header: bytes, pieces: Iterator[memoryview]) -> Iterator[memoryview]:
    yield memoryview(header)
    yield from pieces
