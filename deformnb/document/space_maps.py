"""Affine maps of space and of the steps of a document: to another volume's box, or another unit of length.

The steps are those of :mod:`deformnb.document.deformation`, which uses this module.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.rbf.support import ChosenSupport
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.units import ratio
from deformnb.volume.volume import Grid

SAME = 1e-5
"""Directions and scales that differ by less are the same: files store spacings to about seven digits."""


class HasLengths(Protocol):
    """A step, by what has a place or a length in it."""

    @property
    def maps(self) -> tuple[ControlPoints, ...]:
        """The sets of control points."""

    @property
    def points(self) -> ControlPoints:
        """The first of them."""

    @property
    def plane(self) -> Plane | None:
        """The plane of the picture; None in space."""

    @property
    def support(self) -> Any:
        """The support radius, or its name."""

    @property
    def chosen_support(self) -> ChosenSupport | None:
        """The support that the points chose."""

    @property
    def parts(self) -> tuple[RigidPart, ...]:
        """The rigid parts."""

    @property
    def cuts(self) -> tuple[Cut, ...]:
        """Along which tissue comes apart."""


AnyStep = TypeVar("AnyStep", bound=HasLengths)
_Shape = TypeVar("_Shape", RigidPart, Cut)


def _to_unit(shape: _Shape, unit: str) -> _Shape:
    """A part or a cut whose mask, made of labels in their unit, is in numbers of another one."""
    lattice = getattr(shape.region, "lattice", None)
    if not isinstance(lattice, Grid) or not lattice.unit:
        return shape
    assert isinstance(shape.region, Mask)
    return replace(shape, region=replace(shape.region, lattice=replace(lattice.to_unit(unit), unit="")))


def rescaled_step(step: AnyStep, unit: str) -> AnyStep:
    """A step in numbers of a unit of length, which its points and masks do not state any more."""
    parts = tuple(_to_unit(part, unit) for part in step.parts)
    cuts = tuple(_to_unit(cut, unit) for cut in step.cuts)
    if any(new is not old for new, old in zip((*parts, *cuts), (*step.parts, *step.cuts), strict=True)):
        step = replace(step, parts=parts, cuts=cuts)  # type: ignore[type-var]
    if not step.points.unit:
        return step
    moved = step if step.points.unit == unit else Scale(ratio(step.points.unit, unit)).step(step)
    maps = tuple(replace(points, unit="") for points in moved.maps)
    return replace(moved, maps=maps)  # type: ignore[type-var]


class SpaceMap:
    """An affine map ``x -> A x + t`` of space, and the image of a step under it."""

    def __init__(self, matrix: NDArray[np.float64], shift: NDArray[np.float64]) -> None:
        self.matrix, self.shift = matrix, shift

    def step(self, step: AnyStep) -> AnyStep:
        """One step on the other volume."""
        if step.plane is None:
            to: PlaneMap = PlaneMap(self.matrix, self.shift)
            plane = None
        else:
            plane, to = self._plane(step.plane)
        support = step.support * to.scale if isinstance(step.support, int | float) else step.support
        chosen = step.chosen_support and step.chosen_support._replace(radius=step.chosen_support.radius * to.scale)
        cuts = tuple(replace(cut, region=to.region(cut.region)) for cut in step.cuts)
        return replace(  # type: ignore[type-var]
            step,
            plane=plane,
            support=support,
            chosen_support=chosen,
            maps=tuple(map(to.points, step.maps)),
            cuts=cuts,
            parts=tuple(map(to.part, step.parts)),
        )

    def _plane(self, plane: Plane) -> tuple[Plane, PlaneMap]:
        """The image of a plane, and the map of its coordinates."""
        moved = plane.frame @ self.matrix.T
        lengths = np.linalg.norm(moved, axis=1)
        u, v, n = moved / lengths[:, None]
        if max(abs(u @ v), abs(u @ n), abs(v @ n)) > SAME:
            raise DeformError(
                "an oblique picture would be sheared by the unequal scales of the two boxes; apply this "
                "document as it is."
            )
        v = v - (v @ u) * u
        v /= np.linalg.norm(v)
        if np.cross(u, v) @ n < 0:
            raise DeformError("one of the volumes is the mirror image of the other; apply this document as it is.")
        origin = self.matrix @ np.asarray(plane.origin) + self.shift
        return Plane(tuple(origin), tuple(u), tuple(v)), PlaneMap(np.diag(lengths[:2]), np.zeros(2))


class Scale(SpaceMap):
    """Lengths in another unit."""

    def __init__(self, factor: float) -> None:
        super().__init__(factor * np.eye(3), np.zeros(3))
        self.factor = factor

    def _plane(self, plane: Plane) -> tuple[Plane, PlaneMap]:
        origin = (np.asarray(plane.origin) * self.factor).tolist()
        return replace(plane, origin=tuple(origin)), PlaneMap(self.factor * np.eye(2), np.zeros(2))


class PlaneMap:
    """An affine map of a picture's coordinates, or of space, and the images of all parts of a step under it."""

    def __init__(self, matrix: NDArray[np.float64], shift: NDArray[np.float64]) -> None:
        self.matrix, self.shift = matrix, shift
        self.scale = float(abs(np.linalg.det(matrix)) ** (1 / len(matrix)))
        self.is_similar = np.allclose(matrix @ matrix.T, self.scale**2 * np.eye(len(matrix)), atol=SAME * self.scale**2)

    def __call__(self, places: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(np.asarray(places, dtype=np.float64) @ self.matrix.T + self.shift)

    def points(self, points: ControlPoints) -> ControlPoints:
        return replace(
            points, source=self(points.source), target=self(points.target), radius=points.radius * self.scale
        )

    def part(self, part: RigidPart) -> RigidPart:
        motion = part.motion
        if motion is not None:
            turns = not np.allclose(motion.matrix, np.eye(motion.dim), atol=SAME)
            if turns and not self.is_similar:
                raise DeformError(
                    f"{part.label} turns, which the unequal scales of the two boxes would bend; apply "
                    "this document as it is."
                )
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
        raise DeformError(
            f"a region of the kind {region.kind!r} has no place on another volume; apply this document as it is."
        )

    def _lattice(self, lattice: Raster | Grid) -> Raster | Grid:
        if isinstance(lattice, Grid):
            affine = np.eye(4)
            affine[:3, :3], affine[:3, 3] = self.matrix @ lattice.matrix, self(lattice.origin)
            return Grid.from_affine(lattice.shape, affine)  # refuses what would be sheared
        spacing = np.asarray(lattice.spacing) * np.diag(self.matrix)
        return replace(lattice, spacing=tuple(spacing.tolist()), origin=tuple(self(lattice.origin).tolist()))
