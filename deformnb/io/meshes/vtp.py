"""VTK's surfaces in XML (.vtp)."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package
from deformnb.io.files.errors import fail, human_bytes
from deformnb.io.files.memory import default_limit
from deformnb.io.files.texts import integers
from deformnb.io.files.vtk_xml import StoredArray, Tag, VtkXml
from deformnb.io.meshes.polygons import CUT_SHORT, Polygons, whole_numbers
from deformnb.warping.mesh import Mesh


def read_vtp(path: Path) -> Polygons:
    """The polygons of all pieces of a VTP file; strips become triangles, vertices and lines are left out."""
    file = VtkXml(path, "PolyData")
    pieces = [tag for tag in file.tags if tag.name == "Piece"]
    if not pieces:
        raise fail(path, f"it has no piece of a surface: {CUT_SHORT}.")
    points, counts, corners, first = [], list[NDArray[np.int64]](), list[NDArray[np.int64]](), 0
    for piece in pieces:
        points.append(_points(file, piece))
        cells = [_cells(file, piece, "Polys"), _triangles(*_cells(file, piece, "Strips"))]
        for sizes, numbers in cells:
            if len(numbers) and not (numbers.min() >= 0 and numbers.max() < len(points[-1])):
                raise fail(path, f"a face has a corner that is not among the {len(points[-1])} of its piece.")
            counts.append(sizes)
            corners.append(numbers + first)
        first += len(points[-1])
    return np.concatenate(points), np.concatenate(counts), np.concatenate(corners)


def _points(file: VtkXml, piece: Tag) -> NDArray[np.float64]:
    count = _count(file, piece, "NumberOfPoints")
    array = next(
        (
            tag
            for tag in file.tags
            if tag.name == "DataArray" and tag.is_inside("Points") and tag.parent and tag.parent.parent is piece
        ),
        None,
    )
    if not count:
        return np.zeros((0, 3))
    if array is None or array.attributes.get("NumberOfComponents") != "3":
        raise fail(file.path, f"a piece has no places of three numbers for its {count} corners: {CUT_SHORT}.")
    return _check_memory(file.locate_array(array, 3 * count)).values().astype(np.float64).reshape(-1, 3)


def _cells(file: VtkXml, piece: Tag, kind: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number of corners of each cell of a kind, and their indices."""
    count = _count(file, piece, f"NumberOf{kind}")
    if not count:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    arrays = {
        tag.attributes.get("Name"): tag
        for tag in file.tags
        if tag.name == "DataArray" and tag.is_inside(kind) and tag.parent and tag.parent.parent is piece
    }
    if not {"offsets", "connectivity"} <= arrays.keys():
        raise fail(
            file.path, f"it declares {count} {kind.lower()} without their offsets and connectivity: {CUT_SHORT}."
        )
    ends = whole_numbers(file.path, _check_memory(file.locate_array(arrays["offsets"], count)).values())
    sizes = np.diff(ends, prepend=0)
    if (sizes < 0).any():
        raise fail(file.path, f"the offsets of its {kind.lower()} do not grow: {CUT_SHORT}.")
    numbers = _check_memory(file.locate_array(arrays["connectivity"], int(ends[-1]))).values()
    return sizes, whole_numbers(file.path, numbers)


def _count(file: VtkXml, piece: Tag, name: str) -> int:
    count = integers(file.path, name, piece.attributes.get(name, "0"), 1)[0]
    if count < 0:
        raise fail(file.path, f"its {name} is {count}: {CUT_SHORT}.")
    return count


def _check_memory(array: StoredArray) -> StoredArray:
    limit = default_limit()
    if 4 * array.size > limit:  # its bytes in parts and joined, then its numbers as used
        raise fail(
            array.file.path,
            f"its header declares an array of {human_bytes(array.size)}, for which there is "
            f"not enough memory ({human_bytes(limit)} may be used), or {CUT_SHORT}.",
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


def write_vtp(mesh: Mesh, file: BinaryIO) -> None:
    """A mesh as VTP with arrays in base64."""
    writer = optional_package("vtkmodules.vtkIOXML").vtkXMLPolyDataWriter()
    writer.SetInputData(mesh.to_pyvista())
    writer.WriteToOutputStringOn()
    writer.SetDataModeToBinary()  # appended raw bytes would be no text, which is the form that VTK returns
    writer.Write()
    file.write(writer.GetOutputString().encode("ascii"))
