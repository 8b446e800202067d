"""Surface files: PLY, STL, OBJ and VTP.

None of them says in which directions its axes point. Coordinates are taken as they are: LPS, as volumes have.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import Damage, as_path, fail, human_bytes, regular_file, shown
from deformnb.io.memory import default_limit
from deformnb.io.mesh_parsers import Polygons, read_obj, read_ply, read_stl, read_vtp
from deformnb.surfaces import Mesh

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
    """True if the end of a name says that it is a surface file.

    Examples
    --------
    >>> is_mesh("horse.PLY"), is_mesh("carp.nii.gz")
    (True, False)
    """
    return _row(Path(path)) is not None


def read_mesh(path: str | os.PathLike[str], *, name: str | None = None) -> Mesh:
    """Read a surface; polygons become triangles, colours and textures are left out.

    Parameters
    ----------
    path : a file of one of :data:`MESH_FORMATS`.
    name : of the mesh; by default the file's name without its suffix.

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
        raise fail(place, f"the end of its name says no kind of surface file; known are {mesh_suffixes()}.")
    size, limit = place.stat().st_size, default_limit()
    if size * _MEMORY_PER_BYTE > limit:
        raise fail(place, f"reading it takes about {human_bytes(size * _MEMORY_PER_BYTE)} of memory and "
                          f"{human_bytes(limit)} may be used; thin the mesh out first.")
    with Damage(place, "thin the mesh out first"):
        mesh = _mesh(*row.read(place), place.stem if name is None else name)
    if not len(mesh.faces):
        raise fail(place, f"there are no faces in it: it is no {row.description} of a surface, or it is damaged.")
    return mesh


def describe_mesh(path: str | os.PathLike[str]) -> dict[str, str]:
    """What is in a surface file, for people."""
    mesh, place = read_mesh(path), Path(path)
    low, high = (", ".join(f"{c:.6g}" for c in end) for end in mesh.box)
    row = _row(place)
    assert row is not None
    return {"file": shown(place.name), "kind": row.description, "corners": str(len(mesh.points)),
            "faces": str(len(mesh.faces)), "from": low, "to": high,
            "closed": "yes" if mesh.is_closed else "no, so it has no inside"}


def write_mesh(mesh: Mesh, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write a surface; the suffix chooses the format. The file is complete at once or untouched.

    PLY, OBJ and VTP keep all digits of the corners; STL rounds them to seven and writes each corner with each face.

    Raises
    ------
    VolumeFileError
        If the folder is missing or read-only, the disk is full, or the suffix is unknown.
    """
    place = as_path(path)
    row = check_mesh_target(place)
    with atomic_write(place, overwrite=overwrite) as file:
        row.write(mesh, file)


def check_mesh_target(path: Path) -> MeshFormat:
    """The format that a path to write to asks for; VolumeFileError if there is none of its suffix."""
    row = _row(path)
    if row is None:
        raise fail(path, f"the end of its name says no kind of surface file; write {mesh_suffixes()}.")
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
        raise DeformError(f"a face has {counts.max()} corners, which takes VTK minutes to cut into triangles; "
                          f"at most {_MOST_CORNERS} are read")
    kept = counts >= 3
    cells = np.insert(corners, np.cumsum(counts) - counts, counts)  # as VTK has them: the number, then the corners
    cells = cells[np.repeat(kept, counts + 1)]
    return Mesh.from_pyvista(pyvista.PolyData(points, faces=cells), name)


# ---- writing ---------------------------------------------------------------------------------------------------------


def _write_ply(mesh: Mesh, file: BinaryIO) -> None:
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.points)}",
              *(f"property double {axis}" for axis in "xyz"), f"element face {len(mesh.faces)}",
              "property list uchar int vertex_indices", "end_header", ""]
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
