"""Pages of TIFF files: their fields, and their pixels, which tifffile's and imagecodecs' codecs unpack.

The structure is read and checked here before any codec reads it, for tifffile fills in or leaves out damaged parts:
strips of length zero and short tiles become voxels, a broken chain of pages ends early, pages of another size are left
out, LZW data too long are cut, and circles of over 100 pages never end. It reports this, if at all, only in its log,
which callers may have switched off: of 2000 damaged stacks, checks around tifffile's own fields let one lose two of its
three slices, or with logging off 59 become other voxels. Source: TIFF 6.0 and the BigTIFF proposal.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package
from deformnb.errors import MissingPackageError
from deformnb.io.files.codecs import unpack_bytes, unpack_picture
from deformnb.io.files.errors import fail, printable
from deformnb.io.volumes.headers import volume_shape

# NumPy's code and how many of it make one value: a rational is a pair. Texts and undefined bytes (S) stay bytes.
_FIELD_TYPES = {
    1: ("u1", 1),
    2: ("S1", 1),
    3: ("u2", 1),
    4: ("u4", 1),
    5: ("u4", 2),
    6: ("i1", 1),
    7: ("S1", 1),
    8: ("i2", 1),
    9: ("i4", 1),
    10: ("i4", 2),
    11: ("f4", 1),
    12: ("f8", 1),
    13: ("u4", 1),
    16: ("u8", 1),
    17: ("i8", 1),
    18: ("u8", 1),
}
KIND, WIDTH_TAG, HEIGHT, DESCRIPTION, SAMPLES, XRES, YRES, RESOLUTION_UNIT = 254, 256, 257, 270, 277, 282, 283, 296
_BITS, _COMPRESSION, _PHOTOMETRIC, _FILL = 258, 259, 262, 266
_STRIPS, _ROWS, _STRIP_BYTES, _PLANAR, _T4, _PREDICTOR = 273, 278, 279, 284, 292, 317
_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _EXTRA, _FORMAT, _TABLES = 322, 323, 324, 325, 338, 339, 347
_DEPTH, _TILE_DEPTH = 32997, 32998
_USED = {
    KIND,
    DESCRIPTION,
    XRES,
    YRES,
    RESOLUTION_UNIT,
    WIDTH_TAG,
    HEIGHT,
    _BITS,
    _COMPRESSION,
    _PHOTOMETRIC,
    _FILL,
    _STRIPS,
    SAMPLES,
    _ROWS,
    _STRIP_BYTES,
    _PLANAR,
    _T4,
    _PREDICTOR,
    _TILE_WIDTH,
    _TILE_HEIGHT,
    _TILES,
    _TILE_BYTES,
    _EXTRA,
    _FORMAT,
    _TABLES,
    _DEPTH,
    _TILE_DEPTH,
}

MOST_PAGES = 100_000
_MOST_FIELDS = 4096
_MOST_VALUE = 2**22  # places of half a million strips

_MASK_OR_PREVIEW = 0b101  # bits of a page's kind: a smaller copy of another page, a mask of its transparency

# By the number of a compression: codecs of bytes, and codecs of pictures, which know shape, type and byte order.
_BYTES = {
    1: "none",
    5: "LZW",
    8: "deflate",
    32946: "deflate",
    50013: "deflate",
    32773: "PackBits",
    34925: "lzma",
    50000: "zstd",
    34926: "zstd",
}
_FAX = {2: "ccittrle", 3: "ccittfax3", 4: "ccittfax4"}
_JPEG = (7, 34892, 33007)
_PICTURES = {
    **dict.fromkeys(_JPEG, "jpeg8"),
    34712: "jpeg2k",
    33004: "jpeg2k",
    33005: "jpeg2k",
    34887: "lerc",
    34933: "png",
    50001: "webp",
    34927: "webp",
    50002: "jpegxl",
    52546: "jpegxl",
}
_PREDICTORS = (1, 2, 3)

# imagecodecs' decoder of JPEG XR ends the process on damaged data (within 400 mutants of a small file).
_UNSAFE = {34934: "JPEG XR", 22610: "JPEG XR"}

Tags = dict[int, NDArray[Any] | bytes]


@dataclass(frozen=True)
class PageCodec:
    """Packing of the strips or tiles of a page.

    Parameters
    ----------
    width : pixels in a row of a part.
    samples : numbers of a pixel that are stored together; one where ``is_plane``, for then each part is of one plane.
    """

    path: Path
    dtype: np.dtype[Any]
    bits: int
    width: int
    samples: int
    compression: int
    predictor: int
    photometric: int
    is_reversed: bool = False
    tables: bytes | None = None
    t4_options: int = 0
    has_extra: bool = False
    is_plane: bool = False

    @property
    def copies(self) -> int:
        """Number of copies of a part in memory while it is unpacked."""
        return 2 if self.predictor != 1 or self.compression in _PICTURES or self.bits % 8 else 1

    def packed_bytes(self, rows: int) -> int:
        """Bytes of so many rows of a part before they are packed: every row begins with a whole byte."""
        return rows * (-(-self.width * self.samples * self.bits // 8))

    def unpack(self, data: bytes, rows: int, seen: tuple[int, int]) -> NDArray[Any]:
        """A part [y, x, sample] of so many rows; of a picture at the border only the ``seen`` part may be stored."""
        expected = self.packed_bytes(rows)
        try:
            if self.compression in _PICTURES:
                return self._picture(data, rows, seen)
            if self.is_reversed:
                data = optional_package("imagecodecs").bitorder_decode(data)
            if self.compression in _FAX:
                return self._fax(data, rows)
            return self._numbers(unpack_bytes(_BYTES[self.compression], data, expected), rows)
        except MissingPackageError as error:
            raise MissingPackageError(f"{printable(self.path.name)}: {error}") from error
        except (ValueError, RuntimeError) as error:
            raise fail(
                self.path,
                f"a part of a page should have {expected} bytes but {printable(error).rstrip('.')}: the "
                "file is cut short or damaged.",
            ) from error

    def _numbers(self, data: bytes, rows: int) -> NDArray[Any]:
        """Unpacked bytes as numbers [y, x, sample]."""
        wide, inner = self.width, self.samples
        if self.bits == 24 and self.dtype.kind == "f":
            order = ">" if self.dtype.str[0] == ">" else "<"
            return np.asarray(_codec("float24_decode")(data, byteorder=order)).reshape(rows, wide, inner)
        if self.bits % 8 or self.bits == 24:
            found = _codec("packints_decode")(data, self.dtype.newbyteorder("="), self.bits, runlen=wide * inner)
            return np.asarray(found).reshape(rows, wide, inner)
        if self.predictor == 3:  # which puts bytes in order, from those of a big-endian number
            block = np.frombuffer(data, self.dtype.newbyteorder("=")).reshape(rows, wide, inner)
            return np.asarray(_codec("floatpred_decode")(block, axis=-2))
        block = np.frombuffer(data, self.dtype).reshape(rows, wide, inner)
        if self.predictor == 2:
            whole = block.astype(self.dtype.newbyteorder("=")).view(f"u{self.dtype.itemsize}")
            block = np.cumsum(whole, axis=1, dtype=whole.dtype).view(self.dtype.newbyteorder("="))
        return block

    def _fax(self, data: bytes, rows: int) -> NDArray[Any]:
        options = {"t4options": self.t4_options} if self.compression == 3 else {}
        found = np.asarray(_codec(f"{_FAX[self.compression]}_decode")(data, rows, self.width, **options))
        if found.shape != (rows, self.width):
            raise ValueError(f"holds {found.shape} pixels")
        return found[..., None]

    def _picture(self, data: bytes, rows: int, seen: tuple[int, int]) -> NDArray[Any]:
        """A coded picture; those of tiles at the border may leave out pixels beyond it."""
        codec, parts = _PICTURES[self.compression], () if self.samples == 1 else (self.samples,)
        options = self._jpeg_options() if codec == "jpeg8" else {}
        whole = (rows, self.width)
        for size in (whole, seen):
            try:
                found = unpack_picture(codec, data, (*size, *parts), self.dtype, **options)
            except ValueError as error:
                if size == seen:
                    raise ValueError(f"cannot be unpacked ({codec}: {str(error).rstrip('.')})") from error
            else:
                return found.reshape(*size, self.samples)
        raise AssertionError("the last size either fits or is refused")

    def _jpeg_options(self) -> dict[str, Any]:
        if self.is_plane:  # each plane is a picture in grey
            return {"tables": self.tables}
        colours = optional_package("tifffile").tifffile.jpeg_decode_colorspace(
            self.photometric, 1, (0,) if self.has_extra else (), False
        )
        return {"tables": self.tables, "colorspace": colours[0], "outcolorspace": colours[1]}


@dataclass(frozen=True)
class Page:
    """One picture of a file: its type, its size, and the places of its parts.

    Parameters
    ----------
    part : rows and columns of a strip or a tile.
    samples : numbers of a pixel, which are stored together; or, if ``is_planar``, in a plane of parts each.
    """

    path: Path
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    part: tuple[int, int]
    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]
    codec: PageCodec
    samples: int = 1
    is_planar: bool = False
    is_tiled: bool = False

    @property
    def pixel_bytes(self) -> int:
        """Bytes of a pixel with all its samples, once read."""
        return self.dtype.itemsize * self.samples

    @property
    def working_bytes(self) -> int:
        """Memory that reading takes: the page, its table, and of one strip or tile the packed, unpacked and predicted.

        Tiles are whole, so that one of a small picture may be of any size.
        """
        part = math.prod(self.part) * self.dtype.itemsize * self.codec.samples
        packed = int(self.counts.max()) if self.codec.compression != 1 else 0
        table = self.offsets.nbytes + self.counts.nbytes
        return math.prod(self.shape) * self.pixel_bytes + table + packed + part * self.codec.copies

    def read(self, file: BinaryIO, rows: slice = slice(None), columns: slice = slice(None)) -> NDArray[Any]:
        """The voxels [y, x] of the page in its stored type, or of some rows and columns; [y, x, sample] of several."""
        (y0, y1, _), (x0, x1, _) = rows.indices(self.shape[0]), columns.indices(self.shape[1])
        out = np.empty((max(0, y1 - y0), max(0, x1 - x0), self.samples), self.dtype)
        high, wide = self.part
        across = -(-self.shape[1] // wide)
        per_plane = -(-self.shape[0] // high) * across
        for number, (offset, count) in enumerate(zip(self.offsets, self.counts, strict=True)):
            plane, place = divmod(number, per_plane)
            top, left = place // across * high, place % across * wide
            bottom, right = min(top + high, self.shape[0]), min(left + wide, self.shape[1])
            if top >= y1 or bottom <= y0 or left >= x1 or right <= x0:
                continue
            # The last strip is shorter; tiles are always whole.
            lines = high if self.is_tiled else bottom - top
            file.seek(int(offset))
            # Of plain voxels one byte more than there should be is enough to see that there are too many.
            most = self.codec.packed_bytes(lines) + 1 if self.codec.compression == 1 else int(count)
            block = self.codec.unpack(file.read(min(int(count), most)), lines, (bottom - top, right - left))
            target = out[
                max(top, y0) - y0 : min(bottom, y1) - y0,
                max(left, x0) - x0 : min(right, x1) - x0,
                plane : plane + 1 if self.is_planar else None,
            ]
            target[:] = block[max(y0 - top, 0) : min(bottom, y1) - top, max(x0 - left, 0) : min(right, x1) - left]
        return out if self.samples > 1 else out[..., 0]


def _codec(name: str) -> Any:
    return getattr(optional_package("imagecodecs"), name)


def directories(path: Path, file: BinaryIO) -> Iterator[tuple[str, Tags]]:
    """The byte order and the fields of every page; a chain that runs in a circle is refused."""
    start = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(start[:2])
    version = struct.unpack_from(f"{order}H", start, 2)[0] if order and len(start) == 16 else 0
    if order is None or version not in (42, 43):
        raise fail(path, "this is not a TIFF file: it begins neither with II nor MM and 42 or 43.")
    big = version == 43
    offset = struct.unpack_from(order + ("Q" if big else "I"), start, 8 if big else 4)[0]
    if not offset:
        raise fail(path, "it has no pages.")
    seen: set[int] = set()
    while offset:
        if offset in seen or len(seen) >= MOST_PAGES:
            raise fail(path, f"its pages run in a circle or are more than {MOST_PAGES}; the file is damaged.")
        seen.add(offset)
        tags, offset = _directory(path, file, order, big, offset)
        yield order, tags


def _directory(path: Path, file: BinaryIO, order: str, big: bool, offset: int) -> tuple[Tags, int]:
    size, word = (20, "Q") if big else (12, "I")
    count = struct.unpack(order + ("Q" if big else "H"), _read_bytes(path, file, offset, 8 if big else 2))[0]
    if count > _MOST_FIELDS:
        raise fail(path, f"a page claims {count} fields; the file is damaged.")
    body = file.read(count * size + struct.calcsize(word))
    if len(body) < count * size + struct.calcsize(word):
        raise fail(path, "a page's list of fields is cut short.")
    tags: Tags = {}
    for start in range(0, count * size, size):
        tag, kind, number = struct.unpack_from(order + "HH" + word, body, start)
        if tag not in _USED or (tag in tags and tag == DESCRIPTION):  # ImageJ, tifffile and others add a second one
            continue
        if tag in tags:
            raise fail(path, f"a page has the field {tag} twice; the file is damaged.")
        if kind not in _FIELD_TYPES:  # to leave it out would mean its default: voxels of another type, in silence
            raise fail(path, f"the field {tag} has the unknown type {kind}; the file is damaged.")
        code, values = _FIELD_TYPES[kind]
        length = int(code[1]) * values * number
        if length > _MOST_VALUE:
            raise fail(path, f"the field {tag} claims {length} bytes; the file is damaged.")
        inline = body[start + 4 + struct.calcsize(word) : start + size]
        place = struct.unpack(order + word, inline)[0]
        value = inline[:length] if length <= len(inline) else _read_bytes(path, file, place, length)
        tags[tag] = value if code == "S1" else np.frombuffer(value, order + code)
    return tags, int(struct.unpack_from(order + word, body, count * size)[0])


def _read_bytes(path: Path, file: BinaryIO, offset: int, count: int) -> bytes:
    file.seek(min(offset, 2**62))
    data = file.read(count)
    if len(data) < count:
        raise fail(path, f"it is cut short: {count} bytes at {offset} are missing.")
    return data


def is_preview(path: Path, tags: Tags) -> bool:
    """Check whether a page is a smaller copy of another one or a mask, and no slice."""
    return bool(_one(path, tags, KIND, 0) & _MASK_OR_PREVIEW)


def one_number(path: Path, tags: Tags, tag: int, missing: int) -> int:
    """The one whole number of a field; the missing one where it is absent."""
    return _one(path, tags, tag, missing)


def whole_numbers(tags: Tags, tag: int) -> NDArray[Any]:
    """The whole numbers of a field; none where it is absent or something else."""
    value = tags.get(tag)
    return value if isinstance(value, np.ndarray) and value.dtype.kind in "ui" else np.empty(0, np.int64)


def _one(path: Path, tags: Tags, tag: int, missing: int | None = None) -> int:
    """The one whole number of a field; each sample may have its own, if all are equal."""
    if tag not in tags and missing is not None:
        return missing
    value = whole_numbers(tags, tag)
    if not value.size:
        raise fail(path, f"a page lacks the field {tag} or it is no whole number; the file is damaged.")
    most = int((*whole_numbers(tags, SAMPLES)[:1].tolist(), 1)[0]) if tag in (_BITS, _FORMAT) else 1
    if (value != value[0]).any() or value.size not in (1, most):
        raise fail(
            path,
            f"the field {tag} should be one number but is {printable(value.tolist(), 60)}; the file is "
            "damaged, or its samples are of several types, which is not supported.",
        )
    return int(value[0])


def parse_page(path: Path, order: str, tags: Tags) -> Page:
    """The page that fields describe, if its pixels can be read and all of its parts are in the file."""

    def one(tag: int, missing: int | None = None) -> int:
        return _one(path, tags, tag, missing)

    width, height, samples = one(WIDTH_TAG), one(HEIGHT), one(SAMPLES, 1)
    compression, photometric, is_planar = one(_COMPRESSION, 1), one(_PHOTOMETRIC, 1), one(_PLANAR, 1) == 2
    _check_colours(path, photometric, samples, compression)
    bits = one(_BITS, 1)
    dtype = _dtype(path, bits, one(_FORMAT, 1), order)
    if one(_DEPTH, 1) != 1 or one(_TILE_DEPTH, 1) != 1:
        raise fail(path, "each of its pages is a volume, which is not supported; save a page for each slice.")
    volume_shape(path, [width, height], dtype.itemsize * samples)
    tiled = _TILES in tags
    part = (one(_TILE_HEIGHT), one(_TILE_WIDTH)) if tiled else (min(one(_ROWS, height), height), width)
    offsets, counts = (
        whole_numbers(tags, tag).astype(np.int64)  # beyond 2**63 is less than 0, which is refused too
        for tag in ((_TILES, _TILE_BYTES) if tiled else (_STRIPS, _STRIP_BYTES))
    )
    tables = tags.get(_TABLES)
    is_plane = is_planar and samples > 1
    codec = PageCodec(
        path,
        dtype,
        bits,
        part[1],
        1 if is_plane else samples,
        compression,
        one(_PREDICTOR, 1),
        photometric,
        one(_FILL, 1) == 2,
        bytes(tables) if tables is not None else None,
        one(_T4, 0),
        _EXTRA in tags,
        is_plane,
    )
    page = Page(path, (height, width), dtype, part, offsets, counts, codec, samples, is_plane, tiled)
    _check_packing(page, one(_FILL, 1), one(_PLANAR, 1))
    _check_parts(page)
    return page


def _check_colours(path: Path, photometric: int, samples: int, compression: int) -> None:
    """Refuse pages that would become other colours: inks, and luminance with colour differences that no codec turns."""
    is_grey = photometric in (0, 1, 4) or (photometric == 3 and samples == 1)
    is_colour = (photometric == 2 and samples >= 3) or (photometric == 6 and samples == 3 and compression in _JPEG)
    if not (is_grey or is_colour) or not 1 <= samples <= 1024:
        raise fail(
            path,
            f"its pixels are colours of a kind that is not read ({samples} samples, photometric "
            f"{photometric}); save them as RGB or as grey values.",
        )


def _dtype(path: Path, bits: int, form: int, order: str) -> np.dtype[Any]:
    code = optional_package("tifffile").TIFF.SAMPLE_DTYPES.get((form, bits))
    if code is None or code in "FDE":
        raise fail(path, f"pixels of {bits} bits and format {form} are not supported; save 8, 16 or 32 bits.")
    return np.dtype(code).newbyteorder(order)


def _check_packing(page: Page, fill: int, planar: int) -> None:
    path, codec, compression = page.path, page.codec, page.codec.compression
    if compression in _UNSAFE:
        raise fail(
            path,
            f"it is packed as {_UNSAFE[compression]}, whose decoder ends Python where data are damaged, "
            "so it is not read; save it with deflate.",
        )
    if compression not in {**_BYTES, **_FAX, **_PICTURES}:
        raise fail(path, f"the compression {compression} is not supported; save it uncompressed or with deflate.")
    if compression in _FAX and (codec.bits, page.samples) != (1, 1):
        raise fail(path, f"the compression {compression} is of single bits, and its pixels have {codec.bits}.")
    numbers = codec.predictor != 1 and compression not in _PICTURES
    packed = compression not in (1, 32773, *_FAX)  # as of libtiff: others have no predictor
    of_type = packed and codec.bits % 8 == 0 and codec.bits != 24 and (codec.predictor == 2 or page.dtype.kind == "f")
    if fill not in (1, 2) or planar not in (1, 2) or codec.predictor not in _PREDICTORS or (numbers and not of_type):
        raise fail(
            path,
            f"its order of bits ({fill}) or of samples ({planar}), or its predictor ({codec.predictor}), "
            "is not supported; save it uncompressed.",
        )


def _check_parts(page: Page) -> None:
    """Refuse a page whose strips or tiles are too few or too many, or are not all in the file."""
    path, offsets, counts, (high, wide) = page.path, page.offsets, page.counts, page.part
    size = path.stat().st_size
    if min(high, wide) < 1 or high * wide * page.pixel_bytes > 2**40:
        raise fail(path, f"its parts have {wide} x {high} pixels; the file is damaged.")
    expected = -(-page.shape[0] // high) * -(-page.shape[1] // wide) * (page.samples if page.is_planar else 1)
    if not (len(offsets) == len(counts) == expected):
        raise fail(path, f"a page should have {expected} parts but has {len(offsets)} places and {len(counts)} sizes.")
    if not ((offsets > 0) & (offsets <= size) & (counts > 0) & (counts <= size - offsets)).all():
        raise fail(path, f"a part of a page is outside the file of {size} bytes: it is cut short or damaged.")
