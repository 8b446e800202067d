"""PLY in any of its three encodings; written as binary, little-endian."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.io.files.errors import fail, printable
from deformnb.io.meshes.polygons import CUT_SHORT, Polygons, whole_numbers
from deformnb.warping.mesh import Mesh

_LONGEST_HEADER = 1 << 16
_MOST_ELEMENTS = 64

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Property:
    name: str
    dtype: str
    count: str = ""  # of a list: the type of its length


@dataclass
class _Element:
    name: str
    size: int
    properties: list[_Property]


def read_ply(path: Path) -> Polygons:
    """A PLY file of any of its three encodings; properties other than places and corners are skipped."""
    data = path.read_bytes()
    order, elements, start = _header(path, data)
    source = _Text(path, data[start:]) if not order else _Binary(path, data, start, order)
    points: NDArray[np.float64] | None = None
    faces: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    for element in elements:
        lists = [p for p in element.properties if p.count]
        if element.name == "vertex" and not lists:
            points = _points(path, element, source.rows(element))
        elif element.name == "face":
            corners = next((p for p in lists if p.name in ("vertex_indices", "vertex_index")), None)
            if corners is None:
                raise fail(path, "its faces have no list vertex_indices, so they are no polygons.")
            faces = source.lists(element, corners)
        elif lists:
            source.lists(element, lists[0])
        else:
            source.rows(element)
    if points is None or faces is None:
        raise fail(path, "its header has no element vertex or no element face; only meshes with faces are surfaces.")
    return points, *faces


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    end = re.search(rb"(?m)^end_header[ \t]*\r?\n", data[:_LONGEST_HEADER])
    if not re.match(rb"ply[ \t]*\r?\n", data) or end is None:
        raise fail(path, "this is no PLY file: it does not begin with the lines from ply to end_header.")
    order, elements = None, list[_Element]()
    for line in data[: end.start()].decode("ascii", "replace").splitlines()[1:]:
        words = line.split()
        match words:
            case ["format", kind, _] if kind in _FORMATS:
                order = _FORMATS[kind]
            case ["element", name, size] if re.fullmatch("[0-9]{1,12}", size) and len(elements) < _MOST_ELEMENTS:
                elements.append(_Element(name, int(size), []))
            case ["property", "list", count, kind, name] if (
                elements and _TYPES.get(count, "f")[0] in "iu" and (kind in _TYPES)
            ):
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise fail(path, f"the line '{printable(line, 60)}' of its header is not understood.")
    if order is None:
        raise fail(path, "its header has no line format of a kind that is known.")
    _check_sizes(path, elements, len(data) - end.end())
    return order, elements, end.end()


def _check_sizes(path: Path, elements: list[_Element], size: int) -> None:
    for element in elements:
        names = [p.name for p in element.properties]
        if not names or len(set(names)) != len(names) or len(names) > _MOST_ELEMENTS:
            raise fail(
                path, f"the element {printable(element.name, 30)} has no properties, too many or two of one name."
            )
        if element.size > size:  # each takes a byte at least
            raise fail(
                path,
                f"its header declares {element.size} times {printable(element.name, 30)}, more than the file "
                f"has room for: {CUT_SHORT}.",
            )


def _points(path: Path, element: _Element, rows: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    if not {"x", "y", "z"} <= rows.keys():
        raise fail(path, "its vertices have no x, y and z.")
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


class _Binary:
    """The elements of a binary file, one after the other."""

    def __init__(self, path: Path, data: bytes, start: int, order: str) -> None:
        self._path, self._data, self._at, self._order = path, data, start, order

    def _take(self, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
        end = self._at + dtype.itemsize * count
        if end > len(self._data):
            raise fail(self._path, f"its header declares more than the file holds: {CUT_SHORT}.")
        found = np.frombuffer(self._data, dtype, count, self._at)
        self._at = end
        return found

    def rows(self, element: _Element) -> dict[str, NDArray[Any]]:
        """Columns by name of an element without lists."""
        dtype = np.dtype([(p.name, self._order + p.dtype) for p in element.properties])
        table = self._take(dtype, element.size)
        return {name: table[name] for name in dtype.names or ()}

    def lists(self, element: _Element, chosen: _Property) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The lengths and the joined values of one list of an element."""
        begin = self._at
        if len(element.properties) == 1 and element.size:  # mostly all are triangles, and read in one call
            count = int(self._take(np.dtype(self._order + chosen.count), 1)[0])
            values = ("values", self._order + chosen.dtype, (max(count, 0),))
            row = np.dtype([("n", self._order + chosen.count), values])
            self._at = begin
            if begin + row.itemsize * element.size <= len(self._data):
                table = self._take(row, element.size)
                if (table["n"] == count).all():
                    return table["n"].astype(np.int64), table["values"].reshape(-1).astype(np.int64)
        self._at = begin
        return self._one_by_one(element, chosen)

    def _one_by_one(self, element: _Element, chosen: _Property) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        counts, values = [], []
        kinds = [
            (p is chosen, np.dtype(self._order + p.count) if p.count else None, np.dtype(self._order + p.dtype))
            for p in element.properties
        ]
        for _ in range(element.size):
            for is_wanted, count, dtype in kinds:
                number = 1 if count is None else max(int(self._take(count, 1)[0]), 0)
                part = self._take(dtype, number)
                if is_wanted:
                    counts.append(number)
                    values.append(part)
        joined = np.concatenate(values) if values else np.zeros(0)
        return np.array(counts, dtype=np.int64), joined.astype(np.int64)


class _Text:
    """The elements of a text file, one after the other."""

    def __init__(self, path: Path, data: bytes) -> None:
        self._path = path
        try:
            self._numbers = np.array(data.split(), dtype=np.float64)
        except ValueError as error:
            raise fail(
                path, f"there is something else than numbers after its header ({printable(error, 60)})."
            ) from error
        self._at = 0

    def _take(self, count: int) -> NDArray[np.float64]:
        found = self._numbers[self._at : self._at + count]
        if len(found) < count:
            raise fail(self._path, f"its header declares more than the file holds: {CUT_SHORT}.")
        self._at += count
        return found

    def rows(self, element: _Element) -> dict[str, NDArray[Any]]:
        """Columns by name of an element without lists."""
        names = [p.name for p in element.properties]
        table = self._take(element.size * len(names)).reshape(element.size, len(names))
        return dict(zip(names, table.T, strict=True))

    def lists(self, element: _Element, chosen: _Property) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The lengths and the joined values of one list of an element."""
        counts, values = [], []
        for _ in range(element.size):
            for kind in element.properties:
                number = int(whole_numbers(self._path, self._take(1))[0]) if kind.count else 1
                part = self._take(max(number, 0))
                if kind is chosen:
                    counts.append(len(part))
                    values.append(part)
        joined = np.concatenate(values) if values else np.zeros(0)
        return np.array(counts, dtype=np.int64), whole_numbers(self._path, joined)


def write_ply(mesh: Mesh, file: BinaryIO) -> None:
    """A mesh as binary PLY with corners of double precision."""
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(mesh.points)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(mesh.faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]
    file.write("\n".join(header).encode("ascii"))
    file.write(np.ascontiguousarray(mesh.points, dtype="<f8").tobytes())
    rows = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, mesh.faces
    file.write(rows.tobytes())
