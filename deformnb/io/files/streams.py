"""Streams of bytes: bounded decompression, numbers written as text, and compression."""

from __future__ import annotations

import binascii
import bz2
import itertools
import zlib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

MOST_PACKED = 1040
"""Bytes for each packed one at most: deflate packs a byte of zeros 1032 times."""

# Small enough that a file of thousands of tiny gzip members, each of which copies the rest of its chunk, stays quick.
CHUNK = 2**16

_LONGEST_WORD = 64  # of numbers written as text: a float64 has at most 24 characters


class Stream(Protocol):
    """Anything that gives up to ``size`` bytes, and none at its end."""

    def read(self, size: int, /) -> bytes:
        """Read up to ``size`` bytes."""

    def close(self) -> None:
        """Close the file."""


class Inflate:
    """Inflates zlib or gzip data (any number of members) and never holds more than was requested.

    The check sums at the end of each member are verified; a member without its end raises EOFError.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._decoder = zlib.decompressobj(wbits=47)  # zlib or gzip, by its first bytes
        self._input = b""
        self._waiting = False  # the decoder still has output for input that it took

    def read(self, size: int, /) -> bytes:
        """Read up to ``size`` bytes, none at the end of the last member."""
        while True:
            if not self._input and not self._waiting:
                self._input = self._file.read(CHUNK)
            if self._decoder.eof:
                self._input = self._input.lstrip(b"\0")  # tapes and some archives pad with zeros
                if not self._input:
                    if not self._file.peek(1):  # type: ignore[attr-defined]
                        return b""
                    continue
                self._decoder = zlib.decompressobj(wbits=47)
            elif not self._input and not self._waiting:
                raise EOFError("the compressed data end before their end mark")
            data = self._decoder.decompress(self._input, size)
            self._input = self._decoder.unconsumed_tail or self._decoder.unused_data
            self._waiting = len(data) == size and not self._decoder.eof
            if data:
                return data

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class Pieces:
    """A stream made of an iterator of byte strings."""

    def __init__(self, pieces: Iterator[bytes], close: Callable[[], None]) -> None:
        self._pieces = pieces
        self._rest = memoryview(b"")
        self.close = close

    def read(self, size: int, /) -> bytes:
        """Read up to ``size`` bytes."""
        while not self._rest:
            piece = next(self._pieces, None)
            if piece is None:
                return b""
            self._rest = memoryview(piece)
        data, self._rest = self._rest[:size], self._rest[size:]
        return bytes(data)


def _plain(file: BinaryIO) -> Stream:
    return file


class _Bzip2:
    """Unpacks bzip2; BZ2File alone leaves a file open that it has not opened."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.read = bz2.BZ2File(file).read

    def close(self) -> None:
        self._file.close()


def file_chunks(file: BinaryIO) -> Iterator[bytes]:
    """The bytes of a file up to its end, piece by piece."""
    while chunk := file.read(CHUNK):
        yield chunk


def _hexadecimal(file: BinaryIO) -> Stream:
    return Pieces(_from_hexadecimal(file_chunks(file)), file.close)


def _from_hexadecimal(chunks: Iterator[bytes]) -> Iterator[bytes]:
    rest = b""
    for chunk in chunks:
        digits = rest + b"".join(chunk.split())
        whole = len(digits) // 2 * 2
        rest = digits[whole:]
        if whole:
            yield binascii.unhexlify(digits[:whole])
    if rest:
        raise ValueError("the last byte in hexadecimal digits has one digit")


def from_text(chunks: Iterator[bytes], dtype: np.dtype[Any]) -> Iterator[bytes]:
    """Numbers written as text, in the bytes of a type; white space and commas part them.

    Raises
    ------
    ValueError
        For a word that is no number of this type.
    """
    rest = b""
    for chunk in itertools.chain(chunks, [b" "]):  # the last number may end the text
        text = rest + chunk.replace(b",", b" ")
        end = max(text.rfind(space) for space in (b" ", b"\n", b"\t", b"\r")) + 1
        words, rest = text[:end].split(), text[end:]
        if max(map(len, words), default=0) > _LONGEST_WORD or len(rest) > _LONGEST_WORD:
            raise ValueError("a word of the text is too long for a number")
        if words:
            yield _numbers(words, dtype).tobytes()


def _numbers(words: list[bytes], dtype: np.dtype[Any]) -> NDArray[Any]:
    try:
        if dtype.kind == "f":
            return np.array(words, dtype=np.bytes_).astype(dtype)
        found = np.array([int(word) for word in words], dtype=object)
        limits = np.iinfo(dtype)
        if min(found) < limits.min or max(found) > limits.max:
            raise ValueError
        return found.astype(dtype)
    except (ValueError, OverflowError):
        raise ValueError(f"the text of numbers of type {dtype.name} holds something else") from None


ENCODINGS: dict[str, Callable[[BinaryIO], Stream]] = {
    "raw": _plain,
    "gzip": Inflate,
    "bzip2": _Bzip2,
    "hex": _hexadecimal,
}
"""Encodings of the bytes of voxels; besides these there is "text", which requires the type."""


def take(stream: Stream, size: int) -> bytes:
    """Exactly ``size`` bytes of a stream, or fewer at its end."""
    parts: list[bytes] = []
    while size > 0:
        part = stream.read(size)
        if not part:
            break
        parts.append(part)
        size -= len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


# Level 1 is three to five times faster than zlib's 6 for files about a tenth larger; nibabel chose the same.
LEVEL = 1

# Compressed voxels seldom take more than this share of their size; noise may take all of it, and then the disk's own
# "full" ends the writing cleanly. Requiring all of it would refuse most files that fit.
_PACKED_SHARE = 0.25


def compress(pieces: Iterator[memoryview], encoding: str) -> Iterator[bytes | memoryview]:
    """The pieces, unchanged ("raw") or compressed ("gzip", "zlib")."""
    if encoding == "raw":
        yield from pieces
        return
    # No name and no time in the gzip header: equal volumes give equal files.
    packer = zlib.compressobj(LEVEL, wbits=31 if encoding == "gzip" else 15)
    for piece in pieces:
        yield packer.compress(piece)
    yield packer.flush()


def packed_bytes(size: int) -> int:
    """Free space that is required before so many bytes are packed into a file."""
    return int(_PACKED_SHARE * size)


def checksum(pieces: Iterable[memoryview]) -> int:
    """CRC-32 of the bytes of all pieces."""
    crc = 0
    for piece in pieces:
        crc = zlib.crc32(piece, crc)
    return crc


def write_all(file: BinaryIO, pieces: Iterator[Any]) -> None:
    """Write piece after piece."""
    for piece in pieces:
        file.write(piece)
