"""VTK XML files: their tags and the numbers of their arrays, for images (.vti) and surfaces (.vtp).

VTK's own readers end the whole process or hang on damaged files, so the XML is read here: only its tags, one at a time,
without entities or document types, and numbers only at the places that the tags name and as many as are requested.
Source: the VTK XML file formats, chapter "VTK File Formats" of the VTK user's guide.
"""

from __future__ import annotations

import binascii
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import MissingPackageError, VolumeFileError
from deformnb.io.files.codecs import unpack_bytes
from deformnb.io.files.errors import fail, printable
from deformnb.io.files.streams import Pieces, Stream, from_text, take
from deformnb.io.files.texts import integers

TYPES = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}
"""NumPy's codes of the types of arrays."""

# Real files have some twenty tags; time series with many arrays a few hundred.
_MOST_TAGS = 10_000
_DEEPEST = 20
_CHUNK = 2**16
_READ = 2**20
_MOST_BLOCK = 2**31


@dataclass
class Tag:
    """One tag; its text is from ``begin`` to ``end`` in the file, up to its first child."""

    name: str
    attributes: dict[str, str]
    parent: Tag | None
    begin: int = -1
    end: int = -1

    def is_inside(self, name: str) -> bool:
        """Check the name of the tag around it."""
        return self.parent is not None and self.parent.name == name


class _Appended(Exception):  # noqa: N818 - the way out of expat, no error
    """The tag AppendedData was reached: the rest may be raw bytes, which are no XML."""


@dataclass
class VtkXml:
    """The tags of a file in their order, and where appended data begin.

    Parameters
    ----------
    path : the file.
    kind : the tag of its data set, such as "ImageData".
    """

    path: Path
    kind: str
    tags: list[Tag] = field(default_factory=list)
    appended: tuple[str, int] | None = None
    _open: list[Tag] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._scan()
        if not self.tags or self.tags[0].name != "VTKFile" or self.first(self.kind) is None:
            raise fail(self.path, f"this is no {self._label} file (tags VTKFile and {self.kind}).")
        if self.root.get("type") != self.kind:
            raise fail(self.path, f"its type is '{printable(self.root.get('type'))}', and its data are {self.kind}.")
        order = {"LittleEndian": "<", "BigEndian": ">"}.get(self.root.get("byte_order", "LittleEndian"))
        if order is None:
            raise fail(self.path, f"the byte_order '{printable(self.root['byte_order'])}' is unknown.")
        self.order = order

    @property
    def root(self) -> dict[str, str]:
        """The attributes of the first tag."""
        return self.tags[0].attributes

    @property
    def _label(self) -> str:
        return self.path.suffix[1:].upper()

    def _scan(self) -> None:
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
            raise fail(self.path, f"this is no {self._label} file, or damaged XML ({printable(error)}).") from error

    def _refuse_doctype(self) -> None:
        raise fail(self.path, f"its XML has a document type, which {self._label} files never have; it is not read.")

    def _start(self, parser: Any, name: str, attributes: dict[str, str]) -> None:
        if len(self.tags) >= _MOST_TAGS or len(self._open) > _DEEPEST:
            raise fail(
                self.path, f"its XML has more than {_MOST_TAGS} tags or deep nesting; it is no {self._label} file."
            )
        around = self._open[-1] if self._open else None
        if around is not None and around.begin >= 0 and around.end < 0:
            around.end = parser.CurrentByteIndex
        self.tags.append(Tag(name, attributes, around))
        if name == "AppendedData":
            self.appended = attributes.get("encoding", ""), parser.CurrentByteIndex
            raise _Appended
        self._open.append(self.tags[-1])

    def _text(self, parser: Any) -> None:
        if self._open and self._open[-1].begin < 0:
            self._open[-1].begin = parser.CurrentByteIndex

    def _end(self, parser: Any) -> None:
        tag = self._open.pop()
        if tag.end < 0:
            tag.end = parser.CurrentByteIndex
        if tag.begin < 0:
            tag.begin = tag.end

    def first(self, name: str) -> Tag | None:
        """The first tag of a name."""
        return next((tag for tag in self.tags if tag.name == name), None)

    def dtype(self, tag: Tag) -> np.dtype[Any]:
        """The type of an array's numbers as stored."""
        name = tag.attributes.get("type", "")
        if name not in TYPES:
            raise fail(self.path, f"the array's type '{printable(name)}' is not supported; save plain numbers.")
        return np.dtype(self.order + TYPES[name])

    def locate_array(self, tag: Tag, count: int) -> StoredArray:
        """Locate ``count`` numbers of an array in the file; refuses an array that cannot be read."""
        return StoredArray(self, tag, self.dtype(tag), count)


@dataclass(frozen=True)
class StoredArray:
    """Place and encoding of an array's numbers in a file: as text, inline or appended, compressed or plain."""

    file: VtkXml
    tag: Tag
    dtype: np.dtype[Any]
    count: int

    def __post_init__(self) -> None:
        path, root, form = self.file.path, self.file.root, self.tag.attributes.get("format", "")
        if form not in ("ascii", "binary", "appended"):
            raise fail(path, f"an array has the unknown format '{printable(form)}'; save it as binary.")
        if root.get("compressor", "") not in ("", *_CODECS):
            raise fail(path, f"the compressor {printable(root['compressor'])} is not supported; save with zlib.")
        if root.get("header_type", "UInt32") not in ("UInt32", "UInt64"):
            raise fail(path, f"the header_type {printable(root['header_type'])} is unknown.")
        appended = self.file.appended
        if form == "appended" and (appended is None or appended[0] not in ("raw", "base64")):
            raise fail(path, "its numbers should be appended, but there are no appended raw or base64 data.")

    @property
    def size(self) -> int:
        """Bytes of the numbers."""
        return self.count * self.dtype.itemsize

    def values(self) -> NDArray[Any]:
        """All numbers; exactly ``count`` of them."""
        stream = self.open()
        try:
            data = take(stream, self.size)
            if len(data) < self.size or stream.read(1):
                raise self._wrong("fewer" if len(data) < self.size else "more")
        finally:
            stream.close()
        return np.frombuffer(data, self.dtype)

    def open(self) -> Stream:
        """The bytes of the numbers, unpacked."""
        file = self.file.path.open("rb")
        try:
            return Pieces(self._pieces(file), file.close)
        except BaseException:
            file.close()
            raise

    def _wrong(self, present: int | str) -> Exception:
        return fail(
            self.file.path,
            f"the header needs {self.size} bytes of numbers but the array has {present}: it is cut short or damaged.",
        )

    def _pieces(self, file: BinaryIO) -> Iterator[bytes]:
        if self.tag.attributes["format"] == "ascii":
            yield from self._from_text(file)
            return
        raw, begin, end = self._place(file)
        file.seek(begin)
        sections = _RawSections(file, end) if raw else _Base64Sections(file, end)
        number = np.dtype(self.file.order + ("u8" if self.file.root.get("header_type") == "UInt64" else "u4"))
        if self.file.root.get("compressor"):
            yield from self._unpack(sections, number)
        else:
            yield from self._plain(sections, number)

    def _place(self, file: BinaryIO) -> tuple[bool, int, int]:
        if self.tag.attributes["format"] == "binary":
            return False, self.tag.begin, self.tag.end
        assert self.file.appended is not None
        encoding, start = self.file.appended
        file.seek(start)
        head = file.read(1024)
        mark = head.find(b"_", head.find(b">") + 1)
        offset = integers(self.file.path, "offset", self.tag.attributes.get("offset", ""), 1)[0]
        size = self.file.path.stat().st_size
        if mark < 0 or head[head.find(b">") + 1 : mark].strip() or not 0 <= offset <= size:
            raise fail(
                self.file.path, f"the appended data do not begin with _ or the offset {offset} is outside the file."
            )
        return encoding == "raw", start + mark + 1 + offset, size

    def _from_text(self, file: BinaryIO) -> Iterator[bytes]:
        def chunks() -> Iterator[bytes]:
            file.seek(self.tag.begin)
            left = self.tag.end - self.tag.begin
            while left > 0 and (chunk := file.read(min(_CHUNK, left))):
                left -= len(chunk)
                yield chunk

        try:
            yield from from_text(chunks(), self.dtype)
        except ValueError:
            raise fail(self.file.path, f"an array of numbers of type {self.dtype.name} holds something else.") from None

    def _counts(self, sections: _Sections, number: np.dtype[Any], count: int) -> NDArray[Any]:
        data = sections.read(count * number.itemsize)
        if len(data) < count * number.itemsize:
            raise fail(self.file.path, "the counts before its numbers are missing: it is cut short.")
        return np.frombuffer(data, number)

    def _plain(self, sections: _Sections, number: np.dtype[Any]) -> Iterator[bytes]:
        size = int(self._counts(sections, number, 1)[0])
        if size != self.size:
            raise self._wrong(size)
        sections.may_end()
        while size:
            data = sections.read(min(size, _READ))
            if not data:
                return
            size -= len(data)
            yield data

    def _unpack(self, sections: _Sections, number: np.dtype[Any]) -> Iterator[bytes]:
        blocks, block, last = (int(n) for n in self._counts(sections, number, 3))
        full = blocks - 1 if last else blocks
        size = full * block + last
        if size != self.size or not 0 < block < _MOST_BLOCK or last > block:
            raise self._wrong(size)
        # A block has at least a byte, so there are no more counts than there are bytes of numbers.
        packed = self._counts(sections, number, blocks)
        sections.may_end()
        codec = _CODECS[self.file.root["compressor"]]
        for index, count in enumerate(packed):
            expected = block if index < full else last
            data = sections.read(int(count)) if count <= 2 * expected + _CHUNK else b""
            try:
                yield unpack_bytes(codec, data, expected)
            except MissingPackageError:
                raise
            except ValueError as error:
                raise fail(
                    self.file.path,
                    f"block {index} of an array should unpack to {expected} bytes: it is cut short or damaged.",
                ) from error


_CODECS = {"vtkZLibDataCompressor": "deflate", "vtkLZMADataCompressor": "lzma", "vtkLZ4DataCompressor": "lz4"}


class _Sections:
    """Bytes of an array whose parts (counts, numbers) may be encoded one by one."""

    def read(self, size: int) -> bytes:
        """``size`` bytes, fewer at the end."""
        raise NotImplementedError

    def may_end(self) -> None:
        """Allow one encoded part to end here and the next to begin."""


class _RawSections(_Sections):
    """Raw bytes."""

    def __init__(self, file: BinaryIO, _end: int) -> None:
        self._file = file

    def read(self, size: int) -> bytes:
        return take(self._file, size)


class _Base64Sections(_Sections):
    """Base64 text, in which white space may be anywhere; a padding "=" ends a part."""

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
                text, tag, _ = chunk.partition(b"<")  # appended data end with a tag, and with no "=" where they fit
                self._left = 0 if tag else self._left
                self._text += b"".join(text.split())
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
