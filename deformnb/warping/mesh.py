"""Triangle meshes: conversion to volumes and back, and deformation of their vertices.

A mesh is made a volume by its signed distance (section 5 of the paper: the horse of figure 6), deformed like any other
volume, and found again as an isosurface. It may also be moved directly: its vertices go where the field takes them.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._entrances import READERS, AbstractCellOutput
from deformnb._typing import Progress
from deformnb.checks import any_array, check_fields, optional_package, short_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume.units import check_unit, ratio
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_grid, as_volume
from deformnb.warping import triangles
from deformnb.warping.points import warp_points

_DISAGREE = "the faces of the mesh do not agree on their outside: where bodies overlap, inside and outside take turns"
_MOST_VOXELS = 4096  # along an edge of the grid of signed_distance


@dataclass(frozen=True, eq=False)
class Mesh(AbstractCellOutput):
    """A surface of triangles; two are equal if all of these fields are.

    Parameters
    ----------
    points : (N, 3) corners (x, y, z) in space, physical, LPS.
    faces : (M, 3) numbers of the corners of each triangle; seen from outside they run counter-clockwise.
    name : shown to people; never used as a path.
    notes : remarks ("3 corners have no place in the result"), for a status line.
    unit : of the corners, a symbol or a name of :data:`~deformnb.volume.units.UNITS`; "" where it is not known.

    Raises
    ------
    DeformError
        If a coordinate is not finite or a face has a corner that is not there.

    Examples
    --------
    >>> corner = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> corner.is_closed, round(corner.enclosed, 4)
    (True, 0.1667)
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    name: str = ""
    notes: tuple[str, ...] = ()
    unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "unit", check_unit(self.unit))
        points, faces = _numbers(self.points, "corners", np.float64), _numbers(self.faces, "faces", np.int64)
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise DeformError(f"corner {bad[0]} of the mesh is not finite ({points[bad[0]].tolist()}); repair it.")
        wrong = np.flatnonzero(((faces < 0) | (faces >= len(points))).any(axis=1))
        if len(wrong):
            raise DeformError(
                f"face {wrong[0]} of the mesh has the corners {faces[wrong[0]].tolist()}, but there are "
                f"only {len(points)} corners, counted from 0."
            )
        check_fields(self, "name", "notes")
        for name, array in (("points", points), ("faces", faces)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mesh):
            return NotImplemented
        same = (self.name, self.notes, self.unit) == (other.name, other.notes, other.unit)
        return same and np.array_equal(self.points, other.points) and np.array_equal(self.faces, other.faces)

    def __hash__(self) -> int:
        return hash((self.name, self.notes, self.unit, self.points.shape, self.faces.shape))

    def __repr__(self) -> str:
        name = f" {self.name[:60]!r}" if self.name else ""
        triangles = f"{len(self.faces)} {'triangle' if len(self.faces) == 1 else 'triangles'}"
        return f"<Mesh{name}: {len(self.points)} corners, {triangles}>"

    @classmethod
    def from_pyvista(cls, surface: Any, name: str = "") -> Mesh:
        """A mesh of a ``pyvista.PolyData`` or VTK's; polygons become triangles, lines and loose points are left out.

        VTK has no units; its lengths are taken as millimetres, which :meth:`to_pyvista` gives.
        """
        pyvista = optional_package("pyvista")
        surface = pyvista.wrap(surface)
        if not isinstance(surface, pyvista.PolyData):
            raise DeformError(
                f"from_pyvista takes a PolyData (a surface), not {type(surface).__name__}; extract_surface() makes one."
            )
        whole = surface.triangulate()
        faces = np.asarray(whole.regular_faces if whole.n_cells else np.zeros((0, 3)), dtype=np.int64)
        return cls(np.asarray(whole.points, dtype=np.float64), faces, name, unit="mm")

    def to_pyvista(self) -> Any:
        """A ``pyvista.PolyData`` with the same corners (float64) and triangles, in mm where the unit is known."""
        points = np.array(self.to_unit("mm").points)
        return optional_package("pyvista").PolyData.from_regular_faces(points, np.array(self.faces))

    def to_unit(self, unit: str) -> Mesh:
        """The same surface in numbers of another unit; itself where its own or the other one is not known.

        Examples
        --------
        >>> Mesh([[1, 2, 3]], [], unit="mm").to_unit("µm").points.tolist()
        [[1000.0, 2000.0, 3000.0]]
        """
        to = check_unit(unit)
        if to in ("", self.unit) or not self.unit:
            return self
        return replace(self, points=self.points * ratio(self.unit, to), unit=to)

    @property
    def box(self) -> NDArray[np.float64]:
        """The smallest and the largest coordinates of the corners: (2, 3)."""
        if not len(self.points):
            raise DeformError("the mesh has no corners, so it has no place in space.")
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @property
    def enclosed(self) -> float:
        """The volume that a closed mesh encloses; negative if its faces are oriented inwards."""
        a, b, c = (self.points[self.faces[:, k]] - self.points.mean(axis=0) for k in range(3))
        return float(np.einsum("nk,nk->", a, np.cross(b, c)) / 6)

    @property
    def is_closed(self) -> bool:
        """True if no face has an edge without a neighbour, so that there is an inside."""
        merged = self.merged()
        return bool(len(merged.faces)) and open_edges(merged.faces)[0] == 0

    def merged(self) -> Mesh:
        """The same surface, where corners at the same place are one and faces that are a line or a point are gone."""
        points, number = np.unique(self.points, axis=0, return_inverse=True)
        faces = number.reshape(-1)[self.faces]
        whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        return replace(self, points=points, faces=faces[whole])


def _numbers(given: ArrayLike, what: str, dtype: Any) -> NDArray[Any]:
    array = any_array(given)
    if array.size == 0:
        return np.zeros((0, 3), dtype=dtype)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in ("iu" if dtype is np.int64 else "iuf"):
        raise DeformError(
            f"the {what} of a mesh must be {'whole ' if dtype is np.int64 else ''}numbers of shape "
            f"(n, 3), got {array.dtype} of shape {array.shape}."
        )
    return np.array(array, dtype=dtype)


MeshLike: TypeAlias = Mesh | os.PathLike[str] | Any
"""Objects that :func:`as_mesh` takes where a mesh is required: a Mesh, a PolyData of pyvista or VTK, the path of a
file."""


def is_surface(given: object) -> bool:
    """Check whether an object is a Mesh, or a surface of pyvista or VTK, which need not be loaded for this."""
    return isinstance(given, Mesh) or any(kind.__name__ == "vtkPolyData" for kind in type(given).__mro__)


def as_mesh(given: MeshLike) -> Mesh:
    """The mesh itself, that of a surface of pyvista or VTK, or of a file.

    Raises
    ------
    DeformError
        For anything else.
    """
    if isinstance(given, Mesh):
        return given
    if isinstance(given, str | os.PathLike):
        found: Mesh = READERS["mesh"](given)
        return found
    if is_surface(given):
        return Mesh.from_pyvista(given)
    raise DeformError(f"a Mesh is needed, got {short_value(given)}; read_mesh(path) and Mesh(points, faces) make one.")


def open_edges(faces: NDArray[np.int64]) -> tuple[int, bool]:
    """Number of edges without a face on their other side, and whether neighbours agree on the outside."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    forward = ends[:, 0] < ends[:, 1]
    key = ends.min(axis=1) * (int(faces.max(initial=0)) + 1) + ends.max(axis=1)
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    turns = np.bincount(number.reshape(-1), weights=np.where(forward, 1.0, -1.0), minlength=len(count))
    return int((count % 2 == 1).sum()), bool((turns == 0).all())


def signed_distance(
    mesh: MeshLike,
    grid: Grid | VolumeLike | None = None,
    *,
    size: int = 128,
    margin: float | None = None,
    progress: Progress | None = None,
) -> Volume:
    """A volume of the distance to a closed mesh: negative inside, zero on the surface, positive outside.

    Parameters
    ----------
    mesh : closed; where its faces agree on their outside, bodies may overlap.
    grid : where the voxels are; default is a straight box around the mesh with cubic voxels.
    size : voxels along the longest side of that box.
    margin : room around the mesh in that box, a length: a deformation needs some. Default is a tenth of the mesh's
        longest side.
    progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    Volume of float32, in physical units. Exact where the surface is within a voxel's diagonal; farther away it may be
    too large by a small part of a voxel. A surface outside the grid counts for the inside, not for distances.

    Notes
    -----
    The smallest value of this volume is its inside, not its background: deform it with ``fill=value_range[1]``, and
    make it a body with :func:`fill_distance` for pictures.

    Raises
    ------
    DeformError
        If the mesh is open (it has no inside then), is empty, or does not meet the grid.

    Examples
    --------
    >>> cube = isosurface(Volume.from_array(np.pad(np.ones((4, 4, 4), np.float32), 2)), 0.5, inside="above")
    >>> distance = signed_distance(cube, size=16)
    >>> distance.shape, float(distance.values.min()) < -1
    ((16, 16, 16), True)
    """
    mesh = as_mesh(mesh)
    merged = mesh.merged()
    if not len(merged.faces):
        raise DeformError("the mesh has no faces, so there is no surface to be distant from.")
    missing, oriented = open_edges(merged.faces)
    if missing:
        raise DeformError(
            f"the mesh is open: {missing} edges have no face on their other side, so it has no inside. "
            "Close its holes first, for example with pyvista's fill_holes."
        )
    lattice = grid_around(mesh, size=size, margin=margin) if grid is None else as_grid(grid)
    merged = merged.to_unit(lattice.unit)
    values = triangles.distances(
        lattice.point_to_index(merged.points), merged.faces, lattice, oriented=oriented, progress=progress
    )
    notes = mesh.notes
    if not oriented:
        notes += (_DISAGREE,)
    return Volume(values, lattice, mesh.name, False, notes)


def grid_around(mesh: Mesh, *, size: int = 128, margin: float | None = None) -> Grid:
    """The straight box of cubic voxels that :func:`signed_distance` puts around a mesh; parameters as there.

    Examples
    --------
    >>> grid_around(Mesh([[0, 0, 0], [10, 0, 0], [0, 5, 5]], [[0, 1, 2]]), size=24).shape
    (14, 14, 24)
    """
    if isinstance(size, bool) or not isinstance(size, int | np.integer) or not 2 <= size <= _MOST_VOXELS:
        raise DeformError(f"size must be a whole number of voxels from 2 to {_MOST_VOXELS}, got {size!r}.")
    low, high = mesh.box
    longest = float((high - low).max())
    room = longest / 10 if margin is None else float(margin)
    if not (np.isfinite(room) and room >= 0 and longest > 0):
        raise DeformError(f"the margin must be a length of 0 or more around a mesh with an extent, got {margin!r}.")
    spacing = (longest + 2 * room) / size
    count = np.maximum(1, np.ceil((high - low + 2 * room) / spacing - 1e-9)).astype(int)
    first = (low + high) / 2 - spacing * (count - 1) / 2
    return Grid(
        (int(count[2]), int(count[1]), int(count[0])), (spacing,) * 3, (first[0], first[1], first[2]), unit=mesh.unit
    )


def fill_distance(distance: VolumeLike, *, ramp: float | None = None) -> Volume:
    """The body of a signed distance as grey values, for all that shows scans: 255 inside, 0 outside, 127.5 between.

    Parameters
    ----------
    distance : negative inside.
    ramp : length over which the grey value rises; default is four voxels, which gives pictures smooth shades.

    Examples
    --------
    >>> fill_distance(Volume.from_array([[[-3.0, -1.0, 0.0, 1.0, 3.0]]])).values.tolist()
    [[[255, 191, 128, 64, 0]]]
    """
    distance = as_volume(distance)
    width = 4 * min(distance.grid.spacing) if ramp is None else float(ramp)
    if not (np.isfinite(width) and width > 0):
        raise DeformError(f"the ramp must be a positive length, got {ramp!r}.")
    grey = np.multiply(distance.finite_values, -255 / width, dtype=np.float32)
    np.clip(grey + np.float32(128), 0, 255, out=grey)
    return replace(distance, values=grey.astype(np.uint8))


def isosurface(volume: VolumeLike, level: float = 0.0, *, inside: Literal["below", "above"] = "below") -> Mesh:
    """The surface on which a volume has a value, found between voxels by linear interpolation.

    Parameters
    ----------
    volume : a signed distance, or any other; NaN counts as background.
    level : the value.
    inside : which side of the surface is the body, "below" the level (a signed distance) or "above" it (a CT). Faces
        are oriented away from it.

    Returns
    -------
    Mesh in the volume's space, for any orientation. It is open where the body leaves the volume.

    Raises
    ------
    DeformError
        If the volume has no place with this value.

    Examples
    --------
    >>> z, y, x = np.indices((17, 17, 17)) - 8.0
    >>> ball = isosurface(Volume.from_array(np.sqrt(x * x + y * y + z * z) - 5))
    >>> ball.is_closed, round(ball.enclosed), round(4 / 3 * np.pi * 5**3)
    (True, 511, 524)
    """
    if inside not in ("below", "above"):
        raise DeformError(f"inside must be 'below' or 'above' the level, got {inside!r}.")
    volume = as_volume(volume)
    low, high = volume.value_range
    if not (np.isfinite(level) and low <= level <= high) or min(volume.shape) < 2:
        raise DeformError(
            f"no surface has the value {level:g}: the volume's values go from {low:g} to {high:g} and it "
            f"has {' x '.join(map(str, volume.shape[::-1]))} voxels."
        )
    # In voxels, and placed by the grid's own formula: the same for every orientation.
    values = volume.finite_values
    values = np.asarray(values, dtype=values.dtype if values.dtype.kind == "f" else np.float32)
    image = optional_package("pyvista").ImageData(dimensions=volume.shape[::-1])
    image.point_data["values"] = values.reshape(-1)
    found = image.contour(
        [float(level)],
        scalars="values",
        method="flying_edges",
        compute_normals=False,
        compute_gradients=False,
        compute_scalars=False,
    )
    if not found.n_cells:  # the level is the smallest value, which no edge between voxels crosses
        raise DeformError(
            f"no surface has the value {level:g}: the volume's values go from {low:g} to {high:g}, and "
            "the level must lie between them."
        )
    faces = np.asarray(found.regular_faces, dtype=np.int64)
    mirrored = np.linalg.det(np.asarray(volume.grid.direction)) < 0
    if mirrored == (inside == "above"):  # VTK's normals point to smaller values
        faces = faces[:, ::-1]
    return Mesh(volume.grid.index_to_point(np.asarray(found.points)), faces, volume.name, unit=volume.grid.unit)


def warp_mesh(mesh: MeshLike, field: AbstractField | HasField, grid: Grid | VolumeLike | None = None) -> Mesh:
    """The mesh in the deformed volume: every corner moves by the field, and the faces are unchanged.

    Corners without a place in the result (where the map folds, or beyond a cut) follow their neighbours; a note has
    their number.

    Parameters
    ----------
    mesh : in the space of the volume that the field deforms, and in its own unit, in which the result is too; a note
        states where that is another than the volume's.
    field : backward displacements in space, or a Deformation.
    grid : of the volume that is deformed; needed for a Deformation.

    See Also
    --------
    deformnb.warp_points : the same for points, with a mask of those that have a place.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> warp_mesh(triangle, Identity()).points.tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    field = as_field(field, grid)
    mesh = as_mesh(mesh)
    if field.dim != 3:
        raise DeformError("a mesh needs a field in space; extrude the field of a plane first.")
    there, notes = field.unit or ("" if grid is None else as_grid(grid).unit), mesh.notes
    here = mesh.to_unit(there)
    moved, found = warp_points(here.points, field)
    if here is not mesh:
        notes += (f"the mesh is in {mesh.unit} and the volume in {there}: its lengths were converted",)
    if not found.all():
        moved = here.points + _smooth(moved - here.points, found, mesh.faces)
        why = "the map folds there, or a cut hides them; they follow their neighbours"
        notes += (f"{np.count_nonzero(~found)} of {len(found)} corners have no place in the result: {why}",)
    return replace(here, points=moved, notes=notes).to_unit(mesh.unit)


def _smooth(moves: NDArray[np.float64], known: NDArray[np.bool_], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Displacements where those of unknown corners are the mean of their neighbours', from the known ones inwards."""
    out, done = np.where(known[:, None], moves, 0.0), known.copy()
    a = np.concatenate([faces, faces[:, ::-1]]).reshape(-1)
    b = np.roll(np.concatenate([faces, faces[:, ::-1]]), -1, axis=1).reshape(-1)
    while not done.all():
        use = done[b] & ~done[a]
        count = np.bincount(a[use], minlength=len(out))
        new = count > 0
        if not new.any():  # a part of the mesh without any known corner: the best places that were found
            return np.where(done[:, None], out, moves)
        for axis in range(3):
            total = np.bincount(a[use], weights=out[b[use], axis], minlength=len(out))
            out[new, axis] = total[new] / count[new]
        done |= new
    return out
