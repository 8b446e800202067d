"""The animal on a picture from the left, and where the steps take it: by these the studio's exercises are judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats
from deformnb.analysis.folds import Folds, find_folds
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import MODES, Step
from deformnb.imaging.figures import picture_field
from deformnb.imaging.projection import project
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.registration.outlines import outline
from deformnb.session.session import Session
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Volume, VolumeLike, as_volume
from deformnb.warping.foreground import foreground_level, tissue_test
from deformnb.warping.points import warp_points

SIDE: ViewName = "-x"
"""The view in which the exercises are done: from the left."""

LOOK_FROM_LEFT = "Work on the picture from the left (-x), where the head of the fish points left."

ROUNDED = 0.5
"""Millimetres and degrees that may be missing: hints show whole ones."""

# A part of the animal has this many places at least; the target of a point moves one place even outside the picture.
_LEAST_PLACES = 3
# Nodes at which folds are looked for, for each pixel along each axis.
_FINER = 2
# Share of the animal that has to stay on the picture.
_STAYS = 2 / 3
# Share of the places that may have no place in the result before the map counts as folded.
_LOST = 0.01


def lesson_carp() -> Volume:
    """The carp of the lessons, 64 x 128 x 64 voxels.

    Examples
    --------
    >>> lesson_carp().shape
    (64, 128, 64)
    """
    return PHANTOMS["fish"].make((64, 128, 64))


NOTHING_DRAGGED = "Nothing has been dragged yet. Drag a point on the picture, and check again."


def steps_fault(session: Session) -> str:
    """Reason why the steps of a session cannot be judged together; an empty text if they can."""
    moving = _moving_steps(session)
    if any(step.plane is None for step in moving or [session.editing.step]):
        return "A step has its points in space. Remove it or switch it off, and work on the picture from the left (-x)."
    sides = {session.steps.view_of(step.plane) for step in moving or [session.editing.step]}
    if SIDE not in sides:
        return LOOK_FROM_LEFT
    if not moving:
        return NOTHING_DRAGGED
    if len(sides) > 1:
        return (
            "A step drags points on another side. Remove it or switch it off, and use the picture from the left (-x)."
        )
    if any(step.extrusion != "replicate" for step in moving):
        return "The drag is not the same at every depth. Choose Replicate in the panel (Depth), and check again."
    return ""


def _moving_steps(session: Session) -> list[Step]:
    return [step for step in session.editing.deformation.steps if step.enabled and _moves(step)]


def _moves(step: Step) -> bool:
    return any(bool(points.displacement[points.active].any()) for points in step.maps) or any(
        part.motion is not None for part in step.parts
    )


@dataclass(frozen=True)
class MovedAnimal:
    """The animal on the picture of some steps, before the first and after the last.

    Parameters
    ----------
    volume : with the animal.
    steps : one or more, on one plane, the same at every depth.
    mode : how they add up, a name of :data:`~deformnb.document.deformation.MODES`.
    """

    volume: VolumeLike
    steps: tuple[Step, ...]
    mode: str = "compose"

    @classmethod
    def of(cls, session: Session) -> MovedAnimal:
        """The animal of a session in which :func:`steps_fault` finds none."""
        return cls(session.volume, tuple(_moving_steps(session)), session.editing.deformation.mode)

    @cached_property
    def _plane(self) -> Plane:
        plane = self.steps[0].plane
        assert plane is not None
        return plane

    @cached_property
    def field(self) -> AbstractField:
        """Displacement of the picture by all steps."""
        return self._field_of(self.steps)

    def _field_of(self, steps: tuple[Step, ...]) -> AbstractField:
        grid = as_volume(self.volume).grid
        return MODES[self.mode](*(picture_field(step, grid) for step in steps)) if steps else Identity(2)

    def around(self, number: int) -> tuple[AbstractField, AbstractField]:
        """Displacements of the picture by the steps before one of them, and by this one and those after it."""
        at = number if self.mode == "compose" else 0
        return self._field_of(self.steps[:at]), self._field_of(self.steps[at:])

    @cached_property
    def _silhouette(self) -> Picture:
        volume = as_volume(self.volume)
        picture = project(volume, self._plane, "mip")
        there = (picture.values > foreground_level(volume)).astype(np.float32)
        return replace(picture, values=there, window=(0.0, 1.0))

    @cached_property
    def places(self) -> Floats:
        """Places (n, 2) of the animal: all pixels that show tissue."""
        return self._silhouette.raster.points()[self._silhouette.values > 0].reshape(-1, 2).astype(np.float64)

    @cached_property
    def _arrived(self) -> tuple[Floats, NDArray[np.bool_]]:
        return warp_points(self.places, self.field)

    @property
    def moved(self) -> Floats:
        """Places (n, 2) in the result, one for each of :attr:`places`."""
        return self._arrived[0]

    @cached_property
    def upper_edge(self) -> Floats:
        """The upper part of the outline (n, 2): along it, clockwise to the eye, a grows."""
        line = outline(self._silhouette, 0.5)[0]
        return line[np.roll(line, -1, axis=0)[:, 0] > np.roll(line, 1, axis=0)[:, 0]]

    def is_tissue(self, places: Floats) -> NDArray[np.bool_]:
        """Check whether places (n, 2) before the steps show the animal."""
        raster = self._silhouette.raster
        pixels = np.rint((places - raster.origin) / raster.spacing).astype(np.int64)
        within = np.clip(pixels, 0, np.array(raster.shape[::-1]) - 1)
        return np.asarray((pixels == within).all(axis=1) & (self._silhouette.values[within[:, 1], within[:, 0]] > 0))

    @cached_property
    def folds(self) -> Folds:
        """Folds in tissue, on the picture and wherever the animal is moved next to it."""
        raster = self._silhouette.raster
        both = np.concatenate([self.places, self.moved])
        spacing = np.array(raster.spacing)
        size = spacing * raster.shape[::-1]
        low = np.maximum(np.minimum(both.min(axis=0), raster.origin), -size)  # no farther than the fit is of use
        high = np.minimum(np.maximum(both.max(axis=0), np.array(raster.origin) + size), 2 * size)
        count = np.ceil((high - low) / (spacing / _FINER)).astype(int) + 1
        fine = Raster((int(count[1]), int(count[0])), tuple(spacing / _FINER), tuple(low))
        in_space: Callable[[Floats], NDArray[np.bool_]] = tissue_test(as_volume(self.volume), self._plane)

        def is_tissue(places: Floats) -> NDArray[np.bool_]:
            return in_space(self._plane.from_plane(np.column_stack([places, np.zeros(len(places))])))

        return find_folds(self.field, fine, is_tissue=is_tissue)

    def fault(self) -> str:
        """Fault that no exercise allows, a fold in tissue or an animal that is gone; empty if there is none."""
        raster = self._silhouette.raster
        low, high = np.array(raster.origin), raster.origin + np.array(raster.spacing) * raster.shape[::-1]
        if ((self.moved >= low) & (self.moved <= high)).all(axis=1).mean() < _STAYS:
            return "The carp has left the picture. Take back the last drag with Ctrl+Z."
        lost = not self.field.has_cuts and np.mean(~self._arrived[1]) > _LOST
        if self.folds.least <= 0 or lost:
            a, b = self.folds.place
            return (
                f"The carp still folds near a = {a:.0f}, b = {b:.0f}: the smallest determinant is "
                f"{self.folds.least:.2f}. Make the support radius larger in the panel (Shape), since a longer bump is "
                "less steep, or drag less far."
            )
        return ""

    def displacement_of(self, places: Floats) -> Floats:
        """Forward displacements (n, 2) of places before the steps."""
        return warp_points(places, self.field)[0] - places


def reached(lengths: Floats) -> float:
    """The displacement of a part of the animal, of those (n,) of its places: a single place is a speck."""
    return float(np.sort(lengths)[-_LEAST_PLACES]) if len(lengths) >= _LEAST_PLACES else 0.0
