"""Surface files: PLY, STL, OBJ and VTP.

None of the formats states the directions of its axes. Coordinates are taken as they are: LPS, as volumes have.

The parsers are short ones with bounds on everything, because VTK's end the process on damaged files. Each returns
corners (N, 3) and polygons: for each face its number of corners, then all corners' numbers in one array.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import Damage, as_path, fail, human_bytes, integers, regular_file, shown
from deformnb.io.memory import default_limit
from deformnb.io.vtk_xml import StoredArray, Tag, VtkXml
from deformnb.warping.mesh import Mesh, MeshLike, as_mesh

Polygons = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]
"""Corners (N, 3), how many corners each face has, and their numbers one face after the other."""

_LONGEST_HEADER = 1 << 16
_MOST_ELEMENTS = 64
_CUT = "it is cut short or damaged"

# ---- PLY -------------------------------------------------------------------------------------------------------------

_PLY_TYPES = {
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
_PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


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
    order, elements, start = _ply_header(path, data)
    source = _Text(path, data[start:]) if not order else _Binary(path, data, start, order)
    points: NDArray[np.float64] | None = None
    faces: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    for element in elements:
        lists = [p for p in element.properties if p.count]
        if element.name == "vertex" and not lists:
            points = _ply_points(path, element, source.rows(element))
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


def _ply_header(path: Path, data: bytes) -> tuple[str, list[_Element], int]:
    end = re.search(rb"(?m)^end_header[ \t]*\r?\n", data[:_LONGEST_HEADER])
    if not re.match(rb"ply[ \t]*\r?\n", data) or end is None:
        raise fail(path, "this is no PLY file: it does not begin with the lines from ply to end_header.")
    order, elements = None, list[_Element]()
    for line in data[: end.start()].decode("ascii", "replace").splitlines()[1:]:
        words = line.split()
        match words:
            case ["format", kind, _] if kind in _PLY_FORMATS:
                order = _PLY_FORMATS[kind]
            case ["element", name, size] if re.fullmatch("[0-9]{1,12}", size) and len(elements) < _MOST_ELEMENTS:
                elements.append(_Element(name, int(size), []))
            case ["property", "list", count, kind, name] if (
                elements and _PLY_TYPES.get(count, "f")[0] in "iu" and (kind in _PLY_TYPES)
            ):
                elements[-1].properties.append(_Property(name, _PLY_TYPES[kind], _PLY_TYPES[count]))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1].properties.append(_Property(name, _PLY_TYPES[kind]))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise fail(path, f"the line '{shown(line, 60)}' of its header is not understood.")
    if order is None:
        raise fail(path, "its header has no line format of a kind that is known.")
    _check_sizes(path, elements, len(data) - end.end())
    return order, elements, end.end()


def _check_sizes(path: Path, elements: list[_Element], size: int) -> None:
    for element in elements:
        names = [p.name for p in element.properties]
        if not names or len(set(names)) != len(names) or len(names) > _MOST_ELEMENTS:
            raise fail(path, f"the element {shown(element.name, 30)} has no properties, too many or two of one name.")
        if element.size > size:  # each takes a byte at least
            raise fail(
                path,
                f"its header promises {element.size} times {shown(element.name, 30)}, more than the file "
                f"has room for: {_CUT}.",
            )


def _ply_points(path: Path, element: _Element, rows: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
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
            raise fail(self._path, f"its header promises more than the file holds: {_CUT}.")
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
        if len(element.properties) == 1 and element.size:  # mostly all are triangles, and read at once
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
            raise fail(path, f"there is something else than numbers after its header ({shown(error, 60)}).") from error
        self._at = 0

    def _take(self, count: int) -> NDArray[np.float64]:
        found = self._numbers[self._at : self._at + count]
        if len(found) < count:
            raise fail(self._path, f"its header promises more than the file holds: {_CUT}.")
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
                number = int(_whole(self._path, self._take(1))[0]) if kind.count else 1
                part = self._take(max(number, 0))
                if kind is chosen:
                    counts.append(len(part))
                    values.append(part)
        joined = np.concatenate(values) if values else np.zeros(0)
        return np.array(counts, dtype=np.int64), _whole(self._path, joined)


def _whole(path: Path, numbers: NDArray[Any]) -> NDArray[np.int64]:
    if numbers.dtype.kind in "iu" and numbers.dtype.itemsize < 8:
        return numbers.astype(np.int64)
    if not (np.abs(numbers.astype(np.float64)) < 2**53).all() or (numbers != np.floor(numbers)).any():
        raise fail(path, f"the number of a corner is not a whole number: {_CUT}.")
    return numbers.astype(np.int64)


# ---- STL -------------------------------------------------------------------------------------------------------------

_STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_STL_HEADER = 84


def read_stl(path: Path) -> Polygons:
    """An STL file, binary or text; corners at exactly the same place become one, as STL has no other connectivity."""
    data = path.read_bytes()
    triangles = int.from_bytes(data[80:_STL_HEADER], "little")
    if len(data) >= _STL_HEADER and len(data) == _STL_HEADER + _STL_ROW.itemsize * triangles:
        corners = np.frombuffer(data, _STL_ROW, triangles, _STL_HEADER)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip().startswith(b"solid") and b"\0" not in data:
        corners = _stl_text(path, data)
    else:
        raise fail(path, "this is no STL file, or it is cut short: its size does not fit the number of its triangles.")
    if not np.isfinite(corners).all():
        raise fail(path, "a corner is not a finite number; repair the mesh.")
    points, number = np.unique(corners, axis=0, return_inverse=True)
    return points, np.full(len(corners) // 3, 3), number.reshape(-1).astype(np.int64)


def _stl_text(path: Path, data: bytes) -> NDArray[np.float64]:
    words = data.split()
    if words.count(b"endsolid") != words.count(b"solid") or words.count(b"facet") != words.count(b"endfacet"):
        raise fail(path, f"a solid or a facet of its text does not end: {_CUT}.")
    found = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    if len(found) % 3 or len(found) != 3 * words.count(b"endfacet"):
        raise fail(path, f"a facet of its text has not three vertices: {_CUT}.")
    try:
        return np.array(found, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise fail(path, f"a vertex of its text is no number ({shown(error, 60)}).") from error


# ---- OBJ -------------------------------------------------------------------------------------------------------------


def read_obj(path: Path) -> Polygons:
    """The lines v and f of an OBJ file: places and polygons. Corners are counted from 1, negative ones backwards."""
    points: list[list[bytes]] = []
    counts, corners = [], list[int]()
    promised = None
    for line in _obj_lines(path):
        if promised is None and (comment := re.match(rb"# deformnb: ([0-9]{1,12}) corners, ([0-9]{1,12}) faces", line)):
            promised = (int(comment[1]), int(comment[2]))
        kind, *words = line.split(b"#", 1)[0].split() or [b""]
        if kind == b"v":
            points.append(words[:3])
        elif kind == b"f":
            counts.append(len(words))
            for word in words:
                number = word.split(b"/", 1)[0]
                if re.fullmatch(rb"-?[1-9][0-9]{0,17}", number) is None:
                    raise fail(path, f"the corner '{shown(word.decode('ascii', 'replace'), 30)}' of a face is none.")
                corners.append(int(number) - 1 if int(number) > 0 else len(points) + int(number))
    if promised not in (None, (len(points), len(counts))):  # files of other programs do not mark their end
        raise fail(path, f"its first line promises other numbers of corners and faces than it has: {_CUT}.")
    try:
        places = np.array(points, dtype=np.float64).reshape(len(points), 3)
    except ValueError as error:
        raise fail(path, f"a line v does not hold three numbers: {_CUT}.") from error
    return places, np.array(counts, dtype=np.int64), np.array(corners, dtype=np.int64)


def _obj_lines(path: Path) -> Iterator[bytes]:
    """Lines; a backslash at the end goes on with the next one."""
    data = path.read_bytes()
    if b"\0" in data:
        raise fail(path, "this is no OBJ file: it is not text.")
    yield from data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()


# ---- VTP -------------------------------------------------------------------------------------------------------------


def read_vtp(path: Path) -> Polygons:
    """The polygons of all pieces of a VTP file; strips become triangles, vertices and lines are left out."""
    file = VtkXml(path, "PolyData")
    pieces = [tag for tag in file.tags if tag.name == "Piece"]
    if not pieces:
        raise fail(path, f"it has no piece of a surface: {_CUT}.")
    points, counts, corners, first = [], list[NDArray[np.int64]](), list[NDArray[np.int64]](), 0
    for piece in pieces:
        points.append(_vtp_points(file, piece))
        cells = [_vtp_cells(file, piece, "Polys"), _triangles(*_vtp_cells(file, piece, "Strips"))]
        for sizes, numbers in cells:
            if len(numbers) and not (numbers.min() >= 0 and numbers.max() < len(points[-1])):
                raise fail(path, f"a face has a corner that is not among the {len(points[-1])} of its piece.")
            counts.append(sizes)
            corners.append(numbers + first)
        first += len(points[-1])
    return np.concatenate(points), np.concatenate(counts), np.concatenate(corners)


def _vtp_points(file: VtkXml, piece: Tag) -> NDArray[np.float64]:
    count = _vtp_count(file, piece, "NumberOfPoints")
    array = next(
        (
            tag
            for tag in file.tags
            if tag.name == "DataArray" and tag.within("Points") and tag.parent and tag.parent.parent is piece
        ),
        None,
    )
    if not count:
        return np.zeros((0, 3))
    if array is None or array.attributes.get("NumberOfComponents") != "3":
        raise fail(file.path, f"a piece has no places of three numbers for its {count} corners: {_CUT}.")
    return _within_memory(file.stored(array, 3 * count)).values().astype(np.float64).reshape(-1, 3)


def _vtp_cells(file: VtkXml, piece: Tag, kind: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of corners of each cell of a kind, and their indices."""
    count = _vtp_count(file, piece, f"NumberOf{kind}")
    if not count:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    arrays = {
        tag.attributes.get("Name"): tag
        for tag in file.tags
        if tag.name == "DataArray" and tag.within(kind) and tag.parent and tag.parent.parent is piece
    }
    if not {"offsets", "connectivity"} <= arrays.keys():
        raise fail(file.path, f"it promises {count} {kind.lower()} without their offsets and connectivity: {_CUT}.")
    ends = _whole(file.path, _within_memory(file.stored(arrays["offsets"], count)).values())
    sizes = np.diff(ends, prepend=0)
    if (sizes < 0).any():
        raise fail(file.path, f"the offsets of its {kind.lower()} do not grow: {_CUT}.")
    numbers = _within_memory(file.stored(arrays["connectivity"], int(ends[-1]))).values()
    return sizes, _whole(file.path, numbers)


def _vtp_count(file: VtkXml, piece: Tag, name: str) -> int:
    count = integers(file.path, name, piece.attributes.get(name, "0"), 1)[0]
    if count < 0:
        raise fail(file.path, f"its {name} is {count}: {_CUT}.")
    return count


def _within_memory(array: StoredArray) -> StoredArray:
    limit = default_limit()
    if 4 * array.size > limit:  # its bytes in parts and joined, then its numbers as they are used
        raise fail(
            array.file.path,
            f"its header promises an array of {human_bytes(array.size)}, for which there is "
            f"not enough memory ({human_bytes(limit)} may be used), or {_CUT}.",
        )
    return array


def _triangles(sizes: NDArray[np.int64], numbers: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The triangles of strips; every other one is turned round, so that all face the same way."""
    starts = np.cumsum(sizes) - sizes
    each = np.maximum(sizes - 2, 0)
    place = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    first = np.repeat(starts, each) + place
    odd = place % 2
    faces = np.stack([numbers[first], numbers[first + 1 + odd], numbers[first + 2 - odd]], axis=1)
    return np.full(len(faces), 3), faces.reshape(-1)


# The tables of a mesh while it is read are about so many times the size of the file.
_MEMORY_PER_BYTE = 6

# VTK's time to cut a polygon into triangles grows with the square of its corners: 16 000 take it a second, so a damaged
# count of a million an hour.
_MOST_CORNERS = 16_384


@dataclass(frozen=True)
class MeshFormat:
    """One kind of surface file.

    Parameters
    ----------
    suffixes : endings of file names, lower case.
    read : corners and polygons of a file; raises VolumeFileError if it is damaged.
    write : writes the bytes of a mesh.
    description : for people.
    """

    suffixes: tuple[str, ...]
    read: Callable[[Path], Polygons]
    write: Callable[[Mesh, BinaryIO], None]
    description: str


def is_mesh(path: str | os.PathLike[str]) -> bool:
    """True if the end of a name is that of a surface file.

    Examples
    --------
    >>> is_mesh("horse.PLY"), is_mesh("carp.nii.gz")
    (True, False)
    """
    return _row(Path(path)) is not None


def read_mesh(path: str | os.PathLike[str], *, name: str | None = None, unit: str = "mm") -> Mesh:
    """Read a surface; polygons become triangles, colours and textures are left out.

    Parameters
    ----------
    path : a file of one of :data:`MESH_FORMATS`.
    name : of the mesh; by default the file's name without its suffix.
    unit : of its lengths, which none of these files states: by default millimetres, as :func:`write_mesh` writes them
        and 3D Slicer means them.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged, cut short, no surface, or too large.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "triangle.ply"
    >>> write_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), file)
    >>> read_mesh(file).faces.tolist()
    [[0, 1, 2]]
    """
    place = regular_file(as_path(path))
    row = _row(place)
    if row is None:
        raise fail(place, f"its suffix belongs to no kind of surface file; known are {mesh_suffixes()}.")
    size, limit = place.stat().st_size, default_limit()
    if size * _MEMORY_PER_BYTE > limit:
        raise fail(
            place,
            f"reading it takes about {human_bytes(size * _MEMORY_PER_BYTE)} of memory and "
            f"{human_bytes(limit)} may be used; thin the mesh out first.",
        )
    with Damage(place, "thin the mesh out first"):
        mesh = _mesh(*row.read(place), place.stem if name is None else name)
    if not len(mesh.faces):
        raise fail(place, f"there are no faces in it: it is no {row.description} of a surface, or it is damaged.")
    return replace(mesh, unit=unit)


def describe_mesh(path: str | os.PathLike[str]) -> dict[str, str]:
    """Describe a surface file for people."""
    mesh, place = read_mesh(path), Path(path)
    low, high = (", ".join(f"{c:.6g}" for c in end) for end in mesh.box)
    row = _row(place)
    assert row is not None
    return {
        "file": shown(place.name),
        "kind": row.description,
        "corners": str(len(mesh.points)),
        "faces": str(len(mesh.faces)),
        "from": low,
        "to": high,
        "closed": "yes" if mesh.is_closed else "no, so it has no inside",
    }


def write_mesh(mesh: MeshLike, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write a surface; the suffix chooses the format. The file is complete at once or untouched.

    PLY, OBJ and VTP keep all digits of the corners; STL rounds them to seven and writes each corner with each face.
    None of them states a unit: where that of the mesh is known its lengths are written in millimetres.

    Raises
    ------
    VolumeFileError
        If the folder is missing or read-only, the disk is full, or the suffix is unknown.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "corner.ply"
    >>> write_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), file)
    >>> read_mesh(file).faces.tolist()
    [[0, 1, 2]]
    """
    place, mesh = as_path(path), as_mesh(mesh)
    row = check_mesh_target(place)
    with atomic_write(place, overwrite=overwrite) as file:
        row.write(mesh.in_unit("mm"), file)


def check_mesh_target(path: Path) -> MeshFormat:
    """The format that a path to write to selects; VolumeFileError if there is none of its suffix."""
    row = _row(path)
    if row is None:
        raise fail(path, f"its suffix belongs to no kind of surface file; write {mesh_suffixes()}.")
    return row


def mesh_suffixes() -> str:
    """The suffixes of surfaces, for messages."""
    return ", ".join(suffix for row in MESH_FORMATS.values() for suffix in row.suffixes)


def _row(path: Path) -> MeshFormat | None:
    return next((row for row in MESH_FORMATS.values() if path.name.lower().endswith(row.suffixes)), None)


def _mesh(points: NDArray[np.float64], counts: NDArray[np.int64], corners: NDArray[np.int64], name: str) -> Mesh:
    """A mesh of polygons; those of fewer than three corners are left out, larger ones cut into triangles by VTK."""
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(points)):
        raise DeformError(f"a face has a corner that is not among the {len(points)} of the file")
    if (counts == 3).all():
        return Mesh(points, corners.reshape(-1, 3), name)
    import pyvista

    if not np.isfinite(points).all():
        raise DeformError("a corner is not a finite number")
    if (counts > _MOST_CORNERS).any():
        raise DeformError(
            f"a face has {counts.max()} corners, which takes VTK minutes to cut into triangles; "
            f"at most {_MOST_CORNERS} are read"
        )
    kept = counts >= 3
    cells = np.insert(corners, np.cumsum(counts) - counts, counts)  # as VTK has them: the number, then the corners
    cells = cells[np.repeat(kept, counts + 1)]
    return Mesh.from_pyvista(pyvista.PolyData(points, faces=cells), name)


# ---- writing ---------------------------------------------------------------------------------------------------------


def _write_ply(mesh: Mesh, file: BinaryIO) -> None:
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


def _write_stl(mesh: Mesh, file: BinaryIO) -> None:
    corners = mesh.points[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["normal"], rows["corners"] = normal / np.where(length > 0, length, 1), corners
    file.write(b"deformnb".ljust(80, b"\0") + len(rows).to_bytes(4, "little"))
    file.write(rows.tobytes())


def _write_obj(mesh: Mesh, file: BinaryIO) -> None:
    lines = [f"# deformnb: {len(mesh.points)} corners, {len(mesh.faces)} faces\n"]
    lines += [f"v {x!r} {y!r} {z!r}\n" for x, y, z in mesh.points.tolist()]
    lines += [f"f {a} {b} {c}\n" for a, b, c in (mesh.faces + 1).tolist()]
    file.write("".join(lines).encode("ascii"))


def _write_vtp(mesh: Mesh, file: BinaryIO) -> None:
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(mesh.to_pyvista())
    writer.WriteToOutputStringOn()
    writer.SetDataModeToBinary()  # appended raw bytes would be no text, which is what VTK hands over
    writer.Write()
    file.write(writer.GetOutputString().encode("ascii"))


MESH_FORMATS: dict[str, MeshFormat] = {
    "ply": MeshFormat((".ply",), read_ply, _write_ply, "PLY file"),
    "stl": MeshFormat((".stl",), read_stl, _write_stl, "STL file"),
    "obj": MeshFormat((".obj",), read_obj, _write_obj, "OBJ file"),
    "vtp": MeshFormat((".vtp",), read_vtp, _write_vtp, "VTP file"),
}
"""All kinds of surface files by name. A new one is one row."""
