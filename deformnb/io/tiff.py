"""TIFF stacks (read only): a file of many pages, or a folder of single pages in the natural order of their names.

Read here and not by a library, because libraries fill missing strips with zeros and follow the names of other files.
Source: TIFF 6.0, the BigTIFF proposal, and the descriptions that ImageJ and OME put into the first page.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import MissingPackageError
from deformnb.io.headers import Header, fail, regular_file, shown, volume_shape
from deformnb.volume import Float3

SUFFIXES = (".tif", ".tiff")

# struct code and how many of it make one value: a rational is a pair.
_FIELD_TYPES = {1: ("B", 1), 2: ("s", 1), 3: ("H", 1), 4: ("I", 1), 5: ("I", 2), 6: ("b", 1), 7: ("s", 1), 8: ("h", 1),
                9: ("i", 1), 10: ("i", 2), 11: ("f", 1), 12: ("d", 1), 13: ("I", 1), 16: ("Q", 1), 17: ("q", 1),
                18: ("Q", 1)}
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL, _DESCRIPTION = 256, 257, 258, 259, 262, 266, 270
_STRIPS, _SAMPLES, _ROWS, _STRIP_BYTES, _XRES, _YRES, _PREDICTOR = 273, 277, 278, 279, 282, 283, 317
_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _FORMAT = 322, 323, 324, 325, 339
_USED = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL, _DESCRIPTION, _STRIPS, _SAMPLES, _ROWS,
         _STRIP_BYTES, _XRES, _YRES, _PREDICTOR, _TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _FORMAT}

_MOST_PAGES = 100_000
_MOST_FIELDS = 4096
_MOST_VALUE = 2**22  # places of half a million strips

_ORDER = -1  # byte order, kept with the fields

Tags = dict[int, tuple[Any, ...]]


@dataclass(frozen=True)
class _Page:
    """One picture of a file: its type, its size, and where its parts lie."""

    path: Path
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    part: tuple[int, int]
    offsets: tuple[int, ...]
    counts: tuple[int, ...]
    compression: int
    predictor: int
    photometric: int

    @property
    def working_bytes(self) -> int:
        """Memory that reading takes: the page, and of one strip or tile what is packed, unpacked and predicted.

        Tiles are whole, so that one of a small picture may be of any size.
        """
        part = math.prod(self.part) * self.dtype.itemsize
        packed = max(self.counts, default=0) if self.compression != 1 else 0
        return math.prod(self.shape) * self.dtype.itemsize + packed + part * (2 if self.predictor == 2 else 1)

    def read(self, file: BinaryIO) -> NDArray[Any]:
        """The voxels [y, x] of the page in its stored type."""
        out = np.empty(self.shape, self.dtype)
        high, wide = self.part
        columns = -(-self.shape[1] // wide)
        for number, (offset, count) in enumerate(zip(self.offsets, self.counts, strict=True)):
            top, left = number // columns * high, number % columns * wide
            # The last strip is shorter; tiles are always whole.
            rows = min(high, self.shape[0] - top) if wide == self.shape[1] and columns == 1 else high
            file.seek(offset)
            data = self._unpack(file.read(count), rows * wide * self.dtype.itemsize)
            block = np.frombuffer(data, self.dtype).reshape(rows, wide)
            if self.predictor == 2:
                block = np.cumsum(block, axis=1, dtype=self.dtype.newbyteorder("="))
            target = out[top:top + rows, left:left + wide]
            target[:] = block[:target.shape[0], :target.shape[1]]
        return out

    def _unpack(self, data: bytes, expected: int) -> bytes:
        unpacked = _CODECS[self.compression](data, expected)
        if len(unpacked) != expected:
            more = " or more" if len(unpacked) > expected else ""
            raise fail(self.path, f"a part of a page should have {expected} bytes but has {len(unpacked)}{more}: "
                                  "the file is cut short or damaged.")
        return unpacked


def _inflate(data: bytes, expected: int) -> bytes:
    return zlib.decompressobj().decompress(data, expected + 1)


def _lzw(data: bytes, expected: int) -> bytes:
    try:
        import imagecodecs
    except ImportError as error:
        message = "this TIFF is packed with LZW, which needs the package imagecodecs: pip install imagecodecs"
        raise MissingPackageError(message) from error
    try:
        return bytes(imagecodecs.lzw_decode(data, out=expected + 1))  # it stops when full, so one more shows
    except (RuntimeError, ValueError) as error:  # its own errors are RuntimeErrors
        raise ValueError(f"LZW: {error}") from error


def _packbits(data: bytes, expected: int) -> bytes:
    out = bytearray()
    at = 0
    while at < len(data) and len(out) <= expected:
        code = data[at]
        if code < 128:
            out += data[at + 1:at + 2 + code]
            at += 2 + code
        else:
            out += data[at + 1:at + 2] * (257 - code if code > 128 else 0)
            at += 2 if code > 128 else 1
    return bytes(out)


_CODECS: dict[int, Callable[[bytes, int], bytes]] = {
    1: lambda data, _expected: data, 5: _lzw, 8: _inflate, 32946: _inflate, 32773: _packbits,
}


def read_header(path: Path) -> Header:
    """Geometry and type of a TIFF file with one or many pages."""
    with regular_file(path).open("rb") as file:
        tags = _directories(path, file)
    pages = [_page(path, one) for one in tags]
    description = tags[0].get(_DESCRIPTION, (b"",))[0]
    text = description.split(b"\0")[0].decode("utf-8", "replace") if isinstance(description, bytes) else ""
    spacing, count, notes = _described(path, text, tags[0])
    if count > len(pages) == 1:
        pages = _contiguous(path, pages[0], count)
    return _header(path, pages, spacing, notes)


def read_folder_header(folder: Path) -> Header:
    """Geometry and type of a folder of TIFF files with one page each."""
    found = (file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file())
    files = sorted(found, key=_natural)
    order = f"{len(files)} files in the order {shown(files[0].name, 40)} ... {shown(files[-1].name, 40)}"
    return _header(folder, [_single(file) for file in files[:_MOST_PAGES]], None, (order,))


def _single(path: Path) -> _Page:
    with path.open("rb") as file:
        tags = _directories(path, file)
    if len(tags) != 1:
        raise fail(path, f"it has {len(tags)} pages; in a folder of slices every file has one. Read it by itself.")
    return _page(path, tags[0])


def _natural(path: Path) -> tuple[list[Any], str]:
    """Sort slice2 before slice10."""
    words = re.split(r"([0-9]+)", path.name.lower())
    return [(int(word[:1000]), "") if word.isdecimal() else (-1, word) for word in words], path.name


def _header(path: Path, pages: list[_Page], spacing: Float3 | None, notes: tuple[str, ...]) -> Header:
    first = pages[0]
    for number, page in enumerate(pages):
        if (page.shape, page.dtype) != (first.shape, first.dtype):
            raise fail(path, f"page {number + 1} has {page.shape} pixels of {page.dtype.name} but the first has "
                             f"{first.shape} of {first.dtype.name}; all slices must be alike.")
    height, width = first.shape
    shape, _ = volume_shape(path, [width, height, len(pages)], first.dtype.itemsize)
    if spacing is None:
        notes += ("the file does not say how far slices are apart; spacing 1 was taken",)
    if first.photometric == 0:
        notes += ("the file shows small values as white; the values are kept as they are",)
    if first.photometric == 3:
        notes += ("the file has a colour table; the voxels are its indices",)
    return Header(path, shape, first.dtype, lambda: _blocks(pages), spacing or (1.0, 1.0, 1.0), notes=notes,
                  working_bytes=max(page.working_bytes for page in pages))


def _blocks(pages: list[_Page]) -> Iterator[NDArray[Any]]:
    for page in pages:
        with page.path.open("rb") as file:
            yield page.read(file)[None]


def _directories(path: Path, file: BinaryIO) -> list[Tags]:
    """The fields of every page; a chain that runs in a circle is refused."""
    start = file.read(16)
    order = {b"II": "<", b"MM": ">"}.get(start[:2])
    version = struct.unpack_from(f"{order}H", start, 2)[0] if order and len(start) == 16 else 0
    if order is None or version not in (42, 43):
        raise fail(path, "this is not a TIFF file: it begins neither with II nor MM and 42 or 43.")
    big = version == 43
    offset = struct.unpack_from(order + ("Q" if big else "I"), start, 8 if big else 4)[0]
    pages: list[Tags] = []
    seen: set[int] = set()
    while offset:
        if offset in seen or len(pages) >= _MOST_PAGES:
            raise fail(path, f"its pages run in a circle or are more than {_MOST_PAGES}; the file is damaged.")
        seen.add(offset)
        tags, offset = _directory(path, file, order, big, offset)
        pages.append(tags)
    if not pages:
        raise fail(path, "it has no pages.")
    return pages


def _directory(path: Path, file: BinaryIO, order: str, big: bool, offset: int) -> tuple[Tags, int]:
    size, word = (20, "Q") if big else (12, "I")
    count = struct.unpack(order + ("Q" if big else "H"), _at(path, file, offset, 8 if big else 2))[0]
    if count > _MOST_FIELDS:
        raise fail(path, f"a page claims {count} fields; the file is damaged.")
    body = file.read(count * size + struct.calcsize(word))
    if len(body) < count * size + struct.calcsize(word):
        raise fail(path, "a page's list of fields is cut short.")
    tags: Tags = {}
    for start in range(0, count * size, size):
        tag, kind, number = struct.unpack_from(order + "HH" + word, body, start)
        if tag not in _USED or kind not in _FIELD_TYPES:
            continue
        form, values = _FIELD_TYPES[kind]
        length = struct.calcsize("<" + form) * values * number
        if length > _MOST_VALUE:
            raise fail(path, f"the field {tag} claims {length} bytes; the file is damaged.")
        inline = body[start + 4 + struct.calcsize(word):start + size]
        place = struct.unpack(order + word, inline)[0]
        value = inline[:length] if length <= len(inline) else _at(path, file, place, length)
        tags[tag] = struct.unpack(f"{order}{values * number}{form}", value)
    tags[_ORDER] = (order,)
    return tags, int(struct.unpack_from(order + word, body, count * size)[0])


def _at(path: Path, file: BinaryIO, offset: int, count: int) -> bytes:
    file.seek(min(offset, 2**62))
    data = file.read(count)
    if len(data) < count:
        raise fail(path, f"it is cut short: {count} bytes at {offset} are missing.")
    return data


def _page(path: Path, tags: Tags) -> _Page:
    def one(tag: int, missing: int | None = None) -> int:
        value = tags.get(tag, ())[:1]
        if not value and missing is not None:
            return missing
        if not value or not isinstance(value[0], int):
            raise fail(path, f"a page lacks the field {tag} or it is no whole number; the file is damaged.")
        return value[0]

    width, height, samples = one(_WIDTH), one(_HEIGHT), one(_SAMPLES, 1)
    photometric = one(_PHOTOMETRIC, 1)
    if samples != 1 or photometric not in (0, 1, 3):
        raise fail(path, f"its pixels are colours ({samples} samples); save one channel, or the brightness, first.")
    dtype = _dtype(path, one(_BITS, 1), one(_FORMAT, 1), str(tags[_ORDER][0]))
    if one(_COMPRESSION, 1) not in _CODECS:
        raise fail(path, f"the compression {one(_COMPRESSION)} is not supported; save it uncompressed or with deflate.")
    if one(_FILL, 1) != 1 or one(_PREDICTOR, 1) not in (1, 2) or (one(_PREDICTOR, 1) == 2 and dtype.kind == "f"):
        raise fail(path, "its bit order or its predictor is not supported; save it uncompressed.")
    volume_shape(path, [width, height], dtype.itemsize)
    tiled = _TILES in tags
    part = (one(_TILE_HEIGHT), one(_TILE_WIDTH)) if tiled else (min(one(_ROWS, height), height), width)
    return _parts(path, tags, tiled, _Page(path, (height, width), dtype, part, (), (), one(_COMPRESSION, 1),
                                           one(_PREDICTOR, 1), photometric))


def _dtype(path: Path, bits: int, form: int, order: str) -> np.dtype[Any]:
    kind = {1: "u", 2: "i", 3: "f"}.get(form)
    if kind is None or bits not in ((16, 32, 64) if kind == "f" else (8, 16, 32, 64)):
        raise fail(path, f"pixels of {bits} bits and format {form} are not supported; save 8, 16 or 32 bits.")
    return np.dtype(f"{order}{kind}{bits // 8}")


def _parts(path: Path, tags: Tags, tiled: bool, page: _Page) -> _Page:
    """The page with its strips or tiles, all of which must lie in the file."""
    offsets, counts = (tuple(n for n in tags.get(tag, ()) if isinstance(n, int))
                       for tag in ((_TILES, _TILE_BYTES) if tiled else (_STRIPS, _STRIP_BYTES)))
    high, wide = page.part
    size = path.stat().st_size
    if min(high, wide) < 1 or high * wide * page.dtype.itemsize > 2**40:
        raise fail(path, f"its parts have {wide} x {high} pixels; the file is damaged.")
    expected = -(-page.shape[0] // high) * -(-page.shape[1] // wide)
    if not (len(offsets) == len(counts) == expected):
        raise fail(path, f"a page should have {expected} parts but has {len(offsets)} places and {len(counts)} sizes.")
    places = zip(offsets, counts, strict=True)
    if any(not (0 < offset <= size and 0 < count <= size - offset) for offset, count in places):
        raise fail(path, f"a part of a page lies outside the file of {size} bytes: it is cut short or damaged.")
    return replace(page, offsets=offsets, counts=counts)


def _contiguous(path: Path, page: _Page, count: int) -> list[_Page]:
    """ImageJ writes large stacks as one page and the voxels of all after one another."""
    size = page.shape[0] * page.shape[1] * page.dtype.itemsize
    begin, present = page.offsets[0], path.stat().st_size - page.offsets[0]
    if page.compression != 1 or count > _MOST_PAGES or count * size > present:
        raise fail(path, f"its description claims {count} slices of {size} bytes but the file has {present} bytes of "
                         "voxels: it is cut short or damaged.")
    whole = replace(page, part=page.shape, counts=(size,))
    return [replace(whole, offsets=(begin + number * size,)) for number in range(count)]


def _described(path: Path, text: str, tags: Tags) -> tuple[Float3 | None, int, tuple[str, ...]]:
    """Spacing, number of slices and remarks of the description that ImageJ or OME left in the first page."""
    if text.startswith("ImageJ="):
        fields = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
        counts = {name: int(fields[name]) for name in ("images", "channels", "slices", "frames")
                  if fields.get(name, "").isdecimal() and len(fields[name]) < 10}
        _refuse_axes(path, {name: counts.get(name, 1) for name in ("channels", "frames")})
        return _imagej_spacing(fields, tags), counts.get("images", 1), _unit_note(fields.get("unit", ""))
    if "<OME" in text[:2000]:
        pixels = re.search(r"<Pixels[^>]*>", text)
        found = dict(re.findall(r'([A-Za-z]+)="([^"]{1,60})"', pixels[0])) if pixels else {}
        _refuse_axes(path, {name: int(found[name]) for name in ("SizeC", "SizeT")
                            if found.get(name, "").isdecimal() and len(found[name]) < 10})
        lengths = [_positive(found.get(f"PhysicalSize{axis}", "")) for axis in "XYZ"]
        if lengths[0] and lengths[1]:
            return (lengths[0], lengths[1], lengths[2] or 1.0), 1, _unit_note(found.get("PhysicalSizeXUnit", "µm"))
    return None, 1, ()


def _refuse_axes(path: Path, counts: dict[str, int]) -> None:
    if any(count > 1 for count in counts.values()):
        axes = ", ".join(f"{name}: {count}" for name, count in counts.items())
        raise fail(path, f"a volume has three axes but this stack has more ({axes}); save one channel and one time.")


def _unit_note(unit: str) -> tuple[str, ...]:
    return (f"lengths of the file are in {shown(unit, 20)} and stay so",) if unit not in ("", "mm", "pixel") else ()


def _positive(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0 else None


def _imagej_spacing(fields: dict[str, str], tags: Tags) -> Float3 | None:
    if not fields.get("unit") and "spacing" not in fields:
        return None

    def length(tag: int) -> float:
        above, below = (*tags.get(tag, ()), 0, 0)[:2]
        return below / above if above > 0 and below > 0 else 1.0

    return length(_XRES), length(_YRES), _positive(fields.get("spacing", "")) or 1.0
