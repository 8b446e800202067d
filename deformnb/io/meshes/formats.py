"""Formats of surface files: their table, reading and writing.

None of the formats states the directions of its axes. Coordinates are not converted: LPS, as of volumes.

The parsers are short ones with bounds on everything, because VTK's end the process on damaged files.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package
from deformnb.errors import DeformError
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import Damage, fail, human_bytes, printable
from deformnb.io.files.memory import default_limit
from deformnb.io.files.objects import copied_from_disk, copied_to_disk, is_open_file, name_for
from deformnb.io.files.paths import as_path, named_path, regular_file
from deformnb.io.meshes.obj import read_obj, write_obj
from deformnb.io.meshes.ply import read_ply, write_ply
from deformnb.io.meshes.polygons import Polygons
from deformnb.io.meshes.stl import read_stl, write_stl
from deformnb.io.meshes.vtp import read_vtp, write_vtp
from deformnb.warping.mesh import Mesh, MeshLike, as_mesh

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
    """Check for the suffix of a surface file.

    Examples
    --------
    >>> is_mesh("horse.PLY"), is_mesh("carp.nii.gz")
    (True, False)
    """
    return _row(named_path(path)) is not None


def read_mesh(
    path: str | os.PathLike[str] | BinaryIO, *, name: str | None = None, unit: str = "mm", suffix: str | None = None
) -> Mesh:
    """Read a surface; polygons become triangles, colours and textures are left out.

    Parameters
    ----------
    path : a file of one of :data:`MESH_FORMATS`, its address, or an open file of bytes.
    name : of the mesh; by default the file's name without its suffix.
    unit : of its lengths, which none of these files states: by default millimetres, as :func:`write_mesh` writes them
        and 3D Slicer means them.
    suffix : of an open file, by which its format is known (".ply"); by default that of its name.

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
    if is_open_file(path):
        with copied_to_disk(path, name_for(path, suffix)) as copy:
            return read_mesh(copy, name="" if name is None and suffix is not None else name, unit=unit)
    place = regular_file(input_path(path))
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
    mesh, place = read_mesh(path), input_path(path)
    low, high = (", ".join(f"{c:.6g}" for c in end) for end in mesh.box)
    row = _row(place)
    assert row is not None
    return {
        "file": printable(place.name),
        "kind": row.description,
        "corners": str(len(mesh.points)),
        "faces": str(len(mesh.faces)),
        "from": low,
        "to": high,
        "closed": "yes" if mesh.is_closed else "no, so it has no inside",
    }


def write_mesh(
    mesh: MeshLike, path: str | os.PathLike[str] | BinaryIO, *, overwrite: bool = True, suffix: str | None = None
) -> None:
    """Write a surface to a file, atomically, or to an open one; the suffix chooses the format.

    PLY, OBJ and VTP store all digits of the corners; STL rounds them to seven and writes each corner with each face.
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
    if is_open_file(path):
        with copied_from_disk(path, name_for(path, suffix)) as copy:
            write_mesh(mesh, copy)
        return
    place, mesh = as_path(path), as_mesh(mesh)
    row = check_mesh_target(place)
    with atomic_write(place, overwrite=overwrite) as file:
        row.write(mesh.to_unit("mm"), file)


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
    pyvista = optional_package("pyvista")
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


MESH_FORMATS: dict[str, MeshFormat] = {
    "ply": MeshFormat((".ply",), read_ply, write_ply, "PLY file"),
    "stl": MeshFormat((".stl",), read_stl, write_stl, "STL file"),
    "obj": MeshFormat((".obj",), read_obj, write_obj, "OBJ file"),
    "vtp": MeshFormat((".vtp",), read_vtp, write_vtp, "VTP file"),
}
"""All kinds of surface files by name. A new one is one row."""
