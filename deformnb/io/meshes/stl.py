"""STL, binary and text; written as binary."""

from __future__ import annotations

import re
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.io.files.errors import fail, printable
from deformnb.io.meshes.polygons import CUT_SHORT, Polygons
from deformnb.warping.mesh import Mesh

_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
_HEADER = 84


def read_stl(path: Path) -> Polygons:
    """An STL file, binary or text; corners at exactly the same place become one, as STL has no other connectivity."""
    data = path.read_bytes()
    triangles = int.from_bytes(data[80:_HEADER], "little")
    if len(data) >= _HEADER and len(data) == _HEADER + _ROW.itemsize * triangles:
        corners = np.frombuffer(data, _ROW, triangles, _HEADER)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip().startswith(b"solid") and b"\0" not in data:
        corners = _text(path, data)
    else:
        raise fail(path, "this is no STL file, or it is cut short: its size does not fit the number of its triangles.")
    if not np.isfinite(corners).all():
        raise fail(path, "a corner is not a finite number; repair the mesh.")
    points, number = np.unique(corners, axis=0, return_inverse=True)
    return points, np.full(len(corners) // 3, 3), number.reshape(-1).astype(np.int64)


def _text(path: Path, data: bytes) -> NDArray[np.float64]:
    words = data.split()
    if words.count(b"endsolid") != words.count(b"solid") or words.count(b"facet") != words.count(b"endfacet"):
        raise fail(path, f"a solid or a facet of its text does not end: {CUT_SHORT}.")
    found = re.findall(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    if len(found) % 3 or len(found) != 3 * words.count(b"endfacet"):
        raise fail(path, f"a facet of its text has not three vertices: {CUT_SHORT}.")
    try:
        return np.array(found, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise fail(path, f"a vertex of its text is no number ({printable(error, 60)}).") from error


def write_stl(mesh: Mesh, file: BinaryIO) -> None:
    """A mesh as binary STL."""
    corners = mesh.points[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["normal"], rows["corners"] = normal / np.where(length > 0, length, 1), corners
    file.write(b"deformnb".ljust(80, b"\0") + len(rows).to_bytes(4, "little"))
    file.write(rows.tobytes())
