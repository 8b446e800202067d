"""TIFF stacks: a file of many pages, or a folder of single pages in the natural order of their names.

Files are written as OME-TIFF by tifffile: axes, voxel size with its unit, names and colours of channels. OME has no
place for the origin and the directions of a grid, nor for what is labels: these are annotations of our own, of the kind
that OME has for that (MapAnnotation), which other programs show as such.

The structure is read here and not by tifffile, which fills in or leaves out damaged parts: strips of length zero and
short tiles become voxels, a broken chain of pages ends early, pages of another size are left out, LZW data too long are
cut, and circles of over 100 pages never end. It reports this, if at all, only in its log, which callers may have
switched off: of 2000 damaged stacks, the checks below around tifffile's fields let one lose two of its three slices, or
with logging off 59 become other voxels, and were no shorter. LZW and PackBits are left to imagecodecs.
Source: TIFF 6.0, the BigTIFF proposal, and the descriptions that ImageJ and OME put into the first page.
"""

from __future__ import annotations

import html
import math
import re
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, BinaryIO
from uuid import UUID, uuid4

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Progress
from deformnb.errors import DeformError, MissingPackageError
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import (
    SINGLE,
    Blocks,
    Header,
    Layout,
    checked_layout,
    fail,
    regular_file,
    shown,
    volume_shape,
)
from deformnb.io.streams import stored_dtype
from deformnb.volume.volume import IDENTITY, Grid, Volume, optional_package, voxel_checksum

SUFFIXES = (".ome.tif", ".ome.tiff", ".tif", ".tiff")

# NumPy's code and how many of it make one value: a rational is a pair. Texts and undefined bytes (S) stay bytes.
_FIELD_TYPES = {1: ("u1", 1), 2: ("S1", 1), 3: ("u2", 1), 4: ("u4", 1), 5: ("u4", 2), 6: ("i1", 1), 7: ("S1", 1),
                8: ("i2", 1), 9: ("i4", 1), 10: ("i4", 2), 11: ("f4", 1), 12: ("f8", 1), 13: ("u4", 1), 16: ("u8", 1),
                17: ("i8", 1), 18: ("u8", 1)}
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL, _DESCRIPTION = 256, 257, 258, 259, 262, 266, 270
_STRIPS, _SAMPLES, _ROWS, _STRIP_BYTES, _XRES, _YRES, _PLANAR, _PREDICTOR = 273, 277, 278, 279, 282, 283, 284, 317
_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _FORMAT = 322, 323, 324, 325, 339
_USED = {_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _PHOTOMETRIC, _FILL, _DESCRIPTION, _STRIPS, _SAMPLES, _ROWS,
         _STRIP_BYTES, _XRES, _YRES, _PLANAR, _PREDICTOR, _TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES, _FORMAT}

_MOST_PAGES = 100_000
_MOST_FIELDS = 4096
_MOST_VALUE = 2**22  # places of half a million strips
_MOST_TABLES = 2**26  # of all pages, where they must be sorted: damaged ones may share a table on the disk

Tags = dict[int, NDArray[Any] | bytes]


@dataclass(frozen=True)
class _Page:
    """One picture of a file: its type, its size, and where its parts lie."""

    path: Path
    shape: tuple[int, int]
    dtype: np.dtype[Any]
    part: tuple[int, int]
    offsets: NDArray[np.int64]
    counts: NDArray[np.int64]
    compression: int
    predictor: int
    photometric: int
    samples: int = 1

    @property
    def pixel_bytes(self) -> int:
        """Bytes of a pixel: of the parts of its colour, which lie one after the other."""
        return self.dtype.itemsize * self.samples

    @property
    def working_bytes(self) -> int:
        """Memory that reading takes: the page, its table, and of one strip or tile the packed, unpacked and predicted.

        Tiles are whole, so that one of a small picture may be of any size.
        """
        part = math.prod(self.part) * self.pixel_bytes
        packed = int(self.counts.max()) if self.compression != 1 else 0
        table = self.offsets.nbytes + self.counts.nbytes
        return math.prod(self.shape) * self.pixel_bytes + table + packed + part * (2 if self.predictor == 2 else 1)

    def read(self, file: BinaryIO) -> NDArray[Any]:
        """The voxels [y, x] of the page in its stored type; [y, x, part] of colours."""
        colours = (self.samples,) if self.samples > 1 else ()
        out = np.empty((*self.shape, *colours), self.dtype)
        high, wide = self.part
        columns = -(-self.shape[1] // wide)
        for number, (offset, count) in enumerate(zip(self.offsets, self.counts, strict=True)):
            top, left = number // columns * high, number % columns * wide
            # The last strip is shorter; tiles are always whole.
            rows = min(high, self.shape[0] - top) if wide == self.shape[1] and columns == 1 else high
            file.seek(int(offset))
            expected = rows * wide * self.pixel_bytes
            # Of plain voxels one byte more than there should be is enough to see that there are too many.
            data = file.read(min(int(count), expected + 1) if self.compression == 1 else int(count))
            data = self._unpack(data, expected)
            block = np.frombuffer(data, self.dtype).reshape(rows, wide, *colours)
            if self.predictor == 2:
                block = np.cumsum(block, axis=1, dtype=self.dtype.newbyteorder("="))
            target = out[top:top + rows, left:left + wide]
            target[:] = block[:target.shape[0], :target.shape[1]]
        return out

    def _unpack(self, data: bytes, expected: int) -> bytes:
        try:
            unpacked = _CODECS[self.compression](data, expected)
        except MissingPackageError:
            raise
        except (RuntimeError, ValueError, zlib.error) as error:  # errors of imagecodecs are RuntimeErrors
            raise fail(self.path, f"a part of a page should have {expected} bytes but cannot be unpacked "
                                  f"({shown(error).rstrip('.')}): the file is cut short or damaged.") from error
        if len(unpacked) != expected:
            more = " or more" if len(unpacked) > expected else ""
            raise fail(self.path, f"a part of a page should have {expected} bytes but has {len(unpacked)}{more}: "
                                  "the file is cut short or damaged.")
        return unpacked


def _inflate(data: bytes, expected: int) -> bytes:
    decoder = zlib.decompressobj()
    unpacked = decoder.decompress(data, expected + 1)
    if len(unpacked) == expected and not decoder.eof:
        raise ValueError("deflate: the data end before their check sum")
    return unpacked


def _imagecodecs(name: str, data: bytes, expected: int) -> bytes:
    try:
        import imagecodecs
    except ImportError as error:
        message = f"this TIFF is packed with {name}, which needs the package imagecodecs: pip install imagecodecs"
        raise MissingPackageError(message) from error
    decode = {"LZW": imagecodecs.lzw_decode, "PackBits": imagecodecs.packbits_decode}[name]
    return bytes(decode(data, out=expected + 1))  # LZW stops when full, so one more shows


_CODECS: dict[int, Callable[[bytes, int], bytes]] = {
    1: lambda data, _expected: data, 5: partial(_imagecodecs, "LZW"), 8: _inflate, 32946: _inflate,
    32773: partial(_imagecodecs, "PackBits"),
}


def read_header(path: Path) -> Header:
    """Geometry and type of a TIFF file with one or many pages."""
    with regular_file(path).open("rb") as file:
        _, tags = next(_directories(path, file))
    description = tags.get(_DESCRIPTION, b"")
    text = description.split(b"\0")[0].decode("utf-8", "replace") if isinstance(description, bytes) else ""
    found = _described(path, text, tags)
    header = _header(path, lambda: _pages(path, found.count), found)
    return _annotated(header, text) if "<OME" in text[:2000] else header


def read_folder_header(folder: Path) -> Header:
    """Geometry and type of a folder of TIFF files with one page each."""
    found = (file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES and file.is_file())
    files = sorted(found, key=_natural)
    order = f"{len(files)} files in the order {shown(files[0].name, 40)} ... {shown(files[-1].name, 40)}"
    return _header(folder, lambda: _single_pages(files), _Described(notes=(order,)))


def _single_pages(files: Iterable[Path]) -> Iterator[tuple[_Page, BinaryIO]]:
    for file in files:
        pages = _pages(file, 1)
        yield next(pages)
        more = sum(1 for _ in pages)
        if more:
            raise fail(file, f"it has {1 + more} pages; in a folder of slices every file has one. Read it by itself.")


def _natural(path: Path) -> tuple[list[Any], str]:
    """Sort slice2 before slice10."""
    words = re.split(r"([0-9]+)", path.name.lower())
    return [(int(word[:1000]), "") if word.isdecimal() else (-1, word) for word in words], path.name


def _header(path: Path, pages: Callable[[], Iterator[tuple[_Page, BinaryIO]]], found: _Described) -> Header:
    """Header common to all pages; only the first is kept, because each may have a table of half a million strips."""
    first, count, working_bytes = None, 0, 0
    for page, _ in pages():
        first = first or page
        _require_like(path, page, first, count)
        count, working_bytes = count + 1, max(working_bytes, page.working_bytes)
    if first is None:
        raise fail(path, "it has no pages.")
    (height, width), spacing, notes = first.shape, found.spacing, found.notes
    layout, slices = _layout(path, found, first.samples, count)
    shape, _ = volume_shape(path, [width, height, slices], first.pixel_bytes)
    if spacing is None:
        notes += ("the file does not state the distance of slices; spacing 1 was taken",)
    if first.photometric == 0:
        notes += ("the file shows small values as white; the values are kept as they are",)
    if first.photometric == 3:
        notes += ("the file has a colour table; the voxels are its indices",)
    blocks: Blocks = lambda: _blocks(path, pages(), first, count)  # noqa: E731
    planes = layout.channels // first.samples
    if layout.frames * planes > 1:
        blocks = lambda: _sorted_blocks(path, pages(), found.order, (layout.frames, planes, slices))  # noqa: E731
    return Header(path, shape, first.dtype, blocks, spacing or (1.0, 1.0, 1.0), notes=notes,
                  working_bytes=working_bytes, layout=layout)


def _layout(path: Path, found: _Described, samples: int, count: int) -> tuple[Layout, int]:
    """Channels and moments of so many pages, and the number of slices of each."""
    layout = found.layout
    planes = layout.channels
    if samples > 1:
        if planes not in (1, samples):
            raise fail(path, f"it has {planes} channels of pages in colours; save the channels by themselves.")
        layout = replace(layout, channels=samples, kind="rgb" if samples == 3 else "rgba", interleaved=True, names=(),
                         colours=())
        planes = 1
    layout = checked_layout(path, layout)
    slices, rest = divmod(count, planes * layout.frames)
    if rest or not slices:
        raise fail(path, f"its description claims {layout.frames} moments of {planes} channels, into which its {count} "
                         "pages cannot be divided; it is damaged, or one part of a set of files.")
    if samples > 1 and layout.frames > 1 and found.order.index("T") < found.order.index("Z"):
        raise fail(path, "its moments lie between its slices, which is not supported in colours; save one moment.")
    return layout, slices


def _sorted_blocks(path: Path, pages: Iterator[tuple[_Page, BinaryIO]], order: str,
                   counts: tuple[int, int, int]) -> Iterator[NDArray[Any]]:
    """The pages moment by moment, channel by channel and slice by slice, which may lie in another order.

    Parameters
    ----------
    order : the axes Z, C and T, the one that changes fastest first.
    counts : of moments, channels and slices.
    """
    found, tables = [], 0
    with closing(pages):  # type: ignore[type-var]  # generators can be closed
        for page, _ in pages:
            found.append(page)
            tables += page.offsets.nbytes + page.counts.nbytes
            if tables > _MOST_TABLES:
                raise fail(path, f"the tables of its pages take more than {_MOST_TABLES} bytes; save it uncompressed.")
    if len(found) != math.prod(counts):
        raise fail(path, f"it had {math.prod(counts)} pages and now has {len(found)}: another program is writing it. "
                         "Read it again.")
    size = dict(zip("TCZ", counts, strict=True))
    with path.open("rb") as file:
        for t, c, z in product(*map(range, counts)):
            at, step, place = 0, 1, {"T": t, "C": c, "Z": z}
            for axis in order:
                at, step = at + step * place[axis], step * size[axis]
            yield found[at].read(file)[None]


def _require_like(path: Path, page: _Page, first: _Page, number: int) -> None:
    if (page.shape, page.dtype, page.samples) != (first.shape, first.dtype, first.samples):
        raise fail(path, f"page {number + 1} has {page.shape} pixels of {page.dtype.name} but the first has "
                         f"{first.shape} of {first.dtype.name}; all slices must be alike.")


def _blocks(path: Path, pages: Iterator[tuple[_Page, BinaryIO]], first: _Page, count: int) -> Iterator[NDArray[Any]]:
    number = 0
    with closing(pages):  # type: ignore[type-var]  # generators can be closed
        for page, file in pages:
            _require_like(path, page, first, number)
            yield page.read(file)[None]
            number += 1
    if number != count:
        raise fail(path, f"it had {count} pages and now has {number}: another program is writing it. Read it again.")


def _pages(path: Path, slices: int) -> Iterator[tuple[_Page, BinaryIO]]:
    """The pages in order and the open file, each checked when its turn comes.

    A file of one page whose description claims more slices has their voxels one after another behind it.
    """
    with path.open("rb") as file:
        number = 0
        for order, tags in _directories(path, file):
            page = _page(path, order, tags)
            number += 1
            yield page, file
        if 1 < number < slices:
            raise fail(path, f"its description claims {slices} slices but it has {number} pages; it is damaged.")
        if number < slices:
            yield from ((behind, file) for behind in _contiguous(path, page, slices))


def _directories(path: Path, file: BinaryIO) -> Iterator[tuple[str, Tags]]:
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
        if offset in seen or len(seen) >= _MOST_PAGES:
            raise fail(path, f"its pages run in a circle or are more than {_MOST_PAGES}; the file is damaged.")
        seen.add(offset)
        tags, offset = _directory(path, file, order, big, offset)
        yield order, tags


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
        if tag not in _USED:
            continue
        if kind not in _FIELD_TYPES:  # to leave it out would mean its default: voxels of another type, in silence
            raise fail(path, f"the field {tag} has the unknown type {kind}; the file is damaged.")
        code, values = _FIELD_TYPES[kind]
        length = int(code[1]) * values * number
        if length > _MOST_VALUE:
            raise fail(path, f"the field {tag} claims {length} bytes; the file is damaged.")
        inline = body[start + 4 + struct.calcsize(word):start + size]
        place = struct.unpack(order + word, inline)[0]
        value = inline[:length] if length <= len(inline) else _at(path, file, place, length)
        tags[tag] = value if code == "S1" else np.frombuffer(value, order + code)
    return tags, int(struct.unpack_from(order + word, body, count * size)[0])


def _at(path: Path, file: BinaryIO, offset: int, count: int) -> bytes:
    file.seek(min(offset, 2**62))
    data = file.read(count)
    if len(data) < count:
        raise fail(path, f"it is cut short: {count} bytes at {offset} are missing.")
    return data


def _page(path: Path, order: str, tags: Tags) -> _Page:
    def one(tag: int, missing: int | None = None) -> int:
        if tag not in tags and missing is not None:
            return missing
        value = _whole_numbers(tags, tag)
        if not value.size:
            raise fail(path, f"a page lacks the field {tag} or it is no whole number; the file is damaged.")
        return int(value[0])

    width, height, samples = one(_WIDTH), one(_HEIGHT), one(_SAMPLES, 1)
    photometric = one(_PHOTOMETRIC, 1)
    is_colour = photometric == 2 and samples in (3, 4) and one(_PLANAR, 1) == 1
    if not is_colour and (samples != 1 or photometric not in (0, 1, 3)):
        raise fail(path, f"its pixels are colours of a kind that is not read ({samples} samples, photometric "
                         f"{photometric}); save them as RGB, whose parts lie together, or as grey values.")
    dtype = _dtype(path, one(_BITS, 1), one(_FORMAT, 1), order)
    if one(_COMPRESSION, 1) not in _CODECS:
        raise fail(path, f"the compression {one(_COMPRESSION)} is not supported; save it uncompressed or with deflate.")
    if one(_FILL, 1) != 1 or one(_PREDICTOR, 1) not in (1, 2) or (one(_PREDICTOR, 1) == 2 and dtype.kind == "f"):
        raise fail(path, "its bit order or its predictor is not supported; save it uncompressed.")
    volume_shape(path, [width, height], dtype.itemsize * samples)
    tiled = _TILES in tags
    part = (one(_TILE_HEIGHT), one(_TILE_WIDTH)) if tiled else (min(one(_ROWS, height), height), width)
    offsets, counts = (_whole_numbers(tags, tag).astype(np.int64)  # beyond 2**63 is less than 0, which is refused too
                       for tag in ((_TILES, _TILE_BYTES) if tiled else (_STRIPS, _STRIP_BYTES)))
    page = _Page(path, (height, width), dtype, part, offsets, counts, one(_COMPRESSION, 1), one(_PREDICTOR, 1),
                 photometric, samples)
    _check_parts(page)
    return page


def _whole_numbers(tags: Tags, tag: int) -> NDArray[Any]:
    value = tags.get(tag)
    return value if isinstance(value, np.ndarray) and value.dtype.kind in "ui" else np.empty(0, np.int64)


def _dtype(path: Path, bits: int, form: int, order: str) -> np.dtype[Any]:
    kind = {1: "u", 2: "i", 3: "f"}.get(form)
    if kind is None or bits not in ((16, 32, 64) if kind == "f" else (8, 16, 32, 64)):
        raise fail(path, f"pixels of {bits} bits and format {form} are not supported; save 8, 16 or 32 bits.")
    return np.dtype(f"{order}{kind}{bits // 8}")


def _check_parts(page: _Page) -> None:
    """Refuse a page whose strips or tiles are too few or too many, or do not all lie in the file."""
    path, offsets, counts, (high, wide) = page.path, page.offsets, page.counts, page.part
    size = path.stat().st_size
    if min(high, wide) < 1 or high * wide * page.pixel_bytes > 2**40:
        raise fail(path, f"its parts have {wide} x {high} pixels; the file is damaged.")
    expected = -(-page.shape[0] // high) * -(-page.shape[1] // wide)
    if not (len(offsets) == len(counts) == expected):
        raise fail(path, f"a page should have {expected} parts but has {len(offsets)} places and {len(counts)} sizes.")
    if not ((offsets > 0) & (offsets <= size) & (counts > 0) & (counts <= size - offsets)).all():
        raise fail(path, f"a part of a page lies outside the file of {size} bytes: it is cut short or damaged.")


def _contiguous(path: Path, page: _Page, count: int) -> Iterator[_Page]:
    """The slices after the first: ImageJ writes large stacks as one page and the voxels of all after one another."""
    size = page.shape[0] * page.shape[1] * page.pixel_bytes
    begin = int(page.offsets[0])
    present = path.stat().st_size - begin
    if page.compression != 1 or count > _MOST_PAGES or count * size > present:
        raise fail(path, f"its description claims {count} slices of {size} bytes but the file has {present} bytes of "
                         "voxels: it is cut short or damaged.")
    for number in range(1, count):
        yield replace(page, part=page.shape, offsets=np.array([begin + number * size]), counts=np.array([size]))


@dataclass(frozen=True)
class _Described:
    """What the description of ImageJ or OME in the first page says.

    Parameters
    ----------
    count : pages that the file has at least, which ImageJ may have put one after another behind a single one.
    layout : its channels, still those in colours too, and moments.
    order : of the pages, the axis that changes fastest first.
    """

    spacing: Float3 | None = None
    count: int = 1
    notes: tuple[str, ...] = ()
    layout: Layout = SINGLE
    order: str = "ZCT"


_CHANNEL = re.compile(r"<Channel\b([^>]{0,2000})>")
_ATTRIBUTE = re.compile(r'([A-Za-z]+)="([^"]{1,60})"')


def _described(path: Path, text: str, tags: Tags) -> _Described:
    """Spacing, number of slices, channels, moments and remarks of the description in the first page."""
    if text.startswith("ImageJ="):
        fields = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
        counts = {name: int(fields[name]) for name in ("images", "channels", "slices", "frames")
                  if fields.get(name, "").isdecimal() and len(fields[name]) < 10}
        # ImageJ keeps colours of RGB in the pixels, and its other channels in pages that change fastest.
        layout = Layout(counts.get("frames", 1), counts.get("channels", 1),
                        duration=_positive(fields.get("finterval", "")) or 0.0)
        return _Described(_imagej_spacing(fields, tags), counts.get("images", 1), _unit_note(fields.get("unit", "")),
                          layout, "CZT")
    if "<OME" in text[:2000]:
        pixels = re.search(r"<Pixels[^>]*>", text)
        found = dict(_ATTRIBUTE.findall(pixels[0])) if pixels else {}
        layout = _ome_layout(found, text)
        order = found.get("DimensionOrder", "XYZCT")[2:]
        if sorted(order) != ["C", "T", "Z"]:
            raise fail(path, f"its DimensionOrder is {shown(found['DimensionOrder'], 20)}, which OME does not define.")
        lengths = [_positive(found.get(f"PhysicalSize{axis}", "")) for axis in "XYZ"]
        if lengths[0] and lengths[1]:
            return _Described((lengths[0], lengths[1], lengths[2] or 1.0), 1,
                              _unit_note(found.get("PhysicalSizeXUnit", "µm")), layout, order)
        return _Described(layout=layout, order=order)
    return _Described()


def _ome_layout(pixels: dict[str, str], text: str) -> Layout:
    """Channels with their names and colours (red, green, blue, alpha in 32 bits, with a sign) and moments of OME."""
    sizes = [int(pixels[name]) if pixels.get(name, "").isdecimal() and len(pixels[name]) < 10 else 1
             for name in ("SizeT", "SizeC")]
    channels = [dict(_ATTRIBUTE.findall(found)) for found in _CHANNEL.findall(text)]
    names = tuple(shown(html.unescape(channel.get("Name", ""))) for channel in channels)
    codes = [channel.get("Color", "") for channel in channels]
    colours = tuple(((int(code) >> 24 & 255) / 255, (int(code) >> 16 & 255) / 255, (int(code) >> 8 & 255) / 255)
                    for code in codes if re.fullmatch(r"-?[0-9]{1,10}", code))
    return Layout(sizes[0], sizes[1], names=names if len(names) == sizes[1] and all(names) else (),
                  colours=colours if len(colours) == sizes[1] else (),
                  duration=_positive(pixels.get("TimeIncrement", "")) or 0.0)


_ANNOTATION = re.compile(r'<M K="deformnb ([a-z]+)">([^<]{1,400})</M>')


def _annotated(header: Header, text: str) -> Header:
    """The header with origin, directions and labels of our own annotations, where :func:`write` has left them."""
    found = {key: value.split() for key, value in _ANNOTATION.findall(text)}
    try:
        origin = tuple(map(float, found.get("origin", ("0", "0", "0"))))
        rows = np.reshape(list(map(float, found["direction"])), (3, 3)).tolist() if "direction" in found else IDENTITY
        frame = Grid((1, 1, 1), (1.0, 1.0, 1.0), origin, rows)  # type: ignore[arg-type]
    except (DeformError, ValueError) as error:
        raise fail(header.path, f"its annotations of deformnb are damaged: {shown(error, 200)}") from error
    return replace(header, origin=frame.origin, direction=frame.direction,
                   is_labels=True if found.get("labels") == ["yes"] else header.is_labels)


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
        above, below = (*_whole_numbers(tags, tag).tolist(), 0, 0)[:2]
        return below / above if above > 0 and below > 0 else 1.0

    return length(_XRES), length(_YRES), _positive(fields.get("spacing", "")) or 1.0


# -- writing ---------------------------------------------------------------------------------------------------------

# A classic TIFF has room for 4 GiB; its tables and its description take some of that.
_MOST_CLASSIC = 2**32 - 2**25


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a volume as OME-TIFF, a page for each slice."""
    def pages() -> Iterator[NDArray[Any]]:
        for number, page in enumerate(volume.values):
            yield page.astype(stored_dtype(volume), copy=False)
            if progress is not None:
                progress((number + 1) / len(volume.values))

    checksum = voxel_checksum(volume.dtype, volume.shape, volume.values)  # equal volumes give equal files
    write_pages(pages(), path, volume, SINGLE, overwrite=overwrite, identity=UUID(checksum[:32]))


def write_pages(pages: Iterator[NDArray[Any]], path: Path, like: Volume, layout: Layout, *, overwrite: bool,
                identity: UUID | None = None) -> None:
    """Write pages [y, x], or [y, x, part] of colours, as OME-TIFF: of each moment all channels, of these all slices.

    Parameters
    ----------
    like : a channel, with the name and the grid of all of them.
    layout : number of moments, and of channels with their names and colours.
    identity : of the file; default is a random one.

    Raises
    ------
    MissingPackageError
        If tifffile is not installed.
    """
    tifffile = optional_package("tifffile")
    grid, dtype = like.grid, stored_dtype(like)
    is_colour = layout.kind in ("rgb", "rgba")
    inner, planes = (layout.channels, 1) if is_colour else (1, layout.channels)
    shape = (layout.frames, planes, *grid.shape, *([inner] if is_colour else []))
    size = math.prod(shape) * dtype.itemsize
    colour: dict[str, Any] = {"photometric": "rgb" if is_colour else "minisblack"}
    if layout.kind == "rgba":
        colour["extrasamples"] = ["unassalpha"]
    with atomic_write(path, overwrite=overwrite, needed=size) as file, tifffile.TiffWriter(
            file, bigtiff=size > _MOST_CLASSIC, ome=True, byteorder="<") as writer:
        writer.write(pages, shape=shape, dtype=dtype, software="deformnb", resolutionunit="CENTIMETER",
                     resolution=(10 / grid.spacing[0], 10 / grid.spacing[1]),
                     metadata=_ome_metadata(like, layout, identity or uuid4(), is_colour), **colour)


def _ome_metadata(like: Volume, layout: Layout, identity: UUID, is_colour: bool) -> dict[str, Any]:
    """Metadata as tifffile takes them for the description of the first page."""
    grid = like.grid
    about: dict[str, Any] = {"axes": "TCZYXS" if is_colour else "TCZYX", "Name": like.name, "Creator": "deformnb",
                             "UUID": str(identity)}
    for axis, length in zip("XYZ", grid.spacing, strict=True):
        about |= {f"PhysicalSize{axis}": length, f"PhysicalSize{axis}Unit": "mm"}
    if layout.duration:
        about |= {"TimeIncrement": layout.duration, "TimeIncrementUnit": "s"}
    if layout.channels > 1 and not is_colour:
        about["Channel"] = {"Name": list(layout.names), "Color": [_colour_code(colour) for colour in layout.colours]}
    own = {"deformnb origin": " ".join(map(repr, grid.origin)),
           "deformnb direction": " ".join(repr(value) for row in grid.direction for value in row)}
    return about | {"MapAnnotation": own | ({"deformnb labels": "yes"} if like.is_labels else {})}


def _colour_code(colour: Float3) -> int:
    """Red, green, blue and alpha in 32 bits, with a sign.

    Examples
    --------
    >>> _colour_code((0.0, 1.0, 0.0)), _colour_code((1.0, 0.0, 1.0))
    (16711935, -16711681)
    """
    red, green, blue = (round(255 * part) for part in colour)
    code = red << 24 | green << 16 | blue << 8 | 255
    return code - 2**32 if code >= 2**31 else code
