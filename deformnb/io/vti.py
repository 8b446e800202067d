"""VTK image data (.vti), binary: inline or appended, base64 or raw, plain or zlib.

VTK's own reader ends the whole process on a damaged header, so the XML is read here: only its tags, one at a time,
without entities or document types, and voxels only where the tags say they are.
Source: the VTK XML file formats, chapter "VTK File Formats" of the VTK user's guide.
"""

from __future__ import annotations

import binascii
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import VolumeFileError
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import Header, fail, floats, integers, shown, triple, volume_shape
from deformnb.io.packing import LEVEL, Progress, needed_bytes, slabs_of_bytes, stored_dtype
from deformnb.io.streams import Pieces, Stream, stream_blocks, take
from deformnb.volume import Matrix3, Volume

_TYPES = {"Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
          "UInt64": "u8", "Float32": "f4", "Float64": "f8"}
_NAMES = {dtype: name for name, dtype in _TYPES.items()}

# Real files have some twenty tags; time series with many arrays a few hundred.
_MOST_TAGS = 10_000
_CHUNK = 2**16
_BLOCK = 2**20
_MOST_BLOCK = 2**31

# An array of this name holds labels: VTI has no other place that VTK keeps.
_LABELS = "labels"


@dataclass
class _Tag:
    name: str
    attributes: dict[str, str]
    parent: str
    begin: int = 0  # where its text begins and ends in the file
    end: int = 0
    is_point_data: bool = True


class _Appended(Exception):  # noqa: N818 - the way out of expat, no error
    """The tag AppendedData was reached: what follows may be raw bytes, which are no XML."""


@dataclass
class _Scan:
    """The tags of a file in their order, and where appended data begin."""

    path: Path
    tags: list[_Tag] = field(default_factory=list)
    appended: tuple[str, int] | None = None
    _open: list[_Tag] = field(default_factory=list)

    def run(self) -> _Scan:
        parser = expat.ParserCreate()
        parser.buffer_text = False
        parser.StartElementHandler = lambda name, attributes: self._start(parser, name, attributes)
        parser.EndElementHandler = lambda _name: self._end(parser)
        parser.CharacterDataHandler = lambda _text: self._text(parser)
        parser.StartDoctypeDeclHandler = lambda *_: self._refuse_doctype()
        try:
            with self.path.open("rb") as file:
                while chunk := file.read(_CHUNK):
                    parser.Parse(chunk, False)
                parser.Parse(b"", True)
        except _Appended:
            pass
        except VolumeFileError:
            raise
        except (expat.ExpatError, ValueError, LookupError) as error:  # the others: encodings that expat does not know
            raise fail(self.path, f"this is not a VTI file, or damaged XML ({shown(error)}).") from error
        return self

    def _refuse_doctype(self) -> None:
        raise fail(self.path, "its XML has a document type, which VTI files never have; it is not read.")

    def _start(self, parser: Any, name: str, attributes: dict[str, str]) -> None:
        if len(self.tags) >= _MOST_TAGS or len(self._open) > 20:
            raise fail(self.path, f"its XML has more than {_MOST_TAGS} tags or deep nesting; it is no image.")
        tag = _Tag(name, attributes, self._open[-1].name if self._open else "", begin=-1)
        self.tags.append(tag)
        if name == "AppendedData":
            self.appended = attributes.get("encoding", ""), parser.CurrentByteIndex
            raise _Appended
        self._open.append(tag)

    def _text(self, parser: Any) -> None:
        if self._open and self._open[-1].begin < 0:
            self._open[-1].begin = parser.CurrentByteIndex

    def _end(self, parser: Any) -> None:
        tag = self._open.pop()
        tag.end = parser.CurrentByteIndex
        if tag.begin < 0:
            tag.begin = tag.end

    def first(self, name: str) -> _Tag | None:
        return next((tag for tag in self.tags if tag.name == name), None)


def _scan(path: Path) -> tuple[_Scan, _Tag, _Tag]:
    scan = _Scan(path).run()
    root, image = scan.first("VTKFile"), scan.first("ImageData")
    if root is None or root is not scan.tags[0] or image is None:
        raise fail(path, "this is not VTK image data (tags VTKFile and ImageData); only regular grids are volumes.")
    return scan, root, image


def read_header(path: Path) -> Header:
    """Geometry, type and place of the voxels of a VTI file."""
    scan, root, image = _scan(path)
    array, notes = _choose(path, scan)
    name = array.attributes.get("type", "")
    if name not in _TYPES:
        raise fail(path, f"the array's type '{shown(name)}' is not supported; save one number per voxel.")
    if integers(path, "NumberOfComponents", array.attributes.get("NumberOfComponents", "1"), 1)[0] != 1:
        raise fail(path, "its array has several components (colours or vectors); save one component.")
    order = {"LittleEndian": "<", "BigEndian": ">"}.get(root.attributes.get("byte_order", "LittleEndian"))
    if order is None:
        raise fail(path, f"the byte_order '{shown(root.attributes['byte_order'])}' is unknown.")
    dtype = np.dtype(order + _TYPES[name])
    extent, geometry = _geometry(path, scan, image)
    cells = array.parent == "CellData"
    sizes = [high - low + (0 if cells and high > low else 1)
             for low, high in zip(extent[::2], extent[1::2], strict=True)]
    shape, more = volume_shape(path, sizes, dtype.itemsize)
    axes = np.asarray(geometry["direction"]) * np.asarray(geometry["spacing"])
    corner = np.array(extent[::2]) + (0.5 if cells else 0.0) * (np.array(sizes) >= 1)
    if np.isfinite(axes).all():
        geometry["origin"] = triple((np.asarray(geometry["origin"]) + axes @ corner).tolist())
    if cells:
        notes += ("the values belong to cells: voxels lie at the cells' centres",)
    voxels = _Voxels(path, order, root.attributes, array.attributes, array, scan.appended,
                     math.prod(shape) * dtype.itemsize)
    voxels.check()
    labels = True if array.attributes.get("Name") == _LABELS else None
    return Header(path, shape, dtype, lambda: stream_blocks(path, voxels.open, shape, dtype), is_labels=labels,
                  notes=notes + more, **geometry)


def _choose(path: Path, scan: _Scan) -> tuple[_Tag, tuple[str, ...]]:
    """The array of voxels: the active scalars of the points, or the only or first array."""
    for parent in ("PointData", "CellData"):
        arrays = [tag for tag in scan.tags if tag.name == "DataArray" and tag.parent == parent]
        if not arrays:
            continue
        owner = scan.first(parent)
        active = owner.attributes.get("Scalars") if owner else None
        chosen = next((tag for tag in arrays if active is not None and tag.attributes.get("Name") == active), arrays[0])
        others = ", ".join(shown(tag.attributes.get("Name", "?"), 30) for tag in arrays[:10] if tag is not chosen)
        taken = shown(chosen.attributes.get("Name", "?"), 30)
        return chosen, (f"of several arrays '{taken}' was taken; the others are: {others}",) if others else ()
    raise fail(path, "it has no array of points or cells, so there are no voxels.")


def _geometry(path: Path, scan: _Scan, image: _Tag) -> tuple[list[int], dict[str, Any]]:
    attributes = image.attributes
    extent = integers(path, "WholeExtent", attributes.get("WholeExtent", ""), 6)
    pieces = [tag for tag in scan.tags if tag.name == "Piece"]
    if len(pieces) != 1 or integers(path, "Extent", pieces[0].attributes.get("Extent", ""), 6) != extent:
        raise fail(path, f"it has {len(pieces)} pieces or a piece smaller than the whole; save it as one piece.")
    direction = floats(path, "Direction", attributes.get("Direction", "1 0 0 0 1 0 0 0 1"), 9)
    rows: Matrix3 = (triple(direction[:3]), triple(direction[3:6]), triple(direction[6:]))
    return extent, {
        "spacing": triple(floats(path, "Spacing", attributes.get("Spacing", "1 1 1"), 3)),
        "origin": triple(floats(path, "Origin", attributes.get("Origin", "0 0 0"), 3)),
        "direction": rows,
    }


@dataclass(frozen=True)
class _Voxels:
    """Where and how the bytes of one array lie in the file."""

    path: Path
    order: str
    root: dict[str, str]
    attributes: dict[str, str]
    tag: _Tag
    appended: tuple[str, int] | None
    expected: int

    def check(self) -> None:
        """Refuse what cannot be read before anything is."""
        form = self.attributes.get("format", "")
        if form not in ("binary", "appended"):
            raise fail(self.path, f"its voxels are written as {shown(form) or 'text'}; save them as binary.")
        if self.root.get("compressor") not in (None, "", "vtkZLibDataCompressor"):
            raise fail(self.path, f"the compressor {shown(self.root['compressor'])} is not supported; save with zlib.")
        if self.root.get("header_type", "UInt32") not in ("UInt32", "UInt64"):
            raise fail(self.path, f"the header_type {shown(self.root['header_type'])} is unknown.")
        if form == "appended" and (self.appended is None or self.appended[0] not in ("raw", "base64")):
            raise fail(self.path, "its voxels should be appended, but there are no appended raw or base64 data.")

    def open(self) -> Stream:
        """The bytes of the voxels, unpacked."""
        file = self.path.open("rb")
        try:
            return Pieces(self._pieces(file), file.close)
        except BaseException:
            file.close()
            raise

    def _pieces(self, file: BinaryIO) -> Iterator[bytes]:
        raw, begin, end = self._place(file)
        file.seek(begin)
        read = _RawSections if raw else _Base64Sections
        number = np.dtype(self.order + ("u8" if self.root.get("header_type") == "UInt64" else "u4"))
        if self.root.get("compressor"):
            yield from self._inflated(read(file, end), number)
        else:
            yield from self._plain(read(file, end), number)

    def _place(self, file: BinaryIO) -> tuple[bool, int, int]:
        if self.attributes["format"] == "binary":
            return False, self.tag.begin, self.tag.end
        assert self.appended is not None
        encoding, start = self.appended
        file.seek(start)
        head = file.read(1024)
        mark = head.find(b"_", head.find(b">") + 1)
        offset = integers(self.path, "offset", self.attributes.get("offset", ""), 1)[0]
        size = self.path.stat().st_size
        if mark < 0 or head[head.find(b">") + 1:mark].strip() or not 0 <= offset <= size:
            raise fail(self.path, f"the appended data do not begin with _ or the offset {offset} is outside the file.")
        return encoding == "raw", start + mark + 1 + offset, size

    def _counts(self, sections: _Sections, number: np.dtype[Any], count: int) -> NDArray[Any]:
        data = sections.read(count * number.itemsize)
        if len(data) < count * number.itemsize:
            raise fail(self.path, "the counts before its voxels are missing: it is cut short.")
        return np.frombuffer(data, number)

    def _wrong(self, size: int) -> Exception:
        return fail(self.path, f"the header asks for {self.expected} bytes of voxels but the array has {size}.")

    def _plain(self, sections: _Sections, number: np.dtype[Any]) -> Iterator[bytes]:
        size = int(self._counts(sections, number, 1)[0])
        if size != self.expected:
            raise self._wrong(size)
        sections.may_end()
        while size:
            data = sections.read(min(size, _BLOCK))
            if not data:
                return
            size -= len(data)
            yield data

    def _inflated(self, sections: _Sections, number: np.dtype[Any]) -> Iterator[bytes]:
        blocks, block, last = (int(n) for n in self._counts(sections, number, 3))
        full = blocks - 1 if last else blocks
        size = full * block + last
        if size != self.expected or not 0 < block < _MOST_BLOCK or last > block:
            raise self._wrong(size)
        # A block has at least a byte, so there are no more counts than voxels have bytes.
        packed = self._counts(sections, number, blocks)
        sections.may_end()
        for index, count in enumerate(packed):
            expected = block if index < full else last
            data = sections.read(int(count)) if count <= 2 * expected + _CHUNK else b""
            decoder = zlib.decompressobj()
            unpacked = decoder.decompress(data, expected + 1)
            if len(unpacked) != expected or not decoder.eof:
                raise fail(self.path, f"block {index} of its voxels should unpack to {expected} bytes: it is cut short "
                                      "or damaged.")
            yield unpacked


class _Sections:
    """Bytes of an array whose parts (counts, voxels) may be encoded one by one."""

    def read(self, size: int) -> bytes:
        """``size`` bytes, fewer at the end."""
        raise NotImplementedError

    def may_end(self) -> None:
        """Here one encoded part may end and the next begin."""


class _RawSections(_Sections):
    """Raw bytes."""

    def __init__(self, file: BinaryIO, _end: int) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        return take(self._file, size)


class _Base64Sections(_Sections):
    """Base64 text, in which white space may lie anywhere; a padding "=" ends a part."""

    def __init__(self, file: BinaryIO, end: int) -> None:
        self._file, self._left = file, end - file.tell()
        self._text, self._bytes = b"", b""
        self._ended = False

    def _fill(self) -> bool:
        """Decode some more of this part; False at its end."""
        if self._ended:
            return False
        if len(self._text) < 4:
            while self._left > 0 and len(self._text) < 4:
                chunk = self._file.read(min(_CHUNK, self._left))
                self._left = self._left - len(chunk) if chunk else 0
                self._text += b"".join(chunk.split())
        if len(self._text) < 4:
            return False
        padding = self._text.find(b"=")
        end = len(self._text) // 4 * 4 if padding < 0 else padding // 4 * 4 + 4
        self._bytes += binascii.a2b_base64(self._text[:end])
        self._text = self._text[end:]
        self._ended = padding >= 0
        return True

    def read(self, size: int) -> bytes:
        parts: list[bytes] = []
        while size > 0 and (self._bytes or self._fill()):
            parts.append(self._bytes[:size])
            self._bytes = self._bytes[size:]
            size -= len(parts[-1])
        return b"".join(parts)

    def may_end(self) -> None:
        # The counts fill whole groups of four characters without "=" when their bytes are a multiple of three.
        if self._ended and not self._bytes:
            self._ended = False


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress) -> None:
    """Write VTI: appended raw zlib blocks of one MiB; bool becomes uint8, labels are called "labels"."""
    dtype = stored_dtype(volume)
    size = volume.grid.size * dtype.itemsize
    blocks = -(-size // _BLOCK)
    with atomic_write(path, overwrite=overwrite, needed=needed_bytes(volume, "zlib")) as file:
        file.write(_xml(volume, dtype.str[1:]))
        begin = file.tell()
        file.write(bytes(8 * (3 + blocks)))  # the packed sizes, known at the end
        counts = [file.write(zlib.compress(block, LEVEL)) for block in _blocks(volume, dtype, progress)]
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
        file.seek(begin)
        file.write(np.array([blocks, _BLOCK, size % _BLOCK, *counts], dtype="<u8").tobytes())


def _blocks(volume: Volume, dtype: np.dtype[Any], progress: Progress) -> Iterator[bytes]:
    waiting = b""
    for piece in slabs_of_bytes(volume.values, dtype, progress):
        data = waiting + bytes(piece)
        whole = len(data) // _BLOCK * _BLOCK
        for start in range(0, whole, _BLOCK):
            yield data[start:start + _BLOCK]
        waiting = data[whole:]
    if waiting:
        yield waiting


def _xml(volume: Volume, dtype: str) -> bytes:
    def words(values: Any) -> str:
        return " ".join(map(repr, values))

    grid = volume.grid
    name = "".join(c for c in volume.name if c.isprintable())
    name = _LABELS if volume.is_labels else name if name not in ("", _LABELS) else "values"
    nz, ny, nx = grid.shape
    extent = f"0 {nx - 1} 0 {ny - 1} 0 {nz - 1}"
    direction = words(np.ravel(grid.direction).tolist())
    places = f'Origin="{words(grid.origin)}" Spacing="{words(grid.spacing)}" Direction="{direction}"'
    kind = 'byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor"'
    return f"""<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" {kind}>
  <ImageData WholeExtent="{extent}" {places}>
    <Piece Extent="{extent}">
      <PointData Scalars={quoteattr(name)}>
        <DataArray type="{_NAMES[dtype]}" Name={quoteattr(name)} format="appended" offset="0"/>
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _""".encode()


