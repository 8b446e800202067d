"""Transplant of a document from the volume on which it was made to another one, with its points aligned.

The alignment "none" keeps all coordinates: right for volumes that lie in one space, such as two scans of one
patient that were aligned. The alignment "box" maps the box of the volume it was made on to the box of the other
one, axis by axis: right for specimens of one posture that differ in size and position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid

# Directions and scales that differ by less are the same: files keep spacings to about seven digits.
_SAME = 1e-5


def _unaligned(deformation: Deformation, _grid: Grid) -> Deformation:
    return deformation


def _box_aligned(deformation: Deformation, grid: Grid) -> Deformation:
    made = deformation.volume
    if made is None or made.grid is None:
        raise DeformError("this document has no place of the volume that it was made on, so its box cannot be "
                          "aligned with another; open it on that volume and save it again.")
    if made.grid == grid:
        return deformation
    box = _Box(made.grid, grid)
    keys = tuple(Keyframe(key.time, tuple(map(box.step, key.steps))) for key in deformation.keyframes)
    # Its box is this grid's now, and not the one that it was made on: it must not be aligned a second time.
    output = None if deformation.output is None else box.grid(deformation.output)
    return replace(deformation, steps=tuple(map(box.step, deformation.steps)), keyframes=keys, volume=None,
                   output=output)


ALIGNMENTS: dict[str, Callable[[Deformation, Grid], Deformation]] = {"none": _unaligned, "box": _box_aligned}
"""Alignments of a document with another volume by name; the first is the default."""


def transplanted(deformation: Deformation, grid: Grid, alignment: str = "none") -> Deformation:
    """The document for a volume of another grid; after the alignment "box" it has no volume of its own any more.

    Parameters
    ----------
    deformation : made on any volume.
    grid : of the volume it shall be applied to.
    alignment : a name of :data:`ALIGNMENTS`.

    Raises
    ------
    DeformError
        If the name is unknown; for "box", if the document does not have the box of its volume, or holds what
        unequal scales would bend: turns, oblique planes.

    Examples
    --------
    >>> from deformnb.document.deformation import VolumeReference
    >>> points = ControlPoints.from_arrays([[2, 4]], [[3, 4]])
    >>> small, large = Grid((8, 8, 8)), Grid((8, 8, 16), (2.0, 1.0, 1.0))
    >>> made = VolumeReference("small", small.shape, small.spacing, "0" * 64, small.origin, small.direction)
    >>> document = replace(Deformation.on_picture(small, "+z", points), volume=made)
    >>> transplanted(document, large, "box").steps[0].points.source.tolist()
    [[8.0, 4.0]]
    """
    if alignment not in ALIGNMENTS:
        raise DeformError(f"unknown alignment {alignment!r}; choose one of {', '.join(ALIGNMENTS)}.")
    return ALIGNMENTS[alignment](deformation, grid)


def with_true_spacing(deformation: Deformation, grid: Grid) -> tuple[Deformation, str]:
    """A document for a volume whose file has a wrong spacing, and a notice; any other document unchanged, and "".

    One that was made with the spacing of the file (see :meth:`Deformation.older_spacing`) is aligned with the
    same voxels in the true spacing, to be edited further: at its points the map is the same, between them it is not.

    Parameters
    ----------
    grid : of the volume on which it shall be edited.

    Raises
    ------
    OtherVolumeError
        If it holds what cannot be aligned with them.
    """
    known, made = deformation.older_spacing(grid), deformation.volume
    if known is None or made is None:
        return deformation, ""
    there = made.grid or known.as_in_file(grid)
    was = replace(made, origin=there.origin, direction=there.direction)
    try:
        moved = transplanted(replace(deformation, volume=was), grid, "box")
    except DeformError as error:
        raise OtherVolumeError(f"{known.older_note}, and cannot be moved to the true one: {error} To go on, read "
                               f"the volume with spacing={known.header_spacing}.") from None
    now = replace(made, spacing=grid.spacing, origin=grid.origin, direction=grid.direction)
    return replace(moved, volume=now), (
        f"{known.older_note}. Its points were moved to the same voxels; between them the map differs a little. "
        "Deformation.apply and deformnb warp still give the voxels of then, from the document as it was saved.")


class _Box:
    """The affine map ``x -> A x + t`` of one grid's box to another's: index axes to index axes, edges to edges."""

    def __init__(self, old: Grid, new: Grid) -> None:
        cells = np.array(new.shape[::-1]) / np.array(old.shape[::-1])
        self.matrix = new.matrix @ np.diag(cells) @ np.linalg.inv(old.matrix)
        corner = [g.origin - g.matrix @ np.full(3, 0.5) for g in (old, new)]
        self.shift = corner[1] - self.matrix @ corner[0]
        self.old, self.new = old, new

    def grid(self, output: Grid) -> Grid:
        """A box around the other volume, made of its voxels."""
        corners = (output.corners() @ self.matrix.T) + self.shift
        index = self.new.point_to_index(corners)
        low, high = np.floor(index.min(axis=0) + 0.5 + _SAME), np.ceil(index.max(axis=0) + 0.5 - _SAME)
        x, y, z = (int(n) for n in low)
        nx, ny, nz = (max(1, int(n)) for n in high - low)
        return self.new.crop((z, y, x), (nz, ny, nx))

    def step(self, step: Step) -> Step:
        """One step on the other volume."""
        if step.plane is None:
            to: _Map = _Map(self.matrix, self.shift)
            plane = None
        else:
            plane, to = self._plane(step.plane)
        support = step.support * to.scale if isinstance(step.support, float) else step.support
        chosen = step.chosen_support and step.chosen_support._replace(radius=step.chosen_support.radius * to.scale)
        return replace(step, plane=plane, support=support, chosen_support=chosen, maps=tuple(map(to.points, step.maps)),
                       cuts=tuple(replace(cut, region=to.region(cut.region)) for cut in step.cuts),
                       parts=tuple(map(to.part, step.parts)))

    def _plane(self, plane: Plane) -> tuple[Plane, _Map]:
        """The image of a plane, and the map of its coordinates."""
        moved = plane.frame @ self.matrix.T
        lengths = np.linalg.norm(moved, axis=1)
        u, v, n = moved / lengths[:, None]
        if max(abs(u @ v), abs(u @ n), abs(v @ n)) > _SAME:
            raise DeformError("an oblique picture would be sheared by the unequal scales of the two boxes; apply this "
                              "document as it is.")
        v = v - (v @ u) * u
        v /= np.linalg.norm(v)
        if np.cross(u, v) @ n < 0:
            raise DeformError("one of the volumes is the mirror image of the other; apply this document as it is.")
        origin = self.matrix @ np.asarray(plane.origin) + self.shift
        return Plane(tuple(origin), tuple(u), tuple(v)), _Map(np.diag(lengths[:2]), np.zeros(2))


class _Map:
    """An affine map of a picture's coordinates, or of space, and what it makes of all that a step holds."""

    def __init__(self, matrix: NDArray[np.float64], shift: NDArray[np.float64]) -> None:
        self.matrix, self.shift = matrix, shift
        self.scale = float(abs(np.linalg.det(matrix)) ** (1 / len(matrix)))
        self.is_similar = np.allclose(matrix @ matrix.T, self.scale**2 * np.eye(len(matrix)),
                                      atol=_SAME * self.scale**2)

    def __call__(self, places: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(np.asarray(places, dtype=np.float64) @ self.matrix.T + self.shift)

    def points(self, points: ControlPoints) -> ControlPoints:
        return replace(points, source=self(points.source), target=self(points.target),
                       radius=points.radius * self.scale)

    def part(self, part: RigidPart) -> RigidPart:
        motion = part.motion
        if motion is not None:
            turns = not np.allclose(motion.matrix, np.eye(motion.dim), atol=_SAME)
            if turns and not self.is_similar:
                raise DeformError(f"{part.label} turns, which the unequal scales of the two boxes would bend; apply "
                                  "this document as it is.")
            way = motion(np.zeros(motion.dim))  # of the origin, which the map sends to its shift
            matrix = self.matrix @ np.asarray(motion.matrix) @ np.linalg.inv(self.matrix)
            motion = RigidMotion(matrix, self(way) - matrix @ self.shift)
        reach = None if part.reach is None else part.reach * self.scale
        pivot = None if part.pivot is None else tuple(self(part.pivot).tolist())
        return replace(part, region=self.region(part.region), motion=motion, reach=reach, pivot=pivot)

    def region(self, region: AbstractRegion) -> AbstractRegion:
        if isinstance(region, HalfSpace):
            normal = np.linalg.inv(self.matrix).T @ np.asarray(region.normal)
            return HalfSpace(tuple(self(region.point)), tuple(normal))
        if isinstance(region, Line | Polygon):
            return replace(region, vertices=tuple(map(tuple, self(region.vertices).tolist())))
        if isinstance(region, Mask):
            return replace(region, lattice=self._lattice(region.lattice))
        raise DeformError(f"a region of the kind {region.kind!r} has no place on another volume; apply this document "
                          "as it is.")

    def _lattice(self, lattice: Raster | Grid) -> Raster | Grid:
        if isinstance(lattice, Grid):
            affine = np.eye(4)
            affine[:3, :3], affine[:3, 3] = self.matrix @ lattice.matrix, self(lattice.origin)
            return Grid.from_affine(lattice.shape, affine)  # refuses what would be sheared
        spacing = np.asarray(lattice.spacing) * np.diag(self.matrix)
        return replace(lattice, spacing=tuple(spacing.tolist()), origin=tuple(self(lattice.origin).tolist()))


