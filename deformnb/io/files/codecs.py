"""Unpacking of bytes and of coded pictures, which refuses data that are not of the expected size.

A packed strip of a few bytes may unpack to gigabytes, and a coded picture states its own size, which need not be that
of the header around it. So bytes are unpacked into one byte more than there should be, and a picture into an array of
the shape and the type that it must have; where a codec unpacks before it compares, its header is read here first.
"""

from __future__ import annotations

import lzma
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package

# A stream of LZMA may require a dictionary of 4 GiB; writers' largest has 64 MiB, and twice the data is enough for any.
_LZMA_MEMORY = 2**27


def _inflate(data: bytes, expected: int) -> bytes:
    decoder = zlib.decompressobj()
    unpacked = decoder.decompress(data, expected + 1)
    if len(unpacked) == expected and not decoder.eof:
        raise ValueError("the data end before their check sum")
    return unpacked


def _lzma(data: bytes, expected: int) -> bytes:
    decoder = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=max(_LZMA_MEMORY, 2 * expected))
    unpacked = decoder.decompress(data, expected + 1)
    if len(unpacked) == expected and not decoder.eof:
        raise ValueError("the data end before their check sum")
    return unpacked


def _from_imagecodecs(name: str, more: int = 1) -> Callable[[bytes, int], bytes]:
    def unpack(data: bytes, expected: int) -> bytes:
        return bytes(getattr(optional_package("imagecodecs"), f"{name}_decode")(data, out=expected + more))

    return unpack


BYTES: dict[str, Callable[[bytes, int], bytes]] = {
    "none": lambda data, _expected: data,
    "deflate": _inflate,
    "lzma": _lzma,
    "LZW": _from_imagecodecs("lzw"),  # which stops where its output is full: one byte more shows that there is more
    "PackBits": _from_imagecodecs("packbits"),
    "zstd": _from_imagecodecs("zstd"),
    "lz4": _from_imagecodecs("lz4", 0),
}
"""Codecs of bytes: each is given the data and how many bytes they must be, and returns at most one byte more."""


def unpack_bytes(name: str, data: bytes, expected: int) -> bytes:
    """Bytes of a known number, unpacked.

    Parameters
    ----------
    name : a key of :data:`BYTES`.
    expected : how many there must be.

    Raises
    ------
    ValueError
        If there are more or fewer, or the data are damaged.
    MissingPackageError
        If the codec needs a package that is not installed.

    Examples
    --------
    >>> unpack_bytes("deflate", zlib.compress(b"voxels"), 6)
    b'voxels'
    """
    try:
        unpacked = BYTES[name](data, expected)
    except (RuntimeError, zlib.error, lzma.LZMAError) as error:  # errors of imagecodecs are RuntimeErrors
        raise ValueError(f"cannot be unpacked ({name}: {str(error).rstrip('.')})") from error
    if len(unpacked) != expected:
        raise ValueError(f"has {len(unpacked)}{' or more' * (len(unpacked) > expected)}")
    return unpacked


# -- pictures --------------------------------------------------------------------------------------------------------


def _jpeg_size(data: bytes) -> tuple[int, int, int]:
    """Rows, columns and components of a JPEG, lossless or JPEG-LS picture, of its frame header."""
    if not data.rstrip(b"\0").endswith(b"\xff\xd9"):  # decoders fill missing data with grey
        raise ValueError("the data end before their end mark")
    at = 2
    while at + 9 < len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if (0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC)) or marker == 0xF7:
            rows, columns, components = struct.unpack_from(">HHB", data, at + 5)
            return rows, columns, components
        if marker == 0xFF:  # a fill byte
            at += 1
            continue
        at += 2 if marker == 0x01 or 0xD0 <= marker <= 0xD8 else 2 + struct.unpack_from(">H", data, at + 2)[0]
    raise ValueError("it has no frame header")


def _jpeg2000_size(data: bytes) -> tuple[int, int, int]:
    """Rows, columns and components of a JPEG 2000 picture, of the first segment of its codestream."""
    at = 0
    while data[at : at + 2] != b"\xff\x4f":  # in the boxes of a JP2 file
        length, kind = struct.unpack_from(">I4s", data, at)
        head = 16 if length == 1 else 8
        if length == 1:
            length = struct.unpack_from(">Q", data, at + 8)[0]
        if kind != b"jp2c" and length < 8:
            raise ValueError("it has no codestream")
        at += head if kind == b"jp2c" else length
    right, bottom, left, top = struct.unpack_from(">4I", data, at + 8)
    return bottom - top, right - left, struct.unpack_from(">H", data, at + 40)[0]


_SIZES: dict[str, Callable[[bytes], tuple[int, int, int]]] = {
    "jpeg8": _jpeg_size,
    "jpegls": _jpeg_size,
    "jpeg2k": _jpeg2000_size,
    "htj2k": _jpeg2000_size,
}


def unpack_picture(
    name: str, data: bytes, shape: tuple[int, ...], dtype: np.dtype[Any], **options: Any
) -> NDArray[Any]:
    """A coded picture of a known shape and type.

    Parameters
    ----------
    name : of the codec in imagecodecs: "jpeg8" (with the lossless ones), "jpegls", "jpeg2k", "png", "lerc", ...
    shape : (rows, columns) or (rows, columns, parts of a colour).
    options : for the codec.

    Raises
    ------
    ValueError
        If it is of another shape or type, or the data are damaged.
    MissingPackageError
        If imagecodecs is not installed.

    Examples
    --------
    >>> import imagecodecs
    >>> coded = imagecodecs.png_encode(np.eye(3, dtype=np.uint8))
    >>> int(unpack_picture("png", coded, (3, 3), np.dtype("u1")).trace())
    3
    """
    decode = getattr(optional_package("imagecodecs"), f"{name}_decode")
    try:
        if name in _SIZES:
            rows, columns, parts = _SIZES[name](data)
            if (rows, columns) != shape[:2] or parts != (*shape, 1)[2]:
                raise ValueError(f"it is a picture of {columns} x {rows} pixels of {parts} parts")
        out = np.empty(shape, dtype.newbyteorder("="))
        decode(data, out=out, **options)
    except (RuntimeError, struct.error, LookupError, TypeError) as error:
        raise ValueError(str(error) or type(error).__name__) from error
    return out
